//! What a command prints: results on the standard output, progress on the standard error.

use std::{
    io::{self, IsTerminal as _, Write as _},
    path::Path,
    time::{Duration, Instant},
};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use neif::data::write_atomically;
use serde_json::Value;

/// Time between two lines of progress where there is no terminal.
const PLAIN_INTERVAL: Duration = Duration::from_secs(10);
/// Steps of the bar from empty to full.
const BAR_LENGTH: u64 = 1000;

/// Writes a line of results. A closed pipe is no error: whoever closed it has seen enough.
pub(crate) fn line(text: &str) -> io::Result<()> {
    match writeln!(io::stdout(), "{text}") {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        other => other,
    }
}

/// Writes a JSON value on one line.
pub(crate) fn json_line(value: &Value) -> io::Result<()> {
    line(&value.to_string())
}

/// Writes a Markdown table: its header, as `| a | b |`, and its rows.
pub(crate) fn table(header: &str, rows: impl IntoIterator<Item = String>) -> io::Result<()> {
    line(header)?;
    line(&format!(
        "|{}",
        "---|".repeat(header.matches('|').count() - 1)
    ))?;
    rows.into_iter().try_for_each(|row| line(&row))
}

/// Writes a text file whole or not at all.
pub(crate) fn file(path: &Path, text: &str) -> io::Result<()> {
    write_atomically(path, |file| file.write_all(text.as_bytes()))
}

/// Writes a line for people on the standard error.
pub(crate) fn note(text: &str) {
    // Progress that cannot be shown is no reason to stop the work.
    writeln!(io::stderr(), "{text}").unwrap_or_default();
}

/// Progress of long work: a bar on a terminal, now and then a line elsewhere, nothing with JSON.
#[derive(Debug)]
pub(crate) struct Display {
    bar: Option<ProgressBar>,
    plain: bool,
    last_line: Option<Instant>,
    last_what: String,
}

impl Display {
    /// A display that suits where the output goes.
    pub(crate) fn new(json: bool) -> Self {
        let terminal = io::stderr().is_terminal();
        Self {
            bar: (terminal && !json).then(bar),
            plain: !terminal && !json,
            last_line: None,
            last_what: String::new(),
        }
    }

    /// Shows how far the work is: `fraction` 0 to 1, `what` is going on, and figures about it.
    pub(crate) fn set(&mut self, fraction: f32, what: &str, figures: &str) {
        if let Some(bar) = &self.bar {
            bar.set_position((fraction.clamp(0.0, 1.0) * BAR_LENGTH as f32) as u64);
            bar.set_message(format!("{what} {figures}"));
        }
        let due = self
            .last_line
            .is_none_or(|at| at.elapsed() >= PLAIN_INTERVAL);
        if self.plain && (due || self.last_what != what) {
            note(format!("{what}: {:.0} % {figures}", fraction * 100.0).trim_end());
            self.last_line = Some(Instant::now());
            what.clone_into(&mut self.last_what);
        }
    }

    /// Shows a line that stays.
    pub(crate) fn say(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| note(text)),
            None if self.plain => note(text),
            None => {}
        }
    }

    /// Removes the bar.
    pub(crate) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        self.finish();
    }
}

fn bar() -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(BAR_LENGTH), ProgressDrawTarget::stderr());
    let style = ProgressStyle::with_template("{bar:30} {percent:>3} % {elapsed} {msg}");
    if let Ok(style) = style {
        bar.set_style(style);
    }
    bar
}
