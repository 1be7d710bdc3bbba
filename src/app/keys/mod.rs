//! Which key, menu entry and gesture causes which command: the `table`, its lines (`binding`), and keys as they are pressed.

pub mod binding;
pub mod shortcuts;
pub mod table;
