//! Fields and meshes as tables on the graphics card.

use glam::Vec3;
use half::f16;
use half::slice::HalfFloatSliceExt as _;
use wgpu::{Buffer, BufferDescriptor, BufferUsages};

use super::device::{Gpu, GpuError};
use super::programs::{
    COLOR_WEIGHTS, DENSITY_CELLS, DENSITY_WEIGHTS, ENVIRONMENT_GRID, MATERIAL_GRID,
    MATERIAL_WEIGHTS, NODES, TRIANGLES,
};
use crate::geometry::SurfaceTracer;
use crate::neif::field::density_grid::DensityGrid;
use crate::neif::field::radiance_field::RadianceField;
use crate::neif::networks::hash_grid::{FEATURES, Level};
use crate::neif::networks::mlp::Mlp;
use crate::neif::surface::material::Material;

/// Cells per axis, first row, mask of the hash (0: dense), unused.
pub(super) type LevelRow = [u32; 4];

/// The field of the environment.
#[derive(Debug)]
pub(super) struct EnvironmentTables {
    pub(super) levels: Vec<LevelRow>,
    /// With their binding places.
    pub(super) tables: [(usize, Buffer); 4],
}

/// Mesh and surface field.
#[derive(Debug)]
pub(super) struct ObjectTables {
    pub(super) levels: Vec<LevelRow>,
    /// With their binding places.
    pub(super) tables: [(usize, Buffer); 4],
    pub(super) n_leaves: usize,
    /// Centre and radius of the ball that the mesh is scaled to.
    pub(super) ball: (Vec3, f32),
    pub(super) self_distance: f32,
    /// Lower corner and side of the surface field's cube.
    pub(super) cube: (Vec3, f32),
}

impl EnvironmentTables {
    pub(super) fn new(
        gpu: &Gpu,
        field: &RadianceField,
        density: &DensityGrid,
    ) -> Result<Self, GpuError> {
        let [(density_net, density_params), (color_net, color_params)] = field.networks();
        let density_rows = network_rows(&density_net, density_params);
        let color_rows = network_rows(&color_net, color_params);
        let grid = half_precision(&field.params[field.n_network_params()..]);
        let cells = density_words(density);
        let density_weights = upload(gpu, "density network", &density_rows)?;
        let color_weights = upload(gpu, "colour network", &color_rows)?;
        let grid = upload(gpu, "grid of the environment", &grid)?;
        let cells = upload(gpu, "density of the environment", &cells)?;
        Ok(Self {
            levels: level_rows(field.levels()),
            tables: [
                (DENSITY_WEIGHTS, density_weights),
                (COLOR_WEIGHTS, color_weights),
                (ENVIRONMENT_GRID, grid),
                (DENSITY_CELLS, cells),
            ],
        })
    }
}

impl ObjectTables {
    pub(super) fn new(
        gpu: &Gpu,
        tracer: &SurfaceTracer,
        material: &Material,
    ) -> Result<Self, GpuError> {
        let rows = tracer.rows();
        let (network, params) = material.network();
        let grid = half_precision(&material.params[material.n_network_params()..]);
        let weights = upload(gpu, "surface network", &network_rows(&network, params))?;
        let grid = upload(gpu, "grid of the surface", &grid)?;
        let nodes = upload(gpu, "hierarchy of the mesh", &rows.nodes)?;
        let triangles = upload(gpu, "triangles of the mesh", &rows.triangles)?;
        Ok(Self {
            levels: level_rows(material.levels()),
            tables: [
                (MATERIAL_WEIGHTS, weights),
                (MATERIAL_GRID, grid),
                (NODES, nodes),
                (TRIANGLES, triangles),
            ],
            n_leaves: rows.n_leaves,
            ball: tracer.bounding_ball(),
            self_distance: tracer.self_distance(),
            cube: (material.corner, material.side),
        })
    }
}

/// The cells, then the floor's normal and offset: a normal of 0 where there is none.
fn density_words(density: &DensityGrid) -> Vec<u16> {
    let floor = density.floor.map_or([0.0; 4], |floor| floor.numbers());
    let words: &[u16] = bytemuck::cast_slice(&floor);
    [density.cells(), words].concat()
}

/// A table that is written once.
fn upload<T: bytemuck::NoUninit>(
    gpu: &Gpu,
    what: &'static str,
    rows: &[T],
) -> Result<Buffer, GpuError> {
    let bytes: &[u8] = bytemuck::cast_slice(rows);
    let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
    let buffer = table(gpu, what, bytes.len() as u64, usage)?;
    gpu.queue.write_buffer(&buffer, 0, bytes);
    Ok(buffer)
}

/// A table of so many bytes.
pub(super) fn table(
    gpu: &Gpu,
    what: &'static str,
    n_bytes: u64,
    usage: BufferUsages,
) -> Result<Buffer, GpuError> {
    const MIB: u64 = 1 << 20;
    let most = gpu.most_bytes();
    if n_bytes > most {
        let (adapter, needs, has) = (&gpu.name, n_bytes.div_ceil(MIB), most / MIB);
        return Err(GpuError::Unusable(format!(
            "{what} takes {needs} MiB, and `{adapter}` holds {has} MiB in one piece"
        )));
    }
    Ok(gpu.device.create_buffer(&BufferDescriptor {
        label: Some(what),
        // A binding of nothing is refused.
        size: n_bytes.next_multiple_of(16).max(64),
        usage,
        mapped_at_creation: false,
    }))
}

fn level_rows(levels: &[Level]) -> Vec<LevelRow> {
    let mut first = 0;
    let mut row = |level: &Level| {
        let mask = if level.is_dense {
            0
        } else {
            level.n_entries as u32 - 1
        };
        let row = [level.resolution, first, mask, 0];
        first += level.n_entries as u32;
        row
    };
    levels.iter().map(&mut row).collect()
}

/// Grid values, [`FEATURES`] a row; training sees them with fewer bits yet.
fn half_precision(values: &[f32]) -> Vec<[u16; FEATURES]> {
    let mut halves = vec![f16::ZERO; values.len()];
    halves.convert_from_f32_slice(values);
    let (rows, _) = halves.as_chunks::<FEATURES>();
    let bits = |value: f16| value.clamp(f16::MIN, f16::MAX).to_bits();
    rows.iter().map(|row| row.map(bits)).collect()
}

/// The rows that `mlp.wgsl` reads: of each hidden unit its input weights, output weights and bias; then the output's
/// biases.
fn network_rows(net: &Mlp, params: &[f32]) -> Vec<[f32; 4]> {
    let (w1, rest) = params.split_at(net.n_in * net.n_hidden);
    let (b1, rest) = rest.split_at(net.n_hidden);
    let (w2, b2) = rest.split_at(net.n_hidden * net.n_out);
    let mut values = Vec::with_capacity(params.len() + 3 * net.n_hidden);
    for unit in 0..net.n_hidden {
        values.extend((0..net.n_in).map(|i| w1[i * net.n_hidden + unit]));
        values.extend(&w2[unit * net.n_out..(unit + 1) * net.n_out]);
        values.extend([b1[unit], 0.0, 0.0, 0.0]);
    }
    values.extend(b2);
    values.as_chunks::<4>().0.to_vec()
}
