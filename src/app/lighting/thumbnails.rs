//! Small panoramas of environments: made one after the other on a thread of their own. Those of files are kept between
//! sessions in the user's cache folder by path, size and time of change.

use std::collections::HashSet;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crossbeam::channel::{Receiver, Sender, bounded};
use directories::ProjectDirs;
use glam::Vec3;

use crate::app::work::opener::ScreenPhoto;
use crate::app::work::threads;
use crate::color::luminance;
use crate::data::write_atomically;
use crate::neif::Environment;
use crate::neif::light::display::Display;
use crate::render::{PanoramaView, Scene, panorama_of};

/// Pixels per row; half as many rows.
const WIDTH: u32 = 176;
/// Paths that may wait; more are asked for again later.
const QUEUE: usize = 256;
/// Below the window, its preview and reading; above the trainer.
const NICE: i32 = 10;
/// What the median luminance becomes, so that pictures of any exposure can be distinguished.
const MEDIAN: f32 = 0.2;
/// Most that a picture is brightened or darkened by, as a factor.
const MOST_GAIN: f32 = 64.0;

/// What a small picture is of.
#[derive(Clone, Debug)]
pub(super) enum Subject {
    /// An environment in a file.
    File(PathBuf),
    /// One that is in no file, or is still being trained.
    Loaded(Arc<Environment>),
}

/// Makes thumbnails of environments and collects them.
#[derive(Debug)]
pub(super) struct Thumbnails {
    wanted: Sender<Subject>,
    done: Receiver<(Subject, ScreenPhoto)>,
    asked: HashSet<PathBuf>,
}

impl Thumbnails {
    /// Starts the thread; `wake` is called after each picture. Without a folder nothing is kept.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub(super) fn new(
        folder: Option<PathBuf>,
        wake: impl Fn() + Send + 'static,
    ) -> std::io::Result<Self> {
        let (wanted, subjects) = bounded::<Subject>(QUEUE);
        let (sender, done) = bounded(QUEUE);
        let pool = threads::pool("neif-thumbnail", 1, NICE)?;
        let work = move || {
            for subject in subjects {
                let Some(photo) = pool.install(|| subject.photo(folder.as_deref())) else {
                    continue;
                };
                // The window has closed when nobody takes pictures any more.
                if sender.send((subject, photo)).is_err() {
                    return;
                }
                wake();
            }
        };
        threads::spawn("neif-thumbnails", NICE, work)?;
        Ok(Self {
            wanted,
            done,
            asked: HashSet::new(),
        })
    }

    /// Asks for the picture of a file, once.
    pub(super) fn ask(&mut self, path: &Path) {
        let file = Subject::File(path.to_owned());
        if !self.asked.contains(path) && self.wanted.try_send(file).is_ok() {
            self.asked.insert(path.to_owned());
        }
    }

    /// Asks for the picture of what is loaded, every time; false where too much waits already.
    pub(super) fn ask_loaded(&self, environment: Arc<Environment>) -> bool {
        let loaded = Subject::Loaded(environment);
        self.wanted.try_send(loaded).is_ok()
    }

    /// The next finished picture with what it is of, if there is one.
    pub(super) fn next(&self) -> Option<(Subject, ScreenPhoto)> {
        self.done.try_recv().ok()
    }
}

impl Subject {
    /// Its picture; none where its file cannot be read.
    fn photo(&self, folder: Option<&Path>) -> Option<ScreenPhoto> {
        match self {
            Self::File(path) => thumbnail(path, folder)
                .inspect_err(|error| tracing::debug!("{}: no thumbnail: {error}", path.display()))
                .ok(),
            Self::Loaded(environment) => Some(picture_of(Arc::clone(environment))),
        }
    }
}

/// Where thumbnails are kept; none on a system without a home folder.
pub(super) fn cache_folder() -> Option<PathBuf> {
    ProjectDirs::from("", "", "neif").map(|dirs| dirs.cache_dir().join("thumbnails"))
}

fn thumbnail(path: &Path, folder: Option<&Path>) -> Result<ScreenPhoto, String> {
    let kept = folder.map(|folder| cached_file(folder, path)).transpose();
    let kept = kept.map_err(|error| error.to_string())?;
    if let Some(photo) = kept.as_deref().and_then(read_kept) {
        return Ok(photo);
    }
    let environment = Environment::open(path).map_err(|error| error.to_string())?;
    let photo = picture_of(Arc::new(environment));
    if let Some(kept) = kept
        && let Err(error) = keep(&kept, &photo)
    {
        tracing::debug!("{}: cannot keep a thumbnail: {error}", kept.display());
    }
    Ok(photo)
}

/// The file in which the thumbnail of `path`, as it is now, is kept.
fn cached_file(folder: &Path, path: &Path) -> std::io::Result<PathBuf> {
    let metadata = std::fs::metadata(path)?;
    let mut hasher = DefaultHasher::new();
    let key = (std::path::absolute(path)?, metadata.len(), WIDTH);
    (key, metadata.modified()?).hash(&mut hasher);
    Ok(folder.join(format!("{:016x}.png", hasher.finish())))
}

fn read_kept(file: &Path) -> Option<ScreenPhoto> {
    let image = image::open(file).ok()?.into_rgba8();
    let size = [image.width() as usize, image.height() as usize];
    let (pixels, _) = image.as_raw().as_chunks::<4>();
    Some(ScreenPhoto {
        size,
        pixels: pixels.to_vec(),
    })
}

fn keep(file: &Path, photo: &ScreenPhoto) -> std::io::Result<()> {
    let folder = file.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)?;
    let [width, height] = photo.size.map(|side| side as u32);
    let bytes = photo.pixels.as_flattened().to_vec();
    let image = image::RgbaImage::from_raw(width, height, bytes)
        .ok_or_else(|| std::io::Error::other("the picture has another size"))?;
    write_atomically(file, |into| {
        image
            .write_to(into, image::ImageFormat::Png)
            .map_err(std::io::Error::other)
    })
}

/// What the middle of the environment sees all around, its up axis upwards.
fn picture_of(environment: Arc<Environment>) -> ScreenPhoto {
    let view = PanoramaView {
        at: environment.inner_box().center(),
        up: environment.up(),
        roughness: 0.0,
        width: WIDTH,
    };
    let gamma = environment.gamma();
    let display = Display { gamma };
    let scene = Scene::new(None, environment);
    let seen = panorama_of(&scene, &view, &AtomicBool::new(false));
    // Nothing cancels it.
    let (width, height, pixels) = seen.map_or((0, 0, Vec::new()), |seen| {
        (seen.width, seen.height, seen.pixels)
    });
    let gain = gain(&pixels);
    let shown = |v: f32| (display.value((v * gain).max(0.0)).min(1.0) * 255.0 + 0.5) as u8;
    ScreenPhoto::thinned(width as usize, height as usize, |i| pixels[i].map(shown))
}

/// Brings the median luminance to [`MEDIAN`].
fn gain(pixels: &[[f32; 3]]) -> f32 {
    let mut light: Vec<f32> = pixels.iter().map(|p| luminance(Vec3::from(*p))).collect();
    light.sort_by(f32::total_cmp);
    let median = light.get(light.len() / 2).copied().unwrap_or(MEDIAN);
    // A black environment stays black.
    (MEDIAN / median.max(1e-9)).clamp(1.0 / MOST_GAIN, MOST_GAIN)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use glam::Quat;

    use super::*;
    use crate::neif::Storage;
    use crate::neif::distant::{DistantConfig, DistantLight};

    fn sky(color: [f32; 3], up: Vec3) -> Environment {
        let config = DistantConfig {
            width: 16,
            height: 8,
            world_from_picture: Quat::IDENTITY,
        };
        // The upper half (towards +z) has the colour, the lower one is black.
        let pixel = |i: usize| if i < 64 { color } else { [0.0; 3] };
        let pixels: Vec<f32> = (0..128).flat_map(pixel).collect();
        let light = DistantLight::new(config, &pixels).expect("a picture");
        Environment::of_distant("sky".to_owned(), up, light)
    }

    #[test]
    fn the_up_axis_is_up_in_a_thumbnail() {
        let top = |up| {
            let photo = picture_of(Arc::new(sky([3.0, 1.0, 1.0], up)));
            let row = photo.size[0];
            (
                photo.pixels[row * 4][0],
                photo.pixels[photo.pixels.len() - row * 4][0],
            )
        };
        let (above, below) = top(Vec3::Z);
        assert!(above > 100 && below < 50, "{above} {below}");
        let (above, below) = top(Vec3::NEG_Z);
        assert!(above < 50 && below > 100, "{above} {below}");
    }

    #[test]
    fn a_thumbnail_is_kept_until_its_file_changes() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.safetensors");
        let cache = folder.path().join("cache");
        sky([1.0, 0.2, 0.2], Vec3::Z)
            .save(&file, Storage::F32)
            .unwrap();
        let n_kept = || std::fs::read_dir(&cache).unwrap().count();
        let first = thumbnail(&file, Some(&cache)).unwrap();
        assert_eq!(thumbnail(&file, Some(&cache)).unwrap(), first);
        assert_eq!(n_kept(), 1, "taken from the cache");
        sky([0.2, 0.2, 1.0], Vec3::Z)
            .save(&file, Storage::F32)
            .unwrap();
        let later = std::time::SystemTime::now() + Duration::from_secs(10);
        std::fs::File::options()
            .append(true)
            .open(&file)
            .and_then(|file| file.set_modified(later))
            .unwrap();
        assert_ne!(thumbnail(&file, Some(&cache)).unwrap(), first, "made anew");
        assert_eq!(n_kept(), 2);
    }

    #[test]
    fn what_cannot_be_read_has_no_thumbnail_and_the_rest_comes() {
        let folder = tempfile::tempdir().unwrap();
        let good = folder.path().join("a.safetensors");
        let bad = folder.path().join("b.safetensors");
        sky([1.0; 3], Vec3::Z).save(&good, Storage::F32).unwrap();
        std::fs::write(&bad, "no environment").unwrap();
        let (sender, woken) = bounded(8);
        let wake = move || sender.send(()).unwrap();
        let mut thumbnails = Thumbnails::new(None, wake).unwrap();
        thumbnails.ask(&bad);
        thumbnails.ask(&good);
        thumbnails.ask(&good);
        woken.recv_timeout(Duration::from_mins(1)).unwrap();
        let made = thumbnails.next().map(|(subject, _)| subject);
        assert!(matches!(made, Some(Subject::File(path)) if path == good));
        assert!(thumbnails.next().is_none(), "asked twice, made once");
    }
}
