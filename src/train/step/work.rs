//! Memory of a step, reused by the next.

use super::batch_size::BatchSize;
use super::chunk::{Chunk, N_CHUNKS};
use crate::neif::field::radiance_field::{FieldBatch, RadianceField};

/// Memory of a step, reused by the next.
#[derive(Debug)]
pub(in crate::train) struct Work {
    /// Of the step at hand.
    pub(super) batch_size: BatchSize,
    pub(in crate::train) chunks: Vec<Chunk>,
    /// Features of each level, `[n][4]` of all chunks.
    pub(super) encoded: Vec<Vec<f32>>,
    /// The field's grid in bf16, rewritten with every update: what a step encodes from, at half the cache lines.
    pub(super) tables: Vec<u16>,
    pub(super) probes: Vec<FieldBatch>,
}

impl Work {
    /// For a field of this shape.
    pub(super) fn of(field: &RadianceField) -> Self {
        Self {
            batch_size: BatchSize::default(),
            chunks: (0..N_CHUNKS).map(Chunk::new).collect(),
            encoded: vec![Vec::new(); field.levels().len()],
            tables: vec![0; field.params.len() - field.n_network_params()],
            probes: vec![FieldBatch::default(); N_CHUNKS],
        }
    }
}
