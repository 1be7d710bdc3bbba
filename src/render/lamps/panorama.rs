//! A panorama whose lamps are as bright as they are estimated: for programs that light the object with it.

use glam::Vec3;
use rayon::prelude::*;

use super::{LOOK, Lamps, Look, WHITE};

/// Most radiance above white that a pixel of a look may see, in what the look sees in the mean.
const SHARPER: f32 = 4.0;
/// Angle between a look and the pixels that belong to it at most, in square roots of its solid angle.
const REACH: f32 = 1.5;
/// How many times as large as from the middle of the environment a look may seem: right beside a lamp its looks are too coarse.
const NEAREST: f32 = 100.0;

/// A pixel of a panorama.
#[derive(Clone, Copy, Debug)]
pub(in crate::render) struct PanoramaPixel {
    /// Unit direction in the environment's world.
    pub(in crate::render) direction: Vec3,
    /// Steradians.
    pub(in crate::render) solid_angle: f32,
}

impl Lamps {
    /// Makes the lamps in the linear radiance `seen` by pixels around the point `at`, in the environment's world, as bright as they
    /// are estimated; `pixel(i)` is the `i`-th one. What a look sees above white is spread over the pixels next to it as they see it;
    /// what no look sees is a speck, and at most twice as bright as white.
    pub(in crate::render) fn show_in(
        &self,
        at: Vec3,
        pixel: impl Fn(usize) -> PanoramaPixel + Sync,
        seen: &mut [[f32; 3]],
    ) {
        let looks = self.looks.iter();
        let looks: Vec<NearLook> = looks.map(|l| NearLook::of(l, at, self.is_far)).collect();
        let nearest = |toward: Vec3| {
            let cosines = looks.iter().map(|look| look.toward.dot(toward)).enumerate();
            let nearest = cosines.max_by(|a, b| a.1.total_cmp(&b.1));
            let near = nearest.filter(|(look, cos)| *cos > looks[*look].rim);
            near.map(|(look, _)| look)
        };
        let bright = seen.par_iter_mut().enumerate().filter_map(|(i, seen)| {
            let radiance = Vec3::from(*seen);
            // What photos show as white stays white.
            let below = self.below(radiance).max(radiance.min(Vec3::splat(WHITE)));
            let excess = radiance - below;
            if excess.element_sum() <= 0.0 {
                return None;
            }
            let look = nearest(pixel(i).direction);
            let kept = look.map_or(excess.min(below), |_| Vec3::ZERO);
            *seen = (below + kept).to_array();
            Some((i, look?, excess.min(SHARPER * looks[look?].learned)))
        });
        let bright: Vec<(usize, usize, Vec3)> = bright.collect();
        let mut sums = vec![Vec3::ZERO; looks.len()];
        for &(i, look, excess) in &bright {
            sums[look] += excess * pixel(i).solid_angle;
        }
        for (i, look, excess) in bright {
            let factor = looks[look].light / sums[look].max(Vec3::splat(f32::MIN_POSITIVE));
            seen[i] = (Vec3::from(seen[i]) + excess * factor).to_array();
        }
    }
}

/// A look as seen from somewhere.
struct NearLook {
    toward: Vec3,
    /// Cosine of the angle within which pixels belong to it.
    rim: f32,
    /// Radiance above white as it was learned.
    learned: Vec3,
    /// What it sends there as estimated, radiance times solid angle.
    light: Vec3,
}

impl NearLook {
    fn of(look: &Look, at: Vec3, is_far: bool) -> Self {
        let to_look = look.place - at;
        let (toward, solid_angle) = if is_far {
            (look.direction, LOOK)
        } else {
            let distance = to_look.length().max(f32::MIN_POSITIVE);
            let nearer = (look.distance / distance).powi(2).min(NEAREST);
            (to_look / distance, LOOK * nearer)
        };
        Self {
            toward,
            rim: (REACH * solid_angle.sqrt()).cos(),
            learned: look.learned,
            light: look.excess * solid_angle,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::PI;

    use super::*;
    use crate::geometry::fibonacci_sphere;
    use crate::render::lamps::tests::{LAMP, RIM, sky};
    use crate::render::test_scene::NEVER;

    #[test]
    fn lamps_are_as_bright_as_they_are_estimated_and_specks_are_not() {
        let toward = Vec3::new(1.0, 2.0, 2.0) / 3.0;
        let learned = Lamps::of(&sky(toward), &NEVER).expect("not cancelled");
        let parts = learned.parts();
        let gain = Vec3::new(4.0, 2.0, 0.5);
        let lamps = learned.gained(&parts, &vec![gain; parts.len()]);
        let directions = fibonacci_sphere(1 << 17);
        let solid_angle = 4.0 * PI / directions.len() as f32;
        let is_lamp = |direction: &Vec3| direction.dot(toward) > RIM;
        let radiance = |direction| [if is_lamp(direction) { LAMP } else { 0.1 }; 3];
        let mut seen: Vec<[f32; 3]> = directions.iter().map(radiance).collect();
        // Within the lamp and far from it.
        for speck in [toward, -toward] {
            let cosines = directions.iter().map(|d| d.dot(speck)).enumerate();
            let (speck, _) = cosines.max_by(|a, b| a.1.total_cmp(&b.1)).expect("pixels");
            seen[speck] = [1e5, 2e5, 3e5];
        }
        let pixel = |i: usize| PanoramaPixel {
            direction: directions[i],
            solid_angle,
        };
        lamps.show_in(Vec3::ZERO, pixel, &mut seen);
        let (mut found, mut most) = (Vec3::ZERO, 0.0_f32);
        for (direction, seen) in directions.iter().zip(&seen) {
            found += Vec3::from(*seen) * solid_angle;
            if !is_lamp(direction) {
                most = most.max(Vec3::from(*seen).max_element());
            }
        }
        let expected = gain * LAMP * 2.0 * PI * (1.0 - RIM) + Vec3::splat(0.1 * 4.0 * PI);
        let off = (found / expected - 1.0).abs().max_element();
        assert!(off < 0.1, "{found}, not {expected}");
        assert!(
            most <= 2.0 * learned.white.max(WHITE),
            "{most} where there is no lamp"
        );
    }
}
