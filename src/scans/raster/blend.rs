//! Composites Gaussians over the pixels of a tile, front to back.

use super::TILE;
use super::project::{Flat, MIN_ALPHA};
use crate::neif::kernels::{Isa, dispatch, fma, math};

/// Most that one Gaussian hides, so that light behind it still counts.
const MAX_ALPHA: f32 = 0.99;
/// Light that is left where nothing behind can be seen.
const OPAQUE: f32 = 1e-4;
/// Gaussians between two looks at whether the tile is opaque.
const LOOK_EVERY: usize = 16;

/// A value for each pixel, row by row.
type Plane = [[f32; TILE]; TILE];

/// The pixels of a tile.
pub(super) struct Tile {
    /// Its first column in the picture.
    pub(super) left: usize,
    /// Its first row in the picture.
    top: usize,
    /// Share of the light from behind that comes through.
    pub(super) transmittance: Plane,
    /// Colour, sRGB-encoded.
    pub(super) srgb: [Plane; 3],
    /// Depth times share of the pixel.
    pub(super) depth: Plane,
}

impl Tile {
    pub(super) fn new(left: usize, top: usize) -> Self {
        let zeros = [[0.0; TILE]; TILE];
        Self {
            left,
            top,
            transmittance: [[1.0; TILE]; TILE],
            srgb: [zeros; 3],
            depth: zeros,
        }
    }

    fn is_opaque(&self) -> bool {
        let most = |m: f32, row: &[f32; TILE]| row.iter().fold(m, |m, t| m.max(*t));
        self.transmittance.iter().fold(0.0, most) < OPAQUE
    }
}

dispatch! {
    /// Draws Gaussians, the nearest first.
    pub(super) fn blend(tile: &mut Tile, flats: &[Flat]) = blend_body
}

#[inline(always)]
fn blend_body<I: Isa>(tile: &mut Tile, flats: &[Flat]) {
    for (i, flat) in flats.iter().enumerate() {
        if i % LOOK_EVERY == LOOK_EVERY - 1 && tile.is_opaque() {
            return;
        }
        add::<I>(tile, flat);
    }
}

#[inline(always)]
fn add<I: Isa>(tile: &mut Tile, flat: &Flat) {
    let [xx, xy, yy] = flat.conic;
    let x = tile.left as f32 + 0.5 - flat.center.x;
    // `-q / 2 = along + dy across - yy dy² / 2` of a row.
    let mut along = [0.0; TILE];
    let mut across = [0.0; TILE];
    for i in 0..TILE {
        let dx = x + i as f32;
        along[i] = -0.5 * xx * dx * dx;
        across[i] = -xy * dx;
    }
    let first = usize::from(flat.rows[0]).max(tile.top) - tile.top;
    let last = (usize::from(flat.rows[1]) - tile.top).min(TILE - 1);
    for row in first..=last {
        let dy = (tile.top + row) as f32 + 0.5 - flat.center.y;
        let rest = -0.5 * yy * dy * dy;
        let transmittance = &mut tile.transmittance[row];
        let mut share = [0.0; TILE];
        for i in 0..TILE {
            let exponent = fma::<I>(across[i], dy, along[i] + rest);
            let alpha = (flat.opacity * math::exp::<I>(exponent)).min(MAX_ALPHA);
            let alpha = if alpha < MIN_ALPHA { 0.0 } else { alpha };
            share[i] = alpha * transmittance[i];
            transmittance[i] -= share[i];
        }
        for (plane, color) in tile.srgb.iter_mut().zip(flat.srgb) {
            for (sum, share) in plane[row].iter_mut().zip(share) {
                *sum = fma::<I>(share, color, *sum);
            }
        }
        for (sum, share) in tile.depth[row].iter_mut().zip(share) {
            *sum = fma::<I>(share, flat.depth, *sum);
        }
    }
}
