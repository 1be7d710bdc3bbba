//! Looks: dark unless the system says light; panels without fill.
//!
//! On a machine without GPU each filled pixel costs the processor about 65 ns, so the window's
//! clear colour is the panels' background (five times cheaper frames, measured).

use egui::{Color32, Context, CornerRadius, Stroke, Theme, ThemePreference, Visuals, vec2};

use super::session::preferences::{Preferences, ThemeChoice};
use super::state::training_state::{Level, Phase};

/// The background of all panels.
pub fn background(is_dark: bool) -> Color32 {
    Color32::from_gray(if is_dark { 30 } else { 246 })
}

/// Puts theme and size of the text into effect.
pub fn prefer(ctx: &Context, preferences: &Preferences) {
    ctx.set_theme(match preferences.theme {
        ThemeChoice::System => ThemePreference::System,
        ThemeChoice::Light => ThemePreference::Light,
        ThemeChoice::Dark => ThemePreference::Dark,
    });
    ctx.set_zoom_factor(preferences.zoom);
}

/// Sets both themes up.
pub fn set_up(ctx: &Context) {
    // The table of commands has the keys for it, so that it is remembered.
    ctx.options_mut(|options| options.zoom_with_keyboard = false);
    for theme in [Theme::Dark, Theme::Light] {
        ctx.style_mut_of(theme, |style| {
            style.visuals.panel_fill = Color32::TRANSPARENT;
            style.visuals.window_corner_radius = CornerRadius::same(6);
            style.visuals.window_stroke = Stroke::new(1.0, separator(&style.visuals));
            style.visuals.widgets.noninteractive.bg_stroke =
                Stroke::new(1.0, separator(&style.visuals));
            style.spacing.item_spacing = vec2(8.0, 5.0);
            style.spacing.button_padding = vec2(7.0, 3.0);
            style.spacing.interact_size.y = 22.0;
            style.spacing.slider_width = 120.0;
            style.animation_time = 0.0;
            if theme == Theme::Dark {
                style.visuals.widgets.noninteractive.fg_stroke.color = Color32::from_gray(200);
                style.visuals.widgets.inactive.fg_stroke.color = Color32::from_gray(220);
                style.visuals.window_fill = Color32::from_gray(38);
            }
        });
    }
}

fn separator(visuals: &Visuals) -> Color32 {
    Color32::from_gray(if visuals.dark_mode { 58 } else { 205 })
}

/// Text that matters less.
pub fn weak(visuals: &Visuals) -> Color32 {
    Color32::from_gray(if visuals.dark_mode { 155 } else { 95 })
}

/// The colour that draws the eye.
pub fn accent(visuals: &Visuals) -> Color32 {
    either(visuals, [96, 176, 255], [0, 98, 190])
}

/// A second colour for curves, distinguished from the first by brightness too.
pub fn accent_2(visuals: &Visuals) -> Color32 {
    either(visuals, [255, 178, 84], [176, 92, 0])
}

fn either(visuals: &Visuals, on_dark: [u8; 3], on_light: [u8; 3]) -> Color32 {
    let [r, g, b] = if visuals.dark_mode { on_dark } else { on_light };
    Color32::from_rgb(r, g, b)
}

/// The colour of a phase of training.
pub fn of_phase(visuals: &Visuals, phase: &Phase) -> Color32 {
    let [green, amber, red] = traffic_light(visuals);
    match phase {
        Phase::Idle => weak(visuals),
        Phase::Loading { .. } => accent(visuals),
        Phase::Training | Phase::Finished(_) => green,
        Phase::Paused => amber,
        Phase::Failed(_) => red,
    }
}

/// The colour of a message.
pub fn of_level(visuals: &Visuals, level: Level) -> Color32 {
    let [_, amber, red] = traffic_light(visuals);
    match level {
        Level::Info => accent(visuals),
        Level::Warning => amber,
        Level::Error => red,
    }
}

/// Green, amber and red.
fn traffic_light(visuals: &Visuals) -> [Color32; 3] {
    [
        either(visuals, [110, 205, 120], [20, 120, 40]),
        either(visuals, [240, 190, 80], [150, 95, 0]),
        either(visuals, [255, 115, 105], [190, 30, 25]),
    ]
}
