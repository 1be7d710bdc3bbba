//! Tests of `light_path`.

use super::*;
use crate::neif::EnvironmentTransform;
use crate::neif::test_gradients::{assert_agrees, dot, slope};

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

fn aimed(path: &[PathVertex], surfaces: &[Surface; 3]) -> (usize, Vec<LitVertex>, Vec<FieldRay>) {
    let (mut rays, mut lit) = (Vec::new(), Vec::new());
    let motion = EnvironmentTransform::default().environment_from_world();
    let frame = FieldFrame {
        center: Vec3::ZERO,
        half_side: 2.0,
    };
    let surface = |k| (k, surfaces[k]);
    let n = aim(
        path,
        surface,
        &motion,
        &frame,
        |_| None,
        &mut rays,
        &mut lit,
    );
    (n, lit, rays)
}

fn lit(surfaces: &[Surface; 3]) -> (Vec<LitVertex>, Vec<FieldRay>) {
    let (n, lit, rays) = aimed(&path(), surfaces);
    assert_eq!((n, rays.len()), (3, 3), "every vertex has light of its own");
    (lit, rays)
}

const RADIANCE: [[f32; 3]; 3] = [[1.5, 0.2, 3.0], [0.4, 0.9, 0.1], [2.0, 1.0, 0.5]];
const D_OUT: Vec3 = Vec3::new(0.7, -0.4, 1.2);

fn loss(surfaces: &[Surface; 3]) -> f64 {
    let (mut lit, _) = lit(surfaces);
    gather(&mut lit, |_| Vec3::ONE, |ray| Vec3::from(RADIANCE[ray]));
    f64::from(lit[0].outgoing().dot(D_OUT))
}

#[test]
fn surface_gradients_agree_with_finite_differences() {
    let (mut lit, _) = lit(&surfaces());
    gather(&mut lit, |_| Vec3::ONE, |ray| Vec3::from(RADIANCE[ray]));
    let (mut d_radiance, mut d) = ([[0.0; 3]; 3], [Surface::default(); 3]);
    backward(&lit, D_OUT, &RADIANCE, &mut d_radiance, &mut d);
    for (k, d) in d.iter().enumerate() {
        Surface::for_each_value(|what, value| {
            let numeric = slope(&mut surfaces(), |s| value(&mut s[k]), 1e-2, loss);
            let share = if what == "roughness" { 0.02 } else { 0.0 };
            let what = format!("{what} {k}");
            assert_agrees(&what, *value(&mut { *d }), numeric, (share, 1e-3));
        });
    }
    // Linear in the light: the sum of radiance times gradient is the part of the loss that light makes.
    let by_light = dot(d_radiance.as_flattened(), RADIANCE.as_flattened());
    let mut dark = lit.clone();
    gather(&mut dark, |_| Vec3::ONE, |_| Vec3::ZERO);
    let expected = loss(&surfaces()) - f64::from(dark[0].outgoing().dot(D_OUT));
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
    roughness_backward(&lit, &weights, |_, lobe| lobe.d_variance, &mut d);
    for k in 0..3 {
        let numeric = slope(&mut surfaces(), |s| &mut s[k].roughness, 1e-3, sum);
        assert_agrees(&k.to_string(), d[k].roughness, numeric, (0.01, 1e-4));
    }
}

#[test]
fn a_path_ends_where_its_lobe_is_free() {
    let mut path = path();
    path[0].blocked = Blocked::default();
    let (n, lit, rays) = aimed(&path, &surfaces());
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
    for kappa in [0.5, 5.0, 50.0, 500.0] {
        let share = |kappa: &f32| f64::from(blocked.share(*kappa).0);
        let numeric = slope(&mut { kappa }, |kappa| kappa, 1e-2 * kappa, share);
        let what = format!("kappa {kappa}");
        assert_agrees(&what, blocked.share(kappa).1, numeric, (2e-2, 1e-5));
    }
}
