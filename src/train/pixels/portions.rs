//! In what portions the object's pixels are traced: some before the first step, the others while training draws.

use super::pixel_set::PixelSet;
use crate::geometry::Camera;
use crate::train::random::SlotRandom;

/// Side of the square tiles whose pixels are traced together, in pixels: neighbours share rays, and pixels that have their
/// chroma in common stay together.
const TILE: usize = 8;
/// Object pixels of a portion, about: a tenth of a second for two cores.
const PORTION: usize = 50_000;
/// Most portions: each goes through all photos.
const MOST_PORTIONS: usize = 64;

/// A photo: its index among the training views and its size, pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Photo {
    pub(super) view: usize,
    pub(super) size: [u32; 2],
}

impl Photo {
    pub(super) fn of(view: usize, camera: &Camera) -> Self {
        Self {
            view,
            size: [camera.width, camera.height],
        }
    }
}

/// A random share of the tiles of all photos, cut into portions of about as many pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Portions {
    seed: u64,
    keep: f32,
    n: usize,
}

impl Portions {
    /// A share `keep` of the tiles, another for each `seed`, uncut.
    pub(super) fn whole(seed: u64, keep: f32) -> Self {
        Self { seed, keep, n: 1 }
    }

    /// The same tiles, of `n_pixels` object pixels, in portions.
    pub(super) fn cut(self, n_pixels: usize) -> Self {
        Self {
            n: n_pixels.div_ceil(PORTION).clamp(1, MOST_PORTIONS),
            ..self
        }
    }

    /// Number of portions.
    pub(super) fn len(self) -> usize {
        self.n
    }

    /// The pixels that are in any portion, of those of a photo that are `wanted`.
    pub(super) fn all(self, photo: Photo, wanted: impl Fn(usize) -> bool) -> PixelSet {
        self.pixels(photo, |portion| portion.is_some(), wanted)
    }

    /// Those that are in the `k`-th portion.
    pub(super) fn nth(self, k: usize, photo: Photo, wanted: &PixelSet) -> PixelSet {
        let is_it = |portion| portion == Some(k);
        self.pixels(photo, is_it, |i| wanted.contains(i as u32))
    }

    /// The pixels of the tiles whose portion `is_it`.
    fn pixels(
        self,
        photo: Photo,
        is_it: impl Fn(Option<usize>) -> bool,
        wanted: impl Fn(usize) -> bool,
    ) -> PixelSet {
        let [width, height] = photo.size.map(|n| n as usize);
        let columns = width.div_ceil(TILE);
        let tiles = 0..columns * height.div_ceil(TILE);
        let tiles: Vec<bool> = tiles
            .map(|tile| is_it(self.portion(photo.view, tile)))
            .collect();
        PixelSet::new(width * height, |i| {
            tiles[i / width / TILE * columns + i % width / TILE] && wanted(i)
        })
    }

    /// The portion of a tile; `None` where it is not kept.
    fn portion(self, view: usize, tile: usize) -> Option<usize> {
        let at = SlotRandom::new(self.seed, view as u64, tile as u64).uniform();
        (at < self.keep).then(|| ((at / self.keep * self.n as f32) as usize).min(self.n - 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn portions_are_about_as_large_and_together_all_that_is_kept() {
        let photo = Photo {
            view: 3,
            size: [180, 140],
        };
        let portions = Portions {
            n: 5,
            ..Portions::whole(1, 0.5)
        };
        let wanted = |i: usize| i % 180 < 120;
        let all = portions.all(photo, wanted);
        let share = all.len() as f32 / (120.0 * 140.0);
        assert!((0.4..0.6).contains(&share), "{share}");
        let each: Vec<PixelSet> = (0..5).map(|k| portions.nth(k, photo, &all)).collect();
        for i in 0..180 * 140 {
            let pixel = i as u32;
            let n = each.iter().filter(|set| set.contains(pixel)).count();
            assert_eq!(n, usize::from(all.contains(pixel)), "pixel {i}");
            // Its tile's first pixel has the same fate.
            let first = i / 180 / TILE * TILE * 180 + i % 180 / TILE * TILE;
            let is_kept = all.contains(first as u32);
            assert_eq!(is_kept && wanted(i), all.contains(pixel), "pixel {i}");
        }
        assert!(each.iter().all(|set| set.len() > all.len() / 10));
        let other = Portions {
            seed: 2,
            ..portions
        };
        assert!(other.all(photo, wanted) != all, "another choice");
    }

    #[test]
    fn small_objects_are_one_portion_and_large_ones_many_but_not_too_many() {
        let n = |n_pixels| Portions::whole(1, 1.0).cut(n_pixels).len();
        assert_eq!([0, 1, 50_000, 50_001].map(n), [1, 1, 1, 2]);
        assert_eq!([1_000_000, 100_000_000].map(n), [20, MOST_PORTIONS]);
    }
}
