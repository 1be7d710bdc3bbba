//! The live picture: at once while a person drags, then finer and finer.
//!
//! `worker` takes the newest `request` from its `inbox`; `progressive` refines the picture `band` by band and recomputes what
//! changed; `sketch` is the first coarse one. `accelerator` hands the work to `gpu` where `drawn_by` says so.

mod accelerator;
mod band;
pub mod drawn_by;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod inbox;
pub mod priority;
pub mod progressive;
pub mod request;
pub mod sketch;
pub mod thread_clock;
pub mod worker;
