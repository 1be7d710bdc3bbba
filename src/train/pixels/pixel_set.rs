//! A set of pixels of one picture from which the k-th is found without a list: one bit each, and running counts.

/// Words between two running counts.
const BLOCK: usize = 8;

/// A set of indices of pixels, in rising order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct PixelSet {
    /// Bit `i % 64` of word `i / 64` for pixel `i`.
    words: Vec<u64>,
    /// Members before each block of words.
    before: Vec<u32>,
    n: usize,
}

impl PixelSet {
    /// The pixels `i` in `0..n_pixels` for which `is_member(i)`, asked once each in rising order.
    pub(super) fn new(n_pixels: usize, mut is_member: impl FnMut(usize) -> bool) -> Self {
        let mut words = vec![0_u64; n_pixels.div_ceil(64)];
        for i in 0..n_pixels {
            words[i / 64] |= u64::from(is_member(i)) << (i % 64);
        }
        let mut n = 0;
        let blocks = words.chunks(BLOCK).map(|block| {
            let before = n;
            n += block.iter().map(|word| word.count_ones()).sum::<u32>();
            before
        });
        Self {
            before: blocks.collect(),
            n: n as usize,
            words,
        }
    }

    /// Number of members.
    pub(super) fn len(&self) -> usize {
        self.n
    }

    /// How many members are below pixel `i`; `None` where it is none itself or beyond the picture.
    pub(super) fn rank(&self, i: u32) -> Option<usize> {
        let at = i as usize / 64;
        let below = (1_u64 << (i % 64)) - 1;
        let word = *self.words.get(at)?;
        (word >> (i % 64) & 1 == 1).then(|| {
            let block = at / BLOCK;
            let words = &self.words[block * BLOCK..at];
            let n = words.iter().map(|word| word.count_ones()).sum::<u32>();
            (self.before[block] + n + (word & below).count_ones()) as usize
        })
    }

    /// The `k`-th member from below, `k` in `0..len()`.
    pub(super) fn nth(&self, k: usize) -> u32 {
        assert!(k < self.n, "member {k} of {}", self.n);
        let block = self.before.partition_point(|&before| before as usize <= k) - 1;
        let mut left = k as u32 - self.before[block];
        let mut at = block * BLOCK;
        while left >= self.words[at].count_ones() {
            left -= self.words[at].count_ones();
            at += 1;
        }
        let mut word = self.words[at];
        for _ in 0..left {
            word &= word - 1;
        }
        64 * at as u32 + word.trailing_zeros()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kth_member_is_that_of_the_list() {
        for (n, step) in [
            (0, 1),
            (1, 1),
            (64, 1),
            (2000, 1),
            (2000, 7),
            (5000, 613),
            (513, 512),
        ] {
            let set = PixelSet::new(n, |i| i % step == 0);
            let list: Vec<u32> = (0..n as u32).step_by(step).collect();
            assert_eq!(set.len(), list.len(), "{n} by {step}");
            let found: Vec<u32> = (0..set.len()).map(|k| set.nth(k)).collect();
            assert_eq!(found, list, "{n} by {step}");
            for i in 0..n as u32 + 70 {
                let rank = list.iter().position(|member| *member == i);
                assert_eq!(set.rank(i), rank, "pixel {i} of {n} by {step}");
            }
        }
    }

    #[test]
    fn gaps_of_many_words_are_skipped() {
        let set = PixelSet::new(100_000, |i| i == 3 || i >= 99_998);
        assert_eq!([0, 1, 2].map(|k| set.nth(k)), [3, 99_998, 99_999]);
    }
}
