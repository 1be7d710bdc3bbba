//! Air: what photos see through to what lies behind, where nothing is for good.

use rayon::prelude::*;

use super::{PhotoDepths, SeenDepths};
use crate::neif::contraction::FieldFrame;
use crate::neif::density_grid::{DensityGrid, cell_index};

/// Photos that must see through a cell.
const SEEN_THROUGH_BY: u8 = 3;
/// Share of the distance, and cells, before what is seen that are left alone: it is not known better.
const MARGIN: f32 = 0.05;
const CELLS_BEFORE: f32 = 2.0;
/// Cells from one sample along a line of sight to the next.
const STEP: f32 = 0.5;
/// Photos whose cells are in memory at once.
const AT_ONCE: usize = 16;

/// Declares inner cells empty for good through which enough photos see what their depths are known of.
pub(in crate::train) fn clear_air(
    density: &mut DensityGrid,
    depths: &SeenDepths,
    frame: &FieldFrame,
) {
    let photos: Vec<&PhotoDepths> = depths.photos.iter().flatten().collect();
    let mut n_through = vec![0_u8; DensityGrid::N_INNER];
    for photos in photos.chunks(AT_ONCE) {
        let seen = photos.par_iter().map(|photo| seen_through(photo, frame));
        for seen in seen.collect::<Vec<_>>() {
            for (n, is_seen) in n_through.iter_mut().zip(seen) {
                *n = n.saturating_add(u8::from(is_seen));
            }
        }
    }
    let is_air = |cell: &usize| n_through[*cell] >= SEEN_THROUGH_BY;
    density.hollow_cells((0..DensityGrid::N_INNER).filter(is_air));
}

/// The inner cells through which a photo sees something.
fn seen_through(photo: &PhotoDepths, frame: &FieldFrame) -> Vec<bool> {
    let mut cells = vec![false; DensityGrid::N_INNER];
    let cell = DensityGrid::inner_cell();
    let eye = frame.field_from_world(photo.camera.position());
    // Beyond the box, seen from anywhere in it or near, there are no inner cells.
    let farthest = eye.length() + 3.0_f32.sqrt();
    for point in (0..photo.nearness.len()).filter_map(|pixel| photo.point(pixel)) {
        let sight = frame.field_from_world(point) - eye;
        let end = sight.length() * (1.0 - MARGIN) - CELLS_BEFORE * cell;
        let step = STEP * cell * sight.normalize_or_zero();
        let n = (end.min(farthest) / (STEP * cell)).max(0.0) as usize;
        for k in 0..n {
            let p = eye + (k as f32 + 0.5) * step;
            if p.abs().max_element() < 1.0 {
                cells[cell_index(p.to_array()) as usize] = true;
            }
        }
    }
    cells
}
