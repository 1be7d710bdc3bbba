//! The shadow of the object, and its light, on an environment that is not the one it was captured in, or not where
//! it was.

use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::bounce::Bounce;
use super::captured::{BakedGround, Captured};
use super::look::FLOOR_SLAB;
use super::share_grid::ShareGrid;
use super::sight::Sight;
use super::stand::Stand;
use super::{Cancelled, GroundResolution};
use crate::neif::{Environment, EnvironmentTransform, ObjectModel};
use crate::render::irradiance::Probes;
use crate::render::lamps::Lamps;

/// The share of its light that an object leaves the surfaces around it.
#[derive(Clone, Debug)]
pub struct Shadow {
    share: ShareGrid,
}

impl Shadow {
    /// The shadow in an environment at `transform` of an object with probes, which was `captured` in another or elsewhere;
    /// `baked`: what is known of that environment without the object. `None` when there is nothing near the object.
    pub(crate) fn new(
        object: &ObjectModel,
        (environment, lamps): (&Environment, &Lamps),
        transform: &EnvironmentTransform,
        (probes, captured): (&Probes, &Captured),
        baked: Option<&BakedGround>,
        resolution: GroundResolution,
        cancel: &AtomicBool,
    ) -> Result<Option<Self>, Cancelled> {
        let stand = Stand {
            object,
            environment,
            motion: transform.environment_from_world(),
            lamps,
        };
        let mut surfaces = stand.surfaces(resolution);
        match baked.and_then(|baked| Some((baked, baked.plane()?))) {
            // A known floor keeps its place, wherever the object went.
            Some((baked, plane)) => {
                let slab = FLOOR_SLAB * plane.half_side;
                surfaces.lay(plane, slab, |point| baked.floor_at(point) > 0.5);
            }
            None => {
                stand.plane_below(&mut surfaces);
            }
        }
        if surfaces.patches().is_empty() {
            return Ok(None);
        }
        let bounce = Bounce::new(&stand, probes, resolution).relit(&captured.irradiance);
        let shares = stand.shares(&surfaces, &bounce, resolution.n_directions, cancel)?;
        let light = shares.iter().map(|share| share.light);
        let share = ShareGrid::new(surfaces, light);
        Ok(Some(Self { share }))
    }

    /// Mean share of the radiance along a ray that is left, a colour.
    pub(super) fn share(&self, sight: &Sight<'_>) -> Vec3 {
        self.share.along(sight, |share| share)
    }

    /// The same where the ray ends at a point.
    pub(super) fn share_at(&self, point: Vec3, sight: &Sight<'_>) -> Vec3 {
        self.share.at(point, sight.blur(point))
    }
}
