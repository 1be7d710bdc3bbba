//! The light at an object's surface as probes and lamps give it, and the ratios of two of them.

use std::f32::consts::PI;
use std::sync::Arc;

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use super::probes::Probe;
use super::transport::Transport;
use crate::render::lamps::MovedLamps;

/// Largest ratio: a surface that was in the dark knows too little of its colour to show more.
const MAX_RATIO: f32 = 256.0;
/// Largest ratio of one place's light to another's that is believed.
const MAX_QUOTIENT: f32 = 4096.0;
/// Share of the mean light that is added to both sides of the ratio: in the dark it approaches the ratio of the means.
const FLOOR: f32 = 0.002;
/// Weight of the mean light against a probe's: counts only where no probe is near.
const FAR_WEIGHT: f32 = 1e-4;
/// Linear irradiance as a function of the normal: one row a colour, `E(n) = max(0, M n)`.
///
/// The vector irradiance (Arvo 1994): exact at the probe's normal, and right to first order about it.
pub(super) type Irradiance = Mat3;

/// The light of lamps.
#[derive(Clone, Debug)]
pub(super) struct LampLight {
    /// At the probes.
    at_probes: Vec<Irradiance>,
    /// The lamps for shadow rays from any other point; `None` without any, and where the probes have to do.
    lamps: Option<MovedLamps>,
}

/// The light at an object's surface.
#[derive(Debug)]
pub struct SurfaceLight {
    transport: Arc<Transport>,
    /// Of all but the lamps, at the probes.
    rest: Vec<Irradiance>,
    lamps: LampLight,
    /// Mean over the probes.
    pub(super) mean: Vec3,
}

impl LampLight {
    /// No lamps, for as many probes as there are in `rest`.
    pub(super) fn none(rest: &[Irradiance]) -> Self {
        Self {
            at_probes: vec![Irradiance::ZERO; rest.len()],
            lamps: None,
        }
    }

    pub(super) fn new(transport: &Transport, lamps: MovedLamps) -> Self {
        let tracer = &*transport.tracer;
        let at_probe = |probe: &Probe| {
            let mut light = Irradiance::ZERO;
            let at = (probe.position, probe.normal);
            lamps.arriving(Some(tracer), at, |_, toward, arriving| {
                let columns = toward.to_array().map(|share| arriving * share);
                light += Mat3::from_cols(columns[0], columns[1], columns[2]);
            });
            light
        };
        let probes = transport.probes.probes();
        let at_probes = probes.par_iter().map(at_probe).collect();
        let is_fine = transport.resolution.traces_lamps && !lamps.is_empty();
        Self {
            at_probes,
            lamps: is_fine.then_some(lamps),
        }
    }
}

impl SurfaceLight {
    /// The light of lamps and of the rest, which is given at the probes.
    pub(super) fn new(transport: &Arc<Transport>, rest: Vec<Irradiance>, lamps: LampLight) -> Self {
        let mut light = Self {
            transport: Arc::clone(transport),
            rest,
            lamps,
            mean: Vec3::ZERO,
        };
        let probes = transport.probes.probes().iter().enumerate();
        let at_probes = probes.map(|(i, probe)| light.at_probe(i, probe.normal, true));
        light.mean = at_probes.sum::<Vec3>() / light.rest.len().max(1) as f32;
        light
    }

    /// Irradiance for a normal at probe `i`, with or without the lamps.
    fn at_probe(&self, i: usize, normal: Vec3, has_lamps: bool) -> Vec3 {
        let rest = (self.rest[i] * normal).max(Vec3::ZERO);
        if !has_lamps {
            return rest;
        }
        rest + (self.lamps.at_probes[i] * normal).max(Vec3::ZERO)
    }

    /// Irradiance at a surface point, interpolated from the probes.
    pub(super) fn smooth(&self, position: Vec3, normal: Vec3) -> Vec3 {
        self.interpolated(position, normal, true)
    }

    /// Irradiance at a surface point, linear, at least 0; of lamps with the shadows that the object casts on itself.
    pub fn irradiance(&self, position: Vec3, normal: Vec3) -> Vec3 {
        let Some(lamps) = &self.lamps.lamps else {
            return self.smooth(position, normal);
        };
        let rest = self.interpolated(position, normal, false);
        rest + lamps.irradiance(Some(&self.transport.tracer), position, normal)
    }

    fn interpolated(&self, position: Vec3, normal: Vec3, has_lamps: bool) -> Vec3 {
        let (mut light, mut sum) = (FAR_WEIGHT * self.mean, FAR_WEIGHT);
        self.transport.probes.near(position, normal, |i, weight| {
            light += weight * self.at_probe(i, normal, has_lamps);
            sum += weight;
        });
        light / sum
    }

    /// Diffuse reflectance of a surface point that in this light has the diffuse radiance `diffuse`: `π C_d / E`, in
    /// `[0, 1]`. Below a share of the mean irradiance there is no light.
    pub fn albedo(&self, position: Vec3, normal: Vec3, diffuse: Vec3) -> Vec3 {
        let light = self.irradiance(position, normal) + FLOOR * self.mean;
        let albedo = PI * diffuse * (1.0 + FLOOR) / light.max(Vec3::splat(f32::MIN_POSITIVE));
        albedo.clamp(Vec3::ZERO, Vec3::ONE)
    }
}

/// Present over trained irradiance, both with their means over the object.
pub(in crate::render) fn ratio(
    (now, mean_now): (Vec3, Vec3),
    (then, mean_then): (Vec3, Vec3),
) -> Vec3 {
    let most = MAX_RATIO * quotient(mean_now, mean_then);
    quotient(now + FLOOR * mean_now, then + FLOOR * mean_then).min(most)
}

/// `a / b` per colour, in `[0, 4096]`; 1 where `b` is no positive number.
pub(super) fn quotient(a: Vec3, b: Vec3) -> Vec3 {
    let one = |a: f32, b: f32| {
        if b > f32::MIN_POSITIVE && a.is_finite() && b.is_finite() {
            (a / b).clamp(0.0, MAX_QUOTIENT)
        } else {
            1.0
        }
    };
    Vec3::new(one(a.x, b.x), one(a.y, b.y), one(a.z, b.z))
}
