//! The shadow of the object on the floor of surroundings that are not those it was captured in, or not where they were.

use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::baked::{BakedGround, Captured, FLOOR_LOOK, FLOOR_SLAB, half_side};
use super::bounce::Bounce;
use super::light::{Stand, is_floor, look_down};
use super::map::Map;
use super::square::Square;
use super::{Cancelled, GroundResolution, Reach, meet};
use crate::neif::environment::EnvironmentField;
use crate::neif::radiance_field::FieldRay;
use crate::neif::{Environment, EnvironmentTransform, ObjectModel};
use crate::render::irradiance::Probes;
use crate::render::lamps::Lamps;

/// The share of its light that an object leaves a floor.
#[derive(Clone, Debug)]
pub struct Shadow {
    square: Square,
    /// The share, and whether there is a floor.
    share: Map,
}

impl Shadow {
    /// The shadow in surroundings at `transform` of an object with probes, which was `captured` in others or elsewhere;
    /// `baked`: what is known of their floor. `None` when there is no
    /// floor below the object.
    pub(crate) fn new(
        object: &ObjectModel,
        (environment, lamps): (&Environment, &Lamps),
        transform: &EnvironmentTransform,
        (probes, captured): (&Probes, &Captured),
        baked: Option<&BakedGround>,
        resolution: GroundResolution,
        cancel: &AtomicBool,
    ) -> Result<Option<Self>, Cancelled> {
        // What is infinitely far has no floor; the paper's network does not tell where its light comes from.
        if !matches!(environment.field(), EnvironmentField::Grid { .. }) {
            return Ok(None);
        }
        let stand = Stand {
            object,
            environment,
            motion: transform.environment_from_world(),
            lamps,
        };
        let foot = stand.foot();
        let up = environment.up();
        let half_side = half_side(foot.radius, foot.height);
        // A known floor keeps its height, wherever the object went.
        let lift = baked.map_or(0.0, |baked| (baked.square().center - foot.center).dot(up));
        let square = Square::new(foot.center + lift * up, up, half_side, resolution.side);
        let looks = look_down(
            environment,
            &square,
            FLOOR_LOOK * half_side,
            FLOOR_SLAB * half_side,
        );
        let floors: Vec<f32> = looks
            .iter()
            .enumerate()
            .map(|(i, look)| {
                let known = baked.and_then(|baked| baked.floor_at(square.point(i)));
                look.floor.max(known.unwrap_or(0.0)).min(1.0)
            })
            .collect();
        let bounce = Bounce::new(&stand, probes, resolution).relit(&captured.irradiance);
        let shares = stand.shares(&square, &bounce, resolution.n_directions, cancel)?;
        if !is_floor(&shares, &floors, &vec![1.0; floors.len()]) {
            return Ok(None);
        }
        let values = shares
            .iter()
            .zip(&floors)
            .map(|(share, floor)| share.light.extend(*floor))
            .collect();
        Ok(Some(Self {
            share: Map::new(square.side, values),
            square,
        }))
    }

    /// Share of the radiance along a ray that is left, a colour.
    pub(super) fn share(&self, ray: &FieldRay, reach: &Reach<'_>) -> Vec3 {
        let Some((meeting, blur)) = meet(&self.square, ray) else {
            return Vec3::ONE;
        };
        let share = self.share.at(meeting.place, blur);
        let slab = FLOOR_SLAB * self.square.half_side;
        let reached = reach.beyond(meeting.distance - slab / meeting.fall);
        Vec3::ONE.lerp(share.truncate(), share.w * meeting.fade() * reached)
    }
}
