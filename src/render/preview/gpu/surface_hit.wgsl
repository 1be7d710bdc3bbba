// A point where a ray meets the mesh, and ray differentials there: `geometry/tracing/bvh.rs` and `geometry/tracing/footprint.rs`.
// Igehy 1999, "Tracing Ray Differentials", by finite differences of the neighbouring pixels' rays.

const MAX_DIRECTION_CHANGE: f32 = 2.0;
const MAX_OFFSET_SHARE: f32 = 0.1;
const MAX_BARYCENTRIC: f32 = 4.0;
// Farther than anything, world units.
const FAR_AWAY: f32 = 1e30;

struct Hit {
    is_hit: bool,
    leaf: u32,
    t: f32,
    u: f32,
    v: f32,
    position: vec3<f32>,
    // Unit shading normal on the side that the ray comes from.
    normal: vec3<f32>,
}

// Corner 0 to 2 of a leaf, world units.
fn corner(leaf: u32, i: u32) -> vec3<f32> {
    return triangles[u32(frame.start.y) + 6u * leaf + i].xyz;
}

fn corner_normal(leaf: u32, i: u32) -> vec3<f32> {
    return triangles[u32(frame.start.y) + 6u * leaf + 3u + i].xyz;
}

fn face_normal(leaf: u32) -> vec3<f32> {
    let a = corner(leaf, 0u);
    let ab = corner(leaf, 1u) - a;
    let ac = corner(leaf, 2u) - a;
    // Scaled first: the cross product of tiny edges underflows.
    let size = max(max(max(abs(ab.x), abs(ab.y)), abs(ab.z)), max(max(abs(ac.x), abs(ac.y)), abs(ac.z)));
    let scale = 1.0 / max(size, 1e-30);
    return normalize_or(cross(ab * scale, ac * scale), vec3(0.0));
}

// The nearest hit of a camera's ray.
fn intersect(ray: Ray) -> Hit {
    if frame.flags.x == 0u {
        return Hit();
    }
    let found = walk(ball_ray(ray, 0.0, FAR_AWAY), false);
    if found.leaf == NONE {
        return Hit();
    }
    return hit_on_leaf(ray, found);
}

// The hit of a ray on the triangle of a leaf.
fn hit_on_leaf(ray: Ray, found: LeafHit) -> Hit {
    var hit: Hit;
    let p0 = corner(found.leaf, 0u);
    let n0 = corner_normal(found.leaf, 0u);
    let n1 = corner_normal(found.leaf, 1u);
    let n2 = corner_normal(found.leaf, 2u);
    var geometric = face_normal(found.leaf);
    // Vertex normals say where outside is; some files wind their faces the other way round.
    if dot(geometric, n0 + n1 + n2) < 0.0 {
        geometric = -geometric;
    }
    var normal = normalize_or((1.0 - found.u - found.v) * n0 + found.u * n1 + found.v * n2, geometric);
    if dot(geometric, ray.direction) > 0.0 {
        normal = -normal;
    }
    hit.is_hit = true;
    hit.leaf = found.leaf;
    hit.t = found.t * frame.ball.w;
    hit.u = found.u;
    hit.v = found.v;
    hit.position = p0 + (found.u * (corner(found.leaf, 1u) - p0) + found.v * (corner(found.leaf, 2u) - p0));
    hit.normal = normal;
    return hit;
}

// Where `neighbour` meets the plane of the triangle, relative to the hit.
fn plane_offset(hit: Hit, geometric: vec3<f32>, neighbour: Ray, max_offset: f32) -> vec3<f32> {
    let to_hit = hit.position - neighbour.origin;
    let slope = dot(geometric, neighbour.direction);
    // A neighbour that misses the plane passes at its nearest.
    var t = dot(to_hit, neighbour.direction);
    if abs(slope) > 1e-20 {
        let at = dot(geometric, to_hit) / slope;
        t = select(t, at, at > 0.0 && at < FAR_AWAY);
    }
    let offset = t * neighbour.direction - to_hit;
    let length = length(offset);
    return select(offset, offset * (max_offset / max(length, 1e-30)), length > max_offset);
}

// The unit shading normal at an offset in the triangle's plane.
fn normal_at(hit: Hit, offset: vec3<f32>) -> vec3<f32> {
    let p0 = corner(hit.leaf, 0u);
    let e1 = corner(hit.leaf, 1u) - p0;
    let e2 = corner(hit.leaf, 2u) - p0;
    // Barycentrics of a point in the plane: Cramer's rule, Ericson 2005, Sec. 3.4.
    let d11 = dot(e1, e1);
    let d12 = dot(e1, e2);
    let d22 = dot(e2, e2);
    let b1 = dot(offset, e1);
    let b2 = dot(offset, e2);
    let det = d11 * d22 - d12 * d12;
    if abs(det) < 1e-36 {
        return hit.normal;
    }
    let du = (d22 * b1 - d12 * b2) / det;
    let dv = (d11 * b2 - d12 * b1) / det;
    let shrink = MAX_BARYCENTRIC / max(max(abs(du), abs(dv)), MAX_BARYCENTRIC);
    let u = hit.u + shrink * du;
    let v = hit.v + shrink * dv;
    let n0 = corner_normal(hit.leaf, 0u);
    let n1 = corner_normal(hit.leaf, 1u);
    let n2 = corner_normal(hit.leaf, 2u);
    let smooth_normal = (1.0 - hit.u - hit.v) * n0 + hit.u * n1 + hit.v * n2;
    let side = select(1.0, -1.0, dot(smooth_normal, hit.normal) < 0.0);
    return normalize_or(side * ((1.0 - u - v) * n0 + u * n1 + v * n2), hit.normal);
}

// How the reflected ray changes for a step of one pixel: sideways shift (world units) and turn (radians), root mean
// square of the x and y step.
fn footprint(hit: Hit, ray: Ray, ray_dx: Ray, ray_dy: Ray) -> vec2<f32> {
    let geometric = face_normal(hit.leaf);
    let max_offset = MAX_OFFSET_SHARE * length(hit.position - ray.origin);
    let reflected = reflect(ray.direction, hit.normal);
    var sum = vec2(0.0);
    for (var i = 0u; i < 2u; i++) {
        var neighbour = ray_dx;
        if i == 1u {
            neighbour = ray_dy;
        }
        let offset = plane_offset(hit, geometric, neighbour, max_offset);
        let normal = normal_at(hit, offset);
        let sideways = offset - dot(offset, reflected) * reflected;
        let turned = reflect(neighbour.direction, normal) - reflected;
        let most = MAX_DIRECTION_CHANGE * MAX_DIRECTION_CHANGE;
        sum += vec2(dot(sideways, sideways), min(dot(turned, turned), most));
    }
    return sqrt(0.5 * sum);
}

// Turn of the shading normal for a step along the surface, radians a world unit.
fn curvature(hit: Hit) -> f32 {
    let p0 = corner(hit.leaf, 0u);
    let e1 = corner(hit.leaf, 1u) - p0;
    let e2 = corner(hit.leaf, 2u) - p0;
    let n0 = corner_normal(hit.leaf, 0u);
    let x = normalize_or(e1, vec3(0.0));
    let across = e2 - dot(e2, x) * x;
    let width = length(e1);
    let height = length(across);
    if width < 1e-30 || height < 1e-30 {
        return 0.0;
    }
    let dx = (corner_normal(hit.leaf, 1u) - n0) / width;
    let dy = (corner_normal(hit.leaf, 2u) - n0 - dot(e2, x) * dx) / height;
    return sqrt(0.5 * (dot(dx, dx) + dot(dy, dy)));
}
