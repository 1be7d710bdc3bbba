//! The panels: each draws the state and emits commands.

pub mod frame;
pub mod section;
pub mod side;
pub mod widgets;
