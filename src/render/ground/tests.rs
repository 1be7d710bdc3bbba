//! What is done to floors and walls, in an environment of one brightness.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::{Quat, Vec2, Vec3, Vec4};

use super::map::Map;
use super::stand::Stand;
use super::*;
use crate::geometry::meshes::test_mesh::ellipsoid;
use crate::neif::distant::{DistantConfig, DistantLight};
use crate::neif::field::radiance_field::FieldRay;
use crate::neif::light::environment::LightScratch;
use crate::neif::{Environment, EnvironmentTransform, ObjectModel, SurfaceField};
use crate::render::Scene;
use crate::render::irradiance::Probes;
use crate::render::lamps::Lamps;
use crate::render::test_scene::{NEVER, fog_above, fog_where, object_of};

const RESOLUTION: GroundResolution = GroundResolution {
    side: 32,
    n_looks: 32,
    n_directions: 96,
    most_samples: usize::MAX,
};
/// Height of the floor, world units.
const FLOOR: f32 = -0.5;

/// A ball that sends next to no light.
fn ball() -> Arc<ObjectModel> {
    ball_of(Vec3::splat(-8.0))
}

/// A ball whose tint is the sigmoid of these numbers, without a diffuse part.
fn ball_of(tint: Vec3) -> Arc<ObjectModel> {
    let object = object_of(ellipsoid(Vec3::ZERO, Vec3::splat(0.5), 32), 3);
    let SurfaceField::Grid(material) = &*object.material else {
        unreachable!("it is a grid");
    };
    let mut material = material.clone();
    // The biases of the 16 outputs come last: diffuse, then tint.
    let end = material.n_network_params();
    let biases = &mut material.params[end - 16..end];
    biases[..3].fill(-8.0);
    biases[3..6].copy_from_slice(&tint.to_array());
    Arc::new(ObjectModel {
        tracer: Arc::clone(&object.tracer),
        material: Arc::new(SurfaceField::Grid(material)),
    })
}

fn room() -> Arc<Environment> {
    fog_above(FLOOR)
}

fn lamps_of(room: &Environment) -> Lamps {
    Lamps::of(room, &NEVER).expect("not cancelled")
}

fn probes(object: &ObjectModel) -> Probes {
    Probes::on_mesh(object.tracer.mesh(), 128)
}

fn captured_in(
    room: &Environment,
    object: &ObjectModel,
    cancel: &AtomicBool,
) -> Result<Captured, Cancelled> {
    let own = (room, &lamps_of(room));
    Captured::new(object, own, &probes(object), RESOLUTION, cancel)
}

fn captured(object: &ObjectModel) -> Captured {
    captured_in(&room(), object, &NEVER).expect("not cancelled")
}

/// The shadow in a room at `transform` of an object that was captured in it.
fn shadow_in(
    room: &Environment,
    object: &ObjectModel,
    transform: &EnvironmentTransform,
    captured: &Captured,
    baked: Option<&BakedGround>,
) -> Option<Shadow> {
    let (lamps, probes) = (lamps_of(room), probes(object));
    let known = (&probes, captured);
    let shadow = Shadow::new(
        object,
        (room, &lamps),
        transform,
        known,
        baked,
        RESOLUTION,
        &NEVER,
    );
    shadow.expect("not cancelled")
}

/// Radiance of the room from a world point towards another, after `ground`.
fn look(ground: Option<&Ground>, from: Vec3, to: Vec3) -> Vec3 {
    look_in(&room(), ground, from, to)
}

fn look_in(room: &Environment, ground: Option<&Ground>, from: Vec3, to: Vec3) -> Vec3 {
    let direction = (to - from).normalize_or_zero();
    let mut batch = FieldBatch::default();
    let origin = room.frame().field_from_world(from).to_array();
    batch
        .rays
        .push(FieldRay::of_pixel(origin, direction.to_array(), 0.0, 0.0));
    room.light(&mut batch, &mut LightScratch::default());
    if let Some(ground) = ground {
        ground.apply(&mut batch);
    }
    Vec3::from(batch.radiance[0])
}

#[test]
fn a_shadow_is_taken_away_and_put_where_the_object_went() {
    let still = EnvironmentTransform::default();
    let captured = captured(&ball());
    let baked = captured.ground.clone().expect("a floor");
    let shadow = |transform: &EnvironmentTransform| {
        shadow_in(&room(), &ball(), transform, &captured, Some(&baked)).expect("a floor")
    };
    let empty = Ground {
        baked: Some(Arc::clone(&baked)),
        shadow: None,
    };
    let as_it_was = Ground {
        shadow: Some(shadow(&still)),
        ..empty.clone()
    };
    let aside = EnvironmentTransform {
        translate: Vec3::new(-0.8, 0.0, 0.0),
        ..still
    };
    let moved = Ground {
        shadow: Some(shadow(&aside)),
        ..empty.clone()
    };
    let eye = Vec3::new(0.1, -1.6, 0.6);
    let beside = Vec3::new(0.0, -0.45, FLOOR);
    let seen = look(None, eye, beside);
    assert!(
        look(Some(&empty), eye, beside).cmpgt(seen * 1.3).all(),
        "a shadow was taken away"
    );
    let back = look(Some(&as_it_was), eye, beside);
    assert!(
        (back / seen - 1.0).abs().max_element() < 0.02,
        "{back} for {seen}"
    );
    // An environment that went to -x has the object at +x.
    let new_place = beside + Vec3::new(0.8, 0.0, 0.0);
    let new_shadow = look(Some(&moved), eye, new_place);
    assert!(
        new_shadow
            .cmplt(0.8 * look(Some(&empty), eye, new_place))
            .all(),
        "{new_shadow}"
    );
    let old_place = look(Some(&moved), eye, beside);
    assert!(old_place.cmpgt(seen * 1.1).all(), "{old_place} for {seen}");
}

#[test]
fn a_red_mirror_keeps_less_red_from_its_floor_than_a_black_one() {
    let shade = |ball: &ObjectModel| {
        let still = EnvironmentTransform::default();
        let ground = Ground {
            baked: None,
            shadow: shadow_in(&room(), ball, &still, &captured(ball), None),
        };
        let eye = Vec3::new(0.1, -1.6, 0.6);
        let beside = Vec3::new(0.0, -0.45, FLOOR);
        look(Some(&ground), eye, beside) / look(None, eye, beside)
    };
    let (black, red) = (shade(&ball()), shade(&ball_of(Vec3::new(2.0, -8.0, -8.0))));
    assert!(black.max_element() < 0.8, "a shadow: {black}");
    assert!(red.x > black.x + 0.1, "{red} by a red one, {black}");
    assert!(
        (red.y - black.y).abs() < 0.02,
        "{red} by a red one, {black}"
    );
}

#[test]
fn a_panorama_s_floor_is_shaded() {
    let config = DistantConfig {
        width: 16,
        height: 8,
        world_from_picture: Quat::IDENTITY,
        has_floor: false,
    };
    let white = DistantLight::new(config, &[1.0; 16 * 8 * 3]).expect("a picture");
    let white = Environment::of_distant("white".to_owned(), Vec3::Z, white);
    let floor = white.on_floor(-FLOOR);
    let still = EnvironmentTransform::default();
    let shadow = shadow_in(&floor, &ball(), &still, &captured(&ball()), None);
    let ground = Ground {
        baked: None,
        shadow,
    };
    let eye = Vec3::new(0.1, -1.6, 0.6);
    let shade = |x: f32| {
        let at = Vec3::new(x, -0.45, FLOOR);
        look_in(&floor, Some(&ground), eye, at).max_element()
    };
    assert!(
        shade(0.0) < 0.8 && shade(4.0) > 0.95,
        "{} {}",
        shade(0.0),
        shade(4.0)
    );
}

#[test]
fn walls_slopes_and_curved_things_are_shaded_too() {
    let slope = Vec3::new(0.6, 0.0, 0.8);
    let pillar = Vec3::new(1.3, 0.0, 0.0);
    type Solid = Box<dyn Fn(Vec3) -> bool>;
    let things: [(&str, Solid, Vec3, Vec3); 3] = [
        (
            "a wall",
            Box::new(|x| x.x > 0.7),
            Vec3::new(0.7, 0.0, 0.0),
            Vec3::new(0.7, 1.3, 0.0),
        ),
        (
            "a slope",
            Box::new(move |x| x.dot(slope) < -0.6),
            -0.6 * slope,
            -0.6 * slope + Vec3::Y * 1.3,
        ),
        (
            "a pillar",
            Box::new(move |x| (x - pillar).truncate().length() < 0.6),
            Vec3::new(0.7, 0.0, 0.0),
            Vec3::new(0.7, 0.0, 1.2),
        ),
    ];
    for (what, is_solid, near, far) in things {
        let room = fog_where(is_solid);
        let captured = captured_in(&room, &ball(), &NEVER).expect("not cancelled");
        let still = EnvironmentTransform::default();
        let baked = captured.ground.clone().expect("something near");
        let put_on = Ground {
            baked: None,
            shadow: shadow_in(&room, &ball(), &still, &captured, Some(&baked)),
        };
        let as_it_was = Ground {
            baked: Some(baked),
            shadow: put_on.shadow.clone(),
        };
        // From where the ball is not in between.
        let share = |ground: &Ground, at: Vec3| {
            let eye = Vec3::new(0.0, -0.9, 0.7) - 0.3 * at.normalize_or_zero();
            look_in(&room, Some(ground), eye, at) / look_in(&room, None, eye, at)
        };
        let (dark, light) = (share(&put_on, near), share(&put_on, far));
        assert!(dark.max_element() < 0.75, "{what} beside the ball: {dark}");
        assert!(
            (light - dark).min_element() > 0.15 && light.max_element() < 1.01,
            "{what}: {light} farther off, {dark} beside the ball"
        );
        for at in [near, far] {
            let same = share(&as_it_was, at);
            assert!((same - 1.0).abs().max_element() < 0.02, "{what}: {same}");
        }
    }
}

#[test]
fn a_slope_is_what_an_object_stands_on() {
    let slope = Vec3::new(0.3, -0.2, 0.9).normalize_or_zero();
    let room = fog_where(move |x| x.dot(slope) < -0.5);
    let stand = Stand {
        object: &ball(),
        environment: &room,
        motion: EnvironmentTransform::default().environment_from_world(),
        lamps: &lamps_of(&room),
    };
    let mut surfaces = stand.surfaces(RESOLUTION);
    let plane = stand.plane_below(&mut surfaces).expect("a slope");
    assert!(plane.up.dot(slope) > 0.998, "{} for {slope}", plane.up);
    let center = room.frame().world_from_field(plane.center);
    assert!((center.dot(slope) + 0.5).abs() < 0.03, "{center}");
    let below = surfaces
        .near(plane.center)
        .expect("the ball hides nothing of it");
    assert!(below.1.normal.dot(slope) > 0.99, "{}", below.1.normal);
}

#[test]
fn walls_and_sky_and_what_lies_far_off_stay() {
    let empty = Ground {
        baked: Some(captured(&ball()).ground.expect("a floor")),
        shadow: None,
    };
    let eye = Vec3::new(0.1, -1.6, 0.6);
    for to in [
        Vec3::new(0.0, 0.0, 1.0),
        Vec3::new(0.0, 9.0, 0.6),
        Vec3::new(1.9, 1.9, FLOOR),
    ] {
        assert_eq!(look(Some(&empty), eye, to), look(None, eye, to), "{to}");
    }
}

#[test]
fn an_object_that_hovers_has_no_floor() {
    let high = object_of(ellipsoid(Vec3::new(0.0, 0.0, 1.0), Vec3::splat(0.2), 16), 3);
    assert!(captured(&high).ground.is_none());
    let cancelled = AtomicBool::new(true);
    assert!(captured_in(&room(), &ball(), &cancelled).is_err());
}

#[test]
fn a_scene_has_a_ground_where_its_environment_moved() {
    let scene = Scene::new(Some(ball()), room());
    assert!(scene.lit(&NEVER).expect("not cancelled").ground.is_none());
    let moved = Scene {
        transform: EnvironmentTransform {
            translate: Vec3::X,
            ..EnvironmentTransform::default()
        },
        ..scene.clone()
    };
    let ground = moved.lit(&NEVER).expect("not cancelled").ground;
    assert!(ground.is_some_and(|ground| ground.baked.is_some() && ground.shadow.is_some()));
    let empty = scene.emptied(&NEVER).expect("not cancelled");
    assert!(empty.object.is_none());
    assert!(empty.ground.is_some_and(|ground| ground.shadow.is_none()));
}

#[test]
fn what_is_not_known_comes_from_around_it() {
    let side = 16;
    let value = |i: usize| if i % side < 8 { 1.0 } else { 3.0 };
    let values: Vec<Vec4> = (0..side * side).map(|i| Vec4::splat(value(i))).collect();
    let mut known = vec![1.0; side * side];
    let hole = |i: usize| (4..12).contains(&(i / side)) && (6..10).contains(&(i % side));
    let mut wrong = values.clone();
    for i in (0..values.len()).filter(|i| hole(*i)) {
        (known[i], wrong[i]) = (0.0, Vec4::splat(99.0));
    }
    let map = Map::filled(side, &wrong, &known);
    for i in 0..side * side {
        let place = (Vec2::new((i % side) as f32, (i / side) as f32) + 0.5) / 8.0 - 1.0;
        let found = map.at(place, 0.0).x;
        if hole(i) {
            assert!((0.9..3.1).contains(&found), "{found} at {i}");
        } else {
            assert!((found - value(i)).abs() < 1e-5, "{found} at {i}");
        }
    }
    let mean = Map::new(side, values).at(Vec2::ZERO, 1e9).x;
    assert!((mean - 2.0).abs() < 1e-5, "{mean}");
}
