//! A small version of a photo without lens distortion, for comparing it with others.

use glam::{UVec2, Vec2, Vec3};

use super::{PHOTO_SIDE, pixel_at, ray_of};
use crate::data::View;
use crate::geometry::{Camera, Distortion, SurfaceTracer};
use crate::train::pixels::outlines::Sides;

/// Width of the band along the object's outline that is left out, pixels: small ones mix what is on both sides.
const OUTLINE_PX: f32 = 0.5;

/// A small photo.
#[derive(Debug)]
pub(super) struct SmallPhoto {
    /// Without distortion.
    pub(super) camera: Camera,
    /// `[height * width]` mean of the colours, sRGB in `[0, 1]`; NaN where it shows the object or nothing.
    pub(super) grey: Vec<f32>,
    /// `[height * width]` linear colours.
    pub(super) colors: Vec<Vec3>,
}

impl SmallPhoto {
    /// Of a view that `camera` took.
    pub(super) fn of(view: &View, camera: &Camera, tracer: Option<&SurfaceTracer>) -> Self {
        let small = view.within(PHOTO_SIDE);
        let camera = camera.resized(small.camera.width, small.camera.height);
        let sides = Sides::new(&small, &camera, tracer, OUTLINE_PX);
        let grey = |(i, is_background): (usize, &bool)| {
            let mean = small.photo.srgb(i).iter().sum::<f32>() / 3.0;
            if *is_background { mean } else { f32::NAN }
        };
        let pixels = 0..sides.background.len();
        let photo = Self {
            camera,
            grey: sides.background.iter().enumerate().map(grey).collect(),
            colors: pixels.map(|i| small.photo.linear(i).into()).collect(),
        };
        photo.undistorted()
    }

    /// As a pinhole of the same focal length would have taken it.
    fn undistorted(self) -> Self {
        if self.camera.distortion == Distortion::default() {
            return self;
        }
        let camera = Camera {
            distortion: Distortion::default(),
            ..self.camera
        };
        let eye = camera.position();
        let color = |i: usize| {
            let at = self.camera.project(eye + ray_of(&camera, i));
            let pixel = at.and_then(|at| pixel_at(&self.camera, at));
            let grey = at.map_or(f32::NAN, |at| self.at(at));
            (grey, pixel.map_or(Vec3::ZERO, |i| self.colors[i]))
        };
        let (grey, colors) = (0..self.grey.len()).map(color).unzip();
        Self {
            camera,
            grey,
            colors,
        }
    }

    /// Grey value at a place, pixels, between the four pixels around it; NaN beside the picture and at the object.
    fn at(&self, at: Vec2) -> f32 {
        let last = UVec2::new(self.camera.width, self.camera.height).as_vec2() - 1.0;
        let at = at - 0.5;
        if !(at.cmpge(Vec2::ZERO).all() && at.cmplt(last).all()) {
            return f32::NAN;
        }
        let width = self.camera.width as usize;
        let [u, v] = at.fract().to_array();
        let i = at.y as usize * width + at.x as usize;
        let along = |i: usize| self.grey[i] + u * (self.grey[i + 1] - self.grey[i]);
        let above = along(i);
        above + v * (along(i + width) - above)
    }
}
