//! More cones for the pixels whose split lobes' cones disagree.
//!
//! A lobe is split into as many cones as a usual surface needs. Where one of them meets a lamp and its neighbours do not,
//! their mean is as wrong as their number is small, and says so by its standard error: those few pixels are shaded again
//! with as many cones as the error asks for.

/// Standard error of a pixel that is let be, in display values. The cones' true error is about half of it, as they are
/// spread evenly over the lobe and not by chance.
const BEARABLE: f32 = 0.008;
/// How many times as many cones uncertain pixels get, and the standard error from which they do.
pub(super) const STEPS: [(u32, f32); 4] = [
    (2, BEARABLE),
    (4, 1.7 * BEARABLE),
    (8, 2.8 * BEARABLE),
    (16, 5.0 * BEARABLE),
];

/// How many times as many cones a pixel of this standard error gets; 1 where it is let be.
pub(in crate::render) fn times(std_error: f32) -> u32 {
    let passed = STEPS.iter().rev().find(|(_, least)| std_error > *least);
    passed.map_or(1, |(times, _)| *times)
}

/// Whether pixels of these standard errors are worth [`super::shade::shade_uncertain`].
pub(in crate::render) fn is_any_uncertain(std_errors: &[f32]) -> bool {
    std_errors.iter().any(|&error| times(error) > 1)
}
