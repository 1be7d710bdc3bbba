//! Paths that a capture's files declare: kept inside the capture, extensions completed.

use std::ffi::OsStr;
use std::path::{Component, Path, PathBuf};

/// Extensions of photos and masks, lower case, in the order in which they are tried.
pub(super) const PICTURE_EXTENSIONS: [&str; 5] = ["png", "jpg", "jpeg", "exr", "hdr"];

/// The file below `folder` that a declared relative path means; it may climb `max_climb` folders.
///
/// Errors, as the end of a sentence, for absolute paths, drive letters and paths that lead out.
pub(super) fn path_below(
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
        return Err(format!("\"{declared}\" leads out of the capture"));
    }
    let mut path = folder.to_owned();
    path.extend(std::iter::repeat_n("..", climb));
    path.extend(below);
    Ok(path)
}

/// `path`, or where that does not exist, `path` with a picture's extension added that does.
pub(super) fn with_extension(path: PathBuf) -> PathBuf {
    if path.is_file() {
        return path;
    }
    let name = path.file_name().unwrap_or_default().to_os_string();
    PICTURE_EXTENSIONS
        .iter()
        .map(|extension| {
            let mut name = name.clone();
            name.push(".");
            name.push(extension);
            path.with_file_name(name)
        })
        .find(|candidate| candidate.is_file())
        .unwrap_or(path)
}

/// Whether a file's extension is that of a picture.
pub(super) fn is_picture(path: &Path) -> bool {
    path.extension().is_some_and(|extension| {
        PICTURE_EXTENSIONS
            .iter()
            .any(|known| extension.eq_ignore_ascii_case(known))
    })
}

/// The number at the end of a file's stem: 12 for `rgb_0012.png`.
pub(super) fn trailing_number(path: &Path) -> Option<u64> {
    let stem = path.file_stem()?.to_str()?;
    let digits = stem.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    stem[digits..].parse().ok()
}
