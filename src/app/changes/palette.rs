//! The palette of commands: what answers to what is typed.

use crate::app::keys::binding::Binding;
use crate::app::keys::table::BINDINGS;
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::palette::{Palette, PaletteCommand};

/// Changes the state by what happens in the palette; returns the command that was chosen.
pub(super) fn apply(state: &mut AppState, command: PaletteCommand) -> Option<Command> {
    match (command, &mut state.overlays.palette) {
        (PaletteCommand::Toggle, palette) => {
            *palette = palette.is_none().then(Palette::default);
        }
        (PaletteCommand::Type(typed), Some(palette)) => {
            *palette = Palette { typed, chosen: 0 };
        }
        (PaletteCommand::Step(by), Some(palette)) => {
            let palette = palette.clone();
            let n = found(state, &palette.typed).len().max(1) as isize;
            let chosen = (palette.chosen as isize + by).rem_euclid(n) as usize;
            state.overlays.palette = Some(Palette { chosen, ..palette });
        }
        (PaletteCommand::Run(index), Some(palette)) => {
            let typed = std::mem::take(&mut palette.typed);
            let command = found(state, &typed).into_iter().nth(index);
            state.overlays.palette = None;
            return command.map(|(_, command)| command);
        }
        (_, None) => {}
    }
    None
}

/// The commands that are possible now and answer to what is typed, the best answer first.
pub(in crate::app) fn found(state: &AppState, typed: &str) -> Vec<(&'static Binding, Command)> {
    let mut found: Vec<_> = BINDINGS
        .iter()
        .filter_map(|binding| {
            let command = binding.command(state)?;
            let score = score(typed, &format!("{} {}", binding.group, binding.what))?;
            // The palette is there already, and Esc closes it.
            let is_idle = matches!(command, Command::Palette(_) | Command::CloseOverlays);
            (!is_idle).then_some((score, binding, command))
        })
        .collect();
    // Equal answers stay in the order of the table.
    found.sort_by_key(|(score, ..)| std::cmp::Reverse(*score));
    let answer = |(_, binding, command)| (binding, command);
    found.into_iter().map(answer).collect()
}

/// How well `text` answers to the words in `typed`; none where one of them is not in it.
fn score(typed: &str, text: &str) -> Option<u32> {
    let text = text.to_lowercase();
    let words = typed.to_lowercase();
    words
        .split_whitespace()
        .map(|word| word_score(word, &text))
        .sum()
}

/// Three where a word begins so, two where it stands anywhere, one where its letters come in order.
fn word_score(word: &str, text: &str) -> Option<u32> {
    let begins = |part: &str| part.starts_with(word);
    if text.split(|c: char| !c.is_alphanumeric()).any(begins) {
        return Some(3);
    }
    if text.contains(word) {
        return Some(2);
    }
    let mut letters = text.chars();
    let is_in_order = word.chars().all(|c| letters.any(|letter| letter == c));
    is_in_order.then_some(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::changes::apply::apply as apply_command;

    fn names(typed: &str) -> Vec<&'static str> {
        let found = found(&AppState::default(), typed);
        found.into_iter().map(|(binding, _)| binding.what).collect()
    }

    #[test]
    fn beginnings_of_words_come_before_letters_in_order() {
        assert_eq!(names("rough")[0], "Roughness");
        assert_eq!(names("first v")[0], "Back to the first view");
        assert!(names("rghns").contains(&"Roughness"), "letters in order");
        assert_eq!(names("zzz"), Vec::<&str>::new());
    }

    #[test]
    fn only_what_is_possible_is_offered() {
        assert!(names("").contains(&"Open…"));
        assert!(!names("").contains(&"Pause or resume"), "nothing trains");
    }

    #[test]
    fn the_chosen_answer_is_done_and_the_palette_goes() {
        let (mut state, mut effects) = (AppState::default(), Vec::new());
        for command in [
            PaletteCommand::Toggle,
            PaletteCommand::Type("mouse and".to_owned()),
            PaletteCommand::Step(1),
            PaletteCommand::Step(-1),
            PaletteCommand::Run(0),
        ] {
            apply_command(&mut state, Command::Palette(command), &mut effects);
        }
        assert!(state.overlays.is_help_open && state.overlays.palette.is_none());
    }
}
