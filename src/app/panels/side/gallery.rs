//! The gallery of environments: a small picture of each, chosen by a click.

use std::path::Path;

use egui::text::{LayoutJob, TextWrapping};
use egui::{
    Align2, Color32, FontId, ProgressBar, Rect, Response, Role, ScrollArea, Sense, Stroke,
    StrokeKind, TextureId, Ui, WidgetInfo, pos2, vec2,
};

use crate::app::lighting::LightingCommand;
use crate::app::panels::widgets::{log_place, on_click};
use crate::app::state::app_state::{AppState, PathPurpose};
use crate::app::state::command::Command;
use crate::app::state::source::{EnvironmentContent, EnvironmentEntry};
use crate::app::theme;
use crate::app::viewport::overlay::{Pictures, WHOLE};

/// Tiles beside each other.
const COLUMNS: usize = 3;
/// Height of the name below a picture, in points.
const NAME: f32 = 18.0;
/// Most height that the list takes before it scrolls, in points.
const MOST_HEIGHT: f32 = 215.0;

/// A tile of the gallery.
struct Tile<'a> {
    name: String,
    hint: String,
    picture: Option<TextureId>,
    /// Index of the environment; none is the capture's own.
    environment: Option<usize>,
    entry: Option<&'a EnvironmentEntry>,
}

/// Draws the gallery and the button that adds to it.
pub fn gallery_ui(ui: &mut Ui, state: &AppState, pictures: &Pictures, commands: &mut Vec<Command>) {
    let tiles = tiles(state, pictures);
    ScrollArea::vertical()
        .max_height(MOST_HEIGHT)
        .auto_shrink([false, true])
        .id_salt("environments")
        .show(ui, |ui| {
            let gap = ui.spacing().item_spacing.x;
            let width = (ui.available_width() - gap * (COLUMNS - 1) as f32) / COLUMNS as f32;
            for row in tiles.chunks(COLUMNS) {
                ui.horizontal(|ui| {
                    for tile in row {
                        tile_ui(ui, tile, width.floor(), state, commands);
                    }
                });
            }
        });
    imports_ui(ui, state, commands);
    let add = ui.button("Add environment…");
    let what = "A trained environment (.safetensors), a saved run, a scan (Gaussian splats, a NeRF), or a panorama (.hdr, .exr)";
    let ask = Command::AskPath(PathPurpose::AddEnvironment);
    on_click(&add.on_hover_text(what), ask, commands);
}

/// How far the imports of scans are.
fn imports_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    for import in &state.lighting.imports {
        let Some(entry) = state.environments.get(import.environment) else {
            continue;
        };
        ui.horizontal(|ui| {
            let stop = ui
                .button("Stop")
                .on_hover_text("What was learned so far stays");
            on_click(&stop, Command::StopImport(import.environment), commands);
            let text = format!("{}: {}", entry.name, import.what);
            // All of the rest would widen the panel by a gap.
            let width = ui.available_width() - ui.spacing().item_spacing.x;
            let bar = ProgressBar::new(import.fraction).text(text);
            ui.add(bar.desired_width(width.max(0.0)));
        });
    }
}

fn tiles<'a>(state: &'a AppState, pictures: &Pictures) -> Vec<Tile<'a>> {
    let picture = |path: &Path| {
        let mut known = pictures.thumbnails.iter();
        known.find(|(file, _)| **file == *path).map(|(_, id)| *id)
    };
    let name = match &state.snapshot {
        Some(snapshot) if snapshot.object.is_none() => {
            format!("{} (opened)", snapshot.environment.name())
        }
        _ => "As captured".to_owned(),
    };
    let own = Tile {
        name,
        hint: "The environment of the photos".to_owned(),
        picture: pictures.own_thumbnail,
        environment: None,
        entry: None,
    };
    let entries = state.environments.iter().enumerate();
    let listed = entries.filter(|(i, _)| !state.lighting.removed.contains(i));
    let others = listed.map(|(i, entry)| Tile {
        name: match &entry.content {
            EnvironmentContent::Loading => format!("{} (loading…)", entry.name),
            EnvironmentContent::Failed(_) => format!("{} (cannot be used)", entry.name),
            _ => entry.name.clone(),
        },
        hint: format!("{}\n{}", entry.path.display(), entry.about)
            .trim_end()
            .to_owned(),
        picture: picture(&entry.path),
        environment: Some(i),
        entry: Some(entry),
    });
    std::iter::once(own).chain(others).collect()
}

fn tile_ui(
    ui: &mut Ui,
    tile: &Tile<'_>,
    width: f32,
    state: &AppState,
    commands: &mut Vec<Command>,
) {
    let size = vec2(width, 0.5 * width + NAME);
    let (rect, response) = ui.allocate_exact_size(size, Sense::click());
    let is_chosen = state.look.environment == tile.environment;
    response.widget_info(|| WidgetInfo::selected(Role::RadioButton, true, is_chosen, &tile.name));
    log_place(ui, &tile.name, rect);
    draw(ui, rect, tile, is_chosen, &response);
    if let (Some(index), Some(entry)) = (tile.environment, tile.entry) {
        remove_ui(ui, rect, index, &entry.name, commands);
    }
    let response = response.on_hover_text(format!("{}\n{}", tile.name, tile.hint));
    let choose = Command::ChooseEnvironment(tile.environment);
    on_click(&response, choose, commands);
}

fn draw(ui: &Ui, rect: Rect, tile: &Tile<'_>, is_chosen: bool, response: &Response) {
    let visuals = ui.visuals();
    let picture = Rect::from_min_size(rect.min, vec2(rect.width(), 0.5 * rect.width()));
    if let Some(id) = tile.picture {
        ui.painter().image(id, picture, WHOLE, Color32::WHITE);
    } else {
        let (font, color) = (FontId::proportional(18.0), theme::weak(visuals));
        let (at, anchor) = (picture.center(), Align2::CENTER_CENTER);
        ui.painter().text(at, anchor, "…", font, color);
    }
    let stroke = match (is_chosen, response.hovered() || response.has_focus()) {
        (true, _) => Stroke::new(2.5, theme::accent(visuals)),
        (false, true) => Stroke::new(1.5, visuals.text_color()),
        (false, false) => visuals.widgets.noninteractive.bg_stroke,
    };
    ui.painter()
        .rect_stroke(picture, 3.0, stroke, StrokeKind::Inside);
    let color = if is_chosen {
        theme::accent(visuals)
    } else {
        visuals.text_color()
    };
    let (name, font) = (tile.name.clone(), FontId::proportional(12.0));
    let mut text = LayoutJob::simple_singleline(name, font, color);
    text.wrap = TextWrapping::truncate_at_width(rect.width());
    let galley = ui.painter().layout_job(text);
    let at = pos2(rect.left(), picture.bottom() + 2.0);
    ui.painter().galley(at, galley, color);
}

/// A small cross that takes an environment off the list.
fn remove_ui(ui: &Ui, tile: Rect, index: usize, name: &str, commands: &mut Vec<Command>) {
    let corner = Rect::from_min_size(tile.right_top() + vec2(-17.0, 1.0), vec2(16.0, 16.0));
    let id = ui.scope_id().with(("remove", index));
    let response = ui.interact(corner, id, Sense::click());
    let label = format!("Remove {name}");
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, &label));
    let color = if response.hovered() || response.has_focus() {
        Color32::WHITE
    } else {
        Color32::from_white_alpha(170)
    };
    for (width, color) in [(3.0, Color32::from_black_alpha(150)), (1.5, color)] {
        let cross = corner.shrink(4.5);
        let stroke = Stroke::new(width, color);
        let painter = ui.painter();
        painter.line_segment([cross.left_top(), cross.right_bottom()], stroke);
        painter.line_segment([cross.right_top(), cross.left_bottom()], stroke);
    }
    let remove = Command::Lighting(LightingCommand::Remove(index));
    let response = response.on_hover_text("Take it off the list");
    on_click(&response, remove, commands);
}
