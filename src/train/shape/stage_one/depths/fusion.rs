//! A surface from depth maps: their truncated signed distances averaged on a grid (Curless and Levoy 1996), each along the
//! normal that its map shows, so that maps from all sides agree (Bylow et al. 2013 compare such distances).

use std::collections::HashMap;
use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use crate::data::{Dataset, DepthMap, DepthView, Mask, View};
use crate::geometry::{Aabb, Camera, Projector, ScalarGrid, nearest_point};
use crate::train::shape::stage_one::{GoOn, StageOneError, unless_cancelled};
use crate::train::statistics::middle;

/// Depth maps that are fused at most; of more, evenly spaced ones.
pub(super) const MOST_MAPS: usize = 240;
/// Depth maps in memory at once.
const BATCH: usize = 8;
/// Depth maps without which there is no shape.
pub(in super::super) const MIN_MAPS: usize = 3;
/// Depth maps that say where the object is.
const MAPS_FOR_BOUNDS: usize = 60;
/// Points of a map that do.
const POINTS_FOR_BOUNDS: usize = 4000;
/// Cells up to which distances are estimated from a map; noise and thickness are less.
pub(super) const REACH_CELLS: f32 = 4.0;
/// Weight from which what maps of photos show is believed: that of about so many that see the place squarely.
const SURE_WEIGHT: f32 = 2.0;
/// Pixels from a place in a map to those that say how its surface is turned.
const TURN_PX: f32 = 1.0;
/// Cosine of the angle to the view that a surface is taken to have at least.
const GRAZING: f32 = 0.15;
/// Reaches in front of the surface from which it does not matter how that is turned.
const CLEAR: f32 = 4.0;
/// Coverage from which a pixel's depth is the object's: at its edge, cameras measure something between.
const SOLID: f32 = 0.98;
/// Share of the points along an axis that may be errors, at either end.
const OUTLIERS: f32 = 0.002;
/// Without masks the object reaches so far from where the cameras look, in median distances of theirs from there.
const REACH_OF_LOOK: f32 = 0.5;
/// Share of the cameras that must see that point near their pictures' middle.
const LOOKING: f32 = 0.8;

/// Depths of what a training view shows.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Depths<'a> {
    map: Map<'a>,
    /// Where the object is in the map; anywhere without.
    mask: Option<&'a Mask>,
}

#[derive(Clone, Copy, Debug)]
enum Map<'a> {
    /// Read when it is needed, for pictures of the camera: many are too large to have at once.
    File(&'a DepthView, &'a Camera),
    Known(&'a DepthMap),
}

impl<'a> Depths<'a> {
    /// A map that is no file; `mask`: where it shows the object, or anywhere.
    pub(in super::super) fn known(map: &'a DepthMap, mask: Option<&'a Mask>) -> Self {
        Self {
            map: Map::Known(map),
            mask,
        }
    }
}

/// The training views with depth maps, evenly chosen where they are many.
pub(in super::super) fn depth_views(dataset: &Dataset) -> Vec<Depths<'_>> {
    let views = dataset.train.iter();
    let views: HashMap<&str, &View> = views.map(|view| (view.name.as_str(), view)).collect();
    let depths = dataset.origin.depths.iter();
    let found = depths.filter_map(|depth| {
        let view = views.get(depth.name.as_str())?;
        Some(Depths {
            map: Map::File(depth, &view.camera),
            mask: view.mask.as_ref(),
        })
    });
    evenly(&found.collect::<Vec<_>>(), MOST_MAPS)
}

/// At most `n` of the items, evenly chosen.
pub(super) fn evenly<T: Copy>(items: &[T], n: usize) -> Vec<T> {
    if items.len() <= n {
        return items.to_vec();
    }
    (0..n).map(|i| items[i * items.len() / n]).collect()
}

/// A depth map ready for points of the world.
struct Source<'a> {
    map: Arc<DepthMap>,
    projector: Projector,
    eye: Vec3,
    forward: Vec3,
    mask: Option<&'a Mask>,
}

impl<'a> Source<'a> {
    /// `None` where the file is of no use.
    fn read(depths: &Depths<'a>) -> Option<Self> {
        let Depths { map, mask } = depths;
        let map = match map {
            Map::File(depth, camera) => depth.read(camera).ok()?,
            Map::Known(map) => Arc::new((*map).clone()),
        };
        let camera = map.camera;
        Some(Self {
            projector: camera.projector(glam::Affine3A::IDENTITY),
            eye: camera.position(),
            forward: camera.forward(),
            mask: *mask,
            map,
        })
    }

    /// The object's share at a point of the map; 1 without a mask.
    fn share(&self, x_px: f32, y_px: f32) -> f32 {
        let Some(mask) = self.mask else {
            return 1.0;
        };
        let camera = &self.map.camera;
        let scaled = |at: f32, side: u32, mask_side: u32| {
            let at = at * mask_side as f32 / side as f32;
            (at.max(0.0) as usize).min(mask_side as usize - 1)
        };
        let x = scaled(x_px, camera.width, mask.width);
        let y = scaled(y_px, camera.height, mask.height);
        mask.share(y * mask.width as usize + x)
    }

    /// The place in the world that a place in the map shows.
    fn shown(&self, x_px: f32, y_px: f32) -> Option<Vec3> {
        let ray = self.map.camera.ray(x_px, y_px);
        let along = ray.direction.dot(self.forward).max(1e-3);
        Some(ray.at(self.map.at(x_px, y_px)? / along))
    }

    /// Cosine of the angle between the surface's normal there and the unit direction of view, at least [`GRAZING`]; `None`
    /// where the surface ends or hides another.
    fn facing(&self, x_px: f32, y_px: f32, direction: Vec3) -> Option<f32> {
        let across = self.shown(x_px + TURN_PX, y_px)? - self.shown(x_px - TURN_PX, y_px)?;
        let down = self.shown(x_px, y_px + TURN_PX)? - self.shown(x_px, y_px - TURN_PX)?;
        let normal = across.cross(down).try_normalize()?;
        Some(direction.dot(normal).abs().max(GRAZING))
    }

    /// Points of the object that it shows, at most [`POINTS_FOR_BOUNDS`].
    fn points(&self) -> Vec<Vec3> {
        let camera = &self.map.camera;
        let n_pixels = self.map.depths.len();
        let mut step = n_pixels.div_ceil(POINTS_FOR_BOUNDS).max(1);
        // No divisor of the width, or all points would lie in few columns.
        step += usize::from((camera.width as usize).is_multiple_of(step));
        let point = |i: usize| {
            let (x, y) = (i as u32 % camera.width, i as u32 / camera.width);
            let (x, y) = (x as f32 + 0.5, y as f32 + 0.5);
            let is_object = self.map.depths[i] > 0.0 && self.share(x, y) >= SOLID;
            self.shown(x, y).filter(|_| is_object)
        };
        (0..n_pixels).step_by(step).filter_map(point).collect()
    }
}

/// The box around what the depth maps show: of the object by its masks; without them, of what lies around the place that
/// the cameras look at, or of everything where they look at no one place. `None` where they show nothing.
pub(in super::super) fn bounds(dataset: &Dataset, views: &[Depths<'_>]) -> Option<Aabb> {
    let chosen = evenly(views, MAPS_FOR_BOUNDS);
    let sources = chosen.par_iter().filter_map(Source::read);
    let mut points: Vec<Vec3> = sources.flat_map_iter(|source| source.points()).collect();
    let has_masks = views.iter().any(|depths| depths.mask.is_some());
    if !has_masks && let Some((center, reach)) = looked_at(dataset) {
        points.retain(|p| (*p - center).abs().max_element() < reach);
    }
    if points.len() < 100 {
        return None;
    }
    let range: [(f32, f32); 3] = std::array::from_fn(|axis| {
        let mut along: Vec<f32> = points.iter().map(|p| p[axis]).collect();
        along.sort_unstable_by(f32::total_cmp);
        let skip = (OUTLIERS * along.len() as f32) as usize;
        (along[skip], along[along.len() - 1 - skip])
    });
    let (min, max) = (range.map(|r| r.0).into(), range.map(|r| r.1).into());
    let bounds = Aabb { min, max };
    // What is thin at an end is within the outliers.
    let margin = 0.04 * bounds.extent().max_element();
    Some(bounds.widened(margin))
}

/// Whether there are depth maps of something that the cameras stand around.
pub(in super::super) fn shows_object(dataset: &Dataset) -> bool {
    depth_views(dataset).len() >= MIN_MAPS && looked_at(dataset).is_some()
}

/// The place that the cameras look at and how far from it the object reaches; `None` where they look at no one place.
pub(in crate::train) fn looked_at(dataset: &Dataset) -> Option<(Vec3, f32)> {
    let cameras = || dataset.train.iter().map(|view| &view.camera);
    let axes: Vec<(Vec3, Vec3)> = cameras().map(|c| (c.position(), c.forward())).collect();
    let center = nearest_point(&axes);
    let sees = |view: &&View| {
        let camera = &view.camera;
        let (w, h) = (camera.width as f32, camera.height as f32);
        let seen = camera.project(center);
        seen.is_some_and(|p| (p.x / w - 0.5).abs() < 0.35 && (p.y / h - 0.5).abs() < 0.35)
    };
    let n_looking = dataset.train.iter().filter(sees).count();
    if (n_looking as f32) < LOOKING * dataset.train.len() as f32 {
        return None;
    }
    let mut distances: Vec<f32> = cameras().map(|c| c.position().distance(center)).collect();
    let has_cameras = !distances.is_empty();
    has_cameras.then(|| (center, REACH_OF_LOOK * middle(&mut distances)))
}

/// What depth maps say at the nodes of a grid.
#[derive(Debug)]
pub(in super::super) struct Seen {
    /// Maps that could be read.
    pub(in super::super) n_maps: usize,
    /// `[n]` distances in front of the surface, scene units, at most the reach; negative behind it.
    pub(in super::super) distances: Vec<f32>,
    /// `[n]` how sure they are: about as many as maps saw the place squarely, 0 where none did.
    pub(in super::super) weights: Vec<f32>,
    /// Mean standard error of the distances near the surface, scene units.
    pub(in super::super) noise: f32,
}

/// What the maps say of a node.
#[derive(Clone, Copy, Default)]
struct Node {
    /// Weighted sums of distances in front of the surface, in reaches, at most 1 each, and of their squares.
    sum: f32,
    squares: f32,
    weight: f32,
    n: u32,
    /// Maps that show something far in front of it, less those that know nothing there: depth cameras see no sky, and
    /// what lies before the sky hides nothing.
    n_hiding: i32,
}

impl Node {
    /// Standard error of the distance of a node near the surface, in reaches.
    fn uncertainty(&self) -> Option<f32> {
        let mean = self.sum / self.weight;
        let variance = (self.squares / self.weight - mean * mean).max(0.0);
        (self.n > 2 && mean.abs() < 0.5).then(|| (variance / self.n as f32).sqrt())
    }
}

/// Fills `grid` with distances to the surface that the maps show; what none of them sees is inside where something hides
/// it, and outside otherwise, as are nodes that are not wanted.
///
/// `is_wanted`: of a node, by its index; `is_late`: asked after each few maps, ends the work with what there is.
pub(in super::super) fn fill(
    views: &[Depths<'_>],
    grid: &mut ScalarGrid,
    is_wanted: &(dyn Fn(usize) -> bool + Sync),
    is_late: &dyn Fn() -> bool,
    go_on: GoOn<'_>,
    on_progress: &(dyn Fn(f32) + Sync),
) -> Result<Seen, StageOneError> {
    let reach = REACH_CELLS * grid.cell;
    let layer = grid.size[0] * grid.size[1];
    let mut nodes = vec![Node::default(); grid.values.len()];
    let mut n_maps = 0;
    // Neighbours in the list look alike: spread, what there is by the deadline shows all sides.
    let n_batches = views.len().div_ceil(BATCH);
    for batch in 0..n_batches {
        let of_batch: Vec<_> = views.iter().skip(batch).step_by(n_batches).collect();
        let sources = of_batch
            .par_iter()
            .filter_map(|depths| Source::read(depths));
        let sources: Vec<Source<'_>> = sources.collect();
        n_maps += sources.len();
        let frame = &*grid;
        let observed = nodes.par_iter_mut().enumerate().with_min_len(layer);
        let observed = observed.filter(|(i, _)| is_wanted(*i));
        observed.for_each(|(i, node)| {
            let point = frame.position(frame.place(i));
            for source in &sources {
                observe(node, source, point, reach);
            }
        });
        unless_cancelled(go_on)?;
        on_progress((batch + 1) as f32 / n_batches as f32);
        if is_late() {
            break;
        }
    }
    for (value, node) in grid.values.iter_mut().zip(&nodes) {
        *value = match node {
            Node { n: 0, n_hiding, .. } if *n_hiding > 0 => -reach,
            Node { n: 0, .. } => reach,
            Node { sum, weight, .. } => reach * sum / weight,
        };
    }
    let near: Vec<f32> = nodes.iter().filter_map(Node::uncertainty).collect();
    let noise = near.iter().copied().map(f64::from).sum::<f64>() / near.len().max(1) as f64;
    Ok(Seen {
        n_maps,
        distances: grid.values.clone(),
        weights: nodes.iter().map(|node| node.weight).collect(),
        noise: reach * noise as f32,
    })
}

/// What maps of photos show at the nodes of a grid like `frame` that are wanted, with weight 0 where that is not believed; the
/// other arguments are those of [`fill`].
pub(in super::super) fn sure(
    maps: &[DepthMap],
    frame: &ScalarGrid,
    is_wanted: &(dyn Fn(usize) -> bool + Sync),
    (is_late, go_on): (&dyn Fn() -> bool, GoOn<'_>),
) -> Result<Seen, StageOneError> {
    let views: Vec<_> = maps.iter().map(|map| Depths::known(map, None)).collect();
    let mut grid = frame.clone();
    let mut seen = fill(&views, &mut grid, is_wanted, is_late, go_on, &|_| ())?;
    let unsure = seen.weights.iter_mut().filter(|w| **w < SURE_WEIGHT);
    unsure.for_each(|weight| *weight = 0.0);
    Ok(seen)
}

/// Adds what a map says of a point.
fn observe(node: &mut Node, source: &Source<'_>, point: Vec3, reach: f32) {
    let along = source.forward.dot(point - source.eye);
    if along <= 0.0 {
        return;
    }
    let Some((pixel, _)) = source.projector.project(point) else {
        return;
    };
    let camera = &source.map.camera;
    let (width, height) = (camera.width as f32, camera.height as f32);
    if !(pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < width && pixel.y < height) {
        return;
    }
    // What the map shows beside the object is none of it; the hull is cut away later.
    if source.share(pixel.x, pixel.y) < 0.5 {
        return;
    }
    let Some(depth) = source.map.at(pixel.x, pixel.y) else {
        node.n_hiding -= 1;
        return;
    };
    let mut in_front = (depth - along) / reach;
    if in_front < -1.0 {
        node.n_hiding += 1;
        return;
    }
    let mut weight = 1.0;
    if in_front < CLEAR {
        // The nearest point of the surface lies along its normal, not along the axis.
        let to_point = (point - source.eye) / along;
        let length = to_point.length();
        let facing = source.facing(pixel.x, pixel.y, to_point / length);
        in_front *= length * facing.unwrap_or(1.0);
        weight = facing.unwrap_or(GRAZING).powi(2);
    }
    let in_front = in_front.min(1.0);
    node.sum += weight * in_front;
    node.squares += weight * in_front * in_front;
    node.weight += weight;
    node.n += 1;
}
