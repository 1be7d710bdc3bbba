//! The panel of the picked point: its values as text, and the environment as the point sees it. Below what is edited,
//! which therefore stays where it is when a point is picked.

use egui::{Color32, Grid, Pos2, Rect, RichText, Sense, Shape, Stroke, Ui, vec2};
use glam::{Quat, Vec2, Vec3};

use crate::app::inspect::{InspectCommand, Pick};
use crate::app::panels::section::section_row;
use crate::app::panels::widgets::{on_click, weak};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::sections::Section;
use crate::app::viewport::overlay::{Pictures, WHOLE};
use crate::geometry::orthonormal_basis;
use crate::neif::surface::values::Surface;
use crate::render::{PanoramaView, PointValues, PointView, lobe_half_width};

/// Corners of the outline of the lobe.
const N_CORNERS: usize = 72;
/// Stands for a value that is not known yet, so that what is below the table stays where it is when it comes.
const UNKNOWN: &str = "…";

/// Draws the panel; nothing while nothing is picked.
pub fn inspect_ui(ui: &mut Ui, state: &AppState, pictures: &Pictures, commands: &mut Vec<Command>) {
    let Some(pick) = &state.inspect.pick else {
        return;
    };
    let view = pick.seen_by(&state.view.viewpoint.camera);
    let rows = rows(pick, &view, state.inspect.values.as_ref());
    let is_open = section_row(ui, state, Section::Point, commands, |ui, commands| {
        let forget = ui.button("Forget point").on_hover_text("Esc");
        let command = Command::Inspect(InspectCommand::Forget);
        on_click(&forget, command, commands);
        let copy = ui.button("Copy values");
        if copy.on_hover_text("As text, a value a line").clicked() {
            ui.ctx().copy_text(as_text(&rows));
        }
    });
    if is_open {
        let grid = Grid::new("point").num_columns(2);
        // Closer than controls: nothing here is to be hit.
        let grid = grid.min_row_height(0.0).spacing(vec2(8.0, 3.0));
        grid.show(ui, |ui| {
            for row in &rows {
                ui.label(weak(ui, row.name)).on_hover_text(row.hint);
                ui.label(RichText::new(&row.value).monospace().size(12.0));
                ui.end_row();
            }
        });
        panorama_ui(ui, state, pictures, &view, commands);
    }
    ui.separator();
}

/// A line of the table.
struct Row {
    name: &'static str,
    value: String,
    hint: &'static str,
}

fn rows(pick: &Pick, view: &PointView, values: Option<&PointValues>) -> Vec<Row> {
    let row = |name, value, hint| Row { name, value, hint };
    let known = |text: &dyn Fn(&PointValues) -> String| values.map_or(UNKNOWN.to_owned(), text);
    let surface = |text: &dyn Fn(&Surface) -> String| {
        known(&|values| changed(&values.learned, &values.edited, text))
    };
    vec![
        row("Position", vector(pick.position), "World coordinates"),
        row("Normal", vector(pick.normal), "Unit vector, world axes"),
        row(
            "Viewing angle",
            format!("{:.1}°", view.viewing_angle().to_degrees()),
            "Between the normal and the direction to the camera; from 90° on the point is seen from behind",
        ),
        row(
            "Roughness",
            surface(&|s| format!("{:.3}", s.roughness)),
            "0 is a mirror, 1 is dull; before and after edits",
        ),
        row(
            "Tint",
            surface(&|s| vector(s.tint)),
            "Specular reflectance looked at along the normal, linear RGB; before and after edits",
        ),
        row(
            "Diffuse",
            surface(&|s| vector(s.diffuse)),
            "Light that the diffuse part sends out, linear RGB; before and after edits",
        ),
        row(
            "Incoming light",
            known(&|values| vector(values.incoming)),
            "Mean radiance of what the point mirrors to the camera, linear RGB",
        ),
        row(
            "Outgoing light",
            known(&|values| vector(values.outgoing)),
            "Radiance that the point sends to the camera, linear RGB",
        ),
    ]
}

/// The value, and where an edit changed it both.
fn changed(learned: &Surface, edited: &Surface, text: impl Fn(&Surface) -> String) -> String {
    let (before, after) = (text(learned), text(edited));
    if before == after {
        before
    } else if before.len() > 8 {
        format!("{before}\n→ {after}")
    } else {
        format!("{before} → {after}")
    }
}

fn vector(v: Vec3) -> String {
    format!("{:.3} {:.3} {:.3}", v.x, v.y, v.z)
}

fn as_text(rows: &[Row]) -> String {
    let line = |row: &Row| format!("{}\t{}\n", row.name, row.value.replace('\n', " "));
    rows.iter().map(line).collect()
}

fn panorama_ui(
    ui: &mut Ui,
    state: &AppState,
    pictures: &Pictures,
    view: &PointView,
    commands: &mut Vec<Command>,
) {
    let width = ui.available_width();
    let (rect, response) = ui.allocate_exact_size(vec2(width, 0.5 * width), Sense::hover());
    response.widget_info(|| {
        let name = "Environment as the point sees it";
        egui::WidgetInfo::labeled(egui::Role::Image, true, name)
    });
    let shown = pictures.panorama.zip(state.inspect.panorama.as_ref());
    if let Some((texture, panorama)) = shown {
        ui.painter().image(texture, rect, WHOLE, Color32::WHITE);
        let roughness = state.inspect.values.map_or(0.0, |v| v.cone_roughness);
        lobe_ui(ui, rect, panorama, view, lobe_half_width(roughness));
    } else {
        let dark = ui.visuals().extreme_bg_color;
        ui.painter().rect_filled(rect, 2.0, dark);
    }
    response.on_hover_text(
        "All directions around the point, up at the top. The cross is the mirror direction; the line around it is where the lobe has fallen to half.",
    );
    let mut is_sharp = state.inspect.is_sharp;
    let toggle = ui.checkbox(&mut is_sharp, "Sharp environment");
    let toggle = toggle.on_hover_text("Off: as blurred as the point mirrors it");
    if toggle.changed() {
        commands.push(Command::Inspect(InspectCommand::ShowSharp(is_sharp)));
    }
}

/// The mirror direction and the lobe's half-width, radians, on the panorama.
fn lobe_ui(ui: &Ui, rect: Rect, panorama: &PanoramaView, view: &PointView, half_width: f32) {
    if view.viewing_angle() >= std::f32::consts::FRAC_PI_2 {
        return;
    }
    let axis = view.reflected();
    let on_screen = |place: Vec2| rect.min + vec2(place.x * rect.width(), place.y * rect.height());
    let (side, _) = orthonormal_basis(axis);
    let rim = Quat::from_axis_angle(side, half_width) * axis;
    let corners = (0..=N_CORNERS).map(|i| {
        let turn = std::f32::consts::TAU * i as f32 / N_CORNERS as f32;
        on_screen(panorama.place(Quat::from_axis_angle(axis, turn) * rim))
    });
    let corners: Vec<Pos2> = corners.collect();
    let center = on_screen(panorama.place(axis));
    let painter = ui.painter().with_clip_rect(rect);
    for (width, color) in [(3.0, Color32::from_black_alpha(150)), (1.2, Color32::WHITE)] {
        let stroke = Stroke::new(width, color);
        for pair in corners.windows(2) {
            // Where the outline leaves the picture on one side and comes back on the other there is no line.
            if (pair[0].x - pair[1].x).abs() < 0.5 * rect.width() {
                painter.add(Shape::line_segment([pair[0], pair[1]], stroke));
            }
        }
        for arm in [vec2(4.0, 0.0), vec2(0.0, 4.0)] {
            painter.line_segment([center - arm, center + arm], stroke);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn copied_values_are_a_line_each() {
        let learned = Surface {
            roughness: 0.1234,
            tint: Vec3::new(0.1, 0.2, 0.3),
            ..Surface::default()
        };
        let edited = Surface {
            roughness: 0.5,
            tint: Vec3::ZERO,
            ..learned
        };
        let row = |name, text: &dyn Fn(&Surface) -> String| Row {
            name,
            value: changed(&learned, &edited, text),
            hint: "",
        };
        let rows = [
            row("Roughness", &|s| format!("{:.3}", s.roughness)),
            row("Tint", &|s| vector(s.tint)),
            row("Diffuse", &|s| vector(s.diffuse)),
        ];
        assert_eq!(
            as_text(&rows),
            "Roughness\t0.123 → 0.500\nTint\t0.100 0.200 0.300 → 0.000 0.000 0.000\nDiffuse\t0.000 0.000 0.000\n"
        );
    }
}
