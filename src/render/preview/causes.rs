//! What the parts of a preview picture depend on: a part is good as long as its causes stay.

use std::sync::Arc;

use super::request::{PreviewScene, same};
use crate::geometry::{Camera, SurfaceTracer};
use crate::neif::{Environment, EnvironmentTransform, MaterialEdit, Region, Regions, SurfaceField};
use crate::render::background::Background;
use crate::render::ground::Ground;
use crate::render::irradiance::DiffuseLight;
use crate::render::scene::Layer;

/// What the parts of a picture depend on; an `Arc` stands for its address.
#[derive(Clone, Debug)]
pub(in crate::render) struct Causes {
    pub(in crate::render) camera: Camera,
    tracer: Option<Arc<SurfaceTracer>>,
    environment: Arc<Environment>,
    transform: EnvironmentTransform,
    ground: Option<Arc<Ground>>,
    is_blurred: bool,
    marks_unseen: bool,
    trained_in: Option<Arc<Environment>>,
    diffuse_light: Option<Arc<DiffuseLight>>,
    material: Option<Arc<SurfaceField>>,
    edit: MaterialEdit,
    /// Without those that change nothing.
    regions: Regions,
    layer: Layer,
    /// Without its edit, which does not matter to where it lies.
    highlight: Option<Region>,
}

impl Causes {
    pub(in crate::render) fn of(request: &PreviewScene, camera: Camera) -> Self {
        let scene = &request.scene;
        Self {
            camera,
            tracer: scene
                .object
                .as_ref()
                .map(|object| Arc::clone(&object.tracer)),
            environment: Arc::clone(&scene.environment),
            transform: scene.transform,
            ground: scene.ground.clone(),
            is_blurred: scene.background == Background::Blurred,
            marks_unseen: scene.marks_unseen,
            trained_in: scene.trained_in.clone(),
            diffuse_light: scene
                .diffuse_light
                .as_ref()
                .map(|lit| Arc::clone(&lit.light)),
            material: scene
                .object
                .as_ref()
                .map(|object| Arc::clone(&object.material)),
            edit: scene.edit,
            regions: scene.regions.effective(),
            layer: request.layer,
            highlight: request.highlight.map(|region| Region {
                edit: MaterialEdit::default(),
                ..region
            }),
        }
    }

    pub(super) fn same_geometry(&self, other: &Self) -> bool {
        self.camera == other.camera && same(self.tracer.as_ref(), other.tracer.as_ref())
    }

    pub(in crate::render) fn same_background(&self, other: &Self) -> bool {
        self.is_blurred == other.is_blurred && self.same_light(other)
    }

    fn same_light(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.environment, &other.environment)
            && self.marks_unseen == other.marks_unseen
            && self.transform == other.transform
            && same(self.ground.as_ref(), other.ground.as_ref())
    }

    pub(super) fn same_highlight(&self, other: &Self) -> bool {
        let needs_material = self.highlight.is_some();
        self.highlight == other.highlight
            && (!needs_material || same(self.material.as_ref(), other.material.as_ref()))
    }

    fn same_diffuse_light(&self, other: &Self) -> bool {
        same(self.trained_in.as_ref(), other.trained_in.as_ref())
            && same(self.diffuse_light.as_ref(), other.diffuse_light.as_ref())
    }

    pub(super) fn same_object(&self, other: &Self) -> bool {
        self.layer == other.layer
            && self.edit == other.edit
            && self.regions == other.regions
            && same(self.material.as_ref(), other.material.as_ref())
            && (!self.layer.is_lit() && self.layer != Layer::Samples
                || self.same_light(other) && self.same_diffuse_light(other))
    }
}
