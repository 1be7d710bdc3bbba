//! Many rays from one point of the surface into one cone: the fan of a lobe.
//!
//! One walk through the hierarchy with the whole cone finds the parts of the mesh that its rays can meet. There are
//! none where the lobe leaves into the open, as most do: no ray is traced then. Otherwise each ray begins with those
//! parts rather than at the root, where it would find the surface that it leaves again and again. Answers are the
//! tracer's own ([`SurfaceTracer::intersect`]), which the tests compare.

use glam::{Vec3, Vec3A, Vec4};
use obvhs::ray::Ray as BvhRay;

use super::wide_bvh::{Boxes, Cone, Content, Part, Slabs, Walk};
use crate::geometry::{Hit, Ray, SurfaceTracer};

/// Most parts that are kept, in fours.
const MAX_FOURS: usize = 6;
const MAX_PARTS: usize = 4 * MAX_FOURS;
/// Parts that may be looked at while opening them.
const MAX_LOOKS: usize = 128;
/// Sine of the least elevation above the surface at which the cone's walk speaks for a ray; lower rays are traced.
const LEAST_ELEVATION: f32 = 0.02;
/// How far a triangle may stand above the point's plane and still be out of reach, ball space. A ray of the least
/// elevation that starts at [`SurfaceTracer::self_distance`] begins four times higher; rounding is a fifth.
const HEIGHT: f32 = 1e-6;
/// Widening of the cone against rounding, radians.
const MARGIN: f32 = 0.005;

/// Rays from one point of the surface within one cone.
#[derive(Debug)]
pub struct Fan<'a> {
    tracer: &'a SurfaceTracer,
    cone: Cone,
    /// What the cone can meet.
    parts: [Part; MAX_PARTS],
    n_parts: usize,
    boxes: [Boxes; MAX_FOURS],
}

impl SurfaceTracer {
    /// The fan of rays within `angle` (radians, below a right angle) of `axis` (unit), from `point` on a triangle
    /// whose unit normal is `face_normal`, on the side that the rays leave to.
    #[inline]
    pub fn fan(&self, point: Vec3, face_normal: Vec3, axis: Vec3, angle: f32) -> Fan<'_> {
        let (sin, cos) = (angle + MARGIN).sin_cos();
        let mut fan = Fan {
            tracer: self,
            cone: Cone {
                apex: self.to_ball(point),
                axis: axis.into(),
                cos,
                sin,
                normal: face_normal.into(),
                height: HEIGHT,
            },
            parts: [Part::default(); MAX_PARTS],
            n_parts: 0,
            boxes: [Boxes::EMPTY; MAX_FOURS],
        };
        fan.collect();
        fan
    }
}

impl Fan<'_> {
    /// Opens parts of the mesh, large ones first, as long as there is room for what is in them.
    fn collect(&mut self) {
        let bvh = self.tracer.bvh();
        let mut queue = [Part::default(); MAX_LOOKS];
        let (mut first, mut end) = (0, 0);
        // The root is no part: what is in it, always fits.
        let mut opened = Some(0);
        loop {
            if let Some(node) = opened.take() {
                for part in bvh.parts_in_cone(node, &self.cone) {
                    if self.may_meet(part) {
                        queue[end] = part;
                        end += 1;
                    }
                }
            }
            if first == end {
                break;
            }
            let part = queue[first];
            first += 1;
            let has_room = self.n_parts + (end - first) + 8 <= MAX_PARTS && end + 8 <= MAX_LOOKS;
            match bvh.content(part) {
                Content::Node(node) if has_room => opened = Some(node),
                Content::Node(_) | Content::Leaves(_) => self.keep(part),
            }
        }
    }

    fn keep(&mut self, part: Part) {
        let at = self.n_parts;
        self.parts[at] = part;
        let boxes = &mut self.boxes[at / 4];
        self.tracer.bvh().copy_box(part, boxes, at % 4);
        self.n_parts += 1;
    }

    /// Whether the triangles of a part, when it holds some itself, may reach into the cone.
    fn may_meet(&self, part: Part) -> bool {
        match self.tracer.bvh().content(part) {
            Content::Node(_) => true,
            Content::Leaves(mut leaves) => {
                leaves.any(|leaf| self.cone.may_meet(self.tracer.leaf(leaf)))
            }
        }
    }

    /// Whether no ray of the cone, each starting at [`SurfaceTracer::self_distance`], meets anything.
    pub fn is_free(&self) -> bool {
        // The lowest ray is the axis turned by the cone's angle towards the surface.
        let elevation = self.cone.axis.dot(self.cone.normal);
        self.n_parts == 0 && elevation > self.cone.sin + LEAST_ELEVATION
    }

    /// The nearest hit beyond [`SurfaceTracer::self_distance`] in `direction` (unit, within the cone).
    pub fn intersect(&self, origin: Vec3, direction: Vec3) -> Option<Hit> {
        let ray = Ray { origin, direction };
        let start = self.tracer.self_distance();
        if !self.speaks_for(direction.into()) {
            return self.tracer.intersect(&ray, start, f32::INFINITY);
        }
        if self.n_parts == 0 {
            return None;
        }
        let ray_ball = self.tracer.ball_ray(&ray, start, f32::INFINITY)?;
        let mut nearest = None;
        self.walk(&mut { ray_ball }, |ray, leaf| {
            if let Some(t) = self.tracer.leaf_distance(ray, leaf) {
                ray.tmax = t;
                nearest = Some(leaf);
            }
            Walk::On
        });
        self.tracer.hit_on_leaf(&ray, &ray_ball, nearest?)
    }

    /// Whether anything lies beyond [`SurfaceTracer::self_distance`] in `direction` (unit, within the cone).
    pub fn occluded(&self, origin: Vec3, direction: Vec3) -> bool {
        let ray = Ray { origin, direction };
        let start = self.tracer.self_distance();
        if !self.speaks_for(direction.into()) {
            return self.tracer.occluded(&ray, start, f32::INFINITY);
        }
        if self.n_parts == 0 {
            return false;
        }
        let Some(mut ray) = self.tracer.ball_ray(&ray, start, f32::INFINITY) else {
            return false;
        };
        let mut is_hit = false;
        self.walk(&mut ray, |ray, leaf| {
            is_hit = self.tracer.leaf_distance(ray, leaf).is_some();
            if is_hit { Walk::Stop } else { Walk::On }
        });
        is_hit
    }

    /// Calls `visit` for the leaves in the cone whose boxes the ray meets.
    #[inline(always)]
    fn walk(&self, ray: &mut BvhRay, mut visit: impl FnMut(&mut BvhRay, usize) -> Walk) {
        let (bvh, slabs) = (self.tracer.bvh(), Slabs::new(ray));
        for (boxes, parts) in self.boxes.iter().zip(self.parts[..self.n_parts].chunks(4)) {
            // The places without a part have empty boxes.
            let mut met = boxes.met_by_ray(&slabs, Vec4::splat(ray.tmax));
            while met != 0 {
                let i = met.trailing_zeros() as usize;
                met &= met - 1;
                let goes_on = match bvh.content(parts[i]) {
                    Content::Node(node) => bvh.walk_ray(node, &slabs, ray, &mut visit),
                    Content::Leaves(mut leaves) => leaves.all(|leaf| visit(ray, leaf) == Walk::On),
                };
                if !goes_on {
                    return;
                }
            }
        }
    }

    /// Whether the cone's walk holds for a ray: one that rises enough above the surface.
    fn speaks_for(&self, direction: Vec3A) -> bool {
        direction.dot(self.cone.normal) > LEAST_ELEVATION
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::geometry::meshes::test_mesh::{ellipsoid, together};
    use crate::geometry::{Mesh, fibonacci_sphere, orthonormal_basis};

    const ANGLE: f32 = 0.6;

    /// Two balls that touch, within a bowl that is open above (the lower part of a larger ball, seen from inside).
    fn nook(scale: f32) -> Mesh {
        let ball = |x: f32| ellipsoid(scale * x * Vec3::X, Vec3::splat(scale), 24);
        let balls = together(&ball(-1.0), &ball(1.0));
        let mut bowl = ellipsoid(Vec3::ZERO, scale * Vec3::new(2.2, 1.6, 1.2), 24);
        let is_low = |corners: &[u32; 3]| bowl.positions[corners[0] as usize].z < -0.2 * scale;
        bowl.triangles = bowl.triangles.iter().copied().filter(is_low).collect();
        together(&balls, &bowl)
    }

    #[test]
    fn a_fan_s_rays_are_those_of_the_tracer() {
        for scale in [1e-3_f32, 1.0, 1e4] {
            let tracer = SurfaceTracer::new(Arc::new(nook(scale)));
            let (mut n_free, mut n_small, mut n_large, mut n_hits) = (0, 0, 0, 0);
            for (i, from) in fibonacci_sphere(3000).into_iter().enumerate() {
                let aim = scale * Vec3::new(2.0, 1.5, 0.8) * fibonacci_sphere(71)[i % 71];
                let origin = 5.0 * scale * from;
                let direction = (aim - origin).normalize_or_zero();
                let Some(seen) = tracer.intersect(&Ray { origin, direction }, 0.0, f32::INFINITY)
                else {
                    continue;
                };
                let axis = direction - 2.0 * direction.dot(seen.normal) * seen.normal;
                let fan = tracer.fan(seen.position, seen.geometric_normal, axis, ANGLE);
                let has_nodes = fan.parts[..fan.n_parts]
                    .iter()
                    .any(|part| matches!(tracer.bvh().content(*part), Content::Node(_)));
                n_free += u32::from(fan.is_free());
                n_small += u32::from(fan.n_parts > 0 && !has_nodes);
                n_large += u32::from(has_nodes);
                let (tangent, bitangent) = orthonormal_basis(axis);
                for k in 0..16 {
                    let (off, phi) = (ANGLE * (k % 4) as f32 / 3.0, 0.4 * (k + i) as f32);
                    let side = tangent * phi.cos() + bitangent * phi.sin();
                    let direction = (axis * off.cos() + side * off.sin()).normalize_or_zero();
                    if direction.dot(seen.normal) <= 0.0 {
                        continue;
                    }
                    let ray = Ray {
                        origin: seen.position,
                        direction,
                    };
                    let expected = tracer.intersect(&ray, tracer.self_distance(), f32::INFINITY);
                    let found = fan.intersect(ray.origin, direction);
                    assert_eq!(
                        found.map(|hit| hit.t),
                        expected.map(|hit| hit.t),
                        "scale {scale}, point {i}, ray {k}"
                    );
                    assert_eq!(
                        fan.occluded(ray.origin, direction),
                        expected.is_some(),
                        "scale {scale}, point {i}, ray {k}"
                    );
                    assert!(
                        expected.is_none() || !fan.is_free(),
                        "a free fan meets nothing: scale {scale}, point {i}, ray {k}"
                    );
                    n_hits += u32::from(expected.is_some());
                }
            }
            let least = n_free.min(n_small).min(n_large);
            assert!(
                least > 50 && n_hits > 1000,
                "every case is met: {n_free} free, {n_small} of triangles, {n_large} of nodes, {n_hits} hits"
            );
        }
    }

    #[test]
    fn a_ball_s_own_surface_never_stands_in_the_way() {
        let tracer = SurfaceTracer::new(Arc::new(ellipsoid(Vec3::ZERO, Vec3::ONE, 40)));
        let mut n_points = 0;
        for from in fibonacci_sphere(500) {
            let ray = Ray {
                origin: 3.0 * from + 0.4 * Vec3::Y,
                direction: -from,
            };
            let Some(seen) = tracer.intersect(&ray, 0.0, f32::INFINITY) else {
                continue;
            };
            n_points += 1;
            let fan = tracer.fan(seen.position, seen.geometric_normal, seen.normal, ANGLE);
            assert!(fan.is_free(), "at {}: {:?}", seen.position, fan.n_parts);
        }
        assert_eq!(n_points, 500, "points");
    }
}
