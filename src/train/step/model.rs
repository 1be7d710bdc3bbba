//! What a trainer trains: the interface of the models, and what a step of theirs reports.

use std::fmt;

use super::now::Now;
use super::part::Part;

/// A model under training. The trainer calls these in order, step after step.
pub trait Model: fmt::Debug + Send {
    /// Marks the metadata of its checkpoints.
    fn format(&self) -> &'static str;

    /// Draws pixels, predicts them, compares them with the photos, and goes back: chunk by chunk, whose gradients stay there.
    fn run(&mut self, now: &Now<'_>, on_done: &mut dyn FnMut(Stage)) -> StepStats;

    /// Hands the chunks' gradients to the parts, summed in order. Not called when a value was not finite.
    fn gather(&mut self, now: &Now<'_>);

    /// All that is learned. They are updated after [`Self::gather`], and make up a checkpoint.
    fn parts(&mut self) -> Vec<&mut dyn Part>;

    /// Follows the parts, after an update and after a checkpoint was read.
    fn follow(&mut self) {}

    /// Looks where steps do not lead, now and then; whether it did.
    fn probe(&mut self, _now: &Now<'_>) -> bool {
        false
    }
}

/// The parts of a step, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, strum::VariantArray)]
pub enum Stage {
    /// Pixels drawn, surfaces evaluated, lobes aimed, samples placed.
    Prepare,
    /// Grid features of the field.
    Encode,
    /// Networks, compositing, pixel equation, loss, and back.
    Networks,
    /// Grid gradients, sums, density cache.
    Gather,
    /// Adam.
    Update,
    /// Random looks into the density cache, every 16th step.
    Probe,
}

/// What a step did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepStats {
    /// Weighted sum of all terms.
    pub loss: f32,
    /// Mean squared error of object pixels, summed over the colours.
    pub loss_object: f32,
    /// The same for background pixels.
    pub loss_background: f32,
    /// Field rays evaluated.
    pub rays: u32,
    /// Field samples evaluated.
    pub samples: u32,
    /// Whether a value was not finite, so that nothing was learned.
    pub skipped: bool,
}
