//! Properties of encodings, lobes, compositing and transforms that must hold over the whole range of floats.
//!
//! Whatever is learned or read from a file may be any finite number, so inputs are drawn over all exponents
//! ([`finite`]) and, as those hardly ever fall between 0 and 1, over the usual range as often.

use glam::{DQuat, Vec3};
use proptest::prelude::*;

use super::field::composite::{CompositeBuffers, WIDTH};
use super::field::contraction::{contract, expand, unit_cube};
use super::kernels::math::{sigmoid, softplus};
use super::light::display::Display;
use super::light::lobe::{Lobe, kappa_from_roughness, mean_length};
use super::networks::hash_grid::{
    FEATURES, GridConfig, Level, SamplePoints, encode_level, footprint_gradient,
};
use super::networks::spherical_harmonics::attenuated_sh;
use super::paper::encoding::{LEVEL_WIDTH, encode};
use super::surface::edit::EnvironmentTransform;

/// Any finite float: half of them over all exponents, half of them in `[-4, 4]`.
fn finite() -> impl Strategy<Value = f32> {
    use proptest::num::f32::{NORMAL, SUBNORMAL, ZERO};
    prop_oneof![NORMAL | SUBNORMAL | ZERO, -4.0_f32..4.0]
}

/// Any finite float that is not below zero.
fn not_negative() -> impl Strategy<Value = f32> {
    finite().prop_map(f32::abs)
}

/// A length from a millionth to a million.
fn length() -> impl Strategy<Value = f32> {
    (-6.0_f32..6.0).prop_map(|e| 10.0_f32.powf(e))
}

fn unit_vector() -> impl Strategy<Value = Vec3> {
    (-1.0_f32..1.0, 0.0..std::f32::consts::TAU).prop_map(|(z, phi)| {
        let r = (1.0 - z * z).sqrt();
        Vec3::new(r * phi.cos(), r * phi.sin(), z)
    })
}

/// One dense and two hashed levels.
fn level() -> impl Strategy<Value = Level> {
    prop_oneof![Just(4_u32), Just(24), Just(16384)].prop_map(|resolution| {
        let config = GridConfig {
            n_levels: 4,
            coarsest: resolution,
            finest: resolution,
            log2_table_size: 8,
            least_weight: 0.0,
        };
        config.levels()[0]
    })
}

/// The features of one point, from a table without pattern or, as a partition of unity, of ones.
fn features(level: &Level, table: &[f32], position: [f32; 3], footprint: f32) -> [f32; FEATURES] {
    let mut out = [0.0; FEATURES];
    let at = SamplePoints {
        positions: &[position],
        footprints: &[footprint],
    };
    encode_level(level, table, at, &mut out);
    out
}

fn table(level: &Level) -> Vec<f32> {
    let n = level.n_values();
    (0..n).map(|i| (i as f32 * 0.7).sin()).collect()
}

proptest! {
    #[test]
    fn grid_features_are_within_the_table_for_any_point(
        level in level(), position in [finite(), finite(), finite()], footprint in not_negative()
    ) {
        let out = features(&level, &table(&level), position, footprint);
        prop_assert!(out.iter().all(|v| v.abs() <= 1.0 + 1e-5), "{out:?}");
        let weight = level.weight(footprint);
        prop_assert!((0.0..=1.0).contains(&weight), "weight {weight}");
        let ones = features(&level, &vec![1.0; level.n_values()], position, footprint);
        prop_assert!((ones[0] - weight).abs() < 1e-6, "{ones:?}, not {weight}");
    }

    #[test]
    fn grid_features_are_continuous_across_cells(
        level in level(), cell in [1_u32..4, 1..4, 1..4], inside in [0.0_f32..1.0, 0.0..1.0, 0.0..1.0], axis in 0_usize..3
    ) {
        let side = level.resolution as f32;
        let mut position: [f32; 3] = std::array::from_fn(|a| (cell[a] as f32 + inside[a]) / side);
        let border = cell[axis] as f32 / side;
        let table = table(&level);
        position[axis] = border.next_down();
        let below = features(&level, &table, position, 0.0);
        position[axis] = border.next_up();
        let above = features(&level, &table, position, 0.0);
        for (a, b) in below.iter().zip(above) {
            prop_assert!((a - b).abs() < 1e-5, "{below:?} and {above:?}");
        }
    }

    #[test]
    fn footprint_gradient_is_that_of_double_precision(footprint in not_negative(), feature in -1.0_f32..1.0) {
        let config = GridConfig { n_levels: 4, coarsest: 16, finest: 768, log2_table_size: 8, least_weight: 0.0 };
        let levels = config.levels();
        let encoded: Vec<f32> = levels.iter().flat_map(|l| [l.weight(footprint) * feature, 0.0, 0.0, 0.0]).collect();
        let d = footprint_gradient(&levels, footprint, &encoded, &[1.0; 16]);
        let exact: f64 = levels.iter().map(|level| {
            // w = (1 + (a s)²)^(-1/2), dw/ds = -a² s w³.
            let (a, s) = (2.5 * f64::from(level.resolution), f64::from(footprint));
            let w = 1.0 / (1.0 + (a * s).powi(2)).sqrt();
            -a * a * s * w.powi(3) * f64::from(feature)
        }).sum();
        prop_assert!(
            (f64::from(d) - exact).abs() <= 1e-4 * exact.abs() + 1e-30,
            "{d}, not {exact}"
        );
    }

    #[test]
    fn contraction_is_bounded_for_any_point(x in [finite(), finite(), finite()]) {
        let (c, scale) = contract(x);
        prop_assert!(c.iter().all(|v| v.abs() <= 2.0 + 4.0 * f32::EPSILON), "{c:?}");
        prop_assert!((0.0..=1.0).contains(&scale), "scale {scale}");
        prop_assert!(unit_cube(c).iter().all(|v| (-f32::EPSILON..=1.0 + f32::EPSILON).contains(v)));
        for axis in 0..3 {
            prop_assert!(c[axis] * x[axis] >= 0.0, "the sign changed: {c:?}");
        }
    }

    #[test]
    fn contraction_grows_with_distance(x in [-4.0_f32..4.0, -4.0..4.0, -4.0..4.0], far in 1.0_f32..1e6) {
        let (near_c, near_scale) = contract(x);
        let (far_c, far_scale) = contract(x.map(|v| v * far));
        for axis in 0..3 {
            prop_assert!(far_c[axis].abs() >= near_c[axis].abs() * (1.0 - 1e-6), "{near_c:?} and {far_c:?}");
        }
        prop_assert!(far_scale <= near_scale * (1.0 + 1e-5), "{near_scale} and {far_scale}");
    }

    #[test]
    fn contraction_is_undone(c in [-1.99_f32..1.99, -1.99..1.99, -1.99..1.99]) {
        let back = contract(expand(c)).0;
        for axis in 0..3 {
            prop_assert!((back[axis] - c[axis]).abs() < 1e-5, "{back:?}");
        }
    }

    #[test]
    fn harmonics_are_bounded_and_fade_with_the_lobe(d in unit_vector(), kappa in not_negative(), wider in 1.0_f32..1e3) {
        let sharp = attenuated_sh(d.to_array(), kappa);
        let wide = attenuated_sh(d.to_array(), kappa / wider);
        for (a, b) in sharp.iter().zip(wide) {
            prop_assert!(a.abs() <= 1.1 && b.abs() <= a.abs() + 1e-6, "{sharp:?} and {wide:?}");
        }
    }

    #[test]
    fn the_paper_s_encoding_is_an_attenuated_circle(
        mean in [-2.0_f32..2.0, -2.0..2.0, -2.0..2.0], variance in [not_negative(), not_negative(), not_negative()]
    ) {
        let mut out = [0.0; 16 * LEVEL_WIDTH];
        encode(mean, variance, &mut out);
        for (i, level) in out.chunks_exact(LEVEL_WIDTH).enumerate() {
            for axis in 0..3 {
                let radius = f64::from(level[axis]).hypot(f64::from(level[3 + axis]));
                let exact = (-0.5 * 4.0_f64.powi(i as i32) * f64::from(variance[axis])).exp();
                prop_assert!((radius - exact).abs() < 1e-5 * exact + 1e-8, "{radius}, not {exact}");
            }
        }
    }

    #[test]
    fn any_roughness_gives_a_lobe_in_range(roughness in finite()) {
        let lobe = Lobe::from_roughness(roughness);
        prop_assert!((0.35..=1e6).contains(&lobe.kappa), "{lobe:?}");
        prop_assert!(lobe.mean_length > 0.0 && lobe.mean_length < 1.0, "{lobe:?}");
        prop_assert!(lobe.variance > 0.0 && lobe.variance <= 1.0 / 3.0, "{lobe:?}");
        prop_assert!(lobe.d_variance >= 0.0 && lobe.d_variance.is_finite(), "{lobe:?}");
        prop_assert!(lobe.d_kappa <= 0.0 && lobe.d_kappa.is_finite(), "{lobe:?}");
    }

    #[test]
    fn rougher_is_wider(a in 0.0_f32..1.0, b in 0.0_f32..1.0) {
        let (a, b) = (Lobe::from_roughness(a.min(b)), Lobe::from_roughness(a.max(b)));
        prop_assert!(b.kappa <= a.kappa && b.variance >= a.variance * (1.0 - 1e-5), "{a:?} and {b:?}");
        prop_assert!(b.mean_length <= a.mean_length + 1e-6, "{a:?} and {b:?}");
    }

    #[test]
    fn roughness_follows_from_concentration(roughness in 0.03_f32..1.0) {
        let back = (0.35 / kappa_from_roughness(roughness)).powf(0.25);
        prop_assert!((back - roughness).abs() < 1e-5, "{back}");
    }

    #[test]
    fn mean_length_is_that_of_double_precision(kappa in not_negative()) {
        let k = f64::from(kappa);
        // The series where coth k - 1/k cancels in double precision too.
        let exact = if k < 1e-2 { k / 3.0 - k.powi(3) / 45.0 } else { 1.0 / k.tanh() - 1.0 / k };
        let found = f64::from(mean_length(kappa));
        // Denormal numbers have fewer digits.
        let least = f64::from(f32::MIN_POSITIVE) * f64::from(f32::EPSILON);
        prop_assert!((found - exact).abs() <= 2e-5 * exact + least, "{found}, not {exact}");
    }

    #[test]
    fn activations_are_in_range_and_keep_nan(x in finite()) {
        prop_assert!((0.0..=1.0).contains(&sigmoid(x)));
        prop_assert!(softplus(x) >= 0.0 && softplus(x).is_finite() && softplus(x) >= x);
        prop_assert!(sigmoid(f32::NAN).is_nan() && softplus(f32::NAN).is_nan());
    }

    #[test]
    fn compositing_shares_out_all_light(
        samples in prop::collection::vec((finite(), not_negative(), -1e30_f32..1e30), 1..24)
    ) {
        let composite = Composited::new(&samples);
        let transmittance: f64 = 1.0 - composite.weights().map(f64::from).sum::<f64>();
        prop_assert!(composite.weights().all(|w| (0.0..=1.0).contains(&w)));
        prop_assert!(transmittance > -1e-6, "transmittance {transmittance}");
        let opacity = composite.buffers.features[WIDTH - 1];
        prop_assert!((0.0..=1.0).contains(&opacity), "opacity {opacity}");
        prop_assert!((f64::from(opacity) - 1.0 + transmittance).abs() < 1e-6);
        prop_assert!(composite.buffers.features.iter().all(|v| v.is_finite()));
        let largest = samples.iter().fold(0.0, |m: f32, s| m.max(s.2.abs()));
        prop_assert!(composite.buffers.features[0].abs() <= largest * 1.000_001, "no mean");
    }

    #[test]
    fn compositing_agrees_with_double_precision(
        samples in prop::collection::vec((-6.0_f32..16.0, 1e-4_f32..4.0, -1.0_f32..1.0), 1..24)
    ) {
        let composite = Composited::new(&samples);
        let (weights, d_log_density) = exact_compositing(&samples);
        for (found, exact) in composite.weights().zip(weights) {
            prop_assert!((f64::from(found) - exact).abs() < 2e-6, "weight {found}, not {exact}");
        }
        for (i, exact) in d_log_density.into_iter().enumerate() {
            let found = composite.d_rows[i * WIDTH];
            // Rounding of the transmittance, times a weight's gradient of up to 16, times a depth of up to 20.
            prop_assert!((f64::from(found) - exact).abs() < 2e-4, "sample {i}: {found}, not {exact}");
        }
    }

    #[test]
    fn display_values_are_ordered_and_finite(a in finite(), b in finite(), gamma in 0.2_f32..5.0) {
        let display = Display { gamma };
        let (low, high) = (display.value(a.min(b)), display.value(a.max(b)));
        prop_assert!(low.is_finite() && high.is_finite(), "{low} and {high}");
        prop_assert!(low <= high + 1e-5 * high.abs(), "{low} above {high}");
        prop_assert!(low * a.min(b) >= 0.0, "the sign changed: {low}");
        prop_assert!(display.value(f32::NAN).is_nan());
    }

    #[test]
    fn an_environment_s_motion_is_undone_by_its_definition(
        turn in [-720.0_f32..720.0, -720.0..720.0, -720.0..720.0], shift in [length(), length(), length()],
        scale in 0.01_f32..100.0, point in [-4.0_f32..4.0, -4.0..4.0, -4.0..4.0]
    ) {
        let transform = EnvironmentTransform {
            rotate_deg: turn.into(), translate: shift.into(), scale, ..EnvironmentTransform::default()
        };
        let [x, y, z] = turn.map(|degrees| f64::from(degrees).to_radians());
        let rotation = DQuat::from_rotation_z(z) * DQuat::from_rotation_y(y) * DQuat::from_rotation_x(x);
        let p = Vec3::from(point);
        let world = (rotation * (p.as_dvec3() * f64::from(scale)) + transform.translate.as_dvec3()).as_vec3();
        let back = transform.environment_from_world().point(world);
        // Single precision of the world point, in the environment's unit.
        let precision = 1e-5 * (world.length() + transform.translate.length()) / scale + 1e-4;
        prop_assert!((back - p).length() < precision, "{p} came back as {back}");
    }

    #[test]
    fn any_environment_transform_is_finite(
        turn in [finite(), finite(), finite()], exposure in finite(), white in [not_negative(), not_negative(), not_negative()], scale in finite()
    ) {
        let transform = EnvironmentTransform {
            rotate_deg: turn.into(), exposure_ev: exposure, white_balance: white.into(), scale, ..EnvironmentTransform::default()
        };
        let motion = transform.environment_from_world();
        prop_assert!(motion.gain.is_finite() && motion.gain.min_element() >= 0.0, "{:?}", motion.gain);
        prop_assert!((motion.direction(Vec3::X).length() - 1.0).abs() < 1e-4);
        prop_assert!(motion.point(Vec3::ONE).is_finite() && motion.length(1.0) > 0.0);
    }
}

/// One ray of samples (log density, interval length, all features alike), composited there and back for an opacity and
/// features whose gradient is 1.
struct Composited {
    buffers: CompositeBuffers,
    d_rows: Vec<f32>,
}

impl Composited {
    fn new(samples: &[(f32, f32, f32)]) -> Self {
        let mut rows = Vec::new();
        for (log_density, _, feature) in samples {
            rows.push(*log_density);
            rows.extend([*feature; WIDTH - 1]);
        }
        // Lengths beyond this are no distances; the product with the density would be infinite.
        let deltas: Vec<f32> = samples.iter().map(|s| s.1.min(1e30)).collect();
        let mut buffers = CompositeBuffers::default();
        buffers.forward(&rows, &deltas, samples.len());
        let mut d_rows = vec![0.0; rows.len()];
        buffers.backward(&rows, (&[1.0; WIDTH], &[]), samples.len(), &mut d_rows);
        Self { buffers, d_rows }
    }

    fn weights(&self) -> impl Iterator<Item = f32> {
        self.buffers.weights.iter().copied()
    }
}

/// Weights and `d loss / d log density` of [`Composited`] in double precision.
fn exact_compositing(samples: &[(f32, f32, f32)]) -> (Vec<f64>, Vec<f64>) {
    let depths: Vec<f64> = samples
        .iter()
        .map(|s| f64::from(s.0.min(15.0)).exp() * f64::from(s.1))
        .collect();
    let d_weight = |i: usize| 1.0 + 15.0 * f64::from(samples[i].2);
    let mut before = 1.0;
    let (mut weights, mut after) = (Vec::new(), Vec::new());
    for depth in &depths {
        weights.push(before * -(-depth).exp_m1());
        before *= (-depth).exp();
        after.push(before);
    }
    let d_log_density = (0..samples.len())
        .map(|i| {
            let behind: f64 = (i + 1..samples.len())
                .map(|k| d_weight(k) * weights[k])
                .sum();
            let slope = if samples[i].0 < 15.0 { depths[i] } else { 0.0 };
            (d_weight(i) * after[i] - behind) * slope
        })
        .collect();
    (weights, d_log_density)
}
