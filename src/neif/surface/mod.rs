//! The object: what its surface is made of, and what a person makes of it.
//!
//! `material` is the learned field M(x) of `values`, `object` holds it with its mesh; `edit`, `region` and `edited_surface` change it.

pub mod edit;
pub mod edited_surface;
pub mod material;
pub mod object;
pub mod region;
pub mod values;
