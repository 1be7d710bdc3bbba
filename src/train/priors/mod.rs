//! What is known of the environment beyond the colours of single pixels, as losses or as air that stays empty.
//!
//! Before training: `depth_evidence` (plane sweep over neighbouring photos), `ground`, `void` and `line_of_sight`. As losses of
//! each step: `distortion`, `agreement`, `unseen` and `unseen_light`.

pub(super) mod agreement;
pub(super) mod depth_evidence;
pub(super) mod distortion;
pub(super) mod ground;
pub(super) mod line_of_sight;
pub(super) mod unseen;
pub(super) mod unseen_light;
pub(super) mod void;
