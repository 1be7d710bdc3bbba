//! How far the object reaches where no photo shows it.
//!
//! Behind what cameras on one side see, silhouettes leave whatever their cones hold, often longer than the object is wide.
//! What no photo shows lies within the convex hull of what they show.

use glam::Vec3;
use rayon::prelude::*;

use crate::geometry::{Aabb, ConvexSet, ScalarGrid};

/// Least cosine of the angle between the surface's normal and the direction to a camera that sees it: along the rays of its
/// outlines, which the hull's other faces are made of, it sees nothing.
const FACING: f32 = 0.25;
/// Cameras that must see a part of it: the hull may go beyond what a single one shows.
const SEEN_BY: usize = 2;
/// Cells to either side by which the surface's normal is judged.
const WIDE_CELLS: f32 = 3.0;
/// Cells around the convex hull that may be the object still: those of the surface are uncertain by so much.
const SLACK_CELLS: f32 = 1.0;
/// Share of its former longest side from which a box is worth a closer look.
const SMALLER: f32 = 0.8;

/// What holds the parts of the surface `phi`, distances to it on a grid, that are seen from these places; everything where they
/// see nothing.
pub(super) fn shown(phi: &ScalarGrid, eyes: &[Vec3]) -> ConvexSet {
    let nodes = (0..phi.values.len()).into_par_iter();
    let near = nodes.filter(|node| phi.values[*node].abs() < phi.cell);
    let points = near.filter_map(|node| {
        let at = phi.position(phi.place(node));
        let normal = wide_gradient(phi, at).try_normalize()?;
        let faces = |eye: &&Vec3| (**eye - at).normalize_or_zero().dot(normal) > FACING;
        let n_facing = eyes.iter().filter(faces).take(SEEN_BY).count();
        (n_facing == SEEN_BY).then_some(at)
    });
    ConvexSet::around(&points.collect::<Vec<_>>(), SLACK_CELLS * phi.cell)
}

/// The box around what of the surface `phi` lies within `extent`; `None` unless it is much smaller than `bounds`, which hold the
/// surface.
pub(super) fn within(extent: &ConvexSet, bounds: Aabb, phi: &ScalarGrid) -> Option<Aabb> {
    let nodes = (0..phi.values.len()).filter(|node| phi.values[*node] < phi.cell);
    let points = nodes.map(|node| phi.position(phi.place(node)));
    let found = Aabb::from_points(points.filter(|p| extent.contains(*p)));
    let closer = found.widened(phi.cell);
    let longest = |bounds: &Aabb| bounds.extent().max_element();
    let is_smaller = longest(&closer) < SMALLER * longest(&bounds);
    (!found.is_empty() && is_smaller).then_some(closer)
}

/// Up to a factor, the gradient across a few cells: a notch in a face that no camera sees has walls that some do.
fn wide_gradient(phi: &ScalarGrid, at: Vec3) -> Vec3 {
    let steps = Vec3::AXES.map(|axis| WIDE_CELLS * phi.cell * axis);
    steps
        .map(|step| phi.sample(at + step) - phi.sample(at - step))
        .into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::fibonacci_sphere;
    use crate::train::shape::stage_one::hull::raise;

    /// What cameras before a disc leave of it: a cone behind that.
    fn cone(p: Vec3) -> f32 {
        let aside = p.with_y(0.0).length();
        (-p.y).max(0.9 * (aside + 0.5 * p.y - 0.5))
    }

    fn grid(of: impl Fn(Vec3) -> f32 + Sync) -> ScalarGrid {
        let bounds = Aabb::from_points([Vec3::splat(-1.2), Vec3::splat(1.2)]);
        let mut grid = ScalarGrid::over(&bounds, 48, f32::NEG_INFINITY);
        raise(&mut grid, of);
        grid
    }

    #[test]
    fn what_no_camera_sees_is_no_longer_than_what_they_see() {
        let phi = grid(cone);
        let eyes = [-1.0, 0.0, 1.0].map(|x| Vec3::new(x, -3.0, 0.0));
        let extent = shown(&phi, &eyes);
        for x in [-0.45, 0.0, 0.45] {
            assert!(extent.outside_by(Vec3::new(x, 0.01, 0.0)) < 0.0, "at {x}");
        }
        let behind = extent.outside_by(Vec3::new(0.0, 0.5, 0.0));
        assert!((0.3..0.5).contains(&behind), "{behind}");
        let bounds = phi.bounds();
        let closer = within(&extent, bounds, &phi).expect("a smaller box");
        assert!(
            closer.max.y < 0.25 && closer.contains(Vec3::ZERO),
            "{closer:?}"
        );
        // Nobody looks: nothing is known of it.
        let unknown = shown(&phi, &[]);
        assert_eq!(unknown.outside_by(Vec3::ONE), f32::NEG_INFINITY);
        let whole = within(&unknown, bounds, &phi).unwrap_or(bounds);
        assert!(whole.contains(0.95 * Vec3::Y));
    }

    #[test]
    fn what_cameras_see_from_all_sides_is_kept() {
        // With a hollow, which is seen too.
        let phi = grid(|p| (p.length() - 0.8).max(0.4 - p.distance(Vec3::new(0.0, 0.0, 0.8))));
        let eyes = fibonacci_sphere(20).into_iter().map(|d| 3.0 * d);
        let extent = shown(&phi, &eyes.collect::<Vec<_>>());
        for direction in fibonacci_sphere(100) {
            let off = extent.outside_by(0.8 * direction);
            assert!((-0.1..0.0).contains(&off), "{off} at {direction}");
        }
        let bounds = Aabb::from_points([Vec3::splat(-0.85), Vec3::splat(0.85)]);
        assert_eq!(within(&extent, bounds, &phi), None);
    }
}
