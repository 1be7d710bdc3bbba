//! Edits of parts, through everything that shows them.

use std::sync::Arc;

use glam::Vec3;

use super::preview::progressive::Progressive;
use super::preview::request::Quality;
use super::test_scene::{self, NEVER, camera, environment, object_of};
use super::{GBuffer, Layer, PathOptions, PreviewScene, Scene, bake};
use crate::geometry::meshes::test_mesh::{ellipsoid, together};
use crate::geometry::{Atlas, Camera};
use crate::neif::surface::material::MaterialBatch;
use crate::neif::{EditedSurfaces, Extent, Likeness, MaterialEdit, Region, Regions, RoughnessEdit};

const SIZE: (u32, u32) = (120, 80);
const SEED: Vec3 = Vec3::new(0.1, 0.65, 0.0);

/// Two balls, of which the second has the seed at its near side.
fn two_balls() -> Scene {
    let ball = |y: f32| ellipsoid(Vec3::new(-0.3, y, 0.0), Vec3::splat(0.4), 16);
    let object = object_of(together(&ball(-0.65), &ball(0.65)), 3);
    Scene::new(Some(object), environment(4))
}

fn view() -> Camera {
    camera(SIZE.0, SIZE.1)
}

fn rough(extent: Extent) -> Region {
    Region {
        seed: SEED,
        extent,
        edit: MaterialEdit {
            roughness: RoughnessEdit::Constant(0.9),
            tint_scale: 0.2,
            diffuse_gain: Vec3::new(2.0, 1.0, 0.5),
            ..MaterialEdit::default()
        },
    }
}

fn with(scene: &Scene, region: Region) -> Scene {
    let mut regions = Regions::default();
    assert!(regions.push(region), "room");
    Scene {
        regions,
        ..scene.clone()
    }
}

/// Of each pixel, by which balls its paths pass: bit 1 the first, bit 2 the second.
fn balls_seen(scene: &Scene) -> Vec<u32> {
    let tracer = &scene.object.as_ref().unwrap().tracer;
    let gbuffer = GBuffer::trace(Some(tracer), &view(), 0..SIZE.1, PathOptions::FINE);
    let pixels = 0..SIZE.0 * SIZE.1;
    pixels
        .map(|pixel| {
            let vertices = gbuffer.paths_at(pixel).flatten();
            vertices.fold(0, |seen, vertex| {
                seen | if vertex.point.position.y < 0.0 { 1 } else { 2 }
            })
        })
        .collect()
}

fn picture(scene: &Scene, layer: Layer) -> Vec<[f32; 3]> {
    test_scene::picture(scene, &view(), layer).pixels
}

#[test]
fn an_edit_of_a_part_leaves_the_pixels_of_others_as_they_were() {
    let scene = two_balls();
    let edited = with(&scene, rough(Extent::Part));
    let seen = balls_seen(&scene);
    assert!(seen.contains(&1) && seen.contains(&2), "both are in view");
    for layer in [Layer::Final, Layer::Roughness, Layer::Tint, Layer::Diffuse] {
        let (before, after) = (picture(&scene, layer), picture(&edited, layer));
        let changed = |of: u32| {
            let pixels = before.iter().zip(&after).zip(&seen);
            pixels.filter(|((a, b), s)| **s == of && a != b).count()
        };
        assert_eq!((changed(0), changed(1)), (0, 0), "{layer} of the others");
        assert!(changed(2) > 20, "{layer}: {} changed", changed(2));
    }
}

#[test]
fn without_regions_surfaces_are_those_of_the_whole_edit_bit_for_bit() {
    let scene = two_balls();
    let object = scene.object.as_ref().unwrap();
    let edit = rough(Extent::Part).edit;
    let mesh = Arc::clone(object.tracer.mesh());
    let points = mesh.positions.iter().copied().zip(mesh.normals.clone());
    let mut idle = Region {
        edit: MaterialEdit::default(),
        ..rough(Extent::Part)
    };
    idle.extent = Extent::Material(Likeness::default());
    for regions in [Regions::default(), with(&scene, idle).regions] {
        let mut found = EditedSurfaces::default();
        found.evaluate(object, &edit, &regions, points.clone());
        let mut batch = MaterialBatch::default();
        let material = &object.material;
        material.forward(&mesh.positions, &mut batch, &mut Vec::new());
        for (surface, learned) in found.surfaces().iter().zip(&batch.surfaces) {
            assert_eq!(*surface, edit.apply(material.perceptual(*learned)));
        }
        let gain = edit.specular_gain();
        assert!(found.specular_gain().iter().all(|g| *g == gain), "gain");
    }
}

#[test]
fn a_region_of_like_material_is_softer_than_a_part_and_may_keep_to_it() {
    let scene = two_balls();
    let object = scene.object.as_ref().unwrap();
    let mesh = object.tracer.mesh();
    let points = || mesh.positions.iter().copied().zip(mesh.normals.clone());
    let weights = |extent| {
        let mut weights = Vec::new();
        EditedSurfaces::default().weights(object, &rough(extent), points(), &mut weights);
        weights
    };
    // The random material varies little: a tight threshold cuts through it.
    let like = Likeness {
        threshold: 0.004,
        softness: 1.0,
        within_part: false,
    };
    let everywhere = weights(Extent::Material(like));
    let within = weights(Extent::Material(Likeness {
        within_part: true,
        ..like
    }));
    let part = weights(Extent::Part);
    for list in [&everywhere, &within, &part] {
        assert!(list.iter().all(|w| (0.0..=1.0).contains(w)), "in range");
    }
    assert!(
        part.iter().all(|w| *w == 0.0 || *w == 1.0),
        "parts are hard"
    );
    assert!(everywhere.iter().any(|w| *w > 0.0 && *w < 1.0), "soft");
    for ((all, within), part) in everywhere.iter().zip(&within).zip(&part) {
        assert_eq!(*within, all * part);
    }
}

#[test]
fn baked_textures_follow_a_region() {
    let scene = with(&two_balls(), rough(Extent::Part));
    let object = scene.object.as_ref().unwrap();
    let atlas = Atlas::new(object.tracer.mesh(), 128, 1).unwrap();
    let edits = (&scene.edit, &scene.regions);
    let baked = bake(object, edits, &atlas, 1, None);
    let texels = atlas.texels(object.tracer.mesh());
    assert!(texels.len() > 100, "{} texels", texels.len());
    for texel in texels {
        let is_rough = (baked.roughness[texel.index as usize] - 0.9).abs() < 1e-6;
        assert_eq!(is_rough, texel.position.y > 0.0, "{texel:?}");
    }
}

#[test]
fn a_highlight_covers_its_part_alone_and_costs_no_light() {
    let scene = two_balls();
    let mut request = PreviewScene {
        scene: scene.clone(),
        ..test_scene::request(SIZE.0, SIZE.1)
    };
    let mut progressive = Progressive::default();
    let mut pass = |request: &PreviewScene| {
        let output = progressive.pass(request, Quality::Settled, &NEVER);
        output.expect("not cancelled")
    };
    let before = pass(&request);
    request.highlight = Some(rough(Extent::Part));
    let after = pass(&request);
    assert_eq!(after.recomputed.object, 0, "the object's light is kept");
    let first = |pixel: usize| {
        let tracer = &scene.object.as_ref().unwrap().tracer;
        let (x, y) = (pixel as u32 % SIZE.0, pixel as u32 / SIZE.0);
        let ray = view().ray(x as f32 + 0.5, y as f32 + 0.5);
        tracer.intersect(&ray, 0.0, f32::INFINITY)
    };
    for (i, (a, b)) in before.pixels.iter().zip(&after.pixels).enumerate() {
        if first(i).is_some_and(|hit| hit.position.y > 0.1) {
            assert_ne!(a, b, "pixel {i} is highlighted");
        } else if first(i).is_some_and(|hit| hit.position.y < -0.1) {
            assert_eq!(a, b, "pixel {i} is not");
        }
    }
    request.highlight = None;
    assert_eq!(pass(&request).pixels, before.pixels);
}
