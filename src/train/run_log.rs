//! The diary of a run: a table of figures and a line for each event, kept in memory and saved
//! with the rest of the run folder, so that both files are always whole.

use std::fmt::Write as _;

use crate::train::events::{Progress, TrainEvent, Validation};

/// Columns of `metrics.csv`; an empty cell is a figure that was not measured at that moment.
const CSV_HEADER: &str = "step,elapsed_secs,fraction,loss,steps_per_sec,rays_per_sec,\
                          samples_per_ray,skipped_steps,psnr,psnr_object\n";

/// Figures and events of a run so far.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunLog {
    /// The text of `metrics.csv`.
    csv: String,
    /// The text of `log.jsonl`.
    events: String,
}

/// How much a run has been trained.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trained {
    /// Optimiser steps.
    pub steps: u64,
    /// Seconds, pauses not counted.
    pub train_secs: f64,
}

impl Default for RunLog {
    fn default() -> Self {
        Self::from_texts(String::new(), String::new())
    }
}

impl RunLog {
    /// Continues the diary of an earlier sitting.
    pub fn from_texts(mut csv: String, events: String) -> Self {
        if !csv.starts_with(CSV_HEADER) {
            CSV_HEADER.clone_into(&mut csv);
        }
        Self { csv, events }
    }

    /// The text of `metrics.csv`.
    pub fn csv(&self) -> &str {
        &self.csv
    }

    /// The text of `log.jsonl`.
    pub fn events(&self) -> &str {
        &self.events
    }

    /// Steps and seconds of training of the last row; none before the first report.
    pub fn last_row(&self) -> Option<Trained> {
        let mut cells = self.csv.lines().skip(1).last()?.split(',');
        let steps = cells.next()?.parse().ok()?;
        let train_secs = cells.next()?.parse().ok()?;
        Some(Trained { steps, train_secs })
    }

    /// Notes an event: figures as a table row, everything else as a line of JSON.
    pub fn note(&mut self, event: &TrainEvent) {
        match event {
            TrainEvent::Progress(progress) => self.push_progress(progress),
            TrainEvent::Validated(validation) => self.push_validation(validation),
            TrainEvent::Loading { .. } | TrainEvent::ViewsValidated(_) => {}
            other => {
                self.events.push_str(&other.to_json().to_string());
                self.events.push('\n');
            }
        }
    }

    fn push_progress(&mut self, p: &Progress) {
        self.push_row(&progress_row(p));
    }

    fn push_validation(&mut self, v: &Validation) {
        self.push_row(&validation_row(v));
    }

    fn push_row(&mut self, row: &str) {
        // Writing to a string cannot fail.
        writeln!(self.csv, "{row}").unwrap_or_default();
    }
}

/// A report in the columns of `metrics.csv`.
pub fn progress_row(p: &Progress) -> String {
    format!(
        "{},{:.3},{:.5},{:.6e},{:.2},{:.0},{:.2},{},,",
        p.step,
        p.elapsed_secs,
        p.fraction,
        p.loss,
        p.steps_per_sec,
        p.rays_per_sec,
        p.samples_per_ray,
        p.skipped_steps
    )
}

/// A measurement in the columns of `metrics.csv`.
pub fn validation_row(v: &Validation) -> String {
    format!(
        "{},{:.3},,,,,,,{:.4},{}",
        v.step,
        v.elapsed_secs,
        v.psnr,
        decibels(v.psnr_object)
    )
}

/// A cell of the table; empty where nothing was measured.
pub fn decibels(db: Option<f64>) -> String {
    db.map(|db| format!("{db:.4}")).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_has_as_many_cells_as_the_header() {
        let mut log = RunLog::default();
        log.note(&TrainEvent::Progress(Progress::default()));
        log.note(&TrainEvent::Validated(Validation::default()));
        log.note(&TrainEvent::Warning("a, b".to_owned()));
        let cells: Vec<usize> = log.csv().lines().map(|l| l.split(',').count()).collect();
        assert_eq!(cells, vec![10, 10, 10]);
        assert_eq!(log.last_row().map(|row| row.steps), Some(0));
        assert_eq!(RunLog::default().last_row(), None);
        assert_eq!(
            log.events(),
            "{\"event\":\"warning\",\"message\":\"a, b\"}\n"
        );
    }

    #[test]
    fn a_resumed_run_continues_its_table() {
        let mut log = RunLog::default();
        log.note(&TrainEvent::Progress(Progress::default()));
        let mut resumed = RunLog::from_texts(log.csv().to_owned(), String::new());
        resumed.note(&TrainEvent::Progress(Progress::default()));
        assert_eq!(resumed.csv().lines().count(), 3, "one header, two rows");
    }
}
