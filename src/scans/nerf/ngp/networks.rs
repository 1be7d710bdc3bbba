//! The grid and the networks of a snapshot, from the settings and all numbers in a row.

use glam::Vec3;
use half::f16;

use super::super::hash_field::{
    Directions, HashField, Input, Output, TcnnNetwork, Warp, n_color_inputs, network,
};
use super::super::hash_grid::{GridShape, HashGrid, Sharing};
use super::super::sphere::N_HARMONICS;
use super::settings::Settings;

/// What sides of matrices are padded to multiples of.
const ALIGNMENT: usize = 16;

impl Settings<'_> {
    /// The networks and the grid.
    pub(super) fn field(
        &self,
        snapshot: &Self,
        aabb_scale: u32,
        is_hdr: bool,
    ) -> Result<HashField, String> {
        let mut params = numbers(snapshot)?;
        let grid = self.get("encoding")?.grid(aabb_scale)?;
        let (density, color) = (self.get("network")?, self.get("rgb_network")?);
        let n_features = density.count("n_output_dims", 16, 1..=256)? as usize;
        let density_shape = density.network(grid.n_out(), n_features)?;
        let mut inputs: Vec<Input> = (0..density_shape.n_out)
            .map(|i| Input::Number(i, 1.0))
            .collect();
        inputs.extend(
            self.get("dir_encoding")?
                .directions(snapshot, density_shape.n_out)?,
        );
        let color_shape = color.network(inputs.len(), 3)?;
        let (n_density, n_color) = (density_shape.n_params(), color_shape.n_params());
        let n_grid = grid.n_params();
        if params.len() != n_density + n_color + n_grid {
            let problem = format!(
                "params_binary: {} numbers, and the networks have {n_density} and {n_color}, the grid {n_grid}",
                params.len()
            );
            return Err(snapshot.fail(&problem));
        }
        let table = params.split_off(n_density + n_color);
        let (density_params, color_params) = params.split_at(n_density);
        let encoded: Vec<Input> = (0..grid.n_out()).map(|i| Input::Number(i, 1.0)).collect();
        let size = aabb_scale as f32;
        Ok(HashField {
            warp: Warp::Box {
                min: Vec3::splat(0.5 - 0.5 * size),
                extent: Vec3::splat(size),
            },
            density: network(
                density_shape.matrices(density_params),
                grid.n_out(),
                &encoded,
                density_shape.n_out,
            ),
            density_output: output(snapshot, "density_activation", Output::Exponential)?,
            density_scale: 1.0,
            directions: Directions::Unit,
            color: network(
                color_shape.matrices(color_params),
                n_color_inputs(density_shape.n_out),
                &inputs,
                3,
            ),
            color_output: output(
                snapshot,
                "rgb_activation",
                if is_hdr {
                    Output::Exponential
                } else {
                    Output::Logistic
                },
            )?,
            grid: HashGrid::of_tcnn(&grid, table),
        })
    }

    fn grid(&self, aabb_scale: u32) -> Result<GridShape, String> {
        let kind = self.kind()?;
        let sharing = match (&kind[..], self.find("type").map(|kind| kind.text())) {
            ("hashgrid" | "grid", None) => Sharing::Hash,
            ("densegrid", None) => Sharing::Dense,
            ("tiledgrid", None) => Sharing::Tiled,
            ("hashgrid" | "grid" | "densegrid" | "tiledgrid", Some(kind)) => {
                match &kind?.to_lowercase()[..] {
                    "hash" => Sharing::Hash,
                    "dense" => Sharing::Dense,
                    "tiled" => Sharing::Tiled,
                    kind => return Err(self.fail(&format!("type: \"{kind}\" is not read"))),
                }
            }
            _ => return Err(self.fail(&format!("otype: \"{kind}\" is not read, only grids"))),
        };
        if let Some(hash) = self.find("hash")
            && hash.text()? != "CoherentPrime"
        {
            return Err(hash.fail("only \"CoherentPrime\" is read"));
        }
        let is_smooth = match self.find("interpolation") {
            Some(found) => match &found.text()?.to_lowercase()[..] {
                "linear" => false,
                "smoothstep" => true,
                kind => return Err(found.fail(&format!("\"{kind}\" is not read"))),
            },
            None => false,
        };
        let n_features_per_level = self.count("n_features_per_level", 2, 1..=8)?;
        if !n_features_per_level.is_power_of_two() {
            return Err(self.fail("n_features_per_level: not 1, 2, 4 or 8"));
        }
        let n_features = self.count("n_features", 0, 0..=1024)?;
        let n_levels = if n_features > 0 {
            n_features / n_features_per_level
        } else {
            self.count("n_levels", 16, 1..=32)?
        };
        let log2_table = self.count("log2_hashmap_size", 15, 1..=28)?;
        let base_resolution = match self.count("base_resolution", 0, 0..=4096)? {
            0 => 1 << (log2_table / 3),
            resolution => resolution,
        };
        let scale = self.find("per_level_scale");
        let scale = scale.map_or(Ok(0.0), |scale| scale.number())?;
        let per_level_scale = if scale > 0.0 || n_levels <= 1 {
            scale.max(1.0)
        } else {
            let finest = 2048.0 * aabb_scale as f32 / base_resolution as f32;
            (finest.ln() / (n_levels - 1) as f32).exp()
        };
        if !(1..=32).contains(&n_levels) || per_level_scale > 16.0 {
            return Err(self.fail("not as many levels, or as different ones, as are read"));
        }
        Ok(GridShape {
            n_levels,
            n_features_per_level: n_features_per_level as usize,
            log2_table,
            base_resolution,
            per_level_scale,
            sharing,
            is_smooth,
        })
    }

    fn network(&self, n_in: usize, n_out: usize) -> Result<TcnnNetwork, String> {
        for (key, expected) in [("activation", "ReLU"), ("output_activation", "None")] {
            if let Some(found) = self.find(key)
                && found.text()? != expected
            {
                return Err(found.fail(&format!("only \"{expected}\" is read")));
            }
        }
        match &self.kind()?[..] {
            "fullyfusedmlp" | "megakernelmlp" | "cutlassmlp" => (),
            kind => return Err(self.fail(&format!("otype: \"{kind}\" is not read"))),
        }
        Ok(TcnnNetwork {
            n_in: n_in.next_multiple_of(ALIGNMENT),
            n_out: n_out.next_multiple_of(ALIGNMENT),
            width: self.count("n_neurons", 128, 1..=1024)? as usize,
            n_hidden: self.count("n_hidden_layers", 5, 0..=16)? as usize,
        })
    }

    /// What the colour network takes after the `n_features` of the first: harmonics, what pictures have learnt of their
    /// own (the mean of all), ones.
    fn directions(&self, snapshot: &Self, n_features: usize) -> Result<Vec<Input>, String> {
        let nested = self
            .find("nested")
            .map(|nested| nested.items())
            .transpose()?;
        let sphere = match (&self.kind()?[..], nested) {
            ("composite", Some(mut nested)) if !nested.is_empty() => nested.swap_remove(0),
            _ => Self {
                value: self.value,
                name: self.name.clone(),
            },
        };
        if sphere.kind()? != "sphericalharmonics" {
            return Err(sphere.fail("otype: only \"SphericalHarmonics\" are read"));
        }
        let degree = sphere.count("degree", 4, 1..=4)? as usize;
        let harmonics = (0..degree * degree).map(|i| Input::Number(n_features + i, 1.0));
        debug_assert!(degree * degree <= N_HARMONICS, "those that are computed");
        let learnt = learnt(snapshot)?;
        let n = degree * degree + learnt.len();
        let ones = vec![Input::Constant(1.0); n.next_multiple_of(ALIGNMENT) - n];
        // Harmonics are padded in front, what follows them behind.
        Ok(if learnt.is_empty() {
            ones.into_iter().chain(harmonics).collect()
        } else {
            harmonics.chain(learnt).chain(ones).collect()
        })
    }
}

/// The mean of what pictures have learnt of their own.
fn learnt(snapshot: &Settings<'_>) -> Result<Vec<Input>, String> {
    let nerf = snapshot.get("nerf")?;
    let Some(dataset) = nerf.find("dataset") else {
        return Ok(Vec::new());
    };
    let n = dataset.count("n_extra_learnable_dims", 0, 0..=256)? as usize;
    let mut sums = vec![0.0; n];
    let pictures = nerf.find("extra_dims_opt");
    let pictures = pictures.map_or(Ok(Vec::new()), |pictures| pictures.items())?;
    for picture in &pictures {
        for (sum, number) in sums.iter_mut().zip(picture.get("variable")?.items()?) {
            *sum += number.number()? / pictures.len() as f32;
        }
    }
    Ok(sums.into_iter().map(Input::Constant).collect())
}

fn output(snapshot: &Settings<'_>, key: &str, default: Output) -> Result<Output, String> {
    let Some(found) = snapshot.get("nerf")?.find(key) else {
        return Ok(default);
    };
    match &found.text()?.to_lowercase()[..] {
        "none" => Ok(Output::None),
        "relu" => Ok(Output::Relu),
        "logistic" => Ok(Output::Logistic),
        "exponential" => Ok(Output::Exponential),
        kind => Err(found.fail(&format!("\"{kind}\" is not known"))),
    }
}

/// All parameters.
fn numbers(snapshot: &Settings<'_>) -> Result<Vec<f32>, String> {
    let bytes = snapshot.get("params_binary")?.bytes()?;
    let kind = snapshot.find("params_type");
    match kind.map_or(Ok("__half"), |kind| kind.text())? {
        "__half" => Ok(halves(bytes).collect()),
        "float" => Ok(bytes
            .as_chunks()
            .0
            .iter()
            .map(|b| f32::from_le_bytes(*b))
            .collect()),
        kind => Err(snapshot.fail(&format!("params_type: \"{kind}\" is not read"))),
    }
}

/// Numbers of two bytes.
pub(super) fn halves(bytes: &[u8]) -> impl Iterator<Item = f32> {
    let halves = bytes.as_chunks().0.iter();
    halves.map(|bytes| f16::from_le_bytes(*bytes).to_f32())
}
