//! The passes as compute pipelines: WGSL put together for the shapes of the fields.

use std::fmt::Write as _;

use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindGroupLayoutDescriptor,
    BindGroupLayoutEntry, BindingType, Buffer, BufferBindingType, ComputePipeline,
    ComputePipelineDescriptor, PipelineLayoutDescriptor, ShaderModule, ShaderModuleDescriptor,
    ShaderSource, ShaderStages,
};

use super::device::Gpu;
use crate::neif::field::radiance_field::FieldConfig;
use crate::neif::surface::material::MaterialConfig;

/// Number of binding places.
pub(super) const N_BINDINGS: usize = 18;

/// What a binding holds: the numbers in the WGSL files.
pub(super) mod binding {
    pub(in crate::render::preview::gpu) const FRAME: usize = 0;
    pub(in crate::render::preview::gpu) const DENSITY_WEIGHTS: usize = 1;
    pub(in crate::render::preview::gpu) const ENVIRONMENT_GRID: usize = 2;
    pub(in crate::render::preview::gpu) const DENSITY_CELLS: usize = 3;
    pub(in crate::render::preview::gpu) const MATERIAL_WEIGHTS: usize = 4;
    pub(in crate::render::preview::gpu) const MATERIAL_GRID: usize = 5;
    pub(in crate::render::preview::gpu) const NODES: usize = 6;
    pub(in crate::render::preview::gpu) const TRIANGLES: usize = 7;
    pub(in crate::render::preview::gpu) const CENTERS: usize = 8;
    pub(in crate::render::preview::gpu) const COUNTERS: usize = 9;
    pub(in crate::render::preview::gpu) const STARTS: usize = 10;
    pub(in crate::render::preview::gpu) const RAYS: usize = 11;
    pub(in crate::render::preview::gpu) const RADIANCE: usize = 12;
    pub(in crate::render::preview::gpu) const LIT: usize = 13;
    pub(in crate::render::preview::gpu) const PIXELS: usize = 14;
    pub(in crate::render::preview::gpu) const PICTURE: usize = 15;
    pub(in crate::render::preview::gpu) const COLOR_WEIGHTS: usize = 16;
    pub(in crate::render::preview::gpu) const GROUPS: usize = 17;
}
use binding::{
    CENTERS, COLOR_WEIGHTS, COUNTERS, DENSITY_CELLS, DENSITY_WEIGHTS, ENVIRONMENT_GRID, FRAME,
    GROUPS, LIT, MATERIAL_GRID, MATERIAL_WEIGHTS, NODES, PICTURE, PIXELS, RADIANCE, RAYS, STARTS,
    TRIANGLES,
};

/// A pass of a band: its entry point and what it is bound to, at most eight tables.
#[derive(Clone, Copy, Debug)]
pub(super) struct PassKind {
    pub(super) name: &'static str,
    bindings: &'static [usize],
}

/// Primary rays through the pixels' centres.
pub(super) const TRACE_CENTERS: PassKind = PassKind {
    name: "trace_centers",
    bindings: &[FRAME, NODES, TRIANGLES, CENTERS],
};
/// Coverage, where paths start, and rays into the background.
pub(super) const START_PATHS: PassKind = PassKind {
    name: "start_paths",
    bindings: &[
        FRAME, NODES, TRIANGLES, CENTERS, COUNTERS, STARTS, RAYS, PIXELS,
    ],
};
/// Sizes of the dispatches that follow.
pub(super) const COUNT: PassKind = PassKind {
    name: "count",
    bindings: &[FRAME, COUNTERS, GROUPS],
};
/// Light paths and the rays of their lobes.
pub(super) const AIM: PassKind = PassKind {
    name: "aim",
    bindings: &[
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
};
/// Radiance along all rays.
pub(super) const LIGHT: PassKind = PassKind {
    name: "light",
    bindings: &[
        FRAME,
        DENSITY_WEIGHTS,
        ENVIRONMENT_GRID,
        DENSITY_CELLS,
        COLOR_WEIGHTS,
        COUNTERS,
        RAYS,
        RADIANCE,
    ],
};
/// The picture.
pub(super) const COMPOSE: PassKind = PassKind {
    name: "compose",
    bindings: &[FRAME, RADIANCE, LIT, PIXELS, PICTURE],
};

/// A pass ready to run.
#[derive(Debug)]
pub(super) struct Program {
    kind: PassKind,
    pub(super) pipeline: ComputePipeline,
    layout: BindGroupLayout,
}

/// All passes for fields of one shape.
#[derive(Debug)]
pub(super) struct Programs {
    source: String,
    pub(super) trace_centers: Program,
    pub(super) start_paths: Program,
    pub(super) count: Program,
    pub(super) aim: Program,
    pub(super) light: Program,
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
    for (name, place, inputs, hidden, outputs) in [
        ("density", DENSITY_WEIGHTS, levels, environment.n_hidden, 4),
        ("color", COLOR_WEIGHTS, 8, environment.n_hidden, 4),
        (
            "material",
            MATERIAL_WEIGHTS,
            surface_levels,
            surface_hidden,
            4,
        ),
    ] {
        let pattern = include_str!("mlp.wgsl")
            .replace("BINDING", &place.to_string())
            .replace("INPUTS", &inputs.to_string())
            .replace("HIDDEN", &hidden.to_string())
            .replace("OUTPUTS", &outputs.to_string());
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
        let program = |kind| Program::new(gpu, &module, kind);
        Self {
            trace_centers: program(TRACE_CENTERS),
            start_paths: program(START_PATHS),
            count: program(COUNT),
            aim: program(AIM),
            light: program(LIGHT),
            compose: program(COMPOSE),
            source,
        }
    }

    /// Whether they were made of this source.
    pub(super) fn is_of(&self, source: &str) -> bool {
        self.source == source
    }
}

impl Program {
    fn new(gpu: &Gpu, module: &ShaderModule, kind: PassKind) -> Self {
        let entries: Vec<BindGroupLayoutEntry> = kind
            .bindings
            .iter()
            .map(|place| layout_entry(*place))
            .collect();
        let label = Some(kind.name);
        let device = &gpu.device;
        let layout = device.create_bind_group_layout(&BindGroupLayoutDescriptor {
            label,
            entries: &entries,
        });
        let pipeline_layout = device.create_pipeline_layout(&PipelineLayoutDescriptor {
            label,
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = device.create_compute_pipeline(&ComputePipelineDescriptor {
            label,
            layout: Some(&pipeline_layout),
            module,
            entry_point: Some(kind.name),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        Self {
            kind,
            pipeline,
            layout,
        }
    }

    /// Binds the pass to its tables among all of them.
    pub(super) fn bind(&self, gpu: &Gpu, tables: &[&Buffer; N_BINDINGS]) -> BindGroup {
        let entries: Vec<BindGroupEntry<'_>> = (self.kind.bindings.iter())
            .map(|&place| BindGroupEntry {
                binding: place as u32,
                resource: tables[place].as_entire_binding(),
            })
            .collect();
        gpu.device.create_bind_group(&BindGroupDescriptor {
            label: Some(self.kind.name),
            layout: &self.layout,
            entries: &entries,
        })
    }
}

fn layout_entry(place: usize) -> BindGroupLayoutEntry {
    let read_only = matches!(
        place,
        DENSITY_WEIGHTS
            | ENVIRONMENT_GRID
            | DENSITY_CELLS
            | MATERIAL_WEIGHTS
            | MATERIAL_GRID
            | NODES
            | TRIANGLES
            | COLOR_WEIGHTS
    );
    let ty = if place == FRAME {
        BufferBindingType::Uniform
    } else {
        BufferBindingType::Storage { read_only }
    };
    BindGroupLayoutEntry {
        binding: place as u32,
        visibility: ShaderStages::COMPUTE,
        ty: BindingType::Buffer {
            ty,
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    }
}
