//! Blurred photos: detected by what a further blur takes from them (Crete et al. 2007, "The blur effect").

use rayon::prelude::*;

use crate::color::luminance;
use crate::data::problem::first_names;
use crate::data::{Dataset, Photo, Problem, Severity};

/// Half the length of the further blur, pixels.
const HALF_WINDOW: usize = 4;
/// How much more blurred than the median a photo is that stands out.
const STANDS_OUT: f32 = 0.12;
/// And by how many typical deviations.
const N_DEVIATIONS: f32 = 6.0;
/// Fewest photos among which one can stand out.
const MIN_VIEWS: usize = 8;

/// Names the training photos that are much more blurred than the others.
pub(super) fn find_blurred(dataset: &Dataset, problems: &mut Vec<Problem>) -> Vec<String> {
    let blurs: Vec<f32> = dataset
        .train
        .par_iter()
        .map(|view| blur(&view.photo))
        .collect();
    if blurs.len() < MIN_VIEWS {
        return Vec::new();
    }
    let middle = median(blurs.clone());
    let deviation = median(blurs.iter().map(|blur| (blur - middle).abs()).collect());
    let limit = middle + STANDS_OUT.max(N_DEVIATIONS * deviation);
    let blurred = dataset.train.iter().zip(&blurs);
    let names: Vec<String> = blurred
        .filter(|(_, blur)| **blur > limit)
        .map(|(view, _)| view.name.clone())
        .collect();
    if !names.is_empty() {
        let what = format!(
            "{} photos are much more blurred than the others: {}",
            names.len(),
            first_names(&names)
        );
        let advice = "shaken or out of focus: leave them out, they blur the reflections";
        problems.push(Problem::new(Severity::Warning, what, advice));
    }
    names
}

/// How blurred a photo is, 0 (sharp) to 1: the larger of both axes.
fn blur(photo: &Photo) -> f32 {
    let (width, height) = (photo.width() as usize, photo.height() as usize);
    let values: Vec<f32> = (0..photo.n_pixels())
        .map(|i| luminance(photo.srgb(i).into()))
        .collect();
    let rows = axis_blur((0..height).map(|y| values[y * width..(y + 1) * width].to_vec()));
    let column = |x: usize| values[x..].iter().step_by(width).copied().collect();
    let columns = axis_blur((0..width).map(column));
    rows.max(columns)
}

/// The share of the variation along lines that a further blur leaves.
fn axis_blur(lines: impl Iterator<Item = Vec<f32>>) -> f32 {
    let (mut whole, mut lost) = (0.0_f64, 0.0_f64);
    for line in lines {
        let smooth = smoothed(&line);
        for (sharp, smooth) in line.windows(2).zip(smooth.windows(2)) {
            let variation = (sharp[1] - sharp[0]).abs();
            whole += f64::from(variation);
            lost += f64::from((variation - (smooth[1] - smooth[0]).abs()).max(0.0));
        }
    }
    // A photo of one colour is as blurred as can be; it is reported elsewhere.
    if whole > 0.0 {
        ((whole - lost) / whole) as f32
    } else {
        1.0
    }
}

/// Running means over the pixels at most [`HALF_WINDOW`] away.
fn smoothed(line: &[f32]) -> Vec<f32> {
    let sums: Vec<f32> = std::iter::once(0.0)
        .chain(line.iter().scan(0.0, |sum, v| {
            *sum += v;
            Some(*sum)
        }))
        .collect();
    (0..line.len())
        .map(|i| {
            let (from, to) = (
                i.saturating_sub(HALF_WINDOW),
                (i + HALF_WINDOW + 1).min(line.len()),
            );
            (sums[to] - sums[from]) / (to - from) as f32
        })
        .collect()
}

/// The upper one of the middle values; 0 of none.
pub(super) fn median(mut values: Vec<f32>) -> f32 {
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise, smoothed over `2 * n + 1` pixels a row.
    fn photo(n: usize) -> Photo {
        let (width, height) = (64_usize, 48_usize);
        let sharp = |x: usize, y: usize| ((x * 73_856_093) ^ (y * 19_349_663)) % 97;
        let pixels = (0..width * height)
            .map(|i| {
                let (x, y) = (i % width, i / width);
                let near = x.saturating_sub(n)..(x + n + 1).min(width);
                let n_near = near.len() as f32;
                let v = near.map(|x| sharp(x, y) as f32).sum::<f32>() / n_near;
                [(2.6 * v) as u8; 3]
            })
            .collect();
        Photo::Rgb8 {
            width: width as u32,
            height: height as u32,
            pixels,
            chroma_block: [1, 1],
        }
    }

    #[test]
    fn a_blurred_photo_is_more_blurred_than_a_sharp_one() {
        let blurs: Vec<f32> = [0, 1, 4].map(|n| blur(&photo(n))).to_vec();
        assert!(blurs[0] < blurs[1] && blurs[1] < blurs[2], "{blurs:?}");
        assert!(blurs.iter().all(|b| (0.0..=1.0).contains(b)), "{blurs:?}");
    }
}
