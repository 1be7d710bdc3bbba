//! What the shortcuts of training and preview leave out now.

use egui::{Grid, ProgressBar, Ui};

use crate::app::panels::section::section_heading;
use crate::app::panels::widgets::weak;
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::sections::Section;

/// Width of a bar.
const BAR_WIDTH: f32 = 70.0;

/// The name of a shortcut, the share it leaves out, and what that is a share of.
type Row = (&'static str, f32, &'static str);

/// Draws the table.
pub fn skips_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    if !section_heading(ui, state, Section::Skips, commands) {
        return;
    }
    let rows = rows(state);
    if rows.is_empty() {
        ui.label(weak(ui, "Nothing was counted yet."));
        return;
    }
    Grid::new("skips").num_columns(2).show(ui, |ui| {
        for (name, share, hint) in rows {
            ui.label(name).on_hover_text(hint);
            let bar = ProgressBar::new(share)
                .desired_width(BAR_WIDTH)
                .text(format!("{:.0} %", 100.0 * share));
            ui.add(bar).on_hover_text(hint);
            ui.end_row();
        }
    });
    ui.label(weak(ui, "Shares of the last step and of the last picture."));
}

fn rows(state: &AppState) -> Vec<Row> {
    let mut rows = Vec::new();
    if let Some(skips) = state.training.progress.skips {
        rows.extend([
            (
                "Empty space",
                skips.empty_space,
                "Of the way along rays: next to no density, so that samples go elsewhere",
            ),
            (
                "Behind opaque",
                skips.behind_opaque,
                "Of the way along rays: behind something opaque",
            ),
            (
                "Inside the object",
                skips.inside_object,
                "Of the samples: inside the object, or where a reflection starts; they hold no light",
            ),
            (
                "Weak gradient",
                skips.weak_gradient,
                "Of the samples: too small a gradient to be worth the way back",
            ),
            (
                "Finer than footprint",
                skips.fine_levels,
                "Of the look-ups in the grid: levels finer than what the ray can resolve",
            ),
        ]);
    }
    if let Some(share) = state.shown.and_then(|shown| shown.reused_share()) {
        let hint = "Of the last picture's pixels: taken over from the picture before";
        rows.push(("Preview, unchanged", share, hint));
    }
    rows
}
