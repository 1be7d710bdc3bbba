//! A small scene with random fields, for tests.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::scene::{Layer, Scene};
use super::{Picture, PreviewScene, render};
use crate::geometry::{Camera, Mesh, SurfaceTracer};
use crate::neif::field::contraction::FieldFrame;
use crate::neif::field::density_grid::DensityGrid;
use crate::neif::field::floor::Floor;
use crate::neif::field::radiance_field::{FieldConfig, RadianceField};
use crate::neif::field::seen_grid::SeenGrid;
use crate::neif::kernels::math::bf16_from_f32;
use crate::neif::light::environment::{Environment, EnvironmentField, EnvironmentPlace};
use crate::neif::networks::hash_grid::{GridConfig, LEAST_WEIGHT};
use crate::neif::surface::material::MaterialConfig;
use crate::neif::{Material, ObjectModel, SurfaceField};

const GRID: GridConfig = GridConfig {
    n_levels: 4,
    coarsest: 2,
    finest: 8,
    log2_table_size: 8,
    least_weight: LEAST_WEIGHT,
};

const FIELD: FieldConfig = FieldConfig {
    grid: GRID,
    n_hidden: 16,
    view_dependent: true,
    integrated: true,
    is_far: false,
};

/// For what is not cancelled.
pub(crate) static NEVER: AtomicBool = AtomicBool::new(false);

/// What the density cache knows of [`fog`], per field unit.
const FOG_DENSITY: f32 = 150.0;

/// Numbers in `[0, 1)` that look random and are always the same.
fn uniform(seed: u32) -> impl FnMut() -> f32 {
    let mut state = seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    }
}

/// A random environment.
pub(crate) fn environment(seed: u32) -> Arc<Environment> {
    let mut field = RadianceField::new(FIELD, uniform(seed));
    let mut random = uniform(seed + 1);
    for value in &mut field.params {
        *value += 0.4 * (random() - 0.5);
    }
    with_density(field, DensityGrid::default())
}

/// Dense fog of radiance `e^log`, which grows by `e^(slope x)` towards the directions `d` with positive `x = d.x`.
pub(crate) fn fog(log: f32, slope: f32) -> Arc<Environment> {
    // With these numbers every weight starts at 0.
    let mut field = RadianceField::new(FIELD, || 0.5);
    let n = field.n_network_params();
    // The colour network comes last: `[32][16]` weights and 16 biases, then `[16][16]` and 16.
    let color = &mut field.params[n - 33 * 16 - 17 * 16..n];
    const X_HARMONIC: usize = 16 + 3;
    color[X_HARMONIC * 16] = 1.0 / 0.488_602_5;
    let second = 33 * 16;
    color[second..second + 3].fill(slope);
    color[second + 16 * 16..second + 16 * 16 + 3].fill(log);
    // The density network's last biases come before: the first output is the log density.
    field.params[n - 33 * 16 - 17 * 16 - 16] = 5.0;
    let cells = DensityGrid::default().cells().len();
    let density = DensityGrid::from_cells(vec![bf16_from_f32(FOG_DENSITY); cells])
        .expect("as many cells as there are");
    with_density(field, density)
}

/// A floor of radiance 1 at world height `floor`, empty space above it, and fog far away.
pub(crate) fn fog_above(floor: f32) -> Arc<Environment> {
    fog_where(|x| x.z <= floor)
}

/// Radiance 1 wherever it `is_solid` (world coordinates), empty space between, and fog far away.
pub(crate) fn fog_where(is_solid: impl Fn(Vec3) -> bool) -> Arc<Environment> {
    let fog = fog(0.0, 0.0);
    changed(&fog, |density| {
        density.hollow(|x| !is_solid(fog.frame().world_from_field(x.into())));
    })
}

/// The room of [`environment`] over an opaque floor.
pub(crate) fn environment_over_a_floor(seed: u32) -> Arc<Environment> {
    let up = Vec3::new(0.36, 0.48, 0.8);
    changed(&environment(seed), |density| {
        density.floor = Some(Floor::new(-0.4 * up, up));
    })
}

/// The room of [`environment`], of which photos showed this much.
pub(crate) fn environment_seen(seed: u32, seen: Option<SeenGrid>) -> Arc<Environment> {
    changed(&environment(seed), |density| density.seen = seen)
}

/// A place with a changed density.
fn changed(place: &Environment, change: impl FnOnce(&mut DensityGrid)) -> Arc<Environment> {
    let EnvironmentField::Grid { field, density } = place.field() else {
        unreachable!("it is a grid");
    };
    let mut density = density.clone();
    change(&mut density);
    with_density(field.clone(), density)
}

fn with_density(field: RadianceField, density: DensityGrid) -> Arc<Environment> {
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
    Arc::new(Environment::new(place, field, density))
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
    object_of(mesh, seed)
}

/// A mesh within the cube from -1.1 to 1.1, with a random material.
pub(crate) fn object_of(mesh: Mesh, seed: u32) -> Arc<ObjectModel> {
    let material = Material::new(
        MaterialConfig {
            grid: GRID,
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

/// The tetrahedron in a random environment.
pub(crate) fn scene() -> Scene {
    Scene::new(Some(object(1)), environment(2))
}

/// Sees the tetrahedron and some of the environment.
pub(crate) fn camera(width: u32, height: u32) -> Camera {
    let eye = Vec3::new(4.0, 1.0, 1.5);
    Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 0.9, width, height)
}

/// The full picture of [`scene`] by [`camera`].
pub(crate) fn request(width: u32, height: u32) -> PreviewScene {
    PreviewScene {
        scene: scene(),
        camera: camera(width, height),
        layer: Layer::Final,
        highlight: None,
    }
}

/// A whole picture that nobody cancels.
pub(crate) fn picture(scene: &Scene, camera: &Camera, layer: Layer) -> Picture {
    render(scene, camera, layer, &NEVER, &|_| {}).expect("not cancelled")
}

/// Sum of the squared differences of all channels.
pub(crate) fn squared_difference(a: &Picture, b: &Picture) -> f32 {
    let pairs = a.pixels.iter().zip(&b.pixels);
    pairs
        .map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>())
        .sum()
}

/// Largest difference of a channel, of which 1 is white.
pub(crate) fn worst(shown: &[[u8; 4]], expected: &Picture) -> f32 {
    let pairs = shown.iter().zip(&expected.pixels);
    let channels = pairs.flat_map(|(a, b)| (0..3).map(|c| (f32::from(a[c]), b[c])));
    channels.fold(0.0, |worst, (a, b)| f32::max(worst, (a / 255.0 - b).abs()))
}
