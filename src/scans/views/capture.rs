//! Photographs a scan.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::prelude::*;

use super::cameras::cameras;
use super::stand::Stand;
use super::survey::Survey;
use crate::data::{
    DataError, Dataset, DepthMap, DepthView, LoadOptions, Origin, Photo, Split, Splits, View,
};
use crate::geometry::Camera;
use crate::scans::{Scan, ScanPicture};

/// Of how many photos one is held out to validate, and one to test.
const HOLD_OUT_EVERY: usize = 12;
/// Opacity from which on a pixel shows a surface.
const SOLID: f32 = 0.9;

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
    let survey = Survey::of(path, &options.choices)?;
    let views = photographs(&survey, options.splits, cancel, options.on_progress);
    let Some(views) = views else {
        return Ok(None);
    };
    let (views, depths): (Vec<View>, Vec<DepthView>) = views.into_iter().unzip();
    let (mut train, mut val, mut test) = (Vec::new(), Vec::new(), Vec::new());
    for view in views {
        match view.split {
            Split::Train => train.push(view),
            Split::Val => val.push(view),
            Split::Test => test.push(view),
        }
    }
    Ok(Some(Dataset {
        name: path
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned(),
        root: path.to_owned(),
        origin: Origin {
            recognised: survey.scan.describe(),
            up: Some(survey.up),
            up_is_given: options.choices.up.is_some(),
            depths,
            split_rule: format!("one of {HOLD_OUT_EVERY} pictures of the scan each"),
            ..Origin::default()
        },
        train,
        val,
        test,
        mesh: None,
        first_box: None,
        mesh_path: None,
        environment_visible: true,
        problems: vec![survey.finding()],
    }))
}

/// Takes the photos of these splits, with the depths of what they show; `None` when cancelled.
pub(super) fn photographs(
    survey: &Survey,
    splits: Splits,
    cancel: &AtomicBool,
    on_progress: &(dyn Fn(usize, usize) + Sync),
) -> Option<Vec<(View, DepthView)>> {
    let Survey { scan, points, .. } = survey;
    let stand = Stand::at(scan, survey.at, survey.size, cancel)?;
    let is_wanted = |split| match split {
        Split::Train => splits.train,
        Split::Val => splits.val,
        Split::Test => splits.test,
    };
    let cameras = cameras(&stand, points, survey.up, scan.photos());
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
        on_progress(n_done.fetch_add(1, Ordering::Relaxed) + 1, planned.len());
        let view = View {
            name: format!("{i:03}"),
            file: std::path::PathBuf::new(),
            split,
            camera: *camera,
            photo: photo(&picture),
            mask: None,
        };
        let depths = DepthView::rendered(view.name.clone(), depths(&picture, camera));
        Some((view, depths))
    };
    planned.par_iter().map(take).collect()
}

/// What counts as white: Gaussians are never quite opaque, so that lamps which were white in the photos come out a little darker.
const WHITE: f32 = 0.96;

/// A picture as a camera would store it.
fn photo(picture: &ScanPicture) -> Photo {
    let code = |srgb: f32| {
        let srgb = if srgb >= WHITE { 1.0 } else { srgb.max(0.0) };
        (srgb * 65535.0).round() as u16
    };
    Photo::Ldr {
        width: picture.width,
        height: picture.height,
        pixels: picture.srgb.iter().map(|srgb| srgb.map(code)).collect(),
    }
}

/// A picture's depths along the camera's axis, 0 where nothing is.
fn depths(picture: &ScanPicture, camera: &Camera) -> DepthMap {
    let forward = camera.forward();
    let depth = |(i, distance): (usize, &f32)| {
        let (x, y) = (i as u32 % picture.width, i as u32 / picture.width);
        let ray = camera.ray(x as f32 + 0.5, y as f32 + 0.5).direction;
        let is_solid = picture.opacity[i] > SOLID;
        if is_solid {
            distance * ray.dot(forward)
        } else {
            0.0
        }
    };
    DepthMap {
        camera: *camera,
        depths: picture.distance.iter().enumerate().map(depth).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lamps_that_are_not_quite_opaque_are_white() {
        let taken = photo(&ScanPicture {
            width: 4,
            height: 1,
            srgb: vec![[0.97; 3], [1.3; 3], [0.95, -0.1, 0.0], [0.0; 3]],
            opacity: vec![1.0; 4],
            distance: vec![1.0; 4],
        });
        let expected = [[1.0; 3], [1.0; 3], [0.95, 0.0, 0.0], [0.0; 3]];
        for (i, expected) in expected.into_iter().enumerate() {
            for (found, expected) in taken.srgb(i).into_iter().zip(expected) {
                assert!((found - expected).abs() < 1e-4, "{i}: {found}");
            }
        }
    }
}
