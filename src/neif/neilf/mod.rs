//! The baselines `NeILF` and `NeILF*` of the paper's Table 1: an incident light field for each surface point.
//!
//! `NeILF` (Yao et al. 2022, arXiv:2203.07182) learns `L(x, w)`, the light that reaches the surface point `x` from the
//! direction `w`, with no notion of distance: nothing ties the light of one point to that of another but the smoothness
//! of the network, and the photos' background says nothing about it. A pixel is a sum over directions that are spread
//! over the hemisphere. `NeILF*` has the same light and the paper's reflectance. Both are built from the parts of the
//! fast model (grids, small networks), so that equal time is a fair measure.

pub mod brdf;
pub mod light;
pub mod model;

pub use brdf::Brdf;
pub use light::{IncidentLight, IncidentLightConfig};
pub use model::NeilfModel;
