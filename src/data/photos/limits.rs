//! Pictures that are refused: empty, too large, not finite.

use std::path::Path;

use crate::data::DataError;

/// The longest side accepted.
const MAX_SIDE: u32 = 16384;

/// The most pixels accepted.
const MAX_PIXELS: u64 = 128 << 20;

/// Refuses pictures that are empty or too large, before their pixels are decoded.
pub(super) fn check_size(path: &Path, width: u64, height: u64) -> Result<(), DataError> {
    let too_large = width > u64::from(MAX_SIDE)
        || height > u64::from(MAX_SIDE)
        || width.saturating_mul(height) > MAX_PIXELS;
    if too_large || width == 0 || height == 0 {
        return Err(DataError::unusable(
            path,
            format!(
                "picture of {width} x {height} pixels; sides of 1 to {MAX_SIDE} and at most \
                 {} megapixels are supported",
                MAX_PIXELS >> 20
            ),
        ));
    }
    Ok(())
}

/// Refuses NaN and infinite pixels, naming the first.
pub(in crate::data) fn check_finite(
    path: &Path,
    width: u32,
    pixels: &[[f32; 3]],
) -> Result<(), DataError> {
    match pixels.iter().position(|p| p.iter().any(|c| !c.is_finite())) {
        None => Ok(()),
        Some(i) => {
            let (x, y) = (i % width as usize, i / width as usize);
            Err(DataError::unusable(
                path,
                format!("pixel ({x}, {y}) is not finite: {:?}", pixels[i]),
            ))
        }
    }
}
