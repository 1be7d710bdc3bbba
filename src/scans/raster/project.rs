//! From Gaussians in space to Gaussians on the picture (Zwicker et al., EWA Splatting, 2002).

use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

use crate::geometry::Camera;
use crate::scans::splats::{Splat, Splats, harmonics};

/// Least opacity that is drawn: one step of eight bits.
pub(super) const MIN_ALPHA: f32 = 1.0 / 255.0;
/// Variance that the picture adds to every Gaussian, pixels², so that none is thinner than a pixel.
const SCREEN_VARIANCE: f32 = 0.3;
/// Nearest depth that is drawn, scene units, and the same as a share of the scan's size: nearer Gaussians would be smeared
/// over the whole picture.
const NEAR: f32 = 0.2;
const NEAR_SHARE: f32 = 0.02;
/// How far outside the picture the slope of the projection is still followed, in half pictures.
const SLOPE_MARGIN: f32 = 0.3;
/// Gaussians that one task projects.
const CHUNK: usize = 4096;

/// A Gaussian on the picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flat {
    /// Distance along the camera's axis, scene units.
    pub(super) depth: f32,
    /// Its centre, pixels.
    pub(super) center: Vec2,
    /// The inverse of its covariance: `xx`, `xy`, `yy`, pixels⁻².
    pub(super) conic: [f32; 3],
    /// At its centre.
    pub(super) opacity: f32,
    /// sRGB-encoded, at least 0.
    pub(super) srgb: [f32; 3],
    /// The first and the last column and row on which it is visible.
    pub(super) columns: [u16; 2],
    /// See [`Self::columns`].
    pub(super) rows: [u16; 2],
}

/// What projecting a scan for one camera needs.
pub(super) struct Projection<'a> {
    splats: &'a Splats,
    camera: &'a Camera,
    /// From the scene's axes to x right, y down, z forward.
    axes: Mat3,
    eye: Vec3,
    near: f32,
    /// Least and most `x / z` and `y / z` at which slopes are taken.
    slopes: [Vec2; 2],
    /// Most pixels that a unit across a unit's depth takes anywhere in the picture.
    stretch: f32,
}

impl<'a> Projection<'a> {
    pub(super) fn new(splats: &'a Splats, camera: &'a Camera) -> Self {
        let size = Vec2::new(camera.width as f32, camera.height as f32);
        let (focal, middle) = (
            Vec2::new(camera.fx, camera.fy),
            Vec2::new(camera.cx, camera.cy),
        );
        let margin = SLOPE_MARGIN * 0.5 * size / focal;
        let slopes = [-middle / focal - margin, (size - middle) / focal + margin];
        let steepest = slopes[0].abs().max(slopes[1].abs()).max_element();
        let rotation = Mat3::from(camera.world_from_camera.matrix3).transpose();
        Self {
            splats,
            camera,
            axes: Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0)) * rotation,
            eye: camera.position(),
            near: NEAR.min(NEAR_SHARE * splats.size()),
            slopes,
            stretch: focal.max_element() * (1.0 + steepest * steepest).sqrt(),
        }
    }

    /// All Gaussians that are visible, in the scan's order.
    pub(super) fn flats(&self) -> Vec<Flat> {
        let n_coefficients = self.splats.n_coefficients();
        let chunks = self.splats.splats.par_chunks(CHUNK);
        let harmonics = self.splats.harmonics.par_chunks(CHUNK * n_coefficients);
        let flats: Vec<Vec<Flat>> = chunks
            .zip(harmonics)
            .map(|(splats, harmonics)| {
                let colors = harmonics.chunks_exact(n_coefficients);
                let pairs = splats.iter().zip(colors);
                pairs
                    .filter_map(|(splat, color)| self.flat(splat, color))
                    .collect()
            })
            .collect();
        flats.concat()
    }

    fn flat(&self, splat: &Splat, color: &[[f32; 3]]) -> Option<Flat> {
        let from_eye = splat.center - self.eye;
        let p = self.axes * from_eye;
        // Also false for what is not finite.
        let is_before = p.z > self.near;
        if !is_before || splat.opacity < MIN_ALPHA {
            return None;
        }
        let camera = self.camera;
        let slope = p.truncate() / p.z;
        let center = slope * Vec2::new(camera.fx, camera.fy) + Vec2::new(camera.cx, camera.cy);
        if self.is_surely_outside(center, splat.scale.max_element() / p.z) {
            return None;
        }
        let [xx, xy, yy] = self.covariance(splat, p.z, slope);
        let sharp = xx * yy - xy * xy;
        let (xx, yy) = (xx + SCREEN_VARIANCE, yy + SCREEN_VARIANCE);
        let area = xx * yy - xy * xy;
        let opacity = if self.splats.is_antialiased {
            splat.opacity * (sharp / area).max(0.0).sqrt()
        } else {
            splat.opacity
        };
        // Where `opacity exp(-q / 2)` falls below the least that is drawn.
        let q = 2.0 * (opacity / MIN_ALPHA).ln();
        let is_sane = q > 0.0 && area > 0.0 && area.is_finite();
        if !is_sane {
            return None;
        }
        let columns = covered(center.x, (q * xx).sqrt(), camera.width)?;
        let rows = covered(center.y, (q * yy).sqrt(), camera.height)?;
        Some(Flat {
            depth: p.z,
            center,
            conic: [yy / area, -xy / area, xx / area],
            opacity,
            srgb: harmonics::color(color, from_eye.normalize_or_zero()),
            columns,
            rows,
        })
    }

    /// Whether a Gaussian of at most this size over its depth cannot be seen in the picture: most are found to be so without
    /// their covariance.
    fn is_surely_outside(&self, center: Vec2, size: f32) -> bool {
        let size = size * self.stretch + SCREEN_VARIANCE.sqrt();
        let reach = Vec2::splat((2.0 * MIN_ALPHA.recip().ln()).sqrt() * size);
        let picture = Vec2::new(self.camera.width as f32, self.camera.height as f32);
        (center + reach).cmplt(Vec2::ZERO).any() || (center - reach).cmpgt(picture).any()
    }

    /// The covariance on the picture: that in space, seen through the projection's slope at the centre.
    fn covariance(&self, splat: &Splat, depth: f32, slope: Vec2) -> [f32; 3] {
        let spread = self.axes * Mat3::from_quat(splat.rotation) * Mat3::from_diagonal(splat.scale);
        let slope = slope.clamp(self.slopes[0], self.slopes[1]);
        let row = |focal: f32, axis: Vec3, slope: f32| {
            spread.transpose() * ((axis - slope * Vec3::Z) * (focal / depth))
        };
        let x = row(self.camera.fx, Vec3::X, slope.x);
        let y = row(self.camera.fy, Vec3::Y, slope.y);
        [x.dot(x), x.dot(y), y.dot(y)]
    }
}

/// The first and last of `n` pixels whose centres lie within `reach` of `center`.
fn covered(center: f32, reach: f32, n: u32) -> Option<[u16; 2]> {
    let first = (center - reach - 0.5).ceil().max(0.0);
    let last = (center + reach - 0.5).floor().min(n as f32 - 1.0);
    (first <= last).then_some([first as u16, last as u16])
}
