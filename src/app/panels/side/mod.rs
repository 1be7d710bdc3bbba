//! The panels beside the viewport.

pub mod cameras;
pub mod environment;
pub mod export;
pub mod gallery;
pub mod inspect;
pub mod log;
pub mod material;
pub mod picture;
pub mod plots;
pub mod scope;
pub mod skips;
pub mod slice;
pub mod training;
