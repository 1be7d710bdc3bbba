//! One optimisation step of whichever model: draw pixels, predict them, compare, and follow the gradient.
//!
//! `trainer` is the loop; `model` is what it calls, and `part` what a model's parameters consist of: fields (`learned`), the
//! `display` transform, and what else a model learns. `now` says where in its run a step is, `chunks` how it is cut and its
//! gradients are summed, `adam` follows them, `loss` compares a pixel with the photo, and `tasks` puts it all on threads.

pub(super) mod adam;
pub(super) mod chunks;
pub(super) mod display;
pub(super) mod learned;
pub(super) mod loss;
pub mod model;
pub mod now;
pub mod part;
pub mod tasks;
pub mod trainer;
