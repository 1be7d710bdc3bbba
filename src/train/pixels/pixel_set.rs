//! A set of pixels of one picture from which the k-th is found without a list: one bit each, and running counts.

use std::iter::successors;
use std::ops::Range;

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

    /// Whether pixel `i` is a member; none is beyond the picture.
    pub(super) fn contains(&self, i: u32) -> bool {
        let word = self.words.get(i as usize / 64);
        word.is_some_and(|word| word >> (i % 64) & 1 == 1)
    }

    /// The members, ascending.
    pub(super) fn iter(&self) -> impl Iterator<Item = u32> {
        let of_word = |(at, word): (usize, &u64)| {
            let rest = |word: &u64| Some(word & (word - 1)).filter(|rest| *rest != 0);
            let words = successors(Some(*word).filter(|word| *word != 0), rest);
            words.map(move |word| 64 * at as u32 + word.trailing_zeros())
        };
        self.words.iter().enumerate().flat_map(of_word)
    }

    /// Whether a pixel of the range may be a member; surely not where false.
    pub(super) fn has_any(&self, pixels: Range<u32>) -> bool {
        let words = pixels.start as usize / 64..(pixels.end as usize).div_ceil(64);
        let words = self.words.get(words).unwrap_or_default();
        words.iter().any(|word| *word != 0)
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
            assert!(set.iter().eq(list.iter().copied()), "{n} by {step}");
            for i in 0..n as u32 + 70 {
                let rank = list.iter().position(|member| *member == i);
                assert_eq!(set.rank(i), rank, "pixel {i} of {n} by {step}");
                assert_eq!(
                    set.contains(i),
                    rank.is_some(),
                    "pixel {i} of {n} by {step}"
                );
            }
        }
    }

    #[test]
    fn gaps_of_many_words_are_skipped() {
        let set = PixelSet::new(100_000, |i| i == 3 || i >= 99_998);
        assert_eq!([0, 1, 2].map(|k| set.nth(k)), [3, 99_998, 99_999]);
        assert!(set.has_any(0..64) && set.has_any(99_000..100_000));
        assert!(!set.has_any(64..99_000));
    }
}
