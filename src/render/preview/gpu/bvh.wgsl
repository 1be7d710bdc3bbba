// Rays against the mesh by the eight-wide hierarchy of `geometry/tracing/wide_bvh.rs`, in ball space.
// Ylitalo, Karras, Laine 2017; triangles by the edge-consistent test of Embree's Plücker intersector.

// Deepest path through the tree, as on the processor.
const STACK: u32 = 32u;
const GROWN: f32 = 1.0000005;
const EMPTY_CHILD: u32 = 0xffffffffu;
const EPSILON: f32 = 1.1920929e-7;

// Two rows a child, sixteen a node: lower corner (bits of floats) and first leaf or node; upper corner and number of leaves.
@group(0) @binding(6) var<storage, read> nodes: array<vec4<u32>>;
// Three rows a leaf: corners in ball space; then six a leaf: corners and their normals in the world.
@group(0) @binding(7) var<storage, read> triangles: array<vec4<f32>>;

struct BallRay {
    origin: vec3<f32>,
    direction: vec3<f32>,
    t_min: f32,
    t_max: f32,
}

struct LeafHit {
    leaf: u32,
    t: f32,
    u: f32,
    v: f32,
}

fn ball_ray(ray: Ray, t_min: f32, t_max: f32) -> BallRay {
    let radius = frame.ball.w;
    return BallRay((ray.origin - frame.ball.xyz) / radius, ray.direction, t_min / radius, t_max / radius);
}

// Where the ray meets a leaf's triangle; `leaf` is NONE where it does not.
fn intersect_triangle(ray: BallRay, leaf: u32) -> LeafHit {
    let miss = LeafHit(NONE, 0.0, 0.0, 0.0);
    let v0 = triangles[3u * leaf].xyz - ray.origin;
    let v1 = triangles[3u * leaf + 1u].xyz - ray.origin;
    let v2 = triangles[3u * leaf + 2u].xyz - ray.origin;
    let e0 = v2 - v0;
    let e1 = v0 - v1;
    let e2 = v1 - v2;
    let u = dot(cross(e0, v2 + v0), ray.direction);
    let v = dot(cross(e1, v0 + v1), ray.direction);
    let w = dot(cross(e2, v1 + v2), ray.direction);
    let sum = u + v + w;
    let tolerance = EPSILON * abs(sum);
    let inside = min(min(u, v), w) >= -tolerance || max(max(u, v), w) <= tolerance;
    if !inside || sum == 0.0 {
        return miss;
    }
    let normal = cross(e1, e0);
    let slope = dot(ray.direction, normal);
    if slope == 0.0 {
        return miss;
    }
    let t = dot(v0, normal) / slope;
    if !(t > ray.t_min && t <= ray.t_max) {
        return miss;
    }
    let share = clamp(u / sum, 0.0, 1.0);
    return LeafHit(leaf, t, share, clamp(v / sum, 0.0, 1.0 - share));
}

// The inverse of a component, finite: a ray within a plane passes through boxes that hold the plane.
fn inverse_of(d: f32) -> f32 {
    let least = select(-1e-20, 1e-20, d >= 0.0);
    return 1.0 / select(d, least, abs(d) < 1e-20);
}

// The nearest hit, or with `any` the first that is found.
fn walk(start: BallRay, any: bool) -> LeafHit {
    var ray = start;
    var nearest = LeafHit(NONE, 0.0, 0.0, 0.0);
    let inverse = vec3(inverse_of(ray.direction.x), inverse_of(ray.direction.y), inverse_of(ray.direction.z));
    let signs = select(vec3(0u), vec3(1u), inverse < vec3(0.0));
    let order = 7u - 4u * signs.x - 2u * signs.y - signs.z;
    // A node and which of its inner children wait, nearest at the highest bit.
    var stack: array<vec2<u32>, STACK>;
    var depth = 0u;
    var node = 0u;
    loop {
        var waiting = 0u;
        for (var i = 8u; i > 0u; i--) {
            let bit = i - 1u;
            let row = node * 16u + ((bit ^ order) & 7u) * 2u;
            let upper = nodes[row + 1u];
            let n_leaves = upper.w;
            if n_leaves == EMPTY_CHILD {
                continue;
            }
            let lower = nodes[row];
            let a = (bitcast<vec3<f32>>(lower.xyz) - ray.origin) * inverse;
            let b = (bitcast<vec3<f32>>(upper.xyz) - ray.origin) * inverse;
            let enter = min(a, b);
            let leave = max(a, b);
            let near = max(max(enter.x, enter.y), max(enter.z, ray.t_min));
            let far = min(min(leave.x, leave.y), min(leave.z, ray.t_max));
            if near > far * GROWN {
                continue;
            }
            if n_leaves == 0u {
                waiting |= 1u << bit;
                continue;
            }
            let first = lower.w;
            for (var leaf = first; leaf < first + n_leaves; leaf++) {
                let hit = intersect_triangle(ray, leaf);
                if hit.leaf != NONE && hit.t < ray.t_max {
                    if any {
                        return hit;
                    }
                    ray.t_max = hit.t;
                    nearest = hit;
                }
            }
        }
        if waiting != 0u {
            stack[depth] = vec2(node, waiting);
            depth++;
        }
        if depth == 0u {
            return nearest;
        }
        let top = stack[depth - 1u];
        let bit = firstLeadingBit(top.y);
        let left = top.y & ~(1u << bit);
        node = nodes[top.x * 16u + ((bit ^ order) & 7u) * 2u].w;
        stack[depth - 1u].y = left;
        if left == 0u {
            depth--;
        }
    }
    return nearest;
}
