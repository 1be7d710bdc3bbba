//! What the graphics card's path carries; the rest is drawn by the processor.

use std::fmt;

use crate::geometry::LensModel;
use crate::neif::SurfaceField;
use crate::neif::light::environment::EnvironmentField;
use crate::neif::surface::edit::RoughnessEdit;
use crate::render::irradiance::LightKey;
use crate::render::{Layer, PreviewScene};

/// Why a picture is drawn by the processor though there is a graphics card.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotCarried {
    /// The layer is none of final, diffuse, specular, environment.
    Layer,
    /// Parts of the object are edited or highlighted.
    Regions,
    /// The roughness is edited: lobes of several cones.
    Roughness,
    /// The environment is moved or another: the light at the surface and around it changes.
    Light,
    /// The environment is the paper's network or a picture.
    Surroundings,
    /// The surface is the paper's network.
    Surface,
    /// The lens is distorted.
    Lens,
}

impl fmt::Display for NotCarried {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Layer => "this layer",
            Self::Regions => "parts that are edited or highlighted",
            Self::Roughness => "edited roughness",
            Self::Light => "a moved or another environment",
            Self::Surroundings => "an environment that is no grid",
            Self::Surface => "a surface that is no grid",
            Self::Lens => "a distorted lens",
        })
    }
}

/// Whether the graphics card's path draws a picture as the processor does.
///
/// # Errors
/// What of it is not carried.
pub fn carries(picture: &PreviewScene) -> Result<(), NotCarried> {
    let scene = &picture.scene;
    let refuse = |condition: bool, what| if condition { Err(what) } else { Ok(()) };
    let layers = [
        Layer::Final,
        Layer::Diffuse,
        Layer::Specular,
        Layer::Environment,
    ];
    refuse(!layers.contains(&picture.layer), NotCarried::Layer)?;
    let EnvironmentField::Grid { .. } = scene.environment.field() else {
        return Err(NotCarried::Surroundings);
    };
    let lens = &picture.camera.distortion;
    let is_bent = !lens.is_none() || lens.model != LensModel::Perspective;
    refuse(is_bent, NotCarried::Lens)?;
    refuse(scene.ground.is_some(), NotCarried::Light)?;
    if let Some(object) = &scene.object {
        let is_paper = matches!(*object.material, SurfaceField::Paper(_));
        refuse(is_paper, NotCarried::Surface)?;
        let has_parts =
            scene.regions.effective().iter().next().is_some() || picture.highlight.is_some();
        refuse(has_parts, NotCarried::Regions)?;
        let is_edited = scene.edit.roughness != RoughnessEdit::default();
        refuse(is_edited, NotCarried::Roughness)?;
        refuse(LightKey::of(scene, false).is_some(), NotCarried::Light)?;
        refuse(!scene.has_own_light(), NotCarried::Light)?;
    }
    Ok(())
}
