//! Regions: parts of the surface that are edited on their own, each grown from one point of it.
//!
//! A region stores the point, not the places that belong to it: what they are follows from the mesh and from the
//! learned material, so it stays right while training goes on and takes a few bytes in a file.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::edit::MaterialEdit;
use super::material::MaterialBatch;
use super::object::ObjectModel;
use super::values::Surface;
use crate::color::srgb_from_linear;

/// Most regions of an object: each is weighted at every point that is shaded.
pub const MAX_REGIONS: usize = 8;
/// Weight of the diffuse part in [`distance`]: the light that is baked into it varies over one material.
const DIFFUSE_WEIGHT: f32 = 0.5;

/// What belongs to a region, beginning at its seed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Extent {
    /// The connected part of the mesh.
    #[default]
    Part,
    /// Whatever is made of nearly the same.
    Material(Likeness),
}

/// How alike two materials must be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Likeness {
    /// Distance of materials at which the weight is a half, `[0, 1]`; black and white are 1 apart.
    pub threshold: f32,
    /// Width of the soft edge as a share of twice the threshold, `[0, 1]`; 0 is hard.
    pub softness: f32,
    /// Whether only the seed's connected part of the mesh counts.
    pub within_part: bool,
}

impl Default for Likeness {
    fn default() -> Self {
        Self {
            threshold: 0.15,
            softness: 0.3,
            within_part: false,
        }
    }
}

impl Likeness {
    /// Weight of a material at a distance from the seed's, `[0, 1]`; 1 at the seed itself.
    pub fn weight(&self, distance: f32) -> f32 {
        let inner = self.threshold * (1.0 - self.softness);
        let outer = self.threshold * (1.0 + self.softness);
        if distance <= inner {
            return 1.0;
        }
        // Also where the edge is hard and the division below has no meaning.
        if distance >= outer {
            return 0.0;
        }
        let t = (distance - inner) / (outer - inner);
        1.0 - t * t * (3.0 - 2.0 * t)
    }
}

/// A part of the surface and what is changed there, on top of the edit of the whole object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Region {
    /// A point of the surface, world coordinates.
    pub seed: Vec3,
    /// What belongs to it.
    pub extent: Extent,
    /// The change.
    pub edit: MaterialEdit,
}

impl Region {
    /// Whether every number is finite and in its range.
    fn is_sane(&self) -> bool {
        let unit = |v: f32| (0.0..=1.0).contains(&v);
        let has_extent = match self.extent {
            Extent::Part => true,
            Extent::Material(like) => unit(like.threshold) && unit(like.softness),
        };
        self.seed.is_finite() && has_extent && self.edit.is_finite()
    }
}

/// All regions of an object, in the order in which they are applied; at most [`MAX_REGIONS`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<Region>", into = "Vec<Region>")]
pub struct Regions {
    /// Filled from the front.
    list: [Option<Region>; MAX_REGIONS],
}

impl TryFrom<Vec<Region>> for Regions {
    type Error = String;

    fn try_from(given: Vec<Region>) -> Result<Self, String> {
        let mut regions = Self::default();
        for (i, region) in given.into_iter().enumerate() {
            if !region.is_sane() {
                return Err(format!(
                    "region {}: a number is not finite, or threshold or softness is outside 0 to 1",
                    i + 1
                ));
            }
            if !regions.push(region) {
                return Err(format!("more than {MAX_REGIONS} regions"));
            }
        }
        Ok(regions)
    }
}

impl From<Regions> for Vec<Region> {
    fn from(regions: Regions) -> Self {
        regions.iter().copied().collect()
    }
}

impl Regions {
    /// All of them, in order.
    pub fn iter(&self) -> impl Iterator<Item = &Region> {
        self.list.iter().flatten()
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.iter().count()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.list[0].is_none()
    }

    /// One of them.
    pub fn get(&self, index: usize) -> Option<&Region> {
        self.list.get(index)?.as_ref()
    }

    /// One of them, to be changed.
    pub fn get_mut(&mut self, index: usize) -> Option<&mut Region> {
        self.list.get_mut(index)?.as_mut()
    }

    /// Adds one at the end; false when there is no room.
    pub fn push(&mut self, region: Region) -> bool {
        let room = self.list.iter_mut().find(|slot| slot.is_none());
        room.map(|slot| *slot = Some(region)).is_some()
    }

    /// Takes one out; nothing happens without it.
    pub fn remove(&mut self, index: usize) {
        if index < MAX_REGIONS {
            self.list[index..].rotate_left(1);
            self.list[MAX_REGIONS - 1] = None;
        }
    }

    /// Those that change anything.
    pub fn effective(&self) -> Self {
        let mut changing = Self::default();
        for region in self.iter() {
            if region.edit != MaterialEdit::default() {
                changing.push(*region);
            }
        }
        changing
    }
}

/// Everything that is changed about an object, as files hold it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ObjectEdit {
    /// The change of the whole object.
    pub whole: MaterialEdit,
    /// What is changed in parts of it, on top of that.
    pub regions: Regions,
}

/// How different two materials are, about `[0, 1]`: root of the summed squares of the differences of roughness, of tint
/// and, at half weight and behind the sRGB curve, of diffuse colour (means over the channels).
pub fn distance(a: &Surface, b: &Surface) -> f32 {
    let shown = |v: Vec3| v.map(|c| srgb_from_linear(c.clamp(0.0, 1.0)));
    let tint = (a.tint - b.tint).length_squared() / 3.0;
    let diffuse = (shown(a.diffuse) - shown(b.diffuse)).length_squared() / 3.0;
    let roughness = (a.roughness - b.roughness).powi(2);
    (roughness + tint + DIFFUSE_WEIGHT * diffuse).sqrt()
}

/// A region made ready for many points of one object.
#[derive(Clone, Copy, Debug)]
pub struct RegionMask {
    like: Option<Likeness>,
    /// Whether the region keeps to one connected part, and which.
    keeps_to_part: bool,
    part: Option<u32>,
    /// What the seed is made of, as renderers mean it and not edited.
    material: Surface,
}

impl RegionMask {
    /// Looks up the seeds; `batch` and `encoded` are working memory.
    pub fn of<'a>(
        regions: impl Iterator<Item = &'a Region>,
        object: &ObjectModel,
        batch: &mut MaterialBatch,
        encoded: &mut Vec<f32>,
    ) -> Vec<Self> {
        let regions: Vec<&Region> = regions.collect();
        let seeds: Vec<Vec3> = regions.iter().map(|region| region.seed).collect();
        object.material.forward(&seeds, batch, encoded);
        let masks = regions.iter().zip(&batch.surfaces).map(|(region, seed)| {
            let like = match region.extent {
                Extent::Part => None,
                Extent::Material(like) => Some(like),
            };
            let keeps_to_part = like.is_none_or(|like| like.within_part);
            Self {
                like,
                keeps_to_part,
                part: object.tracer.part_at(region.seed, Vec3::X),
                material: object.material.perceptual(*seed),
            }
        });
        masks.collect()
    }

    /// Weight of a point, `[0, 1]`: its material as renderers mean it and not edited, and its part of the mesh.
    pub fn weight(&self, material: &Surface, part: impl FnOnce() -> Option<u32>) -> f32 {
        let weight = self
            .like
            .map_or(1.0, |like| like.weight(distance(&self.material, material)));
        // A seed away from the surface, as of another mesh, has no part: nothing belongs to it.
        let is_outside = || self.part.is_none() || part() != self.part;
        if self.keeps_to_part && weight > 0.0 && is_outside() {
            0.0
        } else {
            weight
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::neif::RoughnessEdit;

    proptest! {
        #[test]
        fn likeness_weights_fall_from_one_to_zero(
            threshold in 0.0_f32..=1.0,
            softness in 0.0_f32..=1.0,
            near in 0.0_f32..2.0,
            more in 0.0_f32..2.0,
        ) {
            let like = Likeness { threshold, softness, within_part: false };
            let (weight, farther) = (like.weight(near), like.weight(near + more));
            prop_assert!((0.0..=1.0).contains(&weight), "{weight}");
            prop_assert!(farther <= weight, "{farther} after {weight}");
            prop_assert_eq!(like.weight(0.0), 1.0, "the seed");
        }
    }

    fn region(x: f32) -> Region {
        Region {
            seed: Vec3::X * x,
            extent: Extent::Material(Likeness::default()),
            edit: MaterialEdit {
                roughness: RoughnessEdit::Constant(0.4),
                ..MaterialEdit::default()
            },
        }
    }

    #[test]
    fn regions_keep_their_order_and_are_at_most_eight() {
        let mut regions = Regions::default();
        for i in 0..MAX_REGIONS {
            assert!(regions.push(region(i as f32)), "room for {i}");
        }
        assert!(!regions.push(region(9.0)), "full");
        regions.remove(0);
        regions.remove(MAX_REGIONS);
        let seeds: Vec<f32> = regions.iter().map(|region| region.seed.x).collect();
        assert_eq!(seeds, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
    }

    #[test]
    fn regions_are_written_and_read_and_bad_ones_named() {
        let mut regions = Regions::default();
        regions.push(region(0.5));
        regions.push(Region::default());
        let text = serde_json::to_string(&regions).unwrap();
        assert_eq!(serde_json::from_str::<Regions>(&text).unwrap(), regions);
        let bad = text.replace("0.15", "1.5");
        let error = serde_json::from_str::<Regions>(&bad).unwrap_err();
        assert!(error.to_string().contains("region 1"), "{error}");
        assert_eq!(regions.effective().len(), 1, "one changes nothing");
    }
}
