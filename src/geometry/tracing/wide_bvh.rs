//! An eight-wide bounding volume hierarchy with plain boxes, and the ways to walk through it.
//!
//! obvhs builds the hierarchy with compressed boxes. Unpacking eight bytes for every node and ray costs more than the
//! boxes' cache misses save, so the planes are kept as floats, four children to a vector. Children lie in obvhs' slots,
//! whose order along a ray follows from its octant (Ylitalo, Karras, Laine 2017, "Efficient Incoherent Ray Traversal on
//! GPUs Through Compressed Wide BVHs").

use std::ops::Range;

use glam::{Vec3A, Vec4};
use obvhs::cwbvh::CwBvh;
use obvhs::ray::Ray as BvhRay;

use super::hierarchy::MAX_DEPTH;

/// Children of a node.
const WIDTH: usize = 8;
/// Growth of a box's exit distance, so that rounding never loses a ray that grazes it (Ize 2013, "Robust BVH Ray
/// Traversal").
const GROWN: f32 = 1.0 + 4.0 * f32::EPSILON;
/// Widening of the boxes against the rounding of their unpacking, in a mesh that fills the unit ball.
const MARGIN: f32 = 2.0 * f32::EPSILON;

/// Four boxes: `[axis][lower, upper]`. An empty one has its planes swapped at infinity, and is met by nothing.
#[derive(Clone, Copy, Debug)]
pub(in crate::geometry) struct Boxes([[Vec4; 2]; 3]);

/// Eight boxes and where they lead.
#[derive(Clone, Debug)]
struct Node {
    boxes: [Boxes; 2],
    /// Node index of an inner child, first leaf index of another.
    first: [u32; WIDTH],
    /// Triangles of a child; 0 for inner and empty ones.
    n_leaves: [u8; WIDTH],
}

/// The hierarchy; leaves are numbered in obvhs' order of the primitives.
#[derive(Debug)]
pub(in crate::geometry) struct WideBvh {
    nodes: Vec<Node>,
}

/// A child of a node: a box with all that it holds.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::geometry) struct Part(u32);

/// What a part holds.
pub(in crate::geometry) enum Content {
    /// The children of a node.
    Node(usize),
    /// Triangles.
    Leaves(Range<usize>),
}

/// A ray as the boxes are tested with it.
#[derive(Clone, Copy, Debug)]
pub(in crate::geometry) struct Slabs {
    origin: [Vec4; 3],
    inverse: [Vec4; 3],
    /// 1 for an axis along which the ray goes down.
    signs: [usize; 3],
    /// The slot that lies nearest along the ray, times its bits: slot `i` comes in order of falling `i ^ order`.
    order: u32,
    t_min: Vec4,
}

/// A cone that starts on a surface: rays of one lobe.
#[derive(Clone, Copy, Debug)]
pub(in crate::geometry) struct Cone {
    /// Its tip, ball space.
    pub apex: Vec3A,
    /// Unit.
    pub axis: Vec3A,
    /// Cosine of its half-angle.
    pub cos: f32,
    /// Sine of its half-angle.
    pub sin: f32,
    /// Unit normal of the plane through the tip; only what lies higher than `height` above it counts.
    pub normal: Vec3A,
    /// Ball space.
    pub height: f32,
}

impl Cone {
    /// Whether a triangle may reach into the cone above the plane; never false for one that does.
    #[inline(always)]
    pub(in crate::geometry) fn may_meet(&self, corners: &[Vec3A; 3]) -> bool {
        let [a, b, c] = corners.map(|p| p - self.apex);
        let top = (self.normal.dot(a))
            .max(self.normal.dot(b))
            .max(self.normal.dot(c));
        if top <= self.height {
            return false;
        }
        // The sphere about the triangle against the cone.
        let center = (a + b + c) / 3.0;
        let squares = [a, b, c].map(|p| (p - center).length_squared());
        let radius = squares[0].max(squares[1]).max(squares[2]).sqrt();
        let along = center.dot(self.axis);
        let across = (center.length_squared() - along * along).max(0.0).sqrt();
        across * self.cos <= along * self.sin + radius
    }
}

/// A node and which of its inner children are still to be visited, in order of the bits from the highest.
#[derive(Clone, Copy, Default)]
struct Group {
    node: u32,
    waiting: u32,
}

/// What a visitor of leaves wants next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::geometry) enum Walk {
    /// The rest.
    On,
    /// Nothing more.
    Stop,
}

impl WideBvh {
    /// Unpacks a hierarchy.
    pub(in crate::geometry) fn new(bvh: &CwBvh) -> Self {
        let nodes = bvh.nodes.iter().map(|packed| {
            let mut node = Node {
                boxes: [Boxes::EMPTY; 2],
                first: [0; WIDTH],
                n_leaves: [0; WIDTH],
            };
            for child in (0..WIDTH).filter(|child| !packed.is_child_empty(*child)) {
                let bounds = packed.child_aabb(child);
                let (lower, upper) = (bounds.min - MARGIN, bounds.max + MARGIN);
                node.boxes[child / 4].set(child % 4, lower, upper);
                if packed.is_leaf(child) {
                    let (first, n) = packed.child_primitives(child);
                    node.first[child] = first;
                    node.n_leaves[child] = n as u8;
                } else {
                    node.first[child] = packed.child_node_index(child);
                }
            }
            node
        });
        Self {
            nodes: nodes.collect(),
        }
    }

    /// The nodes as rows of words, two a child and sixteen a node: lower corner (bits of floats) and first leaf or node;
    /// upper corner and number of leaves, `u32::MAX` for a child that is none.
    pub(in crate::geometry) fn rows(&self) -> Vec<[u32; 4]> {
        let row = |corner: Vec3A, last: u32| {
            let [x, y, z] = corner.to_array().map(f32::to_bits);
            [x, y, z, last]
        };
        let children = self
            .nodes
            .iter()
            .flat_map(|node| (0..WIDTH).map(move |child| (node, child)));
        children
            .flat_map(|(node, child)| {
                let (lower, upper) = node.boxes[child / 4].get(child % 4);
                let n_leaves = if lower.x > upper.x {
                    u32::MAX
                } else {
                    u32::from(node.n_leaves[child])
                };
                [row(lower, node.first[child]), row(upper, n_leaves)]
            })
            .collect()
    }

    /// What a part holds.
    #[inline(always)]
    pub(in crate::geometry) fn content(&self, part: Part) -> Content {
        let (node, child) = (part.0 as usize / WIDTH, part.0 as usize % WIDTH);
        let node = &self.nodes[node];
        let first = node.first[child] as usize;
        match usize::from(node.n_leaves[child]) {
            0 => Content::Node(first),
            n => Content::Leaves(first..first + n),
        }
    }

    /// Copies a part's box to place `i` of four boxes.
    #[inline(always)]
    pub(super) fn copy_box(&self, part: Part, to: &mut Boxes, i: usize) {
        let (node, child) = (part.0 as usize / WIDTH, part.0 as usize % WIDTH);
        let (lower, upper) = self.nodes[node].boxes[child / 4].get(child % 4);
        to.set(i, lower, upper);
    }

    /// The children of a node that may reach into the cone.
    #[inline(always)]
    pub(super) fn parts_in_cone(&self, node: usize, cone: &Cone) -> impl Iterator<Item = Part> {
        let mut met = self
            .nodes
            .get(node)
            .map_or(0, |node| node.mask(|boxes| boxes.met_by_cone(cone)));
        std::iter::from_fn(move || {
            let child = met.checked_ilog2()?;
            met ^= 1 << child;
            Some(Part((node * WIDTH) as u32 + child))
        })
    }

    /// Calls `visit` for the leaves below node `root` whose boxes the ray meets, near ones first as far as the tree
    /// knows; false when it was stopped. `visit` may shorten the ray.
    #[inline(always)]
    pub(super) fn walk_ray(
        &self,
        root: usize,
        slabs: &Slabs,
        ray: &mut BvhRay,
        mut visit: impl FnMut(&mut BvhRay, usize) -> Walk,
    ) -> bool {
        if self.nodes.is_empty() {
            return true;
        }
        let mut stack = [Group::default(); MAX_DEPTH];
        let mut depth = 0;
        let mut at = root as u32;
        loop {
            let node = &self.nodes[at as usize];
            let t_max = Vec4::splat(ray.tmax);
            let met = node.mask(|boxes| boxes.met_by_ray(slabs, t_max));
            let mut met = swap_bits(met, slabs.order);
            let mut waiting = 0;
            while met != 0 {
                let bit = met.ilog2();
                met ^= 1 << bit;
                let child = (bit ^ slabs.order) as usize % WIDTH;
                if node.n_leaves[child] == 0 {
                    waiting |= 1 << bit;
                }
                let first = node.first[child] as usize;
                for leaf in first..first + usize::from(node.n_leaves[child]) {
                    if visit(ray, leaf) == Walk::Stop {
                        return false;
                    }
                }
            }
            if waiting != 0 {
                stack[depth] = Group { node: at, waiting };
                depth += 1;
            }
            let Some(top) = depth.checked_sub(1) else {
                return true;
            };
            let group = &mut stack[top];
            let bit = group.waiting.ilog2();
            group.waiting ^= 1 << bit;
            at = self.nodes[group.node as usize].first[(bit ^ slabs.order) as usize % WIDTH];
            if group.waiting == 0 {
                depth = top;
            }
        }
    }
}

/// Moves bit `i` of eight to `i ^ order`.
#[inline(always)]
fn swap_bits(mut bits: u32, order: u32) -> u32 {
    if order & 1 != 0 {
        bits = ((bits & 0x55) << 1) | ((bits >> 1) & 0x55);
    }
    if order & 2 != 0 {
        bits = ((bits & 0x33) << 2) | ((bits >> 2) & 0x33);
    }
    if order & 4 != 0 {
        bits = ((bits & 0x0f) << 4) | (bits >> 4);
    }
    bits
}

impl Slabs {
    /// For a ray in ball space.
    #[inline(always)]
    pub(in crate::geometry) fn new(ray: &BvhRay) -> Self {
        // Of the inverse: that of a direction's -0 is minus infinity.
        let signs = ray.inv_direction.to_array().map(|d| usize::from(d < 0.0));
        Self {
            origin: ray.origin.to_array().map(Vec4::splat),
            inverse: ray.inv_direction.to_array().map(Vec4::splat),
            signs,
            order: (7 - 4 * signs[0] - 2 * signs[1] - signs[2]) as u32,
            t_min: Vec4::splat(ray.tmin),
        }
    }
}

impl Node {
    /// Bits of the children whose boxes pass a test.
    #[inline(always)]
    fn mask(&self, test: impl Fn(&Boxes) -> u32) -> u32 {
        test(&self.boxes[0]) | (test(&self.boxes[1]) << 4)
    }
}

impl Boxes {
    /// Four empty boxes.
    pub(in crate::geometry) const EMPTY: Self = Self([[Vec4::INFINITY, Vec4::NEG_INFINITY]; 3]);

    #[inline(always)]
    fn set(&mut self, i: usize, lower: Vec3A, upper: Vec3A) {
        for (axis, planes) in self.0.iter_mut().enumerate() {
            planes[0][i] = lower[axis];
            planes[1][i] = upper[axis];
        }
    }

    #[inline(always)]
    fn get(&self, i: usize) -> (Vec3A, Vec3A) {
        let [x, y, z] = &self.0;
        let side = |k: usize| Vec3A::new(x[k][i], y[k][i], z[k][i]);
        (side(0), side(1))
    }

    /// Bits of the boxes that the ray meets before `t_max`.
    #[inline(always)]
    pub(super) fn met_by_ray(&self, ray: &Slabs, t_max: Vec4) -> u32 {
        let (mut near, mut far) = (ray.t_min, t_max);
        for (axis, sign) in ray.signs.into_iter().enumerate() {
            let (origin, inverse) = (ray.origin[axis], ray.inverse[axis]);
            let (enter, leave) = (self.0[axis][sign], self.0[axis][1 - sign]);
            // In this order the vector instructions ignore the NaN of a ray within a plane.
            near = ((enter - origin) * inverse).max(near);
            far = ((leave - origin) * inverse).min(far);
        }
        near.cmple(far * GROWN).bitmask()
    }

    /// Bits of the boxes that may reach into the cone above its plane.
    #[inline(always)]
    fn met_by_cone(&self, cone: &Cone) -> u32 {
        let [mut above, mut along, mut square, mut radius] = [Vec4::ZERO; 4];
        for (axis, [lower, upper]) in self.0.iter().enumerate() {
            let center = (*lower + *upper) * 0.5 - Vec4::splat(cone.apex[axis]);
            let half = (*upper - *lower) * 0.5;
            above += center * cone.normal[axis] + half * cone.normal[axis].abs();
            along += center * cone.axis[axis];
            square += center * center;
            radius += half * half;
        }
        // The sphere about each box against the cone; the square is negative by rounding near the axis.
        let across = (square - along * along).max(Vec4::ZERO).sqrt();
        let within = (across * cone.cos).cmple(along * cone.sin + radius.sqrt());
        // The planes of an empty box give NaN, which is not above.
        (within & above.cmpgt(Vec4::splat(cone.height))).bitmask()
    }
}
