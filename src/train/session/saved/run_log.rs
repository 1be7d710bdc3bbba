//! The diary of a run: a table of figures and a line for each event, kept in memory and saved
//! with the rest of the run folder, so that both files are always whole.

use serde_json::Value;

use crate::train::session::events::{Progress, TrainEvent, Validation};

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

    /// The reports and measurements of the table, in order. What it has no column for is zero or none; rows that cannot be
    /// read are left out.
    pub fn figures(&self) -> Vec<TrainEvent> {
        self.csv.lines().skip(1).filter_map(figures_of).collect()
    }

    /// The last event of this name ([`TrainEvent::to_json`]); none before there was one.
    pub fn last_event(&self, name: &str) -> Option<Value> {
        let events = self.events.lines().rev();
        let mut events = events.filter_map(|line| serde_json::from_str::<Value>(line).ok());
        events.find(|event| event["event"] == name)
    }

    /// Notes an event: figures as a table row, everything else as a line of JSON.
    pub fn note(&mut self, event: &TrainEvent) {
        let (text, line) = match event {
            TrainEvent::Progress(progress) => (&mut self.csv, progress_row(progress)),
            TrainEvent::Validated(validation) => (&mut self.csv, validation_row(validation)),
            TrainEvent::Loading { .. }
            | TrainEvent::Retracing { .. }
            | TrainEvent::ViewsValidated(_) => return,
            other => (&mut self.events, other.to_json().to_string()),
        };
        text.extend([&line, "\n"]);
    }
}

/// What a row of `metrics.csv` says: a row with a PSNR is a measurement, any other a report.
fn figures_of(row: &str) -> Option<TrainEvent> {
    let cells: Vec<&str> = row.split(',').collect();
    let number = |column: usize| cells.get(column)?.parse::<f64>().ok();
    let step = cells.first()?.parse().ok()?;
    let elapsed_secs = number(1)?;
    if let Some(psnr) = number(8) {
        return Some(TrainEvent::Validated(Validation {
            step,
            elapsed_secs,
            psnr,
            psnr_object: number(9),
            psnr_background: None,
        }));
    }
    Some(TrainEvent::Progress(Progress {
        step,
        elapsed_secs,
        fraction: number(2)? as f32,
        loss: number(3)? as f32,
        steps_per_sec: number(4)? as f32,
        rays_per_sec: number(5)? as f32,
        samples_per_ray: number(6)? as f32,
        skipped_steps: number(7)? as u64,
        ..Progress::default()
    }))
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
    fn the_figures_of_the_table_read_back() {
        let mut log = RunLog::default();
        let report = Progress {
            step: 7,
            elapsed_secs: 1.5,
            loss: 0.25,
            ..Progress::default()
        };
        let measured = Validation {
            step: 8,
            elapsed_secs: 2.0,
            psnr: 30.5,
            ..Validation::default()
        };
        let events = [
            TrainEvent::Progress(report),
            TrainEvent::Validated(measured),
        ];
        for event in &events {
            log.note(event);
        }
        let damaged = format!("{}9,oops\n\n", log.csv());
        let log = RunLog::from_texts(damaged, String::new());
        assert_eq!(log.figures(), events);
    }

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
