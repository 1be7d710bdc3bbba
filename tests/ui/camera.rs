//! Flying, views along the axes, the lens and the way up.

use egui::{Event, Key, Modifiers, PointerButton, Role};
use egui_kittest::kittest::Queryable as _;
use glam::Vec3;
use neif::app::state::watch::Comparison;

use super::{click, with_picture};

#[test]
fn letters_fly_while_the_right_button_is_held_and_are_shortcuts_otherwise() {
    let (mut harness, center) = with_picture();
    let before = harness.state().state.view.viewpoint;
    let button = |pressed| Event::PointerButton {
        pos: center,
        button: PointerButton::Secondary,
        pressed,
        modifiers: Modifiers::NONE,
    };
    harness.hover_at(center);
    harness.run_steps(2);
    harness.event(button(true));
    harness.run_steps(1);
    harness.key_down(Key::W);
    harness.run_steps(5);
    harness.key_up(Key::W);
    harness.run_steps(1);
    let flown = harness.state().state.view.viewpoint;
    let way = flown.camera.position() - before.camera.position();
    assert!(way.dot(before.camera.forward()) > 0.99 * way.length() && way.length() > 0.0);
    assert_eq!(harness.state().state.compare.wipe, None, "W does not wipe");
    harness.hover_at(center + egui::vec2(60.0, 0.0));
    harness.run_steps(2);
    let turned = harness.state().state.view.viewpoint;
    assert_eq!(turned.camera.position(), flown.camera.position());
    let right = Vec3::from(flown.camera.world_from_camera.matrix3.x_axis);
    assert!(turned.camera.forward().dot(right) > 0.05, "looks right");
    harness.event(button(false));
    harness.run_steps(2);
    harness.key_press(Key::OpenBracket);
    harness.run_steps(2);
    harness.key_press(Key::W);
    harness.run_steps(2);
    assert!(
        harness.state().state.compare.wipe.is_some(),
        "W wipes again"
    );
    assert_eq!(harness.state().state.compare.with_photo, Comparison::Off);
}

#[test]
fn the_view_from_above_is_undone_and_follows_the_way_up() {
    let (mut harness, _) = with_picture();
    let before = harness.state().state.view;
    let towards = |harness: &egui_kittest::Harness<'_, super::Shown>| {
        let camera = harness.state().state.view.viewpoint.camera;
        -camera.forward()
    };
    harness.key_press_modifiers(Modifiers::COMMAND, Key::Num7);
    harness.run_steps(2);
    assert!(towards(&harness).dot(before.up) > 0.999);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    harness.run_steps(2);
    assert_eq!(harness.state().state.view.viewpoint, before.viewpoint);
    let up = if before.up == Vec3::X {
        Vec3::Y
    } else {
        Vec3::X
    };
    harness.get_by_label("+x").scroll_to_me();
    harness.run_steps(3);
    click(&mut harness, if up == Vec3::X { "+x" } else { "+y" });
    harness.key_press_modifiers(Modifiers::COMMAND, Key::Num7);
    harness.run_steps(2);
    assert!(towards(&harness).dot(up) > 0.999, "{}", towards(&harness));
}

#[test]
fn the_field_of_view_widens_what_is_seen() {
    let (mut harness, _) = with_picture();
    let before = harness.state().state.view.viewpoint;
    harness
        .get_by_role_and_label(Role::Slider, "Field of view")
        .set_value_accesskit(90.0);
    harness.run_steps(2);
    let after = harness.state().state.view.viewpoint;
    assert!((after.field_of_view().to_degrees() - 90.0).abs() < 0.1);
    assert_eq!(after.camera.position(), before.camera.position());
}
