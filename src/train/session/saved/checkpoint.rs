//! All that a run needs to go on exactly where it stopped, as tensors. Where normals or poses are refined, its pixels are
//! traced anew with all that was learned of them: then it goes on there, but not to the bit.

use crate::data::files::tensor_file::{TensorFile, TensorFileError};
use crate::neif::field::density_grid::DensityGrid;
use crate::neif::field::floor::Floor;
use crate::neif::field::seen_grid::SeenGrid;
use crate::train::TrainError;
use crate::train::step::trainer::Trainer;

/// Marks the metadata of a checkpoint.
const FORMAT: &str = "neif-checkpoint-1";

impl Trainer {
    /// Parameters, moments, density cache and counters. The random numbers have no state beside seed and step.
    pub fn checkpoint(&self) -> TensorFile {
        let mut file = TensorFile::default();
        file.metadata.insert("format".to_owned(), FORMAT.to_owned());
        insert(&mut file, "field.params", &self.field.value.params);
        insert(&mut file, "field.first", &self.field.adam.first);
        insert(&mut file, "field.second", &self.field.adam.second);
        if let Some(material) = &self.material {
            insert(&mut file, "material.params", &material.value.params);
            insert(&mut file, "material.first", &material.adam.first);
            insert(&mut file, "material.second", &material.adam.second);
        }
        insert(
            &mut file,
            "gamma",
            &[
                self.display.gamma,
                self.display.adam.first[0],
                self.display.adam.second[0],
            ],
        );
        if let Some(exposures) = &self.photos.exposures {
            let [log_gains, sums] = exposures.state();
            insert(&mut file, "exposures.log_gains", &log_gains);
            insert(&mut file, "exposures.sums", &sums);
        }
        if let Some(poses) = &self.photos.poses {
            insert(&mut file, "poses.corrections", &poses.state());
            poses.store_sums(&mut file);
        }
        if let Some(refinement) = &self.surface.refinement {
            let [total, moments] = refinement.offsets.state();
            insert(&mut file, "normals.total", &total);
            insert(&mut file, "normals.moments", &moments);
            refinement.store_surface(&mut file);
        }
        file.insert_u16(
            "density.cells",
            &[self.density.cells().len()],
            self.density.cells().to_vec(),
        );
        if let Some(floor) = self.density.floor {
            floor.store(&mut file);
        }
        self.density
            .seen
            .iter()
            .for_each(|s| s.store_both(&mut file));
        file.insert_u64(
            "counters",
            &[3],
            vec![self.counts.step, self.counts.updates, self.counts.skipped],
        );
        file
    }

    /// Goes on from a checkpoint of a run with the same configuration and capture.
    ///
    /// # Errors
    /// When the file is no checkpoint or belongs to another shape of model; the trainer is then unchanged.
    pub fn restore(&mut self, file: &TensorFile) -> Result<(), TrainError> {
        if file.text("format")? != FORMAT {
            return Err(TrainError::Checkpoint {
                file: file.origin().to_owned(),
                what: "is no checkpoint",
            });
        }
        let vector = |name: &str, n: usize| -> Result<Vec<f32>, TensorFileError> {
            Ok(file.f32(name, &[n])?.to_vec())
        };
        let learned =
            |of: &str, values: &str, n: usize| -> Result<[Vec<f32>; 3], TensorFileError> {
                let read = |what: &str| vector(&format!("{of}.{what}"), n);
                Ok([read(values)?, read("first")?, read("second")?])
            };
        let field = learned("field", "params", self.field.value.params.len())?;
        let material = self.material.as_ref();
        let material = material.map(|m| learned("material", "params", m.value.params.len()));
        let material = material.transpose()?;
        let [n_gains, n_sums] = self.photos.exposures.as_ref().map_or([0; 2], |exposures| {
            exposures.state().map(|values| values.len())
        });
        let log_gains = where_stored(file, "exposures.log_gains", n_gains)?;
        let gain_sums = where_stored(file, "exposures.sums", n_sums)?;
        let normals = match &self.surface.refinement {
            Some(refinement) => {
                let n = refinement.offsets.n_values();
                Some([vector("normals.total", n)?, vector("normals.moments", n)?])
            }
            None => None,
        };
        let poses = self.photos.poses.as_ref();
        let n_poses = poses.map_or(0, |poses| poses.state().len());
        let poses = where_stored(file, "poses.corrections", n_poses)?;
        let gamma = vector("gamma", 3)?;
        let counters = file.u64("counters", &[3])?.to_vec();
        let density = stored_density(file, self.density.cells().len())?;
        let optional = material.iter().flatten().chain(normals.iter().flatten());
        let optional = optional.chain(&log_gains).chain(&gain_sums).chain(&poses);
        let all = field.iter().chain(optional).flatten();
        if !all.chain(&gamma).all(|v| v.is_finite()) {
            return Err(TrainError::Checkpoint {
                file: file.origin().to_owned(),
                what: "holds values that are not finite",
            });
        }
        [
            self.field.value.params,
            self.field.adam.first,
            self.field.adam.second,
        ] = field;
        if let (Some(m), Some(stored)) = (&mut self.material, material) {
            [m.value.params, m.adam.first, m.adam.second] = stored;
        }
        (
            self.display.gamma,
            self.display.adam.first[0],
            self.display.adam.second[0],
        ) = (gamma[0], gamma[1], gamma[2]);
        match (&mut self.photos.exposures, &log_gains) {
            (Some(exposures), Some(log_gains)) => {
                exposures.set_state([log_gains, gain_sums.as_deref().unwrap_or_default()]);
            }
            (exposures, _) => *exposures = None,
        }
        if let (Some(poses), Some(stored)) = (&mut self.photos.poses, &poses) {
            poses.set_state(stored);
            poses.set_sums(file);
            self.pixels.set_cameras(&poses.cameras());
        }
        if let (Some(refinement), Some([total, moments])) = (&mut self.surface.refinement, &normals)
        {
            refinement.offsets.set_state([total, moments]);
            refinement.restore_surface(file);
        }
        self.density = density;
        (self.counts.step, self.counts.updates, self.counts.skipped) =
            (counters[0], counters[1], counters[2]);
        self.derive();
        Ok(())
    }
}

/// The `n` values of an array; `None` where there is none of that name, as in runs from before it was kept.
fn where_stored(
    file: &TensorFile,
    name: &str,
    n: usize,
) -> Result<Option<Vec<f32>>, TensorFileError> {
    let is_stored = n > 0 && file.tensor(name).is_ok();
    is_stored
        .then(|| Ok(file.f32(name, &[n])?.to_vec()))
        .transpose()
}

/// The density cache of a checkpoint with `n` cells.
fn stored_density(file: &TensorFile, n: usize) -> Result<DensityGrid, TrainError> {
    let cells = file.u16("density.cells", &[n])?.to_vec();
    let mut density = DensityGrid::from_cells(cells).ok_or_else(|| TrainError::Checkpoint {
        file: file.origin().to_owned(),
        what: "has another density grid",
    })?;
    density.floor = Floor::stored(file)?;
    density.seen = Some(SeenGrid::stored(file)?.unwrap_or_default());
    Ok(density)
}

fn insert(file: &mut TensorFile, name: &str, values: &[f32]) {
    file.insert_f32(name, &[values.len()], values.to_vec());
}
