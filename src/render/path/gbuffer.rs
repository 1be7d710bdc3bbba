//! What a camera sees of the mesh, with antialiased edges; independent of material and light.

use std::ops::Range;

use glam::{Vec2, Vec3};

use super::trace::{
    MAX_VERTICES, PIXEL_SIDE, PathStore, PixelHit, Seen, trace_beam, trace_path, trace_pixel,
};
use crate::geometry::{Camera, SurfaceTracer};
use crate::neif::light::light_path::PathVertex;

/// Sub-samples per axis of a silhouette pixel.
pub(in crate::render) const SUBSAMPLES: usize = 4;

/// How finely and how far pixels are traced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathOptions {
    /// Most vertices of a path, in `1..=MAX_VERTICES`.
    pub max_vertices: usize,
    /// Least paths of a pixel that the object covers, a power of 2.
    pub least: usize,
    /// Most paths of a pixel, a power of 2 in `1..=16`.
    pub most: usize,
    /// Turn of the mirror direction from one side of a path's beam to the other, radians, above which a pixel gets more of them.
    pub largest_turn: f32,
}

impl PathOptions {
    /// One path a pixel, two or four where that is not enough: for pictures in motion.
    pub const PLAIN: Self = Self {
        max_vertices: MAX_VERTICES,
        least: 1,
        most: 4,
        largest_turn: 0.25,
    };
    /// Four paths a pixel, up to sixteen where that is not enough: for pictures that stay. A reflection in a curved mirror is
    /// smaller than the mirror; one path a pixel measured 0.7 dB worse over all object pixels.
    pub const FINE: Self = Self {
        max_vertices: MAX_VERTICES,
        least: 4,
        most: 16,
        largest_turn: 0.03,
    };

    /// Paths per axis of a pixel that the silhouette passes.
    fn edge_side(self) -> usize {
        if self.most < 16 { 2 } else { 4 }
    }
}

/// Traced pixels of some rows of a camera's image.
#[derive(Clone, Debug, Default)]
pub struct GBuffer {
    eye: Vec3,
    first: u32,
    coverage: Vec<f32>,
    /// `[n + 1]`: where each pixel's paths start.
    starts: Vec<u32>,
    paths: PathStore,
}

impl GBuffer {
    /// Traces `rows` of the camera's image; without a tracer nothing is covered.
    pub fn trace(
        tracer: Option<&SurfaceTracer>,
        camera: &Camera,
        rows: Range<u32>,
        options: PathOptions,
    ) -> Self {
        match tracer {
            Some(tracer) => Self::trace_some(tracer, camera, rows, options, |_| true),
            None => Self::uncovered(camera, &rows),
        }
    }

    /// Traces those pixels of `rows` whose index in the whole image is wanted; the others count as not covered.
    pub fn trace_some(
        tracer: &SurfaceTracer,
        camera: &Camera,
        rows: Range<u32>,
        options: PathOptions,
        is_wanted: impl Fn(u32) -> bool,
    ) -> Self {
        let mut buffer = Self::uncovered(camera, &rows);
        buffer.fill(tracer, camera, rows, options, is_wanted);
        buffer
    }

    fn uncovered(camera: &Camera, rows: &Range<u32>) -> Self {
        let n = rows.len() * camera.width as usize;
        Self {
            eye: camera.position(),
            first: rows.start * camera.width,
            coverage: vec![0.0; n],
            starts: vec![0; n + 1],
            paths: PathStore::default(),
        }
    }

    /// Where the camera stands.
    pub fn eye(&self) -> Vec3 {
        self.eye
    }

    /// Share of each pixel that the object covers, `[0, 1]`, of the traced rows.
    pub fn coverage(&self) -> &[f32] {
        &self.coverage
    }

    /// The light paths of a pixel (index in the whole image), all of the same weight; none where no object is seen.
    pub fn paths_at(&self, pixel: u32) -> impl Iterator<Item = &[PathVertex]> {
        let i = (pixel - self.first) as usize;
        (self.starts[i]..self.starts[i + 1]).map(|path| self.paths.path(path as usize))
    }

    fn fill(
        &mut self,
        tracer: &SurfaceTracer,
        camera: &Camera,
        rows: Range<u32>,
        options: PathOptions,
        is_wanted: impl Fn(u32) -> bool,
    ) {
        let width = camera.width as usize;
        let centers = Centers::trace(tracer, camera, rows.clone(), |i| is_wanted(self.first + i));
        let mut points = Vec::new();
        let mut path = [PathVertex::default(); MAX_VERTICES];
        for i in 0..self.coverage.len() {
            points.clear();
            if is_wanted(self.first + i as u32) {
                let (x, y) = ((i % width) as f32, (rows.start as usize + i / width) as f32);
                self.coverage[i] = match centers.kind(i) {
                    PixelKind::Empty => 0.0,
                    PixelKind::Edge => {
                        subsample_edge(tracer, camera, (x, y), options.edge_side(), &mut points)
                    }
                    PixelKind::Inner => {
                        let turn = centers.turn(i);
                        match turn.paths(options) {
                            [1, 1] => points.extend(centers.at(i).copied()),
                            n => subsample(tracer, camera, (x, y), (turn.axis, n), &mut points),
                        }
                        1.0
                    }
                };
            }
            // A turn that varies from pixel to pixel spreads the few lobe rays (golden angle).
            // It depends on the place in the picture alone, not on the rows traced together.
            let turn = ((self.first as usize + i) % 4096) as f32 * 2.399_963;
            for (k, point) in points.iter().enumerate() {
                let turn = turn + k as f32;
                let path = trace_path(tracer, point, turn, &mut path, options.max_vertices);
                self.paths.push(path);
            }
            self.starts[i + 1] = self.paths.n_paths() as u32;
        }
    }
}

/// What the rays through the pixels' centres met, and one row more on each side.
struct Centers {
    width: usize,
    /// By pixel, which of `points`; [`NOTHING`] where no object was met or looked for.
    at: Vec<u32>,
    points: Vec<Seen>,
}

/// No point.
const NOTHING: u32 = u32::MAX;

/// How a pixel compares with its four neighbours.
enum PixelKind {
    /// No object here or beside.
    Empty,
    /// The object's silhouette passes here or beside.
    Edge,
    /// Object all around.
    Inner,
}

/// How the mirror direction turns from a pixel to its neighbours.
struct Turn {
    /// The direction in the picture in which it turns fastest, unit.
    axis: Vec2,
    /// By how much a pixel along the axis and across it, radians (where it is small).
    by: [f32; 2],
}

impl Turn {
    /// From the larger of the differences to either side along x and along y.
    fn new(dx: Vec3, dy: Vec3) -> Self {
        let (xx, xy, yy) = (dx.length_squared(), dx.dot(dy), dy.length_squared());
        let (mean, apart) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
        Self {
            axis: Vec2::from_angle(0.5 * (2.0 * xy).atan2(xx - yy)),
            by: [mean + apart, (mean - apart).max(0.0)].map(f32::sqrt),
        }
    }

    /// Paths along the axis and across it: halves of what is widest until it is narrow enough.
    fn paths(&self, options: PathOptions) -> [usize; 2] {
        let (mut n, mut by) = ([1, 1], self.by);
        while 2 * n[0] * n[1] <= options.most {
            let is_narrow = by[0].max(by[1]) <= options.largest_turn;
            if is_narrow && n[0] * n[1] >= options.least {
                break;
            }
            let wider = usize::from(by[1] > by[0]);
            n[wider] *= 2;
            by[wider] *= 0.5;
        }
        n
    }
}

impl Centers {
    /// Traces the wanted pixels (by index in `rows`) and their neighbours.
    fn trace(
        tracer: &SurfaceTracer,
        camera: &Camera,
        rows: Range<u32>,
        is_wanted: impl Fn(u32) -> bool,
    ) -> Self {
        let width = camera.width as usize;
        let (n, row) = ((rows.len() * width) as i64, width as i64);
        let wanted = |i: i64| (0..n).contains(&i) && is_wanted(i as u32);
        let mut points = Vec::new();
        let at = (-row..n + row).map(|i| {
            let is_near = [0, -1, 1, -row, row].iter().any(|step| wanted(i + step));
            let x = i.rem_euclid(row) as f32 + 0.5;
            let y = (i64::from(rows.start) + i.div_euclid(row)) as f32 + 0.5;
            let seen = is_near.then(|| trace_pixel(tracer, camera, (x, y), 1.0));
            seen.flatten().map_or(NOTHING, |seen| {
                points.push(seen);
                points.len() as u32 - 1
            })
        });
        Self {
            width,
            at: at.collect(),
            points,
        }
    }

    /// The point seen at pixel `i`, from the row before the first.
    fn point(&self, i: usize) -> Option<&Seen> {
        self.points.get(self.at[i] as usize)
    }

    fn at(&self, i: usize) -> Option<&Seen> {
        self.point(i + self.width)
    }

    /// Pixels beside pixel `i`, from the row before the first.
    fn beside(&self, i: usize) -> [usize; 4] {
        beside(i + self.width, [self.width, self.at.len() / self.width])
    }

    fn kind(&self, i: usize) -> PixelKind {
        let is_seen = self.at(i).is_some();
        let is_alike = |j: usize| self.point(j).is_some() == is_seen;
        match (self.beside(i).into_iter().all(is_alike), is_seen) {
            (false, _) => PixelKind::Edge,
            (true, true) => PixelKind::Inner,
            (true, false) => PixelKind::Empty,
        }
    }

    fn turn(&self, i: usize) -> Turn {
        let mirrored = |seen: &Seen| seen.point.reflected();
        let center = self.at(i).map_or(Vec3::ZERO, mirrored);
        let [above, below, left, right] = self.beside(i).map(|j| {
            self.point(j)
                .map_or(Vec3::ZERO, |seen| mirrored(seen) - center)
        });
        let larger = |back: Vec3, on: Vec3| {
            if on.length_squared() < back.length_squared() {
                -back
            } else {
                on
            }
        };
        Turn::new(larger(left, right), larger(above, below))
    }
}

/// Pixels above, below, to the left and to the right of pixel `i` of a picture of so many columns and rows; itself beside the picture.
pub(in crate::render) fn beside(i: usize, [width, height]: [usize; 2]) -> [usize; 4] {
    let (x, y) = (i % width, i / width);
    [
        i - width * usize::from(y > 0),
        i + width * usize::from(y + 1 < height),
        i - usize::from(x > 0),
        i + usize::from(x + 1 < width),
    ]
}

/// The points seen through the beams of pixel `(x, y)`: so many along the axis and across it.
fn subsample(
    tracer: &SurfaceTracer,
    camera: &Camera,
    (x, y): (f32, f32),
    (axis, n): (Vec2, [usize; 2]),
    points: &mut Vec<Seen>,
) {
    let sides = [axis, axis.perp()];
    let beam = [0, 1].map(|k| sides[k] / n[k] as f32);
    for k in 0..n[0] * n[1] {
        let share = |i: usize, n: usize| PIXEL_SIDE * ((i as f32 + 0.5) / n as f32 - 0.5);
        let offset = share(k % n[0], n[0]) * sides[0] + share(k / n[0], n[1]) * sides[1];
        let at_px = Vec2::new(x + 0.5, y + 0.5) + offset;
        points.extend(trace_beam(tracer, camera, at_px, beam));
    }
}

/// Coverage of pixel `(x, y)`; in each of its `n` by `n` squares the hit nearest to the covered part's centre.
pub(in crate::render) fn subsample_edge(
    tracer: &SurfaceTracer,
    camera: &Camera,
    (x, y): (f32, f32),
    n: usize,
    points: &mut Vec<Seen>,
) -> f32 {
    let n_inside = SUBSAMPLES / n;
    let mut hits = Vec::with_capacity(n_inside * n_inside);
    let mut n_hits = 0;
    for square in 0..n * n {
        hits.clear();
        for k in 0..n_inside * n_inside {
            let share = |s: usize, i: usize| ((s * n_inside + i) as f32 + 0.5) / SUBSAMPLES as f32;
            let place = Vec2::new(
                share(square % n, k % n_inside),
                share(square / n, k / n_inside),
            );
            let at_px = Vec2::new(x + 0.5, y + 0.5) + (place - 0.5) * PIXEL_SIDE;
            hits.extend(PixelHit::trace(tracer, camera, at_px).map(|hit| (at_px, hit)));
        }
        let sum: Vec2 = hits.iter().map(|hit| hit.0).sum();
        let mean = sum / hits.len().max(1) as f32;
        let distance = |at_px: Vec2| at_px.distance_squared(mean);
        let nearest = hits
            .iter()
            .min_by(|a, b| distance(a.0).total_cmp(&distance(b.0)));
        let sides = Vec2::AXES.map(|axis| axis / n as f32);
        points.extend(nearest.map(|(at_px, hit)| hit.seen(tracer, camera, *at_px, sides)));
        n_hits += hits.len();
    }
    n_hits as f32 / (SUBSAMPLES * SUBSAMPLES) as f32
}

#[cfg(test)]
mod tests {
    use super::super::trace::PIXEL_STD;
    use super::*;
    use crate::render::test_scene::{camera, scene};

    #[test]
    fn a_pixel_has_more_paths_along_the_axis_on_which_its_mirror_image_turns() {
        let taught = PathOptions {
            least: 1,
            most: 8,
            largest_turn: 0.08,
            ..PathOptions::PLAIN
        };
        // By 0.4 rad a pixel down the diagonal, and not at all across.
        let side = 0.4 / 2.0_f32.sqrt();
        let squeezed = Turn::new(side * Vec3::Z, side * Vec3::Z);
        assert!(squeezed.axis.distance(Vec2::ONE.normalize()) < 1e-5);
        assert!((squeezed.by[0] - 0.4).abs() < 1e-6 && squeezed.by[1] < 1e-3);
        assert_eq!(squeezed.paths(taught), [8, 1]);
        assert_eq!(squeezed.paths(PathOptions::FINE), [16, 1]);
        assert_eq!(squeezed.paths(PathOptions::PLAIN), [2, 1]);
        let round = Turn::new(0.1 * Vec3::X, 0.15 * Vec3::Y);
        assert!(round.axis.abs().distance(Vec2::Y) < 1e-5);
        assert_eq!(round.paths(taught), [2, 2]);
        let flat = Turn::new(1e-3 * Vec3::X, 1e-3 * Vec3::Y);
        assert_eq!(flat.paths(taught), [1, 1]);
        assert_eq!(flat.paths(PathOptions::FINE), [2, 2]);
    }

    #[test]
    fn beams_of_a_pixel_cover_what_it_averages() {
        let scene = scene();
        let tracer = &scene.object.as_ref().expect("an object").tracer;
        let camera = camera(40, 30);
        let (x, y) = (20.0, 15.0);
        let mut seen = Vec::new();
        let axis = Vec2::from_angle(0.7);
        subsample(tracer, &camera, (x, y), (axis, [8, 2]), &mut seen);
        assert_eq!(seen.len(), 16);
        let at: Vec<Vec2> = seen
            .iter()
            .filter_map(|seen| camera.project(seen.point.position))
            .collect();
        let center = Vec2::new(x + 0.5, y + 0.5);
        let mean = at.iter().sum::<Vec2>() / 16.0;
        assert!(mean.distance(center) < 1e-3, "{mean} is not {center}");
        for (direction, n) in [(axis, 8.0), (axis.perp(), 2.0)] {
            let square = |at: &Vec2| (*at - center).dot(direction).powi(2);
            let between = at.iter().map(square).sum::<f32>() / 16.0;
            // Each beam is as much narrower, so that together they have the pixel's variance.
            let all = between + (PIXEL_STD / n).powi(2);
            assert!((all.sqrt() - PIXEL_STD).abs() < 1e-3, "{}", all.sqrt());
        }
    }
}
