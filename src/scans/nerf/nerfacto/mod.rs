//! Checkpoints of nerfstudio's nerfacto (`nerfstudio/fields/nerfacto_field.py`), with networks of tiny-cuda-nn or of torch.
//!
//! A checkpoint has no settings: sizes are taken from the shapes, and what those do not say from `config.yml` in the folder
//! of the run where it is still there, or else the method's defaults. It is trained in coordinates of its own;
//! `dataparser_transforms.json` in the same folder takes the scene's to those. What each photo has learnt of its own is
//! replaced by the mean. The layouts of all versions since 0.1 are known: their names differ.

mod run;

use glam::{Mat3, Vec3};

use self::run::{Settings, Transform};
use super::checkpoint::Checkpoint;
use super::hash_field::{
    Directions, HashField, Input, Matrix, Output, TcnnNetwork, Warp, n_color_inputs, network,
};
use super::hash_grid::{GridShape, HashGrid, Sharing};
use super::sphere::{N_HARMONICS, nerfstudio_sign};
use crate::data::DataError;

/// What the networks of tiny-cuda-nn are padded to multiples of.
const ALIGNMENT: usize = 16;
/// Widths of networks, the method's first.
const WIDTHS: [usize; 5] = [64, 128, 256, 32, 16];
/// Finest resolutions of the method's variants, the usual first.
const FINEST: [u32; 5] = [2048, 4096, 8192, 1024, 512];
/// Most layers of a network.
const MAX_LAYERS: usize = 16;

/// What a checkpoint holds.
#[derive(Debug)]
pub(super) struct Nerfacto {
    pub(super) field: HashField,
    /// Whether all of space is in it, or only a box around the origin, half as wide as this.
    pub(super) half: Option<f32>,
    /// `scale * (rotation * p + translation)` is where a point of the scene lies in it.
    pub(super) rotation: Mat3,
    pub(super) translation: Vec3,
    pub(super) scale: f32,
}

/// Whether a checkpoint is of nerfacto.
pub(super) fn is_nerfacto(checkpoint: &Checkpoint) -> bool {
    prefix(checkpoint).is_some()
}

/// What comes before the names of the field's tensors.
fn prefix(checkpoint: &Checkpoint) -> Option<String> {
    let mut names = checkpoint
        .names()
        .filter(|name| name.starts_with("pipeline."));
    names.find_map(|name| {
        let at = name.find(".field.mlp_head.")?;
        Some(format!("{}.field.", &name[..at]))
    })
}

/// Reads a checkpoint.
pub(super) fn read(checkpoint: &Checkpoint) -> Result<Nerfacto, DataError> {
    let path = checkpoint.path();
    let prefix = prefix(checkpoint)
        .ok_or_else(|| DataError::unusable(path, "no field of nerfacto in it"))?;
    let settings = Settings::near(path);
    let transform = Transform::near(path)?;
    let reader = Reader {
        checkpoint,
        prefix,
        settings,
    };
    let (field, half) = reader.field()?;
    let [x, y, z] = transform.transform;
    Ok(Nerfacto {
        field,
        half,
        rotation: Mat3::from_cols(
            Vec3::new(x[0], y[0], z[0]),
            Vec3::new(x[1], y[1], z[1]),
            Vec3::new(x[2], y[2], z[2]),
        ),
        translation: Vec3::new(x[3], y[3], z[3]),
        scale: transform.scale,
    })
}

struct Reader<'a> {
    checkpoint: &'a Checkpoint,
    prefix: String,
    settings: Settings,
}

/// The networks and the grid.
struct Parts {
    density: Vec<Matrix>,
    grid: HashGrid,
    n_encoded: usize,
    color: Vec<Matrix>,
    directions: Directions,
}

impl Reader<'_> {
    fn field(&self) -> Result<(HashField, Option<f32>), DataError> {
        let learnt = self.learnt()?;
        let is_torch = self.find(&["mlp_head.layers.0.weight"]).is_some();
        let parts = if is_torch {
            self.torch()
        } else {
            self.tcnn(learnt.len())
        }?;
        let n_features = parts.density.last().map_or(0, Matrix::n_out);
        // Harmonics, the features besides the density, what is learnt, and ones up to the width.
        let mut inputs: Vec<Input> = (0..N_HARMONICS)
            .map(|i| {
                let sign = if is_torch { nerfstudio_sign(i) } else { 1.0 };
                Input::Number(n_features + i, sign)
            })
            .collect();
        inputs.extend((1..n_features).map(|i| Input::Number(i, 1.0)));
        inputs.extend(learnt.into_iter().map(Input::Constant));
        let n_out = parts.color.last().map_or(0, Matrix::n_out);
        if n_out < 3 || is_torch && n_out != 3 {
            return Err(self.fail("mlp_head", &format!("makes {n_out} numbers, no colour")));
        }
        let n_in = parts.color.first().map_or(0, |matrix| matrix.n_in);
        if inputs.len() > n_in || is_torch && inputs.len() != n_in {
            let problem = format!("takes {n_in} numbers, and {} are made", inputs.len());
            return Err(self.fail("mlp_head", &problem));
        }
        inputs.resize(n_in, Input::Constant(1.0));
        let encoded: Vec<Input> = (0..parts.n_encoded)
            .map(|i| Input::Number(i, 1.0))
            .collect();
        let (warp, half) = self.warp()?;
        let field = HashField {
            warp,
            density: network(parts.density, parts.n_encoded, &encoded, n_features),
            grid: parts.grid,
            density_output: Output::Exponential,
            density_scale: self.density_scale(),
            directions: parts.directions,
            color: network(parts.color, n_color_inputs(n_features), &inputs, 3),
            color_output: Output::Logistic,
        };
        Ok((field, half))
    }

    fn warp(&self) -> Result<(Warp, Option<f32>), DataError> {
        let is_box = self.settings.get::<bool>("disable_scene_contraction");
        if is_box != Some(true) {
            return Ok((Warp::Contracted, None));
        }
        let corners = self.floats("aabb")?;
        let &[a, b, c, d, e, f] = &corners[..] else {
            return Err(self.fail("aabb", "not two corners"));
        };
        let (min, max) = (Vec3::new(a, b, c), Vec3::new(d, e, f));
        let extent = max - min;
        let half = min.abs().max(max.abs()).max_element();
        if !(extent.min_element() > 0.0 && half.is_finite()) {
            return Err(self.fail("aabb", "empty"));
        }
        Ok((Warp::Box { min, extent }, Some(half)))
    }

    /// `average_init_density`: the method has 0.01 since both networks became one part, and 1 before there was any.
    fn density_scale(&self) -> f32 {
        let is_new = self.checkpoint.names().any(|name| {
            let name = name.strip_prefix(&self.prefix);
            name.is_some_and(|name| name.starts_with("mlp_base.model."))
        });
        let scale = self.settings.get::<f32>("average_init_density");
        scale.filter(|scale| scale.is_finite()).unwrap_or(
            match (is_new, self.settings.is_empty()) {
                (true, true) => 0.01,
                _ => 1.0,
            },
        )
    }

    /// The mean of what each photo has learnt.
    fn learnt(&self) -> Result<Vec<f32>, DataError> {
        let name = "embedding_appearance.embedding.weight";
        let Some([n_photos, n]) = self.shape(name) else {
            return Ok(Vec::new());
        };
        let (n_photos, n) = (*n_photos, *n);
        if n > 4096 {
            return Err(self.fail(name, "too wide"));
        }
        let mut mean = vec![0.0; n];
        let is_mean = self
            .settings
            .get::<bool>("use_average_appearance_embedding");
        if is_mean != Some(false) {
            for row in self.floats(name)?.chunks_exact(n.max(1)) {
                for (mean, x) in mean.iter_mut().zip(row) {
                    *mean += x / n_photos as f32;
                }
            }
        }
        Ok(mean)
    }

    /// With torch's own layers.
    fn torch(&self) -> Result<Parts, DataError> {
        let grids = [
            "mlp_base.model.0.hash_table",
            "mlp_base_grid.hash_table",
            "mlp_base.0.hash_table",
        ];
        let grid = self
            .find(&grids)
            .ok_or_else(|| self.fail(grids[0], "missing"))?;
        let density = [
            "mlp_base.model.1.layers",
            "mlp_base_mlp.layers",
            "mlp_base.1.layers",
        ];
        let firsts = density.map(|name| format!("{name}.0.weight"));
        let first = self.find(&firsts.each_ref().map(|name| &name[..]));
        let density = first.map_or(density[0], |name| name.trim_end_matches(".0.weight"));
        let density = self.matrices(density)?;
        let n_encoded = density.first().map_or(0, |matrix| matrix.n_in);
        let Some(&[n_rows, n_features]) = self.shape(grid) else {
            return Err(self.fail(grid, "no matrix"));
        };
        let n_levels = n_encoded / n_features.max(1);
        let n_table = n_rows / n_levels.max(1);
        let is_known = matches!(n_features, 1 | 2 | 4 | 8)
            && n_levels * n_features == n_encoded
            && n_table * n_levels == n_rows
            && n_table.is_power_of_two()
            && (1..=32).contains(&n_levels);
        if !is_known {
            let problem = format!("{n_rows} by {n_features} for {n_encoded} features");
            return Err(self.fail(grid, &problem));
        }
        let shape = self.grid_shape(n_levels as u32, n_features, n_table.ilog2(), self.finest());
        Ok(Parts {
            density,
            n_encoded,
            grid: HashGrid::of_nerfstudio(&shape, self.floats(grid)?),
            color: self.matrices("mlp_head.layers")?,
            directions: Directions::Halved,
        })
    }

    /// With tiny-cuda-nn's networks, of which only the numbers of parameters are there.
    fn tcnn(&self, n_learnt: usize) -> Result<Parts, DataError> {
        let both = [
            "mlp_base.model.params",
            "mlp_base.tcnn_encoding.params",
            "mlp_base.params",
        ];
        let grids = [
            "mlp_base_grid.tcnn_encoding.params",
            "mlp_base.0.tcnn_encoding.params",
        ];
        let networks = [
            "mlp_base_mlp.tcnn_encoding.params",
            "mlp_base.1.tcnn_encoding.params",
        ];
        let heads = ["mlp_head.tcnn_encoding.params", "mlp_head.params"];
        let need = |names: &[&'static str]| {
            self.find(names)
                .ok_or_else(|| self.fail(names[0], "missing"))
        };
        let mut base = if let Some(name) = self.find(&both) {
            self.floats(name)?
        } else {
            let mut base = self.floats(need(&networks)?)?;
            base.extend(self.floats(need(&grids)?)?);
            base
        };
        let (shape, density) = self.tcnn_base(base.len()).ok_or_else(|| {
            let problem = format!(
                "{} numbers are those of no grid and network that are known",
                base.len()
            );
            self.fail("mlp_base", &problem)
        })?;
        let table = base.split_off(density.n_params());
        let head = need(&heads)?;
        let color_params = self.floats(head)?;
        let n_in = (N_HARMONICS + density.n_out - 1 + n_learnt).next_multiple_of(ALIGNMENT);
        let color = tcnn_network(n_in, [2, 1, 3, 4], color_params.len());
        let color = color.ok_or_else(|| {
            let problem = format!(
                "{} numbers are those of no network of {n_in} inputs",
                color_params.len()
            );
            self.fail(head, &problem)
        })?;
        Ok(Parts {
            density: density.matrices(&base),
            n_encoded: shape.n_out(),
            grid: HashGrid::of_tcnn(&shape, table),
            color: color.matrices(&color_params),
            directions: Directions::Unit,
        })
    }

    /// The grid and the first network that have so many numbers together; likelier ones first.
    fn tcnn_base(&self, n_params: usize) -> Option<(GridShape, TcnnNetwork)> {
        let n_levels = self.size("num_levels").unwrap_or(16);
        let n_features = self
            .settings
            .get::<usize>("features_per_level")
            .unwrap_or(2);
        if !(1..=32).contains(&n_levels) || !matches!(n_features, 1 | 2 | 4 | 8) {
            return None;
        }
        let log2_table = self.size("log2_hashmap_size");
        let log2_tables = log2_table
            .into_iter()
            .chain(std::iter::once(19))
            .chain(12..=24);
        let log2_tables = log2_tables.filter(|log2| (1..=28).contains(log2));
        let finest = std::iter::once(self.finest()).chain(FINEST);
        let pairs = log2_tables.flat_map(|log2| finest.clone().map(move |finest| (log2, finest)));
        let mut found = pairs.filter_map(|(log2, finest)| {
            let shape = self.grid_shape(n_levels, n_features, log2, finest);
            let n_left = n_params.checked_sub(shape.n_params())?;
            let n_in = shape.n_out().next_multiple_of(ALIGNMENT);
            Some((shape, tcnn_network(n_in, [1, 2, 3, 4], n_left)?))
        });
        found.next()
    }

    fn grid_shape(
        &self,
        n_levels: u32,
        n_features: usize,
        log2_table: u32,
        finest: u32,
    ) -> GridShape {
        let base = self
            .settings
            .get::<u32>("base_res")
            .unwrap_or(16)
            .clamp(1, 4096);
        let octaves = f64::from(finest.max(1)).ln() - f64::from(base).ln();
        let growth = octaves / f64::from(n_levels.saturating_sub(1).max(1));
        GridShape {
            n_levels,
            n_features_per_level: n_features,
            log2_table,
            base_resolution: base,
            per_level_scale: growth.exp() as f32,
            sharing: Sharing::Hash,
            is_smooth: false,
        }
    }

    fn finest(&self) -> u32 {
        self.size("max_res").unwrap_or(2048).clamp(1, 1 << 20)
    }

    /// A whole number that newer checkpoints hold, or the settings.
    fn size(&self, key: &str) -> Option<u32> {
        let stored = self.shape(key).is_some_and(<[usize]>::is_empty);
        let stored = stored.then(|| self.floats(key).ok()).flatten();
        let stored = stored.and_then(|numbers| numbers.first().copied());
        stored
            .map(|number| number as u32)
            .or_else(|| self.settings.get(key))
    }

    /// The matrices of a list of layers.
    fn matrices(&self, list: &str) -> Result<Vec<Matrix>, DataError> {
        let mut matrices: Vec<Matrix> = Vec::new();
        for i in 0..MAX_LAYERS {
            let (weight, bias) = (format!("{list}.{i}.weight"), format!("{list}.{i}.bias"));
            let Some(&[n_out, n_in]) = self.shape(&weight) else {
                break;
            };
            let matrix = Matrix {
                n_in,
                weights: self.floats(&weight)?,
                bias: self.floats(&bias)?,
            };
            let is_next = matrices.last().is_none_or(|last| last.n_out() == n_in);
            if n_in == 0 || n_out == 0 || matrix.bias.len() != n_out || !is_next {
                return Err(self.fail(&weight, "does not fit what is around it"));
            }
            matrices.push(matrix);
        }
        if matrices.is_empty() {
            return Err(self.fail(list, "missing"));
        }
        Ok(matrices)
    }

    /// The first of the names that is there.
    fn find<'n>(&self, names: &[&'n str]) -> Option<&'n str> {
        names
            .iter()
            .copied()
            .find(|name| self.shape(name).is_some())
    }

    fn shape(&self, name: &str) -> Option<&[usize]> {
        self.checkpoint.shape(&format!("{}{name}", self.prefix))
    }

    fn floats(&self, name: &str) -> Result<Vec<f32>, DataError> {
        self.checkpoint.floats(&format!("{}{name}", self.prefix))
    }

    fn fail(&self, name: &str, problem: &str) -> DataError {
        let problem = format!("{}{name}: {problem}", self.prefix);
        DataError::unusable(self.checkpoint.path(), problem)
    }
}

/// The network with so many parameters, one of the numbers of hidden layers, and sixteen outputs with their padding.
fn tcnn_network(n_in: usize, n_hidden: [usize; 4], n_params: usize) -> Option<TcnnNetwork> {
    let pairs = n_hidden
        .into_iter()
        .flat_map(|n| WIDTHS.map(|width| (n, width)));
    let mut networks = pairs.map(|(n_hidden, width)| TcnnNetwork {
        n_in,
        n_out: ALIGNMENT,
        width,
        n_hidden,
    });
    networks.find(|network| network.n_params() == n_params)
}
