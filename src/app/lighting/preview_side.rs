//! One picture of the viewport: its preview, what was asked of it, and the texture that it fills.

use std::sync::Arc;
use std::time::Duration;

use egui::{Context, TextureHandle, TextureId};

use crate::app::state::app_state::ShownPicture;
use crate::app::viewport::texture;
use crate::app::work::preview_driver::{PreviewDriver, Situation};
use crate::render::{DrawnBy, GpuChoice, Preview, PreviewScene};
use crate::train::Snapshot;

/// A preview that keeps a texture up to date.
pub(in crate::app) struct PreviewSide {
    name: &'static str,
    preview: Preview,
    driver: PreviewDriver,
    n_frames_seen: u64,
    texture: Option<TextureHandle>,
}

impl PreviewSide {
    /// Starts the threads (0: one per core); `ctx` is woken after each picture. Pictures come from a graphics card where
    /// `choice` finds one.
    ///
    /// # Errors
    /// When the system gives no threads.
    pub(in crate::app) fn new(
        ctx: &Context,
        name: &'static str,
        n_threads: usize,
        choice: GpuChoice,
    ) -> std::io::Result<Self> {
        let wake = ctx.clone();
        Ok(Self {
            name,
            preview: Preview::new(n_threads, choice, move || wake.request_repaint())?,
            driver: PreviewDriver::default(),
            n_frames_seen: 0,
            texture: None,
        })
    }

    /// What draws its pictures.
    pub(in crate::app) fn drawn_by(&self) -> DrawnBy {
        self.preview.drawn_by()
    }

    /// The newest picture; none before the first.
    pub(in crate::app) fn texture(&self) -> Option<TextureId> {
        self.texture.as_ref().map(TextureHandle::id)
    }

    /// Uploads the newest picture and returns what is known of it, if there is a new one.
    pub(in crate::app) fn take_frame(&mut self, ctx: &Context) -> Option<ShownPicture> {
        let n_frames = self.preview.n_frames();
        if n_frames == self.n_frames_seen {
            return None;
        }
        self.n_frames_seen = n_frames;
        let frame = self.preview.frame()?;
        let step = self.driver.was_shown(&frame)?;
        let output = &frame.output;
        let size = [output.width as usize, output.height as usize];
        texture::renew(ctx, &mut self.texture, self.name, (size, &output.pixels));
        tracing::trace!(
            name = self.name,
            scale = frame.scale,
            is_last = frame.is_last,
            cpu_secs = output.cpu_secs,
            computed = ?output.recomputed,
            "preview"
        );
        Some(ShownPicture {
            size: (output.width, output.height),
            scale: frame.scale,
            step,
            is_refining: !frame.is_last,
            recomputed: output.recomputed,
        })
    }

    /// Asks for what is missing; `scene` makes the picture of a snapshot.
    pub(in crate::app) fn ask(
        &mut self,
        ctx: &Context,
        snapshot: &Arc<Snapshot>,
        scene: impl Fn(&Snapshot) -> PreviewScene,
        situation: &Situation,
    ) {
        if let Some(wanted) = self.driver.decide(snapshot, scene, situation) {
            let number = self.preview.request(wanted.scene, wanted.passes);
            self.driver.was_requested(number);
        } else if let Some(wait) = self.driver.wait_secs(situation.now_secs) {
            ctx.request_repaint_after(Duration::from_secs_f64(wait.max(0.01)));
        }
    }

    /// Forgets every picture: something else was opened.
    pub(in crate::app) fn clear(&mut self) {
        self.driver.clear();
        self.texture = None;
    }
}
