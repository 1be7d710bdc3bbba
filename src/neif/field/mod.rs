//! The radiance field of the environment: cones in, linear radiance out, and the gradients back.
//!
//! A ray's `samples` are placed by `proposal` with the densities of `density_grid` (in `cells`), brought into the unit cube by
//! `contraction`, encoded and turned to light by [`super::networks`] and composited by `composite`: all of it in `radiance_field`,
//! whose working memory is `field_batch`.

pub mod cells;
pub mod composite;
pub mod contraction;
pub mod density_grid;
pub mod field_batch;
pub mod floor;
pub mod proposal;
pub mod radiance_field;
pub mod samples;
pub mod seen_grid;
pub mod skip_counts;
