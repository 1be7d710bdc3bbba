//! Exposure and white balance of each training photo: known before ([`crate::train::priors::ground::SeenGround::log_gains`]), or found while the
//! fields are learned.
//!
//! A photo shows `gain * radiance`, a gain a colour. Linear least squares over its pixels, in what is shown, give by how much
//! the logarithms of its gain are off, again and again as the fields sharpen. Where that differs from photo to photo by no more
//! than the fields are wrong, the photos are taken as alike. Only the photos' differences can be determined: the gains'
//! geometric mean over the photos is held at 1, which is how held-out photos are shown.

use glam::Vec3;

use crate::data::files::tensor_file::TensorFile;
use crate::train::TrainError;
use crate::train::config::PhotoFit;
use crate::train::step::loss::PixelLoss;
use crate::train::step::now::Now;
use crate::train::step::part::{Part, finite, insert};
use crate::train::step::tasks::Job;

/// Steps before exposures are found. Much later the field would have learned them itself, from where each photo was taken.
const DELAY: u64 = 50;
/// Steps after which photos that are alike until then are taken as alike for good: looking takes a twentieth of a step.
const LOOKED_AT: u64 = 1000;
/// Steps between two updates: a photo of fifty gives some thousand pixels in that time.
const EVERY: u64 = 50;
/// Share of what is found that is taken up: the fields follow the gains, as they follow these.
const SHARE: f32 = 0.5;
/// Root mean square of the logarithms up to which photos count as alike.
const ALIKE: f32 = 0.04;
/// Difference, in sRGB, from which a pixel counts less: it shows something else, not the same thing exposed otherwise.
const USUAL_DIFFERENCE: f32 = 0.1;
/// Pull of the logarithms towards 0, in pixels' squared slopes: what hardly any pixel constrains keeps the mean exposure.
const PULL: f32 = 0.1;
/// Largest logarithm: a black photo would have its gain fall without end.
const MOST: f32 = 3.0;

/// A pixel's equation: `slope * correction = -difference`, a colour each.
#[derive(Clone, Copy, Debug)]
pub(in crate::train) struct ExposureRow {
    view: usize,
    /// Of what is shown, by the logarithm of the gain.
    slope: Vec3,
    /// What is shown less the target, sRGB.
    difference: Vec3,
}

impl ExposureRow {
    /// Of a pixel that shows `exposed`, gain times radiance.
    pub(in crate::train) fn new(view: usize, exposed: Vec3, loss: &PixelLoss) -> Self {
        Self {
            view,
            slope: loss.slope * exposed,
            difference: loss.difference,
        }
    }
}

/// The gains, and what the photos have contributed to their estimate since they were last updated.
#[derive(Clone, Debug)]
pub(in crate::train) struct Exposures {
    fit: PhotoFit,
    /// Whether they are not sought.
    are_known: bool,
    /// `[n_views]` logarithms.
    log_gains: Vec<Vec3>,
    /// `[n_views]` sums of `slope^2` and `slope * difference`.
    sums: Vec<[Vec3; 2]>,
    /// What they are as applied.
    gains: Vec<Vec3>,
    are_applied: bool,
}

impl Exposures {
    /// All alike, to be found.
    pub(in crate::train) fn new(n_views: usize, fit: PhotoFit) -> Self {
        let mut exposures = Self {
            fit,
            are_known: false,
            log_gains: vec![Vec3::ZERO; n_views],
            sums: vec![[Vec3::ZERO; 2]; n_views],
            gains: Vec::new(),
            are_applied: false,
        };
        exposures.apply();
        exposures
    }

    /// Known from logarithms of the gains, whose mean is 0.
    pub(in crate::train) fn known(log_gains: Vec<Vec3>, fit: PhotoFit) -> Self {
        let mut exposures = Self::new(log_gains.len(), fit);
        exposures.are_known = true;
        exposures.log_gains = log_gains;
        exposures.apply();
        exposures
    }

    /// By training view, in linear light; `None` where all are alike.
    pub(in crate::train) fn gains(&self) -> Option<&[Vec3]> {
        self.are_applied.then_some(&self.gains)
    }

    /// Whether the pixels of step `step` are asked for them.
    pub(in crate::train) fn are_sought(&self, step: u64) -> bool {
        let may_differ = self.are_applied || step < LOOKED_AT;
        !self.are_known && step >= DELAY && may_differ
    }

    /// Takes up the equations of step `step`, while they are sought.
    pub(in crate::train) fn gather<'a>(
        &mut self,
        step: u64,
        rows: impl Iterator<Item = &'a ExposureRow>,
    ) {
        if !self.are_sought(step) {
            return;
        }
        for row in rows {
            let ratio = row.difference / USUAL_DIFFERENCE;
            let weighted = row.slope / (1.0 + ratio * ratio);
            let [slopes, differences] = &mut self.sums[row.view];
            *slopes += weighted * row.slope;
            *differences += weighted * row.difference;
        }
    }

    /// Corrects all by what was taken up since the last time.
    fn correct(&mut self) {
        for (i, sums) in self.sums.iter_mut().enumerate() {
            let [slopes, differences] = std::mem::take(sums);
            let applied = self.gains[i].map(f32::ln);
            let found = applied - (differences + PULL * applied) / (slopes + PULL);
            if found.is_finite() {
                let log_gain = &mut self.log_gains[i];
                *log_gain = log_gain.lerp(found, SHARE);
            }
        }
        let mean = self.log_gains.iter().sum::<Vec3>() / self.log_gains.len().max(1) as f32;
        for log_gain in &mut self.log_gains {
            *log_gain = (*log_gain - mean).clamp(Vec3::splat(-MOST), Vec3::splat(MOST));
        }
        self.apply();
    }

    /// Root mean square of the logarithms, over photos and colours.
    fn spread(&self) -> f32 {
        let squares: f32 = self.log_gains.iter().map(|v| v.length_squared()).sum();
        (squares / (3 * self.log_gains.len().max(1)) as f32).sqrt()
    }

    fn apply(&mut self) {
        self.are_applied = self.fit != PhotoFit::Auto || self.spread() > ALIKE;
        self.gains = if self.are_applied {
            self.log_gains.iter().map(|v| v.exp()).collect()
        } else {
            vec![Vec3::ONE; self.log_gains.len()]
        };
    }
}

/// Arrays of a checkpoint, `[n_views * 3]` and `[n_views * 6]`.
const LOG_GAINS: &str = "exposures.log_gains";
const SUMS: &str = "exposures.sums";

/// Not there where photos are taken as alike.
impl Part for Option<Exposures> {
    fn update<'a>(&'a mut self, now: &Now<'_>, _jobs: &mut Vec<Job<'a>>) {
        if let Some(exposures) = self
            && exposures.are_sought(now.step)
            && now.step.is_multiple_of(EVERY)
        {
            exposures.correct();
        }
    }

    fn store(&self, file: &mut TensorFile) {
        let Some(exposures) = self else {
            return;
        };
        insert(file, LOG_GAINS, &flattened(&exposures.log_gains));
        insert(file, SUMS, &flattened(exposures.sums.as_flattened()));
    }

    /// A run that was stored without goes on without.
    fn restore(&mut self, file: &TensorFile) -> Result<(), TrainError> {
        let Some(exposures) = self else {
            return Ok(());
        };
        if file.tensor(LOG_GAINS).is_err() {
            *self = None;
            return Ok(());
        }
        let n = 3 * exposures.log_gains.len();
        let log_gains = finite(file, LOG_GAINS, n)?;
        let sums = finite(file, SUMS, 2 * n)?;
        set(&mut exposures.log_gains, &log_gains);
        set(exposures.sums.as_flattened_mut(), &sums);
        exposures.apply();
        Ok(())
    }
}

fn flattened(colors: &[Vec3]) -> Vec<f32> {
    colors.iter().flat_map(Vec3::to_array).collect()
}

fn set(colors: &mut [Vec3], numbers: &[f32]) {
    for (color, stored) in colors.iter_mut().zip(numbers.chunks_exact(3)) {
        *color = Vec3::from_slice(stored);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::srgb_from_linear;
    use crate::neif::light::display::Display;
    use crate::train::step::loss::pixel_loss;

    /// The equations of pixels of every photo as bright as `truth` says, under gains as they are applied.
    fn rows(exposures: &Exposures, truth: &[Vec3]) -> Vec<ExposureRow> {
        let shown =
            |radiance: f32, log_gain: Vec3| (radiance * log_gain.exp()).map(srgb_from_linear);
        let row = |k: usize| {
            let (view, radiance) = (k % truth.len(), 0.05 + 0.01 * (k % 40) as f32);
            let exposed = radiance * exposures.gains[view];
            let target = shown(radiance, truth[view]).to_array();
            let loss = pixel_loss(Display { gamma: 1.0 }, exposed, target);
            ExposureRow::new(view, exposed, &loss)
        };
        (0..600).map(row).collect()
    }

    fn found(truth: &[Vec3], fit: PhotoFit) -> Exposures {
        let mut exposures = Exposures::new(truth.len(), fit);
        for _ in 0..20 {
            let rows = rows(&exposures, truth);
            exposures.gather(EVERY, rows.iter());
            exposures.correct();
        }
        exposures
    }

    #[test]
    fn gains_that_differ_are_found_around_a_mean_of_one() {
        let truth = [
            Vec3::new(0.4, 0.0, -0.1),
            Vec3::new(-0.4, 0.2, 0.0),
            Vec3::new(0.0, -0.2, 0.1),
        ];
        let exposures = found(&truth, PhotoFit::Auto);
        let gains = exposures.gains().expect("they differ");
        for (found, truth) in gains.iter().zip(truth) {
            let apart = (found.map(f32::ln) - truth).abs().max_element();
            assert!(apart < 0.01, "{found} for {truth}");
        }
        let mean = gains.iter().map(|g| g.x.ln()).sum::<f32>() / 3.0;
        assert!(mean.abs() < 1e-5, "{mean}");
    }

    #[test]
    fn photos_that_hardly_differ_are_alike_unless_somebody_says_otherwise() {
        let truth = [Vec3::splat(0.02), Vec3::splat(-0.02)];
        assert_eq!(found(&truth, PhotoFit::Auto).gains(), None);
        let forced = found(&truth, PhotoFit::On);
        let gains = forced.gains().expect("it is said otherwise");
        let ratio = gains[0].x / gains[1].x;
        assert!((ratio - 1.04).abs() < 0.005, "{ratio}");
    }
}
