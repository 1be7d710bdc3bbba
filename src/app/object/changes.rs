//! What commands do to the selection.

use glam::Vec2;

use super::state::{ObjectCommand, ObjectState, Search};
use crate::app::changes::choose::go_to_view;
use crate::app::state::app_state::AppState;
use crate::app::state::command::Effect;
use crate::app::state::source::Source;
use crate::app::state::training_state::Level;
use crate::scans::Scan;
use crate::train::masks::{Selection, Stroke, point_at};

/// Said of a click that is to show the object.
const NOTHING_THERE: &str = "There is nothing at that place: click on the object";

impl AppState {
    /// Whether photos are open in which an object can be found, as their environment alone is trained.
    pub fn lacks_object(&self) -> bool {
        let is_of_photos = match &self.source {
            Source::Demo(path) | Source::Capture(path) => !Scan::is_named_so(path),
            _ => false,
        };
        let capture = self.training.capture.as_ref();
        let is_ready = self.snapshot.is_some() && self.dataset.is_some();
        is_of_photos && is_ready && capture.is_some_and(|c| !c.has_object)
    }

    /// The photo at hand while the object is selected.
    pub fn object_view(&self) -> Option<usize> {
        self.view.at_view.filter(|_| self.object.is_open)
    }
}

/// Changes the selection.
pub(in crate::app) fn apply(
    state: &mut AppState,
    command: ObjectCommand,
    effects: &mut Vec<Effect>,
) {
    match command {
        ObjectCommand::Select(true) if state.lacks_object() && !state.object.is_open => {
            state.object = ObjectState {
                is_open: true,
                ..ObjectState::default()
            };
            let nearest = state.view.at_view.or_else(|| state.nearest_view());
            go_to_view(state, nearest.unwrap_or(0));
        }
        ObjectCommand::Select(false) => state.object = ObjectState::default(),
        _ if !state.object.is_open => {}
        ObjectCommand::PointAt(at) => point(state, at),
        ObjectCommand::LookedAt => {
            state.object = aimed(&state.object, Some(Selection::default()));
        }
        ObjectCommand::SetAdds(adds) => state.object.adds = adds,
        ObjectCommand::SetBrush(share) => state.object.set_brush(share),
        ObjectCommand::Draw { at, adds } => draw(state, at, adds),
        ObjectCommand::Lift => {
            let object = &mut state.object;
            if let Some(stroke) = object.drawing.take() {
                object.strokes.push(stroke);
                object.undone.clear();
            }
        }
        ObjectCommand::Undo => {
            let object = &mut state.object;
            object.undone.extend(object.strokes.pop());
        }
        ObjectCommand::Redo => {
            let object = &mut state.object;
            object.strokes.extend(object.undone.pop());
        }
        ObjectCommand::Again => {
            state.object.n_looks += 1;
            state.object.search = Search::Idle;
        }
        ObjectCommand::Another => {
            state.object = aimed(&state.object, None);
        }
        ObjectCommand::Train if state.object.found.is_some() => effects.push(Effect::TrainObject),
        ObjectCommand::Select(true) | ObjectCommand::Train => {}
    }
}

/// With another object chosen; what was drawn was meant for the one before.
fn aimed(object: &ObjectState, selection: Option<Selection>) -> ObjectState {
    ObjectState {
        is_open: true,
        selection,
        brush: object.brush,
        n_looks: object.n_looks,
        step: object.step,
        search: object.search.clone(),
        ..ObjectState::default()
    }
}

fn point(state: &mut AppState, at: Vec2) {
    let view = state.object_view().and_then(|i| state.view_at(i));
    let (Some(view), Some(snapshot)) = (view, &state.snapshot) else {
        return;
    };
    let at = point_at(&snapshot.environment, &view.camera, at);
    if at.is_some() {
        state.object = aimed(
            &state.object,
            Some(Selection {
                at,
                ..Selection::default()
            }),
        );
    } else {
        state.messages.say(Level::Warning, NOTHING_THERE);
    }
}

fn draw(state: &mut AppState, at: Vec2, adds: bool) {
    let Some(index) = state.object_view() else {
        return;
    };
    let Some(view) = state.view_at(index) else {
        return;
    };
    let radius = state.object.brush * view.camera.width.min(view.camera.height) as f32;
    let new = || Stroke {
        view: index,
        places: Vec::new(),
        radius,
        adds,
    };
    let stroke = state.object.drawing.get_or_insert_with(new);
    // Nothing is gained by places closer than that.
    let is_new = |last: &Vec2| last.distance(at) > 0.2 * stroke.radius;
    if stroke.places.last().is_none_or(is_new) {
        stroke.places.push(at);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::app::state::app_state::tests::one_photo;
    use crate::app::state::training_state::CaptureInfo;
    use crate::render::test_scene::fog_where;
    use crate::train::Snapshot;

    fn capture() -> AppState {
        let (dataset, _) = one_photo(glam::Vec3::ONE);
        let mut state = AppState {
            source: Source::Capture("/photos".into()),
            dataset: Some(dataset),
            snapshot: Some(Arc::new(Snapshot {
                step: 1,
                object: None,
                environment: fog_where(|x| x.length() < 0.3),
                exposures: None,
            })),
            ..AppState::default()
        };
        state.training.capture = Some(CaptureInfo {
            n_train: 1,
            n_val: 0,
            size: (32, 24),
            has_object: false,
        });
        state
    }

    fn run(state: &mut AppState, command: ObjectCommand) -> Vec<Effect> {
        let mut effects = Vec::new();
        apply(state, command, &mut effects);
        effects
    }

    #[test]
    fn a_click_in_a_photo_shows_the_object() {
        let mut state = capture();
        let middle = Vec2::new(0.5, 0.5)
            * Vec2::from(state.view_at(0).map_or((1.0, 1.0), |view| {
                (view.camera.width as f32, view.camera.height as f32)
            }));
        run(&mut state, ObjectCommand::PointAt(middle));
        assert_eq!(state.object.selection, None, "nobody asked");
        run(&mut state, ObjectCommand::Select(true));
        assert_eq!(state.object_view(), Some(0), "at a photo");
        run(&mut state, ObjectCommand::PointAt(middle));
        assert!(state.object.selection.is_some_and(|it| it.at.is_some()));
        run(&mut state, ObjectCommand::LookedAt);
        assert_eq!(state.object.selection, Some(Selection::default()));
        assert_eq!(
            run(&mut state, ObjectCommand::Train),
            [],
            "nothing is found yet"
        );
        run(&mut state, ObjectCommand::Select(false));
        state.source = Source::Capture("/scan.ply".into());
        run(&mut state, ObjectCommand::Select(true));
        assert!(!state.object.is_open, "a scan has no photos");
    }

    #[test]
    fn strokes_are_drawn_taken_back_and_drawn_again() {
        let mut state = capture();
        run(&mut state, ObjectCommand::Select(true));
        run(&mut state, ObjectCommand::LookedAt);
        run(&mut state, ObjectCommand::SetBrush(7.0));
        assert_eq!(state.object.brush, 0.1, "within limits");
        for (adds, x) in [(true, 2.0), (false, 3.0)] {
            for i in 0..3 {
                let at = Vec2::new(x, i as f32);
                run(&mut state, ObjectCommand::Draw { at, adds });
            }
            assert_eq!(state.object.strokes.len(), usize::from(!adds), "not lifted");
            run(&mut state, ObjectCommand::Lift);
        }
        let drawn = state.object.strokes.clone();
        let adds: Vec<bool> = drawn.iter().map(|stroke| stroke.adds).collect();
        assert_eq!(adds, [true, false]);
        run(&mut state, ObjectCommand::Undo);
        assert_eq!(state.object.strokes, drawn[..1]);
        run(&mut state, ObjectCommand::Redo);
        assert_eq!(state.object.strokes, drawn);
        run(&mut state, ObjectCommand::Undo);
        let at = Vec2::ZERO;
        run(&mut state, ObjectCommand::Draw { at, adds: true });
        run(&mut state, ObjectCommand::Lift);
        run(&mut state, ObjectCommand::Redo);
        assert_eq!(
            state.object.strokes.len(),
            2,
            "a new stroke ends what could be drawn again"
        );
        run(&mut state, ObjectCommand::LookedAt);
        assert!(
            state.object.strokes.is_empty(),
            "they were meant for another object"
        );
    }
}
