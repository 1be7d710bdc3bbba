//! Photographs a scan.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::prelude::*;

use super::cameras::cameras;
use super::stand::Stand;
use super::survey::Survey;
use crate::data::{DataError, Dataset, LoadOptions, Origin, Photo, Split, View};
use crate::geometry::Camera;
use crate::scans::{Scan, ScanPicture};

/// Photos that are taken.
const N_PHOTOS: usize = 144;
/// Pixels along a photo's sides.
const SIDE: u32 = 256;
/// Of how many photos one is held out to validate, and one to test.
const HOLD_OUT_EVERY: usize = 12;
/// Reads a capture, or photographs the scan in a file from around where an object may stand; `None` when cancelled. Runs on the
/// current rayon pool.
///
/// # Errors
/// As [`Dataset::load`]; when the file is a scan that cannot be used.
pub fn load_capture(
    path: &Path,
    options: &LoadOptions<'_>,
    cancel: &AtomicBool,
) -> Result<Option<Dataset>, DataError> {
    if Scan::is_scan(path) {
        photograph(path, options, cancel)
    } else {
        Dataset::load(path, options).map(Some)
    }
}

fn photograph(
    path: &Path,
    options: &LoadOptions<'_>,
    cancel: &AtomicBool,
) -> Result<Option<Dataset>, DataError> {
    let choices = &options.choices;
    let survey = Survey::of(path, choices)?;
    let Survey { scan, points, .. } = &survey;
    let Some(stand) = Stand::at(scan, survey.at, survey.size, cancel) else {
        return Ok(None);
    };
    let is_wanted = |split| match split {
        Split::Train => options.splits.train,
        Split::Val => options.splits.val,
        Split::Test => options.splits.test,
    };
    let cameras = cameras(&stand, points, survey.up, N_PHOTOS, SIDE);
    let planned = cameras.iter().enumerate().map(|(i, camera)| {
        let split = match i % HOLD_OUT_EVERY {
            5 => Split::Val,
            11 => Split::Test,
            _ => Split::Train,
        };
        (i, split, camera)
    });
    let planned: Vec<_> = planned.filter(|(_, split, _)| is_wanted(*split)).collect();
    let n_done = AtomicUsize::new(0);
    let take = |&(i, split, camera): &(usize, Split, &Camera)| {
        let picture = scan.picture(camera, cancel)?;
        (options.on_progress)(n_done.fetch_add(1, Ordering::Relaxed) + 1, planned.len());
        Some(View {
            name: format!("{i:03}"),
            split,
            camera: *camera,
            photo: photo(&picture),
            mask: None,
        })
    };
    let views: Option<Vec<View>> = planned.par_iter().map(take).collect();
    let Some(views) = views else {
        return Ok(None);
    };
    let of = |split| {
        let views = views.iter().filter(|view| view.split == split);
        views.cloned().collect()
    };
    Ok(Some(Dataset {
        name: path
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned(),
        root: path.to_owned(),
        origin: Origin {
            recognised: scan.describe(),
            up: Some(survey.up),
            up_is_given: choices.up.is_some(),
            split_rule: format!("one of {HOLD_OUT_EVERY} pictures of the scan each"),
            ..Origin::default()
        },
        train: of(Split::Train),
        val: of(Split::Val),
        test: of(Split::Test),
        mesh: None,
        first_box: None,
        mesh_path: None,
        environment_visible: true,
        problems: vec![survey.finding()],
    }))
}

/// A picture as a camera would store it.
fn photo(picture: &ScanPicture) -> Photo {
    let code = |srgb: f32| (srgb.clamp(0.0, 1.0) * 65535.0).round() as u16;
    Photo::Ldr {
        width: picture.width,
        height: picture.height,
        pixels: picture.srgb.iter().map(|srgb| srgb.map(code)).collect(),
    }
}
