//! How roughness is learned: held at first, then by the width of the lobes.
//!
//! A lobe narrower than that of a mirror looks like one, and its variance hardly depends on its roughness: a surface that reflects
//! little, whose reflections say little, would stay a mirror for good once it has become one. There the slope is that of a mirror.

use super::chunk::{Chunk, N_CHUNKS};
use super::step_context::StepContext;
use crate::neif::light::light_path;
use crate::neif::light::lobe::{Lobe, cone_roughness};
use crate::neif::surface::values::ROUGHNESS_MIN;

/// Roughness while it is not yet learned, and how strongly it is held there. Coming from sharp lobes, environment and
/// roughness settle on sharper ones than coming from blurred lobes: 0.2 dB more of the object than from 0.3.
const INITIAL_ROUGHNESS: f32 = 0.1;
const HOLD_STRENGTH: f32 = 1.0;
/// Most that a slope is multiplied by: at the least roughness the network's output has none.
const MOST_GAIN: f32 = 1000.0;

impl Chunk {
    /// From the rays' lobe variances to the roughness of the paths' vertices.
    pub(super) fn roughness_gradients(&mut self, context: &StepContext<'_>) {
        if context.step < u64::from(context.config.roughness_delay) {
            // The output shares its hidden layer with the others and would drift; a spring holds it.
            let scale = HOLD_STRENGTH / self.material.surfaces.len() as f32 / N_CHUNKS as f32;
            for (d, surface) in self
                .material
                .d_surfaces
                .iter_mut()
                .zip(&self.material.surfaces)
            {
                d.roughness = scale * (surface.roughness - INITIAL_ROUGHNESS);
            }
            return;
        }
        let mirror = Mirror::new();
        for path in &self.paths {
            light_path::roughness_backward(
                &self.lit[path.lit.clone()],
                &self.batch.d_lobe_variance,
                |roughness, lobe| mirror.slope(roughness, lobe),
                &mut self.material.d_surfaces,
            );
        }
    }
}

/// The widest lobe that looks like a mirror's.
struct Mirror {
    roughness: f32,
    /// Slopes of its variance by the roughness, and of that by the network's output.
    d_variance: f32,
    d_roughness: f32,
}

impl Mirror {
    fn new() -> Self {
        let roughness = cone_roughness(0.0);
        Self {
            roughness,
            d_variance: Lobe::from_roughness(roughness).d_variance,
            d_roughness: output_slope(roughness),
        }
    }

    /// Slope of the variance of a surface's lobe by its roughness, with which the network's output has at least as large a one as
    /// a mirror's.
    fn slope(&self, roughness: f32, lobe: &Lobe) -> f32 {
        if roughness >= self.roughness {
            return lobe.d_variance;
        }
        self.d_variance * (self.d_roughness / output_slope(roughness)).min(MOST_GAIN)
    }
}

/// Slope of a roughness by the network's output that is it.
fn output_slope(roughness: f32) -> f32 {
    let share = (roughness - ROUGHNESS_MIN) / (1.0 - ROUGHNESS_MIN);
    (1.0 - ROUGHNESS_MIN) * share * (1.0 - share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lobes_narrower_than_a_mirrors_have_its_slope() {
        let mirror = Mirror::new();
        let slope = |roughness: f32| {
            let by_roughness = mirror.slope(roughness, &Lobe::from_roughness(roughness));
            by_roughness * output_slope(roughness)
        };
        let of_mirror = slope(mirror.roughness);
        assert!(of_mirror > 0.0);
        for roughness in [0.021, 0.05, 0.1] {
            let share = slope(roughness) / of_mirror;
            assert!((share - 1.0).abs() < 1e-3, "{roughness}: {share}");
        }
        // Where the output is saturated in single precision.
        let saturated = mirror.slope(ROUGHNESS_MIN, &Lobe::from_roughness(ROUGHNESS_MIN));
        assert!(saturated.is_finite() && saturated > 0.0);
        let rough = Lobe::from_roughness(0.3);
        assert_eq!(mirror.slope(0.3, &rough), rough.d_variance);
    }
}
