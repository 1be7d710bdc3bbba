//! What the material panel changes: the whole object, or a region of it.
//!
//! The choice takes two rows whatever there is to choose from, so that the sliders below it stay where they are.

use egui::{Button, ComboBox, Response, RichText, Role, Ui, WidgetInfo};

use crate::app::inspect::InspectCommand;
use crate::app::panels::widgets::{Setting, name_label, on_click, slider_row, weak};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::neif::{Extent, Likeness, Region};

/// Width of the choice, points: “Region 8 (like material)” and its arrow.
const CHOICE_WIDTH: f32 = 172.0;
const LIKENESS: Setting = Setting {
    name: "Tolerance",
    range: 0.0..=0.6,
    default: 0.15,
    hint: "How much roughness, tint and diffuse colour may differ from the picked point's",
};
const SOFTNESS: Setting = Setting {
    name: "Soft edge",
    range: 0.0..=1.0,
    default: 0.3,
    hint: "How gradually the edit fades out",
};

/// Draws the choice, and the buttons that grow a region from the picked point.
pub fn scope_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let mut hovered = None;
    ui.horizontal(|ui| {
        let chosen = state.scope().map(|(index, _)| index);
        let name = name_label(ui, "Acts on").on_hover_text("What the sliders below change");
        let choice = choice_ui(ui, state, chosen, &mut hovered, commands);
        if choice.labelled_by(name.id).contains_pointer() {
            hovered = hovered.or(chosen);
        }
        delete_ui(ui, chosen, commands);
    });
    ui.horizontal(|ui| grow_ui(ui, state, commands));
    if hovered != state.inspect.hovered {
        commands.push(Command::Inspect(InspectCommand::Hover(hovered)));
    }
}

/// Draws how far the chosen region reaches, where that can be chosen.
pub fn reach_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let Some((index, region)) = state.scope() else {
        return;
    };
    let Extent::Material(like) = region.extent else {
        return;
    };
    ui.label(weak(ui, format!("Reach of region {}", index + 1)));
    let mut changed = like;
    slider_row(ui, &LIKENESS, &mut changed.threshold);
    slider_row(ui, &SOFTNESS, &mut changed.softness);
    ui.checkbox(&mut changed.within_part, "Connected part only")
        .on_hover_text("Keeps to the part of the mesh that was clicked");
    if changed != like {
        let set = InspectCommand::SetExtent(index, Extent::Material(changed));
        commands.push(Command::Inspect(set));
    }
}

/// The list to choose from; `hovered` becomes the region of it that is under the pointer.
fn choice_ui(
    ui: &mut Ui,
    state: &AppState,
    chosen: Option<usize>,
    hovered: &mut Option<usize>,
    commands: &mut Vec<Command>,
) -> Response {
    let regions = &state.look.regions;
    let name =
        |index: Option<usize>| match index.and_then(|index| Some((index, regions.get(index)?))) {
            Some((index, region)) => region_name(index, region),
            None => "Whole object".to_owned(),
        };
    let list = ComboBox::from_id_salt("scope")
        .width(CHOICE_WIDTH)
        .selected_text(name(chosen));
    let list = list.show_ui(ui, |ui| {
        for index in std::iter::once(None).chain((0..regions.len()).map(Some)) {
            let item = ui.selectable_label(index == chosen, name(index));
            if item.contains_pointer() {
                *hovered = index;
            }
            let choose = InspectCommand::ChooseScope(index);
            on_click(&item, Command::Inspect(choose), commands);
        }
    });
    list.response
        .on_hover_text("The whole object, or a region; regions are shown in the picture while the pointer is on them")
}

fn region_name(index: usize, region: &Region) -> String {
    let what = match region.extent {
        Extent::Part => "part",
        Extent::Material(_) => "like material",
    };
    format!("Region {} ({what})", index + 1)
}

/// A small cross that deletes the chosen region; dead while the whole object is chosen.
fn delete_ui(ui: &mut Ui, chosen: Option<usize>, commands: &mut Vec<Command>) {
    let cross = Button::new(RichText::new("×").monospace().size(15.0)).frame(false);
    let button = ui.add_enabled(chosen.is_some(), cross);
    let name = chosen.map_or("Delete region".to_owned(), |index| {
        format!("Delete region {}", index + 1)
    });
    button.widget_info(|| WidgetInfo::labeled(Role::Button, chosen.is_some(), &name));
    let clicked = chosen.filter(|_| button.on_hover_text(name).clicked());
    let remove = clicked.map(InspectCommand::RemoveRegion);
    commands.extend(remove.map(Command::Inspect));
}

/// The buttons that make a region; what to do first while nothing is picked.
fn grow_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    if state.inspect.pick.is_none() {
        let what = weak(ui, "Click the object to edit a part of it.");
        ui.label(what)
            .on_hover_text("What is known of the point is shown too");
        return;
    }
    let part = ui.button("Edit this part");
    let part = part.on_hover_text("A region of the connected part of the mesh");
    let add = |extent| Command::Inspect(InspectCommand::AddRegion(extent));
    on_click(&part, add(Extent::Part), commands);
    let like = ui.button("Edit like material");
    let like = like.on_hover_text("A region of whatever is made of nearly the same");
    let extent = Extent::Material(Likeness::default());
    on_click(&like, add(extent), commands);
}
