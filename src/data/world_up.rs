//! Which way is up in a capture's world, estimated from how the cameras were held.

use glam::{Affine3A, Mat3, Vec3};

/// Cosine of 20 degrees: an axis this near is meant, and the rest is how the photos were taken.
const NEAR_AXIS: f32 = 0.94;
/// Least share of the second smallest spread for the cameras' right-hand directions to determine a plane.
const LEAST_SPREAD: f32 = 0.05;
/// Turns of the power iteration; the spread above makes each gain a factor.
const N_ITERATIONS: usize = 30;

/// The direction that is up, unit: that of a world axis where one is within 20 degrees.
///
/// People hold cameras level: what is common to all views is that their right-hand sides lie in
/// the horizontal plane, even when all look down from one side. Where they do not determine a plane
/// (one view, or cameras held at all angles), the mean of the pictures' up directions is taken.
///
/// `poses`: from camera to world, OpenGL's axes.
pub fn world_up(poses: impl Iterator<Item = Affine3A>) -> Vec3 {
    let poses: Vec<Affine3A> = poses.collect();
    let mean_up: Vec3 = poses
        .iter()
        .map(|pose| unit(pose.matrix3.y_axis.into()))
        .sum();
    let mean_up = mean_up.normalize_or(Vec3::Z);
    let up = plane_normal(&poses)
        .map(|normal| {
            if normal.dot(mean_up) < 0.0 {
                -normal
            } else {
                normal
            }
        })
        // A camera held on its side has its right-hand side up; then the plane misleads.
        .filter(|normal| normal.dot(mean_up) > 0.5)
        .unwrap_or(mean_up);
    let axis = (0..3)
        .max_by(|&a, &b| up[a].abs().total_cmp(&up[b].abs()))
        .unwrap_or(2);
    if up[axis].abs() < NEAR_AXIS {
        return up;
    }
    let mut snapped = Vec3::ZERO;
    snapped[axis] = up[axis].signum();
    snapped
}

/// The normal of the plane that the cameras' right-hand sides lie in, if they determine one.
fn plane_normal(poses: &[Affine3A]) -> Option<Vec3> {
    if poses.is_empty() {
        return None;
    }
    let mut spread = Mat3::ZERO;
    for pose in poses {
        let right = unit(pose.matrix3.x_axis.into());
        spread += Mat3::from_cols(right.x * right, right.y * right, right.z * right);
    }
    spread *= 1.0 / poses.len() as f32;
    // The smallest eigenvector is the largest one of the inverse.
    let inverse = (spread + Mat3::from_diagonal(Vec3::splat(1e-4))).inverse();
    let mut normal = Vec3::new(0.41, 0.53, 0.74);
    for _ in 0..N_ITERATIONS {
        normal = (inverse * normal).normalize_or_zero();
    }
    let least = normal.dot(spread * normal);
    // The three eigenvalues sum to the trace, and their squares to that of the square.
    let rest = 1.0 - least;
    let square =
        (spread * spread).col(0).x + (spread * spread).col(1).y + (spread * spread).col(2).z;
    let difference = (2.0 * (square - least * least) - rest * rest)
        .max(0.0)
        .sqrt();
    let second = 0.5 * (rest - difference);
    (normal.is_finite() && second > LEAST_SPREAD && least < 0.5 * second).then_some(normal)
}

fn unit(v: Vec3) -> Vec3 {
    v.normalize_or_zero()
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;
    use crate::geometry::Camera;

    fn around(n: usize, from_turn: f32, turns: f32, height: f32, world: Quat) -> Vec<Affine3A> {
        (0..n)
            .map(|i| {
                let angle = from_turn + turns * std::f32::consts::TAU * i as f32 / n as f32;
                let eye = Vec3::new(3.0 * angle.cos(), 3.0 * angle.sin(), height);
                let up = world * Vec3::Z;
                Camera::look_at(world * eye, Vec3::ZERO, up, 0.8, 64, 48).world_from_camera
            })
            .collect()
    }

    #[test]
    fn up_is_found_from_all_around_and_from_one_side() {
        let oblique = Quat::from_rotation_x(0.7) * Quat::from_rotation_z(0.4);
        for world in [
            Quat::IDENTITY,
            oblique,
            Quat::from_rotation_x(std::f32::consts::PI),
        ] {
            for (turns, height) in [(1.0, 0.5), (1.0, 4.0), (0.2, 3.0)] {
                let up = world_up(around(24, 0.3, turns, height, world).into_iter());
                let error = up.angle_between(world * Vec3::Z).to_degrees();
                assert!(
                    error < 1.0,
                    "{turns} turns at {height}: off by {error} degrees"
                );
            }
        }
    }

    #[test]
    fn one_view_and_none_have_an_up_too() {
        let one = around(1, 0.0, 1.0, 1.0, Quat::IDENTITY);
        let up = world_up(one.into_iter());
        assert!(up.is_normalized() && up.z > 0.9, "{up}");
        assert_eq!(world_up(std::iter::empty()), Vec3::Z, "none");
    }
}
