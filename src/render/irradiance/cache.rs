//! Diffuse lights on demand, with all that the next one can reuse: probes of the same mesh, light of the same model.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::key::{KeyedLight, LightKey};
use super::light::{DiffuseLight, Gathered, TrainedLight, TrainedWork};
use super::transport::{Resolution, Transport};
use crate::geometry::SurfaceTracer;
use crate::neif::Environment;
use crate::neif::light::estimated_lamps::EstimatedLamps;
use crate::render::lamps::Lamps;
use crate::render::{Layer, Scene};

/// Lamps that were looked for last: of the trained environment of an object, and of another one.
#[derive(Debug, Default)]
struct KnownLamps {
    own: Option<(Arc<SurfaceTracer>, Arc<Lamps>)>,
    other: Option<(Arc<Environment>, Arc<Lamps>)>,
}

impl KnownLamps {
    /// Lamps of the trained environment as an earlier model of the same object had them: a model that is still trained
    /// changes every second, its lamps hardly.
    fn own(&self, key: &LightKey) -> Option<Arc<Lamps>> {
        let (tracer, lamps) = self.own.as_ref()?;
        Arc::ptr_eq(tracer, &key.object.tracer).then(|| Arc::clone(lamps))
    }

    /// Lamps of the environment of `key`; `None` when cancelled.
    fn of(
        &mut self,
        key: &LightKey,
        trained: &TrainedLight,
        cancel: &AtomicBool,
    ) -> Option<Arc<Lamps>> {
        if Arc::ptr_eq(&key.trained_in, &key.environment) {
            return Some(Arc::clone(&trained.lamps));
        }
        if let Some((environment, lamps)) = &self.other
            && Arc::ptr_eq(environment, &key.environment)
        {
            return Some(Arc::clone(lamps));
        }
        let lamps = Arc::new(Lamps::of(&key.environment, cancel)?);
        self.other = Some((Arc::clone(&key.environment), Arc::clone(&lamps)));
        Some(lamps)
    }
}

/// Makes diffuse lights, coarse or fine; keeps the last of each, and what an interrupted one had done.
#[derive(Debug)]
pub struct DiffuseLights {
    lamps: KnownLamps,
    coarse: Level,
    fine: Level,
}

impl Default for DiffuseLights {
    fn default() -> Self {
        Self {
            lamps: KnownLamps::default(),
            coarse: Level::new(Resolution::COARSE),
            fine: Level::new(Resolution::FINE),
        }
    }
}

impl DiffuseLights {
    /// The scene with the fine light that `layers` need; `None` when cancelled, to be taken up again with the same scene.
    pub fn fine(&mut self, scene: &Scene, layers: &[Layer], cancel: &AtomicBool) -> Option<Scene> {
        let level = (&mut self.fine, &mut self.lamps);
        lit(level, (scene, layers), cancel)
    }

    /// The scene with its fine light where that is known, else with the coarse one, which is quick.
    pub fn quick(&mut self, scene: &Scene, layer: Layer) -> Scene {
        let key = LightKey::of(scene, shows_light(&[layer]));
        let is_known = |light: &KeyedLight| {
            key.as_ref()
                .is_some_and(|key| light.is_for(key, Resolution::FINE))
        };
        let level = if self.fine.light.as_ref().is_some_and(is_known) {
            &mut self.fine
        } else {
            &mut self.coarse
        };
        let level = (level, &mut self.lamps);
        let scene_lit = lit(level, (scene, &[layer]), &AtomicBool::new(false));
        scene_lit.unwrap_or_else(|| scene.clone())
    }

    /// Makes what every coarse light of the scene's object takes from the one that it was trained in, which is longer than a
    /// hand waits for the first change; to be taken up again where cancelled.
    pub fn prepare(&mut self, scene: &Scene, cancel: &AtomicBool) {
        if let Some(key) = LightKey::trained(scene) {
            self.coarse.trained(&key, &mut self.lamps, cancel);
        }
    }
}

/// Whether one of the layers shows the light at the surface even where it is the trained one.
pub(crate) fn shows_light(layers: &[Layer]) -> bool {
    let is_light = |layer: &Layer| matches!(layer, Layer::Albedo | Layer::Irradiance);
    layers.iter().any(is_light)
}

fn lit(
    (level, lamps): (&mut Level, &mut KnownLamps),
    (scene, layers): (&Scene, &[Layer]),
    cancel: &AtomicBool,
) -> Option<Scene> {
    let diffuse_light = match LightKey::of(scene, shows_light(layers)) {
        Some(key) => Some(level.light(&key, lamps, cancel)?),
        None => None,
    };
    let ground = diffuse_light.as_ref();
    let ground = ground.and_then(|lit: &KeyedLight| lit.light.ground.clone());
    Some(Scene {
        ground,
        diffuse_light,
        ..scene.clone().marked_for(layers)
    })
}

/// One resolution.
#[derive(Debug)]
struct Level {
    resolution: Resolution,
    transport: Option<Arc<Transport>>,
    work: Option<(LightKey, TrainedWork)>,
    trained: Option<(LightKey, Arc<TrainedLight>)>,
    gathered: Option<(LightKey, Gathered)>,
    light: Option<KeyedLight>,
}

impl Level {
    fn new(resolution: Resolution) -> Self {
        Self {
            resolution,
            transport: None,
            work: None,
            trained: None,
            gathered: None,
            light: None,
        }
    }

    fn light(
        &mut self,
        key: &LightKey,
        lamps: &mut KnownLamps,
        cancel: &AtomicBool,
    ) -> Option<KeyedLight> {
        if let Some(light) = &self.light
            && light.is_for(key, self.resolution)
        {
            return Some(light.clone());
        }
        let trained = self.trained(key, lamps, cancel)?;
        let environment_lamps = lamps.of(key, &trained, cancel)?;
        let mut gathered = match self.gathered.take() {
            Some((old, gathered)) if old.is_same(key) => gathered,
            _ => Gathered::default(),
        };
        let Some(light) =
            DiffuseLight::gather(&trained, (key, &environment_lamps), &mut gathered, cancel)
        else {
            self.gathered = Some((key.clone(), gathered));
            return None;
        };
        let light = KeyedLight {
            key: key.clone(),
            resolution: self.resolution,
            light: Arc::new(light),
        };
        self.light = Some(light.clone());
        Some(light)
    }

    fn trained(
        &mut self,
        key: &LightKey,
        lamps: &mut KnownLamps,
        cancel: &AtomicBool,
    ) -> Option<Arc<TrainedLight>> {
        if let Some((old, trained)) = &self.trained
            && old.is_same_model(key)
        {
            return Some(Arc::clone(trained));
        }
        let mut work = match self.work.take() {
            Some((old, work)) if old.is_same_model(key) => work,
            _ => TrainedWork::new(
                self.transport(&key.object.tracer, cancel)?,
                &key.object.material,
            ),
        };
        let known = lamps
            .own(key)
            .filter(|_| self.resolution == Resolution::COARSE);
        let Some(trained) = work.run(key, known, cancel) else {
            self.work = Some((key.clone(), work));
            return None;
        };
        let trained = Arc::new(trained);
        lamps.own = Some((Arc::clone(&key.object.tracer), Arc::clone(&trained.lamps)));
        self.trained = Some((key.clone(), Arc::clone(&trained)));
        Some(trained)
    }

    fn transport(
        &mut self,
        tracer: &Arc<SurfaceTracer>,
        cancel: &AtomicBool,
    ) -> Option<Arc<Transport>> {
        if let Some(transport) = &self.transport
            && Arc::ptr_eq(&transport.tracer, tracer)
        {
            return Some(Arc::clone(transport));
        }
        let transport = Transport::trace(tracer, self.resolution, cancel)?;
        Some(Arc::clone(self.transport.insert(Arc::new(transport))))
    }
}

/// The light that the object of a scene was trained in, e.g. for its albedo; `None` without an object, where the diffuse
/// part is baked, or when cancelled.
pub fn trained_light(scene: &Scene, cancel: &AtomicBool) -> Option<Arc<TrainedLight>> {
    let key = LightKey::trained(scene)?;
    Level::new(Resolution::FINE).trained(&key, &mut KnownLamps::default(), cancel)
}

/// How bright the lamps of the environment are that the object of a scene was trained in, from its shading and reflections;
/// `None` without an object, without lamps (which is quick), where the diffuse part is baked, or when cancelled.
pub fn estimated_lamps(scene: &Scene, cancel: &AtomicBool) -> Option<EstimatedLamps> {
    let key = LightKey::trained(scene)?;
    let learned = Lamps::learned(&key.trained_in, cancel)?;
    if learned.are_none() {
        return None;
    }
    let transport = Transport::trace(&key.object.tracer, Resolution::FINE, cancel)?;
    let mut work = TrainedWork::new(Arc::new(transport), &key.object.material);
    let rest = work.rest(&key, &learned, cancel)?;
    work.brightened(&learned, &rest, &key).estimated()
}
