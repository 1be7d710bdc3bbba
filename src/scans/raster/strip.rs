//! A row of tiles: which Gaussians are in it, nearest first.

use super::TILE;
use super::blend::{Tile, blend};
use super::project::Flat;
use crate::geometry::Camera;
use rayon::prelude::*;

/// The Gaussians that touch each row of tiles, by index, the nearest first.
pub(super) fn strip_lists(flats: &[Flat], height: usize) -> Vec<Vec<u32>> {
    // Depths are positive: their bits are in their order, and ties keep the scan's.
    let mut order: Vec<u64> = flats
        .par_iter()
        .enumerate()
        .map(|(i, flat)| u64::from(flat.depth.to_bits()) << 32 | i as u64)
        .collect();
    order.par_sort_unstable();
    let mut lists = vec![Vec::new(); height.div_ceil(TILE)];
    for i in order {
        let i = i as u32;
        let [first, last] = flats[i as usize].rows.map(|row| usize::from(row) / TILE);
        lists[first..=last].iter_mut().for_each(|list| list.push(i));
    }
    lists
}

/// A picture's rows of one row of tiles.
pub(super) struct Strip<'a> {
    /// Its first row in the picture.
    pub(super) top: usize,
    /// Columns.
    pub(super) width: usize,
    /// See [`crate::scans::ScanPicture`], these rows alone.
    pub(super) srgb: &'a mut [[f32; 3]],
    /// As before.
    pub(super) opacity: &'a mut [f32],
    /// As before.
    pub(super) distance: &'a mut [f32],
}

impl Strip<'_> {
    /// Draws the Gaussians of a list, the nearest first.
    pub(super) fn draw(&mut self, flats: &[Flat], list: &[u32], camera: &Camera) {
        let mut lists = vec![Vec::new(); self.width.div_ceil(TILE)];
        for &i in list {
            let flat = &flats[i as usize];
            let [first, last] = flat.columns.map(|column| usize::from(column) / TILE);
            lists[first..=last]
                .iter_mut()
                .for_each(|list| list.push(*flat));
        }
        for (i, list) in lists.iter().enumerate() {
            let mut tile = Tile::new(i * TILE, self.top);
            blend(&mut tile, list);
            self.keep(&tile, camera);
        }
    }

    fn keep(&mut self, tile: &Tile, camera: &Camera) {
        let n_rows = self.opacity.len() / self.width;
        for y in 0..n_rows {
            let columns = tile.left..(tile.left + TILE).min(self.width);
            for (x, column) in columns.enumerate() {
                let i = y * self.width + column;
                let opacity = 1.0 - tile.transmittance[y][x];
                self.srgb[i] = [0, 1, 2].map(|c| tile.srgb[c][y][x]);
                self.opacity[i] = opacity;
                if opacity > 0.0 {
                    let slope_x = (column as f32 + 0.5 - camera.cx) / camera.fx;
                    let slope_y = ((self.top + y) as f32 + 0.5 - camera.cy) / camera.fy;
                    let stretch = (1.0 + slope_x * slope_x + slope_y * slope_y).sqrt();
                    self.distance[i] = stretch * tile.depth[y][x] / opacity;
                }
            }
        }
    }
}
