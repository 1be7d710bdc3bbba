//! Computes what is known of a picked point, and the panorama around it, on threads of its own.
//!
//! A newer request supersedes a running one within a row of the panorama, except that values and the coarsest panorama
//! are always finished: while something is dragged both follow.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::thread::JoinHandle;

use glam::Vec3;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::render::preview::inbox::Inbox;
use crate::render::preview::priority::lower_thread_priority;
use crate::render::{
    Layer, PanoramaView, Picture, PointValues, PointView, Scene, ShadeScratch, compose,
    panorama_of, point_values,
};
use crate::train::session::latest::Latest;

/// Niceness of the threads: below the preview's, above the trainer's.
const NICE: i32 = 10;

/// A panorama that is wanted.
#[derive(Clone, Debug, PartialEq)]
pub struct PanoramaWish {
    /// The unit direction at its top edge.
    pub up: Vec3,
    /// Whether it is sharp rather than as blurred as the point's reflection.
    pub is_sharp: bool,
    /// Its widths, one after the other, pixels.
    pub widths: Vec<u32>,
}

/// What is wanted.
#[derive(Clone, Debug)]
pub struct PointRequest {
    /// Object, environment and edits.
    pub scene: Scene,
    /// The point.
    pub view: PointView,
    /// The panorama around it, unless the shown one will do.
    pub panorama: Option<PanoramaWish>,
}

/// What was found; each number is the request's, from [`PointWorker::request`].
#[derive(Clone, Debug)]
pub struct FoundValues {
    /// The request.
    pub number: u64,
    /// The values.
    pub values: PointValues,
}

/// A finished panorama.
#[derive(Clone, Debug)]
pub struct FoundPanorama {
    /// The request.
    pub number: u64,
    /// What it shows.
    pub view: PanoramaView,
    /// `[height * width]` sRGB with alpha 255.
    pub pixels: Vec<[u8; 4]>,
    /// Rows.
    pub height: u32,
}

#[derive(Debug, Default)]
struct Shared {
    inbox: Inbox<PointRequest>,
    values: Latest<FoundValues>,
    panorama: Latest<FoundPanorama>,
}

/// The threads. Dropping it ends them.
#[derive(Debug)]
pub struct PointWorker {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl PointWorker {
    /// Starts the threads, one per core. `wake` is called after each result; it must not block.
    ///
    /// # Errors
    /// When the system gives no threads.
    pub fn new(wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let pool = ThreadPoolBuilder::new()
            .thread_name(|i| format!("neif-point-{i}"))
            .start_handler(|_| lower_thread_priority(NICE))
            .build()
            .map_err(std::io::Error::other)?;
        let theirs = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("neif-point".to_owned())
            .spawn(move || {
                lower_thread_priority(NICE);
                let mut scratch = ShadeScratch::default();
                while let Some((number, request)) = theirs.inbox.take() {
                    theirs.serve(number, &request, &pool, &mut scratch, &wake);
                }
            })?;
        Ok(Self {
            shared,
            thread: Some(thread),
        })
    }

    /// Asks instead of whatever is waiting or running; returns the request's number, which grows.
    pub fn request(&self, request: PointRequest) -> u64 {
        self.shared.inbox.put(request)
    }

    /// The newest values.
    pub fn values(&self) -> &Latest<FoundValues> {
        &self.shared.values
    }

    /// The newest panorama.
    pub fn panorama(&self) -> &Latest<FoundPanorama> {
        &self.shared.panorama
    }
}

impl Drop for PointWorker {
    fn drop(&mut self) {
        self.shared.inbox.close();
        let thread = self.thread.take();
        if thread.is_some_and(|thread| thread.join().is_err()) {
            tracing::error!("the thread of the picked point broke down (this is a bug)");
        }
    }
}

impl Shared {
    fn serve(
        &self,
        number: u64,
        request: &PointRequest,
        pool: &ThreadPool,
        scratch: &mut ShadeScratch,
        wake: &impl Fn(),
    ) {
        let PointRequest { scene, view, .. } = request;
        let Some(values) = point_values(scene, view, scratch) else {
            return;
        };
        let found = FoundValues { number, values };
        self.values.publish(Arc::new(found));
        wake();
        let Some(wish) = &request.panorama else {
            return;
        };
        let roughness = if wish.is_sharp {
            0.0
        } else {
            values.cone_roughness
        };
        let never = AtomicBool::new(false);
        for (i, &width) in wish.widths.iter().enumerate() {
            let around = PanoramaView {
                at: view.position,
                up: wish.up,
                roughness,
                width,
            };
            let cancel = if i == 0 {
                &never
            } else {
                self.inbox.superseded()
            };
            let Some(picture) = pool.install(|| panorama_of(scene, &around, cancel)) else {
                return;
            };
            self.panorama.publish(Arc::new(FoundPanorama {
                number,
                view: around,
                pixels: shown(scene, &picture),
                height: picture.height,
            }));
            wake();
            if self.inbox.is_superseded() {
                return;
            }
        }
    }
}

/// The panorama as the viewport shows an environment.
fn shown(scene: &Scene, picture: &Picture) -> Vec<[u8; 4]> {
    let pixels = picture.pixels.iter().map(|&radiance| {
        let color = compose(scene, Layer::Environment, 0.0, [0.0; 3], radiance);
        let [r, g, b] = color.map(|v| (v * 255.0 + 0.5) as u8);
        [r, g, b, 255]
    });
    pixels.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::test_scene;

    #[test]
    fn values_and_panoramas_arrive_and_newer_requests_come_first() {
        let worker = PointWorker::new(|| {}).unwrap();
        let scene = test_scene::scene();
        let camera = test_scene::camera(40, 30);
        let (position, normal) = (Vec3::splat(0.4), Vec3::ONE.normalize_or_zero());
        let request = |widths: &[u32]| PointRequest {
            scene: scene.clone(),
            view: PointView::from_camera(position, normal, normal, &camera),
            panorama: Some(PanoramaWish {
                up: Vec3::Z,
                is_sharp: false,
                widths: widths.to_vec(),
            }),
        };
        // Far more than can be rendered while the test waits.
        worker.request(request(&[8, 1 << 14]));
        let last = worker.request(request(&[8, 16]));
        let start = std::time::Instant::now();
        loop {
            let found = worker.panorama().get();
            let done = found.filter(|found| (found.number, found.view.width) == (last, 16));
            if let Some(found) = done {
                assert_eq!(found.pixels.len(), 16 * 8);
                assert!(found.view.roughness > 0.0, "blurred like the point");
                break;
            }
            assert!(start.elapsed().as_secs() < 60, "superseded work goes on");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        let values = worker.values().get().expect("values come first");
        assert_eq!(values.number, last);
    }
}
