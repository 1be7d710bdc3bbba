//! How a pixel's error depends on its normal: by a second ray, for a normal that leans a little to a random side.
//!
//! The difference of the two rays' light over the angle between the normals, along the random side, is in expectation
//! half the gradient. The radiance field is too rough for its derivative at a point to say where the light changes.

use glam::Vec3;

use super::normal_evidence::NormalRow;
use super::normal_offsets::OffsetBatch;
use crate::geometry::orthonormal_basis;
use crate::neif::EnvironmentTransform;
use crate::neif::field::radiance_field::FieldBatch;
use crate::neif::light::light_path::{LitVertex, first_lobe_ray};
use crate::neif::light::shading::SurfacePoint;
use crate::train::fast::step_context::StepContext;
use crate::train::random::SlotRandom;
use crate::train::step::loss::PixelLoss;

/// By how much a normal leans, radians.
const TILT: f32 = 0.01;

/// The second rays of a batch, which are its last.
#[derive(Debug, Default)]
pub(in crate::train) struct TiltedRays {
    first: usize,
    rays: Vec<TiltedRay>,
    /// What their pixels say of the normals, after [`Self::backward`].
    pub(in crate::train) rows: Vec<NormalRow>,
}

#[derive(Clone, Copy, Debug)]
struct TiltedRay {
    /// The point whose normal leans.
    point: usize,
    /// The ray of its upright normal.
    upright: usize,
    /// Unit tangent that the normal leans to.
    side: Vec3,
    /// Where that is, world.
    position: Vec3,
    /// Of the step's pixels.
    share: f32,
    /// The pixel, among the chunk's.
    pixel: usize,
}

/// How a pixel's error comes about.
#[derive(Clone, Copy, Debug)]
pub(in crate::train) struct PixelError {
    /// The error squared, sRGB, summed over the colours.
    value: f32,
    /// Slope of what is shown by the light that the pixel's paths bring, sRGB.
    slope: Vec3,
    /// Gradient of the step's loss by the light of one of them.
    d_light: Vec3,
}

impl PixelError {
    /// Of a pixel with this loss and the photo's `gain`.
    pub(in crate::train) fn new(loss: &PixelLoss, gain: Vec3, d_light: Vec3) -> Self {
        Self {
            value: loss.value,
            slope: loss.slope * gain,
            d_light,
        }
    }
}

impl TiltedRays {
    /// Forgets all; those to come follow the batch's rays.
    pub(in crate::train) fn begin(&mut self, batch: &FieldBatch) {
        self.first = batch.rays.len();
        self.rays.clear();
    }

    /// Adds one beside the lobe's ray of a path's first vertex, if that has one. `vertex` is that point, the `index`-th of the
    /// chunk's, which stands for `share` of the step's pixels and belongs to the chunk's `pixel`-th.
    pub(in crate::train) fn push(
        &mut self,
        context: &StepContext<'_>,
        random: &mut SlotRandom,
        (index, point, lit): (usize, &SurfacePoint, &LitVertex),
        (pixel, share): (usize, f32),
        batch: &mut FieldBatch,
    ) {
        let Some(upright) = lit.ray else {
            return;
        };
        let (sin, cos) = (random.uniform() * std::f32::consts::TAU).sin_cos();
        let (tangent, bitangent) = orthonormal_basis(point.normal);
        let side = tangent * cos + bitangent * sin;
        let leaning = SurfacePoint {
            normal: (point.normal + side * TILT).normalize_or(point.normal),
            ..*point
        };
        let still = EnvironmentTransform::default().environment_from_world();
        let axis = leaning.reflected();
        let ray = first_lobe_ray(&leaning, axis, &lit.lobe, &still, context.frame);
        batch.rays.push(ray);
        self.rays.push(TiltedRay {
            point: index,
            upright,
            side,
            position: point.position,
            share,
            pixel,
        });
    }

    /// The ray whose random numbers place the samples of `ray`: both of a pair have the same, so that only what they
    /// meet differs.
    pub(in crate::train) fn placed_like(&self, ray: usize) -> usize {
        let tilted = ray.checked_sub(self.first).and_then(|i| self.rays.get(i));
        tilted.map_or(ray, |tilted| tilted.upright)
    }

    /// From the gradients by the upright rays' light to those by the corrections; `errors`: of the chunk's pixels.
    pub(in crate::train) fn backward(
        &mut self,
        batch: &FieldBatch,
        errors: &[PixelError],
        offsets: &mut OffsetBatch,
    ) {
        self.rows.clear();
        for (tilted, ray) in self.rays.iter().zip(self.first..) {
            let light = |ray: usize| Vec3::from(batch.radiance[ray]);
            let slope = (light(ray) - light(tilted.upright)) / TILT;
            let d_radiance = Vec3::from(batch.d_radiance[tilted.upright]);
            let d = d_radiance.dot(slope);
            offsets.add(tilted.point, 2.0 * d * tilted.side, tilted.share);
            let error = &errors[tilted.pixel];
            // What this ray's light is of the pixel's; a colour without an error carries no information.
            let part = d_radiance / error.d_light;
            let part = Vec3::select(part.is_finite_mask(), part, Vec3::ZERO);
            self.rows.push(NormalRow {
                position: tilted.position,
                error: error.value,
                slope: 2.0 * (error.slope * part * slope).length_squared(),
            });
        }
    }
}
