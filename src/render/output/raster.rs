//! A picture: its size and its pixels.

use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

/// An image, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `[height * width]` colours; which space, the maker says.
    pub pixels: Vec<[f32; 3]>,
}

impl Picture {
    /// A picture whose rows, `n_rows` a task, are made in parallel by `draw(scratch, first_row, pixels)`; `None` when
    /// cancelled.
    pub(in crate::render) fn by_rows<S: Default>(
        (width, height): (u32, u32),
        n_rows: u32,
        cancel: &AtomicBool,
        draw: impl Fn(&mut S, u32, &mut [[f32; 3]]) + Sync,
    ) -> Option<Self> {
        let mut pixels = vec![[0.0; 3]; (width * height) as usize];
        pixels
            .par_chunks_mut((n_rows * width) as usize)
            .enumerate()
            .for_each_init(S::default, |scratch, (task, pixels)| {
                if !cancel.load(Ordering::Relaxed) {
                    draw(scratch, task as u32 * n_rows, pixels);
                }
            });
        (!cancel.load(Ordering::Relaxed)).then_some(Self {
            width,
            height,
            pixels,
        })
    }
}
