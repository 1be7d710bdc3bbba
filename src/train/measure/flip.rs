//! FLIP: how different two pictures look to a person who flips between them, 0 to 1.
//!
//! LDR-FLIP of Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images"
//! (doi 10.1145/3406183), with the constants, borders and normalisation of the authors' reference
//! implementation (github.com/NVlabs/flip, version 1.7): pictures 0.7 m away on a 4K screen 0.7 m
//! wide. Colours that the eye cannot resolve are blurred together before they are compared;
//! differences of edges and points make a pixel's colour difference count more.
//! Planes are `[height][width]`, row-major; pixels beyond the border repeat the border's.

use std::f32::consts::{PI, SQRT_2};

use rayon::prelude::*;

use crate::color::linear_from_srgb;

/// Pixels of the picture in a degree of the visual field: 3840 columns on 0.7 m, seen from 0.7 m.
const PIXELS_PER_DEGREE: f32 = 3840.0 * PI / 180.0;

/// Amplitude and width (degrees^2) of the Gaussian that is the eye's contrast sensitivity to
/// lightness (Table 1 of the paper; a sensitivity is the Fourier transform of its blur).
const LIGHTNESS_BLUR: (f32, f32) = (1.0, 0.0047);
/// The same for red against green.
const RED_GREEN_BLUR: (f32, f32) = (1.0, 0.0053);
/// The same for blue against yellow: a sum of two Gaussians.
const BLUE_YELLOW_BLUR: [(f32, f32); 2] = [(34.1, 0.04), (13.5, 0.025)];
/// Exponent of the colour difference (`q_c`).
const COLOUR_EXPONENT: f32 = 0.7;
/// Exponent of the feature difference (`q_f`).
const FEATURE_EXPONENT: f32 = 0.5;
/// Share of the largest colour difference that is mapped to [`KNEE_ERROR`] (`p_c`).
const KNEE: f32 = 0.4;
/// Error at the knee (`p_t`): the larger differences share what is left up to 1.
const KNEE_ERROR: f32 = 0.95;
/// Peak-to-trough distance of the eye's edge detector, in degrees (`w`).
const FEATURE_WIDTH_DEG: f32 = 0.082;

/// CIE XYZ of linear Rec. 709, white point D65, as the reference rounds it.
const XYZ_FROM_LINEAR: [[f32; 3]; 3] = [
    [
        (10_135_552_f64 / 24_577_794.0) as f32,
        (8_788_810_f64 / 24_577_794.0) as f32,
        (4_435_075_f64 / 24_577_794.0) as f32,
    ],
    [
        (2_613_072_f64 / 12_288_897.0) as f32,
        (8_788_810_f64 / 12_288_897.0) as f32,
        (887_015_f64 / 12_288_897.0) as f32,
    ],
    [
        (1_425_312_f64 / 73_733_382.0) as f32,
        (8_788_810_f64 / 73_733_382.0) as f32,
        (70_074_185_f64 / 73_733_382.0) as f32,
    ],
];
/// The inverse of [`XYZ_FROM_LINEAR`].
const LINEAR_FROM_XYZ: [[f32; 3]; 3] = [
    [3.241_003_3, -1.537_398_9, -0.498_615_86],
    [-0.969_224_33, 1.875_930_1, 0.041_554_224],
    [0.055_639_423, -0.204_011_2, 1.057_148_9],
];
/// XYZ of the white point.
const WHITE: [f32; 3] = [0.950_428_55, 1.0, 1.088_900_4];
/// Its reciprocal, as the reference rounds it.
const PER_WHITE: [f32; 3] = [1.052_156_9, 1.0, 0.918_357_7];

/// The mean FLIP error over the pixels of two pictures, as [`error_map`] takes them. `None` for
/// pictures without pixels or with values that are not finite.
///
/// # Panics
/// When the lengths do not agree or are no multiple of `width`: a bug of the caller.
pub fn mean_error(a: &[[f32; 3]], b: &[[f32; 3]], width: usize) -> Option<f64> {
    let finite = |image: &[[f32; 3]]| image.as_flattened().iter().all(|v| v.is_finite());
    if a.is_empty() || !finite(a) || !finite(b) {
        return None;
    }
    let map = error_map(a, b, width);
    Some(map.iter().map(|e| f64::from(*e)).sum::<f64>() / map.len() as f64)
}

/// The FLIP error of each pixel, `[height][width]` in `[0, 1]`, which is the same in either order.
/// Both pictures are `[height][width]` of sRGB; values outside `[0, 1]` are clamped.
///
/// # Panics
/// When the lengths do not agree or are no multiple of `width`: a bug of the caller.
pub fn error_map(a: &[[f32; 3]], b: &[[f32; 3]], width: usize) -> Vec<f32> {
    assert_eq!(a.len(), b.len(), "images must have one size");
    if a.is_empty() {
        return Vec::new();
    }
    assert!(a.len().is_multiple_of(width), "the last row must be whole");
    let [a, b] = [a, b].map(|image| Appearance::of(image, width));
    let max_colour = max_colour_difference();
    (0..a.colour.len())
        .into_par_iter()
        .map(|i| {
            let colour = hyab(a.colour[i], b.colour[i]).powf(COLOUR_EXPONENT);
            let edge = (a.edges[i] - b.edges[i]).abs();
            let point = (a.points[i] - b.points[i]).abs();
            let feature = (edge.max(point) / SQRT_2).powf(FEATURE_EXPONENT);
            redistribute(colour, max_colour).powf(1.0 - feature)
        })
        .collect()
}

/// What the eye makes of a picture, by pixel.
struct Appearance {
    /// Hunt-adjusted L*a*b* of the blurred picture.
    colour: Vec<[f32; 3]>,
    /// Strength of the edge there, about 0..1.
    edges: Vec<f32>,
    /// Strength of the point there, about 0..1.
    points: Vec<f32>,
}

impl Appearance {
    fn of(image: &[[f32; 3]], width: usize) -> Self {
        let opponent = image.par_iter().map(|srgb| ycxcz_from_srgb(*srgb));
        let opponent: Vec<[f32; 3]> = opponent.collect();
        let plane = |c: usize| -> Vec<f32> { opponent.iter().map(|v| v[c]).collect() };
        // Lightness in 0..1.
        let grey: Vec<f32> = opponent.iter().map(|v| (v[0] + 16.0) / 116.0).collect();
        let taps = FeatureTaps::new();
        Self {
            colour: seen_colours([plane(0), plane(1), plane(2)], width),
            edges: gradient_length(&grey, width, &taps.first_derivative, &taps.gaussian),
            points: gradient_length(&grey, width, &taps.second_derivative, &taps.gaussian),
        }
    }
}

/// Blurs the planes of Y, Cx and Cz as the eye does and converts to Hunt-adjusted L*a*b*.
fn seen_colours([y, cx, cz]: [Vec<f32>; 3], width: usize) -> Vec<[f32; 3]> {
    let blurred = |plane: &[f32], blurs: &[(f32, f32)]| {
        let kernels = blur_taps(blurs);
        let parts = kernels.iter().map(|taps| filter(plane, width, taps, taps));
        parts
            .reduce(|sum, part| sum.iter().zip(&part).map(|(a, b)| a + b).collect())
            .expect("at least one Gaussian a channel")
    };
    let y = blurred(&y, &[LIGHTNESS_BLUR]);
    let cx = blurred(&cx, &[RED_GREEN_BLUR]);
    let cz = blurred(&cz, &BLUE_YELLOW_BLUR);
    (0..y.len())
        .into_par_iter()
        .map(|i| {
            let linear = linear_from_ycxcz([y[i], cx[i], cz[i]]);
            hunt_adjusted_lab(linear.map(|v| v.clamp(0.0, 1.0)))
        })
        .collect()
}

/// Taps of the Gaussians whose sum is a channel's blur; each is applied along rows and columns.
/// The sum of all two-dimensional weights is 1.
fn blur_taps(blurs: &[(f32, f32)]) -> Vec<Vec<f32>> {
    // All channels share the radius that the widest Gaussian needs: three standard deviations.
    let widest = BLUE_YELLOW_BLUR[0].1;
    let radius = (3.0 * (widest / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
    let mut kernels: Vec<Vec<f32>> = blurs
        .iter()
        .map(|(amplitude, spread)| {
            let peak = (amplitude * (PI / spread).sqrt()).sqrt();
            let tap = |x: i32| {
                let deg = x as f32 / PIXELS_PER_DEGREE;
                peak * (-PI * PI * deg * deg / spread).exp()
            };
            (-radius..=radius).map(tap).collect()
        })
        .collect();
    let square_of_sum = |taps: &Vec<f32>| taps.iter().sum::<f32>().powi(2);
    let norm = kernels.iter().map(square_of_sum).sum::<f32>().sqrt();
    for tap in kernels.iter_mut().flatten() {
        *tap /= norm;
    }
    kernels
}

/// Taps of the edge and point detectors.
struct FeatureTaps {
    /// Sums to 1.
    gaussian: Vec<f32>,
    /// Positive taps sum to 1, negative ones to -1: finds edges.
    first_derivative: Vec<f32>,
    /// Likewise: finds points and lines.
    second_derivative: Vec<f32>,
}

impl FeatureTaps {
    fn new() -> Self {
        let sigma = 0.5 * FEATURE_WIDTH_DEG * PIXELS_PER_DEGREE;
        let radius = (3.0 * sigma).ceil() as i32;
        let gauss = |x: f32| (-x * x / (2.0 * sigma * sigma)).exp();
        let taps = |f: &dyn Fn(f32) -> f32| -> Vec<f32> {
            balanced((-radius..=radius).map(|x| f(x as f32)).collect())
        };
        Self {
            gaussian: taps(&gauss),
            first_derivative: taps(&|x| -x * gauss(x)),
            second_derivative: taps(&|x| (x * x / (sigma * sigma) - 1.0) * gauss(x)),
        }
    }
}

/// Scales positive taps to the sum 1 and negative ones to -1.
fn balanced(taps: Vec<f32>) -> Vec<f32> {
    let positive: f32 = taps.iter().filter(|t| **t > 0.0).sum();
    let negative: f32 = -taps.iter().filter(|t| **t < 0.0).sum::<f32>();
    let scaled = |t: f32| t / if t > 0.0 { positive } else { negative };
    let scaled = |t: f32| if t == 0.0 { 0.0 } else { scaled(t) };
    taps.into_iter().map(scaled).collect()
}

/// Length of the vector of the derivatives along x and y.
fn gradient_length(plane: &[f32], width: usize, derivative: &[f32], gaussian: &[f32]) -> Vec<f32> {
    let along_x = filter(plane, width, derivative, gaussian);
    let along_y = filter(plane, width, gaussian, derivative);
    let both = along_x.iter().zip(&along_y);
    both.map(|(x, y)| x.hypot(*y)).collect()
}

/// Correlates a plane with `taps_x` along its rows and `taps_y` along its columns.
fn filter(plane: &[f32], width: usize, taps_x: &[f32], taps_y: &[f32]) -> Vec<f32> {
    filter_columns(&filter_rows(plane, width, taps_x), width, taps_y)
}

fn filter_rows(plane: &[f32], width: usize, taps: &[f32]) -> Vec<f32> {
    let radius = taps.len() / 2;
    let mut out = vec![0.0; plane.len()];
    let rows = out
        .par_chunks_exact_mut(width)
        .zip(plane.par_chunks_exact(width));
    rows.for_each_init(Vec::new, |padded, (out, row)| {
        padded.clear();
        padded.extend(std::iter::repeat_n(row[0], radius));
        padded.extend_from_slice(row);
        padded.extend(std::iter::repeat_n(row[width - 1], radius));
        for (k, tap) in taps.iter().enumerate() {
            add_scaled(out, *tap, &padded[k..][..width]);
        }
    });
    out
}

fn filter_columns(plane: &[f32], width: usize, taps: &[f32]) -> Vec<f32> {
    let radius = taps.len() / 2;
    let last = plane.len() / width - 1;
    let mut out = vec![0.0; plane.len()];
    let rows = out.par_chunks_exact_mut(width).enumerate();
    rows.for_each(|(y, out)| {
        for (k, tap) in taps.iter().enumerate() {
            let source = (y + k).saturating_sub(radius).min(last);
            add_scaled(out, *tap, &plane[source * width..][..width]);
        }
    });
    out
}

fn add_scaled(out: &mut [f32], scale: f32, values: &[f32]) {
    for (sum, value) in out.iter_mut().zip(values) {
        *sum += scale * value;
    }
}

/// Maps a colour difference to `[0, 1]`: linearly in two pieces that meet at the knee.
fn redistribute(difference: f32, max: f32) -> f32 {
    let knee = KNEE * max;
    if difference < knee {
        KNEE_ERROR / knee * difference
    } else {
        KNEE_ERROR + (difference - knee) / (max - knee) * (1.0 - KNEE_ERROR)
    }
}

/// The largest colour difference there is, between pure green and pure blue, after its exponent.
fn max_colour_difference() -> f32 {
    let [green, blue] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(hunt_adjusted_lab);
    hyab(green, blue).powf(COLOUR_EXPONENT)
}

/// City-block distance in lightness plus Euclidean distance in chroma (`HyAB`).
fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

/// CIE L*a*b* with chroma scaled by lightness: colours look less colourful in the dark (Hunt).
fn hunt_adjusted_lab(linear: [f32; 3]) -> [f32; 3] {
    const DELTA: f32 = 6.0 / 29.0;
    let xyz = multiply(&XYZ_FROM_LINEAR, linear);
    let [x, y, z] = std::array::from_fn(|c| {
        let t = xyz[c] * PER_WHITE[c];
        if t > DELTA * DELTA * DELTA {
            t.cbrt()
        } else {
            t / (3.0 * DELTA * DELTA) + 4.0 / 29.0
        }
    });
    let lightness = 116.0 * y - 16.0;
    let hunt = 0.01 * lightness;
    [lightness, hunt * 500.0 * (x - y), hunt * 200.0 * (y - z)]
}

/// The linearised opponent space `YCxCz`: L*a*b* without its cube root.
fn ycxcz_from_srgb(srgb: [f32; 3]) -> [f32; 3] {
    let linear = srgb.map(|v| linear_from_srgb(v.clamp(0.0, 1.0)));
    let xyz = multiply(&XYZ_FROM_LINEAR, linear);
    let [x, y, z] = std::array::from_fn(|c| xyz[c] * PER_WHITE[c]);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn linear_from_ycxcz([y, cx, cz]: [f32; 3]) -> [f32; 3] {
    let y = (y + 16.0) / 116.0;
    let [x, z] = [y + cx / 500.0, y - cz / 200.0];
    multiply(&LINEAR_FROM_XYZ, [x * WHITE[0], y * WHITE[1], z * WHITE[2]])
}

fn multiply(matrix: &[[f32; 3]; 3], v: [f32; 3]) -> [f32; 3] {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of 8-bit codes given by a formula, which the reference program got too.
    fn picture(width: usize, height: usize, code: impl Fn(i64, i64, i64) -> i64) -> Vec<[f32; 3]> {
        let pixel = |i: usize, c: usize| code((i % width) as i64, (i / width) as i64, c as i64);
        (0..width * height)
            .map(|i| std::array::from_fn(|c| pixel(i, c) as f32 / 255.0))
            .collect()
    }

    fn gradient(k: i64) -> Vec<[f32; 3]> {
        picture(48, 40, |x, y, c| {
            (x * (5 - c) + y * (1 + 2 * c) + k * ((x * 3 + y * 5 + c) % 9)) % 256
        })
    }

    /// A checkerboard of 48 x 40 pixels.
    fn board(k: i64) -> Vec<[f32; 3]> {
        checkerboard(k, 48, 40)
    }

    fn checkerboard(k: i64, width: usize, height: usize) -> Vec<[f32; 3]> {
        picture(width, height, |x, y, c| {
            if ((x + k) / 6 + y / 6) % 2 == 0 {
                230 - 30 * c
            } else {
                20 + 40 * c
            }
        })
    }

    fn blob(k: i64) -> Vec<[f32; 3]> {
        picture(48, 40, |x, y, c| {
            let distance = (x - 20 - k).pow(2) + (y - 18).pow(2);
            (255 - distance * (1 + c) / 2).max(0)
        })
    }

    fn flat(rgb: [i64; 3]) -> Vec<[f32; 3]> {
        picture(48, 40, |_, _, c| rgb[c as usize])
    }

    fn assert_close(found: f64, expected: f64, what: &str) {
        assert!(
            (found - expected).abs() < 2e-5,
            "{what}: {found}, expected {expected}"
        );
    }

    /// Expected values: `evaluate(a, b, "LDR", applyMagma=False)` of the authors' package
    /// `flip-evaluator` 1.7 (C++ in single precision), default parameters, on the same pictures.
    #[test]
    fn means_equal_those_of_the_reference_program() {
        let small = |k| checkerboard(k, 7, 5);
        let (orange, darker) = (flat([200, 100, 50]), flat([190, 110, 60]));
        let (green, blue) = (flat([0, 255, 0]), flat([0, 0, 255]));
        let pairs = [
            ("gradients", gradient(0), gradient(3), 48, 0.330_482_51),
            ("checkerboards", board(0), board(1), 48, 0.289_325_70),
            ("blobs", blob(0), blob(4), 48, 0.418_527_21),
            ("smaller than filters", small(0), small(3), 7, 0.721_379_78),
            ("unlike pictures", gradient(0), board(0), 48, 0.763_071_55),
            ("flat colours", orange, darker, 48, 0.197_824_28),
            ("green and blue", green, blue, 48, 1.0),
        ];
        for (name, a, b, width, expected) in pairs {
            let mean = mean_error(&a, &b, width).unwrap();
            assert_close(mean, expected, name);
            assert_close(mean_error(&b, &a, width).unwrap(), expected, name);
        }
    }

    /// The same program's values at four pixels: corners included, where borders matter.
    #[test]
    fn maps_equal_those_of_the_reference_program() {
        let maps = [
            (
                error_map(&gradient(0), &gradient(3), 48),
                [0.134_284_79, 0.238_297_98, 0.309_676_11, 0.215_888_74],
            ),
            (
                error_map(&board(0), &board(1), 48),
                [0.081_288_72, 0.227_565_41, 0.970_558_23, 0.610_963_25],
            ),
        ];
        for (map, expected) in maps {
            for ((x, y), expected) in [(0, 0), (3, 2), (47, 39), (24, 20)]
                .into_iter()
                .zip(expected)
            {
                assert_close(
                    f64::from(map[y * 48 + x]),
                    expected,
                    &format!("pixel {x},{y}"),
                );
            }
        }
    }

    #[test]
    fn equal_pictures_have_no_error_and_broken_ones_no_value() {
        assert_eq!(mean_error(&gradient(1), &gradient(1), 48), Some(0.0));
        assert_eq!(mean_error(&[], &[], 1), None);
        assert_eq!(mean_error(&[[f32::NAN; 3]], &[[0.5; 3]], 1), None);
    }
}
