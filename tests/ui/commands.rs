//! Menus and the command palette: both are the table of commands.

use egui::{Key, Modifiers};
use egui_kittest::kittest::{NodeT as _, Queryable as _};
use neif::app::AppState;
use neif::render::Layer;

use super::{click, harness, training_state};

#[test]
fn a_menu_does_what_its_key_does() {
    let mut harness = harness(training_state());
    click(&mut harness, "View");
    click(&mut harness, "Environment alone");
    assert_eq!(harness.state().state.layer, Layer::Environment);
    assert!(
        harness.query_by_label("Next photo's camera").is_none(),
        "the menu has closed"
    );
}

#[test]
fn what_is_not_possible_is_dead_in_its_menu() {
    let mut harness = harness(AppState::default());
    click(&mut harness, "File");
    let save = harness.get_by_label("Save the run…");
    assert!(save.accesskit_node().is_disabled(), "nothing to save");
}

#[test]
fn a_command_is_found_by_typing_and_done_by_enter() {
    for key in [Key::K, Key::P] {
        let mut harness = harness(training_state());
        harness.key_press_modifiers(Modifiers::COMMAND, key);
        harness.run_steps(3);
        harness.get_by_label("Find a command").type_text("next ph");
        harness.run_steps(3);
        assert_eq!(
            harness.state().state.layer,
            Layer::Final,
            "typing is no shortcut"
        );
        harness.key_press(Key::Enter);
        harness.run_steps(3);
        let state = &harness.state().state;
        assert_eq!(state.view.at_view, Some(1));
        assert_eq!(state.overlays.palette, None);
    }
}

#[test]
fn arrows_choose_and_escape_closes_the_palette() {
    let mut harness = harness(training_state());
    harness.key_press_modifiers(Modifiers::COMMAND, Key::K);
    harness.run_steps(3);
    harness.get_by_label("Find a command").type_text("camera");
    harness.run_steps(3);
    for key in [Key::ArrowDown, Key::ArrowDown, Key::ArrowUp] {
        harness.key_press(key);
        harness.run_steps(2);
    }
    let chosen = harness.state().state.overlays.palette.clone();
    assert_eq!(chosen.map(|palette| palette.chosen), Some(1));
    harness.key_press(Key::Escape);
    harness.run_steps(3);
    assert_eq!(harness.state().state.overlays.palette, None);
}
