//! The panels: each draws the state and emits commands.

pub mod cameras;
pub mod environment;
pub mod help;
pub mod inspect;
pub mod log;
pub mod material;
pub mod menus;
pub mod palette;
pub mod path_dialog;
pub mod plots;
pub mod questions;
pub mod scope;
pub mod skips;
pub mod slice;
pub mod status;
pub mod toasts;
pub mod top_bar;
pub mod training;
pub mod widgets;

pub use cameras::cameras_ui;
pub use environment::environment_ui;
pub use help::help_ui;
pub use inspect::inspect_ui;
pub use log::log_ui;
pub use material::material_ui;
pub use menus::menus_ui;
pub use palette::palette_ui;
pub use path_dialog::path_dialog_ui;
pub use plots::plots_ui;
pub use questions::{leaving_question_ui, recovery_ui, stop_question_ui};
pub use scope::scope_ui;
pub use slice::slice_ui;
pub use status::status_ui;
pub use toasts::toasts_ui;
pub use top_bar::top_bar_ui;
pub use training::training_ui;
