//! What a person has set once and finds again: theme, size of the text, size of the window, panels and what of them is
//! folded, automatic start.
//!
//! Kept in a small TOML file in the system's folder for settings.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use directories::ProjectDirs;
use serde::{Deserialize, Serialize};

use crate::app::state::sections::Section;

/// Smallest and largest size of the text, times the system's.
const ZOOM_RANGE: [f32; 2] = [0.5, 3.0];
/// Change of that size by one key.
pub(in crate::app) const ZOOM_STEP: f32 = 0.1;
/// Smallest and largest width of a side panel, in points.
const WIDTH_RANGE: [f32; 2] = [200.0, 600.0];
/// Smallest and largest side of the window, in points.
const WINDOW_RANGE: [f32; 2] = [400.0, 16_384.0];

/// Dark or light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ThemeChoice {
    /// As the system.
    #[default]
    System,
    /// Light.
    Light,
    /// Dark.
    Dark,
}

/// How much a new run is to find out.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    Serialize,
    Deserialize,
    strum::IntoStaticStr,
    strum::VariantArray,
)]
#[serde(rename_all = "lowercase")]
pub enum Quality {
    /// What can be had in minutes.
    #[default]
    Fast,
    /// What the photos show.
    Full,
}

impl Quality {
    /// The settings' name.
    pub(in crate::app) fn preset(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Full => "quality",
        }
    }

    /// Training time that suits it, seconds.
    pub(in crate::app) fn usual_secs(self) -> f64 {
        match self {
            Self::Fast => 300.0,
            Self::Full => 1200.0,
        }
    }

    pub(in crate::app) fn hint(self) -> &'static str {
        match self {
            Self::Fast => "Sharp in minutes",
            Self::Full => {
                "A finer environment, for large sharp photos and twenty minutes on two cores"
            }
        }
    }
}

/// A panel beside the viewport.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SidePanel {
    /// Whether it is hidden.
    pub is_hidden: bool,
    /// Its width in points; none is the usual one.
    pub width: Option<f32>,
}

/// Both panels beside the viewport.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Panels {
    /// Training and photos.
    pub left: SidePanel,
    /// Material and environment.
    pub right: SidePanel,
}

/// One of the panels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Training and photos.
    Left,
    /// Material and environment.
    Right,
}

/// All of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Preferences {
    /// Dark or light.
    pub theme: ThemeChoice,
    /// Size of the text, times the system's.
    pub zoom: f32,
    /// Whether opening a capture starts training.
    pub is_auto_start: bool,
    /// How much new runs are to find out.
    pub quality: Quality,
    /// Which parts of the side panels are folded; at first those that few people need.
    pub folded: BTreeSet<Section>,
    /// Whether the list of messages is open.
    pub is_log_open: bool,
    /// Width and height of the window, in points; none is the usual size.
    pub window: Option<[f32; 2]>,
    /// The side panels.
    pub panels: Panels,
}

impl Default for Preferences {
    fn default() -> Self {
        Self {
            theme: ThemeChoice::default(),
            zoom: 1.0,
            is_auto_start: true,
            quality: Quality::default(),
            folded: BTreeSet::from([Section::Skips, Section::Slice]),
            is_log_open: false,
            window: None,
            panels: Panels::default(),
        }
    }
}

/// A change of the preferences.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PreferencesCommand {
    /// Dark or light.
    Theme(ThemeChoice),
    /// How much new runs are to find out; their training time goes with it.
    Quality(Quality),
    /// Larger (above zero) or smaller text by so many steps.
    Zoom(f32),
    /// Text of the system's size.
    ResetZoom,
    /// Hide both panels, or show both.
    TogglePanels,
    /// Hide a panel, or show it.
    TogglePanel(Side),
    /// A panel has another width, in points.
    Resize(Side, f32),
    /// Fold a part of a panel, or unfold it.
    Fold(Section),
    /// The window has another width and height, in points.
    ResizeWindow([f32; 2]),
}

impl Panels {
    /// Whether either is shown.
    pub fn is_any_shown(&self) -> bool {
        !(self.left.is_hidden && self.right.is_hidden)
    }

    /// One of them.
    pub fn side(&self, side: Side) -> SidePanel {
        match side {
            Side::Left => self.left,
            Side::Right => self.right,
        }
    }

    /// One of them, to be changed.
    pub fn side_mut(&mut self, side: Side) -> &mut SidePanel {
        match side {
            Side::Left => &mut self.left,
            Side::Right => &mut self.right,
        }
    }
}

impl Preferences {
    /// Brings every number into its range.
    pub(in crate::app) fn limit(&mut self) {
        let [least, most] = ZOOM_RANGE;
        self.zoom = if self.zoom.is_finite() {
            self.zoom.clamp(least, most)
        } else {
            1.0
        };
        let [least, most] = WIDTH_RANGE;
        for panel in [&mut self.panels.left, &mut self.panels.right] {
            let width = panel.width.filter(|width| width.is_finite());
            panel.width = width.map(|width| width.clamp(least, most));
        }
        let [least, most] = WINDOW_RANGE;
        let size = self
            .window
            .filter(|size| size.iter().all(|side| side.is_finite()));
        self.window = size.map(|size| size.map(|side| side.clamp(least, most)));
    }

    /// As the file holds it.
    pub fn to_text(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }
}

/// Where they are kept; none on a system without a home folder.
pub fn file() -> Option<PathBuf> {
    ProjectDirs::from("", "", "neif").map(|dirs| dirs.config_dir().join("settings.toml"))
}

/// The kept ones, and what is wrong with the file, if anything: then they are the usual ones.
pub fn load(file: &Path) -> (Preferences, Option<String>) {
    let Ok(text) = std::fs::read_to_string(file) else {
        return (Preferences::default(), None);
    };
    match toml::from_str::<Preferences>(&text) {
        Ok(mut preferences) => {
            preferences.limit();
            (preferences, None)
        }
        Err(error) => {
            let what = format!("{}: settings not used: {}", file.display(), error.message());
            (Preferences::default(), Some(what))
        }
    }
}

#[cfg(test)]
mod tests {
    use strum::VariantArray as _;

    use super::*;
    use crate::app::changes::preferences::apply;
    use crate::app::state::app_state::AppState;

    #[test]
    fn they_come_back_from_their_file_and_stay_in_range() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("settings.toml");
        let mut state = AppState::default();
        for command in [
            PreferencesCommand::Theme(ThemeChoice::Light),
            PreferencesCommand::Zoom(100.0),
            PreferencesCommand::TogglePanel(Side::Left),
            PreferencesCommand::Resize(Side::Right, f32::NAN),
            PreferencesCommand::Fold(Section::Material),
            PreferencesCommand::ResizeWindow([1e9, 700.4]),
        ] {
            apply(&mut state, command);
        }
        assert_eq!(state.preferences.zoom, 3.0);
        assert!(state.preferences.folded.contains(&Section::Material));
        assert_eq!(state.preferences.window, Some([16_384.0, 700.0]));
        std::fs::write(&file, state.preferences.to_text()).unwrap();
        assert_eq!(load(&file), (state.preferences, None));
    }

    #[test]
    fn a_damaged_file_is_named_and_not_used() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("settings.toml");
        std::fs::write(&file, "zoom = \"large\"").unwrap();
        let (preferences, problem) = load(&file);
        assert_eq!(preferences, Preferences::default());
        assert!(problem.is_some_and(|problem| problem.contains("settings.toml")));
    }

    #[test]
    fn every_section_folds_by_itself() {
        let mut state = AppState::default();
        state.preferences.folded.clear();
        for &section in Section::VARIANTS {
            apply(&mut state, PreferencesCommand::Fold(section));
            assert_eq!(state.preferences.folded, BTreeSet::from([section]));
            apply(&mut state, PreferencesCommand::Fold(section));
            assert_eq!(state.preferences.folded, BTreeSet::new());
        }
    }

    #[test]
    fn both_panels_are_hidden_together_and_come_back_together() {
        let mut state = AppState::default();
        apply(&mut state, PreferencesCommand::TogglePanel(Side::Left));
        apply(&mut state, PreferencesCommand::TogglePanels);
        assert!(!state.preferences.panels.is_any_shown());
        apply(&mut state, PreferencesCommand::TogglePanels);
        let panels = state.preferences.panels;
        assert!(!panels.left.is_hidden && !panels.right.is_hidden);
    }
}
