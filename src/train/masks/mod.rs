//! Which pixels show the object, where nobody drew masks: selected in space, in all photos at once.
//!
//! An environment that was trained on the photos with the object in them knows how far away everything is. `seen` looks at it
//! from the photos' cameras; `region` is the part of space that the object takes up: what stands out from the plane that it
//! stands on, where the cameras look or the person pointed. `outline` predicts each photo without it (background subtraction by
//! view synthesis), and cuts the photo where it differs, along its edges, with `colors` and `total_variation`.
//! `agreed` is the shape on which the photos agree, near which they are cut once more, and what a person's strokes
//! (`selection`) say of it. `voxels` and `window` are the grids in space and in a photo.

mod agreed;
mod colors;
mod find;
mod found;
mod jobs;
mod learn;
mod outline;
mod region;
mod seen;
mod selection;
#[cfg(test)]
pub(crate) mod test_capture;
mod total_variation;
mod voxels;
mod window;

pub use agreed::agreement_of;
pub use find::{ObjectFinder, find_object};
pub use found::{FoundObject, MaskError};
pub use learn::{LearnedPlace, learn_environment};
pub use seen::point_at;
pub use selection::{Selection, Stroke};
