//! Lens distortion: ideal directions to image points and back, for perspective and fisheye lenses.
//!
//! Image axes are `OpenCV`'s (x right, y down, z forward), image points are in units of the focal
//! length about the principal point. Both ways are defined on the part of the lens polynomial that
//! rises from the centre; beyond its first fold a lens shows nothing, whatever the polynomial says.

use glam::{Mat2, Vec2, Vec3};

/// Newton steps that undo the distortion. Phone lenses converge in 3; the rest is reserve.
const N_UNDISTORT_STEPS: usize = 8;
/// Damped steps of the fallback, and how often one may be halved: the image of a direction almost
/// across the axis lies tens of thousands of focal lengths off, where the first step leads.
const N_DAMPED_STEPS: usize = 40;
const N_HALVINGS: usize = 24;
/// Least determinant of the Jacobian, or slope of the fisheye angle: below it the picture folds.
const LEAST_SLOPE: f32 = 1e-3;
/// Points between the centre and the asked one at which the polynomial must rise.
const N_FOLD_CHECKS: u32 = 16;
/// How far off an undone distortion may be, focal lengths: 0.01 px of a 1000 px focal length.
const TOLERANCE: f32 = 1e-5;

/// How a lens maps the angle off its axis to the distance from the principal point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LensModel {
    /// By its tangent, then Brown and Conrady's polynomial.
    #[default]
    Perspective,
    /// By the angle itself, then a polynomial in it (Kannala and Brandt; `OpenCV`'s fisheye).
    Fisheye,
}

/// Lens distortion, in `OpenCV`'s image axes (x right, y down, unit focal length).
///
/// Perspective, with `r2 = x^2 + y^2`, `radial = 1 + k1 r2 + k2 r2^2 + k3 r2^3 + k4 r2^4`:
/// `x' = x radial + 2 p1 x y + p2 (r2 + 2 x^2)`, `y' = y radial + p1 (r2 + 2 y^2) + 2 p2 x y`.
/// `k4` is the coefficient of `r^8`, as nerfstudio means it; it is not the rational denominator
/// that `OpenCV`'s own eight-parameter model calls k4.
///
/// Fisheye, with the angle `t` off the axis in radians:
/// `r' = t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8)`; `p1` and `p2` are not used.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distortion {
    /// What the coefficients mean.
    pub model: LensModel,
    /// Radial, `r^2`.
    pub k1: f32,
    /// Radial, `r^4`.
    pub k2: f32,
    /// Radial, `r^6`.
    pub k3: f32,
    /// Radial, `r^8`.
    pub k4: f32,
    /// Tangential.
    pub p1: f32,
    /// Tangential.
    pub p2: f32,
}

impl Distortion {
    /// Whether the lens is an ideal pinhole.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// The image point of a direction (any length), or `None` where the lens does not see it.
    pub(super) fn image_of(&self, direction: Vec3) -> Option<Vec2> {
        let Vec3 { x, y, z } = direction;
        match self.model {
            LensModel::Perspective => {
                // Written so that NaN is refused as well.
                if !(z > 0.0 && direction.is_finite()) {
                    return None;
                }
                let p = Vec2::new(x, y) / z;
                if self.is_none() {
                    return Some(p);
                }
                let (distorted, jacobian) = self.distort(p);
                let sees = jacobian.determinant() >= LEAST_SLOPE && self.rises_to(p.length());
                sees.then_some(distorted)
            }
            LensModel::Fisheye => {
                let side = Vec2::new(x, y);
                let angle = side.length().atan2(z);
                if !direction.is_finite() || direction == Vec3::ZERO || !self.rises_to(angle) {
                    return None;
                }
                Some(side.normalize_or_zero() * self.fisheye_radius(angle).0)
            }
        }
    }

    /// The direction (any length) that the lens shows at an image point; at the edge of what it
    /// shows for points beyond.
    pub(super) fn direction_of(&self, p: Vec2) -> Vec3 {
        match self.model {
            LensModel::Perspective if self.is_none() => p.extend(1.0),
            LensModel::Perspective => self.undistort(p).extend(1.0),
            LensModel::Fisheye => {
                let (sin, cos) = self.fisheye_angle(p.length()).sin_cos();
                (p.normalize_or_zero() * sin).extend(cos)
            }
        }
    }

    /// Whether the radial polynomial rises all the way from the centre to `end`: a radius
    /// (perspective) or an angle (fisheye).
    fn rises_to(&self, end: f32) -> bool {
        (1..=N_FOLD_CHECKS).all(|i| {
            let at = end * i as f32 / N_FOLD_CHECKS as f32;
            match self.model {
                LensModel::Perspective => self.radial_slope(at) >= LEAST_SLOPE,
                LensModel::Fisheye => self.fisheye_radius(at).1 >= LEAST_SLOPE,
            }
        })
    }

    /// `d (r radial) / d r`.
    fn radial_slope(&self, r: f32) -> f32 {
        let r2 = r * r;
        1.0 + r2
            * (3.0 * self.k1 + r2 * (5.0 * self.k2 + r2 * (7.0 * self.k3 + r2 * 9.0 * self.k4)))
    }

    /// The distance from the principal point at an angle off the axis, and its derivative.
    fn fisheye_radius(&self, angle: f32) -> (f32, f32) {
        let t2 = angle * angle;
        let radius =
            angle * (1.0 + t2 * (self.k1 + t2 * (self.k2 + t2 * (self.k3 + t2 * self.k4))));
        (radius, self.radial_slope(angle))
    }

    /// The angle off the axis that appears at `radius`: Newton's method, else bisection.
    fn fisheye_angle(&self, radius: f32) -> f32 {
        let mut angle = radius;
        for _ in 0..N_UNDISTORT_STEPS {
            let (image, slope) = self.fisheye_radius(angle);
            angle -= (image - radius) / slope.max(LEAST_SLOPE);
        }
        let residual = (self.fisheye_radius(angle).0 - radius).abs();
        let in_range = (0.0..=std::f32::consts::PI).contains(&angle);
        if in_range && residual <= TOLERANCE * (1.0 + radius) && self.rises_to(angle) {
            return angle;
        }
        let step = std::f32::consts::PI / 64.0;
        let n_rising = (1..=64_u32)
            .take_while(|i| self.radial_slope(*i as f32 * step) >= LEAST_SLOPE)
            .count();
        let (mut low, mut high) = (0.0, n_rising as f32 * step);
        for _ in 0..24 {
            let middle = 0.5 * (low + high);
            if self.fisheye_radius(middle).0 < radius {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    }

    /// The distorted image point of the ideal one `p`, and the Jacobian of that map.
    fn distort(&self, p: Vec2) -> (Vec2, Mat2) {
        let Self {
            model: _,
            k1,
            k2,
            k3,
            k4,
            p1,
            p2,
        } = *self;
        let (x, y) = (p.x, p.y);
        let r2 = p.length_squared();
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)));
        // d radial / d r2
        let slope = k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3 + r2 * 4.0 * k4));
        let distorted = Vec2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let off_diagonal = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        let jacobian = Mat2::from_cols(
            Vec2::new(
                radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
                off_diagonal,
            ),
            Vec2::new(
                off_diagonal,
                radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
            ),
        );
        (distorted, jacobian)
    }

    /// The ideal image point that the lens moves to `distorted`: Newton's method at fixed cost,
    /// checked, and where it failed damped steps from the centre.
    fn undistort(&self, distorted: Vec2) -> Vec2 {
        let mut p = distorted;
        for _ in 0..N_UNDISTORT_STEPS {
            let (image, jacobian) = self.distort(p);
            // Where the lens folds the picture over itself the step would run away: stop there.
            if jacobian.determinant() < LEAST_SLOPE {
                break;
            }
            p -= jacobian.inverse() * (image - distorted);
        }
        let residual = (self.distort(p).0 - distorted).length();
        // Written so that NaN fails.
        if residual <= TOLERANCE * (1.0 + distorted.length()) && self.rises_to(p.length()) {
            p
        } else {
            self.undistort_from_centre(distorted)
        }
    }

    /// Newton's method that starts at the centre, where every lens is regular, and takes no step
    /// over a fold or away from the goal: ends at the edge of the picture where there is no answer.
    fn undistort_from_centre(&self, distorted: Vec2) -> Vec2 {
        let mut p = Vec2::ZERO;
        let (mut image, mut jacobian) = self.distort(p);
        for _ in 0..N_DAMPED_STEPS {
            let mut step = jacobian.inverse() * (distorted - image);
            let residual = (distorted - image).length_squared();
            let mut moved = false;
            for _ in 0..N_HALVINGS {
                let next = p + step;
                let (next_image, next_jacobian) = self.distort(next);
                let regular =
                    next_jacobian.determinant() >= LEAST_SLOPE && self.rises_to(next.length());
                if regular && (distorted - next_image).length_squared() < residual {
                    (p, image, jacobian) = (next, next_image, next_jacobian);
                    moved = true;
                    break;
                }
                step *= 0.5;
            }
            if !moved {
                break;
            }
        }
        p
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn fisheye() -> Distortion {
        Distortion {
            model: LensModel::Fisheye,
            k1: 0.03,
            k2: -0.012,
            k3: 0.004,
            k4: -0.0007,
            ..Distortion::default()
        }
    }

    /// A wide action camera's lens, on which plain Newton steps leave the picture.
    fn barrel() -> Distortion {
        Distortion {
            k1: -0.28,
            k2: 0.07,
            p1: 0.001,
            p2: -0.002,
            ..Distortion::default()
        }
    }

    proptest! {
        #[test]
        fn a_direction_s_image_leads_back_to_it(
            angle in 0.0_f32..1.5, turn in 0.0_f32..std::f32::consts::TAU
        ) {
            let (sin, cos) = angle.sin_cos();
            let direction = Vec3::new(sin * turn.cos(), sin * turn.sin(), cos);
            for lens in [fisheye(), barrel()] {
                let Some(p) = lens.image_of(direction) else { continue };
                let back = lens.direction_of(p).normalize_or_zero();
                prop_assert!((back - direction).length() < 2e-3, "{lens:?}: {back}, not {direction}");
            }
        }

        #[test]
        fn any_lens_gives_finite_directions(
            k in prop::array::uniform4(-10.0_f32..10.0), p in prop::array::uniform2(-1.0_f32..1.0),
            x in -4.0_f32..4.0, y in -4.0_f32..4.0
        ) {
            for model in [LensModel::Perspective, LensModel::Fisheye] {
                let lens = Distortion { model, k1: k[0], k2: k[1], k3: k[2], k4: k[3], p1: p[0], p2: p[1] };
                let direction = lens.direction_of(Vec2::new(x, y));
                prop_assert!(direction.is_finite() && direction.length() > 0.0, "{lens:?}: {direction}");
            }
        }
    }

    #[test]
    fn an_image_far_out_leads_back_to_its_direction() {
        let (sin, cos) = 1.498_266_f32.sin_cos();
        let direction = Vec3::new(sin, 0.0, cos);
        let p = barrel()
            .image_of(direction)
            .expect("this lens does not fold");
        assert!(p.length() > 3e4, "{p}");
        assert!((barrel().direction_of(p).normalize_or_zero() - direction).length() < 2e-3);
    }

    #[test]
    fn an_equidistant_lens_sees_more_than_half_the_sphere() {
        let lens = Distortion {
            model: LensModel::Fisheye,
            ..Distortion::default()
        };
        let behind = Vec3::new(1.0, 0.0, -1.0);
        let p = lens.image_of(behind).unwrap();
        assert!((p.x - 0.75 * std::f32::consts::PI).abs() < 1e-6, "{p}");
        let back = lens.direction_of(p).normalize_or_zero();
        assert!(
            (back - behind.normalize_or_zero()).length() < 1e-5,
            "{back}"
        );
        assert!(
            !lens.is_none(),
            "a fisheye without coefficients is no pinhole"
        );
        assert_eq!(
            barrel().image_of(behind),
            None,
            "a perspective lens does not see it"
        );
    }

    #[test]
    fn nothing_beyond_the_fold_is_seen() {
        // r (1 - 0.3 r^2) falls beyond r = 1.05; beyond 1.83 it is negative and regular again.
        let lens = Distortion {
            k1: -0.3,
            ..Distortion::default()
        };
        assert!(lens.image_of(Vec3::new(1.0, 0.0, 1.0)).is_some(), "inside");
        for r in [1.1, 1.5, 2.0, 5.0] {
            assert_eq!(lens.image_of(Vec3::new(r, 0.0, 1.0)), None, "{r}");
        }
        // A picture corner that no direction reaches shows the edge, not another branch.
        let edge = lens.direction_of(Vec2::new(0.9, 0.0));
        assert!(
            edge.x > 0.95 && edge.x < 1.06 && edge.y.abs() < 1e-3,
            "{edge}"
        );
    }
}
