//! The baselines as a whole, small: they learn, their gradients are right, and they repeat themselves bit for bit.

use std::sync::atomic::AtomicBool;

use super::{Neilf, NeilfConfig};
use crate::neif::neilf::Brdf;
use crate::train::config::TrainConfig;
use crate::train::measure::eval::evaluate_object;
use crate::train::step::model::Model as _;
use crate::train::step::trainer::Trainer;
use crate::train::test_agreement::agreement;
use crate::train::test_scene::sphere_in_a_box;

const BOTH: [Brdf; 2] = [Brdf::Disney, Brdf::Lobe];

fn config(brdf: Brdf) -> NeilfConfig {
    let mut config = NeilfConfig {
        pixels: 32,
        directions: 48,
        render_directions: 64,
        ..NeilfConfig::new(brdf)
    };
    config.light.width = 32;
    for grid in [&mut config.light.directions, &mut config.light.positions] {
        grid.n_levels = 4;
        grid.finest = 16;
        grid.log2_table_size = 10;
    }
    config
}

fn trainer(config: &NeilfConfig, seed: u64) -> Trainer<Neilf> {
    let dataset = sphere_in_a_box(10, 32);
    let common = TrainConfig {
        seed,
        ..TrainConfig::default()
    };
    Neilf::trainer(&common, config, &dataset, &AtomicBool::new(false)).unwrap()
}

/// Takes `n` steps of a plan of that length.
fn train(trainer: &mut Trainer<Neilf>, n: u64) {
    for step in 0..n {
        trainer.step(step as f32 / n as f32);
    }
}

#[test]
fn training_explains_unseen_views_of_the_object() {
    for brdf in BOTH {
        let mut trainer = trainer(&config(brdf), 0);
        train(&mut trainer, 300);
        let views = sphere_in_a_box(10, 32).val;
        let results = evaluate_object(&trainer.trained(), &views, &AtomicBool::new(false)).unwrap();
        for (view, metrics) in views.iter().zip(results) {
            let psnr = metrics.psnr_object.unwrap();
            assert!(psnr > 17.0, "{brdf:?}, {}: {psnr} dB", view.name);
            assert_eq!(
                (metrics.psnr, metrics.psnr_background, metrics.ssim),
                (None, None, None),
                "no figure for what the model does not explain"
            );
        }
    }
}

#[test]
fn gradients_agree_with_finite_differences() {
    for brdf in BOTH {
        let mut trainer = trainer(&config(brdf), 1);
        train(&mut trainer, 60);
        let (_, gradients) = loss_and_gradients(&mut trainer);
        for (in_light, gradient) in [true, false].into_iter().zip(gradients) {
            let all = 0..gradient.len();
            let (cosine, ratio) = agreement(&gradient, all, (4, 40), 5e-4, |i, by| {
                shift(&mut trainer, in_light, i, by);
                let loss = loss_and_gradients(&mut trainer).0;
                shift(&mut trainer, in_light, i, -by);
                loss
            });
            // Directions enter and leave a lobe at a thousandth of its weight, which no gradient knows of.
            assert!(
                cosine > 0.995 && (0.97..1.03).contains(&ratio),
                "{brdf:?}, light {in_light}: cosine {cosine}, length ratio {ratio}"
            );
        }
    }
}

fn shift(trainer: &mut Trainer<Neilf>, in_light: bool, i: usize, by: f32) {
    if in_light {
        trainer.model.light.value.params[i] += by;
        trainer.model.light.derive();
    } else {
        trainer.model.material.value.params[i] += by;
        trainer.model.material.derive();
    }
}

/// Weighted loss of the next step and the gradients of light and material, without taking the step.
fn loss_and_gradients(trainer: &mut Trainer<Neilf>) -> (f64, [Vec<f32>; 2]) {
    let (now, model) = trainer.now(0.0);
    model.run(&now, &mut |_| ());
    model.gather(&now);
    let gradients = [model.light.take_gradient(), model.material.take_gradient()];
    (model.loss(), gradients)
}

#[test]
fn the_same_seed_gives_the_same_bits_on_any_number_of_threads() {
    for brdf in BOTH {
        let run = |threads: usize, seed: u64| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.unwrap().install(|| {
                let mut trainer = trainer(&config(brdf), seed);
                train(&mut trainer, 10);
                let model = trainer.trained();
                (
                    model.light.params,
                    model.material.params,
                    model.display.gamma,
                )
            })
        };
        let reference = run(1, 1);
        assert!(run(3, 1) == reference, "three threads must give the same");
        assert!(run(1, 2) != reference, "another seed, another result");
    }
}

#[test]
fn a_step_with_numbers_that_are_not_finite_is_skipped() {
    let mut trainer = trainer(&config(Brdf::Lobe), 0);
    train(&mut trainer, 3);
    let kept = std::mem::replace(&mut trainer.model.light.value.params[3], f32::NAN);
    let before = trainer.model.light.value.params[100];
    assert!(trainer.step(0.1).skipped, "a NaN weight must be noticed");
    assert_eq!(
        trainer.model.light.value.params[100], before,
        "nothing learned"
    );
    trainer.model.light.value.params[3] = kept;
    assert!(!trainer.step(0.1).skipped, "training goes on");
    assert_eq!(trainer.skipped_steps(), 1);
}

#[test]
fn a_capture_without_object_is_refused() {
    let mut dataset = sphere_in_a_box(5, 16);
    dataset.mesh = None;
    let neilf = config(Brdf::Disney);
    let common = TrainConfig::default();
    assert!(Neilf::trainer(&common, &neilf, &dataset, &AtomicBool::new(false)).is_err());
}
