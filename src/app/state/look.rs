//! Looks: everything that a person edits about the picture, and the same as it is stored.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::neif::{EnvironmentTransform, MaterialEdit, Regions};

/// Everything a person edits about the picture: one value, so that edits can be compared and kept.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Look {
    /// The material of the whole object.
    pub edit: MaterialEdit,
    /// Parts of it that are edited on their own.
    pub regions: Regions,
    /// Where the surroundings stand.
    pub transform: EnvironmentTransform,
    /// Which surroundings: index into [`super::app_state::AppState::environments`]; none is the capture's own.
    pub environment: Option<usize>,
}

/// The same for undo and for files: surroundings by their file, as an index would mean others once the list changes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StoredLook {
    /// The chosen surroundings; none is the capture's own.
    pub environment: Option<PathBuf>,
    /// Parts of the object that are edited on their own.
    pub regions: Regions,
    /// The material's edits.
    pub material: MaterialEdit,
    /// Where the surroundings stand.
    pub transform: EnvironmentTransform,
}
