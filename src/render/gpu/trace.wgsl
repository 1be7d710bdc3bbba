// What a pixel sees of the mesh, and the lobes' rays that meet it again: `render/trace.rs`.

const PIXEL_STD: f32 = 0.28867513;
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

// The first point met by the ray through `at` (pixels); `size` is the side of the square whose beam is meant.
fn trace_pixel(at: vec2<f32>, size: f32) -> SurfacePoint {
    let ray = camera_ray(at);
    let hit = intersect(ray, 0.0);
    if !hit.is_hit {
        return SurfacePoint();
    }
    return seen(hit, ray, camera_ray(at + vec2(size, 0.0)), camera_ray(at + vec2(0.0, size)));
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
// turns the rings.
fn trace_lobe(at: SurfacePoint, turn: f32) -> BlockedLobe {
    let axis = reflected(at);
    let start = frame.start.x;
    var lobe: BlockedLobe;
    let mirror = intersect(Ray(at.position, axis), start);
    if mirror.is_hit {
        lobe.shares.x = 1.0;
        lobe.has_next = true;
        lobe.next = next_vertex(at, axis, mirror);
    }
    let sides = orthonormal_basis(axis);
    for (var ring = 0u; ring < 2u; ring++) {
        let angle = select(0.19, 0.6, ring == 1u);
        var n = 0.0;
        var n_blocked = 0.0;
        for (var k = 0u; k < RING_RAYS; k++) {
            let phi = turn + TAU * (f32(k) + 0.5 * f32(ring)) / f32(RING_RAYS);
            let side = sides[0] * cos(phi) + sides[1] * sin(phi);
            let direction = normalize(axis * cos(angle) + side * sin(angle));
            // Directions below the horizon are no part of the reflected lobe.
            if dot(direction, at.normal) <= 0.0 {
                continue;
            }
            n += 1.0;
            let ray = Ray(at.position, direction);
            // Where it meets matters only if nothing was met before.
            if lobe.has_next {
                n_blocked += select(0.0, 1.0, is_occluded(ray, start));
            } else {
                let hit = intersect(ray, start);
                if hit.is_hit {
                    n_blocked += 1.0;
                    lobe.has_next = true;
                    lobe.next = next_vertex(at, direction, hit);
                }
            }
        }
        let share = select(lobe.shares.x, n_blocked / max(n, 1.0), n > 0.0);
        if ring == 0u {
            lobe.shares.y = share;
        } else {
            lobe.shares.z = share;
        }
    }
    return lobe;
}
