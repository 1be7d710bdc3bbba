//! What lamps must do, under skies with a known one.

use std::f32::consts::PI;
use std::sync::Arc;

use glam::{Quat, Vec3};

use super::*;
use crate::geometry::meshes::test_mesh::ellipsoid;
use crate::neif::EnvironmentTransform;
use crate::neif::distant::{DistantConfig, DistantLight};
use crate::neif::light::shading::SurfacePoint;
use crate::render::irradiance::Probes;
use crate::render::test_scene::NEVER;

/// Radiance of the lamp, and the cosine of its half angle: a disc of 0.0195 steradians.
pub(super) const LAMP: f32 = 400.0;
pub(super) const RIM: f32 = 0.996_9;

/// A grey sky with a disc of a lamp about `toward`.
pub(super) fn sky(toward: Vec3) -> Environment {
    sky_of(toward, RIM)
}

/// The same with a lamp of any size: the cosine of its half angle.
fn sky_of(toward: Vec3, rim: f32) -> Environment {
    let width = 512;
    let config = DistantConfig {
        width,
        height: width / 2,
        world_from_picture: Quat::IDENTITY,
        has_floor: false,
    };
    let pixels: Vec<f32> = (0..width * width / 2)
        .flat_map(|i| {
            let azimuth = 2.0 * PI * (0.5 - (i % width) as f32 / width as f32 - 0.5 / width as f32);
            let elevation =
                PI * (0.5 - (i / width) as f32 / (width / 2) as f32 - 1.0 / width as f32);
            let (sin, cos) = elevation.sin_cos();
            let d = Vec3::new(cos * azimuth.cos(), cos * azimuth.sin(), sin);
            [if d.dot(toward) > rim { LAMP } else { 0.1 }; 3]
        })
        .collect();
    let light = DistantLight::new(config, &pixels).expect("a sane picture");
    Environment::of_distant("sky".to_owned(), Vec3::Z, light)
}

fn still() -> EnvironmentFromWorld {
    EnvironmentTransform::default().environment_from_world()
}

#[test]
fn a_lamp_as_small_as_a_look_keeps_its_light() {
    let toward = Vec3::new(1.0, 2.0, 2.0) / 3.0;
    let rim = 1.0 - 2.0 / N_LOOKS as f32;
    let lamps = Lamps::of(&sky_of(toward, rim), &NEVER).expect("not cancelled");
    let facing = lamps.points(&still()).irradiance(None, Vec3::ZERO, toward);
    let share = facing / (LAMP * 2.0 * PI * (1.0 - rim));
    assert!(
        share.min_element() > 0.6 && share.max_element() < 1.5,
        "{share}"
    );
}

#[test]
fn a_lamp_lights_what_faces_it_by_its_radiance_times_its_solid_angle() {
    let toward = Vec3::new(1.0, 2.0, 2.0) / 3.0;
    let lamps = Lamps::of(&sky(toward), &NEVER).expect("not cancelled");
    let points = lamps.points(&still());
    let expected = LAMP * 2.0 * PI * (1.0 - RIM);
    let facing = points.irradiance(None, Vec3::ZERO, toward);
    assert!(
        (facing / expected - 1.0).abs().max_element() < 0.1,
        "{facing}, not {expected}"
    );
    let slanted = (toward + 2.0 * toward.any_orthonormal_vector()).normalize_or_zero();
    let light = points.irradiance(None, Vec3::ZERO, slanted);
    let share = light / facing / slanted.dot(toward);
    assert!((share - 1.0).abs().max_element() < 0.02, "{share}");
    assert_eq!(
        points.irradiance(None, Vec3::ZERO, -toward),
        Vec3::ZERO,
        "behind"
    );
}

#[test]
fn an_environment_s_lamps_are_as_bright_as_they_were_estimated() {
    let sky = sky(Vec3::X);
    let learned = Lamps::of(&sky, &NEVER).expect("not cancelled");
    let parts = learned.parts();
    let gain = Vec3::new(4.0, 2.0, 0.5);
    let bright = learned.gained(&parts, &vec![gain; parts.len()]);
    let lit = sky.with_lamps(bright.estimated());
    let facing = |lamps: &Lamps| lamps.points(&still()).irradiance(None, Vec3::ZERO, Vec3::X);
    let again = Lamps::of(&lit, &NEVER).expect("not cancelled");
    let off = facing(&again) / facing(&learned) / gain - 1.0;
    assert!(off.abs().max_element() < 1e-3, "{off}");
    let anew = Lamps::learned(&lit, &NEVER).expect("not cancelled");
    assert_eq!(facing(&anew), facing(&learned), "to be estimated anew");
}

#[test]
fn cones_and_lamps_add_up_to_all_light() {
    let lamps = Lamps::of(&sky(Vec3::Z), &NEVER).expect("not cancelled");
    let seen = Vec3::new(LAMP, 0.5 * LAMP, 0.0);
    let left = lamps.below(seen);
    assert!(
        left.max_element() < 1.0 && (left.y / left.x - 0.5).abs() < 1e-6,
        "{left}"
    );
    assert_eq!(lamps.below(Vec3::splat(0.1)), Vec3::splat(0.1), "no lamp");
}

#[test]
fn an_object_shades_itself_and_a_turned_environment_turns_its_lamps() {
    let mesh = ellipsoid(Vec3::ZERO, Vec3::splat(0.5), 24);
    let tracer = SurfaceTracer::new(mesh.into());
    let lamps = Lamps::of(&sky(Vec3::X), &NEVER).expect("not cancelled");
    let turn = EnvironmentTransform {
        rotate_deg: Vec3::new(0.0, 0.0, 90.0),
        ..EnvironmentTransform::default()
    };
    let light = |motion: &EnvironmentFromWorld, at: Vec3, normal: Vec3| {
        lamps
            .points(motion)
            .irradiance(Some(&tracer), at, normal.normalize_or_zero())
            .x
    };
    let behind = Vec3::new(-1.0, 0.0, 0.0);
    let normal = Vec3::new(1.0, 1.0, 1.0);
    assert_eq!(light(&still(), behind, normal), 0.0, "in the shadow");
    assert!(
        light(&turn.environment_from_world(), behind, normal) > 1.0,
        "lit from +y now"
    );
}

/// A ball of two paints under a lamp that shines `gain` times as bright as it was learned.
fn shaded(probes: &Probes, toward: Vec3, gain: Vec3) -> Vec<LitPlace> {
    let place = |probe: &crate::render::irradiance::Probe| {
        let lamp = Vec3::splat(0.2 * probe.normal.dot(toward).max(0.0));
        let rest = Vec3::splat(0.3 + 0.1 * probe.normal.z);
        let paint = if probe.position.y > 0.1 { 0.7 } else { 0.2 };
        LitPlace {
            radiance: paint * (rest + gain * lamp),
            trust: 1.0,
            rest,
            lamps: vec![lamp],
        }
    };
    probes.probes().iter().map(place).collect()
}

#[test]
fn shading_shows_how_bright_a_lamp_is_whatever_is_painted_on_the_object() {
    let mesh = ellipsoid(Vec3::ZERO, Vec3::splat(0.5), 32);
    let probes = Probes::on_mesh(&mesh, 1000);
    for gain in [Vec3::ONE, Vec3::new(60.0, 50.0, 40.0), Vec3::splat(0.3)] {
        let lit = shaded(&probes, Vec3::new(0.6, 0.0, 0.8), gain);
        let found = lamp_gains(&probes, &lit, &[], 1)[0];
        let off = (found / gain - 1.0).abs().max_element();
        assert!(off < 0.1, "{found}, not {gain}");
    }
}

#[test]
fn what_has_no_diffuse_part_leaves_lamps_as_they_were_learned() {
    let mesh = ellipsoid(Vec3::ZERO, Vec3::splat(0.5), 16);
    let probes = Probes::on_mesh(&mesh, 200);
    let mut lit = shaded(&probes, Vec3::X, Vec3::splat(30.0));
    for place in &mut lit {
        place.radiance = Vec3::ZERO;
    }
    let found = lamp_gains(&probes, &lit, &[], 1)[0];
    assert!((found - 1.0).abs().max_element() < 0.05, "{found}");
    assert!(lamp_gains(&probes, &lit, &[], 0).is_empty(), "no lamp");
}

#[test]
fn what_shading_says_faintly_puts_no_lamp_out_and_lobes_outvote_it() {
    let mesh = ellipsoid(Vec3::ZERO, Vec3::splat(0.5), 32);
    let probes = Probes::on_mesh(&mesh, 1000);
    let shading = |trust: f32| {
        let mut lit = shaded(&probes, Vec3::new(0.6, 0.0, 0.8), Vec3::splat(0.3));
        for place in &mut lit {
            place.trust = trust;
        }
        lit
    };
    let faint = lamp_gains(&probes, &shading(0.1), &[], 1)[0];
    assert!(faint.min_element() > 0.9, "{faint}");
    let lobe = LitPlace {
        radiance: Vec3::splat(0.5),
        trust: 0.01,
        rest: Vec3::splat(0.2),
        lamps: vec![Vec3::splat(0.3)],
    };
    let outvoted = lamp_gains(&probes, &shading(1.0), &[&lobe; 100], 1)[0];
    assert!(outvoted.min_element() > 0.9, "{outvoted}");
}

#[test]
fn lobes_show_how_bright_a_lamp_is_and_what_is_known_of_one_part_goes_for_the_next() {
    let mesh = ellipsoid(Vec3::ZERO, Vec3::splat(0.5), 16);
    let probes = Probes::on_mesh(&mesh, 20);
    let black = LitPlace {
        radiance: Vec3::ZERO,
        trust: 1.0,
        rest: Vec3::ONE,
        lamps: vec![Vec3::ZERO; 2],
    };
    let black = vec![black; probes.probes().len()];
    let gain = Vec3::new(30.0, 25.0, 20.0);
    let lobe = |i: usize| {
        let (rest, lamp) = (Vec3::splat(0.2), Vec3::splat(0.01 * (i + 1) as f32));
        LitPlace {
            radiance: rest + gain * lamp,
            trust: 1.0,
            rest,
            lamps: vec![lamp, Vec3::ZERO],
        }
    };
    let lobes: Vec<LitPlace> = (0..20).map(lobe).collect();
    let lobes: Vec<&LitPlace> = lobes.iter().collect();
    let found = lamp_gains(&probes, &black, &lobes, 2);
    let off = (found[0] / gain - 1.0).abs().max_element();
    assert!(off < 0.15, "{}, not {gain}", found[0]);
    assert!(
        (found[1] / gain - 1.0).abs().max_element() < 0.3,
        "{}",
        found[1]
    );
}

/// A place whose mirror image of the eye is straight up.
fn facing_up(position: Vec3) -> SurfacePoint {
    SurfacePoint {
        position,
        normal: Vec3::Z,
        to_eye: Vec3::Z,
        ..SurfacePoint::default()
    }
}

#[test]
fn a_wide_lobe_gathers_lamps_from_their_points_and_a_mirror_from_its_cones() {
    let ball = ellipsoid(Vec3::ZERO, Vec3::splat(0.5), 24);
    let tracer = SurfaceTracer::new(ball.into());
    let lamps = Arc::new(Lamps::of(&sky(Vec3::Z), &NEVER).expect("not cancelled"));
    assert!(Highlights::new(&lamps, &still()).is_none(), "as learned");
    let parts = lamps.parts();
    let lamps = Arc::new(lamps.gained(&parts, &vec![Vec3::splat(4.0); parts.len()]));
    let highlights = Highlights::new(&lamps, &still()).expect("a lamp");
    let (seen, dim) = ([LAMP; 3], [0.3, 0.2, 0.1]);
    for roughness in [0.3, 0.6] {
        let free = facing_up(Vec3::new(0.0, 0.0, 0.6));
        let mut cones = [seen, dim];
        let found = highlights.take(&tracer, (&free, roughness), &mut cones);
        // At the middle of the lobe GGX's directions have a density of 1 / (4 pi alpha^2).
        let expected = 4.0 * LAMP * 2.0 * PI * (1.0 - RIM) / (4.0 * PI * roughness.powi(4));
        assert!(
            found.max_element() > 0.6 * expected && found.max_element() < 1.05 * expected,
            "{found}, {expected}"
        );
        assert!(cones[0].iter().all(|v| *v <= 1.0), "{cones:?}");
        assert_eq!(cones[1], dim, "no lamp");
        let below = facing_up(Vec3::new(0.0, 0.0, -0.6));
        let hidden = highlights.take(&tracer, (&below, roughness), &mut [seen]);
        assert_eq!(hidden, Vec3::ZERO, "in the shadow");
    }
    let mut cones = [seen];
    let mirror = (&facing_up(Vec3::Z), 0.05);
    assert_eq!(highlights.take(&tracer, mirror, &mut cones), Vec3::ZERO);
    assert_eq!(cones, [seen]);
}
