//! The learned exponent of the display transform.

use super::adam::Adam;
use super::now::Now;
use super::part::{Part, finite, insert};
use super::tasks::Job;
use crate::data::files::tensor_file::TensorFile;
use crate::neif::light::display::Display;
use crate::train::TrainError;

/// Name in a checkpoint: the exponent and its two moments.
const NAME: &str = "gamma";
/// Outside this range the transform is no display transform any more.
const RANGE: [f32; 2] = [0.2, 5.0];

/// The learned exponent of the display transform; it starts at 1.
#[derive(Debug)]
pub(in crate::train) struct LearnedDisplay {
    pub(in crate::train) gamma: f32,
    /// Of the step, by the exponent.
    pub(in crate::train) gradient: f32,
    adam: Adam,
    is_learned: bool,
}

impl LearnedDisplay {
    /// An exponent that is learned, or stays.
    pub(in crate::train) fn new(is_learned: bool) -> Self {
        Self {
            gamma: 1.0,
            gradient: 0.0,
            adam: Adam::new(1),
            is_learned,
        }
    }

    /// The transform as it stands.
    pub(in crate::train) fn display(&self) -> Display {
        Display { gamma: self.gamma }
    }
}

impl Part for LearnedDisplay {
    fn update<'a>(&'a mut self, now: &Now<'_>, _jobs: &mut Vec<Job<'a>>) {
        if !self.is_learned {
            return;
        }
        let mut gamma = [self.gamma];
        let gradient = &mut [self.gradient];
        self.adam
            .update(&mut gamma, gradient, now.gamma_rate(), now.updates);
        let [least, most] = RANGE;
        self.gamma = gamma[0].clamp(least, most);
    }

    fn store(&self, file: &mut TensorFile) {
        let state = [self.gamma, self.adam.first[0], self.adam.second[0]];
        insert(file, NAME, &state);
    }

    fn restore(&mut self, file: &TensorFile) -> Result<(), TrainError> {
        let state = finite(file, NAME, 3)?;
        (self.gamma, self.adam.first[0], self.adam.second[0]) = (state[0], state[1], state[2]);
        Ok(())
    }
}
