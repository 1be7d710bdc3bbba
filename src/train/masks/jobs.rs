//! Progress of a search.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use super::found::MaskError;

/// Pieces of work, counted, until the person asks to stop.
pub(super) struct Jobs<'a> {
    n: usize,
    done: AtomicUsize,
    cancel: &'a AtomicBool,
    on_progress: &'a (dyn Fn(f32) + Sync),
}

impl<'a> Jobs<'a> {
    pub(super) fn new(
        n: usize,
        cancel: &'a AtomicBool,
        on_progress: &'a (dyn Fn(f32) + Sync),
    ) -> Self {
        Self {
            n,
            done: AtomicUsize::new(0),
            cancel,
            on_progress,
        }
    }

    /// To be called before each.
    ///
    /// # Errors
    /// When the person has asked to stop.
    pub(super) fn next(&self) -> Result<(), MaskError> {
        if self.cancel.load(Ordering::Relaxed) {
            return Err(MaskError::Cancelled);
        }
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        (self.on_progress)(done as f32 / self.n as f32);
        Ok(())
    }
}
