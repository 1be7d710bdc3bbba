//! A small scene with random fields, for tests.

use std::sync::Arc;

use glam::Vec3;

use super::scene::Scene;
use crate::geometry::{Camera, Mesh, SurfaceTracer};
use crate::neif::contraction::FieldFrame;
use crate::neif::environment::{Environment, EnvironmentPlace};
use crate::neif::hash_grid::{GridConfig, LEAST_WEIGHT};
use crate::neif::material::MaterialConfig;
use crate::neif::proposal::DensityGrid;
use crate::neif::radiance_field::{FieldConfig, RadianceField};
use crate::neif::{EnvironmentTransform, Material, MaterialEdit, ObjectModel, SurfaceField};

/// Numbers in `[0, 1)` that look random and are always the same.
fn uniform(seed: u32) -> impl FnMut() -> f32 {
    let mut state = seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    }
}

/// Random surroundings.
pub(crate) fn environment(seed: u32) -> Arc<Environment> {
    let grid = GridConfig {
        n_levels: 4,
        coarsest: 2,
        finest: 8,
        log2_table_size: 8,
        least_weight: LEAST_WEIGHT,
    };
    let mut field = RadianceField::new(
        FieldConfig {
            grid,
            n_hidden: 16,
            view_dependent: true,
            integrated: true,
            is_far: false,
        },
        uniform(seed),
    );
    let mut random = uniform(seed + 1);
    for value in &mut field.params {
        *value += 0.4 * (random() - 0.5);
    }
    let frame = FieldFrame {
        center: Vec3::ZERO,
        half_side: 2.0,
    };
    let place = EnvironmentPlace {
        name: "room".to_owned(),
        frame,
        gamma: 1.0,
        n_samples: 16,
        up: Vec3::Z,
    };
    Arc::new(Environment::new(place, field, DensityGrid::default()))
}

/// A tetrahedron about the origin with a random material.
pub(crate) fn object(seed: u32) -> Arc<ObjectModel> {
    let positions = vec![
        Vec3::new(1.0, 1.0, 1.0),
        Vec3::new(1.0, -1.0, -1.0),
        Vec3::new(-1.0, 1.0, -1.0),
        Vec3::new(-1.0, -1.0, 1.0),
    ];
    let triangles = vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];
    let normals = positions.iter().map(|p| p.normalize_or_zero()).collect();
    let mesh = Mesh::new(positions, Some(normals), triangles).expect("a sound tetrahedron");
    let grid = GridConfig {
        n_levels: 4,
        coarsest: 2,
        finest: 8,
        log2_table_size: 8,
        least_weight: LEAST_WEIGHT,
    };
    let material = Material::new(
        MaterialConfig {
            grid,
            n_hidden: 16,
            rgb_tint: true,
        },
        Vec3::ZERO,
        2.2,
        uniform(seed),
    );
    Arc::new(ObjectModel {
        tracer: Arc::new(SurfaceTracer::new(Arc::new(mesh))),
        material: Arc::new(SurfaceField::Grid(material)),
    })
}

/// The tetrahedron in random surroundings.
pub(crate) fn scene() -> Scene {
    Scene {
        object: Some(object(1)),
        environment: environment(2),
        transform: EnvironmentTransform::default(),
        edit: MaterialEdit::default(),
    }
}

/// Sees the tetrahedron and some surroundings.
pub(crate) fn camera(width: u32, height: u32) -> Camera {
    Camera::look_at(
        Vec3::new(4.0, 1.0, 1.5),
        Vec3::ZERO,
        Vec3::Z,
        0.9,
        width,
        height,
    )
}
