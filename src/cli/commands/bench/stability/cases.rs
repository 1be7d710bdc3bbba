//! The absurd captures and settings of `neif bench stability`.

use std::sync::Arc;

use glam::{Affine3A, Quat, Vec3};
use neif::data::{Dataset, Photo, View};
use neif::geometry::Mesh;
use neif::train::config::TrainConfig;

/// A capture and settings to survive.
pub(super) struct Case {
    pub(super) name: &'static str,
    pub(super) change: fn(&mut Dataset, &mut TrainConfig),
    pub(super) expected: Expected,
}

/// What must become of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Expected {
    /// Everything stays finite.
    Finite,
    /// The error must be the normal one too: the scene is the same.
    SameError,
}

const fn hard(name: &'static str, change: fn(&mut Dataset, &mut TrainConfig)) -> Case {
    Case {
        name,
        change,
        expected: Expected::Finite,
    }
}

const fn same(name: &'static str, change: fn(&mut Dataset, &mut TrainConfig)) -> Case {
    Case {
        name,
        change,
        expected: Expected::SameError,
    }
}

/// What all others are compared with.
pub(super) const NORMAL: Case = hard("normal", |_, _| ());

/// All others but the long run.
pub(super) const CASES: [Case; 22] = [
    // How far two runs of the same scene are apart by chance.
    hard("another seed", |_, c| c.seed += 1),
    same("unit 1e-3", |d, _| {
        move_all(d, Affine3A::from_scale(Vec3::splat(1e-3)));
    }),
    same("unit 1e4", |d, _| {
        move_all(d, Affine3A::from_scale(Vec3::splat(1e4)));
    }),
    same("turned by 30 degrees", |d, _| {
        let axis = Vec3::ONE.normalize_or_zero();
        move_all(d, Affine3A::from_quat(Quat::from_axis_angle(axis, 0.52)));
    }),
    same("100 units away", |d, _| {
        move_all(d, Affine3A::from_translation(Vec3::new(100.0, -60.0, 30.0)));
    }),
    same("1e4 units away", |d, _| {
        move_all(d, Affine3A::from_translation(Vec3::new(1e4, 0.0, 0.0)));
    }),
    hard("learning rates x 10", |_, c| {
        c.grid_rate *= 10.0;
        c.network_rate *= 10.0;
    }),
    hard("learning rates x 100", |_, c| {
        c.grid_rate *= 100.0;
        c.network_rate *= 100.0;
    }),
    hard("one photo", |d, _| d.train.truncate(1)),
    hard("masks of two pixels", |d, _| {
        for view in &mut d.train {
            keep_two_mask_pixels(view);
        }
    }),
    hard("black photos", |d, _| paint(d, |_| [0.0; 3])),
    hard("white photos", |d, _| paint(d, |_| [1.0; 3])),
    hard("radiance 1e5", |d, _| paint(d, |v| v.map(|v| v * 1e5))),
    hard("photos that are not numbers", |d, _| {
        paint(d, |_| [f32::NAN; 3]);
    }),
    hard("contradicting photos", |d, _| {
        let cameras: Vec<_> = d.train.iter().map(|v| v.camera).collect();
        let n = cameras.len();
        for (i, view) in d.train.iter_mut().enumerate() {
            view.camera = cameras[(i * 7 + 1) % n];
        }
    }),
    hard("no mesh", |d, _| d.mesh = None),
    hard("slivers among the triangles", |d, _| {
        d.mesh = d.mesh.as_deref().and_then(with_slivers).map(Arc::new);
    }),
    hard("two samples a ray", |_, c| c.samples_per_ray = 2),
    hard("one pixel a step", |_, c| {
        c.object_pixels = 1;
        c.background_pixels = 1;
    }),
    hard("roughness free from the start", |_, c| {
        c.roughness_delay = 0;
    }),
    hard("weights a million times larger", |_, c| {
        c.background_weight *= 1e6;
        c.smoothness_weight *= 1e6;
    }),
    hard("no smoothness, no warm-up, no decay", |_, c| {
        c.smoothness_weight = 0.0;
        c.warmup_steps = 0;
        c.final_rate = 1.0;
    }),
];

/// So small that 100,000 steps take a minute or two.
pub(super) const TINY: Case = hard("long run at tiny size", |_, c| {
    (c.object_pixels, c.background_pixels) = (4, 4);
    (c.samples_per_ray, c.max_pixels, c.preconvolved_levels) = (4, 4096, 0);
    (c.field.n_hidden, c.material.n_hidden) = (16, 16);
    for (grid, finest) in [(&mut c.field.grid, 64), (&mut c.material.grid, 32)] {
        (grid.n_levels, grid.coarsest, grid.finest) = (4, 4, finest);
        grid.log2_table_size = 10;
    }
});

/// Moves, turns or scales cameras and mesh together.
fn move_all(dataset: &mut Dataset, motion: Affine3A) {
    let (_, rotation, _) = motion.to_scale_rotation_translation();
    for view in dataset.train.iter_mut().chain(&mut dataset.val) {
        let pose = view.camera.world_from_camera;
        let (_, turn, at) = pose.to_scale_rotation_translation();
        view.camera.world_from_camera =
            Affine3A::from_rotation_translation(rotation * turn, motion.transform_point3(at));
    }
    dataset.mesh = dataset
        .mesh
        .as_ref()
        .map(|mesh| Arc::new(mesh.transformed(motion)));
}

/// Changes the training photos, in linear radiance.
fn paint(dataset: &mut Dataset, color: fn([f32; 3]) -> [f32; 3]) {
    for view in &mut dataset.train {
        view.photo = Photo::Hdr {
            width: view.photo.width(),
            height: view.photo.height(),
            pixels: (0..view.photo.n_pixels())
                .map(|i| color(view.photo.linear(i)))
                .collect(),
        };
    }
}

/// Leaves two object pixels in a view's mask.
fn keep_two_mask_pixels(view: &mut View) {
    let Some(mask) = &mut view.mask else { return };
    let mut left = 2;
    for coverage in &mut mask.coverage {
        if *coverage < u8::MAX || left == 0 {
            *coverage = 0;
        } else {
            left -= 1;
        }
    }
}

/// The mesh with a needle along the first edge of each triangle, as thin as a face may be.
fn with_slivers(mesh: &Mesh) -> Option<Mesh> {
    let (mut positions, mut normals) = (mesh.positions.clone(), mesh.normals.clone());
    let mut triangles = mesh.triangles.clone();
    for [a, b, c] in &mesh.triangles {
        let [pa, pb, pc] = [a, b, c].map(|i| mesh.positions[*i as usize]);
        triangles.push([*a, *b, positions.len() as u32]);
        positions.push(pa + 0.5 * (pb - pa) + 1e-6 * (pc - pa));
        normals.push(mesh.normals[*a as usize]);
    }
    Mesh::new(positions, Some(normals), triangles).ok()
}
