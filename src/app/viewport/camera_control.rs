//! The camera of the viewport: orbit, pan, dolly, framing, and fitting a photo's lens to the window.
//!
//! A viewpoint keeps the whole pose, so that it can stand exactly where a photo was taken; moving
//! it turns about the pivot like a turntable.

use glam::{Affine3A, Mat3, Quat, Vec2, Vec3};

use crate::data::View;
use crate::geometry::{Aabb, Camera, Distortion};

/// Nearest the view may come to straight up or down, in radians.
const POLE_MARGIN: f32 = 0.02;
/// Vertical field of view where no photo gives one, in radians.
const DEFAULT_FOV: f32 = 0.8;
/// Narrowest and widest field of view, radians.
pub const LENS_RANGE: [f32; 2] = [0.1, 2.4];
/// Room left around a framed object.
const FRAME_MARGIN: f32 = 1.15;

/// A camera pose with the lens of a photo, and the point it turns about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// Pose and lens; its size is the photo's, not the window's.
    pub camera: Camera,
    /// The point to orbit about.
    pub pivot: Vec3,
}

/// A movement of the camera, as the mouse makes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CameraMove {
    /// Turns about the pivot, by radians to the right and down.
    Orbit {
        /// About the world's up axis.
        yaw: f32,
        /// About the camera's right axis.
        pitch: f32,
    },
    /// Shifts in the picture plane, in picture heights at the pivot's distance.
    Pan {
        /// To the right.
        right: f32,
        /// Up.
        up: f32,
    },
    /// Multiplies the distance to the pivot.
    Dolly(f32),
    /// Turns about the eye, by radians to the right and down; the pivot stays in front.
    Look {
        /// About the world's up axis.
        yaw: f32,
        /// About the camera's right axis.
        pitch: f32,
    },
    /// Goes with the pivot, to the right, up (the world's) and forward, in distances to the pivot.
    Fly(Vec3),
    /// Stands in this direction from the pivot (unit, world), as far away as before.
    From(Vec3),
    /// Has this vertical field of view of the photo's picture, radians.
    Lens(f32),
    /// Brings the horizon level.
    Level,
}

/// Where a photo lies in a window that shows all of it: pixels from the window's top left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotoArea {
    /// Top left corner.
    pub min: Vec2,
    /// Width and height.
    pub size: Vec2,
}

impl Viewpoint {
    /// Where a photo was taken.
    pub fn of_camera(camera: &Camera, pivot: Vec3) -> Self {
        Self {
            camera: *camera,
            pivot,
        }
    }

    /// Looking at `pivot` from `eye` with an ordinary lens.
    pub fn look_at(eye: Vec3, pivot: Vec3, up: Vec3) -> Self {
        Self {
            camera: Camera::look_at(eye, pivot, up, DEFAULT_FOV, 400, 300),
            pivot,
        }
    }

    /// Distance to the pivot, never zero.
    pub fn distance(&self) -> f32 {
        // A camera on its pivot could neither pan nor dolly out again.
        (self.camera.position() - self.pivot).length().max(1e-6)
    }

    /// Moves the camera; `up` is the world's.
    pub fn apply(&mut self, movement: CameraMove, up: Vec3) {
        // The lens polynomial only holds within the photo; away from it a plain lens is right.
        self.camera.distortion = Distortion::default();
        match movement {
            CameraMove::Orbit { yaw, pitch } => {
                let turn = self.turn(yaw, pitch, up);
                let position = self.pivot + turn * (self.camera.position() - self.pivot);
                self.place(position, (turn * self.rotation()).normalize());
            }
            CameraMove::Look { yaw, pitch } => {
                let rotation = (self.turn(yaw, pitch, up) * self.rotation()).normalize();
                let distance = self.distance();
                self.place(self.camera.position(), rotation);
                self.pivot = self.camera.position() + self.camera.forward() * distance;
            }
            CameraMove::Fly(by) => {
                let right = Vec3::from(self.camera.world_from_camera.matrix3.x_axis);
                let way = right * by.x + up * by.y + self.camera.forward() * by.z;
                let shift = way * self.distance();
                if shift.is_finite() {
                    self.pivot += shift;
                    self.place(self.camera.position() + shift, self.rotation());
                }
            }
            CameraMove::From(direction) => {
                let eye = self.pivot + direction * self.distance();
                self.look_from(eye, up);
            }
            CameraMove::Lens(angle) => {
                let angle = angle.clamp(LENS_RANGE[0], LENS_RANGE[1]);
                let fy = 0.5 * self.camera.height as f32 / (0.5 * angle).tan();
                self.camera.fx *= fy / self.camera.fy;
                self.camera.fy = fy;
            }
            CameraMove::Level => self.look_from(self.camera.position(), up),
            CameraMove::Pan { right, up } => {
                let height = self.distance() * self.camera.height as f32 / self.camera.fy;
                let axes = self.camera.world_from_camera.matrix3;
                let shift =
                    (Vec3::from(axes.x_axis) * right + Vec3::from(axes.y_axis) * up) * height;
                self.pivot += shift;
                self.place(self.camera.position() + shift, self.rotation());
            }
            CameraMove::Dolly(factor) => {
                let factor = if factor.is_finite() {
                    factor.clamp(0.05, 20.0)
                } else {
                    1.0
                };
                let offset = self.camera.position() - self.pivot;
                // Past these bounds f32 loses the pose.
                let length = offset.length() * factor;
                if (1e-4..1e6).contains(&length) {
                    self.place(self.pivot + offset * factor, self.rotation());
                }
            }
        }
    }

    /// Vertical field of view of the photo's picture, radians.
    pub fn field_of_view(&self) -> f32 {
        2.0 * (0.5 * self.camera.height as f32 / self.camera.fy).atan()
    }

    /// Looks at the pivot from `eye` with `up` upwards.
    fn look_from(&mut self, eye: Vec3, up: Vec3) {
        let down = (self.pivot - eye).normalize_or_zero();
        // From a pole, where up has no direction in the picture, the front is below.
        let up = if down.dot(up).abs() > POLE_MARGIN.cos() {
            down.dot(up).signum() * front(up)
        } else {
            up
        };
        let posed = Self::look_at(eye, self.pivot, up);
        self.place(eye, posed.rotation());
    }

    /// The turn by angles to the right and down, which ends short of the poles.
    fn turn(&self, yaw: f32, pitch: f32, up: Vec3) -> Quat {
        let from_up = self.camera.forward().angle_between(up);
        // Looking down, pitch lowers the view towards -up: the angle from up grows.
        let pitch =
            (from_up + pitch).clamp(POLE_MARGIN, std::f32::consts::PI - POLE_MARGIN) - from_up;
        let right = Vec3::from(self.camera.world_from_camera.matrix3.x_axis).normalize_or_zero();
        Quat::from_axis_angle(up, -yaw) * Quat::from_axis_angle(right, -pitch)
    }

    fn rotation(&self) -> Quat {
        Quat::from_mat3a(&self.camera.world_from_camera.matrix3)
    }

    fn place(&mut self, position: Vec3, rotation: Quat) {
        if position.is_finite() && rotation.is_finite() {
            self.camera.world_from_camera = Affine3A::from_rotation_translation(rotation, position);
        }
    }

    /// Moves back or forth, and sideways, until `bounds` fill the picture; the direction stays.
    pub fn frame(&mut self, bounds: &Aabb) {
        self.pivot = bounds.center();
        self.camera.distortion = Distortion::default();
        let radius = (0.5 * bounds.diagonal()).max(1e-3);
        let half_angle = |size: u32, focal: f32| (0.5 * size as f32 / focal).atan();
        let half = half_angle(self.camera.width, self.camera.fx)
            .min(half_angle(self.camera.height, self.camera.fy));
        let distance = FRAME_MARGIN * radius / half.sin().max(1e-3);
        self.place(
            self.pivot - self.camera.forward() * distance,
            self.rotation(),
        );
    }

    /// Where the photo of this viewpoint lies in a window of that size.
    pub fn photo_area(&self, width: u32, height: u32) -> PhotoArea {
        let photo = Vec2::new(self.camera.width as f32, self.camera.height as f32).max(Vec2::ONE);
        let window = Vec2::new(width as f32, height as f32);
        let size = photo * (window / photo).min_element();
        PhotoArea {
            min: 0.5 * (window - size),
            size,
        }
    }

    /// The camera of a window of that size, which shows the whole photo and what is around it.
    pub fn camera_for(&self, width: u32, height: u32) -> Camera {
        let area = self.photo_area(width, height);
        let scale = area.size.x / self.camera.width.max(1) as f32;
        Camera {
            width,
            height,
            fx: self.camera.fx * scale,
            fy: self.camera.fy * scale,
            cx: area.min.x + self.camera.cx * scale,
            cy: area.min.y + self.camera.cy * scale,
            ..self.camera
        }
    }
}

/// To the right of who looks at the front, for a world with this up axis: x, or y where x is up.
pub fn right_side(up: Vec3) -> Vec3 {
    if up.x.abs() > 0.9 { Vec3::Y } else { Vec3::X }
}

/// Where who looks at the front stands: at -y where z is up, at z where y is up.
pub fn front(up: Vec3) -> Vec3 {
    right_side(up).cross(up).normalize_or_zero()
}

/// The world's up axis: the mean of the cameras' up vectors, snapped to the nearest axis.
pub fn up_axis<'a>(cameras: impl IntoIterator<Item = &'a Camera>) -> Vec3 {
    let mean: Vec3 = cameras.into_iter().map(Camera::up).sum();
    let axes = [Vec3::Z, Vec3::Y, Vec3::X].into_iter();
    axes.flat_map(|axis| [axis, -axis])
        .max_by(|a, b| a.dot(mean).total_cmp(&b.dot(mean)))
        .unwrap_or(Vec3::Z)
}

/// The point nearest to all viewing axes (least squares); `None` where they are parallel.
pub fn point_looked_at<'a>(cameras: impl IntoIterator<Item = &'a Camera>) -> Option<Vec3> {
    let mut normal = Mat3::ZERO;
    let mut rhs = Vec3::ZERO;
    for camera in cameras {
        // Projects out the viewing direction d: I - d d^T.
        let d = camera.forward();
        let across = Mat3::IDENTITY - Mat3::from_cols(d * d.x, d * d.y, d * d.z);
        normal += across;
        rhs += across * camera.position();
    }
    // The determinant of n cameras grows as n³; below this the axes are as good as parallel.
    let point = (normal.determinant() > 1e-4).then(|| normal.inverse() * rhs)?;
    point.is_finite().then_some(point)
}

/// The view whose camera is most like this one: by place and direction.
pub fn nearest_view<'a>(
    camera: &Camera,
    views: impl IntoIterator<Item = &'a View>,
) -> Option<usize> {
    let misfit = |view: &View| {
        let apart = (view.camera.position() - camera.position()).length();
        let angle = view.camera.forward().angle_between(camera.forward());
        apart * (1.0 + angle) + angle
    };
    let views = views.into_iter().map(misfit).enumerate();
    views.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i)
}

#[cfg(test)]
mod tests;
