//! Air: what photos see through to what lies behind, where nothing is for good.

use glam::Vec3;
use rayon::prelude::*;

use super::SeenDepths;
use crate::neif::field::cells::{INNER_SIDE, inner_cell_index};
use crate::neif::field::contraction::FieldFrame;
use crate::neif::field::density_grid::DensityGrid;
use crate::train::sweep::PhotoDepths;

/// Photos that must see through a cell, and how many of them for one that sees something there.
const SEEN_THROUGH_BY: u8 = 3;
const FOR_ONE: u8 = 4;
/// Share of the distance, and cells, before what is seen that are left alone: it is not known better.
const MARGIN: f32 = 0.05;
const CELLS_BEFORE: f32 = 2.0;
/// Cells from one sample along a line of sight to the next.
const STEP: f32 = 0.5;
/// Inner cells, which come first.
const N_CELLS: usize = INNER_SIDE.pow(3);
/// Photos whose cells are in memory at once.
const AT_ONCE: usize = 16;

/// Declares inner cells empty for good through which enough photos see what their depths are known of.
pub(in crate::train) fn clear_air(
    density: &mut DensityGrid,
    depths: &SeenDepths,
    frame: &FieldFrame,
) {
    let photos: Vec<&PhotoDepths> = depths.photos.iter().flatten().collect();
    let mut n_seen = vec![[0_u8; 2]; N_CELLS];
    for photos in photos.chunks(AT_ONCE) {
        let seen = photos.par_iter().map(|photo| seen(photo, frame));
        for seen in seen.collect::<Vec<_>>() {
            for ([n_air, n_surface], seen) in n_seen.iter_mut().zip(seen) {
                *n_air = n_air.saturating_add(u8::from(seen == Seen::Air));
                *n_surface = n_surface.saturating_add(u8::from(seen == Seen::Surface));
            }
        }
    }
    let is_air = |cell: &usize| {
        let [n_air, n_surface] = n_seen[*cell];
        n_air >= SEEN_THROUGH_BY && n_air / FOR_ONE >= n_surface
    };
    density.hollow_cells((0..N_CELLS).filter(is_air));
}

/// What a photo says of each inner cell.
fn seen(photo: &PhotoDepths, frame: &FieldFrame) -> Vec<Seen> {
    let mut cells = vec![Seen::Nothing; N_CELLS];
    let cell = DensityGrid::inner_cell();
    let eye = frame.field_from_world(photo.camera.position());
    let sights = (0..photo.nearness.len()).filter_map(|pixel| photo.point(pixel));
    let sights: Vec<Vec3> = sights.map(|p| frame.field_from_world(p) - eye).collect();
    let mut mark = |sight: &Vec3, from: f32, to: f32, seen: Seen| {
        let step = STEP * cell;
        let direction = sight.normalize_or_zero();
        let [enters, leaves] = in_box(eye, direction);
        let [first, last] = [from.max(enters), to.min(leaves)].map(|at| (at / step) as usize);
        for k in first..last {
            let p = eye + (k as f32 + 0.5) * step * direction;
            cells[inner_cell_index(p.to_array()) as usize] = seen;
        }
    };
    let before = |sight: &Vec3| sight.length() * (1.0 - MARGIN) - CELLS_BEFORE * cell;
    for sight in &sights {
        mark(sight, 0.0, before(sight), Seen::Air);
    }
    // A surface that some pixels see counts even where others look past its edge.
    for sight in &sights {
        mark(sight, before(sight), sight.length() + cell, Seen::Surface);
    }
    cells
}

/// Distances at which a ray enters and leaves the box of the inner cells, `[-1, 1]` each axis; the same where it misses it.
fn in_box(origin: Vec3, direction: Vec3) -> [f32; 2] {
    let [a, b] = [-1.0, 1.0].map(|side| (side - origin) / direction);
    let (near, far) = (a.min(b).max_element().max(0.0), a.max(b).min_element());
    [near, far.max(near)]
}

/// What a photo says of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Seen {
    Nothing,
    Air,
    Surface,
}
