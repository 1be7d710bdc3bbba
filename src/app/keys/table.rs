//! The table of commands, keys and gestures: shortcuts, menus, palette, help and the manual's list
//! of keys are all made from it.

use std::sync::LazyLock;

use glam::Vec3;

use super::binding::{Binding, entry, gesture};
use crate::app::changes::history::{can_redo, can_undo};
use crate::app::lighting::LightingCommand;
use crate::app::object::ObjectCommand;
use crate::app::session::leaving::LeavingCommand;
use crate::app::session::preferences::{PreferencesCommand, Side, ThemeChoice};
use crate::app::session::saving::SessionCommand;
use crate::app::state::app_state::{AppState, PathPurpose};
use crate::app::state::command::{Command, Train};
use crate::app::state::export::{ExportCommand, Subject};
use crate::app::state::history::HistoryCommand;
use crate::app::state::look::Look;
use crate::app::state::palette::PaletteCommand;
use crate::app::state::source::Source;
use crate::app::state::training_state::Phase;
use crate::app::state::watch::{Comparison, WatchCommand};
use crate::app::viewport::camera_control::{CameraMove, front, right_side};
use crate::neif::{EnvironmentTransform, MaterialEdit};
use crate::render::Layer;

/// The menus and the groups in each; groups without commands are left out.
pub const MENUS: &[(&str, &[&str])] = &[
    ("File", &["File"]),
    ("Edit", &["Edit"]),
    ("View", &["Camera", "Layers"]),
    ("Light", &["Environment"]),
    ("Photos", &["Photos"]),
    ("Training", &["Training"]),
    ("Window", &["Window"]),
];

/// All of them, by group.
pub static BINDINGS: LazyLock<Vec<Binding>> = LazyLock::new(|| {
    let object = gesture(
        "Click",
        "Look into the point under the pointer, or edit a part",
    );
    let add = gesture(
        "Drag, while it is selected",
        "Add to the object in the photo; the wheel changes the brush",
    );
    let remove = gesture(
        "Right drag or Shift+drag, while it is selected",
        "Remove from the object",
    );
    let groups = [
        ("File", file()),
        ("Edit", edit()),
        ("Camera", camera()),
        ("Object", vec![object, add, remove]),
        ("Environment", environment()),
        ("Photos", photos()),
        ("Layers", layers()),
        ("Training", training()),
        ("Window", window()),
    ];
    let in_group = |(group, bindings): (&'static str, Vec<Binding>)| {
        let bindings = bindings.into_iter();
        bindings.map(move |binding| binding.under(group))
    };
    groups.into_iter().flat_map(in_group).collect()
});

fn file() -> Vec<Binding> {
    let session = |command| move |_: &AppState| Command::Session(command);
    vec![
        entry("Ctrl+O", "Open…", |_| Command::AskPath(PathPurpose::Open)),
        entry("", "Open the bundled demo", |_| Command::OpenDemo),
        entry("Ctrl+S", "Save the session", session(SessionCommand::Save)).when(is_something_open),
        entry(
            "Ctrl+Shift+S",
            "Save the session as…",
            session(SessionCommand::SaveAs),
        )
        .when(is_something_open),
        entry("", "Save the run…", |_| {
            Command::AskPath(PathPurpose::Save)
        })
        .when(takes_commands),
        entry("Ctrl+E", "Export…", |state| {
            Command::Export(ExportCommand::Show(state.export.settings.subject))
        })
        .when(is_something_open),
        entry("Shift+F12", "Export a turntable…", |_| {
            Command::Export(ExportCommand::Show(Subject::Turntable))
        })
        .when(is_something_open),
        entry("F12", "Screenshot of the view", |_| {
            Command::Export(ExportCommand::Screenshot)
        })
        .when(is_something_open),
        entry("", "Cancel the export", |_| {
            Command::Export(ExportCommand::Cancel)
        })
        .when(|state| state.export.running.is_some()),
        entry("Ctrl+Q", "Quit", |_| {
            Command::Leaving(LeavingCommand::Close)
        }),
    ]
}

fn edit() -> Vec<Binding> {
    let history = |command| move |_: &AppState| Command::History(command);
    vec![
        entry("Ctrl+Z", "Undo", history(HistoryCommand::Undo)).when(can_undo),
        entry(
            "Ctrl+Shift+Z, Ctrl+Y",
            "Redo",
            history(HistoryCommand::Redo),
        )
        .when(can_redo),
        entry("", "Reset material", |_| {
            Command::Edit(MaterialEdit::default())
        })
        .when(|state| state.look.edit != MaterialEdit::default()),
    ]
}

fn camera() -> Vec<Binding> {
    let from = |direction: fn(Vec3) -> Vec3| {
        move |state: &AppState| Command::MoveCamera(CameraMove::From(direction(state.view.up)))
    };
    vec![
        gesture("Drag", "Turn about the pivot"),
        gesture("Middle drag, Ctrl+drag", "Pan"),
        gesture("Wheel", "Closer or farther"),
        gesture("Right drag", "Look around"),
        gesture(
            "Right button + W A S D Q E",
            "Fly; with Shift faster, with Alt slower",
        ),
        gesture("Double-click", "Turn about the point under the pointer"),
        entry("F", "Show the whole object", |_| Command::FrameObject)
            .when(|state| state.view.bounds.is_some()),
        entry("Shift+F", "Back to the first view", |_| Command::ResetView),
        entry("Ctrl+1", "From the front", from(front)),
        entry("Ctrl+3", "From the right", from(right_side)),
        entry("Ctrl+7", "From above", from(|up| up)),
    ]
}

fn environment() -> Vec<Binding> {
    let lighting = |command| move |_: &AppState| Command::Lighting(command);
    let expose = |by_ev: f32| {
        move |state: &AppState| {
            let ev = state.lighting.display_ev + by_ev;
            Command::Lighting(LightingCommand::SetDisplayEv(ev))
        }
    };
    vec![
        gesture("Shift+drag, Shift+right drag", "Rotate the environment"),
        gesture("Shift+middle drag, Ctrl+Shift+drag", "Move the environment"),
        entry(
            "M",
            "Handles to move, turn and scale the environment; Ctrl for round steps",
            lighting(LightingCommand::ToggleGizmo),
        )
        .marked(|state| state.lighting.is_gizmo_shown),
        entry(
            "P",
            "Set the object down: press or drag in the picture",
            lighting(LightingCommand::ToggleSettingDown),
        )
        .marked(|state| state.lighting.is_setting_down),
        entry(
            "L",
            "Axes and bounds",
            lighting(LightingCommand::ToggleLines),
        )
        .marked(|state| state.lighting.are_lines_shown),
        entry("H", "Background: auto, blurred, hidden", |state| {
            let next = state.lighting.background.next();
            Command::Lighting(LightingCommand::SetBackground(next))
        }),
        entry("Shift+E", "Darker picture, by half a stop", expose(-0.5)),
        entry("E", "Brighter picture, by half a stop", expose(0.5)),
        entry(
            "V",
            "Two looks side by side: A as edited, B as kept",
            lighting(LightingCommand::ToggleSplit),
        )
        .marked(|state| state.lighting.split.is_some()),
        entry("X", "Swap A and B", lighting(LightingCommand::SwapSides))
            .when(|state| state.lighting.kept.is_some()),
        entry("B", "Before and after: hide or show all edits", |state| {
            Command::ShowOriginal(!state.is_original_shown)
        })
        .when(|state| state.look != Look::default())
        .marked(|state| state.is_original_shown),
        entry("", "Back to the environment as captured", |_| {
            Command::ChooseEnvironment(None)
        })
        .when(|state| state.look.environment.is_some()),
        entry("", "Put the environment back where it was", |_| {
            Command::MoveEnvironment(EnvironmentTransform::default())
        })
        .when(|state| state.look.transform != EnvironmentTransform::default()),
        entry("", "Put the panorama on a floor", |_| Command::PutOnFloor).when(|state| {
            state
                .chosen_environment()
                .is_some_and(|it| it.lacks_floor())
        }),
        entry("", "Match exposure", |_| Command::MatchExposure)
            .when(|state| state.chosen_environment().is_some()),
    ]
}

fn photos() -> Vec<Binding> {
    // Switches a comparison on, or off where it is on.
    let compare = |with: Comparison| {
        move |state: &AppState| {
            let is_on = state.compare.with_photo == with;
            let next = if is_on { Comparison::Off } else { with };
            Command::Watch(WatchCommand::Compare(next))
        }
    };
    vec![
        entry("[", "Previous photo's camera", |_| Command::StepView(-1)).when(has_photos),
        entry("]", "Next photo's camera", |_| Command::StepView(1)).when(has_photos),
        entry("{", "First photo's camera", |_| Command::GoToView(0)).when(has_photos),
        entry("}", "Last photo's camera", |state| {
            Command::GoToView(state.views().count().saturating_sub(1))
        })
        .when(has_photos),
        entry(
            "Shift+W",
            "Photo and rendering side by side",
            compare(Comparison::Beside),
        ),
        entry(
            "T",
            "Photo and rendering in turn (flicker)",
            compare(Comparison::Flicker),
        ),
        entry(
            "D",
            "Difference from the photo: absolute, signed, FLIP, off",
            |state| Command::Watch(WatchCommand::Compare(state.compare.with_photo.next_error())),
        ),
        entry(
            "C",
            "Show the photos' cameras; click one to go there",
            |state| Command::Watch(WatchCommand::ShowCameras(!state.watch.are_cameras_shown)),
        ),
        entry("W", "Wipe between photo and rendering", |state| {
            let is_on = state.compare.wipe.is_some();
            Command::SetWipe((!is_on).then_some(0.5))
        })
        .when(has_photos)
        .marked(|state| state.compare.wipe.is_some()),
        gesture("Hold G", "Show the photo"),
    ]
}

fn layers() -> Vec<Binding> {
    let layers = [
        ("1", "Lit", Layer::Final),
        ("2", "Diffuse", Layer::Diffuse),
        ("3", "Specular", Layer::Specular),
        ("4", "Roughness", Layer::Roughness),
        ("5", "Tint", Layer::Tint),
        ("6", "Normals", Layer::Normal),
        ("7", "Environment alone", Layer::Environment),
        ("8", "Depth", Layer::Depth),
        ("9", "Visibility of a uniform sky", Layer::Visibility),
        ("0", "Field samples a pixel", Layer::Samples),
        ("", "Albedo", Layer::Albedo),
        ("", "Irradiance", Layer::Irradiance),
        ("", "Seen by photos", Layer::Seen),
    ];
    let binding = |(keys, what, layer)| {
        entry(keys, what, move |_| Command::ShowLayer(layer))
            .marked(move |state| state.layer == layer)
    };
    layers.map(binding).into()
}

fn training() -> Vec<Binding> {
    let train = |command| move |_: &AppState| Command::Train(command);
    vec![
        entry("", "Start training, or train further", train(Train::Start)).when(can_start),
        entry("Space", "Pause or resume", train(Train::PauseOrResume)).when(is_running),
        entry(".", "One step", train(Train::Step)).when(is_running),
        entry("", "Train one minute longer", train(Train::Extend(60.0))).when(takes_commands),
        entry("", "Train five minutes longer", train(Train::Extend(300.0))).when(takes_commands),
        entry("", "Stop training", train(Train::Stop)).when(is_running),
        entry("", "Select the object in photos without masks", |_| {
            Command::Object(ObjectCommand::Select(true))
        })
        .when(AppState::lacks_object),
    ]
}

fn window() -> Vec<Binding> {
    let prefer = |command| move |_: &AppState| Command::Preferences(command);
    let panel = |what, side| {
        entry("", what, prefer(PreferencesCommand::TogglePanel(side)))
            .marked(move |state| !state.preferences.panels.side(side).is_hidden)
    };
    let theme = |what, theme| {
        entry("", what, prefer(PreferencesCommand::Theme(theme)))
            .marked(move |state| state.preferences.theme == theme)
    };
    vec![
        entry("Ctrl+K, Ctrl+P", "Find a command…", |_| {
            Command::Palette(PaletteCommand::Toggle)
        }),
        entry("F11", "Full screen", |_| Command::ToggleFullScreen)
            .marked(|state| state.is_full_screen),
        entry("?", "Mouse and keys", |_| Command::ToggleHelp)
            .marked(|state| state.overlays.is_help_open),
        entry("", "Messages", |_| Command::ToggleLog).marked(|state| state.preferences.is_log_open),
        entry(
            "Esc",
            "Close what is in front, or forget the picked point",
            |_| Command::CloseOverlays,
        ),
        gesture("Double-click a slider's name", "Back to its default"),
        entry(
            "Tab",
            "Show or hide the side panels",
            prefer(PreferencesCommand::TogglePanels),
        )
        .marked(|state| state.preferences.panels.is_any_shown()),
        panel("Left panel", Side::Left),
        panel("Right panel", Side::Right),
        entry(
            "Ctrl +",
            "Larger text",
            prefer(PreferencesCommand::Zoom(1.0)),
        ),
        entry(
            "Ctrl -",
            "Smaller text",
            prefer(PreferencesCommand::Zoom(-1.0)),
        ),
        entry(
            "Ctrl 0",
            "Text of the usual size",
            prefer(PreferencesCommand::ResetZoom),
        ),
        theme("Theme of the system", ThemeChoice::System),
        theme("Light theme", ThemeChoice::Light),
        theme("Dark theme", ThemeChoice::Dark),
    ]
}

fn has_photos(state: &AppState) -> bool {
    state.view_at(0).is_some()
}

fn is_something_open(state: &AppState) -> bool {
    state.source != Source::Nothing
}

fn takes_commands(state: &AppState) -> bool {
    state.training.phase.takes_commands()
}

fn is_running(state: &AppState) -> bool {
    matches!(state.training.phase, Phase::Training | Phase::Paused)
}

fn can_start(state: &AppState) -> bool {
    let phase = &state.training.phase;
    let is_idle = matches!(phase, Phase::Idle | Phase::Finished(_) | Phase::Failed(_));
    is_idle && !phase.takes_commands() && state.source.is_trainable()
}

#[cfg(test)]
mod tests;
