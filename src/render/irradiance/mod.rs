//! Diffuse light: what the environment sheds on the object, compared with the light that it was trained in.
//!
//! The learned diffuse part `C_d` is radiance in the trained light. Elsewhere the surface shows
//! `C_d · E_now(x, n) / E_trained(x, n)` per colour: with the same estimate in both, errors of the estimate cancel and
//! an unmoved environment changes nothing. `E` is gathered at [`Probes`] by cones through the radiance field; where a cone
//! meets the object, what the object sends on takes its place. Edits of the material are not followed: they were no
//! part of the light that was baked.

mod cache;
mod key;
mod light;
mod probes;
mod surface_light;
#[cfg(test)]
mod tests;
mod transport;

pub use self::key::{KeyedLight, LightKey};
pub(super) use cache::shows_light;
pub use cache::{DiffuseLights, estimated_lamps, trained_light};
pub use light::{DiffuseLight, TrainedLight};
pub use probes::{Probe, Probes};
pub use surface_light::SurfaceLight;
pub(super) use surface_light::ratio;
pub use transport::{Resolution, Transport};
