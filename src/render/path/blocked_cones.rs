//! What the cones of a split lobe find where they meet the object again: its diffuse part, and on along its own lobe.
//!
//! The same walk as the oracle's ([`super::reference`]), with cones instead of thin rays. All pixels draw with the same
//! numbers, so that neighbours differ by what they see and not by chance.

use glam::Vec3;

use super::scratch::{BlockedCone, Contribution, ShadeScratch, light_surfaces};
use super::trace::{MAX_VERTICES, meet_again};
use crate::neif::light::light_path;
use crate::neif::light::lobe::Lobe;
use crate::neif::light::lobe_cones::{LobeCone, lobe_cone};
use crate::neif::light::shading::{SurfacePoint, fresnel};
use crate::neif::surface::object::ObjectModel;
use crate::render::scene::Scene;

/// Widest variance of a cone's directions per axis, radians squared: beyond it directions mean little.
const WIDEST: f32 = 0.3;

/// The point where a cone of `variance` that left `from` meets the object.
pub(in crate::render) fn arrive(
    object: &ObjectModel,
    from: &SurfacePoint,
    axis: Vec3,
    variance: f32,
) -> Option<SurfacePoint> {
    let hit = meet_again(&object.tracer, from.position, axis)?;
    let base = from.base + from.spread * hit.t;
    Some(SurfacePoint {
        position: hit.position,
        normal: hit.normal,
        to_eye: -axis,
        base: (base * base + variance * hit.t * hit.t).sqrt(),
        spread: from.spread,
    })
}

/// Follows the scratch's blocked cones: adds what the object itself sends to their owners, and rays for the rest.
pub(in crate::render) fn follow(scene: &Scene, object: &ObjectModel, scratch: &mut ShadeScratch) {
    let motion = scene.transform.environment_from_world();
    let frame = scene.environment.frame();
    let sharpest = scene.environment.sharpest_variance();
    let mut cones = std::mem::take(&mut scratch.blocked);
    let mut beyond = std::mem::take(&mut scratch.beyond);
    for bounce in 1..MAX_VERTICES as u32 {
        if cones.is_empty() {
            break;
        }
        let points = cones
            .iter()
            .map(|cone| (cone.point.position, cone.point.normal));
        light_surfaces(&mut beyond, scene, object, points, |_| false);
        let surfaces = beyond.surfaces().iter().zip(beyond.specular_gain());
        let is_last = bounce as usize + 1 == MAX_VERTICES;
        let mut next = Vec::new();
        for (cone, (surface, gain)) in cones.iter().zip(surfaces) {
            let fresnel = fresnel(surface.tint, cone.point.n_dot_v());
            let diffuse = surface.diffuse * (Vec3::ONE - fresnel);
            scratch.lit[cone.owner].add_from_object(cone.throughput * diffuse);
            let LobeCone { axis, lobe } = draw(cone, surface.roughness, bounce);
            let variance = cone.variance + lobe.variance;
            let throughput = cone.throughput * fresnel * *gain;
            let met = arrive(object, &cone.point, axis, variance);
            if let Some(point) = met.filter(|_| !is_last) {
                next.push(BlockedCone {
                    point,
                    variance,
                    throughput,
                    ..*cone
                });
                continue;
            }
            let (owner, ray) = (cone.owner, scratch.rays.len());
            scratch.contributions.push(Contribution {
                owner,
                ray,
                throughput,
            });
            let lobe = Lobe::from_variance((variance + sharpest).min(WIDEST));
            let ray = light_path::first_lobe_ray(&cone.point, axis, &lobe, &motion, frame);
            scratch.rays.push(ray);
        }
        cones = next;
    }
    cones.clear();
    scratch.blocked = cones;
    scratch.beyond = beyond;
}

/// One cone of the lobe at the point where the cone is.
fn draw(cone: &BlockedCone, roughness: f32, bounce: u32) -> LobeCone {
    // A lattice by the powers of the plastic number's inverse.
    let number = f64::from(cone.index * MAX_VERTICES as u32 + bounce);
    let u = [0.754_877_666_246_693, 0.569_840_290_998_053]
        .map(|step| (number * step + 0.5).fract() as f32);
    lobe_cone(&cone.point, roughness, u, cone.n).unwrap_or_else(|| LobeCone {
        axis: cone.point.reflected(),
        lobe: Lobe::from_roughness(roughness),
    })
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use crate::geometry::meshes::test_mesh::{ellipsoid, together};
    use crate::neif::RoughnessEdit;
    use crate::render::{Layer, LobeShape, ReferenceOptions, Scene, render_reference, test_scene};

    #[test]
    fn a_rough_object_that_meets_itself_looks_as_by_thin_rays() {
        let radii = Vec3::splat(0.5);
        let [left, right] = [-0.5, 0.5].map(|x| ellipsoid(Vec3::Y * x, radii, 24));
        let object = test_scene::object_of(together(&left, &right), 1);
        let mut scene = Scene::new(Some(object), test_scene::environment(2));
        let camera = test_scene::camera(24, 16);
        for roughness in [0.1, 0.4, 0.8] {
            scene.edit.roughness = RoughnessEdit::Constant(roughness);
            let options = ReferenceOptions {
                n_paths: 256,
                lobe: LobeShape::Ggx,
            };
            let cones = test_scene::picture(&scene, &camera, Layer::Final);
            let rays = render_reference(&scene, &camera, options, &test_scene::NEVER, &|_| {});
            let rays = rays.expect("not cancelled");
            let sum = test_scene::squared_difference(&cones, &rays);
            let psnr = -10.0 * (sum / (3 * cones.pixels.len()) as f32).log10();
            assert!(psnr > 34.0, "roughness {roughness}: {psnr} dB");
        }
    }
}
