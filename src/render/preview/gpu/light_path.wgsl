// The light paths of a band: points that a reflection meets one after the other, and the rays that their lobes need
// (`neif/light/light_path.rs`, `neif/light/lobe.rs`); what they bring is put together in `compose.wgsl`.

const KAPPA_ALPHA2: f32 = 0.35;
const KAPPA_MAX: f32 = 1e6;
const KAPPA_SERIES: f32 = 0.2;
const CORE_ANGLE: f32 = 0.09;
const INNER_RING_END: f32 = 0.32;
const SHARE_MARGIN: f32 = 0.01;
// Standard deviation of the cone through which a blurred background is seen, radians.
const BLUR_STD: f32 = 0.105;
// Rows of a path in `lit`, two a vertex.
const LIT_ROWS: u32 = 8u;
// Set in a ray's number where the path goes on.
const GOES_ON: u32 = 0x80000000u;

// Of each vertex: what it sends on itself and the blocked share of its lobe; the factor of the light that its lobe
// gathers and the ray of the free part. Floats as their bits.
@group(0) @binding(13) var<storage, read_write> lit: array<vec4<u32>>;

struct Lobe {
    kappa: f32,
    mean_length: f32,
    variance: f32,
}

// Blur of the beam that comes from the eye, as variances per transverse axis: of position, of direction.
struct Blur {
    position: f32,
    direction: f32,
}

// Length of the mean direction, `coth kappa - 1/kappa`.
fn mean_length(kappa: f32) -> f32 {
    if kappa < KAPPA_SERIES {
        let k2 = kappa * kappa;
        return kappa * (1.0 / 3.0 - k2 * (1.0 / 45.0 - k2 * (2.0 / 945.0)));
    }
    if kappa > 20.0 {
        return 1.0 - 1.0 / kappa;
    }
    return 1.0 / tanh(kappa) - 1.0 / kappa;
}

fn lobe_of(roughness: f32) -> Lobe {
    let r = clamp(roughness, 1e-4, 1.0);
    let alpha = r * r;
    let kappa = min(KAPPA_ALPHA2 / (alpha * alpha), KAPPA_MAX);
    let mean = mean_length(kappa);
    return Lobe(kappa, mean, mean / kappa);
}

// Mass of a von Mises–Fisher lobe within an angle whose `1 - cos` is given.
fn lobe_mass(kappa: f32, one_less_cos: f32) -> f32 {
    return (1.0 - exp(-kappa * one_less_cos)) / (1.0 - exp(-2.0 * kappa));
}

// Blocked share of a lobe: each group of rays weighted by the lobe's mass there.
fn blocked_share(shares: vec3<f32>, kappa: f32) -> f32 {
    let inside_core = lobe_mass(kappa, 1.0 - cos(CORE_ANGLE));
    let inside_ring = lobe_mass(kappa, 1.0 - cos(INNER_RING_END));
    let share = inside_core * shares.x + (inside_ring - inside_core) * shares.y + (1.0 - inside_ring) * shares.z;
    return clamp(share, 0.0, 1.0);
}

fn field_from_world(p: vec3<f32>) -> vec3<f32> {
    let q = vec4(p, 1.0);
    return vec3(dot(frame.field_x, q), dot(frame.field_y, q), dot(frame.field_z, q));
}

// A world direction in the axes of the environment.
fn field_direction(d: vec3<f32>) -> vec3<f32> {
    let turned = vec3(dot(frame.field_x.xyz, d), dot(frame.field_y.xyz, d), dot(frame.field_z.xyz, d));
    return turned / frame.motion.w;
}

// The cone that gathers light along the lobe, for a beam that is blurred already.
fn lobe_ray(at: SurfacePoint, lobe: Lobe, blur: Blur) -> FieldRay {
    let base = sqrt(at.base * at.base + blur.position) * frame.motion.w;
    return FieldRay(
        field_from_world(at.position), base,
        field_direction(reflected(at)), at.spread,
        lobe.mean_length, lobe.variance + blur.direction, lobe.kappa, 0.0,
    );
}

fn push_ray(ray: FieldRay) -> u32 {
    let number = atomicAdd(&counters.n_rays, 1u);
    rays[number] = ray;
    return number;
}

// The ray of a picture point into the environment.
fn push_background_ray(at: vec2<f32>) -> u32 {
    let seen_ray = camera_ray(at);
    let origin = field_from_world(seen_ray.origin);
    let direction = field_direction(seen_ray.direction);
    if frame.flags.y == BEHIND_BLURRED {
        let variance = BLUR_STD * BLUR_STD;
        let kappa = 1.0 / variance;
        return push_ray(FieldRay(origin, 0.0, direction, 0.0, mean_length(kappa), variance, kappa, 0.0));
    }
    return push_ray(FieldRay(origin, 0.0, direction, PIXEL_STD / frame.lens.x, 1.0, 0.0, NO_LOBE, 0.0));
}

// Schlick's Fresnel per colour.
fn fresnel(tint: vec3<f32>, cos_eye: f32) -> vec3<f32> {
    let m = clamp(1.0 - cos_eye, 0.0, 1.0);
    let m2 = m * m;
    return tint + (1.0 - tint) * (m2 * m2 * m);
}

@compute @workgroup_size(64)
fn aim(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let path = thread_index(id, groups);
    if path >= atomicLoad(&counters.n_paths) || starts[path].turn < 0.0 {
        return;
    }
    let turn = starts[path].turn;
    var vertex = PathVertex(starts[path].at, 0.0, 0.0);
    var blur = Blur(0.0, 0.0);
    for (var k = 0u; k < frame.options.z; k++) {
        let at = vertex.at;
        var blocked: BlockedLobe;
        if k + 1u < frame.options.z {
            blocked = trace_lobe(at, turn + f32(k));
        }
        let surface = surface_at(at.position);
        let lobe = lobe_of(surface.roughness);
        let share = select(0.0, blocked_share(blocked.shares, lobe.kappa), blocked.has_next);
        // Travels to the vertex and is mirrored by its curved surface.
        blur.position += vertex.distance * vertex.distance * blur.direction;
        blur.direction += 4.0 * vertex.curvature * vertex.curvature * blur.position;
        var ray = NONE;
        if share < 1.0 - SHARE_MARGIN {
            ray = push_ray(lobe_ray(at, lobe, blur));
        }
        let goes_on = blocked.has_next && share > SHARE_MARGIN;
        let reflectance = fresnel(surface.tint, max(dot(at.normal, at.to_eye), 0.0));
        let row = path * LIT_ROWS + 2u * k;
        lit[row] = bitcast<vec4<u32>>(vec4(surface.diffuse * (1.0 - reflectance), share));
        let factor = bitcast<vec3<u32>>(frame.specular.xyz * reflectance);
        lit[row + 1u] = vec4(factor, ray | select(0u, GOES_ON, goes_on));
        if !goes_on {
            return;
        }
        blur.direction += lobe.variance;
        vertex = blocked.next;
    }
}
