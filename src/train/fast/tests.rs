//! The trainer as a whole: it converges, repeats itself bit for bit, resumes exactly, and survives bad numbers.

use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::Fast;
use crate::color::{linear_from_srgb, srgb_from_linear};
use crate::data::{Dataset, Photo};
use crate::neif::field::floor::Floor;
use crate::neif::field::radiance_field::{CutOff, FieldBatch, FieldRay, RadianceField};
use crate::neif::light::environment::LightScratch;
use crate::neif::surface::material::MaterialBatch;
use crate::render::{Layer, render};
use crate::train::config::{PhotoFit, TrainConfig};
use crate::train::scene_model::SceneModel as _;
use crate::train::step::learned::Learned;
use crate::train::step::model::StepStats;
use crate::train::step::trainer::Trainer;
use crate::train::test_agreement::agreement;
use crate::train::test_scene::{FLOOR, TINT, small_fields, sphere_in_a_box, sphere_on_a_floor};

/// Weighted loss of the next step and the gradients of both fields, without taking the step.
fn loss_and_gradients(trainer: &mut Trainer<Fast>) -> (f64, Vec<f32>, Vec<f32>) {
    let (now, model) = trainer.now(0.0);
    let density = model.density.clone();
    model.prepare(&now);
    // In single precision: the differences are smaller than the steps of bf16.
    model.encode_by_level(&now, RadianceField::encode_level);
    model.run_chunks(&now);
    model.gather_gradients(&now);
    model.density = density;
    let material = model.material.as_mut().map(Learned::take_gradient);
    let field = model.field.take_gradient();
    (model.loss(now.config), field, material.unwrap_or_default())
}

fn trainer(config: &TrainConfig, dataset: &Dataset) -> Trainer<Fast> {
    Fast::trainer(config, dataset, &AtomicBool::new(false), &|_| ()).unwrap()
}

fn train(trainer: &mut Trainer<Fast>, steps: u64) -> StepStats {
    let mut last = StepStats::default();
    for step in 0..steps {
        last = trainer.step(step as f32 / steps as f32);
    }
    last
}

/// Mean over the validation views, object pixels and background pixels.
fn validation_psnr(trainer: &Trainer<Fast>, dataset: &Dataset) -> [f64; 2] {
    let scene = trainer.snapshot().scene();
    let (mut error, mut n) = ([0.0_f64; 2], [0_u32; 2]);
    for view in &dataset.val {
        let picture = render(
            &scene,
            &view.camera,
            Layer::Final,
            &AtomicBool::new(false),
            &|_| (),
        )
        .unwrap();
        for (i, shown) in picture.pixels.iter().enumerate() {
            let kind = usize::from(!view.mask.as_ref().unwrap().is_object(i));
            let truth = view.photo.srgb(i);
            error[kind] += (0..3)
                .map(|c| f64::from(shown[c] - truth[c]).powi(2))
                .sum::<f64>();
            n[kind] += 3;
        }
    }
    [0, 1].map(|kind| -10.0 * (error[kind] / f64::from(n[kind])).log10())
}

#[test]
fn what_photos_show_is_known_as_seen_and_what_none_shows_is_not() {
    let mut dataset = sphere_in_a_box(30, 48);
    dataset.train.truncate(3);
    let mut trainer = trainer(&small_fields(), &dataset);
    train(&mut trainer, 120);
    let environment = trainer.snapshot().environment;
    let share = |origin: Vec3, direction: Vec3| {
        let origin = environment.frame().field_from_world(origin).to_array();
        let direction = direction.normalize_or_zero().to_array();
        let mut batch = FieldBatch::default();
        batch
            .rays
            .push(FieldRay::of_pixel(origin, direction, 0.0, 0.01));
        environment.light(&mut batch, &mut LightScratch::default());
        environment.seen_share(&batch, 0)
    };
    for view in &dataset.train {
        let camera = &view.camera;
        let corner = camera.ray(2.0, 2.0);
        let ahead = share(corner.origin, corner.direction);
        assert!(ahead > 0.25, "{}: {ahead} in its corner", view.name);
    }
    // Away from where all three cameras look.
    let looks: Vec3 = dataset.train.iter().map(|v| v.camera.forward()).sum();
    let behind = share(dataset.train[0].camera.position(), -looks);
    assert!(behind < 0.1, "{behind} behind the cameras");
}

#[test]
fn a_glossy_sphere_in_a_box_is_learned() {
    let dataset = sphere_in_a_box(30, 48);
    let mut trainer = trainer(&small_fields(), &dataset);
    let before = validation_psnr(&trainer, &dataset);
    train(&mut trainer, 900);
    let [object, background] = validation_psnr(&trainer, &dataset);
    assert!(before[0] < 22.0, "untrained: {before:?}");
    assert!(
        object > 30.0 && background > 26.0,
        "object {object:.1} dB, background {background:.1} dB"
    );
    let material = &trainer.snapshot().object.unwrap().material;
    let mut batch = MaterialBatch::default();
    material.forward(&[Vec3::new(0.5, 0.0, 0.0)], &mut batch, &mut Vec::new());
    let tint = batch.surfaces[0].tint;
    assert!(
        (tint - TINT).abs().max_element() < 0.15,
        "tint {tint:?} against {TINT:?}"
    );
}

#[test]
fn gradients_of_a_whole_step_agree_with_finite_differences() {
    let dataset = sphere_in_a_box(8, 32);
    let mut trainer = trainer(
        &TrainConfig {
            roughness_delay: 0,
            gradient_cut_off: CutOff::default(),
            ..small_fields()
        },
        &dataset,
    );
    train(&mut trainer, 150);
    let (_, field, material) = loss_and_gradients(&mut trainer);
    // Networks and grids of both fields.
    let n_field = trainer.model.field.value.n_network_params();
    let learned = trainer.model.material.as_ref().unwrap();
    let n_material = learned.value.n_network_params();
    let groups = [
        (true, &field, 0..n_field),
        (true, &field, n_field..field.len()),
        (false, &material, 0..n_material),
        (false, &material, n_material..material.len()),
    ];
    for (in_field, gradient, range) in groups {
        let shift = |trainer: &mut Trainer<Fast>, i: usize, by: f32| {
            if in_field {
                trainer.model.field.value.params[i] += by;
            } else {
                trainer.model.material.as_mut().unwrap().value.params[i] += by;
            }
        };
        let (cosine, ratio) = agreement(gradient, range, (3, 25), 1e-3, |i, by| {
            shift(&mut trainer, i, by);
            let loss = loss_and_gradients(&mut trainer).0;
            shift(&mut trainer, i, -by);
            loss
        });
        // The mean position along a wide lobe depends on roughness too; the backward pass leaves that out, so the material's
        // gradient agrees to some 20 degrees (it depends on the state that the first steps led to), not exactly. (Paths
        // alone are checked exactly in `light_path`.)
        let (least, lengths) = if in_field {
            (0.9999, 0.99..1.01)
        } else {
            (0.9, 0.8..1.25)
        };
        assert!(
            cosine > least && lengths.contains(&ratio),
            "field {in_field}: cosine {cosine}, length ratio {ratio}"
        );
    }
}

#[test]
fn what_reflects_like_a_metal_loses_its_diffuse_part() {
    let dataset = sphere_in_a_box(8, 32);
    let diffuse = |metal_weight| {
        let mut trainer = trainer(
            &TrainConfig {
                metal_weight,
                ..small_fields()
            },
            &dataset,
        );
        train(&mut trainer, 200);
        let material = trainer.model.material.expect("there is an object").value;
        let points: Vec<Vec3> = dataset.mesh.as_ref().expect("a mesh").positions.clone();
        let mut batch = MaterialBatch::default();
        material.forward(&points, &mut batch, &mut Vec::new());
        let sum: f32 = batch.surfaces.iter().map(|s| s.diffuse.element_sum()).sum();
        sum / points.len() as f32
    };
    let (free, pulled) = (diffuse(0.0), diffuse(0.3));
    assert!(
        pulled < 0.5 * free,
        "{free} without, {pulled} with the pull"
    );
}

/// The scene with every second photo exposed `gain` times as long as the others.
fn unevenly_exposed(gain: f32) -> Dataset {
    let mut dataset = sphere_in_a_box(30, 24);
    for view in dataset.train.iter_mut().step_by(2) {
        let Photo::Ldr { pixels, .. } = &mut view.photo else {
            panic!("a photo of 16 bits");
        };
        for code in pixels.iter_mut().flatten() {
            let linear = linear_from_srgb(f32::from(*code) / 65535.0);
            *code = (65535.0 * srgb_from_linear(gain * linear)) as u16;
        }
    }
    dataset
}

#[test]
fn exposures_that_jump_from_photo_to_photo_are_found_in_part() {
    let config = TrainConfig {
        photo_exposures: PhotoFit::On,
        ..small_fields()
    };
    let mut trainer = trainer(&config, &unevenly_exposed(0.6));
    train(&mut trainer, 500);
    let gains = trainer.model.gains().unwrap();
    let mean = |from: usize| {
        let logs = gains.iter().skip(from).step_by(2).map(|g| g.y.ln());
        logs.sum::<f32>() / gains.len().div_ceil(2) as f32
    };
    let ratio = (mean(0) - mean(1)).exp();
    // The rest of it is in the view-dependent colours: no two photos are from one place.
    assert!((0.5..0.88).contains(&ratio), "{ratio}");
}

/// Photos of a sphere on a floor whose exposures differ, and say so.
fn on_a_floor() -> Dataset {
    let mut dataset = sphere_on_a_floor(60, 48, |i| Vec3::splat(1.0 + 0.3 * (i % 2) as f32));
    dataset.origin.noted_exposure_ev = Some([0.0, 0.4]);
    dataset
}

/// The floor of a trainer's field.
fn floor_of(trainer: &Trainer<Fast>) -> Option<Floor> {
    trainer.snapshot().environment.floor()
}

#[test]
fn what_stands_on_a_floor_is_lit_over_an_opaque_one() {
    let dataset = on_a_floor();
    let mut learner = trainer(&small_fields(), &dataset);
    let environment = learner.snapshot().environment;
    let down = |origin: Vec3| FieldRay::of_pixel(origin.to_array(), [0.0, 0.0, -1.0], 0.0, 0.001);
    let mut batch = FieldBatch::default();
    let above = [Vec3::new(0.3, 0.2, 0.4), Vec3::new(-0.6, 0.1, 0.2)];
    batch.rays.extend(above.map(down));
    environment.light(&mut batch, &mut LightScratch::default());
    let floor = environment
        .frame()
        .field_from_world(Vec3::new(0.0, 0.0, FLOOR))
        .z;
    let (end, opacity) = batch.end(1);
    assert!(opacity > 0.999, "{opacity}");
    assert!(end <= 0.2 - floor + 0.01, "{end}");
    train(&mut learner, 20);
    let error = |trainer: &Trainer<Fast>| validation_psnr(trainer, &dataset)[1];
    assert!(error(&learner).is_finite());

    let checkpoint = learner.checkpoint();
    let mut resumed = trainer(&small_fields(), &dataset);
    resumed.restore(&checkpoint).unwrap();
    assert_eq!(floor_of(&resumed), floor_of(&learner));
    train(&mut resumed, 5);
    train(&mut learner, 5);
    assert!(resumed.checkpoint().to_bytes() == learner.checkpoint().to_bytes());
}

#[test]
fn a_run_from_before_floors_goes_on_without_one() {
    let dataset = on_a_floor();
    let mut old = trainer(&small_fields(), &dataset);
    old.model.density.floor = None;
    old.model.photos.exposures = None;
    train(&mut old, 5);
    let mut resumed = trainer(&small_fields(), &dataset);
    assert!(floor_of(&resumed).is_some() && resumed.model.gains().is_some());
    resumed.restore(&old.checkpoint()).unwrap();
    assert!(floor_of(&resumed).is_none() && resumed.model.gains().is_none());
    train(&mut resumed, 5);
    train(&mut old, 5);
    assert!(resumed.checkpoint().to_bytes() == old.checkpoint().to_bytes());
}

#[test]
fn where_exposures_are_fair_no_floor_is_laid() {
    let mut dataset = on_a_floor();
    dataset.origin.noted_exposure_ev = None;
    assert!(
        floor_of(&trainer(&small_fields(), &dataset)).is_none(),
        "photos that are alike need none"
    );
}

#[test]
fn the_same_seed_gives_the_same_bits_on_any_number_of_threads() {
    let dataset = sphere_in_a_box(6, 24);
    let run = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let mut trainer = trainer(
                &TrainConfig {
                    seed,
                    ..small_fields()
                },
                &dataset,
            );
            train(&mut trainer, 40);
            trainer.checkpoint().to_bytes()
        })
    };
    let reference = run(1, 1);
    assert!(
        run(1, 1) == reference,
        "a repeated run must give the same bits"
    );
    assert!(
        run(3, 1) == reference,
        "three threads must give the same bits as one"
    );
    assert!(
        run(1, 2) != reference,
        "another seed must give another result"
    );
}

#[test]
fn snapshots_show_the_mean_of_the_last_steps() {
    let dataset = sphere_in_a_box(6, 24);
    let mut trainer = trainer(&small_fields(), &dataset);
    let mut last = Vec::new();
    for step in 0..1040_u32 {
        trainer.step(step as f32 / 1040.0);
        if step % 8 == 7 {
            last.push(trainer.model.field.value.params.clone());
        }
    }
    let shown = trainer.snapshot();
    let shown = shown.environment.params();
    // About 31 steps at the end: the distance to the mean of as many is less than to where the last one went.
    let mean = |i: usize| last[last.len() - 4..].iter().map(|v| v[i]).sum::<f32>() / 4.0;
    let apart = |of: &dyn Fn(usize) -> f32| -> f64 {
        let squares = (0..shown.len()).map(|i| f64::from(shown[i] - of(i)).powi(2));
        squares.sum::<f64>()
    };
    let (to_mean, to_last) = (apart(&mean), apart(&|i| last[last.len() - 1][i]));
    assert!(
        0.0 < to_mean && to_mean < 0.7 * to_last,
        "{to_mean} {to_last}"
    );
}

#[test]
fn a_resumed_run_equals_an_uninterrupted_one() {
    let dataset = sphere_in_a_box(6, 24);
    let config = TrainConfig {
        photo_exposures: PhotoFit::On,
        ..small_fields()
    };
    // Exposures are learned from step 50.
    let progress = |step: u32| step as f32 / 80.0;
    let mut whole = trainer(&config, &dataset);
    for step in 0..80 {
        whole.step(progress(step));
    }
    let mut first = trainer(&config, &dataset);
    for step in 0..57 {
        first.step(progress(step));
    }
    let mut second = trainer(&config, &dataset);
    second.restore(&first.checkpoint()).unwrap();
    for step in 57..80 {
        second.step(progress(step));
    }
    assert!(
        second.checkpoint().to_bytes() == whole.checkpoint().to_bytes(),
        "resume must be exact"
    );
}

#[test]
fn steps_with_numbers_that_are_not_finite_are_skipped_and_counted() {
    let dataset = sphere_in_a_box(6, 24);
    let mut trainer = trainer(&small_fields(), &dataset);
    train(&mut trainer, 5);
    let kept = trainer.model.field.value.params[3];
    trainer.model.field.value.params[3] = f32::NAN;
    let before = trainer.model.field.value.params[1000];
    assert!(trainer.step(0.1).skipped, "a NaN weight must be noticed");
    assert_eq!((trainer.skipped_steps(), trainer.steps()), (1, 6));
    assert_eq!(
        trainer.model.field.value.params[1000], before,
        "a skipped step learns nothing"
    );
    trainer.model.field.value.params[3] = kept;
    trainer.model.field.derive();
    assert!(!trainer.step(0.1).skipped, "training goes on");
}

#[test]
fn scenes_of_any_size_and_black_or_white_photos_stay_finite() {
    for (scale, level) in [
        (1e-3_f32, None),
        (1e4, None),
        (1.0, Some(0_u16)),
        (1.0, Some(u16::MAX)),
    ] {
        let mut dataset = sphere_in_a_box(2, 16);
        for view in dataset.train.iter_mut().chain(&mut dataset.val) {
            view.camera.world_from_camera.translation *= scale;
            if let (Photo::Ldr { pixels, .. }, Some(level)) = (&mut view.photo, level) {
                pixels.fill([level; 3]);
            }
        }
        let mesh = dataset
            .mesh
            .as_ref()
            .unwrap()
            .transformed(glam::Affine3A::from_scale(Vec3::splat(scale)));
        dataset.mesh = Some(std::sync::Arc::new(mesh));
        let mut trainer = trainer(&small_fields(), &dataset);
        let stats = train(&mut trainer, 30);
        assert!(
            stats.loss.is_finite() && trainer.skipped_steps() == 0,
            "scale {scale}, level {level:?}: {stats:?}"
        );
    }
}

#[test]
fn a_capture_without_object_trains_an_environment() {
    let mut dataset = sphere_in_a_box(6, 24);
    dataset.mesh = None;
    let mut trainer = trainer(&small_fields(), &dataset);
    let stats = train(&mut trainer, 30);
    assert!(
        stats.loss.is_finite() && trainer.snapshot().object.is_none(),
        "{stats:?}"
    );
}
