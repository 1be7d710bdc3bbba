//! How deep is what photos show, from the photos themselves: each is compared with its neighbours over planes of all depths.
//!
//! `neighbours` chooses the photos that one is compared with, `small_photo` reduces them, `plane_sweep` tries all depths by
//! their `correlation`, and `photo_depths` keeps what other photos confirm. What sweeps: `priors::depth_evidence` what lies
//! beside the object, `shape::stage_one` the object.

mod correlation;
mod neighbours;
mod photo_depths;
mod plane_sweep;
mod small_photo;

pub(super) use self::neighbours::neighbours;
pub(super) use self::photo_depths::{Onlooker, PhotoDepths, ray_of};
pub(super) use self::plane_sweep::Steps;
pub(super) use self::small_photo::{SmallPhoto, Window};
