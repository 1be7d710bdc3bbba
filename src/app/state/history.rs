//! Undo and redo of edits, of the environment and how it is shown, of what is compared, and of the camera's jumps.
//!
//! What is kept is a plain value without indices, compared before and after every command and once a
//! frame. Changes that follow each other at once, as while a slider is dragged, are one step. The
//! camera is not part of it, or every turn of it would be a step; its jumps are.

use std::path::PathBuf;

use egui::util::undoer::{Settings, Undoer};
use glam::Vec3;

use super::look::StoredLook;
use crate::app::viewport::camera_control::Viewpoint;
use crate::render::{Background, ToneMap};

/// Changes are one step unless nothing changes for this long, in seconds.
const SETTLE_SECS: f32 = 0.5;
/// Steps kept.
const MAX_STEPS: usize = 200;

/// What a person asks of the history.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HistoryCommand {
    /// One step back.
    Undo,
    /// One step forth again.
    Redo,
}

/// What a step brings back.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::app) struct Moment {
    pub(in crate::app) look: StoredLook,
    /// B, once there is one.
    pub(in crate::app) kept: Option<StoredLook>,
    pub(in crate::app) background: Background,
    pub(in crate::app) display_ev: f32,
    pub(in crate::app) tone_map: ToneMap,
    /// Files taken off the list of environments.
    pub(in crate::app) removed: Vec<PathBuf>,
    /// Jumps of the camera so far.
    pub(in crate::app) n_jumps: usize,
}

/// Where the camera is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::app) struct Place {
    pub(in crate::app) viewpoint: Viewpoint,
    pub(in crate::app) up: Vec3,
    pub(in crate::app) at_view: Option<usize>,
}

/// The steps back and forth.
#[derive(Clone, Debug)]
pub struct History {
    pub(in crate::app) undoer: Undoer<Moment>,
    /// From where to where the camera jumped, oldest first.
    pub(in crate::app) jumps: Vec<[Place; 2]>,
    /// How many of them are behind the present.
    pub(in crate::app) n_jumps: usize,
}

impl Default for History {
    fn default() -> Self {
        let settings = Settings {
            max_undos: MAX_STEPS,
            stable_time: SETTLE_SECS,
            // However long a slider is dragged, it is one step.
            auto_save_interval: f32::INFINITY,
        };
        Self {
            undoer: Undoer::with_settings(settings),
            jumps: Vec::new(),
            n_jumps: 0,
        }
    }
}
