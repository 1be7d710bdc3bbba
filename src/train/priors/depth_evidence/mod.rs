//! How far away is what the photos show beside the object, from the photos themselves and before any training.
//!
//! A few photos of a room are explained as well by clouds before each camera. What neighbouring photos agree on says where
//! surfaces are, where there is only air, and how much brighter photos are than one another. Each photo is swept against its
//! neighbours, and what is found is kept where the neighbours' own findings confirm it. Depth maps that the capture has go before.

mod air;
mod exposures;
mod loss;
#[cfg(test)]
mod tests;

use std::collections::HashMap;

use glam::Vec3;
use rayon::prelude::*;

pub(in crate::train) use self::air::clear_air;
pub(in crate::train) use self::loss::{fading, misplacement};

use self::exposures::log_gains;
use crate::data::{Dataset, DepthMap, DepthView, View};
use crate::geometry::{Camera, SurfaceTracer};
use crate::neif::field::contraction::FieldFrame;
use crate::train::pixels::outlines::Sides;
use crate::train::sweep::{Onlooker, PhotoDepths, SmallPhoto, Steps, Window, neighbours, ray_of};

/// Longer side of the photos that are compared, pixels.
const PHOTO_SIDE: u32 = 128;
/// Most photos that are swept; of more, every second or third.
const MOST_PHOTOS: usize = 160;
/// Width of the band along the object's outline that is left out, pixels: small ones mix what is on both sides.
const OUTLINE_PX: f32 = 0.5;
/// Nearest depth that is tried, in half sides of the field's inner box.
const NEAREST: f32 = 0.5;
/// A typical distance of what is seen, in half sides of the inner box.
const TYPICAL: f32 = 1.0;
/// Rays along each side of the picture whose points are looked for in other photos, and their distances, in typical ones.
const SIDE: usize = 4;
const DISTANCES: [f32; 3] = [0.6, 1.2, 3.0];
/// Neighbours that must confirm what a photo finds.
const CONFIRMED_BY: usize = 2;
/// About how exactly maps of measured depths are known, in one over the nearest depth.
const MEASURED: f32 = 1.0 / 128.0;

/// What the training photos say before any training.
#[derive(Debug)]
pub(in crate::train) struct SeenDepths {
    /// By training photo; `None` for those that were not swept.
    photos: Vec<Option<PhotoDepths>>,
    /// The logarithm of each training photo's gain a colour, of mean 0; `None` where they do not determine all.
    pub(in crate::train) log_gains: Option<Vec<Vec3>>,
}

impl SeenDepths {
    /// Of the training photos as `cameras` took them; `None` once `go_on`, asked before each photo, returns false.
    pub(in crate::train) fn of(
        dataset: &Dataset,
        cameras: &[Camera],
        tracer: Option<&SurfaceTracer>,
        frame: &FieldFrame,
        go_on: &(dyn Fn() -> bool + Sync),
    ) -> Option<Self> {
        let n = dataset.train.len();
        let chosen: Vec<usize> = (0..n).step_by(n.div_ceil(MOST_PHOTOS).max(1)).collect();
        let small = |i: &usize| background(&dataset.train[*i], &cameras[*i], tracer);
        let photos: Vec<SmallPhoto> = chosen.par_iter().map(small).collect();
        let pinholes: Vec<Camera> = photos.iter().map(|photo| photo.camera).collect();
        let of_photo = |i: usize| {
            let points = points_before(&pinholes[i], TYPICAL * frame.half_side);
            neighbours(&pinholes, i, &points)
        };
        let all = (0..photos.len()).into_par_iter();
        let neighbours: Vec<Vec<usize>> = all.map(of_photo).collect();
        let maps = dataset.origin.depths.iter();
        let measured: HashMap<&str, &DepthView> =
            maps.map(|map| (map.name.as_str(), map)).collect();
        let map_of = |i: usize| measured.get(dataset.train[i].name.as_str());
        let of_photo = |(i, neighbours): (usize, &Vec<usize>)| {
            go_on().then(|| {
                let nearest = 1.0 / (NEAREST * frame.half_side);
                let is_measured = map_of(chosen[i]).is_some_and(|map| map.is_complete());
                if is_measured || neighbours.len() < CONFIRMED_BY {
                    return PhotoDepths::unknown(&photos[i], MEASURED * nearest);
                }
                let others: Vec<_> = neighbours.iter().map(|i| &photos[*i]).collect();
                let steps = Steps::between([0.0, nearest], &photos[i], &others);
                PhotoDepths::swept(&photos[i], &others, steps)
            })
        };
        let swept = neighbours.par_iter().enumerate().map(of_photo);
        let mut swept: Vec<PhotoDepths> = swept.collect::<Option<_>>()?;
        let pairs = swept.par_iter().zip(&neighbours);
        let confirmed = pairs.map(|(own, neighbours)| {
            let others: Vec<Onlooker<'_>> = neighbours.iter().map(|i| swept[*i].looks()).collect();
            own.confirmed(|point| {
                let seeing = others
                    .iter()
                    .filter(|other| other.pixel_of(point).is_some());
                seeing.count() >= CONFIRMED_BY
            })
        });
        let confirmed: Vec<Vec<f32>> = confirmed.collect();
        for (photo, nearness) in swept.iter_mut().zip(confirmed) {
            photo.nearness = nearness;
        }
        let found = chosen.par_iter().zip(&photos).zip(&mut swept);
        found.for_each(|((i, photo), depths)| {
            // Without a map that can be read, the depths stay those estimated from the photos.
            if let Some(map) = map_of(*i).and_then(|map| map.read(&dataset.train[*i].camera).ok()) {
                measure(depths, photo, &map);
            }
        });
        let are_all = chosen.len() == n;
        let log_gains = are_all.then(|| log_gains(&photos, &swept)).flatten();
        let mut photos: Vec<Option<PhotoDepths>> = (0..n).map(|_| None).collect();
        for (place, photo) in chosen.into_iter().zip(swept) {
            photos[place] = Some(photo);
        }
        Some(Self { photos, log_gains })
    }

    /// One over the distance of what a training photo shows in a direction, world units; `None` where it is unknown.
    pub(in crate::train) fn nearness(&self, photo: usize, direction: Vec3) -> Option<f32> {
        let depths = self.photos[photo].as_ref()?;
        let camera = &depths.camera;
        let at = camera.project(camera.position() + direction)?;
        let by_depth = depths.nearness[camera.pixel_at(at)?];
        (!by_depth.is_nan()).then(|| by_depth * direction.dot(camera.forward()))
    }

    /// Share of the swept photos' pixels of which the depth is known, `[0, 1]`.
    pub(in crate::train) fn share(&self) -> f32 {
        let all = || self.photos.iter().flatten().flat_map(|p| &p.nearness);
        all().filter(|v| !v.is_nan()).count() as f32 / all().count().max(1) as f32
    }
}

/// What a view that `camera` took shows beside the object, small.
fn background(view: &View, camera: &Camera, tracer: Option<&SurfaceTracer>) -> SmallPhoto {
    let small = view.within(PHOTO_SIDE);
    let size = [small.camera.width, small.camera.height];
    let camera = camera.resized(size[0], size[1]);
    let sides = Sides::new(&small, &camera, tracer, OUTLINE_PX);
    let start = [0, 0];
    SmallPhoto::new(&small, &camera, &sides.background, Window { start, size })
}

/// Takes what was measured where the photo shows the background.
fn measure(depths: &mut PhotoDepths, photo: &SmallPhoto, map: &DepthMap) {
    let eye = map.camera.position();
    for (pixel, nearness) in depths.nearness.iter_mut().enumerate() {
        let at = map.camera.project(eye + ray_of(&photo.camera, pixel));
        let depth = at.and_then(|at| map.at(at.x, at.y));
        let is_known = |depth: &f32| *depth > 0.0 && depth.is_finite();
        if let Some(depth) = depth.filter(is_known)
            && !photo.grey[pixel].is_nan()
        {
            *nearness = 1.0 / depth;
        }
    }
}

/// Points that a camera may show, at about a `typical` distance, world units.
fn points_before(camera: &Camera, typical: f32) -> Vec<Vec3> {
    let at = |i: usize, n: u32| (i as f32 + 0.5) / SIDE as f32 * n as f32;
    let ray = |i: usize| camera.ray(at(i % SIDE, camera.width), at(i / SIDE, camera.height));
    let points = |i: usize| DISTANCES.map(|distance| ray(i).at(distance * typical));
    (0..SIDE * SIDE).flat_map(points).collect()
}
