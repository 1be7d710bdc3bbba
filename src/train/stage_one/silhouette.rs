//! What a mask says about the object's shape: its outline, and distances to it.

use glam::{Affine3A, Vec2, Vec3};

use crate::data::{Mask, View};
use crate::geometry::{Camera, Ray};

/// A mask of values between nothing and all at fewer of its edge pixels than this share is taken as
/// cut hard; its outline is a staircase that must be smoothed.
const SOFT_SHARE: f32 = 0.3;

/// The outline of one view's mask.
#[derive(Debug)]
pub(super) struct Silhouette {
    pub(super) camera: Camera,
    camera_from_world: Affine3A,
    /// Middles of the outline's pieces, about one a pixel, in pixels. Where the picture ends the
    /// object is cut, and there is no outline.
    pub(super) outline: Vec<Vec2>,
    /// Places on the object, evenly, in pixels: all of its rays should meet it.
    pub(super) inner: Vec<Vec2>,
    /// `[height * width]` distance of each pixel's centre to the outline in pixels, positive on
    /// the object; cut at [`FAR_PX`] either way.
    distance: Vec<f32>,
}

/// Where distances end, pixels.
const FAR_PX: f32 = 1e4;
/// Most places on the object whose rays are asked for, about one for every other cell that it covers.
const MOST_INNER: usize = 8_000;
/// Pixels from the outline within which rays are not: cameras err by as much.
const RIM_PX: f32 = 1.5;

/// A piece of the outline, in pixels.
type Piece = [Vec2; 2];

impl Silhouette {
    /// The silhouette of a view; `None` without a mask or where it shows nothing of the object's edge.
    pub(super) fn new(view: &View) -> Option<Self> {
        let mask = view.mask.as_ref()?;
        let soft = softened(mask);
        let (width, height) = (mask.width as usize, mask.height as usize);
        let pieces = outline_pieces(&soft, width, height);
        if pieces.is_empty() {
            return None;
        }
        let distance = distances(&soft, width, height, &pieces);
        let inner = inner_places(&distance, width);
        Some(Self {
            camera: view.camera,
            camera_from_world: view.camera.world_from_camera.inverse(),
            outline: pieces.iter().map(|[a, b]| 0.5 * (*a + *b)).collect(),
            inner,
            distance,
        })
    }

    /// The ray through a point of the outline.
    pub(super) fn ray(&self, at: Vec2) -> Ray {
        self.camera.ray(at.x, at.y)
    }

    /// The distance to the outline in pixels where `p` appears, positive on the object. Beside the
    /// picture the object is not, unless the picture's border cuts it there; `None` where it does,
    /// and for what the lens does not see.
    fn distance_px(&self, p: Vec3) -> Option<f32> {
        let pixel = self.project(p)?;
        let (width, height) = (self.camera.width, self.camera.height);
        let end = Vec2::new((width - 1) as f32, (height - 1) as f32);
        let beside = (pixel - 0.5).distance((pixel - 0.5).clamp(Vec2::ZERO, end));
        let within = self.interpolated(pixel.x - 0.5, pixel.y - 0.5);
        // Half a pixel of the border is still in the picture.
        if beside > 0.75 && within > -1.0 {
            return None;
        }
        Some(within - beside)
    }

    /// As [`Camera::project`], without inverting the pose each time.
    fn project(&self, p: Vec3) -> Option<Vec2> {
        if !self.camera.distortion.is_none() {
            return self.camera.project(p);
        }
        let p = self.camera_from_world.transform_point3(p);
        let camera = &self.camera;
        let pixel =
            Vec2::new(camera.fx * p.x, -camera.fy * p.y) / -p.z + Vec2::new(camera.cx, camera.cy);
        (p.z < 0.0 && pixel.is_finite()).then_some(pixel)
    }

    /// The distance at a place, in pixels from the first pixel's centre; that of the border beyond it.
    fn interpolated(&self, x: f32, y: f32) -> f32 {
        let (width, height) = (self.camera.width, self.camera.height);
        let axis = |at: f32, n: u32| {
            let at = at.clamp(0.0, (n - 1) as f32);
            let first = (at as usize).min((n as usize).saturating_sub(2));
            (first, at - first as f32)
        };
        let ((x, u), (y, v)) = (axis(x, width), axis(y, height));
        let width = width as usize;
        let next_row = if height > 1 { width } else { 0 };
        let next = usize::from(width > 1);
        let i = y * width + x;
        let at = |i: usize| self.distance[i];
        let top = at(i) + u * (at(i + next) - at(i));
        let low = at(i + next_row) + u * (at(i + next_row + next) - at(i + next_row));
        top + v * (low - top)
    }

    /// How far outside this silhouette's cone `p` lies, in scene units, negative inside; `None`
    /// where the view does not say.
    pub(super) fn outside_by(&self, p: Vec3) -> Option<f32> {
        let away = (p - self.camera.position()).length();
        self.distance_px(p)
            .map(|px| -px * away * self.camera.pixel_angle())
    }

    /// The middle of the object's pixels, and the largest distance of its outline from there, pixels.
    pub(super) fn disc(&self) -> (Vec2, f32) {
        let width = self.camera.width as usize;
        let (mut sum, mut n) = (Vec2::ZERO, 0.0);
        for (i, distance) in self.distance.iter().enumerate() {
            if *distance > 0.0 {
                sum += Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
                n += 1.0;
            }
        }
        let middle = if n > 0.0 { sum / n } else { self.outline[0] };
        let reach = self.outline.iter().map(|p| p.distance(middle));
        (middle, reach.fold(0.0, f32::max))
    }
}

/// Pixel centres further than [`RIM_PX`] within the outline, all or every so many along both axes.
fn inner_places(distance: &[f32], width: usize) -> Vec<Vec2> {
    let inner = || (0..distance.len()).filter(|i| distance[*i] > RIM_PX);
    let stride = (inner().count() as f32 / MOST_INNER as f32).sqrt().ceil() as usize;
    inner()
        .map(|i| (i % width, i / width))
        .filter(|(x, y)| x % stride == 0 && y % stride == 0)
        .map(|(x, y)| Vec2::new(x as f32, y as f32) + 0.5)
        .collect()
}

/// Coverage 0..1, blurred a little where the mask has hard steps.
fn softened(mask: &Mask) -> Vec<f32> {
    let (width, height) = (mask.width as usize, mask.height as usize);
    let share: Vec<f32> = (0..width * height).map(|i| mask.share(i)).collect();
    let is_edge = |i: usize, j: usize| mask.is_object(i) != mask.is_object(j);
    let (mut n_edges, mut n_soft) = (0, 0);
    for y in 0..height {
        for x in 1..width {
            let i = y * width + x;
            if is_edge(i - 1, i) {
                n_edges += 1;
                let is_between = |v: f32| v > 0.02 && v < 0.98;
                n_soft += usize::from(is_between(share[i]) || is_between(share[i - 1]));
            }
        }
    }
    if n_soft as f32 >= SOFT_SHARE * n_edges as f32 {
        return share;
    }
    let mut blurred = share;
    for _ in 0..2 {
        blurred = blurred_121(&blurred, width, height);
    }
    blurred
}

/// Blurred by 1, 2, 1 along both axes.
fn blurred_121(source: &[f32], width: usize, height: usize) -> Vec<f32> {
    let pass = |source: &[f32], step: usize, place: &dyn Fn(usize) -> (usize, usize)| -> Vec<f32> {
        (0..source.len())
            .map(|i| {
                let (at, n) = place(i);
                let before = if at > 0 { source[i - step] } else { source[i] };
                let after = if at + 1 < n {
                    source[i + step]
                } else {
                    source[i]
                };
                0.25 * (before + 2.0 * source[i] + after)
            })
            .collect()
    };
    let rows = pass(source, 1, &|i| (i % width, width));
    pass(&rows, width, &|i| (i / width, height))
}

/// Marching squares at half coverage between the pixels' centres.
fn outline_pieces(soft: &[f32], width: usize, height: usize) -> Vec<Piece> {
    let mut pieces = Vec::new();
    for y in 0..height.saturating_sub(1) {
        for x in 0..width.saturating_sub(1) {
            let i = y * width + x;
            // Around the square: top left, top right, bottom right, bottom left.
            let corners = [i, i + 1, i + width + 1, i + width];
            let places = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
            let values = corners.map(|i| soft[i] - 0.5);
            let mut crossings = Vec::with_capacity(4);
            for a in 0..4 {
                let b = (a + 1) % 4;
                if (values[a] > 0.0) != (values[b] > 0.0) {
                    let t = values[a] / (values[a] - values[b]);
                    let (p, q) = (Vec2::from(places[a]), Vec2::from(places[b]));
                    crossings.push(Vec2::new(x as f32 + 0.5, y as f32 + 0.5) + p.lerp(q, t));
                }
            }
            for pair in crossings.as_chunks::<2>().0 {
                pieces.push(*pair);
            }
        }
    }
    pieces
}

/// Signed distances by carrying the nearest piece from neighbour to neighbour, forth and back.
fn distances(soft: &[f32], width: usize, height: usize, pieces: &[Piece]) -> Vec<f32> {
    const NONE: u32 = u32::MAX;
    let mut nearest = vec![NONE; width * height];
    let mut distance = vec![FAR_PX; width * height];
    let centre = |i: usize| Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
    let offer = |i: usize, piece: u32, nearest: &mut [u32], distance: &mut [f32]| {
        let d = distance_to_piece(centre(i), pieces[piece as usize]);
        if d < distance[i] {
            distance[i] = d;
            nearest[i] = piece;
        }
    };
    for (index, [a, b]) in pieces.iter().enumerate() {
        let middle = 0.5 * (*a + *b) - 0.5;
        let (x, y) = (middle.x as usize, middle.y as usize);
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let (x, y) = ((x + dx).min(width - 1), (y + dy).min(height - 1));
            offer(y * width + x, index as u32, &mut nearest, &mut distance);
        }
    }
    for round in 0..4 {
        let is_back = round % 2 == 1;
        for step in 0..width * height {
            let i = if is_back {
                width * height - 1 - step
            } else {
                step
            };
            let (x, y) = ((i % width) as isize, (i / width) as isize);
            for (dx, dy) in [
                (-1, 0),
                (-1, -1),
                (0, -1),
                (1, -1),
                (1, 0),
                (1, 1),
                (0, 1),
                (-1, 1),
            ] {
                let (x, y) = (x + dx, y + dy);
                if x >= 0 && y >= 0 && (x as usize) < width && (y as usize) < height {
                    let piece = nearest[y as usize * width + x as usize];
                    if piece != NONE {
                        offer(i, piece, &mut nearest, &mut distance);
                    }
                }
            }
        }
    }
    let sign = |i: usize| if soft[i] > 0.5 { 1.0 } else { -1.0 };
    distance
        .iter()
        .enumerate()
        .map(|(i, d)| sign(i) * d)
        .collect()
}

fn distance_to_piece(p: Vec2, [a, b]: Piece) -> f32 {
    let along = b - a;
    let t = (p - a).dot(along) / along.length_squared().max(f32::MIN_POSITIVE);
    p.distance(a + t.clamp(0.0, 1.0) * along)
}
