//! Picking a point of the object and editing the parts that grow from it.

use std::sync::Arc;

use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use glam::{Quat, Vec3};
use neif::app::AppState;
use neif::geometry::{Mesh, SurfaceTracer};
use neif::neif::distant::{DistantConfig, DistantLight};
use neif::neif::hash_grid::{GridConfig, LEAST_WEIGHT};
use neif::neif::material::MaterialConfig;
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

/// A harness that shows the square, looked at from the side, with its middle picked.
fn picked() -> Harness<'static, Shown> {
    let mut state = AppState::default();
    let snapshot = snapshot();
    state.look_at_model(&snapshot);
    state.snapshot = Some(snapshot);
    let mut harness = harness(state);
    harness.state_mut().pictures.preview = Some(egui::TextureId::default());
    harness.run_steps(2);
    click(&mut harness, "Preview of the scene");
    harness
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
    harness.get_by_label("Surroundings as the point sees them");
    click(&mut harness, "Sharp surroundings");
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
    click(&mut harness, "Region 1 (part)");
    strength(&mut harness, 1.5);
    let tints = |harness: &Harness<'_, Shown>| {
        let look = &state(harness).look;
        let of_regions = look.regions.iter().map(|region| region.edit.tint_scale);
        (look.edit.tint_scale, of_regions.collect::<Vec<_>>())
    };
    assert_eq!(tints(&harness), (1.0, vec![1.5, 0.5]));
    click(&mut harness, "Whole object");
    strength(&mut harness, 0.8);
    assert_eq!(tints(&harness), (0.8, vec![1.5, 0.5]));
    click(&mut harness, "Reset material");
    assert_eq!(state(&harness).look.edit, MaterialEdit::default());
    click(&mut harness, "Delete region 1");
    assert_eq!(tints(&harness), (1.0, vec![0.5]));
}

#[test]
fn a_region_is_shown_while_the_pointer_is_over_it() {
    let mut harness = picked();
    click(&mut harness, "Edit like material");
    let place = harness.get_by_label("Region 1 (like material)").rect();
    harness.hover_at(place.center());
    harness.run_steps(2);
    assert!(state(&harness).highlight().is_some());
    harness.hover_at(egui::pos2(640.0, 400.0));
    harness.run_steps(2);
    assert!(state(&harness).highlight().is_none());
}
