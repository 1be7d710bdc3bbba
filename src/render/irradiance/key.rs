//! What a diffuse light depends on, so that it is made once.

use std::sync::Arc;

use glam::Vec3;

use crate::neif::{Environment, EnvironmentTransform, ObjectModel};
use crate::render::Scene;
use crate::render::irradiance::{DiffuseLight, Resolution};

/// What a [`DiffuseLight`] depends on; an `Arc` stands for its address.
#[derive(Clone, Debug)]
pub struct LightKey {
    pub(super) object: Arc<ObjectModel>,
    pub(super) trained_in: Arc<Environment>,
    pub(super) environment: Arc<Environment>,
    /// Without the gain: the light is proportional to that.
    pub(super) transform: EnvironmentTransform,
}

impl LightKey {
    /// What the scene's light depends on; `None` where surfaces are shown as they were trained, but for a gain, and the
    /// light itself is not shown.
    pub fn of(scene: &Scene, is_shown: bool) -> Option<Self> {
        let key = Self::with(scene, scene.transform)?;
        let is_needed = is_shown || scene.changes_roughness() || !key.is_captured();
        is_needed.then_some(key)
    }

    /// Of the light that the scene's object was trained in; `None` without an object, or where the diffuse part is baked.
    pub(super) fn trained(scene: &Scene) -> Option<Self> {
        Self::with(scene, EnvironmentTransform::default())
    }

    fn with(scene: &Scene, transform: EnvironmentTransform) -> Option<Self> {
        Some(Self {
            object: Arc::clone(scene.object.as_ref()?),
            trained_in: Arc::clone(scene.trained_in.as_ref()?),
            environment: Arc::clone(&scene.environment),
            transform: EnvironmentTransform {
                exposure_ev: 0.0,
                white_balance: Vec3::ONE,
                ..transform
            },
        })
    }

    /// Whether it is the environment that the object was trained in, where it was.
    pub(super) fn is_captured(&self) -> bool {
        Arc::ptr_eq(&self.trained_in, &self.environment)
            && self.transform == EnvironmentTransform::default()
    }

    pub(super) fn is_same(&self, other: &Self) -> bool {
        self.is_same_model(other)
            && Arc::ptr_eq(&self.environment, &other.environment)
            && self.transform == other.transform
    }

    pub(super) fn is_same_model(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.object.tracer, &other.object.tracer)
            && Arc::ptr_eq(&self.object.material, &other.object.material)
            && Arc::ptr_eq(&self.trained_in, &other.trained_in)
    }
}

/// A diffuse light with what it was made for.
#[derive(Clone, Debug)]
pub struct KeyedLight {
    pub(super) key: LightKey,
    pub(super) resolution: Resolution,
    /// The light.
    pub light: Arc<DiffuseLight>,
}

impl KeyedLight {
    /// Whether it is the light of `key` at `resolution`.
    pub fn is_for(&self, key: &LightKey, resolution: Resolution) -> bool {
        self.resolution == resolution && self.key.is_same(key)
    }
}
