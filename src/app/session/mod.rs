//! What is kept from one start of the program to the next: sessions (`saving`, `session_file`, `autosave`), `preferences` and
//! what was opened (`recent`); and the question before something is lost (`leaving`).

pub(super) mod autosave;
pub mod leaving;
pub mod preferences;
pub(super) mod recent;
pub mod saving;
pub mod session_file;
