//! Exposure and white balance of each training photo: known before ([`super::ground::gains_by_ground`]), or learned beside the fields.
//!
//! A photo shows `gain * radiance`, a gain a colour. Only the photos' differences can be told: the gains' geometric mean
//! over the photos is held at 1, which is how held-out photos are shown.

use glam::Vec3;

use super::adam::{Adam, Rates};

/// Pull of the logarithms towards 0, against the squared error of the photos' colours: what hardly any pixel tells of
/// keeps the mean exposure.
const PULL: f32 = 0.01;
/// Largest logarithm: a black photo would have its gain fall without end.
const MOST: f32 = 3.0;

/// The gains and their moments.
#[derive(Clone, Debug)]
pub(super) struct Exposures {
    /// `[n_views * 3]`.
    log_gains: Vec<f32>,
    gradient: Vec<f32>,
    adam: Adam,
    gains: Vec<Vec3>,
    /// Whether they are known, not learned.
    is_held: bool,
}

impl Exposures {
    /// All alike, to be learned.
    pub(super) fn new(n_views: usize) -> Self {
        let mut exposures = Self::held(&vec![Vec3::ZERO; n_views]);
        exposures.is_held = false;
        exposures
    }

    /// Known from logarithms of the gains, whose mean is 0.
    pub(super) fn held(log_gains: &[Vec3]) -> Self {
        let n = 3 * log_gains.len();
        let mut exposures = Self {
            log_gains: log_gains.iter().flat_map(Vec3::to_array).collect(),
            gradient: vec![0.0; n],
            adam: Adam::new(n),
            gains: vec![Vec3::ONE; log_gains.len()],
            is_held: true,
        };
        exposures.derive();
        exposures
    }

    /// By training view, in linear light.
    pub(super) fn gains(&self) -> &[Vec3] {
        &self.gains
    }

    /// One step, the `step`-th (from 1), from gradients by the logarithms of single views' gains; none where they are known.
    pub(super) fn update<'a>(
        &mut self,
        gradients: impl Iterator<Item = &'a (usize, Vec3)>,
        rate: f32,
        step: u64,
    ) {
        if self.is_held {
            return;
        }
        for (view, d) in gradients {
            let sums = &mut self.gradient[3 * view..3 * view + 3];
            for (sum, d) in sums.iter_mut().zip(d.to_array()) {
                *sum += d;
            }
        }
        let pull = PULL / self.gains.len().max(1) as f32;
        for (d, log_gain) in self.gradient.iter_mut().zip(&self.log_gains) {
            *d += pull * log_gain;
        }
        let rates = Rates {
            n_head: self.log_gains.len(),
            head: rate,
            tail: 0.0,
        };
        self.adam
            .update(&mut self.log_gains, &mut self.gradient, rates, step);
        self.center();
        self.derive();
    }

    /// Logarithms, first and second moments.
    pub(super) fn state(&self) -> [&[f32]; 3] {
        [&self.log_gains, &self.adam.first, &self.adam.second]
    }

    /// Goes on from there; the lengths must be those of [`Self::state`].
    pub(super) fn set_state(&mut self, [log_gains, first, second]: [Vec<f32>; 3]) {
        assert_eq!(log_gains.len(), self.log_gains.len(), "gains of all views");
        self.log_gains = log_gains;
        self.adam = Adam { first, second };
        self.derive();
    }

    /// Holds the mean of the logarithms at 0, by colour.
    fn center(&mut self) {
        for c in 0..3 {
            let of_color = || self.log_gains.iter().skip(c).step_by(3);
            let mean = of_color().sum::<f32>() / self.gains.len().max(1) as f32;
            let of_color = self.log_gains.iter_mut().skip(c).step_by(3);
            of_color.for_each(|log_gain| *log_gain = (*log_gain - mean).clamp(-MOST, MOST));
        }
    }

    fn derive(&mut self) {
        for (gain, log_gain) in self.gains.iter_mut().zip(self.log_gains.chunks_exact(3)) {
            *gain = Vec3::from_slice(log_gain).exp();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_that_differ_are_found_around_a_mean_of_one() {
        let truth = [
            Vec3::new(0.4, 0.0, -0.1),
            Vec3::new(-0.4, 0.2, 0.0),
            Vec3::new(0.0, -0.2, 0.1),
        ];
        let mut exposures = Exposures::new(3);
        for step in 1..=1500 {
            let gradients: Vec<(usize, Vec3)> = (0..3)
                .map(|view| (view, exposures.gains()[view] - truth[view].exp()))
                .collect();
            exposures.update(gradients.iter(), 0.01, step);
        }
        for (found, truth) in exposures.gains().iter().zip(truth) {
            let apart = (found.map(f32::ln) - truth).abs().max_element();
            assert!(apart < 0.1, "{found} for {truth}");
        }
        let mean = exposures.gains().iter().map(|g| g.x.ln()).sum::<f32>() / 3.0;
        assert!(mean.abs() < 1e-5, "{mean}");
    }
}
