//! What stands around and over the viewport: menus, bars, messages, questions.

pub mod help;
pub mod menus;
pub mod palette;
pub mod path_dialog;
pub mod questions;
pub mod status;
pub mod toasts;
pub mod top_bar;
pub mod view_bar;
