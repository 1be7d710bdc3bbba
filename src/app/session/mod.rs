//! What is kept from one start of the program to the next.

pub mod autosave;
pub mod leaving;
pub mod preferences;
pub mod recent;
pub mod saving;
pub mod session_file;
