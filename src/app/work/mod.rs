//! What goes on beside drawing, on threads of its own: the window never waits for it.
//!
//! `tasks` holds all of it: the training session, files being read (`opener`), written (`keeper`, `exporter`) or chosen (`dialog`),
//! and the preview (`preview_driver`, at the `pace` that leaves time for training).

mod dialog;
pub(super) mod error_maps;
mod exporter;
mod importer;
pub(super) mod keeper;
pub(super) mod opener;
pub mod pace;
pub mod preview_driver;
pub(super) mod slice_view;
pub(super) mod tasks;
pub(super) mod threads;
