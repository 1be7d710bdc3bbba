//! What is rendered: a model, its edits, and which part of the result is shown.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use crate::neif::exposure_match::matched;
use crate::neif::{Environment, EnvironmentTransform, MaterialEdit, ObjectModel};

/// An object under an environment, with all edits.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The object, if any.
    pub object: Option<Arc<ObjectModel>>,
    /// The lamp.
    pub environment: Arc<Environment>,
    /// Where the environment stands.
    pub transform: EnvironmentTransform,
    /// How the material is changed.
    pub edit: MaterialEdit,
}

impl Scene {
    /// The transform with exposure and white balance such that the surroundings light the object as much as `own` does
    /// where it was captured; `None` where one of them is black.
    pub fn matched_to(&self, own: &Environment) -> Option<EnvironmentTransform> {
        let object = self.object.as_ref();
        let bounds = object.map_or_else(|| own.inner_box(), |o| o.tracer.mesh().bounds());
        matched(&self.transform, own, &self.environment, bounds.center())
    }
}

/// What a picture shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Layer {
    /// The lit object in its surroundings.
    #[default]
    Final,
    /// The object's diffuse part.
    Diffuse,
    /// The object's specular part.
    Specular,
    /// Roughness as a grey value.
    Roughness,
    /// Specular tint.
    Tint,
    /// Unit normal, `0.5 n + 0.5`.
    Normal,
    /// The surroundings without the object.
    Environment,
}

impl Layer {
    /// All layers, in the order of the window's keys.
    pub const ALL: [Self; 7] = [
        Self::Final,
        Self::Diffuse,
        Self::Specular,
        Self::Roughness,
        Self::Tint,
        Self::Normal,
        Self::Environment,
    ];

    /// Lower-case name, as on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Final => "final",
            Self::Diffuse => "diffuse",
            Self::Specular => "specular",
            Self::Roughness => "roughness",
            Self::Tint => "tint",
            Self::Normal => "normal",
            Self::Environment => "environment",
        }
    }

    /// Whether the surroundings are part of the picture.
    pub fn shows_background(self) -> bool {
        matches!(self, Self::Final | Self::Environment)
    }

    /// Whether the object is part of the picture.
    pub fn shows_object(self) -> bool {
        self != Self::Environment
    }
}

impl fmt::Display for Layer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Layer {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|layer| layer.name() == text)
            .ok_or_else(|| {
                format!(
                    "unknown layer `{text}`; known: {}",
                    Self::ALL.map(Self::name).join(", ")
                )
            })
    }
}
