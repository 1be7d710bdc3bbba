//! What a view's mask says about the object's shape: the rays along its outline and within it.

use glam::{Affine3A, Vec2, Vec3};

use crate::data::View;
use crate::geometry::{Camera, Ray};
use crate::train::pixels::mask_outline::MaskOutline;

/// The outline of one view's mask.
#[derive(Debug)]
pub(super) struct Silhouette {
    /// Index of its training view.
    pub(super) view: usize,
    pub(super) camera: Camera,
    camera_from_world: Affine3A,
    pub(super) outline: MaskOutline,
    /// Places on the object, evenly, in pixels: all of its rays should meet it.
    pub(super) inner: Vec<Vec2>,
    /// Pixels by which the object may reach beyond the outline.
    slack: f32,
}

/// Most places on the object whose rays are asked for, about one for every other cell that it covers.
const MOST_INNER: usize = 8_000;
/// Pixels from the outline within which rays are not: cameras err by as much.
const RIM_PX: f32 = 1.5;
/// The same in standard deviations of the outline's error.
const RIM_ERRORS: f32 = 2.5;
/// Standard deviations by which the object may reach beyond an uncertain outline: one of many views cuts it off where it errs
/// the most.
pub(super) const SLACK_ERRORS: f32 = 1.5;

impl Silhouette {
    /// The silhouette of a view, training view `index`, that `camera` took, for what lies within `reach` pixels of its outline; `None` without a mask or
    /// where it shows nothing of the object's edge.
    pub(super) fn new(index: usize, view: &View, camera: Camera, reach: f32) -> Option<Self> {
        let outline = MaskOutline::new(view.mask.as_ref()?, reach)?;
        Some(Self {
            view: index,
            camera,
            camera_from_world: camera.world_from_camera.inverse(),
            inner: inner_places(&outline, RIM_PX),
            outline,
            slack: 0.0,
        })
    }

    /// The outline is wrong by `error_px` pixels (standard deviation).
    pub(super) fn set_error(&mut self, error_px: f32) {
        let rim = RIM_PX.max(RIM_ERRORS * error_px);
        self.inner = inner_places(&self.outline, rim);
        self.slack = SLACK_ERRORS * error_px;
    }

    /// The picture is shifted by `by` pixels against its camera.
    pub(super) fn shift(&mut self, by: Vec2) {
        self.camera.cx += by.x;
        self.camera.cy += by.y;
    }

    /// The ray through a point of the outline.
    pub(super) fn ray(&self, at: Vec2) -> Ray {
        self.camera.ray(at.x, at.y)
    }

    /// The distance to the outline in pixels where `p` appears, positive on the object. Beside the
    /// picture the object is not, unless the picture's border cuts it there; `None` where it does,
    /// and for what the lens does not see.
    fn distance_px(&self, p: Vec3) -> Option<f32> {
        let pixel = self.project(p)?;
        let (width, height) = (self.camera.width, self.camera.height);
        let end = Vec2::new((width - 1) as f32, (height - 1) as f32);
        let beside = (pixel - 0.5).distance((pixel - 0.5).clamp(Vec2::ZERO, end));
        let within = self.outline.distance_at(pixel);
        // Half a pixel of the border is still in the picture.
        if beside > 0.75 && within > -1.0 {
            return None;
        }
        Some(within - beside)
    }

    /// As [`Camera::project`], without inverting the pose each time.
    fn project(&self, p: Vec3) -> Option<Vec2> {
        if !self.camera.distortion.is_none() {
            return self.camera.project(p);
        }
        let p = self.camera_from_world.transform_point3(p);
        let camera = &self.camera;
        let pixel =
            Vec2::new(camera.fx * p.x, -camera.fy * p.y) / -p.z + Vec2::new(camera.cx, camera.cy);
        (p.z < 0.0 && pixel.is_finite()).then_some(pixel)
    }

    /// How far outside this silhouette's cone `p` lies, in scene units, negative inside; `None`
    /// where the view does not say.
    pub(super) fn outside_by(&self, p: Vec3) -> Option<f32> {
        let px = self.distance_px(p)? + self.slack;
        Some(-px * self.pixel_at(p))
    }

    /// Width of a pixel at `p`, scene units.
    pub(super) fn pixel_at(&self, p: Vec3) -> f32 {
        p.distance(self.camera.position()) * self.camera.pixel_angle()
    }

    /// The middle of the object's pixels, and the largest distance of its outline from there, pixels.
    pub(super) fn disc(&self) -> (Vec2, f32) {
        let width = self.camera.width as usize;
        let (mut sum, mut n) = (Vec2::ZERO, 0.0);
        for (i, distance) in self.outline.distance.iter().enumerate() {
            if *distance > 0.0 {
                sum += Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
                n += 1.0;
            }
        }
        let middle = if n > 0.0 {
            sum / n
        } else {
            self.outline.middles[0]
        };
        let reach = self.outline.middles.iter().map(|p| p.distance(middle));
        (middle, reach.fold(0.0, f32::max))
    }
}

/// Pixel centres further than `rim` within the outline, all or every so many along both axes.
fn inner_places(outline: &MaskOutline, rim: f32) -> Vec<Vec2> {
    let (distance, width) = (&outline.distance, outline.size[0]);
    let inner = || (0..distance.len()).filter(|i| distance[*i] > rim);
    let stride = (inner().count() as f32 / MOST_INNER as f32).sqrt().ceil() as usize;
    inner()
        .map(|i| (i % width, i / width))
        .filter(|(x, y)| x % stride == 0 && y % stride == 0)
        .map(|(x, y)| Vec2::new(x as f32, y as f32) + 0.5)
        .collect()
}
