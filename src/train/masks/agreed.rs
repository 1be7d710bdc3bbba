//! The shape on which the photos agree, and what a photo that a person has corrected says of it: a pixel beside the object has
//! nothing of it along its ray, a pixel of the object has some of it.

use std::sync::OnceLock;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::seen::SeenView;
use super::voxels::{VoxelGrid, VoxelSet};
use crate::data::{Mask, View};
use crate::geometry::{Aabb, Camera, Ray, ScalarGrid};
use crate::train::pixels::mask_outline::MaskOutline;
use crate::train::shape::stage_one::GrowthPicture;

/// Photos that vote, at most, evenly chosen.
const VOTERS: usize = 60;
/// Voxels along an axis.
const N_VOXELS: usize = 128;
/// The shares of photos that are tried: as many must show a place on the object.
const AGREEMENTS: [f32; 6] = [0.6, 0.7, 0.8, 0.86, 0.91, 0.95];
/// How far beside a corrected outline a pixel is certain, pixels of the photo as it was seen.
const CERTAIN: f32 = 1.0;
/// Photos whose outlines choose among them.
const JUDGES: usize = 12;

/// How many photos show each place on the object.
#[derive(Debug)]
pub(super) struct Votes {
    grid: VoxelGrid,
    /// Share of the photos a voxel; 0 where it is small.
    shares: Vec<f32>,
    /// The share from which on a place belongs to the shape.
    agreement: f32,
}

/// A shape with the places that corrected photos decided.
#[derive(Clone, Debug)]
pub(super) struct AgreedShape {
    shape: VoxelSet,
    /// Places that they took away, and places that they put in.
    removed: VoxelSet,
    added: VoxelSet,
    /// Distances to its surface, once a picture of it was asked for.
    surface: OnceLock<ScalarGrid>,
}

/// A photo whose mask a person has corrected: what it shows is certain, to a pixel.
#[derive(Debug)]
pub(super) struct Corrected<'a> {
    view: &'a SeenView,
    outline: MaskOutline,
}

/// What a shape says of the pixels of a view.
#[derive(Debug)]
pub(super) struct Expected {
    /// The shape's outline.
    pub(super) outline: Mask,
    /// Pixels that show nothing but what corrected photos took away.
    pub(super) removed: Option<Mask>,
    /// Pixels that show what corrected photos put in.
    pub(super) added: Option<Mask>,
}

impl Votes {
    /// Of `masks`, one a view, within `around`. The shape is of as many as make its outlines most like theirs.
    pub(super) fn new(around: &VoxelSet, views: &[SeenView], masks: &[Mask]) -> Self {
        let places = around.members.iter().map(|i| around.grid.center(*i));
        let bounds = Aabb::from_points(places);
        let reach = 0.5 * bounds.extent().max_element() + 0.5 * around.grid.cell;
        let grid = VoxelGrid::around(bounds.center(), reach, N_VOXELS);
        let voters = voters(views.iter(), masks.iter());
        let share = |voxel: usize| {
            let p = grid.center(voxel);
            if around.contains_point(p) {
                vote(&voters, p, AGREEMENTS[0])
            } else {
                0.0
            }
        };
        let shares = (0..grid.len()).into_par_iter().map(share);
        let mut votes = Self {
            grid,
            shares: shares.collect(),
            agreement: 0.0,
        };
        let stride = views.len().div_ceil(JUDGES);
        let likeness = |agreement: f32| -> f32 {
            let shape = votes.voxels(agreement);
            let judges: Vec<_> = views.iter().zip(masks).step_by(stride).collect();
            let each = judges
                .par_iter()
                .map(|(view, mask)| agreement_of(&outline_of(&shape, &view.camera), mask));
            each.collect::<Vec<f32>>().iter().sum()
        };
        let scored = AGREEMENTS.map(|agreement| (agreement, likeness(agreement)));
        let best = scored.iter().max_by(|a, b| a.1.total_cmp(&b.1));
        votes.agreement = best.map_or(AGREEMENTS[0], |best| best.0);
        votes
    }

    fn voxels(&self, agreement: f32) -> VoxelSet {
        let voxels = (0..self.grid.len()).filter(|voxel| self.shares[*voxel] >= agreement);
        VoxelSet::of(self.grid, voxels)
    }

    /// The shape as most photos show it, and as corrected ones correct it.
    pub(super) fn shape(&self, corrected: &[Corrected<'_>]) -> AgreedShape {
        let shape = self.voxels(self.agreement);
        let is_beside = |voxel: &usize| {
            let p = self.grid.center(*voxel);
            corrected.iter().any(|photo| photo.is_beside(p))
        };
        let lost = (0..self.grid.len()).into_par_iter();
        let lost = lost
            .filter(|voxel| self.shares[*voxel] > 0.0)
            .filter(is_beside);
        let removed = VoxelSet::of(self.grid, lost.collect::<Vec<usize>>());
        let mut shape = shape.filtered(|voxel| !removed.contains(voxel));
        let mut added = VoxelSet::empty(self.grid);
        for photo in corrected {
            for voxel in photo.missing(&shape, |voxel| {
                (!removed.contains(voxel)).then(|| self.shares[voxel])
            }) {
                added.insert(voxel);
            }
        }
        for voxel in &added.members {
            shape.insert(*voxel);
        }
        AgreedShape {
            shape,
            removed,
            added,
            surface: OnceLock::new(),
        }
    }
}

impl AgreedShape {
    /// What it says of a view's pixels.
    pub(super) fn expected(&self, view: &SeenView) -> Expected {
        let outline = self.outline(&view.camera);
        let drawn =
            |set: &VoxelSet| (!set.members.is_empty()).then(|| outline_of(set, &view.camera));
        let mut removed = drawn(&self.removed);
        if let Some(removed) = &mut removed {
            let pairs = removed.coverage.iter_mut().zip(&outline.coverage);
            pairs.for_each(|(removed, outline)| *removed &= !outline);
        }
        Expected {
            removed,
            added: drawn(&self.added),
            outline,
        }
    }

    /// What a camera sees of it.
    pub(super) fn outline(&self, camera: &Camera) -> Mask {
        outline_of(&self.shape, camera)
    }

    /// The shape over a photo.
    pub(super) fn picture(&self, view: &View) -> GrowthPicture {
        let surface = self.surface.get_or_init(|| self.shape.distances());
        GrowthPicture::new(surface, view)
    }
}

impl Expected {
    /// What a mask says before the photos agree on a shape.
    pub(super) fn by(outline: Mask) -> Self {
        Self {
            outline,
            removed: None,
            added: None,
        }
    }
}

impl<'a> Corrected<'a> {
    /// With its mask, which has the pixels of the view as it was seen; `None` where that shows no outline.
    pub(super) fn new(view: &'a SeenView, mask: &Mask) -> Option<Self> {
        let outline = MaskOutline::new(mask, CERTAIN + 1.0)?;
        Some(Self { view, outline })
    }

    /// Whether a place is certainly beside the object.
    fn is_beside(&self, p: Vec3) -> bool {
        let at = self.view.place(p).filter(|at| self.view.has(*at));
        at.is_some_and(|at| self.outline.distance_at(at) < -CERTAIN)
    }

    /// For each pixel that certainly shows the object and not the shape: the place on its ray that most photos show on it, of
    /// those that have a share.
    fn missing(&self, shape: &VoxelSet, share: impl Fn(usize) -> Option<f32> + Sync) -> Vec<usize> {
        let (camera, grid) = (&self.view.camera, shape.grid);
        let bounds = grid.bounds();
        let pixels = (0..camera.width * camera.height).into_par_iter();
        let missing = pixels.filter_map(|i| {
            let at = Vec2::new((i % camera.width) as f32, (i / camera.width) as f32) + 0.5;
            if self.outline.distance_at(at) < CERTAIN {
                return None;
            }
            let ray = camera.ray(at.x, at.y);
            let voxels = along(&bounds, &ray, grid.cell).filter_map(|p| grid.index(p));
            let voxels: Vec<usize> = voxels.collect();
            if voxels.iter().any(|voxel| shape.contains(*voxel)) {
                return None;
            }
            let scored = voxels
                .iter()
                .filter_map(|voxel| Some((share(*voxel)?, *voxel)));
            let best = scored.max_by(|a, b| a.0.total_cmp(&b.0));
            best.map(|(_, voxel)| voxel)
        });
        missing.collect()
    }
}

/// Points along a ray within a box, no further apart than a cell.
fn along(bounds: &Aabb, ray: &Ray, cell: f32) -> impl Iterator<Item = Vec3> {
    let step = 0.7 * cell;
    let span = bounds.span(ray);
    let (near, n) = span.map_or((0.0, 0), |(near, far)| {
        (near, ((far - near) / step) as usize + 1)
    });
    let ray = *ray;
    (0..n).map(move |k| ray.at(near + k as f32 * step))
}

/// The views that vote, with their masks.
pub(super) fn voters<'a>(
    views: impl ExactSizeIterator<Item = &'a SeenView>,
    masks: impl Iterator<Item = &'a Mask>,
) -> Vec<(&'a SeenView, &'a Mask)> {
    let stride = views.len().div_ceil(VOTERS).max(1);
    views.zip(masks).step_by(stride).collect()
}

/// Share of the voters that show a place on the object, of those that have it in the picture; 0 where it is sure to be below
/// `least`.
pub(super) fn vote(voters: &[(&SeenView, &Mask)], p: Vec3, least: f32) -> f32 {
    let (mut n, mut n_object) = (0_u32, 0_u32);
    let most_against = (1.0 - least) * voters.len() as f32;
    for (view, mask) in voters {
        if let Some(pixel) = view.pixel(p) {
            n += 1;
            n_object += u32::from(mask.is_object(pixel));
            if (n - n_object) as f32 > most_against {
                return 0.0;
            }
        }
    }
    n_object as f32 / n.max(1) as f32
}

/// The pixels whose rays meet a set.
pub(super) fn outline_of(shape: &VoxelSet, camera: &Camera) -> Mask {
    let bounds = shape.grid.bounds();
    let meets = |ray: &Ray| along(&bounds, ray, shape.grid.cell).any(|p| shape.contains_point(p));
    let pixels = (0..camera.width * camera.height).map(|i| {
        let (x, y) = (i % camera.width, i / camera.width);
        meets(&camera.ray(x as f32 + 0.5, y as f32 + 0.5))
    });
    Mask {
        width: camera.width,
        height: camera.height,
        coverage: pixels.map(|is| 255 * u8::from(is)).collect(),
    }
}

/// Share of two masks' object pixels that they have in common, 0..1; 1 where both show none.
pub fn agreement_of(a: &Mask, b: &Mask) -> f32 {
    let (mut both, mut either) = (0, 0);
    for i in 0..a.coverage.len().min(b.coverage.len()) {
        both += usize::from(a.is_object(i) && b.is_object(i));
        either += usize::from(a.is_object(i) || b.is_object(i));
    }
    if either == 0 {
        return 1.0;
    }
    both as f32 / either as f32
}
