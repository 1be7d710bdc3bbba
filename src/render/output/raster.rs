//! A picture: its size and its pixels.

/// An image, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `[height * width]` colours; which space, the maker says.
    pub pixels: Vec<[f32; 3]>,
}
