//! What the window shows and what may happen to it: plain values, no threads, no files.
//!
//! `app_state` is all of it, each other file a part; every change is a `command`, which [`super::changes`] applies.

pub mod app_state;
pub mod command;
pub mod export;
pub mod history;
pub mod look;
pub mod messages;
pub mod palette;
pub mod sections;
pub mod source;
pub mod training_log;
pub mod training_state;
pub mod watch;
