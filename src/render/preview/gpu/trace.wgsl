// What a pixel sees of the mesh, and the lobes' rays that meet it again: `render/path/trace.rs`.

const RING_RAYS: u32 = 4u;

// A surface point: geometry only, as `SurfacePoint`.
struct SurfacePoint {
    position: vec3<f32>,
    base: f32,
    normal: vec3<f32>,
    spread: f32,
    to_eye: vec3<f32>,
    // 1 where there is a point, 0 where the ray met nothing.
    is_seen: f32,
}

// A vertex of a light path, as `PathVertex` without its blocked lobe.
struct PathVertex {
    at: SurfacePoint,
    distance: f32,
    curvature: f32,
}

// Blocked share of a lobe's rays: mirror ray, inner ring, outer ring; and the first point met.
struct BlockedLobe {
    shares: vec3<f32>,
    has_next: bool,
    next: PathVertex,
}

fn reflected(at: SurfacePoint) -> vec3<f32> {
    return 2.0 * dot(at.normal, at.to_eye) * at.normal - at.to_eye;
}

fn seen(hit: Hit, ray: Ray, ray_dx: Ray, ray_dy: Ray) -> SurfacePoint {
    let per_px = footprint(hit, ray, ray_dx, ray_dy) * PIXEL_STD;
    return SurfacePoint(hit.position, per_px.x, hit.normal, per_px.y, -ray.direction, 1.0);
}

// The first point met by the ray through `at` (pixels), with a beam whose sides are shares of a pixel.
fn trace_beam(at: vec2<f32>, along: vec2<f32>, across: vec2<f32>) -> SurfacePoint {
    let ray = camera_ray(at);
    let hit = intersect(ray);
    if !hit.is_hit {
        return SurfacePoint();
    }
    return seen(hit, ray, camera_ray(at + along), camera_ray(at + across));
}

fn next_vertex(at: SurfacePoint, direction: vec3<f32>, hit: Hit) -> PathVertex {
    // The beam widens as if it came from a point behind the mirror.
    let behind = min(at.base / max(at.spread, 1e-12), 1e3 * hit.t);
    let ray = Ray(at.position - behind * direction, direction);
    let angle = min(at.spread / PIXEL_STD, 0.5);
    let sides = orthonormal_basis(direction);
    let turned_x = direction * cos(angle) + cross(sides[0], direction) * sin(angle);
    let turned_y = direction * cos(angle) + cross(sides[1], direction) * sin(angle);
    let point = seen(hit, ray, Ray(ray.origin, turned_x), Ray(ray.origin, turned_y));
    return PathVertex(point, hit.t, curvature(hit));
}

// The lobe's rays: how many meet the object, and the first point met (the mirror ray's if it does). `turn` (radians)
// turns the rings. One loop for mirror ray and rings: compilers copy the walk to every place that calls it.
fn trace_lobe(at: SurfacePoint, turn: f32) -> BlockedLobe {
    let axis = reflected(at);
    let sides = orthonormal_basis(axis);
    var lobe: BlockedLobe;
    var n = vec3(0.0);
    for (var k = 0u; k < 1u + 2u * RING_RAYS; k++) {
        var direction = axis;
        var group = vec3(1.0, 0.0, 0.0);
        if k > 0u {
            let ring = (k - 1u) / RING_RAYS;
            let angle = select(0.19, 0.6, ring == 1u);
            let phi = turn + TAU * (f32((k - 1u) % RING_RAYS) + 0.5 * f32(ring)) / f32(RING_RAYS);
            let side = sides[0] * cos(phi) + sides[1] * sin(phi);
            direction = normalize(axis * cos(angle) + side * sin(angle));
            group = select(vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0), ring == 1u);
            // Directions below the horizon are no part of the reflected lobe.
            if dot(direction, at.normal) <= 0.0 {
                continue;
            }
        }
        n += group;
        let ray = Ray(at.position, direction);
        // Where it meets matters only if nothing was met before.
        let found = walk(ball_ray(ray, frame.start.x, FAR_AWAY), lobe.has_next);
        if found.leaf == NONE {
            continue;
        }
        lobe.shares += group;
        if !lobe.has_next {
            lobe.has_next = true;
            lobe.next = next_vertex(at, direction, hit_on_leaf(ray, found));
        }
    }
    let shares = lobe.shares / max(n, vec3(1.0));
    // A ring that is all below the horizon is as the mirror ray.
    lobe.shares = select(vec3(shares.x), shares, n > vec3(0.0));
    return lobe;
}
