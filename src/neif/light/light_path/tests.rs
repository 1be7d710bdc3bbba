//! Tests of `light_path`.

use super::*;
use crate::neif::EnvironmentTransform;

/// Three vertices on curved surfaces; the last one's lobe is free.
fn path() -> [PathVertex; 3] {
    let vertex = |core: f32, distance, curvature| PathVertex {
        point: SurfacePoint {
            position: Vec3::new(0.1, -0.2, 0.3),
            normal: Vec3::Z,
            to_eye: Vec3::new(0.6, 0.0, 0.8),
            base: 0.01,
            spread: 0.02,
        },
        blocked: Blocked {
            core,
            rings: [0.5, 0.25],
        },
        distance,
        curvature,
    };
    [
        vertex(0.0, 0.0, 0.0),
        vertex(1.0, 0.3, 4.0),
        vertex(0.0, 0.5, 2.0),
    ]
}

fn surfaces() -> [Surface; 3] {
    [0.45, 0.6, 0.3].map(|roughness| Surface {
        diffuse: Vec3::new(0.2, 0.5, 0.1) * roughness,
        tint: Vec3::new(0.9, 0.3, 0.4),
        roughness,
    })
}

fn lit(surfaces: &[Surface; 3]) -> (Vec<LitVertex>, Vec<FieldRay>) {
    let (mut rays, mut lit) = (Vec::new(), Vec::new());
    let motion = EnvironmentTransform::default().environment_from_world();
    let frame = FieldFrame {
        center: Vec3::ZERO,
        half_side: 2.0,
    };
    let n = aim(
        &path(),
        |k| (k, surfaces[k]),
        &motion,
        &frame,
        &mut rays,
        &mut lit,
    );
    assert_eq!((n, rays.len()), (3, 3), "every vertex has light of its own");
    (lit, rays)
}

const RADIANCE: [[f32; 3]; 3] = [[1.5, 0.2, 3.0], [0.4, 0.9, 0.1], [2.0, 1.0, 0.5]];
const D_OUT: Vec3 = Vec3::new(0.7, -0.4, 1.2);

fn loss(surfaces: &[Surface; 3]) -> f32 {
    let (mut lit, _) = lit(surfaces);
    gather(&mut lit, |_| Vec3::ONE, |ray| Vec3::from(RADIANCE[ray]));
    lit[0].outgoing().dot(D_OUT)
}

#[test]
fn surface_gradients_agree_with_finite_differences() {
    let (mut lit, _) = lit(&surfaces());
    gather(&mut lit, |_| Vec3::ONE, |ray| Vec3::from(RADIANCE[ray]));
    let (mut d_radiance, mut d) = ([[0.0; 3]; 3], [Surface::default(); 3]);
    backward(&lit, D_OUT, &RADIANCE, &mut d_radiance, &mut d);
    let numeric = |k: usize, change: &dyn Fn(&mut Surface, f32)| {
        let at = |h: f32| {
            let mut moved = surfaces();
            change(&mut moved[k], h);
            loss(&moved)
        };
        (at(1e-2) - at(-1e-2)) / 2e-2
    };
    for (k, d) in d.iter().enumerate() {
        for c in 0..3 {
            let diffuse = numeric(k, &|s, h| s.diffuse[c] += h);
            assert!((d.diffuse[c] - diffuse).abs() < 1e-3, "diffuse {k} {c}");
            let tint = numeric(k, &|s, h| s.tint[c] += h);
            assert!((d.tint[c] - tint).abs() < 1e-3, "tint {k} {c}");
        }
        let roughness = numeric(k, &|s, h| s.roughness += h);
        assert!(
            (d.roughness - roughness).abs() < 0.02 * roughness.abs() + 1e-3,
            "roughness {k}: {} against {roughness}",
            d.roughness
        );
    }
    // Linear in the light: the sum of radiance times gradient is the part of the loss that light makes.
    let by_light: f32 = d_radiance
        .iter()
        .flatten()
        .zip(RADIANCE.iter().flatten())
        .map(|(d, r)| d * r)
        .sum();
    let mut dark = lit.clone();
    gather(&mut dark, |_| Vec3::ONE, |_| Vec3::ZERO);
    let expected = loss(&surfaces()) - dark[0].outgoing().dot(D_OUT);
    assert!(
        (by_light - expected).abs() < 1e-4,
        "{by_light} against {expected}"
    );
}

#[test]
fn a_ray_s_width_answers_to_all_lobes_before_it() {
    let weights = [0.3, -0.7, 1.1];
    let sum = |surfaces: &[Surface; 3]| -> f64 {
        let (_, rays) = lit(surfaces);
        let rays = rays.iter().zip(weights);
        rays.map(|(ray, w)| f64::from(ray.cone.lobe_variance * w))
            .sum()
    };
    let (lit, _) = lit(&surfaces());
    let mut d = [Surface::default(); 3];
    roughness_backward(&lit, &weights, &mut d);
    for k in 0..3 {
        let at = |h: f32| {
            let mut moved = surfaces();
            moved[k].roughness += h;
            sum(&moved)
        };
        let numeric = ((at(1e-3) - at(-1e-3)) / 2e-3) as f32;
        assert!(
            (d[k].roughness - numeric).abs() < 0.01 * numeric.abs() + 1e-4,
            "{k}: {} against {numeric}",
            d[k].roughness
        );
    }
}

#[test]
fn a_path_ends_where_its_lobe_is_free() {
    let mut path = path();
    path[0].blocked = Blocked::default();
    let (mut rays, mut lit) = (Vec::new(), Vec::new());
    let motion = EnvironmentTransform::default().environment_from_world();
    let frame = FieldFrame {
        center: Vec3::ZERO,
        half_side: 2.0,
    };
    let n = aim(
        &path,
        |k| (k, surfaces()[k]),
        &motion,
        &frame,
        &mut rays,
        &mut lit,
    );
    assert_eq!((n, rays.len(), lit.len()), (1, 1, 1));
}

#[test]
fn blocked_share_follows_the_lobe() {
    let blocked = Blocked {
        core: 1.0,
        rings: [0.5, 0.25],
    };
    assert!(
        (blocked.share(1e6).0 - 1.0).abs() < 1e-6,
        "a mirror sees the mirror ray only"
    );
    assert!(
        (blocked.share(0.35).0 - 0.25).abs() < 0.05,
        "a wide lobe sees the outer ring"
    );
    assert_eq!(Blocked::default().share(10.0).0, 0.0, "nothing blocked");
    for kappa in [0.5_f32, 5.0, 50.0, 500.0] {
        let h = 1e-2 * kappa;
        let numeric = (blocked.share(kappa + h).0 - blocked.share(kappa - h).0) / (2.0 * h);
        let analytic = blocked.share(kappa).1;
        assert!(
            (analytic - numeric).abs() < 2e-2 * numeric.abs() + 1e-5,
            "kappa {kappa}: {analytic} against {numeric}"
        );
    }
}
