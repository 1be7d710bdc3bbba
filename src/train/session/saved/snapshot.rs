//! What leaves training: the model as it stood at one step.

use std::sync::Arc;

use crate::data::View;
use crate::neif::{Environment, ObjectModel};
use crate::render::Scene;
use crate::train::photos::photo_exposures::PhotoExposures;

/// Object and environment at one step, immutable.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Steps taken.
    pub step: u64,
    /// The object, unless the capture has none.
    pub object: Option<Arc<ObjectModel>>,
    /// The environment.
    pub environment: Arc<Environment>,
    /// The exposures of the photos, where each has its own.
    pub exposures: Option<Arc<PhotoExposures>>,
}

impl Snapshot {
    /// The unedited scene.
    pub fn scene(&self) -> Scene {
        Scene::new(self.object.clone(), Arc::clone(&self.environment))
    }

    /// `scene` as bright as the view's photo.
    pub fn exposed_like(&self, view: &View, scene: Scene) -> Scene {
        match &self.exposures {
            Some(exposures) => scene.exposed(exposures.gain(view, &self.scene())),
            None => scene,
        }
    }
}
