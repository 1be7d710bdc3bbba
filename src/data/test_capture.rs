//! A small capture on disk for tests: an ellipsoid off the origin, photographed from all around.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{Mat4, Vec3};
use serde_json::{Value, json};
use tempfile::TempDir;

use super::{write_glb, write_png_srgb};
use crate::geometry::meshes::test_mesh::ellipsoid;
use crate::geometry::{Camera, Mesh, SurfaceTracer, fibonacci_sphere};

/// Side of the photos.
pub(super) const SIDE: u32 = 32;

/// A temporary folder with a capture in it; removed on drop.
pub(super) struct TestCapture {
    folder: TempDir,
}

impl TestCapture {
    /// `n_train` training and 4 test views with masks, and `mesh.glb`.
    pub(super) fn new(n_train: usize) -> Self {
        let capture = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        let mesh = object();
        write_glb(&capture.path("mesh.glb"), &mesh).unwrap();
        let tracer = SurfaceTracer::new(Arc::new(mesh));
        capture.write_split("train", n_train, 0.0, &tracer);
        capture.write_split("test", 4, 1.3, &tracer);
        capture
    }

    pub(super) fn root(&self) -> &Path {
        self.folder.path()
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.root().join(name)
    }

    /// Changes one of the JSON files.
    pub(super) fn edit_json(&self, name: &str, edit: impl FnOnce(&mut Value)) {
        let path = self.path(name);
        let mut value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        edit(&mut value);
        std::fs::write(&path, value.to_string()).unwrap();
    }

    fn write_split(&self, split: &str, n: usize, turn: f32, tracer: &SurfaceTracer) {
        std::fs::create_dir(self.path(split)).unwrap();
        std::fs::create_dir(self.path(&format!("{split}_mask"))).unwrap();
        let eyes = fibonacci_sphere(n);
        let frames: Vec<Value> = eyes
            .iter()
            .enumerate()
            .map(|(i, eye)| {
                let eye = glam::Quat::from_rotation_x(turn) * *eye * 5.0 + CENTER;
                let camera = Camera::look_at(eye, CENTER, Vec3::Z, 0.7, SIDE, SIDE);
                let photo = format!("{split}/r_{i}.png");
                let mask = format!("{split}_mask/r_{i}.png");
                self.write_pictures(&camera, tracer, &photo, &mask);
                let pose = Mat4::from(camera.world_from_camera).transpose();
                json!({"file_path": photo, "mask_path": mask,
                       "transform_matrix": pose.to_cols_array_2d()})
            })
            .collect();
        let focal = Camera::look_at(CENTER + Vec3::X, CENTER, Vec3::Z, 0.7, SIDE, SIDE).fx;
        let json = json!({"w": SIDE, "h": SIDE, "fl_x": focal, "frames": frames});
        let path = self.path(&format!("transforms_{split}.json"));
        std::fs::write(path, json.to_string()).unwrap();
    }

    fn write_pictures(&self, camera: &Camera, tracer: &SurfaceTracer, photo: &str, mask: &str) {
        let (mut colors, mut coverage) = (Vec::new(), Vec::new());
        for i in 0..SIDE * SIDE {
            let ray = camera.ray((i % SIDE) as f32 + 0.5, (i / SIDE) as f32 + 0.5);
            let hit = tracer.occluded(&ray, 0.0, f32::INFINITY);
            coverage.push(if hit { [1.0; 3] } else { [0.0; 3] });
            let background = (0.5 + 0.5 * ray.direction).to_array();
            colors.push(if hit { [0.8, 0.2, 0.1] } else { background });
        }
        write_png_srgb(&self.path(photo), SIDE, SIDE, &colors).unwrap();
        write_png_srgb(&self.path(mask), SIDE, SIDE, &coverage).unwrap();
    }
}

/// Where the object is.
pub(super) const CENTER: Vec3 = Vec3::new(0.2, 0.6, -0.3);

/// The object: three different radii, so that no axis rotation maps it to itself in place.
pub(super) fn object() -> Mesh {
    ellipsoid(CENTER, Vec3::new(1.0, 0.35, 0.6), 16)
}
