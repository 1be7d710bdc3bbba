//! The window's side of a picked point: the worker with its driver, and the panorama on the graphics card.

use std::time::Duration;

use egui::{Context, TextureHandle, TextureId};

use crate::app::inspect::InspectState;
use crate::app::inspect::driver::{InspectDriver, REFRESH_SECS, Wanted};
use crate::app::inspect::worker::PointWorker;
use crate::app::viewport::texture;
use crate::app::work::preview_driver::Situation;

/// Worker, driver and texture.
pub(in crate::app) struct Inspector {
    worker: PointWorker,
    driver: InspectDriver,
    /// How much of the worker's results was taken in.
    seen: (u64, u64),
    texture: Option<TextureHandle>,
}

impl Inspector {
    /// Starts the worker, which wakes the window with every result.
    ///
    /// # Errors
    /// When the system gives no threads.
    pub(in crate::app) fn new(ctx: &Context) -> std::io::Result<Self> {
        let wake = ctx.clone();
        Ok(Self {
            worker: PointWorker::new(move || wake.request_repaint())?,
            driver: InspectDriver::default(),
            seen: (0, 0),
            texture: None,
        })
    }

    /// Takes in what was found since the last frame.
    pub(in crate::app) fn poll(&mut self, ctx: &Context, inspect: &mut InspectState) {
        let (values, panorama) = (self.worker.values(), self.worker.panorama());
        let versions = (values.version(), panorama.version());
        if versions.0 != self.seen.0
            && let Some(found) = values.get()
            && self.driver.is_current(found.0)
        {
            inspect.values = Some(found.1);
        }
        if versions.1 != self.seen.1
            && let Some(found) = panorama.get()
            && self.driver.was_reached(found.number, found.view.width)
        {
            let picture = (found.picture.size, &*found.picture.pixels);
            texture::renew(ctx, &mut self.texture, "panorama", picture);
            inspect.panorama = Some(found.view);
        }
        self.seen = versions;
    }

    /// Asks for what is missing; nothing is wanted while nothing is picked.
    pub(in crate::app) fn ask(&mut self, ctx: &Context, wanted: Option<Wanted>, now: &Situation) {
        let Some(wanted) = wanted else {
            self.driver.clear();
            return;
        };
        if let Some(decision) = self.driver.decide(&wanted, now) {
            let widths = decision.widths.clone();
            let number = self.worker.request(wanted.clone(), widths);
            self.driver.was_requested(wanted, &decision, number, now);
        } else if now.is_training {
            ctx.request_repaint_after(Duration::from_secs_f64(REFRESH_SECS));
        }
    }

    /// The panorama on the graphics card.
    pub(in crate::app) fn texture(&self) -> Option<TextureId> {
        self.texture.as_ref().map(TextureHandle::id)
    }
}
