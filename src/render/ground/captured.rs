//! What the object did to the surfaces around it where it was captured.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::bounce::Bounce;
use super::share_grid::ShareGrid;
use super::sight::Sight;
use super::stand::Stand;
use super::support::{LEAST_SHARE, Support};
use super::{Cancelled, GroundResolution};
use crate::neif::{Environment, EnvironmentTransform, ObjectModel};
use crate::render::irradiance::Probes;
use crate::render::lamps::Lamps;

/// What an object does to the environment that it was captured in.
#[derive(Debug)]
pub(crate) struct Captured {
    /// The surfaces around it, where there are any.
    pub(crate) ground: Option<Arc<BakedGround>>,
    /// Irradiance at its probes, as [`Bounce::relit`] takes it.
    pub(super) irradiance: Vec<Vec3>,
}

impl Captured {
    /// Looks at the environment with the object, by `probes` on it.
    pub(crate) fn new(
        object: &ObjectModel,
        (own, lamps): (&Environment, &Lamps),
        probes: &Probes,
        resolution: GroundResolution,
        cancel: &AtomicBool,
    ) -> Result<Self, Cancelled> {
        let stand = Stand {
            object,
            environment: own,
            motion: EnvironmentTransform::default().environment_from_world(),
            lamps,
        };
        let bounce = Bounce::new(&stand, probes, resolution);
        Ok(Self {
            ground: BakedGround::new(&stand, &bounce, resolution, cancel)?,
            irradiance: bounce.irradiance(),
        })
    }
}

/// The environment without the shadow and the hidden part of the object that was captured in it.
#[derive(Clone, Debug)]
pub struct BakedGround {
    /// Share of the light that the object left.
    share: ShareGrid,
    /// What it stood on, where there was something.
    pub(super) support: Option<Support>,
}

impl BakedGround {
    /// Looks at the surfaces around the object; `None` when there are none.
    fn new(
        stand: &Stand<'_>,
        bounce: &Bounce<'_>,
        resolution: GroundResolution,
        cancel: &AtomicBool,
    ) -> Result<Option<Arc<Self>>, Cancelled> {
        let mut surfaces = stand.surfaces(resolution);
        let plane = stand.plane_below(&mut surfaces);
        if surfaces.patches.is_empty() {
            return Ok(None);
        }
        let shares = stand.shares(&surfaces, bounce, resolution.n_directions, cancel)?;
        let share = ShareGrid::new(surfaces, &shares);
        let support = plane.and_then(|plane| Support::new(stand, plane, &share, &shares));
        Ok(Some(Arc::new(Self { share, support })))
    }

    /// What the radiance along a ray without the object's shadow is multiplied by, a colour.
    pub(super) fn lightened(&self, sight: &Sight<'_>) -> Vec3 {
        let least = Vec3::splat(LEAST_SHARE);
        self.share.along(sight, |share| share.max(least).recip())
    }
}
