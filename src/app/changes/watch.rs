//! What comparing with a photo and plotting do.

use super::choose::go_to_view;
use crate::app::state::app_state::AppState;
use crate::app::state::training_state::Level;
use crate::app::state::watch::{Comparison, WatchCommand};

/// Changes the state by a command.
pub(super) fn apply(state: &mut AppState, command: WatchCommand) {
    match command {
        WatchCommand::Compare(comparison) => compare(state, comparison),
        WatchCommand::ShowCameras(on) => state.watch.are_cameras_shown = on,
        WatchCommand::ShowSlice(on) => state.watch.is_slice_shown = on,
        WatchCommand::MoveSlice(plane) => state.watch.slice = plane,
        WatchCommand::PlotOver(axis) => state.watch.plot_over = axis,
        WatchCommand::SetExtend(secs) => state.watch.extend_secs = secs.clamp(5.0, 86_400.0),
    }
}

fn compare(state: &mut AppState, comparison: Comparison) {
    if comparison != Comparison::Off && state.view.at_view.is_none() {
        let Some(index) = state.nearest_view() else {
            let words = "There is no photo to compare with";
            state.messages.say(Level::Info, words);
            return;
        };
        go_to_view(state, index);
    }
    state.compare.wipe = None;
    state.compare.with_photo = comparison;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::state::watch::ErrorKind;
    use crate::color::map::ColorMap;
    use crate::color::map::NEUTRAL;

    #[test]
    fn the_key_goes_through_all_error_maps_and_ends() {
        let mut seen = vec![Comparison::Off];
        for _ in 0..4 {
            seen.extend(seen.last().map(|last| last.next_error()));
        }
        assert_eq!(seen[1..4], Comparison::ALL[2..]);
        assert_eq!(seen[4], Comparison::Off);
    }

    #[test]
    fn no_error_has_the_colour_of_nothing() {
        assert_eq!(ErrorKind::Signed.color(0.0), NEUTRAL);
        for kind in [ErrorKind::Absolute, ErrorKind::Flip] {
            assert_eq!(kind.color(0.0), ColorMap::Sequential.srgb8(0.0));
        }
    }
}
