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
    /// Where the environment stands.
    pub transform: EnvironmentTransform,
    /// Which environment: index into [`super::app_state::AppState::environments`]; none is the capture's own.
    pub environment: Option<usize>,
}

/// The same for undo and for files: the environment by its file, as an index would mean another once the list changes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StoredLook {
    /// The chosen environment; none is the capture's own.
    pub environment: Option<PathBuf>,
    /// Parts of the object that are edited on their own.
    pub regions: Regions,
    /// The material's edits.
    pub material: MaterialEdit,
    /// Where the environment stands.
    pub transform: EnvironmentTransform,
}
