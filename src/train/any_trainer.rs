//! The trainer of either model behind one name: what the session drives.

use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::TrainError;
use super::config::TrainConfig;
use super::paper::PaperTrainer;
use super::photos::poses::Poses;
use super::priors::depth_evidence::SeenDepths;
use super::session::saved::snapshot::Snapshot;
use super::step::skips::SkipShares;
use super::step::trainer::{StepStats, Trainer};
use crate::data::Dataset;
use crate::data::files::tensor_file::TensorFile;

/// A plain value, like the two that it stands for.
#[derive(Debug)]
pub enum AnyTrainer {
    /// Grids and small networks.
    Fast(Box<Trainer>),
    /// The paper's networks.
    Paper(Box<PaperTrainer>),
}

/// The same expression for either kind.
macro_rules! either {
    ($self:expr, $trainer:ident => $value:expr) => {
        match $self {
            AnyTrainer::Fast($trainer) => $value,
            AnyTrainer::Paper($trainer) => $value,
        }
    };
}

impl AnyTrainer {
    /// The trainer of the model that the configuration names.
    ///
    /// # Errors
    /// When cancelled, when the configuration is unusable, or when no pixel can be trained on.
    pub fn new(
        config: &TrainConfig,
        dataset: &Dataset,
        cancel: &AtomicBool,
        on_progress: &(dyn Fn(f32) + Sync),
    ) -> Result<Self, TrainError> {
        Ok(if config.paper.is_some() {
            let trainer = PaperTrainer::new(config, dataset, cancel, on_progress)?;
            Self::Paper(Box::new(trainer))
        } else {
            let trainer = Trainer::new(config, dataset, cancel, on_progress)?;
            Self::Fast(Box::new(trainer))
        })
    }

    /// Takes one step; `progress` in 0..1 drives the learning rates' decay.
    pub fn step(&mut self, progress: f32) -> StepStats {
        either!(self, trainer => trainer.step(progress))
    }

    /// Steps taken.
    pub fn steps(&self) -> u64 {
        either!(self, trainer => trainer.steps())
    }

    /// Steps that learned nothing because a value was not finite.
    pub fn skipped_steps(&self) -> u64 {
        either!(self, trainer => trainer.skipped_steps())
    }

    /// Field samples a ray.
    pub fn samples_per_ray(&self) -> f32 {
        either!(self, trainer => trainer.samples_per_ray())
    }

    /// What the shortcuts left out of the last step; the paper's own model has none.
    pub fn skips(&self) -> Option<SkipShares> {
        match self {
            Self::Fast(trainer) => Some(trainer.skips()),
            Self::Paper(_) => None,
        }
    }

    /// Whether the normals of the mesh are refined.
    pub fn refines_normals(&self) -> bool {
        match self {
            Self::Fast(trainer) => trainer.refines_normals(),
            Self::Paper(_) => false,
        }
    }

    /// Lets snapshots have the normals as they are known by now.
    pub fn settle_normals(&mut self) {
        if let Self::Fast(trainer) = self {
            trainer.settle_normals();
        }
    }

    /// Whether the pixels' light paths change while training, as normals or poses are refined.
    pub fn needs_retracing(&self) -> bool {
        match self {
            Self::Fast(trainer) => trainer.needs_retracing(),
            Self::Paper(_) => false,
        }
    }

    /// Moves a mesh made of outlines to where its refined normals want it; the pixels are to be traced anew then.
    ///
    /// # Errors
    /// When cancelled.
    pub fn move_surface(
        &mut self,
        dataset: &Dataset,
        cancel: &AtomicBool,
    ) -> Result<(), TrainError> {
        match self {
            Self::Fast(trainer) => trainer.move_surface(dataset, cancel),
            Self::Paper(_) => Ok(()),
        }
    }

    /// Whether the light paths of a restored trainer are to be traced anew.
    pub fn has_first_paths(&self) -> bool {
        match self {
            Self::Fast(trainer) => trainer.has_first_paths(),
            Self::Paper(_) => false,
        }
    }

    /// Object pixels that the steps of the part `[from, to]` of a plan of `n_steps` draw.
    pub fn draws(&self, n_steps: f64, [from, to]: [f32; 2]) -> usize {
        match self {
            Self::Fast(trainer) => trainer.draws(n_steps, [from, to]),
            Self::Paper(_) => 0,
        }
    }

    /// Traces training pixels anew where [`Self::needs_retracing`], of the object about `most_objects`; `on_progress` hears
    /// the share that is done, 0 to 1.
    ///
    /// # Errors
    /// When cancelled.
    pub fn retrace(
        &mut self,
        dataset: &Dataset,
        most_objects: usize,
        cancel: &AtomicBool,
        on_progress: &(dyn Fn(f32) + Sync),
    ) -> Result<(), TrainError> {
        match self {
            Self::Fast(trainer) => trainer.retrace(dataset, most_objects, cancel, on_progress),
            Self::Paper(_) => Ok(()),
        }
    }

    /// What each training photo's exposure multiplies radiance by, in the capture's order; `None` where all are alike.
    pub fn gains(&self) -> Option<&[Vec3]> {
        match self {
            Self::Fast(trainer) => trainer.gains(),
            Self::Paper(_) => None,
        }
    }

    /// The poses of the training photos as they are known by now; `None` where they are taken as given.
    pub fn poses(&self) -> Option<&Poses> {
        match self {
            Self::Fast(trainer) => trainer.poses(),
            Self::Paper(_) => None,
        }
    }

    /// How far the outlines of the masks err about the mesh's silhouettes, pixels (standard deviation); 0 where they are exact.
    pub fn outline_error_px(&self) -> f32 {
        either!(self, trainer => trainer.pixels.outline_error_px())
    }

    /// Training photos in which pixels of the object have their chroma in common, where that is made use of.
    pub fn n_sharing_chroma(&self) -> usize {
        either!(self, trainer => trainer.pixels.n_sharing_chroma())
    }

    /// Share of the photos' pixels whose depth was estimated from the photos before training, `[0, 1]`.
    pub fn share_of_depths(&self) -> f32 {
        let depths = either!(self, trainer => trainer.pixels.depths.as_ref());
        depths.map_or(0.0, SeenDepths::share)
    }

    /// The model as it stands.
    pub fn snapshot(&self) -> Snapshot {
        either!(self, trainer => trainer.snapshot())
    }

    /// All that the run needs to go on.
    pub fn checkpoint(&self) -> TensorFile {
        either!(self, trainer => trainer.checkpoint())
    }

    /// Goes on from a checkpoint.
    ///
    /// # Errors
    /// When the file is no checkpoint of this model.
    pub fn restore(&mut self, file: &TensorFile) -> Result<(), TrainError> {
        either!(self, trainer => trainer.restore(file))
    }
}
