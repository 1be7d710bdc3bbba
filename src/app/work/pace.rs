//! How training and the window share the processor.

use crate::train::session::handle::Threads;

/// What comes first while training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, strum::IntoStaticStr, strum::VariantArray)]
pub enum Pace {
    /// The window: training leaves it a core, and pictures follow each other as fast as they can.
    Responsive,
    /// Training has all cores, and pictures in motion take about a third of them.
    #[default]
    Balanced,
    /// Training: pictures in motion are few.
    #[strum(serialize = "Fast training")]
    Fast,
}

impl Pace {
    pub(in crate::app) fn hint(self) -> &'static str {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearer_to_training_the_less_for_pictures() {
        let shares = [Pace::Responsive, Pace::Balanced, Pace::Fast].map(Pace::drag_share);
        assert!(shares.iter().rev().is_sorted(), "{shares:?}");
        assert!(shares.iter().all(|share| (0.1..=1.0).contains(share)));
    }
}
