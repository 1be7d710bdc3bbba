//! What picking a point and editing a region do.

use glam::Vec2;

use crate::app::inspect::{InspectCommand, Pick};
use crate::app::state::app_state::AppState;
use crate::app::state::training_state::Level;
use crate::neif::surface::region::MAX_REGIONS;
use crate::neif::{Extent, MaterialEdit, Region};

/// Changes the state by a command.
pub(super) fn apply(state: &mut AppState, command: InspectCommand) {
    let inspect = &mut state.inspect;
    match command {
        InspectCommand::PickAt { at, window } => pick_at(state, at, window),
        InspectCommand::Forget => inspect.forget(),
        InspectCommand::ShowSharp(on) => inspect.is_sharp = on,
        InspectCommand::AddRegion(extent) => add_region(state, extent),
        InspectCommand::SetExtent(index, extent) => {
            if let Some(region) = state.look.regions.get_mut(index) {
                region.extent = extent;
            }
        }
        InspectCommand::Edit(index, edit) => {
            if let Some(region) = state.look.regions.get_mut(index) {
                region.edit = edit;
            }
        }
        InspectCommand::RemoveRegion(index) => {
            state.look.regions.remove(index);
            inspect.hovered = None;
            inspect.scope = match inspect.scope {
                Some(scope) if scope == index => None,
                Some(scope) if scope > index => Some(scope - 1),
                scope => scope,
            };
        }
        InspectCommand::ChooseScope(scope) => inspect.scope = scope,
        InspectCommand::Hover(region) => inspect.hovered = region,
    }
}

fn pick_at(state: &mut AppState, at: Vec2, window: (u32, u32)) {
    state.inspect.forget();
    let hit = state.hit_at(at, window);
    let hit = hit.filter(|_| state.layer.shows_object());
    state.inspect.pick = hit.map(|hit| Pick {
        position: hit.position,
        normal: hit.normal,
        face_normal: hit.geometric_normal,
    });
}

fn add_region(state: &mut AppState, extent: Extent) {
    let Some(pick) = state.inspect.pick else {
        return;
    };
    let region = Region {
        seed: pick.position,
        extent,
        edit: MaterialEdit::default(),
    };
    if state.look.regions.push(region) {
        state.inspect.scope = Some(state.look.regions.len() - 1);
    } else {
        state.messages.say(
            Level::Warning,
            format!("There are {MAX_REGIONS} regions already: delete one first"),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::state::app_state::tests::snapshot;

    fn state() -> AppState {
        let snapshot = snapshot(1);
        let mut state = AppState::default();
        state.look_at_model(&snapshot);
        state.snapshot = Some(snapshot);
        state
    }

    #[test]
    fn a_pick_is_the_point_under_the_pointer_and_stays_there() {
        let mut state = state();
        let window = (400, 300);
        let mut n_hits = 0;
        for at in [(200.0, 150.0), (230.0, 160.0), (2.0, 2.0)] {
            let at = Vec2::from(at);
            apply(&mut state, InspectCommand::PickAt { at, window });
            let camera = state.window_camera(window);
            let Some(pick) = state.inspect.pick else {
                continue;
            };
            n_hits += 1;
            let shown = camera.project(pick.position).expect("in front");
            assert!((shown - at).length() < 0.05, "{shown} for {at}");
            let facing = pick.normal.dot(camera.position() - pick.position);
            assert!(facing > 0.0, "the normal looks at the eye");
        }
        assert_eq!(n_hits, 2, "the corner is beside the object");
        assert_eq!(state.inspect.pick, None, "and a click there forgets");
    }

    #[test]
    fn regions_grow_from_the_pick_and_the_scope_follows_them() {
        let mut state = state();
        apply(&mut state, InspectCommand::AddRegion(Extent::Part));
        assert!(state.look.regions.is_empty(), "nothing is picked");
        let at = Vec2::new(200.0, 150.0);
        let window = (400, 300);
        apply(&mut state, InspectCommand::PickAt { at, window });
        for _ in 0..=MAX_REGIONS {
            apply(&mut state, InspectCommand::AddRegion(Extent::Part));
        }
        assert_eq!(state.look.regions.len(), MAX_REGIONS);
        assert_eq!(state.messages.all().len(), 1, "one too many");
        apply(&mut state, InspectCommand::ChooseScope(Some(3)));
        apply(&mut state, InspectCommand::RemoveRegion(1));
        assert_eq!(state.inspect.scope, Some(2), "the same region");
        apply(&mut state, InspectCommand::RemoveRegion(2));
        assert!(state.scope().is_none(), "its region is gone");
    }
}
