//! What each command does to the state, and what it asks of the world.
//!
//! `apply` is the way in; every other file is what the commands of that part do.

pub mod apply;
pub mod ask_path;
pub mod choose;
pub mod export;
pub mod history;
pub mod inspect;
pub mod leaving;
pub mod lighting;
pub mod palette;
pub mod paths;
pub mod preferences;
pub mod saving;
mod stored;
pub mod watch;
