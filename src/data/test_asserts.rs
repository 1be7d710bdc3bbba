//! What tests of readers ask of messages.

use std::fmt::Display;

/// Fails unless the text has this part, and shows it.
#[track_caller]
pub(super) fn assert_contains(text: impl AsRef<str>, part: &str) {
    let text = text.as_ref();
    assert!(text.contains(part), "\"{part}\" is missing in: {text}");
}

/// Fails unless it is an error whose message has all these parts.
#[track_caller]
pub(super) fn assert_error<T, E: Display>(result: Result<T, E>, parts: &[&str]) {
    let message = result.err().expect("an error").to_string();
    for part in parts {
        assert_contains(&message, part);
    }
}
