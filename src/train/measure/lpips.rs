//! LPIPS: how different two pictures look, by the features of a network trained on photos.
//!
//! Version 0.1 of Zhang et al. 2018, "The Unreasonable Effectiveness of Deep Features as a
//! Perceptual Metric" (arXiv:1801.03924), as github.com/richzhang/PerceptualSimilarity computes
//! it, on `AlexNet` or `SqueezeNet` 1.1. The weights are not part of this program: they come in a
//! safetensors file with the names that torchvision gives the network (`features.N.weight`,
//! `features.N.bias`) and `linK.model.1.weight` for the weights of the K-th layer's features.

use std::path::Path;

use super::convolution::{
    Convolution, ConvolutionShape, FeatureMap, LastWindow, max_pool, pooled_side,
};
use crate::data::files::tensor_file::{TensorFile, TensorFileError};

/// Mean of the pictures that the networks were trained on, in `[-1, 1]` of sRGB.
const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
/// Their standard deviation, in the same unit.
const SCALE: [f32; 3] = [0.458, 0.448, 0.450];
/// Keeps features that are zero in all channels from being divided by zero.
const NORM_EPSILON: f64 = 1e-10;

/// The network that makes the features.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::Display)]
pub enum Backbone {
    /// `AlexNet`, five layers of features: what most papers print.
    AlexNet,
    /// `SqueezeNet` 1.1, seven layers of features.
    SqueezeNet,
}

/// The trained measure.
#[derive(Clone, Debug)]
pub struct Lpips {
    backbone: Backbone,
    stages: Vec<Stage>,
}

/// A part of the network, behind which features are compared.
#[derive(Clone, Debug)]
struct Stage {
    steps: Vec<Step>,
    /// `[channels]`: how much each feature counts.
    head: Vec<f32>,
}

#[derive(Clone, Debug)]
enum Step {
    Convolve(Convolution),
    Pool(LastWindow),
    /// `SqueezeNet`'s module: few channels, then two convolutions of them beside each other.
    Fire {
        squeeze: Convolution,
        expand1x1: Convolution,
        expand3x3: Convolution,
    },
}

impl Step {
    /// None when the map is too small.
    fn forward(&self, map: &FeatureMap) -> Option<FeatureMap> {
        match self {
            Self::Convolve(convolution) => convolution.forward_relu(map),
            Self::Pool(last) => max_pool(map, *last),
            Self::Fire {
                squeeze,
                expand1x1,
                expand3x3,
            } => {
                let few = squeeze.forward_relu(map)?;
                Some((expand1x1.forward_relu(&few)?).beside(&expand3x3.forward_relu(&few)?))
            }
        }
    }

    fn output_side(&self, side: usize) -> Option<usize> {
        match self {
            Self::Convolve(convolution) => convolution.shape.output_side(side),
            Self::Pool(last) => pooled_side(side, *last),
            Self::Fire { .. } => Some(side),
        }
    }
}

impl Lpips {
    /// Reads the weights of either network; the tensors' names say which one it is.
    ///
    /// # Errors
    /// When the file cannot be read, or naming file and tensor when one is missing or of another
    /// shape.
    pub fn read(path: &Path) -> Result<Self, TensorFileError> {
        Self::from_tensors(&TensorFile::read(path)?)
    }

    /// Takes the weights out of a file that was read; see [`Self::read`].
    ///
    /// # Errors
    /// Naming file and tensor, when one is missing or of another shape.
    pub fn from_tensors(file: &TensorFile) -> Result<Self, TensorFileError> {
        let backbone = if file.tensors.keys().any(|name| name.contains(".squeeze.")) {
            Backbone::SqueezeNet
        } else {
            Backbone::AlexNet
        };
        let stages = match backbone {
            Backbone::AlexNet => alexnet(file)?,
            Backbone::SqueezeNet => squeezenet(file)?,
        };
        Ok(Self { backbone, stages })
    }

    /// Which network the weights are of.
    pub fn backbone(&self) -> Backbone {
        self.backbone
    }

    /// Fewest rows or columns of a picture that the network can take.
    pub fn min_side(&self) -> usize {
        let steps = self.stages.iter().flat_map(|stage| &stage.steps);
        let fits = |side: &usize| steps.clone().try_fold(*side, |s, step| step.output_side(s));
        // Both networks need far less than the bound, which only keeps the search finite.
        (1..=1024)
            .find(|side| fits(side).is_some())
            .unwrap_or(usize::MAX)
    }

    /// The distance of two pictures, 0 for equal ones, about 0 to 1, the same in either order.
    /// Both are `[height][width]` of sRGB; values outside `[0, 1]` are clamped. `None` for
    /// pictures with a side below [`Self::min_side`] or values that are not finite.
    ///
    /// # Panics
    /// When the lengths do not agree or are no multiple of `width`: a bug of the caller.
    pub fn distance(&self, a: &[[f32; 3]], b: &[[f32; 3]], width: usize) -> Option<f64> {
        assert_eq!(a.len(), b.len(), "images must have one size");
        let mut maps = [network_input(a, width)?, network_input(b, width)?];
        let mut distance = 0.0;
        for stage in &self.stages {
            for map in &mut maps {
                for step in &stage.steps {
                    *map = step.forward(map)?;
                }
            }
            distance += feature_distance(&maps, &stage.head);
        }
        distance.is_finite().then_some(distance)
    }
}

/// The picture as the networks were trained to see it; none without finite pixels.
fn network_input(image: &[[f32; 3]], width: usize) -> Option<FeatureMap> {
    if image.is_empty() || !image.as_flattened().iter().all(|v| v.is_finite()) {
        return None;
    }
    assert!(
        image.len().is_multiple_of(width),
        "the last row must be whole"
    );
    let normalised = |srgb: &[f32; 3]| -> [f32; 3] {
        std::array::from_fn(|c| (srgb[c].clamp(0.0, 1.0) * 2.0 - 1.0 - SHIFT[c]) / SCALE[c])
    };
    Some(FeatureMap {
        width,
        channels: 3,
        values: image.iter().flat_map(normalised).collect(),
    })
}

/// Mean over pixels of the weighted squared difference of the features, each pixel's features
/// scaled to length 1 (Eq. 1 of arXiv:1801.03924; the square of its weights is `head`).
fn feature_distance([a, b]: &[FeatureMap; 2], head: &[f32]) -> f64 {
    let scale = |features: &[f32]| {
        let squares = features.iter().map(|v| f64::from(*v).powi(2));
        1.0 / (squares.sum::<f64>().sqrt() + NORM_EPSILON)
    };
    let pixels = a
        .values
        .chunks_exact(a.channels)
        .zip(b.values.chunks_exact(b.channels));
    let n_pixels = pixels.len();
    let sum: f64 = pixels
        .map(|(a, b)| {
            let (scale_a, scale_b) = (scale(a), scale(b));
            let terms = a.iter().zip(b).zip(head).map(|((a, b), weight)| {
                let difference = f64::from(*a) * scale_a - f64::from(*b) * scale_b;
                f64::from(*weight) * difference * difference
            });
            terms.sum::<f64>()
        })
        .sum();
    sum / n_pixels as f64
}

/// torchvision's `alexnet().features`, cut behind each activation.
fn alexnet(file: &TensorFile) -> Result<Vec<Stage>, TensorFileError> {
    // Number of the layer; channels in and out; side, stride and padding of the window.
    let layers = [
        (0, 3, 64, 11, 4, 2),
        (3, 64, 192, 5, 1, 2),
        (6, 192, 384, 3, 1, 1),
        (8, 384, 256, 3, 1, 1),
        (10, 256, 256, 3, 1, 1),
    ];
    let mut stages = Vec::with_capacity(layers.len());
    for (number, n_in, n_out, side, stride, padding) in layers {
        let mut steps = Vec::new();
        if matches!(number, 3 | 6) {
            steps.push(Step::Pool(LastWindow::Dropped));
        }
        let (name, window) = (format!("features.{number}"), [side, stride, padding]);
        let layer = convolution(file, &name, [n_in, n_out], window)?;
        steps.push(Step::Convolve(layer));
        stages.push(stage(file, stages.len(), steps, n_out)?);
    }
    Ok(stages)
}

/// torchvision's `squeezenet1_1().features`, cut as LPIPS does: before each pooling, then behind
/// each of the last modules.
fn squeezenet(file: &TensorFile) -> Result<Vec<Stage>, TensorFileError> {
    let first = convolution(file, "features.0", [3, 64], [3, 2, 0])?;
    let mut stages = vec![stage(file, 0, vec![Step::Convolve(first)], 64)?];
    // Modules of a stage: number, channels in, in between, and of each of both outputs.
    let modules: [&[(usize, usize, usize, usize)]; 6] = [
        &[(3, 64, 16, 64), (4, 128, 16, 64)],
        &[(6, 128, 32, 128), (7, 256, 32, 128)],
        &[(9, 256, 48, 192)],
        &[(10, 384, 48, 192)],
        &[(11, 384, 64, 256)],
        &[(12, 512, 64, 256)],
    ];
    for modules in modules {
        let mut steps = Vec::new();
        if stages.len() <= 3 {
            steps.push(Step::Pool(LastWindow::Cut));
        }
        let mut channels = 0;
        for (number, n_in, n_between, n_each) in modules {
            steps.push(fire(file, *number, [*n_in, *n_between, *n_each])?);
            channels = 2 * n_each;
        }
        stages.push(stage(file, stages.len(), steps, channels)?);
    }
    Ok(stages)
}

fn fire(
    file: &TensorFile,
    number: usize,
    [n_in, n_between, n_each]: [usize; 3],
) -> Result<Step, TensorFileError> {
    let part = |name: &str, n_in, n_out, side| {
        let name = format!("features.{number}.{name}");
        convolution(file, &name, [n_in, n_out], [side, 1, side / 2])
    };
    Ok(Step::Fire {
        squeeze: part("squeeze", n_in, n_between, 1)?,
        expand1x1: part("expand1x1", n_between, n_each, 1)?,
        expand3x3: part("expand3x3", n_between, n_each, 3)?,
    })
}

fn convolution(
    file: &TensorFile,
    name: &str,
    [n_in, n_out]: [usize; 2],
    [side, stride, padding]: [usize; 3],
) -> Result<Convolution, TensorFileError> {
    let shape = ConvolutionShape {
        n_in,
        n_out,
        side,
        stride,
        padding,
    };
    let weights = file.f32(&format!("{name}.weight"), &[n_out, n_in, side, side])?;
    let bias = file.f32(&format!("{name}.bias"), &[n_out])?;
    Ok(Convolution::new(shape, weights, bias))
}

fn stage(
    file: &TensorFile,
    index: usize,
    steps: Vec<Step>,
    channels: usize,
) -> Result<Stage, TensorFileError> {
    let name = format!("lin{index}.model.1.weight");
    let head = file.f32(&name, &[1, channels, 1, 1])?.to_vec();
    Ok(Stage { steps, head })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::measure::test_picture::picture;

    /// Made-up weights: hashes of the element's index and the tensor's place among the names.
    fn made_up(backbone: Backbone) -> TensorFile {
        let mut shapes: Vec<(String, Vec<usize>)> = Vec::new();
        let mut layer = |name: &str, n_out: usize, n_in: usize, side: usize| {
            shapes.push((format!("{name}.weight"), vec![n_out, n_in, side, side]));
            shapes.push((format!("{name}.bias"), vec![n_out]));
        };
        let heads: &[usize] = match backbone {
            Backbone::AlexNet => {
                layer("features.0", 64, 3, 11);
                layer("features.3", 192, 64, 5);
                layer("features.6", 384, 192, 3);
                layer("features.8", 256, 384, 3);
                layer("features.10", 256, 256, 3);
                &[64, 192, 384, 256, 256]
            }
            Backbone::SqueezeNet => {
                layer("features.0", 64, 3, 3);
                let mut n_in = 64;
                let outputs = [64, 64, 128, 128, 192, 192, 256, 256];
                for (number, n_each) in [3, 4, 6, 7, 9, 10, 11, 12].into_iter().zip(outputs) {
                    let name = format!("features.{number}");
                    layer(&format!("{name}.squeeze"), n_each / 4, n_in, 1);
                    layer(&format!("{name}.expand1x1"), n_each, n_each / 4, 1);
                    layer(&format!("{name}.expand3x3"), n_each, n_each / 4, 3);
                    n_in = 2 * n_each;
                }
                &[64, 128, 256, 384, 384, 512, 512]
            }
        };
        for (k, channels) in heads.iter().enumerate() {
            shapes.push((format!("lin{k}.model.1.weight"), vec![1, *channels, 1, 1]));
        }
        shapes.sort();
        let mut file = TensorFile::default();
        for (salt, (name, shape)) in shapes.iter().enumerate() {
            let value = |i: usize| {
                let mut h = (i as u32).wrapping_mul(2_654_435_761);
                h = h.wrapping_add(salt as u32 * 40_503);
                h = (h ^ (h >> 15)).wrapping_mul(2_246_822_519);
                let v = (f64::from((h ^ (h >> 13)) % 2001) - 1000.0) / 1000.0;
                match (name.starts_with("lin"), name.ends_with("weight")) {
                    (true, _) => v.abs() as f32,
                    (_, true) => {
                        (v * 2.0 / (shape[1..].iter().product::<usize>() as f64).sqrt()) as f32
                    }
                    _ => v as f32,
                }
            };
            let values = (0..shape.iter().product()).map(value).collect();
            file.insert_f32(name, shape, values);
        }
        file
    }

    /// The expected distances were computed once in double precision with `numpy` from
    /// torchvision's definition of the networks, on the same made-up weights.
    #[test]
    fn distances_of_made_up_networks_equal_those_of_numpy() {
        for (backbone, expected) in [
            (Backbone::AlexNet, 0.155_439_882_573_554_15),
            (Backbone::SqueezeNet, 0.103_834_056_724_962_32),
        ] {
            let lpips = Lpips::from_tensors(&made_up(backbone)).unwrap();
            assert_eq!(lpips.backbone(), backbone);
            let (a, b) = (picture(0, 45, 38), picture(2, 45, 38));
            let distance = lpips.distance(&a, &b, 45).unwrap();
            assert!(
                (distance - expected).abs() < 1e-6,
                "{backbone}: {distance}, expected {expected}"
            );
            assert_eq!(lpips.distance(&b, &a, 45), Some(distance), "{backbone}");
            assert_eq!(lpips.distance(&a, &a, 45), Some(0.0), "{backbone}");
        }
    }

    #[test]
    fn small_or_broken_pictures_have_no_distance() {
        for (backbone, min_side) in [(Backbone::AlexNet, 31), (Backbone::SqueezeNet, 17)] {
            let lpips = Lpips::from_tensors(&made_up(backbone)).unwrap();
            assert_eq!(lpips.min_side(), min_side, "{backbone}");
            let measured = |width: usize, height: usize| {
                let image = picture(0, width, height);
                lpips.distance(&image, &image, width)
            };
            assert_eq!(measured(min_side, min_side), Some(0.0), "{backbone}");
            assert_eq!(measured(min_side - 1, 40), None, "{backbone}");
            assert_eq!(measured(40, min_side - 1), None, "{backbone}");
            let broken = vec![[f32::NAN; 3]; 1600];
            assert_eq!(lpips.distance(&broken, &broken, 40), None, "{backbone}");
        }
    }

    #[test]
    fn missing_and_misshapen_tensors_are_named_with_the_file() {
        let path = Path::new("weights/made_up.safetensors");
        for (backbone, name) in [
            (Backbone::AlexNet, "features.8.weight"),
            (Backbone::SqueezeNet, "features.11.expand3x3.bias"),
            (Backbone::SqueezeNet, "lin6.model.1.weight"),
        ] {
            let mut file = made_up(backbone);
            file.tensors.remove(name);
            let missing = TensorFile::from_bytes(&file.to_bytes(), path).unwrap();
            let message = Lpips::from_tensors(&missing).unwrap_err().to_string();
            let expected = format!("weights/made_up.safetensors: tensor `{name}` is missing");
            assert_eq!(message, expected);
            file.insert_f32(name, &[3], vec![0.0; 3]);
            let misshapen = TensorFile::from_bytes(&file.to_bytes(), path).unwrap();
            let message = Lpips::from_tensors(&misshapen).unwrap_err().to_string();
            let expected = format!("made_up.safetensors: tensor `{name}` is F32 [3], expected");
            assert!(message.contains(&expected), "{message}");
        }
    }
}
