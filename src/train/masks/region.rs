//! The part of space that the object takes up: what stands out from its support, in one piece, where it was looked for.

use glam::Vec3;
use rayon::prelude::*;

use super::agreed::{outline_of, vote, voters};
use super::seen::SeenView;
use super::selection::Selection;
use super::voxels::{VoxelGrid, VoxelSet};
use crate::data::Mask;
use crate::geometry::Aabb;
use crate::train::shape::support_plane::{self, Plane, Support};
use crate::train::statistics::middle;

/// Largest reach of an object as a share of the cameras' distance, and of what a photo shows at that distance.
const REACH: f32 = 0.45;
const REACH_OF_PHOTO: f32 = 0.8;
/// Reaches around the object in which its support is looked for.
const SUPPORT_WITHIN: [f32; 2] = [1.2, 1.8];
/// Half the side of the grid, in reaches.
const GRID_REACH: f32 = 1.9;
/// Voxels along an axis.
const N_VOXELS: usize = 160;
/// Standard deviations of the support's points below which nothing stands out from it.
const STANDS_OUT: f32 = 2.5;
/// The same height times this is where parts are told apart: lower, things that stand side by side are joined by their shadows.
const APART: f32 = 3.0;
/// Points of the surface that make a voxel, as a share of what one photo that looks straight at it shows.
const LEAST_POINTS: f32 = 1.0;
/// Share of the photos that must have a place in the picture, or it is not what they were taken of.
const SHOWN: f32 = 0.5;
/// Share of the photos that show a place on the object, from which on it is inside the object.
const INSIDE: f32 = 0.7;
/// How near to a point on it, or to the middle of what the cameras look at, most of it is, in reaches.
const POINTED: f32 = 0.1;
const LOOKED_AT: f32 = 0.4;
/// Height in margins down to which it is cleared.
const CLEARED_FROM: f32 = 0.7;
/// Voxels around the object that are cleared with it: its surface is as thick.
const CLEARED: usize = 2;
/// Voxels from the region within which all photos' shape is looked for.
const NEAR: usize = 5;

/// What the object stands out from.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Ground {
    support: Option<Support>,
    /// Height from which on something stands out, scene units.
    margin: f32,
}

impl Ground {
    /// Below what is around `center`; `pixel` is the width of one there, scene units.
    fn below(views: &[SeenView], center: Vec3, reach: f32, pixel: f32) -> Self {
        let eyes: Vec<Vec3> = views.iter().map(|view| view.camera.position()).collect();
        let supports = SUPPORT_WITHIN.iter().filter_map(|share| {
            let near = |p: &Vec3| p.distance(center) < share * reach;
            support_plane::find(
                &points(views).filter(near).collect::<Vec<_>>(),
                &eyes,
                reach,
            )
        });
        let support = supports.max_by(|a, b| a.share.total_cmp(&b.share));
        let scatter = support.map_or(0.0, |support| support.scatter);
        Self {
            support,
            margin: (STANDS_OUT * scatter).max(pixel),
        }
    }

    /// Height of a point in margins; infinite where there is no ground.
    fn margins(&self, p: Vec3) -> f32 {
        let height = self
            .support
            .map_or(f32::INFINITY, |support| support.plane.height(p));
        height / self.margin
    }
}

/// The surfaces that the views see, on a grid.
struct Surfaces {
    grid: VoxelGrid,
    /// Points of the views in each voxel that stand out from the ground.
    counts: Vec<u32>,
    /// Voxels with enough of them.
    solid: VoxelSet,
}

impl Surfaces {
    fn new(
        views: &[SeenView],
        (grid, ground): (VoxelGrid, &Ground),
        pixel: f32,
        within: Option<Aabb>,
    ) -> Self {
        let mut counts = vec![0_u32; grid.len()];
        for p in points(views).filter(|p| ground.margins(*p) > 0.5) {
            if let Some(voxel) = grid.index(p) {
                counts[voxel] += 1;
            }
        }
        let least = (LEAST_POINTS * (grid.cell / pixel).powi(2)).max(2.0) as u32;
        let is_solid = |voxel: &usize| {
            let p = grid.center(*voxel);
            let is_allowed = within.is_none_or(|within| within.contains(p));
            counts[*voxel] >= least && is_allowed && is_shown(views, p)
        };
        let voxels = (0..grid.len()).into_par_iter();
        let solid: Vec<usize> = voxels.filter(is_solid).collect();
        Self {
            grid,
            solid: VoxelSet::of(grid, solid),
            counts,
        }
    }

    /// How much of a set is about `spread` or less from `aim`.
    fn near(&self, set: &VoxelSet, aim: Vec3, spread: f32) -> f32 {
        let weight = |voxel: &usize| {
            let off = self.grid.center(*voxel).distance(aim) / spread;
            self.counts[*voxel] as f32 * (-off * off).exp()
        };
        set.members.iter().map(weight).sum()
    }
}

/// Where the object is.
#[derive(Debug, PartialEq)]
pub(super) struct Region {
    voxels: VoxelSet,
    ground: Ground,
}

impl Region {
    /// The region around `center` that the views show, with the parts that have half of the points in one of `added`; `None` where
    /// nothing is there.
    pub(super) fn find(
        views: &[SeenView],
        center: Vec3,
        selection: &Selection,
        added: &[Vec<Vec3>],
    ) -> Option<Self> {
        let (reach, pixel) = sizes(views, center);
        let ground = Ground::below(views, center, reach, pixel);
        let grid = VoxelGrid::around(center, GRID_REACH * reach, N_VOXELS);
        let surfaces = Surfaces::new(views, (grid, &ground), pixel, selection.within);
        let is_high = |voxel: usize| ground.margins(grid.center(voxel)) > APART;
        let high = surfaces.solid.filtered(is_high).grown(1).filtered(is_high);
        let aim = selection.at.unwrap_or(center);
        let spread = if selection.at.is_some() {
            POINTED * reach
        } else {
            LOOKED_AT * reach
        };
        let parts = high.parts();
        let scored = parts
            .iter()
            .map(|part| (surfaces.near(part, aim, spread), part));
        let best = scored.max_by(|a, b| a.0.total_cmp(&b.0));
        let (_, best) = best.filter(|(score, _)| *score > 0.0)?;
        // Down from there it is whatever is right below and beside.
        let foot = (APART * ground.margin / grid.cell).ceil() as usize + 2;
        let near_solid = surfaces.solid.grown(1);
        let whole = |part: &VoxelSet| {
            let mut whole = part.clone();
            for voxel in part.grown(foot).members {
                let height = ground.margins(grid.center(voxel));
                if near_solid.contains(voxel) && height > 0.0 && height <= APART {
                    whole.insert(voxel);
                }
            }
            whole
        };
        let mut voxels = whole(best);
        for points in added {
            let is_meant = |part: &VoxelSet| {
                let around = part.grown(1);
                let has = points.iter().filter(|p| around.contains_point(**p));
                2 * has.count() > points.len()
            };
            let joined = parts.iter().map(whole).find(is_meant);
            for voxel in joined.into_iter().flat_map(|part| part.members) {
                voxels.insert(voxel);
            }
        }
        Some(Self { voxels, ground })
    }

    /// The region around `center` that most of `masks`, one a view where there is one, show; `None` where they show nothing there.
    pub(super) fn of_masks(
        views: &[SeenView],
        center: Vec3,
        masks: &[Option<Mask>],
    ) -> Option<Self> {
        let (reach, pixel) = sizes(views, center);
        let ground = Ground::below(views, center, reach, pixel);
        let grid = VoxelGrid::around(center, GRID_REACH * reach, N_VOXELS);
        let voxels = (0..grid.len()).into_par_iter();
        let masked = views.iter().zip(masks).filter(|(_, mask)| mask.is_some());
        let masked: Vec<&SeenView> = masked.map(|(view, _)| view).collect();
        let voters = voters(masked.into_iter(), masks.iter().flatten());
        let is_inside = |voxel: &usize| {
            let p = grid.center(*voxel);
            is_shown(views, p) && vote(&voters, p, INSIDE) > INSIDE
        };
        let inside: Vec<usize> = voxels.filter(is_inside).collect();
        let voxels = VoxelSet::of(grid, inside);
        (!voxels.members.is_empty()).then_some(Self { voxels, ground })
    }

    /// The outline of the region in a view.
    pub(super) fn outline_in(&self, view: &SeenView) -> Mask {
        outline_of(&self.voxels, &view.camera)
    }

    /// What the object stands on.
    pub(super) fn support(&self) -> Option<Plane> {
        self.ground.support.map(|support| support.plane)
    }

    /// The pixels whose surface is the object's; single ones at its edge are left out.
    pub(super) fn shown_in(&self, view: &SeenView) -> Mask {
        let is_object = |p: &Vec3| self.voxels.contains_point(*p) && self.ground.margins(*p) > 0.5;
        let shown: Vec<bool> = view.points.iter().map(is_object).collect();
        opened(&shown, view.camera.width, view.camera.height)
    }

    /// What must be empty for the photos to show the environment alone: the object, what `masks` say is in its inside, and a
    /// little around it, over the support.
    pub(super) fn cleared(&self, views: &[SeenView], masks: &[Mask]) -> impl Fn(Vec3) -> bool {
        let grid = self.voxels.grid;
        let voters = voters(views.iter(), masks.iter());
        let around = bounded(&self.voxels);
        let inside: Vec<usize> = around
            .into_par_iter()
            .filter(|voxel| vote(&voters, grid.center(*voxel), INSIDE) > INSIDE)
            .collect();
        let mut cleared = self.voxels.clone();
        for voxel in inside {
            cleared.insert(voxel);
        }
        let cleared = cleared.grown(CLEARED);
        let ground = self.ground;
        move |p| cleared.contains_point(p) && ground.margins(p) > CLEARED_FROM
    }

    /// Where the shape on which the photos agree is looked for.
    pub(super) fn around(&self) -> VoxelSet {
        self.voxels.grown(NEAR)
    }
}

fn points(views: &[SeenView]) -> impl Iterator<Item = Vec3> {
    views.iter().flat_map(|view| view.points.iter().copied())
}

/// How far from `center` an object can reach, and how wide a pixel is there, scene units.
fn sizes(views: &[SeenView], center: Vec3) -> (f32, f32) {
    let of_views = |value: &dyn Fn(&SeenView) -> f32| {
        let mut values: Vec<f32> = views.iter().map(value).collect();
        middle(&mut values)
    };
    let distance = of_views(&|view| view.camera.position().distance(center));
    let half_width = of_views(&|view| {
        let shorter = view.camera.width.min(view.camera.height);
        0.5 * shorter as f32 * view.camera.pixel_angle()
    });
    let pixel = of_views(&|view| view.camera.pixel_angle() * distance);
    (distance * REACH.min(REACH_OF_PHOTO * half_width), pixel)
}

/// Whether a place is in the picture of enough views.
fn is_shown(views: &[SeenView], p: Vec3) -> bool {
    let shown = views.iter().filter(|view| view.pixel(p).is_some());
    shown.count() as f32 >= SHOWN * views.len() as f32
}

/// The voxels of the box around a set.
fn bounded(set: &VoxelSet) -> Vec<usize> {
    let places = set.members.iter().map(|voxel| set.grid.center(*voxel));
    let mut bounds = Aabb::from_points(places);
    bounds.min -= 0.5 * set.grid.cell;
    bounds.max += 0.5 * set.grid.cell;
    let voxels = (0..set.grid.len()).into_par_iter();
    voxels
        .filter(|voxel| bounds.contains(set.grid.center(*voxel)))
        .collect()
}

/// Without pixels that are not part of a cross of five (a morphological opening).
fn opened(shown: &[bool], width: u32, height: u32) -> Mask {
    let (w, h) = (width as usize, height as usize);
    let cross = |i: usize| {
        let (x, y) = (i % w, i / w);
        let beside = [
            (x > 0).then(|| i - 1),
            (x + 1 < w).then(|| i + 1),
            (y > 0).then(|| i - w),
            (y + 1 < h).then(|| i + w),
        ];
        beside.into_iter().flatten()
    };
    let core: Vec<bool> = (0..shown.len())
        .map(|i| shown[i] && cross(i).all(|j| shown[j]))
        .collect();
    let coverage = (0..shown.len()).map(|i| core[i] || cross(i).any(|j| core[j]));
    Mask {
        width,
        height,
        coverage: coverage.map(|is| 255 * u8::from(is)).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::masks::agreed::Votes;
    use crate::train::masks::test_capture::{BALLS, RADII, cameras, likeness, place};

    fn views() -> Vec<SeenView> {
        let environment = place().environment;
        let cameras = cameras().into_iter();
        cameras
            .map(|camera| SeenView::new(&environment, &camera))
            .collect()
    }

    fn likeness_to(views: &[SeenView], masks: &[Mask], ball: usize) -> f32 {
        likeness(views.iter().map(|view| &view.camera), masks, &[ball])
    }

    #[test]
    fn of_two_balls_the_one_is_found_that_was_looked_for() {
        let views = views();
        for ball in [0, 1] {
            let at = (ball == 1).then_some(BALLS[1] + RADII[1] * Vec3::Z);
            let selection = Selection {
                at,
                ..Selection::default()
            };
            let center = at.unwrap_or(BALLS[0]);
            let region = Region::find(&views, center, &selection, &[]).expect("a ball");
            let support = region.support().expect("a floor");
            assert!(support.normal.z > 0.99, "{support:?}");
            let shown: Vec<Mask> = views.iter().map(|view| region.shown_in(view)).collect();
            let likeness_shown = likeness_to(&views, &shown, ball);
            assert!(likeness_shown > 0.6, "{likeness_shown}");
            // Cells are as wide as a fifth of a ball; what all photos agree on is no worse.
            let agreed = Votes::new(&region.around(), &views, &shown).shape(&[]);
            let outline = |view: &SeenView| agreed.expected(view).outline;
            let agreed: Vec<Mask> = views.iter().map(outline).collect();
            assert!(likeness_to(&views, &agreed, ball) > 0.95 * likeness_shown);
            let cleared = region.cleared(&views, &shown);
            assert!(cleared(BALLS[ball]), "the inside too");
            assert!(!cleared(BALLS[1 - ball]) && !cleared(Vec3::new(0.0, 0.0, -0.5)));
        }
    }

    #[test]
    fn a_box_around_one_ball_leaves_the_other_out() {
        let views = views();
        let within = Some(Aabb {
            min: BALLS[1] - 0.2,
            max: BALLS[1] + 0.2,
        });
        let selection = Selection {
            within,
            ..Selection::default()
        };
        let region = Region::find(&views, BALLS[1], &selection, &[]).expect("a ball");
        let shown: Vec<Mask> = views.iter().map(|view| region.shown_in(view)).collect();
        assert!(likeness_to(&views, &shown, 1) > 0.6);
    }

    #[test]
    fn where_nothing_stands_nothing_is_found() {
        let selection = Selection::default();
        let far = Vec3::new(0.0, -40.0, 3.0);
        assert!(Region::find(&views(), far, &selection, &[]).is_none());
    }
}
