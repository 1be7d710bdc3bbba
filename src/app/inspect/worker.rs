//! Computes what is known of a picked point, and the panorama around it, on threads of its own.
//!
//! A newer request supersedes a running one within a row of the panorama, except that values and the coarsest panorama
//! are always finished: while something is dragged both follow.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::thread::JoinHandle;

use rayon::ThreadPool;

use super::driver::Wanted;
use crate::app::work::opener::ScreenPhoto;
use crate::app::work::threads;
use crate::render::preview::inbox::Inbox;
use crate::render::{
    Layer, PanoramaView, Picture, PointValues, Scene, ShadeScratch, compose, panorama_of,
    point_values,
};
use crate::train::session::latest::Latest;

/// Niceness of the threads: below the preview's, above the trainer's.
const NICE: i32 = 10;

/// A finished panorama.
#[derive(Clone, Debug)]
pub(super) struct FoundPanorama {
    /// The number of its request, from [`PointWorker::request`].
    pub(super) number: u64,
    pub(super) view: PanoramaView,
    pub(super) picture: ScreenPhoto,
}

#[derive(Debug, Default)]
struct Shared {
    /// What is wanted, and the widths of the panorama around it, one after the other; none where the shown one will do.
    inbox: Inbox<(Wanted, Vec<u32>)>,
    /// With the number of their request.
    values: Latest<(u64, PointValues)>,
    panorama: Latest<FoundPanorama>,
}

/// The threads. Dropping it ends them.
#[derive(Debug)]
pub(super) struct PointWorker {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl PointWorker {
    /// Starts the threads, one per core. `wake` is called after each result; it must not block.
    ///
    /// # Errors
    /// When the system gives no threads.
    pub(super) fn new(wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let pool = threads::pool("neif-point", 0, NICE)?;
        let theirs = Arc::clone(&shared);
        let thread = threads::spawn("neif-point", NICE, move || {
            let mut scratch = ShadeScratch::default();
            while let Some((number, (wanted, widths))) = theirs.inbox.take() {
                theirs.serve(number, &wanted, &widths, &pool, &mut scratch, &wake);
            }
        })?;
        Ok(Self {
            shared,
            thread: Some(thread),
        })
    }

    /// Asks instead of whatever is waiting or running; returns the request's number, which grows.
    pub(super) fn request(&self, wanted: Wanted, widths: Vec<u32>) -> u64 {
        self.shared.inbox.put((wanted, widths))
    }

    /// The newest values.
    pub(super) fn values(&self) -> &Latest<(u64, PointValues)> {
        &self.shared.values
    }

    /// The newest panorama.
    pub(super) fn panorama(&self) -> &Latest<FoundPanorama> {
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
        wanted: &Wanted,
        widths: &[u32],
        pool: &ThreadPool,
        scratch: &mut ShadeScratch,
        wake: &impl Fn(),
    ) {
        let scene = &wanted.scene;
        let Some(values) = point_values(scene, &wanted.view, scratch) else {
            return;
        };
        self.values.publish(Arc::new((number, values)));
        wake();
        let roughness = if wanted.is_sharp {
            0.0
        } else {
            values.cone_roughness
        };
        let never = AtomicBool::new(false);
        for (i, &width) in widths.iter().enumerate() {
            let around = PanoramaView {
                at: wanted.view.position,
                up: wanted.up,
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
                picture: shown(scene, &picture),
            }));
            wake();
            if self.inbox.is_superseded() {
                return;
            }
        }
    }
}

/// The panorama as the viewport shows an environment.
fn shown(scene: &Scene, picture: &Picture) -> ScreenPhoto {
    let (width, height) = (picture.width as usize, picture.height as usize);
    ScreenPhoto::thinned(width, height, |i| {
        let color = compose(scene, Layer::Environment, 0.0, [0.0; 3], picture.pixels[i]);
        color.map(|v| (v * 255.0 + 0.5) as u8)
    })
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::app::inspect::Pick;
    use crate::render::test_scene;

    #[test]
    fn values_and_panoramas_arrive_and_newer_requests_come_first() {
        let worker = PointWorker::new(|| {}).unwrap();
        let normal = Vec3::ONE.normalize_or_zero();
        let pick = Pick {
            position: Vec3::splat(0.4),
            normal,
            face_normal: normal,
        };
        let wanted = Wanted {
            pick,
            view: pick.seen_by(&test_scene::camera(40, 30)),
            scene: test_scene::scene(),
            up: Vec3::Z,
            is_sharp: false,
        };
        // Far more than can be rendered while the test waits.
        worker.request(wanted.clone(), vec![8, 1 << 14]);
        let last = worker.request(wanted, vec![8, 16]);
        let start = std::time::Instant::now();
        loop {
            let found = worker.panorama().get();
            let done = found.filter(|found| (found.number, found.view.width) == (last, 16));
            if let Some(found) = done {
                assert_eq!(found.picture.pixels.len(), 16 * 8);
                assert!(found.view.roughness > 0.0, "blurred like the point");
                break;
            }
            assert!(start.elapsed().as_secs() < 60, "superseded work goes on");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        let values = worker.values().get().expect("values come first");
        assert_eq!(values.0, last);
    }
}
