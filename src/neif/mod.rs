//! neif
