//! A view made small, for questions about light that need no detail.

use rayon::prelude::*;

use crate::color::luminance;
use crate::data::{Dataset, View};
use crate::geometry::Camera;

/// The longer side, pixels.
const SIDE: u32 = 40;
/// Coverage up to which a pixel counts as background.
const MAX_COVERAGE: f32 = 0.02;

/// A small picture of the background.
pub(super) struct Thumb {
    /// The camera for this size.
    pub(super) camera: Camera,
    /// `[height * width]` linear luminance; `None` where the object is.
    pub(super) background: Vec<Option<f32>>,
}

/// One for each training view.
pub(super) fn thumbs(dataset: &Dataset) -> Vec<Thumb> {
    dataset.train.par_iter().map(Thumb::new).collect()
}

impl Thumb {
    fn new(view: &View) -> Self {
        let View {
            camera,
            photo,
            mask,
            ..
        } = view.within(SIDE);
        let background = (0..photo.n_pixels())
            .map(|i| {
                let is_background = mask
                    .as_ref()
                    .is_none_or(|mask| mask.share(i) <= MAX_COVERAGE);
                is_background.then(|| luminance(photo.linear(i).into()))
            })
            .collect();
        Self { camera, background }
    }

    /// The background's luminance at a point of the picture, that of the pixel there.
    pub(super) fn at(&self, x_px: f32, y_px: f32) -> Option<f32> {
        let (w, h) = (self.camera.width, self.camera.height);
        let is_inside = (0.0..w as f32).contains(&x_px) && (0.0..h as f32).contains(&y_px);
        let i = (y_px as u32).min(h - 1) * w + (x_px as u32).min(w - 1);
        self.background[i as usize].filter(|_| is_inside)
    }
}
