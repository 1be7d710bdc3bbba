//! Directions: even ones over the sphere, random ones in a lobe, and frames about an axis.

use std::f32::consts::TAU;

use glam::Vec3;

/// Turn between neighbours of a sunflower, radians.
pub const GOLDEN_ANGLE: f32 = 2.399_963_2;

/// `n` unit directions spread evenly over the sphere (the Fibonacci lattice, z falling).
pub fn fibonacci_sphere(n: usize) -> Vec<Vec3> {
    (0..n)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f32 + 1.0) / n as f32;
            let r = (1.0 - z * z).max(0.0).sqrt();
            // The angle is reduced before the sine: at i = 1e6 the plain product has lost its fraction.
            let phi = (i as f64 * f64::from(GOLDEN_ANGLE) % std::f64::consts::TAU) as f32;
            Vec3::new(r * phi.cos(), r * phi.sin(), z)
        })
        .collect()
}

/// Two unit vectors `(t, b)` that with the unit vector `n` form a right-handed frame.
///
/// Branchless and without a pole: Duff et al. 2017, "Building an Orthonormal Basis, Revisited".
#[inline]
pub fn orthonormal_basis(n: Vec3) -> (Vec3, Vec3) {
    n.any_orthonormal_pair()
}

/// `n` unit directions of equal shares of the irradiance of a surface with unit `normal`, each with its cosine: a
/// sunflower on the disc below the hemisphere (Vogel 1979), turned by `turn` radians.
pub fn irradiance_directions(
    normal: Vec3,
    n: usize,
    turn: f32,
) -> impl Iterator<Item = (Vec3, f32)> {
    let (tangent, bitangent) = orthonormal_basis(normal);
    let share = 1.0 / n as f32;
    (0..n).map(move |k| {
        let radius2 = (k as f32 + 0.5) * share;
        let (sin, cos) = (turn + k as f32 * GOLDEN_ANGLE).sin_cos();
        let up = (1.0 - radius2).sqrt();
        let across = (tangent * cos + bitangent * sin) * radius2.sqrt();
        ((across + normal * up).normalize_or(normal), up)
    })
}

/// A unit direction drawn from the von Mises–Fisher lobe of concentration `kappa` about `axis`.
///
/// `u`: two uniform numbers in 0..1. `cos = 1 + log(u + (1 - u) exp(-2 kappa)) / kappa`
/// (Jakob 2012, "Numerically stable sampling of the von Mises-Fisher distribution on S2").
/// `kappa` below 1e-4 is taken as uniform over the sphere: the quotient would be 0 / 0.
#[inline]
pub fn sample_vmf(kappa: f32, axis: Vec3, u: [f32; 2]) -> Vec3 {
    // One minus the cosine is kept, not the cosine: for a sharp lobe 1 - cos^2 would cancel to 0.
    let one_minus_cos = if kappa < 1e-4 {
        2.0 * u[0]
    } else {
        let tail = (-2.0 * kappa).exp();
        // u = 0 with a vanished tail would be log 0.
        -(u[0] + (1.0 - u[0]) * tail).max(f32::MIN_POSITIVE).ln() / kappa
    }
    .clamp(0.0, 2.0);
    let sin = (one_minus_cos * (2.0 - one_minus_cos)).max(0.0).sqrt();
    let phi = TAU * u[1];
    let (t, b) = orthonormal_basis(axis);
    (sin * phi.cos() * t + sin * phi.sin() * b + (1.0 - one_minus_cos) * axis).normalize_or_zero()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn irradiance_directions_are_unit_above_the_surface_and_cosine_weighted() {
        let normal = Vec3::new(0.6, 0.0, 0.8);
        let n = 500;
        let mut sum = Vec3::ZERO;
        for (direction, up) in irradiance_directions(normal, n, 1.0) {
            assert!(direction.is_normalized() && (direction.dot(normal) - up).abs() < 1e-5);
            assert!(up > 0.0, "{up}");
            sum += direction;
        }
        // The mean of the cosine over a cosine-weighted hemisphere is 2/3.
        assert!(
            (sum / n as f32 - normal * (2.0 / 3.0)).length() < 0.01,
            "{sum}"
        );
    }

    #[test]
    fn fibonacci_directions_are_unit_and_balanced() {
        let directions = fibonacci_sphere(1000);
        assert!(directions.iter().all(|d| d.is_normalized()), "unit length");
        let mean = directions.iter().sum::<Vec3>() / 1000.0;
        assert!(mean.length() < 2e-3, "mean {mean}");
        let zz = directions.iter().map(|d| d.z * d.z).sum::<f32>() / 1000.0;
        assert!((zz - 1.0 / 3.0).abs() < 1e-3, "second moment {zz}");
    }

    #[test]
    fn bases_are_orthonormal_and_right_handed_everywhere() {
        let poles = [Vec3::Z, Vec3::NEG_Z, Vec3::X, Vec3::Y];
        for n in fibonacci_sphere(500).into_iter().chain(poles) {
            let (t, b) = orthonormal_basis(n);
            assert!(t.dot(n).abs() < 1e-5 && b.dot(n).abs() < 1e-5, "at {n}");
            assert!((t.cross(b) - n).length() < 1e-5, "handedness at {n}");
        }
    }

    #[test]
    fn lobe_samples_have_the_mean_cosine_of_the_distribution() {
        let axis = Vec3::new(0.6, -0.64, 0.48);
        for kappa in [0.0_f32, 0.5, 5.0, 100.0, 1e4] {
            let n = 100;
            let mut sum = Vec3::ZERO;
            for i in 0..n {
                for j in 0..n {
                    let u = [(i as f32 + 0.5) / n as f32, (j as f32 + 0.5) / n as f32];
                    sum += sample_vmf(kappa, axis, u);
                }
            }
            let mean = sum / (n * n) as f32;
            let expected = if kappa == 0.0 {
                0.0
            } else {
                1.0 / kappa.tanh() - 1.0 / kappa
            };
            assert!(
                (mean - expected * axis).length() < 5e-3,
                "kappa {kappa}: mean {mean}, expected length {expected}"
            );
        }
    }

    #[test]
    fn the_corners_of_the_unit_square_give_finite_directions() {
        for kappa in [0.0, 1e-5, 1.0, 1e6, 1e12] {
            for u in [[0.0, 0.0], [1.0, 1.0], [0.0, 1.0], [1e-30, 0.3]] {
                let d = sample_vmf(kappa, Vec3::NEG_Z, u);
                assert!(d.is_normalized(), "kappa {kappa}, u {u:?}: {d}");
            }
        }
    }
}
