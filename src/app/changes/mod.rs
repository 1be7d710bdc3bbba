//! What each command does to the state, and what it asks of the world.
//!
//! `apply` is the way in; every other file is what the commands of that part do.

pub mod apply;
mod ask_path;
pub(super) mod choose;
pub mod export;
pub mod history;
mod inspect;
pub mod leaving;
pub(super) mod lighting;
pub(super) mod palette;
mod paths;
pub(super) mod preferences;
pub(super) mod saving;
mod stored;
mod watch;
