//! What the object did to the floor where it was captured.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::{Vec3, Vec4};

use super::bounce::Bounce;
use super::light::{Stand, is_floor, lightness, look_down};
use super::map::Map;
use super::square::Square;
use super::{Cancelled, GroundResolution, Reach, meet, smoothstep};
use crate::neif::radiance_field::FieldRay;
use crate::neif::{Environment, EnvironmentTransform, ObjectModel};
use crate::render::irradiance::Probes;
use crate::render::lamps::Lamps;

/// Half the square's side: this many heights of the object beyond its radius.
const MARGIN_HEIGHTS: f32 = 1.2;
/// Height from which the floor is looked at, and half the thickness within which its samples lie, half sides.
pub(super) const FLOOR_LOOK: f32 = 0.5;
pub(super) const FLOOR_SLAB: f32 = 0.06;
/// What hides a point that no camera saw may be as high as this, in heights of the object.
const GHOST_HEIGHT: f32 = 0.5;
/// Share of the cameras' directions from which a point counts as not seen, and as seen.
const SEEN: [f32; 2] = [0.05, 0.25];
/// Share of the light at which a point is too dark to tell its colour, and at which it is not.
const LIT: [f32; 2] = [0.04, 0.1];
/// Share of the light from which a point does not, and does, tell the colour of places that no camera saw.
const TELLING: [f32; 2] = [0.2, 0.7];
/// Least share that is divided by.
const LEAST_SHARE: f32 = 0.03;

/// What an object does to the surroundings that it was captured in.
#[derive(Debug)]
pub(crate) struct Captured {
    /// The floor that it stood on, where there is one.
    pub(crate) floor: Option<Arc<BakedGround>>,
    /// Irradiance at its probes, as [`Bounce::relit`] takes it.
    pub(super) irradiance: Vec<Vec3>,
}

impl Captured {
    /// Looks at the surroundings with the object, by `probes` on it.
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
            floor: BakedGround::new(&stand, &bounce, resolution, cancel)?,
            irradiance: bounce.irradiance(),
        })
    }
}

/// The floor of surroundings without the shadow and the hidden part of the object that was captured in them.
#[derive(Clone, Debug)]
pub struct BakedGround {
    square: Square,
    /// Share of the light that the object left, and whether there is a floor.
    share: Map,
    /// Radiance without the object, and how far it replaces what was learned.
    clean: Map,
    /// Height of what a point that no camera saw may hide behind, field units.
    ghost: f32,
}

impl BakedGround {
    /// Looks at the floor that the object stood on; `None` when there is none.
    fn new(
        stand: &Stand<'_>,
        bounce: &Bounce<'_>,
        resolution: GroundResolution,
        cancel: &AtomicBool,
    ) -> Result<Option<Arc<Self>>, Cancelled> {
        let own = stand.environment;
        let foot = stand.foot();
        let half_side = half_side(foot.radius, foot.height);
        let square = Square::new(foot.center, own.up(), half_side, resolution.side);
        let shares = stand.shares(&square, bounce, resolution.n_directions, cancel)?;
        let looks = look_down(own, &square, FLOOR_LOOK * half_side, FLOOR_SLAB * half_side);
        let known: Vec<f32> = shares
            .iter()
            .zip(&looks)
            .map(|(share, look)| {
                look.seen
                    * smoothstep(SEEN[0], SEEN[1], share.seen)
                    * smoothstep(LIT[0], LIT[1], lightness(share.light))
            })
            .collect();
        let floor: Vec<f32> = looks.iter().map(|look| look.floor).collect();
        if !is_floor(&shares, &floor, &known) {
            return Ok(None);
        }
        let floors: Vec<Vec4> = looks.iter().map(|look| Vec4::splat(look.floor)).collect();
        let floors = Map::filled(square.side, &floors, &known);
        let clean: Vec<Vec4> = looks
            .iter()
            .zip(&shares)
            .map(|(look, share)| {
                let share = share.light.max(Vec3::splat(LEAST_SHARE));
                (look.radiance / share).extend(0.0)
            })
            .collect();
        let sure: Vec<f32> = looks
            .iter()
            .zip(known.iter().zip(&shares))
            .map(|(look, (known, share))| {
                let lit = smoothstep(TELLING[0], TELLING[1], lightness(share.light));
                look.floor * known * (lit + 1e-3)
            })
            .collect();
        let clean = Map::filled(square.side, &clean, &sure);
        let place = |i: usize| square.place_of(square.point(i));
        let n = square.len();
        Ok(Some(Arc::new(Self {
            share: Map::new(
                square.side,
                (0..n)
                    .map(|i| {
                        let light = shares[i].light.max(Vec3::splat(LEAST_SHARE));
                        light.extend(floors.at(place(i), 0.0).x.clamp(0.0, 1.0))
                    })
                    .collect(),
            ),
            clean: Map::new(
                square.side,
                (0..n)
                    .map(|i| clean.at(place(i), 0.0).truncate().extend(1.0 - known[i]))
                    .collect(),
            ),
            ghost: GHOST_HEIGHT * foot.height,
            square,
        })))
    }

    /// The plane of the floor.
    pub(super) fn square(&self) -> &Square {
        &self.square
    }

    /// Whether there is a floor at a point of the plane, `[0, 1]`; `None` outside the square.
    pub(super) fn floor_at(&self, point: Vec3) -> Option<f32> {
        let place = self.square.place_of(point);
        (place.length_squared() < 1.0).then(|| self.share.at(place, 0.0).w)
    }

    /// What the ray would see without the object's traces.
    pub(super) fn cleaned(&self, ray: &FieldRay, reach: &Reach<'_>, seen: Vec3) -> Vec3 {
        let Some((meeting, blur)) = meet(&self.square, ray) else {
            return seen;
        };
        let (share, clean) = (
            self.share.at(meeting.place, blur),
            self.clean.at(meeting.place, blur),
        );
        let slab = FLOOR_SLAB * self.square.half_side;
        let above = slab + (self.ghost - slab).max(0.0) * clean.w;
        let reached = reach.beyond(meeting.distance - above / meeting.fall);
        let floor = seen / share.truncate();
        let floor = floor.lerp(clean.truncate(), clean.w);
        seen.lerp(floor, share.w * meeting.fade() * reached)
    }
}

/// Half the side of the square around a foot.
pub(super) fn half_side(radius: f32, height: f32) -> f32 {
    radius + MARGIN_HEIGHTS * height
}
