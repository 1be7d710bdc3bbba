//! How bright the lamps of an environment are, estimated from an object that was trained in it: photos show them as white.

use glam::Vec3;

use crate::data::files::tensor_file::{TensorFile, TensorFileError};

/// The arrays in an environment file.
const DIRECTIONS: &str = "lamps.directions";
const GAINS: &str = "lamps.gains";

/// By how much lamps are brighter than the field has them, direction by direction; never empty.
#[derive(Clone, Debug, PartialEq)]
pub struct EstimatedLamps {
    /// Unit directions from the middle of the inner box, in the environment's world, and the factor of the radiance above
    /// white that is seen there, a colour: finite and at least 0.
    gains: Vec<(Vec3, Vec3)>,
}

impl EstimatedLamps {
    /// From directions with their factors; `None` for no direction.
    pub fn new(gains: Vec<(Vec3, Vec3)>) -> Option<Self> {
        (!gains.is_empty()).then_some(Self { gains })
    }

    /// The factor in a direction: that of the nearest one that is known.
    pub fn gain(&self, direction: Vec3) -> Vec3 {
        let nearest = self.gains.iter().max_by(|a, b| {
            let [a, b] = [a, b].map(|(known, _)| known.dot(direction));
            a.total_cmp(&b)
        });
        nearest.map_or(Vec3::ONE, |(_, gain)| *gain)
    }

    /// Adds them to an environment file.
    pub(super) fn store(&self, file: &mut TensorFile) {
        let (directions, gains): (Vec<Vec3>, Vec<Vec3>) = self.gains.iter().copied().unzip();
        for (name, values) in [(DIRECTIONS, directions), (GAINS, gains)] {
            let values = values.iter().flat_map(Vec3::to_array);
            file.insert_f32(name, &[self.gains.len(), 3], values.collect());
        }
    }

    /// Reads them from an environment file; `None` where the file has none.
    ///
    /// # Errors
    /// When the arrays do not fit each other or hold what is no direction or no factor.
    pub(super) fn stored(file: &TensorFile) -> Result<Option<Self>, TensorFileError> {
        let Ok(directions) = file.tensor(DIRECTIONS) else {
            return Ok(None);
        };
        let n = directions.shape.first().copied().unwrap_or(0);
        let vectors = |name: &str, what: &str, is_one: fn(&Vec3) -> bool| {
            let vectors: Vec<Vec3> = file
                .f32(name, &[n, 3])?
                .chunks_exact(3)
                .map(Vec3::from_slice)
                .collect();
            match vectors.iter().find(|vector| !is_one(vector)) {
                None => Ok(vectors),
                Some(vector) => Err(TensorFileError::Mismatch {
                    path: file.origin().to_owned(),
                    tensor: name.to_owned(),
                    found: vector.to_string(),
                    expected: what.to_owned(),
                }),
            }
        };
        let directions = vectors(DIRECTIONS, "unit directions", |v| v.is_normalized())?;
        let is_factor = |v: &Vec3| v.is_finite() && v.min_element() >= 0.0;
        let gains = vectors(GAINS, "factors of at least 0", is_factor)?;
        Ok(Self::new(directions.into_iter().zip(gains).collect()))
    }
}
