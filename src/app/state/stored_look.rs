//! A look that names its surroundings by their file: an index would mean others once the list changes.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::app_state::{AppState, Look};
use super::command::{Effect, load_environment};
use crate::neif::{EnvironmentTransform, MaterialEdit, Regions};

/// The same as [`Look`], for undo and for files.
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

impl StoredLook {
    /// A look of this state.
    pub fn of(state: &AppState, look: &Look) -> Self {
        let entry = look.environment.and_then(|i| state.environments.get(i));
        Self {
            environment: entry.map(|entry| entry.path.clone()),
            regions: look.regions,
            material: look.edit,
            transform: look.transform,
        }
    }

    /// The look, its surroundings put on the list and read where they are not.
    pub fn to_look(&self, state: &mut AppState, effects: &mut Vec<Effect>) -> Look {
        let path = self.environment.as_ref();
        let environment = path.map(|path| state.environment_of_file(path));
        if let Some(index) = environment {
            load_environment(state, index, effects);
        }
        Look {
            edit: self.material,
            regions: self.regions,
            transform: self.transform,
            environment,
        }
    }
}
