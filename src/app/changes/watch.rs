//! What comparing with a photo and plotting do.

use super::choose::stand_at_photo;
use crate::app::state::app_state::AppState;
use crate::app::state::watch::{Comparison, WatchCommand};

/// Changes the state by a command.
pub(super) fn apply(state: &mut AppState, command: WatchCommand) {
    match command {
        WatchCommand::Compare(comparison) => {
            if comparison == Comparison::Off || stand_at_photo(state) {
                state.compare.wipe = None;
                state.compare.with_photo = comparison;
            }
        }
        WatchCommand::ShowCameras(on) => state.watch.are_cameras_shown = on,
        WatchCommand::ShowSlice(on) => state.watch.is_slice_shown = on,
        WatchCommand::MoveSlice(plane) => state.watch.slice = plane,
        WatchCommand::PlotOver(axis) => state.watch.plot_over = axis,
        WatchCommand::SetExtend(secs) => state.watch.extend_secs = secs.clamp(5.0, 86_400.0),
    }
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
