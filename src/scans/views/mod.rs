//! A scan as a capture: photos of it, taken from where an object may stand in it, for the trainer to learn from.
//!
//! `upright` estimates which way is up, `stand` where an object may stand, `survey` both, `cameras` from where it is looked at, `capture`
//! takes the photos.

mod cameras;
mod capture;
mod stand;
mod survey;
mod upright;

pub use self::capture::load_capture;
pub use self::survey::Survey;

#[cfg(test)]
mod tests;
