//! How bright lamps are that photos show as white: estimated from shading and blurred reflections.
//!
//! Over a stretch of surface of one colour the diffuse radiance varies as the irradiance does. Pairs of neighbouring
//! probes therefore compare `ln C_d` with `ln E`, where `E` is the sum of the lamps, each times its unknown gain, and
//! of everything else; a forgiving error lets the pairs across an edge of paint disagree (Retinex, Land and
//! `McCann` 1971, with the light known up to a few gains). What lobes gather has no albedo that is unknown. Where
//! little constrains the gains, a prior leaves them at 1.

use glam::Vec3;
use rayon::prelude::*;

use crate::render::irradiance::Probes;

/// Scale of the differences of logarithms that are believed.
const NOISE: f32 = 0.15;
/// Diffuse radiance at which a photo is half as informative as a bright one.
const DIM: f32 = 0.02;
/// Share of the mean irradiance below which there is no light.
const DARK: f32 = 0.005;
/// How many pairs a lobe is worth: nothing of it is unknown but the gains, and it is seen where it is bright.
const LOBE: f32 = 10.0;
/// Weight of the squared logarithm of a part's gain, in pairs, as long as that is small, and what is small: a lamp may be
/// clipped by far. Pairs that err together are many and say little, and an object that mirrors most of its light must not put
/// lamps out by how its diffuse rest varies.
const PRIOR: f32 = 6.0;
const AS_LEARNED: f32 = 0.2;
/// The same for its difference from the mean of all: lamps are as clipped as each other unless something indicates otherwise.
const EVENNESS: f32 = 1.0;
const EVEN: f32 = 0.5;
/// The same for the difference of a colour's gain from that of all.
const COLOR_PRIOR: f32 = 1.0;
/// Gains that are tried for all parts together, octaves.
const OCTAVES: std::ops::RangeInclusive<i32> = -4..=10;
/// Steps of gradient descent (Adam), and the logarithm of the gains that the first and the last one change at most.
const STEPS: usize = 300;
const FIRST_STEP: f32 = 0.2;
const LAST_STEP: f32 = 0.01;

/// What is known of the light that a place of the surface sends on, diffusely or along a lobe.
#[derive(Clone, Debug)]
pub(in crate::render) struct LitPlace {
    /// Radiance that the photos taught.
    pub(in crate::render) radiance: Vec3,
    /// How much that is believed, `[0, 1]`.
    pub(in crate::render) trust: f32,
    /// What it would be from everything but the lamps on a white surface.
    pub(in crate::render) rest: Vec3,
    /// The same from each part of the lamps as it was learned.
    pub(in crate::render) lamps: Vec<Vec3>,
}

impl LitPlace {
    /// What it would be on a white surface if lamps were brighter by these gains.
    pub(super) fn light(&self, gains: &[Vec3]) -> Vec3 {
        let lamps = self.lamps.iter().zip(gains);
        self.rest + lamps.map(|(light, gain)| *light * *gain).sum::<Vec3>()
    }
}

/// Gains of each of `n_parts` of the lamps, a colour, from the diffuse light `lit` of each of the `probes` and from `lobes`.
pub(in crate::render) fn lamp_gains(
    probes: &Probes,
    lit: &[LitPlace],
    lobes: &[&LitPlace],
    n_parts: usize,
) -> Vec<Vec3> {
    let mut pairs = pairs(probes, lit);
    pairs.extend(lobes.iter().enumerate().map(|(i, lobe)| Pair {
        a: lit.len() + i,
        b: None,
        weight: LOBE * lobe.trust,
    }));
    let lit: Vec<&LitPlace> = lit.iter().chain(lobes.iter().copied()).collect();
    let problem = Problem {
        lit: &lit,
        pairs: &pairs,
    };
    if pairs.is_empty() || n_parts == 0 {
        return vec![Vec3::ONE; n_parts];
    }
    let all = |octave: i32| vec![Vec3::splat(octave as f32 * std::f32::consts::LN_2); n_parts];
    let errors = OCTAVES.map(|octave| (octave, problem.error(&all(octave)).0));
    let best = errors.min_by(|a, b| a.1.total_cmp(&b.1));
    let mut logs = all(best.map_or(0, |(octave, _)| octave));
    let (mut mean, mut squares) = (vec![Vec3::ZERO; n_parts], vec![Vec3::ZERO; n_parts]);
    for step in 0..STEPS {
        let (_, slope) = problem.error(&logs);
        let rate = FIRST_STEP * (LAST_STEP / FIRST_STEP).powf(step as f32 / STEPS as f32);
        let [first, second] = [0.9_f32, 0.99].map(|b| 1.0 - b.powi(step as i32 + 1));
        for k in 0..n_parts {
            mean[k] = mean[k].lerp(slope[k], 0.1);
            squares[k] = squares[k].lerp(slope[k] * slope[k], 0.01);
            let size = (squares[k] / second).map(f32::sqrt) + 1e-8;
            logs[k] -= rate * (mean[k] / first) / size;
        }
    }
    logs.into_iter().map(|log| log.map(f32::exp)).collect()
}

/// Two neighbouring places, of about one albedo, and how informative they are.
struct Pair {
    a: usize,
    /// None where the albedo of `a` is 1.
    b: Option<usize>,
    weight: f32,
}

fn pairs(probes: &Probes, lit: &[LitPlace]) -> Vec<Pair> {
    let trust = |i: usize| {
        let dim = lit[i].radiance.element_sum() / 3.0;
        lit[i].trust * dim / (dim + DIM)
    };
    let mut pairs = Vec::new();
    for (a, probe) in probes.probes().iter().enumerate() {
        probes.near(probe.position, probe.normal, |b, near| {
            if b > a {
                let weight = near * trust(a) * trust(b);
                pairs.push(Pair {
                    a,
                    b: Some(b),
                    weight,
                });
            }
        });
    }
    pairs
}

struct Problem<'a> {
    lit: &'a [&'a LitPlace],
    pairs: &'a [Pair],
}

impl Problem<'_> {
    /// Error of the logarithms of gains, and its slope.
    fn error(&self, logs: &[Vec3]) -> (f32, Vec<Vec3>) {
        let gains: Vec<Vec3> = logs.iter().map(|log| log.map(f32::exp)).collect();
        let light = self.lit.par_iter().map(|place| place.light(&gains));
        let light: Vec<Vec3> = light.collect();
        let dark = DARK * light.iter().sum::<Vec3>() / light.len().max(1) as f32;
        let logarithm = |v: Vec3| v.max(Vec3::splat(1e-6)).map(f32::ln);
        let albedo: Vec<Vec3> = light
            .iter()
            .zip(self.lit)
            .map(|(light, probe)| logarithm(probe.radiance) - logarithm(*light + dark))
            .collect();
        let mut sum = 0.0;
        let mut by_albedo = vec![Vec3::ZERO; light.len()];
        for pair in self.pairs {
            let other = pair.b.map_or(Vec3::ZERO, |b| albedo[b]);
            let difference = (albedo[pair.a] - other) / NOISE;
            let squared = difference * difference;
            sum += pair.weight * squared.map(f32::ln_1p).element_sum();
            let slope = 2.0 * pair.weight / NOISE * difference / (squared + 1.0);
            by_albedo[pair.a] += slope;
            if let Some(b) = pair.b {
                by_albedo[b] -= slope;
            }
        }
        let mut slope = self.by_gain(&by_albedo, &light, dark);
        let mean = logs.iter().sum::<Vec3>() / logs.len().max(1) as f32;
        for ((slope, log), gain) in slope.iter_mut().zip(logs).zip(&gains) {
            let grey = log.element_sum() / 3.0;
            let (color, uneven) = (*log - grey, *log - mean);
            let gained = 1.0 + grey * grey / (AS_LEARNED * AS_LEARNED);
            let unlike = 1.0 + uneven.length_squared() / (EVEN * EVEN);
            sum += PRIOR * AS_LEARNED * AS_LEARNED * gained.ln();
            sum += EVENNESS * EVEN * EVEN * unlike.ln();
            sum += COLOR_PRIOR * color.length_squared();
            // The mean counts as given.
            let by_prior =
                PRIOR / (3.0 * gained) * grey + COLOR_PRIOR * color + EVENNESS / unlike * uneven;
            *slope = *slope * *gain + 2.0 * by_prior;
        }
        (sum, slope)
    }

    /// From the slope by the logarithms of the albedos to that by the gains; what is dark counts as given.
    fn by_gain(&self, by_albedo: &[Vec3], light: &[Vec3], dark: Vec3) -> Vec<Vec3> {
        let n_parts = self.lit.first().map_or(0, |probe| probe.lamps.len());
        let pieces: Vec<Vec<Vec3>> = self
            .lit
            .par_chunks(256)
            .zip(by_albedo.par_chunks(256).zip(light.par_chunks(256)))
            .map(|(lit, (by_albedo, light))| {
                let mut slope = vec![Vec3::ZERO; n_parts];
                for ((probe, by_albedo), light) in lit.iter().zip(by_albedo).zip(light) {
                    let by_light = -*by_albedo / (*light + dark);
                    for (slope, lamp) in slope.iter_mut().zip(&probe.lamps) {
                        *slope += by_light * *lamp;
                    }
                }
                slope
            })
            .collect();
        let mut slope = vec![Vec3::ZERO; n_parts];
        for piece in pieces {
            slope.iter_mut().zip(piece).for_each(|(sum, v)| *sum += v);
        }
        slope
    }
}
