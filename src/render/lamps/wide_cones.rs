//! By how much the one cone of a rough surface is brighter than the several cones that stand for the same lobe.
//!
//! Photos show tint times light. Where a rough surface alone asks the field for cones as wide as its lobes, that light may be
//! brighter, and its tint darker, than narrow cones say. In other light, or with another roughness, several cones gather the
//! lobe; they take the factor over, so that the surface goes on from what photos show.

use glam::Vec3;

/// Steps of learned roughness from 0 to 1.
const N_STEPS: usize = 33;
/// Difference of roughness up to which a lobe counts.
const REACH: f32 = 0.1;
/// How many lobes that mirror all light say as much as the assumption that there is no difference.
const PRIOR: f32 = 5.0;
/// Share of the lobes that must ask for a factor, or for more of it.
const AGREE: f32 = 0.75;

/// A lobe by one cone and by several.
#[derive(Clone, Copy, Debug)]
pub(in crate::render) struct Compared {
    /// Learned roughness.
    pub(in crate::render) roughness: f32,
    /// How much it is believed.
    pub(in crate::render) trust: f32,
    /// Logarithm of the one cone's radiance over that of several.
    pub(in crate::render) brighter: Vec3,
}

/// The factor by learned roughness.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::render) struct WideCones {
    /// Logarithms; empty where there is no difference.
    steps: Vec<Vec3>,
}

impl WideCones {
    pub(in crate::render) fn of(lobes: &[Compared]) -> Self {
        let step = |k: usize| {
            let roughness = k as f32 / (N_STEPS - 1) as f32;
            let near: Vec<(f32, Vec3)> = lobes
                .iter()
                .filter_map(|lobe| {
                    let inside = 1.0 - ((lobe.roughness - roughness) / REACH).powi(2);
                    (inside > 0.0 && lobe.brighter.is_finite())
                        .then_some((inside * lobe.trust, lobe.brighter))
                })
                .collect();
            let total: f32 = near.iter().map(|(weight, _)| weight).sum();
            let agreed = [0, 1, 2].map(|c| {
                let mut values: Vec<(f32, f32)> = near.iter().map(|(w, v)| (*w, v[c])).collect();
                values.sort_by(|a, b| a.1.total_cmp(&b.1));
                let [low, high] =
                    [1.0 - AGREE, AGREE].map(|share| quantile(&values, share * total));
                0.0_f32.clamp(low, high)
            });
            total / (total + PRIOR) * Vec3::from(agreed)
        };
        Self {
            steps: (0..N_STEPS).map(step).collect(),
        }
    }

    /// Factor of what several cones gather for lobes of this learned roughness.
    pub(in crate::render) fn gain(&self, learned: f32) -> Vec3 {
        let at = learned.clamp(0.0, 1.0) * (N_STEPS - 1) as f32;
        let k = (at as usize).min(N_STEPS - 2);
        let (Some(low), Some(high)) = (self.steps.get(k), self.steps.get(k + 1)) else {
            return Vec3::ONE;
        };
        low.lerp(*high, at - k as f32).map(f32::exp)
    }
}

/// The first of the sorted values, each with its weight, up to which there is that much weight; 0 for none.
fn quantile(values: &[(f32, f32)], weight: f32) -> f32 {
    let mut before = 0.0;
    let first = values.iter().find(|(own, _)| {
        before += own;
        before >= weight
    });
    first.or(values.last()).map_or(0.0, |(_, value)| *value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lobes(factors: &[f32], roughness: f32) -> Vec<Compared> {
        let lobe = |factor: &f32| Compared {
            roughness,
            trust: 1.0,
            brighter: Vec3::new(factor.ln(), 0.0, 0.0),
        };
        factors.iter().cycle().take(400).map(lobe).collect()
    }

    #[test]
    fn several_cones_take_over_what_most_lobes_agree_on() {
        let agreed = WideCones::of(&lobes(&[1.3, 1.4, 1.5, 1.6], 0.5));
        let gain = agreed.gain(0.5);
        assert!(gain.x > 1.25 && gain.x < 1.45, "{gain}");
        assert!((gain.y - 1.0).abs() < 1e-6 && (gain.z - 1.0).abs() < 1e-6);
        assert_eq!(agreed.gain(0.3), Vec3::ONE, "nothing is known of these");
    }

    #[test]
    fn what_lobes_contradict_each_other_in_is_no_factor() {
        let apart = WideCones::of(&lobes(&[0.7, 0.9, 1.0, 1.1, 1.4], 0.5));
        assert_eq!(apart.gain(0.5), Vec3::ONE);
        assert_eq!(WideCones::of(&[]).gain(0.5), Vec3::ONE);
        assert_eq!(WideCones::default().gain(0.5), Vec3::ONE);
        let few = WideCones::of(&lobes(&[2.0], 0.5)[..1]);
        assert!(few.gain(0.5).x < 1.2, "one lobe says little");
    }
}
