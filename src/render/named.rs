//! Choices that people name on the command line and in files.

use strum::VariantArray;

/// The choice of that name; `what` is what they are called in the error, which lists all of them.
pub(super) fn by_name<T: VariantArray + Copy + Into<&'static str>>(
    what: &str,
    text: &str,
) -> Result<T, String> {
    let named = |one: &T| -> &'static str { (*one).into() };
    let found = T::VARIANTS.iter().find(|one| named(one) == text);
    found.copied().ok_or_else(|| {
        let known: Vec<_> = T::VARIANTS.iter().map(named).collect();
        format!("unknown {what} `{text}`; known: {}", known.join(", "))
    })
}
