//! Random numbers addressed by (seed, step, slot): no state to store, the same for any number of threads.

/// A short stream of numbers of one slot in one step.
#[derive(Clone, Copy, Debug)]
pub(super) struct SlotRandom {
    state: u64,
}

impl SlotRandom {
    /// The stream of `slot` in `step`.
    pub(super) fn new(seed: u64, step: u64, slot: u64) -> Self {
        let mut state = mix(seed);
        state = mix(state ^ step);
        Self {
            state: mix(state ^ slot.rotate_left(32)),
        }
    }

    /// 64 random bits: `SplitMix64` (Steele, Lea, Flood, "Fast splittable pseudorandom number generators").
    pub(super) fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        finalize(self.state)
    }

    /// Uniform in `[0, 1)`.
    pub(super) fn uniform(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1_u64 << 24) as f32
    }

    /// Uniform in `0..n`; `n` is positive.
    pub(super) fn index(&mut self, n: usize) -> usize {
        ((u128::from(self.bits()) * n as u128) >> 64) as usize
    }
}

fn mix(x: u64) -> u64 {
    finalize(x.wrapping_add(0x9e37_79b9_7f4a_7c15))
}

fn finalize(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_differ_in_every_coordinate_and_are_uniform() {
        let first = |seed, step, slot| SlotRandom::new(seed, step, slot).bits();
        let all = [
            first(0, 0, 0),
            first(1, 0, 0),
            first(0, 1, 0),
            first(0, 0, 1),
            first(1 << 63, 0, 0),
        ];
        for i in 0..all.len() {
            for j in 0..i {
                assert_ne!(all[i], all[j], "streams {i} and {j}");
            }
        }
        let n = 20_000;
        let mean = (0..n)
            .map(|slot| f64::from(SlotRandom::new(3, 9, slot).uniform()))
            .sum::<f64>()
            / n as f64;
        assert!((mean - 0.5).abs() < 0.01, "mean {mean}");
        let mut counts = [0; 5];
        for slot in 0..n {
            counts[SlotRandom::new(3, 9, slot).index(5)] += 1;
        }
        assert!(
            counts.iter().all(|&c| (3600..4400).contains(&c)),
            "{counts:?}"
        );
    }
}
