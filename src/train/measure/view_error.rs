//! How a rendered view differs from its photo, pixel by pixel and in figures.

use super::flip;
use super::held_out::truth_and_mask;
use super::metrics::{MASK_THRESHOLD, squared_error};
use crate::data::View;
use crate::render::Picture;

/// Quality of one view; `None` where a scope has no pixel or a value was not finite.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ViewFigures {
    /// PSNR over the whole picture, dB.
    pub psnr: Option<f64>,
    /// Over pixels whose mask is above one half, dB.
    pub psnr_object: Option<f64>,
    /// Over pixels whose mask is below one half, dB.
    pub psnr_background: Option<f64>,
    /// Mean FLIP error over the whole picture, 0 to 1.
    pub flip: Option<f64>,
    /// The same over pixels whose mask is above one half.
    pub flip_object: Option<f64>,
}

/// The differences of a picture, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewError {
    /// Pixels per row.
    pub width: usize,
    /// `[height * width]` mean absolute difference of the three sRGB values, 0 to 1.
    pub absolute: Vec<f32>,
    /// `[height * width]` mean of rendering less photo, -1 to 1: positive where the rendering is too bright.
    pub signed: Vec<f32>,
    /// `[height * width]` FLIP error, 0 to 1 ([`flip::error_map`]).
    pub flip: Vec<f32>,
    /// Their summary.
    pub figures: ViewFigures,
}

impl ViewError {
    /// Compares a rendering of the view, sRGB in `[0, 1]`, with its photo, on the current thread pool.
    ///
    /// # Panics
    /// When the picture has another size than the photo: a bug of the caller.
    pub fn of(picture: &Picture, view: &View) -> Self {
        let width = picture.width as usize;
        assert_eq!(
            (picture.width, picture.height),
            (view.photo.width(), view.photo.height()),
            "the picture must have the photo's size"
        );
        let (truth, mask) = truth_and_mask(view, picture.pixels.len());
        let pairs = || picture.pixels.iter().zip(&truth);
        let mean = |of: fn(f32) -> f32| -> Vec<f32> {
            let difference =
                |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| of(a[c] - b[c])).sum::<f32>() / 3.0;
            pairs().map(difference).collect()
        };
        let flip = flip::error_map(&truth, &picture.pixels, width);
        let figures = figures(&picture.pixels, &truth, &flip, mask.as_deref());
        Self {
            width,
            absolute: mean(f32::abs),
            signed: mean(|v| v),
            flip,
            figures,
        }
    }
}

fn figures(
    picture: &[[f32; 3]],
    truth: &[[f32; 3]],
    flip: &[f32],
    mask: Option<&[f32]>,
) -> ViewFigures {
    let is_object = |i: usize| mask.is_some_and(|mask| mask[i] > MASK_THRESHOLD);
    let is_background = |i: usize| mask.is_some_and(|mask| mask[i] < MASK_THRESHOLD);
    let psnr = |keep: &dyn Fn(usize) -> bool| squared_error(picture, truth, keep).psnr();
    let mean_flip = |keep: &dyn Fn(usize) -> bool| {
        let kept = || (0..flip.len()).filter(|&i| keep(i));
        let mean = kept().map(|i| f64::from(flip[i])).sum::<f64>() / kept().count() as f64;
        mean.is_finite().then_some(mean)
    };
    ViewFigures {
        psnr: psnr(&|_| true),
        psnr_object: psnr(&is_object),
        psnr_background: psnr(&is_background),
        flip: mean_flip(&|_| true),
        flip_object: mean_flip(&is_object),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::measure::metrics::{MAX_PSNR_DB, compare};
    use crate::train::test_scene::sphere_in_a_box;

    fn rendering(view: &View, change: impl Fn(usize, f32) -> f32) -> Picture {
        let (width, height) = (view.photo.width(), view.photo.height());
        let pixel = |i: usize| view.photo.srgb(i).map(|v| change(i, v).clamp(0.0, 1.0));
        let pixels = (0..view.photo.n_pixels()).map(pixel).collect();
        Picture {
            width,
            height,
            pixels,
        }
    }

    #[test]
    fn a_perfect_rendering_has_no_error_anywhere() {
        let dataset = sphere_in_a_box(2, 24);
        let view = &dataset.train[0];
        let error = ViewError::of(&rendering(view, |_, v| v), view);
        let all = [&error.absolute, &error.signed, &error.flip];
        assert!(all.into_iter().flatten().all(|v| *v == 0.0), "not zero");
        assert_eq!(error.figures.psnr_object, Some(MAX_PSNR_DB));
        assert_eq!(error.figures.flip_object, Some(0.0));
    }

    #[test]
    fn figures_are_those_of_eval() {
        let dataset = sphere_in_a_box(2, 24);
        let view = &dataset.train[0];
        let picture = rendering(view, |i, v| v + 0.1 * (i as f32).sin());
        let error = ViewError::of(&picture, view);
        let (truth, mask) = truth_and_mask(view, view.photo.n_pixels());
        assert!(mask.is_some(), "the sphere has a mask");
        let eval = compare(&picture.pixels, &truth, mask.as_deref(), error.width);
        let figures = error.figures;
        assert_eq!(
            (figures.psnr, figures.psnr_object, figures.psnr_background),
            (eval.psnr, eval.psnr_object, eval.psnr_background)
        );
        assert_eq!(figures.flip, eval.flip);
    }

    #[test]
    fn the_sign_says_which_is_brighter() {
        let dataset = sphere_in_a_box(2, 24);
        let view = &dataset.train[0];
        let error = ViewError::of(&rendering(view, |_, v| v * 0.5), view);
        assert!(error.signed.iter().all(|v| *v <= 0.0), "darker everywhere");
        let flipped = error.signed.iter().zip(&error.absolute);
        assert!(flipped.into_iter().all(|(s, a)| (s + a).abs() < 1e-6));
    }
}
