//! The question before training that was never saved is lost: asked, answered, and settled by a save.

use super::ask_path::ask;
use crate::app::session::leaving::{Goal, Leaving, LeavingCommand};
use crate::app::state::app_state::{AppState, PathPurpose};
use crate::app::state::command::Effect;
use crate::app::state::source::{Source, is_light};
use crate::train::session::events::TrainCommand;

/// Whether ending the run now would lose training: it goes on or waits, was not saved as it is, and
/// has no folder into which it saves itself. The bundled demo is nobody's work.
pub fn is_training_unsaved(state: &AppState) -> bool {
    let training = &state.training;
    training.phase.takes_commands()
        && training.is_unsaved()
        && !matches!(state.source, Source::Run(_) | Source::Demo(_))
}

/// Goes on to `goal`, or asks first.
pub(in crate::app) fn go(state: &mut AppState, goal: Goal, effects: &mut Vec<Effect>) {
    state.overlays.path_dialog = None;
    let is_harmless = matches!(&goal, Goal::Open(path) if is_light(path));
    if is_training_unsaved(state) && !is_harmless && !state.is_leaving_for_sure {
        state.leaving = Some(Leaving {
            goal,
            saving_after: None,
        });
    } else {
        reach(state, goal, effects);
    }
}

fn reach(state: &mut AppState, goal: Goal, effects: &mut Vec<Effect>) {
    effects.push(match goal {
        Goal::Open(path) => Effect::Open(path),
        Goal::OpenDemo => Effect::OpenDemo,
        Goal::Close => {
            state.is_leaving_for_sure = true;
            Effect::Close
        }
    });
}

/// Changes the state by an answer.
pub(super) fn apply(state: &mut AppState, command: LeavingCommand, effects: &mut Vec<Effect>) {
    match command {
        LeavingCommand::Close => go(state, Goal::Close, effects),
        LeavingCommand::Cancel => state.leaving = None,
        LeavingCommand::Discard => {
            if let Some(leaving) = state.leaving.take() {
                reach(state, leaving.goal, effects);
            }
        }
        LeavingCommand::Save => match state.training.saved.clone() {
            Some(folder) => {
                save_began(state);
                effects.push(Effect::Train(TrainCommand::Save(folder)));
            }
            None => ask(state, PathPurpose::Save),
        },
    }
}

/// To be called when the run is being saved: the question then waits for that.
pub(in crate::app) fn save_began(state: &mut AppState) {
    if let Some(leaving) = &mut state.leaving {
        leaving.saving_after = Some(state.training.saved_secs.len());
    }
}

/// To be called when saving may have failed: the question is open again.
pub(in crate::app) fn save_failed(state: &mut AppState) {
    if let Some(leaving) = &mut state.leaving {
        leaving.saving_after = None;
    }
}

/// To be called after news from training: goes on once the run is saved.
pub fn after_news(state: &mut AppState, effects: &mut Vec<Effect>) {
    let n_saves = state.training.saved_secs.len();
    let is_saved = |leaving: &mut Leaving| leaving.saving_after.is_some_and(|n| n_saves > n);
    if let Some(leaving) = state.leaving.take_if(is_saved) {
        reach(state, leaving.goal, effects);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::changes::apply::apply as apply_command;
    use crate::app::state::command::Command;
    use crate::train::session::events::{Progress, TrainEvent};

    fn training() -> AppState {
        let mut state = AppState {
            source: Source::Capture("/capture".into()),
            ..AppState::default()
        };
        let loaded = TrainEvent::Loaded {
            n_train: 1,
            n_val: 0,
            width: 1,
            height: 1,
            has_object: true,
            problems: Vec::new(),
            found: Vec::new(),
        };
        let progress = Progress {
            step: 10,
            ..Progress::default()
        };
        state.training.take(loaded);
        state.training.take(TrainEvent::Progress(progress));
        state
    }

    fn run(state: &mut AppState, command: Command) -> Vec<Effect> {
        let mut effects = Vec::new();
        apply_command(state, command, &mut effects);
        effects
    }

    const CLOSE: Command = Command::Leaving(LeavingCommand::Close);

    #[test]
    fn only_what_would_be_lost_raises_the_question() {
        let mut state = training();
        assert_eq!(run(&mut state, Command::Open("/sky.hdr".into())).len(), 1);
        assert_eq!(run(&mut state, Command::Open("/other".into())), []);
        assert!(state.leaving.is_some());
        for source in [Source::Demo("/d".into()), Source::Run("/r".into())] {
            let mut state = AppState {
                source,
                ..training()
            };
            assert_eq!(run(&mut state, CLOSE), [Effect::Close]);
        }
        let mut state = training();
        state.training.take(TrainEvent::Saved("/run".into()));
        assert_eq!(run(&mut state, CLOSE), [Effect::Close]);
    }

    #[test]
    fn saving_comes_before_what_was_asked_for() {
        let mut state = training();
        assert_eq!(run(&mut state, CLOSE), []);
        run(&mut state, Command::Leaving(LeavingCommand::Save));
        assert!(
            state.overlays.path_dialog.is_some(),
            "never saved: where to?"
        );
        let saves = run(&mut state, Command::UseTypedPath);
        assert!(matches!(saves[..], [Effect::Train(TrainCommand::Save(_))]));
        let mut effects = Vec::new();
        after_news(&mut state, &mut effects);
        assert_eq!(effects, [], "not saved yet");
        state.training.take(TrainEvent::Saved("/run".into()));
        after_news(&mut state, &mut effects);
        assert_eq!(effects, [Effect::Close]);
        assert!(state.leaving.is_none());
    }

    #[test]
    fn a_save_that_fails_leaves_the_choice() {
        let mut state = training();
        run(&mut state, CLOSE);
        state.training.saved = Some("/run".into());
        run(&mut state, Command::Leaving(LeavingCommand::Save));
        save_failed(&mut state);
        assert_eq!(state.leaving.as_ref().map(|l| l.saving_after), Some(None));
        assert_eq!(
            run(&mut state, Command::Leaving(LeavingCommand::Discard)),
            [Effect::Close]
        );
    }
}
