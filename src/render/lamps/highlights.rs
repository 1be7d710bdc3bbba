//! What a lobe that is split into cones gathers of the lamps: from their points, wherever the lobe is wide enough not to
//! resolve them.
//!
//! The field's thin rays know a lamp less well than the object's shading does ([`super::gains`]), and few cones meet a
//! small one. What the cones see above [`Lamps::white`] gives way to the points, with the brightness
//! estimated from the shading.

use std::f32::consts::PI;
use std::sync::Arc;

use glam::Vec3;

use super::{Lamps, MovedLamps};
use crate::geometry::SurfaceTracer;
use crate::neif::EnvironmentFromWorld;
use crate::neif::light::lobe::Lobe;
use crate::neif::light::lobe_cones::lobe_density;
use crate::neif::light::shading::SurfacePoint;
use crate::render::path::trace::is_hidden;

/// Light, as a share of white, below which a point is not asked for its shadow.
const LITTLE: f32 = 1e-3;
/// Variance of a lobe, in solid angles of a point, from which points count and from which they count wholly: two
/// neighbours are then one deviation apart.
const APART: [f32; 2] = [0.5, 1.0];

/// The lamps that light a scene's lobes.
#[derive(Clone, Debug)]
pub(in crate::render) struct Highlights {
    /// What is a lamp's.
    lamps: Arc<Lamps>,
    points: MovedLamps,
    /// How much of what the cones see of lamps the points replace, `[0, 1]`: all once they say an octave more or less.
    weight: f32,
}

impl Highlights {
    /// Of lamps, in a world in which the environment was moved; `None` where points say no more of them than the cones.
    pub(in crate::render) fn new(
        lamps: &Arc<Lamps>,
        motion: &EnvironmentFromWorld,
    ) -> Option<Self> {
        let weight = lamps.correction.min(1.0);
        (weight > 0.0).then(|| Self {
            lamps: Arc::clone(lamps),
            points: lamps.points_of(&lamps.parts(), motion),
            weight,
        })
    }

    /// Takes the lamps' light out of the radiance of the `cones` that stand for GGX's lobe of a perceptual roughness, as
    /// far as points count; what the lobe gathers from the points that the object does not hide.
    pub(in crate::render) fn take(
        &self,
        tracer: &SurfaceTracer,
        (point, roughness): (&SurfacePoint, f32),
        cones: &mut [[f32; 3]],
    ) -> Vec3 {
        let share = self.weight * self.points.spacing_share(roughness);
        if share <= 0.0 {
            return Vec3::ZERO;
        }
        for radiance in cones {
            let seen = Vec3::from(*radiance);
            *radiance = seen.lerp(self.lamps.below(seen), share).to_array();
        }
        let mut sum = Vec3::ZERO;
        self.points
            .gathered(tracer, point, roughness, |_, light| sum += light);
        share * sum
    }
}

impl MovedLamps {
    /// How far a lobe of this perceptual roughness is too wide to resolve the points, `[0, 1]`.
    pub(super) fn spacing_share(&self, roughness: f32) -> f32 {
        let sum: f32 = self.points.iter().map(|point| point.solid_angle).sum();
        let solid_angle = sum / self.points.len().max(1) as f32;
        let variance = Lobe::from_roughness(roughness).variance / solid_angle;
        ((variance - APART[0]) / (APART[1] - APART[0])).clamp(0.0, 1.0)
    }

    /// Calls `visit(point, radiance)` for each point that GGX's lobe gathers light from and the object does not hide.
    pub(super) fn gathered(
        &self,
        tracer: &SurfaceTracer,
        point: &SurfacePoint,
        roughness: f32,
        mut visit: impl FnMut(usize, Vec3),
    ) {
        for (number, lamp) in self.points.iter().enumerate() {
            let (toward, distance, light) = self.unhidden(lamp, point.position);
            if point.normal.dot(toward) <= 0.0 {
                continue;
            }
            // A disc's variance an axis.
            let spread = lamp.solid_angle / (4.0 * PI) + point.spread * point.spread;
            let light = light * lobe_density(point, roughness, spread, toward);
            if light.max_element() > LITTLE && !is_hidden(tracer, point.position, toward, distance)
            {
                visit(number, light);
            }
        }
    }
}
