//! Depths of what a photo shows, and which of them other photos confirm.

use glam::{Affine3A, Vec2, Vec3};

use super::plane_sweep::{Steps, sweep};
use super::small_photo::SmallPhoto;
use crate::geometry::Camera;

/// Steps by which the findings of two photos may differ and confirm each other.
const SAME: f32 = 1.5;

/// Depths of what a photo shows, where its neighbours determine them.
#[derive(Debug)]
pub(in crate::train) struct PhotoDepths {
    /// A pinhole, of the size of the depths.
    pub(in crate::train) camera: Camera,
    /// `[height * width]` one over the depth along the camera's axis, world units; NaN where not known.
    pub(in crate::train) nearness: Vec<f32>,
    /// About how exactly they are known.
    pub(in crate::train) step: f32,
}

impl PhotoDepths {
    /// What a photo shows, compared with `others`.
    pub(in crate::train) fn swept(
        photo: &SmallPhoto,
        others: &[&SmallPhoto],
        steps: Steps,
    ) -> Self {
        Self {
            nearness: sweep(photo, others, steps),
            ..Self::unknown(photo, steps.width)
        }
    }

    /// Before anything is known of a photo; what will be, about as exactly as `step`.
    pub(in crate::train) fn unknown(photo: &SmallPhoto, step: f32) -> Self {
        Self {
            camera: photo.camera,
            nearness: vec![f32::NAN; photo.grey.len()],
            step,
        }
    }

    /// The depths, as one over them, of the pixels whose points `is_confirmed`; NaN for all others.
    pub(in crate::train) fn confirmed(&self, is_confirmed: impl Fn(Vec3) -> bool) -> Vec<f32> {
        let kept = |(pixel, nearness): (usize, &f32)| {
            let is_kept = self.point(pixel).is_some_and(&is_confirmed);
            if is_kept { *nearness } else { f32::NAN }
        };
        self.nearness.iter().enumerate().map(kept).collect()
    }

    /// To be asked which of its pixels show points.
    pub(in crate::train) fn looks(&self) -> Onlooker<'_> {
        Onlooker {
            depths: self,
            camera_from_world: self.camera.world_from_camera.inverse(),
        }
    }

    /// What a pixel shows, world; `None` where that is not known.
    pub(in crate::train) fn point(&self, pixel: usize) -> Option<Vec3> {
        let nearness = self.nearness[pixel];
        // What is at infinity is taken for far away.
        let depth = 1.0 / nearness.max(0.01 * self.step);
        (!nearness.is_nan()).then(|| self.camera.position() + depth * ray_of(&self.camera, pixel))
    }
}

/// A photo that is asked about many points.
#[derive(Debug)]
pub(in crate::train) struct Onlooker<'a> {
    depths: &'a PhotoDepths,
    camera_from_world: Affine3A,
}

impl Onlooker<'_> {
    /// The pixel that shows a point, world, as near as that is; `None` where none does.
    pub(in crate::train) fn pixel_of(&self, point: Vec3) -> Option<usize> {
        let PhotoDepths { camera, step, .. } = self.depths;
        let p = self.camera_from_world.transform_point3(point);
        let expected = -1.0 / p.z;
        let at = Vec2::new(camera.fx * p.x, -camera.fy * p.y) * expected;
        let pixel = camera.pixel_at(at + Vec2::new(camera.cx, camera.cy))?;
        let is_there = (self.depths.nearness[pixel] - expected).abs() <= SAME * step;
        (p.z < 0.0 && is_there).then_some(pixel)
    }

    /// From where it looks, world.
    pub(in crate::train) fn eye(&self) -> Vec3 {
        self.depths.camera.position()
    }
}

/// The ray through the middle of a pixel, world, of length 1 along the camera's axis.
pub(in crate::train) fn ray_of(camera: &Camera, pixel: usize) -> Vec3 {
    let width = camera.width as usize;
    let middle = Vec2::new((pixel % width) as f32, (pixel / width) as f32) + 0.5;
    let direction = camera.ray(middle.x, middle.y).direction;
    direction / direction.dot(camera.forward())
}
