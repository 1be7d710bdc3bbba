//! Undo and redo: what is noted before and after a command, and what a step brings back.

use std::cmp::Ordering;
use std::path::Path;

use super::choose::choose_environment;
use crate::app::lighting::LightingCommand;
use crate::app::state::app_state::{AppState, Compare};
use crate::app::state::command::{Command, Effect};
use crate::app::state::history::{HistoryCommand, Moment, Place};
use crate::app::state::look::{Look, StoredLook};
use crate::app::viewport::camera_control::CameraMove;

/// What was before a command.
#[derive(Clone, Copy, Debug)]
pub(in crate::app) struct Before {
    jumped_from: Option<Place>,
    is_step: bool,
}

fn moment(state: &AppState) -> Moment {
    let lighting = &state.lighting;
    Moment {
        look: StoredLook::of(state, &state.look),
        kept: lighting.kept.map(|kept| StoredLook::of(state, &kept)),
        background: lighting.background,
        display_ev: lighting.display_ev,
        tone_map: lighting.tone_map,
        removed: state.removed_environments().map(Path::to_owned).collect(),
        n_jumps: state.history.n_jumps,
    }
}

fn place(state: &AppState) -> Place {
    Place {
        viewpoint: state.view.viewpoint,
        up: state.view.up,
        at_view: state.view.at_view,
    }
}

/// Whether there is a step back.
pub fn can_undo(state: &AppState) -> bool {
    if state.object.is_open {
        return !state.object.strokes.is_empty();
    }
    state.history.undoer.has_undo(&moment(state))
}

/// Whether there is a step forth again.
pub fn can_redo(state: &AppState) -> bool {
    if state.object.is_open {
        return !state.object.undone.is_empty();
    }
    state.history.undoer.has_redo(&moment(state))
}

/// Takes in what has changed; called once a frame, as not all changes come from commands.
pub fn watch(state: &mut AppState) {
    let (now, moment) = (state.messages.now_secs, moment(state));
    state.history.undoer.feed_state(now, &moment);
}

/// To be called before a command is applied.
pub(in crate::app) fn before(state: &mut AppState, command: &Command) -> Before {
    let is_jump = matches!(
        command,
        Command::GoToView(_)
            | Command::StepView(_)
            | Command::FrameObject
            | Command::ResetView
            | Command::MoveCamera(CameraMove::From(_))
            | Command::SetUp(_)
            | Command::Watch(_)
            | Command::SetWipe(Some(_))
            | Command::HoldPhoto(true)
    );
    let is_choice = matches!(
        command,
        Command::ChooseEnvironment(_)
            | Command::Lighting(
                LightingCommand::SetBackground(_)
                    | LightingCommand::SetToneMap(_)
                    | LightingCommand::Remove(_)
                    | LightingCommand::SwapSides
                    | LightingCommand::CopyToB
            )
    );
    let is_step = is_jump || is_choice;
    watch(state);
    if is_step {
        // What is being dragged ends here.
        close_step(state);
    }
    Before {
        jumped_from: is_jump.then(|| place(state)),
        is_step,
    }
}

/// To be called after a command was applied.
pub(in crate::app) fn after(state: &mut AppState, before: Before) {
    let now = place(state);
    if let Some(from) = before.jumped_from.filter(|from| *from != now) {
        let history = &mut state.history;
        history.jumps.truncate(history.n_jumps);
        history.jumps.push([from, now]);
        history.n_jumps += 1;
    }
    watch(state);
    if before.is_step {
        close_step(state);
    }
}

fn close_step(state: &mut AppState) {
    let moment = moment(state);
    state.history.undoer.add_undo(&moment);
}

/// Goes a step back or forth.
pub(super) fn apply(state: &mut AppState, command: HistoryCommand, effects: &mut Vec<Effect>) {
    let mut now = moment(state);
    loop {
        let undoer = &mut state.history.undoer;
        let wanted = match command {
            HistoryCommand::Undo => undoer.undo(&now),
            HistoryCommand::Redo => undoer.redo(&now),
        };
        let Some(wanted) = wanted.cloned() else {
            return;
        };
        restore(state, &wanted, effects);
        if moment(state) == wanted {
            return;
        }
        // Its environment cannot be read any more: on to the next.
        now = wanted;
    }
}

fn restore(state: &mut AppState, moment: &Moment, effects: &mut Vec<Effect>) {
    let look = moment.look.to_look(state, effects);
    let chosen_before = state.look.environment;
    state.look = Look {
        environment: chosen_before,
        ..look
    };
    // Hidden edits would make this look as if nothing happened.
    state.is_original_shown = false;
    if look.environment != chosen_before {
        choose_environment(state, look.environment, effects);
    }
    let kept = moment.kept.as_ref();
    state.lighting.kept = kept.map(|kept| kept.to_look(state, effects));
    if state.lighting.kept.is_none() {
        state.lighting.split = None;
    }
    state.lighting.background = moment.background;
    state.lighting.display_ev = moment.display_ev;
    state.lighting.tone_map = moment.tone_map;
    state.remove_environments(&moment.removed);
    let history = &mut state.history;
    let target = match moment.n_jumps.cmp(&history.n_jumps) {
        Ordering::Less => history.jumps.get(moment.n_jumps).map(|[from, _]| *from),
        Ordering::Equal => None,
        Ordering::Greater => history.jumps.get(moment.n_jumps - 1).map(|[_, to]| *to),
    };
    history.n_jumps = moment.n_jumps;
    if let Some(place) = target {
        state.view.viewpoint = place.viewpoint;
        state.view.up = place.up;
        state.view.at_view = place.at_view.filter(|&view| state.view_at(view).is_some());
        state.view.was_moved = true;
        if state.view.at_view.is_none() {
            state.compare = Compare::default();
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::app::changes::apply::apply as apply_command;
    use crate::app::state::source::{EnvironmentContent, EnvironmentEntry};
    use crate::app::viewport::camera_control::CameraMove;
    use crate::geometry::Aabb;
    use crate::neif::{EnvironmentTransform, MaterialEdit};
    use crate::render::Background;
    use glam::Vec3;
    use std::path::PathBuf;

    fn state() -> AppState {
        let mut state = AppState::default();
        state.view.bounds = Some(Aabb {
            min: Vec3::ZERO,
            max: Vec3::ONE,
        });
        for name in ["a", "b"] {
            state.environments.push(EnvironmentEntry {
                name: name.to_owned(),
                path: name.into(),
                about: String::new(),
                content: EnvironmentContent::Loading,
            });
        }
        watch(&mut state);
        state
    }

    fn run(state: &mut AppState, at_secs: f64, command: Command) {
        state.messages.now_secs = at_secs;
        apply_command(state, command, &mut Vec::new());
    }

    fn tint(tint_scale: f32) -> Command {
        Command::Edit(MaterialEdit {
            tint_scale,
            ..MaterialEdit::default()
        })
    }

    const UNDO: Command = Command::History(HistoryCommand::Undo);
    const REDO: Command = Command::History(HistoryCommand::Redo);

    #[test]
    fn how_environments_are_shown_and_listed_is_undone_too() {
        let mut state = state();
        let done = [
            Command::Lighting(LightingCommand::SetBackground(Background::Hidden)),
            Command::Lighting(LightingCommand::SetDisplayEv(1.5)),
            Command::Lighting(LightingCommand::ToggleSplit),
            tint(0.5),
            Command::Lighting(LightingCommand::CopyToB),
            Command::Lighting(LightingCommand::Remove(1)),
        ];
        for (i, command) in done.into_iter().enumerate() {
            run(&mut state, 1.0 + 2.0 * i as f64, command);
        }
        let tint_of_b = |state: &AppState| state.lighting.kept.map(|kept| kept.edit.tint_scale);
        assert_eq!(
            (tint_of_b(&state), state.lighting.removed.len()),
            (Some(0.5), 1)
        );
        run(&mut state, 13.0, UNDO);
        assert!(state.lighting.removed.is_empty());
        run(&mut state, 15.0, UNDO);
        assert_eq!(
            (tint_of_b(&state), state.look.edit.tint_scale),
            (Some(1.0), 0.5)
        );
        run(&mut state, 17.0, UNDO);
        assert_eq!(state.look.edit.tint_scale, 1.0);
        run(&mut state, 19.0, UNDO);
        assert_eq!((tint_of_b(&state), state.lighting.split), (None, None));
        run(&mut state, 21.0, UNDO);
        assert_eq!(state.lighting.display_ev, 0.0);
        run(&mut state, 23.0, UNDO);
        assert_eq!(state.lighting.background, Background::Auto);
        run(&mut state, 25.0, Command::History(HistoryCommand::Redo));
        assert_eq!(state.lighting.background, Background::Hidden);
    }

    #[test]
    fn a_drag_is_one_step_and_a_pause_ends_it() {
        let mut state = state();
        for i in 0..20 {
            run(&mut state, f64::from(i) * 0.02, tint(0.5 + 0.01 * i as f32));
        }
        run(&mut state, 10.0, tint(1.5));
        run(&mut state, 20.0, UNDO);
        assert_eq!(state.look.edit.tint_scale, 0.5 + 0.01 * 19.0);
        run(&mut state, 20.1, UNDO);
        assert_eq!(state.look.edit, MaterialEdit::default());
        assert!(!can_undo(&state) && can_redo(&state), "at the beginning");
        run(&mut state, 20.2, REDO);
        run(&mut state, 20.3, REDO);
        assert_eq!(state.look.edit.tint_scale, 1.5);
        assert!(!can_redo(&state), "at the end");
    }

    #[test]
    fn a_jump_goes_back_to_where_the_camera_was_and_turning_it_is_no_step() {
        let mut state = state();
        let turn = CameraMove::Orbit {
            yaw: 0.3,
            pitch: 0.1,
        };
        run(&mut state, 1.0, Command::MoveCamera(turn));
        let turned = state.view.viewpoint;
        assert!(!can_undo(&state), "turning is no step");
        run(&mut state, 2.0, Command::FrameObject);
        let framed = state.view.viewpoint;
        assert_ne!(framed, turned);
        run(&mut state, 3.0, Command::MoveCamera(turn));
        run(&mut state, 4.0, UNDO);
        assert_eq!(state.view.viewpoint, turned);
        run(&mut state, 5.0, REDO);
        assert_eq!(state.view.viewpoint, framed);
    }

    #[test]
    fn environments_are_found_again_after_the_list_has_changed() {
        let mut state = state();
        run(&mut state, 1.0, Command::ChooseEnvironment(Some(1)));
        run(&mut state, 2.0, Command::ChooseEnvironment(None));
        state.environments.remove(0);
        run(&mut state, 3.0, UNDO);
        assert_eq!(state.look.environment, Some(0), "b is now the first");
        run(&mut state, 4.0, UNDO);
        state.environments.clear();
        let mut effects = Vec::new();
        apply_command(&mut state, REDO, &mut effects);
        assert_eq!(effects, [Effect::LoadEnvironment(0)], "read once more");
        assert_eq!(state.environments[0].path, PathBuf::from("b"));
    }

    #[test]
    fn a_new_edit_forgets_what_was_undone() {
        let mut state = state();
        run(&mut state, 1.0, tint(0.5));
        run(&mut state, 2.0, UNDO);
        run(&mut state, 3.0, tint(0.7));
        assert!(!can_redo(&state));
        run(&mut state, 4.0, REDO);
        assert_eq!(state.look.edit.tint_scale, 0.7);
    }

    proptest! {
        /// Whatever was done, undoing all of it leads to the beginning and redoing all to the end.
        #[test]
        fn all_steps_lead_back_and_forth(steps in prop::collection::vec((0..4_usize, 0.1_f32..2.0), 1..20)) {
            let mut state = state();
            let (first, home) = (state.look, state.view.viewpoint);
            for (i, &(kind, value)) in steps.iter().enumerate() {
                let command = match kind {
                    0 => tint(value),
                    1 => Command::ChooseEnvironment((value > 1.0).then_some(usize::from(value > 1.5))),
                    2 => Command::FrameObject,
                    _ => Command::MoveEnvironment(EnvironmentTransform { scale: value, ..state.look.transform }),
                };
                run(&mut state, i as f64, command);
            }
            let (last, end) = (state.look, state.view.viewpoint);
            for _ in 0..=steps.len() {
                run(&mut state, 100.0, UNDO);
            }
            prop_assert_eq!((state.look, state.view.viewpoint), (first, home));
            for _ in 0..=steps.len() {
                run(&mut state, 200.0, REDO);
            }
            prop_assert_eq!((state.look, state.view.viewpoint), (last, end));
        }
    }
}
