//! Files that are no photos: whole or not at all when written, checked when read.

pub(super) mod atomic;
pub(super) mod bundled;
pub(super) mod camera_file;
pub(super) mod capture_path;
pub(super) mod film;
pub(super) mod npy;
pub(super) mod pickle;
pub(crate) mod pickle_machine;
pub(super) mod staged_folder;
pub mod tensor_file;
