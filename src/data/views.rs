//! Decodes listed frames into views, in parallel, and gathers what was noticed on the way.

use std::path::Path;

use rayon::prelude::*;

use super::image::decode;
use super::problem::first_names;
use super::{DataError, Frame, Mask, Photo, Problem, Severity, View, read_mask};

/// Views in the order of their frames, `None` where one could not be read.
pub(super) struct LoadedViews {
    pub(super) views: Vec<Option<View>>,
    pub(super) findings: Findings,
}

/// What was noticed while reading views, by kind, with the views' names.
#[derive(Debug, Default)]
pub(super) struct Findings {
    unreadable: Vec<Problem>,
    rescaled: Vec<String>,
    without_mask_file: Vec<String>,
    cut_out: Vec<String>,
    n_views: usize,
}

impl Findings {
    /// Whether most views are cut-outs; a few among full photos do not make the surroundings
    /// unknown.
    pub(super) fn are_cut_out(&self) -> bool {
        2 * self.cut_out.len() > self.n_views
    }

    /// One problem a kind.
    pub(super) fn into_problems(self) -> Vec<Problem> {
        let cut_out = self.are_cut_out();
        let mut problems = self.unreadable;
        let mut add = |severity, names: &[String], what: &str, advice: &str| {
            if !names.is_empty() {
                let what = format!("{what} ({} views: {})", names.len(), first_names(names));
                problems.push(Problem::new(severity, what, advice));
            }
        };
        add(
            Severity::Warning,
            &self.without_mask_file,
            "mask files are missing",
            "these views are used without a mask",
        );
        add(
            Severity::Note,
            &self.rescaled,
            "photos are smaller or larger than w x h",
            "the lens was scaled with them",
        );
        if cut_out {
            add(
                Severity::Note,
                &self.cut_out,
                "the surroundings are not visible: the photos are cut out along the object",
                "light is learned from reflections alone",
            );
        }
        problems
    }
}

/// What one frame gave.
struct LoadedView {
    view: View,
    rescaled: bool,
    mask_file_missing: bool,
    cut_out: bool,
}

/// Reads the frames in parallel, calling `on_done` after each.
pub(super) fn load_views(frames: &[Frame], on_done: &(dyn Fn() + Sync)) -> LoadedViews {
    let results: Vec<Result<LoadedView, DataError>> = frames
        .par_iter()
        .map(|frame| {
            let result = load_view(frame);
            on_done();
            result
        })
        .collect();
    let mut findings = Findings::default();
    let views = results
        .into_iter()
        .map(|result| match result {
            Ok(loaded) => {
                findings.n_views += 1;
                let name = &loaded.view.name;
                let kinds = [
                    (loaded.rescaled, &mut findings.rescaled),
                    (loaded.mask_file_missing, &mut findings.without_mask_file),
                    (loaded.cut_out, &mut findings.cut_out),
                ];
                for (found, names) in kinds {
                    if found {
                        names.push(name.clone());
                    }
                }
                Some(loaded.view)
            }
            Err(e) => {
                let problem = Problem::new(Severity::Error, e.to_string(), "the view is left out");
                findings.unreadable.push(problem);
                None
            }
        })
        .collect();
    LoadedViews { views, findings }
}

fn load_view(frame: &Frame) -> Result<LoadedView, DataError> {
    let decoded = decode(&frame.photo)?;
    let (width, height) = (decoded.photo.width(), decoded.photo.height());
    let (camera, rescaled) = frame.camera(width, height)?;
    let mask_file = frame.mask.as_deref().filter(|path| path.is_file());
    let cut_out = decoded
        .alpha
        .as_ref()
        .is_some_and(|alpha| hides_one_color(&decoded.photo, alpha));
    let mask = match mask_file {
        Some(path) => Some(read_mask_sized(path, width, height)?),
        None => decoded.alpha,
    };
    Ok(LoadedView {
        view: View {
            name: frame.name.clone(),
            camera,
            photo: decoded.photo,
            mask,
        },
        rescaled,
        mask_file_missing: frame.mask.is_some() && mask_file.is_none(),
        cut_out,
    })
}

/// Reads a mask and brings it to the photo's size; errors where the aspect differs.
fn read_mask_sized(path: &Path, width: u32, height: u32) -> Result<Mask, DataError> {
    let mask = read_mask(path)?;
    if (mask.width, mask.height) == (width, height) {
        return Ok(mask);
    }
    let expected = mask.width as f32 * height as f32 / mask.height as f32;
    if (expected - width as f32).abs() > 0.01 * width as f32 + 1.0 {
        let problem = format!(
            "the mask is {} x {}, its photo {width} x {height}",
            mask.width, mask.height
        );
        return Err(DataError::image(path, problem));
    }
    let coverage = image::GrayImage::from_raw(mask.width, mask.height, mask.coverage)
        .map(|mask| image::imageops::resize(&mask, width, height, image::imageops::Triangle))
        .ok_or_else(|| DataError::image(path, "the mask is incomplete"))?
        .into_raw();
    Ok(Mask {
        width,
        height,
        coverage,
    })
}

/// Whether nearly all fully transparent pixels have one colour, that is, hold no photo.
///
/// Nearly: renderers leave stray colours along the silhouette (0.1 % in NeRF-synthetic).
fn hides_one_color(photo: &Photo, alpha: &Mask) -> bool {
    const NEARLY_ALL: f32 = 0.95;
    let hidden = || {
        (0..photo.n_pixels())
            .filter(|i| alpha.coverage[*i] == 0)
            .map(|i| photo.srgb(i))
    };
    // Boyer and Moore's vote finds the one colour that can hold a majority.
    let (candidate, _) = hidden().fold(([0.0; 3], 0_usize), |(candidate, votes), color| {
        if votes == 0 {
            (color, 1)
        } else if color == candidate {
            (candidate, votes + 1)
        } else {
            (candidate, votes - 1)
        }
    });
    let n_hidden = hidden().count();
    let n_same = hidden().filter(|color| *color == candidate).count();
    n_hidden > 0 && n_same as f32 >= NEARLY_ALL * n_hidden as f32
}
