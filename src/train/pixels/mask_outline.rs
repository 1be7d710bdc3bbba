//! The outline of a mask, to a fraction of a pixel, and distances to it.

use glam::Vec2;

use crate::data::Mask;
use crate::train::statistics::{mean_121, with_neighbours};

/// A mask of values between nothing and all at fewer of its edge pixels than this share is taken as
/// cut hard; its outline is a staircase that must be smoothed.
const SOFT_SHARE: f32 = 0.3;
/// Where distances end, pixels.
const FAR_PX: f32 = 1e4;

/// A piece of an outline, in pixels.
type Piece = [Vec2; 2];

/// Where a mask says that the object ends in the picture.
#[derive(Debug)]
pub(in crate::train) struct MaskOutline {
    /// Columns and rows.
    pub(in crate::train) size: [usize; 2],
    /// Middles of the outline's pieces, about one a pixel, in pixels. Where the picture ends the
    /// object is cut, and there is no outline.
    pub(in crate::train) middles: Vec<Vec2>,
    /// `[height * width]` distance of each pixel's centre to the outline in pixels, positive on
    /// the object; cut at [`FAR_PX`], or where they were asked for no further, either way.
    pub(in crate::train) distance: Vec<f32>,
}

impl MaskOutline {
    /// With distances up to `reach` pixels; a few take a tenth of the time of an infinite one. `None` where the mask shows nothing
    /// of the object's edge.
    pub(in crate::train) fn new(mask: &Mask, reach: f32) -> Option<Self> {
        let soft = softened(mask);
        let (width, height) = (mask.width as usize, mask.height as usize);
        let pieces = outline_pieces(&soft, width, height);
        if pieces.is_empty() {
            return None;
        }
        let mut distance = if reach.is_finite() {
            distances_near([width, height], &pieces, reach)
        } else {
            distances([width, height], &pieces)
        };
        for (distance, soft) in distance.iter_mut().zip(&soft) {
            *distance *= if *soft > 0.5 { 1.0 } else { -1.0 };
        }
        Some(Self {
            size: [width, height],
            middles: pieces.iter().map(|[a, b]| 0.5 * (*a + *b)).collect(),
            distance,
        })
    }

    /// The distance at a place in pixels; that of the border beyond it.
    pub(in crate::train) fn distance_at(&self, at: Vec2) -> f32 {
        let [width, height] = self.size;
        let axis = |at: f32, n: usize| {
            let at = (at - 0.5).clamp(0.0, (n - 1) as f32);
            let first = (at as usize).min(n.saturating_sub(2));
            (first, at - first as f32)
        };
        let ((x, u), (y, v)) = (axis(at.x, width), axis(at.y, height));
        let next_row = if height > 1 { width } else { 0 };
        let next = usize::from(width > 1);
        let i = y * width + x;
        let at = |i: usize| self.distance[i];
        let top = at(i) + u * (at(i + next) - at(i));
        let low = at(i + next_row) + u * (at(i + next_row + next) - at(i + next_row));
        top + v * (low - top)
    }
}

/// Coverage 0..1, blurred a little where the mask has hard steps.
fn softened(mask: &Mask) -> Vec<f32> {
    let (width, height) = (mask.width as usize, mask.height as usize);
    let share: Vec<f32> = (0..width * height).map(|i| mask.share(i)).collect();
    let is_edge = |i: usize, j: usize| mask.is_object(i) != mask.is_object(j);
    let (mut n_edges, mut n_soft) = (0, 0);
    for y in 0..height {
        for x in 1..width {
            let i = y * width + x;
            if is_edge(i - 1, i) {
                n_edges += 1;
                let is_between = |v: f32| v > 0.02 && v < 0.98;
                n_soft += usize::from(is_between(share[i]) || is_between(share[i - 1]));
            }
        }
    }
    if n_soft as f32 >= SOFT_SHARE * n_edges as f32 {
        return share;
    }
    let blurred = |source: &[f32]| blurred_121(source, width, height);
    blurred(&blurred(&share))
}

/// Blurred by 1, 2, 1 along both axes.
fn blurred_121(source: &[f32], width: usize, height: usize) -> Vec<f32> {
    let across = with_neighbours(source, (width, 1), mean_121);
    with_neighbours(&across, (height, width), mean_121)
}

/// Marching squares at half coverage between the pixels' centres.
fn outline_pieces(soft: &[f32], width: usize, height: usize) -> Vec<Piece> {
    let mut pieces = Vec::new();
    for y in 0..height.saturating_sub(1) {
        for x in 0..width.saturating_sub(1) {
            let i = y * width + x;
            // Around the square: top left, top right, bottom right, bottom left.
            let corners = [i, i + 1, i + width + 1, i + width];
            let places = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
            let values = corners.map(|i| soft[i] - 0.5);
            let n_inside = values.iter().filter(|value| **value > 0.0).count();
            if n_inside % 4 == 0 {
                continue;
            }
            let mut crossings = Vec::with_capacity(4);
            for a in 0..4 {
                let b = (a + 1) % 4;
                if (values[a] > 0.0) != (values[b] > 0.0) {
                    let t = values[a] / (values[a] - values[b]);
                    let (p, q) = (Vec2::from(places[a]), Vec2::from(places[b]));
                    crossings.push(Vec2::new(x as f32 + 0.5, y as f32 + 0.5) + p.lerp(q, t));
                }
            }
            pieces.extend(crossings.as_chunks::<2>().0);
        }
    }
    pieces
}

/// `[height * width]` distances of the pixels' centres from the nearest piece, no larger than `reach`.
fn distances_near([width, height]: [usize; 2], pieces: &[Piece], reach: f32) -> Vec<f32> {
    let mut distance = vec![reach; width * height];
    for piece in pieces {
        let middle = 0.5 * (piece[0] + piece[1]) - 0.5;
        let around = |at: f32, n: usize| {
            let first = (at - reach).ceil().max(0.0) as usize;
            first..n.min((at + reach + 1.0).max(0.0) as usize)
        };
        for y in around(middle.y, height) {
            for x in around(middle.x, width) {
                let centre = Vec2::new(x as f32, y as f32) + 0.5;
                let distance = &mut distance[y * width + x];
                *distance = distance.min(distance_to_piece(centre, *piece));
            }
        }
    }
    distance
}

/// The same without an end, by carrying the nearest piece from neighbour to neighbour, forth and back.
fn distances([width, height]: [usize; 2], pieces: &[Piece]) -> Vec<f32> {
    const NONE: u32 = u32::MAX;
    /// The pixels around one, column and row.
    const AROUND: [(isize, isize); 8] = [
        (-1, 0),
        (-1, -1),
        (0, -1),
        (1, -1),
        (1, 0),
        (1, 1),
        (0, 1),
        (-1, 1),
    ];
    let mut nearest = vec![NONE; width * height];
    let mut distance = vec![FAR_PX; width * height];
    let offer = |i: usize, piece: u32, nearest: &mut [u32], distance: &mut [f32]| {
        let centre = Vec2::new((i % width) as f32, (i / width) as f32) + 0.5;
        let d = distance_to_piece(centre, pieces[piece as usize]);
        if d < distance[i] {
            distance[i] = d;
            nearest[i] = piece;
        }
    };
    for (index, [a, b]) in pieces.iter().enumerate() {
        let middle = 0.5 * (*a + *b) - 0.5;
        let (x, y) = (middle.x as usize, middle.y as usize);
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let (x, y) = ((x + dx).min(width - 1), (y + dy).min(height - 1));
            offer(y * width + x, index as u32, &mut nearest, &mut distance);
        }
    }
    let n = width * height;
    let forth_and_back = || (0..n).chain((0..n).rev());
    for i in forth_and_back().chain(forth_and_back()) {
        for (dx, dy) in AROUND {
            let x = (i % width).wrapping_add_signed(dx);
            let y = (i / width).wrapping_add_signed(dy);
            let piece = if x < width && y < height {
                nearest[y * width + x]
            } else {
                NONE
            };
            if piece != NONE {
                offer(i, piece, &mut nearest, &mut distance);
            }
        }
    }
    distance
}

fn distance_to_piece(p: Vec2, [a, b]: Piece) -> f32 {
    let along = b - a;
    let t = (p - a).dot(along) / along.length_squared().max(f32::MIN_POSITIVE);
    p.distance(a + t.clamp(0.0, 1.0) * along)
}
