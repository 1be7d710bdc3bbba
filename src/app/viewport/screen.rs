//! Between the window's points, the viewport's pixels and the world.

use egui::{Context, Pos2, Rect, vec2};
use glam::{Vec2, Vec3};

use crate::app::state::app_state::AppState;
use crate::geometry::Camera;

/// Where the viewport is, and the camera through which it shows the world.
#[derive(Clone, Copy)]
pub(in crate::app) struct Screen {
    pub(in crate::app) rect: Rect,
    /// Width and height in pixels.
    pub(in crate::app) window: (u32, u32),
    /// Pixels per point.
    pub(in crate::app) per_point: f32,
    pub(in crate::app) camera: Camera,
}

impl Screen {
    /// The viewport in a rectangle of the window.
    pub(in crate::app) fn new(ctx: &Context, rect: Rect, state: &AppState) -> Self {
        let per_point = ctx.pixels_per_point();
        let size = (rect.size() * per_point).round();
        let window = (size.x.max(1.0) as u32, size.y.max(1.0) as u32);
        Self {
            rect,
            window,
            per_point,
            camera: state.window_camera(window),
        }
    }

    /// A point of the window as a pixel of the viewport.
    pub(in crate::app) fn to_pixels(self, at: Pos2) -> Vec2 {
        let at = (at - self.rect.min) * self.per_point;
        Vec2::new(at.x, at.y)
    }

    /// A pixel of the viewport as a point of the window.
    pub(in crate::app) fn to_points(self, at: Vec2) -> Pos2 {
        self.rect.min + vec2(at.x, at.y) / self.per_point
    }

    /// Where a world point is seen; none behind the camera.
    pub(in crate::app) fn place(self, p_world: Vec3) -> Option<Pos2> {
        Some(self.to_points(self.camera.project(p_world)?))
    }
}
