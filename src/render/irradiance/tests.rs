//! What the diffuse light must do, on small scenes with known answers.

use std::f32::consts::{E, PI};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::light::{Gathered, TrainedLight, TrainedWork};
use super::*;
use crate::color::linear_from_srgb;
use crate::geometry::Mesh;
use crate::geometry::meshes::test_mesh::{ellipsoid, together};
use crate::neif::{Environment, EnvironmentTransform, ObjectModel, RoughnessEdit};
use crate::render::lamps::{Compared, Lamps, WideCones};
use crate::render::test_scene::{NEVER, camera, environment, fog, object_of, picture, scene};
use crate::render::{Layer, LobeShape, Picture, ReferenceOptions, Scene, render_reference};

fn ball() -> Arc<ObjectModel> {
    object_of(ellipsoid(Vec3::ZERO, Vec3::splat(0.5), 32), 3)
}

fn turned(degrees: f32) -> EnvironmentTransform {
    EnvironmentTransform {
        rotate_deg: Vec3::new(0.0, 0.0, degrees),
        ..EnvironmentTransform::default()
    }
}

/// An object trained in one environment and shown in another.
fn moved(
    object: Arc<ObjectModel>,
    trained_in: &Arc<Environment>,
    environment: &Arc<Environment>,
    transform: EnvironmentTransform,
) -> Scene {
    let scene = Scene {
        environment: Arc::clone(environment),
        transform,
        ..Scene::new(Some(object), Arc::clone(trained_in))
    };
    scene.lit(&NEVER).expect("not cancelled")
}

fn response(scene: &Scene, position: Vec3, normal: Vec3) -> Vec3 {
    let gain = scene.transform.environment_from_world().gain;
    scene.diffuse_response((position, normal), gain, true)
}

fn light_of(object: Arc<ObjectModel>, environment: &Arc<Environment>) -> Arc<TrainedLight> {
    let scene = Scene::new(Some(object), Arc::clone(environment));
    trained_light(&scene, &NEVER).expect("an object")
}

/// Unit normals all around.
fn normals() -> Vec<Vec3> {
    crate::geometry::fibonacci_sphere(50)
}

#[test]
fn in_a_white_furnace_the_irradiance_is_pi_times_the_radiance_and_turning_changes_nothing() {
    let (ball, furnace) = (ball(), fog(-1.0, 0.0));
    let trained = light_of(Arc::clone(&ball), &furnace);
    let turned = moved(Arc::clone(&ball), &furnace, &furnace, turned(77.0));
    for n in normals() {
        let expected = PI / E;
        let light = trained.surface.irradiance(0.5 * n, n);
        let off = (light / expected - Vec3::ONE).abs().max_element();
        assert!(off < 0.02, "{light} at {n}, not {expected}");
        let ratio = response(&turned, 0.5 * n, n);
        assert!(
            (ratio - Vec3::ONE).abs().max_element() < 0.01,
            "{ratio} at {n}"
        );
        let albedo = trained.surface.albedo(0.5 * n, n, Vec3::splat(0.5 / E));
        assert!((albedo - 0.5).abs().max_element() < 0.01, "{albedo} at {n}");
    }
}

#[test]
fn a_half_lit_room_turned_about_swaps_the_bright_and_the_dark_side() {
    let (ball, room) = (ball(), fog(-2.0, 3.0));
    let trained = light_of(Arc::clone(&ball), &room);
    let turned = moved(ball, &room, &room, turned(180.0));
    let light = |n: Vec3| trained.surface.irradiance(0.5 * n, n);
    assert!(
        light(Vec3::X).y > 4.0 * light(Vec3::NEG_X).y,
        "the room is half lit"
    );
    for n in normals() {
        let opposite = Vec3::new(-n.x, -n.y, n.z);
        let now = light(n) * response(&turned, 0.5 * n, n);
        let off = (now - light(opposite)).abs() / light(Vec3::X);
        // The floor of the ratio holds the dark side back by a few percent.
        assert!(
            off.max_element() < 0.08,
            "{now} at {n}, not {}",
            light(opposite)
        );
    }
}

#[test]
fn the_light_at_the_surface_is_the_mean_of_narrow_rays_where_wide_cones_see_less() {
    // What a wide cone sees of this is the exponential of a mean.
    let slope = 16.0;
    let trained = light_of(ball(), &fog(-slope, slope));
    let found = trained.surface.irradiance(0.5 * Vec3::X, Vec3::X).y;
    // The integral of e^(slope (x - 1)) x over the directions with positive x.
    let expected = 2.0 * PI * (1.0 / slope - (1.0 - (-slope).exp()) / (slope * slope));
    assert!(
        (found / expected - 1.0).abs() < 0.03,
        "{found}, not {expected}"
    );
}

/// A square of side 1 at height `z`, looking up or down, of small triangles.
fn square(z: f32, up: f32) -> Mesh {
    let n = 8;
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for i in 0..=n {
        for j in 0..=n {
            positions.push(Vec3::new(
                i as f32 / n as f32 - 0.5,
                j as f32 / n as f32 - 0.5,
                z,
            ));
            if i < n && j < n {
                let corner = i * (n + 1) + j;
                triangles.push([corner, corner + n + 1, corner + n + 2]);
                triangles.push([corner, corner + n + 2, corner + 1]);
            }
        }
    }
    let normals = vec![Vec3::Z * up; positions.len()];
    Mesh::new(positions, Some(normals), triangles).unwrap()
}

#[test]
fn a_point_under_a_roof_receives_less_and_its_share_of_what_the_roof_sends() {
    let room = fog(0.0, 0.0);
    let open = light_of(object_of(square(0.0, 1.0), 5), &room);
    let roofed = light_of(
        object_of(together(&square(0.0, 1.0), &square(0.2, -1.0)), 5),
        &room,
    );
    let [open, roofed] =
        [open, roofed].map(|light| light.surface.irradiance(Vec3::ZERO, Vec3::Z).y);
    assert!((open / PI - 1.0).abs() < 0.02, "{open}");
    // The roof covers 0.82 of the hemisphere by cosine, and sends on some of the light.
    assert!(
        roofed < 0.6 * open && roofed > 0.15 * open,
        "{roofed} of {open}"
    );
}

#[test]
fn exposure_and_white_balance_scale_the_diffuse_part_exactly() {
    let gain = Vec3::new(8.0, 4.0, 2.0);
    let exposed = |transform| EnvironmentTransform {
        exposure_ev: 2.0,
        white_balance: Vec3::new(2.0, 1.0, 0.5),
        ..transform
    };
    let (ball, room) = (ball(), environment(4));
    let still = EnvironmentTransform::default();
    for transform in [still, turned(30.0)] {
        let plain = moved(Arc::clone(&ball), &room, &room, transform);
        let bright = moved(Arc::clone(&ball), &room, &room, exposed(transform));
        for n in normals() {
            let [plain, bright] = [&plain, &bright].map(|scene| response(scene, 0.5 * n, n));
            assert_eq!(bright, gain * plain);
        }
    }
}

#[test]
fn an_unmoved_environment_changes_nothing_even_when_read_again() {
    let room = environment(4);
    let again = Arc::new(Environment::clone(&room));
    let still = EnvironmentTransform::default();
    let same = moved(ball(), &room, &room, still);
    assert!(same.diffuse_light.is_none(), "nothing to compute");
    let read_again = moved(ball(), &room, &again, still);
    assert!(read_again.diffuse_light.is_some(), "it may be another");
    for n in normals() {
        assert_eq!(response(&same, 0.5 * n, n), Vec3::ONE);
        assert_eq!(response(&read_again, 0.5 * n, n), Vec3::ONE);
    }
}

#[test]
fn black_and_blinding_environments_give_finite_ratios_in_range() {
    let (black, bright) = (fog(-12.0, 0.0), fog(11.5, 0.0));
    let still = EnvironmentTransform::default();
    for (from, to, least, most) in [
        (&black, &bright, 4096.0, 4096.0),
        (&bright, &black, 0.0, 1e-4),
        (&black, &black, 1.0, 1.0),
    ] {
        let scene = moved(ball(), from, &Arc::new(Environment::clone(to)), still);
        let odd = [Vec3::NAN, Vec3::INFINITY, Vec3::splat(1e30)];
        for position in odd.into_iter().chain(normals()) {
            let ratio = response(&scene, 0.5 * position, position);
            assert!(
                ratio.min_element() >= least && ratio.max_element() <= most,
                "{ratio} at {position}"
            );
        }
    }
}

#[test]
fn without_the_switch_the_diffuse_part_stays_as_it_was_learned() {
    let baked = Scene {
        trained_in: None,
        transform: EnvironmentTransform {
            exposure_ev: 3.0,
            ..turned(50.0)
        },
        ..scene()
    };
    let baked = baked.lit(&NEVER).expect("not cancelled");
    assert!(baked.diffuse_light.is_none(), "nothing to compute");
    assert_eq!(response(&baked, Vec3::X, Vec3::X), Vec3::ONE);
}

#[test]
fn what_was_interrupted_goes_on_to_the_same_light() {
    let scene = Scene {
        transform: turned(40.0),
        ..scene()
    };
    let mut lights = DiffuseLights::default();
    assert!(
        lights
            .fine(&scene, &[Layer::Final], &AtomicBool::new(true))
            .is_none(),
        "cancelled"
    );
    let fine = lights
        .fine(&scene, &[Layer::Final], &NEVER)
        .expect("not cancelled");
    let whole = scene.lit(&NEVER).expect("not cancelled");
    let quick = lights.quick(&scene, Layer::Final);
    for n in normals() {
        assert_eq!(response(&fine, n, n), response(&whole, n, n));
        assert_eq!(
            response(&quick, n, n),
            response(&whole, n, n),
            "the fine one is known"
        );
    }
}

#[test]
fn what_is_prepared_serves_every_change() {
    let place = environment(5);
    let scene = Scene {
        transform: turned(70.0),
        ..Scene::new(Some(ball()), Arc::clone(&place))
    };
    let mut prepared = DiffuseLights::default();
    prepared.prepare(&scene, &AtomicBool::new(true));
    prepared.prepare(&scene, &NEVER);
    let trained = |lights: &mut DiffuseLights, degrees: f32| {
        let transform = turned(degrees);
        let scene = lights.quick(
            &Scene {
                transform,
                ..scene.clone()
            },
            Layer::Final,
        );
        let light = scene.diffuse_light.expect("moved").light;
        (
            Arc::clone(&light.trained),
            light.surface.irradiance(0.5 * Vec3::X, Vec3::X),
        )
    };
    let (first, light) = trained(&mut prepared, 70.0);
    assert!(Arc::ptr_eq(&first, &trained(&mut prepared, 20.0).0));
    assert_eq!(light, trained(&mut DiffuseLights::default(), 70.0).1);
}

#[test]
fn the_coarse_light_is_near_the_fine_one() {
    let room = fog(-1.0, 2.0);
    let scene = Scene {
        transform: turned(90.0),
        ..Scene::new(Some(ball()), room)
    };
    let quick = DiffuseLights::default().quick(&scene, Layer::Final);
    let fine = scene.lit(&NEVER).expect("not cancelled");
    for n in normals() {
        let [quick, fine] = [&quick, &fine].map(|scene| response(scene, 0.5 * n, n));
        let off = ((quick - fine) / fine).abs().max_element();
        assert!(off < 0.15, "{quick}, not {fine} at {n}");
    }
}

#[test]
fn an_edit_of_roughness_asks_for_lamps_and_leaves_the_diffuse_part_alone() {
    let mut scene = Scene::new(Some(ball()), fog(0.3, 0.0));
    let lit = |scene: &Scene| scene.lit(&NEVER).expect("not cancelled");
    assert!(lit(&scene).diffuse_light.is_none(), "as it was trained");
    scene.edit.roughness = RoughnessEdit::Constant(0.4);
    let lit = lit(&scene);
    assert!(lit.diffuse_light.is_some() && lit.ground.is_none());
    for normal in normals() {
        assert_eq!(response(&lit, 0.5 * normal, normal), Vec3::ONE);
    }
}

/// A smooth ball without a diffuse part, made rough, and how much brighter its one cones are than several.
fn made_rough(brighter: Vec3) -> Scene {
    let furnace = fog(-1.0, 0.0);
    let mut scene = Scene::new(Some(ball()), Arc::clone(&furnace));
    scene.edit.roughness = RoughnessEdit::Constant(1.0);
    scene.edit.diffuse_gain = Vec3::ZERO;
    let object = scene.object.clone().expect("the ball");
    let lobe = |k: i32| Compared {
        roughness: k as f32 / 1000.0,
        trust: 1000.0,
        brighter: brighter.map(f32::ln),
    };
    let lobes: Vec<Compared> = (0..1000).map(lobe).collect();
    let mut lamps = Lamps::of(&furnace, &NEVER).expect("not cancelled");
    lamps.wide = WideCones::of(&lobes);
    let lamps = Arc::new(lamps);
    let key = LightKey::of(&scene, false).expect("a new roughness asks for light");
    let transport = Transport::trace(&object.tracer, Resolution::FINE, &NEVER);
    let transport = Arc::new(transport.expect("not cancelled"));
    let trained = TrainedWork::new(transport, &object.material)
        .run(&key, Some(Arc::clone(&lamps)), &NEVER)
        .expect("not cancelled");
    let light = DiffuseLight::gather(
        &Arc::new(trained),
        (&key, &lamps),
        &mut Gathered::default(),
        &NEVER,
    );
    scene.diffuse_light = Some(KeyedLight {
        key,
        resolution: Resolution::FINE,
        light: Arc::new(light.expect("not cancelled")),
    });
    scene
}

#[test]
fn what_wide_cones_show_goes_for_several_and_for_the_reference() {
    let factor = Vec3::new(1.4, 1.0, 0.7);
    let [plain, brighter] = [Vec3::ONE, factor].map(made_rough);
    let total = |picture: &Picture| {
        let linear = picture
            .pixels
            .iter()
            .map(|p| Vec3::from(p.map(linear_from_srgb)));
        linear.sum::<Vec3>()
    };
    let cones = |scene: &Scene| total(&picture(scene, &camera(24, 16), Layer::Specular));
    let by_reference = |scene: &Scene| {
        let options = ReferenceOptions {
            n_paths: 64,
            lobe: LobeShape::Ggx,
        };
        let seen = render_reference(scene, &camera(24, 16), options, &NEVER, &|_| {});
        total(&seen.expect("not cancelled"))
    };
    // The reference's picture has the fog around the ball too.
    let found = [
        cones(&brighter) / cones(&plain),
        (by_reference(&brighter) - by_reference(&plain)) / cones(&plain) + Vec3::ONE,
    ];
    for found in found {
        let off = (found - factor).abs().max_element();
        assert!(off < 0.02, "{found} instead of {factor}");
    }
}
