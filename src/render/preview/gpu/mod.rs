//! The preview's path on a graphics card: G-buffer, light paths and the march through the field as WGSL compute passes.
//!
//! A picture is made in bands of rows. Of each band, the rays through the pixels' centres are traced (`trace.wgsl`),
//! paths are started where the object is seen and rays pushed where it is not (`gbuffer.wgsl`), lobes are traced and
//! their rays pushed (`light_path.wgsl`), all rays are evaluated together (`radiance_field.wgsl`), and the picture is put
//! together (`compose.wgsl`). The files carry the names of those of the processor's path, which stays the oracle.
//! Pictures are read back, four bytes a pixel: the window may use another card than the one that computes.

mod band;
mod device;
mod frame;
mod programs;
mod support;
mod tables;
#[cfg(test)]
mod tests;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use wgpu::{Buffer, BufferUsages, CommandEncoderDescriptor, MapMode, PollType};

use band::{BandSize, BandTables};
use device::Gpu;
use frame::Frame;
use programs::{COUNTERS, FRAME, PICTURE, Programs, RADIANCE, RAYS};
use tables::{EnvironmentTables, ObjectTables, table};

pub use device::GpuError;
pub use support::{NotCarried, carries};

use crate::neif::field::radiance_field::FieldRay;
use crate::neif::light::environment::EnvironmentField;
use crate::neif::{Environment, ObjectModel, SurfaceField};
use crate::render::{GpuChoice, PathOptions, PreviewScene};

/// A card that says nothing for so long is lost; software needs long for a large picture.
const PATIENCE: Duration = Duration::from_mins(2);
/// Concentration that stands for none, `NO_LOBE` in WGSL.
const NO_LOBE: f32 = 1e30;

/// Draws pictures on a graphics card; keeps what was uploaded until something else is shown.
#[derive(Debug)]
pub struct GpuRenderer {
    gpu: Gpu,
    programs: Option<Programs>,
    environment: Option<(Arc<Environment>, EnvironmentTables)>,
    object: Option<(Arc<ObjectModel>, ObjectTables)>,
    band: Option<BandTables>,
}

impl GpuRenderer {
    /// Opens the best adapter that the choice allows; takes up to seconds.
    ///
    /// # Errors
    /// When there is none, or it can do too little.
    pub fn new(choice: GpuChoice) -> Result<Self, GpuError> {
        Ok(Self {
            gpu: Gpu::open(choice)?,
            programs: None,
            environment: None,
            object: None,
            band: None,
        })
    }

    /// The adapter, as the driver calls it.
    pub fn adapter(&self) -> &str {
        &self.gpu.name
    }

    /// A picture that [`carries`] allows, `[height * width]` sRGB with alpha 255; `None` when cancelled.
    ///
    /// # Errors
    /// When the card is lost, out of memory or the scene too large for it; after that it should not be asked again.
    pub fn picture(
        &mut self,
        picture: &PreviewScene,
        options: PathOptions,
        cancel: &AtomicBool,
    ) -> Result<Option<Vec<[u8; 4]>>, GpuError> {
        let (scene, camera) = (&picture.scene, &picture.camera);
        self.take_environment(&scene.environment)?;
        self.take_object(scene.object.as_ref())?;
        self.take_programs();
        let size = BandSize::of(camera.width, camera.height, options, self.gpu.most_bytes());
        self.take_band(size)?;
        let (gpu, programs, environment, band) = self.parts();
        let object = self.object.as_ref().map(|(_, tables)| tables);
        let tables = (environment, object);
        for rows in size.bands() {
            if cancel.load(Ordering::Relaxed) {
                return Ok(None);
            }
            let frame = Frame::of_band(picture, options, tables, rows);
            gpu.queue
                .write_buffer(&band.tables[FRAME], 0, frame.bytes());
            let commands = band.encode(gpu, programs, environment, object);
            gpu.queue.submit([commands.finish()]);
            // Bands of a picture that stays are long, and something newer may come.
            if options.least > 1 {
                wait(gpu)?;
            }
        }
        let n_bytes = u64::from(camera.width) * u64::from(camera.height) * 4;
        let bytes = read_back(gpu, &band.tables[PICTURE], n_bytes)?;
        Ok(Some(bytes.as_chunks::<4>().0.to_vec()))
    }

    /// Linear radiance along rays, as [`Environment::light`] finds it.
    ///
    /// # Errors
    /// As [`Self::picture`].
    pub fn radiance(
        &mut self,
        environment: &Arc<Environment>,
        rays: &[FieldRay],
    ) -> Result<Vec<[f32; 3]>, GpuError> {
        self.take_environment(environment)?;
        self.take_object(None)?;
        self.take_programs();
        let n_rays = rays.len() as u32;
        self.take_band(BandSize::of_rays(n_rays))?;
        let (gpu, programs, environment_tables, band) = self.parts();
        let frame = Frame::of_rays(environment, &environment_tables.levels);
        let rows: Vec<[f32; 4]> = rays.iter().flat_map(ray_rows).collect();
        gpu.queue
            .write_buffer(&band.tables[FRAME], 0, frame.bytes());
        gpu.queue
            .write_buffer(&band.tables[RAYS], 0, bytemuck::cast_slice(&rows));
        let counts = [0, n_rays];
        gpu.queue
            .write_buffer(&band.tables[COUNTERS], 0, bytemuck::cast_slice(&counts));
        let commands = band.encode_rays(gpu, programs, environment_tables, n_rays);
        gpu.queue.submit([commands.finish()]);
        let bytes = read_back(gpu, &band.tables[RADIANCE], u64::from(n_rays) * 16)?;
        let rows: &[[f32; 4]] = bytemuck::cast_slice(&bytes);
        Ok(rows.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect())
    }

    fn take_environment(&mut self, environment: &Arc<Environment>) -> Result<(), GpuError> {
        let kept = self.environment.as_ref();
        if kept.is_some_and(|(kept, _)| Arc::ptr_eq(kept, environment)) {
            return Ok(());
        }
        let EnvironmentField::Grid { field, density } = environment.field() else {
            unreachable!("only grids are carried");
        };
        let tables = EnvironmentTables::new(&self.gpu, field, density)?;
        self.environment = Some((Arc::clone(environment), tables));
        Ok(())
    }

    fn take_object(&mut self, object: Option<&Arc<ObjectModel>>) -> Result<(), GpuError> {
        let kept = self.object.as_ref();
        self.object = match object {
            None => None,
            Some(object) if kept.is_some_and(|(kept, _)| Arc::ptr_eq(kept, object)) => {
                return Ok(());
            }
            Some(object) => {
                let SurfaceField::Grid(material) = &*object.material else {
                    unreachable!("only grids are carried");
                };
                let tables = ObjectTables::new(&self.gpu, &object.tracer, material)?;
                Some((Arc::clone(object), tables))
            }
        };
        Ok(())
    }

    /// Compiles the passes for the shapes of the fields unless they are.
    fn take_programs(&mut self) {
        let Some((environment, _)) = &self.environment else {
            return;
        };
        let EnvironmentField::Grid { field, .. } = environment.field() else {
            return;
        };
        let object = self.object.as_ref();
        let material = object.and_then(|(object, _)| match &*object.material {
            SurfaceField::Grid(material) => Some(&material.config),
            SurfaceField::Paper(_) => None,
        });
        let source = programs::source(&field.config, material);
        if self.programs.as_ref().is_none_or(|p| p.source != source) {
            self.programs = Some(Programs::new(&self.gpu, source));
        }
    }

    fn take_band(&mut self, size: BandSize) -> Result<(), GpuError> {
        if self.band.as_ref().is_none_or(|band| band.size != size) {
            // The old one first: both may be more than there is.
            self.band = None;
            self.band = Some(BandTables::new(&self.gpu, size)?);
        }
        self.gpu.check()
    }

    fn parts(&self) -> (&Gpu, &Programs, &EnvironmentTables, &BandTables) {
        let programs = self.programs.as_ref();
        let environment = self.environment.as_ref().map(|(_, tables)| tables);
        (
            &self.gpu,
            programs.expect("taken before"),
            environment.expect("taken before"),
            self.band.as_ref().expect("taken before"),
        )
    }
}

/// A ray as WGSL's `FieldRay`.
fn ray_rows(ray: &FieldRay) -> [[f32; 4]; 3] {
    let cone = &ray.cone;
    let [x, y, z] = cone.origin;
    let [u, v, w] = ray.direction;
    let along = glam::Vec3::from(cone.direction).length();
    let kappa = ray.kappa.min(NO_LOBE);
    [
        [x, y, z, cone.base],
        [u, v, w, cone.spread],
        [along, cone.lobe_variance, kappa, 0.0],
    ]
}

/// Waits until everything submitted is done.
fn wait(gpu: &Gpu) -> Result<(), GpuError> {
    let all = PollType::Wait {
        submission_index: None,
        timeout: Some(PATIENCE),
    };
    let done = gpu.device.poll(all);
    // A lost device says why by its callback.
    gpu.check()?;
    done.map_err(|error| gpu.lost(error))?;
    Ok(())
}

/// The first bytes of a table.
fn read_back(gpu: &Gpu, from: &Buffer, n_bytes: u64) -> Result<Vec<u8>, GpuError> {
    let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
    let staging = table(gpu, "read-back", n_bytes, usage)?;
    let mut copy = gpu
        .device
        .create_command_encoder(&CommandEncoderDescriptor::default());
    copy.copy_buffer_to_buffer(from, 0, &staging, 0, n_bytes);
    gpu.queue.submit([copy.finish()]);
    // Whether it worked shows when the bytes are asked for.
    staging.map_async(MapMode::Read, 0..n_bytes, |_| ());
    wait(gpu)?;
    let bytes = staging
        .get_mapped_range(0..n_bytes)
        .map_err(|error| gpu.lost(error))?;
    Ok(bytes.to_vec())
}
