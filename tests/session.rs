//! The training session as the window drives it: pause, single steps, saving, training further.

#[path = "cli/capture.rs"]
mod capture;

use std::{path::Path, time::Duration};

use neif::train::TrainConfig;
use neif::train::config::{Normals, PhotoFit};
use neif::train::session::events::{FinishReason, TrainCommand, TrainEvent};
use neif::train::session::handle::Session;
use neif::train::session::options::SessionOptions;
use neif::train::session::plan::Budget;
use neif::train::session::saved::run_folder::RunFolder;

/// Longer than anything here takes, even on a busy machine.
const PATIENCE: Duration = Duration::from_mins(1);

fn tiny_config() -> TrainConfig {
    let mut config = TrainConfig {
        threads: 1,
        object_pixels: 32,
        background_pixels: 32,
        samples_per_ray: 8,
        render_samples: 8,
        ..TrainConfig::default()
    };
    config.field.n_hidden = 16;
    config.field.grid.n_levels = 4;
    config.field.grid.finest = 64;
    config.field.grid.log2_table_size = 12;
    config.material.n_hidden = 16;
    config.material.grid.log2_table_size = 10;
    config
}

fn start(folder: &Path, budget: Budget) -> Session {
    let capture = folder.join("scene");
    capture::write_capture(&capture);
    let options = SessionOptions::new(&capture, tiny_config(), budget);
    Session::spawn(options, || {}).expect("a thread")
}

/// Reads events until one is wanted; that one.
fn wait_for(session: &Session, wanted: impl Fn(&TrainEvent) -> bool) -> TrainEvent {
    loop {
        let event = session
            .events()
            .recv_timeout(PATIENCE)
            .expect("an event in time");
        assert!(!matches!(event, TrainEvent::Failed(_)), "{event:?}");
        if wanted(&event) {
            return event;
        }
    }
}

fn step_of(session: &Session) -> u64 {
    session.snapshot().map_or(0, |snapshot| snapshot.step)
}

#[test]
fn a_paused_session_stands_still_and_steps_on_request() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = start(folder.path(), Budget::Steps(1_000_000));
    wait_for(&session, |event| matches!(event, TrainEvent::Progress(_)));
    session.send(TrainCommand::Pause);
    wait_for(&session, |event| *event == TrainEvent::Paused);
    let paused_at = step_of(&session);
    assert!(paused_at > 0, "the newest state is published on pause");
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(step_of(&session), paused_at, "nothing moves");

    session.send(TrainCommand::StepOnce);
    wait_for(&session, |event| *event == TrainEvent::Paused);
    assert_eq!(step_of(&session), paused_at + 1, "exactly one step");

    session.send(TrainCommand::Resume);
    wait_for(&session, |event| *event == TrainEvent::Resumed);
    let went_on = |event: &TrainEvent| matches!(event, TrainEvent::Progress(progress) if progress.step > paused_at + 1);
    wait_for(&session, went_on);

    session.send(TrainCommand::Stop);
    let end = wait_for(&session, |event| matches!(event, TrainEvent::Finished(_)));
    let stopped =
        matches!(end, TrainEvent::Finished(finish) if finish.reason == FinishReason::Stopped);
    assert!(stopped, "{end:?}");
    session.join().expect("a clean end");
}

#[test]
fn who_asks_sees_the_surface_grow_that_is_made_from_masks() {
    let folder = tempfile::tempdir().expect("a folder");
    let capture = folder.path().join("scene");
    capture::write_capture(&capture);
    std::fs::remove_file(capture.join("mesh.ply")).expect("a mesh");
    for shows_growth in [true, false] {
        let options = SessionOptions {
            shows_growth,
            ..SessionOptions::new(&capture, tiny_config(), Budget::Seconds(6.0))
        };
        let session = Session::spawn(options, || {}).expect("a thread");
        wait_for(&session, |event| matches!(event, TrainEvent::Loaded { .. }));
        let (picture, n_pictures) = session.growth();
        assert_eq!(n_pictures > 0, shows_growth, "{n_pictures} pictures");
        if let Some(picture) = picture {
            assert_eq!(picture.size, [32, 32], "as large as the photo");
            let corner = picture.pixels[0];
            let middle = picture.pixels[16 * 32 + 16];
            assert_ne!(middle, corner, "the ball is in the middle");
        }
        session.send(TrainCommand::Stop);
        session.join().expect("a clean end");
    }
}

/// A colour, with its opacity, for each place `[x, y]` of a photo.
type Painting<'a> = dyn Fn([f32; 2]) -> image::Rgba<u8> + 'a;

/// Gives what lies beside the object in all photos another colour.
fn repaint_background(capture: &Path, color: &Painting<'_>) {
    for split in ["train", "val", "test"] {
        for entry in std::fs::read_dir(capture.join(split)).expect("a folder") {
            let path = entry.expect("a file").path();
            let mask = path.with_file_name(format!(
                "{}_mask.png",
                path.file_stem().expect("a name").to_string_lossy()
            ));
            let Ok(mask) = image::open(&mask) else {
                continue;
            };
            let mut photo = image::open(&path).expect("a photo").to_rgba8();
            for (x, y, pixel) in photo.enumerate_pixels_mut() {
                if mask.to_luma8().get_pixel(x, y).0 == [0] {
                    *pixel = color([x as f32, y as f32]);
                }
            }
            photo.save(&path).expect("a photo");
        }
    }
}

/// Whether a run on the capture learns from the background, and what it says of that.
fn learns_background(capture: &Path, background: PhotoFit) -> (bool, Vec<String>) {
    let config = TrainConfig {
        background,
        ..tiny_config()
    };
    let options = SessionOptions::new(capture, config, Budget::Steps(30));
    let session = Session::spawn(options, || {}).expect("a thread");
    let loaded = wait_for(&session, |event| matches!(event, TrainEvent::Loaded { .. }));
    let TrainEvent::Loaded { problems, .. } = loaded else {
        unreachable!("it was waited for");
    };
    let stepped = |event: &TrainEvent| matches!(event, TrainEvent::Progress(p) if p.step > 0);
    let TrainEvent::Progress(progress) = wait_for(&session, stepped) else {
        unreachable!("it was waited for");
    };
    session.send(TrainCommand::Stop);
    session.join().expect("a clean end");
    (progress.loss_background > 0.0, problems)
}

#[test]
fn a_background_that_shows_no_environment_is_left_out_unless_somebody_wants_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let capture = folder.path().join("scene");
    capture::write_capture(&capture);
    let as_on_a_turntable = |[x, y]: [f32; 2]| {
        let grey = (120.0 + 10.0 * ((0.5 * x).sin() + (0.4 * y).cos())) as u8;
        image::Rgba([grey, grey, grey, u8::MAX])
    };
    let is_said = |problems: &[String], what| problems.iter().any(|p| p.contains(what));
    let cases: [(_, &Painting<'_>); 2] = [
        ("it is left out", &as_on_a_turntable),
        ("cut out", &|_| image::Rgba([0; 4])),
    ];
    for (what, color) in cases {
        repaint_background(&capture, color);
        let (is_learned, problems) = learns_background(&capture, PhotoFit::Auto);
        assert!(!is_learned && is_said(&problems, what), "{problems:?}");
        let (is_learned, problems) = learns_background(&capture, PhotoFit::On);
        let is_left_out = is_said(&problems, "it is left out");
        assert!(is_learned && !is_left_out, "{problems:?}");
    }
}

#[test]
fn a_session_reports_that_it_traces_refined_normals_anew() {
    let folder = tempfile::tempdir().expect("a folder");
    let capture = folder.path().join("scene");
    capture::write_capture(&capture);
    let config = TrainConfig {
        normals: Normals::Refined,
        ..tiny_config()
    };
    let options = SessionOptions::new(&capture, config, Budget::Steps(20));
    let session = Session::spawn(options, || {}).expect("a thread");
    let event = wait_for(&session, |event| {
        matches!(
            event,
            TrainEvent::Retracing { .. } | TrainEvent::Finished(_)
        )
    });
    assert_eq!(event, TrainEvent::Retracing { fraction: 0.0 });
    let goes_on = |event: &TrainEvent| matches!(event, TrainEvent::Progress(_));
    wait_for(&session, goes_on);
    wait_for(&session, |event| matches!(event, TrainEvent::Finished(_)));
    session.join().expect("a clean end");
}

#[test]
fn a_finished_session_saves_and_trains_further() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = start(folder.path(), Budget::Steps(5));
    let is_end = |event: &TrainEvent| matches!(event, TrainEvent::Finished(_));
    wait_for(&session, is_end);
    assert_eq!(step_of(&session), 5);

    session.send(TrainCommand::Extend(Budget::Steps(3)));
    wait_for(&session, is_end);
    assert_eq!(step_of(&session), 8, "the last state is always published");

    let run = folder.path().join("run");
    for _ in 0..2 {
        session.send(TrainCommand::Save(run.clone()));
        wait_for(&session, |event| *event == TrainEvent::Saved(run.clone()));
    }
    let saved = RunFolder::open(&run).expect("a run folder");
    assert!(saved.scene().expect("a scene").object.is_some());
    assert_eq!(saved.trained().map(|trained| trained.steps), Some(8));
    session.join().expect("a clean end");

    let session = start(folder.path(), Budget::Steps(1));
    wait_for(&session, is_end);
    session.send(TrainCommand::Save(run));
    let refused = wait_for(&session, |event| matches!(event, TrainEvent::Warning(_)));
    let named = matches!(&refused, TrainEvent::Warning(text) if text.contains("holds a run"));
    assert!(named, "another run is not overwritten: {refused:?}");
    session.join().expect("a clean end");
}

#[test]
fn a_session_stops_while_it_is_still_loading() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = start(folder.path(), Budget::Seconds(1e6));
    session.send(TrainCommand::Stop);
    let end = wait_for(&session, |event| matches!(event, TrainEvent::Finished(_)));
    let step = if let TrainEvent::Finished(finish) = end {
        finish.step
    } else {
        u64::MAX
    };
    assert_eq!(step, 0);
    session.join().expect("a clean end");
}

#[test]
fn a_missing_capture_is_reported_and_returned() {
    let folder = tempfile::tempdir().expect("a folder");
    let nowhere = folder.path().join("nowhere");
    let options = SessionOptions::new(&nowhere, tiny_config(), Budget::Steps(1));
    let session = Session::spawn(options, || {}).expect("a thread");
    let events = std::iter::from_fn(|| session.events().recv_timeout(PATIENCE).ok());
    let failed = events.filter_map(|event| match event {
        TrainEvent::Failed(message) => Some(message),
        _ => None,
    });
    let failed = failed.last().expect("a report");
    assert!(failed.contains("nowhere"), "{failed}");
    let error = session.join().expect_err("the same error");
    assert!(error.is_unusable_input(), "{error}");
}
