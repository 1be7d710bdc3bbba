//! Light paths of training pixels in 24 bytes a vertex.
//!
//! Positions stay as they are. Normals have 16 bits a coordinate on the octahedron (Cigolle et al. 2014, "A Survey of
//! Efficient Representations for Independent Unit Vectors"), off by less than 1e-4; footprints and curvatures keep 8 bits
//! behind the point, off by 0.2 %; blocked shares are exact. Direction to the eye and distance follow from the
//! positions.

use std::ops::Range;

use glam::{Vec2, Vec3};

use crate::neif::light::light_path::{Blocked, PathVertex};
use crate::neif::light::shading::SurfacePoint;

/// Multiple of which all shares of up to four rays are: lowest common multiple of 1 to 4.
const SHARE_STEPS: f32 = 12.0;
/// Bits of a share in the flags.
const SHARE_BITS: u32 = 4;
const SHARE_MASK: u16 = (1 << SHARE_BITS) - 1;
const CORE_BIT: u16 = 1 << (2 * SHARE_BITS);
const END_OF_PATH: u16 = CORE_BIT << 1;
const END_OF_PIXEL: u16 = CORE_BIT << 2;

/// A vertex of a path.
#[derive(Clone, Copy, Debug)]
struct PackedVertex {
    position: [f32; 3],
    normal: [u16; 2],
    base: u16,
    spread: u16,
    curvature: u16,
    /// Blocked shares, and whether its path or pixel ends here.
    flags: u16,
}

/// The light paths of one view's object pixels, one pixel after the other.
#[derive(Clone, Debug, Default)]
pub(super) struct PackedPaths {
    vertices: Vec<PackedVertex>,
    /// First vertex of each pixel.
    starts: Vec<u32>,
}

impl PackedPaths {
    /// Adds a pixel with its paths; nothing when there are none. Returns whether there are.
    pub(super) fn push<'a>(&mut self, paths: impl Iterator<Item = &'a [PathVertex]>) -> bool {
        let start = self.vertices.len();
        for path in paths {
            self.vertices.extend(path.iter().map(PackedVertex::new));
            if let Some(last) = self.vertices.last_mut() {
                last.flags |= END_OF_PATH;
            }
        }
        let Some(last) = self.vertices[start..].last_mut() else {
            return false;
        };
        last.flags |= END_OF_PIXEL;
        self.starts.push(start as u32);
        true
    }

    /// Gives back memory that was reserved for more.
    pub(super) fn shrink(&mut self) {
        self.vertices.shrink_to_fit();
        self.starts.shrink_to_fit();
    }

    /// Appends the vertices of a pixel's paths, seen from `eye`, to `vertices`; `on_path` gets the range of each path.
    pub(super) fn unpack(
        &self,
        pixel: usize,
        eye: Vec3,
        vertices: &mut Vec<PathVertex>,
        mut on_path: impl FnMut(Range<usize>),
    ) {
        let (mut start, mut from) = (vertices.len(), eye);
        for packed in &self.vertices[self.starts[pixel] as usize..] {
            let mut vertex = packed.unpack(from);
            if vertices.len() == start {
                vertex.distance = 0.0;
            }
            vertices.push(vertex);
            from = vertex.point.position;
            if packed.flags & END_OF_PATH != 0 {
                on_path(start..vertices.len());
                (start, from) = (vertices.len(), eye);
            }
            if packed.flags & END_OF_PIXEL != 0 {
                return;
            }
        }
    }
}

impl PackedVertex {
    fn new(vertex: &PathVertex) -> Self {
        let Blocked { core, rings } = vertex.blocked;
        let share = |ring: usize| (rings[ring] * SHARE_STEPS).round() as u16;
        let core = if core > 0.0 { CORE_BIT } else { 0 };
        Self {
            position: vertex.point.position.to_array(),
            normal: pack_unit(vertex.point.normal),
            base: pack_positive(vertex.point.base),
            spread: pack_positive(vertex.point.spread),
            curvature: pack_positive(vertex.curvature),
            flags: share(0) | (share(1) << SHARE_BITS) | core,
        }
    }

    /// The vertex, coming from point `from`.
    fn unpack(&self, from: Vec3) -> PathVertex {
        let position = Vec3::from(self.position);
        let share =
            |ring: u32| f32::from((self.flags >> (ring * SHARE_BITS)) & SHARE_MASK) / SHARE_STEPS;
        let back = from - position;
        let to_eye = back.normalize_or_zero();
        PathVertex {
            point: SurfacePoint {
                position,
                normal: unpack_unit(self.normal),
                to_eye,
                base: unpack_positive(self.base),
                spread: unpack_positive(self.spread),
            },
            blocked: Blocked {
                core: if self.flags & CORE_BIT != 0 { 1.0 } else { 0.0 },
                rings: [share(0), share(1)],
            },
            distance: back.length(),
            curvature: unpack_positive(self.curvature),
        }
    }
}

/// A finite number of at least 0 without its sign and the lower 15 bits of its fraction, rounded.
fn pack_positive(v: f32) -> u16 {
    const LARGEST: u32 = f32::MAX.to_bits() >> 15;
    let rounded = (v.max(0.0).to_bits() + (1 << 14)) >> 15;
    rounded.min(LARGEST) as u16
}

fn unpack_positive(bits: u16) -> f32 {
    f32::from_bits(u32::from(bits) << 15)
}

/// A unit vector as a point of the unfolded octahedron.
fn pack_unit(n: Vec3) -> [u16; 2] {
    // A zero vector, of a degenerate triangle, has no place on the octahedron: taken as +z.
    let n = n / n.abs().element_sum().max(f32::MIN_POSITIVE);
    let p = Vec2::new(n.x, n.y);
    let p = if n.z < 0.0 { fold(p) } else { p };
    p.to_array()
        .map(|v| ((v * 0.5 + 0.5) * f32::from(u16::MAX)).round() as u16)
}

fn unpack_unit(bits: [u16; 2]) -> Vec3 {
    let [x, y] = bits.map(|v| f32::from(v) / f32::from(u16::MAX) * 2.0 - 1.0);
    let (p, z) = (Vec2::new(x, y), 1.0 - x.abs() - y.abs());
    let p = if z < 0.0 { fold(p) } else { p };
    p.extend(z).normalize_or(Vec3::Z)
}

/// Swaps the corners and the middle of the unfolded octahedron.
fn fold(p: Vec2) -> Vec2 {
    (Vec2::ONE - Vec2::new(p.y, p.x).abs()) * Vec2::ONE.copysign(p)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::fibonacci_sphere;

    #[test]
    fn unit_vectors_come_back_within_their_precision() {
        let axes = Vec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
        for n in fibonacci_sphere(10_000).into_iter().chain(axes) {
            let back = unpack_unit(pack_unit(n));
            assert!((back - n).length() < 1e-4, "{n} became {back}");
            assert!((back.length() - 1.0).abs() < 1e-6, "{back} is not unit");
        }
    }

    #[test]
    fn positive_numbers_of_any_size_come_back_within_their_precision() {
        assert_eq!(unpack_positive(pack_positive(0.0)), 0.0, "zero");
        let largest = unpack_positive(pack_positive(f32::MAX));
        assert!(largest.is_finite(), "{largest}");
        for e in -30..30 {
            let v = 1.37 * 10.0_f32.powi(e);
            let back = unpack_positive(pack_positive(v));
            assert!((back / v - 1.0).abs() < 2e-3, "{v} became {back}");
        }
    }

    #[test]
    fn paths_come_back_one_by_one() {
        let eye = Vec3::new(1.0, 2.0, 3.0);
        let positions = [Vec3::ZERO, Vec3::X, Vec3::new(0.5, -1.0, 0.25)];
        let rings = [[0.0, 1.0], [1.0 / 3.0, 2.0 / 3.0], [0.25, 0.75]];
        let path = |n: usize| -> Vec<PathVertex> {
            let vertex = |k: usize| {
                let from = if k == 0 { eye } else { positions[k - 1] };
                let back = from - positions[k];
                PathVertex {
                    point: SurfacePoint {
                        position: positions[k],
                        normal: Vec3::Z,
                        to_eye: back.normalize_or_zero(),
                        base: 0.5,
                        spread: 0.25,
                    },
                    blocked: Blocked {
                        core: (k % 2) as f32,
                        rings: rings[k],
                    },
                    distance: if k == 0 { 0.0 } else { back.length() },
                    curvature: 3.0 * k as f32,
                }
            };
            (0..n).map(vertex).collect()
        };
        let pixels: [Vec<Vec<PathVertex>>; 3] = [vec![path(3)], vec![], vec![path(1), path(2)]];
        let mut packed = PackedPaths::default();
        let kept = pixels
            .each_ref()
            .map(|paths| packed.push(paths.iter().map(Vec::as_slice)));
        assert_eq!(kept, [true, false, true], "those with paths are kept");
        for (pixel, paths) in [&pixels[0], &pixels[2]].into_iter().enumerate() {
            let (mut vertices, mut ranges) = (Vec::new(), Vec::new());
            packed.unpack(pixel, eye, &mut vertices, |range| ranges.push(range));
            let expected: Vec<PathVertex> = paths.concat();
            assert_eq!(ranges.len(), paths.len(), "paths of pixel {pixel}");
            assert_eq!(vertices.len(), expected.len(), "vertices of pixel {pixel}");
            for (a, b) in vertices.iter().zip(&expected) {
                assert_eq!(a.blocked, b.blocked, "shares are exact");
                assert_eq!(a.curvature, b.curvature, "few bits suffice here");
                let turned = (a.point.to_eye - b.point.to_eye).length();
                let farther = (a.distance - b.distance).abs();
                assert!(turned < 1e-6 && farther < 1e-6, "{a:?} against {b:?}");
            }
        }
    }
}
