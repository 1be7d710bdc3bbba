//! Facts about program and machine, to be sent along with a report of a fault.

use std::env::consts::{ARCH, OS};

use super::state::app_state::AppState;
use crate::neif::kernels;

/// Version, system, adapter, processor, what is open, how training goes, and all messages.
pub fn diagnostics(state: &AppState) -> String {
    let adapter = &state.adapter;
    let kind = if adapter.is_software {
        "software"
    } else {
        "graphics card"
    };
    let training = &state.training;
    let phase = training.phase.name();
    let n_cores = std::thread::available_parallelism().map_or(1, usize::from);
    let is_debug = if cfg!(debug_assertions) { "yes" } else { "no" };
    let lines = [
        format!("neif {}", env!("CARGO_PKG_VERSION")),
        format!("system: {OS} {ARCH}"),
        format!("adapter: {} ({kind}; {})", adapter.name, adapter.details),
        format!("preview drawn by: {:?}", state.drawn_by),
        format!("cores: {n_cores}"),
        format!("kernels: {}", kernels::instructions()),
        format!("debug build: {is_debug}"),
        format!("open: {:?}", state.source),
        format!("training: {phase}, step {}", training.progress.step),
        format!("text size: {}", state.preferences.zoom),
        "messages:".to_owned(),
        state.messages.to_text(),
    ];
    lines.join("\n")
}
