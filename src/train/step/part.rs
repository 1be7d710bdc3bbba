//! Something learned: the interface of all that a model's parameters consist of.

use super::now::Now;
use super::tasks::Job;
use crate::data::files::tensor_file::TensorFile;
use crate::train::TrainError;

/// Something learned. It owns its parameters, what was gathered of the step for them, its optimiser's state and its share of
/// a checkpoint; a model lists its parts ([`super::model::Model::parts`]).
pub trait Part {
    /// Follows what was gathered: at once, or by jobs where that takes long.
    fn update<'a>(&'a mut self, now: &Now<'_>, jobs: &mut Vec<Job<'a>>);

    /// Follows the updated parameters, when the jobs are done.
    fn follow(&mut self) {}

    /// Adds its arrays to a checkpoint.
    fn store(&self, file: &mut TensorFile);

    /// Goes on from there.
    ///
    /// # Errors
    /// When an array is missing, is of another shape or holds values that are not finite.
    fn restore(&mut self, file: &TensorFile) -> Result<(), TrainError>;
}

/// Stores a vector.
pub(in crate::train) fn insert(file: &mut TensorFile, name: &str, values: &[f32]) {
    file.insert_f32(name, &[values.len()], values.to_vec());
}

/// A stored vector of `n` values.
///
/// # Errors
/// When it is missing, is of another length or holds values that are not finite.
pub(in crate::train) fn finite(
    file: &TensorFile,
    name: &str,
    n: usize,
) -> Result<Vec<f32>, TrainError> {
    let values = file.f32(name, &[n])?;
    if values.iter().all(|v| v.is_finite()) {
        return Ok(values.to_vec());
    }
    Err(TrainError::Checkpoint {
        file: file.origin().to_owned(),
        what: "holds values that are not finite",
    })
}
