//! Keeps of what a reader finds the Gaussians that can be drawn.

use std::path::Path;

use glam::{Quat, Vec3, Vec4};

use super::{Splat, Splats};
use crate::data::DataError;

/// Coordinates and coefficients from here on are damage; the squares of their products would overflow.
const TOO_LARGE: f32 = 1e9;
/// Range of standard deviations, scene units: what underflows would leave a covariance without an inverse.
const SCALES: [f32; 2] = [1e-9, TOO_LARGE];

/// Gaussians of a file as they are read.
#[derive(Debug)]
pub(super) struct Collector {
    splats: Splats,
    n_read: usize,
}

impl Collector {
    /// For `n` Gaussians, which the file must be long enough for, with `(degree + 1)²` coefficients each.
    pub(super) fn new(n: usize, degree: usize) -> Self {
        Self {
            splats: Splats {
                splats: Vec::with_capacity(n),
                degree,
                harmonics: Vec::with_capacity(n * (degree + 1).pow(2)),
                is_antialiased: false,
            },
            n_read: 0,
        }
    }

    /// Keeps a Gaussian whose numbers are finite, and drops any other. Its rotation need not be unit (none at all where it is
    /// zero), its opacity and scale become what is drawable.
    pub(super) fn push(&mut self, splat: Splat, harmonics: &[[f32; 3]]) {
        self.n_read += 1;
        let length = splat.rotation.length();
        let numbers = splat.center.to_array().into_iter().chain([length]);
        let is_usable = numbers
            .chain(harmonics.iter().flatten().copied())
            .all(|number| number.abs() < TOO_LARGE);
        if !is_usable || splat.scale.is_nan() || splat.opacity.is_nan() {
            return;
        }
        let rotation = if length > 0.0 {
            Quat::from_vec4(Vec4::from(splat.rotation) / length)
        } else {
            Quat::IDENTITY
        };
        let [least, most] = SCALES.map(Vec3::splat);
        self.splats.splats.push(Splat {
            center: splat.center,
            scale: splat.scale.clamp(least, most),
            rotation,
            opacity: splat.opacity.clamp(0.0, 1.0),
        });
        self.splats.harmonics.extend_from_slice(harmonics);
    }

    /// What was kept; an error where nothing was.
    pub(super) fn finish(self, path: &Path, is_antialiased: bool) -> Result<Splats, DataError> {
        if self.splats.splats.is_empty() {
            let problem = match self.n_read {
                0 => "holds no Gaussians".to_owned(),
                n => format!("none of its {n} Gaussians has finite numbers"),
            };
            return Err(DataError::unusable(path, problem));
        }
        Ok(Splats {
            is_antialiased,
            ..self.splats
        }
        .trimmed())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn splat() -> Splat {
        Splat {
            center: Vec3::new(1.0, 2.0, 3.0),
            scale: Vec3::new(0.1, 0.2, 0.3),
            rotation: Quat::from_xyzw(0.0, 0.0, 0.0, 2.0),
            opacity: 0.5,
        }
    }

    /// What becomes of one Gaussian.
    fn collected(splat: Splat, harmonic: f32) -> Option<Splat> {
        let mut found = Collector::new(1, 0);
        found.push(splat, &[[0.0, 0.0, harmonic]]);
        let splats = found.finish(Path::new("a.ply"), false).ok()?;
        assert_eq!(splats.harmonics.len(), 1);
        Some(splats.splats[0])
    }

    #[test]
    fn gaussians_without_finite_numbers_are_dropped() {
        assert!(collected(splat(), 0.0).is_some());
        for bad in [f32::NAN, f32::INFINITY, -f32::INFINITY, 1e30] {
            assert_eq!(collected(splat(), bad), None, "harmonic {bad}");
            let center = Vec3::new(0.0, bad, 0.0);
            assert_eq!(collected(Splat { center, ..splat() }, 0.0), None);
            let rotation = Quat::from_xyzw(0.0, bad, 0.0, 1.0);
            assert_eq!(
                collected(
                    Splat {
                        rotation,
                        ..splat()
                    },
                    0.0
                ),
                None
            );
        }
        let opacity = f32::NAN;
        assert_eq!(collected(Splat { opacity, ..splat() }, 0.0), None);
        let scale = Vec3::new(1.0, f32::NAN, 1.0);
        assert_eq!(collected(Splat { scale, ..splat() }, 0.0), None);
        let message = Collector::new(0, 0).finish(Path::new("a.ply"), false);
        assert!(message.unwrap_err().to_string().contains("a.ply"));
    }

    #[test]
    fn scales_opacities_and_rotations_become_drawable() {
        let odd = Splat {
            scale: Vec3::new(f32::INFINITY, 0.0, -1.0),
            rotation: Quat::from_xyzw(0.0, 0.0, 0.0, 0.0),
            opacity: 1.5,
            ..splat()
        };
        let found = collected(odd, 0.0).unwrap();
        assert_eq!(found.scale, Vec3::new(SCALES[1], SCALES[0], SCALES[0]));
        assert_eq!((found.rotation, found.opacity), (Quat::IDENTITY, 1.0));
        let found = collected(splat(), 0.0).unwrap();
        assert!(found.rotation.is_normalized(), "{}", found.rotation);
    }
}
