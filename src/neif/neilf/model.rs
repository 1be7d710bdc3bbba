//! A trained baseline: mesh, material and incident light, and the light that surface points send to the eye.

use std::sync::Arc;

use glam::Vec3;

use super::brdf::Sum;
use super::light::LightBatch;
use super::{Brdf, IncidentLight};
use crate::geometry::SurfaceTracer;
use crate::neif::light::display::Display;
use crate::neif::light::shading::SurfacePoint;
use crate::neif::surface::material::{Material, MaterialBatch};

/// Everything a picture needs; it knows nothing of the environment but what falls onto the surface.
#[derive(Clone, Debug)]
pub struct NeilfModel {
    /// The surface.
    pub tracer: Arc<SurfaceTracer>,
    /// How it reflects.
    pub brdf: Brdf,
    /// What it is made of, as `brdf` reads it.
    pub material: Material,
    /// The light that falls onto it.
    pub light: IncidentLight,
    /// From linear radiance to display values.
    pub display: Display,
    /// Directions over which a point's light is summed, of the hemisphere about +z.
    pub lattice: Vec<Vec3>,
}

/// Working memory of one thread, reused from call to call.
#[derive(Debug, Default)]
pub struct NeilfScratch {
    material: MaterialBatch,
    encoded: Vec<f32>,
    positions: Vec<Vec3>,
    directions: Vec<Vec3>,
    responses: Vec<Vec3>,
    constants: Vec<Vec3>,
    light: LightBatch,
}

impl NeilfModel {
    /// Adds the linear radiance that each point sends to its eye to `out`. The lattice is not turned, as in `NeILF`.
    pub fn shade(&self, points: &[SurfacePoint], scratch: &mut NeilfScratch, out: &mut Vec<Vec3>) {
        scratch.positions.clear();
        scratch.positions.extend(points.iter().map(|p| p.position));
        self.material.forward(
            &scratch.positions,
            &mut scratch.material,
            &mut scratch.encoded,
        );
        scratch.light.clear();
        scratch.responses.clear();
        scratch.constants.clear();
        for (point, surface) in points.iter().zip(&scratch.material.surfaces) {
            let (directions, lattice) = (&mut scratch.directions, &self.lattice);
            directions.clear();
            self.brdf
                .directions(surface, point, lattice, 0.0, directions);
            let first = scratch.responses.len();
            scratch
                .responses
                .resize(first + directions.len(), Vec3::ZERO);
            let responses = &mut scratch.responses[first..];
            let sum = Sum {
                point,
                directions,
                n_lattice: lattice.len(),
            };
            let constant = self.brdf.forward(surface, sum, responses);
            scratch.constants.push(constant);
            self.light
                .push(&mut scratch.light, point.position, directions);
        }
        self.light.encode(&mut scratch.light);
        for tile in scratch.light.tiles() {
            self.light.forward(&mut scratch.light, &tile);
            out.extend(tile.map(|point| {
                let rows = scratch.light.rows(point);
                let terms = scratch.responses[rows.clone()]
                    .iter()
                    .zip(&scratch.light.radiance[rows]);
                scratch.constants[point] + terms.map(|(r, l)| *r * *l).sum::<Vec3>()
            }));
        }
    }
}
