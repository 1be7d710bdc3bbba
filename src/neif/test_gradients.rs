//! Random numbers and finite differences, for tests.

/// Numbers in `[0, 1)` that look random and are always the same.
pub(crate) fn random(seed: u32) -> impl FnMut() -> f32 {
    let mut state = seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    }
}

/// The central difference of a loss by one value of a model, which is moved by `h` either way and back.
pub(crate) fn slope<M>(
    model: &mut M,
    value: impl Fn(&mut M) -> &mut f32,
    h: f32,
    mut loss: impl FnMut(&M) -> f64,
) -> f64 {
    let kept = *value(model);
    let mut at = |h: f32| {
        *value(model) = kept + h;
        loss(model)
    };
    let numeric = (at(h) - at(-h)) / f64::from(2.0 * h);
    *value(model) = kept;
    numeric
}

/// Whether a gradient is a difference but for a share of it and a constant.
pub(crate) fn agrees(analytic: f32, numeric: f64, (relative, absolute): (f64, f64)) -> bool {
    (f64::from(analytic) - numeric).abs() < relative * numeric.abs() + absolute
}

/// Panics with what does not [`agrees`].
pub(crate) fn assert_agrees(what: &str, analytic: f32, numeric: f64, tolerance: (f64, f64)) {
    let is_near = agrees(analytic, numeric, tolerance);
    assert!(is_near, "{what}: {analytic} against {numeric}");
}

/// `Σ a b`.
pub(crate) fn dot<'a>(
    a: impl IntoIterator<Item = &'a f32>,
    b: impl IntoIterator<Item = &'a f32>,
) -> f64 {
    let terms = a.into_iter().zip(b);
    terms.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
}
