//! How the environment is seen, grabbed and compared: the part of the window's state beside the edits themselves.

pub(super) mod anchor;
pub(super) mod gallery_pictures;
pub mod gizmo;
pub(super) mod gizmo_ui;
mod lines;
pub(super) mod lines_ui;
pub(super) mod preview_side;
pub(super) mod split_ui;
pub(super) mod standing;
mod thumbnails;

use std::collections::BTreeSet;

use gizmo::{Grab, Handle};
use glam::Vec2;

use super::state::look::Look;
use crate::render::{Background, ToneMap};

/// Largest exposure of the picture either way, stops.
pub const LARGEST_DISPLAY_EV: f32 = 10.0;

/// A scan of which an environment is being made.
#[derive(Clone, Debug, PartialEq)]
pub struct Import {
    /// The environment, by its index on the list.
    pub environment: usize,
    /// What is being done, for people.
    pub what: String,
    /// How much of it is done, 0 to 1.
    pub fraction: f32,
}

/// What is chosen of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightingState {
    /// What stands behind the object.
    pub background: Background,
    /// Exposure of the picture, stops; the light stays.
    pub display_ev: f32,
    /// How light brighter than white is shown.
    pub tone_map: ToneMap,
    /// Whether the environment can be grabbed in the picture.
    pub is_gizmo_shown: bool,
    /// Whether a press in the picture sets the object down there.
    pub is_setting_down: bool,
    /// The handle that is held.
    pub grab: Option<Grab>,
    /// Whether axes and bounds are drawn.
    pub are_lines_shown: bool,
    /// The line between A and B, 0 (left) to 1 (right) of the viewport; none shows A alone.
    pub split: Option<f32>,
    /// B: the look that is kept to compare with.
    pub kept: Option<Look>,
    /// Environments taken off the list, by index: a removed one keeps its index, so that looks stay valid.
    pub removed: BTreeSet<usize>,
    /// Scans of which environments are being made.
    pub imports: Vec<Import>,
}

/// What may happen to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightingCommand {
    /// Choose what stands behind the object.
    SetBackground(Background),
    /// Expose the picture, in stops.
    SetDisplayEv(f32),
    /// Choose how light brighter than white is shown.
    SetToneMap(ToneMap),
    /// Show or hide the gizmo.
    ToggleGizmo,
    /// Begin or end setting the object down in the picture.
    ToggleSettingDown,
    /// Move environment and camera so that the object stands on what is seen at a pixel, where the picture stays still.
    SetDown {
        /// From the top left.
        at: Vec2,
        /// Width and height of the window in pixels.
        window: (u32, u32),
    },
    /// Take hold of a handle.
    Grab {
        /// Which.
        handle: Handle,
        /// Where, in pixels of the window from the top left.
        at: Vec2,
        /// Width and height in pixels.
        window: (u32, u32),
        /// Length of an arrow in pixels.
        arrow_px: f32,
    },
    /// Pull the held handle to a pixel.
    Drag {
        /// From the top left.
        at: Vec2,
        /// Whether in round steps.
        is_snapped: bool,
    },
    /// Let go of it.
    LetGo,
    /// Show or hide axes and bounds.
    ToggleLines,
    /// Take an environment off the list.
    Remove(usize),
    /// Show A and B beside each other, or A alone; what is seen is kept as B when there is none.
    ToggleSplit,
    /// Move the line between A and B.
    MoveSplit(f32),
    /// A becomes B and B becomes A.
    SwapSides,
    /// B becomes what A is.
    CopyToB,
}
