//! How far away is what the photos show beside the object, from the photos themselves and before any training.
//!
//! A few photos of a room are explained as well by clouds before each camera. What neighbouring photos agree on says where
//! surfaces are, where there is only air, and how much brighter photos are than one another. Each photo is swept against its
//! neighbours, and what is found is kept where the neighbours' own findings confirm it. Depth maps that the capture has go before.

mod air;
mod correlation;
mod exposures;
mod loss;
mod neighbours;
mod small_photo;
mod sweep;
#[cfg(test)]
mod tests;

use std::collections::HashMap;

use glam::{Affine3A, Vec2, Vec3};
use rayon::prelude::*;

pub(in crate::train) use self::air::clear_air;
pub(in crate::train) use self::loss::{fading, misplacement};

use self::exposures::log_gains;
use self::neighbours::neighbours;
use self::small_photo::SmallPhoto;
use self::sweep::{Steps, sweep};
use crate::data::{Dataset, DepthMap, DepthView};
use crate::geometry::{Camera, SurfaceTracer};
use crate::neif::field::contraction::FieldFrame;

/// Longer side of the photos that are compared, pixels.
const PHOTO_SIDE: u32 = 128;
/// Most photos that are swept; of more, every second or third.
const MOST_PHOTOS: usize = 160;
/// Nearest depth that is tried, in half sides of the field's inner box.
const NEAREST: f32 = 0.5;
/// Most depths that are tried.
const MOST_STEPS: usize = 128;
/// A typical distance of what is seen, in half sides of the inner box.
const TYPICAL: f32 = 1.0;
/// Steps by which the findings of two photos may differ and confirm each other, and neighbours that must confirm one.
const SAME: f32 = 1.5;
const CONFIRMED_BY: usize = 2;

/// What the training photos say before any training.
#[derive(Debug)]
pub(in crate::train) struct SeenDepths {
    /// By training photo; `None` for those that were not swept.
    photos: Vec<Option<PhotoDepths>>,
    /// The logarithm of each training photo's gain a colour, of mean 0; `None` where they do not determine all.
    pub(in crate::train) log_gains: Option<Vec<Vec3>>,
}

/// Depths of what a photo shows, where its neighbours determine them.
#[derive(Debug)]
struct PhotoDepths {
    /// A pinhole, of the size of the depths.
    camera: Camera,
    /// `[height * width]` one over the depth along the camera's axis, world units; NaN where not known.
    nearness: Vec<f32>,
    /// About how exactly they are known.
    step: f32,
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
        let small = |i: &usize| SmallPhoto::of(&dataset.train[*i], &cameras[*i], tracer);
        let photos: Vec<SmallPhoto> = chosen.par_iter().map(small).collect();
        let pinholes: Vec<Camera> = photos.iter().map(|photo| photo.camera).collect();
        let of_photo = |i| neighbours(&pinholes, i, TYPICAL * frame.half_side);
        let all = (0..photos.len()).into_par_iter();
        let neighbours: Vec<Vec<usize>> = all.map(of_photo).collect();
        let maps = dataset.origin.depths.iter();
        let measured: HashMap<&str, &DepthView> =
            maps.map(|map| (map.name.as_str(), map)).collect();
        let map_of = |i: usize| measured.get(dataset.train[i].name.as_str());
        let of_photo = |(i, neighbours): (usize, &Vec<usize>)| {
            go_on().then(|| {
                if map_of(chosen[i]).is_some_and(|map| map.is_complete()) {
                    return PhotoDepths::unknown(&photos[i], frame);
                }
                let others: Vec<_> = neighbours.iter().map(|i| &photos[*i]).collect();
                PhotoDepths::swept(&photos[i], &others, frame)
            })
        };
        let swept = neighbours.par_iter().enumerate().map(of_photo);
        let mut swept: Vec<PhotoDepths> = swept.collect::<Option<_>>()?;
        let pairs = swept.par_iter().zip(&neighbours);
        let confirmed = pairs.map(|(own, neighbours)| own.confirmed(&swept, neighbours));
        let confirmed: Vec<Vec<f32>> = confirmed.collect();
        for (photo, nearness) in swept.iter_mut().zip(confirmed) {
            photo.nearness = nearness;
        }
        let found = chosen.par_iter().zip(&photos).zip(&mut swept);
        found.for_each(|((i, photo), depths)| {
            // Without a map that can be read, the depths stay those estimated from the photos.
            if let Some(map) = map_of(*i).and_then(|map| map.read(&dataset.train[*i].camera).ok()) {
                depths.measure(photo, &map);
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
        let by_depth = depths.nearness[pixel_at(camera, at)?];
        (!by_depth.is_nan()).then(|| by_depth * direction.dot(camera.forward()))
    }

    /// Share of the swept photos' pixels of which the depth is known, `[0, 1]`.
    pub(in crate::train) fn share(&self) -> f32 {
        let all = || self.photos.iter().flatten().flat_map(|p| &p.nearness);
        all().filter(|v| !v.is_nan()).count() as f32 / all().count().max(1) as f32
    }
}

impl PhotoDepths {
    fn swept(photo: &SmallPhoto, others: &[&SmallPhoto], frame: &FieldFrame) -> Self {
        let steps = steps(photo, others, frame);
        let nearness = if others.len() < CONFIRMED_BY {
            vec![f32::NAN; photo.grey.len()]
        } else {
            sweep(photo, others, steps)
        };
        Self {
            camera: photo.camera,
            nearness,
            step: steps.width,
        }
    }

    /// Before anything is measured.
    fn unknown(photo: &SmallPhoto, frame: &FieldFrame) -> Self {
        Self {
            camera: photo.camera,
            nearness: vec![f32::NAN; photo.grey.len()],
            step: 1.0 / (NEAREST * frame.half_side * MOST_STEPS as f32),
        }
    }

    /// What the sweep found, where enough of the photos numbered `neighbours` found the same.
    fn confirmed(&self, photos: &[Self], neighbours: &[usize]) -> Vec<f32> {
        let others: Vec<Onlooker<'_>> = neighbours.iter().map(|i| photos[*i].looks()).collect();
        let kept = |(pixel, nearness): (usize, &f32)| {
            let n_seeing = self.point(pixel).map_or(0, |point| {
                let sees = |other: &&Onlooker<'_>| other.pixel_of(point).is_some();
                others.iter().filter(sees).count()
            });
            if n_seeing >= CONFIRMED_BY {
                *nearness
            } else {
                f32::NAN
            }
        };
        self.nearness.iter().enumerate().map(kept).collect()
    }

    /// To be asked which of its pixels show points.
    fn looks(&self) -> Onlooker<'_> {
        Onlooker {
            depths: self,
            camera_from_world: self.camera.world_from_camera.inverse(),
        }
    }

    /// Takes what was measured where the photo shows the background.
    fn measure(&mut self, photo: &SmallPhoto, map: &DepthMap) {
        let eye = map.camera.position();
        for (pixel, nearness) in self.nearness.iter_mut().enumerate() {
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

    /// What a pixel shows, world; `None` where that is not known.
    fn point(&self, pixel: usize) -> Option<Vec3> {
        let nearness = self.nearness[pixel];
        // What is at infinity is taken for far away.
        let depth = 1.0 / nearness.max(0.01 * self.step);
        (!nearness.is_nan()).then(|| self.camera.position() + depth * ray_of(&self.camera, pixel))
    }
}

/// A photo that is asked about many points.
struct Onlooker<'a> {
    depths: &'a PhotoDepths,
    camera_from_world: Affine3A,
}

impl Onlooker<'_> {
    /// The pixel that shows a point, world, as near as that is; `None` where none does.
    fn pixel_of(&self, point: Vec3) -> Option<usize> {
        let PhotoDepths { camera, step, .. } = self.depths;
        let p = self.camera_from_world.transform_point3(point);
        let expected = -1.0 / p.z;
        let at = Vec2::new(camera.fx * p.x, -camera.fy * p.y) * expected;
        let pixel = pixel_at(camera, at + Vec2::new(camera.cx, camera.cy))?;
        let is_there = (self.depths.nearness[pixel] - expected).abs() <= SAME * step;
        (p.z < 0.0 && is_there).then_some(pixel)
    }
}

/// Depths about a pixel apart in the neighbours.
fn steps(photo: &SmallPhoto, neighbours: &[&SmallPhoto], frame: &FieldFrame) -> Steps {
    let eye = photo.camera.position();
    let shift =
        |other: &&SmallPhoto| other.camera.position().distance(eye) / other.camera.pixel_angle();
    let nearest = 1.0 / (NEAREST * frame.half_side);
    let n = (neighbours.iter().map(shift).fold(0.0, f32::max) * nearest).ceil() as usize;
    let n = n.clamp(8, MOST_STEPS);
    Steps {
        n,
        width: nearest / (n - 1) as f32,
    }
}

/// The ray through the middle of a pixel, world, of length 1 along the camera's axis.
fn ray_of(camera: &Camera, pixel: usize) -> Vec3 {
    let width = camera.width as usize;
    let middle = Vec2::new((pixel % width) as f32, (pixel / width) as f32) + 0.5;
    let direction = camera.ray(middle.x, middle.y).direction;
    direction / direction.dot(camera.forward())
}

/// The pixel at a place, pixels; `None` beside the picture.
fn pixel_at(camera: &Camera, at: Vec2) -> Option<usize> {
    let size = Vec2::new(camera.width as f32, camera.height as f32);
    let is_inside = at.cmpge(Vec2::ZERO).all() && at.cmplt(size).all();
    is_inside.then(|| at.y as usize * camera.width as usize + at.x as usize)
}
