//! Training is paused, ended, prolonged and paced from the window.

use super::*;
use neif::app::session::preferences::Quality;

#[test]
fn training_is_paused_and_resumed_by_button_and_space() {
    let mut harness = harness(training_state());
    click(&mut harness, "Pause");
    assert_eq!(effects(&mut harness), [Effect::Train(TrainCommand::Pause)]);
    harness.state_mut().state.training.take(TrainEvent::Paused);
    harness.run_steps(2);
    click(&mut harness, "Resume");
    assert_eq!(effects(&mut harness), [Effect::Train(TrainCommand::Resume)]);
    harness.key_press(egui::Key::Space);
    harness.run_steps(2);
    assert_eq!(effects(&mut harness), [Effect::Train(TrainCommand::Resume)]);
    harness.key_press(egui::Key::Period);
    harness.run_steps(2);
    assert_eq!(
        effects(&mut harness),
        [Effect::Train(TrainCommand::StepOnce)]
    );
}

#[test]
fn figures_are_shown() {
    let harness = harness(training_state());
    harness.get_by_label("step 1234");
    harness.get_by_label("56 it/s");
    harness.get_by_label("2 photos, 32 × 24; 1 held out");
}

#[test]
fn stopping_asks_before_training_is_lost() {
    let mut harness = harness(training_state());
    click(&mut harness, "Stop");
    assert_eq!(effects(&mut harness), []);
    click(&mut harness, "Stop without saving");
    assert_eq!(effects(&mut harness), [Effect::Train(TrainCommand::Stop)]);
}

#[test]
fn a_finished_run_can_be_trained_longer() {
    let mut state = training_state();
    state.training.phase = Phase::Finished(neif::train::session::events::FinishReason::Budget);
    let mut harness = harness(state);
    click(&mut harness, "+1 min");
    let more = neif::train::session::plan::Budget::Seconds(60.0);
    assert_eq!(
        effects(&mut harness),
        [Effect::Train(TrainCommand::Extend(more))]
    );
    assert_eq!(harness.state().state.training.phase, Phase::Training);
}

#[test]
fn quality_is_chosen_before_training_and_brings_its_time() {
    let mut harness = harness(AppState::default());
    click(&mut harness, "Full");
    let state = &harness.state().state;
    assert_eq!(state.preferences.quality, Quality::Full);
    assert_eq!(state.watch.budget_secs, 1200.0);
    click(&mut harness, "Fast");
    assert_eq!(harness.state().state.watch.budget_secs, 300.0);
}

#[test]
fn the_pace_of_training_is_chosen_in_the_training_panel() {
    let mut state = AppState::default();
    state.training.phase = Phase::Training;
    let mut harness = harness(state);
    click(&mut harness, "Fast training");
    assert_eq!(harness.state().state.pace, Pace::Fast);
    click(&mut harness, "Responsive");
    assert_eq!(harness.state().state.pace, Pace::Responsive);
    let last = harness.state().effects.last();
    assert_eq!(last, Some(&Effect::UseThreads(Threads::OneFewer)));
}
