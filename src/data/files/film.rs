//! Moving pictures in one file: animated GIF, and MP4 by `ffmpeg` where that is installed.
//!
//! Writers pull their frames, so that a film is never in memory as a whole, and a frame that does not come ends the
//! film without a file.

use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};

use super::atomic::{rename_over, temporary_beside};
use crate::data::{DataError, Rgba8, write_atomically};

/// Most frames a second that a GIF can show: browsers take shorter delays for a tenth of a second.
pub const MAX_GIF_FPS: f32 = 50.0;
/// Alpha from which a pixel is opaque in a GIF, which knows no half-transparent ones.
const OPAQUE_ALPHA: u8 = 128;
/// Sampling of the colours of a GIF's palette: 1 is best, 30 fastest.
const PALETTE_SPEED: i32 = 10;

/// Size and speed of a film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmFormat {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Frames.
    pub n_frames: u32,
    /// Frames a second, positive.
    pub fps: f32,
}

/// How work that can be cancelled ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// The files are there.
    Finished,
    /// Nothing was written.
    Cancelled,
}

/// Gives the next frame, or nothing when it was cancelled.
pub type NextFrame<'a> = dyn FnMut() -> Option<Rgba8> + 'a;

/// Writes an endless animated GIF, each frame with a palette of its own; whole or not at all.
pub fn write_gif(
    path: &Path,
    format: FilmFormat,
    next: &mut NextFrame<'_>,
) -> Result<Ending, DataError> {
    let mut is_cancelled = false;
    let written = write_atomically(path, |file| {
        let (width, height) = (side_u16(format.width)?, side_u16(format.height)?);
        let mut encoder = gif::Encoder::new(file, width, height, &[]).map_err(io::Error::other)?;
        encoder
            .set_repeat(gif::Repeat::Infinite)
            .map_err(io::Error::other)?;
        for i in 0..format.n_frames {
            let Some(picture) = next() else {
                is_cancelled = true;
                return Err(io::Error::other("cancelled"));
            };
            let frame = gif_frame(picture, (width, height), delay_hundredths(i, format.fps));
            encoder.write_frame(&frame).map_err(io::Error::other)?;
        }
        encoder.into_inner().map(drop).map_err(io::Error::other)
    });
    match written {
        Ok(()) => Ok(Ending::Finished),
        Err(_) if is_cancelled => Ok(Ending::Cancelled),
        Err(e) => Err(DataError::io(path, e)),
    }
}

fn side_u16(side: u32) -> io::Result<u16> {
    u16::try_from(side).map_err(io::Error::other)
}

/// How long frame `i` is shown, in hundredths of a second; rounding does not add up.
fn delay_hundredths(i: u32, fps: f32) -> u16 {
    let time = |i: u32| (f64::from(i) * 100.0 / f64::from(fps)).round();
    (time(i + 1) - time(i)).clamp(2.0, 65535.0) as u16
}

fn gif_frame(mut picture: Rgba8, (width, height): (u16, u16), delay: u16) -> gif::Frame<'static> {
    let mut is_opaque = true;
    for pixel in &mut picture.pixels {
        if pixel[3] < OPAQUE_ALPHA {
            *pixel = [0; 4];
            is_opaque = false;
        }
    }
    let bytes = picture.pixels.as_flattened_mut();
    let frame = gif::Frame::from_rgba_speed(width, height, bytes, PALETTE_SPEED);
    let dispose = if is_opaque {
        gif::DisposalMethod::Keep
    } else {
        gif::DisposalMethod::Background
    };
    gif::Frame {
        delay,
        dispose,
        ..frame
    }
}

/// The `ffmpeg` program on the `PATH`, if there is one.
pub fn find_ffmpeg() -> Option<PathBuf> {
    let name = format!("ffmpeg{}", std::env::consts::EXE_SUFFIX);
    let folders = std::env::var_os("PATH")?;
    std::env::split_paths(&folders)
        .map(|folder| folder.join(&name))
        .find(|program| program.is_file())
}

/// Writes an MP4 (H.264) through the given `ffmpeg`; transparency is lost. Whole or not at all.
///
/// # Errors
/// When `ffmpeg` cannot be started or fails, with its words, or the file cannot be written.
pub fn write_mp4(
    path: &Path,
    ffmpeg: &Path,
    format: FilmFormat,
    next: &mut NextFrame<'_>,
) -> Result<Ending, DataError> {
    let unwritable = |e| DataError::io(path, e);
    let file = temporary_beside(path, ".part.mp4").map_err(unwritable)?;
    let mut child = start(ffmpeg, format, file.path()).map_err(|e| DataError::io(ffmpeg, e))?;
    let fed = match child.stdin.take() {
        Some(stdin) => feed(stdin, format, next),
        None => Err(io::Error::other("no way to hand over frames")),
    };
    if matches!(fed, Ok(Ending::Cancelled)) {
        end(&mut child);
        return Ok(Ending::Cancelled);
    }
    // Its words explain more than the broken pipe that follows from them.
    let output = child
        .wait_with_output()
        .map_err(|e| DataError::io(ffmpeg, e))?;
    if !output.status.success() {
        let words = String::from_utf8_lossy(&output.stderr);
        let problem = format!("{} failed: {}", ffmpeg.display(), words.trim());
        return Err(unwritable(io::Error::other(problem)));
    }
    fed.map_err(unwritable)?;
    rename_over(file, path).map_err(unwritable)?;
    Ok(Ending::Finished)
}

/// Starts `ffmpeg` waiting for frames of 8-bit RGB.
fn start(ffmpeg: &Path, format: FilmFormat, out: &Path) -> io::Result<Child> {
    // H.264 with halved colour needs even sides. Without the matrix, players guess the colours by the size.
    let filter = "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv";
    let size = format!("{}x{}", format.width, format.height);
    let fps = format.fps.to_string();
    Command::new(ffmpeg)
        .args(["-hide_banner", "-loglevel", "error", "-y"])
        .args(["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", &size])
        .args(["-framerate", &fps, "-i", "-", "-an", "-vf", filter])
        .args(["-c:v", "libx264", "-crf", "17", "-pix_fmt", "yuv420p"])
        .args(["-colorspace", "bt709", "-color_primaries", "bt709"])
        .args(["-color_trc", "bt709", "-movflags", "+faststart"])
        .arg(out)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
}

fn feed(mut stdin: ChildStdin, format: FilmFormat, next: &mut NextFrame<'_>) -> io::Result<Ending> {
    for _ in 0..format.n_frames {
        let Some(picture) = next() else {
            return Ok(Ending::Cancelled);
        };
        stdin.write_all(&picture.rgb())?;
    }
    Ok(Ending::Finished)
}

fn end(child: &mut Child) {
    if let Err(error) = child.kill().and_then(|()| child.wait()) {
        tracing::debug!("cannot end ffmpeg: {error}");
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{self, File};

    use super::*;
    use crate::data::test_asserts::assert_error;

    const FORMAT: FilmFormat = FilmFormat {
        width: 12,
        height: 8,
        n_frames: 5,
        fps: 24.0,
    };

    /// A red square on nothing, one pixel further right in each frame.
    fn frame(number: u32) -> Rgba8 {
        let is_red = |i: u32| (number..number + 4).contains(&(i % 12)) && i / 12 > 3;
        let pixel = |i| {
            if is_red(i) {
                [250, 10, 20, 255]
            } else {
                [0; 4]
            }
        };
        Rgba8 {
            width: 12,
            height: 8,
            pixels: (0..96).map(pixel).collect(),
        }
    }

    /// Gives frames until there are `n`.
    fn frames(n: u32) -> impl FnMut() -> Option<Rgba8> {
        let mut numbers = 0..n;
        move || numbers.next().map(frame)
    }

    #[test]
    fn a_gif_reads_back_with_its_frames_colours_and_transparency() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gif");
        let ending = write_gif(&path, FORMAT, &mut frames(5)).unwrap();
        assert_eq!(ending, Ending::Finished);
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut decoder = options.read_info(File::open(&path).unwrap()).unwrap();
        assert_eq!((decoder.width(), decoder.height()), (12, 8));
        let (mut n, mut time) = (0, 0);
        while let Some(read) = decoder.read_next_frame().unwrap() {
            for (i, (a, b)) in read
                .buffer
                .as_chunks::<4>()
                .0
                .iter()
                .zip(frame(n).pixels)
                .enumerate()
            {
                let off = a.iter().zip(b).map(|(a, b)| a.abs_diff(b)).max();
                assert!(off <= Some(4), "frame {n}, pixel {i}: {a:?} for {b:?}");
            }
            (n, time) = (n + 1, time + read.delay);
        }
        assert_eq!((n, time), (5, 21), "frames and hundredths of a second");
    }

    #[test]
    fn a_film_without_its_last_frame_leaves_the_old_file_and_no_litter() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gif");
        fs::write(&path, "old").unwrap();
        let ending = write_gif(&path, FORMAT, &mut frames(4)).unwrap();
        assert_eq!(ending, Ending::Cancelled);
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    /// A program that takes the place of `ffmpeg`.
    #[cfg(unix)]
    fn program(folder: &Path, script: &str) -> PathBuf {
        use std::os::unix::fs::PermissionsExt as _;
        let path = folder.join("ffmpeg");
        fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
        path
    }

    // One test, as a script that is being written by one thread cannot be started by another.
    #[cfg(unix)]
    #[test]
    fn ffmpeg_gets_all_frames_and_leaves_nothing_when_cancelled_or_failing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mp4");
        let ffmpeg = program(folder.path(), "for out; do :; done; cat > \"$out\"");
        let ending = write_mp4(&path, &ffmpeg, FORMAT, &mut frames(5)).unwrap();
        assert_eq!(ending, Ending::Finished);
        let expected: Vec<u8> = (0..5).flat_map(|n| frame(n).rgb()).collect();
        assert_eq!(fs::read(&path).unwrap(), expected);
        fs::remove_file(&path).unwrap();
        let ending = write_mp4(&path, &ffmpeg, FORMAT, &mut frames(3)).unwrap();
        assert_eq!(ending, Ending::Cancelled);
        let ffmpeg = program(folder.path(), "echo no such codec >&2; exit 1");
        let ending = write_mp4(&path, &ffmpeg, FORMAT, &mut frames(5));
        assert_error(ending, &["no such codec", "a.mp4"]);
        let n_files = fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(n_files, 1, "only the program");
    }
}
