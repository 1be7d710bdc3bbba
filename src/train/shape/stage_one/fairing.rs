//! The fairest surface that has the given outlines: signed distances on a grid, pulled onto the
//! rays that graze the object and bent as evenly as possible between them, without letting go of what rays
//! within the outlines meet. Where depth maps saw the surface it stays, less their noise.
//!
//! Each round finds where every grazing ray comes nearest to the surface and solves the linear
//! least squares `sum w (phi(x))^2 + evenness sum c (L phi(i) - L phi(j))^2 + stiffness sum (L phi)^2`,
//! over neighbours `i` and `j`, for the change of `phi`, with a one-sided term that keeps `phi` above the
//! distance to the hull, one that pulls it to the distances of the depth maps, and one that pulls its slope to the normals that
//! photos ask for ([`super::slopes`]). `L phi` is the surface's curvature: where it is bent, it shall go on bending as
//! it does beside (the surfaces of least variation of curvature of Moreton and Séquin 1992, of which
//! spheres and cylinders are some), rather than be as little bent as can be, which fills the gap between
//! two balls with a neck and ripples between the outlines. The weights `c` are those of a Cauchy loss, so
//! that a crease may be as sharp as the outlines are sure. Where these err, the weights are those of a smoothed curvature, as
//! in the diffusion of Catté, Lions, Morel and Coll 1992: a crease is a line, and noise that passes for creases would tear thin
//! parts and rims to crumbs.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::band::{Band, add_scaled, dot};
use super::depths::fusion::Seen;
use super::silhouette::Silhouette;
use super::slopes::{Normals, Slopes};
use crate::geometry::{Ray, ScalarGrid};
use crate::train::statistics::cauchy_weight;

/// Cells on either side of the surface that move with it.
pub(super) const BAND: f32 = 3.5;
/// Cells on either side to which distances are kept.
pub(super) const REACH: f32 = 6.0;
/// Least distance in cells at which a condition's weight has fallen to a half: what is further off belongs to another surface.
const LEAST_SCALE: f32 = 1.0;
/// Least difference of curvature between neighbours, a cell, whose weight is a half, however sure the outlines are.
const LEAST_CREASE: f32 = 0.04;
/// Standard deviation in cells of outlines that are as sure as can be; others weigh less by the ratio of the variances.
const LEAST_ERROR: f32 = 0.11;
/// Mean distance of rays from the true surface, in standard deviations of their outlines' error.
const MEAN_ERROR: f32 = 0.8;
/// Share of the outlines' error that the surface follows, however even it is.
const FOLLOWED_ERROR: f32 = 0.15;
/// Cells below the surface that a ray within an outline reaches at least. A sheet two cells thick bends in no even way, and
/// would dissolve between its rims.
const LEAST_DEPTH: f32 = 0.3;
/// Cells from the surface up to which what depth maps say is a distance; further off it is free or hidden.
const NEAR_SEEN: f32 = 2.0;

/// Difference of curvature between neighbours, a cell, whose weight is a half, over the mean distance of the rays from the
/// surface, beyond what their error explains, or the depth maps' noise: outlines that err would rip it.
const CREASE: f32 = 1.5;

/// Weights beside that of a ray and of the curvature's differences between neighbours, in cells, where outlines are sure: of the
/// curvature itself, of what depth maps say, of the hull, and of staying put, which keeps a round's changes where they are linear.
const STIFFNESS: f32 = 0.01;
const SEEN: f32 = 0.3;
const HULL: f32 = 0.3;
const INERTIA: f32 = 0.02;

/// Steps of conjugate gradients.
const SOLVER_STEPS: usize = 160;
/// Steps along a ray.
const MAX_STEPS: usize = 2048;

/// What is taken for the outlines' error and not for the surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fairing {
    /// Rounds by which the curvature is smoothed where creases are looked for, over the squared error of the outlines in cells.
    smoothing: f32,
    /// Distance in standard deviations of the outlines at which a ray's weight has fallen to a half, if that is further off
    /// than [`LEAST_SCALE`].
    scale: f32,
}

impl Fairing {
    /// Outlines that err leave no creases where there are none.
    pub(super) const SMOOTHED: Self = Self {
        smoothing: 6.0,
        scale: 4.0,
    };
    /// Creases may be a cell wide, which no smoothing leaves: necks open along them.
    pub(super) const UNSMOOTHED: Self = Self {
        smoothing: 0.0,
        scale: 0.0,
    };
}

/// What a surface must agree with.
#[derive(Debug)]
pub(super) struct Evidence {
    /// Distances to the hull, at the same nodes as the surface's.
    pub(super) hull: ScalarGrid,
    /// The outlines.
    pub(super) silhouettes: Vec<Silhouette>,
    /// Standard deviation of the outlines' error, cells.
    pub(super) outline_error: f32,
    /// What depth maps say, where there are any.
    pub(super) seen: Option<Seen>,
    /// What photos say of normals, at the same nodes.
    pub(super) normals: Normals,
}

/// A linear condition: a weighted sum of values around a point should be zero.
#[derive(Clone, Copy, Debug)]
struct Condition {
    slots: [u32; 8],
    weights: [f32; 8],
    weight: f32,
    /// The value there now, in cells, less what it should be.
    value: f32,
}

/// One round. Returns the mean distance of the rays from the surface, in cells.
pub(super) fn round(phi: &mut ScalarGrid, evidence: &Evidence, fairing: Fairing) -> f32 {
    let silhouettes = &evidence.silhouettes;
    let band = Band::new(phi, BAND);
    let error = evidence.outline_error;
    let scale = LEAST_SCALE.max(fairing.scale * error);
    let every = |rays: fn(&Silhouette) -> &[Vec2], depth: f32, enough: f32| -> Vec<Condition> {
        let rays = silhouettes
            .par_iter()
            .flat_map_iter(|silhouette| rays(silhouette).iter().map(|at| silhouette.ray(*at)));
        rays.filter_map(|ray| condition(phi, &band, &ray, (depth, enough), scale))
            .collect()
    };
    let mut conditions = every(|s| &s.outline.middles, 0.0, f32::NEG_INFINITY);
    let sum: f32 = conditions.iter().map(|c| c.value.abs()).sum();
    let residual = sum / conditions.len().max(1) as f32;
    conditions.extend(every(|s| &s.inner, LEAST_DEPTH, -LEAST_DEPTH));
    let seen = evidence.seen.as_ref();
    let noise = seen.map_or(0.0, |seen| seen.noise / phi.cell);
    let unexplained = residual.max(noise) - MEAN_ERROR * error;
    let crease = (CREASE * unexplained)
        .max(FOLLOWED_ERROR * error)
        .max(LEAST_CREASE);
    let n_smoothed = fairing.smoothing * error.powi(2);
    let system = System::new(phi, evidence, &band, &conditions, (crease, n_smoothed));
    let change = system.solve();
    for (slot, node) in band.nodes.iter().enumerate() {
        // A change of more than a cell is beyond what the round knows.
        phi.values[*node as usize] += change[slot].clamp(-1.0, 1.0) * phi.cell;
    }
    phi.redistance(REACH);
    residual
}

/// The condition that a ray should come `depth` cells below the surface and no deeper, if it comes near, at half the weight
/// where it is off by `scale` cells; `None` too for one that goes `enough` cells deep (a negative value, as inside).
fn condition(
    phi: &ScalarGrid,
    band: &Band,
    ray: &Ray,
    (depth, enough): (f32, f32),
    scale: f32,
) -> Option<Condition> {
    let at = nearest_approach(phi, ray, enough * phi.cell)?;
    let corners = phi.corners(at);
    let mut slots = [0; 8];
    for (slot, node) in slots.iter_mut().zip(corners.nodes) {
        *slot = band.slot(node)? as u32;
    }
    let terms = corners.nodes.iter().zip(corners.weights);
    let value: f32 = terms
        .map(|(node, weight)| weight * phi.values[*node] / phi.cell)
        .sum();
    let value = value + depth;
    Some(Condition {
        slots,
        weights: corners.weights,
        weight: cauchy_weight(value, scale),
        value,
    })
}

/// Where along the ray the value is least; `None` for rays that miss the grid, and where it falls to `enough`.
pub(super) fn nearest_approach(phi: &ScalarGrid, ray: &Ray, enough: f32) -> Option<Vec3> {
    let (start, end) = phi.bounds().span(ray)?;
    let (mut t, mut best_t, mut best) = (start, start, f32::INFINITY);
    // Bounded, as a step may be lost in the rounding of a far camera's distances.
    for _ in 0..MAX_STEPS {
        if t >= end {
            break;
        }
        let value = phi.sample(ray.at(t));
        if value < best {
            (best, best_t) = (value, t);
            if value <= enough {
                return None;
            }
        }
        t += (0.7 * value.abs()).max(0.5 * phi.cell);
    }
    // Closer, by halves.
    if best == f32::INFINITY {
        return None;
    }
    let mut step = 0.5 * phi.cell;
    for _ in 0..5 {
        for t in [best_t - step, best_t + step] {
            let value = phi.sample(ray.at(t));
            if value < best {
                (best, best_t) = (value, t);
            }
        }
        step *= 0.5;
    }
    Some(ray.at(best_t))
}

/// The normal equations of a round, values in cells.
struct System<'a> {
    band: &'a Band,
    conditions: &'a [Condition],
    /// `[n]` weights of the curvature's differences.
    evenness: Vec<[f32; 6]>,
    slopes: Slopes,
    /// `[n]` weight of each node's own term.
    diagonal: Vec<f32>,
    right: Vec<f32>,
}

impl<'a> System<'a> {
    /// `crease`: difference of curvature between neighbours, a cell, whose weight is a half, before the curvature is smoothed by
    /// `n_smoothed` rounds.
    fn new(
        phi: &ScalarGrid,
        evidence: &Evidence,
        band: &'a Band,
        conditions: &'a [Condition],
        (crease, n_smoothed): (f32, f32),
    ) -> Self {
        let value = |node: &u32| phi.values[*node as usize] / phi.cell;
        let values: Vec<f32> = band.nodes.iter().map(value).collect();
        let mut curvature = vec![0.0; band.len()];
        band.laplacian(&values, &mut curvature);
        let smooth = band.smoothed(&curvature, n_smoothed.round() as usize);
        // A difference is the smaller, the more it is smoothed.
        let mut evenness = band.evenness(&smooth, crease / (1.0 + n_smoothed));
        let variances = 1.0 + (evidence.outline_error / LEAST_ERROR).powi(2);
        let asked = evidence.normals.asked_evenness(band);
        for (slot, weights) in evenness.iter_mut().enumerate() {
            for (weight, other) in weights.iter_mut().zip(band.neighbours_of(slot)) {
                let asked = (asked[slot] * other.map_or(0.0, |other| asked[other])).sqrt();
                *weight *= asked * variances;
            }
        }
        let mut right = vec![0.0; band.len()];
        let mut bent = vec![0.0; band.len()];
        band.unevenness(&curvature, &evenness, STIFFNESS, &mut bent);
        band.laplacian_transposed(&bent, -1.0, &mut right);
        let noise = evidence.seen.as_ref().map_or(0.0, |seen| seen.noise);
        // Evenness weighs more where outlines err, which says nothing against the maps.
        let sure_seen = SEEN * variances / (1.0 + (noise / (LEAST_ERROR * phi.cell)).powi(2));
        let mut diagonal = vec![INERTIA; band.len()];
        for (slot, node) in band.nodes.iter().enumerate() {
            let node = *node as usize;
            let mut least = evidence.hull.values[node] / phi.cell;
            if let Some(seen) = &evidence.seen
                && seen.weights[node] > 0.0
            {
                let distance = seen.distances[node] / phi.cell;
                if distance >= NEAR_SEEN {
                    least = least.max(1.0);
                } else if distance > -NEAR_SEEN {
                    let off = distance - values[slot];
                    let sure = seen.weights[node] / (1.0 + seen.weights[node]);
                    let weight = sure_seen * sure / (1.0 + (off / LEAST_SCALE).powi(2));
                    diagonal[slot] += weight;
                    right[slot] += weight * off;
                }
            }
            let missing = least - values[slot];
            if missing > 0.0 {
                diagonal[slot] += HULL;
                right[slot] += HULL * missing.min(1.0);
            }
        }
        let slopes = Slopes::new(band, &evidence.normals, &values);
        slopes.add_missing(&mut right);
        for condition in conditions {
            for (slot, weight) in condition.slots.iter().zip(condition.weights) {
                right[*slot as usize] -= condition.weight * weight * condition.value;
            }
        }
        Self {
            band,
            conditions,
            evenness,
            slopes,
            diagonal,
            right,
        }
    }

    /// `out = A u`; the scratch is as long.
    fn apply(&self, u: &[f32], scratch: &mut [Vec<f32>; 2], out: &mut [f32]) {
        let [curvature, bent] = scratch;
        self.band.laplacian(u, curvature);
        self.band
            .unevenness(curvature, &self.evenness, STIFFNESS, bent);
        self.band.laplacian_transposed(bent, 1.0, out);
        for ((out, u), d) in out.iter_mut().zip(u).zip(&self.diagonal) {
            *out += d * u;
        }
        self.slopes.apply(u, out);
        for condition in self.conditions {
            let terms = condition.slots.iter().zip(condition.weights);
            let value: f32 = terms
                .clone()
                .map(|(slot, weight)| weight * u[*slot as usize])
                .sum();
            for (slot, weight) in terms {
                out[*slot as usize] += condition.weight * weight * value;
            }
        }
    }

    /// Conjugate gradients from zero.
    fn solve(&self) -> Vec<f32> {
        let n = self.band.len();
        let mut u = vec![0.0; n];
        let mut residual = self.right.clone();
        let mut direction = residual.clone();
        let mut scratch = [vec![0.0; n], vec![0.0; n]];
        let mut product = vec![0.0; n];
        let mut energy = dot(&residual, &residual);
        let end = 1e-6 * energy;
        for _ in 0..SOLVER_STEPS {
            if energy <= end {
                break;
            }
            self.apply(&direction, &mut scratch, &mut product);
            let step = energy / dot(&direction, &product).max(f64::MIN_POSITIVE);
            add_scaled(&mut u, step as f32, &direction);
            add_scaled(&mut residual, -step as f32, &product);
            let before = energy;
            energy = dot(&residual, &residual);
            let keep = (energy / before) as f32;
            direction
                .par_iter_mut()
                .zip(&residual)
                .for_each(|(d, r)| *d = r + keep * *d);
        }
        u
    }
}
