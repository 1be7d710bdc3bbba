//! The files of a `.sog`, in a zip archive or a folder, and the pictures among them.

use std::fs::File;
use std::io::{BufReader, Cursor, Read as _};
use std::path::{Path, PathBuf};

use image::codecs::webp::WebPDecoder;
use image::{DynamicImage, ImageDecoder as _, RgbaImage};
use zip::ZipArchive;

/// The file that describes the others.
pub(super) const META: &str = "meta.json";
/// Bytes that a file may have beyond its archive's length.
const MAX_SPARE_BYTES: u64 = 1 << 20;
/// Pixels that a picture may have beyond two a Gaussian.
const MAX_SPARE: u64 = 1 << 16;

/// Where the files are.
#[derive(Debug)]
pub(super) enum Files {
    /// With its length, bytes.
    Archive(ZipArchive<BufReader<File>>, u64),
    Folder(PathBuf),
}

impl Files {
    /// Opens an archive, or the folder of a `meta.json`.
    pub(super) fn open(path: &Path) -> Result<Self, String> {
        if path.file_name().is_some_and(|name| name == META) {
            return Ok(Self::Folder(path.with_file_name("")));
        }
        let text = |e: std::io::Error| e.to_string();
        let file = File::open(path).map_err(text)?;
        let n_bytes = file.metadata().map_err(text)?.len();
        let archive = ZipArchive::new(BufReader::new(file)).map_err(|e| e.to_string())?;
        Ok(Self::Archive(archive, n_bytes))
    }

    /// The bytes of a file, which must be fewer than so many.
    pub(super) fn read(&mut self, name: &str, most: u64) -> Result<Vec<u8>, String> {
        let mut bytes = Vec::new();
        let mut most = most;
        let read = match self {
            Self::Archive(archive, n_bytes) => {
                // Pictures are packed already: an archive that unpacks to much more only fills the memory.
                most = most.min(*n_bytes + MAX_SPARE_BYTES);
                let entry = archive.by_name(name).map_err(|e| format!("{name}: {e}"))?;
                entry.take(most).read_to_end(&mut bytes)
            }
            Self::Folder(folder) => {
                // Nothing outside the folder.
                let name = Path::new(name).file_name().unwrap_or_default();
                let file = File::open(folder.join(name));
                file.and_then(|file| file.take(most).read_to_end(&mut bytes))
            }
        };
        match read {
            Ok(n) if (n as u64) < most => Ok(bytes),
            Ok(_) => Err(format!("{name}: {most} bytes or more")),
            Err(e) => Err(format!("{name}: {e}")),
        }
    }

    /// A picture of at least so many pixels, and not many more.
    pub(super) fn picture(&mut self, name: &str, n: usize) -> Result<RgbaImage, String> {
        let n = n as u64;
        let bytes = self.read(name, u64::MAX)?;
        let wrong = |e| format!("{name}: {e}");
        let decoder = WebPDecoder::new(Cursor::new(bytes)).map_err(wrong)?;
        let (width, height) = decoder.dimensions();
        let n_pixels = u64::from(width) * u64::from(height);
        if n_pixels < n || n_pixels > 2 * n + MAX_SPARE {
            return Err(format!(
                "{name}: {width} × {height} pixels for {n} Gaussians"
            ));
        }
        Ok(DynamicImage::from_decoder(decoder)
            .map_err(wrong)?
            .into_rgba8())
    }
}
