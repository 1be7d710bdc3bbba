//! Depth maps of what photos show of the object, where its own pattern determines them.
//!
//! Each photo is swept within the box of the object, and what others confirm from well apart is kept. A polished surface shows a
//! pattern too, that of its environment, at a virtual depth that may be confirmed as well: `outline_check` tells.

use glam::Vec3;
use rayon::prelude::*;

use super::{fusion, outline_check};
use crate::data::{Dataset, DepthMap};
use crate::geometry::{Aabb, Camera, ScalarGrid};
use crate::train::pixels::outlines::Sides;
use crate::train::shape::stage_one::GoOn;
use crate::train::shape::stage_one::silhouette::Silhouette;
use crate::train::sweep::{Onlooker, PhotoDepths, SmallPhoto, Steps, Window, neighbours};

/// Longer side of the pictures of the object, pixels.
const SIDE: u32 = 256;
/// Photos that must confirm what one finds, and the angle between two of the views at least, radians.
const CONFIRMED_BY: usize = 2;
const APART: f32 = 0.25;
/// Angle from a view within which others are asked.
const ASKED: f32 = 1.2;

/// What photos show of the object.
#[derive(Debug, Default)]
pub(in super::super) struct PhotoMaps {
    /// Depths of what some of the photos show.
    pub(in super::super) maps: Vec<DepthMap>,
    /// Share of all photos' pixels of the object of which the depth is known, `[0, 1]`.
    pub(in super::super) share: f32,
}

/// Of the views with these silhouettes, which gave the surface `phi` within `bounds`, as coarse as they are compared on
/// (`draft::COMPARED_CELLS`). `None` where they contradict these, as the virtual images of a polished surface do, where they
/// determine too little, and once `go_on`, asked before each photo, returns false.
pub(in super::super) fn of_surface(
    dataset: &Dataset,
    silhouettes: &[Silhouette],
    (bounds, phi): (&Aabb, &ScalarGrid),
    go_on: GoOn<'_>,
) -> Option<PhotoMaps> {
    let found = maps(dataset, silhouettes, bounds, go_on);
    let are_enough = found.maps.len() >= fusion::MIN_MAPS;
    (are_enough && outline_check::agree(&found.maps, phi, silhouettes)).then_some(found)
}

/// The same whether or not outlines contradict them.
pub(in super::super) fn maps(
    dataset: &Dataset,
    silhouettes: &[Silhouette],
    bounds: &Aabb,
    go_on: GoOn<'_>,
) -> PhotoMaps {
    let photos: Vec<SmallPhoto> = silhouettes
        .par_iter()
        .filter_map(|silhouette| picture(dataset, silhouette))
        .collect();
    let cameras: Vec<Camera> = photos.iter().map(|photo| photo.camera).collect();
    let corners = bounds.corners();
    let swept = photos.par_iter().enumerate().map(|(i, photo)| {
        if !go_on() {
            return None;
        }
        let neighbours = neighbours(&cameras, i, &corners);
        let others: Vec<_> = neighbours.iter().map(|i| &photos[*i]).collect();
        let range = nearness(&photo.camera, &corners);
        let (CONFIRMED_BY.., Some(range)) = (others.len(), range) else {
            return Some(PhotoDepths::unknown(photo, f32::INFINITY));
        };
        let steps = Steps::between(range, photo, &others);
        Some(PhotoDepths::swept(photo, &others, steps))
    });
    let Some(swept) = swept.collect::<Option<Vec<PhotoDepths>>>() else {
        return PhotoMaps::default();
    };
    let looks: Vec<Onlooker<'_>> = swept.iter().map(PhotoDepths::looks).collect();
    let center = bounds.center();
    let confirmed = swept.par_iter().enumerate().map(|(i, own)| {
        let eye = own.camera.position();
        let angle_at =
            |point: Vec3, other: &Onlooker<'_>| (eye - point).angle_between(other.eye() - point);
        let asked = looks.iter().enumerate();
        let asked = asked.filter(|(j, other)| *j != i && angle_at(center, other) < ASKED);
        let asked: Vec<&Onlooker<'_>> = asked.map(|(_, other)| other).collect();
        let nearness = own.confirmed(|point| {
            let seeing = asked.iter().filter(|other| other.pixel_of(point).is_some());
            let angles = seeing.map(|other| angle_at(point, other));
            let (n, widest) = angles.fold((0, 0.0_f32), |(n, widest), angle| {
                (n + 1, widest.max(angle))
            });
            n >= CONFIRMED_BY && widest >= APART
        });
        DepthMap {
            camera: own.camera,
            depths: nearness
                .iter()
                .map(|v| if v.is_nan() { 0.0 } else { 1.0 / v })
                .collect(),
        }
    });
    let n_known = |map: &DepthMap| map.depths.iter().filter(|depth| **depth > 0.0).count();
    let maps: Vec<DepthMap> = confirmed.filter(|map| n_known(map) > 0).collect();
    let n_shown = photos
        .iter()
        .flat_map(|photo| &photo.grey)
        .filter(|grey| !grey.is_nan());
    let share = maps.iter().map(n_known).sum::<usize>() as f32 / n_shown.count().max(1) as f32;
    PhotoMaps { maps, share }
}

/// What a photo shows of the object; `None` where that is nothing.
fn picture(dataset: &Dataset, silhouette: &Silhouette) -> Option<SmallPhoto> {
    let view = &dataset.train[silhouette.view];
    let longer = |window: &Window| window.size[0].max(window.size[1]);
    let full = window_of(&silhouette.outline.distance, view.camera.width, |d| {
        *d > 0.0
    })?;
    let scale = (SIDE as f32 / longer(&full) as f32).min(1.0);
    let longest = view.camera.width.max(view.camera.height);
    let small = view.within((scale * longest as f32).round() as u32);
    let camera = silhouette
        .camera
        .resized(small.camera.width, small.camera.height);
    let is_object = Sides::new(&small, &camera, None, 0.0).object;
    let window = window_of(&is_object, camera.width, |is_object| *is_object)?;
    Some(SmallPhoto::new(&small, &camera, &is_object, window))
}

/// The part of a picture around the pixels that are wanted.
fn window_of<T>(pixels: &[T], width: u32, is_wanted: impl Fn(&T) -> bool) -> Option<Window> {
    let wanted = pixels
        .iter()
        .enumerate()
        .filter(|(_, pixel)| is_wanted(pixel));
    let places = wanted.map(|(i, _)| [i as u32 % width, i as u32 / width]);
    let range = places.fold(None, |range: Option<[[u32; 2]; 2]>, at| {
        let [low, high] = range.unwrap_or([at; 2]);
        let pick =
            |a: [u32; 2], choose: fn(u32, u32) -> u32| [choose(a[0], at[0]), choose(a[1], at[1])];
        Some([pick(low, u32::min), pick(high, u32::max)])
    });
    let [start, end] = range?;
    let size = [end[0] - start[0] + 1, end[1] - start[1] + 1];
    Some(Window { start, size })
}

/// One over the furthest and the nearest depth of points before a camera; `None` where some is not.
fn nearness(camera: &Camera, points: &[Vec3]) -> Option<[f32; 2]> {
    let (eye, forward) = (camera.position(), camera.forward());
    let depths = points.iter().map(|p| (*p - eye).dot(forward));
    let (near, far) = depths.fold((f32::INFINITY, 0.0_f32), |(near, far), depth| {
        (near.min(depth), far.max(depth))
    });
    (near > 0.0).then(|| [1.0 / far, 1.0 / near])
}
