//! From world coordinates to the unit cube of the grids: an inner box as it is, all space outside folded in.
//!
//! The L∞ form of the contraction of mip-NeRF 360 (Eq. 10 of arXiv:2111.12077): rooms fill the cube.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::neif::kernels::math;

/// The inner box of a field: a cube in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldFrame {
    /// Centre, world coordinates.
    pub center: Vec3,
    /// Half the side, world units; positive.
    pub half_side: f32,
}

impl FieldFrame {
    /// A world point in field coordinates: the inner box is `[-1, 1]³`.
    pub fn field_from_world(&self, p_world: Vec3) -> Vec3 {
        (p_world - self.center) / self.half_side
    }

    /// Undoes [`Self::field_from_world`].
    pub fn world_from_field(&self, p_field: Vec3) -> Vec3 {
        p_field * self.half_side + self.center
    }
}

/// A point in field coordinates contracted into `(-2, 2)³` (up to rounding), and the local scale of lengths there.
///
/// `c(x) = x` inside, `(2 - 1/m) x/m` with `m = max |x_i|` outside; scale `(2m - 1)^(2/3) / m²` (the cube root of the
/// Jacobian's determinant, the isotropic scale of Zip-NeRF).
#[inline(always)]
pub fn contract(x: [f32; 3]) -> ([f32; 3], f32) {
    let m = x[0].abs().max(x[1].abs()).max(x[2].abs());
    // `m` below 1 would divide by small numbers: both branches are computed, so clamp first.
    let outer = m.max(1.0);
    let inverse = 1.0 / outer;
    let scale = (2.0 - inverse) * inverse;
    // Exact: ((2 - 1/m)²/m² · 1/m²)^(1/3).
    let root = math::cbrt(scale * inverse);
    let isotropic = if m > 1.0 { root * root } else { 1.0 };
    (x.map(|v| v * scale), isotropic)
}

/// A contracted point in the unit cube `[0, 1]³`.
#[inline(always)]
pub fn unit_cube(contracted: [f32; 3]) -> [f32; 3] {
    contracted.map(|v| v * 0.25 + 0.5)
}

/// Undoes [`contract`] for a point inside `(-2, 2)³`.
pub fn expand(c: [f32; 3]) -> [f32; 3] {
    let m = c[0].abs().max(c[1].abs()).max(c[2].abs());
    if m <= 1.0 {
        return c;
    }
    // At the rim (m = 2) the point is at infinity.
    let outer = 1.0 / (2.0 - m.min(1.999));
    c.map(|v| v / m * outer)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn expand_undoes_contract() {
        for x in [[0.1, -0.4, 0.9], [3.0, -1.0, 0.5], [0.2, 0.2, -7.0]] {
            let back = expand(contract(x).0);
            for axis in 0..3 {
                assert!(
                    (back[axis] - x[axis]).abs() < 1e-4 * x[axis].abs().max(1.0),
                    "{x:?} came back as {back:?}"
                );
            }
        }
    }

    #[test]
    fn scale_is_the_cube_root_of_the_volume_change() {
        let x = [2.5_f32, 0.7, -1.2];
        let h = 1e-3;
        let column = |axis: usize| {
            let (mut a, mut b) = (x, x);
            a[axis] += h;
            b[axis] -= h;
            Vec3::from(contract(a).0) / (2.0 * h) - Vec3::from(contract(b).0) / (2.0 * h)
        };
        let volume = column(0).cross(column(1)).dot(column(2)).abs();
        assert!(
            (volume.cbrt() - contract(x).1).abs() < 1e-2 * volume.cbrt(),
            "{} against {}",
            volume.cbrt(),
            contract(x).1
        );
    }

    #[test]
    fn any_point_lands_in_the_cube() {
        for x in [[0.0, 0.0, 0.0], [1e30, -1e30, 3.0], [f32::MAX, 1.0, 1.0]] {
            let u = unit_cube(contract(x).0);
            assert!(u.iter().all(|v| (0.0..=1.0).contains(v)), "{x:?} -> {u:?}");
        }
    }
}
