//! One line of the table of commands: what it is called, which keys it has, and what it causes.

use egui::{Key, KeyboardShortcut, Modifiers};

use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;

/// What depends on the state of the window.
type Of<T> = Box<dyn Fn(&AppState) -> T + Send + Sync>;

/// A command with its name and keys, or a gesture, which has no command.
///
/// Keys, menus, palette, help and the manual's table are all made of these.
pub struct Binding {
    /// The heading it stands under.
    pub group: &'static str,
    /// Keys or gesture, as people write them; empty where there are none.
    pub keys: &'static str,
    /// What it does.
    pub what: &'static str,
    command: Option<Of<Command>>,
    is_available: fn(&AppState) -> bool,
    is_on: Of<bool>,
}

impl std::fmt::Debug for Binding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Binding")
            .field("keys", &self.keys)
            .field("what", &self.what)
            .finish_non_exhaustive()
    }
}

/// Something done with the mouse, or handled elsewhere: only explained. Its group is given by the table.
pub(super) fn gesture(keys: &'static str, what: &'static str) -> Binding {
    Binding {
        group: "",
        keys,
        what,
        command: None,
        is_available: |_| true,
        is_on: Box::new(|_| false),
    }
}

/// A command; without keys it is in menus and palette only.
pub(super) fn entry(
    keys: &'static str,
    what: &'static str,
    command: impl Fn(&AppState) -> Command + Send + Sync + 'static,
) -> Binding {
    Binding {
        command: Some(Box::new(command)),
        ..gesture(keys, what)
    }
}

impl Binding {
    /// The same under this heading.
    pub(super) fn under(self, group: &'static str) -> Self {
        Self { group, ..self }
    }

    /// The same, possible only where `is_available` says so.
    pub(super) fn when(self, is_available: fn(&AppState) -> bool) -> Self {
        Self {
            is_available,
            ..self
        }
    }

    /// The same, marked in menus while `is_on` says so.
    pub(super) fn marked(self, is_on: impl Fn(&AppState) -> bool + Send + Sync + 'static) -> Self {
        Self {
            is_on: Box::new(is_on),
            ..self
        }
    }

    /// Its keys.
    pub fn shortcuts(&self) -> impl Iterator<Item = KeyboardShortcut> {
        self.keys.split(", ").flat_map(read_keys)
    }

    /// Whether it is a command and not a gesture.
    pub fn is_command(&self) -> bool {
        self.command.is_some()
    }

    /// What it causes now; none where it is a gesture or not possible.
    pub fn command(&self, state: &AppState) -> Option<Command> {
        let command = self.command.as_ref();
        Some(command.filter(|_| (self.is_available)(state))?(state))
    }

    /// Whether what it switches is on.
    pub fn is_on(&self, state: &AppState) -> bool {
        (self.is_on)(state)
    }
}

/// `Ctrl+Shift+Z` as the keyboard has it; none where it names no key. A plus is typed as an equals sign too.
fn read_keys(written: &str) -> Vec<KeyboardShortcut> {
    let (mut name, mut modifiers) = (written, Modifiers::NONE);
    for (prefix, modifier) in [("Ctrl", Modifiers::COMMAND), ("Shift", Modifiers::SHIFT)] {
        let rest = name.strip_prefix(prefix);
        if let Some(rest) = rest.and_then(|rest| rest.strip_prefix(['+', ' '])) {
            (name, modifiers) = (rest, modifiers.plus(modifier));
        }
    }
    let keys = match Key::from_name(name) {
        Some(Key::Plus) => vec![Key::Plus, Key::Equals],
        key => key.into_iter().collect(),
    };
    let shortcut = |key| KeyboardShortcut::new(modifiers, key);
    keys.into_iter().map(shortcut).collect()
}
