//! What a run leaves behind: its `run_folder` with the diary `run_log` and the `checkpoint`, and the model at one step, a
//! `snapshot`.

mod checkpoint;
pub mod run_folder;
pub mod run_log;
pub mod snapshot;
