//! The paper's trainer as a whole, with tiny networks: it learns, repeats itself bit for bit and resumes exactly.

use std::sync::atomic::AtomicBool;

use super::{Paper, PaperConfig};
use crate::neif::paper::{PaperFieldConfig, PaperMaterialConfig};
use crate::neif::surface::object::SurfaceField;
use crate::neif::{Environment, Storage};
use crate::render::{Layer, render};
use crate::train::config::TrainConfig;
use crate::train::step::learned::Learned;
use crate::train::step::model::Model as _;
use crate::train::step::trainer::Trainer;
use crate::train::test_agreement::agreement;
use crate::train::test_scene::sphere_in_a_box;

fn config() -> TrainConfig {
    TrainConfig {
        object_pixels: 16,
        background_pixels: 16,
        samples_per_ray: 12,
        render_samples: 12,
        preconvolved_levels: 2,
        network_rate: 3e-3,
        paper: Some(PaperConfig {
            field: PaperFieldConfig {
                position_levels: 5,
                direction_levels: 2,
                depth: 4,
                width: 32,
                view_width: 16,
            },
            material: PaperMaterialConfig {
                position_levels: 3,
                depth: 4,
                width: 32,
            },
            ..PaperConfig::default()
        }),
        ..TrainConfig::preset("paper").unwrap()
    }
}

fn trainer(config: &TrainConfig) -> Trainer<Paper> {
    let dataset = sphere_in_a_box(6, 24);
    Paper::trainer(config, &dataset, &AtomicBool::new(false), &|_| ()).unwrap()
}

/// Takes steps up to `until` of a plan of 300; mean loss of the last tenth.
fn train(trainer: &mut Trainer<Paper>, until: u64) -> f32 {
    let mut losses = Vec::new();
    while trainer.steps() < until {
        losses.push(trainer.step(trainer.steps() as f32 / 300.0).loss);
    }
    let tenth = &losses[losses.len() - losses.len().div_ceil(10)..];
    tenth.iter().sum::<f32>() / tenth.len() as f32
}

#[test]
fn training_lowers_the_loss() {
    let mut trainer = trainer(&config());
    let before = train(&mut trainer, 10);
    let after = train(&mut trainer, 300);
    assert!(after < 0.7 * before, "{before} fell to {after} only");
    assert_eq!(trainer.skipped_steps(), 0);
}

#[test]
fn gradients_of_a_whole_step_agree_with_finite_differences() {
    // Even sampling: the places of the second pass do not answer to the first one's weights.
    let mut trainer = trainer(&TrainConfig {
        uniform_share: 1.0,
        ..config()
    });
    train(&mut trainer, 60);
    let (_, field, material) = loss_and_gradients(&mut trainer);
    for (gradient, in_field) in [(field, true), (material, false)] {
        let all = 0..gradient.len();
        let (cosine, ratio) = agreement(&gradient, all, (4, 40), 1e-3, |i, by| {
            shift_by(&mut trainer, in_field, i, by);
            let loss = loss_and_gradients(&mut trainer).0;
            shift_by(&mut trainer, in_field, i, -by);
            loss
        });
        // The mean length of a lobe answers to roughness too, which is left out (see `PaperField::backward`).
        let (least, lengths) = if in_field {
            (0.999, 0.98..1.02)
        } else {
            (0.97, 0.8..1.25)
        };
        assert!(
            cosine > least && lengths.contains(&ratio),
            "field {in_field}: cosine {cosine}, length ratio {ratio}"
        );
    }
}

fn shift_by(trainer: &mut Trainer<Paper>, in_field: bool, i: usize, by: f32) {
    if in_field {
        trainer.model.field.value.params[i] += by;
        trainer.model.field.derive();
    } else {
        let material = trainer.model.material.as_mut().unwrap();
        material.value.params[i] += by;
        material.derive();
    }
}

/// Weighted loss of the next step and the gradients of both networks, without taking the step.
fn loss_and_gradients(trainer: &mut Trainer<Paper>) -> (f64, Vec<f32>, Vec<f32>) {
    let (now, model) = trainer.now(0.0);
    model.run(&now, &mut |_| ());
    model.gather(&now);
    let material = model.material.as_mut().map(Learned::take_gradient);
    let field = model.field.take_gradient();
    (model.loss(), field, material.unwrap_or_default())
}

#[test]
fn the_same_seed_gives_the_same_bits_on_any_number_of_threads() {
    let run = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let mut trainer = trainer(&TrainConfig { seed, ..config() });
            train(&mut trainer, 10);
            trainer.checkpoint().to_bytes()
        })
    };
    let reference = run(1, 1);
    assert!(run(3, 1) == reference, "three threads must give the same");
    assert!(run(1, 2) != reference, "another seed, another result");
}

#[test]
fn a_resumed_run_equals_an_uninterrupted_one() {
    let mut whole = trainer(&config());
    train(&mut whole, 20);
    let mut first = trainer(&config());
    train(&mut first, 7);
    let mut second = trainer(&config());
    second.restore(&first.checkpoint()).unwrap();
    train(&mut second, 20);
    assert!(
        second.checkpoint().to_bytes() == whole.checkpoint().to_bytes(),
        "resume must be exact"
    );
}

#[test]
fn a_step_with_numbers_that_are_not_finite_is_skipped() {
    let mut trainer = trainer(&config());
    train(&mut trainer, 3);
    let kept = trainer.model.field.value.params[3];
    trainer.model.field.value.params[3] = f32::NAN;
    let before = trainer.model.field.value.params[100];
    assert!(trainer.step(0.1).skipped, "a NaN weight must be noticed");
    assert_eq!(
        trainer.model.field.value.params[100], before,
        "nothing learned"
    );
    trainer.model.field.value.params[3] = kept;
    assert!(!trainer.step(0.1).skipped, "training goes on");
}

#[test]
fn stored_fields_show_the_same_picture() {
    let dataset = sphere_in_a_box(6, 24);
    let mut trainer = trainer(&config());
    train(&mut trainer, 5);
    let folder = tempfile::tempdir().unwrap();
    let (light, surface) = (folder.path().join("light"), folder.path().join("surface"));
    let mut scene = trainer.snapshot().scene();
    let shown = |scene: &crate::render::Scene| {
        let camera = &dataset.val[0].camera;
        render(
            scene,
            camera,
            Layer::Final,
            &AtomicBool::new(false),
            &|_| (),
        )
        .unwrap()
    };
    let before = shown(&scene);
    scene.environment.save(&light, Storage::F32).unwrap();
    let mut object = (**scene.object.as_ref().unwrap()).clone();
    object.material.save(&surface, Storage::F32).unwrap();
    object.material = SurfaceField::load(&surface).unwrap().into();
    scene.object = Some(object.into());
    scene.environment = Environment::load(&light).unwrap().into();
    assert_eq!(shown(&scene).pixels, before.pixels);
}

#[test]
fn a_capture_without_object_trains_an_environment() {
    let mut dataset = sphere_in_a_box(6, 24);
    dataset.mesh = None;
    let mut trainer =
        Paper::trainer(&config(), &dataset, &AtomicBool::new(false), &|_| ()).unwrap();
    let loss = train(&mut trainer, 5);
    assert!(loss.is_finite() && trainer.snapshot().object.is_none());
}
