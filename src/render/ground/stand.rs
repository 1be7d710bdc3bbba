//! An object as it stands in an environment.

use crate::neif::surface::edit::EnvironmentFromWorld;
use crate::neif::{Environment, ObjectModel};
use crate::render::lamps::Lamps;

/// An object in an environment.
pub(super) struct Stand<'a> {
    pub(super) object: &'a ObjectModel,
    pub(super) environment: &'a Environment,
    pub(super) motion: EnvironmentFromWorld,
    /// Of the environment.
    pub(super) lamps: &'a Lamps,
}
