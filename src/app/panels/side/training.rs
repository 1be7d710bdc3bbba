//! The training panel: what is trained, its controls and its figures.

use egui::{Button, Grid, Ui};
use strum::VariantArray as _;

use crate::app::object::ObjectCommand;
use crate::app::panels::frame::status::chip;
use crate::app::panels::section::section_heading;
use crate::app::panels::widgets::{
    choices_ui, count, duration, log_place, number_ui, on_click, training_secs, weak,
};
use crate::app::session::preferences::{PreferencesCommand, Quality};
use crate::app::state::app_state::{AppState, PathPurpose};
use crate::app::state::command::{Command, Train};
use crate::app::state::sections::Section;
use crate::app::state::source::Source;
use crate::app::state::training_state::{Phase, headline};
use crate::app::state::watch::WatchCommand;
use crate::app::theme;
use crate::app::work::pace::Pace;

/// Draws the panel.
pub fn training_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let row = ui.horizontal(|ui| {
        let is_open = section_heading(ui, state, Section::Training, commands);
        let phase = &state.training.phase;
        // While it trains, the heading says it already.
        if *phase != Phase::Training {
            chip(ui, phase.name(), theme::of_phase(ui.visuals(), phase));
        }
        is_open
    });
    if !row.inner {
        return;
    }
    capture_ui(ui, state);
    object_ui(ui, state, commands);
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

/// For captures whose object nobody has shown yet.
fn object_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    if !state.lacks_object() {
        return;
    }
    let select = ui.button("Select the object…");
    let select = select.on_hover_text(
        "In photos without masks: what stands where you click is cut out of all of them, and trained",
    );
    log_place(ui, "Select the object…", select.rect);
    on_click(
        &select,
        Command::Object(ObjectCommand::Select(true)),
        commands,
    );
}

fn controls_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let phase = &state.training.phase;
    match phase {
        Phase::Training | Phase::Paused => {
            running_ui(ui, phase, commands);
            ui.horizontal_wrapped(|ui| {
                ui.label(weak(ui, "Pace"));
                let paces = Pace::VARIANTS.iter();
                let paces = paces.map(|pace| (*pace, <&str>::from(pace), pace.hint()));
                commands.extend(choices_ui(ui, state.pace, paces).map(Command::SetPace));
            });
            extend_ui(ui, state, commands);
        }
        Phase::Loading { .. } => {
            let cancel = ui.button("Cancel");
            on_click(&cancel, Command::Train(Train::StopForSure), commands);
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
            let button = Button::new(text).min_size(egui::vec2(46.0, 0.0));
            on_click(&ui.add(button).on_hover_text(hint), command, commands);
        }
    });
}

/// More training, while it runs and after its end.
fn extend_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    ui.horizontal(|ui| {
        let mut secs = state.watch.extend_secs;
        let extend = |secs| Command::Train(Train::Extend(secs));
        let longer = ui.button("Train longer");
        let longer = longer.on_hover_text("By so many seconds, after the end of the plan");
        on_click(&longer, extend(secs), commands);
        let number = number_ui(ui, "Seconds more", training_secs(&mut secs));
        if number.changed() {
            commands.push(Command::Watch(WatchCommand::SetExtend(secs)));
        }
        on_click(&ui.button("+1 min"), extend(60.0), commands);
    });
}

fn start_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    if matches!(state.training.phase, Phase::Finished(_)) && state.training.phase.takes_commands() {
        extend_ui(ui, state, commands);
        let save = Command::AskPath(PathPurpose::Save);
        on_click(&ui.button("Save…"), save, commands);
        return;
    }
    ui.horizontal(|ui| {
        let text = match (&state.source, &state.training.phase) {
            (Source::Run(_), _) => "Train further",
            (_, Phase::Idle) => "Start training",
            _ => "Train again",
        };
        let start = ui.add_enabled(state.source.is_trainable(), Button::new(text));
        on_click(&start, Command::Train(Train::Start), commands);
        ui.label("for");
        let mut budget = state.watch.budget_secs;
        let number = number_ui(ui, "Training time in seconds", training_secs(&mut budget));
        let number = number.on_hover_text("Training time; more can be added later");
        if number.changed() {
            commands.push(Command::SetBudget(budget));
        }
    });
    if !matches!(state.source, Source::Run(_)) {
        ui.horizontal_wrapped(|ui| {
            ui.label(weak(ui, "Quality"));
            let qualities = Quality::VARIANTS.iter();
            let qualities = qualities.map(|it| (*it, <&str>::from(it), it.hint()));
            let chosen = choices_ui(ui, state.preferences.quality, qualities);
            let command = |it| Command::Preferences(PreferencesCommand::Quality(it));
            commands.extend(chosen.map(command));
        });
    }
    let mut is_auto = state.preferences.is_auto_start;
    let auto = ui.checkbox(&mut is_auto, "Start when a capture is opened");
    on_click(&auto, Command::SetAutoStart(is_auto), commands);
}

fn figures_ui(ui: &mut Ui, state: &AppState) {
    let p = &state.training.progress;
    let has_figures = p.step > 0;
    if !has_figures && state.training.phase == Phase::Idle {
        return;
    }
    let step = p.planned_steps.map_or_else(
        || p.step.to_string(),
        |planned| format!("{}/{planned}", p.step),
    );
    let samples = format!("{:.1}", p.samples_per_ray);
    let rows = [
        ("Step", step, "Optimiser steps done"),
        ("It/s", count(p.steps_per_sec), "Optimiser steps per second"),
        ("Rays/s", count(p.rays_per_sec), "Rays per second"),
        ("Samples/ray", samples, "Field samples per ray"),
        (
            "Elapsed",
            duration(p.elapsed_secs),
            "Training time, pauses not counted",
        ),
        ("Left", duration(p.eta_secs), "Time left by the plan"),
        (
            "Loss",
            format!("{:.4}", p.loss),
            "Mean loss since the last report",
        ),
        (
            "Skipped",
            p.skipped_steps.to_string(),
            "Steps left out because a value was not finite",
        ),
    ];
    ui.add_space(2.0);
    Grid::new("training figures")
        .num_columns(4)
        .spacing([8.0, 2.0])
        .min_col_width(44.0)
        .show(ui, |ui| {
            for pair in rows.chunks(2) {
                for (name, value, hint) in pair {
                    ui.label(weak(ui, *name)).on_hover_text(*hint);
                    ui.label(if has_figures { value.as_str() } else { "–" });
                }
                ui.end_row();
            }
        });
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
