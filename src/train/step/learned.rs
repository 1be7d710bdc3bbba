//! A field under training, with all that its updates need.

use std::fmt;

use super::adam::{Adam, Followed, store_bf16};
use super::chunks::sum_in_order;
use super::now::Now;
use super::part::{Part, finite, insert};
use super::tasks::Job;
use crate::data::files::tensor_file::TensorFile;
use crate::neif::field::radiance_field::RadianceField;
use crate::neif::neilf::IncidentLight;
use crate::neif::networks::hash_grid::Level;
use crate::neif::paper::{PaperField, PaperMaterial};
use crate::neif::surface::material::Material;
use crate::train::TrainError;

/// Updates between two looks at the parameters for their running means, which are the parameters themselves before the window
/// is as long.
const AVERAGED_EVERY: u64 = 8;
/// Share of all updates that the means go back.
const WINDOW: f32 = 0.03;

/// Parameters of networks that a job sums over the chunks.
const SUM_BLOCK: usize = 1 << 11;

/// A field as the optimiser sees it: one vector, first the networks' parameters, then the grids'.
pub(in crate::train) trait Network: fmt::Debug {
    /// All parameters.
    fn params(&self) -> &[f32];
    /// The same, to be changed.
    fn params_mut(&mut self) -> &mut [f32];
    /// How many of them are the networks'.
    fn n_head(&self) -> usize;
    /// Writes its networks' transposed weights, as the backward pass reads them.
    fn write_transposed(&self, out: &mut Vec<f32>);
}

macro_rules! networks {
    ($($field:ty: $n_head:ident;)*) => {$(
        impl Network for $field {
            fn params(&self) -> &[f32] {
                &self.params
            }
            fn params_mut(&mut self) -> &mut [f32] {
                &mut self.params
            }
            fn n_head(&self) -> usize {
                self.$n_head()
            }
            fn write_transposed(&self, out: &mut Vec<f32>) {
                self.transpose(out);
            }
        }
    )*};
}

networks! {
    RadianceField: n_network_params;
    Material: n_network_params;
    PaperField: n_params;
    PaperMaterial: n_params;
    IncidentLight: n_network_params;
}

/// A field under training: its moments, gradient and transposed weights.
#[derive(Debug)]
pub(in crate::train) struct Learned<N: Network> {
    /// Of its arrays in a checkpoint.
    name: &'static str,
    pub(in crate::train) value: N,
    adam: Adam,
    /// Zero between steps: [`Adam::update`] clears it.
    pub(in crate::train) gradient: Vec<f32>,
    pub(in crate::train) transposed: Vec<f32>,
    /// The grids in bf16, where they are read from there: half the cache lines.
    pub(in crate::train) rounded: Vec<u16>,
    /// Running means of the parameters, where those are what is shown: the noise of the last steps is not in them.
    averaged: Vec<f32>,
}

impl<N: Network> Learned<N> {
    /// With zero moments.
    pub(in crate::train) fn new(name: &'static str, value: N) -> Self {
        let n = value.params().len();
        let mut learned = Self {
            name,
            adam: Adam::new(n),
            gradient: vec![0.0; n],
            transposed: Vec::new(),
            rounded: Vec::new(),
            averaged: Vec::new(),
            value,
        };
        learned.derive();
        learned
    }

    /// With the grids in bf16 too.
    pub(in crate::train) fn with_rounded_grids(mut self) -> Self {
        self.rounded = vec![0; self.value.params().len() - self.value.n_head()];
        self.derive();
        self
    }

    /// With running means of the parameters.
    pub(in crate::train) fn with_averages(mut self) -> Self {
        self.averaged = self.value.params().to_vec();
        self
    }

    /// The field with the means of its parameters, where they are kept.
    pub(in crate::train) fn settled(&self) -> N
    where
        N: Clone,
    {
        let mut settled = self.value.clone();
        if !self.averaged.is_empty() {
            settled.params_mut().copy_from_slice(&self.averaged);
        }
        settled
    }

    /// By how much of the way the means follow now: exponentially, over the last [`WINDOW`] of all updates, so that they are as
    /// sharp early in a run as late (after Polyak and Juditsky 1992).
    fn mean_share(updates: u64) -> f32 {
        let share = (AVERAGED_EVERY as f32 / (WINDOW * updates as f32)).min(1.0);
        let is_due = share == 1.0 || updates.is_multiple_of(AVERAGED_EVERY);
        if is_due { share } else { 0.0 }
    }

    /// The jobs that add all chunks' gradients in order: of the networks, as `of_networks` has them, and of each of the grid's
    /// `levels` one, as `scatter` adds a chunk's to that level's `[n_entries][4]`. Jobs for parts of a level would go through all
    /// samples each, and two take twice as long as one.
    pub(in crate::train) fn gather<'s, C: Sync>(
        &'s mut self,
        jobs: &mut Vec<Job<'s>>,
        chunks: &'s [C],
        levels: fn(&N) -> &[Level],
        of_networks: fn(&C) -> &[f32],
        scatter: fn(&N, usize, &C, &mut [f32]),
    ) where
        N: Sync,
    {
        let field = &self.value;
        let (networks, mut grids) = self.gradient.split_at_mut(field.n_head());
        let mut tables = Vec::new();
        for (level, shape) in levels(field).iter().enumerate() {
            let (table, rest) = grids.split_at_mut(shape.n_values());
            grids = rest;
            tables.push((level, table));
        }
        // The finest levels take longest.
        for (level, table) in tables.into_iter().rev() {
            jobs.push(Box::new(move || {
                for chunk in chunks {
                    scatter(field, level, chunk, table);
                }
            }));
        }
        for (i, block) in networks.chunks_mut(SUM_BLOCK).enumerate() {
            jobs.push(Box::new(move || {
                let range = i * SUM_BLOCK..i * SUM_BLOCK + block.len();
                let parts = chunks
                    .iter()
                    .map(|chunk| &of_networks(chunk)[range.clone()]);
                sum_in_order(block, parts);
            }));
        }
    }

    /// All that follows from the parameters, after they were set from outside.
    pub(in crate::train) fn derive(&mut self) {
        if !self.rounded.is_empty() {
            let grids = &self.value.params()[self.value.n_head()..];
            store_bf16(grids, &mut self.rounded);
        }
        self.value.write_transposed(&mut self.transposed);
    }

    /// The gradient; zeros are left in its place.
    #[cfg(test)]
    pub(in crate::train) fn take_gradient(&mut self) -> Vec<f32> {
        let zeros = vec![0.0; self.gradient.len()];
        std::mem::replace(&mut self.gradient, zeros)
    }

    fn array(&self, what: &str) -> String {
        format!("{}.{what}", self.name)
    }
}

impl<N: Network> Part for Learned<N> {
    fn update<'a>(&'a mut self, now: &Now<'_>, jobs: &mut Vec<Job<'a>>) {
        let rates = now.rates(self.value.n_head());
        let followed = Followed {
            params: self.value.params_mut(),
            gradient: &mut self.gradient,
            tail_bf16: &mut self.rounded,
            averaged: &mut self.averaged,
        };
        let mean_share = Self::mean_share(now.updates);
        self.adam
            .jobs(followed, rates, now.updates, mean_share, jobs);
    }

    fn follow(&mut self) {
        self.value.write_transposed(&mut self.transposed);
    }

    fn store(&self, file: &mut TensorFile) {
        insert(file, &self.array("params"), self.value.params());
        insert(file, &self.array("first"), &self.adam.first);
        insert(file, &self.array("second"), &self.adam.second);
        if !self.averaged.is_empty() {
            insert(file, &self.array("averaged"), &self.averaged);
        }
    }

    fn restore(&mut self, file: &TensorFile) -> Result<(), TrainError> {
        let n = self.value.params().len();
        let read = |what| finite(file, &self.array(what), n);
        let [params, first, second] = [read("params")?, read("first")?, read("second")?];
        if !self.averaged.is_empty() {
            // Runs from before kept none.
            let is_kept = file.tensor(&self.array("averaged")).is_ok();
            self.averaged = if is_kept {
                read("averaged")?
            } else {
                params.clone()
            };
        }
        self.value.params_mut().copy_from_slice(&params);
        self.adam = Adam { first, second };
        self.derive();
        Ok(())
    }
}
