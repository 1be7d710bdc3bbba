//! The `neif` program: the window, and the commands that do the same work without one.

mod cli;

use std::{io::Write as _, process::ExitCode, time::Instant};

fn main() -> ExitCode {
    let started = Instant::now();
    match cli::run(started) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            if let Some(message) = failure.message() {
                // Nothing is left to do when even this cannot be written.
                writeln!(std::io::stderr(), "error: {message}").unwrap_or_default();
            }
            failure.exit_code()
        }
    }
}
