//! The training panel: what is trained, its controls and its figures.

use egui::{Button, DragValue, Grid, Ui};

use super::pace::pace_ui;
use crate::app::panels::frame::status::chip;
use crate::app::panels::section::section_heading;
use crate::app::panels::widgets::{count, describe_number, duration, weak};
use crate::app::state::app_state::{AppState, PathPurpose};
use crate::app::state::command::{Command, Train};
use crate::app::state::sections::Section;
use crate::app::state::source::Source;
use crate::app::state::training_state::{Phase, headline};
use crate::app::state::watch::WatchCommand;
use crate::app::theme;

/// Draws the panel.
pub fn training_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let mut is_open = true;
    ui.horizontal(|ui| {
        is_open = section_heading(ui, state, Section::Training, commands);
        let phase = &state.training.phase;
        // While it trains, the heading says it already.
        if *phase != Phase::Training {
            chip(ui, phase.name(), theme::of_phase(ui.visuals(), phase));
        }
    });
    if !is_open {
        return;
    }
    capture_ui(ui, state);
    controls_ui(ui, state, commands);
    figures_ui(ui, state);
    best_ui(ui, state);
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
        text.push_str("\nno object: the environment alone is trained");
    }
    ui.label(weak(ui, text));
}

fn controls_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let phase = &state.training.phase;
    match phase {
        Phase::Training | Phase::Paused => {
            running_ui(ui, phase, commands);
            pace_ui(ui, state, commands);
            extend_ui(ui, state, commands);
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
            (
                "Save…",
                "Keeps the run in a folder",
                Command::AskPath(PathPurpose::Save),
            ),
        ];
        for (text, hint, command) in buttons {
            if ui
                .add(Button::new(text).min_size(egui::vec2(46.0, 0.0)))
                .on_hover_text(hint)
                .clicked()
            {
                commands.push(command);
            }
        }
    });
}

/// More training, while it runs and after its end.
fn extend_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    ui.horizontal(|ui| {
        let mut secs = state.watch.extend_secs;
        let extend = |secs| Command::Train(Train::Extend(secs));
        let longer = ui.button("Train longer");
        if longer
            .on_hover_text("By so many seconds, after the end of the plan")
            .clicked()
        {
            commands.push(extend(secs));
        }
        let number = DragValue::new(&mut secs)
            .range(5.0..=86_400.0)
            .speed(5.0)
            .max_decimals(0)
            .suffix(" s");
        let number = ui.add(number);
        describe_number(&number, "Seconds more");
        if number.changed() {
            commands.push(Command::Watch(WatchCommand::SetExtend(secs)));
        }
        if ui.button("+1 min").clicked() {
            commands.push(extend(60.0));
        }
    });
}

fn start_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    if matches!(state.training.phase, Phase::Finished(_)) && state.training.phase.takes_commands() {
        extend_ui(ui, state, commands);
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
    let mut is_auto = state.preferences.is_auto_start;
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
    if !has_figures && state.training.phase == Phase::Idle {
        return;
    }
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

/// The best measurement on held-out photos against the last one.
fn best_ui(ui: &mut Ui, state: &AppState) {
    let (Some(best), Some(last)) = (state.training.best, state.training.validation) else {
        return;
    };
    let what = match last.psnr_object {
        Some(_) => "Object on held-out photos",
        None => "Held-out photos",
    };
    let text = format!(
        "{:.2} dB at step {}, best {:.2} at {}",
        headline(&last),
        last.step,
        headline(&best),
        best.step
    );
    ui.label(text).on_hover_text(what);
}
