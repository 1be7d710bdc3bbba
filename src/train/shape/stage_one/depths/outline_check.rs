//! Whether what photos show is the object's surface or what that mirrors.
//!
//! Rays along outlines touch the surface, so that some places of it are known. What a convex mirror shows lies behind them, at a
//! virtual depth on which photos agree as they do on a painted surface.

use glam::{Affine3A, Vec3};
use rayon::prelude::*;

use crate::data::DepthMap;
use crate::geometry::{Projector, ScalarGrid};
use crate::train::shape::stage_one::fairing::nearest_approach;
use crate::train::shape::stage_one::silhouette::Silhouette;

/// Least cosine of the angle between the surface's normal and a view that is asked.
const FACING: f32 = 0.6;
/// Cells of the surface's grid by which depths may differ and agree.
const SAME_CELLS: f32 = 1.5;
/// Share that must agree, of those that do not show something nearer, which may hide the place.
const LEAST_AGREEING: f32 = 0.7;
/// Cells along an outline's ray, to either side of where it comes nearest, within which it must be so many cells off for the
/// place to be known: cameras that see the object from one side leave a hull whose faces are made of such rays.
const CONTACT_CELLS: f32 = 6.0;
const LEFT_CELLS: f32 = 0.5;
/// Fewest views of places that say anything.
const FEWEST: usize = 100;

/// Whether depth maps show the surface where the outlines touch `phi`, distances to the surface that these gave.
pub(in super::super) fn agree(
    maps: &[DepthMap],
    phi: &ScalarGrid,
    silhouettes: &[Silhouette],
) -> bool {
    let views: Vec<(&DepthMap, Projector)> = maps
        .iter()
        .map(|map| (map, map.camera.projector(Affine3A::IDENTITY)))
        .collect();
    let touched = silhouettes.par_iter().flat_map_iter(|silhouette| {
        let outline = silhouette.outline.middles.iter();
        outline.filter_map(|at| touched(phi, silhouette, *at))
    });
    let counts = touched.map(|(place, normal)| {
        let off = views
            .iter()
            .filter_map(|view| further_by(view, place, normal));
        off.fold([0, 0], |[n_agreeing, n_further], off| {
            let is_same = off.abs() < SAME_CELLS * phi.cell;
            [
                n_agreeing + usize::from(is_same),
                n_further + usize::from(!is_same && off > 0.0),
            ]
        })
    });
    let [n_agreeing, n_further] = counts.reduce(|| [0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
    let n = n_agreeing + n_further;
    n >= FEWEST && n_agreeing as f32 >= LEAST_AGREEING * n as f32
}

/// Where the ray through a place of an outline touches the surface, and its normal there; `None` where it touches nothing, or keeps
/// so near to the surface that nobody knows where.
fn touched(phi: &ScalarGrid, silhouette: &Silhouette, at: glam::Vec2) -> Option<(Vec3, Vec3)> {
    let ray = silhouette.ray(at);
    let place = nearest_approach(phi, &ray, f32::NEG_INFINITY)?;
    let leaves = |cells: f32| {
        let further = place + cells * phi.cell * ray.direction;
        phi.sample(further) > LEFT_CELLS * phi.cell
    };
    let touches = phi.sample(place).abs() < phi.cell;
    let is_known = touches && leaves(CONTACT_CELLS) && leaves(-CONTACT_CELLS);
    is_known.then(|| (place, phi.gradient(place).normalize_or_zero()))
}

/// By how much what a map shows at a place of the surface is further than that, scene units; `None` where it shows nothing, or
/// sees the place askance.
fn further_by((map, projector): &(&DepthMap, Projector), place: Vec3, normal: Vec3) -> Option<f32> {
    let from_eye = place - map.camera.position();
    if -from_eye.normalize_or_zero().dot(normal) < FACING {
        return None;
    }
    let (at, _) = projector.project(place)?;
    Some(map.at(at.x, at.y)? - from_eye.dot(map.camera.forward()))
}
