//! The light at the probes: what the trained environment sent there, what the present one sends, and their ratio.

use std::f32::consts::PI;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use super::key::LightKey;
use super::probes::Probes;
use super::surface_light::{Irradiance, LampLight, SurfaceLight, quotient, ratio};
use super::transport::{Cone, Met, Transport};
use crate::neif::field::radiance_field::{FieldBatch, FieldRay};
use crate::neif::light::environment::LightScratch;
use crate::neif::light::lobe::Lobe;
use crate::neif::light::shading::fresnel;
use crate::neif::surface::material::MaterialBatch;
use crate::neif::surface::values::Surface;
use crate::neif::{Environment, EnvironmentTransform, SurfaceField};
use crate::render::ground::{BakedGround, Captured, Ground, Shadow};
use crate::render::lamps::{Highlights, Lamps, Place, WideCones, lamp_gains, lit_lobes};

/// Places at which shading is looked at to estimate the lamps' brightness.
const N_SHADED: usize = 4096;
/// How much smaller than a probe's share of the directions, in variance, the cone is that is asked for the environment there:
/// the field is brighter in a wide cone than in the mean of the narrow ones in it, which photos show. Neighbouring probes look
/// in other directions, so that together they see all.
const SHARPER: f32 = 1.0 / 16.0;
/// Rounds of light sent from surface to surface: each is weaker by albedo times blocked share, seldom above 0.2.
const BOUNCES: usize = 3;

/// A cone with the material that it meets.
#[derive(Clone, Copy, Debug)]
struct Beam {
    /// Direction from the probe, times solid angle.
    toward: Vec3,
    /// Asks the environment: along the cone, or mirrored where it meets the object.
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
    /// What is done to the surfaces around the object, once they were looked at.
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
    /// Lamps of the trained environment, with the brightness estimated from the object's shading.
    pub(super) lamps: Arc<Lamps>,
    /// The light at the surface.
    pub surface: Arc<SurfaceLight>,
    captured: Captured,
}

/// [`TrainedLight`] on its way.
#[derive(Debug)]
pub(super) struct TrainedWork {
    transport: Arc<Transport>,
    beams: Vec<Vec<Beam>>,
    gathered: Gathered,
}

impl TrainedWork {
    /// Looks up the material at the probes and of what the cones meet.
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

    /// Irradiance from everything but lamps in the environment where it was trained; `None` when cancelled, to be taken up again.
    pub(super) fn rest(
        &mut self,
        key: &LightKey,
        lamps: &Lamps,
        cancel: &AtomicBool,
    ) -> Option<Vec<Irradiance>> {
        let most_samples = self.transport.resolution.ground.most_samples;
        let from = (&*key.trained_in, lamps, most_samples);
        let still = EnvironmentTransform::default();
        let is_all = self.gathered.run(&self.beams, from, &still, cancel);
        is_all.then(|| irradiance(&self.beams, &self.gathered.radiance, |beam| beam.bounce))
    }

    /// Lamps with the brightness estimated from the object's shading and lobes, where `rest` is the irradiance from everything
    /// else.
    pub(super) fn brightened(&self, lamps: &Lamps, rest: &[Irradiance], key: &LightKey) -> Lamps {
        let rest = SurfaceLight::new(&self.transport, rest.to_vec(), LampLight::none(rest));
        brightened(lamps, &rest, key)
    }

    /// Gathers the light of the environment where it was trained, whose lamps are `known` or are looked for; `None` when
    /// cancelled, to be taken up again.
    pub(super) fn run(
        &mut self,
        key: &LightKey,
        known: Option<Arc<Lamps>>,
        cancel: &AtomicBool,
    ) -> Option<TrainedLight> {
        let seen = match &known {
            Some(known) => Arc::clone(known),
            None => Arc::new(Lamps::learned(&key.trained_in, cancel)?),
        };
        let first = self.rest(key, &seen, cancel)?;
        let lamps = known.unwrap_or_else(|| Arc::new(self.brightened(&seen, &first, key)));
        let still = EnvironmentTransform::default().environment_from_world();
        let resolution = self.transport.resolution.ground;
        let (transport, light) = (Arc::clone(&self.transport), (&*key.trained_in, &*lamps));
        let probes = &transport.probes;
        let captured = Captured::new(&key.object, light, probes, resolution, cancel).ok()?;
        let points = lamps.points(&still);
        let by_lamps = LampLight::new(&transport, points);
        let first = SurfaceLight::new(&transport, first, by_lamps.clone());
        let mut beams = std::mem::take(&mut self.beams);
        beams.par_iter_mut().flatten().for_each(|beam| {
            // An enclosed mirror sees about what is around it.
            if let (Some((position, normal)), None) = (beam.met, beam.ray) {
                let around = first.smooth(position, normal);
                beam.bounce += beam.gain * around / PI;
            }
        });
        let rest = irradiance(&beams, &self.gathered.radiance, |beam| beam.bounce);
        Some(TrainedLight {
            ray_mean: self.gathered.mean(),
            surface: Arc::new(SurfaceLight::new(&transport, rest, by_lamps)),
            lamps,
            transport,
            beams,
            captured,
        })
    }
}

impl TrainedLight {
    /// The lamps of the environment, as bright as they are estimated.
    pub(in crate::render) fn lamps(&self) -> &Lamps {
        &self.lamps
    }

    /// By how much the one cone of a lobe is brighter than the several that stand for the same lobe, by learned roughness.
    pub(in crate::render) fn wide_gain(&self, learned: f32) -> Vec3 {
        self.lamps.wide.gain(learned)
    }

    /// What is done to the surfaces around the object in the environment of `key`; `None` when cancelled.
    fn ground_in(&self, key: &LightKey, lamps: &Lamps, cancel: &AtomicBool) -> Option<Arc<Ground>> {
        let is_own = Arc::ptr_eq(&key.trained_in, &key.environment);
        if is_own && self.captured.ground.is_none() {
            // Its shadow lies where it lay.
            return Some(Arc::default());
        }
        let baked = self.captured.ground.as_ref().filter(|_| is_own);
        let shadow = Shadow::new(
            &key.object,
            (&key.environment, lamps),
            &key.transform,
            (&self.transport.probes, &self.captured),
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

    /// The surfaces around the object where it was captured, where there are any.
    pub fn baked_ground(&self) -> Option<&Arc<BakedGround>> {
        self.captured.ground.as_ref()
    }
}

/// How the light at the surface differs from the one that the diffuse part was trained in.
#[derive(Debug)]
pub struct DiffuseLight {
    /// The light that it is compared with.
    pub(super) trained: Arc<TrainedLight>,
    /// The present light at the surface, before the transform's gain.
    pub surface: Arc<SurfaceLight>,
    /// What is done to the surfaces around the object.
    pub(super) ground: Option<Arc<Ground>>,
    /// The lamps that lobes gather, if there are any.
    pub(in crate::render) highlights: Option<Highlights>,
}

impl DiffuseLight {
    /// Factor of what several cones of the object's lobes gather, by learned roughness.
    pub(in crate::render) fn wide_gain(&self, learned: f32) -> Vec3 {
        self.trained.wide_gain(learned)
    }

    /// Gathers the light of a moved or another environment, or takes that of the captured one as it was, but not its gain:
    /// the ratio is proportional to that. `None` when cancelled; `gathered` then keeps what was done, for the same arguments.
    pub(super) fn gather(
        trained: &Arc<TrainedLight>,
        (key, lamps): (&LightKey, &Arc<Lamps>),
        gathered: &mut Gathered,
        cancel: &AtomicBool,
    ) -> Option<Self> {
        let motion = key.transform.environment_from_world();
        let highlights = Highlights::new(lamps, &motion);
        if key.is_captured() {
            return Some(Self {
                surface: Arc::clone(&trained.surface),
                trained: Arc::clone(trained),
                ground: None,
                highlights,
            });
        }
        if gathered.ground.is_none() {
            gathered.ground = Some(trained.ground_in(key, lamps, cancel)?);
        }
        let transport = &trained.transport;
        let most_samples = transport.resolution.ground.most_samples;
        let from = (&*key.environment, &**lamps, most_samples);
        if !gathered.run(&trained.beams, from, &key.transform, cancel) {
            return None;
        }
        let by_lamps = LampLight::new(transport, lamps.points(&motion));
        let lit = |bounce: &(dyn Fn(&Beam) -> Vec3 + Sync)| {
            let rest = irradiance(&trained.beams, &gathered.radiance, bounce);
            SurfaceLight::new(transport, rest, by_lamps.clone())
        };
        let start = quotient(gathered.mean(), trained.ray_mean);
        let mut light = lit(&|beam| beam.bounce * start);
        for _ in 0..BOUNCES {
            light = lit(&|beam| {
                beam.met.map_or(Vec3::ZERO, |(position, normal)| {
                    let [now, then] = [&light, &*trained.surface]
                        .map(|light| (light.smooth(position, normal), light.mean));
                    beam.bounce * ratio(now, then)
                })
            });
        }
        Some(Self {
            surface: Arc::new(light),
            trained: Arc::clone(trained),
            ground: gathered.ground.clone().filter(|ground| !ground.is_empty()),
            highlights,
        })
    }

    /// Present over trained irradiance at a surface point, per colour: at least 0, at most 256 times that of the means over
    /// the object, and 4096; 1 where there never was light. Light that is twice as bright gives twice the ratio.
    ///
    /// Shadows have edges where the point `is_seen` directly; elsewhere the probes have to do, for shadow rays from each
    /// of the places that many cones meet take longer than all the rest.
    pub fn ratio(&self, position: Vec3, normal: Vec3, is_seen: bool) -> Vec3 {
        if Arc::ptr_eq(&self.surface, &self.trained.surface) {
            return Vec3::ONE;
        }
        let at = |light: &SurfaceLight| {
            let value = if is_seen {
                light.irradiance(position, normal)
            } else {
                light.smooth(position, normal)
            };
            (value, light.mean)
        };
        ratio(at(&self.surface), at(&self.trained.surface))
    }
}

/// The lamps with the brightness estimated from the object's shading, where `rest` is the light of everything else.
fn brightened(lamps: &Lamps, rest: &SurfaceLight, key: &LightKey) -> Lamps {
    let parts = lamps.parts();
    let tracer = &key.object.tracer;
    let still = EnvironmentTransform::default().environment_from_world();
    let points = lamps.points_of(&parts, &still);
    let probes = Probes::on_mesh(tracer.mesh(), N_SHADED);
    let positions: Vec<Vec3> = probes.probes().iter().map(|p| p.position).collect();
    let mut batch = MaterialBatch::default();
    key.object
        .material
        .forward(&positions, &mut batch, &mut Vec::new());
    let places = probes.probes().iter().zip(&batch.surfaces);
    let places: Vec<Place> = places
        .map(|(&probe, &surface)| Place {
            probe,
            surface,
            around: rest.smooth(probe.position, probe.normal) / PI,
        })
        .collect();
    let shaded = places.par_iter().map(|place| place.shaded(tracer, &points));
    let shaded: Vec<_> = shaded.collect();
    let own = (&*key.trained_in, lamps, &points);
    let lobes = lit_lobes(&key.object, own, &places, &still);
    let constraints: Vec<_> = lobes.iter().map(|lobe| &lobe.place).collect();
    let gains = lamp_gains(&probes, &shaded, &constraints, parts.len());
    let compared: Vec<_> = lobes.iter().map(|lobe| lobe.compared(&gains)).collect();
    let mut lamps = lamps.gained(&parts, &gains);
    lamps.wide = WideCones::of(&compared);
    lamps
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
                        variance: SHARPER * cone.variance(),
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
    /// Evaluates what is missing, probe by probe, in parallel, with a number of samples a ray at most; whether that is all.
    fn run(
        &mut self,
        beams: &[Vec<Beam>],
        (environment, lamps, most_samples): (&Environment, &Lamps, usize),
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
                environment.light_by(most_samples, batch, scratch);
                if let Some(ground) = &ground {
                    ground.apply(batch);
                }
                let asking = beams.iter().filter(|beam| beam.ray.is_some());
                radiance.extend(asking.zip(&batch.radiance).map(|(beam, seen)| {
                    // What the object mirrors is no lamp that shadow rays look for.
                    match beam.met {
                        Some(_) => *seen,
                        None => lamps.below(Vec3::from(*seen)).to_array(),
                    }
                }));
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
