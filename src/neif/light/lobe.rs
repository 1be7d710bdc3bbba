//! The specular lobe: a normalised von Mises–Fisher distribution whose width follows from roughness.
//!
//! Eq. 4 of the paper, normalised; roughness is glTF's and Blender's perceptual one (GGX alpha = r²).

/// Concentration times alpha²: median fit to the GGX reflection lobe at normal incidence.
pub(super) const KAPPA_ALPHA2: f32 = 0.35;
/// Sharpest lobe; beyond it single precision cannot distinguish the lobe from a ray.
const KAPPA_MAX: f32 = 1e6;
/// Below this concentration the closed form of [`mean_length`] cancels: three terms of its series are exact.
const KAPPA_SERIES: f32 = 0.2;

/// Concentration `kappa = 0.35 / r⁴`, clamped to `[0.35, 1e6]`; `roughness` is clamped to `[0, 1]`.
pub fn kappa_from_roughness(roughness: f32) -> f32 {
    let alpha = roughness.clamp(0.0, 1.0).powi(2);
    (KAPPA_ALPHA2 / (alpha * alpha)).min(KAPPA_MAX)
}

/// `alpha` by which a lobe learned through one cone of the fast field is wider than GGX's lobe of the same look.
const CONE_ALPHA: f32 = 0.018;
/// Least perceptual roughness that is distinguished from a mirror.
const LEAST_PERCEPTUAL: f32 = 0.02;

/// The roughness that renderers mean, of one learned through single cones: `alpha² = alpha_learned² - 0.018²`.
///
/// A cone finds the field's fine levels too sharp: mirrors settle at 0.13, and 0.10 at 0.16, whatever the scene.
pub fn perceptual_roughness(learned: f32) -> f32 {
    let alpha2 = learned.clamp(0.0, 1.0).powi(4) - CONE_ALPHA * CONE_ALPHA;
    alpha2.max(0.0).sqrt().sqrt().max(LEAST_PERCEPTUAL)
}

/// Variance per transverse axis of the fast field's sharpest cone, that of a mirror: what photos taught it no narrower one
/// of, other cones have on top of their own.
pub const SHARPEST_VARIANCE: f32 = CONE_ALPHA * CONE_ALPHA / KAPPA_ALPHA2;

/// The inverse of [`perceptual_roughness`]: the roughness of the one cone of the fast field that looks like this one.
pub fn cone_roughness(perceptual: f32) -> f32 {
    let alpha2 = perceptual.clamp(0.0, 1.0).powi(4) + CONE_ALPHA * CONE_ALPHA;
    alpha2.sqrt().sqrt().min(1.0)
}

/// Length of the mean direction, `A(kappa) = coth kappa - 1/kappa`, in `[0, 1]`.
pub fn mean_length(kappa: f32) -> f32 {
    if kappa < KAPPA_SERIES {
        let k2 = kappa * kappa;
        kappa * (1.0 / 3.0 - k2 * (1.0 / 45.0 - k2 * (2.0 / 945.0)))
    } else if kappa > 20.0 {
        // coth is 1 to the last bit.
        1.0 - 1.0 / kappa
    } else {
        1.0 / kappa.tanh() - 1.0 / kappa
    }
}

/// Concentration of the lobe with this variance per transverse axis, the inverse of `A/kappa`; 0 from 1/3 on, where
/// the lobe is the whole sphere.
pub fn kappa_from_variance(variance: f32) -> f32 {
    // A = 1 - 1/kappa to the last bit, which leaves a quadratic equation.
    if variance < 0.0475 {
        let variance = variance.max(1.0 / KAPPA_MAX / KAPPA_MAX);
        return (1.0 + (1.0 - 4.0 * variance).sqrt()) / (2.0 * variance);
    }
    if variance >= 1.0 / 3.0 {
        return 0.0;
    }
    // Banerjee et al. 2005, Eq. 4.4, solved for kappa; then Newton's method.
    let mean = ((1.0 - 3.0 * variance) / (1.0 - variance)).max(0.0).sqrt();
    let mut kappa = mean / variance;
    for _ in 0..2 {
        let a = mean_length(kappa);
        let slope = d_variance_d_kappa(kappa, a);
        // Next to 1/3 the slope vanishes, and the start is as good as can be determined.
        if slope > -1e-4 {
            break;
        }
        kappa -= (a / kappa - variance) / slope;
    }
    kappa.max(0.0)
}

/// What one roughness means for a cone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lobe {
    /// Concentration.
    pub kappa: f32,
    /// Length of the mean direction.
    pub mean_length: f32,
    /// Variance per transverse axis of a unit direction, `A/kappa`.
    pub variance: f32,
    /// `d variance / d roughness`; 0 where `kappa` is clamped.
    pub d_variance: f32,
    /// `d kappa / d roughness`; 0 where it is clamped.
    pub d_kappa: f32,
}

impl Lobe {
    /// The narrow lobe of a given variance per transverse axis, in `(0, 0.3]`, by `variance = 1/kappa`: no derivatives.
    pub fn from_variance(variance: f32) -> Self {
        Self::new(variance.recip().min(KAPPA_MAX), 0.0)
    }

    /// The lobe of a perceptual roughness in `[0, 1]`.
    pub fn from_roughness(roughness: f32) -> Self {
        let kappa = kappa_from_roughness(roughness);
        let d_kappa = if kappa < KAPPA_MAX && roughness > 0.0 && roughness < 1.0 {
            -4.0 * kappa / roughness
        } else {
            0.0
        };
        Self::new(kappa, d_kappa)
    }

    fn new(kappa: f32, d_kappa: f32) -> Self {
        let mean_length = mean_length(kappa);
        Self {
            kappa,
            mean_length,
            variance: mean_length / kappa,
            d_variance: d_variance_d_kappa(kappa, mean_length) * d_kappa,
            d_kappa,
        }
    }
}

/// `d(A/kappa)/d kappa = (A' - A/kappa)/kappa` with `A' = 1 - A² - 2A/kappa`.
fn d_variance_d_kappa(kappa: f32, a: f32) -> f32 {
    if kappa < KAPPA_SERIES {
        // A/k = 1/3 - k²/45 + 2k⁴/945.
        return kappa * (8.0 / 945.0 * kappa * kappa - 2.0 / 45.0);
    }
    // For large kappa A' = 1/kappa² up to exponentially small terms; the general form cancels there.
    let d_a = if kappa > 20.0 {
        1.0 / (kappa * kappa)
    } else {
        1.0 - a * a - 2.0 * a / kappa
    };
    (d_a - a / kappa) / kappa
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cone_of_a_perceptual_roughness_looks_like_it() {
        for r in [LEAST_PERCEPTUAL, 0.1, 0.3, 0.7, 0.99] {
            let back = perceptual_roughness(cone_roughness(r));
            // Near a mirror the fourth root magnifies what is rounded.
            assert!((back - r).abs() < 1e-3, "{r}: {back}");
        }
        let mirror = Lobe::from_roughness(cone_roughness(0.0)).variance;
        assert!((mirror / SHARPEST_VARIANCE - 1.0).abs() < 0.01, "{mirror}");
    }

    #[test]
    fn variance_slope_agrees_with_finite_differences() {
        for r in [0.05_f32, 0.1, 0.3, 0.5, 0.6, 0.8, 0.95] {
            let h = 1e-3 * r;
            let variance = |r: f32| {
                let k = 0.35 / (r as f64).powi(4);
                (1.0 / k.tanh() - 1.0 / k) / k
            };
            let numeric = (variance(r + h) - variance(r - h)) / f64::from((r + h) - (r - h));
            let analytic = f64::from(Lobe::from_roughness(r).d_variance);
            assert!(
                (analytic - numeric).abs() < 5e-3 * numeric.abs() + 1e-9,
                "r = {r}: {analytic} against {numeric}"
            );
        }
    }

    #[test]
    fn the_concentration_follows_from_the_variance() {
        for i in 1..=1000 {
            let lobe = Lobe::from_roughness(i as f32 / 1000.0);
            let kappa = kappa_from_variance(lobe.variance);
            // The widest lobes' variance hardly depends on the concentration.
            let tolerance = if lobe.kappa < 1.0 { 1e-2 } else { 2e-3 };
            assert!(
                (kappa / lobe.kappa - 1.0).abs() < tolerance,
                "{i}: {kappa}, not {}",
                lobe.kappa
            );
        }
        assert!(kappa_from_variance(0.0).is_finite(), "a line");
        assert_eq!(kappa_from_variance(0.4), 0.0, "wider than the sphere");
    }

    #[test]
    fn perceptual_roughness_rises_and_leaves_rough_surfaces_alone() {
        let all: Vec<f32> = (0..=100)
            .map(|i| perceptual_roughness(i as f32 / 100.0))
            .collect();
        assert!(all.windows(2).all(|pair| pair[0] <= pair[1]), "{all:?}");
        assert_eq!(all[10], LEAST_PERCEPTUAL, "a mirror");
        assert!((all[50] - 0.5).abs() < 1e-3 && (all[100] - 1.0).abs() < 1e-3);
    }

    #[test]
    fn every_roughness_gives_a_finite_lobe() {
        for i in 0..=1000 {
            let lobe = Lobe::from_roughness(i as f32 / 1000.0);
            assert!(
                lobe.variance.is_finite() && lobe.d_variance.is_finite() && lobe.mean_length > 0.0,
                "{i}: {lobe:?}"
            );
            assert!(
                lobe.mean_length < 1.0 + 1e-6 && lobe.variance <= 1.0 / 3.0 + 1e-6,
                "{i}: {lobe:?}"
            );
        }
    }

    #[test]
    fn lobe_moments_agree_with_samples() {
        // E[cos] of the vMF by inverse CDF: cos = 1 + ln(u + (1-u) e^{-2k})/k.
        for kappa in [0.5_f64, 2.0, 10.0, 100.0] {
            let n = 20_000;
            let cosines = (0..n).map(|i| {
                let u = (f64::from(i) + 0.5) / f64::from(n);
                1.0 + (u + (1.0 - u) * (-2.0 * kappa).exp()).ln() / kappa
            });
            let (sum, sum_sin2) = cosines.fold((0.0, 0.0), |(s, t), c| (s + c, t + (1.0 - c * c)));
            let a = mean_length(kappa as f32);
            assert!(
                (sum / f64::from(n) - f64::from(a)).abs() < 1e-3,
                "mean, kappa {kappa}"
            );
            let variance = f64::from(a) / kappa;
            assert!(
                (sum_sin2 / f64::from(n) / 2.0 - variance).abs() < 2e-3 * variance.max(0.1),
                "variance, kappa {kappa}"
            );
        }
    }
}
