//! The table of a run's figures as the window saw them: the columns of `metrics.csv`, and more after them.

use std::fmt::Write as _;

use crate::train::session::events::{Progress, Validation};
use crate::train::session::saved::run_log::{decibels, progress_row, validation_row};

/// The columns; an empty cell is a figure that was not measured at that moment.
const HEADER: &str = "step,elapsed_secs,fraction,loss,steps_per_sec,rays_per_sec,samples_per_ray,\
                      skipped_steps,psnr,psnr_object,psnr_background,loss_object,loss_background\n";

/// The text of the table without its header.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TrainingLog {
    rows: String,
}

impl TrainingLog {
    /// Whether there is nothing in it.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Adds a report.
    pub fn push_progress(&mut self, p: &Progress) {
        let row = progress_row(p);
        self.push_row(format_args!(
            "{row},,{:.6e},{:.6e}",
            p.loss_object, p.loss_background
        ));
    }

    /// Adds a measurement.
    pub fn push_validation(&mut self, v: &Validation) {
        let (row, background) = (validation_row(v), decibels(v.psnr_background));
        self.push_row(format_args!("{row},{background},,"));
    }

    fn push_row(&mut self, row: std::fmt::Arguments<'_>) {
        // Writing to a string cannot fail.
        writeln!(self.rows, "{row}").unwrap_or_default();
    }

    /// The whole table, comma-separated.
    pub fn to_csv(&self) -> String {
        format!("{HEADER}{}", self.rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_reads_back() {
        let mut log = TrainingLog::default();
        log.push_progress(&Progress {
            step: 7,
            loss: 0.25,
            loss_object: 0.125,
            ..Progress::default()
        });
        log.push_validation(&Validation {
            step: 8,
            psnr: 30.5,
            psnr_background: Some(31.25),
            ..Validation::default()
        });
        let csv = log.to_csv();
        let mut lines = csv.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let header = lines.next().expect("a header");
        let rows: Vec<_> = lines.collect();
        let cell = |row: usize, name: &str| {
            let column = header.iter().position(|column| *column == name);
            rows[row][column.expect("a known column")]
                .parse::<f64>()
                .ok()
        };
        assert!(
            rows.iter().all(|row| row.len() == header.len()),
            "a cell a column"
        );
        assert_eq!(cell(0, "loss"), Some(0.25));
        assert_eq!(cell(0, "loss_object"), Some(0.125));
        assert_eq!(cell(0, "psnr"), None);
        assert_eq!((cell(1, "step"), cell(1, "psnr")), (Some(8.0), Some(30.5)));
        assert_eq!(cell(1, "psnr_background"), Some(31.25));
        assert_eq!(cell(1, "psnr_object"), None);
    }
}
