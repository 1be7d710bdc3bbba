//! From surfaces to the rays that their lobes need: one cone as the photos taught it, or several.

use std::ops::Range;

use glam::Vec3;

use super::blocked_cones;
use super::scratch::{BlockedCone, ShadeScratch};
use crate::neif::EnvironmentFromWorld;
use crate::neif::field::contraction::FieldFrame;
use crate::neif::field::radiance_field::FieldRay;
use crate::neif::light::light_path::{self, PathVertex, SplitLobe};
use crate::neif::light::lobe::{Lobe, cone_roughness};
use crate::neif::light::lobe_cones::{LobeCone, PathOfPixel, lobe_cones};
use crate::neif::light::shading::SurfacePoint;
use crate::neif::surface::object::ObjectModel;
use crate::neif::surface::values::Surface;
use crate::render::scene::Scene;

/// Change of roughness from which one cone, which the photos taught at the learned roughness, counts nothing.
const UNTAUGHT: f32 = 0.05;
/// Learned roughness up to which one cone serves in another environment too, that of a mirror, and the distance from there
/// to where it counts nothing: one cone has none of the long tails of GGX, in which a lamp glows.
const SHARP: f32 = 0.13;
const SHARP_TO_WIDE: f32 = 0.03;

/// The lit vertices of each path, and how many rays it takes; both are put into the scratch.
pub(in crate::render) fn aim_lobes(
    scene: &Scene,
    object: &ObjectModel,
    (paths, starts): (&[&[PathVertex]], &[usize]),
    of_pixel: impl Fn(usize) -> PathOfPixel,
    scratch: &mut ShadeScratch,
) -> (Vec<Range<usize>>, Vec<usize>) {
    let motion = scene.transform.environment_from_world();
    let aim = Aim {
        object,
        scene,
        motion: &motion,
        frame: scene.environment.frame(),
        sharpest: scene.environment.sharpest_variance(),
        has_own_light: scene.has_own_light(),
    };
    scratch.rays.clear();
    scratch.lit.clear();
    scratch.blocked.clear();
    scratch.contributions.clear();
    let paths = paths.iter().zip(starts).enumerate();
    let aimed = paths.map(|(number, (path, &start))| {
        let before = scratch.rays.len();
        let lit = aim.path(path, start, of_pixel(number), scratch);
        (lit, scratch.rays.len() - before)
    });
    let aimed = aimed.unzip();
    blocked_cones::follow(scene, object, scratch);
    aimed
}

/// From surfaces to the rays that their lobes need.
struct Aim<'a> {
    object: &'a ObjectModel,
    scene: &'a Scene,
    motion: &'a EnvironmentFromWorld,
    frame: &'a FieldFrame,
    /// Variance that the environment asks for on top of a lobe's.
    sharpest: f32,
    has_own_light: bool,
}

impl Aim<'_> {
    /// Adds the rays of a path whose first surface is number `start` of the scratch; its lit vertices.
    fn path(
        &self,
        path: &[PathVertex],
        start: usize,
        of_pixel: PathOfPixel,
        scratch: &mut ShadeScratch,
    ) -> Range<usize> {
        let (surfaces, learned) = (
            scratch.edited.surfaces(),
            scratch.edited.learned_roughness(),
        );
        // Lobes that the photos did not teach: another roughness, or another environment.
        let new_roughness = scratch.edited.has_new_roughness();
        let is_new = |k: usize| new_roughness[start + k] || !self.has_own_light;
        let roughness = surfaces[start].roughness;
        let moved = if self.has_own_light {
            moved_away(self.motion, self.frame, &path[0].point, learned[start])
        } else {
            1.0
        };
        let first_learned = learned[start];
        let weight = self.split_weight(roughness, first_learned, moved);
        let surface = |k: usize| {
            let mut surface = surfaces[start + k];
            let is_taught = !is_new(k) || k == 0 && weight < 1.0;
            if self.sharpest > 0.0 || !is_new(k) {
                // One cone is as wide as it was when it was taught, or as if it had been.
                surface.roughness = if is_taught {
                    learned[start + k]
                } else {
                    cone_roughness(surface.roughness)
                };
            }
            (start + k, surface)
        };
        let first = scratch.lit.len();
        let (blocked, rays, lit) = (&mut scratch.blocked, &mut scratch.rays, &mut scratch.lit);
        let split = |rays: &mut Vec<FieldRay>| {
            if weight <= 0.0 {
                return None;
            }
            let split = self.split_lobe(path, roughness, (first, of_pixel), rays, blocked)?;
            let gain = self.scene.wide_gain(first_learned);
            Some(SplitLobe {
                gain,
                weight,
                ..split
            })
        };
        let n = light_path::aim(path, surface, self.motion, self.frame, split, rays, lit);
        first..first + n
    }

    /// How much several cones count against the one that photos taught where the environment is now that of another
    /// lobe by the share `moved`, `[0, 1]`.
    fn split_weight(&self, roughness: f32, learned: f32, moved: f32) -> f32 {
        let change = untaught_share(self.object, roughness, learned);
        // Sharp cones are as good elsewhere.
        let is_wide = (learned - SHARP) / SHARP_TO_WIDE;
        change.max(moved * is_wide.clamp(0.0, 1.0))
    }

    /// Adds those of a lobe's cones that leave the object to `rays` and the others to `blocked`, as those of the lit
    /// vertex `owner`; nothing without cones.
    fn split_lobe(
        &self,
        path: &[PathVertex],
        roughness: f32,
        (owner, of_pixel): (usize, PathOfPixel),
        rays: &mut Vec<FieldRay>,
        blocked: &mut Vec<BlockedCone>,
    ) -> Option<SplitLobe> {
        let (point, first, first_blocked) = (&path[0].point, rays.len(), blocked.len());
        let cones = lobe_cones(point, roughness, of_pixel);
        for (k, LobeCone { axis, lobe }) in cones.enumerate() {
            // Without a next vertex nothing is there that could block.
            let hit = (path.len() > 1)
                .then(|| blocked_cones::arrive(self.object, point, axis, lobe.variance))
                .flatten();
            if let Some(point) = hit {
                blocked.push(BlockedCone {
                    owner,
                    point,
                    variance: lobe.variance,
                    throughput: Vec3::ONE,
                    index: k as u32 * of_pixel.of + of_pixel.index,
                    n: of_pixel.of,
                });
            } else {
                let (motion, frame) = (self.motion, self.frame);
                let lobe = Lobe::from_variance(lobe.variance + self.sharpest);
                rays.push(light_path::first_lobe_ray(
                    point, axis, &lobe, motion, frame,
                ));
            }
        }
        let n = rays.len() - first;
        let n_blocked = blocked.len() - first_blocked;
        let share = 1.0 / (n + n_blocked).max(1) as f32;
        for cone in &mut blocked[first_blocked..] {
            cone.throughput *= share;
            cone.n *= n_blocked as u32;
        }
        (n + n_blocked > 0).then_some(SplitLobe {
            first,
            n,
            n_cones: n + n_blocked,
            from_object: Vec3::ZERO,
            from_object_squared: Vec3::ZERO,
            from_lamps: Vec3::ZERO,
            gain: Vec3::ONE,
            weight: 1.0,
        })
    }
}

/// How far a moved environment asks the lobe at `point` for other light than photos taught it, `[0, 1]`: the environment
/// was turned or moved under the lobe by more than the lobe is wide.
fn moved_away(
    motion: &EnvironmentFromWorld,
    frame: &FieldFrame,
    point: &SurfacePoint,
    learned: f32,
) -> f32 {
    let axis = point.reflected();
    let turned = motion.direction(axis) - axis;
    let moved = (motion.point(point.position) - point.position) / frame.half_side;
    let away2 = turned.length_squared() + moved.length_squared();
    1.0 - (-0.5 * away2 / Lobe::from_roughness(learned).variance).exp()
}

/// How little the photos taught a lobe of this perceptual roughness where they taught one of the `learned` roughness, `[0, 1]`.
pub(super) fn untaught_share(object: &ObjectModel, roughness: f32, learned: f32) -> f32 {
    let taught = object.material.perceptual(Surface {
        roughness: learned,
        ..Surface::default()
    });
    ((roughness - taught.roughness).abs() / UNTAUGHT).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::EnvironmentTransform;

    #[test]
    fn a_lobe_keeps_its_light_where_the_environment_hardly_moves_under_it() {
        let frame = FieldFrame {
            center: Vec3::ZERO,
            half_side: 2.0,
        };
        let away = |rotate_deg, translate, learned| {
            let transform = EnvironmentTransform {
                rotate_deg,
                translate,
                ..EnvironmentTransform::default()
            };
            let point = SurfacePoint {
                normal: Vec3::Z,
                to_eye: Vec3::Z,
                ..SurfacePoint::default()
            };
            moved_away(&transform.environment_from_world(), &frame, &point, learned)
        };
        assert_eq!(away(Vec3::ZERO, Vec3::ZERO, 0.2), 0.0);
        let about_itself = away(Vec3::new(0.0, 0.0, 90.0), Vec3::ZERO, 0.2);
        assert!(about_itself < 1e-6, "{about_itself}");
        let turned = |degrees, learned| away(Vec3::new(degrees, 0.0, 0.0), Vec3::ZERO, learned);
        assert!(turned(90.0, 0.2) > 0.999);
        assert!((0.0..0.05).contains(&turned(2.0, 0.5)), "rough");
        assert!(
            turned(2.0, 0.1) > turned(2.0, 0.5),
            "a sharp lobe sees it sooner"
        );
        let shifted = |x, learned| away(Vec3::ZERO, Vec3::new(x, 0.0, 0.0), learned);
        assert!(shifted(0.05, 0.4) < 0.05 && shifted(2.0, 0.2) > 0.9);
    }
}
