//! A picture for tests.

/// The `k`-th of the given size, `[height][width]` of sRGB: made of integers only, so that `numpy` gets exactly the same
/// values.
pub(super) fn picture(k: usize, width: usize, height: usize) -> Vec<[f32; 3]> {
    let code = |x: usize, y: usize, c: usize| {
        let pattern = x * (7 + c) + y * (13 - 2 * c) + (x * y * (c + 1)) % 11;
        (pattern + k * ((x * 3 + y * 5 + c) % 9)) % 256
    };
    (0..width * height)
        .map(|i| std::array::from_fn(|c| code(i % width, i / width, c) as f32 / 255.0))
        .collect()
}
