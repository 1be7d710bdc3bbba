//! The numbers that all passes of a band share, as words: `frame.wgsl` has the same members in the same order.

use std::ops::Range;

use glam::{Vec3, Vec4};

use super::tables::{EnvironmentTables, LevelRow, ObjectTables};
use crate::geometry::Camera;
use crate::neif::Environment;
use crate::neif::surface::edit::EnvironmentFromWorld;
use crate::render::{Background, Layer, PathOptions, PreviewScene, ToneMap};

/// Levels that a grid may have.
pub(super) const MAX_LEVELS: usize = 16;

/// The words of one band.
pub(super) struct Frame {
    words: Vec<[u32; 4]>,
}

impl Frame {
    /// Of rows `rows` of a picture from these tables.
    pub(super) fn of_band(
        picture: &PreviewScene,
        options: PathOptions,
        (environment, object): (&EnvironmentTables, Option<&ObjectTables>),
        rows: Range<u32>,
    ) -> Self {
        let (scene, camera, layer) = (&picture.scene, &picture.camera, picture.layer);
        let motion = scene.transform.environment_from_world();
        let mut frame = Self { words: Vec::new() };
        frame.camera(camera);
        frame.integers([camera.width, camera.height, rows.start, rows.len() as u32]);
        let n_samples = scene.environment.n_samples() as u32;
        let paths = [options.least, options.most, options.max_vertices];
        let [least, most, n_vertices] = paths.map(|n| n as u32);
        frame.integers([least, most, n_vertices, n_samples]);
        let behind = match (scene.shows_background(layer), scene.shown_background()) {
            (false, _) => 0,
            (true, Background::Blurred) => 2,
            (true, _) => 1,
        };
        let shown = match layer {
            Layer::Diffuse => 1,
            Layer::Specular => 2,
            Layer::Environment => 3,
            _ => 0,
        };
        let has_object = u32::from(object.is_some());
        let screen = scene.shown(layer);
        let is_neutral = u32::from(screen.tone_map == ToneMap::Neutral);
        frame.integers([has_object, behind, shown, is_neutral]);
        frame.ball(object, options.largest_turn);
        frame.motion(&scene.environment, &motion);
        frame.cube(object);
        // The light that the diffuse part follows; where it follows none, it stays as it was learned.
        let response = scene.trained_in.as_ref().map_or(Vec3::ONE, |_| motion.gain);
        frame.floats((scene.edit.diffuse_gain * response).extend(screen.gain));
        let gamma = scene.environment.gamma();
        frame.floats(scene.edit.specular_gain().extend(gamma));
        frame.levels(&environment.levels);
        frame.levels(object.map_or(&[], |object| &object.levels));
        frame
    }

    /// Of rays that are given rather than seen: only the field matters.
    pub(super) fn of_rays(environment: &Environment, environment_levels: &[LevelRow]) -> Self {
        let mut frame = Self {
            words: vec![[0; 4]; 6],
        };
        frame.integers([0, 0, 0, environment.n_samples() as u32]);
        frame.words.resize(17, [0; 4]);
        frame.levels(environment_levels);
        frame.levels(&[]);
        frame
    }

    pub(super) fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(&self.words)
    }

    fn floats(&mut self, row: Vec4) {
        self.words.push(row.to_array().map(f32::to_bits));
    }

    fn integers(&mut self, row: [u32; 4]) {
        self.words.push(row);
    }

    fn camera(&mut self, camera: &Camera) {
        self.floats(camera.position().extend(0.0));
        let rotation = camera.world_from_camera.matrix3;
        for column in [rotation.x_axis, rotation.y_axis, rotation.z_axis] {
            self.floats(Vec3::from(column).extend(0.0));
        }
        self.floats(Vec4::new(camera.fx, camera.fy, camera.cx, camera.cy));
    }

    fn ball(&mut self, object: Option<&ObjectTables>, largest_turn: f32) {
        let (center, radius) = object.map_or((Vec3::ZERO, 1.0), |object| object.ball);
        self.floats(center.extend(radius));
        let (start, n_leaves) = object.map_or((0.0, 0), |o| (o.self_distance, o.n_leaves));
        let row = Vec4::new(start, 3.0 * n_leaves as f32, largest_turn, 0.0);
        self.floats(row);
    }

    fn motion(&mut self, environment: &Environment, motion: &EnvironmentFromWorld) {
        let place = environment.frame();
        let to_field = motion.length(1.0) / place.half_side;
        let columns = Vec3::AXES.map(|axis| motion.direction(axis) * to_field);
        let shift = place.field_from_world(motion.point(Vec3::ZERO));
        for row in 0..3 {
            let [x, y, z] = columns.map(|column| column[row]);
            self.floats(Vec4::new(x, y, z, shift[row]));
        }
        self.floats(motion.gain.extend(to_field));
    }

    fn cube(&mut self, object: Option<&ObjectTables>) {
        let (corner, side) = object.map_or((Vec3::ZERO, 1.0), |object| object.cube);
        self.floats(corner.extend(side));
    }

    fn levels(&mut self, levels: &[LevelRow]) {
        let end = self.words.len() + MAX_LEVELS;
        self.words.extend(levels);
        self.words.resize(end, [0; 4]);
    }
}
