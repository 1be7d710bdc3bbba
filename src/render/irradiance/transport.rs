//! Where the light of a probe comes from: cones over its hemisphere and what of the object they meet. Geometry only.

use std::f32::consts::{PI, TAU};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use super::probes::{Probe, Probes};
use crate::geometry::{GOLDEN_ANGLE, SurfaceTracer, irradiance_directions};
use crate::render::ground::GroundResolution;
use crate::render::path::shade::MOTION_SAMPLES;
use crate::render::path::trace::{is_hidden, meet_again};

/// How finely light is gathered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Resolution {
    /// Probes on the surface.
    pub n_probes: usize,
    /// Cones over the hemisphere of each.
    pub n_cones: usize,
    /// Whether shadow rays go to the lamps from every point that is lit, not from the probes alone.
    pub traces_lamps: bool,
    /// Of the surfaces around the object, with the most samples of all rays into the environment.
    pub ground: GroundResolution,
}

impl Resolution {
    /// For pictures that stay.
    pub const FINE: Self = Self {
        n_probes: 1024,
        n_cones: 128,
        traces_lamps: true,
        ground: GroundResolution {
            side: 64,
            n_looks: 96,
            n_directions: 192,
            most_samples: usize::MAX,
        },
    };
    /// For pictures in motion.
    pub const COARSE: Self = Self {
        n_probes: 96,
        n_cones: 16,
        traces_lamps: false,
        ground: GroundResolution {
            side: 24,
            n_looks: 14,
            n_directions: 32,
            most_samples: MOTION_SAMPLES,
        },
    };
}

/// A cone from a probe.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cone {
    /// Unit, away from the probe.
    pub(super) direction: Vec3,
    /// Solid angle, steradians: all cones bring the same share of the irradiance, `weight * cos = π/n`.
    pub(super) weight: f32,
    /// What it meets of the object.
    pub(super) met: Option<Met>,
}

/// A point of the object that a cone meets.
#[derive(Clone, Copy, Debug)]
pub(super) struct Met {
    pub(super) position: Vec3,
    pub(super) normal: Vec3,
    /// Mirror direction of the cone there.
    pub(super) reflected: Vec3,
    /// Cosine between normal and cone.
    pub(super) cos: f32,
    /// Distance from the probe.
    pub(super) distance: f32,
    /// Turn of the normal, radians a world unit.
    pub(super) curvature: f32,
    /// Whether the mirror direction meets the object once more.
    pub(super) is_enclosed: bool,
}

impl Cone {
    /// Variance of its directions per transverse axis: that of a disc of its solid angle, `r²/4`.
    pub(super) fn variance(&self) -> f32 {
        self.weight / (4.0 * PI)
    }
}

/// Probes with their cones.
#[derive(Debug)]
pub struct Transport {
    pub(super) tracer: Arc<SurfaceTracer>,
    pub(super) probes: Probes,
    /// Of each probe.
    pub(super) cones: Vec<Vec<Cone>>,
    pub(super) resolution: Resolution,
}

impl Transport {
    /// Places the probes and traces their cones, in parallel; `None` when cancelled.
    pub fn trace(
        tracer: &Arc<SurfaceTracer>,
        resolution: Resolution,
        cancel: &AtomicBool,
    ) -> Option<Self> {
        let probes = Probes::on_mesh(tracer.mesh(), resolution.n_probes);
        let cones = probes
            .probes()
            .par_iter()
            .enumerate()
            .map(|(i, probe)| {
                let turn = i as f32 * GOLDEN_ANGLE % TAU;
                (!cancel.load(Ordering::Relaxed))
                    .then(|| cones(tracer, probe, turn, resolution.n_cones))
            })
            .collect::<Option<Vec<_>>>()?;
        Some(Self {
            tracer: Arc::clone(tracer),
            probes,
            cones,
            resolution,
        })
    }
}

/// Cones at equal shares of the cosine-weighted hemisphere.
fn cones(tracer: &SurfaceTracer, probe: &Probe, turn: f32, n: usize) -> Vec<Cone> {
    irradiance_directions(probe.normal, n, turn)
        .map(|(direction, up)| Cone {
            direction,
            weight: PI / (n as f32 * up),
            met: met(tracer, probe, direction),
        })
        .collect()
}

fn met(tracer: &SurfaceTracer, probe: &Probe, direction: Vec3) -> Option<Met> {
    // What lies between the shading normal's horizon and the triangle is free on the smooth surface that is meant.
    if direction.dot(probe.face_normal) <= 0.0 {
        return None;
    }
    let hit = meet_again(tracer, probe.position, direction)?;
    let cos = -hit.normal.dot(direction);
    let reflected = (direction + 2.0 * cos * hit.normal).normalize_or(hit.normal);
    Some(Met {
        position: hit.position,
        normal: hit.normal,
        reflected,
        cos: cos.max(0.0),
        distance: hit.t,
        curvature: tracer.curvature(&hit),
        is_enclosed: is_hidden(tracer, hit.position, reflected, f32::INFINITY),
    })
}
