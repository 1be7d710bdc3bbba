//! Memory of a step, reused by the next.

use super::batch_size::BatchSize;
use super::chunk::{Chunk, N_CHUNKS};
use crate::neif::field::radiance_field::{FieldBatch, RadianceField};

/// Memory of a step, reused by the next.
#[derive(Debug)]
pub(super) struct Work {
    /// Of the step at hand.
    pub(super) batch_size: BatchSize,
    pub(super) chunks: Vec<Chunk>,
    /// Features of each level, `[n][4]` of all chunks.
    pub(super) encoded: Vec<Vec<f32>>,
    pub(super) probes: Vec<FieldBatch>,
}

impl Work {
    /// For a field of this shape.
    pub(super) fn of(field: &RadianceField) -> Self {
        Self {
            batch_size: BatchSize::default(),
            chunks: (0..N_CHUNKS).map(Chunk::new).collect(),
            encoded: vec![Vec::new(); field.levels().len()],
            probes: vec![FieldBatch::default(); N_CHUNKS],
        }
    }
}
