//! Makes the picture of the density slice on a thread of its own, while it is shown.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crossbeam::channel::{Receiver, bounded};
use egui::{ColorImage, Context, TextureHandle, TextureId, TextureOptions};

use super::threads::spawn;
use crate::app::state::app_state::AppState;
use crate::app::state::training_state::Level;
use crate::color::map::{ColorMap, NEUTRAL};
use crate::neif::Environment;
use crate::render::output::slice::{DensitySlice, SlicePlane, density_share, density_slice};

/// Niceness of the thread: above the trainer alone.
const NICE: i32 = 8;
/// Points a side.
const SIDE: usize = 128;
/// Shortest time between two slices that only training made different, in seconds.
const REFRESH_SECS: f64 = 3.0;

/// A slice that is made or was made.
#[derive(Clone, Debug)]
struct Cut {
    environment: Arc<Environment>,
    plane: SlicePlane,
    begun_secs: f64,
}

/// A thread at work; dropping it ends the work.
#[derive(Debug)]
struct Running {
    cut: Cut,
    cancel: Arc<AtomicBool>,
    result: Receiver<Option<DensitySlice>>,
}

impl Drop for Running {
    fn drop(&mut self) {
        self.cancel.store(true, Ordering::Relaxed);
    }
}

/// The thread and the newest picture.
#[derive(Default)]
pub(in crate::app) struct SliceView {
    running: Option<Running>,
    done: Option<Cut>,
    texture: Option<TextureHandle>,
}

impl SliceView {
    /// The newest picture.
    pub(in crate::app) fn texture(&self) -> Option<TextureId> {
        self.texture.as_ref().map(TextureHandle::id)
    }

    /// Takes in a result, and begins what the state wants.
    pub(in crate::app) fn update(&mut self, ctx: &Context, state: &mut AppState) {
        let result = self.running.as_ref().map(|r| r.result.try_recv());
        if let Some(Ok(slice)) = result {
            self.take(ctx, slice);
        }
        let shown = state.shown_environment().cloned();
        let Some(environment) = shown.filter(|_| state.watch.is_slice_shown) else {
            self.running = None;
            return;
        };
        let (plane, now) = (state.watch.slice, state.messages.now_secs);
        let is_due = match (&self.running, &self.done) {
            (Some(running), _) => running.cut.plane != plane,
            (None, Some(done)) if done.plane == plane => {
                let is_training = state.is_learning();
                let has_rested = now - done.begun_secs >= REFRESH_SECS;
                !Arc::ptr_eq(&done.environment, &environment) && (has_rested || !is_training)
            }
            (None, _) => true,
        };
        if is_due {
            let cut = Cut {
                environment,
                plane,
                begun_secs: now,
            };
            if let Err(error) = self.start(ctx, cut) {
                let words = format!("cannot cut the environment: {error}");
                state.messages.say(Level::Error, words);
            }
        }
    }

    fn take(&mut self, ctx: &Context, slice: Option<DensitySlice>) {
        self.done = self.running.take().map(|running| running.cut.clone());
        self.texture = slice.map(|slice| {
            let size = [slice.side, slice.side];
            let colors: Vec<u8> = slice.densities.iter().flat_map(|d| color(*d)).collect();
            let image = ColorImage::from_rgb(size, &colors);
            ctx.load_texture("density slice", image, TextureOptions::NEAREST)
        });
    }

    fn start(&mut self, ctx: &Context, cut: Cut) -> std::io::Result<()> {
        let (sender, result) = bounded(1);
        let cancel = Arc::new(AtomicBool::new(false));
        let (environment, plane) = (Arc::clone(&cut.environment), cut.plane);
        let (flag, ctx) = (Arc::clone(&cancel), ctx.clone());
        spawn("neif-slice", NICE, move || {
            let slice = density_slice(&environment, plane, SIDE, &flag);
            // Nobody takes it when another one was asked for meanwhile.
            if sender.send(slice).is_ok() {
                ctx.request_repaint();
            }
        })?;
        self.running = Some(Running {
            cut,
            cancel,
            result,
        });
        Ok(())
    }
}

/// Grey inside the object, where nothing can be.
fn color(density: f32) -> [u8; 3] {
    if density.is_nan() {
        NEUTRAL.map(|c| c + 64)
    } else {
        ColorMap::Sequential.srgb8(density_share(density))
    }
}
