//! The light path of a pixel: the points that its reflection meets one after the other, and the light they send on.
//!
//! Vertex 0 is what the pixel sees. At each vertex `k` the lobe gathers
//! `L_k = (1 - b_k) L_env + b_k O(k + 1)`, with `b_k` the share of the lobe that meets the object again and `O` the
//! pixel equation at the next vertex (Eq. 7 of the paper, applied along the path). What earlier lobes blur, later ones
//! see blurred: their variances add, and a curved surface spreads the blurred spot on it (ray differentials).

use std::ops::Range;

use glam::Vec3;

use super::lobe::Lobe;
use super::shading::{SurfacePoint, outgoing, outgoing_backward};
use crate::neif::field::contraction::FieldFrame;
use crate::neif::field::proposal::ConeRay;
use crate::neif::field::radiance_field::FieldRay;
use crate::neif::surface::edit::EnvironmentFromWorld;
use crate::neif::surface::values::Surface;

/// Half-angle of the part of the lobe that the mirror ray stands for, radians.
const CORE_ANGLE: f32 = 0.09;
/// Angle up to which the inner ring of lobe rays stands, radians.
const INNER_RING_END: f32 = 0.32;
/// Angles of the two rings of lobe rays, radians.
pub const RING_ANGLES: [f32; 2] = [0.19, 0.6];
/// Rays in a ring.
pub const RING_RAYS: usize = 4;
/// Blocked or free shares of a lobe below this are not worth a ray.
const SHARE_MARGIN: f32 = 0.01;

/// How much of a lobe meets the object again, by distance from the mirror direction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Blocked {
    /// 1 when the mirror ray hits, else 0.
    pub core: f32,
    /// Share of blocked rays in the two rings, `[0, 1]`.
    pub rings: [f32; 2],
}

/// A point of a light path: geometry only.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PathVertex {
    /// The point; `to_eye` looks back to the vertex before, or to the camera.
    pub point: SurfacePoint,
    /// How much of its lobe meets the object again; nothing at a path's last vertex.
    pub blocked: Blocked,
    /// Distance from the vertex before, world units; 0 at the first.
    pub distance: f32,
    /// Turn of the normal for a step along the surface, radians a world unit (root mean square over the directions).
    pub curvature: f32,
}

/// Blur of the beam that comes from the eye along the path, as variances per transverse axis: linear in the
/// variances of the lobes it passed.
#[derive(Clone, Copy, Debug, Default)]
struct Blur {
    /// Of position, world units squared.
    position: f32,
    /// Of direction, radians squared.
    direction: f32,
}

impl Blur {
    /// Travels to a vertex and is mirrored by its curved surface.
    fn arrive(&mut self, vertex: &PathVertex) {
        self.position += vertex.distance * vertex.distance * self.direction;
        self.direction += (2.0 * vertex.curvature).powi(2) * self.position;
    }

    /// The adjoint of [`Self::arrive`].
    fn arrive_backward(&mut self, distance: f32, curvature: f32) {
        self.position += (2.0 * curvature).powi(2) * self.direction;
        self.direction += distance * distance * self.position;
    }
}

/// A vertex with its material, on its way through forward and backward pass.
#[derive(Clone, Copy, Debug)]
pub struct LitVertex {
    /// Index of the surface among those that [`aim`] was given.
    index: usize,
    surface: Surface,
    cos: f32,
    distance: f32,
    curvature: f32,
    /// Its lobe.
    pub lobe: Lobe,
    /// Blocked share of the lobe and its derivative by `kappa`.
    share: (f32, f32),
    /// Ray of the lobe's free part, if that is worth one.
    pub ray: Option<usize>,
    /// The same lobe by several cones, if it is split.
    pub split: Option<SplitLobe>,
    /// Whether the path goes on.
    goes_on: bool,
    /// What the lobe gathers; known after [`gather`].
    light: Vec3,
    /// Standard error of that as far as a split lobe's cones disagree, 0 for one cone; known after [`gather`].
    pub standard_error: Vec3,
}

/// A lobe by several cones, each as wide as its share of it ([`super::lobe_cones`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplitLobe {
    /// The first of their rays.
    pub first: usize,
    /// How many rays.
    pub n: usize,
    /// How many cones with those that meet the object again and have no ray among these, at least 1.
    pub n_cones: usize,
    /// What those bring to the lobe, times their share.
    pub from_object: Vec3,
    /// Sum of the squares of what each of those brings to the lobe.
    pub from_object_squared: Vec3,
    /// What the lobe gathers from lamps that the cones do not see.
    pub from_lamps: Vec3,
    /// Factor of all that they gather.
    pub gain: Vec3,
    /// Weight of this light against that of the one cone, `[0, 1]`.
    pub weight: f32,
}

impl Blocked {
    /// Whether no tested ray is blocked.
    pub fn is_free(&self) -> bool {
        self.core <= 0.0 && self.rings[0] <= 0.0 && self.rings[1] <= 0.0
    }

    /// Blocked share of the lobe and its derivative by `kappa`: each group of rays weighted by the lobe's mass there.
    pub fn share(&self, kappa: f32) -> (f32, f32) {
        let (inside_core, d_core) = vmf_cdf(kappa, CORE_ANGLE);
        let (inside_ring, d_ring) = vmf_cdf(kappa, INNER_RING_END);
        let share = inside_core * self.core
            + (inside_ring - inside_core) * self.rings[0]
            + (1.0 - inside_ring) * self.rings[1];
        let d_share =
            d_core * self.core + (d_ring - d_core) * self.rings[0] - d_ring * self.rings[1];
        (share.clamp(0.0, 1.0), d_share)
    }
}

/// Mass of a von Mises–Fisher lobe within `angle` of its axis, and its derivative by `kappa`.
///
/// `(1 - e^(-kappa (1 - cos angle))) / (1 - e^(-2 kappa))`.
fn vmf_cdf(kappa: f32, angle: f32) -> (f32, f32) {
    let c = 1.0 - angle.cos();
    let (e, e2) = ((-kappa * c).exp(), (-2.0 * kappa).exp());
    let (numerator, denominator) = (1.0 - e, 1.0 - e2);
    let mass = numerator / denominator;
    (mass, (c * e - 2.0 * e2 * mass) / denominator)
}

/// Adds the rays that a path's lobes need to `rays` and its vertices to `lit`; returns how many vertices that are.
///
/// `surfaces(k)` is the index and the material of vertex `k`. The first vertex's lobe gets several cones where `split` adds
/// their rays. The path ends where hardly any light would come from further on.
pub fn aim(
    path: &[PathVertex],
    surfaces: impl Fn(usize) -> (usize, Surface),
    motion: &EnvironmentFromWorld,
    frame: &FieldFrame,
    mut split: impl FnMut(&mut Vec<FieldRay>) -> Option<SplitLobe>,
    rays: &mut Vec<FieldRay>,
    lit: &mut Vec<LitVertex>,
) -> usize {
    let mut blur = Blur::default();
    for (k, vertex) in path.iter().enumerate() {
        let (index, surface) = surfaces(k);
        let lobe = Lobe::from_roughness(surface.roughness);
        let share = if k + 1 < path.len() {
            vertex.blocked.share(lobe.kappa)
        } else {
            (0.0, 0.0)
        };
        blur.arrive(vertex);
        let split = if k == 0 { split(rays) } else { None };
        let has_cone = split.is_none_or(|split| split.weight < 1.0);
        let ray = (has_cone && share.0 < 1.0 - SHARE_MARGIN).then(|| {
            let axis = vertex.point.reflected();
            rays.push(lobe_ray(&vertex.point, axis, &lobe, blur, motion, frame));
            rays.len() - 1
        });
        let goes_on = k + 1 < path.len() && has_cone && share.0 > SHARE_MARGIN;
        lit.push(LitVertex {
            index,
            surface,
            cos: vertex.point.n_dot_v(),
            distance: vertex.distance,
            curvature: vertex.curvature,
            lobe,
            share,
            ray,
            split,
            goes_on,
            light: Vec3::ZERO,
            standard_error: Vec3::ZERO,
        });
        if !goes_on {
            return k + 1;
        }
        blur.direction += lobe.variance;
    }
    path.len()
}

/// A cone of a lobe at a point that the eye sees directly, about the unit direction `axis`; field coordinates.
pub fn first_lobe_ray(
    point: &SurfacePoint,
    axis: Vec3,
    lobe: &Lobe,
    motion: &EnvironmentFromWorld,
    frame: &FieldFrame,
) -> FieldRay {
    lobe_ray(point, axis, lobe, Blur::default(), motion, frame)
}

/// The cone that gathers light along the lobe, in field coordinates, for a beam that is blurred already.
fn lobe_ray(
    point: &SurfacePoint,
    axis: Vec3,
    lobe: &Lobe,
    blur: Blur,
    motion: &EnvironmentFromWorld,
    frame: &FieldFrame,
) -> FieldRay {
    let direction = motion.direction(axis);
    let to_field = motion.length(1.0) / frame.half_side;
    let cone = ConeRay {
        origin: frame
            .field_from_world(motion.point(point.position))
            .to_array(),
        direction: (direction * lobe.mean_length).to_array(),
        base: (point.base * point.base + blur.position).sqrt() * to_field,
        spread: point.spread,
        lobe_variance: lobe.variance + blur.direction,
    };
    FieldRay {
        cone,
        direction: direction.to_array(),
        kappa: lobe.kappa,
    }
}

/// Fills in the light of each vertex of a path, from the last to the first; `gain(surface)` is the specular gain of an
/// edit at the surface of that index and `incoming(ray)` the radiance that a ray brought. Returns what the first
/// vertex's lobe gathers.
pub fn gather(
    lit: &mut [LitVertex],
    gain: impl Fn(usize) -> Vec3,
    incoming: impl Fn(usize) -> Vec3,
) -> Vec3 {
    let mut beyond = Vec3::ZERO;
    for vertex in lit.iter_mut().rev() {
        let free = vertex.ray.map_or(Vec3::ZERO, &incoming);
        vertex.light = free * (1.0 - vertex.share.0) + beyond * vertex.share.0;
        if let Some(split) = vertex.split {
            let (light, standard_error) = split.light(&incoming);
            vertex.light = vertex.light.lerp(light, split.weight);
            vertex.standard_error = standard_error * split.weight;
        }
        beyond = outgoing(
            &vertex.surface,
            vertex.cos,
            gain(vertex.index),
            vertex.light,
        );
    }
    lit.first().map_or(Vec3::ZERO, |first| first.light)
}

impl SplitLobe {
    /// Its rays.
    pub fn rays(&self) -> Range<usize> {
        self.first..self.first + self.n
    }

    /// The mean of its cones and the mean's standard error, as if they were drawn by chance.
    fn light(&self, incoming: impl Fn(usize) -> Vec3) -> (Vec3, Vec3) {
        let share = 1.0 / self.n_cones as f32;
        let (mut mean, mut squares) = (self.from_object, self.from_object_squared);
        for ray in self.rays() {
            let light = incoming(ray) * share;
            mean += light;
            squares += light * light;
        }
        let variance = (squares - mean * mean * share).max(Vec3::ZERO);
        let light = self.gain * (mean + self.from_lamps);
        (light, self.gain * variance.map(f32::sqrt))
    }
}

impl LitVertex {
    /// Adds to what a split lobe's blocked cones bring.
    pub fn add_from_object(&mut self, light: Vec3) {
        if let Some(split) = &mut self.split {
            split.from_object += light;
            split.from_object_squared += light * light;
        }
    }

    /// What the vertex sends on, given the light that [`gather`] found.
    pub fn outgoing(&self) -> Vec3 {
        outgoing(&self.surface, self.cos, Vec3::ONE, self.light)
    }
}

/// Back through a path of gain 1 without split lobes: from `d_out` of the first vertex to `d_surfaces` and, per ray, `d_radiance`.
pub fn backward(
    lit: &[LitVertex],
    d_out: Vec3,
    radiance: &[[f32; 3]],
    d_radiance: &mut [[f32; 3]],
    d_surfaces: &mut [Surface],
) {
    let mut d_out = d_out;
    for (k, vertex) in lit.iter().enumerate() {
        let d_surface = &mut d_surfaces[vertex.index];
        let d_light =
            outgoing_backward(&vertex.surface, vertex.cos, vertex.light, d_out, d_surface);
        let mut free = Vec3::ZERO;
        if let Some(ray) = vertex.ray {
            d_radiance[ray] = (d_light * (1.0 - vertex.share.0)).to_array();
            free = Vec3::from(radiance[ray]);
        }
        let Some(next) = lit.get(k + 1).filter(|_| vertex.goes_on) else {
            return;
        };
        // The share depends on kappa.
        let d_kappa = vertex.share.1 * d_light.dot(next.outgoing() - free);
        d_surface.roughness += d_kappa * vertex.lobe.d_kappa;
        d_out = d_light * vertex.share.0;
    }
}

/// From the lobe variances of a path's rays to the roughness of all vertices whose lobes they passed; `slope`: of the variance
/// of a lobe by the roughness that it is of.
pub fn roughness_backward(
    lit: &[LitVertex],
    d_lobe_variance: &[f32],
    slope: impl Fn(f32, &Lobe) -> f32,
    d_surfaces: &mut [Surface],
) {
    let mut d_blur = Blur::default();
    for vertex in lit.iter().rev() {
        d_blur.direction += vertex.ray.map_or(0.0, |ray| d_lobe_variance[ray]);
        d_surfaces[vertex.index].roughness +=
            d_blur.direction * slope(vertex.surface.roughness, &vertex.lobe);
        d_blur.arrive_backward(vertex.distance, vertex.curvature);
    }
}

#[cfg(test)]
mod tests;
