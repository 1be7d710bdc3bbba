//! The plane that an object stood on, and what no camera can have seen of it.

use glam::{Vec3, Vec4};

use super::look::{FLOOR_SLAB, Share, is_floor, lightness, look_down};
use super::map::Map;
use super::share_grid::ShareGrid;
use super::sight::Sight;
use super::smoothstep;
use super::square::Square;
use super::stand::Stand;

/// What hides a point that no camera saw may be as high as this, in heights of the object.
const GHOST_HEIGHT: f32 = 0.5;
/// Share of the cameras' directions from which a point counts as not seen, and as seen.
const SEEN: [f32; 2] = [0.05, 0.25];
/// Share of the light at which a point is too dark to determine its colour, and at which it is not.
const LIT: [f32; 2] = [0.04, 0.1];
/// Share of the light from which a point does not, and does, determine the colour of places that no camera saw.
const INFORMATIVE: [f32; 2] = [0.2, 0.7];

/// What an object stood on.
#[derive(Clone, Debug)]
pub(super) struct Support {
    pub(super) plane: Square,
    /// Whether there is something to stand on.
    floor: Map,
    /// Radiance without the object, and how far it replaces what was learned.
    clean: Map,
    /// Height of what a point that no camera saw may hide behind, field units.
    ghost: f32,
}

/// What an object hid along a ray.
pub(super) struct Hidden {
    /// On the plane.
    pub(super) point: Vec3,
    /// Without the object.
    pub(super) radiance: Vec3,
    /// Share of the ray's light that it replaces.
    pub(super) weight: f32,
}

impl Support {
    /// Looks at a plane with the object on it, which leaves each patch of the surfaces its share of the light; `None` when
    /// there is nothing to stand on.
    pub(super) fn new(
        stand: &Stand<'_>,
        plane: Square,
        grid: &ShareGrid,
        shares: &[Share],
    ) -> Option<Self> {
        let n = plane.len();
        let at = |i: usize| {
            let point = plane.point(i);
            let near = grid.surfaces.near(point);
            Share {
                light: grid.at(point, 0.0),
                seen: near.map_or(1.0, |(number, _)| shares[number].seen),
            }
        };
        let shares: Vec<Share> = (0..n).map(at).collect();
        let looks = look_down(stand.environment, &plane);
        let known: Vec<f32> = shares
            .iter()
            .zip(&looks)
            .map(|(share, look)| {
                look.seen
                    * smoothstep(SEEN[0], SEEN[1], share.seen)
                    * smoothstep(LIT[0], LIT[1], lightness(share.light))
            })
            .collect();
        if !is_floor(&shares, &looks, &known) {
            return None;
        }
        let floors: Vec<Vec4> = looks.iter().map(|look| Vec4::splat(look.floor)).collect();
        let floor = Map::filled(plane.side, &floors, &known);
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
                let lit = smoothstep(INFORMATIVE[0], INFORMATIVE[1], lightness(share.light));
                look.floor * known * (lit + 1e-3)
            })
            .collect();
        let clean = Map::filled(plane.side, &clean, &sure);
        let place = |i: usize| plane.place_of(plane.point(i));
        let clean = (0..n)
            .map(|i| clean.at(place(i), 0.0).truncate().extend(1.0 - known[i]))
            .collect();
        Some(Self {
            floor,
            clean: Map::new(plane.side, clean),
            ghost: GHOST_HEIGHT * stand.foot(plane.up).height,
            plane,
        })
    }

    /// Whether there is something to stand on at a point of the plane, `[0, 1]`.
    pub(super) fn floor_at(&self, point: Vec3) -> f32 {
        let place = self.plane.place_of(point);
        if place.length_squared() < 1.0 {
            self.floor.at(place, 0.0).x.clamp(0.0, 1.0)
        } else {
            0.0
        }
    }

    /// What the object hid along a ray.
    pub(super) fn hidden(&self, sight: &Sight<'_>) -> Option<Hidden> {
        let cone = &sight.ray.cone;
        let meeting = self.plane.meet(cone.origin.into(), cone.direction.into())?;
        let point = sight.point(meeting.distance);
        let blur = sight.blur(point) / self.plane.point_size();
        let clean = self.clean.at(meeting.place, blur);
        if clean.w <= 0.0 {
            return None;
        }
        let floor = self.floor.at(meeting.place, blur).x.clamp(0.0, 1.0);
        let slab = FLOOR_SLAB * self.plane.half_side;
        let above = slab + (self.ghost - slab).max(0.0) * clean.w;
        let reached = sight.beyond(meeting.distance - above / meeting.fall);
        Some(Hidden {
            point,
            radiance: clean.truncate(),
            weight: clean.w * floor * meeting.fade() * reached,
        })
    }
}

/// Least share that is divided by: less says nothing of the colour there.
pub(super) const LEAST_SHARE: f32 = 0.1;
