//! Taking pictures away as files: stills with or without the environment, series of them, and films. The window and the
//! command line write through this; what is cancelled leaves nothing behind.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use strum::{Display, EnumString, IntoStaticStr, VariantArray};

use super::parts::{Backdrop, Parts, PartsOptions, render_parts};
use crate::data::{
    DataError, Ending, FilmFormat, MAX_GIF_FPS, Rgba8, StagedFolder, find_ffmpeg,
    write_exr_channels, write_gif, write_mp4,
};
use crate::geometry::Camera;
use crate::neif::EnvironmentTransform;
use crate::render::irradiance::DiffuseLights;
use crate::render::named::unknown;
use crate::render::path::reference::ReferenceOptions;
use crate::render::scene::{Layer, Scene};

/// What kind of file pictures become; its name is the ending of the files' names.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Display, EnumString, IntoStaticStr, VariantArray,
)]
#[strum(serialize_all = "lowercase", parse_err_ty = String, parse_err_fn = unknown_kind)]
pub enum FileKind {
    /// 8 bits as shown on a screen, a file a picture and layer.
    #[default]
    Png,
    /// Linear light, a file a picture with all layers.
    Exr,
    /// One animated picture, endless.
    Gif,
    /// One film, by `ffmpeg`.
    Mp4,
}

impl FileKind {
    /// The ending of its files' names, also its name on the command line.
    pub fn extension(self) -> &'static str {
        self.into()
    }

    /// Whether all pictures go into one file.
    pub fn is_film(self) -> bool {
        matches!(self, Self::Gif | Self::Mp4)
    }
}

fn unknown_kind(text: &str) -> String {
    unknown::<FileKind>("format", text)
}

/// One picture of a series.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// File name without ending.
    pub name: String,
    /// From where.
    pub camera: Camera,
    /// Where the environment stands.
    pub transform: EnvironmentTransform,
}

/// Pictures to be written.
#[derive(Clone, Debug)]
pub struct Film {
    /// What is shown; its transform is each shot's.
    pub scene: Scene,
    /// The pictures, in order.
    pub shots: Vec<Shot>,
    /// What is shown of the scene.
    pub layers: Vec<Layer>,
    /// Whether the environment is in the pictures.
    pub backdrop: Backdrop,
    /// What kind of file.
    pub kind: FileKind,
    /// Pictures a second of a film.
    pub fps: f32,
    /// The object by thin rays, to compare with.
    pub reference: Option<ReferenceOptions>,
}

/// Where pictures go.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Destination {
    /// A folder, a file a picture named as the shots; made when missing.
    Folder(PathBuf),
    /// One file, its folder made when missing: a film, or the only picture.
    File(PathBuf),
}

impl Destination {
    /// The folder, and the name of the only file.
    fn parts(&self) -> Result<(&Path, Option<&OsStr>), FilmError> {
        match self {
            Self::Folder(folder) => Ok((folder, None)),
            Self::File(path) => {
                let name = path.file_name().ok_or_else(|| {
                    FilmError::Unusable(format!("{}: not the name of a file", path.display()))
                })?;
                let folder = path.parent().filter(|folder| *folder != Path::new(""));
                Ok((folder.unwrap_or_else(|| Path::new(".")), Some(name)))
            }
        }
    }
}

/// Why pictures were not written.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// What was asked for cannot be done; found out before anything is rendered.
    #[error("{0}")]
    Unusable(String),
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] DataError),
}

impl Film {
    /// Renders and writes everything, whole or not at all. `on_progress` gets 0..1, from several threads.
    ///
    /// # Errors
    /// When that kind of file cannot hold these pictures, when `ffmpeg` is missing, and when files cannot be written.
    pub fn write(
        &self,
        destination: &Destination,
        cancel: &AtomicBool,
        on_progress: &(dyn Fn(f32) + Sync),
    ) -> Result<Ending, FilmError> {
        let camera = self.check(destination)?;
        let mut renderer = Renderer {
            film: self,
            lights: DiffuseLights::default(),
            done: 0,
            cancel,
            on_progress,
        };
        let format = FilmFormat {
            width: camera.width,
            height: camera.height,
            n_frames: self.shots.len() as u32,
            fps: self.fps,
        };
        let (folder, name) = destination.parts()?;
        let staged = StagedFolder::new(folder)?;
        let path = staged.path().join(name.unwrap_or_default());
        let written = match (self.kind, name) {
            (FileKind::Gif, _) => write_gif(&path, format, &mut || renderer.next_frame()),
            (FileKind::Mp4, _) => {
                write_mp4(&path, &ffmpeg()?, format, &mut || renderer.next_frame())
            }
            (_, Some(_)) => renderer.write_stills(|_| path.clone()),
            (_, None) => renderer.write_stills(|name| path.join(name)),
        };
        match written {
            // Ctrl-C ends ffmpeg too, which then looks like its failure.
            Err(_) if cancel.load(Ordering::Relaxed) => Ok(Ending::Cancelled),
            Ok(Ending::Finished) => {
                staged.finish()?;
                Ok(Ending::Finished)
            }
            other => Ok(other?),
        }
    }

    /// Whether the files can be written, without rendering anything; the first camera.
    ///
    /// # Errors
    /// When that kind of file cannot hold these pictures, and when `ffmpeg` is missing.
    pub fn check(&self, destination: &Destination) -> Result<&Camera, FilmError> {
        let refuse = |why: &str| Err(FilmError::Unusable(why.to_owned()));
        let Some(Shot { camera, .. }) = self.shots.first() else {
            return refuse("there are no pictures to take");
        };
        if self.reference.is_some() && self.layers != [Layer::Final] {
            return refuse("thin rays make the final picture only; ask for no other layer");
        }
        let is_one_file = matches!(destination, Destination::File(_));
        if is_one_file && self.kind != FileKind::Exr && self.layers.len() != 1 {
            return refuse("a png, gif or mp4 file shows one layer; ask for one");
        }
        match self.kind {
            FileKind::Png | FileKind::Exr if is_one_file && self.shots.len() > 1 => {
                refuse("several pictures need a folder, not a file")
            }
            FileKind::Png | FileKind::Exr => Ok(camera),
            FileKind::Gif | FileKind::Mp4 if !is_one_file => {
                refuse("a film is one file, not a folder")
            }
            FileKind::Gif if self.fps > MAX_GIF_FPS => {
                refuse("a GIF has at most 50 pictures a second")
            }
            FileKind::Mp4 if self.backdrop == Backdrop::Transparent => {
                refuse("an MP4 knows no transparency; take png or gif, or leave the environment in")
            }
            FileKind::Gif => self.check_sizes().map(|()| camera),
            FileKind::Mp4 => {
                self.check_sizes()?;
                ffmpeg().map(|_| camera)
            }
        }
    }

    /// Whether all pictures are of one size.
    fn check_sizes(&self) -> Result<(), FilmError> {
        let size = |Shot { camera, .. }: &Shot| (camera.width, camera.height);
        let mut sizes = self.shots.iter().map(size);
        let first = sizes.next();
        match (first, sizes.find(|size| Some(*size) != first)) {
            (Some((a, b)), Some((c, d))) => Err(FilmError::Unusable(format!(
                "a film has pictures of one size, and these are {a}x{b} and {c}x{d}; ask for a size"
            ))),
            _ => Ok(()),
        }
    }
}

fn ffmpeg() -> Result<PathBuf, FilmError> {
    find_ffmpeg().ok_or_else(|| {
        FilmError::Unusable(
            "MP4 needs the program ffmpeg, which is not on the PATH; install the package `ffmpeg`, or take gif or png"
                .to_owned(),
        )
    })
}

/// Renders one shot after the other.
struct Renderer<'a> {
    film: &'a Film,
    /// What the light of one place of the environment has in common with that of the next.
    lights: DiffuseLights,
    done: usize,
    cancel: &'a AtomicBool,
    on_progress: &'a (dyn Fn(f32) + Sync),
}

impl Renderer<'_> {
    /// The next shot with the scene as it was lit.
    fn render_next(&mut self) -> Option<(Scene, Parts)> {
        let film = self.film;
        let shot = &film.shots[self.done];
        let mut scene = Scene {
            transform: shot.transform,
            ..film.scene.clone()
        };
        if film.layers.iter().any(|layer| layer.is_lit()) {
            scene = self.lights.fine(&scene, &film.layers, self.cancel)?;
        }
        let options = PartsOptions {
            backdrop: film.backdrop,
            reference: film.reference,
            ..PartsOptions::new(&film.layers)
        };
        let n = film.shots.len() as f32;
        let done = self.done as f32;
        let on_progress = |fraction: f32| (self.on_progress)((done + fraction) / n);
        let parts = render_parts(&scene, &shot.camera, &options, self.cancel, &on_progress)?;
        self.done += 1;
        Some((scene, parts))
    }

    /// The next shot of a film.
    fn next_frame(&mut self) -> Option<Rgba8> {
        let (scene, parts) = self.render_next()?;
        Some(parts.to_rgba8(&scene, self.film.layers[0]))
    }

    /// Writes the shots where `path_of` their files' names says.
    fn write_stills(&mut self, path_of: impl Fn(String) -> PathBuf) -> Result<Ending, DataError> {
        let film = self.film;
        for shot in &film.shots {
            let Some((scene, parts)) = self.render_next() else {
                return Ok(Ending::Cancelled);
            };
            if film.kind == FileKind::Exr {
                let path = path_of(format!("{}.exr", shot.name));
                write_exr_channels(&path, parts.width, parts.height, parts.exr_channels(&scene))?;
                continue;
            }
            for &layer in &film.layers {
                let path = path_of(png_name(&shot.name, layer));
                parts.to_rgba8(&scene, layer).write_png(&path)?;
            }
        }
        Ok(Ending::Finished)
    }
}

/// `NAME.png` for the final picture, `NAME_layer.png` for the others.
fn png_name(name: &str, layer: Layer) -> String {
    match layer {
        Layer::Final => format!("{name}.png"),
        other => format!("{name}_{other}.png"),
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{self, File};
    use std::sync::atomic::AtomicU32;

    use glam::Vec3;

    use super::*;
    use crate::render::output::turntable::{self, Spin};
    use crate::render::test_scene::{NEVER, camera, picture, scene};

    const SIZE: (u32, u32) = (24, 16);

    /// The environment turns in `n` steps.
    fn film(kind: FileKind, n: u32) -> Film {
        let (camera, first) = (camera(SIZE.0, SIZE.1), EnvironmentTransform::default());
        let axis = (Vec3::ZERO, Vec3::Z);
        Film {
            scene: scene(),
            shots: turntable::shots(Spin::Environment, &camera, &first, axis, n),
            layers: vec![Layer::Final],
            backdrop: Backdrop::Shown,
            kind,
            fps: 20.0,
            reference: None,
        }
    }

    fn destination(folder: &Path, kind: FileKind) -> Destination {
        if kind.is_film() {
            Destination::File(folder.join(format!("film.{kind}")))
        } else {
            Destination::Folder(folder.join("pictures"))
        }
    }

    fn write(film: &Film, destination: &Destination) -> Result<Ending, FilmError> {
        film.write(destination, &NEVER, &|_| {})
    }

    #[test]
    fn the_first_picture_of_a_turning_environment_is_the_still_picture() {
        let folder = tempfile::tempdir().unwrap();
        let film = film(FileKind::Png, 3);
        write(&film, &destination(folder.path(), FileKind::Png)).unwrap();
        let file = |i: u32| folder.path().join(format!("pictures/turn_{i:03}.png"));
        let read = |i| image::open(file(i)).unwrap().to_rgb8();
        let still = picture(&film.scene, &camera(SIZE.0, SIZE.1), Layer::Final);
        let code = |v: &f32| (v * 255.0).round() as u8;
        let codes: Vec<u8> = still.pixels.as_flattened().iter().map(code).collect();
        assert!(read(0).as_raw() == &codes, "the first picture differs");
        assert!(read(1) != read(0) && read(2) != read(1), "nothing turns");
    }

    #[test]
    fn a_gif_has_every_picture_at_its_size() {
        let folder = tempfile::tempdir().unwrap();
        let film = film(FileKind::Gif, 4);
        write(&film, &destination(folder.path(), FileKind::Gif)).unwrap();
        let file = File::open(folder.path().join("film.gif")).unwrap();
        let mut decoder = gif::DecodeOptions::new().read_info(file).unwrap();
        assert_eq!((decoder.width(), decoder.height()), (24, 16));
        let mut n = 0;
        while decoder.read_next_frame().unwrap().is_some() {
            n += 1;
        }
        assert_eq!(n, 4);
    }

    #[test]
    fn what_is_cancelled_half_way_leaves_nothing() {
        for kind in [FileKind::Png, FileKind::Exr, FileKind::Gif] {
            let folder = tempfile::tempdir().unwrap();
            let (cancel, percent) = (AtomicBool::new(false), AtomicU32::new(0));
            let on_progress = |fraction: f32| {
                let now = (fraction * 100.0) as u32;
                if percent.fetch_max(now, Ordering::Relaxed).max(now) > 50 {
                    cancel.store(true, Ordering::Relaxed);
                }
            };
            let destination = destination(folder.path(), kind);
            let ending = film(kind, 4).write(&destination, &cancel, &on_progress);
            assert_eq!(ending.unwrap(), Ending::Cancelled, "{kind}");
            let n_files = fs::read_dir(folder.path()).unwrap().count();
            assert_eq!(n_files, 0, "{kind} left something");
        }
    }

    #[test]
    fn what_a_file_cannot_hold_is_refused_before_anything_is_rendered() {
        let folder = tempfile::tempdir().unwrap();
        let mut sizes = film(FileKind::Gif, 2);
        sizes.shots[1].camera = camera(20, 20);
        let mut layers = film(FileKind::Gif, 2);
        layers.layers.push(Layer::Normal);
        let mut fast = film(FileKind::Gif, 2);
        fast.fps = 60.0;
        let mut see_through = film(FileKind::Mp4, 2);
        see_through.backdrop = Backdrop::Transparent;
        for (film, expected) in [
            (sizes, "24x16 and 20x20"),
            (layers, "one layer"),
            (fast, "50 pictures"),
            (see_through, "transparency"),
            (film(FileKind::Gif, 0), "no pictures"),
        ] {
            let error = write(&film, &destination(folder.path(), film.kind)).unwrap_err();
            assert!(matches!(error, FilmError::Unusable(_)), "{error}");
            assert!(error.to_string().contains(expected), "{error}");
        }
    }
}
