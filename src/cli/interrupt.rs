//! Ctrl-C and termination: the first asks the running work to end in order, the second ends it.

use std::sync::atomic::{AtomicBool, Ordering};

use super::failure::Failure;

/// Set by the first Ctrl-C; long work polls it.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Set once the handler is there; a second one is refused.
static INSTALLED: AtomicBool = AtomicBool::new(false);

/// Exit code of an interrupted process, as shells expect it.
const INTERRUPTED_EXIT_CODE: i32 = 130;

/// Installs the handler, if that has not been done yet, and returns the flag that it sets.
pub(crate) fn install() -> anyhow::Result<&'static AtomicBool> {
    if !INSTALLED.swap(true, Ordering::SeqCst) {
        ctrlc::set_handler(|| {
            if INTERRUPTED.swap(true, Ordering::SeqCst) {
                // Whoever presses twice does not want to wait for a save.
                std::process::exit(INTERRUPTED_EXIT_CODE);
            }
        })?;
    }
    Ok(&INTERRUPTED)
}

/// True once Ctrl-C was pressed.
pub(crate) fn requested() -> bool {
    INTERRUPTED.load(Ordering::SeqCst)
}

/// [`Failure::Interrupted`] once Ctrl-C was pressed.
pub(crate) fn check() -> Result<(), Failure> {
    if requested() {
        return Err(Failure::Interrupted);
    }
    Ok(())
}
