//! Looking into one point of the object, and editing the parts that grow from such points.
//!
//! The state and its commands; values and panorama are computed on a thread of their own ([`worker`]), which
//! [`driver`] asks for what is out of date.

pub(super) mod driver;
mod inspector;
pub(super) mod marker;
mod worker;

use glam::{Vec2, Vec3};

use crate::geometry::Camera;
use crate::neif::{Extent, MaterialEdit};
use crate::render::{PanoramaView, PointValues, PointView};

pub(super) use inspector::Inspector;

/// A picked point of the surface, world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pick {
    /// Where.
    pub position: Vec3,
    /// Unit shading normal, on the side from which it was picked.
    pub normal: Vec3,
    /// Unit normal of the triangle, on the same side.
    pub face_normal: Vec3,
}

impl Pick {
    /// The point as a camera sees it.
    pub fn seen_by(&self, camera: &Camera) -> PointView {
        PointView::from_camera(self.position, self.normal, self.face_normal, camera)
    }
}

/// What is looked into, and what the material panel acts on.
#[derive(Clone, Debug, Default)]
pub struct InspectState {
    /// The point.
    pub pick: Option<Pick>,
    /// What is known of it.
    pub values: Option<PointValues>,
    /// Whether the panorama is sharp rather than as blurred as the point's reflection.
    pub is_sharp: bool,
    /// The panorama on the graphics card.
    pub panorama: Option<PanoramaView>,
    /// The region that the material panel changes; none is the whole object.
    pub scope: Option<usize>,
    /// The region under the pointer, shown in a signal colour.
    pub hovered: Option<usize>,
}

/// What a person does about points and regions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InspectCommand {
    /// Look into what is seen at this point of a window of that size, both in pixels.
    PickAt {
        /// From the top left.
        at: Vec2,
        /// Width and height.
        window: (u32, u32),
    },
    /// Forget the point.
    Forget,
    /// Show the panorama sharp, or as blurred as the point's reflection.
    ShowSharp(bool),
    /// Grow a region from the point, and edit that.
    AddRegion(Extent),
    /// Change what belongs to a region.
    SetExtent(usize, Extent),
    /// Edit a region's material.
    Edit(usize, MaterialEdit),
    /// Give a region up, with its edit.
    RemoveRegion(usize),
    /// What the material panel changes: a region, or the whole object.
    ChooseScope(Option<usize>),
    /// Show where a region lies.
    Hover(Option<usize>),
}

impl InspectState {
    /// Forgets the point.
    pub fn forget(&mut self) {
        (self.pick, self.values, self.panorama) = (None, None, None);
    }
}
