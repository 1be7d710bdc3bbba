//! The table of commands, keys and gestures: shortcuts, menus, palette, help and the manual's list
//! of keys are all made from it.

use egui::{Key, Modifiers};

use super::binding::{
    Binding, CAMERA, COMPARE, EDIT, FILE, LAYERS, LIGHT, OBJECT, TRAINING, WINDOW, gesture, key,
    plain,
};
use super::conditions::{
    can_start, compare, expose, from, has_photos, is_running, is_something_open, layer,
};
use crate::app::changes::history::{can_redo, can_undo};
use crate::app::lighting::LightingCommand;
use crate::app::session::leaving::LeavingCommand;
use crate::app::session::preferences::{PreferencesCommand, Side, ThemeChoice};
use crate::app::session::saving::SessionCommand;
use crate::app::state::app_state::PathPurpose;
use crate::app::state::command::{Command, Train};
use crate::app::state::export::{ExportCommand, Subject};
use crate::app::state::history::HistoryCommand;
use crate::app::state::look::Look;
use crate::app::state::palette::PaletteCommand;
use crate::app::state::watch::{Comparison, WatchCommand};
use crate::app::viewport::camera_control::{CameraMove, front, right_side};
use crate::neif::{EnvironmentTransform, MaterialEdit};
use crate::render::Layer;

/// The menus and the groups in each; groups without commands are left out.
pub const MENUS: &[(&str, &[&str])] = &[
    ("File", &[FILE]),
    ("Edit", &[EDIT]),
    ("View", &[CAMERA, LAYERS]),
    ("Light", &[LIGHT]),
    ("Photos", &[COMPARE]),
    ("Training", &[TRAINING]),
    ("Window", &[WINDOW]),
];

/// All of them, by group.
pub const BINDINGS: &[Binding] = &[
    key(
        FILE,
        ("Ctrl+O", Modifiers::COMMAND, Key::O),
        "Open…",
        |_| Command::AskPath(PathPurpose::Open),
    ),
    plain(FILE, "Open the bundled demo", |_| Command::OpenDemo),
    key(
        FILE,
        ("Ctrl+S", Modifiers::COMMAND, Key::S),
        "Save the session",
        |_| Command::Session(SessionCommand::Save),
    )
    .when(is_something_open),
    key(
        FILE,
        (
            "Ctrl+Shift+S",
            Modifiers::COMMAND.plus(Modifiers::SHIFT),
            Key::S,
        ),
        "Save the session as…",
        |_| Command::Session(SessionCommand::SaveAs),
    )
    .when(is_something_open),
    plain(FILE, "Save the run…", |_| {
        Command::AskPath(PathPurpose::Save)
    })
    .when(|state| state.training.phase.takes_commands()),
    key(
        FILE,
        ("Ctrl+E", Modifiers::COMMAND, Key::E),
        "Export…",
        |state| Command::Export(ExportCommand::Show(state.export.settings.subject)),
    )
    .when(is_something_open),
    key(
        FILE,
        ("Shift+F12", Modifiers::SHIFT, Key::F12),
        "Export a turntable…",
        |_| Command::Export(ExportCommand::Show(Subject::Turntable)),
    )
    .when(is_something_open),
    key(
        FILE,
        ("F12", Modifiers::NONE, Key::F12),
        "Screenshot of the view",
        |_| Command::Export(ExportCommand::Screenshot),
    )
    .when(is_something_open),
    plain(FILE, "Cancel the export", |_| {
        Command::Export(ExportCommand::Cancel)
    })
    .when(|state| state.export.running.is_some()),
    key(FILE, ("Ctrl+Q", Modifiers::COMMAND, Key::Q), "Quit", |_| {
        Command::Leaving(LeavingCommand::Close)
    }),
    key(EDIT, ("Ctrl+Z", Modifiers::COMMAND, Key::Z), "Undo", |_| {
        Command::History(HistoryCommand::Undo)
    })
    .when(can_undo),
    key(
        EDIT,
        (
            "Ctrl+Shift+Z, Ctrl+Y",
            Modifiers::COMMAND.plus(Modifiers::SHIFT),
            Key::Z,
        ),
        "Redo",
        |_| Command::History(HistoryCommand::Redo),
    )
    .or(Modifiers::COMMAND, Key::Y)
    .when(can_redo),
    plain(EDIT, "Reset material", |_| {
        Command::Edit(MaterialEdit::default())
    })
    .when(|state| state.look.edit != MaterialEdit::default()),
    gesture(CAMERA, "Drag", "Turn about the pivot"),
    gesture(CAMERA, "Middle drag, Ctrl+drag", "Pan"),
    gesture(CAMERA, "Wheel", "Closer or farther"),
    gesture(CAMERA, "Right drag", "Look around"),
    gesture(
        CAMERA,
        "Right button + W A S D Q E",
        "Fly; with Shift faster, with Alt slower",
    ),
    gesture(
        CAMERA,
        "Double-click",
        "Turn about the point under the pointer",
    ),
    key(
        CAMERA,
        ("F", Modifiers::NONE, Key::F),
        "Show the whole object",
        |_| Command::FrameObject,
    )
    .when(|state| state.view.bounds.is_some()),
    key(
        CAMERA,
        ("Shift+F", Modifiers::SHIFT, Key::F),
        "Back to the first view",
        |_| Command::ResetView,
    ),
    from(("Ctrl+1", Key::Num1), "From the front", |state| {
        Command::MoveCamera(CameraMove::From(front(state.view.up)))
    }),
    from(("Ctrl+3", Key::Num3), "From the right", |state| {
        Command::MoveCamera(CameraMove::From(right_side(state.view.up)))
    }),
    from(("Ctrl+7", Key::Num7), "From above", |state| {
        Command::MoveCamera(CameraMove::From(state.view.up))
    }),
    gesture(
        OBJECT,
        "Click",
        "Look into the point under the pointer, or edit a part",
    ),
    gesture(
        LIGHT,
        "Shift+drag, Shift+right drag",
        "Rotate the environment",
    ),
    gesture(
        LIGHT,
        "Shift+middle drag, Ctrl+Shift+drag",
        "Move the environment",
    ),
    key(
        LIGHT,
        ("M", Modifiers::NONE, Key::M),
        "Handles to move, turn and scale the environment; Ctrl for round steps",
        |_| Command::Lighting(LightingCommand::ToggleGizmo),
    )
    .marked(|state| state.lighting.is_gizmo_shown),
    key(
        LIGHT,
        ("L", Modifiers::NONE, Key::L),
        "Axes and bounds",
        |_| Command::Lighting(LightingCommand::ToggleLines),
    )
    .marked(|state| state.lighting.are_lines_shown),
    key(
        LIGHT,
        ("H", Modifiers::NONE, Key::H),
        "Background: shown, blurred, hidden",
        |state| {
            let next = state.lighting.background.next();
            Command::Lighting(LightingCommand::SetBackground(next))
        },
    ),
    key(
        LIGHT,
        ("Shift+E", Modifiers::SHIFT, Key::E),
        "Darker picture, by half a stop",
        |state| expose(state, -0.5),
    ),
    key(
        LIGHT,
        ("E", Modifiers::NONE, Key::E),
        "Brighter picture, by half a stop",
        |state| expose(state, 0.5),
    ),
    key(
        LIGHT,
        ("V", Modifiers::NONE, Key::V),
        "Two looks side by side: A as edited, B as kept",
        |_| Command::Lighting(LightingCommand::ToggleSplit),
    )
    .marked(|state| state.lighting.split.is_some()),
    key(
        LIGHT,
        ("X", Modifiers::NONE, Key::X),
        "Swap A and B",
        |_| Command::Lighting(LightingCommand::SwapSides),
    )
    .when(|state| state.lighting.kept.is_some()),
    key(
        LIGHT,
        ("B", Modifiers::NONE, Key::B),
        "Before and after: hide or show all edits",
        |state| Command::ShowOriginal(!state.is_original_shown),
    )
    .when(|state| state.look != Look::default())
    .marked(|state| state.is_original_shown),
    plain(LIGHT, "Back to the environment as captured", |_| {
        Command::ChooseEnvironment(None)
    })
    .when(|state| state.look.environment.is_some()),
    plain(LIGHT, "Put the environment back where it was", |_| {
        Command::MoveEnvironment(EnvironmentTransform::default())
    })
    .when(|state| state.look.transform != EnvironmentTransform::default()),
    plain(LIGHT, "Match exposure", |_| Command::MatchExposure)
        .when(|state| state.chosen_environment().is_some()),
    key(
        COMPARE,
        ("[", Modifiers::NONE, Key::OpenBracket),
        "Previous photo's camera",
        |_| Command::StepView(-1),
    )
    .when(has_photos),
    key(
        COMPARE,
        ("]", Modifiers::NONE, Key::CloseBracket),
        "Next photo's camera",
        |_| Command::StepView(1),
    )
    .when(has_photos),
    key(
        COMPARE,
        ("{", Modifiers::NONE, Key::OpenCurlyBracket),
        "First photo's camera",
        |_| Command::GoToView(0),
    )
    .when(has_photos),
    key(
        COMPARE,
        ("}", Modifiers::NONE, Key::CloseCurlyBracket),
        "Last photo's camera",
        |state| Command::GoToView(state.views().count().saturating_sub(1)),
    )
    .when(has_photos),
    key(
        COMPARE,
        ("Shift+W", Modifiers::SHIFT, Key::W),
        "Photo and rendering side by side",
        |state| compare(state, Comparison::Beside),
    ),
    key(
        COMPARE,
        ("T", Modifiers::NONE, Key::T),
        "Photo and rendering in turn (flicker)",
        |state| compare(state, Comparison::Flicker),
    ),
    key(
        COMPARE,
        ("D", Modifiers::NONE, Key::D),
        "Difference from the photo: absolute, signed, FLIP, off",
        |state| Command::Watch(WatchCommand::Compare(state.compare.with_photo.next_error())),
    ),
    key(
        COMPARE,
        ("C", Modifiers::NONE, Key::C),
        "Show the photos' cameras; click one to go there",
        |state| Command::Watch(WatchCommand::ShowCameras(!state.watch.are_cameras_shown)),
    ),
    key(
        COMPARE,
        ("W", Modifiers::NONE, Key::W),
        "Wipe between photo and rendering",
        |state| {
            Command::SetWipe(if state.compare.wipe.is_some() {
                None
            } else {
                Some(0.5)
            })
        },
    )
    .when(has_photos)
    .marked(|state| state.compare.wipe.is_some()),
    gesture(COMPARE, "Hold G", "Show the photo"),
    layer("1", Key::Num1, "Lit", |_| Command::ShowLayer(Layer::Final))
        .marked(|state| state.layer == Layer::Final),
    layer("2", Key::Num2, "Diffuse", |_| {
        Command::ShowLayer(Layer::Diffuse)
    })
    .marked(|state| state.layer == Layer::Diffuse),
    layer("3", Key::Num3, "Specular", |_| {
        Command::ShowLayer(Layer::Specular)
    })
    .marked(|state| state.layer == Layer::Specular),
    layer("4", Key::Num4, "Roughness", |_| {
        Command::ShowLayer(Layer::Roughness)
    })
    .marked(|state| state.layer == Layer::Roughness),
    layer("5", Key::Num5, "Tint", |_| Command::ShowLayer(Layer::Tint))
        .marked(|state| state.layer == Layer::Tint),
    layer("6", Key::Num6, "Normals", |_| {
        Command::ShowLayer(Layer::Normal)
    })
    .marked(|state| state.layer == Layer::Normal),
    layer("7", Key::Num7, "Environment alone", |_| {
        Command::ShowLayer(Layer::Environment)
    })
    .marked(|state| state.layer == Layer::Environment),
    layer("8", Key::Num8, "Depth", |_| {
        Command::ShowLayer(Layer::Depth)
    })
    .marked(|state| state.layer == Layer::Depth),
    layer("9", Key::Num9, "Visibility of a uniform sky", |_| {
        Command::ShowLayer(Layer::Visibility)
    })
    .marked(|state| state.layer == Layer::Visibility),
    layer("0", Key::Num0, "Field samples a pixel", |_| {
        Command::ShowLayer(Layer::Samples)
    })
    .marked(|state| state.layer == Layer::Samples),
    plain(LAYERS, "Albedo", |_| Command::ShowLayer(Layer::Albedo))
        .marked(|state| state.layer == Layer::Albedo),
    plain(LAYERS, "Irradiance", |_| {
        Command::ShowLayer(Layer::Irradiance)
    })
    .marked(|state| state.layer == Layer::Irradiance),
    plain(LAYERS, "Seen by photos", |_| {
        Command::ShowLayer(Layer::Seen)
    })
    .marked(|state| state.layer == Layer::Seen),
    plain(TRAINING, "Start training, or train further", |_| {
        Command::Train(Train::Start)
    })
    .when(can_start),
    key(
        TRAINING,
        ("Space", Modifiers::NONE, Key::Space),
        "Pause or resume",
        |_| Command::Train(Train::PauseOrResume),
    )
    .when(is_running),
    key(
        TRAINING,
        (".", Modifiers::NONE, Key::Period),
        "One step",
        |_| Command::Train(Train::Step),
    )
    .when(is_running),
    plain(TRAINING, "Train one minute longer", |_| {
        Command::Train(Train::Extend(60.0))
    })
    .when(|state| state.training.phase.takes_commands()),
    plain(TRAINING, "Train five minutes longer", |_| {
        Command::Train(Train::Extend(300.0))
    })
    .when(|state| state.training.phase.takes_commands()),
    plain(TRAINING, "Stop training", |_| Command::Train(Train::Stop)).when(is_running),
    key(
        WINDOW,
        ("Ctrl+K, Ctrl+P", Modifiers::COMMAND, Key::K),
        "Find a command…",
        |_| Command::Palette(PaletteCommand::Toggle),
    )
    .or(Modifiers::COMMAND, Key::P),
    key(
        WINDOW,
        ("F11", Modifiers::NONE, Key::F11),
        "Full screen",
        |_| Command::ToggleFullScreen,
    )
    .marked(|state| state.is_full_screen),
    key(
        WINDOW,
        ("?", Modifiers::NONE, Key::Questionmark),
        "Mouse and keys",
        |_| Command::ToggleHelp,
    )
    .marked(|state| state.overlays.is_help_open),
    plain(WINDOW, "Messages", |_| Command::ToggleLog).marked(|state| state.preferences.is_log_open),
    key(
        WINDOW,
        ("Esc", Modifiers::NONE, Key::Escape),
        "Close what is in front, or forget the picked point",
        |_| Command::CloseOverlays,
    ),
    gesture(
        WINDOW,
        "Double-click a slider's name",
        "Back to its default",
    ),
    key(
        WINDOW,
        ("Tab", Modifiers::NONE, Key::Tab),
        "Show or hide the side panels",
        |_| Command::Preferences(PreferencesCommand::TogglePanels),
    )
    .marked(|state| state.preferences.panels.is_any_shown()),
    plain(WINDOW, "Left panel", |_| {
        Command::Preferences(PreferencesCommand::TogglePanel(Side::Left))
    })
    .marked(|state| !state.preferences.panels.left.is_hidden),
    plain(WINDOW, "Right panel", |_| {
        Command::Preferences(PreferencesCommand::TogglePanel(Side::Right))
    })
    .marked(|state| !state.preferences.panels.right.is_hidden),
    key(
        WINDOW,
        ("Ctrl +", Modifiers::COMMAND, Key::Plus),
        "Larger text",
        |_| Command::Preferences(PreferencesCommand::Zoom(1.0)),
    )
    .or(Modifiers::COMMAND, Key::Equals),
    key(
        WINDOW,
        ("Ctrl -", Modifiers::COMMAND, Key::Minus),
        "Smaller text",
        |_| Command::Preferences(PreferencesCommand::Zoom(-1.0)),
    ),
    key(
        WINDOW,
        ("Ctrl 0", Modifiers::COMMAND, Key::Num0),
        "Text of the usual size",
        |_| Command::Preferences(PreferencesCommand::ResetZoom),
    ),
    plain(WINDOW, "Theme of the system", |_| {
        Command::Preferences(PreferencesCommand::Theme(ThemeChoice::System))
    })
    .marked(|state| state.preferences.theme == ThemeChoice::System),
    plain(WINDOW, "Light theme", |_| {
        Command::Preferences(PreferencesCommand::Theme(ThemeChoice::Light))
    })
    .marked(|state| state.preferences.theme == ThemeChoice::Light),
    plain(WINDOW, "Dark theme", |_| {
        Command::Preferences(PreferencesCommand::Theme(ThemeChoice::Dark))
    })
    .marked(|state| state.preferences.theme == ThemeChoice::Dark),
];

#[cfg(test)]
mod tests;
