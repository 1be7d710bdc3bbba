//! The panel beside the photo: what to do, what was found, and all photos with their outlines, those in doubt first.

use egui::{Button, Image, ProgressBar, ScrollArea, Sense, Slider, Ui, load::SizedTexture, vec2};

use super::pictures::ObjectPictures;
use super::state::{ObjectCommand, Search};
use crate::app::panels::widgets::{choices_ui, log_place, on_click, set_label, weak};
use crate::app::state::app_state::{AppState, PathPurpose};
use crate::app::state::command::Command;
use crate::data::View;
use crate::train::masks::FoundObject;

/// Side of a small picture, points.
const SMALL: f32 = 72.0;
/// Height of the picture of the shape, points.
const SHAPE_HEIGHT: f32 = 150.0;
/// When training has come so much further, another search would find more.
const WORTH_MORE: f64 = 1.5;

/// Draws the panel.
pub(in crate::app) fn object_panel_ui(
    ui: &mut Ui,
    state: &AppState,
    pictures: &ObjectPictures,
    commands: &mut Vec<Command>,
) {
    let object = &state.object;
    ui.add_space(4.0);
    ui.heading("Select the object");
    match &object.search {
        Search::Busy(what, share) => {
            ui.add(ProgressBar::new(*share).text(*what));
        }
        Search::Failed(reason) => {
            ui.colored_label(ui.visuals().error_fg_color, reason);
            again_ui(ui, "Try again", commands);
        }
        Search::Idle => {}
    }
    match &object.found {
        None => pointing_ui(ui, state, commands),
        Some(found) => {
            ui.label(summary(found));
            accept_ui(ui, commands);
            strokes_ui(ui, state, commands);
            let step = state.snapshot.as_ref().map_or(0, |snapshot| snapshot.step);
            if step as f64 > WORTH_MORE * object.step as f64 && object.search == Search::Idle {
                again_ui(ui, "Search with what is learned by now", commands);
            }
        }
    }
    ui.horizontal(|ui| {
        if object.selection.is_some() {
            let another = ui.button("Another object");
            let another = another.on_hover_text("Forgets this one; then click on the other");
            on_click(&another, Command::Object(ObjectCommand::Another), commands);
        }
        let cancel = ui.button("Cancel");
        on_click(
            &cancel,
            Command::Object(ObjectCommand::Select(false)),
            commands,
        );
    });
    shape_ui(ui, pictures);
    photos_ui(ui, state, pictures, commands);
}

/// What to do with an object that looks right.
fn accept_ui(ui: &mut Ui, commands: &mut Vec<Command>) {
    ui.horizontal_wrapped(|ui| {
        let train = ui.button("Looks right: train");
        let train = train.on_hover_text("Begins anew, with the object and with what is around it");
        log_place(ui, "Looks right: train", train.rect);
        on_click(&train, Command::Object(ObjectCommand::Train), commands);
        let export = ui.button("Export masks…");
        let export = export.on_hover_text("A PNG a photo: white is the object");
        on_click(&export, Command::AskPath(PathPurpose::Masks), commands);
    });
}

fn again_ui(ui: &mut Ui, text: &str, commands: &mut Vec<Command>) {
    let again = ui.button(text);
    on_click(&again, Command::Object(ObjectCommand::Again), commands);
}

/// Before anything was found.
fn pointing_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let has_failed = matches!(state.object.search, Search::Failed(_));
    if state.object.selection.is_some() && !has_failed {
        return;
    }
    ui.label("Click on it in the photo, or take what all photos look at:");
    let looked_at = ui.button("What the photos look at");
    log_place(ui, "What the photos look at", looked_at.rect);
    on_click(
        &looked_at,
        Command::Object(ObjectCommand::LookedAt),
        commands,
    );
    ui.label(weak(
        ui,
        "It is found in what training has learned of the place so far: half a minute is enough for most. Training goes on meanwhile.",
    ));
}

/// What was found in one line.
fn summary(found: &FoundObject) -> String {
    let n = found.masks.len();
    match found.doubtful().len() {
        0 => format!("Found in {n} photos."),
        1 => format!("Found in {n} photos; the others contradict the first below."),
        few => format!("Found in {n} photos; the others contradict the first {few} below."),
    }
}

fn strokes_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let object = &state.object;
    ui.horizontal_wrapped(|ui| {
        let kinds = [
            (
                true,
                "Add",
                "Strokes over parts of the object that were missed",
            ),
            (false, "Remove", "Strokes over what is not the object"),
        ];
        let chosen = choices_ui(ui, object.adds, kinds);
        commands.extend(chosen.map(|adds| Command::Object(ObjectCommand::SetAdds(adds))));
        for (text, hint, command, is_possible) in [
            (
                "Undo",
                "Ctrl+Z",
                ObjectCommand::Undo,
                !object.strokes.is_empty(),
            ),
            (
                "Redo",
                "Ctrl+Y",
                ObjectCommand::Redo,
                !object.undone.is_empty(),
            ),
        ] {
            let button = ui.add_enabled(is_possible, Button::new(text));
            on_click(
                &button.on_hover_text(hint),
                Command::Object(command),
                commands,
            );
        }
    });
    ui.horizontal(|ui| {
        ui.label("Brush");
        let mut percent = 100.0 * object.brush;
        let slider = Slider::new(&mut percent, 0.2..=10.0)
            .logarithmic(true)
            .suffix(" %");
        let slider = ui
            .add(slider)
            .on_hover_text("Radius, of the photo's shorter side; the wheel changes it too");
        set_label(&slider, "Brush");
        if slider.changed() {
            commands.push(Command::Object(ObjectCommand::SetBrush(percent / 100.0)));
        }
    });
}

fn shape_ui(ui: &mut Ui, pictures: &ObjectPictures) {
    let Some((texture, [width, height])) = pictures.shape else {
        return;
    };
    let size = vec2(width as f32, height as f32);
    let scale = (SHAPE_HEIGHT / size.y).min(ui.available_width() / size.x);
    let image = Image::new(SizedTexture::new(texture, size * scale));
    ui.add(image)
        .on_hover_text("The shape on which the photos agree, as clay");
}

/// Small pictures of all photos, those in doubt first; a click goes there.
fn photos_ui(
    ui: &mut Ui,
    state: &AppState,
    pictures: &ObjectPictures,
    commands: &mut Vec<Command>,
) {
    let n = state.views().count();
    let mut order: Vec<usize> = (0..n).collect();
    if let Some(found) = &state.object.found {
        let agreement = |i: &usize| found.agreement.get(*i).copied().unwrap_or(1.0);
        order.sort_by(|a, b| agreement(a).total_cmp(&agreement(b)));
    }
    let names: Vec<String> = state.views().map(View::full_name).collect();
    let gap = ui.spacing().item_spacing.x;
    let columns = ((ui.available_width() + gap) / (SMALL + gap)) as usize;
    let columns = columns.max(1);
    let rows = n.div_ceil(columns);
    ui.add_space(4.0);
    let scroll = ScrollArea::vertical()
        .auto_shrink([false, false])
        .id_salt("outlines");
    scroll.show_rows(ui, SMALL, rows, |ui, shown| {
        for row in shown {
            ui.horizontal(|ui| {
                for i in order.iter().skip(row * columns).take(columns) {
                    photo_ui(ui, state, pictures, (*i, &names[*i]), commands);
                }
            });
        }
    });
}

fn photo_ui(
    ui: &mut Ui,
    state: &AppState,
    pictures: &ObjectPictures,
    (index, name): (usize, &str),
    commands: &mut Vec<Command>,
) {
    let (rect, response) = ui.allocate_exact_size(vec2(SMALL, SMALL), Sense::click());
    set_label(&response, name);
    let response = match state
        .object
        .found
        .as_ref()
        .and_then(|f| f.agreement.get(index))
    {
        Some(share) => response.on_hover_text(format!(
            "{name}: {:.0} % in common with what the other photos say",
            100.0 * share
        )),
        None => response.on_hover_text(name),
    };
    if ui.is_rect_visible(rect) {
        let visuals = ui.visuals();
        ui.painter()
            .rect_filled(rect, 3.0, visuals.extreme_bg_color);
        if let Some((texture, [width, height])) = pictures.thumbnails.get(&index) {
            let size = vec2(*width as f32, *height as f32);
            let scale = (SMALL / size.x).min(SMALL / size.y);
            let image = Image::new(SizedTexture::new(*texture, size));
            let place = egui::Rect::from_center_size(rect.center(), size * scale);
            image.paint_at(ui, place);
        } else {
            let (at, align) = (rect.center(), egui::Align2::CENTER_CENTER);
            let font = egui::FontId::proportional(10.0);
            let color = ui.visuals().weak_text_color();
            ui.painter()
                .with_clip_rect(rect)
                .text(at, align, name, font, color);
        }
        let is_here = state.view.at_view == Some(index);
        let stroke = if is_here {
            egui::Stroke::new(2.0, ui.visuals().selection.bg_fill)
        } else if response.hovered() {
            ui.visuals().widgets.hovered.bg_stroke
        } else {
            egui::Stroke::NONE
        };
        ui.painter()
            .rect_stroke(rect, 3.0, stroke, egui::StrokeKind::Inside);
    }
    on_click(&response, Command::GoToView(index), commands);
}
