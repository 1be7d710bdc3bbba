//! What a person says of the object.

use glam::Vec3;

use crate::geometry::Aabb;

/// Which object is meant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Selection {
    /// A point on it, world; the middle of what the cameras look at where absent.
    pub at: Option<Vec3>,
    /// A box that it is within, world.
    pub within: Option<Aabb>,
}
