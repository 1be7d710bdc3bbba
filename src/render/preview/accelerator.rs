//! The graphics card beside the processor: opened when a picture first wants it, given up for good when it fails.

use std::sync::atomic::AtomicBool;

use super::drawn_by::{DrawnBy, GpuChoice};

#[cfg(feature = "gpu")]
use super::gpu::{GpuRenderer, carries};
use super::progressive::PassOutput;
#[cfg(feature = "gpu")]
use super::progressive::Recomputed;
use super::request::PreviewScene;
#[cfg(feature = "gpu")]
use super::thread_clock::thread_cpu;
#[cfg(feature = "gpu")]
use crate::render::PathOptions;

/// What came of asking the card.
#[cfg_attr(not(feature = "gpu"), expect(dead_code, reason = "only a card draws"))]
#[derive(Debug)]
pub(in crate::render) enum Attempt {
    /// A picture.
    Drawn(PassOutput),
    /// Something newer came.
    Cancelled,
    /// It is gone: the processor has to draw.
    Failed,
}

/// The card, if it is to be used.
#[derive(Debug, Default)]
pub(in crate::render) struct Accelerator {
    choice: GpuChoice,
    #[cfg(feature = "gpu")]
    renderer: Option<GpuRenderer>,
    /// What draws at the moment.
    pub(in crate::render) drawn_by: DrawnBy,
}

impl Accelerator {
    pub(in crate::render) fn new(choice: GpuChoice) -> Self {
        Self {
            choice,
            ..Self::default()
        }
    }

    fn fail(&mut self, why: &impl ToString) {
        self.drawn_by = self.drawn_by.after_failure(why.to_string());
        tracing::info!(drawn_by = ?self.drawn_by, "preview");
    }
}

#[cfg(feature = "gpu")]
impl Accelerator {
    /// Whether the card is there and carries the picture; opens it when it is first asked.
    pub(in crate::render) fn takes(&mut self, picture: &PreviewScene) -> bool {
        if !self.drawn_by.may_use_card() {
            return false;
        }
        if self.renderer.is_none() {
            match GpuRenderer::new(self.choice) {
                Ok(renderer) => self.renderer = Some(renderer),
                Err(error) => self.fail(&error),
            }
        }
        let Some(renderer) = &self.renderer else {
            return false;
        };
        let card = renderer.adapter().to_owned();
        let carried = carries(picture);
        self.drawn_by = match carried {
            Ok(()) => DrawnBy::Card(card),
            Err(what) => DrawnBy::ProcessorFor {
                card,
                what: what.to_string(),
            },
        };
        carried.is_ok()
    }

    /// A picture that it takes: with one path a pixel or, where it `is_fine`, what [`crate::render::render`] makes.
    pub(in crate::render) fn draw(
        &mut self,
        picture: &PreviewScene,
        is_fine: bool,
        cancel: &AtomicBool,
    ) -> Attempt {
        let start = thread_cpu();
        let options = if is_fine {
            PathOptions::FINE
        } else {
            PathOptions::PLAIN
        };
        let renderer = self.renderer.as_mut();
        match renderer.map_or(Ok(None), |card| card.picture(picture, options, cancel)) {
            Ok(Some(pixels)) => {
                let (width, height) = (picture.camera.width, picture.camera.height);
                let n = pixels.len();
                Attempt::Drawn(PassOutput {
                    width,
                    height,
                    pixels,
                    recomputed: Recomputed {
                        traced: n,
                        background: n,
                        object: n,
                    },
                    is_settled: is_fine,
                    cpu_secs: thread_cpu().saturating_sub(start).as_secs_f64(),
                })
            }
            Ok(None) => Attempt::Cancelled,
            Err(error) => {
                self.renderer = None;
                self.fail(&error);
                Attempt::Failed
            }
        }
    }
}

/// Why such a build draws by the processor.
#[cfg(not(feature = "gpu"))]
const NO_CARD: &str = "this build uses no graphics card";

#[cfg(not(feature = "gpu"))]
impl Accelerator {
    /// Never: this build has no such path.
    pub(in crate::render) fn takes(&mut self, _picture: &PreviewScene) -> bool {
        if self.drawn_by.may_use_card() {
            self.fail(&NO_CARD);
        }
        tracing::trace!(choice = ?self.choice, NO_CARD);
        false
    }

    /// Not reached, as nothing is taken.
    pub(in crate::render) fn draw(
        &mut self,
        _picture: &PreviewScene,
        _is_fine: bool,
        _cancel: &AtomicBool,
    ) -> Attempt {
        self.fail(&NO_CARD);
        Attempt::Failed
    }
}
