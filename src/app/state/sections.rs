//! The parts of the side panels, which can be folded.

use serde::{Deserialize, Serialize};

/// A part of a side panel under a heading that folds it, from the left top to the right bottom.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Serialize,
    Deserialize,
    strum::IntoStaticStr,
    strum::VariantArray,
)]
#[serde(rename_all = "lowercase")]
pub enum Section {
    /// Controls and figures of training.
    Training,
    /// What the shortcuts leave out.
    #[strum(serialize = "What skipping saves now")]
    Skips,
    /// The density on a plane.
    #[strum(serialize = "Density slice")]
    Slice,
    /// Loss and held-out PSNR.
    Curves,
    /// The photos, each a camera to stand at.
    Photos,
    /// Roughness, tint, diffuse.
    Material,
    /// What is known of the picked point.
    #[strum(serialize = "Picked point")]
    Point,
    /// Which environment, and where it stands.
    Environment,
    /// How the scene is shown.
    Picture,
}
