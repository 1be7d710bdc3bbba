//! A training run from its first step to its folder, on a thread of its own.
//!
//! `handle` is what a window or command holds: it sends and receives `events` over `event_queue` and `latest`. `run` is the
//! thread: after the `setup`, as its `options` ask (`object` finds it where there are no masks), it takes the steps of the `plan`; `upkeep` does what comes between them,
//! by the `meter`. What is left behind is in `saved`.

mod event_queue;
pub mod events;
pub mod handle;
pub mod latest;
mod meter;
mod object;
pub mod options;
pub mod plan;
mod run;
pub mod saved;
mod setup;
mod upkeep;
