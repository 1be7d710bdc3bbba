//! A small scan: Gaussian splats in the simplest of their formats.

use std::fs;
use std::path::Path;

/// A room of 4 x 4 x 2.6 about the origin as a `.splat` file, z up: its walls have a colour each.
pub(crate) fn write_room(file: &Path) {
    let mut bytes = Vec::new();
    let n = 40;
    let at = |i: i32, half: f32| half * (2.0 * i as f32 / n as f32 - 1.0);
    for (axis, half) in [(0, 2.0_f32), (1, 2.0), (2, 1.3)] {
        for (side, color) in [(1.0, 200), (-1.0, 60)] {
            for k in 0..=n * n {
                let (i, j) = (k % n, k / n);
                let mut center = [at(i, 2.0), at(j, 2.0), 0.0];
                if axis < 2 {
                    center = [at(i, 2.0), at(i, 2.0), at(j, 1.3)];
                }
                center[axis] = side * half;
                for value in center.into_iter().chain([0.06; 3]) {
                    bytes.extend(value.to_le_bytes());
                }
                let mut rgba = [90, 90, 90, 250];
                rgba[axis] = color;
                bytes.extend(rgba);
                bytes.extend([255, 128, 128, 128]);
            }
        }
    }
    fs::write(file, bytes).expect("a scan");
}
