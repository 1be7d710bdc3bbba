//! The object of photos without masks is selected.

use super::*;
use neif::app::object::ObjectCommand;
use neif::train::Snapshot;
use neif::train::masks::Selection;

#[test]
fn an_object_without_masks_is_selected_in_a_photo() {
    let mut state = training_state();
    state.snapshot = Some(Arc::new(Snapshot {
        step: 1,
        object: None,
        environment: Arc::new(white_sky()),
        exposures: None,
    }));
    let mut harness = harness(state);
    let button = "Select the object…";
    assert!(harness.query_by_label(button).is_none(), "it has one");
    let capture = harness.state_mut().state.training.capture.as_mut();
    capture.expect("a capture").has_object = false;
    harness.run_steps(2);
    click(&mut harness, button);
    harness.get_by_label("Select the object");
    assert_eq!(harness.state().state.object_view(), Some(0), "at a photo");
    // A far sky has nothing to click on.
    let Shown { state, effects, .. } = harness.state_mut();
    let point = ObjectCommand::PointAt(glam::Vec2::new(16.0, 12.0));
    apply(state, Command::Object(point), effects);
    assert_eq!(state.object.selection, None);
    click(&mut harness, "What the photos look at");
    let selection = harness.state().state.object.selection;
    assert_eq!(selection, Some(Selection::default()));
    click(&mut harness, "Cancel");
    assert!(!harness.state().state.object.is_open);
    harness.get_by_label(button);
}
