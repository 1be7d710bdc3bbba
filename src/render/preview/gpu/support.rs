//! What the graphics card's path carries; the rest is drawn by the processor.

use crate::geometry::LensModel;
use crate::neif::SurfaceField;
use crate::neif::light::environment::EnvironmentField;
use crate::neif::surface::edit::RoughnessEdit;
use crate::render::irradiance::LightKey;
use crate::render::{Layer, PreviewScene};

/// Why a picture is drawn by the processor though there is a graphics card.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotCarried {
    /// The layer is none of final, diffuse, specular, environment.
    #[error("this layer")]
    Layer,
    /// The environment is the paper's network or a picture.
    #[error("an environment that is no grid")]
    Environment,
    /// The lens is distorted.
    #[error("a distorted lens")]
    Lens,
    /// The environment is moved or another: the light at the surface and around it changes.
    #[error("a moved or another environment")]
    Light,
    /// The surface is the paper's network.
    #[error("a surface that is no grid")]
    Surface,
    /// Parts of the object are edited or highlighted.
    #[error("parts that are edited or highlighted")]
    Regions,
    /// The roughness is edited: lobes of several cones.
    #[error("edited roughness")]
    Roughness,
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
    let is_grid = matches!(scene.environment.field(), EnvironmentField::Grid { .. });
    refuse(!is_grid, NotCarried::Environment)?;
    let lens = &picture.camera.distortion;
    let is_bent = !lens.is_none() || lens.model != LensModel::Perspective;
    refuse(is_bent, NotCarried::Lens)?;
    refuse(scene.ground.is_some(), NotCarried::Light)?;
    let Some(object) = &scene.object else {
        return Ok(());
    };
    let is_paper = matches!(*object.material, SurfaceField::Paper(_));
    refuse(is_paper, NotCarried::Surface)?;
    let has_regions = scene.regions.effective().iter().next().is_some();
    refuse(
        has_regions || picture.highlight.is_some(),
        NotCarried::Regions,
    )?;
    let is_edited = scene.edit.roughness != RoughnessEdit::default();
    refuse(is_edited, NotCarried::Roughness)?;
    let is_relit = LightKey::of(scene, false).is_some() || !scene.has_own_light();
    refuse(is_relit, NotCarried::Light)
}
