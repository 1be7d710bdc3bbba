//! Constraints on the brightness of lamps from the lobes of rough surfaces.
//!
//! The one cone of a lobe brings what photos taught it, tails of GGX included. The same lobe gathered from narrow cones
//! and from the lamps' points ([`super::highlights`]) should be as bright, which asks for the lamps' gains.

use std::f32::consts::TAU;

use glam::Vec3;
use rayon::prelude::*;

use super::{Compared, Lamps, LitPlace, MovedLamps, Place};
use crate::geometry::{SurfaceTracer, irradiance_directions, orthonormal_basis};
use crate::neif::field::radiance_field::{FieldBatch, FieldRay};
use crate::neif::light::environment::{EnvironmentField, LightScratch};
use crate::neif::light::light_path::first_lobe_ray;
use crate::neif::light::lobe::Lobe;
use crate::neif::light::lobe_cones::{PathOfPixel, lobe_cones};
use crate::neif::light::shading::SurfacePoint;
use crate::neif::surface::object::ObjectModel;
use crate::neif::{Environment, EnvironmentFromWorld};
use crate::render::irradiance::Probe;
use crate::render::path::trace::is_hidden;

/// Lobes that are asked for at once.
const LOBES_AT_ONCE: usize = 16;
/// Cones that stand for a lobe, in fours.
const FOURS_OF_CONES: u32 = 4;
/// Share of the light that is mirrored below which a surface's lobe is not asked.
const DULL: f32 = 0.2;
/// Share of a line of sight that is empty for good, from which photos were taken from about there: far from the object, the
/// beam of a photo is thinner than a cell.
const PHOTOGRAPHED: f32 = 0.25;
/// Directions to the eye that are tried at a place.
const N_EYES: usize = 16;
/// Lobe directions that must be free of the object, in deviations from the mirror direction.
const CLEAR: f32 = 1.5;

/// A lobe of the object that photos taught.
struct TaughtLobe {
    point: SurfacePoint,
    /// Perceptual roughness, and that of the one cone.
    roughness: [f32; 2],
    /// Share of the light that is mirrored.
    mirrored: f32,
}

/// The lobes at those places that mirror much through a lobe wide enough for the lamps' points, as places whose albedo is 1.
pub(in crate::render) fn lit_lobes(
    object: &ObjectModel,
    (environment, lamps, points): (&Environment, &Lamps, &MovedLamps),
    places: &[Place],
    motion: &EnvironmentFromWorld,
) -> Vec<LitLobe> {
    let taught = places.par_iter().enumerate().filter_map(|(number, place)| {
        let roughness = object.material.perceptual(place.surface).roughness;
        let mirrored = 1.0 - place.diffuse_share();
        if mirrored < DULL || points.spacing_share(roughness) < 1.0 {
            return None;
        }
        let lobe = TaughtLobe {
            point: photographed(&place.probe, environment, number)?,
            roughness: [roughness, place.surface.roughness],
            mirrored,
        };
        lobe.is_clear(&object.tracer).then_some(lobe)
    });
    let taught: Vec<TaughtLobe> = taught.collect();
    let light_of = |(batch, scratch): &mut (FieldBatch, LightScratch), lobes: &[TaughtLobe]| {
        batch.rays.clear();
        let ends: Vec<usize> = lobes
            .iter()
            .map(|lobe| {
                lobe.push_rays(environment, motion, &mut batch.rays);
                batch.rays.len()
            })
            .collect();
        environment.light(batch, scratch);
        let starts = std::iter::once(&0).chain(&ends);
        let lit = lobes.iter().zip(starts).zip(&ends);
        lit.map(|((lobe, &start), &end)| {
            let [one, narrow @ ..] = &batch.radiance[start..end] else {
                unreachable!("the one cone is always there");
            };
            lobe.lit(&object.tracer, (lamps, points), *one, narrow)
        })
        .collect::<Vec<_>>()
    };
    taught
        .par_chunks(LOBES_AT_ONCE)
        .map_init(Default::default, light_of)
        .flatten()
        .collect()
}

/// What a lobe of the object gathers in its own light.
#[derive(Clone, Debug)]
pub(in crate::render) struct LitLobe {
    /// Learned roughness.
    roughness: f32,
    /// How much it is believed as a whole.
    trust: f32,
    /// The constraint that it puts on lamps.
    pub(in crate::render) place: LitPlace,
}

impl LitLobe {
    /// Its one cone against several in the light of lamps with these gains.
    pub(in crate::render) fn compared(&self, gains: &[Vec3]) -> Compared {
        let several = self.place.light(gains);
        let logarithm = |v: Vec3| v.max(Vec3::splat(1e-3)).map(f32::ln);
        Compared {
            roughness: self.roughness,
            trust: self.trust,
            brighter: logarithm(self.place.radiance) - logarithm(several),
        }
    }
}

impl TaughtLobe {
    /// Whether its core meets nothing of the object.
    fn is_clear(&self, tracer: &SurfaceTracer) -> bool {
        let mirror = self.point.reflected();
        let (t, b) = orthonormal_basis(mirror);
        let reach = CLEAR * Lobe::from_roughness(self.roughness[1]).variance.sqrt();
        [Vec3::ZERO, t, -t, b, -b].iter().all(|side| {
            let toward = (mirror + reach * *side).normalize_or(mirror);
            let is_up = toward.dot(self.point.normal) > 0.0;
            is_up && !is_hidden(tracer, self.point.position, toward, f32::INFINITY)
        })
    }

    /// Adds its one cone, then its narrow ones.
    fn push_rays(
        &self,
        environment: &Environment,
        motion: &EnvironmentFromWorld,
        rays: &mut Vec<FieldRay>,
    ) {
        let (point, frame) = (&self.point, environment.frame());
        let [roughness, learned] = self.roughness;
        let ray = |axis: Vec3, lobe: &Lobe| first_lobe_ray(point, axis, lobe, motion, frame);
        rays.push(ray(point.reflected(), &Lobe::from_roughness(learned)));
        let path = PathOfPixel {
            times: FOURS_OF_CONES,
            ..PathOfPixel::ALONE
        };
        rays.extend(lobe_cones(point, roughness, path).map(|cone| {
            let variance = cone.lobe.variance + environment.sharpest_variance();
            ray(cone.axis, &Lobe::from_variance(variance))
        }));
    }

    /// The constraint it gives, from what its one cone and the narrow ones bring.
    fn lit(
        &self,
        tracer: &SurfaceTracer,
        (lamps, points): (&Lamps, &MovedLamps),
        one: [f32; 3],
        narrow: &[[f32; 3]],
    ) -> LitLobe {
        let rest = narrow.iter().map(|&light| lamps.below(light.into()));
        let rest = rest.sum::<Vec3>() / narrow.len().max(1) as f32;
        let mut by_part = vec![Vec3::ZERO; points.points.len()];
        points.gathered(tracer, &self.point, self.roughness[0], |part, light| {
            by_part[part] += light;
        });
        // It constrains the lamps by as much as they contribute to its light.
        let from_lamps = by_part.iter().sum::<Vec3>().element_sum();
        let share = from_lamps / (from_lamps + rest.element_sum()).max(f32::MIN_POSITIVE);
        LitLobe {
            roughness: self.roughness[1],
            trust: self.mirrored.powi(2),
            place: LitPlace {
                radiance: one.into(),
                trust: (self.mirrored * share).powi(2),
                rest,
                lamps: by_part,
            },
        }
    }
}

/// The place as seen from where photos were taken, if that can be determined; its `number` turns the directions that are
/// tried.
fn photographed(place: &Probe, environment: &Environment, number: usize) -> Option<SurfacePoint> {
    let EnvironmentField::Grid { density, .. } = environment.field() else {
        return None;
    };
    let start = environment.frame().field_from_world(place.position);
    let turn = number as f32 * 2.399_963 % TAU;
    let eyes = irradiance_directions(place.normal, N_EYES, turn)
        .map(|(eye, _)| (eye, density.void_share(start, eye)));
    let (to_eye, share) = eyes.max_by(|a, b| a.1.total_cmp(&b.1))?;
    (share >= PHOTOGRAPHED).then(|| SurfacePoint {
        position: place.position,
        normal: place.normal,
        to_eye,
        ..SurfacePoint::default()
    })
}
