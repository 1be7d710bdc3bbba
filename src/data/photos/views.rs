//! Decodes listed frames into views, in parallel, and gathers what was noticed on the way.

use std::path::Path;

use image::imageops::FilterType;
use image::metadata::Orientation;
use image::{DynamicImage, GrayImage};
use rayon::prelude::*;

use super::image::decode;
use super::photo_budget::{DecodeGate, Reduction, decoding_cost};
use super::shrink::{shrunk_mask, shrunk_photo};
use crate::data::problem::first_names;
use crate::data::{
    DataError, DepthFile, Frame, Mask, Photo, Problem, Severity, Split, View, read_mask,
};

/// Views in the order of their frames, `None` where one could not be read.
pub(in crate::data) struct LoadedViews {
    pub(in crate::data) views: Vec<Option<View>>,
    pub(in crate::data) findings: Findings,
}

/// What was noticed while reading views, by kind, with the views' names.
#[derive(Debug, Default)]
pub(in crate::data) struct Findings {
    unreadable: Vec<Problem>,
    rescaled: Vec<String>,
    turned: Vec<String>,
    /// Sizes before and after.
    reduced: Vec<String>,
    n_reduced: usize,
    without_mask_file: Vec<String>,
    cut_out: Vec<String>,
    n_views: usize,
    masks_inverted: bool,
}

impl Findings {
    /// Whether most views are cut-outs; a few among full photos do not make the environment
    /// unknown.
    pub(in crate::data) fn are_cut_out(&self) -> bool {
        2 * self.cut_out.len() > self.n_views
    }

    /// Notes what was noticed of a view, and gives the view where it could be read.
    fn note(&mut self, result: Result<LoadedView, DataError>) -> Option<View> {
        let loaded = match result {
            Ok(loaded) => loaded,
            Err(e) => {
                let problem = Problem::new(Severity::Error, e.to_string(), "the view is left out");
                self.unreadable.push(problem);
                return None;
            }
        };
        self.n_views += 1;
        let kinds = [
            (loaded.rescaled, &mut self.rescaled),
            (loaded.turned.is_some(), &mut self.turned),
            (loaded.mask_file_missing, &mut self.without_mask_file),
            (loaded.cut_out, &mut self.cut_out),
        ];
        for (_, names) in kinds.into_iter().filter(|(found, _)| *found) {
            names.push(loaded.view.name.clone());
        }
        if let Some([(w, h), (new_w, new_h)]) = loaded.reduced {
            let sizes = format!("{w} x {h} to {new_w} x {new_h}");
            if !self.reduced.contains(&sizes) {
                self.reduced.push(sizes);
            }
            self.n_reduced += 1;
        }
        Some(loaded.view)
    }

    /// One problem a kind.
    pub(in crate::data) fn into_problems(self) -> Vec<Problem> {
        let cut_out: &[String] = if self.are_cut_out() {
            &self.cut_out
        } else {
            &[]
        };
        let of_views = |severity, names: &[String], what: &str, advice: &str| {
            let what = format!("{what} ({} views: {})", names.len(), first_names(names));
            (!names.is_empty()).then(|| Problem::new(severity, what, advice))
        };
        let mut problems = self.unreadable;
        problems.extend(of_views(
            Severity::Warning,
            &self.without_mask_file,
            "mask files are missing",
            "these views are used without a mask",
        ));
        problems.extend(of_views(
            Severity::Note,
            &self.rescaled,
            "photos are smaller or larger than w x h",
            "the lens was scaled with them",
        ));
        problems.extend(of_views(
            Severity::Note,
            &self.turned,
            "photos are stored on their side, and w x h is that of the upright photo",
            "they were turned as EXIF says",
        ));
        if self.n_reduced > 0 {
            let what = format!(
                "{} photos were reduced to fit into memory: from {}",
                self.n_reduced,
                first_names(&self.reduced)
            );
            let advice =
                "--max-megapixels sets how many millions of pixels all photos together may have";
            problems.push(Problem::new(Severity::Note, what, advice));
        }
        if self.masks_inverted {
            let what = "masks are white where the object is not: they were inverted";
            let advice = "check the picture of a mask if that is wrong";
            problems.push(Problem::new(Severity::Warning, what, advice));
        }
        problems.extend(of_views(
            Severity::Note,
            cut_out,
            "the environment is not visible: the photos are cut out along the object",
            "light is learned from reflections alone",
        ));
        problems
    }
}

/// What one frame gave.
struct LoadedView {
    view: View,
    rescaled: bool,
    /// How the photo was turned, if it was.
    turned: Option<Orientation>,
    /// Sizes before and after, where it was reduced to fit into memory.
    reduced: Option<[(u32, u32); 2]>,
    mask_file_missing: bool,
    cut_out: bool,
}

/// Reads the frames in parallel, reduces their photos and calls `on_done` after each.
pub(in crate::data) fn load_views(
    frames: &[Frame],
    reduction: Reduction,
    on_done: &(dyn Fn() + Sync),
) -> LoadedViews {
    let gate = DecodeGate::default();
    let results: Vec<Result<LoadedView, DataError>> = frames
        .par_iter()
        .map(|frame| {
            let decoding = gate.enter(decoding_cost(frame));
            let result = load_view(frame, reduction);
            drop(decoding);
            on_done();
            result
        })
        .collect();
    let mut findings = Findings::default();
    let views = results.into_iter().map(|result| findings.note(result));
    let mut views: Vec<Option<View>> = views.collect();
    findings.masks_inverted = invert_masks_if_meant(&mut views, frames);
    LoadedViews { views, findings }
}

/// Inverts masks from files when they are white all around and less so inside: photos of an object
/// show the background along their borders. Says whether it did.
fn invert_masks_if_meant(views: &mut [Option<View>], frames: &[Frame]) -> bool {
    /// Mean coverage of the border from which masks count as inverted, and by how much that of the
    /// whole picture must be lower.
    const BORDER: f32 = 0.9;
    const LOWER: f32 = 0.03;
    let of_files: Vec<&mut Mask> = views
        .iter_mut()
        .zip(frames)
        .filter(|(_, frame)| frame.mask.is_some())
        .filter_map(|(view, _)| view.as_mut()?.mask.as_mut())
        .collect();
    let n = of_files.len().max(1) as f32;
    let border = of_files.iter().map(|mask| border_share(mask)).sum::<f32>() / n;
    let whole = of_files.iter().map(|mask| mask.mean()).sum::<f32>() / n;
    if border < BORDER || whole > border - LOWER {
        return false;
    }
    for mask in of_files {
        for coverage in &mut mask.coverage {
            *coverage = 255 - *coverage;
        }
    }
    true
}

/// The mean coverage of a mask's outermost pixels.
fn border_share(mask: &Mask) -> f32 {
    let (width, height) = (mask.width as usize, mask.height as usize);
    let rows = (0..width).flat_map(|x| [x, (height - 1) * width + x]);
    let columns = (0..height).flat_map(|y| [y * width, y * width + width - 1]);
    let sum: f32 = rows.chain(columns).map(|i| mask.share(i)).sum();
    sum / (2 * (width + height)) as f32
}

/// A frame's photo, turned as its camera says.
pub(in crate::data) fn upright_photo(frame: &Frame) -> Result<Photo, DataError> {
    Ok(decode(&frame.photo, frame.intrinsics.size)?.photo)
}

fn load_view(frame: &Frame, reduction: Reduction) -> Result<LoadedView, DataError> {
    let decoded = decode(&frame.photo, frame.intrinsics.size)?;
    let (width, height) = (decoded.photo.width(), decoded.photo.height());
    let (camera, rescaled) = frame.camera(width, height)?;
    let new_size = reduction.size(width, height);
    let mask_file = frame.mask.as_deref().filter(|path| path.is_file());
    let cut_out = decoded
        .alpha
        .as_ref()
        .is_some_and(|alpha| hides_one_color(&decoded.photo, alpha));
    let mask = match (mask_file, &frame.depth) {
        (Some(path), _) => Some(read_mask_sized(path, width, height, decoded.turned)?),
        (None, Some(depth)) if decoded.alpha.is_none() => mask_of_depth(depth, width, height)?,
        (None, _) => decoded.alpha.clone(),
    };
    let full = View {
        name: frame.name.clone(),
        file: frame.photo.clone(),
        split: Split::Train,
        camera,
        photo: decoded.photo,
        mask,
    };
    let is_reduced = new_size != (width, height);
    let shown = decoded.alpha.filter(|_| cut_out);
    Ok(LoadedView {
        view: if is_reduced {
            reduced_view(&full, shown.as_ref(), new_size)
        } else {
            full
        },
        reduced: is_reduced.then_some([(width, height), new_size]),
        rescaled,
        turned: decoded.turned,
        mask_file_missing: frame.mask.is_some() && mask_file.is_none(),
        cut_out,
    })
}

/// The views of frames of one split.
pub(in crate::data) fn of_split(
    split: Split,
    views: impl IntoIterator<Item = Option<View>>,
) -> Vec<View> {
    let views = views.into_iter().flatten();
    views.map(|view| View { split, ..view }).collect()
}

impl View {
    /// The view with a photo of at most `longest` pixels along its longer side.
    pub(crate) fn within(&self, longest: u32) -> Self {
        let small = self.camera.within(longest);
        reduced_view(self, None, (small.width, small.height))
    }
}

/// The view with a smaller photo. `shown`: where the photo is not transparent, if it is a cut-out.
fn reduced_view(full: &View, shown: Option<&Mask>, (width, height): (u32, u32)) -> View {
    View {
        name: full.name.clone(),
        file: full.file.clone(),
        split: full.split,
        camera: full.camera.resized(width, height),
        photo: shrunk_photo(&full.photo, shown, width, height),
        mask: full
            .mask
            .as_ref()
            .map(|mask| shrunk_mask(mask, width, height)),
    }
}

/// Reads a mask and brings it to the photo's size; errors where the aspect differs.
///
/// `orientation`: how the photo was turned; a mask that was made from the stored photo follows.
fn read_mask_sized(
    path: &Path,
    width: u32,
    height: u32,
    orientation: Option<Orientation>,
) -> Result<Mask, DataError> {
    let mask = read_mask(path)?;
    let picture = GrayImage::from_raw(mask.width, mask.height, mask.coverage);
    let picture = picture.ok_or_else(|| DataError::unusable(path, "the mask is incomplete"))?;
    let mut picture = DynamicImage::ImageLuma8(picture);
    if let Some(orientation) = orientation
        && (picture.width() > picture.height()) != (width > height)
    {
        picture.apply_orientation(orientation);
    }
    let (w, h) = (picture.width(), picture.height());
    let expected = w as f32 * height as f32 / h as f32;
    if (expected - width as f32).abs() > 0.01 * width as f32 + 1.0 {
        let problem = format!("the mask is {w} x {h}, its photo {width} x {height}");
        return Err(DataError::unusable(path, problem));
    }
    if (w, h) != (width, height) {
        picture = picture.resize_exact(width, height, FilterType::Triangle);
    }
    Ok(Mask {
        width,
        height,
        coverage: picture.into_luma8().into_raw(),
    })
}

/// The mask of a depth map that knows where nothing is, of the photo's size.
fn mask_of_depth(depth: &DepthFile, width: u32, height: u32) -> Result<Option<Mask>, DataError> {
    if depth.nothing_from.is_infinite() || !depth.path.is_file() {
        return Ok(None);
    }
    let (map_width, map_height, depths) = depth.read()?;
    if (map_width, map_height) != (width, height) {
        let problem =
            format!("the depth map is {map_width} x {map_height}, its photo {width} x {height}");
        return Err(DataError::unusable(&depth.path, problem));
    }
    let coverage = depths
        .iter()
        .map(|depth| if *depth > 0.0 { 255 } else { 0 });
    Ok(Some(Mask {
        width,
        height,
        coverage: coverage.collect(),
    }))
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

#[cfg(test)]
mod tests {
    use image::{ExtendedColorType, ImageEncoder as _, codecs::jpeg::JpegEncoder};

    use super::*;
    use crate::data::formats::test_formats::{
        SIZE, cameras, capture, folder, write_colmap_text, write_llff, write_photos,
    };
    use crate::data::{Dataset, LoadOptions, write_png_srgb};

    /// A JPEG whose left half is white, stored so that EXIF must turn it to get there.
    fn write_stored_on_its_side(path: &Path) {
        // A directory with one entry: orientation (0x112), one short, 6: turn it clockwise.
        let mut exif = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0".to_vec();
        exif.extend([0; 4]);
        let (width, height) = SIZE;
        // Stored with width and height exchanged; the upright left is the stored bottom.
        let stored: Vec<u8> = (0..width)
            .flat_map(|y| vec![if y >= width / 2 { 255 } else { 0 }; 3 * height as usize])
            .collect();
        let mut bytes = Vec::new();
        let mut encoder = JpegEncoder::new_with_quality(&mut bytes, 95);
        encoder.set_exif_metadata(exif).unwrap();
        encoder
            .write_image(&stored, height, width, ExtendedColorType::Rgb8)
            .unwrap();
        std::fs::write(path, bytes).unwrap();
    }

    #[test]
    fn a_photo_on_its_side_is_turned_when_its_camera_is_upright() {
        let folder = folder();
        write_llff(folder.path(), &cameras()[..2]);
        write_photos(&folder.path().join("images"), 1);
        write_stored_on_its_side(&folder.path().join("images/side.jpg"));
        let dataset = Dataset::load(folder.path(), &LoadOptions::default()).unwrap();
        let photo = &dataset.train[1].photo;
        assert_eq!((photo.width(), photo.height()), SIZE, "turned");
        assert!(
            photo.srgb(3)[0] > 0.9 && photo.srgb(36)[0] < 0.1,
            "white on the left"
        );
        let said = dataset
            .problems
            .iter()
            .any(|p| p.what.contains("on their side"));
        assert!(said, "{:?}", dataset.problems);
        // A model of the photos as stored takes them as stored.
        let (width, height) = SIZE;
        let text = format!("7 PINHOLE {height} {width} 50 50 15 20\n");
        write_colmap_text(folder.path(), &cameras()[..1]);
        std::fs::write(folder.path().join("cameras.txt"), text).unwrap();
        let image = "1 1 0 0 0 0 0 0 7 side.jpg\n\n";
        std::fs::write(folder.path().join("images.txt"), image).unwrap();
        let dataset = Dataset::load(folder.path(), &LoadOptions::default()).unwrap();
        assert_eq!(dataset.train[0].photo.width(), height, "as stored");
    }

    #[test]
    fn masks_that_are_white_around_the_object_are_inverted() {
        for is_inverted in [false, true] {
            let folder = capture("images", |root| write_llff(root, &cameras()));
            write_photos(&folder.path().join("masks"), 9);
            let (width, height) = SIZE;
            let pixels: Vec<[f32; 3]> = (0..width * height)
                .map(|i| {
                    let (x, y) = (i % width, i / width);
                    let is_object = (10..30).contains(&x) && (8..22).contains(&y);
                    [if is_object == is_inverted { 0.0 } else { 1.0 }; 3]
                })
                .collect();
            for i in 0..9 {
                let path = folder.path().join(format!("masks/{i:04}.png"));
                write_png_srgb(&path, width, height, &pixels).unwrap();
            }
            let dataset = Dataset::load(folder.path(), &LoadOptions::default()).unwrap();
            let mask = dataset.train[0].mask.as_ref().unwrap();
            let middle = (15 * width + 20) as usize;
            assert!(
                mask.is_object(middle) && !mask.is_object(0),
                "inverted: {is_inverted}"
            );
            let said = dataset.problems.iter().any(|p| p.what.contains("inverted"));
            assert_eq!(said, is_inverted, "{:?}", dataset.problems);
        }
    }
}
