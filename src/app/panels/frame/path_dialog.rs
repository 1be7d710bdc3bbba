//! The window in which a path is typed, browsed for, or taken from the recent ones.

use egui::{Button, RichText, TextEdit, Ui};

use crate::app::panels::widgets::{modal_ui, on_click, weak};
use crate::app::state::app_state::{AppState, PathDialog, PathPurpose};
use crate::app::state::command::{Browse, Command};
use crate::app::state::source::file_name;
use crate::app::state::training_state::Level;
use crate::app::theme;

/// Width of the window's content.
const WIDTH: f32 = 520.0;

/// Draws the window, while it is open.
pub fn path_dialog_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let Some(dialog) = &state.overlays.path_dialog else {
        return;
    };
    modal_ui(
        ui,
        "path",
        Command::ClosePathDialog,
        commands,
        |ui, commands| {
            ui.set_width(WIDTH);
            let (title, what) = match dialog.purpose {
                PathPurpose::Open => (
                    "Open",
                    "A capture (folder or transforms.json), a saved run, a session, an environment (.safetensors, or a panorama as .hdr or .exr), or a scan (Gaussian splats or a NeRF). Dropping it on the window works too.",
                ),
                PathPurpose::AddEnvironment => (
                    "Add an environment",
                    "A trained environment (.safetensors), a saved run whose environment is meant, a scan (Gaussian splats or a NeRF), or a panorama (.hdr, .exr). Dropping a file on the window works too.",
                ),
                PathPurpose::Save => (
                    "Save the run",
                    "A folder for the model and everything to go on with it; it is made if it does not exist.",
                ),
                PathPurpose::Log => (
                    "Export the figures",
                    "A file for loss, PSNR and speed over the run so far, as a table with commas (.csv).",
                ),
                PathPurpose::Masks => (
                    "Export the masks",
                    "A folder for a PNG a photo, named as the photo: white is the object. It is made if it does not exist.",
                ),
                PathPurpose::SaveSession => (
                    "Save the session",
                    "A small file that names what is open and holds all edits, camera and layout. What was trained and never saved goes into a folder beside it.",
                ),
            };
            ui.heading(title);
            ui.label(weak(ui, what));
            ui.add_space(6.0);
            path_ui(ui, dialog, commands);
            if dialog.purpose == PathPurpose::Open {
                recent_ui(ui, state, commands);
            }
            ui.add_space(8.0);
            ui.button("Cancel").clicked()
        },
    );
}

fn path_ui(ui: &mut Ui, dialog: &PathDialog, commands: &mut Vec<Command>) {
    let mut typed = dialog.typed.clone();
    let verb = match dialog.purpose {
        PathPurpose::Open => "Open path",
        PathPurpose::AddEnvironment => "Add path",
        PathPurpose::Save | PathPurpose::SaveSession => "Save",
        PathPurpose::Log | PathPurpose::Masks => "Export",
    };
    ui.horizontal(|ui| {
        let label = ui.label("Path");
        let edit = TextEdit::singleline(&mut typed)
            .desired_width(WIDTH - 140.0)
            .hint_text(match dialog.purpose {
                PathPurpose::Open => "/path/to/capture",
                PathPurpose::AddEnvironment => "/path/to/environment.hdr",
                PathPurpose::Save => "/path/to/run",
                PathPurpose::Log => "/path/to/figures.csv",
                PathPurpose::Masks => "/path/to/masks",
                PathPurpose::SaveSession => "/path/to/session",
            });
        let edit = ui.add(edit).labelled_by(label.id);
        if edit.changed() {
            commands.push(Command::TypePath(typed.clone()));
        }
        let is_entered = edit.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
        // Ready to type at once; asked after `lost_focus`, which asking would hide.
        if !is_entered && ui.memory(|memory| memory.focused().is_none()) {
            edit.request_focus();
        }
        let button = ui.add_enabled(!typed.trim().is_empty(), Button::new(verb));
        if button.clicked() || is_entered {
            commands.push(Command::UseTypedPath);
        }
    });
    ui.horizontal(|ui| {
        let browse = [
            ("Browse for a folder…", Browse::Folder),
            ("Browse for a file…", Browse::File),
        ];
        let browse = match dialog.purpose {
            PathPurpose::Open | PathPurpose::AddEnvironment => &browse[..],
            PathPurpose::Save | PathPurpose::Masks => &browse[..1],
            PathPurpose::SaveSession | PathPurpose::Log => &browse[1..],
        };
        for (text, kind) in browse {
            let button = ui.add_enabled(!dialog.is_browsing, Button::new(*text));
            on_click(&button, Command::Browse(*kind), commands);
        }
        if dialog.is_browsing {
            ui.label(weak(ui, "Waiting for the system's dialog…"));
        }
    });
    if let Some(note) = &dialog.note {
        ui.label(RichText::new(note).color(theme::of_level(ui.visuals(), Level::Warning)));
    }
}

fn recent_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    ui.add_space(6.0);
    ui.label(RichText::new("Recent").strong());
    if state.recent.is_empty() {
        ui.label(weak(ui, "Nothing was opened yet."));
    }
    for path in &state.recent {
        let folder = path.parent().unwrap_or(path).display();
        let text = format!("{}   {folder}", file_name(path));
        let button = ui.add(Button::new(text).frame(false).truncate());
        let button = button.on_hover_text(path.display().to_string());
        on_click(&button, Command::Open(path.clone()), commands);
    }
    ui.add_space(6.0);
    let demo = ui.button("Bundled demo");
    let demo = demo.on_hover_text("A small capture that comes with the program");
    on_click(&demo, Command::OpenDemo, commands);
}
