//! How training is watched: comparison with a photo, figures of single views, the capture's cameras.

use std::collections::BTreeMap;

use strum::VariantArray as _;

use crate::color::map::ColorMap;
use crate::render::output::slice::SlicePlane;
use crate::train::measure::view_error::ViewFigures;

/// Comparison with the photo of the view the camera stands at, beside the wipe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Comparison {
    /// None.
    #[default]
    Off,
    /// Photo at the left, rendering at the right.
    Beside,
    /// One after the other, in the same place.
    Flicker,
    /// How far they are apart.
    Error(ErrorKind),
}

impl Comparison {
    /// All that are something, in the order of the menu.
    pub const ALL: [Self; 5] = [
        Self::Beside,
        Self::Flicker,
        Self::Error(ErrorKind::Absolute),
        Self::Error(ErrorKind::Signed),
        Self::Error(ErrorKind::Flip),
    ];

    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "Off",
            Self::Beside => "Side by side",
            Self::Flicker => "Flicker",
            Self::Error(kind) => kind.into(),
        }
    }

    /// What the key of the error maps shows next: one after the other, then none.
    pub fn next_error(self) -> Self {
        let Self::Error(now) = self else {
            return Self::Error(ErrorKind::VARIANTS[0]);
        };
        let later = ErrorKind::VARIANTS.get(now as usize + 1);
        later.copied().map_or(Self::Off, Self::Error)
    }
}

/// Which difference an error map shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::IntoStaticStr, strum::VariantArray)]
pub enum ErrorKind {
    /// Mean absolute difference of the sRGB values.
    #[strum(serialize = "Error, absolute")]
    Absolute,
    /// Mean of rendering less photo.
    #[strum(serialize = "Error, signed")]
    Signed,
    /// What a person sees who flips between the two.
    #[strum(serialize = "Error, FLIP")]
    Flip,
}

impl ErrorKind {
    /// What the colour bar measures.
    pub fn legend(self) -> &'static str {
        match self {
            Self::Absolute => "|rendering - photo|, sRGB 0 to 1",
            Self::Signed => "rendering - photo, sRGB 0 to 1",
            Self::Flip => "FLIP, 0 to 1",
        }
    }

    /// The values at both ends of the colour bar; what is beyond has the colour of the end.
    pub fn range(self) -> [f32; 2] {
        match self {
            Self::Absolute => [0.0, 0.25],
            Self::Signed => [-0.25, 0.25],
            Self::Flip => [0.0, 0.5],
        }
    }

    /// The colours.
    pub fn map(self) -> ColorMap {
        match self {
            Self::Signed => ColorMap::Diverging,
            Self::Absolute | Self::Flip => ColorMap::Sequential,
        }
    }

    /// The sRGB colour of a value.
    pub fn color(self, value: f32) -> [u8; 3] {
        let [low, high] = self.range();
        self.map().srgb8((value - low) / (high - low))
    }
}

/// Figures of one view, and what they are of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredView {
    /// Index among [`super::app_state::AppState::views`].
    pub view: usize,
    /// The training step.
    pub step: u64,
    /// Whether the material or the environment was edited.
    pub is_edited: bool,
    /// The figures.
    pub figures: ViewFigures,
}

/// What curves are drawn over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlotAxis {
    /// Seconds of training.
    #[default]
    Time,
    /// Optimiser steps.
    Steps,
}

/// What is watched, and what came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct WatchState {
    /// What curves are drawn over.
    pub plot_over: PlotAxis,
    /// Training time for the next run, in seconds.
    pub budget_secs: f64,
    /// How much longer to train when asked to, in seconds.
    pub extend_secs: f64,
    /// Whether the capture's cameras are drawn.
    pub are_cameras_shown: bool,
    /// Whether the slice through the environment is shown.
    pub is_slice_shown: bool,
    /// Where it is.
    pub slice: SlicePlane,
    /// The view on the error map.
    pub measured: Option<MeasuredView>,
    /// How far the next one is, 0 to 1, while it is made.
    pub measuring: Option<f32>,
    /// The last figures of each view without edits, by index.
    pub by_view: BTreeMap<usize, MeasuredView>,
}

impl Default for WatchState {
    fn default() -> Self {
        Self {
            plot_over: PlotAxis::default(),
            budget_secs: 300.0,
            extend_secs: 120.0,
            are_cameras_shown: false,
            is_slice_shown: false,
            slice: SlicePlane {
                axis: 2,
                share: 0.5,
            },
            measured: None,
            measuring: None,
            by_view: BTreeMap::new(),
        }
    }
}

impl WatchState {
    /// Drops what was of another capture; choices stay.
    pub fn forget(&mut self) {
        self.measured = None;
        self.measuring = None;
        self.by_view.clear();
    }
}

/// What may happen to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WatchCommand {
    /// Compare with the photo.
    Compare(Comparison),
    /// Show or hide the capture's cameras.
    ShowCameras(bool),
    /// Show or hide the slice through the environment.
    ShowSlice(bool),
    /// Move it.
    MoveSlice(SlicePlane),
    /// Draw curves over this.
    PlotOver(PlotAxis),
    /// How much longer to train when asked to, in seconds.
    SetExtend(f64),
}
