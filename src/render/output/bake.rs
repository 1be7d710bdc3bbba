//! Bakes the object's surface into textures for other programs.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::metallic_roughness::MetallicRoughness;
use crate::geometry::{Atlas, Texel};
use crate::neif::{EditedSurfaces, MaterialEdit, ObjectModel, Regions};
use crate::render::irradiance::TrainedLight;

/// Texels evaluated together.
const CHUNK: usize = 4096;

/// Square textures, row-major from the top left.
#[derive(Clone, Debug)]
pub struct BakedSurface {
    /// Texels on a side.
    pub size_px: u32,
    /// `[size_px * size_px]` colours, metalness and reflectance.
    pub material: Vec<MetallicRoughness>,
    /// `[size_px * size_px]` perceptual roughness.
    pub roughness: Vec<f32>,
    /// Root mean square of what glTF's plain material misses of the reflectance, over the surface.
    pub plain_error: f32,
    /// The same with `KHR_materials_specular`.
    pub specular_error: f32,
}

/// Evaluates the edited material at every texel that shows the mesh; the others take the colours next to them, or the mean.
///
/// `light` is the light that the object was trained in. Without it the baked diffuse radiance itself is taken for the albedo, as if
/// the irradiance were pi everywhere.
pub fn bake(
    object: &ObjectModel,
    (edit, regions): (&MaterialEdit, &Regions),
    atlas: &Atlas,
    padding_px: u32,
    light: Option<&TrainedLight>,
) -> BakedSurface {
    let texels = atlas.texels(object.tracer.mesh());
    let baked: Vec<Baked> = texels
        .par_chunks(CHUNK)
        .flat_map_iter(|texels| bake_texels(object, (edit, regions), texels, light))
        .collect();
    let n = texels.len().max(1) as f32;
    let error = |of: fn(&MetallicRoughness) -> Vec3| {
        let sum: f32 = baked
            .iter()
            .map(|b| (of(&b.material) - b.reflectance).length_squared() / 3.0)
            .sum();
        (sum / n).sqrt()
    };
    let (plain_error, specular_error) = (
        error(MetallicRoughness::plain_reflectance),
        error(MetallicRoughness::reflectance),
    );
    let n_texels = (atlas.size_px as usize).pow(2);
    let mut pixels: Vec<Option<Pixel>> = vec![None; n_texels];
    for (texel, baked) in texels.iter().zip(&baked) {
        let MetallicRoughness {
            base,
            metallic,
            dielectric,
        } = baked.material;
        let pixel = [base.extend(metallic), dielectric.extend(baked.roughness)];
        pixels[texel.index as usize] = Some(pixel);
    }
    let overall = mean(&mut pixels.iter().flatten().copied());
    for _ in 0..=padding_px {
        grow(&mut pixels, atlas.size_px as usize, mean);
    }
    let filled = pixels.iter().map(|pixel| pixel.unwrap_or(overall));
    let material = |[metal, rest]: Pixel| MetallicRoughness {
        base: metal.truncate(),
        metallic: metal.w,
        dielectric: rest.truncate(),
    };
    BakedSurface {
        size_px: atlas.size_px,
        material: filled.clone().map(material).collect(),
        roughness: filled.map(|[_, rest]| rest.w).collect(),
        plain_error,
        specular_error,
    }
}

/// The surface at a texel, and the reflectance that it should have.
struct Baked {
    material: MetallicRoughness,
    roughness: f32,
    reflectance: Vec3,
}

/// Base colour and metalness, dielectric colour and roughness.
type Pixel = [Vec4; 2];

fn bake_texels(
    object: &ObjectModel,
    (edit, regions): (&MaterialEdit, &Regions),
    texels: &[Texel],
    light: Option<&TrainedLight>,
) -> Vec<Baked> {
    let mut edited = EditedSurfaces::default();
    let points = texels.iter().map(|texel| (texel.position, texel.normal));
    edited.evaluate(object, edit, regions, points);
    let surfaces = edited.surfaces();
    let learned = edited
        .specular_gain()
        .iter()
        .zip(edited.learned_roughness());
    let surfaces = texels.iter().zip(surfaces).zip(learned);
    surfaces
        .map(|((texel, surface), (gain, roughness))| {
            let (mut albedo, mut reflectance) = (surface.diffuse, surface.tint * *gain);
            if let Some(light) = light {
                albedo = light.surface.albedo(texel.position, texel.normal, albedo);
                // Other programs gather a lobe by many rays.
                reflectance *= light.wide_gain(*roughness);
            }
            let reflectance = reflectance.clamp(Vec3::ZERO, Vec3::ONE);
            Baked {
                material: MetallicRoughness::nearest(albedo, reflectance),
                roughness: surface.roughness,
                reflectance,
            }
        })
        .collect()
}

fn mean(pixels: &mut dyn Iterator<Item = Pixel>) -> Pixel {
    let (mut sum, mut n) = (Pixel::default(), 0.0);
    for [metal, rest] in pixels {
        sum[0] += metal;
        sum[1] += rest;
        n += 1.0;
    }
    sum.map(|values| values / f32::max(n, 1.0))
}

/// Gives every empty pixel beside filled ones their mean, so that look-ups between texels do not bleed.
pub(in crate::render) fn grow<P: Copy + Send + Sync>(
    pixels: &mut [Option<P>],
    size: usize,
    mean: impl Fn(&mut dyn Iterator<Item = P>) -> P + Sync,
) {
    let before = pixels.to_vec();
    pixels
        .par_chunks_mut(size)
        .enumerate()
        .for_each(|(y, row)| {
            let around = |x: usize| {
                let rows = y.saturating_sub(1)..(y + 2).min(size);
                rows.flat_map(move |y| {
                    (x.saturating_sub(1)..(x + 2).min(size)).map(move |x| y * size + x)
                })
            };
            for (x, pixel) in row.iter_mut().enumerate() {
                if pixel.is_none() {
                    let mut filled = around(x).filter_map(|i| before[i]).peekable();
                    let is_beside = filled.peek().is_some();
                    *pixel = is_beside.then(|| mean(&mut filled));
                }
            }
        });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::RoughnessEdit;
    use crate::neif::surface::material::MaterialBatch;
    use crate::render::{test_scene, trained_light};

    #[test]
    fn textures_hold_the_edited_material_where_the_mesh_is() {
        let object = test_scene::object(1);
        let atlas = Atlas::new(object.tracer.mesh(), 64, 2).unwrap();
        let edit = MaterialEdit {
            roughness: RoughnessEdit::Constant(0.25),
            tint_scale: 0.5,
            diffuse_gain: Vec3::new(1.0, 0.5, 0.0),
            ..MaterialEdit::default()
        };
        let baked = bake(&object, (&edit, &Regions::default()), &atlas, 2, None);
        assert!(
            baked.roughness.iter().all(|r| (r - 0.25).abs() < 1e-6),
            "roughness"
        );
        let texels = atlas.texels(object.tracer.mesh());
        let points: Vec<Vec3> = texels.iter().map(|texel| texel.position).collect();
        let mut batch = MaterialBatch::default();
        object
            .material
            .forward(&points, &mut batch, &mut Vec::new());
        for (texel, surface) in texels.iter().zip(&batch.surfaces) {
            let found = baked.material[texel.index as usize];
            let (albedo, reflectance) = (surface.diffuse * edit.diffuse_gain, surface.tint * 0.5);
            assert_eq!(
                found,
                MetallicRoughness::nearest(albedo, reflectance),
                "at {texel:?}"
            );
        }
        assert!(
            baked.specular_error <= baked.plain_error + 1e-6,
            "the extension helps"
        );
    }

    #[test]
    fn where_the_light_is_known_the_base_colour_is_the_albedo() {
        let scene = test_scene::scene();
        let object = scene.object.as_ref().expect("the ball");
        let light = trained_light(&scene, &test_scene::NEVER).expect("not cancelled");
        let atlas = Atlas::new(object.tracer.mesh(), 32, 1).unwrap();
        let edit = MaterialEdit {
            tint_scale: 0.0,
            ..MaterialEdit::default()
        };
        let edits = (&edit, &Regions::default());
        let [lit, unlit] = [Some(&*light), None].map(|light| bake(object, edits, &atlas, 1, light));
        for texel in atlas.texels(object.tracer.mesh()) {
            let [lit, unlit] = [&lit, &unlit].map(|b| b.material[texel.index as usize].albedo());
            let expected = light.surface.albedo(texel.position, texel.normal, unlit);
            assert!(
                (lit - expected).abs().max_element() < 1e-4,
                "{lit} {expected}"
            );
            assert!(lit.distance(unlit) > 1e-3, "{lit}");
        }
    }
}
