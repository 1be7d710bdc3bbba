//! Choices that people name on the command line and in files.

use std::fmt::Display;

use strum::VariantArray;

/// That no choice has the name `text`, with the names of all; `what` is what they are called.
pub(super) fn unknown<T: VariantArray + Display>(what: &str, text: &str) -> String {
    let known: Vec<_> = T::VARIANTS.iter().map(ToString::to_string).collect();
    format!("unknown {what} `{text}`; known: {}", known.join(", "))
}
