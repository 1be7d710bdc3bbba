//! Small panoramas of environments: made one after the other on a thread of their own. Those of files are kept between
//! sessions in the user's cache folder by path, size and time of change, those of the library beside its environments.

use std::collections::HashSet;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crossbeam::channel::{Receiver, Sender, bounded};
use directories::ProjectDirs;

use crate::app::work::opener::ScreenPhoto;
use crate::app::work::threads;
use crate::data::Rgba8;
use crate::neif::Environment;
use crate::render::library::{self, Library, THUMBNAIL_WIDTH};

/// Paths that may wait; more are asked for again later.
const QUEUE: usize = 256;
/// Below the window, its preview and reading; above the trainer.
const NICE: i32 = 10;

/// What a small picture is of.
#[derive(Clone, Debug)]
pub(super) enum Subject {
    /// An environment in a file.
    File(PathBuf),
    /// One that is in no file, or is still being trained.
    Loaded(Arc<Environment>),
}

/// Where the small pictures of files are kept.
#[derive(Debug, Default)]
pub(super) struct Kept {
    /// The folder for those that this thread made; without it none is kept.
    cache: Option<PathBuf>,
    /// It has pictures of its own.
    library: Library,
}

/// Makes thumbnails of environments and collects them.
#[derive(Debug)]
pub(super) struct Thumbnails {
    wanted: Sender<Subject>,
    done: Receiver<(Subject, ScreenPhoto)>,
    asked: HashSet<PathBuf>,
}

impl Thumbnails {
    /// Starts the thread; `wake` is called after each picture.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub(super) fn new(kept: Kept, wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let (wanted, subjects) = bounded::<Subject>(QUEUE);
        let (sender, done) = bounded(QUEUE);
        let pool = threads::pool("neif-thumbnail", 1, NICE)?;
        let work = move || {
            for subject in subjects {
                let Some(photo) = pool.install(|| subject.photo(&kept)) else {
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
    fn photo(&self, kept: &Kept) -> Option<ScreenPhoto> {
        match self {
            Self::File(path) => kept
                .thumbnail(path)
                .inspect_err(|error| tracing::debug!("{}: no thumbnail: {error}", path.display()))
                .ok(),
            Self::Loaded(environment) => {
                Some(screen_photo(library::thumbnail(Arc::clone(environment))))
            }
        }
    }
}

impl Kept {
    /// In the system's folders; on a system without a home folder nowhere.
    pub(super) fn in_system() -> Self {
        let folders = ProjectDirs::from("", "", "neif");
        Self {
            cache: folders.map(|folders| folders.cache_dir().join("thumbnails")),
            library: Library::of_system(),
        }
    }

    /// The picture of a file, which is made and kept where there is none.
    fn thumbnail(&self, path: &Path) -> Result<ScreenPhoto, String> {
        let of_library = self.library.picture(path);
        if let Some(photo) = of_library.as_deref().and_then(read_kept) {
            return Ok(photo);
        }
        let kept = self.cache.as_deref();
        let kept = kept.map(|folder| cached_file(folder, path)).transpose();
        let kept = kept.map_err(|error| error.to_string())?;
        if let Some(photo) = kept.as_deref().and_then(read_kept) {
            return Ok(photo);
        }
        let environment = Environment::open(path).map_err(|error| error.to_string())?;
        let picture = library::thumbnail(Arc::new(environment));
        if let Some(kept) = kept
            && let Err(error) = keep(&kept, &picture)
        {
            tracing::debug!("{}: cannot keep a thumbnail: {error}", kept.display());
        }
        Ok(screen_photo(picture))
    }
}

/// The file in which the thumbnail of `path`, as it is now, is kept.
fn cached_file(folder: &Path, path: &Path) -> std::io::Result<PathBuf> {
    let metadata = std::fs::metadata(path)?;
    let mut hasher = DefaultHasher::new();
    let key = (std::path::absolute(path)?, metadata.len(), THUMBNAIL_WIDTH);
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

fn keep(file: &Path, picture: &Rgba8) -> Result<(), String> {
    let folder = file.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(|error| error.to_string())?;
    picture.write_png(file).map_err(|error| error.to_string())
}

fn screen_photo(picture: Rgba8) -> ScreenPhoto {
    ScreenPhoto {
        size: [picture.width as usize, picture.height as usize],
        pixels: picture.pixels,
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use glam::Vec3;

    use super::*;
    use crate::neif::Storage;
    use crate::render::library::{Record, sky};

    #[test]
    fn a_thumbnail_is_kept_until_its_file_changes() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.safetensors");
        let cache = folder.path().join("cache");
        let kept = Kept {
            cache: Some(cache.clone()),
            library: Library::default(),
        };
        sky([1.0, 0.2, 0.2], Vec3::Z)
            .save(&file, Storage::F32)
            .unwrap();
        let n_kept = || std::fs::read_dir(&cache).unwrap().count();
        let first = kept.thumbnail(&file).unwrap();
        assert_eq!(kept.thumbnail(&file).unwrap(), first);
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
        assert_ne!(kept.thumbnail(&file).unwrap(), first, "made anew");
        assert_eq!(n_kept(), 2);
    }

    #[test]
    fn the_library_s_own_picture_is_taken_where_there_is_one() {
        let folder = tempfile::tempdir().unwrap();
        let library = Library::new(Some(folder.path().to_owned()), None);
        let environment = Arc::new(sky([1.0, 0.2, 0.2], Vec3::Z));
        let entry = library
            .add(&environment, Storage::F32, Record::default())
            .unwrap();
        // The light itself is not read for it.
        let file = std::fs::File::options()
            .write(true)
            .open(&entry.file)
            .unwrap();
        let changed = file.metadata().and_then(|of| of.modified()).unwrap();
        file.set_len(9)
            .and_then(|()| file.set_modified(changed))
            .unwrap();
        let kept = Kept {
            cache: None,
            library,
        };
        let expected = screen_photo(library::thumbnail(environment));
        assert_eq!(kept.thumbnail(&entry.file), Ok(expected));
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
        let mut thumbnails = Thumbnails::new(Kept::default(), wake).unwrap();
        thumbnails.ask(&bad);
        thumbnails.ask(&good);
        thumbnails.ask(&good);
        woken.recv_timeout(Duration::from_mins(1)).unwrap();
        let made = thumbnails.next().map(|(subject, _)| subject);
        assert!(matches!(made, Some(Subject::File(path)) if path == good));
        assert!(thumbnails.next().is_none(), "asked twice, made once");
    }
}
