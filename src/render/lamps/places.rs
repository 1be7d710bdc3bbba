//! Places of the object at which is known what light arrives and what photos taught of it.

use std::f32::consts::PI;

use glam::Vec3;

use super::{LitPlace, MovedLamps};
use crate::geometry::SurfaceTracer;
use crate::neif::light::shading::fresnel;
use crate::neif::surface::values::Surface;
use crate::render::irradiance::Probe;

/// A place of the object in the light that it was captured in.
#[derive(Clone, Copy, Debug)]
pub(in crate::render) struct Place {
    /// Where.
    pub(in crate::render) probe: Probe,
    /// What photos taught of it.
    pub(in crate::render) surface: Surface,
    /// Radiance that arrives from everything but lamps, weighted by the cosine: irradiance by π.
    pub(in crate::render) around: Vec3,
}

impl Place {
    /// Share of diffuse light in what the place sends on, `[0, 1]`.
    pub(super) fn diffuse_share(&self) -> f32 {
        let diffuse = self.surface.diffuse.element_sum();
        let mirrored = (fresnel(self.surface.tint, 1.0) * self.around).element_sum();
        diffuse / (diffuse + mirrored).max(f32::MIN_POSITIVE)
    }

    /// The constraint that its shading puts on lamps that are at `points`, one a part.
    pub(in crate::render) fn shaded(
        &self,
        tracer: &SurfaceTracer,
        points: &MovedLamps,
    ) -> LitPlace {
        let Probe {
            position, normal, ..
        } = self.probe;
        let mut arriving = vec![Vec3::ZERO; points.points.len()];
        points.arriving(Some(tracer), (position, normal), |part, toward, light| {
            arriving[part] += light * (normal.dot(toward) / PI);
        });
        // What a metal has of a diffuse part stands for what its lobe does not explain.
        let trust = self.diffuse_share().powi(2);
        LitPlace {
            radiance: self.surface.diffuse,
            trust,
            rest: self.around,
            lamps: arriving,
        }
    }
}
