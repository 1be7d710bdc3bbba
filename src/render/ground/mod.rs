//! Light both ways between an object and the surfaces around it: its shadow and what it sends them.
//!
//! Photos show the environment with the object in it. Where the environment is moved, swapped or looked at alone, the
//! radiance of the surfaces near the object is divided by the share of their light that it left them where it was captured,
//! [`BakedGround`], and multiplied by the share that it leaves them now, [`Shadow`]. Both shares come from the same
//! formula, so that nothing changes where nothing moved. What no photo can have seen of the plane that it stood on is
//! filled from around it.

mod bounce;
mod captured;
mod light;
mod look;
mod map;
mod shadow;
mod share_grid;
mod sight;
mod square;
mod stand;
mod support;
mod surfaces;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use glam::Vec3;

pub use captured::BakedGround;
pub(crate) use captured::Captured;
pub use shadow::Shadow;

use crate::neif::field::radiance_field::FieldBatch;
use sight::Sight;
use support::Hidden;

/// How finely the surfaces around an object are looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GroundResolution {
    /// Cells an axis.
    pub side: usize,
    /// Looks an axis through each face of a cube.
    pub n_looks: usize,
    /// Directions that light comes from.
    pub n_directions: usize,
    /// Most samples a ray into the environment.
    pub most_samples: usize,
}

/// The work was given up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cancelled;

/// What is done to the surfaces around an object.
#[derive(Clone, Debug, Default)]
pub struct Ground {
    /// Taken away.
    pub baked: Option<Arc<BakedGround>>,
    /// Put on.
    pub shadow: Option<Shadow>,
}

impl Ground {
    /// Whether nothing is done.
    pub fn is_empty(&self) -> bool {
        self.baked.is_none() && self.shadow.is_none()
    }

    /// Corrects the radiance of an evaluated batch: [`FieldBatch::radiance`].
    pub fn apply(&self, batch: &mut FieldBatch) {
        let (n_rays, n_samples) = (batch.rays.len(), batch.weights().len());
        if n_rays == 0 || n_samples == 0 || !n_samples.is_multiple_of(n_rays) {
            return;
        }
        for i in 0..n_rays {
            let seen = Vec3::from(batch.radiance[i]);
            let radiance = self.corrected(&Sight::of(batch, i), seen);
            if radiance != seen {
                batch.radiance[i] = radiance.to_array();
            }
        }
    }

    fn corrected(&self, sight: &Sight<'_>, seen: Vec3) -> Vec3 {
        let support = self.baked.as_ref().and_then(|baked| baked.support.as_ref());
        let hidden = support.and_then(|support| support.hidden(sight));
        let mut radiance = seen;
        if let Some(baked) = &self.baked {
            radiance *= baked.lightened(sight);
        }
        if let Some(hidden) = &hidden {
            radiance = radiance.lerp(hidden.radiance, hidden.weight);
        }
        if let Some(shadow) = &self.shadow {
            let mut share = shadow.share.along(sight, |share| share);
            if let Some(Hidden { point, weight, .. }) = hidden {
                share = share.lerp(shadow.share.at(point, sight.blur(point)), weight);
            }
            radiance *= share;
        }
        radiance
    }
}

/// 0 up to `from`, 1 from `to` on, smooth between.
fn smoothstep(from: f32, to: f32, v: f32) -> f32 {
    let x = ((v - from) / (to - from)).clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}
