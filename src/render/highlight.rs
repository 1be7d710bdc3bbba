//! Shows which places of the object belong to a region: a signal colour over them.

use glam::Vec3;

use super::path::gbuffer::GBuffer;
use super::path::scratch::ShadeScratch;
use super::scene::Scene;
use crate::neif::{ObjectModel, Region};

/// The colour, for linear values in motion as well: rare in photos of things.
const COLOR: [f32; 3] = [1.0, 0.25, 0.9];
/// How much of it covers what belongs to the region fully.
const OPACITY: f32 = 0.5;

/// Share `[0, 1]` of the object in each listed pixel that belongs to the region; 0 where no object is seen.
pub(super) fn region_share(
    scene: &Scene,
    gbuffer: &GBuffer,
    region: &Region,
    pixels: &[u32],
    scratch: &mut ShadeScratch,
) -> Vec<f32> {
    let Some(object) = &scene.object else {
        return vec![0.0; pixels.len()];
    };
    let seen = pixels.iter().flat_map(|&pixel| gbuffer.paths_at(pixel));
    let points: Vec<(Vec3, Vec3)> = seen
        .map(|path| (path[0].point.position, path[0].point.normal))
        .collect();
    let mut weights = Vec::new();
    let points = points.into_iter();
    scratch.edited.weights(object, region, points, &mut weights);
    let mut weights = weights.into_iter();
    let shares = pixels.iter().map(|&pixel| {
        let n = gbuffer.paths_at(pixel).count();
        weights.by_ref().take(n).sum::<f32>() / n.max(1) as f32
    });
    shares.collect()
}

/// Covers linear values of the object, one a point seen of it (with its unit normal), with the colour.
pub(super) fn cover_values(
    object: &ObjectModel,
    region: &Region,
    points: impl Iterator<Item = (Vec3, Vec3)> + Clone,
    values: &mut [[f32; 3]],
    scratch: &mut ShadeScratch,
) {
    let mut weights = Vec::new();
    scratch.edited.weights(object, region, points, &mut weights);
    for (value, weight) in values.iter_mut().zip(weights) {
        *value = highlighted(*value, weight);
    }
}

/// A colour of which a share `[0, 1]` is highlighted.
pub(super) fn highlighted(srgb: [f32; 3], share: f32) -> [f32; 3] {
    let opacity = OPACITY * share;
    std::array::from_fn(|c| srgb[c] * (1.0 - opacity) + COLOR[c] * opacity)
}
