//! The light that arrives at the surfaces around an object, and the share of it that the object leaves.

use std::f32::consts::PI;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use super::bounce::Bounce;
use super::look::{FLOOR_SLAB, Share};
use super::square::Square;
use super::stand::Stand;
use super::surfaces::{Cells, Patch, Surfaces};
use super::{Cancelled, GroundResolution};
use crate::geometry::{Ray, irradiance_directions};
use crate::render::path::trace::meet_again;

/// Half the cube's side: this many heights of the object beyond its radius.
const MARGIN_HEIGHTS: f32 = 1.2;
/// Sine of the angles above a surface from which cameras look at it.
const CAMERA_BAND: std::ops::Range<f32> = 0.17..0.97;
/// Most light that is left of a unit: an object may mirror light onto what is near.
const MOST_SHARE: f32 = 2.0;
/// Height above a surface from which shadow rays start, half sides of the cube.
const LIFT: f32 = 1e-3;

/// Radii of the object within which the plane that it stands on is looked for.
const BESIDE: f32 = 1.6;
/// Half thicknesses of what is taken for that plane, in sizes of the object: narrower and narrower, as what was taken says
/// better where it lies.
const SLABS: [f32; 4] = [0.3, 0.2, 0.1, 0.05];
/// Cosine from which a patch faces the way of that plane.
const FACING: f32 = 0.8;
/// Cosine of a slope that is none, 2.5 degrees.
const LEVEL: f32 = 0.999;

/// Where an object stands, field coordinates.
pub(super) struct Foot {
    /// Below the middle of the object, as low as its lowest point.
    pub(super) center: Vec3,
    /// Farthest from the vertical through the middle.
    pub(super) radius: f32,
    pub(super) height: f32,
}

impl Stand<'_> {
    fn field(&self, p_world: Vec3) -> Vec3 {
        let frame = self.environment.frame();
        frame.field_from_world(self.motion.point(p_world))
    }

    /// Middle of the object, field coordinates.
    pub(super) fn middle(&self) -> Vec3 {
        self.field(self.object.tracer.mesh().bounds().center())
    }

    /// Where the object stands on what faces `up` (unit, of the environment).
    pub(super) fn foot(&self, up: Vec3) -> Foot {
        let points = self.object.tracer.mesh().positions.par_iter();
        let middle = self.middle();
        // Down, up and out.
        let around = points.map(|&p| {
            let from_middle = self.field(p) - middle;
            let height = from_middle.dot(up);
            Vec3::new(-height, height, (from_middle - height * up).length())
        });
        let most = around.reduce(|| Vec3::NEG_INFINITY, Vec3::max);
        Foot {
            center: middle - most.x * up,
            radius: most.z,
            height: most.x + most.y,
        }
    }

    /// The surfaces around the object.
    pub(super) fn surfaces(&self, resolution: GroundResolution) -> Surfaces {
        let foot = self.foot(self.environment.up());
        let cells = Cells {
            center: self.middle(),
            half_side: half_side(&foot),
            side: resolution.side,
        };
        let (center, far) = (cells.center, cells.half_side);
        let outside = |direction: Vec3| self.extent(center, far * direction);
        Surfaces::around(self.environment, cells, resolution, outside)
    }

    /// How far the object reaches from `center` along `to_far`, which ends beyond it; 0 where it is not. Field coordinates.
    fn extent(&self, center: Vec3, to_far: Vec3) -> f32 {
        let frame = self.environment.frame();
        let world = |point| self.motion.world_point(frame.world_from_field(point));
        let origin = world(center + to_far);
        let ray = Ray {
            origin,
            direction: (world(center) - origin).normalize_or_zero(),
        };
        let hit = self.object.tracer.intersect(&ray, 0.0, f32::INFINITY);
        hit.map_or(0.0, |hit| {
            let from_center = self.field(hit.position) - center;
            from_center.dot(to_far.normalize_or_zero()).max(0.0)
        })
    }

    /// The plane that the object stands on, to which the surfaces then keep; `None` where nothing below it is flat.
    pub(super) fn plane_below(&self, surfaces: &mut Surfaces) -> Option<Square> {
        let level = self.environment.up();
        let (mut up, mut foot) = (level, self.foot(level));
        let mut offset = 0.0;
        for slab in SLABS {
            let (normal, point) = plane_beside(surfaces, (&foot, up, offset), slab)?;
            // The field's noise is no slope.
            let found = if normal.dot(level) > LEVEL {
                level
            } else {
                normal
            };
            if found != up {
                up = found;
                foot = self.foot(up);
            }
            offset = (point - foot.center).dot(up);
        }
        let half_side = half_side(&foot);
        let slab = FLOOR_SLAB * half_side;
        // The object's lowest point says better than the field where it stands.
        let lift = if offset.abs() < slab { 0.0 } else { offset };
        let center = foot.center + lift * up;
        let plane = Square::new(center, up, half_side, surfaces.cells.side);
        surfaces.lay(&plane, slab, |point| point.distance(center) < foot.radius);
        Some(plane)
    }

    /// What the object does to each patch of the surfaces.
    pub(super) fn shares(
        &self,
        surfaces: &Surfaces,
        bounce: &Bounce<'_>,
        n_directions: usize,
        cancel: &AtomicBool,
    ) -> Result<Vec<Share>, Cancelled> {
        let lift = LIFT * surfaces.cells.half_side;
        let patches = surfaces.patches.par_iter();
        let shares: Option<Vec<Share>> = patches
            .map(|patch| {
                let lifted = patch.point + patch.normal * lift;
                (!cancel.load(Ordering::Relaxed))
                    .then(|| self.share(lifted, patch.normal, n_directions, bounce))
            })
            .collect();
        Ok(blurred(surfaces, &shares.ok_or(Cancelled)?))
    }

    /// What the object does to a point of a surface: keeps light from it, and sends some of its own.
    fn share(&self, point: Vec3, normal: Vec3, n_directions: usize, bounce: &Bounce<'_>) -> Share {
        let (tracer, frame) = (&*self.object.tracer, self.environment.frame());
        let normal_world = self.motion.world_direction(normal);
        let origin = self.motion.world_point(frame.world_from_field(point));
        let (mut light, mut all) = (Vec3::ZERO, Vec3::ZERO);
        let (mut n_seen, mut n_band) = (0_usize, 0_usize);
        for (toward, _) in irradiance_directions(normal, n_directions, 0.0) {
            let radiance = bounce.around.radiance(toward);
            let is_in_band = CAMERA_BAND.contains(&toward.dot(normal));
            let direction = self.motion.world_direction(toward);
            all += radiance;
            n_band += usize::from(is_in_band);
            if let Some(hit) = meet_again(tracer, origin, direction) {
                light += bounce.radiance(&hit, direction);
            } else {
                light += radiance;
                n_seen += usize::from(is_in_band);
            }
        }
        // As mean radiances from above: a lamp's irradiance over pi.
        let n = n_directions.max(1) as f32;
        let by_lamps = |tracer| bounce.lamps.irradiance(tracer, origin, normal_world) / PI;
        let light = light / n + by_lamps(Some(tracer));
        let all = all / n + by_lamps(None);
        Share {
            light: (light / all.max(Vec3::splat(f32::MIN_POSITIVE)))
                .clamp(Vec3::ZERO, Vec3::splat(MOST_SHARE)),
            seen: n_seen as f32 / n_band.max(1) as f32,
        }
    }
}

/// Mean normal and point of the patches below and beside an object that lie about a plane `offset` above its foot and face
/// its way, `up`, within `slab` sizes of the object.
fn plane_beside(
    surfaces: &Surfaces,
    (foot, up, offset): (&Foot, Vec3, f32),
    slab: f32,
) -> Option<(Vec3, Vec3)> {
    let size = surfaces.cells.size();
    let slab = slab * foot.height.max(foot.radius) + size;
    let reach = BESIDE * foot.radius + 2.0 * size;
    let (mut normals, mut points, mut n) = (Vec3::ZERO, Vec3::ZERO, 0.0);
    for patch in &surfaces.patches {
        let from_foot = patch.point - foot.center;
        let height = from_foot.dot(up);
        if (height - offset).abs() < slab
            && patch.normal.dot(up) > FACING
            && (from_foot - height * up).length() < reach
        {
            normals += patch.normal;
            points += patch.point;
            n += 1.0;
        }
    }
    normals.try_normalize().map(|normal| (normal, points / n))
}

/// Half the side of the cube around an object.
pub(super) fn half_side(foot: &Foot) -> f32 {
    foot.radius + MARGIN_HEIGHTS * foot.height
}

/// Means with the patches in the cells around: each direction casts a hard shadow of its own.
fn blurred(surfaces: &Surfaces, shares: &[Share]) -> Vec<Share> {
    let mean = |(patch, own): (&Patch, &Share)| {
        let (mut sum, mut n) = (*own, 1.0);
        for share in surfaces.beside(patch).map(|number| &shares[number]) {
            sum.light += share.light;
            sum.seen += share.seen;
            n += 1.0;
        }
        Share {
            light: sum.light / n,
            seen: sum.seen / n,
        }
    };
    surfaces.patches.iter().zip(shares).map(mean).collect()
}
