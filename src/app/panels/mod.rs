//! The panels: each draws the state and emits commands.

pub mod frame;
pub mod section;
pub mod side;
pub mod widgets;

pub use self::frame::help::help_ui;
pub use self::frame::menus::menus_ui;
pub use self::frame::palette::palette_ui;
pub use self::frame::path_dialog::path_dialog_ui;
pub use self::frame::questions::{leaving_question_ui, recovery_ui, stop_question_ui};
pub use self::frame::status::status_ui;
pub use self::frame::toasts::toasts_ui;
pub use self::frame::top_bar::top_bar_ui;
pub use self::frame::view_bar::view_bar_ui;
pub use self::side::cameras::cameras_ui;
pub use self::side::environment::environment_ui;
pub use self::side::export::{export_ui, running_export_ui};
pub use self::side::gallery::gallery_ui;
pub use self::side::inspect::inspect_ui;
pub use self::side::log::log_ui;
pub use self::side::material::material_ui;
pub use self::side::picture::picture_ui;
pub use self::side::plots::plots_ui;
pub use self::side::skips::skips_ui;
pub use self::side::slice::slice_ui;
pub use self::side::training::training_ui;
