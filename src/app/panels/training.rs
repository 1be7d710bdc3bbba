//! The training panel: what is trained, its controls, its figures and curves.

use egui::{Button, DragValue, Grid, Ui};
use egui_plot::{GridInput, GridMark, Line, Plot, PlotPoints, Points};

use crate::app::command::{Command, Train};
use crate::app::pace::pace_ui;
use crate::app::panels::status::chip;
use crate::app::panels::widgets::{count, describe_number, duration, heading, weak};
use crate::app::state::{AppState, PathPurpose, Source};
use crate::app::theme;
use crate::app::training_state::{Curve, Phase};

/// Height of a plot.
const PLOT_HEIGHT: f32 = 96.0;

/// Draws the panel.
pub fn training_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    ui.horizontal(|ui| {
        heading(ui, "Training");
        let phase = &state.training.phase;
        // While it trains, the heading says it already.
        if *phase != Phase::Training {
            chip(ui, phase.name(), theme::of_phase(ui.visuals(), phase));
        }
    });
    capture_ui(ui, state);
    controls_ui(ui, state, commands);
    figures_ui(ui, state);
    let training = &state.training;
    let accents = [theme::accent(ui.visuals()), theme::accent_2(ui.visuals())];
    plot_ui(
        ui,
        "Loss (log scale)",
        &[("loss", &training.loss, accents[0])],
        Scale::Log,
    );
    let psnr = [
        ("object", &training.psnr_object, accents[1]),
        ("whole photo", &training.psnr, accents[0]),
    ];
    plot_ui(ui, "PSNR on held-out photos, dB", &psnr, Scale::Linear);
}

fn capture_ui(ui: &mut Ui, state: &AppState) {
    let Some(capture) = &state.training.capture else {
        let text = match (&state.source, &state.training.phase) {
            (_, Phase::Loading { what, .. }) => format!("{what}…"),
            (Source::Nothing, _) => "Open a capture to train on it.".to_owned(),
            (Source::Run(_), _) => "A saved run: look at it, or train it further.".to_owned(),
            (Source::Environment(_), _) => "An environment alone: nothing to train.".to_owned(),
            _ => "Not started.".to_owned(),
        };
        ui.label(weak(ui, text));
        return;
    };
    let (width, height) = capture.size;
    let mut text = format!(
        "{} photos, {width} × {height}; {} held out",
        capture.n_train, capture.n_val
    );
    if !capture.has_object {
        text.push_str("\nno object: the surroundings alone are trained");
    }
    ui.label(weak(ui, text));
}

fn controls_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let phase = &state.training.phase;
    match phase {
        Phase::Training | Phase::Paused => {
            running_ui(ui, phase, commands);
            pace_ui(ui, state, commands);
        }
        Phase::Loading { .. } => {
            if ui.button("Cancel").clicked() {
                commands.push(Command::Train(Train::StopForSure));
            }
        }
        Phase::Idle | Phase::Finished(_) | Phase::Failed(_) => start_ui(ui, state, commands),
    }
}

fn running_ui(ui: &mut Ui, phase: &Phase, commands: &mut Vec<Command>) {
    ui.horizontal(|ui| {
        let pause = if *phase == Phase::Paused {
            "Resume"
        } else {
            "Pause"
        };
        let buttons = [
            (pause, "Space", Command::Train(Train::PauseOrResume)),
            (
                "Step",
                "One step, then pause ( . )",
                Command::Train(Train::Step),
            ),
            ("Stop", "End the run", Command::Train(Train::Stop)),
            ("Save…", "Ctrl+S", Command::AskPath(PathPurpose::Save)),
        ];
        for (text, hint, command) in buttons {
            if ui
                .add(Button::new(text).min_size(egui::vec2(52.0, 0.0)))
                .on_hover_text(hint)
                .clicked()
            {
                commands.push(command);
            }
        }
    });
    extend_ui(ui, commands);
}

fn extend_ui(ui: &mut Ui, commands: &mut Vec<Command>) {
    ui.horizontal(|ui| {
        ui.label("Train longer");
        for (text, secs) in [("+1 min", 60.0), ("+5 min", 300.0)] {
            if ui.button(text).clicked() {
                commands.push(Command::Train(Train::Extend(secs)));
            }
        }
    });
}

fn start_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    if matches!(state.training.phase, Phase::Finished(_)) && state.training.phase.takes_commands() {
        extend_ui(ui, commands);
        if ui.button("Save…").clicked() {
            commands.push(Command::AskPath(PathPurpose::Save));
        }
        return;
    }
    let can_start = matches!(
        state.source,
        Source::Demo(_) | Source::Capture(_) | Source::Run(_)
    );
    ui.horizontal(|ui| {
        let text = match (&state.source, &state.training.phase) {
            (Source::Run(_), _) => "Train further",
            (_, Phase::Idle) => "Start training",
            _ => "Train again",
        };
        if ui.add_enabled(can_start, Button::new(text)).clicked() {
            commands.push(Command::Train(Train::Start));
        }
        ui.label("for");
        let mut budget = state.budget_secs;
        let number = ui.add(
            DragValue::new(&mut budget)
                .range(5.0..=86_400.0)
                .speed(5.0)
                .max_decimals(0)
                .suffix(" s"),
        );
        describe_number(&number, "Training time in seconds");
        if number
            .on_hover_text("Training time; more can be added later")
            .changed()
        {
            commands.push(Command::SetBudget(budget));
        }
    });
    let mut is_auto = state.is_auto_start;
    if ui
        .checkbox(&mut is_auto, "Start when a capture is opened")
        .changed()
    {
        commands.push(Command::SetAutoStart(is_auto));
    }
}

fn figures_ui(ui: &mut Ui, state: &AppState) {
    let p = &state.training.progress;
    let has_figures = p.step > 0;
    let dash = || "–".to_owned();
    let show = |text: String| if has_figures { text } else { dash() };
    let rows = [
        (
            "Step",
            show(
                p.planned_steps
                    .map_or_else(|| p.step.to_string(), |n| format!("{}/{n}", p.step)),
            ),
        ),
        ("It/s", show(count(p.steps_per_sec))),
        ("Rays/s", show(count(p.rays_per_sec))),
        ("Samples/ray", show(format!("{:.1}", p.samples_per_ray))),
        ("Elapsed", show(duration(p.elapsed_secs))),
        ("Left", show(duration(p.eta_secs))),
        ("Loss", show(format!("{:.4}", p.loss))),
        ("Skipped", show(p.skipped_steps.to_string())),
    ];
    ui.add_space(2.0);
    Grid::new("training figures")
        .num_columns(4)
        .spacing([8.0, 2.0])
        .min_col_width(44.0)
        .show(ui, |ui| {
            for pair in rows.chunks(2) {
                for (name, value) in pair {
                    ui.label(weak(ui, *name)).on_hover_text(figure_hint(name));
                    ui.label(value.as_str());
                }
                ui.end_row();
            }
        });
}

fn figure_hint(name: &str) -> &'static str {
    match name {
        "Step" => "Optimiser steps done",
        "It/s" => "Optimiser steps per second",
        "Rays/s" => "Rays per second",
        "Samples/ray" => "Field samples per ray",
        "Elapsed" => "Training time, pauses not counted",
        "Left" => "Time left by the plan",
        "Loss" => "Mean loss since the last report",
        _ => "Steps left out because a value was not finite",
    }
}

/// How values are drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Scale {
    Linear,
    /// By their decimal logarithm.
    Log,
}

fn plot_ui(ui: &mut Ui, title: &str, curves: &[(&str, &Curve, egui::Color32)], scale: Scale) {
    ui.add_space(4.0);
    ui.horizontal(|ui| {
        ui.label(weak(ui, title));
        if curves.len() > 1 {
            for (name, curve, color) in curves
                .iter()
                .filter(|(_, curve, _)| !curve.points().is_empty())
            {
                let last = curve.points().last().map_or(0.0, |p| p[1]);
                ui.label(egui::RichText::new(format!("{last:.1}")).color(*color))
                    .on_hover_text(*name);
            }
        }
    });
    let value = move |y: f64| {
        if scale == Scale::Log {
            y.max(1e-12).log10()
        } else {
            y
        }
    };
    let text = move |y: f64| match (scale, 10_f64.powf(y)) {
        (Scale::Log, value) if value >= 1e-3 => format!("{}", (value * 1e4).round() / 1e4),
        (Scale::Log, value) => format!("{value:.0e}"),
        (Scale::Linear, _) => format!("{y:.0}"),
    };
    let plot = Plot::new(title)
        .height(PLOT_HEIGHT)
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
        .x_axis_formatter(|mark, _| duration(mark.value))
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
    let first = |curve: &Curve| curve.points().first().map(|p| [p[0], value(p[1])]);
    let starts: Vec<_> = curves
        .iter()
        .filter_map(|(name, curve, color)| Some((*name, first(curve)?, *color)))
        .collect();
    let lines: Vec<Line<'static>> = curves
        .iter()
        .map(|(name, curve, color)| {
            let points: Vec<[f64; 2]> =
                curve.points().iter().map(|p| [p[0], value(p[1])]).collect();
            Line::new(*name, PlotPoints::new(points))
                .color(*color)
                .width(1.5)
        })
        .collect();
    plot.show(ui, |plot_ui| {
        for line in lines {
            plot_ui.line(line);
        }
        // A line of one point cannot be seen.
        for (name, start, color) in starts {
            plot_ui.points(
                Points::new(name, PlotPoints::new(vec![start]))
                    .color(color)
                    .radius(2.0),
            );
        }
    });
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
