//! The curves of a run: loss and held-out PSNR over time or steps, and their table as a file.

use egui::{Rangef, Ui};
use egui_plot::{AxisHints, GridInput, GridMark, Line, Plot, PlotPoints, Points};

use crate::app::panels::section::section_heading;
use crate::app::panels::widgets::{count, duration, on_click, weak};
use crate::app::state::app_state::{AppState, PathPurpose};
use crate::app::state::command::Command;
use crate::app::state::sections::Section;
use crate::app::state::training_state::{Curve, Phase};
use crate::app::state::watch::{PlotAxis, WatchCommand};
use crate::app::theme;

/// Height of a plot.
const PLOT_HEIGHT: f32 = 80.0;
/// Right of a plot, for the last number below it.
const MARGIN: f32 = 12.0;
/// Distances at which numbers below a plot are faintest and full, points.
const LABEL_SPACING: Rangef = Rangef {
    min: 34.0,
    max: 48.0,
};
/// Share of a new value in the smoothed loss.
const SMOOTHING: f64 = 0.2;

/// A curve with its name and colour.
type Named<'a> = (&'a str, &'a Curve, egui::Color32);

/// Draws both plots.
pub fn plots_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    if !section_heading(ui, state, Section::Curves, commands) {
        return;
    }
    let training = &state.training;
    if training.log.is_empty() && training.phase == Phase::Idle {
        ui.label(weak(
            ui,
            "Loss and PSNR on held-out photos, once it trains.",
        ));
        return;
    }
    let visuals = ui.visuals();
    let colors = [
        theme::accent(visuals),
        theme::accent_2(visuals),
        theme::weak(visuals),
    ];
    let over = state.watch.plot_over;
    for (title, whole, curves, scale) in [
        ("Loss, smoothed", "all", &training.loss, Scale::Log),
        (
            "Held-out PSNR, dB",
            "whole photo",
            &training.psnr,
            Scale::Linear,
        ),
    ] {
        let names = [whole, "object", "background"];
        let named: [Named<'_>; 3] = std::array::from_fn(|i| (names[i], &curves[i], colors[i]));
        plot_ui(ui, title, &named, (scale, over));
    }
    ui.horizontal(|ui| {
        for (axis, name) in [(PlotAxis::Time, "by time"), (PlotAxis::Steps, "by step")] {
            let choose = Command::Watch(WatchCommand::PlotOver(axis));
            on_click(&ui.selectable_label(over == axis, name), choose, commands);
        }
        let is_empty = training.log.is_empty();
        let export = ui.add_enabled(!is_empty, egui::Button::new("Export CSV…").small());
        let export = export.on_hover_text("All figures so far as a table");
        let export = export.on_disabled_hover_text("No figures yet");
        on_click(&export, Command::AskPath(PathPurpose::Log), commands);
    });
}

/// How values are drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Scale {
    Linear,
    /// By their decimal logarithm.
    Log,
}

fn plot_ui(ui: &mut Ui, title: &str, curves: &[Named<'_>], (scale, over): (Scale, PlotAxis)) {
    ui.add_space(4.0);
    legend_ui(ui, title, curves, scale);
    let text = move |y: f64| match (scale, 10_f64.powf(y)) {
        (Scale::Log, value) if value >= 1e-3 => format!("{}", (value * 1e4).round() / 1e4),
        (Scale::Log, value) => format!("{value:.0e}"),
        (Scale::Linear, _) => format!("{y:.0}"),
    };
    let x_axis =
        AxisHints::new_x()
            .label_spacing(LABEL_SPACING)
            .formatter(move |mark, _| match over {
                PlotAxis::Time => duration(mark.value),
                PlotAxis::Steps => count(mark.value as f32),
            });
    let plot = Plot::new(title)
        .height(PLOT_HEIGHT)
        .width(ui.available_width() - MARGIN)
        .show_background(false)
        .show_grid([false, true])
        .show_x(false)
        .show_y(false)
        .allow_zoom(false)
        .allow_drag(false)
        .allow_scroll(false)
        .allow_boxed_zoom(false)
        .allow_axis_zoom_drag(false)
        .y_axis_min_width(34.0)
        .set_margin_fraction(egui::vec2(0.02, 0.12))
        .custom_x_axes(vec![x_axis])
        .y_axis_formatter(move |mark, _| text(mark.value));
    let plot = if scale == Scale::Log {
        plot.y_grid_spacer(decades)
    } else {
        plot
    };
    let is_empty = curves.iter().all(|(_, curve, _)| curve.points().is_empty());
    if is_empty {
        let size = egui::vec2(ui.available_width(), PLOT_HEIGHT);
        ui.add_sized(size, egui::Label::new(weak(ui, "no values yet")));
        return;
    }
    plot.show(ui, |plot_ui| {
        for (name, curve, color) in curves {
            let points = points_of(curve, scale, over);
            // A line of one point cannot be seen.
            if let Some(start) = points.first() {
                let start = Points::new(*name, PlotPoints::new(vec![*start]));
                plot_ui.points(start.color(*color).radius(2.0));
            }
            let line = Line::new(*name, PlotPoints::new(points));
            plot_ui.line(line.color(*color).width(1.5));
        }
    });
}

/// The title and the last value of each curve, in its colour.
fn legend_ui(ui: &mut Ui, title: &str, curves: &[Named<'_>], scale: Scale) {
    ui.horizontal(|ui| {
        ui.label(weak(ui, title));
        for (name, curve, color) in curves {
            let Some([_, _, last]) = curve.points().last() else {
                continue;
            };
            let text = match scale {
                Scale::Log => format!("{last:.4}"),
                Scale::Linear => format!("{last:.1}"),
            };
            let text = egui::RichText::new(text).color(*color).small();
            ui.label(text).on_hover_text(*name);
        }
    });
}

/// What is drawn of a curve: noisy ones smoothed, values by their logarithm where the scale is.
fn points_of(curve: &Curve, scale: Scale, over: PlotAxis) -> Vec<[f64; 2]> {
    let mut mean: Option<f64> = None;
    let point = |[secs, step, value]: &[f64; 3]| {
        let x = match over {
            PlotAxis::Time => *secs,
            PlotAxis::Steps => *step,
        };
        if scale == Scale::Linear {
            return [x, *value];
        }
        let log = value.max(1e-12).log10();
        let smooth = mean.map_or(log, |mean| mean + SMOOTHING * (log - mean));
        mean = Some(smooth);
        [x, smooth]
    };
    curve.points().iter().map(point).collect()
}

/// Lines at 1, 2 and 5 times the powers of ten, for values drawn by their logarithm.
#[expect(
    clippy::needless_pass_by_value,
    reason = "the signature that the plot wants"
)]
fn decades(input: GridInput) -> Vec<GridMark> {
    let (low, high) = input.bounds;
    let range = low.floor().max(-12.0) as i32..=high.ceil().min(12.0) as i32;
    range
        .flat_map(|decade| [1.0, 2.0, 5.0].map(|digit| f64::from(decade) + f64::log10(digit)))
        .filter(|value| (low..=high).contains(value))
        // Where lines are crowded, only the powers of ten keep their numbers.
        .map(|value| GridMark {
            value,
            step_size: if value.fract() == 0.0 { 1.0 } else { 0.3 },
        })
        .collect()
}
