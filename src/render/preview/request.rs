//! What a person wants to see, and how good.

use std::sync::Arc;

use crate::geometry::Camera;
use crate::neif::{MaterialEdit, Region};
use crate::render::{Layer, Scene};

/// The resolution divisors of the passes, coarsest first; nothing is ever coarser than a quarter.
pub const SCALES: [u32; 3] = [4, 2, 1];

/// What the object gets in a pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// One path a pixel.
    Plain,
    /// Several.
    Fine,
    /// What [`crate::render::render`] makes: where the cones of lobes disagree, more of them.
    Settled,
}

/// How good a pass is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PassKind {
    /// Resolution divisor per axis, one of [`SCALES`].
    pub scale: u32,
    /// What the object gets.
    pub quality: Quality,
}

impl PassKind {
    /// The last pass but one.
    pub const FINE: Self = Self {
        scale: 1,
        quality: Quality::Fine,
    };
    /// The last pass: what [`crate::render::render`] makes.
    pub const SETTLED: Self = Self {
        scale: 1,
        quality: Quality::Settled,
    };

    /// One path a pixel at the given resolution divisor.
    pub fn plain(scale: u32) -> Self {
        Self {
            scale,
            quality: Quality::Plain,
        }
    }
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
        let object = |scene: &Scene| scene.object.as_ref().map(Arc::as_ptr);
        // Where a highlighted region lies does not follow from its edit.
        let place = |region: Region| Region {
            edit: MaterialEdit::default(),
            ..region
        };
        self.camera == other.camera
            && self.layer == other.layer
            && self.highlight.map(place) == other.highlight.map(place)
            && self.scene.transform == other.scene.transform
            && self.scene.edit == other.scene.edit
            && self.scene.regions.effective() == other.scene.regions.effective()
            && self.scene.background == other.scene.background
            && self.scene.display_ev == other.scene.display_ev
            && self.scene.tone_map == other.scene.tone_map
            && Arc::ptr_eq(&self.scene.environment, &other.scene.environment)
            && same(
                self.scene.trained_in.as_ref(),
                other.scene.trained_in.as_ref(),
            )
            && object(&self.scene) == object(&other.scene)
    }
}

/// Whether both are the same one, or none.
pub(in crate::render) fn same<T>(a: Option<&Arc<T>>, b: Option<&Arc<T>>) -> bool {
    a.map(Arc::as_ptr) == b.map(Arc::as_ptr)
}
