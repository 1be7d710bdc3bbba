//! The layouts that captures come in.
//!
//! `listing` recognises a capture's layout and asks the reader of that name for what it `found`; `photo_folder`, `splits` and
//! `json_fields` are what the readers share.

mod blended_mvs;
pub(super) mod colmap;
mod found;
mod idr;
mod json_fields;
pub(super) mod listing;
mod llff;
mod neilf;
mod nero;
mod photo_folder;
mod rgbd;
pub(super) mod splits;
#[cfg(test)]
pub(super) mod test_formats;
pub(super) mod transforms_json;
