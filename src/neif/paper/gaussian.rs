//! The Gaussian of one interval of a cone, in contracted space.
//!
//! The conical frustum of mip-NeRF (Eq. 7 and 8 of arXiv:2103.13415), its radius that of the pixel and of the lobe
//! together; contracted by the linearised map, as in mip-NeRF 360 (Sec. 3 of arXiv:2111.12077), with the L∞ norm.

use crate::neif::field::radiance_field::FieldRay;

/// Mean and diagonal variance of an interval, contracted coordinates in `(-2, 2)³`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct IntervalGaussian {
    /// Mean.
    pub mean: [f32; 3],
    /// Variance per axis.
    pub variance: [f32; 3],
    /// `d variance / d lobe_variance` of the ray's cone.
    pub d_variance: [f32; 3],
}

/// Mean of `t`, its variance and the mean of `t²` over a frustum between `t0` and `t1`, where mass grows as `t²`.
fn frustum_moments(t0: f32, t1: f32) -> [f32; 3] {
    let (mu, h) = (0.5 * (t0 + t1), 0.5 * (t1 - t0));
    let (mu2, h2) = (mu * mu, h * h);
    // A frustum of no length at the origin would divide by zero.
    let d = (3.0 * mu2 + h2).max(1e-20);
    let mean = mu + 2.0 * mu * h2 / d;
    let variance = h2 / 3.0 - 4.0 / 15.0 * h2 * h2 * (12.0 * mu2 - h2) / (d * d);
    // Rounding may take a thin interval's variance below zero.
    let variance = variance.max(0.0);
    [mean, variance, mean * mean + variance]
}

impl IntervalGaussian {
    /// The Gaussian of a ray's cone between distances `t0 < t1`.
    ///
    /// Transverse variance is `E[(base + spread t)² + lobe_variance t²]`, the frustum's radius variance; `FieldRay`'s
    /// fields say what is what.
    pub fn new(ray: &FieldRay, t0: f32, t1: f32) -> Self {
        let cone = &ray.cone;
        let [t_mean, t_variance, t_square] = frustum_moments(t0, t1);
        let transverse = cone.base * cone.base
            + 2.0 * cone.base * cone.spread * t_mean
            + (cone.spread * cone.spread + cone.lobe_variance) * t_square;
        let x: [f32; 3] =
            std::array::from_fn(|axis| cone.origin[axis] + t_mean * cone.direction[axis]);
        let map = LinearContraction::at(x);
        let mut gaussian = Self {
            mean: map.point,
            ..Self::default()
        };
        for axis in 0..3 {
            // Row J_i of the Jacobian; Sigma = t_variance v vᵀ + transverse (1 - l lᵀ).
            let row = map.row(axis);
            let along = dot(row, cone.direction);
            let axial = dot(row, ray.direction);
            // Rounding may take it below zero for an axis along the ray.
            let across = (dot(row, row) - axial * axial).max(0.0);
            gaussian.variance[axis] = t_variance * along * along + transverse * across;
            gaussian.d_variance[axis] = t_square * across;
        }
        gaussian
    }
}

/// The contraction near a point: where the point goes, and the derivatives.
struct LinearContraction {
    point: [f32; 3],
    largest: usize,
    /// `d c_i / d x_i` of the axes that are not the largest, and of the largest.
    scales: [f32; 2],
    /// `d c_i / d x_largest` for the other axes.
    shear: [f32; 3],
}

impl LinearContraction {
    /// `c = x` inside the inner box, `(2 - 1/m) x/m` outside, with `m` the largest coordinate.
    fn at(x: [f32; 3]) -> Self {
        let largest = (0..3)
            .max_by(|&a, &b| x[a].abs().total_cmp(&x[b].abs()))
            .unwrap_or(0);
        let m = x[largest].abs();
        if m <= 1.0 {
            return Self {
                point: x,
                largest,
                scales: [1.0; 2],
                shear: [0.0; 3],
            };
        }
        let inverse = 1.0 / m;
        let scale = (2.0 - inverse) * inverse;
        let d_scale = 2.0 * inverse * inverse * (inverse - 1.0) * x[largest].signum();
        Self {
            point: x.map(|v| v * scale),
            largest,
            scales: [scale, inverse * inverse],
            shear: x.map(|v| v * d_scale),
        }
    }

    fn row(&self, axis: usize) -> [f32; 3] {
        let mut row = [0.0; 3];
        if axis == self.largest {
            row[axis] = self.scales[1];
        } else {
            row[axis] = self.scales[0];
            row[self.largest] = self.shear[axis];
        }
        row
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::orthonormal_basis;
    use crate::neif::field::contraction::contract;
    use crate::neif::field::proposal::ConeRay;
    use crate::neif::test_gradients::{assert_agrees, random, slope};
    use glam::Vec3;

    fn ray(lobe_variance: f32) -> FieldRay {
        let direction = [0.6, 0.48, 0.64];
        FieldRay {
            cone: ConeRay {
                origin: [0.1, -0.2, 0.0],
                direction,
                base: 0.0,
                spread: 0.01,
                lobe_variance,
            },
            direction,
            kappa: 50.0,
        }
    }

    #[test]
    fn moments_agree_with_points_of_the_frustum() {
        let ray = ray(0.02);
        let mut uniform = random(11);
        let l = Vec3::from(ray.direction);
        let (a, b) = orthonormal_basis(l);
        // Inside the box nothing is bent; far out the interval is short enough for the map to be linear.
        for (t0, t1) in [(0.2_f32, 0.6), (4.0, 4.05)] {
            let spread2 = ray.cone.variance(1.0) * if t0 > 1.0 { 1e-4 } else { 1.0 };
            let thin = FieldRay {
                cone: ConeRay {
                    spread: 0.0,
                    lobe_variance: spread2,
                    ..ray.cone
                },
                ..ray
            };
            let gaussian = IntervalGaussian::new(&thin, t0, t1);
            let (mut sum, mut squares) = ([0.0_f64; 3], [0.0_f64; 3]);
            let n = 200_000;
            for _ in 0..n {
                let u = uniform();
                let t = (t0.powi(3) + u * (t1.powi(3) - t0.powi(3))).cbrt();
                // A disc of radius 2 s t has the variance (s t)² per axis.
                let radius = 2.0 * spread2.sqrt() * t * uniform().sqrt();
                let (sin, cos) = (std::f32::consts::TAU * uniform()).sin_cos();
                let x = Vec3::from(ray.cone.origin) + l * t + (a * cos + b * sin) * radius;
                let c = contract(x.to_array()).0;
                for axis in 0..3 {
                    sum[axis] += f64::from(c[axis]);
                    squares[axis] += f64::from(c[axis] - gaussian.mean[axis]).powi(2);
                }
            }
            for axis in 0..3 {
                let mean = sum[axis] / f64::from(n);
                let variance = squares[axis] / f64::from(n);
                let expected = f64::from(gaussian.variance[axis]);
                assert!(
                    (mean - f64::from(gaussian.mean[axis])).abs() < 0.02 * expected.sqrt(),
                    "{t0}: mean {mean} against {}",
                    gaussian.mean[axis]
                );
                assert!(
                    (variance - expected).abs() < 0.03 * expected,
                    "{t0}: variance {variance} against {expected}"
                );
            }
        }
    }

    #[test]
    fn lobe_gradient_agrees_with_finite_differences() {
        for (t0, t1) in [(0.3, 0.5), (3.0, 4.0)] {
            let gaussian = IntervalGaussian::new(&ray(0.02), t0, t1);
            for axis in 0..3 {
                let at =
                    |v: &f32| f64::from(IntervalGaussian::new(&ray(*v), t0, t1).variance[axis]);
                let numeric = slope(&mut 0.02, |v| v, 0.01, at);
                let what = format!("{t0}, axis {axis}");
                assert_agrees(&what, gaussian.d_variance[axis], numeric, (1e-3, 1e-6));
            }
        }
    }

    #[test]
    fn any_interval_is_finite() {
        for (t0, t1) in [(0.0, 0.0), (0.0, 64.0), (1e-6, 2e-6), (63.9, 64.0)] {
            let gaussian = IntervalGaussian::new(&ray(0.33), t0, t1);
            let values = gaussian.mean.iter().chain(&gaussian.variance);
            assert!(
                values.clone().all(|v| v.is_finite())
                    && gaussian.variance.iter().all(|v| *v >= 0.0),
                "{gaussian:?}"
            );
        }
    }
}
