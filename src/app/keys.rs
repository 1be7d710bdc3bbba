//! Keys and gestures: one table, from which both the shortcuts and the help are made.

use egui::{Key, Modifiers};

use crate::app::command::{Command, Train};
use crate::app::state::{AppState, PathPurpose};
use crate::app::watch::{Comparison, WatchCommand};
use crate::render::Layer;

/// One line of the help.
pub struct Binding {
    /// The heading it stands under.
    pub group: &'static str,
    /// Keys or gesture, as people write them.
    pub keys: &'static str,
    /// What it does.
    pub what: &'static str,
    /// The key that does it, unless it is a gesture.
    pub shortcut: Option<Shortcut>,
}

/// A key and what it causes.
pub struct Shortcut {
    modifiers: Modifiers,
    key: Key,
    command: fn(&AppState) -> Command,
}

impl std::fmt::Debug for Binding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Binding")
            .field("keys", &self.keys)
            .field("what", &self.what)
            .finish_non_exhaustive()
    }
}

impl std::fmt::Debug for Shortcut {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Shortcut")
            .field("key", &self.key)
            .finish_non_exhaustive()
    }
}

const CAMERA: &str = "Camera";
const LIGHT: &str = "Environment";
const OBJECT: &str = "Object";
const COMPARE: &str = "Photos";
const LAYERS: &str = "Layers";
const TRAINING: &str = "Training";
const WINDOW: &str = "Window";

const fn gesture(group: &'static str, keys: &'static str, what: &'static str) -> Binding {
    Binding {
        group,
        keys,
        what,
        shortcut: None,
    }
}

const fn key(
    group: &'static str,
    (keys, modifiers, key): (&'static str, Modifiers, Key),
    what: &'static str,
    command: fn(&AppState) -> Command,
) -> Binding {
    Binding {
        group,
        keys,
        what,
        shortcut: Some(Shortcut {
            modifiers,
            key,
            command,
        }),
    }
}

const fn layer(
    keys: &'static str,
    number: Key,
    what: &'static str,
    command: fn(&AppState) -> Command,
) -> Binding {
    key(LAYERS, (keys, Modifiers::NONE, number), what, command)
}

/// Switches a comparison on, or off where it is on.
fn compare(state: &AppState, with: Comparison) -> Command {
    let is_on = state.compare.with_photo == with;
    Command::Watch(WatchCommand::Compare(if is_on {
        Comparison::Off
    } else {
        with
    }))
}

/// All of them. Of two with the same key, the one with more modifiers comes first.
pub const BINDINGS: &[Binding] = &[
    gesture(CAMERA, "Drag", "Turn about the pivot"),
    gesture(CAMERA, "Middle drag, Ctrl+drag", "Pan"),
    gesture(CAMERA, "Wheel", "Closer or farther"),
    gesture(
        CAMERA,
        "Double-click",
        "Turn about the point under the pointer",
    ),
    key(
        CAMERA,
        ("Shift+F", Modifiers::SHIFT, Key::F),
        "Back to the first view",
        |_| Command::ResetView,
    ),
    key(
        CAMERA,
        ("F", Modifiers::NONE, Key::F),
        "Show the whole object",
        |_| Command::FrameObject,
    ),
    gesture(
        OBJECT,
        "Click",
        "Look into the point under the pointer, or edit a part",
    ),
    gesture(LIGHT, "Shift+drag", "Rotate the environment"),
    gesture(
        LIGHT,
        "Shift+middle drag, Ctrl+Shift+drag",
        "Move the environment",
    ),
    key(
        LIGHT,
        ("B", Modifiers::NONE, Key::B),
        "Before and after: hide or show all edits",
        |state| Command::ShowOriginal(!state.is_original_shown),
    ),
    key(
        COMPARE,
        ("[", Modifiers::NONE, Key::OpenBracket),
        "Previous photo's camera",
        |_| Command::StepView(-1),
    ),
    key(
        COMPARE,
        ("]", Modifiers::NONE, Key::CloseBracket),
        "Next photo's camera",
        |_| Command::StepView(1),
    ),
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
        "Wipe between photo and rendering; drag the line",
        |state| {
            Command::SetWipe(if state.compare.wipe.is_some() {
                None
            } else {
                Some(0.5)
            })
        },
    ),
    gesture(COMPARE, "Hold G", "Show the photo"),
    layer("1", Key::Num1, "Lit", |_| Command::ShowLayer(Layer::Final)),
    layer("2", Key::Num2, "Diffuse", |_| {
        Command::ShowLayer(Layer::Diffuse)
    }),
    layer("3", Key::Num3, "Specular", |_| {
        Command::ShowLayer(Layer::Specular)
    }),
    layer("4", Key::Num4, "Roughness", |_| {
        Command::ShowLayer(Layer::Roughness)
    }),
    layer("5", Key::Num5, "Tint", |_| Command::ShowLayer(Layer::Tint)),
    layer("6", Key::Num6, "Normals", |_| {
        Command::ShowLayer(Layer::Normal)
    }),
    layer("7", Key::Num7, "Environment alone", |_| {
        Command::ShowLayer(Layer::Environment)
    }),
    layer("8", Key::Num8, "Depth", |_| {
        Command::ShowLayer(Layer::Depth)
    }),
    layer("9", Key::Num9, "Visibility of a uniform sky", |_| {
        Command::ShowLayer(Layer::Visibility)
    }),
    layer("0", Key::Num0, "Field samples a pixel", |_| {
        Command::ShowLayer(Layer::Samples)
    }),
    key(
        TRAINING,
        ("Space", Modifiers::NONE, Key::Space),
        "Pause or resume",
        |_| Command::Train(Train::PauseOrResume),
    ),
    key(
        TRAINING,
        (".", Modifiers::NONE, Key::Period),
        "One step",
        |_| Command::Train(Train::Step),
    ),
    key(
        WINDOW,
        ("Ctrl+O", Modifiers::COMMAND, Key::O),
        "Open",
        |_| Command::AskPath(PathPurpose::Open),
    ),
    key(
        WINDOW,
        ("Ctrl+S", Modifiers::COMMAND, Key::S),
        "Save the run",
        |_| Command::AskPath(PathPurpose::Save),
    ),
    key(
        WINDOW,
        ("?", Modifiers::NONE, Key::Questionmark),
        "This help",
        |_| Command::ToggleHelp,
    ),
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
    gesture(WINDOW, "Ctrl + and Ctrl -", "Larger and smaller text"),
];

/// What the keys pressed in this frame cause; nothing while text is typed.
pub fn pressed(ctx: &egui::Context, state: &AppState, commands: &mut Vec<Command>) {
    let has_focus = ctx.memory(|memory| memory.focused().is_some());
    if ctx.text_edit_focused() {
        return;
    }
    for shortcut in BINDINGS
        .iter()
        .filter_map(|binding| binding.shortcut.as_ref())
    {
        // The space bar presses the button that has the focus.
        if shortcut.key == Key::Space && has_focus {
            continue;
        }
        if ctx.input_mut(|input| input.consume_key(shortcut.modifiers, shortcut.key)) {
            commands.push((shortcut.command)(state));
        }
    }
    let is_held = ctx.input(|input| input.key_down(Key::G) && input.modifiers.is_none());
    if is_held != state.compare.is_photo_held {
        commands.push(Command::HoldPhoto(is_held));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_key_hides_behind_another() {
        let shortcuts: Vec<_> = BINDINGS
            .iter()
            .filter_map(|b| b.shortcut.as_ref().map(|s| (b.keys, s)))
            .collect();
        for (i, (keys, later)) in shortcuts.iter().enumerate() {
            for (_, earlier) in &shortcuts[..i] {
                let hides = earlier.key == later.key && later.modifiers.contains(earlier.modifiers);
                assert!(!hides, "{keys} is never reached");
            }
        }
    }

    #[test]
    fn every_layer_has_its_key_in_order() {
        let state = AppState::default();
        let layers: Vec<_> = BINDINGS
            .iter()
            .filter_map(|b| match (b.shortcut.as_ref()?.command)(&state) {
                Command::ShowLayer(layer) => Some(layer),
                _ => None,
            })
            .collect();
        assert_eq!(layers, Layer::ALL);
    }
}
