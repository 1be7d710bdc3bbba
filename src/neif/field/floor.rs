//! The floor that an object stands on: an opaque plane of the field.
//!
//! Fog in front of the cameras and under a translucent floor explains a few photos as well as a floor does. Where there is
//! known to be one, rays end on it, exactly, and the field has to learn its colour alone. Whatever stands on it is in
//! front of it.

use glam::Vec3;

use crate::data::files::tensor_file::{TensorFile, TensorFileError};

/// The least slope of a ray that meets it: others skim over what is not quite a plane.
const LEAST_SLOPE: f32 = 1e-3;
/// Name of the array in files: a point and the normal.
const NAME: &str = "floor";

/// A plane, field coordinates; only rays from above end on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Floor {
    /// Unit.
    up: Vec3,
    /// `up . p` of its points.
    offset: f32,
}

impl Floor {
    /// The plane through `point`, square to `up` (unit).
    pub fn new(point: Vec3, up: Vec3) -> Self {
        Self {
            up,
            offset: up.dot(point),
        }
    }

    /// The normal, then the offset along it.
    pub fn numbers(&self) -> [f32; 4] {
        [self.up.x, self.up.y, self.up.z, self.offset]
    }

    /// Height of a point above it; negative below.
    #[inline(always)]
    pub fn height(&self, point: [f32; 3]) -> f32 {
        Vec3::from(point).dot(self.up) - self.offset
    }

    /// Distance along a ray from above to where it ends, in lengths of its direction.
    #[inline(always)]
    pub fn distance(&self, origin: [f32; 3], direction: [f32; 3]) -> Option<f32> {
        let height = self.height(origin);
        let slope = -Vec3::from(direction).dot(self.up);
        (height > 0.0 && slope > LEAST_SLOPE).then(|| height / slope)
    }

    /// Adds it to a file.
    pub fn store(&self, file: &mut TensorFile) {
        file.insert_f32(NAME, &[4], self.numbers().to_vec());
    }

    /// Reads it from a file; `None` where the file has none.
    ///
    /// # Errors
    /// When what is there is no plane.
    pub fn stored(file: &TensorFile) -> Result<Option<Self>, TensorFileError> {
        if file.tensor(NAME).is_err() {
            return Ok(None);
        }
        let numbers = file.f32(NAME, &[4])?;
        let (up, offset) = (Vec3::from_slice(numbers), numbers[3]);
        if up.is_normalized() && offset.is_finite() {
            return Ok(Some(Self { up, offset }));
        }
        Err(TensorFileError::Mismatch {
            path: file.origin().to_owned(),
            tensor: NAME.to_owned(),
            found: format!("{numbers:?}"),
            expected: "a unit normal and an offset".to_owned(),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn distance(origin: [f32; 3], direction: [f32; 3]) -> Option<f32> {
        Floor::new(Vec3::new(7.0, 3.0, -0.5), Vec3::Z).distance(origin, direction)
    }

    #[test]
    fn rays_from_above_end_on_it() {
        assert_eq!(distance([1.0, 0.3, 0.5], [0.0, 0.0, -1.0]), Some(1.0));
        let slanted = distance([-0.5, 0.0, 0.5], [0.6, 0.0, -0.8]).expect("crosses at 0.25");
        assert!((slanted - 1.25).abs() < 1e-6);
        for (what, origin, direction) in [
            ("upwards", [1.0, 0.0, 0.5], [0.0, 0.0, 1.0]),
            ("along it", [1.0, 0.0, 0.5], [1.0, 0.0, 0.0]),
            ("from below", [1.0, 0.0, -0.6], [0.0, 0.0, -1.0]),
        ] {
            assert_eq!(distance(origin, direction), None, "{what}");
        }
    }

    #[test]
    fn files_keep_it_and_refuse_what_is_none() {
        let mut file = TensorFile::default();
        let stored = |file: &TensorFile| {
            let file = TensorFile::from_bytes(&file.to_bytes(), Path::new("a.file")).unwrap();
            Floor::stored(&file)
        };
        assert_eq!(stored(&file).unwrap(), None);
        let floor = Floor::new(Vec3::new(0.1, 0.2, 0.3), Vec3::new(0.6, 0.0, 0.8));
        floor.store(&mut file);
        assert_eq!(stored(&file).unwrap(), Some(floor));
        for wrong in [[0.0, 0.0, 2.0, 1.0], [0.0, 0.0, 1.0, f32::NAN]] {
            file.insert_f32(NAME, &[4], wrong.to_vec());
            let error = stored(&file).unwrap_err().to_string();
            assert!(error.contains("a.file") && error.contains(NAME), "{error}");
        }
        file.insert_f32(NAME, &[3], vec![0.0, 0.0, 1.0]);
        assert!(stored(&file).is_err());
    }
}
