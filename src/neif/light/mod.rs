//! From light to what a pixel shows.
//!
//! `lobe` is how a roughness reflects, `lobe_cones` the same as several cones; `light_path` follows the reflection from surface to
//! surface, `shading` is the pixel equation, `display` the way to the screen. `environment` is the lamp with its file, `estimated_lamps` what
//! photos of it do not show.

pub mod display;
pub mod environment;
pub mod estimated_lamps;
pub mod exposure_match;
pub mod light_path;
pub mod lobe;
pub mod lobe_cones;
pub mod shading;
