//! The parts of the side panels, and which of them are folded: kept from one start to the next.

use serde::{Deserialize, Serialize};

/// A part of a side panel under a heading that folds it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Section {
    /// Controls and figures of training.
    Training,
    /// What the shortcuts leave out.
    Skips,
    /// The density on a plane.
    Slice,
    /// Loss and held-out PSNR.
    Curves,
    /// The photos, each a camera to stand at.
    Photos,
    /// Roughness, tint, diffuse.
    Material,
    /// What is known of the picked point.
    Point,
    /// Which environment, and where it stands.
    Environment,
    /// How the scene is shown.
    Picture,
}

impl Section {
    /// All of them, from the left top to the right bottom.
    pub const ALL: [Self; 9] = [
        Self::Training,
        Self::Skips,
        Self::Slice,
        Self::Curves,
        Self::Photos,
        Self::Material,
        Self::Point,
        Self::Environment,
        Self::Picture,
    ];

    /// Its heading.
    pub fn name(self) -> &'static str {
        match self {
            Self::Training => "Training",
            Self::Skips => "What skipping saves now",
            Self::Slice => "Density slice",
            Self::Curves => "Curves",
            Self::Photos => "Photos",
            Self::Material => "Material",
            Self::Point => "Picked point",
            Self::Environment => "Environment",
            Self::Picture => "Picture",
        }
    }

    fn bit(self) -> u16 {
        1 << self as u16
    }
}

/// The sections of which only the heading is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "Vec<Section>", into = "Vec<Section>")]
pub struct Folded(u16);

impl Default for Folded {
    /// Those that few people need.
    fn default() -> Self {
        vec![Section::Skips, Section::Slice].into()
    }
}

impl Folded {
    /// Whether it is one of them.
    pub fn has(self, section: Section) -> bool {
        self.0 & section.bit() != 0
    }

    /// Folds a section, or unfolds it.
    pub fn toggle(&mut self, section: Section) {
        self.0 ^= section.bit();
    }
}

impl From<Vec<Section>> for Folded {
    fn from(sections: Vec<Section>) -> Self {
        Self(
            sections
                .iter()
                .fold(0, |bits, section| bits | section.bit()),
        )
    }
}

impl From<Folded> for Vec<Section> {
    fn from(folded: Folded) -> Self {
        let all = Section::ALL.into_iter();
        all.filter(|section| folded.has(*section)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_section_folds_by_itself() {
        for section in Section::ALL {
            let mut folded = Folded::from(Vec::new());
            folded.toggle(section);
            assert_eq!(Vec::from(folded), [section]);
            folded.toggle(section);
            assert_eq!(Vec::from(folded), []);
        }
    }
}
