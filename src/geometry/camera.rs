//! Cameras with lens distortion: pixels to rays and points to pixels.
//!
//! Axes are OpenGL's: x right, y up, the camera looks along -z. Pixel coordinates are continuous
//! with y down; pixel `(0, 0)` covers `[0, 1) x [0, 1)`, so its centre is `(0.5, 0.5)`.

use glam::{Affine3A, UVec2, Vec2, Vec3};

use super::{Distortion, Ray};

/// A posed camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Picture width in pixels.
    pub width: u32,
    /// Picture height in pixels.
    pub height: u32,
    /// Horizontal focal length in pixels.
    pub fx: f32,
    /// Vertical focal length in pixels.
    pub fy: f32,
    /// Principal point, x in pixels.
    pub cx: f32,
    /// Principal point, y in pixels from the top.
    pub cy: f32,
    /// Lens distortion; all zero for an ideal pinhole.
    pub distortion: Distortion,
    /// The pose: a rotation and the camera's position.
    pub world_from_camera: Affine3A,
}

impl Camera {
    /// A pinhole camera at `eye` that sees `target` in the middle of the picture.
    ///
    /// `fov_y`: vertical field of view in radians. `up` need not be perpendicular; where it is
    /// parallel to the view, or `eye` equals `target`, another axis is taken, so that the pose
    /// stays finite.
    pub fn look_at(eye: Vec3, target: Vec3, up: Vec3, fov_y: f32, width: u32, height: u32) -> Self {
        let backward = (eye - target).normalize_or(Vec3::Z);
        let right = [up, Vec3::Z, Vec3::Y]
            .into_iter()
            .map(|up| up.normalize_or_zero().cross(backward))
            .find(|right| right.length_squared() > 1e-10)
            .map_or(Vec3::X, Vec3::normalize_or_zero);
        let rotation = glam::Mat3::from_cols(right, backward.cross(right), backward);
        let focal = 0.5 * height as f32 / (0.5 * fov_y).tan();
        Self {
            width,
            height,
            fx: focal,
            fy: focal,
            cx: 0.5 * width as f32,
            cy: 0.5 * height as f32,
            distortion: Distortion::default(),
            world_from_camera: Affine3A::from_mat3_translation(rotation, eye),
        }
    }

    /// The world ray through the picture point `(x_px, y_px)`; a pixel's centre is at `+ 0.5`.
    pub fn ray(&self, x_px: f32, y_px: f32) -> Ray {
        let p = Vec2::new((x_px - self.cx) / self.fx, (y_px - self.cy) / self.fy);
        // From the image's axes (y down, z forward) to the camera's.
        let direction = self.distortion.direction_of(p) * Vec3::new(1.0, -1.0, -1.0);
        Ray {
            origin: self.position(),
            direction: self
                .world_from_camera
                .transform_vector3(direction)
                .normalize_or_zero(),
        }
    }

    /// The picture point at which `p_world` appears, in pixels; may lie outside the picture.
    ///
    /// `None` for points that the lens does not see: behind the camera (a fisheye lens sees some of
    /// those) and so far outside the field of view that the distortion polynomial folds back.
    pub fn project(&self, p_world: Vec3) -> Option<Vec2> {
        self.pixel_of(self.world_from_camera.inverse().transform_point3(p_world))
    }

    fn pixel_of(&self, p_camera: Vec3) -> Option<Vec2> {
        let p = self
            .distortion
            .image_of(p_camera * Vec3::new(1.0, -1.0, -1.0))?;
        let pixel = Vec2::new(p.x * self.fx + self.cx, p.y * self.fy + self.cy);
        pixel.is_finite().then_some(pixel)
    }

    /// The index of the pixel, row by row, at a point of the picture, pixels; `None` beside it.
    pub fn pixel_at(&self, at: Vec2) -> Option<usize> {
        let size = Vec2::new(self.width as f32, self.height as f32);
        let is_inside = at.cmpge(Vec2::ZERO).all() && at.cmplt(size).all();
        is_inside.then(|| at.y as usize * self.width as usize + at.x as usize)
    }

    /// The camera of a part of its pictures, `width` by `height` pixels from `(x, y)` on.
    pub fn part(&self, [x, y]: [u32; 2], width: u32, height: u32) -> Self {
        Self {
            width,
            height,
            cx: self.cx - x as f32,
            cy: self.cy - y as f32,
            ..*self
        }
    }

    /// Projects many points, whose coordinates `world_from_points` takes to the world.
    pub fn projector(&self, world_from_points: Affine3A) -> Projector {
        Projector {
            camera: *self,
            camera_from_points: self.world_from_camera.inverse() * world_from_points,
        }
    }

    /// The angular width of one pixel at the picture's centre, in radians: `1 / fx`.
    pub fn pixel_angle(&self) -> f32 {
        1.0 / self.fx
    }

    /// The same view as a picture of another size; the aspect follows the new size.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let sx = width as f32 / self.width.max(1) as f32;
        let sy = height as f32 / self.height.max(1) as f32;
        Self {
            width,
            height,
            fx: self.fx * sx,
            fy: self.fy * sy,
            cx: self.cx * sx,
            cy: self.cy * sy,
            ..*self
        }
    }

    /// The same camera with pictures of at most `longest` pixels along their longer side.
    pub fn within(&self, longest: u32) -> Self {
        let scale = (f64::from(longest) / f64::from(self.width.max(self.height))).min(1.0);
        let side = |full: u32| ((f64::from(full) * scale).round() as u32).clamp(1, full);
        self.resized(side(self.width), side(self.height))
    }

    /// A picture of another size that shows all of this one, and more where it is wider or higher; nothing is stretched.
    pub fn fitted(&self, width: u32, height: u32) -> Self {
        let (w, h) = (self.width.max(1) as f32, self.height.max(1) as f32);
        let scale = (width as f32 / w).min(height as f32 / h);
        Self {
            width,
            height,
            fx: self.fx * scale,
            fy: self.fy * scale,
            cx: self.cx * scale + 0.5 * (width as f32 - w * scale),
            cy: self.cy * scale + 0.5 * (height as f32 - h * scale),
            ..*self
        }
    }

    /// Where the camera stands.
    pub fn position(&self) -> Vec3 {
        self.world_from_camera.translation.into()
    }

    /// The unit direction in which the camera looks.
    pub fn forward(&self) -> Vec3 {
        (-Vec3::from(self.world_from_camera.matrix3.z_axis)).normalize_or_zero()
    }

    /// The unit direction that is up in the picture.
    pub fn up(&self) -> Vec3 {
        Vec3::from(self.world_from_camera.matrix3.y_axis).normalize_or_zero()
    }
}

/// [`Camera::project`] for many points.
#[derive(Clone, Copy, Debug)]
pub struct Projector {
    camera: Camera,
    camera_from_points: Affine3A,
}

impl Projector {
    /// Where a point appears, in pixels, and how far from the camera it is; `None` as for [`Camera::project`].
    pub fn project(&self, point: Vec3) -> Option<(Vec2, f32)> {
        let p_camera = self.camera_from_points.transform_point3(point);
        let pixel = self.camera.pixel_of(p_camera)?;
        let distance = p_camera.length();
        distance.is_finite().then_some((pixel, distance))
    }

    /// Column and row of the pixel that shows a point; `None` beside the picture.
    pub fn pixel(&self, point: Vec3) -> Option<UVec2> {
        let (at, _) = self.project(point)?;
        let size = Vec2::new(self.camera.width as f32, self.camera.height as f32);
        let is_inside = at.cmpge(Vec2::ZERO).all() && at.cmplt(size).all();
        is_inside.then(|| at.as_uvec2())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A phone camera's calibration.
    fn phone() -> Camera {
        Camera {
            width: 450,
            height: 800,
            fx: 573.133_3,
            fy: 572.704_2,
            cx: 231.065_8,
            cy: 402.195,
            distortion: Distortion {
                k1: 0.057_842_1,
                k2: -0.080_509_9,
                p1: -0.000_980_296,
                p2: 0.000_155_75,
                ..Distortion::default()
            },
            ..Camera::look_at(
                Vec3::new(3.0, -5.0, 1.0),
                Vec3::ZERO,
                Vec3::Z,
                1.0,
                450,
                800,
            )
        }
    }

    fn fisheye() -> Distortion {
        Distortion {
            model: super::super::LensModel::Fisheye,
            k1: -0.03,
            k2: 0.006,
            ..Distortion::default()
        }
    }

    proptest! {
        #[test]
        fn a_point_on_a_pixels_ray_projects_to_that_pixel(
            x in 0.0_f32..450.0, y in 0.0_f32..800.0, t in 0.1_f32..100.0
        ) {
            for camera in [phone(), Camera { distortion: fisheye(), ..phone() }] {
                let pixel = camera.project(camera.ray(x, y).at(t)).unwrap();
                prop_assert!((pixel - Vec2::new(x, y)).length() < 0.02, "{pixel}");
                let moved = Affine3A::from_translation(Vec3::new(1.0, 2.0, 3.0));
                let point = camera.ray(x, y).at(t) - Vec3::new(1.0, 2.0, 3.0);
                let (same, distance) = camera.projector(moved).project(point).unwrap();
                prop_assert!((same - pixel).length() < 0.02 && (distance - t).abs() < 1e-3 * t, "{same}");
            }
        }
    }

    #[test]
    fn distortion_moves_the_corners_and_not_the_principal_point() {
        let camera = phone();
        let pinhole = Camera {
            distortion: Distortion::default(),
            ..camera
        };
        let apart = |x, y| {
            let (a, b) = (camera.ray(x, y).direction, pinhole.ray(x, y).direction);
            (a - b).length() / camera.pixel_angle()
        };
        assert!(apart(camera.cx, camera.cy) < 1e-3, "principal point");
        assert!(
            apart(0.0, 0.0) > 1.0,
            "corner moved by {} px",
            apart(0.0, 0.0)
        );
    }

    #[test]
    fn the_middle_of_the_picture_looks_forward_and_y_points_down() {
        let eye = Vec3::new(1.0, 2.0, 3.0);
        let camera = Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 0.8, 64, 48);
        let ray = camera.ray(32.0, 24.0);
        assert!(
            (ray.direction - camera.forward()).length() < 1e-6,
            "forward"
        );
        assert!(
            (ray.direction + eye.normalize_or_zero()).length() < 1e-6,
            "target"
        );
        assert!(
            camera.ray(32.0, 0.0).direction.dot(camera.up()) > 0.0,
            "top is up"
        );
        let right = camera.forward().cross(camera.up());
        assert!(
            camera.ray(64.0, 24.0).direction.dot(right) > 0.0,
            "right is right"
        );
        let top = camera.ray(32.0, 0.0).direction;
        let half_angle = top.dot(camera.forward()).clamp(-1.0, 1.0).acos();
        assert!(
            (half_angle - 0.4).abs() < 1e-4,
            "field of view {half_angle}"
        );
    }

    #[test]
    fn points_behind_the_camera_do_not_project() {
        let camera = phone();
        assert_eq!(
            camera.project(camera.position() - camera.forward()),
            None,
            "behind"
        );
        assert_eq!(camera.project(camera.position()), None, "at the centre");
        assert_eq!(camera.project(Vec3::NAN), None, "nowhere");
    }

    #[test]
    fn resizing_keeps_the_view() {
        let camera = phone();
        let small = camera.resized(225, 400);
        let (a, b) = (camera.ray(100.0, 300.0), small.ray(50.0, 150.0));
        assert!((a.direction - b.direction).length() < 1e-6, "same ray");
    }

    #[test]
    fn fitting_another_shape_stretches_nothing() {
        let camera = phone();
        for (width, height) in [(900, 800), (225, 800), (450, 800)] {
            let fitted = camera.fitted(width, height);
            assert_eq!((fitted.width, fitted.height), (width, height));
            let pixels = fitted.fx / fitted.fy - camera.fx / camera.fy;
            assert!(pixels.abs() < 1e-6, "stretched at {width}x{height}");
            for (x, y) in [(0.0, 0.0), (450.0, 800.0)] {
                let p = fitted.project(camera.ray(x, y).at(2.0)).unwrap();
                let inside = -0.01..=width as f32 + 0.01;
                assert!(inside.contains(&p.x), "{p} at {width}x{height}");
            }
        }
    }

    #[test]
    fn degenerate_views_stay_finite() {
        for (eye, target, up) in [
            (Vec3::ZERO, Vec3::ZERO, Vec3::Z),
            (Vec3::Z, Vec3::ZERO, Vec3::Z),
            (Vec3::Y, Vec3::ZERO, Vec3::ZERO),
        ] {
            let camera = Camera::look_at(eye, target, up, 1.0, 10, 10);
            let determinant = camera.world_from_camera.matrix3.determinant();
            assert!(
                (determinant - 1.0).abs() < 1e-5,
                "from {eye}: {determinant}"
            );
        }
        let wild = Camera {
            distortion: Distortion {
                k1: -5.0,
                k4: 1e6,
                ..Distortion::default()
            },
            ..phone()
        };
        assert!(wild.ray(0.0, 0.0).direction.is_normalized(), "folding lens");
    }
}
