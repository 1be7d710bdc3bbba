//! The surface as it is shown: M(x), then the edit of the whole object, then those of its regions.
//!
//! Everything that shows or exports the object takes it from here, so that an edit is the same everywhere.

use glam::Vec3;

use super::edit::MaterialEdit;
use super::material::MaterialBatch;
use super::object::ObjectModel;
use super::region::{Region, RegionMask, Regions};
use super::values::Surface;

/// The edited surfaces at some points, and working memory to be used again.
#[derive(Debug, Default)]
pub struct EditedSurfaces {
    batch: MaterialBatch,
    points: Vec<Vec3>,
    encoded: Vec<f32>,
    learned_roughness: Vec<f32>,
    specular_gain: Vec<Vec3>,
    has_new_roughness: Vec<bool>,
}

impl EditedSurfaces {
    /// Evaluates the surface at world points with unit normals.
    pub fn evaluate(
        &mut self,
        object: &ObjectModel,
        edit: &MaterialEdit,
        regions: &Regions,
        points: impl Iterator<Item = (Vec3, Vec3)> + Clone,
    ) {
        let regions = regions.effective();
        let masks = self.masks(object, regions.iter());
        self.forward(object, points.clone());
        let (gain, is_new) = (edit.specular_gain(), edit.changes_roughness());
        self.learned_roughness.clear();
        self.specular_gain.clear();
        self.has_new_roughness.clear();
        for (surface, (position, normal)) in self.batch.surfaces.iter_mut().zip(points) {
            self.learned_roughness.push(surface.roughness);
            let material = object.material.perceptual(*surface);
            let mut edited = Edited {
                surface: edit.apply(material),
                gain,
                is_new,
            };
            let mut part = None;
            for (region, mask) in regions.iter().zip(&masks) {
                let find = || *part.get_or_insert_with(|| object.tracer.part_at(position, normal));
                edited.change(&region.edit, mask.weight(&material, find));
            }
            *surface = edited.surface;
            self.specular_gain.push(edited.gain);
            self.has_new_roughness.push(edited.is_new);
        }
    }

    /// The share `[0, 1]` of each world point (with its unit normal) that belongs to a region; added to `weights`.
    pub fn weights(
        &mut self,
        object: &ObjectModel,
        region: &Region,
        points: impl Iterator<Item = (Vec3, Vec3)> + Clone,
        weights: &mut Vec<f32>,
    ) {
        let masks = self.masks(object, std::iter::once(region));
        self.forward(object, points.clone());
        for (surface, (position, normal)) in self.batch.surfaces.iter().zip(points) {
            let material = object.material.perceptual(*surface);
            let part = || object.tracer.part_at(position, normal);
            weights.extend(masks.iter().map(|mask| mask.weight(&material, part)));
        }
    }

    /// The surfaces, `[n_points]`; roughness as renderers mean it.
    pub fn surfaces(&self) -> &[Surface] {
        &self.batch.surfaces
    }

    /// The same, to be changed further.
    pub fn surfaces_mut(&mut self) -> &mut [Surface] {
        &mut self.batch.surfaces
    }

    /// Roughness as it was learned, before edits, `[n_points]`.
    pub fn learned_roughness(&self) -> &[f32] {
        &self.learned_roughness
    }

    /// Factor of the whole specular part, grazing angles included, `[n_points]`.
    pub fn specular_gain(&self) -> &[Vec3] {
        &self.specular_gain
    }

    /// Whether an edit of roughness reaches the point, `[n_points]`.
    pub fn has_new_roughness(&self) -> &[bool] {
        &self.has_new_roughness
    }

    fn masks<'a>(
        &mut self,
        object: &ObjectModel,
        regions: impl Iterator<Item = &'a Region>,
    ) -> Vec<RegionMask> {
        let mut regions = regions.peekable();
        if regions.peek().is_none() {
            return Vec::new();
        }
        RegionMask::of(regions, object, &mut self.batch, &mut self.encoded)
    }

    fn forward(&mut self, object: &ObjectModel, points: impl Iterator<Item = (Vec3, Vec3)>) {
        self.points.clear();
        self.points.extend(points.map(|(position, _)| position));
        object
            .material
            .forward(&self.points, &mut self.batch, &mut self.encoded);
    }
}

/// One point on its way through the edits.
struct Edited {
    surface: Surface,
    gain: Vec3,
    is_new: bool,
}

impl Edited {
    /// Applies an edit with a weight in `[0, 1]`.
    fn change(&mut self, edit: &MaterialEdit, weight: f32) {
        if weight <= 0.0 {
            return;
        }
        let surface = edit.apply(self.surface);
        // Weights of 1 leave nothing of the old value, to the last bit.
        let mix = |old: f32, new: f32| old * (1.0 - weight) + new * weight;
        let mix3 = |old: Vec3, new: Vec3| old * (1.0 - weight) + new * weight;
        self.surface.roughness = mix(self.surface.roughness, surface.roughness);
        self.surface.diffuse = mix3(self.surface.diffuse, surface.diffuse);
        self.gain = mix3(self.gain, self.gain * edit.specular_gain());
        self.is_new |= edit.changes_roughness();
    }
}
