//! A camera's smooth way through key views: Catmull-Rom splines over time, of rotations too.
//!
//! The spline is evaluated as a pyramid of straight mixes (Barry and Goldman, 1988), which holds for uneven times.
//! Rotations are mixed as quaternions of one sign and then normalised: unlike spherical mixes, which take the shorter way
//! round, that never jumps where the spline overshoots. Two key views give a straight way.

use glam::{Affine3A, Quat, Vec3, Vec4};

use super::film::Shot;
use crate::data::KeyView;
use crate::geometry::{Camera, Distortion};
use crate::neif::EnvironmentTransform;

/// Why key views make no path.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CameraPathError {
    /// A way needs two ends.
    #[error("a camera path needs at least two key views, and there are {0}")]
    TooFew(usize),
    /// Times must rise.
    #[error("key view {later} is at {at_secs} s, not after the one before it")]
    Times {
        /// Which, counted from 1.
        later: usize,
        /// Its time, seconds.
        at_secs: f64,
    },
}

/// A camera's way.
#[derive(Clone, Debug)]
pub struct CameraPath {
    first: Camera,
    keys: Vec<Key>,
}

/// What is mixed of a key view.
#[derive(Clone, Copy, Debug)]
struct Key {
    time_secs: f64,
    position: Vec3,
    /// A quaternion; not normalised between key views.
    rotation: Vec4,
    /// Logarithms of the focal lengths, which must stay positive, and the principal point.
    lens: Vec4,
}

impl CameraPath {
    /// The way through key views, as pictures of one size.
    ///
    /// # Errors
    /// With fewer than two key views, and where their times do not rise.
    pub fn new(keys: &[KeyView], width: u32, height: u32) -> Result<Self, CameraPathError> {
        let Some(first) = keys.first().filter(|_| keys.len() > 1) else {
            return Err(CameraPathError::TooFew(keys.len()));
        };
        for (i, pair) in keys.windows(2).enumerate() {
            let [before, at_secs] = [pair[0].time_secs, pair[1].time_secs];
            // Written so that NaN is refused as well.
            if !(before < at_secs && at_secs.is_finite()) {
                let later = i + 2;
                return Err(CameraPathError::Times { later, at_secs });
            }
        }
        let first = first.camera.fitted(width, height);
        let has_one_lens = keys
            .iter()
            .all(|key| key.camera.distortion == first.distortion);
        let distortion = if has_one_lens {
            first.distortion
        } else {
            Distortion::default()
        };
        let mut keys: Vec<Key> = keys
            .iter()
            .map(|key| Key::new(key, width, height))
            .collect();
        for i in 1..keys.len() {
            // Both signs are the same rotation; the nearer one is the shorter way.
            if keys[i].rotation.dot(keys[i - 1].rotation) < 0.0 {
                keys[i].rotation = -keys[i].rotation;
            }
        }
        let first = Camera {
            distortion,
            ..first
        };
        Ok(Self { first, keys })
    }

    /// From the first key view to the last, seconds.
    pub fn duration_secs(&self) -> f64 {
        let last = self.keys.last().map_or(0.0, |key| key.time_secs);
        last - self.keys[0].time_secs
    }

    /// `n` cameras at equal times, from the first key view to the last.
    pub fn cameras(&self, n: u32) -> Vec<Camera> {
        let start = self.keys[0].time_secs;
        let step = self.duration_secs() / f64::from(n.max(2) - 1);
        (0..n)
            .map(|i| self.camera_at(start + f64::from(i) * step))
            .collect()
    }

    /// `n` pictures at equal times, the environment standing at `transform`.
    pub fn shots(&self, transform: &EnvironmentTransform, n: u32) -> Vec<Shot> {
        let shot = |(i, camera)| Shot {
            name: format!("path_{i:04}"),
            camera,
            transform: *transform,
        };
        self.cameras(n).into_iter().enumerate().map(shot).collect()
    }

    /// The camera at a time, seconds; before the first and after the last key view, theirs.
    pub fn camera_at(&self, time_secs: f64) -> Camera {
        let last = self.keys.len() - 1;
        let time = time_secs.clamp(self.keys[0].time_secs, self.keys[last].time_secs);
        let i = self.keys[1..last].partition_point(|key| key.time_secs <= time);
        let (from, to) = (self.keys[i], self.keys[i + 1]);
        // Beyond its ends the way goes on straight.
        let before = match i.checked_sub(1) {
            Some(before) => self.keys[before],
            None => mix(&from, &to, 2.0 * from.time_secs - to.time_secs),
        };
        let after = match self.keys.get(i + 2) {
            Some(after) => *after,
            None => mix(&from, &to, 2.0 * to.time_secs - from.time_secs),
        };
        let a = [(before, from), (from, to), (to, after)].map(|(a, b)| mix(&a, &b, time));
        let b = [
            between(&a[0], &a[1], (before.time_secs, to.time_secs), time),
            between(&a[1], &a[2], (from.time_secs, after.time_secs), time),
        ];
        let key = between(&b[0], &b[1], (from.time_secs, to.time_secs), time);
        key.camera(&self.first)
    }
}

/// The straight way between two keys at a time, which may lie beyond them.
fn mix(a: &Key, b: &Key, time: f64) -> Key {
    between(a, b, (a.time_secs, b.time_secs), time)
}

/// The straight way from `a` at the first of two times to `b` at the second.
fn between(a: &Key, b: &Key, (start, end): (f64, f64), time: f64) -> Key {
    let s = ((time - start) / (end - start)) as f32;
    Key {
        time_secs: time,
        position: a.position.lerp(b.position, s),
        rotation: a.rotation.lerp(b.rotation, s),
        lens: a.lens.lerp(b.lens, s),
    }
}

impl Key {
    fn new(key: &KeyView, width: u32, height: u32) -> Self {
        let camera = key.camera.fitted(width, height);
        let rotation = Quat::from_mat3a(&camera.world_from_camera.matrix3);
        Self {
            time_secs: key.time_secs,
            position: camera.position(),
            rotation: rotation.normalize().into(),
            lens: Vec4::new(camera.fx.ln(), camera.fy.ln(), camera.cx, camera.cy),
        }
    }

    fn camera(&self, like: &Camera) -> Camera {
        // Opposite rotations have no middle: any will do there.
        let rotation = self.rotation.try_normalize().unwrap_or(Vec4::W);
        Camera {
            fx: self.lens.x.exp(),
            fy: self.lens.y.exp(),
            cx: self.lens.z,
            cy: self.lens.w,
            world_from_camera: Affine3A::from_rotation_translation(
                Quat::from_vec4(rotation),
                self.position,
            ),
            ..*like
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(eye: Vec3, fov: f32, time_secs: f64) -> KeyView {
        let camera = Camera::look_at(eye, Vec3::ZERO, Vec3::Z, fov, 64, 48);
        KeyView { camera, time_secs }
    }

    fn keys() -> Vec<KeyView> {
        vec![
            key(Vec3::new(4.0, 0.0, 1.0), 0.8, 1.0),
            key(Vec3::new(0.0, 5.0, 2.0), 0.5, 2.0),
            key(Vec3::new(-4.0, 0.0, 0.5), 0.9, 5.0),
            key(Vec3::new(0.0, -3.0, 1.0), 0.8, 5.5),
        ]
    }

    fn apart(a: &Camera, b: &Camera) -> f32 {
        let (a, b) = (a.ray(3.0, 40.0), b.ray(3.0, 40.0));
        (a.origin - b.origin).length() + (a.direction - b.direction).length()
    }

    #[test]
    fn the_way_passes_through_every_key_view_at_its_time() {
        let path = CameraPath::new(&keys(), 64, 48).unwrap();
        for key in keys() {
            let off = apart(&path.camera_at(key.time_secs), &key.camera);
            assert!(off < 1e-4, "{off} at {} s", key.time_secs);
        }
        let cameras = path.cameras(10);
        assert!(apart(&cameras[0], &keys()[0].camera) < 1e-4, "begins");
        assert!(apart(&cameras[9], &keys()[3].camera) < 1e-4, "ends");
    }

    #[test]
    fn the_way_is_smooth_and_finite() {
        let path = CameraPath::new(&keys(), 64, 48).unwrap();
        let h = 1e-3;
        let speed = |t: f64| apart(&path.camera_at(t), &path.camera_at(t + h)) / h as f32;
        for key in &keys()[1..3] {
            let (before, after) = (speed(key.time_secs - h), speed(key.time_secs));
            assert!(
                (before - after).abs() < 0.05 * before + 0.05,
                "a jolt at {} s: {before} to {after}",
                key.time_secs
            );
        }
        for camera in path.cameras(200) {
            assert!(camera.world_from_camera.is_finite() && camera.fx > 0.0);
        }
    }

    #[test]
    fn two_key_views_give_an_even_way() {
        let path = CameraPath::new(&keys()[..2], 64, 48).unwrap();
        let middle = path.camera_at(1.5);
        let mean = 0.5 * (keys()[0].camera.position() + keys()[1].camera.position());
        assert!((middle.position() - mean).length() < 1e-5);
        let angle = |a: &Camera| a.forward().angle_between(keys()[0].camera.forward());
        let half = 0.5 * angle(&keys()[1].camera);
        assert!((angle(&middle) - half).abs() < 0.05, "half of the turn");
    }

    #[test]
    fn what_makes_no_path_is_refused() {
        let too_few = CameraPath::new(&keys()[..1], 8, 8).unwrap_err();
        assert_eq!(too_few, CameraPathError::TooFew(1));
        let mut keys = keys();
        keys[2].time_secs = 2.0;
        let message = CameraPath::new(&keys, 8, 8).unwrap_err().to_string();
        assert!(message.contains("key view 3"), "{message}");
    }
}
