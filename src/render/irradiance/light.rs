//! The light at the probes: what the trained surroundings sent there, what the present ones send, and their ratio.

use std::f32::consts::PI;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use super::cache::LightKey;
use super::transport::{Cone, Met, Transport};
use crate::neif::environment::LightScratch;
use crate::neif::lobe::Lobe;
use crate::neif::material::{MaterialBatch, Surface};
use crate::neif::radiance_field::{FieldBatch, FieldRay};
use crate::neif::shading::fresnel;
use crate::neif::{Environment, EnvironmentTransform, SurfaceField};
use crate::render::ground::{BakedGround, Ground, Shadow};

/// Largest ratio: a surface that was in the dark knows too little of its colour to show more.
const MAX_RATIO: f32 = 16.0;
/// Largest ratio of one place's light to another's that is believed.
const MAX_QUOTIENT: f32 = 4096.0;
/// Share of the mean light that is added to both sides of the ratio: in the dark it approaches the ratio of the means.
const FLOOR: f32 = 0.02;
/// Weight of the mean light against a probe's: counts only where no probe is near.
const FAR_WEIGHT: f32 = 1e-4;
/// Rounds of light sent from surface to surface: each is weaker by albedo times blocked share, seldom above 0.2.
const BOUNCES: usize = 3;

/// Linear irradiance as a function of the normal: one row a colour, `E(n) = max(0, M n)`.
///
/// The vector irradiance (Arvo 1994): exact at the probe's normal, and right to first order about it.
type Irradiance = Mat3;

/// A cone with the material that it meets.
#[derive(Clone, Copy, Debug)]
struct Beam {
    /// Direction from the probe, times solid angle.
    toward: Vec3,
    /// Asks the surroundings: along the cone, or mirrored where it meets the object.
    ray: Option<WorldCone>,
    /// Share of that light that arrives.
    gain: Vec3,
    /// What the object sends that does not come along `ray`, in the trained light.
    bounce: Vec3,
    /// Where the object is met: position and normal.
    met: Option<(Vec3, Vec3)>,
}

/// A cone in world coordinates.
#[derive(Clone, Copy, Debug)]
struct WorldCone {
    origin: Vec3,
    direction: Vec3,
    /// Standard deviation at the origin, world units.
    base: f32,
    /// Variance of the directions per transverse axis.
    variance: f32,
}

/// Radiance along the beams of each probe: empty until they were evaluated. Kept when interrupted.
#[derive(Clone, Debug, Default)]
pub(super) struct Gathered {
    /// What is done to the floor, once it was looked at.
    ground: Option<Arc<Ground>>,
    radiance: Vec<Vec<[f32; 3]>>,
}

/// An object in the light that it was trained in.
#[derive(Debug)]
pub struct TrainedLight {
    transport: Arc<Transport>,
    beams: Vec<Vec<Beam>>,
    /// Mean radiance along all rays.
    ray_mean: Vec3,
    irradiance: Vec<Irradiance>,
    mean: Vec3,
    ground: Option<Arc<BakedGround>>,
}

/// [`TrainedLight`] on its way.
#[derive(Debug)]
pub(super) struct TrainedWork {
    transport: Arc<Transport>,
    beams: Vec<Vec<Beam>>,
    gathered: Gathered,
}

impl TrainedWork {
    /// Looks up the material that the cones meet.
    pub(super) fn new(transport: Arc<Transport>, material: &SurfaceField) -> Self {
        let probes = transport.probes.probes().par_iter().zip(&transport.cones);
        let beams = probes
            .map_init(Default::default, |scratch, (probe, cones)| {
                beams(probe.position, cones, material, scratch)
            })
            .collect();
        Self {
            transport,
            beams,
            gathered: Gathered::default(),
        }
    }

    /// Gathers the light of the surroundings where they were trained; `None` when cancelled, to be taken up again.
    pub(super) fn run(&mut self, key: &LightKey, cancel: &AtomicBool) -> Option<TrainedLight> {
        let still = EnvironmentTransform::default();
        let own = &key.trained_in;
        if !self.gathered.run(&self.beams, own, &still, cancel) {
            return None;
        }
        let resolution = self.transport.resolution.ground;
        let ground = BakedGround::new(&key.object, own, resolution, cancel).ok()?;
        let mut beams = std::mem::take(&mut self.beams);
        let (transport, radiance) = (Arc::clone(&self.transport), &self.gathered.radiance);
        let first = irradiance(&beams, radiance, |beam| beam.bounce);
        let mean = mean_irradiance(&transport, &first);
        beams.par_iter_mut().flatten().for_each(|beam| {
            // An enclosed mirror sees about what is around it.
            if let (Some((position, normal)), None) = (beam.met, beam.ray) {
                let around = interpolate(&transport, &first, mean, position, normal);
                beam.bounce += beam.gain * around / PI;
            }
        });
        let irradiance = irradiance(&beams, radiance, |beam| beam.bounce);
        Some(TrainedLight {
            mean: mean_irradiance(&transport, &irradiance),
            ray_mean: self.gathered.mean(),
            transport,
            beams,
            irradiance,
            ground,
        })
    }
}

impl TrainedLight {
    /// What is done to the floor of the surroundings of `key`; `None` when cancelled.
    fn ground_in(&self, key: &LightKey, cancel: &AtomicBool) -> Option<Arc<Ground>> {
        let is_own = Arc::ptr_eq(&key.trained_in, &key.environment);
        if is_own && self.ground.is_none() {
            // Its shadow lies where it lay.
            return Some(Arc::default());
        }
        let baked = self.ground.as_ref().filter(|_| is_own);
        let shadow = Shadow::new(
            &key.object,
            &key.environment,
            &key.transform,
            baked.map(|baked| &**baked),
            self.transport.resolution.ground,
            cancel,
        )
        .ok()?;
        Some(Arc::new(Ground {
            baked: baked.cloned(),
            shadow,
        }))
    }

    /// Diffuse reflectance of a surface point whose baked diffuse radiance is `diffuse`: `π C_d / E`, in `[0, 1]`.
    pub fn albedo(&self, position: Vec3, normal: Vec3, diffuse: Vec3) -> Vec3 {
        let (transport, irradiance) = (&self.transport, &self.irradiance);
        let floor = FLOOR * self.mean;
        let light = interpolate(transport, irradiance, self.mean, position, normal) + floor;
        let albedo = PI * diffuse * (Vec3::ONE + FLOOR) / light.max(Vec3::splat(f32::MIN_POSITIVE));
        albedo.clamp(Vec3::ZERO, Vec3::ONE)
    }

    /// Irradiance at a surface point, linear, at least 0.
    pub fn irradiance(&self, position: Vec3, normal: Vec3) -> Vec3 {
        interpolate(
            &self.transport,
            &self.irradiance,
            self.mean,
            position,
            normal,
        )
    }

    /// Number of rays that the surroundings are asked with.
    pub fn n_rays(&self) -> usize {
        let beams = self.beams.iter().flatten();
        beams.filter(|beam| beam.ray.is_some()).count()
    }
}

/// How the light at the surface differs from the one that the diffuse part was trained in.
#[derive(Debug)]
pub struct DiffuseLight {
    trained: Arc<TrainedLight>,
    irradiance: Vec<Irradiance>,
    mean: Vec3,
    ground: Option<Arc<Ground>>,
}

impl DiffuseLight {
    /// Gathers the light of moved or other surroundings, but not their gain: the ratio is proportional to that. `None`
    /// when cancelled; `gathered` then keeps what was done, for the same arguments.
    pub(super) fn gather(
        trained: &Arc<TrainedLight>,
        key: &LightKey,
        gathered: &mut Gathered,
        cancel: &AtomicBool,
    ) -> Option<Self> {
        if gathered.ground.is_none() {
            gathered.ground = Some(trained.ground_in(key, cancel)?);
        }
        if !gathered.run(&trained.beams, &key.environment, &key.transform, cancel) {
            return None;
        }
        let transport = &trained.transport;
        let start = quotient(gathered.mean(), trained.ray_mean);
        let mut light = Self {
            irradiance: irradiance(&trained.beams, &gathered.radiance, |beam| {
                beam.bounce * start
            }),
            trained: Arc::clone(trained),
            mean: Vec3::ZERO,
            ground: gathered.ground.clone().filter(|ground| !ground.is_empty()),
        };
        light.mean = mean_irradiance(transport, &light.irradiance);
        for _ in 0..BOUNCES {
            light.irradiance = irradiance(&trained.beams, &gathered.radiance, |beam| {
                beam.met.map_or(Vec3::ZERO, |(position, normal)| {
                    beam.bounce * light.ratio(position, normal)
                })
            });
            light.mean = mean_irradiance(transport, &light.irradiance);
        }
        Some(light)
    }

    /// Present over trained irradiance at a surface point, per colour: at least 0, at most 16 times that of the means over
    /// the object, and 4096; 1 where there never was light. Light that is twice as bright gives twice the ratio.
    pub fn ratio(&self, position: Vec3, normal: Vec3) -> Vec3 {
        let trained = &self.trained;
        let (mut now, mut then, mut sum) = (Vec3::ZERO, Vec3::ZERO, FAR_WEIGHT);
        trained
            .transport
            .probes
            .near(position, normal, |i, weight| {
                now += weight * (self.irradiance[i] * normal).max(Vec3::ZERO);
                then += weight * (trained.irradiance[i] * normal).max(Vec3::ZERO);
                sum += weight;
            });
        let rest = FAR_WEIGHT + FLOOR * sum;
        let most = MAX_RATIO * quotient(self.mean, trained.mean);
        quotient(now + rest * self.mean, then + rest * trained.mean).min(most)
    }

    /// What is done to the floor of the surroundings.
    pub fn ground(&self) -> Option<&Arc<Ground>> {
        self.ground.as_ref()
    }

    /// The light that it is compared with.
    pub fn trained(&self) -> &Arc<TrainedLight> {
        &self.trained
    }
}

/// `a / b` per colour, in `[0, 4096]`; 1 where `b` is no positive number.
fn quotient(a: Vec3, b: Vec3) -> Vec3 {
    let one = |a: f32, b: f32| {
        if b > f32::MIN_POSITIVE && a.is_finite() && b.is_finite() {
            (a / b).clamp(0.0, MAX_QUOTIENT)
        } else {
            1.0
        }
    };
    Vec3::new(one(a.x, b.x), one(a.y, b.y), one(a.z, b.z))
}

/// Irradiance at a surface point.
fn interpolate(
    transport: &Transport,
    irradiance: &[Irradiance],
    mean: Vec3,
    position: Vec3,
    normal: Vec3,
) -> Vec3 {
    let (mut light, mut sum) = (FAR_WEIGHT * mean, FAR_WEIGHT);
    transport.probes.near(position, normal, |i, weight| {
        light += weight * (irradiance[i] * normal).max(Vec3::ZERO);
        sum += weight;
    });
    light / sum
}

/// Irradiance of every probe, from the radiance along its rays and what the object sends instead.
fn irradiance(
    beams: &[Vec<Beam>],
    radiance: &[Vec<[f32; 3]>],
    bounce: impl Fn(&Beam) -> Vec3 + Sync,
) -> Vec<Irradiance> {
    let probes = beams.par_iter().zip(radiance);
    probes
        .map(|(beams, radiance)| {
            let mut rays = radiance.iter();
            let mut columns = [Vec3::ZERO; 3];
            for beam in beams {
                let ray = beam.ray.and_then(|_| rays.next());
                let from_ray = ray.map_or(Vec3::ZERO, |radiance| beam.gain * Vec3::from(*radiance));
                let light = from_ray + bounce(beam);
                for (column, toward) in columns.iter_mut().zip(beam.toward.to_array()) {
                    *column += light * toward;
                }
            }
            Mat3::from_cols(columns[0], columns[1], columns[2])
        })
        .collect()
}

/// Mean over the probes, each at its own normal.
fn mean_irradiance(transport: &Transport, irradiance: &[Irradiance]) -> Vec3 {
    let probes = transport.probes.probes().iter().zip(irradiance);
    let sum: Vec3 = probes
        .map(|(probe, irradiance)| (*irradiance * probe.normal).max(Vec3::ZERO))
        .sum();
    sum / irradiance.len().max(1) as f32
}

/// The beams of one probe.
fn beams(
    origin: Vec3,
    cones: &[Cone],
    material: &SurfaceField,
    (batch, points, encoded): &mut (MaterialBatch, Vec<Vec3>, Vec<f32>),
) -> Vec<Beam> {
    points.clear();
    points.extend(cones.iter().filter_map(|cone| Some(cone.met?.position)));
    material.forward(points, batch, encoded);
    let mut surfaces = batch.surfaces.iter();
    cones
        .iter()
        .map(
            |cone| match cone.met.and_then(|met| Some((met, surfaces.next()?))) {
                Some((met, surface)) => blocked_beam(cone, &met, surface),
                None => Beam {
                    toward: cone.direction * cone.weight,
                    ray: Some(WorldCone {
                        origin,
                        direction: cone.direction,
                        base: 0.0,
                        variance: cone.variance(),
                    }),
                    gain: Vec3::ONE,
                    bounce: Vec3::ZERO,
                    met: None,
                },
            },
        )
        .collect()
}

/// A cone that meets the object: diffuse part and one lobe, widened as along a light path.
fn blocked_beam(cone: &Cone, met: &Met, surface: &Surface) -> Beam {
    let fresnel = fresnel(surface.tint, met.cos);
    let position_variance = met.distance * met.distance * cone.variance();
    let spread = (2.0 * met.curvature).powi(2) * position_variance;
    let lobe = Lobe::from_roughness(surface.roughness);
    Beam {
        toward: cone.direction * cone.weight,
        ray: (!met.is_enclosed).then(|| WorldCone {
            origin: met.position,
            direction: met.reflected,
            base: position_variance.sqrt(),
            variance: cone.variance() + spread + lobe.variance,
        }),
        gain: fresnel,
        bounce: surface.diffuse * (Vec3::ONE - fresnel),
        met: Some((met.position, met.normal)),
    }
}

impl Gathered {
    /// Evaluates what is missing, probe by probe, in parallel; whether that is all.
    fn run(
        &mut self,
        beams: &[Vec<Beam>],
        environment: &Environment,
        transform: &EnvironmentTransform,
        cancel: &AtomicBool,
    ) -> bool {
        let motion = transform.environment_from_world();
        let frame = environment.frame();
        let to_field = motion.length(1.0) / frame.half_side;
        let ground = self.ground.clone();
        self.radiance.resize(beams.len(), Vec::new());
        self.radiance.par_iter_mut().zip(beams).for_each_init(
            <(FieldBatch, LightScratch)>::default,
            |(batch, scratch), (radiance, beams)| {
                if !radiance.is_empty() || cancel.load(Ordering::Relaxed) {
                    return;
                }
                batch.rays.clear();
                batch
                    .rays
                    .extend(beams.iter().filter_map(|beam| beam.ray).map(|cone| {
                        let origin = frame.field_from_world(motion.point(cone.origin));
                        let axis = motion.direction(cone.direction);
                        FieldRay::of_cone(origin, axis, cone.variance, cone.base * to_field)
                    }));
                if batch.rays.is_empty() {
                    // A probe without any ray is done too.
                    radiance.push([0.0; 3]);
                    return;
                }
                environment.light(batch, scratch);
                if let Some(ground) = &ground {
                    ground.apply(batch);
                }
                radiance.extend_from_slice(&batch.radiance);
            },
        );
        self.radiance.iter().all(|radiance| !radiance.is_empty())
    }

    /// Mean radiance along all rays.
    fn mean(&self) -> Vec3 {
        let mut sum = Vec3::ZERO;
        let mut n = 0;
        for radiance in self.radiance.iter().flatten() {
            sum += Vec3::from(*radiance);
            n += 1;
        }
        sum / n.max(1) as f32
    }
}
