//! Files that are written whole or not at all.

use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::path::Path;

use tempfile::NamedTempFile;

/// Writes `path` through `write`: into a temporary file in the same folder, flushed to disk, then
/// renamed over `path`. On any error `path` is as it was before.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>,
) -> io::Result<()> {
    let mut file = temporary_beside(path, ".part")?;
    {
        let mut buffered = BufWriter::new(file.as_file_mut());
        write(&mut buffered)?;
        buffered.flush()?;
    }
    rename_over(file, path)
}

/// A file in the folder of `path` that is gone when dropped; its name ends in `suffix`.
pub(super) fn temporary_beside(path: &Path, suffix: &str) -> io::Result<NamedTempFile> {
    temporary(suffix, 0o666).tempfile_in(folder_of(path))
}

/// What makes temporary files or folders. They are private by default, but what is written should be as open as any other.
#[cfg_attr(not(unix), expect(unused_variables, reason = "others have no modes"))]
pub(super) fn temporary(suffix: &str, unix_mode: u32) -> tempfile::Builder<'static, '_> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".neif-").suffix(suffix);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        builder.permissions(std::fs::Permissions::from_mode(unix_mode));
    }
    builder
}

/// Gives a temporary file, flushed to disk, its name.
pub(super) fn rename_over(file: NamedTempFile, path: &Path) -> io::Result<()> {
    file.as_file().sync_all()?;
    file.persist(path).map_err(|failure| failure.error)?;
    sync_folder(folder_of(path));
    Ok(())
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Makes the rename itself durable. Not all file systems allow it, and the file is whole either
/// way, so a refusal is not an error.
fn sync_folder(folder: &Path) {
    if let Ok(folder) = File::open(folder) {
        drop(folder.sync_all());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_litter() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_atomically(&path, |w| w.write_all(b"old")).unwrap();
        let failure = write_atomically(&path, |w| {
            w.write_all(b"half of the new")?;
            Err(io::Error::other("disk full"))
        });
        assert!(failure.is_err(), "the error is passed on");
        assert_eq!(std::fs::read(&path).unwrap(), b"old", "contents");
        assert_eq!(
            folder.path().read_dir().unwrap().count(),
            1,
            "only the file"
        );
    }

    #[test]
    fn a_new_write_replaces_the_old_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_atomically(&path, |w| w.write_all(b"old")).unwrap();
        write_atomically(&path, |w| w.write_all(b"new")).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new", "contents");
    }
}
