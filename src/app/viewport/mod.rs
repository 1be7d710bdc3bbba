//! The picture in the middle of the window, and what the mouse does there.
//!
//! `canvas` draws it, with words and bars of `overlay`; `camera_control`, `fly` and `environment_control` are what the mouse moves.

pub mod camera_control;
pub mod canvas;
pub mod compare_view;
pub mod environment_control;
pub mod fly;
mod frustums;
mod layer_bar;
pub mod overlay;
pub(super) mod screen;
pub(super) mod texture;
