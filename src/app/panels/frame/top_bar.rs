//! The bar at the top: menus, undo, what is open, help.

use egui::containers::menu::MenuBar;
use egui::style::StyleModifier;
use egui::{Align, Button, Layout, RichText, Role, Ui, WidgetInfo};

use super::menus::menus_ui;
use crate::app::changes::history::{can_redo, can_undo};
use crate::app::panels::side::export::running_export_ui;
use crate::app::panels::widgets::{on_click, weak};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::history::HistoryCommand;
use crate::app::state::source::Source;

/// Draws the bar.
pub fn top_bar_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    // The menu style would take the frames off all buttons of the bar.
    let bar = MenuBar::new().style(StyleModifier::default());
    bar.ui(ui, |ui| {
        menus_ui(ui, state, commands);
        ui.separator();
        history_ui(ui, state, commands);
        ui.separator();
        running_export_ui(ui, state, commands);
        source_ui(ui, state);
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            let help = ui.button("Help").on_hover_text("Keys and mouse (?)");
            on_click(&help, Command::ToggleHelp, commands);
        });
    });
}

fn history_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let buttons = [
        ("↺", "Undo", can_undo(state), HistoryCommand::Undo),
        ("↻", "Redo", can_redo(state), HistoryCommand::Redo),
    ];
    for (sign, name, is_enabled, command) in buttons {
        let button = ui.add_enabled(is_enabled, Button::new(RichText::new(sign).monospace()));
        button.widget_info(|| WidgetInfo::labeled(Role::Button, is_enabled, name));
        let button = button.on_hover_text(name);
        on_click(&button, Command::History(command), commands);
    }
}

fn source_ui(ui: &mut Ui, state: &AppState) {
    let name = ui.label(RichText::new(state.source.name()).strong());
    if let Some(path) = state.source.path() {
        name.on_hover_text(path.display().to_string());
    }
    let kind = match state.source {
        Source::Nothing | Source::Demo(_) => return,
        Source::Capture(_) => "capture",
        Source::Run(_) => "saved run",
        Source::Environment(_) => "environment",
    };
    ui.label(weak(ui, kind));
}
