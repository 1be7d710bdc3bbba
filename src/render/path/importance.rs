//! Where the light comes from, roughly: which of a lobe's directions are worth a ray.

use std::sync::atomic::AtomicBool;

use glam::Vec3;

use crate::color::luminance;
use crate::render::output::panorama::{PanoramaView, panorama_of};
use crate::render::scene::Scene;

/// Pixels per row of the panoramas.
const WIDTH: u32 = 128;
/// Roughness of their pixels: a lobe about as wide as one, so that a lamp between two is not missed.
const ROUGHNESS: f32 = 0.18;
/// Share of the mean that a direction without light counts as: what the panoramas miss must be found by somebody.
const LEAST: f32 = 0.1;
/// Roughness of lobes within which all directions matter alike, as they are closer together than the panoramas resolve,
/// and from which they matter as the panoramas say.
const TRUSTED: [f32; 2] = [0.05, 0.2];
/// The panoramas' places in the object's bounding ball, in radii: lamps are seen elsewhere from another point.
const PLACES: [Vec3; 5] = [
    Vec3::ZERO,
    Vec3::new(0.4, 0.4, 0.4),
    Vec3::new(0.4, -0.4, -0.4),
    Vec3::new(-0.4, 0.4, -0.4),
    Vec3::new(-0.4, -0.4, 0.4),
];

/// Rough luminance of the environment about an object, by world direction.
#[derive(Clone, Debug)]
pub(in crate::render) struct Importance {
    view: PanoramaView,
    /// `[WIDTH / 2][WIDTH]`, in means, at least [`LEAST`].
    luminance: Vec<f32>,
}

impl Importance {
    /// The environment of `scene` about the ball of `center` and `radius`, world units; `None` when cancelled.
    pub(in crate::render) fn new(
        scene: &Scene,
        (center, radius): (Vec3, f32),
        cancel: &AtomicBool,
    ) -> Option<Self> {
        let mut luminances = vec![0.0; (WIDTH * WIDTH / 2) as usize];
        let view_at = |at| PanoramaView {
            at,
            up: Vec3::Z,
            roughness: ROUGHNESS,
            width: WIDTH,
        };
        for place in PLACES {
            let seen = panorama_of(scene, &view_at(center + radius * place), cancel)?;
            for (sum, pixel) in luminances.iter_mut().zip(seen.pixels) {
                let value = luminance(Vec3::from(pixel));
                *sum += if value.is_finite() {
                    value.max(0.0)
                } else {
                    0.0
                };
            }
        }
        // A black environment is as important everywhere.
        let mean = luminances.iter().sum::<f32>() / luminances.len() as f32;
        for value in &mut luminances {
            *value = *value / mean.max(f32::MIN_POSITIVE) + LEAST;
        }
        Some(Self {
            view: view_at(center),
            luminance: luminances,
        })
    }

    /// How much a ray along a unit world direction matters to a lobe of the given roughness; positive, 1 on average.
    pub(in crate::render) fn of(&self, direction: Vec3, roughness: f32) -> f32 {
        let [sharp, wide] = TRUSTED;
        let trust = ((roughness - sharp) / (wide - sharp)).clamp(0.0, 1.0);
        if trust == 0.0 {
            return 1.0;
        }
        let place = self.view.place(direction);
        let index = |share: f32, n: u32| ((share * n as f32) as u32).min(n - 1);
        let (x, y) = (index(place.x, WIDTH), index(place.y, WIDTH / 2));
        self.luminance[(y * WIDTH + x) as usize].powf(trust)
    }
}

/// Draws `n` of a list in proportion to its positive weights, evenly along it: indices, rising, with how often each.
///
/// `start` in `[0, 1)` is uniform. Each index comes `n weight / sum` times on average (systematic resampling).
pub(super) fn systematic(
    weights: &[f32],
    n: u32,
    start: f32,
) -> impl Iterator<Item = (usize, u32)> {
    let sum: f64 = weights.iter().map(|weight| f64::from(*weight)).sum();
    let step = sum / f64::from(n);
    let (mut passed, mut drawn) = (0.0, 0);
    weights.iter().enumerate().filter_map(move |(i, weight)| {
        passed += f64::from(*weight);
        // Rounding of the sum neither loses the last one nor draws one more.
        let due = ((passed / step - f64::from(start)).ceil().max(0.0) as u32).min(n);
        let times = due - drawn;
        drawn = due;
        (times > 0).then_some((i, times))
    })
}

/// The `i`-th cell, column and row, of Hilbert's curve over a square of `side` cells a side, a power of two: neighbours
/// along it are neighbours in the square.
pub(super) fn hilbert(side: u32, i: u32) -> [u32; 2] {
    let (mut x, mut y, mut rest) = (0, 0, i);
    let mut square = 1;
    while square < side {
        let right = 1 & (rest / 2);
        let up = 1 & (rest ^ right);
        if up == 0 {
            if right == 1 {
                (x, y) = (square - 1 - x, square - 1 - y);
            }
            (x, y) = (y, x);
        }
        x += square * right;
        y += square * up;
        rest /= 4;
        square *= 2;
    }
    [x, y]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::test_scene;

    #[test]
    fn the_curve_visits_every_cell_from_neighbour_to_neighbour() {
        let side = 16;
        let cells: Vec<[u32; 2]> = (0..side * side).map(|i| hilbert(side, i)).collect();
        let steps = cells.windows(2).map(|pair| {
            let [[ax, ay], [bx, by]] = [pair[0], pair[1]];
            ax.abs_diff(bx) + ay.abs_diff(by)
        });
        assert!(steps.clone().all(|step| step == 1), "{cells:?}");
        let mut sorted = cells.clone();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), cells.len(), "each once");
    }

    #[test]
    fn heavy_entries_are_drawn_as_often_as_they_weigh() {
        let weights = [1.0, 0.25, 6.0, 0.5, 0.25];
        let (n, n_starts) = (16, 1000);
        let mut counts = [0; 5];
        for k in 0..n_starts {
            let start = (k as f32 + 0.5) / n_starts as f32;
            let drawn: Vec<(usize, u32)> = systematic(&weights, n, start).collect();
            assert_eq!(drawn.iter().map(|(_, times)| times).sum::<u32>(), n);
            for (i, times) in drawn {
                counts[i] += times;
            }
        }
        for (weight, count) in weights.iter().zip(counts) {
            let expected = n as f32 * weight / 8.0;
            let mean = count as f32 / n_starts as f32;
            assert!((mean - expected).abs() < 0.01, "{mean}, not {expected}");
        }
    }

    #[test]
    fn brighter_directions_count_more() {
        let of_fog = |log| {
            let scene = Scene::new(None, test_scene::fog(log, 2.0));
            Importance::new(&scene, (Vec3::ZERO, 1.0), &test_scene::NEVER).expect("not cancelled")
        };
        let fog = of_fog(0.0);
        let ratio = |roughness| fog.of(Vec3::X, roughness) / fog.of(Vec3::NEG_X, roughness);
        assert!(ratio(0.5) > 1.5, "{}", ratio(0.5));
        assert_eq!(ratio(0.02), 1.0, "a mirror");
        let dark = of_fog(-200.0);
        assert!(dark.of(Vec3::X, 1.0) > 0.0, "still drawn");
    }
}
