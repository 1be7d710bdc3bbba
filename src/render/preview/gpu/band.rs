//! The working memory of one band of a picture on the graphics card, and its passes one after the other.

use std::ops::Range;

use wgpu::{
    BindGroup, Buffer, BufferUsages, CommandEncoder, CommandEncoderDescriptor, ComputePass,
    ComputePassDescriptor,
};

use super::device::{Gpu, GpuError};
use super::programs::{
    CENTERS, COUNTERS, FRAME, GROUPS, LIT, N_BINDINGS, PICTURE, PIXELS, Program, Programs,
    RADIANCE, RAYS, STARTS,
};
use super::tables::{EnvironmentTables, ObjectTables, table};
use crate::render::PathOptions;
use crate::render::path::trace::MAX_VERTICES;

/// Bytes of a frame's words.
const FRAME_BYTES: u64 = 1024;
/// Bytes of a point that a pixel's centre sees, of a path's start, of a ray, its radiance, a vertex, a pixel.
const CENTER_BYTES: u64 = 48;
const START_BYTES: u64 = 64;
const RAY_BYTES: u64 = 48;
const RADIANCE_BYTES: u64 = 16;
const VERTEX_BYTES: u64 = 32;
const PIXEL_BYTES: u64 = 16;
/// Threads of a group.
const GROUP: u32 = 64;
/// Most paths of a band: about 250 MiB.
const MOST_PATHS: u64 = 1 << 19;
/// Most groups along one axis of a dispatch.
const MOST_GROUPS: u32 = 65_535;

/// What a band has room for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct BandSize {
    pub(super) width: u32,
    /// Rows of a band.
    pub(super) rows: u32,
    /// Rows of the picture.
    pub(super) height: u32,
    /// Most paths of a pixel.
    paths_per_pixel: u32,
}

/// The tables that a band writes, by their binding places; those that others fill hold next to nothing.
#[derive(Debug)]
pub(super) struct BandTables {
    pub(super) size: BandSize,
    pub(super) tables: [Buffer; N_BINDINGS],
}

impl BandSize {
    /// For a picture: as many rows as tables of `most_bytes` hold.
    pub(super) fn of(width: u32, height: u32, options: PathOptions, most_bytes: u64) -> Self {
        let paths_per_pixel = options.most as u32;
        let largest = (MAX_VERTICES as u64 + 1) * RAY_BYTES;
        let most_paths = MOST_PATHS.min(most_bytes / largest);
        let paths_per_row = u64::from(paths_per_pixel) * u64::from(width.max(1));
        Self {
            width,
            height,
            rows: ((most_paths / paths_per_row).max(1) as u32).min(height.max(1)),
            paths_per_pixel,
        }
    }

    /// For so many rays without a picture.
    pub(super) fn of_rays(n_rays: u32) -> Self {
        Self {
            width: n_rays.max(1),
            rows: 1,
            height: 1,
            paths_per_pixel: 0,
        }
    }

    /// The bands of the picture.
    pub(super) fn bands(self) -> impl Iterator<Item = Range<u32>> {
        let starts = (0..self.height).step_by(self.rows as usize);
        starts.map(move |start| start..(start + self.rows).min(self.height))
    }

    fn n_pixels(self) -> u64 {
        u64::from(self.width) * u64::from(self.rows)
    }

    fn n_paths(self) -> u64 {
        self.n_pixels() * u64::from(self.paths_per_pixel)
    }

    /// A ray a vertex, and one a pixel for what is behind the object.
    fn n_rays(self) -> u64 {
        self.n_paths() * MAX_VERTICES as u64 + self.n_pixels()
    }
}

impl BandTables {
    pub(super) fn new(gpu: &Gpu, size: BandSize) -> Result<Self, GpuError> {
        let storage = BufferUsages::STORAGE;
        let (to, from) = (BufferUsages::COPY_DST, BufferUsages::COPY_SRC);
        let n_centers = u64::from(size.width) * u64::from(size.rows + 2);
        let n_picture = u64::from(size.width) * u64::from(size.height);
        let (n_paths, n_rays) = (size.n_paths(), size.n_rays());
        let n_vertices = n_paths * MAX_VERTICES as u64;
        let nothing = table(gpu, "nothing", 64, storage)?;
        let mut tables = [(); N_BINDINGS].map(|()| nothing.clone());
        for (place, what, n_bytes, usage) in [
            (FRAME, "frame", FRAME_BYTES, BufferUsages::UNIFORM | to),
            (COUNTERS, "counters", 8, storage | to),
            (RAYS, "rays", n_rays * RAY_BYTES, storage | to),
            (
                RADIANCE,
                "radiance",
                n_rays * RADIANCE_BYTES,
                storage | from,
            ),
            (PICTURE, "picture", n_picture * 4, storage | from),
            (CENTERS, "centres", n_centers * CENTER_BYTES, storage),
            (STARTS, "starts of paths", n_paths * START_BYTES, storage),
            (LIT, "vertices", n_vertices * VERTEX_BYTES, storage),
            (PIXELS, "pixels", size.n_pixels() * PIXEL_BYTES, storage),
            (GROUPS, "groups", 24, storage | BufferUsages::INDIRECT),
        ] {
            tables[place] = table(gpu, what, n_bytes, usage)?;
        }
        Ok(Self { size, tables })
    }

    fn all<'a>(
        &'a self,
        environment: &'a EnvironmentTables,
        object: Option<&'a ObjectTables>,
    ) -> [&'a Buffer; N_BINDINGS] {
        let mut all = self.tables.each_ref();
        let of_object = object.into_iter().flat_map(|object| &object.tables);
        for (place, table) in environment.tables.iter().chain(of_object) {
            all[*place] = table;
        }
        all
    }

    /// The commands of one band, whose frame is written before they are submitted.
    pub(super) fn encode(
        &self,
        gpu: &Gpu,
        programs: &Programs,
        environment: &EnvironmentTables,
        object: Option<&ObjectTables>,
    ) -> CommandEncoder {
        let tables = self.all(environment, object);
        let mut encoder = encoder(gpu, "band");
        encoder.clear_buffer(&self.tables[COUNTERS], 0, None);
        let size = self.size;
        let n_pixels = size.width * size.rows;
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
        let mut run = |program: &Program, groups: Groups<'_>| {
            groups.run(&mut pass, program, &program.bind(gpu, &tables));
        };
        let wanted = &self.tables[GROUPS];
        let (paths, rays) = (Groups::From(wanted, 0), Groups::From(wanted, 12));
        let n_centers = n_pixels + 2 * size.width;
        run(&programs.trace_centers, Groups::For(n_centers));
        run(&programs.start_paths, Groups::For(n_pixels));
        run(&programs.count, Groups::For(1));
        if object.is_some() {
            run(&programs.aim, paths);
            run(&programs.count, Groups::For(1));
        }
        run(&programs.light, rays);
        run(&programs.compose, Groups::For(n_pixels));
        drop(pass);
        encoder
    }

    /// The commands that evaluate `n_rays` given ones.
    pub(super) fn encode_rays(
        &self,
        gpu: &Gpu,
        programs: &Programs,
        environment: &EnvironmentTables,
        n_rays: u32,
    ) -> CommandEncoder {
        let tables = self.all(environment, None);
        let mut encoder = encoder(gpu, "rays");
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
        let light = &programs.light;
        Groups::For(n_rays).run(&mut pass, light, &light.bind(gpu, &tables));
        drop(pass);
        encoder
    }
}

/// How many groups of threads a pass has.
#[derive(Clone, Copy)]
enum Groups<'a> {
    /// Enough for so many threads.
    For(u32),
    /// What the card counted, at a place of a table.
    From(&'a Buffer, u64),
}

impl Groups<'_> {
    fn run(self, pass: &mut ComputePass<'_>, program: &Program, tables: &BindGroup) {
        pass.set_pipeline(&program.pipeline);
        pass.set_bind_group(0, tables, &[]);
        match self {
            Self::For(n) => {
                let (x, y) = groups_for(n);
                pass.dispatch_workgroups(x, y, 1);
            }
            Self::From(buffer, offset) => pass.dispatch_workgroups_indirect(buffer, offset),
        }
    }
}

fn groups_for(n_threads: u32) -> (u32, u32) {
    let n = n_threads.div_ceil(GROUP).max(1);
    let x = n.min(MOST_GROUPS);
    (x, n.div_ceil(x))
}

fn encoder(gpu: &Gpu, label: &'static str) -> CommandEncoder {
    gpu.device
        .create_command_encoder(&CommandEncoderDescriptor { label: Some(label) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_cover_the_picture_and_fit_the_tables() {
        for (width, height) in [(1280, 800), (3840, 2160), (7, 3), (1, 1)] {
            for options in [PathOptions::PLAIN, PathOptions::FINE] {
                let most_bytes = 128 << 20;
                let size = BandSize::of(width, height, options, most_bytes);
                assert!(size.n_rays() * RAY_BYTES <= most_bytes, "{size:?}");
                let bands: Vec<_> = size.bands().collect();
                assert_eq!((bands[0].start, bands[bands.len() - 1].end), (0, height));
                assert!(bands.windows(2).all(|pair| pair[0].end == pair[1].start));
            }
        }
    }

    #[test]
    fn a_large_dispatch_takes_two_axes() {
        assert_eq!(groups_for(1), (1, 1));
        let (x, y) = groups_for(u32::MAX);
        assert!(x <= MOST_GROUPS && u64::from(x) * u64::from(y) * 64 >= u64::from(u32::MAX));
    }
}
