//! Building a hierarchy over triangles: obvhs', or a balanced one of a mesh that would make that too deep to walk.
//!
//! obvhs merges neighbours by surface area. Triangles on top of each other, or each within the next, become a chain: a
//! level for every seven of them, which no walk has room for and obvhs' own recursion runs out of stack over. Many of them take
//! it a time that is quadratic in their number.

use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::ploc::PlocBuilder;
use obvhs::triangle::Triangle;
use obvhs::{Boundable, BvhBuildParams};

/// Nodes on the longest path through a hierarchy, at most.
pub(in crate::geometry) const MAX_DEPTH: usize = 32;
/// The same of a binary tree that obvhs may turn into a hierarchy: it does so by recursion.
const MAX_BINARY_DEPTH: usize = 256;
/// Triangles about one point that obvhs is given, at most: as many take it a tenth of a second.
const MOST_IN_PLACE: usize = 2000;
/// Cells of a place, along each side of the mesh.
const N_PLACES: f32 = 1024.0;
/// Triangles in a leaf, at most.
const LEAF: u32 = 3;

/// The hierarchy over triangles, at most [`MAX_DEPTH`] deep.
pub(super) fn build_hierarchy(triangles: &[Triangle]) -> CwBvh {
    if most_in_place(triangles) > MOST_IN_PLACE {
        return widen(&balanced(triangles));
    }
    let params = BvhBuildParams::medium_build();
    let mut binary = PlocBuilder::with_capacity(triangles.len()).build(
        params.ploc_search_distance,
        triangles,
        (0..triangles.len() as u32).collect(),
        params.sort_precision,
        params.search_depth_threshold,
    );
    ReinsertionOptimizer::default().run(&mut binary, params.reinsertion_batch_ratio, None);
    let wide = (binary_depth(&binary) <= MAX_BINARY_DEPTH).then(|| widen(&binary));
    wide.filter(|wide| wide_depth(wide) <= MAX_DEPTH)
        .unwrap_or_else(|| widen(&balanced(triangles)))
}

/// The greatest number of triangles whose centres are about one point.
fn most_in_place(triangles: &[Triangle]) -> usize {
    let centers: Vec<Vec3A> = triangles.iter().map(|t| t.aabb().center()).collect();
    let bounds = Aabb::from_points(&centers);
    let per_side = N_PLACES / bounds.diagonal().max(Vec3A::splat(f32::MIN_POSITIVE));
    let place = |center: &Vec3A| ((*center - bounds.min) * per_side).as_uvec3().to_array();
    let mut places: Vec<[u32; 3]> = centers.iter().map(place).collect();
    places.sort_unstable();
    let runs = places.chunk_by(|a, b| a == b).map(<[_]>::len);
    runs.max().unwrap_or(0)
}

fn widen(binary: &Bvh2) -> CwBvh {
    bvh2_to_cwbvh(binary, LEAF, true, false)
}

/// A tree whose nodes are halved by the order of their triangles' centres along their longest side.
fn balanced(triangles: &[Triangle]) -> Bvh2 {
    let boxes: Vec<Aabb> = triangles.iter().map(Boundable::aabb).collect();
    let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
    let mut nodes = vec![Bvh2Node::default(); (2 * triangles.len()).saturating_sub(1)];
    let mut n_nodes = 1;
    let mut open = vec![(0, 0..order.len())];
    while let Some((at, range)) = open.pop() {
        let held = &mut order[range.clone()];
        let bounds = bounds_of(held, |i| boxes[i]);
        nodes[at] = if held.len() <= 1 {
            Bvh2Node::new(bounds, held.len() as u32, range.start as u32)
        } else {
            let centers = bounds_of(held, |i| Aabb::from_point(boxes[i].center()));
            let axis = longest_side(&centers);
            let middle = held.len() / 2;
            held.select_nth_unstable_by(middle, |a, b| {
                let along = |i: &u32| boxes[*i as usize].center()[axis];
                along(a).total_cmp(&along(b)).then(a.cmp(b))
            });
            let first = n_nodes;
            n_nodes += 2;
            let middle = range.start + middle;
            open.push((first, range.start..middle));
            open.push((first + 1, middle..range.end));
            Bvh2Node::new(bounds, 0, first as u32)
        };
    }
    Bvh2 {
        nodes,
        primitive_indices: order,
        ..Bvh2::default()
    }
}

fn bounds_of(held: &[u32], bounds: impl Fn(usize) -> Aabb) -> Aabb {
    let boxes = held.iter().map(|i| bounds(*i as usize));
    boxes.fold(Aabb::empty(), |all, one| all.union(&one))
}

fn longest_side(bounds: &Aabb) -> usize {
    let sides: Vec3A = bounds.diagonal();
    (0..3)
        .max_by(|a, b| sides[*a].total_cmp(&sides[*b]))
        .unwrap_or_default()
}

fn binary_depth(binary: &Bvh2) -> usize {
    depth(binary.nodes.len(), |at, inner| {
        let node = &binary.nodes[at];
        if !node.is_leaf() {
            inner.extend(node.first_index as usize..node.first_index as usize + 2);
        }
    })
}

fn wide_depth(wide: &CwBvh) -> usize {
    depth(wide.nodes.len(), |at, inner| {
        let node = &wide.nodes[at];
        let is_inner = |child: &usize| !node.is_child_empty(*child) && !node.is_leaf(*child);
        let nodes = (0..8).filter(is_inner);
        inner.extend(nodes.map(|child| node.child_node_index(child) as usize));
    })
}

/// Nodes on the longest path from the first of `n_nodes`; `children` adds those of a node to a list.
fn depth(n_nodes: usize, children: impl Fn(usize, &mut Vec<usize>)) -> usize {
    let mut row: Vec<usize> = (0..n_nodes.min(1)).collect();
    let mut depth = 0;
    while !row.is_empty() {
        depth += 1;
        let mut next = Vec::new();
        for at in row {
            children(at, &mut next);
        }
        row = next;
    }
    depth
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::geometry::meshes::test_mesh::nested;

    fn packed(triangles: &[[Vec3; 3]]) -> Vec<Triangle> {
        let packed = |corners: &[Vec3; 3]| {
            let [v0, v1, v2] = corners.map(Vec3A::from);
            Triangle { v0, v1, v2 }
        };
        triangles.iter().map(packed).collect()
    }

    #[test]
    fn chains_of_triangles_are_built_shallow() {
        for (n, ratio, times) in [
            (1000, 0.92, 1),
            (4000, 1.0, 1),
            (4000, 0.5, 40),
            (6000, 0.995, 1),
        ] {
            let triangles = packed(&nested(n, ratio, times));
            let hierarchy = build_hierarchy(&triangles);
            let depth = wide_depth(&hierarchy);
            assert!(depth <= MAX_DEPTH, "{n} {ratio} {times}: {depth}");
            let mut held = hierarchy.primitive_indices.clone();
            held.sort_unstable();
            assert!(held.into_iter().eq(0..n as u32), "each triangle once");
        }
    }

    #[test]
    fn a_hundred_thousand_triangles_in_one_place_are_built_at_once() {
        for ratio in [1.0, 0.9999] {
            let triangles = packed(&nested(100_000, ratio, 1));
            let began = std::time::Instant::now();
            let hierarchy = build_hierarchy(&triangles);
            let secs = began.elapsed().as_secs_f64();
            // Far below a time that is quadratic in their number, with room for a busy machine.
            assert!(secs < 5.0, "{ratio}: {secs} s");
            assert!(wide_depth(&hierarchy) <= MAX_DEPTH);
        }
    }

    #[test]
    fn a_balanced_tree_holds_what_is_below_each_node() {
        let triangles = packed(&nested(77, 0.8, 2));
        let tree = balanced(&triangles);
        let mut n_leaves = 0;
        for node in &tree.nodes {
            if node.is_leaf() {
                n_leaves += 1;
                let triangle = tree.primitive_indices[node.first_index as usize];
                assert_eq!(*node.aabb(), triangles[triangle as usize].aabb());
                continue;
            }
            let first = node.first_index as usize;
            let both = tree.nodes[first].aabb().union(tree.nodes[first + 1].aabb());
            assert_eq!(*node.aabb(), both);
        }
        assert_eq!(n_leaves, 77);
    }
}
