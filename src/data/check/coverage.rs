//! Which sides of the object and which directions around it do the photos show?

use glam::Vec3;

use crate::data::{Dataset, Problem, Severity};
use crate::geometry::{Camera, fibonacci_sphere, orthonormal_basis};

/// Directions around the scene that are looked for in the photos.
const N_DIRECTIONS: usize = 2000;
/// Largest gap around the object, degrees, that is not worth a word.
const WIDE_GAP_DEG: f32 = 150.0;
/// Share of all directions below which reflections are mostly guessed.
const LITTLE_SEEN: f32 = 0.12;

/// The share of all directions that some training photo looks into.
pub(super) fn directions_seen(dataset: &Dataset, problems: &mut Vec<Problem>) -> f32 {
    let directions = fibonacci_sphere(N_DIRECTIONS);
    let n_seen = directions
        .iter()
        .filter(|direction| {
            dataset.train.iter().any(|view| {
                let camera = &view.camera;
                // A point so far away that it stands for the direction.
                let reach = 1e3 * (1.0 + camera.position().length());
                camera
                    .project(camera.position() + reach * **direction)
                    .is_some_and(|p| {
                        (0.0..camera.width as f32).contains(&p.x)
                            && (0.0..camera.height as f32).contains(&p.y)
                    })
            })
        })
        .count();
    let share = n_seen as f32 / N_DIRECTIONS as f32;
    if share < LITTLE_SEEN && !dataset.train.is_empty() && dataset.environment_visible {
        let what = format!(
            "the photos look into {:.0} % of all directions",
            100.0 * share
        );
        let advice = "reflections of the rest are guessed: add photos from other sides";
        problems.push(Problem::new(Severity::Warning, what, advice));
    }
    share
}

/// Whether most training photos look at `center`: photos of the environment alone look anywhere.
pub(super) fn shows_object(dataset: &Dataset, center: Vec3) -> bool {
    let views = dataset.train.iter();
    let n_looking = views.filter(|view| looks_at(&view.camera, center)).count();
    2 * n_looking > dataset.train.len()
}

/// Whether a camera looks there within 60 degrees.
fn looks_at(camera: &Camera, center: Vec3) -> bool {
    let to_center = center - camera.position();
    to_center.dot(camera.forward()) > 0.5 * to_center.length()
}

/// The part of the circle around `center` that training photos were taken from, degrees: what the widest gap leaves.
pub(super) fn circle_covered_deg(
    dataset: &Dataset,
    center: Vec3,
    up: Vec3,
    problems: &mut Vec<Problem>,
) -> f32 {
    let (across, along) = orthonormal_basis(up);
    let mut angles: Vec<f32> = dataset
        .train
        .iter()
        .filter(|view| looks_at(&view.camera, center))
        .map(|view| view.camera.position() - center)
        // From straight above no side is seen.
        .filter(|from| from.dot(up).abs() < 0.94 * from.length())
        .map(|from| from.dot(along).atan2(from.dot(across)).to_degrees())
        .collect();
    angles.sort_by(f32::total_cmp);
    let (Some(first), Some(last)) = (angles.first(), angles.last()) else {
        return 0.0;
    };
    let across_the_cut = 360.0 - (last - first);
    let gap = angles
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .fold(across_the_cut, f32::max);
    let covered = 360.0 - gap;
    if gap > WIDE_GAP_DEG && angles.len() > 1 && shows_object(dataset, center) {
        let what =
            format!("the photos are from one side: {covered:.0} of 360 degrees around the object");
        let advice = "what no photo shows is guessed; go all around the object";
        problems.push(Problem::new(Severity::Warning, what, advice));
    }
    covered
}
