//! One line of the table of commands: what it is called, which keys it has, and what it causes.

use egui::{Key, KeyboardShortcut, Modifiers};

use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;

pub(super) const FILE: &str = "File";
pub(super) const EDIT: &str = "Edit";
pub(super) const CAMERA: &str = "Camera";
pub(super) const LIGHT: &str = "Environment";
pub(super) const OBJECT: &str = "Object";
pub(super) const COMPARE: &str = "Photos";
pub(super) const LAYERS: &str = "Layers";
pub(super) const TRAINING: &str = "Training";
pub(super) const WINDOW: &str = "Window";

/// A command with its name and keys, or a gesture, which has no command.
///
/// Keys, menus, palette, help and the manual's table are all made of these.
#[derive(Clone, Copy)]
pub struct Binding {
    /// The heading it stands under.
    pub group: &'static str,
    /// Keys or gesture, as people write them; empty where there are none.
    pub keys: &'static str,
    /// What it does.
    pub what: &'static str,
    shortcuts: [Option<KeyboardShortcut>; 2],
    command: Option<fn(&AppState) -> Command>,
    is_available: fn(&AppState) -> bool,
    is_on: fn(&AppState) -> bool,
}

impl std::fmt::Debug for Binding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Binding")
            .field("keys", &self.keys)
            .field("what", &self.what)
            .finish_non_exhaustive()
    }
}

/// Something done with the mouse, or handled elsewhere: only explained.
pub const fn gesture(group: &'static str, keys: &'static str, what: &'static str) -> Binding {
    Binding {
        group,
        keys,
        what,
        shortcuts: [None, None],
        command: None,
        is_available: |_| true,
        is_on: |_| false,
    }
}

/// A command without a key: in menus and palette only.
pub const fn plain(
    group: &'static str,
    what: &'static str,
    command: fn(&AppState) -> Command,
) -> Binding {
    Binding {
        command: Some(command),
        ..gesture(group, "", what)
    }
}

/// A command with a key.
pub const fn key(
    group: &'static str,
    (keys, modifiers, key): (&'static str, Modifiers, Key),
    what: &'static str,
    command: fn(&AppState) -> Command,
) -> Binding {
    Binding {
        keys,
        shortcuts: [Some(KeyboardShortcut::new(modifiers, key)), None],
        ..plain(group, what, command)
    }
}

impl Binding {
    /// The same with a second key; [`Self::keys`] should name both.
    pub const fn or(self, modifiers: Modifiers, key: Key) -> Self {
        Self {
            shortcuts: [
                self.shortcuts[0],
                Some(KeyboardShortcut::new(modifiers, key)),
            ],
            ..self
        }
    }

    /// The same, possible only where `is_available` says so.
    pub const fn when(self, is_available: fn(&AppState) -> bool) -> Self {
        Self {
            is_available,
            ..self
        }
    }

    /// The same, marked in menus while `is_on` says so.
    pub const fn marked(self, is_on: fn(&AppState) -> bool) -> Self {
        Self { is_on, ..self }
    }

    /// Its keys.
    pub fn shortcuts(&self) -> impl Iterator<Item = KeyboardShortcut> {
        self.shortcuts.into_iter().flatten()
    }

    /// Whether it is a command and not a gesture.
    pub fn is_command(&self) -> bool {
        self.command.is_some()
    }

    /// What it causes now; none where it is a gesture or not possible.
    pub fn command(&self, state: &AppState) -> Option<Command> {
        let command = self.command.filter(|_| (self.is_available)(state))?;
        Some(command(state))
    }

    /// Whether what it switches is on.
    pub fn is_on(&self, state: &AppState) -> bool {
        (self.is_on)(state)
    }
}
