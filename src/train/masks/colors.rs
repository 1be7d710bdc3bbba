//! How likely a colour is on the object or beside it: histograms.

use crate::train::statistics::with_neighbours;

/// Bins of a channel.
const BINS: usize = 16;
/// Added to each bin: a colour that was never seen is not impossible.
const UNSEEN: f32 = 1e-3;
/// Blur of the bins along each channel: the middle, then each neighbour (a normal of 0.8 bins).
const BLUR: [f32; 2] = [0.52, 0.24];

/// A distribution of display colours.
#[derive(Clone, Debug)]
pub(super) struct Histogram {
    /// `[BINS red][BINS green][BINS blue]`, of sum 1.
    shares: Vec<f32>,
}

fn bin([red, green, blue]: [f32; 3]) -> usize {
    let of = |v: f32| ((v * BINS as f32) as usize).min(BINS - 1);
    (of(red) * BINS + of(green)) * BINS + of(blue)
}

impl Histogram {
    /// Of these colours, sRGB 0..1.
    pub(super) fn of(colors: impl Iterator<Item = [f32; 3]>) -> Self {
        let mut counts = vec![0.0_f32; BINS.pow(3)];
        for color in colors {
            counts[bin(color)] += 1.0;
        }
        let blurred =
            |before: f32, count: f32, after: f32| BLUR[0] * count + BLUR[1] * (before + after);
        for stride in [1, BINS, BINS * BINS] {
            counts = with_neighbours(&counts, (BINS, stride), blurred);
        }
        let sum: f32 = counts.iter().map(|count| count + UNSEEN).sum();
        for count in &mut counts {
            *count = (*count + UNSEEN) / sum;
        }
        Self { shares: counts }
    }

    /// The share of colours like this one.
    pub(super) fn share(&self, color: [f32; 3]) -> f32 {
        self.shares[bin(color)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_colour_is_likely_where_it_was_seen_and_nowhere_impossible() {
        let reds = Histogram::of((0..100).map(|_| [0.9, 0.1, 0.1]));
        let blues = Histogram::of((0..1000).map(|_| [0.1, 0.1, 0.9]));
        let sum: f32 = reds.shares.iter().sum();
        assert!((sum - 1.0).abs() < 1e-4, "{sum}");
        assert!(reds.share([0.88, 0.12, 0.1]) > 1e3 * blues.share([0.88, 0.12, 0.1]));
        assert!(
            reds.share([0.83, 0.1, 0.1]) > 10.0 * reds.share([0.5, 0.5, 0.5]),
            "a neighbour"
        );
        assert!(blues.share([0.5; 3]) > 0.0);
    }
}
