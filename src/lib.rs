//! Neural illumination fields on the CPU (filled in as modules land).
#[cfg(feature = "gui")]
pub mod app;
pub mod color;
pub mod data;
pub mod geometry;
pub mod neif;
pub mod render;
pub mod scans;
pub mod train;
