//! What a run leaves behind: its folder, its diary, and the model at one step.

mod checkpoint;
pub mod run_folder;
pub mod run_log;
pub mod snapshot;
