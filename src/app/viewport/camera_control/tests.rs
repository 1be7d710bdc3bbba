//! Tests of `camera_control`.

use super::*;

fn viewpoint() -> Viewpoint {
    Viewpoint::look_at(Vec3::new(3.0, 0.0, 1.0), Vec3::ZERO, Vec3::Z)
}

fn orbit(view: &mut Viewpoint, yaw: f32, pitch: f32) {
    view.apply(CameraMove::Orbit { yaw, pitch }, Vec3::Z);
}

#[test]
fn orbiting_keeps_distance_and_target() {
    let mut view = viewpoint();
    let distance = view.distance();
    orbit(&mut view, 0.7, -0.3);
    assert!(
        (view.distance() - distance).abs() < 1e-4,
        "distance {}",
        view.distance()
    );
    let seen = view
        .camera
        .project(Vec3::ZERO)
        .expect("the pivot is in front");
    assert!(
        (seen - Vec2::new(200.0, 150.0)).length() < 0.05,
        "pivot at {seen}"
    );
    let right = Vec3::from(view.camera.world_from_camera.matrix3.x_axis);
    assert!(right.z.abs() < 1e-4, "the horizon tilted: {right}");
}

#[test]
fn orbiting_stops_at_the_poles() {
    for pitch in [-10.0, 10.0] {
        let mut view = viewpoint();
        orbit(&mut view, 0.0, pitch);
        let angle = view.camera.forward().angle_between(Vec3::Z);
        let off = angle.min(std::f32::consts::PI - angle);
        assert!((off - POLE_MARGIN).abs() < 1e-3, "{off} from the pole");
    }
}

#[test]
fn dragging_right_turns_the_scene_right() {
    let mut view = viewpoint();
    let p = Vec3::new(1.0, 0.0, 0.0);
    let before = view.camera.project(p).expect("in front");
    orbit(&mut view, 0.1, 0.0);
    let after = view.camera.project(p).expect("in front");
    assert!(after.x > before.x, "{before} to {after}");
}

#[test]
fn dragging_down_shows_more_of_the_top() {
    let mut view = viewpoint();
    orbit(&mut view, 0.0, 0.1);
    assert!(view.camera.position().z > 1.0, "{}", view.camera.position());
}

#[test]
fn looking_around_keeps_the_place_and_flying_the_direction() {
    let mut view = viewpoint();
    let (eye, distance) = (view.camera.position(), view.distance());
    let (yaw, pitch) = (0.3, 0.1);
    view.apply(CameraMove::Look { yaw, pitch }, Vec3::Z);
    assert!((view.camera.position() - eye).length() < 1e-5);
    assert!((view.distance() - distance).abs() < 1e-4);
    let origin = view.camera.project(Vec3::ZERO).expect("in front");
    assert!(
        origin.x < 200.0 && origin.y < 150.0,
        "right and down: {origin}"
    );
    let forward = view.camera.forward();
    view.apply(CameraMove::Fly(Vec3::new(0.5, 0.25, 1.0)), Vec3::Z);
    assert!((view.camera.forward() - forward).length() < 1e-5);
    let way = (view.camera.position() - eye) / distance;
    let right = Vec3::from(view.camera.world_from_camera.matrix3.x_axis);
    let expected = 0.5 * right + 0.25 * Vec3::Z + forward;
    assert!((way - expected).length() < 1e-4, "{way}, not {expected}");
}

#[test]
fn views_along_the_axes_are_level_and_show_their_side() {
    for up in [Vec3::Z, Vec3::Y, Vec3::NEG_Y, Vec3::X] {
        let right = right_side(up);
        for (from, is_right, is_up) in [
            (front(up), right, up),
            (right, -front(up), up),
            (up, right, -front(up)),
        ] {
            let mut view = viewpoint();
            let distance = view.distance();
            view.apply(CameraMove::From(from), up);
            let eye = view.camera.position();
            assert!((eye - distance * from).length() < 1e-4, "{up} {from}");
            let axes = view.camera.world_from_camera.matrix3;
            assert!(axes.x_axis.dot(is_right.into()) > 0.999, "{up} {from}");
            assert!(axes.y_axis.dot(is_up.into()) > 0.999, "{up} {from}");
        }
    }
}

#[test]
fn a_lens_has_the_field_of_view_asked_for_and_keeps_its_shape() {
    let mut view = viewpoint();
    view.camera.fx *= 1.1;
    for (asked, given) in [(0.5, 0.5), (9.0, LENS_RANGE[1]), (0.0, LENS_RANGE[0])] {
        view.apply(CameraMove::Lens(asked), Vec3::Z);
        assert!((view.field_of_view() - given).abs() < 1e-4);
        assert!((view.camera.fx / view.camera.fy - 1.1).abs() < 1e-3);
    }
}

#[test]
fn panning_by_a_picture_height_moves_the_picture_by_that() {
    let mut view = viewpoint();
    let (right, up) = (0.0, 1.0);
    view.apply(CameraMove::Pan { right, up }, Vec3::Z);
    let seen = view.camera.project(Vec3::ZERO).expect("in front");
    assert!((seen - Vec2::new(200.0, 450.0)).length() < 0.1, "{seen}");
}

#[test]
fn dolly_scales_the_distance_within_bounds() {
    let mut view = viewpoint();
    let distance = view.distance();
    view.apply(CameraMove::Dolly(0.5), Vec3::Z);
    assert!((view.distance() - 0.5 * distance).abs() < 1e-4);
    for factor in [0.0, f32::NAN, f32::INFINITY, 1e-9].repeat(40) {
        view.apply(CameraMove::Dolly(factor), Vec3::Z);
    }
    assert!(
        view.distance() > 5e-5 && view.camera.position().is_finite(),
        "{view:?}"
    );
}

#[test]
fn a_window_shows_the_whole_photo_in_its_area() {
    let mut camera = Camera::look_at(Vec3::X, Vec3::ZERO, Vec3::Z, 1.0, 300, 200);
    camera.cx = 140.0;
    let view = Viewpoint::of_camera(&camera, Vec3::ZERO);
    let (window, area) = (view.camera_for(900, 800), view.photo_area(900, 800));
    assert_eq!(
        (area.min, area.size),
        (Vec2::new(0.0, 100.0), Vec2::new(900.0, 600.0))
    );
    let p = Vec3::new(0.1, 0.2, -0.1);
    let in_photo = camera.project(p).expect("seen");
    let in_window = window.project(p).expect("seen");
    assert!(
        (area.min + in_photo * 3.0 - in_window).length() < 1e-2,
        "{in_photo} {in_window}"
    );
}

#[test]
fn framing_shows_all_corners() {
    let mut view = viewpoint();
    let bounds = Aabb {
        min: Vec3::splat(4.0),
        max: Vec3::new(6.0, 5.0, 5.0),
    };
    view.frame(&bounds);
    for corner in bounds.corners() {
        let p = view.camera.project(corner).expect("in front");
        assert!(
            (0.0..400.0).contains(&p.x) && (0.0..300.0).contains(&p.y),
            "{corner} at {p}"
        );
    }
}

#[test]
fn cameras_around_a_point_look_at_it() {
    let target = Vec3::new(1.0, 2.0, 3.0);
    let eyes = [
        Vec3::new(4.0, 2.0, 3.5),
        Vec3::new(1.0, 6.0, 3.0),
        Vec3::new(0.0, 0.0, 6.0),
    ];
    let cameras = eyes.map(|eye| Camera::look_at(eye, target, Vec3::Y, 1.0, 10, 10));
    let found = point_looked_at(&cameras).expect("not parallel");
    assert!((found - target).length() < 1e-3, "{found}");
    assert_eq!(
        point_looked_at(&cameras[..1]),
        None,
        "one axis has no single nearest point"
    );
    assert_eq!(up_axis(&cameras), Vec3::Y);
}
