//! Headings that fold what is below them.

use egui::collapsing_header::paint_default_icon;
use egui::{
    Align, FontSelection, Layout, Role, Sense, TextWrapMode, Ui, WidgetInfo, WidgetText, vec2,
};

use crate::app::session::preferences::PreferencesCommand;
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::sections::Section;

/// Size of a main heading's text.
const SIZE: f32 = 15.0;

/// Draws a section's heading with what stands beside it at the right; returns whether what is below it is shown.
pub fn section_row(
    ui: &mut Ui,
    state: &AppState,
    section: Section,
    commands: &mut Vec<Command>,
    beside: impl FnOnce(&mut Ui, &mut Vec<Command>),
) -> bool {
    let row = ui.horizontal(|ui| {
        let is_open = section_heading(ui, state, section, commands);
        let layout = Layout::right_to_left(Align::Center);
        ui.with_layout(layout, |ui| beside(ui, commands));
        is_open
    });
    row.inner
}

/// Draws a section's heading; returns whether what is below it is shown.
pub fn section_heading(
    ui: &mut Ui,
    state: &AppState,
    section: Section,
    commands: &mut Vec<Command>,
) -> bool {
    let is_open = !state.preferences.folded.contains(&section);
    let name: &str = section.into();
    let text = match section {
        Section::Skips | Section::Slice => egui::RichText::new(name),
        _ => egui::RichText::new(name).strong().size(SIZE),
    };
    let galley = WidgetText::from(text).into_galley(
        ui,
        Some(TextWrapMode::Extend),
        f32::INFINITY,
        FontSelection::Default,
    );
    let (icon, gap) = (ui.spacing().icon_width_inner, ui.spacing().icon_spacing);
    let height = ui.spacing().interact_size.y;
    let size = vec2(icon + gap + galley.size().x, height);
    let (rect, response) = ui.allocate_exact_size(size, Sense::click());
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, name));
    ui.ctx()
        .accesskit_node_builder(response.id, |node| node.set_expanded(is_open));
    let triangle =
        egui::Rect::from_center_size(rect.left_center() + vec2(0.5 * icon, 0.0), vec2(icon, icon));
    paint_default_icon(
        ui,
        if is_open { 1.0 } else { 0.0 },
        &response.clone().with_new_rect(triangle),
    );
    let color = ui.style().interact(&response).text_color();
    let at = rect.right_center() - vec2(galley.size().x, 0.5 * galley.size().y);
    ui.painter().galley(at, galley, color);
    if response.clicked() {
        let fold = PreferencesCommand::Fold(section);
        commands.push(Command::Preferences(fold));
    }
    is_open
}
