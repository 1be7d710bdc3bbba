//! Small controls that several panels use: rows with a name, a value and a way back.

use egui::{
    Align, Button, DragValue, Layout, Response, RichText, Role, Sense, Slider, Ui, WidgetInfo,
};
use glam::Vec3;
use std::ops::RangeInclusive;

use crate::app::state::command::Command;
use crate::app::theme;

/// Width of the names at the left of rows.
const NAME_WIDTH: f32 = 78.0;

/// A value with its limits and the value to go back to.
#[derive(Clone, Debug)]
pub struct Setting {
    /// The name, also for assistive technology.
    pub name: &'static str,
    /// Limits.
    pub range: RangeInclusive<f32>,
    /// What a double-click on the name, or the button, brings back.
    pub default: f32,
    /// Explained on hovering.
    pub hint: &'static str,
}

/// Says in the log, at its finest level, where a control is: its middle in physical pixels. The window is driven by it from
/// outside, by mouse, in its test.
pub fn log_place(ui: &Ui, name: &str, rect: egui::Rect) {
    let per_point = ui.ctx().pixels_per_point();
    let (center, size) = (rect.center() * per_point, rect.size() * per_point);
    tracing::trace!(
        name,
        x = center.x,
        y = center.y,
        width = size.x,
        height = size.y,
        "place"
    );
}

/// A slider row; true when the value was changed.
pub fn slider_row(ui: &mut Ui, setting: &Setting, value: &mut f32) -> bool {
    ui.horizontal(|ui| {
        let name = name_label(ui, setting.name).on_hover_text(setting.hint);
        let slider = Slider::new(value, setting.range.clone()).max_decimals(2);
        let slider = ui
            .add(slider)
            .labelled_by(name.id)
            .on_hover_text(setting.hint);
        log_place(ui, setting.name, slider.rect);
        let is_changed = slider.changed();
        is_changed | reset_ui(ui, &name, setting.name, value, setting.default)
    })
    .inner
}

/// What brings the default of a row back: a double-click on its label, or a button; true when it was.
fn reset_ui<T: PartialEq>(
    ui: &mut Ui,
    label: &Response,
    name: &str,
    value: &mut T,
    default: T,
) -> bool {
    let is_other = *value != default;
    let is_wanted = label.double_clicked() | reset_button(ui, name, is_other);
    if is_wanted && is_other {
        *value = default;
    }
    is_wanted && is_other
}

/// The name at the left of a row; it can be double-clicked.
pub fn name_label(ui: &mut Ui, name: &str) -> Response {
    let size = egui::vec2(NAME_WIDTH, ui.spacing().interact_size.y);
    let layout = Layout::left_to_right(Align::Center);
    ui.allocate_ui_with_layout(size, layout, |ui| {
        ui.set_min_width(NAME_WIDTH);
        ui.add(
            egui::Label::new(name)
                .sense(Sense::click())
                .selectable(false),
        )
    })
    .inner
}

/// A small button that brings a default back; dead while nothing is to bring back.
fn reset_button(ui: &mut Ui, what: &str, is_enabled: bool) -> bool {
    let button = ui.add_enabled(
        is_enabled,
        Button::new(RichText::new("↺").monospace().size(15.0)).frame(false),
    );
    let name = format!("Reset {}", what.to_lowercase());
    button.widget_info(|| WidgetInfo::labeled(Role::Button, is_enabled, &name));
    button.on_hover_text(name).clicked()
}

/// A row of three numbers that can be typed or dragged; true when one was changed.
pub fn vector_row(ui: &mut Ui, name: &str, value: &mut Vec3, speed: f64, suffix: &str) -> bool {
    numbers_row(ui, (name, ["X", "Y", "Z"]), value, Vec3::ZERO, |v| {
        DragValue::new(v)
            .speed(speed)
            .custom_formatter(|v, _| three_digits(v))
            .suffix(suffix.to_owned())
    })
}

/// A row of three factors, of red, green and blue; true when one was changed.
pub fn gain_row(ui: &mut Ui, name: &str, value: &mut Vec3) -> bool {
    numbers_row(ui, (name, ["R", "G", "B"]), value, Vec3::ONE, |v| {
        DragValue::new(v)
            .speed(0.005)
            .range(0.0..=100.0)
            .custom_formatter(|v, _| three_digits(v))
    })
}

/// At most two decimals, and fewer of numbers that would not fit beside two others.
fn three_digits(v: f64) -> String {
    let n_before = v.abs().max(1.0).log10() as usize;
    let n_after = 2_usize.saturating_sub(n_before);
    let text = format!("{v:.n_after$}");
    // No negative zero.
    text.strip_prefix('-')
        .filter(|rest| rest.trim_matches(['0', '.']).is_empty())
        .map_or(text.clone(), str::to_owned)
}

fn numbers_row(
    ui: &mut Ui,
    (name, parts): (&str, [&str; 3]),
    value: &mut Vec3,
    default: Vec3,
    number: impl Fn(&mut f32) -> DragValue<'_>,
) -> bool {
    ui.horizontal(|ui| {
        let label = name_label(ui, name);
        let mut is_changed = false;
        for (axis, v) in parts.into_iter().zip(value.as_mut()) {
            let number = number(v);
            let response = ui.add_sized([46.0, ui.spacing().interact_size.y], number);
            set_label(&response, &format!("{name} {axis}"));
            is_changed |= response
                .on_hover_text(format!("{name} {axis}: drag or type"))
                .changed();
        }
        is_changed | reset_ui(ui, &label, name, value, default)
    })
    .inner
}

/// Gives a control a name for assistive technology.
pub fn set_label(response: &Response, name: &str) {
    response
        .ctx
        .accesskit_node_builder(response.id, |node| node.set_label(name.to_owned()));
}

/// A colour row (linear factors 0 to 1); true when it was changed.
pub fn color_row(ui: &mut Ui, name: &str, color: &mut Vec3) -> bool {
    ui.horizontal(|ui| {
        let label = name_label(ui, name);
        let mut rgb = color.to_array();
        let button = ui.color_edit_button_rgb(&mut rgb);
        set_label(&button, name);
        // White on white is no button.
        let edge = egui::Stroke::new(1.0, theme::weak(ui.visuals()));
        ui.painter()
            .rect_stroke(button.rect, 2.0, edge, egui::StrokeKind::Inside);
        if button.changed() {
            *color = Vec3::from(rgb);
        }
        button.changed() | reset_ui(ui, &label, name, color, Vec3::ONE)
    })
    .inner
}

/// Sends a command when something is clicked.
pub fn on_click<C>(response: &Response, command: C, commands: &mut Vec<C>) {
    commands.extend(response.clicked().then_some(command));
}

/// Choices beside each other, each with its name and a hint, one of them chosen `now`; the one that is clicked.
pub fn choices_ui<T: Copy + PartialEq>(
    ui: &mut Ui,
    now: T,
    choices: impl IntoIterator<Item = (T, impl Into<String>, &'static str)>,
) -> Option<T> {
    let mut clicked = None;
    for (choice, name, hint) in choices {
        let button = ui.selectable_label(now == choice, name.into());
        if button.on_hover_text(hint).clicked() {
            clicked = Some(choice);
        }
    }
    clicked
}

/// A number that can be typed or dragged, with a name for assistive technology.
pub fn number_ui(ui: &mut Ui, name: &str, number: DragValue<'_>) -> Response {
    let response = ui.add(number);
    set_label(&response, name);
    response
}

/// A number of seconds of training, 5 to a day.
pub fn training_secs(secs: &mut f64) -> DragValue<'_> {
    let number = DragValue::new(secs).range(5.0..=86_400.0);
    number.speed(5.0).max_decimals(0).suffix(" s")
}

/// A window in front of everything, with room around its content; sends `close` when `content` returns true, or it is left
/// by Esc or a click beside it.
pub fn modal_ui(
    ui: &Ui,
    name: &str,
    close: Command,
    commands: &mut Vec<Command>,
    content: impl FnOnce(&mut Ui, &mut Vec<Command>) -> bool,
) {
    let frame = egui::Frame::popup(ui.style()).inner_margin(16);
    let modal = egui::Modal::new(egui::Id::unique(name)).frame(frame);
    let modal = modal.show(ui.ctx(), |ui| content(ui, commands));
    if modal.inner || modal.should_close() {
        commands.push(close);
    }
}

/// Text that matters less.
pub fn weak(ui: &Ui, text: impl Into<String>) -> RichText {
    RichText::new(text).color(theme::weak(ui.visuals()))
}

/// Seconds as people say them: `42 s`, `3:05`, `1:02:03`.
pub fn duration(secs: f64) -> String {
    if !secs.is_finite() || secs < 0.0 {
        return "–".to_owned();
    }
    let whole = secs.round() as u64;
    let (hours, minutes, seconds) = (whole / 3600, whole / 60 % 60, whole % 60);
    match (hours, minutes) {
        (0, 0) => format!("{seconds} s"),
        (0, _) => format!("{minutes}:{seconds:02}"),
        _ => format!("{hours}:{minutes:02}:{seconds:02}"),
    }
}

/// A count with a unit prefix: `950`, `12.3 k`, `4.0 M`.
pub fn count(n: f32) -> String {
    match n {
        n if !n.is_finite() => "–".to_owned(),
        n if n < 10.0 => format!("{n:.1}"),
        n if n < 1e3 => format!("{n:.0}"),
        n if n < 1e6 => format!("{:.1} k", n / 1e3),
        n => format!("{:.1} M", n / 1e6),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_and_counts_read_well() {
        assert_eq!(
            [0.4, 42.0, 185.0, 3723.0, f64::NAN].map(duration),
            ["0 s", "42 s", "3:05", "1:02:03", "–"]
        );
        assert_eq!(
            [7.0, 70.0, 12_345.0, 4e6].map(count),
            ["7.0", "70", "12.3 k", "4.0 M"]
        );
    }
}
