//! The object of a capture whose photos have no masks: whether it is to be found, and where a click shows it.

use glam::{Vec2, Vec3};

use super::app_state::AppState;
use super::source::Source;
use crate::geometry::Ray;
use crate::render::Support;
use crate::scans::Scan;

impl AppState {
    /// Whether photos are open in which an object can be found, as their environment alone is trained.
    pub fn lacks_object(&self) -> bool {
        let is_of_photos = match &self.source {
            Source::Demo(path) | Source::Capture(path) => !Scan::is_named_so(path),
            _ => false,
        };
        let capture = self.training.capture.as_ref();
        is_of_photos && self.snapshot.is_some() && capture.is_some_and(|c| !c.has_object)
    }

    /// The point of the capture's environment that is seen at a pixel of a window of that size, world coordinates.
    pub fn environment_at(&self, at: Vec2, window: (u32, u32)) -> Option<Vec3> {
        let ray = self.window_camera(window).ray(at.x, at.y);
        let ray = Ray {
            origin: ray.origin,
            direction: ray.direction,
        };
        let snapshot = self.snapshot.as_ref()?;
        Some(Support::met_by(&snapshot.environment, &ray)?.point)
    }
}
