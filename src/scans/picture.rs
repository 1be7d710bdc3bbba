//! What a scan looks like from somewhere.

/// A picture of a scan, row-major from the top left.
#[derive(Clone, Debug)]
pub struct ScanPicture {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Colour as the scan was trained to show it, on black where nothing is: sRGB-encoded, `[height * width]`, at least 0.
    pub srgb: Vec<[f32; 3]>,
    /// How much of a pixel is covered, `[height * width]`, 0 to 1.
    pub opacity: Vec<f32>,
    /// Mean distance along the ray of what covers a pixel, scene units, `[height * width]`; infinite where nothing does.
    pub distance: Vec<f32>,
}
