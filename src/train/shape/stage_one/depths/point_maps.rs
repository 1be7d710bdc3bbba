//! Depth maps from a reconstruction's points: coarse, but enough for a mesh where there is nothing else.
//!
//! Each photo knows the depth of the points that it was matched by. Between them it is that of the near ones, weighted by
//! how near they are, as long as they belong to one surface.

use std::collections::HashMap;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::fusion::{MOST_MAPS, evenly, looked_at};
use crate::data::{Dataset, DepthMap, PointCloud, View};
use crate::train::shape::stage_one::GoOn;
use crate::train::statistics::middle;

/// Pixels on the longer side of a map.
const SIDE: u32 = 128;
/// Points that a photo must see.
const MIN_POINTS: usize = 30;
/// Points that are used at most, of a photo or around the object, evenly chosen.
const MOST_POINTS: usize = 4000;
/// Reprojection error in the photo's pixels above which a point is not believed.
const MOST_ERROR_PX: f32 = 2.0;
/// How far a point's depth reaches, in usual distances between neighbouring points.
const REACH: f32 = 3.0;
/// Share by which the depths of one surface's neighbouring points differ at most.
const SAME_SURFACE: f32 = 0.1;

/// A point in a map: where, and its depth along the camera's axis.
type Sight = (Vec2, f32);

/// Maps of the training views that see enough points, evenly chosen where they are many; fewer when asked to stop.
pub(in super::super) fn maps<'a>(
    dataset: &'a Dataset,
    go_on: GoOn<'_>,
) -> Vec<(DepthMap, &'a View)> {
    let Some(cloud) = &dataset.origin.points else {
        return Vec::new();
    };
    let photos = cloud.photos.iter();
    let seen: HashMap<&str, &[u32]> = photos
        .map(|photo| (photo.name.as_str(), photo.points.as_slice()))
        .collect();
    let views: Vec<&View> = dataset.train.iter().collect();
    let of_view = |view: &'a View| {
        let points = seen.get(view.name.as_str()).filter(|_| go_on())?;
        Some((map(cloud, points, view)?, view))
    };
    let chosen = evenly(&views, MOST_MAPS).into_par_iter();
    chosen.filter_map(of_view).collect()
}

/// Points around the place that the cameras look at, evenly chosen where they are many, and how far they reach from there;
/// `None` where the cameras look at no one place.
pub(in super::super) fn around_object(dataset: &Dataset) -> Option<(Vec<Vec3>, f32)> {
    let cloud = dataset.origin.points.as_ref()?;
    let (center, reach) = looked_at(dataset)?;
    let points = cloud.positions.iter().copied();
    let near = points.filter(|p| (*p - center).abs().max_element() < reach);
    Some((evenly(&near.collect::<Vec<_>>(), MOST_POINTS), reach))
}

fn map(cloud: &PointCloud, points: &[u32], view: &View) -> Option<DepthMap> {
    let longer = view.camera.width.max(view.camera.height).max(1);
    let shrunk = |n: u32| (n * SIDE.min(longer)).div_ceil(longer).max(1);
    let (width, height) = (shrunk(view.camera.width), shrunk(view.camera.height));
    let camera = view.camera.resized(width, height);
    let (eye, forward) = (camera.position(), camera.forward());
    let sight = |point: &u32| -> Option<Sight> {
        let point = *point as usize;
        let (error, position) = (cloud.errors_px[point], cloud.positions[point]);
        let depth = forward.dot(position - eye);
        let pixel = camera.project(position)?;
        // An error that is no number was never computed.
        let is_believed = error.is_nan() || error <= MOST_ERROR_PX;
        (is_believed && depth > 0.0).then_some((pixel, depth))
    };
    let sights: Vec<Sight> = points.iter().filter_map(sight).collect();
    if sights.len() < MIN_POINTS {
        return None;
    }
    let sights = evenly(&sights, MOST_POINTS);
    let spacing = spacing_px(&sights);
    let depths = (0..camera.width * camera.height).map(|i| {
        let at = Vec2::new((i % camera.width) as f32, (i / camera.width) as f32) + 0.5;
        depth_at(&sights, at, spacing).unwrap_or(0.0)
    });
    Some(DepthMap {
        depths: depths.collect(),
        camera,
    })
}

/// The median distance of a point from its neighbour, at least a pixel.
fn spacing_px(sights: &[Sight]) -> f32 {
    let nearest = |i: usize| {
        let others = (0..sights.len()).filter(|j| *j != i);
        let distances = others.map(|j| sights[i].0.distance_squared(sights[j].0));
        distances.fold(f32::INFINITY, f32::min).sqrt()
    };
    let mut nearest: Vec<f32> = (0..sights.len()).map(nearest).collect();
    middle(&mut nearest).max(1.0)
}

/// The depth at a place between points; `None` far from all.
fn depth_at(sights: &[Sight], at: Vec2, spacing: f32) -> Option<f32> {
    let square = |sight: &Sight| sight.0.distance_squared(at);
    let near = (REACH * spacing).powi(2);
    let nearest = sights
        .iter()
        .min_by(|a, b| square(a).total_cmp(&square(b)))?;
    if square(nearest) > near {
        return None;
    }
    let of_surface = sights.iter().filter(|sight| {
        square(sight) < near && (sight.1 - nearest.1).abs() < SAME_SURFACE * nearest.1
    });
    // One over the depth is linear over a plane.
    let (mut sum, mut weights) = (0.0, 0.0);
    for sight in of_surface {
        let weight = (-0.5 * (square(sight) - square(nearest)) / (spacing * spacing)).exp();
        sum += weight / sight.1;
        weights += weight;
    }
    Some(weights / sum)
}
