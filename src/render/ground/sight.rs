//! How far along a ray light gets.

use std::ops::Range;

use glam::Vec3;

use crate::neif::field::radiance_field::{FieldBatch, FieldRay};

/// Opacity below which a ray ends nowhere.
const OPAQUE: f32 = 0.5;

/// An evaluated ray with its samples.
pub(super) struct Sight<'a> {
    pub(super) ray: &'a FieldRay,
    distances: &'a [f32],
    weights: &'a [f32],
}

impl<'a> Sight<'a> {
    /// Ray `i` of an evaluated batch.
    pub(super) fn of(batch: &'a FieldBatch, i: usize) -> Self {
        let n = batch.weights().len() / batch.rays.len();
        let samples = i * n..(i + 1) * n;
        Self {
            ray: &batch.rays[i],
            distances: &batch.distances()[samples.clone()],
            weights: &batch.weights()[samples],
        }
    }

    /// The point at a distance, in lengths of the direction.
    pub(super) fn point(&self, distance: f32) -> Vec3 {
        Vec3::from(self.ray.cone.origin) + distance * Vec3::from(self.ray.cone.direction)
    }

    /// Field units a unit of distance.
    pub(super) fn speed(&self) -> f32 {
        Vec3::from(self.ray.cone.direction).length()
    }

    /// Standard deviation of the cone about a point on it, field units.
    pub(super) fn blur(&self, point: Vec3) -> f32 {
        let cone = &self.ray.cone;
        let direction = Vec3::from(cone.direction);
        let distance = (point - Vec3::from(cone.origin)).dot(direction);
        let distance = distance / direction.length_squared().max(f32::MIN_POSITIVE);
        cone.variance(distance.max(0.0)).sqrt()
    }

    /// Distances between which the ray is in a ball; `None` where it passes by.
    pub(super) fn within(&self, center: Vec3, radius: f32) -> Option<Range<f32>> {
        let direction = Vec3::from(self.ray.cone.direction);
        let from = center - Vec3::from(self.ray.cone.origin);
        let length = direction.length_squared();
        let nearest = from.dot(direction) / length;
        let beside = (from - nearest * direction).length_squared();
        let half = (radius * radius - beside) / length;
        (half > 0.0).then(|| nearest - half.sqrt()..nearest + half.sqrt())
    }

    /// Distance and share of the light of each sample.
    pub(super) fn samples(&self) -> impl Iterator<Item = (f32, f32)> + '_ {
        let distances = self.distances.iter().copied();
        distances.zip(self.weights.iter().copied())
    }

    /// Calls `visit(near, far, weight)` along the ray: each sample stands for the ray from halfway to the one before up
    /// to halfway to the next.
    fn stretches(&self, mut visit: impl FnMut(f32, f32, f32) -> bool) {
        let last = self.distances.len().saturating_sub(1);
        let mut near = 0.0;
        for (i, weight) in self.weights.iter().enumerate() {
            let far = 0.5 * (self.distances[i] + self.distances[(i + 1).min(last)]);
            if !visit(near, far, *weight) {
                return;
            }
            near = far;
        }
    }

    /// Share of what is seen that lies at least `distance` away, `[0, 1]`.
    pub(super) fn beyond(&self, distance: f32) -> f32 {
        let mut before = 0.0;
        self.stretches(|near, far, weight| {
            let length = (far - near).max(f32::MIN_POSITIVE);
            before += weight * ((distance - near) / length).clamp(0.0, 1.0);
            far < distance
        });
        (1.0 - before).clamp(0.0, 1.0)
    }

    /// Distance before which half of the light comes from; `None` where the ray meets too little.
    pub(super) fn end(&self) -> Option<f32> {
        let opacity: f32 = self.weights.iter().sum();
        let (mut end, mut before) = (None, 0.0);
        self.stretches(|near, far, weight| {
            let missing = 0.5 * opacity - before;
            if weight >= missing && weight > 0.0 {
                end = Some(near + (far - near) * missing / weight);
            }
            before += weight;
            end.is_none()
        });
        end.filter(|_| opacity > OPAQUE)
    }
}
