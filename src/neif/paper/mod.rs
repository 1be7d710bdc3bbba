//! The model as the paper prints it, with its misprints corrected: the slow reference of the fast one.
//!
//! A Mip-NeRF network (8 x 256, coarse and fine pass with the same weights) over the paper's integrated lobe encoding,
//! and a surface network (8 x 512). What the paper leaves open follows the code it builds on, mip-NeRF
//! (arXiv:2103.13415) and IDR (arXiv:2003.09852); each such choice is named where it is made. The pixel equation
//! (with Schlick's Fresnel, where Eq. 7 has none) and the contraction of far space are those of the fast model.

pub mod encoding;
pub mod field;
pub mod gaussian;
pub mod material;
pub mod network;
pub mod ray_pass;
pub mod sampling;

pub use field::{PaperField, PaperFieldConfig};
pub use material::{PaperMaterial, PaperMaterialConfig};
