//! What a person wants to see, how good, and which parts of a picture hold for the next: an `Arc` stands for its address.

use std::sync::Arc;

use crate::geometry::Camera;
use crate::neif::{MaterialEdit, Region};
use crate::render::{Background, Layer, Scene};

/// How good a pass at full resolution is, several paths for each of the object's pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// The last pass but one.
    Fine,
    /// What [`crate::render::render`] makes: where the cones of lobes disagree, more of them.
    Settled,
}

/// A picture that is wanted.
#[derive(Clone, Debug)]
pub struct PreviewScene {
    /// What to show.
    pub scene: Scene,
    /// From where, at full resolution.
    pub camera: Camera,
    /// Which part.
    pub layer: Layer,
    /// The region whose places are shown in a signal colour.
    pub highlight: Option<Region>,
}

impl PreviewScene {
    /// Whether the picture would be the same.
    pub fn is_same(&self, other: &Self) -> bool {
        let (a, b) = (&self.scene, &other.scene);
        self.camera == other.camera
            && self.layer == other.layer
            && self.highlighted_place() == other.highlighted_place()
            && a.transform == b.transform
            && a.edit == b.edit
            && a.regions.effective() == b.regions.effective()
            && a.background == b.background
            && a.display_ev == b.display_ev
            && a.tone_map == b.tone_map
            && Arc::ptr_eq(&a.environment, &b.environment)
            && same(a.trained_in.as_ref(), b.trained_in.as_ref())
            && same(a.object.as_ref(), b.object.as_ref())
    }

    /// Whether the camera sees the same of the same mesh.
    pub(super) fn same_geometry(&self, other: &Self) -> bool {
        let tracer = |scene: &Scene| scene.object.as_ref().map(|o| Arc::as_ptr(&o.tracer));
        self.camera == other.camera && tracer(&self.scene) == tracer(&other.scene)
    }

    /// Whether what is behind the object is the same from one place.
    pub(super) fn same_background(&self, other: &Self) -> bool {
        let is_blurred = |of: &Self| of.scene.shown_background() == Background::Blurred;
        is_blurred(self) == is_blurred(other) && self.same_light(other)
    }

    fn same_light(&self, other: &Self) -> bool {
        let (a, b) = (&self.scene, &other.scene);
        Arc::ptr_eq(&a.environment, &b.environment)
            && a.marks_unseen == b.marks_unseen
            && a.transform == b.transform
            && same(a.ground.as_ref(), b.ground.as_ref())
    }

    /// Whether the same places of the object are highlighted.
    pub(super) fn same_highlight(&self, other: &Self) -> bool {
        self.highlighted_place() == other.highlighted_place()
            && (self.highlight.is_none() || self.same_material(other))
    }

    /// Whether the object, of the same geometry, has the same values.
    pub(super) fn same_object(&self, other: &Self) -> bool {
        let (a, b) = (&self.scene, &other.scene);
        let light = |scene: &Scene| scene.diffuse_light.as_ref().map(|l| Arc::as_ptr(&l.light));
        let needs_light = self.layer.is_lit() || self.layer == Layer::Samples;
        let is_same_light = || {
            self.same_light(other)
                && same(a.trained_in.as_ref(), b.trained_in.as_ref())
                && light(a) == light(b)
        };
        self.layer == other.layer
            && a.edit == b.edit
            && a.regions.effective() == b.regions.effective()
            && self.same_material(other)
            && (!needs_light || is_same_light())
    }

    fn same_material(&self, other: &Self) -> bool {
        let material = |scene: &Scene| scene.object.as_ref().map(|o| Arc::as_ptr(&o.material));
        material(&self.scene) == material(&other.scene)
    }

    /// The highlighted region without its edit, from which it does not follow where it lies.
    fn highlighted_place(&self) -> Option<Region> {
        self.highlight.map(|region| Region {
            edit: MaterialEdit::default(),
            ..region
        })
    }
}

/// Whether both are the same one, or none.
pub(in crate::render) fn same<T>(a: Option<&Arc<T>>, b: Option<&Arc<T>>) -> bool {
    a.map(Arc::as_ptr) == b.map(Arc::as_ptr)
}
