//! Lamps: small parts of the environment that are much brighter than the rest, as points that shadow rays reach.
//!
//! A few dozen wide cones do not find a small lamp, and what they find of it casts no shadow with an edge. The light
//! above [`Lamps::white`] is therefore left out of the cones and sent from points instead, one for each equal share of
//! it (the median cut of Debevec 2005); below that the cones gather it as before, so that the two add up.

mod gains;
mod highlights;
mod lobes;
mod panorama;
mod places;
#[cfg(test)]
mod tests;
mod wide_cones;

use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use gains::LitPlace;
pub(super) use gains::lamp_gains;
pub(super) use highlights::Highlights;
pub(super) use lobes::lit_lobes;
pub(super) use panorama::PanoramaPixel;
pub(super) use places::Place;
pub(super) use wide_cones::{Compared, WideCones};

use crate::geometry::{SurfaceTracer, fibonacci_sphere};
use crate::neif::field::radiance_field::{FieldBatch, FieldRay};
use crate::neif::light::environment::{EnvironmentField, LightScratch};
use crate::neif::light::estimated_lamps::EstimatedLamps;
use crate::neif::{Environment, EnvironmentFromWorld};
use crate::render::path::trace::is_hidden;

/// Directions in which lamps are looked for: 2.2 degrees apart.
const N_LOOKS: usize = 16_384;
/// Solid angle of a look, steradians.
const LOOK: f32 = 4.0 * std::f32::consts::PI / N_LOOKS as f32;
/// Solid angle, in looks, of the cone that limits how bright a look may be.
const WIDER: f32 = 9.0;
/// Looks evaluated together.
const PIECE: usize = 256;
/// Radiance from which light is a lamp's, in means of the darker 95 hundredths of the directions.
const BRIGHT: f32 = 4.0;
const DARKER: f32 = 0.95;
/// The same at least, where a photo's white is 1.
const WHITE: f32 = 1.0;
/// Parts of the lamps whose brightness is asked for one by one, and that lobes distinguish.
const N_PARTS: usize = 64;
/// Points that stand for all lamps where they light a surface.
const N_POINTS: usize = 24;

/// A point that stands for a share of a lamp's light, in the coordinates of the environment's world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LampPoint {
    /// Where it is; a unit direction where the environment is infinitely far.
    pub(super) place: Vec3,
    /// Irradiance of a surface that faces it at distance 1; at any distance where it is infinitely far.
    pub(super) strength: Vec3,
    /// Square of the extent that it stands for: at smaller distances it is no point.
    extent2: f32,
    /// Solid angle of the same, seen from the middle of the environment, steradians.
    solid_angle: f32,
}

/// The lamps of an environment.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Lamps {
    /// Most radiance of a colour that is left to cones.
    white: f32,
    is_far: bool,
    /// Where there is more than that.
    looks: Vec<Look>,
    /// By how much all together are brighter or darker than they were learned, octaves.
    correction: f32,
    /// What the object's lobes are like in this light, where it was trained in it.
    pub(super) wide: WideCones,
}

/// One look at the environment.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Look {
    direction: Vec3,
    place: Vec3,
    /// Radiance above white.
    excess: Vec3,
    /// The same as it was learned.
    learned: Vec3,
    distance: f32,
}

impl Look {
    fn energy(&self) -> f32 {
        self.excess.element_sum()
    }
}

impl Lamps {
    /// The lamps as bright as they were estimated to be with another object, if they were; `None` when cancelled.
    pub(super) fn of(environment: &Environment, cancel: &AtomicBool) -> Option<Self> {
        let learned = Self::learned(environment, cancel)?;
        Some(match environment.estimated_lamps() {
            Some(estimated) => learned.brightened(|_, look| estimated.gain(look.direction)),
            None => learned,
        })
    }

    /// The lamps as the field has them. Looks around from the middle of the environment's inner box; `None` when cancelled.
    pub(super) fn learned(environment: &Environment, cancel: &AtomicBool) -> Option<Self> {
        let directions = fibonacci_sphere(N_LOOKS);
        let mut seen = look_around(environment, &directions, 1.0, cancel)?;
        let white = white(environment, &seen);
        limit(environment, &directions, &mut seen, white, cancel)?;
        let frame = environment.frame();
        let is_far = environment.is_far();
        let looks: Vec<Look> = directions
            .iter()
            .zip(&seen)
            .filter_map(|(&direction, &(radiance, distance))| {
                let excess = radiance - below(radiance, white);
                let distance = distance * frame.half_side;
                (excess.element_sum() > 0.0).then_some(Look {
                    direction,
                    place: if is_far {
                        direction
                    } else {
                        frame.center + distance * direction
                    },
                    excess,
                    learned: excess,
                    distance,
                })
            })
            .collect();
        Some(Self {
            white,
            is_far,
            looks,
            correction: 0.0,
            wide: WideCones::default(),
        })
    }

    /// Whether nothing is brighter than white.
    pub(super) fn are_none(&self) -> bool {
        self.looks.is_empty()
    }

    /// What cones are left with of a radiance that they see.
    pub(super) fn below(&self, radiance: Vec3) -> Vec3 {
        below(radiance, self.white)
    }

    /// The lamps in parts of one direction each, for [`Self::gained`].
    pub(super) fn parts(&self) -> Vec<Vec<usize>> {
        parts(&self.looks, N_PARTS)
    }

    /// Multiplies each part by its gain, a colour.
    pub(super) fn gained(&self, parts: &[Vec<usize>], gains: &[Vec3]) -> Self {
        let mut by_look = vec![Vec3::ONE; self.looks.len()];
        for (part, gain) in parts.iter().zip(gains) {
            for &look in part {
                by_look[look] = *gain;
            }
        }
        self.brightened(|i, _| by_look[i])
    }

    /// Multiplies each look by its gain, a colour.
    fn brightened(&self, gain: impl Fn(usize, &Look) -> Vec3) -> Self {
        let mut gained = self.clone();
        for (i, look) in gained.looks.iter_mut().enumerate() {
            look.excess *= gain(i, look);
        }
        let [now, before] = [&gained, self].map(|lamps| {
            let all = lamps.looks.iter().map(|look| look.excess);
            all.sum::<Vec3>().element_sum()
        });
        let octaves = (now / before).log2().abs();
        gained.correction = if octaves.is_finite() { octaves } else { 0.0 };
        gained
    }

    /// By how much they are brighter than the field has them; `None` where there are none.
    pub(super) fn estimated(&self) -> Option<EstimatedLamps> {
        let gain = |look: &Look| {
            let is_lit = look.learned.cmpgt(Vec3::ZERO);
            Vec3::select(is_lit, look.excess / look.learned, Vec3::ONE)
        };
        let gains = self.looks.iter().map(|look| (look.direction, gain(look)));
        EstimatedLamps::new(gains.collect())
    }

    /// As few points as will do for lighting a surface, in a world in which the environment was moved.
    pub(super) fn points(&self, motion: &EnvironmentFromWorld) -> MovedLamps {
        self.points_of(&parts(&self.looks, N_POINTS), motion)
    }

    /// A point for each part, in a world in which the environment was moved.
    pub(super) fn points_of(
        &self,
        parts: &[Vec<usize>],
        motion: &EnvironmentFromWorld,
    ) -> MovedLamps {
        let scale = 1.0 / motion.length(1.0);
        let moved = |point: LampPoint| {
            if self.is_far {
                return LampPoint {
                    place: motion.world_direction(point.place),
                    ..point
                };
            }
            LampPoint {
                place: motion.world_point(point.place),
                strength: point.strength * (scale * scale),
                extent2: point.extent2 * scale * scale,
                ..point
            }
        };
        let points = parts
            .iter()
            .map(|part| point(&self.looks, part, self.is_far));
        MovedLamps {
            is_far: self.is_far,
            points: points.map(moved).collect(),
        }
    }
}

/// Lamps in world coordinates.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MovedLamps {
    is_far: bool,
    pub(super) points: Vec<LampPoint>,
}

impl MovedLamps {
    /// Whether there is none.
    pub(super) fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Calls `visit(point, toward, irradiance)` for each point that lies before a surface and is not hidden by the object, if one
    /// is given: `toward` is unit and `irradiance` that of a surface which faces it.
    pub(super) fn arriving(
        &self,
        tracer: Option<&SurfaceTracer>,
        (position, normal): (Vec3, Vec3),
        mut visit: impl FnMut(usize, Vec3, Vec3),
    ) {
        for (number, point) in self.points.iter().enumerate() {
            let (direction, distance, light) = self.unhidden(point, position);
            if normal.dot(direction) <= 0.0 {
                continue;
            }
            let is_hidden = tracer.is_some_and(|t| is_hidden(t, position, direction, distance));
            if !is_hidden {
                visit(number, direction, light);
            }
        }
    }

    /// Direction and distance of a point, and the irradiance of a surface at `position` that faces it.
    fn unhidden(&self, point: &LampPoint, position: Vec3) -> (Vec3, f32, Vec3) {
        if self.is_far {
            return (point.place, f32::INFINITY, point.strength);
        }
        let to_lamp = point.place - position;
        let distance2 = to_lamp.length_squared();
        let distance = distance2.sqrt();
        let light = point.strength / distance2.max(point.extent2).max(f32::MIN_POSITIVE);
        (to_lamp / distance.max(f32::MIN_POSITIVE), distance, light)
    }

    /// Irradiance of a surface point.
    pub(super) fn irradiance(
        &self,
        tracer: Option<&SurfaceTracer>,
        position: Vec3,
        normal: Vec3,
    ) -> Vec3 {
        let mut sum = Vec3::ZERO;
        self.arriving(tracer, (position, normal), |_, toward, light| {
            sum += light * normal.dot(toward);
        });
        sum
    }
}

/// Radiance scaled so that no colour is brighter than `white`.
fn below(radiance: Vec3, white: f32) -> Vec3 {
    let brightest = radiance.max_element();
    if brightest > white {
        radiance * (white / brightest)
    } else {
        radiance
    }
}

/// Radiance and distance (field units) in each direction, through cones `wider` than a look in solid angle.
fn look_around(
    environment: &Environment,
    directions: &[Vec3],
    wider: f32,
    cancel: &AtomicBool,
) -> Option<Vec<(Vec3, f32)>> {
    let variance = wider / N_LOOKS as f32;
    let origin = Vec3::ZERO;
    let is_picture = matches!(environment.field(), EnvironmentField::Distant(_));
    let pieces: Option<Vec<Vec<(Vec3, f32)>>> = directions
        .par_chunks(PIECE)
        .map_init(
            <(FieldBatch, LightScratch)>::default,
            |(batch, scratch), directions| {
                if cancel.load(Ordering::Relaxed) {
                    return None;
                }
                batch.rays.clear();
                batch.rays.extend(directions.iter().map(|&direction| {
                    if is_picture {
                        FieldRay::of_cone(origin, direction, variance, 0.0)
                    } else {
                        let spread = variance.sqrt();
                        FieldRay::of_pixel([0.0; 3], direction.to_array(), 0.0, spread)
                    }
                }));
                environment.light(batch, scratch);
                let has_distance = environment.has_surfaces();
                let distance = |ray| if has_distance { batch.end(ray).0 } else { 1.0 };
                let seen = batch.radiance.iter().enumerate();
                Some(seen.map(|(i, v)| (Vec3::from(*v), distance(i))).collect())
            },
        )
        .collect();
    Some(pieces?.into_iter().flatten().collect())
}

/// Limits what is brighter than `white` to what a wider cone around it sees, as if all of that came from there.
///
/// A thin ray may see a speck of any radiance: photos do not say by how much white is exceeded, and hardly any looks as finely.
fn limit(
    environment: &Environment,
    directions: &[Vec3],
    seen: &mut [(Vec3, f32)],
    white: f32,
    cancel: &AtomicBool,
) -> Option<()> {
    let bright: Vec<usize> = (0..seen.len())
        .filter(|i| seen[*i].0.max_element() > white)
        .collect();
    let toward: Vec<Vec3> = bright.iter().map(|i| directions[*i]).collect();
    let wide = look_around(environment, &toward, WIDER, cancel)?;
    for (i, (around, _)) in bright.into_iter().zip(wide) {
        seen[i].0 = seen[i].0.min(WIDER * around);
    }
    Some(())
}

/// Most radiance of a colour that is not a lamp's.
fn white(environment: &Environment, seen: &[(Vec3, f32)]) -> f32 {
    let mut brightness: Vec<f32> = seen.iter().map(|(v, _)| v.max_element()).collect();
    brightness.sort_by(f32::total_cmp);
    let darker = &brightness[..(brightness.len() as f32 * DARKER) as usize];
    let mean = darker.iter().sum::<f32>() / darker.len().max(1) as f32;
    let white = BRIGHT * mean;
    match environment.field() {
        EnvironmentField::Distant(_) => white,
        EnvironmentField::Grid { .. } | EnvironmentField::Paper(_) => white.max(WHITE),
    }
}

/// At most `n` parts of looks: that one is cut whose light comes from the most different directions.
fn parts(looks: &[Look], n: usize) -> Vec<Vec<usize>> {
    let mut parts = vec![(0..looks.len()).collect::<Vec<usize>>()];
    let mut spreads = vec![spread(looks, &parts[0])];
    while parts.len() < n {
        let widest = (0..parts.len()).max_by(|a, b| spreads[*a].total_cmp(&spreads[*b]));
        let Some(widest) = widest.filter(|i| parts[*i].len() > 1) else {
            break;
        };
        let (near, far) = cut(looks, std::mem::take(&mut parts[widest]));
        spreads[widest] = spread(looks, &near);
        spreads.push(spread(looks, &far));
        parts[widest] = near;
        parts.push(far);
    }
    parts.retain(|part| !part.is_empty());
    parts
}

/// How far a part's light is from coming from one direction: its energy times the variance of its directions; 0 for one.
fn spread(looks: &[Look], part: &[usize]) -> f32 {
    let (mut sum, mut energy) = (Vec3::ZERO, 0.0);
    for &i in part {
        sum += looks[i].energy() * looks[i].direction;
        energy += looks[i].energy();
    }
    if part.len() < 2 {
        return 0.0;
    }
    (energy - sum.length_squared() / energy.max(f32::MIN_POSITIVE)).max(0.0)
}

/// Two halves of a part of at least two looks.
fn cut(looks: &[Look], mut part: Vec<usize>) -> (Vec<usize>, Vec<usize>) {
    let first = looks[part[0]].direction;
    let (mut low, mut high) = (first, first);
    for &i in &part {
        low = low.min(looks[i].direction);
        high = high.max(looks[i].direction);
    }
    let axis = (high - low).max_position();
    part.sort_by(|a, b| looks[*a].direction[axis].total_cmp(&looks[*b].direction[axis]));
    let half = 0.5 * part.iter().map(|&i| looks[i].energy()).sum::<f32>();
    let mut before = 0.0;
    let middle = part.iter().position(|&i| {
        before += looks[i].energy();
        before >= half
    });
    let middle = middle.unwrap_or(0).clamp(1, part.len() - 1);
    let rest = part.split_off(middle);
    (part, rest)
}

/// The point that stands for a part.
fn point(looks: &[Look], part: &[usize], is_far: bool) -> LampPoint {
    let (mut place, mut strength, mut weights) = (Vec3::ZERO, Vec3::ZERO, 0.0);
    for &i in part {
        let look = &looks[i];
        let distance2 = if is_far {
            1.0
        } else {
            look.distance * look.distance
        };
        place += look.energy() * look.place;
        weights += look.energy();
        strength += look.excess * (LOOK * distance2);
    }
    let place = place / weights.max(f32::MIN_POSITIVE);
    let distance2 =
        part.iter().map(|&i| looks[i].distance.powi(2)).sum::<f32>() / part.len() as f32;
    LampPoint {
        place: if is_far {
            place.normalize_or(Vec3::Z)
        } else {
            place
        },
        strength,
        extent2: distance2 * LOOK * part.len() as f32,
        solid_angle: LOOK * part.len() as f32,
    }
}
