//! The shadow of the object, and its light, on an environment that is not the one it was captured in, or not where
//! it was.

use std::sync::atomic::AtomicBool;

use super::bounce::Bounce;
use super::captured::{BakedGround, Captured};
use super::look::FLOOR_SLAB;
use super::share_grid::ShareGrid;
use super::stand::Stand;
use super::{Cancelled, GroundResolution};
use crate::neif::{Environment, EnvironmentTransform, ObjectModel};
use crate::render::irradiance::Probes;
use crate::render::lamps::Lamps;

/// The share of its light that an object leaves the surfaces around it.
#[derive(Clone, Debug)]
pub struct Shadow {
    pub(super) share: ShareGrid,
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
        match baked.and_then(|baked| baked.support.as_ref()) {
            // A known floor keeps its place, wherever the object went.
            Some(floor) => {
                let slab = FLOOR_SLAB * floor.plane.half_side;
                surfaces.lay(&floor.plane, slab, |point| floor.floor_at(point) > 0.5);
            }
            None => {
                stand.plane_below(&mut surfaces);
            }
        }
        if surfaces.patches.is_empty() {
            return Ok(None);
        }
        let bounce = Bounce::new(&stand, probes, resolution).relit(&captured.irradiance);
        let shares = stand.shares(&surfaces, &bounce, resolution.n_directions, cancel)?;
        let share = ShareGrid::new(surfaces, &shares);
        Ok(Some(Self { share }))
    }
}
