//! The field: what is learned, how it is evaluated forward and backward, and how it is edited and stored.

pub mod distant;
pub mod field;
pub mod kernels;
pub mod light;
pub mod neilf;
pub mod networks;
pub mod paper;
#[cfg(test)]
mod properties;
pub mod storage;
pub mod surface;
#[cfg(test)]
pub(crate) mod test_gradients;

pub use self::light::environment::Environment;
pub use self::surface::edit::{
    EnvironmentFromWorld, EnvironmentTransform, MaterialEdit, RoughnessEdit,
};
pub use self::surface::edited_surface::EditedSurfaces;
pub use self::surface::object::{Material, ObjectModel, SurfaceField};
pub use self::surface::region::{Extent, Likeness, Region, Regions};
pub use storage::Storage;

use std::path::PathBuf;

use crate::data::DataError;
use crate::data::files::tensor_file::TensorFileError;

/// What is wrong with a stored field.
#[derive(Debug, thiserror::Error)]
pub enum NeifError {
    /// The file cannot be read or lacks a tensor.
    #[error(transparent)]
    File(#[from] TensorFileError),
    /// A picture cannot be read.
    #[error(transparent)]
    Picture(#[from] DataError),
    /// A file is no picture of all directions.
    #[error("{file}: {what}: not an equirectangular panorama (.hdr, .exr, .png or .jpg)")]
    NotAPanorama {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A metadata entry is missing or unreadable.
    #[error("{file}: metadata field `{field}` {what}")]
    Metadata {
        /// The file.
        file: PathBuf,
        /// The field.
        field: &'static str,
        /// What is wrong.
        what: String,
    },
    /// The number of stored values does not fit the stored shape.
    #[error("{file}: tensor `{tensor}` has {found} values, which do not fit its configuration")]
    Shape {
        /// The file.
        file: PathBuf,
        /// The tensor.
        tensor: &'static str,
        /// How many values it has.
        found: usize,
    },
    /// A value is NaN or infinite.
    #[error("{file}: tensor `{tensor}` holds a value that is not finite")]
    NotFinite {
        /// The file.
        file: PathBuf,
        /// The tensor.
        tensor: &'static str,
    },
}
