//! An environment that is an equirectangular picture of linear radiance, such as an HDRI: infinitely far, or on a floor
//! ([`dome`]).
//!
//! The picture is convolved once with lobes of growing width ([`pyramid`]), so that a cone of any width is a few
//! look-ups ([`light`]); [`import`] makes one from a picture file.

mod dome;
pub mod equirect;
pub mod import;
pub mod light;
mod pyramid;

pub use equirect::Equirect;
pub use import::{
    ImportOptions, Imported, import_environment, is_environment_file, is_panorama_file,
};
pub use light::{DistantConfig, DistantLight};
