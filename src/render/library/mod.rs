//! The library: environments in a folder of their own, at hand for every run, with those that come with the program.
//!
//! An environment is `NAME.safetensors` (the environment file), `NAME.toml` ([`Record`]: where it came from, and what may
//! be done with it) and `NAME.png` (what its middle sees). `names` says what files may be called, `thumbnail` makes the
//! picture, `record` and `entry` are what the folder holds, `folder` lists, adds and removes.

mod entry;
mod error;
mod folder;
mod names;
mod record;
mod thumbnail;

pub use entry::Entry;
pub use error::LibraryError;
pub use folder::Library;
pub use names::environment_name;
pub use record::Record;
pub use thumbnail::{THUMBNAIL_WIDTH, thumbnail};

#[cfg(test)]
pub(crate) use thumbnail::tests::sky;
