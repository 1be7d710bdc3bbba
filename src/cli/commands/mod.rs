//! The commands of the program, one file each; what they share lies beside this folder.

pub(super) mod bench;
pub(super) mod demo;
pub(super) mod env;
pub(super) mod env_import;
pub(super) mod env_library;
pub(super) mod eval;
pub(super) mod export;
pub(super) mod info;
pub(super) mod masks;
pub(super) mod mesh;
pub(super) mod render;
pub(super) mod train;
pub(super) mod view;
