//! Undo, sessions, the questions before something is lost, preferences, and the list of messages.

use std::path::PathBuf;

use egui::{Key, Modifiers};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable as _};
use neif::app::session::leaving::{Goal, Leaving};
use neif::app::session::preferences::ThemeChoice;
use neif::app::session::session_file::SessionFile;
use neif::app::state::source::Source;
use neif::app::state::training_state::Level;
use neif::app::{AppState, Effect};
use neif::neif::MaterialEdit;
use neif::train::session::events::{TrainCommand, TrainEvent};

use super::{Shown, click, effects, harness, training_state};

const SHIFT_COMMAND: Modifiers = Modifiers::COMMAND.plus(Modifiers::SHIFT);

fn press(harness: &mut Harness<'_, Shown>, modifiers: Modifiers, key: Key) {
    harness.key_press_modifiers(modifiers, key);
    harness.run_steps(3);
}

/// The window's clock goes on, so that what was done is a step of its own.
fn wait(harness: &mut Harness<'_, Shown>) {
    harness.state_mut().state.messages.now_secs += 2.0;
    harness.run_steps(1);
}

#[test]
fn edits_are_undone_and_redone_by_keys_and_buttons() {
    let mut harness = harness(training_state());
    let edit = |harness: &Harness<'_, Shown>| harness.state().state.look.edit;
    click(&mut harness, "One value");
    wait(&mut harness);
    let one_value = edit(&harness);
    click(&mut harness, "Reset material");
    wait(&mut harness);
    press(&mut harness, Modifiers::COMMAND, Key::Z);
    assert_eq!(edit(&harness), one_value);
    click(&mut harness, "Undo");
    assert_eq!(edit(&harness), MaterialEdit::default());
    press(&mut harness, SHIFT_COMMAND, Key::Z);
    assert_eq!(edit(&harness), one_value);
    press(&mut harness, Modifiers::COMMAND, Key::Y);
    assert_eq!(edit(&harness), MaterialEdit::default());
    click(&mut harness, "Undo");
    click(&mut harness, "Redo");
    assert_eq!(edit(&harness), MaterialEdit::default());
    let redo = harness.get_by_label("Redo").accesskit_node().is_disabled();
    assert!(redo, "nothing more to redo");
}

#[test]
fn a_jump_to_a_photo_is_undone() {
    let mut harness = harness(training_state());
    let view = |harness: &Harness<'_, Shown>| harness.state().state.view;
    let before = view(&harness);
    click(&mut harness, "train / b");
    assert_ne!(view(&harness).viewpoint, before.viewpoint);
    press(&mut harness, Modifiers::COMMAND, Key::Z);
    let after = view(&harness);
    assert_eq!(
        (after.viewpoint, after.at_view),
        (before.viewpoint, before.at_view)
    );
}

#[test]
fn typing_is_undone_in_its_field_and_nowhere_else() {
    let mut harness = harness(training_state());
    click(&mut harness, "One value");
    wait(&mut harness);
    let edit = harness.state().state.look.edit;
    press(&mut harness, Modifiers::COMMAND, Key::O);
    harness.get_by_label("Path").type_text("abc");
    harness.run_steps(3);
    press(&mut harness, Modifiers::COMMAND, Key::Z);
    assert_eq!(harness.state().state.look.edit, edit);
}

#[test]
fn saving_asks_where_to_once() {
    let mut harness = harness(training_state());
    press(&mut harness, Modifiers::COMMAND, Key::S);
    harness.get_by_label("Save the session");
    click(&mut harness, "Save");
    let file = match &effects(&mut harness)[..] {
        [Effect::SaveSession(file)] => file.clone(),
        other => panic!("{other:?}"),
    };
    harness.state_mut().state.session.file = Some(file.clone());
    press(&mut harness, Modifiers::COMMAND, Key::S);
    assert_eq!(effects(&mut harness), [Effect::SaveSession(file)]);
    press(&mut harness, SHIFT_COMMAND, Key::S);
    assert_eq!(effects(&mut harness), [], "asks again");
    harness.get_by_label("Save the session");
}

#[test]
fn what_was_left_behind_is_offered_and_not_forced() {
    let mut left = SessionFile::of(&AppState::default(), None);
    left.material.tint_scale = 0.5;
    let mut state = training_state();
    state.session.recovery = Some(Box::new(left.clone()));
    let mut restoring = harness(state.clone());
    assert_eq!(effects(&mut restoring), []);
    click(&mut restoring, "Restore session");
    assert_eq!(
        effects(&mut restoring),
        [Effect::RestoreSession(Box::new(left))]
    );
    let mut forgetting = harness(state);
    click(&mut forgetting, "Forget it");
    assert_eq!(forgetting.state().state.session.recovery, None);
}

#[test]
fn closing_asks_before_training_is_lost() {
    let mut harness = harness(training_state());
    press(&mut harness, Modifiers::COMMAND, Key::Q);
    harness.get_by_label("Close without saving the run?");
    assert_eq!(effects(&mut harness), []);
    press(&mut harness, Modifiers::NONE, Key::Escape);
    assert_eq!(harness.state().state.leaving, None);
    press(&mut harness, Modifiers::COMMAND, Key::Q);
    click(&mut harness, "Close without saving");
    assert_eq!(effects(&mut harness), [Effect::Close]);
}

#[test]
fn the_run_is_saved_where_it_was_before_something_else_is_opened() {
    let mut state = training_state();
    state.training.saved = Some(PathBuf::from("/runs/mug"));
    state.leaving = Some(Leaving {
        goal: Goal::Open(PathBuf::from("/other")),
        saving_after: None,
    });
    let mut harness = harness(state);
    harness.get_by_label("Save the run before opening “other”?");
    click(&mut harness, "Save the run");
    let save = TrainCommand::Save(PathBuf::from("/runs/mug"));
    assert_eq!(effects(&mut harness), [Effect::Train(save)]);
    harness.get_by_label("Saving…");
    let saved = TrainEvent::Saved(PathBuf::from("/runs/mug"));
    harness.state_mut().state.training.take(saved);
    harness.run_steps(2);
    assert_eq!(
        effects(&mut harness),
        [Effect::Open(PathBuf::from("/other"))]
    );
}

#[test]
fn tab_hides_the_panels_unless_a_control_has_the_focus() {
    let mut harness = harness(training_state());
    press(&mut harness, Modifiers::NONE, Key::Tab);
    assert!(harness.query_by_label("Material").is_none(), "hidden");
    press(&mut harness, Modifiers::NONE, Key::Tab);
    harness.get_by_label("Material");
    harness.get_by_label("One value").focus();
    harness.run_steps(2);
    press(&mut harness, Modifiers::NONE, Key::Tab);
    harness.get_by_label("Material");
}

#[test]
fn theme_and_size_are_chosen_by_menu_and_key() {
    let mut harness = harness(AppState::default());
    click(&mut harness, "Window");
    click(&mut harness, "Light theme");
    press(&mut harness, Modifiers::COMMAND, Key::Plus);
    press(&mut harness, Modifiers::COMMAND, Key::Equals);
    let preferences = &harness.state().state.preferences;
    assert_eq!(preferences.theme, ThemeChoice::Light);
    assert_eq!(preferences.zoom, 1.2);
    press(&mut harness, Modifiers::COMMAND, Key::Num0);
    assert_eq!(harness.state().state.preferences.zoom, 1.0);
}

#[test]
fn the_messages_show_causes_and_can_be_copied() {
    let mut state = AppState {
        source: Source::Run(PathBuf::from("/runs/mug")),
        ..AppState::default()
    };
    state.adapter.name = "llvmpipe".to_owned();
    let text = "/runs/mug: cannot be read\ndisk gone";
    state.messages.say(Level::Error, text);
    state.preferences.is_log_open = true;
    let mut harness = harness(state);
    harness.get_by_label("because disk gone");
    let copied = |harness: &Harness<'_, Shown>| {
        let commands = harness.output().platform_output.commands.clone();
        commands.into_iter().find_map(|command| match command {
            egui::OutputCommand::CopyText(text) => Some(text),
            _ => None,
        })
    };
    harness.get_by_label("Copy diagnostics").click();
    let mut text = None;
    for _ in 0..4 {
        harness.step();
        text = text.or_else(|| copied(&harness));
    }
    let text = text.expect("copied");
    for part in [env!("CARGO_PKG_VERSION"), "llvmpipe", "cores", "disk gone"] {
        assert!(text.contains(part), "{part} in {text}");
    }
}
