// What all passes of a band share: camera, motion of the environment, edits, and where the tables of the fields lie.
// The Rust side is `frame.rs`; every member is a multiple of four words long, so that both sides agree without padding.

struct Frame {
    // Where the camera stands, world units.
    eye: vec4<f32>,
    // Columns of the camera's rotation: right, up, backward.
    camera_x: vec4<f32>,
    camera_y: vec4<f32>,
    camera_z: vec4<f32>,
    // fx, fy, cx, cy in pixels.
    lens: vec4<f32>,
    // Width and height of the picture, first row of the band, rows of the band.
    size: vec4<u32>,
    // Least and most paths of a pixel, most vertices of a path, samples a ray.
    options: vec4<u32>,
    // Whether there is an object, what is behind it (BEHIND_*), which layer (LAYER_*); samples of a ray where the caller
    // gives rays, else whether the tone map is neutral.
    flags: vec4<u32>,
    // Centre and radius of the ball that the mesh is scaled to.
    ball: vec4<f32>,
    // Start of a ray that leaves the surface (world units), rows of ball-space corners before the world's, turn across a beam
    // above which a pixel gets more of them (radians).
    start: vec4<f32>,
    // Rows of the map from world points to field coordinates.
    field_x: vec4<f32>,
    field_y: vec4<f32>,
    field_z: vec4<f32>,
    // Gain of the environment's radiance; field units a world unit.
    motion: vec4<f32>,
    // Lower corner and side of the cube of the surface field.
    material_cube: vec4<f32>,
    // Factor of the diffuse part; exposure of the picture.
    diffuse: vec4<f32>,
    // Factor of the specular part; exponent of the display transform.
    specular: vec4<f32>,
    // Of each level: cells per axis, first row, mask of the hash (0: dense), unused.
    environment_levels: array<vec4<u32>, 16>,
    material_levels: array<vec4<u32>, 16>,
}

const BEHIND_NOTHING: u32 = 0u;
const BEHIND_SHARP: u32 = 1u;
const BEHIND_BLURRED: u32 = 2u;

const LAYER_FINAL: u32 = 0u;
const LAYER_DIFFUSE: u32 = 1u;
const LAYER_SPECULAR: u32 = 2u;
const LAYER_ENVIRONMENT: u32 = 3u;

// Slope of the weight of a grid's level against footprint / cell.
const FOOTPRINT_SLOPE: f32 = 2.5;
const TAU: f32 = 6.2831853;
// No ray, no path.
const NONE: u32 = 0x3fffffffu;

@group(0) @binding(0) var<uniform> frame: Frame;

// Numbers of paths and rays of the band so far.
struct Counters {
    n_paths: atomic<u32>,
    n_rays: atomic<u32>,
}
@group(0) @binding(9) var<storage, read_write> counters: Counters;

struct Ray {
    origin: vec3<f32>,
    // Unit.
    direction: vec3<f32>,
}

// The world ray through a picture point, pixels.
fn camera_ray(at: vec2<f32>) -> Ray {
    let p = (at - frame.lens.zw) / frame.lens.xy;
    let direction = frame.camera_x.xyz * p.x - frame.camera_y.xyz * p.y - frame.camera_z.xyz;
    return Ray(frame.eye.xyz, normalize(direction));
}

fn orthonormal_basis(n: vec3<f32>) -> mat2x3<f32> {
    let sign = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    return mat2x3<f32>(
        vec3(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
        vec3(b, sign + n.y * n.y * a, -n.y),
    );
}

fn normalize_or(v: vec3<f32>, other: vec3<f32>) -> vec3<f32> {
    let square = dot(v, v);
    if square > 1e-30 {
        return v * inverseSqrt(square);
    }
    return other;
}

// Groups of threads for the paths, then for the rays: what an indirect dispatch takes.
@group(0) @binding(17) var<storage, read_write> groups_wanted: array<u32, 6>;

@compute @workgroup_size(1)
fn count() {
    let wanted = vec2(atomicLoad(&counters.n_paths), atomicLoad(&counters.n_rays));
    for (var i = 0u; i < 2u; i++) {
        let n = max((wanted[i] + 63u) / 64u, 1u);
        let x = min(n, 65535u);
        groups_wanted[3u * i] = x;
        groups_wanted[3u * i + 1u] = (n + x - 1u) / x;
        groups_wanted[3u * i + 2u] = 1u;
    }
}

// The number of a thread of a dispatch over more groups than one axis holds.
fn thread_index(id: vec3<u32>, groups: vec3<u32>) -> u32 {
    return id.y * groups.x * 64u + id.x;
}
