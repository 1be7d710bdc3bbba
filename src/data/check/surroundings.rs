//! Do the photos show the surroundings from all sides, and do these stand still?
//!
//! Light is learned from surroundings that stay where they are while the camera moves. On a turntable, or before a
//! backdrop that is carried along, the background stays the same in the picture instead.

use glam::{Mat3, Vec3};

use super::thumb::Thumb;
use crate::data::{Dataset, Problem, Severity};
use crate::geometry::{Camera, fibonacci_sphere, orthonormal_basis};

/// Least angle between two cameras' views for their backgrounds to have to differ, cosine of 40 degrees.
const WIDE_COSINE: f32 = 0.766;
/// Correlation of two backgrounds, pixel by pixel, from which they are the same one.
const SAME: f32 = 0.9;
/// Share of such pairs from which the background counts as moving along: turntables with photos from several heights
/// have the same background in a third of the pairs.
const SAME_SHARE: f32 = 0.2;
/// Standard deviation of a background, encoded, below which nothing is to be seen in it.
const PLAIN: f32 = 0.02;
/// Share of photos with such a background from which the surroundings count as plain.
const PLAIN_SHARE: f32 = 0.5;
/// Fewest pixels that both photos must show of the background.
const MIN_SHARED: usize = 60;
/// Fewest pairs that tell anything.
const MIN_PAIRS: usize = 10;
/// Pairs compared at most.
const MAX_PAIRS: usize = 4000;
/// Directions around the scene that are looked for in the photos.
const N_DIRECTIONS: usize = 2000;
/// Largest gap around the object, degrees, that is not worth a word.
const WIDE_GAP_DEG: f32 = 150.0;
/// Share of all directions below which reflections are mostly guessed.
const LITTLE_SEEN: f32 = 0.12;

/// The share of photo pairs from different sides whose backgrounds are the same; `None` where too few tell.
pub(super) fn same_background(
    dataset: &Dataset,
    thumbs: &[Thumb],
    problems: &mut Vec<Problem>,
) -> Option<f32> {
    if !dataset.surroundings_visible {
        return None;
    }
    let encoded: Vec<Vec<Option<f32>>> = thumbs.iter().map(encoded).collect();
    let is_plain = |values: &Vec<Option<f32>>| spread(values) < PLAIN;
    let n_plain = encoded.iter().filter(|values| is_plain(values)).count();
    if !thumbs.is_empty() && n_plain as f32 >= PLAIN_SHARE * thumbs.len() as f32 {
        let what = format!(
            "the background is plain in {n_plain} of {} photos",
            thumbs.len()
        );
        let advice =
            "light is learned from surroundings that can be seen: photograph without a backdrop";
        problems.push(Problem::new(Severity::Warning, what, advice));
        return None;
    }
    let detail: Vec<Vec<Option<f32>>> = thumbs
        .iter()
        .zip(&encoded)
        .map(|(thumb, values)| without_slope(values, thumb.camera.width))
        .collect();
    let correlations = wide_pairs(thumbs)
        .filter_map(|(a, b)| correlation(&detail[a], &detail[b]))
        .take(MAX_PAIRS);
    let (n_same, n) = correlations.fold((0, 0), |(n_same, n), c| {
        (n_same + usize::from(c > SAME), n + 1)
    });
    if n < MIN_PAIRS {
        return None;
    }
    let share = n_same as f32 / n as f32;
    if share > SAME_SHARE {
        let what = format!(
            "the background stands still in the picture while the camera goes around the object (the same in {:.0} % \
             of photos from different sides): a turntable, or a backdrop that is carried along",
            100.0 * share
        );
        let advice =
            "the light cannot be learned so: leave the object where it is and walk around it";
        problems.push(Problem::new(Severity::Error, what, advice));
    }
    Some(share)
}

/// Pairs of photos of one size from clearly different sides, spread over all of them.
fn wide_pairs(thumbs: &[Thumb]) -> impl Iterator<Item = (usize, usize)> + '_ {
    let n = thumbs.len();
    let pairs = (1..n).flat_map(move |step| (0..n - step).map(move |a| (a, a + step)));
    let n_pairs = n * n.saturating_sub(1) / 2;
    let stride = n_pairs.div_ceil(4 * MAX_PAIRS).max(1);
    pairs.step_by(stride).filter(|(a, b)| {
        let (a, b) = (&thumbs[*a].camera, &thumbs[*b].camera);
        (a.width, a.height) == (b.width, b.height) && a.forward().dot(b.forward()) < WIDE_COSINE
    })
}

fn encoded(thumb: &Thumb) -> Vec<Option<f32>> {
    let encode = |v: &Option<f32>| v.map(|v| crate::color::srgb_from_linear(v.clamp(0.0, 1.0)));
    thumb.background.iter().map(encode).collect()
}

/// What is left beside the plane that fits a background best: bright skies over dark floors are alike everywhere.
fn without_slope(values: &[Option<f32>], width: u32) -> Vec<Option<f32>> {
    let place = |i: usize| {
        let (x, y) = (i as u32 % width, i as u32 / width);
        Vec3::new(
            x as f32 / width as f32 - 0.5,
            y as f32 / width as f32 - 0.5,
            1.0,
        )
    };
    // A trace of the identity keeps the matrix of few pixels invertible.
    let mut matrix = Mat3::from_diagonal(Vec3::splat(1e-3));
    let mut right_side = Vec3::ZERO;
    for (i, value) in values.iter().enumerate() {
        if let Some(value) = value {
            let p = place(i);
            matrix += Mat3::from_cols(p.x * p, p.y * p, p.z * p);
            right_side += *value * p;
        }
    }
    let plane = matrix.inverse() * right_side;
    let rest = |(i, value): (usize, &Option<f32>)| value.map(|value| value - plane.dot(place(i)));
    values.iter().enumerate().map(rest).collect()
}

/// The standard deviation.
fn spread(values: &[Option<f32>]) -> f32 {
    let known: Vec<f32> = values.iter().flatten().copied().collect();
    let n = known.len().max(1) as f32;
    let mean = known.iter().sum::<f32>() / n;
    (known.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / n).sqrt()
}

/// How alike two backgrounds are where both are seen, -1 to 1, whatever their brightness; `None` where too little is
/// seen or to be seen.
fn correlation(a: &[Option<f32>], b: &[Option<f32>]) -> Option<f32> {
    let shared: Vec<(f32, f32)> = a.iter().zip(b).filter_map(|(a, b)| a.zip(*b)).collect();
    if shared.len() < MIN_SHARED {
        return None;
    }
    let n = shared.len() as f32;
    let mean_a = shared.iter().map(|(a, _)| a).sum::<f32>() / n;
    let mean_b = shared.iter().map(|(_, b)| b).sum::<f32>() / n;
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (a, b) in shared {
        let (a, b) = (a - mean_a, b - mean_b);
        ab += a * b;
        aa += a * a;
        bb += b * b;
    }
    let least = n * PLAIN * PLAIN;
    (aa > least && bb > least).then(|| ab / (aa * bb).sqrt())
}

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
    if share < LITTLE_SEEN && !dataset.train.is_empty() && dataset.surroundings_visible {
        let what = format!(
            "the photos look into {:.0} % of all directions",
            100.0 * share
        );
        let advice = "reflections of the rest are guessed: add photos from other sides";
        problems.push(Problem::new(Severity::Warning, what, advice));
    }
    share
}

/// Whether most training photos look at `center`: photos of the surroundings alone look anywhere.
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
