//! All that a run of the paper's model needs to go on exactly where it stopped, as tensors.

use super::PaperTrainer;
use crate::data::files::tensor_file::TensorFile;
use crate::train::TrainError;
use crate::train::step::adam::Adam;

/// Marks the metadata of a checkpoint of this model.
const FORMAT: &str = "neif-paper-checkpoint-1";

impl PaperTrainer {
    /// Parameters, moments and counters. The random numbers have no state beside seed and step.
    pub fn checkpoint(&self) -> TensorFile {
        let mut file = TensorFile::default();
        file.metadata.insert("format".to_owned(), FORMAT.to_owned());
        insert(
            &mut file,
            "field",
            &self.field.value.params,
            &self.field.adam,
        );
        if let Some(m) = &self.material {
            insert(&mut file, "material", &m.value.params, &m.adam);
        }
        insert(&mut file, "gamma", &[self.gamma], &self.gamma_adam);
        let counters = vec![self.step, self.updates, self.skipped];
        file.insert_u64("counters", &[3], counters);
        file
    }

    /// Goes on from a checkpoint of a run with the same configuration and capture.
    ///
    /// # Errors
    /// When the file is no checkpoint of this model or of another shape; the trainer is then unchanged.
    pub fn restore(&mut self, file: &TensorFile) -> Result<(), TrainError> {
        if file.text("format")? != FORMAT {
            return Err(TrainError::Checkpoint {
                file: file.origin().to_owned(),
                what: "is no checkpoint of the paper's model",
            });
        }
        let field = read(file, "field", self.field.value.n_params())?;
        let material = match &self.material {
            Some(m) => Some(read(file, "material", m.value.n_params())?),
            None => None,
        };
        let gamma = read(file, "gamma", 1)?;
        let counters = file.u64("counters", &[3])?.to_vec();
        (self.field.value.params, self.field.adam) = field;
        if let (Some(m), Some(stored)) = (&mut self.material, material) {
            (m.value.params, m.adam) = stored;
        }
        (self.gamma, self.gamma_adam) = (gamma.0[0], gamma.1);
        (self.step, self.updates, self.skipped) = (counters[0], counters[1], counters[2]);
        self.transpose();
        Ok(())
    }
}

/// Names of a parameter vector and its moments.
fn names(of: &str) -> [String; 3] {
    ["params", "first", "second"].map(|part| format!("{of}.{part}"))
}

fn insert(file: &mut TensorFile, of: &str, params: &[f32], adam: &Adam) {
    for (name, values) in names(of).iter().zip([params, &adam.first, &adam.second]) {
        file.insert_f32(name, &[values.len()], values.to_vec());
    }
}

fn read(file: &TensorFile, of: &str, n: usize) -> Result<(Vec<f32>, Adam), TrainError> {
    let vector = |name: &str| -> Result<Vec<f32>, TrainError> {
        let values = file.f32(name, &[n])?;
        if values.iter().all(|v| v.is_finite()) {
            return Ok(values.to_vec());
        }
        Err(TrainError::Checkpoint {
            file: file.origin().to_owned(),
            what: "holds values that are not finite",
        })
    };
    let [params, first, second] = names(of);
    let adam = Adam {
        first: vector(&first)?,
        second: vector(&second)?,
    };
    Ok((vector(&params)?, adam))
}
