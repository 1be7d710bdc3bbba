//! Selecting the object of a capture whose photos have no masks: a person points at it in a photo, sees its outline in all of
//! them, mends it with strokes, and trains.
//!
//! `state` is what is chosen and known, `changes` what commands do to it, `panel` and `view` what is drawn; `finder` searches on
//! a thread beside the window and training, and `pictures` shows what it finds.

pub mod changes;
mod finder;
mod outlined;
pub mod panel;
pub mod pictures;
pub mod state;
pub mod view;

pub use state::{ObjectCommand, ObjectState};
