//! Adam (Kingma and Ba, arXiv:1412.6980) over flat parameter vectors.

use super::tasks::Job;
use crate::neif::kernels::math::bf16_from_f32;
use crate::neif::kernels::{Isa, dispatch};

const BETA1: f32 = 0.9;
const BETA2: f32 = 0.99;
/// Small, as grid values see gradients of 1e-8 (instant-ngp's choice); 0 would divide by zero where none came yet.
const EPSILON: f32 = 1e-15;
/// Parameters of a cache line: a line without any gradient is left as it is, moments included. Most of a grid's values are
/// touched by few steps, and the update is as fast as memory (instant-ngp skips them too, Sec. 4 of arXiv:2201.05989).
const LINE: usize = 16;
/// Parameters a job takes.
const BLOCK: usize = 1 << 15;

/// First and second moments of a parameter vector.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::train) struct Adam {
    /// Running mean of the gradient.
    pub first: Vec<f32>,
    /// Running mean of its square.
    pub second: Vec<f32>,
}

impl Adam {
    /// Zero moments for `n` parameters.
    pub(in crate::train) fn new(n: usize) -> Self {
        Self {
            first: vec![0.0; n],
            second: vec![0.0; n],
        }
    }

    /// One step, the `step`-th (from 1): `params[i]` moves by at most about `lr(i)`; the head `..n_head` has `lr_head`.
    /// Leaves the gradient zero: clearing it here, while it is in cache, saves a pass over it.
    pub(in crate::train) fn update(
        &mut self,
        params: &mut [f32],
        gradient: &mut [f32],
        rates: Rates,
        step: u64,
    ) {
        let mut jobs = Vec::new();
        let followed = Followed {
            params,
            gradient,
            tail_bf16: &mut [],
            averaged: &mut [],
        };
        self.jobs(followed, rates, step, 0.0, &mut jobs);
        for job in jobs {
            job();
        }
    }

    /// The jobs of such a step. Each also writes its part of the tail in bf16, and lets the running means follow by
    /// `mean_share` of the way, where there are any.
    pub(super) fn jobs<'a>(
        &'a mut self,
        of: Followed<'a>,
        rates: Rates,
        step: u64,
        mean_share: f32,
        jobs: &mut Vec<Job<'a>>,
    ) {
        let n = of.params.len();
        let (n_bf16, n_averaged) = (of.tail_bf16.len(), of.averaged.len());
        assert!(
            n == self.first.len()
                && n == of.gradient.len()
                && (n_bf16 == 0 || n_bf16 == n - rates.n_head)
                && (n_averaged == 0 || n_averaged == n),
            "adam: lengths differ"
        );
        let bias1 = 1.0 - f64::from(BETA1).powf(step as f64);
        let bias2 = 1.0 - f64::from(BETA2).powf(step as f64);
        let unbias = (bias2.sqrt() / bias1) as f32;
        let epsilon = EPSILON * bias2.sqrt() as f32;
        let (p_head, p_tail) = of.params.split_at_mut(rates.n_head);
        let (m_head, m_tail) = self.first.split_at_mut(rates.n_head);
        let (v_head, v_tail) = self.second.split_at_mut(rates.n_head);
        let (g_head, g_tail) = of.gradient.split_at_mut(rates.n_head);
        let (a_head, a_tail) = of.averaged.split_at_mut(rates.n_head.min(n_averaged));
        let head = ([p_head, m_head, v_head, g_head], &mut [][..], a_head);
        let tail = ([p_tail, m_tail, v_tail, g_tail], of.tail_bf16, a_tail);
        for (rate, decay, (vectors, copy, means)) in [
            (rates.head, 0.0, head),
            (rates.tail, rates.tail_decay, tail),
        ] {
            let numbers = [rate * unbias, epsilon, decay];
            let [p, m, v, g] = vectors.map(|values| values.chunks_mut(BLOCK));
            let (mut copies, mut means) = (copy.chunks_mut(BLOCK), means.chunks_mut(BLOCK));
            for ((p, m), (v, g)) in p.zip(m).zip(v.zip(g)) {
                let copy = copies.next().unwrap_or_default();
                let means = means.next().unwrap_or_default();
                jobs.push(Box::new(move || {
                    adam_block(p, m, v, g, numbers);
                    store_bf16(p, copy);
                    if mean_share > 0.0 {
                        average(p, mean_share, means);
                    }
                }));
            }
        }
    }
}

/// Vectors of a parameter each.
#[derive(Debug)]
pub(super) struct Followed<'a> {
    pub(super) params: &'a mut [f32],
    pub(super) gradient: &'a mut [f32],
    /// Copy of the tail, or empty.
    pub(super) tail_bf16: &'a mut [u16],
    /// Running means, or empty.
    pub(super) averaged: &'a mut [f32],
}

fn average(params: &[f32], share: f32, means: &mut [f32]) {
    for (mean, param) in means.iter_mut().zip(params) {
        *mean += share * (param - *mean);
    }
}

/// Learning rates of the networks (the head of the vector) and of the grid (the rest).
#[derive(Clone, Copy, Debug)]
pub(in crate::train) struct Rates {
    /// Parameters in the head.
    pub n_head: usize,
    /// Their rate.
    pub head: f32,
    /// The rate of the rest.
    pub tail: f32,
    /// Weight of half the square of each of the rest in the loss of the steps that have a gradient for it.
    pub tail_decay: f32,
}

dispatch! {
    /// Rounds `values` to bf16.
    pub(super) fn store_bf16(values: &[f32], out: &mut [u16]) = store_bf16_body
}

#[inline(always)]
#[expect(
    clippy::extra_unused_type_parameters,
    reason = "compiled once an instruction set"
)]
fn store_bf16_body<I: Isa>(values: &[f32], out: &mut [u16]) {
    for (out, value) in out.iter_mut().zip(values) {
        *out = bf16_from_f32(*value);
    }
}

dispatch! {
    fn adam_block(params: &mut [f32], first: &mut [f32], second: &mut [f32], gradient: &mut [f32], numbers: [f32; 3]) = adam_body
}

#[inline(always)]
#[expect(
    clippy::extra_unused_type_parameters,
    reason = "compiled once an instruction set"
)]
fn adam_body<I: Isa>(
    params: &mut [f32],
    first: &mut [f32],
    second: &mut [f32],
    gradient: &mut [f32],
    [rate, epsilon, decay]: [f32; 3],
) {
    let lines = params
        .chunks_mut(LINE)
        .zip(first.chunks_mut(LINE))
        .zip(second.chunks_mut(LINE).zip(gradient.chunks_mut(LINE)));
    for ((params, first), (second, gradient)) in lines {
        // Bits of +0 and -0 without the sign are 0; a NaN's are not.
        if gradient.iter().fold(0, |bits, g| bits | g.to_bits()) << 1 == 0 {
            continue;
        }
        for (((p, m), v), g) in params.iter_mut().zip(first).zip(second).zip(gradient) {
            // What the photos say nothing about is not drawn to zero.
            let drawn = if *g == 0.0 { 0.0 } else { decay * *p };
            *g += drawn;
            *m += (1.0 - BETA1) * (*g - *m);
            *v += (1.0 - BETA2) * (*g * *g - *v);
            *p -= rate * *m / (v.sqrt() + epsilon);
            *g = 0.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_agree_with_the_defining_formula() {
        let mut params = vec![1.0_f32, -2.0, 0.5];
        let mut adam = Adam::new(3);
        let mut reference = [1.0_f64, -2.0, 0.5];
        let (mut m, mut v) = ([0.0_f64; 3], [0.0_f64; 3]);
        let rates = Rates {
            n_head: 1,
            head: 0.01,
            tail: 0.1,
            tail_decay: 0.02,
        };
        for step in 1..=20_u64 {
            let gradient: Vec<f32> = (0..3).map(|i| ((step * 3 + i) as f32).sin()).collect();
            let mut copy = [0; 2];
            let mut means = params.clone();
            let before = params.clone();
            let followed = Followed {
                params: &mut params,
                gradient: &mut gradient.clone(),
                tail_bf16: &mut copy,
                averaged: &mut means,
            };
            let mut jobs = Vec::new();
            adam.jobs(followed, rates, step, 0.25, &mut jobs);
            for job in jobs {
                job();
            }
            let quarter = before[2] + 0.25 * (params[2] - before[2]);
            assert!((means[2] - quarter).abs() < 1e-6, "the running mean");
            assert_eq!(copy[1], bf16_from_f32(params[2]), "the tail's copy");
            for i in 0..3 {
                let decay = if i == 0 { 0.0 } else { 0.02 };
                let g = f64::from(gradient[i]) + decay * reference[i];
                m[i] = 0.9 * m[i] + 0.1 * g;
                v[i] = 0.99 * v[i] + 0.01 * g * g;
                let (mh, vh) = (
                    m[i] / (1.0 - 0.9_f64.powi(step as i32)),
                    v[i] / (1.0 - 0.99_f64.powi(step as i32)),
                );
                reference[i] -= if i == 0 { 0.01 } else { 0.1 } * mh / (vh.sqrt() + 1e-15);
            }
        }
        for i in 0..3 {
            assert!(
                (f64::from(params[i]) - reference[i]).abs() < 1e-4,
                "{i}: {} against {}",
                params[i],
                reference[i]
            );
        }
    }

    #[test]
    fn untouched_parameters_stay() {
        let rates = Rates {
            n_head: 0,
            head: 0.0,
            tail: 1.0,
            tail_decay: 0.5,
        };
        let mut first_touched = [0.0; 10];
        first_touched[0] = 1.0;
        for (mut gradient, n_touched) in [([0.0; 10], 0), (first_touched, 1)] {
            let mut params = vec![3.0; 10];
            Adam::new(10).update(&mut params, &mut gradient, rates, 1);
            let (touched, untouched) = params.split_at(n_touched);
            assert!(touched.iter().all(|p| *p < 3.0), "{params:?}");
            assert!(untouched.iter().all(|p| *p == 3.0), "{params:?}");
        }
    }
}
