//! Neural illumination fields on the CPU (filled in as modules land).
pub mod color;
pub mod geometry;
pub mod data;
pub mod neif;
pub mod render;
pub mod train;
#[cfg(feature = "gui")]
pub mod app;
