//! What a run leaves behind: its `run_folder` with the diary `run_log`, and the model at one step, a `snapshot`.

pub mod run_folder;
pub mod run_log;
pub mod snapshot;
