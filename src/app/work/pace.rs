//! How training and the window share the processor.

use egui::Ui;

use crate::app::panels::widgets::weak;
use crate::app::state::app_state::AppState;
use crate::app::state::command::{Command, Effect};
use crate::train::session::handle::Threads;

/// What comes first while training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pace {
    /// The window: training leaves it a core, and pictures follow each other as fast as they can.
    Responsive,
    /// Training has all cores, and pictures in motion take about a third of them.
    #[default]
    Balanced,
    /// Training: pictures in motion are few.
    Fast,
}

impl Pace {
    /// All, from the window's side to training's.
    pub const ALL: [Self; 3] = [Self::Responsive, Self::Balanced, Self::Fast];

    /// As on the buttons.
    pub fn name(self) -> &'static str {
        match self {
            Self::Responsive => "Responsive",
            Self::Balanced => "Balanced",
            Self::Fast => "Fast training",
        }
    }

    fn hint(self) -> &'static str {
        match self {
            Self::Responsive => "Training leaves a core to the window",
            Self::Balanced => "Training takes what dragging leaves",
            Self::Fast => "While you drag, few pictures; training hardly slows",
        }
    }

    /// The threads that training takes.
    pub fn threads(self) -> Threads {
        match self {
            Self::Responsive => Threads::OneFewer,
            Self::Balanced | Self::Fast => Threads::All,
        }
    }

    /// Share of all cores that pictures of something dragged may take while training, in `(0, 1]`.
    pub fn drag_share(self) -> f64 {
        match self {
            Self::Responsive => 1.0,
            Self::Balanced => 0.33,
            Self::Fast => 0.15,
        }
    }
}

/// Changes of the pace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PaceCommand {
    /// Take this one.
    Choose(Pace),
}

/// Changes the pace and tells training.
pub fn apply(pace: &mut Pace, command: PaceCommand, effects: &mut Vec<Effect>) {
    let PaceCommand::Choose(chosen) = command;
    *pace = chosen;
    effects.push(Effect::UseThreads(chosen.threads()));
}

/// Draws the choice.
pub fn pace_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    ui.horizontal_wrapped(|ui| {
        ui.label(weak(ui, "Pace"));
        for pace in Pace::ALL {
            let button = ui.selectable_label(state.pace == pace, pace.name());
            if button.on_hover_text(pace.hint()).clicked() {
                commands.push(Command::Pace(PaceCommand::Choose(pace)));
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chosen_pace_is_kept_and_training_hears_of_it() {
        let (mut pace, mut effects) = (Pace::default(), Vec::new());
        apply(
            &mut pace,
            PaceCommand::Choose(Pace::Responsive),
            &mut effects,
        );
        assert_eq!(pace, Pace::Responsive);
        assert_eq!(effects, [Effect::UseThreads(Threads::OneFewer)]);
    }

    #[test]
    fn the_nearer_to_training_the_less_for_pictures() {
        let shares = Pace::ALL.map(Pace::drag_share);
        assert!(shares.iter().rev().is_sorted(), "{shares:?}");
        assert!(shares.iter().all(|share| (0.1..=1.0).contains(share)));
    }
}
