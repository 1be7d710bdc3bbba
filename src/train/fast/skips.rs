//! What the shortcuts of training leave out, as shares for people.

use serde::Serialize;

use crate::neif::field::density_grid::DensityGrid;
use crate::neif::field::radiance_field::FieldBatch;
use crate::neif::field::skip_counts::SkipCounts;
use crate::neif::networks::hash_grid::Level;

/// Shares that the shortcuts left out, each in `[0, 1]` of what would be done without it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SkipShares {
    /// Of the way along rays: next to no density, so that samples go elsewhere.
    pub empty_space: f32,
    /// Of the way along rays: behind something opaque.
    pub behind_opaque: f32,
    /// Of the samples: inside the object or at the surface that a lobe starts from.
    pub inside_object: f32,
    /// Of the samples: too small a gradient for the backward pass.
    pub weak_gradient: f32,
    /// Of the look-ups in the grid: levels finer than the footprint.
    pub fine_levels: f32,
}

impl SkipShares {
    /// Of the rays of a step; 0 where nothing was done.
    pub(super) fn of<'a>(
        batches: impl Iterator<Item = &'a FieldBatch>,
        levels: &[Level],
        density: &DensityGrid,
    ) -> Self {
        let mut counts = SkipCounts::default();
        for batch in batches {
            counts.add(batch, levels, density);
        }
        let share = |part: u64, whole: u64| part as f32 / whole.max(1) as f32;
        Self {
            empty_space: share(counts.empty_steps, counts.steps),
            behind_opaque: share(counts.hidden_steps, counts.steps),
            inside_object: share(counts.void_samples, counts.samples),
            weak_gradient: share(counts.weak_samples, counts.samples),
            fine_levels: share(counts.fine_looks, counts.looks),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::train::config::TrainConfig;
    use crate::train::fast::Fast;
    use crate::train::scene_model::SceneModel as _;
    use crate::train::test_scene::sphere_in_a_box;

    #[test]
    fn shares_are_of_the_last_step() {
        let dataset = sphere_in_a_box(5, 16);
        let config = TrainConfig::preset("fast").expect("a preset");
        let trainer = Fast::trainer(&config, &dataset, &AtomicBool::new(false), &|_| {});
        let mut trainer = trainer.expect("a trainer");
        assert_eq!(
            trainer.model.skips().expect("it has shortcuts"),
            SkipShares::default(),
            "nothing was done yet"
        );
        for _ in 0..3 {
            trainer.step(0.0);
        }
        let skips = trainer.model.skips().expect("it has shortcuts");
        let shares = [
            skips.empty_space,
            skips.behind_opaque,
            skips.inside_object,
            skips.weak_gradient,
            skips.fine_levels,
        ];
        assert!(
            shares.iter().all(|share| (0.0..=1.0).contains(share)),
            "{skips:?}"
        );
        assert!(
            skips.inside_object > 0.0 && skips.fine_levels > 0.0,
            "lobes start on the sphere and are wide: {skips:?}"
        );
    }
}
