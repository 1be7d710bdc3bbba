//! Draws Gaussians on the processor: 3D Gaussian Splatting's picture (Kerbl et al. 2023, Sec. 6), without a graphics card.
//!
//! `project` flattens Gaussians onto the picture, `strip` sorts them into tiles, `blend` composites a tile.

mod blend;
mod project;
mod strip;

use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use self::project::Projection;
use self::strip::{Strip, strip_lists};
use super::picture::ScanPicture;
use super::splats::Splats;
use crate::geometry::Camera;

/// Pixels along a tile's side.
const TILE: usize = 16;

/// The view of a pinhole camera; `None` when cancelled. The same picture on any number of threads.
pub(super) fn picture(
    splats: &Splats,
    camera: &Camera,
    cancel: &AtomicBool,
) -> Option<ScanPicture> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let flats = Projection::new(splats, camera).flats();
    let lists = strip_lists(&flats, height);
    let mut picture = ScanPicture {
        width: camera.width,
        height: camera.height,
        srgb: vec![[0.0; 3]; width * height],
        opacity: vec![0.0; width * height],
        distance: vec![f32::INFINITY; width * height],
    };
    let n = TILE * width;
    let strips = picture
        .srgb
        .par_chunks_mut(n)
        .zip(picture.opacity.par_chunks_mut(n))
        .zip(picture.distance.par_chunks_mut(n));
    strips
        .zip(lists)
        .enumerate()
        .for_each(|(i, (((srgb, opacity), distance), list))| {
            if !cancel.load(Ordering::Relaxed) {
                let mut strip = Strip {
                    top: i * TILE,
                    width,
                    srgb,
                    opacity,
                    distance,
                };
                strip.draw(&flats, &list, camera);
            }
        });
    (!cancel.load(Ordering::Relaxed)).then_some(picture)
}

#[cfg(test)]
mod tests;
