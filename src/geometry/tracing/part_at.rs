//! On which connected part of the mesh a point lies.

use glam::Vec3;

use crate::geometry::{Ray, SurfaceTracer};

/// How far beside the surface a point may lie, in steps of [`SurfaceTracer::self_distance`]: on it but for rounding, or
/// as a texel's middle does.
const REACHES: [f32; 2] = [1.0, 16.0];

impl SurfaceTracer {
    /// The part of the mesh on which a world point lies; `None` for points away from the surface. `normal`: a unit
    /// direction, best that of the surface.
    pub fn part_at(&self, p_world: Vec3, normal: Vec3) -> Option<u32> {
        let across = |direction: Vec3, reach: f32| {
            let ray = Ray {
                origin: p_world + direction * reach,
                direction: -direction,
            };
            self.intersect(&ray, 0.0, 2.0 * reach)
        };
        // A ray through the point meets its triangle unless it runs along it; one of the axes does not.
        let hit = REACHES.into_iter().find_map(|steps| {
            let reach = steps * self.self_distance();
            let directions = [normal, Vec3::X, Vec3::Y, Vec3::Z];
            directions
                .into_iter()
                .find_map(|direction| across(direction, reach))
        })?;
        Some(self.parts().of_triangle(hit.triangle))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::geometry::meshes::parts::MeshParts;
    use crate::geometry::meshes::test_mesh::{ellipsoid, together};

    #[test]
    fn two_balls_are_two_parts_and_a_split_seam_is_none() {
        let ball = |x: f32| ellipsoid(Vec3::new(x, 0.0, 0.0), Vec3::ONE, 8);
        // The ellipsoid's poles are rings of vertices at one position, and its columns are shared.
        assert_eq!(MeshParts::new(&ball(0.0)).n_parts, 1, "one ball");
        let both = together(&ball(-1.5), &ball(1.5));
        let tracer = SurfaceTracer::new(Arc::new(both));
        assert_eq!(tracer.parts().n_parts, 2, "two balls");
        for (i, corners) in tracer.mesh().triangles.iter().enumerate() {
            let middle = corners
                .map(|v| tracer.mesh().positions[v as usize])
                .into_iter()
                .sum::<Vec3>()
                / 3.0;
            let expected = tracer.parts().of_triangle(i as u32);
            for normal in [Vec3::X, Vec3::new(0.6, 0.0, 0.8)] {
                assert_eq!(tracer.part_at(middle, normal), Some(expected), "{i}");
            }
        }
        assert_eq!(tracer.part_at(Vec3::ZERO, Vec3::X), None, "between them");
    }
}
