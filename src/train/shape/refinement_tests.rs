//! Bent normals are straightened by what the sphere mirrors, repeatably, and survive a checkpoint.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::refinement::stored_box;
use crate::data::Dataset;
use crate::geometry::Mesh;
use crate::train::config::{Normals, TrainConfig};
use crate::train::fast::Fast;
use crate::train::step::trainer::Trainer;
use crate::train::test_scene::{retrace, small_fields, sphere_in_a_box};

/// The sphere with ripples in its normals.
fn bent_sphere(n_views: usize, size: u32) -> Dataset {
    let mut dataset = sphere_in_a_box(n_views, size);
    let sphere = dataset.mesh.as_deref().unwrap();
    let normals = sphere.positions.iter().map(|p| {
        let ripple = Vec3::new((9.0 * p.y).sin(), (9.0 * p.z).sin(), (9.0 * p.x).sin());
        (p.normalize_or_zero() + 0.06 * ripple).normalize_or_zero()
    });
    let mesh = Mesh {
        normals: normals.collect(),
        ..sphere.clone()
    };
    dataset.mesh = Some(Arc::new(mesh));
    dataset
}

fn trainer(normals: Normals, dataset: &Dataset) -> Trainer<Fast> {
    let config = TrainConfig {
        normals,
        ..small_fields()
    };
    Fast::trainer(&config, dataset, &AtomicBool::new(false), &|_| ()).unwrap()
}

fn train(trainer: &mut Trainer<Fast>, steps: std::ops::Range<u32>, end: u32) {
    for step in steps {
        assert!(
            !trainer.step(step as f32 / end as f32).skipped,
            "step {step}"
        );
    }
}

fn mesh(trainer: &mut Trainer<Fast>) -> Arc<Mesh> {
    trainer.settle_normals();
    let object = trainer.snapshot().object.unwrap();
    Arc::clone(object.tracer.mesh())
}

/// Root mean square angle to the sphere's true normals, degrees.
fn error_deg(mesh: &Mesh) -> f32 {
    let vertices = mesh.positions.iter().zip(&mesh.normals);
    let squares = vertices.map(|(p, n)| p.normalize_or_zero().angle_between(*n).powi(2));
    let mean = squares.sum::<f32>() / mesh.normals.len() as f32;
    mean.sqrt().to_degrees()
}

#[test]
fn bent_normals_are_straightened_by_what_they_mirror() {
    let dataset = bent_sphere(30, 48);
    let before = error_deg(dataset.mesh.as_deref().unwrap());
    let mut refined = trainer(Normals::Refined, &dataset);
    train(&mut refined, 0..250, 750);
    retrace(&mut refined, &dataset);
    train(&mut refined, 250..750, 750);
    let after = error_deg(&mesh(&mut refined));
    assert!(
        after < 0.5 * before,
        "{before:.2} degrees became {after:.2}"
    );
    let mut given = trainer(Normals::Given, &dataset);
    train(&mut given, 0..120, 750);
    assert_eq!(error_deg(&mesh(&mut given)), before, "a given mesh stays");
}

#[test]
fn pixels_traced_anew_are_those_that_a_new_trainer_would_have() {
    for has_masks in [true, false] {
        let mut dataset = bent_sphere(4, 24);
        if !has_masks {
            dataset.train.iter_mut().for_each(|view| view.mask = None);
        }
        let mut refined = trainer(Normals::Refined, &dataset);
        let pixels = |trainer: &Trainer<Fast>| trainer.model.pixels.drawn_from();
        let before = pixels(&refined);
        train(&mut refined, 0..130, 200);
        retrace(&mut refined, &dataset);
        assert!(pixels(&refined) != before, "normals have changed");
        dataset.mesh = Some(mesh(&mut refined));
        let new = trainer(Normals::Refined, &dataset);
        assert!(pixels(&refined) == pixels(&new), "masks: {has_masks}");

        let cancelled = AtomicBool::new(true);
        refined.retrace(&dataset, &cancelled, &|_| ()).unwrap_err();
        assert!(pixels(&refined) == pixels(&new), "as before when cancelled");
    }
}

#[test]
fn refinement_gives_the_same_bits_on_any_number_of_threads() {
    let dataset = bent_sphere(6, 24);
    let run = |n_threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads);
        pool.build().unwrap().install(|| {
            let mut trainer = trainer(Normals::Refined, &dataset);
            train(&mut trainer, 0..130, 200);
            retrace(&mut trainer, &dataset);
            train(&mut trainer, 130..150, 200);
            (
                mesh(&mut trainer).normals.clone(),
                trainer.checkpoint().to_bytes(),
            )
        })
    };
    assert!(run(1) == run(3), "three threads must give the same bits");
}

#[test]
fn what_was_learned_of_the_normals_survives_a_checkpoint() {
    let mut dataset = bent_sphere(6, 24);
    let given = Arc::clone(dataset.mesh.as_ref().unwrap());
    let mut first = trainer(Normals::Refined, &dataset);
    train(&mut first, 0..150, 200);
    let saved = mesh(&mut first);
    assert!(distance(&saved, &given) > 1e-3, "something is learned");
    dataset.mesh = Some(Arc::clone(&saved));
    let mut second = trainer(Normals::Refined, &dataset);
    second.restore(&first.checkpoint()).unwrap();
    let nothing = distance(&mesh(&mut second), &saved);
    assert!(nothing < 1e-6, "nothing is added twice: {nothing}");
    train(&mut second, 150..170, 200);
    let moved = distance(&mesh(&mut second), &saved);
    assert!(
        (1e-5..0.05).contains(&moved),
        "it goes on from there: {moved}"
    );
    let mut without = trainer(Normals::Given, &dataset);
    without.restore(&first.checkpoint()).unwrap();
    let refused = second.restore(&without.checkpoint());
    assert!(refused.is_err(), "a checkpoint without corrections");
}

fn move_and_retrace(trainer: &mut Trainer<Fast>, dataset: &Dataset) {
    trainer
        .move_surface(dataset, &AtomicBool::new(false))
        .unwrap();
    retrace(trainer, dataset);
}

/// The bent sphere as a mesh made of masks would be.
fn made_sphere(n_views: usize, size: u32) -> Dataset {
    Dataset {
        mesh_path: None,
        ..bent_sphere(n_views, size)
    }
}

#[test]
fn a_mesh_of_outlines_moves_and_a_run_goes_on_with_the_moved_one() {
    let dataset = made_sphere(10, 48);
    let given = Arc::clone(dataset.mesh.as_ref().unwrap());
    let mut first = trainer(Normals::Auto, &dataset);
    train(&mut first, 0..150, 300);
    let cancelled = AtomicBool::new(true);
    first.move_surface(&dataset, &cancelled).unwrap_err();
    assert_eq!(mesh(&mut first).positions, given.positions);
    move_and_retrace(&mut first, &dataset);
    let moved = mesh(&mut first);
    assert!(moved.positions != given.positions, "it is another mesh");
    // Its vertices are on the sphere, whose radius is a half, up to a share of a pixel: 0.02.
    let off = moved.positions.iter().map(|p| (p.length() - 0.5).abs());
    let off = off.sum::<f32>() / moved.positions.len() as f32;
    assert!(off < 0.008, "{off} units off");

    train(&mut first, 150..170, 300);
    let checkpoint = first.checkpoint();
    let saved = Dataset {
        mesh: Some(mesh(&mut first)),
        first_box: stored_box(&checkpoint),
        ..made_sphere(10, 48)
    };
    assert_eq!(saved.object_box(), Some(given.bounds()));
    let mut second = trainer(Normals::Auto, &saved);
    second.restore(&checkpoint).unwrap();
    assert_eq!(
        second.model.place.frame, first.model.place.frame,
        "in the same environment"
    );
    assert!(
        second.checkpoint().to_bytes() == checkpoint.to_bytes(),
        "with all that was known"
    );
    // What was learned since the paths were traced is in the saved mesh's normals.
    for trainer in [&mut first, &mut second] {
        train(trainer, 170..180, 300);
    }
    let [a, b] = [mesh(&mut first), mesh(&mut second)];
    assert_eq!(a.positions, b.positions);
    assert!(distance(&a, &b) < 0.02, "{}", distance(&a, &b));
}

#[test]
fn a_mesh_that_was_given_never_moves() {
    let dataset = bent_sphere(10, 32);
    let mut given = trainer(Normals::Refined, &dataset);
    train(&mut given, 0..130, 200);
    move_and_retrace(&mut given, &dataset);
    let before = &dataset.mesh.as_ref().unwrap().positions;
    assert_eq!(&mesh(&mut given).positions, before);
}

/// Largest difference of two meshes' normals.
fn distance(a: &Mesh, b: &Mesh) -> f32 {
    let pairs = a.normals.iter().zip(&b.normals);
    pairs.map(|(a, b)| a.distance(*b)).fold(0.0, f32::max)
}
