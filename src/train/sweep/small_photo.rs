//! A small version of a photo without lens distortion, for comparing it with others.

use glam::{UVec2, Vec2, Vec3};

use super::ray_of;
use crate::data::View;
use crate::geometry::{Camera, Distortion};

/// A part of a picture.
#[derive(Clone, Copy, Debug)]
pub(in crate::train) struct Window {
    /// Its first pixel, `[x, y]`.
    pub(in crate::train) start: [u32; 2],
    /// Its width and height, pixels.
    pub(in crate::train) size: [u32; 2],
}

/// A small photo.
#[derive(Debug)]
pub(in crate::train) struct SmallPhoto {
    /// Without distortion.
    pub(in crate::train) camera: Camera,
    /// `[height * width]` mean of the colours, sRGB in `[0, 1]`; NaN where it shows nothing that is compared.
    pub(in crate::train) grey: Vec<f32>,
    /// `[height * width]` linear colours.
    pub(in crate::train) colors: Vec<Vec3>,
}

impl SmallPhoto {
    /// A part of a view that `camera` took, whose pixels `is_compared` or not.
    pub(in crate::train) fn new(
        view: &View,
        camera: &Camera,
        is_compared: &[bool],
        window: Window,
    ) -> Self {
        let Window { start, size } = window;
        let pixel = |i: u32| {
            let (x, y) = (start[0] + i % size[0], start[1] + i / size[0]);
            (y * camera.width + x) as usize
        };
        let grey = |i: usize| {
            let mean = view.photo.srgb(i).iter().sum::<f32>() / 3.0;
            if is_compared[i] { mean } else { f32::NAN }
        };
        let pixels = || (0..size[0] * size[1]).map(pixel);
        let photo = Self {
            camera: camera.part(start, size[0], size[1]),
            grey: pixels().map(grey).collect(),
            colors: pixels().map(|i| view.photo.linear(i).into()).collect(),
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
            let pixel = at.and_then(|at| self.camera.pixel_at(at));
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

    /// Grey value at a place, pixels, between the four pixels around it; NaN beside the picture and where nothing is compared.
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
