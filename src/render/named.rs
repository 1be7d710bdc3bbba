//! Choices that people name on the command line and in files.

/// The choice of that name; `what` is what they are called in the error, which lists all of them.
pub(super) fn by_name<T: Copy>(
    what: &str,
    all: &[T],
    name: impl Fn(T) -> &'static str,
    text: &str,
) -> Result<T, String> {
    let found = all.iter().copied().find(|one| name(*one) == text);
    found.ok_or_else(|| {
        let known: Vec<_> = all.iter().map(|one| name(*one)).collect();
        format!("unknown {what} `{text}`; known: {}", known.join(", "))
    })
}
