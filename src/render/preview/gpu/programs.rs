//! The passes as compute pipelines: WGSL put together for the shapes of the fields.

use std::fmt::Write as _;

use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, Buffer, ComputePipeline,
    ComputePipelineDescriptor, ShaderModuleDescriptor, ShaderSource,
};

use super::device::Gpu;
use crate::neif::field::radiance_field::FieldConfig;
use crate::neif::surface::material::MaterialConfig;
use crate::render::path::trace::{PIXEL_SIDE, PIXEL_STD};

// What a binding holds: the numbers in the WGSL files.
pub(super) const FRAME: usize = 0;
pub(super) const DENSITY_WEIGHTS: usize = 1;
pub(super) const ENVIRONMENT_GRID: usize = 2;
pub(super) const DENSITY_CELLS: usize = 3;
pub(super) const MATERIAL_WEIGHTS: usize = 4;
pub(super) const MATERIAL_GRID: usize = 5;
pub(super) const NODES: usize = 6;
pub(super) const TRIANGLES: usize = 7;
pub(super) const CENTERS: usize = 8;
pub(super) const COUNTERS: usize = 9;
pub(super) const STARTS: usize = 10;
pub(super) const RAYS: usize = 11;
pub(super) const RADIANCE: usize = 12;
pub(super) const LIT: usize = 13;
pub(super) const PIXELS: usize = 14;
pub(super) const PICTURE: usize = 15;
pub(super) const COLOR_WEIGHTS: usize = 16;
pub(super) const GROUPS: usize = 17;
/// Number of binding places.
pub(super) const N_BINDINGS: usize = 18;

/// A pass ready to run.
#[derive(Debug)]
pub(super) struct Program {
    name: &'static str,
    /// What it is bound to: all that it uses, at most eight tables beside the frame.
    bindings: &'static [usize],
    pub(super) pipeline: ComputePipeline,
}

/// All passes for fields of one shape.
#[derive(Debug)]
pub(super) struct Programs {
    pub(super) source: String,
    /// Primary rays through the pixels' centres.
    pub(super) trace_centers: Program,
    /// Coverage, where paths start, and rays into the background.
    pub(super) start_paths: Program,
    /// Sizes of the dispatches that follow.
    pub(super) count: Program,
    /// Light paths and the rays of their lobes.
    pub(super) aim: Program,
    /// Radiance along all rays.
    pub(super) light: Program,
    /// The picture.
    pub(super) compose: Program,
}

/// The source for fields of these shapes; without an object its field has one of its own.
pub(super) fn source(environment: &FieldConfig, material: Option<&MaterialConfig>) -> String {
    let (levels, grid) = (environment.grid.n_levels, environment.grid);
    let (surface_levels, surface_hidden) =
        material.map_or((4, 16), |m| (m.grid.n_levels, m.n_hidden));
    let surface_weight = material.map_or(0.0, |m| m.grid.least_weight);
    let has_rgb_tint = material.is_none_or(|m| m.rgb_tint);
    let mut text = String::new();
    let written = write!(
        text,
        "const ENVIRONMENT_LEVELS: u32 = {levels}u;\n\
         const MATERIAL_LEVELS: u32 = {surface_levels}u;\n\
         const environment_LEAST_WEIGHT: f32 = {:?};\n\
         const material_LEAST_WEIGHT: f32 = {surface_weight:?};\n\
         const PIXEL_SIDE: f32 = {PIXEL_SIDE:?};\n\
         const PIXEL_STD: f32 = {PIXEL_STD:?};\n\
         const IS_FAR: bool = {};\n\
         const IS_INTEGRATED: bool = {};\n\
         const IS_VIEW_DEPENDENT: bool = {};\n\
         const HAS_RGB_TINT: bool = {has_rgb_tint};\n",
        grid.least_weight, environment.is_far, environment.integrated, environment.view_dependent,
    );
    written.expect("a string takes any text");
    for part in [
        include_str!("frame.wgsl"),
        include_str!("bvh.wgsl"),
        include_str!("surface_hit.wgsl"),
        include_str!("trace.wgsl"),
        include_str!("gbuffer.wgsl"),
        include_str!("proposal.wgsl"),
        include_str!("radiance_field.wgsl"),
        include_str!("material.wgsl"),
        include_str!("light_path.wgsl"),
        include_str!("compose.wgsl"),
    ] {
        text.push_str(part);
    }
    for (name, place) in [
        ("environment", ENVIRONMENT_GRID),
        ("material", MATERIAL_GRID),
    ] {
        let pattern = include_str!("hash_grid.wgsl").replace("BINDING", &place.to_string());
        text.push_str(&pattern.replace("NAME", name));
    }
    let n_hidden = environment.n_hidden;
    for (name, place, inputs, hidden) in [
        ("density", DENSITY_WEIGHTS, levels, n_hidden),
        ("color", COLOR_WEIGHTS, 8, n_hidden),
        ("material", MATERIAL_WEIGHTS, surface_levels, surface_hidden),
    ] {
        let pattern = include_str!("mlp.wgsl")
            .replace("BINDING", &place.to_string())
            .replace("INPUTS", &inputs.to_string())
            .replace("HIDDEN", &hidden.to_string())
            .replace("OUTPUTS", "4");
        text.push_str(&pattern.replace("NAME", name));
    }
    text
}

impl Programs {
    /// Compiles all passes; takes up to seconds.
    pub(super) fn new(gpu: &Gpu, source: String) -> Self {
        let module = gpu.device.create_shader_module(ShaderModuleDescriptor {
            label: Some("neif preview"),
            source: ShaderSource::Wgsl(source.as_str().into()),
        });
        // The layout of its bindings is read from the source.
        let program = |name: &'static str, bindings: &'static [usize]| Program {
            name,
            bindings,
            pipeline: (gpu.device).create_compute_pipeline(&ComputePipelineDescriptor {
                label: Some(name),
                layout: None,
                module: &module,
                entry_point: Some(name),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            }),
        };
        Self {
            trace_centers: program("trace_centers", &[FRAME, NODES, TRIANGLES, CENTERS]),
            start_paths: program(
                "start_paths",
                &[
                    FRAME, NODES, TRIANGLES, CENTERS, COUNTERS, STARTS, RAYS, PIXELS,
                ],
            ),
            count: program("count", &[COUNTERS, GROUPS]),
            aim: program(
                "aim",
                &[
                    FRAME,
                    MATERIAL_WEIGHTS,
                    MATERIAL_GRID,
                    NODES,
                    TRIANGLES,
                    COUNTERS,
                    STARTS,
                    RAYS,
                    LIT,
                ],
            ),
            light: program(
                "light",
                &[
                    FRAME,
                    DENSITY_WEIGHTS,
                    ENVIRONMENT_GRID,
                    DENSITY_CELLS,
                    COLOR_WEIGHTS,
                    COUNTERS,
                    RAYS,
                    RADIANCE,
                ],
            ),
            compose: program("compose", &[FRAME, RADIANCE, LIT, PIXELS, PICTURE]),
            source,
        }
    }
}

impl Program {
    /// Binds the pass to its tables among all of them.
    pub(super) fn bind(&self, gpu: &Gpu, tables: &[&Buffer; N_BINDINGS]) -> BindGroup {
        let entries: Vec<BindGroupEntry<'_>> = (self.bindings.iter())
            .map(|&place| BindGroupEntry {
                binding: place as u32,
                resource: tables[place].as_entire_binding(),
            })
            .collect();
        gpu.device.create_bind_group(&BindGroupDescriptor {
            label: Some(self.name),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        })
    }
}
