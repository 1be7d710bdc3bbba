//! The status bar: state, step, speed, time, progress, resolution, adapter.

use egui::{Align, Color32, Layout, ProgressBar, RichText, Ui};

use crate::app::panels::widgets::{count, duration, on_click, weak};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::training_state::{Phase, headline};
use crate::app::theme;
use crate::render::DrawnBy;

/// Draws the bar.
pub fn status_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    ui.horizontal(|ui| {
        let phase = &state.training.phase;
        chip(ui, phase.name(), theme::of_phase(ui.visuals(), phase));
        match phase {
            Phase::Idle => {}
            Phase::Loading { what, fraction } => {
                ui.label(what);
                progress(ui, *fraction, &[]);
            }
            Phase::Failed(reason) => {
                ui.add(egui::Label::new(reason).truncate());
            }
            Phase::Training | Phase::Paused | Phase::Finished(_) => figures_ui(ui, state),
        }
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            right_ui(ui, state, commands);
        });
    });
}

fn figures_ui(ui: &mut Ui, state: &AppState) {
    let p = &state.training.progress;
    let step = match p.planned_steps {
        Some(planned) => format!("step {} / {planned}", p.step),
        None => format!("step {}", p.step),
    };
    ui.label(step);
    ui.label(match state.training.retraced {
        Some(fraction) => format!("tracing light anew, {:.0} %", 100.0 * fraction),
        None => format!("{} it/s", count(p.steps_per_sec)),
    });
    ui.label(format!("{} elapsed", duration(p.elapsed_secs)));
    if matches!(state.training.phase, Phase::Training | Phase::Paused) {
        ui.label(format!("{} left", duration(p.eta_secs)));
    }
    progress(ui, p.fraction, &state.training.saved_fractions());
    if let Some(validation) = &state.training.validation {
        ui.label(format!("{:.1} dB", headline(validation)))
            .on_hover_text("PSNR on held-out photos (of the object, if there is one)");
    }
}

/// A bar with a notch at each save.
fn progress(ui: &mut Ui, fraction: f32, saves: &[f32]) {
    let bar = ProgressBar::new(fraction.clamp(0.0, 1.0))
        .desired_width(140.0)
        .desired_height(10.0);
    let bar = ui.add(bar);
    let stroke = egui::Stroke::new(2.0, ui.visuals().strong_text_color());
    for at in saves {
        let x = bar.rect.left() + at * bar.rect.width();
        ui.painter().vline(x, bar.rect.y_range(), stroke);
    }
    let mut hint = format!("{:.0} % of the plan", 100.0 * fraction);
    if !saves.is_empty() {
        hint.push_str("; a notch is a save");
    }
    bar.on_hover_text(hint);
    ui.label(weak(ui, format!("{:.0} %", 100.0 * fraction)));
}

fn right_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let n = state.messages.all().len();
    let button = ui.small_button(format!("Messages ({n})"));
    let button = button.on_hover_text("Everything that was said");
    on_click(&button, Command::ToggleLog, commands);
    drawing_ui(ui, state);
    if let Some(shown) = state.shown {
        let scale = match shown.scale {
            1 => "full resolution",
            2 => "1/2 resolution",
            _ => "1/4 resolution",
        };
        let (width, height) = shown.size;
        let more = if shown.is_refining { "…" } else { "" };
        ui.label(weak(ui, format!("{scale}{more}")))
            .on_hover_text(format!("Preview of {width} × {height} pixels"));
    }
}

/// Says where no graphics card draws the preview, and why.
fn drawing_ui(ui: &mut Ui, state: &AppState) {
    let adapter = &state.adapter;
    let window = if adapter.is_software {
        format!(
            "No GPU in use ({}). Everything works; the window itself costs some processor time.",
            adapter.name
        )
    } else {
        format!("The window is drawn by {}.", adapter.name)
    };
    let (text, hint) = match &state.drawn_by {
        DrawnBy::Processor { why, .. } => (
            "software rendering",
            format!("{window}\nThe processor draws the preview: {why}."),
        ),
        DrawnBy::ProcessorFor { card, what } => (
            "drawn by the processor",
            format!("{card} draws the preview, but not {what}: that is left to the processor."),
        ),
        _ if adapter.is_software => ("software rendering", window),
        DrawnBy::Undecided | DrawnBy::Card(_) => return,
    };
    let amber = theme::of_phase(ui.visuals(), &Phase::Paused);
    chip(ui, text, amber).on_hover_text(hint);
}

/// A word on a tinted ground.
pub fn chip(ui: &mut Ui, text: &str, color: Color32) -> egui::Response {
    let frame = egui::Frame::NONE
        .fill(color.gamma_multiply(0.18))
        .corner_radius(4)
        .inner_margin(egui::Margin::symmetric(6, 1));
    frame
        .show(ui, |ui| ui.label(RichText::new(text).color(color).strong()))
        .inner
}
