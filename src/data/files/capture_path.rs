//! Paths that a capture's files declare: kept inside the capture, extensions completed.
//!
//! What a file *declares* must lie below the capture's folder. Links in the folder are followed wherever they lead, as
//! captures are often linked together from other disks; [`leads_out`] detects this, so that it can be reported.

use std::ffi::OsStr;
use std::io::{ErrorKind, Read as _};
use std::path::{Component, Path, PathBuf};

use serde::de::DeserializeOwned;

use crate::data::DataError;

/// Extensions of photos and masks, lower case, in the order in which they are tried.
pub(in crate::data) const PICTURE_EXTENSIONS: [&str; 5] = ["png", "jpg", "jpeg", "exr", "hdr"];

/// Most files looked at in a folder: a capture of 10,000 photos passes, a whole disk does not.
const MAX_FILES: usize = 200_000;

/// The file below `folder` that a declared relative path means; it may climb `max_climb` folders.
///
/// Errors, as the end of a sentence, for absolute paths, drive letters and paths that lead out.
pub(in crate::data) fn path_below(
    folder: &Path,
    declared: &str,
    max_climb: usize,
) -> Result<PathBuf, String> {
    let portable = declared.replace('\\', "/");
    let mut below: Vec<&OsStr> = Vec::new();
    let mut climb = 0;
    for component in Path::new(&portable).components() {
        match component {
            Component::Normal(part) => below.push(part),
            Component::CurDir => (),
            Component::ParentDir => {
                if below.pop().is_none() {
                    climb += 1;
                }
            }
            Component::RootDir | Component::Prefix(_) => {
                return Err(format!("\"{declared}\" is an absolute path"));
            }
        }
    }
    // Drive letters are prefixes on Windows only; refuse them everywhere.
    let has_drive = portable.as_bytes().get(1) == Some(&b':');
    if below.is_empty() || has_drive || portable.contains('\0') {
        return Err(format!("\"{declared}\" is not a relative file path"));
    }
    if climb > max_climb {
        return Err(format!(
            "\"{declared}\" leads out of the capture's folder; photos must lie below it"
        ));
    }
    let mut path = folder.to_owned();
    path.extend(std::iter::repeat_n("..", climb));
    path.extend(below);
    Ok(path)
}

/// `path`, or where that does not exist, `path` with a picture's extension added that does.
pub(in crate::data) fn with_extension(path: PathBuf) -> PathBuf {
    if path.is_file() {
        return path;
    }
    first_extended(&path, &PICTURE_EXTENSIONS).unwrap_or(path)
}

/// The first of the files `path` with one of these extensions added that exists.
pub(in crate::data) fn first_extended(path: &Path, extensions: &[&str]) -> Option<PathBuf> {
    let mut files = extensions.iter().map(|extension| {
        // Not `with_extension`: a name may hold dots.
        let mut name = path.as_os_str().to_owned();
        name.push(".");
        name.push(extension);
        PathBuf::from(name)
    });
    files.find(|file| file.is_file())
}

/// Whether links on the way make a path end outside `root`.
pub(in crate::data) fn leads_out(root: &Path, path: &Path) -> bool {
    let root = if root.as_os_str().is_empty() {
        Path::new(".")
    } else {
        root
    };
    match (root.canonicalize(), path.canonicalize()) {
        (Ok(root), Ok(path)) => !path.starts_with(root),
        _ => false,
    }
}

/// The first of these files of `folder` that exists.
pub(in crate::data) fn first_file(folder: &Path, names: &[&str]) -> Option<PathBuf> {
    let mut files = names.iter().map(|name| folder.join(name));
    files.find(|file| file.is_file())
}

/// The first of these folders in `folder` that exists.
pub(in crate::data) fn first_folder(folder: &Path, names: &[&str]) -> Option<PathBuf> {
    let mut folders = names.iter().map(|name| folder.join(name));
    folders.find(|folder| folder.is_dir())
}

/// What is in a folder and wanted, sorted by name.
pub(in crate::data) fn list_folder(
    folder: &Path,
    is_wanted: impl Fn(&Path) -> bool,
) -> Result<Vec<PathBuf>, DataError> {
    let io = |e| DataError::io(folder, e);
    let mut wanted = Vec::new();
    for (i, entry) in folder.read_dir().map_err(io)?.enumerate() {
        if i == MAX_FILES {
            let problem = format!("more than {MAX_FILES} files in the folder");
            return Err(DataError::unusable(folder, problem));
        }
        let path = entry.map_err(io)?.path();
        if is_wanted(&path) {
            wanted.push(path);
        }
    }
    wanted.sort();
    Ok(wanted)
}

/// The folder of a file.
pub(in crate::data) fn folder_of(file: &Path) -> &Path {
    file.parent().unwrap_or_else(|| Path::new(""))
}

/// Reads a JSON file of at most `max_bytes`.
pub(in crate::data) fn read_json<T: DeserializeOwned>(
    path: &Path,
    max_bytes: u64,
) -> Result<T, DataError> {
    let text = read_text(path, max_bytes)?;
    serde_json::from_str(&text).map_err(|source| DataError::Json {
        path: path.to_owned(),
        source,
    })
}

/// Reads a text file of at most `max_bytes`.
pub(in crate::data) fn read_text(path: &Path, max_bytes: u64) -> Result<String, DataError> {
    let text = String::from_utf8(read_bytes(path, max_bytes)?);
    text.map_err(|e| DataError::io(path, std::io::Error::new(ErrorKind::InvalidData, e)))
}

/// Reads a file of at most `max_bytes`.
pub(in crate::data) fn read_bytes(path: &Path, max_bytes: u64) -> Result<Vec<u8>, DataError> {
    let io = |e| DataError::io(path, e);
    let file = std::fs::File::open(path).map_err(io)?;
    let mut bytes = Vec::new();
    // Files can grow while they are read; what arrives counts, not the size that was said.
    file.take(max_bytes + 1)
        .read_to_end(&mut bytes)
        .map_err(io)?;
    if bytes.len() as u64 > max_bytes {
        let problem = match max_bytes >> 20 {
            0 => format!("larger than {} KiB", max_bytes >> 10),
            mib => format!("larger than {mib} MiB"),
        };
        return Err(DataError::field(path, "size", problem));
    }
    Ok(bytes)
}

/// Whether a file's extension is that of a picture.
pub(in crate::data) fn is_picture(path: &Path) -> bool {
    let mut known = PICTURE_EXTENSIONS.iter();
    known.any(|extension| has_extension(path, extension))
}

/// Whether a file has this extension, in upper or lower case.
pub(in crate::data) fn has_extension(path: &Path, wanted: &str) -> bool {
    let extension = path.extension();
    extension.is_some_and(|extension| extension.eq_ignore_ascii_case(wanted))
}

/// The number at the end of a file's stem: 12 for `rgb_0012.png`.
pub(in crate::data) fn trailing_number(path: &Path) -> Option<u64> {
    let stem = path.file_stem()?.to_str()?;
    let digits = stem.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    stem[digits..].parse().ok()
}
