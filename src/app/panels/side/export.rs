//! The export window: what is taken away, in which file, and how far it is.

use egui::{Button, DragValue, Grid, ProgressBar, RichText, TextEdit, Ui};

use strum::VariantArray as _;

use crate::app::changes::export::default_path;
use crate::app::panels::frame::view_bar::layer_name;
use crate::app::panels::widgets::{duration, number_ui, on_click, set_label, weak};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::export::{
    ExportCommand, ExportSettings, ExportState, MAX_FPS, MAX_FRAMES, MAX_SIDE_PX, Subject,
    key_text, n_path_frames,
};
use crate::app::state::source::file_name;
use crate::app::state::training_state::Level;
use crate::app::theme;
use crate::render::{Backdrop, FileKind, Spin};

/// Width of the window's content.
const WIDTH: f32 = 400.0;

/// While an export runs, a button that shows how far it is and opens the window.
pub fn running_export_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let Some(running) = &state.export.running else {
        return;
    };
    let button = ui.button(format!("Export {:.0} %", 100.0 * running.fraction));
    let show = ExportCommand::Show(state.export.settings.subject);
    let button = button.on_hover_text("How far it is, and cancel");
    on_click(&button, Command::Export(show), commands);
    ui.separator();
}

/// Draws the window, while it is open.
pub fn export_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let export = &state.export;
    if !export.is_open {
        return;
    }
    let mut asked = Vec::new();
    let mut is_open = true;
    egui::Window::new("Export")
        .open(&mut is_open)
        .resizable(false)
        .collapsible(false)
        .default_pos([290.0, 60.0])
        .show(ui.ctx(), |ui| {
            ui.set_width(WIDTH);
            let mut settings = export.settings;
            ui.horizontal(|ui| {
                for &subject in Subject::VARIANTS {
                    ui.selectable_value(&mut settings.subject, subject, <&str>::from(subject));
                }
            });
            ui.separator();
            Grid::new("export")
                .num_columns(2)
                .spacing([12.0, 6.0])
                .show(ui, |ui| settings_ui(ui, export, &mut settings));
            if settings != export.settings {
                asked.push(ExportCommand::Set(settings));
            }
            if export.settings.subject == Subject::Path {
                keys_ui(ui, export, &mut asked);
            }
            hint_ui(ui, state);
            ui.separator();
            path_ui(ui, state, &mut asked);
            run_ui(ui, state, &mut asked);
        });
    if !is_open {
        asked.push(ExportCommand::Close);
    }
    commands.extend(asked.into_iter().map(Command::Export));
}

fn settings_ui(ui: &mut Ui, export: &ExportState, settings: &mut ExportSettings) {
    ui.label("Size");
    ui.horizontal(|ui| size_ui(ui, export, settings));
    ui.end_row();

    ui.label("File");
    ui.horizontal(|ui| {
        let is_still = settings.subject == Subject::Picture;
        let kind = if is_still {
            &mut settings.still_kind
        } else {
            &mut settings.film_kind
        };
        let kinds = FileKind::VARIANTS.iter().copied();
        for choice in kinds.filter(|kind| !(is_still && kind.is_film())) {
            ui.selectable_value(kind, choice, choice.extension().to_uppercase())
                .on_hover_text(kind_hint(choice));
        }
    });
    ui.end_row();

    ui.label("Background");
    let mut is_shown = settings.backdrop == Backdrop::Shown;
    ui.checkbox(&mut is_shown, "With the environment")
        .on_hover_text("Without it the picture is transparent around the object");
    settings.backdrop = if is_shown {
        Backdrop::Shown
    } else {
        Backdrop::Transparent
    };
    ui.end_row();

    if settings.subject == Subject::Turntable {
        ui.label("Turns");
        ui.horizontal(|ui| {
            ui.selectable_value(&mut settings.spin, Spin::Camera, "Camera")
                .on_hover_text("Around the object, from the current view");
            ui.selectable_value(&mut settings.spin, Spin::Environment, "Environment")
                .on_hover_text("Around the object; the camera stays");
        });
        ui.end_row();
    }
    if settings.subject != Subject::Picture {
        ui.label("Frames");
        ui.horizontal(|ui| frames_ui(ui, export, settings));
        ui.end_row();
    }
}

fn size_ui(ui: &mut Ui, export: &ExportState, settings: &mut ExportSettings) {
    let mut is_window = settings.size.is_none();
    ui.checkbox(&mut is_window, "As the view");
    let (mut width, mut height) = settings.size.unwrap_or(export.window_px);
    for (side, name) in [(&mut width, "Width"), (&mut height, "Height")] {
        let value = DragValue::new(side).range(1..=MAX_SIDE_PX).suffix(" px");
        let value = ui.add_enabled(!is_window, value);
        set_label(&value, name);
    }
    settings.size = (!is_window).then_some((width, height));
}

fn frames_ui(ui: &mut Ui, export: &ExportState, settings: &mut ExportSettings) {
    let n = if settings.subject == Subject::Turntable {
        let frames = DragValue::new(&mut settings.n_frames).range(1..=MAX_FRAMES);
        number_ui(ui, "Frames", frames);
        settings.n_frames
    } else {
        let n = n_path_frames(export);
        ui.label(n.to_string());
        n
    };
    ui.label("at");
    let fps = DragValue::new(&mut settings.fps)
        .range(1.0..=MAX_FPS)
        .max_decimals(2)
        .suffix(" a second");
    number_ui(ui, "Frames a second", fps);
    ui.label(weak(ui, format!("{:.1} s", n as f32 / settings.fps)));
}

fn kind_hint(kind: FileKind) -> &'static str {
    match kind {
        FileKind::Png => "8 bits, as on the screen",
        FileKind::Exr => "Linear light, for compositing",
        FileKind::Gif => "One animated picture, plays everywhere",
        FileKind::Mp4 => "One film; needs the program ffmpeg",
    }
}

/// What the files hold, where the choice does not say it.
fn hint_ui(ui: &mut Ui, state: &AppState) {
    let settings = &state.export.settings;
    let text = match settings.kind() {
        FileKind::Exr => {
            "Named channels: the picture, diffuse, specular, roughness, tint, normal and depth (Z)."
                .to_owned()
        }
        _ => format!("Shows the layer {}.", layer_name(state.layer)),
    };
    ui.label(weak(ui, text));
}

fn keys_ui(ui: &mut Ui, export: &ExportState, asked: &mut Vec<ExportCommand>) {
    ui.add_space(4.0);
    ui.horizontal(|ui| {
        let add = ui.button("Add this view");
        let add = add.on_hover_text("The current view becomes the path's next key view");
        on_click(&add, ExportCommand::AddKey, asked);
        let save = ui.add_enabled(!export.keys.is_empty(), Button::new("Save cameras"));
        let save = save.on_hover_text("A file for `neif render --cameras`");
        on_click(&save, ExportCommand::SaveKeys, asked);
    });
    if export.keys.len() < 2 {
        let text = "Move the camera and add at least two views; the path passes through them.";
        ui.label(weak(ui, text));
    }
    egui::ScrollArea::vertical()
        .max_height(160.0)
        .id_salt("key views")
        .show(ui, |ui| {
            for (i, key) in export.keys.iter().enumerate() {
                ui.horizontal(|ui| {
                    ui.label((i + 1).to_string());
                    let mut secs = key.time_secs;
                    let time = DragValue::new(&mut secs)
                        .speed(0.05)
                        .range(0.0..=86_400.0)
                        .max_decimals(2)
                        .suffix(" s");
                    let time = number_ui(ui, &format!("Time of view {}", i + 1), time);
                    if time.changed() {
                        asked.push(ExportCommand::SetKeyTime(i, secs));
                    }
                    let go = ui.small_button("Go").on_hover_text("Stand there");
                    on_click(&go, ExportCommand::GoToKey(i), asked);
                    let remove = ui.small_button("Remove");
                    on_click(&remove, ExportCommand::RemoveKey(i), asked);
                    ui.label(weak(ui, key_text(&key.camera)));
                });
            }
        });
}

fn path_ui(ui: &mut Ui, state: &AppState, asked: &mut Vec<ExportCommand>) {
    let export = &state.export;
    let path = default_path(&state.source, &export.settings);
    let typed = export.typed.clone();
    let mut typed = typed.unwrap_or_else(|| path.display().to_string());
    let what = if export.settings.needs_folder() {
        "Folder"
    } else {
        "Save as"
    };
    ui.horizontal(|ui| {
        let label = ui.label(what);
        let edit = TextEdit::singleline(&mut typed).desired_width(WIDTH - 150.0);
        if ui.add(edit).labelled_by(label.id).changed() {
            asked.push(ExportCommand::Type(typed.clone()));
        }
        let browse = ui.add_enabled(!export.is_browsing, Button::new("Browse…"));
        on_click(&browse, ExportCommand::Browse, asked);
    });
    let note = match (&export.typed, export.settings.needs_folder()) {
        (None, _) => "A number is added where that exists.",
        (Some(_), true) => "Pictures of the same names in it are replaced.",
        (Some(_), false) => "A file of that name is replaced.",
    };
    ui.label(weak(ui, note));
    if let Some(note) = &export.note {
        let color = theme::of_level(ui.visuals(), Level::Warning);
        ui.label(RichText::new(note).color(color));
    }
}

fn run_ui(ui: &mut Ui, state: &AppState, asked: &mut Vec<ExportCommand>) {
    ui.add_space(4.0);
    let Some(running) = &state.export.running else {
        let can_start = state.snapshot.is_some();
        let start = ui.add_enabled(can_start, Button::new("Start export"));
        let start = start.on_disabled_hover_text("There is no picture yet");
        on_click(&start, ExportCommand::Start, asked);
        return;
    };
    let elapsed = (state.messages.now_secs - running.started_secs).max(0.0);
    let fraction = f64::from(running.fraction);
    ui.horizontal(|ui| {
        let bar = ProgressBar::new(running.fraction).desired_width(150.0);
        ui.add(bar.desired_height(10.0));
        ui.label(format!("{:.0} %", 100.0 * fraction));
        // Before the time, which comes later, so that it stays where it is.
        on_click(&ui.button("Cancel export"), ExportCommand::Cancel, asked);
        if fraction > 0.01 {
            let left = elapsed * (1.0 - fraction) / fraction;
            ui.label(weak(ui, format!("{} left", duration(left))));
        }
    });
    ui.label(weak(ui, file_name(&running.path)));
}
