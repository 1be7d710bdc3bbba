//! Picking a point of the object and editing the parts that grow from it.

use std::sync::Arc;

use egui::Role;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use glam::{Quat, Vec3};
use neif::app::AppState;
use neif::geometry::{Mesh, SurfaceTracer};
use neif::neif::distant::{DistantConfig, DistantLight};
use neif::neif::networks::hash_grid::{GridConfig, LEAST_WEIGHT};
use neif::neif::surface::material::MaterialConfig;
use neif::neif::{Environment, Extent, Material, MaterialEdit, ObjectModel, SurfaceField};
use neif::train::Snapshot;

use super::{Shown, click, harness};

/// A large square that faces the camera, under a grey sky.
pub(super) fn snapshot() -> Arc<Snapshot> {
    let positions = vec![
        Vec3::new(0.0, -1.0, -1.0),
        Vec3::new(0.0, 1.0, -1.0),
        Vec3::new(0.0, 1.0, 1.0),
        Vec3::new(0.0, -1.0, 1.0),
    ];
    let mesh = Mesh::new(positions, None, vec![[0, 1, 2], [0, 2, 3]]).expect("a square");
    let grid = GridConfig {
        n_levels: 4,
        coarsest: 2,
        finest: 8,
        log2_table_size: 8,
        least_weight: LEAST_WEIGHT,
    };
    let config = MaterialConfig {
        grid,
        n_hidden: 16,
        rgb_tint: true,
    };
    let material = Material::new(config, Vec3::ZERO, 2.2, || 0.4);
    let sky = DistantConfig {
        width: 16,
        height: 8,
        world_from_picture: Quat::IDENTITY,
        has_floor: false,
    };
    let light = DistantLight::new(sky, &[0.5; 16 * 8 * 3]).expect("a picture");
    Arc::new(Snapshot {
        step: 1,
        object: Some(Arc::new(ObjectModel {
            tracer: Arc::new(SurfaceTracer::new(Arc::new(mesh))),
            material: Arc::new(SurfaceField::Grid(material)),
        })),
        environment: Arc::new(Environment::of_distant("sky".to_owned(), Vec3::Z, light)),
        exposures: None,
    })
}

/// A harness that shows the square, looked at from the side.
fn shown() -> Harness<'static, Shown> {
    let mut state = AppState::default();
    let snapshot = snapshot();
    state.look_at_model(&snapshot);
    state.snapshot = Some(snapshot);
    let mut harness = harness(state);
    harness.state_mut().pictures.preview = Some(egui::TextureId::default());
    harness.run_steps(2);
    harness
}

/// The same with its middle picked.
fn picked() -> Harness<'static, Shown> {
    let mut harness = shown();
    click(&mut harness, "Preview of the scene");
    harness
}

/// Opens the list of what the material panel can act on.
fn open_scopes(harness: &mut Harness<'_, Shown>) {
    let list = harness.get_by_role_and_label(Role::ComboBox, "Acts on");
    list.click();
    harness.run_steps(3);
}

fn choose_scope(harness: &mut Harness<'_, Shown>, name: &str) {
    open_scopes(harness);
    click(harness, name);
}

fn state<'a>(harness: &'a Harness<'_, Shown>) -> &'a AppState {
    &harness.state().state
}

#[test]
fn a_click_picks_and_escape_forgets() {
    let mut harness = picked();
    let pick = state(&harness).inspect.pick.expect("the square is in view");
    assert!(pick.position.length() < 0.1, "its middle: {pick:?}");
    assert!(pick.normal.x.abs() > 0.999, "its normal: {pick:?}");
    harness.get_by_label("Picked point");
    harness.get_by_label("Viewing angle");
    harness.get_by_label("Environment as the point sees it");
    click(&mut harness, "Sharp environment");
    assert!(state(&harness).inspect.is_sharp);
    harness.key_press(egui::Key::Escape);
    harness.run_steps(2);
    assert_eq!(state(&harness).inspect.pick, None);
    assert!(harness.query_by_label("Picked point").is_none());
}

#[test]
fn sliders_act_on_the_chosen_scope_alone() {
    let mut harness = picked();
    click(&mut harness, "Edit this part");
    click(&mut harness, "Edit like material");
    let extents: Vec<Extent> = state(&harness)
        .look
        .regions
        .iter()
        .map(|region| region.extent)
        .collect();
    assert!(matches!(extents[..], [Extent::Part, Extent::Material(_)]));
    let strength = |harness: &mut Harness<'_, Shown>, value: f64| {
        let slider = harness.get_all_by_label("Strength").last();
        slider.expect("a slider").set_value_accesskit(value);
        harness.run_steps(2);
    };
    strength(&mut harness, 0.5);
    choose_scope(&mut harness, "Region 1 (part)");
    strength(&mut harness, 1.5);
    let tints = |harness: &Harness<'_, Shown>| {
        let look = &state(harness).look;
        let of_regions = look.regions.iter().map(|region| region.edit.tint_scale);
        (look.edit.tint_scale, of_regions.collect::<Vec<_>>())
    };
    assert_eq!(tints(&harness), (1.0, vec![1.5, 0.5]));
    choose_scope(&mut harness, "Whole object");
    strength(&mut harness, 0.8);
    assert_eq!(tints(&harness), (0.8, vec![1.5, 0.5]));
    click(&mut harness, "Reset material");
    assert_eq!(state(&harness).look.edit, MaterialEdit::default());
    choose_scope(&mut harness, "Region 1 (part)");
    click(&mut harness, "Delete region 1");
    assert_eq!(tints(&harness), (1.0, vec![0.5]));
}

#[test]
fn a_region_is_shown_while_the_pointer_is_over_it() {
    let mut harness = picked();
    click(&mut harness, "Edit like material");
    choose_scope(&mut harness, "Whole object");
    open_scopes(&mut harness);
    assert!(state(&harness).highlight().is_none());
    let place = harness.get_by_label("Region 1 (like material)").rect();
    harness.hover_at(place.center());
    harness.run_steps(2);
    assert!(state(&harness).highlight().is_some());
    harness.hover_at(egui::pos2(640.0, 400.0));
    harness.run_steps(2);
    assert!(state(&harness).highlight().is_none());
}

#[test]
fn the_material_sliders_stay_in_their_place_whatever_is_picked_or_chosen() {
    let mut harness = shown();
    let screen = egui::vec2(1280.0, 1000.0);
    harness.set_size(screen);
    harness.run_steps(3);
    let sliders = |harness: &Harness<'_, Shown>| {
        ["Offset", "Strength", "Brightness"].map(|label| {
            let slider = harness.get_by_role_and_label(Role::Slider, label);
            slider.rect()
        })
    };
    let before = sliders(&harness);
    let window = egui::Rect::from_min_size(egui::Pos2::ZERO, screen);
    assert!(
        before.into_iter().all(|rect| window.contains_rect(rect)),
        "below the fold: {before:?}"
    );
    click(&mut harness, "Preview of the scene");
    assert!(state(&harness).inspect.pick.is_some(), "picked");
    assert_eq!(sliders(&harness), before, "with a point");
    click(&mut harness, "Edit this part");
    assert_eq!(sliders(&harness), before, "with a part");
    click(&mut harness, "Edit like material");
    harness.get_by_role_and_label(Role::Slider, "Tolerance");
    assert_eq!(sliders(&harness), before, "with what is like the point");
    choose_scope(&mut harness, "Region 1 (part)");
    assert_eq!(sliders(&harness), before, "with another region");
    click(&mut harness, "One value");
    let strength = harness.get_by_role_and_label(Role::Slider, "Strength");
    assert_eq!(strength.rect(), before[1], "with one roughness");
    choose_scope(&mut harness, "Whole object");
    harness.key_press(egui::Key::Escape);
    harness.run_steps(2);
    assert_eq!(state(&harness).inspect.pick, None, "forgotten");
    assert_eq!(sliders(&harness), before, "as at first");
}
