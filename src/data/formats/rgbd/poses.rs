//! Files that hold all poses of a camera: a matrix each, or one for each moment.

use std::path::Path;

use glam::{Affine3A, DMat3, DQuat, DVec3};

use super::{numbers_of, pose_of};
use crate::data::DataError;
use crate::data::frame::rotation_and_translation;
use crate::data::photos::depth::MILLIMETRE;

/// Scene units of a step of depth maps that are listed by time.
const TIMED_DEPTH_UNIT: f32 = 1.0 / 5000.0;
/// Longest time between two poses between which the camera is taken to have moved evenly, seconds.
const MAX_GAP_SECS: f64 = 0.1;

/// Where a camera was: from its axes to the world's, and its position there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pose {
    rotation: DQuat,
    position: DVec3,
}

/// What a file of poses holds.
#[derive(Debug)]
pub(super) enum Poses {
    /// One a photo; `None` where the camera had lost its place.
    Ordered(Vec<Option<Pose>>),
    /// With the time of each in seconds, earliest first.
    Timed(Vec<(f64, Pose)>),
}

impl Poses {
    /// Reads poses, recognised by how many numbers a line has; what is not finite is a camera that had lost its place.
    ///
    /// Errors name the file and the line.
    pub(super) fn parse(path: &Path, text: &str) -> Result<Self, DataError> {
        let (mut ordered, mut timed) = (Vec::new(), Vec::new());
        let mut lines = records(text);
        while let Some((number, line)) = lines.next() {
            let at_line = |problem: &str| DataError::field(path, format!("line {number}"), problem);
            let mut numbers = numbers_of(path, line)?;
            if numbers.len() == 3 {
                numbers.clear();
                for (_, line) in lines.by_ref().take(4) {
                    numbers.extend(numbers_of(path, line)?);
                }
            }
            let is_lost = numbers.iter().any(|v| !v.is_finite());
            match *numbers.as_slice() {
                [secs, x, y, z, qx, qy, qz, qw] if !is_lost => {
                    let rotation = DQuat::from_xyzw(qx, qy, qz, qw);
                    let length = rotation.length();
                    if !(0.5..2.0).contains(&length) {
                        return Err(at_line("qx, qy, qz, qw are not a rotation"));
                    }
                    let rotation = rotation * (1.0 / length);
                    let position = DVec3::new(x, y, z);
                    timed.push((secs, Pose { rotation, position }));
                }
                [_, _, _, _, _, _, _, _] => (),
                _ if numbers.len() != 12 && numbers.len() != 16 => {
                    let problem = "not a pose: neither a matrix of 3 x 4 or 4 x 4 nor seconds x y z qx qy qz qw";
                    return Err(at_line(problem));
                }
                _ if is_lost => ordered.push(None),
                _ => {
                    let pose = rotation_and_translation(&numbers);
                    let (rotation, position) =
                        pose.ok_or_else(|| at_line("not a rotation and a position"))?;
                    let rotation = DQuat::from_mat3(&rotation);
                    ordered.push(Some(Pose { rotation, position }));
                }
            }
        }
        match (ordered.is_empty(), timed.is_empty()) {
            (true, true) => Err(DataError::field(path, "poses", "none is in it")),
            (false, false) => Err(DataError::field(
                path,
                "poses",
                "some have times and some have none",
            )),
            (false, true) => Ok(Self::Ordered(ordered)),
            (true, false) => {
                timed.sort_by(|a, b| a.0.total_cmp(&b.0));
                Ok(Self::Timed(timed))
            }
        }
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Self::Ordered(poses) => poses.len(),
            Self::Timed(poses) => poses.len(),
        }
    }

    /// Scene units of a step of the depth maps by custom.
    pub(super) fn depth_unit(&self) -> f32 {
        match self {
            Self::Ordered(_) => MILLIMETRE,
            Self::Timed(_) => TIMED_DEPTH_UNIT,
        }
    }

    /// The pose of the photo at `index`, taken at the time `secs` where that is known; `None` where nothing is known of it.
    pub(super) fn of(&self, index: usize, secs: Option<f64>) -> Option<Affine3A> {
        let pose = match (self, secs) {
            (Self::Ordered(poses), _) => (*poses.get(index)?)?,
            (Self::Timed(poses), None) => poses.get(index)?.1,
            (Self::Timed(poses), Some(secs)) => pose_at(poses, secs)?,
        };
        Some(pose_of(DMat3::from_quat(pose.rotation), pose.position))
    }
}

/// Where the camera was between two poses that are not far apart in time.
fn pose_at(poses: &[(f64, Pose)], secs: f64) -> Option<Pose> {
    let next = poses.partition_point(|(at, _)| *at < secs);
    let (end, after) = poses.get(next)?;
    if *end == secs {
        return Some(*after);
    }
    let (begin, before) = poses.get(next.checked_sub(1)?)?;
    let share = (secs - begin) / (end - begin);
    (end - begin <= MAX_GAP_SECS).then(|| Pose {
        rotation: before.rotation.slerp(after.rotation, share),
        position: before.position.lerp(after.position, share),
    })
}

/// Lines with content, counted from 1.
pub(super) fn records(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let lines = text
        .lines()
        .enumerate()
        .map(|(i, line)| (i + 1, line.trim()));
    lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_two_poses_the_camera_moves_evenly() {
        let pose = |angle: f64, x: f64| Pose {
            rotation: DQuat::from_rotation_z(angle),
            position: DVec3::new(x, 0.0, 1.0),
        };
        let poses = [
            (1.0, pose(0.0, 0.0)),
            (1.04, pose(0.4, 2.0)),
            (2.0, pose(0.0, 0.0)),
        ];
        let found = pose_at(&poses, 1.01).unwrap();
        assert!(
            found.position.distance(DVec3::new(0.5, 0.0, 1.0)) < 1e-9,
            "{found:?}"
        );
        assert!(
            found.rotation.angle_between(DQuat::from_rotation_z(0.1)) < 1e-6,
            "{found:?}"
        );
        assert_eq!(pose_at(&poses, 1.04).unwrap().position.x, 2.0, "at a pose");
        for secs in [0.99, 1.5, 2.01] {
            assert!(
                pose_at(&poses, secs).is_none(),
                "nothing is known at {secs}"
            );
        }
    }
}
