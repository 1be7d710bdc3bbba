//! How the formats encode colours, opacities and rotations.

use glam::Vec3;

/// The constant harmonic.
const Y_00: f32 = 0.282_094_79;
/// Coefficients of a channel without the constant one, by degree.
pub(super) const N_REST: [usize; 5] = [0, 3, 8, 15, 24];
/// Highest degree that is kept of a file.
pub(super) const MAX_DEGREE: usize = 3;
/// A compressed file is taken for a trap where it unpacks to more than this many times its length, and this many bytes.
const MAX_EXPANSION: u64 = 100;
const MAX_FREE: u64 = 1 << 24;

/// The constant coefficient of a colour that is the same in all directions, sRGB.
pub(super) fn constant_of(srgb: Vec3) -> [f32; 3] {
    ((srgb - 0.5) / Y_00).to_array()
}

/// The degree of so many coefficients of all channels without the constant ones.
pub(super) fn degree_of(n_rest: usize) -> Option<usize> {
    N_REST.iter().position(|n| n * 3 == n_rest)
}

/// Opacity by its logit.
pub(super) fn sigmoid(logit: f32) -> f32 {
    1.0 / (1.0 + (-logit).exp())
}

/// A unit quaternion's four components by the index of the largest one, which is positive, and the others in order.
pub(super) fn smallest_three(largest: usize, others: [f32; 3]) -> [f32; 4] {
    let [a, b, c] = others;
    // Rounding can leave the others longer than one.
    let rest = (1.0 - (a * a + b * b + c * c)).max(0.0).sqrt();
    match largest {
        0 => [rest, a, b, c],
        1 => [a, rest, b, c],
        2 => [a, b, rest, c],
        _ => [a, b, c, rest],
    }
}

/// Refuses `n_packed` bytes that claim to unpack to so many more that they would only fill the memory.
pub(super) fn check_expansion(n_packed: u64, n_unpacked: u64) -> Result<(), String> {
    if n_unpacked > n_packed.saturating_mul(MAX_EXPANSION).max(MAX_FREE) {
        return Err(format!(
            "{n_packed} bytes cannot hold the {n_unpacked} that the header tells"
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_component_completes_a_unit_quaternion() {
        for largest in 0..4 {
            let whole = smallest_three(largest, [0.1, -0.2, 0.3]);
            let length: f32 = whole.iter().map(|v| v * v).sum();
            assert!((length - 1.0).abs() < 1e-6, "{whole:?}");
            let mut others = whole.to_vec();
            assert!(others.remove(largest) > 0.9, "{whole:?}");
            assert_eq!(others, [0.1, -0.2, 0.3]);
        }
        assert_eq!(smallest_three(3, [0.6, 0.6, 0.6])[3], 0.0);
    }

    #[test]
    fn only_enormous_claims_are_refused() {
        assert!(check_expansion(10, 1 << 20).is_ok());
        assert!(check_expansion(1 << 30, 1 << 34).is_ok());
        assert!(check_expansion(1 << 20, 1 << 30).is_err());
        assert!(check_expansion(u64::MAX, u64::MAX).is_ok());
    }
}
