//! The floor under the object: the object's shadow and what it hides are part of the learned surroundings.
//!
//! Photos show the surroundings with the object in them. Where they are moved, swapped or looked at alone, the floor's
//! radiance is divided by the share of its light that the object left it where it was captured, [`BakedGround`], and
//! multiplied by the share that it leaves now, [`Shadow`]; what no photo can have seen is filled from around it. Both
//! shares come from the same formula, so that nothing changes where nothing moved. The floor is a horizontal plane
//! below the object, where the surroundings have a surface there; nothing else is corrected.

mod baked;
mod bounce;
mod light;
mod map;
mod shadow;
mod square;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use glam::Vec3;

pub use baked::BakedGround;
pub(crate) use baked::Captured;
pub use shadow::Shadow;

use crate::neif::radiance_field::{FieldBatch, FieldRay};
use square::{Meeting, Square};

/// How finely a floor is looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GroundResolution {
    /// Points a side of the square.
    pub side: usize,
    /// Directions that light comes from.
    pub n_directions: usize,
}

/// The work was given up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cancelled;

/// What is done to the floor of the surroundings.
#[derive(Clone, Debug, Default)]
pub struct Ground {
    /// Taken away.
    pub baked: Option<Arc<BakedGround>>,
    /// Put on.
    pub shadow: Option<Shadow>,
}

impl Ground {
    /// Whether nothing is done.
    pub fn is_empty(&self) -> bool {
        self.baked.is_none() && self.shadow.is_none()
    }

    /// Corrects the radiance of an evaluated batch: [`FieldBatch::radiance`].
    pub fn apply(&self, batch: &mut FieldBatch) {
        let n_rays = batch.rays.len();
        if n_rays == 0
            || !batch.weights().len().is_multiple_of(n_rays)
            || batch.weights().is_empty()
        {
            return;
        }
        let n = batch.weights().len() / n_rays;
        for i in 0..n_rays {
            let ray = &batch.rays[i];
            let samples = i * n..(i + 1) * n;
            let reach = Reach {
                distances: &batch.distances()[samples.clone()],
                weights: &batch.weights()[samples],
            };
            let seen = Vec3::from(batch.radiance[i]);
            let mut radiance = seen;
            if let Some(baked) = &self.baked {
                radiance = baked.cleaned(ray, &reach, radiance);
            }
            if let Some(shadow) = &self.shadow {
                radiance *= shadow.share(ray, &reach);
            }
            if radiance != seen {
                batch.radiance[i] = radiance.to_array();
            }
        }
    }
}

/// How far along a ray light gets.
struct Reach<'a> {
    distances: &'a [f32],
    weights: &'a [f32],
}

impl Reach<'_> {
    /// Share of what is seen that lies at least `distance` away, `[0, 1]`: each sample stands for the ray from halfway
    /// to the one before up to halfway to the next.
    fn beyond(&self, distance: f32) -> f32 {
        let n = self.distances.len();
        let middle = |i: usize| 0.5 * (self.distances[i] + self.distances[(i + 1).min(n - 1)]);
        let (mut near, mut before) = (0.0, 0.0);
        for (i, weight) in self.weights.iter().enumerate() {
            let far = middle(i);
            if distance <= near {
                break;
            }
            let length = (far - near).max(f32::MIN_POSITIVE);
            before += weight * ((distance - near) / length).min(1.0);
            near = far;
        }
        (1.0 - before).clamp(0.0, 1.0)
    }
}

/// Where a ray meets a square, and how blurred it is there in points of a map.
fn meet(square: &Square, ray: &FieldRay) -> Option<(Meeting, f32)> {
    let meeting = square.meet(Vec3::from(ray.cone.origin), Vec3::from(ray.cone.direction))?;
    let blur = ray.cone.variance(meeting.distance).sqrt() / square.point_size();
    Some((meeting, blur))
}

/// 0 up to `from`, 1 from `to` on, smooth between.
fn smoothstep(from: f32, to: f32, v: f32) -> f32 {
    let x = ((v - from) / (to - from)).clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}
