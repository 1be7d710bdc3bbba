//! What leaves training: the model as it stood at one step.

use std::sync::Arc;

use crate::neif::{Environment, ObjectModel};
use crate::render::Scene;

/// Object and environment at one step, immutable.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Steps taken.
    pub step: u64,
    /// The object, unless the capture has none.
    pub object: Option<Arc<ObjectModel>>,
    /// The environment.
    pub environment: Arc<Environment>,
}

impl Snapshot {
    /// The unedited scene.
    pub fn scene(&self) -> Scene {
        Scene::new(self.object.clone(), Arc::clone(&self.environment))
    }
}
