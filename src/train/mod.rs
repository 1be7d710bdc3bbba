//! train
pub mod latest;
pub mod metrics;
pub mod plan;
