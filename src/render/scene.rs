//! What is rendered: a model, its edits, and which part of the result is shown.

use std::f32::consts::PI;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::background::Background;
use super::ground::Ground;
use super::irradiance::{
    DiffuseLights, KeyedLight, LightKey, Resolution, TrainedLight, shows_light, trained_light,
};
use super::lamps::Highlights;
use super::named::unknown;
use super::output::tone_map::{ToneMap, display_gain};
use crate::neif::light::display::Display;
use crate::neif::light::environment::EnvironmentField;
use crate::neif::light::exposure_match::matched;
use crate::neif::{Environment, EnvironmentTransform, MaterialEdit, ObjectModel, Regions};

/// An object under an environment, with all edits.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The object, if any.
    pub object: Option<Arc<ObjectModel>>,
    /// The lamp.
    pub environment: Arc<Environment>,
    /// Where the environment stands.
    pub transform: EnvironmentTransform,
    /// How the material of the whole object is changed.
    pub edit: MaterialEdit,
    /// What is changed in parts of it, on top of that.
    pub regions: Regions,
    /// How the environment is seen directly.
    pub background: Background,
    /// Exposure of the picture, stops: brightens what is shown of any light, and changes none of it.
    pub display_ev: f32,
    /// How light brighter than white is shown.
    pub tone_map: ToneMap,
    /// Whether light that no photo showed has a signal colour: [`Layer::Seen`].
    pub marks_unseen: bool,
    /// The environment that the object was trained in: its diffuse part follows the light. `None` leaves it as it was
    /// learned, whatever the light, as the paper does.
    pub trained_in: Option<Arc<Environment>>,
    /// What is done to the surfaces around the object; made by [`Self::lit`].
    pub ground: Option<Arc<Ground>>,
    /// The light at the surface, where it is not the trained one; made by [`Self::lit`].
    pub diffuse_light: Option<KeyedLight>,
}

impl Scene {
    /// A trained model without any edit. The paper's own model keeps its diffuse part as the paper does.
    pub fn new(object: Option<Arc<ObjectModel>>, environment: Arc<Environment>) -> Self {
        let is_fast = matches!(environment.field(), EnvironmentField::Grid { .. });
        Self {
            object,
            trained_in: is_fast.then(|| Arc::clone(&environment)),
            environment,
            transform: EnvironmentTransform::default(),
            edit: MaterialEdit::default(),
            regions: Regions::default(),
            background: Background::default(),
            display_ev: 0.0,
            tone_map: ToneMap::default(),
            marks_unseen: false,
            ground: None,
            diffuse_light: None,
        }
    }

    /// The scene with the light at its surface that a lit picture needs; see [`Self::lit_for`].
    pub fn lit(&self, cancel: &AtomicBool) -> Option<Self> {
        self.lit_for(&[Layer::Final], cancel)
    }

    /// The scene with the light at its surface that `layers` need; nothing is computed where that is known, or is the
    /// trained one and not shown itself. `None` when cancelled.
    pub fn lit_for(&self, layers: &[Layer], cancel: &AtomicBool) -> Option<Self> {
        let is_lit = layers.iter().any(|layer| layer.is_lit());
        let key = LightKey::of(self, shows_light(layers));
        let is_known = key.zip(self.diffuse_light.as_ref());
        let is_known = is_known.is_some_and(|(key, light)| light.is_for(&key, Resolution::FINE));
        if is_known || !is_lit {
            return Some(self.clone().marked_for(layers));
        }
        DiffuseLights::default().fine(self, layers, cancel)
    }

    /// The same with unseen light marked where [`Layer::Seen`] alone is shown, unmarked elsewhere.
    pub(super) fn marked_for(mut self, layers: &[Layer]) -> Self {
        self.marks_unseen = layers == [Layer::Seen];
        self
    }

    /// The same in a photo of another exposure and white balance: all light times `gain` a colour.
    pub fn exposed(&self, gain: Vec3) -> Self {
        let mut exposed = self.clone();
        exposed.transform.white_balance *= gain;
        if self.trained_in.is_none() {
            // Then the diffuse part follows no light.
            exposed.edit.diffuse_gain *= gain;
        }
        exposed
    }

    /// How a layer is shown: light with the picture's exposure and tone map, reflectances without, the rest as numbers.
    pub(super) fn shown(&self, layer: Layer) -> Shown {
        let display = Display {
            gamma: self.environment.gamma(),
        };
        let (gain, tone_map) = match layer {
            Layer::Roughness | Layer::Normal | Layer::Tint | Layer::Albedo => (1.0, ToneMap::Photo),
            _ => (display_gain(self.display_ev), self.tone_map),
        };
        Shown {
            gain,
            tone_map,
            display: (!matches!(layer, Layer::Roughness | Layer::Normal)).then_some(display),
        }
    }

    /// The environment alone, without the traces that the object left in its own; `None` when cancelled.
    pub fn emptied(&self, cancel: &AtomicBool) -> Option<Self> {
        let has_ground = self.object.is_some() && self.has_own_light() && self.trained_in.is_some();
        if !has_ground {
            return Some(self.emptied_of(None));
        }
        let light = trained_light(self, cancel)?;
        Some(self.emptied_of(Some(&light)))
    }

    /// [`Self::emptied`] of an object whose light in its own environment, where the scene stands, is known.
    pub fn emptied_of(&self, light: Option<&TrainedLight>) -> Self {
        let baked = light.and_then(TrainedLight::baked_ground);
        Self {
            object: None,
            diffuse_light: None,
            ground: baked.map(|baked| {
                Arc::new(Ground {
                    baked: Some(Arc::clone(baked)),
                    shadow: None,
                })
            }),
            ..self.clone()
        }
    }

    /// Factor of the diffuse part at a surface point with its unit normal, with the edges of shadows where it `is_seen`
    /// directly; at least 0.
    pub fn diffuse_response(
        &self,
        (position, normal): (Vec3, Vec3),
        gain: Vec3,
        is_seen: bool,
    ) -> Vec3 {
        match (&self.trained_in, &self.diffuse_light) {
            (None, _) => Vec3::ONE,
            (Some(_), None) => gain,
            (Some(_), Some(lit)) => gain * lit.light.ratio(position, normal, is_seen),
        }
    }

    /// Irradiance of a surface point over pi, the radiance of a white one, and the albedo of one of the given present
    /// diffuse radiance; black where nothing is known of the light ([`Self::lit_for`]).
    pub(super) fn surface_light(&self, at: (Vec3, Vec3), diffuse: Vec3) -> [Vec3; 2] {
        let gain = self.transform.environment_from_world().gain;
        let Some(lit) = &self.diffuse_light else {
            return [Vec3::ZERO; 2];
        };
        let ((position, normal), surface) = (at, &lit.light.surface);
        let light = gain * surface.irradiance(position, normal) / PI;
        let ungained = diffuse / gain.max(Vec3::splat(f32::MIN_POSITIVE));
        [light, surface.albedo(position, normal, ungained)]
    }

    /// Whether an edit changes roughness somewhere.
    pub(super) fn changes_roughness(&self) -> bool {
        let mut edits = self.regions.iter().map(|region| &region.edit);
        self.edit.changes_roughness() || edits.any(MaterialEdit::changes_roughness)
    }

    /// The lamps that split lobes gather, where they are known.
    pub(super) fn highlights(&self) -> Option<&Highlights> {
        self.diffuse_light.as_ref()?.light.highlights.as_ref()
    }

    /// Factor of what several cones of the object's lobes gather, by learned roughness; 1 where it is not known.
    pub(super) fn wide_gain(&self, learned: f32) -> Vec3 {
        self.diffuse_light
            .as_ref()
            .map_or(Vec3::ONE, |lit| lit.light.wide_gain(learned))
    }

    /// Puts the object in another environment. Its own, read from a file again, stays its own: what was learned of it holds.
    pub fn swap_environment(&mut self, environment: Arc<Environment>) {
        let own = self.trained_in.as_ref();
        self.environment = match own.filter(|own| own.is_same_light(&environment)) {
            Some(own) => Arc::clone(own),
            None => environment,
        };
    }

    /// How the environment is seen directly, with [`Background::Auto`] decided.
    pub fn shown_background(&self) -> Background {
        match self.background {
            Background::Auto if self.environment.is_seen() => Background::Shown,
            Background::Auto => Background::Blurred,
            asked => asked,
        }
    }

    /// Whether the environment is part of a layer's picture: alone it is never hidden.
    pub fn shows_background(&self, layer: Layer) -> bool {
        let is_hidden = self.background == Background::Hidden && layer != Layer::Environment;
        layer.shows_background() && !is_hidden
    }

    /// Whether the environment is the one that the object was trained in; it may be moved. An unknown one counts as such.
    pub fn has_own_light(&self) -> bool {
        let own = self.trained_in.as_ref();
        own.is_none_or(|own| Arc::ptr_eq(own, &self.environment))
    }

    /// The transform with exposure and white balance such that the environment lights the object as much as `own` does
    /// where it was captured; `None` where one of them is black.
    pub fn matched_to(&self, own: &Environment) -> Option<EnvironmentTransform> {
        let object = self.object.as_ref();
        let bounds = object.map_or_else(|| own.inner_box(), |o| o.tracer.mesh().bounds());
        matched(&self.transform, own, &self.environment, bounds.center())
    }
}

/// How the values of a layer become what a screen shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shown {
    /// Factor of the values, before the tone map.
    pub(super) gain: f32,
    /// What becomes of light brighter than white.
    pub(super) tone_map: ToneMap,
    /// `None` shows numbers as they are.
    pub(super) display: Option<Display>,
}

impl Shown {
    /// What is shown of linear values at least 0, in `[0, 1]`.
    pub(super) fn values(&self, linear: [f32; 3]) -> [f32; 3] {
        let shown = self.tone_map.apply(linear.map(|v| v * self.gain));
        shown.map(|v| self.display.map_or(v, |display| display.value(v)).min(1.0))
    }
}

/// What a picture shows, in the order of the window's keys.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[derive(strum::Display, strum::EnumString, strum::VariantArray)]
#[strum(serialize_all = "lowercase", parse_err_ty = String, parse_err_fn = unknown_layer)]
pub enum Layer {
    /// The lit object in its environment.
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
    /// The environment without the object.
    Environment,
    /// Distance of the object from the eye, near ones light ([`super::diagnostic::depth_range`]).
    Depth,
    /// Share of a uniform sky's light that the object leaves to itself.
    Visibility,
    /// Field samples that the pixel costs ([`super::diagnostic::SAMPLES_RANGE`]).
    Samples,
    /// Diffuse reflectance.
    Albedo,
    /// Irradiance over pi: the radiance of a white, matt surface.
    Irradiance,
    /// The picture with light that no photo showed in a signal colour, seen directly or mirrored: it is guessed.
    Seen,
}

impl Layer {
    /// Whether the environment is part of the picture.
    pub fn shows_background(self) -> bool {
        matches!(self, Self::Final | Self::Environment | Self::Seen)
    }

    /// Whether the picture depends on the light that the object receives.
    pub fn is_lit(self) -> bool {
        matches!(
            self,
            Self::Final
                | Self::Diffuse
                | Self::Specular
                | Self::Albedo
                | Self::Irradiance
                | Self::Seen
        )
    }

    /// Whether the object is part of the picture.
    pub fn shows_object(self) -> bool {
        self != Self::Environment
    }
}

fn unknown_layer(text: &str) -> String {
    unknown::<Layer>("layer", text)
}
