//! What a person changes after training: the material, and where the environment stands.

use glam::{EulerRot, Quat, Vec3};
use serde::{Deserialize, Serialize};

use super::values::Surface;

/// How roughness is edited.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RoughnessEdit {
    /// The learned map, `scale * r + offset`.
    Map {
        /// Factor.
        scale: f32,
        /// Added after the factor.
        offset: f32,
    },
    /// One roughness for the whole object, `[0, 1]`.
    Constant(f32),
}

/// Changes applied after M(x); the default changes nothing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MaterialEdit {
    /// Roughness.
    pub roughness: RoughnessEdit,
    /// Factor of the whole specular part, grazing angles included.
    pub tint_scale: f32,
    /// Colour multiplied into the specular part.
    pub tint_color: Vec3,
    /// Factor of the diffuse part.
    pub diffuse_gain: Vec3,
}

impl Default for RoughnessEdit {
    /// As learned.
    fn default() -> Self {
        Self::Map {
            scale: 1.0,
            offset: 0.0,
        }
    }
}

impl Default for MaterialEdit {
    fn default() -> Self {
        Self {
            roughness: RoughnessEdit::default(),
            tint_scale: 1.0,
            tint_color: Vec3::ONE,
            diffuse_gain: Vec3::ONE,
        }
    }
}

impl MaterialEdit {
    /// Whether roughness differs from what was learned.
    pub fn changes_roughness(&self) -> bool {
        self.roughness != RoughnessEdit::default()
    }

    /// Edited roughness, clamped to `[0, 1]`.
    pub fn roughness(&self, roughness: f32) -> f32 {
        match self.roughness {
            RoughnessEdit::Map { scale, offset } => (roughness * scale + offset).clamp(0.0, 1.0),
            RoughnessEdit::Constant(value) => value.clamp(0.0, 1.0),
        }
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        let roughness = match self.roughness {
            RoughnessEdit::Map { scale, offset } => scale.is_finite() && offset.is_finite(),
            RoughnessEdit::Constant(value) => value.is_finite(),
        };
        let gains = self.specular_gain() + self.diffuse_gain;
        roughness && gains.is_finite()
    }

    /// Factor of the specular part.
    pub fn specular_gain(&self) -> Vec3 {
        self.tint_color * self.tint_scale
    }

    /// The surface with its roughness and diffuse part edited; the specular gain applies to the shaded lobe.
    pub fn apply(&self, surface: Surface) -> Surface {
        Surface {
            diffuse: surface.diffuse * self.diffuse_gain,
            roughness: self.roughness(surface.roughness),
            ..surface
        }
    }
}

/// Moves the environment in world axes about the origin: scale, then rotation (about X, then Y, then Z), then
/// translation; and how bright and what colour it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EnvironmentTransform {
    /// Rotation about the fixed X, then Y, then Z axis, degrees.
    pub rotate_deg: Vec3,
    /// Translation, world units.
    pub translate: Vec3,
    /// Uniform scale, positive.
    pub scale: f32,
    /// Exposure, stops.
    pub exposure_ev: f32,
    /// Gain of each colour.
    pub white_balance: Vec3,
}

impl Default for EnvironmentTransform {
    fn default() -> Self {
        Self {
            rotate_deg: Vec3::ZERO,
            translate: Vec3::ZERO,
            scale: 1.0,
            exposure_ev: 0.0,
            white_balance: Vec3::ONE,
        }
    }
}

/// Largest exposure either way, stops, and the gain of as many: more than any two lights differ by. An infinite gain
/// would make a black surface NaN.
const LARGEST_EXPOSURE: f32 = 60.0;
const LARGEST_GAIN: f32 = 1.2e18;

/// [`EnvironmentTransform`] made ready for many rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnvironmentFromWorld {
    rotation: Quat,
    translate: Vec3,
    inverse_scale: f32,
    /// Factor of the radiance.
    pub gain: Vec3,
}

impl EnvironmentTransform {
    /// The same with a turn after its rotation; where the translation puts it stays.
    pub fn turned(&self, turn: Quat) -> Self {
        let (z, y, x) = (turn * self.rotation()).to_euler(EulerRot::ZYX);
        Self {
            rotate_deg: Vec3::new(x, y, z).map(f32::to_degrees),
            ..*self
        }
    }

    fn rotation(&self) -> Quat {
        let [x, y, z] = self.rotate_deg.to_array().map(f32::to_radians);
        // glam's ZYX order with (z, y, x) is R = Rz·Ry·Rx: X is applied first.
        Quat::from_euler(EulerRot::ZYX, z, y, x)
    }

    /// The inverse motion, as rays need it.
    pub fn environment_from_world(&self) -> EnvironmentFromWorld {
        let exposure = self.exposure_ev.clamp(-LARGEST_EXPOSURE, LARGEST_EXPOSURE);
        EnvironmentFromWorld {
            rotation: self.rotation().inverse(),
            translate: self.translate,
            // A zero scale would put every point at infinity.
            inverse_scale: 1.0 / self.scale.abs().max(1e-6),
            gain: (self.white_balance * exposure.exp2()).min(Vec3::splat(LARGEST_GAIN)),
        }
    }
}

impl EnvironmentFromWorld {
    /// A world point in the environment's own coordinates.
    pub fn point(&self, p_world: Vec3) -> Vec3 {
        self.rotation * (p_world - self.translate) * self.inverse_scale
    }

    /// A world direction in the environment's own axes, length kept.
    pub fn direction(&self, d_world: Vec3) -> Vec3 {
        self.rotation * d_world
    }

    /// Undoes [`Self::point`].
    pub fn world_point(&self, p_environment: Vec3) -> Vec3 {
        self.rotation.inverse() * (p_environment / self.inverse_scale) + self.translate
    }

    /// Undoes [`Self::direction`].
    pub fn world_direction(&self, d_environment: Vec3) -> Vec3 {
        self.rotation.inverse() * d_environment
    }

    /// A world length in the environment's units.
    pub fn length(&self, length_world: f32) -> f32 {
        length_world * self.inverse_scale
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identity_leaves_points_alone() {
        let motion = EnvironmentTransform::default().environment_from_world();
        let p = Vec3::new(0.3, -2.0, 5.0);
        assert!(
            (motion.point(p) - p).length() < 1e-6,
            "{:?}",
            motion.point(p)
        );
    }

    #[test]
    fn a_turned_and_moved_environment_shows_its_content_where_it_went() {
        // An object of the environment at +x; turn 90° about z brings it to +y, then it moves up by 1.
        let transform = EnvironmentTransform {
            rotate_deg: Vec3::new(0.0, 0.0, 90.0),
            translate: Vec3::Z,
            scale: 2.0,
            ..EnvironmentTransform::default()
        };
        let motion = transform.environment_from_world();
        let place = Vec3::new(0.0, 2.0, 1.0);
        let back = motion.point(place);
        assert!((back - Vec3::X).length() < 1e-5, "{back:?}");
        assert!((motion.world_point(back) - place).length() < 1e-5);
        assert!((motion.world_direction(Vec3::X) - Vec3::Y).length() < 1e-5);
    }

    #[test]
    fn rotation_is_about_x_first() {
        let transform = EnvironmentTransform {
            rotate_deg: Vec3::new(90.0, 0.0, 90.0),
            ..Default::default()
        };
        // X by 90° takes +y to +z; Z by 90° leaves +z.
        let back = transform.environment_from_world().point(Vec3::Z);
        assert!((back - Vec3::Y).length() < 1e-5, "{back:?}");
    }

    #[test]
    fn roughness_edits_stay_in_range() {
        let edit = |roughness| MaterialEdit {
            roughness,
            ..MaterialEdit::default()
        };
        assert_eq!(
            edit(RoughnessEdit::Map {
                scale: 3.0,
                offset: 0.2
            })
            .roughness(0.5),
            1.0
        );
        assert_eq!(edit(RoughnessEdit::Constant(-1.0)).roughness(0.5), 0.0);
    }
}
