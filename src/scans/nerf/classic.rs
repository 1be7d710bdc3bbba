//! The original network: layers over sines and cosines of position and direction (arXiv:2003.08934), as two programs in
//! `PyTorch` save it.
//!
//! - `krrish94/nerf-pytorch`, `nerf/models.py`, `FlexibleNeRFModel`: `model_fine_state_dict` with `layer1`, `layers_xyz.N`,
//!   `fc_feat`, `fc_alpha`, `layers_dir.N`, `fc_rgb`, or `fc_out` alone without directions.
//! - `yenchenlin/nerf-pytorch`, `run_nerf_helpers.py`, `NeRF`: `network_fine_state_dict` with `pts_linears.N`,
//!   `feature_linear`, `alpha_linear`, `views_linears.0`, `rgb_linear`, or `output_linear` alone.
//!
//! Sizes, frequencies and where the position enters again are taken from the shapes. Where there is a fine network, it is the
//! one that is looked at; the space is the box of the synthetic scenes, as a checkpoint says nothing about its own.

use glam::Vec3;

use super::checkpoint::Checkpoint;
use super::field::{Densities, Field, Scratch, logistic, usable_color, usable_density};
use super::layers::{Activation, Layer};
use crate::data::DataError;

/// Most layers of a trunk.
const MAX_LAYERS: usize = 64;
/// Widest layer.
const MAX_WIDTH: usize = 4096;

/// Position or direction as the network sees it: itself and the sines and cosines of its doublings (Eq. 4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Waves {
    has_input: bool,
    n_frequencies: usize,
}

impl Waves {
    /// By the length of the encoding: `3 + 6 n` or `6 n`.
    fn of(n: usize) -> Option<Self> {
        let has_input = n % 6 == 3;
        (n > 0 && (has_input || n.is_multiple_of(6))).then_some(Self {
            has_input,
            n_frequencies: n / 6,
        })
    }

    fn n_out(self) -> usize {
        6 * self.n_frequencies + if self.has_input { 3 } else { 0 }
    }

    fn encode(self, v: Vec3, out: &mut Vec<f32>) {
        let v = v.to_array();
        if self.has_input {
            out.extend(v);
        }
        // Doubles, as each doubling may make errors four times as large: 1e-10 after ten.
        let angles = v.map(f64::from);
        let (mut sines, mut cosines) = (angles.map(f64::sin), angles.map(f64::cos));
        for _ in 0..self.n_frequencies {
            out.extend(sines.map(|sine| sine as f32));
            out.extend(cosines.map(|cosine| cosine as f32));
            for (sine, cosine) in sines.iter_mut().zip(&mut cosines) {
                (*sine, *cosine) = (2.0 * *sine * *cosine, 1.0 - 2.0 * *sine * *sine);
            }
        }
    }
}

/// Where a layer takes the encoded position besides what the one before it made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Skip {
    None,
    Before,
    After,
}

/// How colours are made.
#[derive(Clone, Debug)]
enum Head {
    /// Of the trunk's output and the direction.
    Directed {
        waves: Waves,
        density: Layer,
        feature: Layer,
        feature_activation: Activation,
        layers: Vec<Layer>,
        color: Layer,
    },
    /// With the density, the same from everywhere.
    Plain(Layer),
}

/// The original network.
#[derive(Clone, Debug)]
pub(super) struct ClassicField {
    waves: Waves,
    trunk: Vec<(Layer, Skip)>,
    /// After the first layer: one program leaves it out there.
    first_activation: Activation,
    head: Head,
}

/// Names of the parts in a program's checkpoints.
struct Names {
    /// Of the networks, the finer first.
    networks: [&'static str; 2],
    /// Of the trunk's first layer where it is not one of the others.
    first: Option<&'static str>,
    first_activation: Activation,
    trunk: &'static str,
    density: &'static str,
    feature: &'static str,
    feature_activation: Activation,
    directed: &'static str,
    color: &'static str,
    plain: &'static str,
    skip: Skip,
}

const PROGRAMS: [Names; 2] = [
    Names {
        networks: ["model_fine_state_dict.", "model_coarse_state_dict."],
        first: Some("layer1"),
        first_activation: Activation::None,
        trunk: "layers_xyz",
        density: "fc_alpha",
        feature: "fc_feat",
        feature_activation: Activation::Relu,
        directed: "layers_dir",
        color: "fc_rgb",
        plain: "fc_out",
        skip: Skip::After,
    },
    Names {
        networks: ["network_fine_state_dict.", "network_fn_state_dict."],
        first: None,
        first_activation: Activation::Relu,
        trunk: "pts_linears",
        density: "alpha_linear",
        feature: "feature_linear",
        feature_activation: Activation::None,
        directed: "views_linears",
        color: "rgb_linear",
        plain: "output_linear",
        skip: Skip::Before,
    },
];

/// Whether a checkpoint holds such a network.
pub(super) fn is_classic(checkpoint: &Checkpoint) -> bool {
    find(checkpoint).is_some()
}

fn find(checkpoint: &Checkpoint) -> Option<(&'static Names, String)> {
    PROGRAMS.iter().find_map(|program| {
        program.networks.iter().find_map(|network| {
            let first = checkpoint.names().find(|name| name.starts_with(network))?;
            // What trained on several cards at once is one step further in.
            let module = first[network.len()..].starts_with("module.");
            let prefix = format!("{network}{}", if module { "module." } else { "" });
            Some((program, prefix))
        })
    })
}

/// Reads a network.
pub(super) fn read(checkpoint: &Checkpoint) -> Result<ClassicField, DataError> {
    let (names, prefix) = find(checkpoint)
        .ok_or_else(|| DataError::unusable(checkpoint.path(), "no network of a radiance field"))?;
    Reader {
        checkpoint,
        names,
        prefix,
    }
    .read()
}

struct Reader<'a> {
    checkpoint: &'a Checkpoint,
    names: &'static Names,
    prefix: String,
}

impl Reader<'_> {
    fn read(&self) -> Result<ClassicField, DataError> {
        let mut trunk: Vec<Layer> = Vec::new();
        if let Some(first) = self.names.first {
            trunk.push(self.layer(first)?);
        }
        trunk.extend(self.layers(self.names.trunk)?);
        let Some(first) = trunk.first() else {
            return Err(self.fail(self.names.trunk, "missing"));
        };
        let n_encoded = first.n_in();
        let waves = Waves::of(n_encoded).ok_or_else(|| {
            let problem = format!("takes {n_encoded} numbers, which is no position in sines");
            self.fail(self.names.first.unwrap_or(self.names.trunk), &problem)
        })?;
        let mut n_before = 0;
        let mut with_skips = Vec::new();
        for layer in trunk {
            let skip = match layer.n_in() {
                n if with_skips.is_empty() || n == n_before => Skip::None,
                n if n == n_before + n_encoded => self.names.skip,
                n => {
                    let problem = format!("takes {n} numbers where {n_before} are made");
                    return Err(self.fail(self.names.trunk, &problem));
                }
            };
            n_before = layer.n_out();
            with_skips.push((layer, skip));
        }
        Ok(ClassicField {
            waves,
            trunk: with_skips,
            first_activation: self.names.first_activation,
            head: self.head(n_before)?,
        })
    }

    fn head(&self, n_trunk: usize) -> Result<Head, DataError> {
        let names = self.names;
        let expect = |what: &str, layer: &Layer, n_in: usize, n_out: usize| {
            let has = (layer.n_in(), layer.n_out());
            if layer.n_in() == n_in && layer.n_out() >= n_out {
                return Ok(());
            }
            let problem = format!("is {has:?} and should be {:?}", (n_in, n_out));
            Err(self.fail(what, &problem))
        };
        if self.shape(names.plain).is_some() {
            let layer = self.layer(names.plain)?;
            expect(names.plain, &layer, n_trunk, 4)?;
            return Ok(Head::Plain(layer));
        }
        let (density, feature) = (self.layer(names.density)?, self.layer(names.feature)?);
        expect(names.density, &density, n_trunk, 1)?;
        if density.n_out() != 1 {
            return Err(self.fail(names.density, "more than one density"));
        }
        expect(names.feature, &feature, n_trunk, 1)?;
        let layers = self.layers(names.directed)?;
        let color = self.layer(names.color)?;
        let mut n_before = feature.n_out();
        let mut waves = None;
        for layer in &layers {
            if waves.is_none() {
                let n_direction = layer.n_in().checked_sub(n_before);
                waves = n_direction.and_then(Waves::of);
                if waves.is_none() {
                    let problem = format!("takes {} numbers, not a direction", layer.n_in());
                    return Err(self.fail(names.directed, &problem));
                }
            } else {
                expect(names.directed, layer, n_before, 1)?;
            }
            n_before = layer.n_out();
        }
        expect(names.color, &color, n_before, 3)?;
        Ok(Head::Directed {
            waves: waves.ok_or_else(|| self.fail(names.directed, "missing"))?,
            density,
            feature,
            feature_activation: names.feature_activation,
            layers,
            color,
        })
    }

    /// The layers of a list.
    fn layers(&self, list: &str) -> Result<Vec<Layer>, DataError> {
        let names = (0..MAX_LAYERS).map(|i| format!("{list}.{i}"));
        let names = names.take_while(|name| self.shape(name).is_some());
        names.map(|name| self.layer(&name)).collect()
    }

    fn shape(&self, layer: &str) -> Option<&[usize]> {
        let weight = format!("{}{layer}.weight", self.prefix);
        self.checkpoint.shape(&weight)
    }

    fn layer(&self, layer: &str) -> Result<Layer, DataError> {
        read_layer(self.checkpoint, &format!("{}{layer}", self.prefix))
    }

    fn fail(&self, what: &str, problem: &str) -> DataError {
        let problem = format!("{}{what}: {problem}", self.prefix);
        DataError::unusable(self.checkpoint.path(), problem)
    }
}

/// The layer with that name before `.weight` and `.bias`.
pub(super) fn read_layer(checkpoint: &Checkpoint, name: &str) -> Result<Layer, DataError> {
    let fail = |problem: &str| {
        let problem = format!("{name}.weight: {problem}");
        DataError::unusable(checkpoint.path(), problem)
    };
    let weight = format!("{name}.weight");
    let shape = checkpoint.shape(&weight).ok_or_else(|| fail("missing"))?;
    let &[n_out, n_in] = shape else {
        return Err(fail("no matrix"));
    };
    if !(1..=MAX_WIDTH).contains(&n_out) || !(1..=MAX_WIDTH).contains(&n_in) {
        return Err(fail(&format!("a matrix of {n_out} by {n_in}")));
    }
    let weights = checkpoint.floats(&weight)?;
    let bias = checkpoint.floats(&format!("{name}.bias"))?;
    if bias.len() != n_out {
        return Err(fail("its bias has another length"));
    }
    Ok(Layer::new(n_in, &weights, &bias))
}

impl ClassicField {
    /// What it is, for people.
    pub(super) fn describe(&self) -> String {
        let width = self.trunk.first().map_or(0, |(layer, _)| layer.n_out());
        let n = self.trunk.len();
        format!("neural radiance field ({n} layers of {width})")
    }
}

impl Field for ClassicField {
    fn n_features(&self) -> usize {
        match &self.head {
            Head::Directed { density, .. } => density.n_in(),
            Head::Plain(_) => 3,
        }
    }

    fn densities(&self, points: &[Vec3], scratch: &mut Scratch, answers: &mut Densities) {
        let n_encoded = self.waves.n_out();
        scratch.inputs.clear();
        for point in points {
            self.waves.encode(*point, &mut scratch.inputs);
        }
        for (i, (layer, skip)) in self.trunk.iter().enumerate() {
            let inputs = match skip {
                _ if i == 0 => &scratch.inputs,
                Skip::None => &scratch.hidden,
                Skip::Before => {
                    let n = layer.n_in() - n_encoded;
                    join(
                        (&scratch.inputs, n_encoded),
                        (&scratch.hidden, n),
                        &mut scratch.spare,
                    );
                    &scratch.spare
                }
                Skip::After => {
                    let n = layer.n_in() - n_encoded;
                    join(
                        (&scratch.hidden, n),
                        (&scratch.inputs, n_encoded),
                        &mut scratch.spare,
                    );
                    &scratch.spare
                }
            };
            let activation = if i == 0 {
                self.first_activation
            } else {
                Activation::Relu
            };
            layer.apply(inputs, activation, &mut scratch.outputs);
            std::mem::swap(&mut scratch.hidden, &mut scratch.outputs);
        }
        answers.features.clear();
        answers.densities.clear();
        match &self.head {
            Head::Directed { density, .. } => {
                density.apply(&scratch.hidden, Activation::Relu, &mut answers.densities);
                std::mem::swap(&mut answers.features, &mut scratch.hidden);
            }
            Head::Plain(layer) => {
                layer.apply(&scratch.hidden, Activation::None, &mut scratch.outputs);
                for row in scratch.outputs.chunks_exact(layer.n_out()) {
                    answers.features.extend(&row[..3]);
                    answers.densities.push(row[3]);
                }
            }
        }
        for density in &mut answers.densities {
            *density = usable_density(*density);
        }
    }

    fn colors(
        &self,
        features: &[f32],
        directions: &[Vec3],
        scratch: &mut Scratch,
        colors: &mut Vec<[f32; 3]>,
    ) {
        colors.clear();
        let Head::Directed {
            waves,
            feature,
            feature_activation,
            layers,
            color,
            ..
        } = &self.head
        else {
            let rows = features.as_chunks::<3>().0;
            colors.extend(rows.iter().map(|row| usable_color(row.map(logistic))));
            return;
        };
        feature.apply(features, *feature_activation, &mut scratch.hidden);
        scratch.inputs.clear();
        for (row, direction) in scratch.hidden.chunks_exact(feature.n_out()).zip(directions) {
            scratch.inputs.extend(row);
            waves.encode(*direction, &mut scratch.inputs);
        }
        std::mem::swap(&mut scratch.hidden, &mut scratch.inputs);
        for layer in layers {
            layer.apply(&scratch.hidden, Activation::Relu, &mut scratch.outputs);
            std::mem::swap(&mut scratch.hidden, &mut scratch.outputs);
        }
        color.apply(&scratch.hidden, Activation::None, &mut scratch.outputs);
        let rows = scratch.outputs.chunks_exact(color.n_out());
        colors.extend(rows.map(|row| usable_color([row[0], row[1], row[2]].map(logistic))));
    }
}

/// Rows of two matrices side by side; each with its length of a row.
fn join(first: (&[f32], usize), second: (&[f32], usize), joined: &mut Vec<f32>) {
    joined.clear();
    let rows = first.0.chunks_exact(first.1);
    for (first, second) in rows.zip(second.0.chunks_exact(second.1)) {
        joined.extend(first);
        joined.extend(second);
    }
}
