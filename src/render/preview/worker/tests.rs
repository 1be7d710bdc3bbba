//! Tests of `worker`.

use std::time::{Duration, Instant};

use super::*;
use crate::render::Scene;
use crate::render::test_scene::{self, fog, picture, worst};

fn request(width: u32) -> PreviewScene {
    test_scene::request(width, width)
}

/// All pictures until the last one of a request.
fn frames_until_last(
    preview: &Preview,
    news: &crossbeam::channel::Receiver<()>,
    number: u64,
) -> Vec<Arc<PreviewFrame>> {
    let end = Instant::now() + Duration::from_mins(1);
    let mut frames: Vec<Arc<PreviewFrame>> = Vec::new();
    while frames
        .last()
        .is_none_or(|frame| frame.request != number || !frame.is_last)
    {
        news.recv_timeout(end.saturating_duration_since(Instant::now()))
            .expect("a picture within a minute");
        frames.extend(preview.frame());
    }
    frames
}

fn preview() -> (Preview, crossbeam::channel::Receiver<()>) {
    let (sender, news) = crossbeam::channel::bounded(1000);
    let wake = move || sender.send(()).expect("the test listens");
    let preview = Preview::new(2, GpuChoice::Off, wake);
    (preview.expect("threads"), news)
}

#[test]
fn pictures_come_coarse_to_fine() {
    let (preview, news) = preview();
    let number = preview.request(request(200), Passes::Refine);
    let frames = frames_until_last(&preview, &news, number);
    let last = frames.last().unwrap();
    let size = (last.output.width, last.output.height);
    assert_eq!((last.scale, size), (1, (200, 200)));
    assert!(last.is_fine, "the last picture is the offline one");
    assert_eq!(
        frames[0].scale, 2,
        "nothing was measured yet, so it begins at a half"
    );
    assert!(
        frames.windows(2).all(|pair| pair[1].scale <= pair[0].scale),
        "it grew coarser"
    );
}

#[test]
fn in_a_moved_environment_the_settled_picture_is_the_offline_one() {
    let (preview, news) = preview();
    let mut request = request(60);
    request.scene = Scene::new(request.scene.object, fog(-1.0, 1.5));
    request.scene.transform.rotate_deg = glam::Vec3::new(0.0, 20.0, 130.0);
    for _ in 0..2 {
        let number = preview.request(request.clone(), Passes::Refine);
        let frames = frames_until_last(&preview, &news, number);
        let settled = &frames.last().expect("a picture").output.pixels;
        let off = |scene| worst(settled, &picture(scene, &request.camera, request.layer));
        assert!(off(&request.scene) < 0.02, "{}", off(&request.scene));
        let baked = Scene {
            trained_in: None,
            ..request.scene.clone()
        };
        assert!(off(&baked) > 0.02, "the diffuse part follows");
        // The second time after another light in between.
        request.scene.transform.rotate_deg.z = -80.0;
    }
}

#[test]
fn the_newest_request_wins_and_none_is_coarser_than_a_half() {
    let (preview, news) = preview();
    let mut number = 0;
    for i in 0..30 {
        let mut next = request(160);
        next.scene.transform.rotate_deg.z = i as f32;
        number = preview.request(next, Passes::Refine);
    }
    let frames = frames_until_last(&preview, &news, number);
    assert!(
        frames.len() < 4 * 30,
        "every request was refined: {} pictures",
        frames.len()
    );
    assert!(
        frames.iter().all(|frame| frame.output.width >= 80),
        "coarser than a half"
    );
    assert!(
        frames
            .windows(2)
            .all(|pair| pair[1].request >= pair[0].request),
        "an older one came later"
    );
}

#[test]
fn a_refresh_makes_one_picture_of_the_scale_asked_for() {
    let (preview, news) = preview();
    let number = preview.request(request(64), Passes::Only(2));
    let frames = frames_until_last(&preview, &news, number);
    assert_eq!(
        frames
            .iter()
            .map(|frame| (frame.scale, frame.is_last))
            .collect::<Vec<_>>(),
        [(2, true)]
    );
}

#[test]
fn a_dropped_preview_ends_at_once() {
    let (preview, _news) = preview();
    preview.request(request(2000), Passes::Only(1));
    let start = Instant::now();
    drop(preview);
    assert!(
        start.elapsed() < Duration::from_secs(20),
        "took {:?}",
        start.elapsed()
    );
}
