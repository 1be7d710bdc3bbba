//! Memory for photos: by how much they are reduced so that all of them fit, and how many are decoded at once.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;

use super::image::picture_size;
use crate::data::Frame;
use crate::data::files::capture_path::has_extension;

/// Pixels that may be decoded at once, over all threads; a single larger photo waits until it is alone.
const MAX_DECODING: u64 = 64 << 20;

/// The factor on the sides of all photos of a capture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::data) struct Reduction {
    /// In `(0, 1]`.
    side_factor: f64,
}

impl Reduction {
    /// What makes the photos fit into `max_megapixels`, determined from their files' headers. Photos that cannot be read
    /// count nothing.
    pub(in crate::data) fn to_fit<'a>(
        frames: impl ParallelIterator<Item = &'a Frame>,
        max_megapixels: f32,
    ) -> Self {
        let n_pixels: u64 = frames
            .filter_map(|frame| picture_size(&frame.photo).ok())
            .map(|(width, height)| u64::from(width) * u64::from(height))
            .sum();
        let budget = 1e6 * f64::from(max_megapixels);
        Self {
            side_factor: (budget / n_pixels.max(1) as f64).sqrt().min(1.0),
        }
    }

    /// The size that a photo of the given size is reduced to; at least one pixel.
    pub(in crate::data) fn size(self, width: u32, height: u32) -> (u32, u32) {
        let side = |full: u32| {
            // Rounded down, so that the sum stays within the budget.
            let reduced = (f64::from(full) * self.side_factor).floor() as u32;
            reduced.clamp(1, full.max(1))
        };
        if self.side_factor < 1.0 {
            (side(width), side(height))
        } else {
            (width, height)
        }
    }
}

/// Lets threads decode photos only as long as the pixels of all of them are few.
#[derive(Debug, Default)]
pub(in crate::data) struct DecodeGate {
    n_decoding: Mutex<u64>,
    left: Condvar,
}

/// Pixels that are being decoded, until it is dropped.
#[derive(Debug)]
pub(in crate::data) struct Decoding<'a> {
    gate: &'a DecodeGate,
    n_pixels: u64,
}

impl DecodeGate {
    /// Waits until `n_pixels` more may be decoded; one photo always may.
    pub(in crate::data) fn enter(&self, n_pixels: u64) -> Decoding<'_> {
        let mut n_decoding = self.count();
        while *n_decoding > 0 && n_decoding.saturating_add(n_pixels) > MAX_DECODING {
            n_decoding = self
                .left
                .wait(n_decoding)
                .unwrap_or_else(PoisonError::into_inner);
        }
        *n_decoding += n_pixels;
        Decoding {
            gate: self,
            n_pixels,
        }
    }

    /// A panic elsewhere leaves the number right: it is changed in one step.
    fn count(&self) -> MutexGuard<'_, u64> {
        self.n_decoding
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Decoding<'_> {
    fn drop(&mut self) {
        *self.gate.count() -= self.n_pixels;
        self.gate.left.notify_all();
    }
}

/// Memory of a decoded photo in pixels of eight bits a colour, estimated before it is decoded.
pub(super) fn decoding_cost(frame: &Frame) -> u64 {
    let is_float = has_extension(&frame.photo, "exr") || has_extension(&frame.photo, "hdr");
    let n_pixels = picture_size(&frame.photo).map_or(0, |(w, h)| u64::from(w) * u64::from(h));
    n_pixels * if is_float { 4 } else { 1 }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    #[test]
    fn reduced_photos_fit_and_small_ones_stay() {
        for (n_pixels, budget) in [(48e6, 10e6), (1e9, 1e5), (7.0, 1.0)] {
            let reduction = Reduction {
                side_factor: f64::sqrt(budget / n_pixels),
            };
            let (width, height) = reduction.size(8000, 6000);
            let share = f64::from(width) * f64::from(height) / 48e6;
            assert!(share <= budget / n_pixels, "{width} x {height}");
            assert!(share > 0.9 * budget / n_pixels, "{width} x {height}");
            assert_eq!(reduction.size(1, 1), (1, 1), "one pixel stays");
        }
        let reduction = Reduction { side_factor: 1.0 };
        assert_eq!(reduction.size(8000, 6000), (8000, 6000), "enough room");
    }

    #[test]
    fn few_photos_are_decoded_at_once_and_a_huge_one_alone() {
        let (gate, now, most) = (DecodeGate::default(), AtomicU64::new(0), AtomicU64::new(0));
        let sizes = [MAX_DECODING / 2, 1, MAX_DECODING * 3, MAX_DECODING / 2 + 1];
        (0..64_usize).into_par_iter().for_each(|i| {
            let n_pixels = sizes[i % sizes.len()];
            let _decoding = gate.enter(n_pixels);
            let others = now.fetch_add(n_pixels, Ordering::SeqCst);
            assert!(others == 0 || others + n_pixels <= MAX_DECODING, "{others}");
            most.fetch_max(others + n_pixels, Ordering::SeqCst);
            std::thread::yield_now();
            now.fetch_sub(n_pixels, Ordering::SeqCst);
        });
        assert_eq!(most.into_inner(), MAX_DECODING * 3, "the huge one passed");
    }
}
