//! Snapshots of instant-ngp: `MessagePack`, compressed or not (`src/testbed.cu`, `save_snapshot`).
//!
//! A snapshot holds the training's settings and, under `snapshot`, all numbers in a row: the density network, the colour
//! network and the grid (`include/neural-graphics-primitives/nerf_network.h`, `set_params_impl`). Networks are padded to
//! multiples of sixteen: the grid's features with zeros, directions with ones. Space is the cube
//! from 0 to 1, or a larger one around it, into which positions come scaled, moved and with their axes turned
//! (`nerf_loader.h`, `nerf_position_to_ngp`).

use std::io::Read as _;
use std::path::Path;

use flate2::read::MultiGzDecoder;
use flate2::read::ZlibDecoder;
use glam::{Mat3, UVec3, Vec3};
use half::f16;
use rmpv::ValueRef;

use super::hash_field::{
    Directions, HashField, Input, Output, TcnnNetwork, Warp, n_color_inputs, network,
};
use super::hash_grid::{GridShape, HashGrid, Sharing};
use super::sphere::N_HARMONICS;
use crate::data::DataError;

/// Bytes of a snapshot, unpacked.
const MAX_BYTES: u64 = 2 << 30;
/// First keys of the settings' map, one of which comes first: maps are sorted.
const FIRST_KEYS: [&str; 8] = [
    "dir_encoding",
    "distortion_map",
    "encoding",
    "envmap",
    "hyperparams",
    "loss",
    "network",
    "snapshot",
];
/// What sides of matrices are padded to multiples of.
const ALIGNMENT: usize = 16;
/// Cells along a side of the density grid's cascades.
pub(super) const GRID: u32 = 128;
/// The shortest step: a diagonal of the unit cube in 1024 parts.
pub(super) const MIN_STEP: f32 = 1.732_050_8 / 1024.0;
/// Optical thickness of a shortest step above which a cell is occupied.
const MIN_THICKNESS: f32 = 0.01;

/// What a snapshot holds.
#[derive(Debug)]
pub(super) struct Snapshot {
    pub(super) field: HashField,
    /// Side of the cube, a power of two; its middle is 0.5.
    pub(super) aabb_scale: u32,
    /// The part of it that is shown, by its corners.
    pub(super) shown: [Vec3; 2],
    /// Whether a cell is occupied, `[cascade][GRID^3]`, in the order of [`cell_index`]; empty where the snapshot does not say.
    pub(super) occupied: Vec<bool>,
    /// From the scene's axes to the cube's.
    pub(super) rotation: Mat3,
    /// `rotation * (scale * p + offset)`.
    pub(super) scale: f32,
    pub(super) offset: Vec3,
    /// Whether colours are linear.
    pub(super) is_hdr: bool,
}

/// Whether a file that starts so is a snapshot.
pub(super) fn is_snapshot(head: &[u8]) -> bool {
    let mut unpacked = Vec::new();
    // What is cut off is an error, which comes after what could be unpacked.
    let head = match head {
        [0x1f, 0x8b, ..] => {
            drop(
                MultiGzDecoder::new(head)
                    .take(64)
                    .read_to_end(&mut unpacked),
            );
            &unpacked
        }
        [0x78, ..] => {
            drop(ZlibDecoder::new(head).take(64).read_to_end(&mut unpacked));
            &unpacked
        }
        _ => head,
    };
    let rest = match head {
        [0x80..=0x8f, rest @ ..] | [0xde, _, _, rest @ ..] => rest,
        _ => return false,
    };
    let key = match rest {
        [n @ 0xa0..=0xbf, rest @ ..] => rest.get(..usize::from(n - 0xa0)),
        [0xd9, n, rest @ ..] => rest.get(..usize::from(*n)),
        _ => None,
    };
    key.is_some_and(|key| FIRST_KEYS.iter().any(|known| known.as_bytes() == key))
}

/// Where the density of a cell lies within its cascade: the bits of its coordinates in turn (`morton3D`).
pub(super) fn cell_index(cell: UVec3) -> usize {
    let spread = |x: u32| (0..7).fold(0, |sum, bit| sum | (x >> bit & 1) << (3 * bit));
    (spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2) as usize
}

/// Reads a snapshot.
pub(super) fn read(path: &Path) -> Result<Snapshot, DataError> {
    let fail = |problem: String| DataError::unusable(path, problem);
    let bytes = unpacked(path)?;
    let value = rmpv::decode::read_value_ref(&mut &bytes[..])
        .map_err(|e| fail(format!("no MessagePack: {e}")))?;
    Settings {
        value: &value,
        name: String::new(),
    }
    .snapshot()
    .map_err(fail)
}

fn unpacked(path: &Path) -> Result<Vec<u8>, DataError> {
    let io = |e| DataError::io(path, e);
    let file = std::fs::File::open(path).map_err(io)?;
    let mut bytes = Vec::new();
    file.take(MAX_BYTES + 1)
        .read_to_end(&mut bytes)
        .map_err(io)?;
    let mut unpacked = Vec::new();
    match bytes[..] {
        [0x1f, 0x8b, ..] => {
            let reader = MultiGzDecoder::new(&bytes[..]);
            reader
                .take(MAX_BYTES + 1)
                .read_to_end(&mut unpacked)
                .map_err(io)?;
        }
        [0x78, ..] => {
            let reader = ZlibDecoder::new(&bytes[..]);
            reader
                .take(MAX_BYTES + 1)
                .read_to_end(&mut unpacked)
                .map_err(io)?;
        }
        _ => unpacked = bytes,
    }
    if unpacked.len() as u64 > MAX_BYTES {
        let problem = format!("larger than {} GiB", MAX_BYTES >> 30);
        return Err(DataError::unusable(path, problem));
    }
    Ok(unpacked)
}

/// A value among the settings and the keys that lead to it.
struct Settings<'a> {
    value: &'a ValueRef<'a>,
    name: String,
}

fn text_of<'a>(value: &'a ValueRef<'a>) -> Option<&'a str> {
    match value {
        ValueRef::String(text) => text.as_str(),
        _ => None,
    }
}

impl<'a> Settings<'a> {
    /// The value with that key; nil counts as missing.
    fn find(&self, key: &str) -> Option<Self> {
        let ValueRef::Map(pairs) = self.value else {
            return None;
        };
        let (_, value) = pairs
            .iter()
            .find(|(k, v)| text_of(k) == Some(key) && *v != ValueRef::Nil)?;
        let dot = if self.name.is_empty() { "" } else { "." };
        Some(Self {
            value,
            name: format!("{}{dot}{key}", self.name),
        })
    }

    fn get(&self, key: &str) -> Result<Self, String> {
        let dot = if self.name.is_empty() { "" } else { "." };
        let found = self.find(key);
        found.ok_or_else(|| format!("{}{dot}{key}: missing", self.name))
    }

    fn fail(&self, problem: &str) -> String {
        format!("{}: {problem}", self.name)
    }

    fn text(&self) -> Result<&'a str, String> {
        let text = text_of(self.value);
        text.ok_or_else(|| self.fail("no text"))
    }

    fn number(&self) -> Result<f32, String> {
        let number = match self.value {
            ValueRef::F32(x) => Some(*x),
            ValueRef::F64(x) => Some(*x as f32),
            ValueRef::Integer(n) => n.as_f64().map(|x| x as f32),
            _ => None,
        };
        let number = number.filter(|x| x.is_finite());
        number.ok_or_else(|| self.fail("no number"))
    }

    /// A whole number within bounds, or what it is by default.
    fn count(
        &self,
        key: &str,
        default: u32,
        bounds: std::ops::RangeInclusive<u32>,
    ) -> Result<u32, String> {
        let Some(found) = self.find(key) else {
            return Ok(default);
        };
        let count = found.value.as_u64().and_then(|n| u32::try_from(n).ok());
        let count = count.filter(|n| bounds.contains(n));
        count.ok_or_else(|| found.fail(&format!("not a whole number within {bounds:?}")))
    }

    /// Three numbers.
    fn vector(&self) -> Result<Vec3, String> {
        let items = self.items()?;
        let [x, y, z] = &items[..] else {
            return Err(self.fail("not three numbers"));
        };
        Ok(Vec3::new(x.number()?, y.number()?, z.number()?))
    }

    fn items(&self) -> Result<Vec<Self>, String> {
        let items = self.value.as_array();
        let items = items.ok_or_else(|| self.fail("no list"))?;
        let item = |(i, value)| Self {
            value,
            name: format!("{}[{i}]", self.name),
        };
        Ok(items.iter().enumerate().map(item).collect())
    }

    fn bytes(&self) -> Result<&'a [u8], String> {
        match self.value {
            ValueRef::Binary(bytes) | ValueRef::Ext(_, bytes) => Ok(bytes),
            _ => Err(self.fail("no bytes")),
        }
    }

    /// Lower case, as the program compares.
    fn kind(&self) -> Result<String, String> {
        Ok(self.get("otype")?.text()?.to_lowercase())
    }

    /// The whole file.
    fn snapshot(&self) -> Result<Snapshot, String> {
        let snapshot = self.get("snapshot")?;
        match snapshot.find("mode") {
            Some(mode) if !mode.text()?.eq_ignore_ascii_case("nerf") => {
                let problem = format!("\"{}\" is no radiance field", mode.text()?);
                return Err(mode.fail(&problem));
            }
            Some(_) => (),
            None => drop(snapshot.get("nerf")?),
        }
        let nerf = snapshot.get("nerf")?;
        let dataset = nerf.find("dataset");
        let dataset = dataset.as_ref();
        let aabb_scale = match dataset {
            Some(dataset) if nerf.find("aabb_scale").is_none() => {
                dataset.count("aabb_scale", 1, 1..=128)?
            }
            _ => nerf.count("aabb_scale", 1, 1..=128)?,
        };
        if !aabb_scale.is_power_of_two() {
            return Err(nerf.fail("aabb_scale: not a power of two"));
        }
        let is_hdr = dataset
            .and_then(|dataset| dataset.find("is_hdr"))
            .is_some_and(|is_hdr| *is_hdr.value == ValueRef::Boolean(true));
        let is_mitsuba = dataset
            .and_then(|dataset| dataset.find("from_mitsuba"))
            .is_some_and(|is_mitsuba| *is_mitsuba.value == ValueRef::Boolean(true));
        let scale = dataset.and_then(|dataset| dataset.find("scale"));
        let scale = scale.map_or(Ok(0.33), |scale| scale.number())?;
        if scale <= 0.0 {
            return Err(nerf.fail("dataset.scale: not positive"));
        }
        let offset = dataset.and_then(|dataset| dataset.find("offset"));
        Ok(Snapshot {
            field: self.field(&snapshot, aabb_scale, is_hdr)?,
            aabb_scale,
            shown: shown(&snapshot, aabb_scale)?,
            occupied: occupied(&snapshot, aabb_scale)?,
            // x, y, z of the cube are y, z, x of the scene.
            rotation: if is_mitsuba {
                Mat3::IDENTITY
            } else {
                Mat3::from_cols(Vec3::Z, Vec3::X, Vec3::Y)
            },
            scale,
            offset: offset.map_or(Ok(Vec3::splat(0.5)), |offset| offset.vector())?,
            is_hdr,
        })
    }

    fn field(&self, snapshot: &Self, aabb_scale: u32, is_hdr: bool) -> Result<HashField, String> {
        let params = numbers(snapshot)?;
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
        let (density_params, rest) = params.split_at(n_density);
        let (color_params, rest) = rest.split_at(n_color);
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
            grid: HashGrid::of_tcnn(&grid, rest[..n_grid].to_vec()),
        })
    }

    fn grid(&self, aabb_scale: u32) -> Result<GridShape, String> {
        let kind = self.kind()?;
        let sharing = match (&kind[..], self.find("type").map(|kind| kind.text())) {
            ("hashgrid", None) | ("grid", None) => Sharing::Hash,
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

fn halves(bytes: &[u8]) -> impl Iterator<Item = f32> {
    let halves = bytes.as_chunks().0.iter();
    halves.map(|bytes| f16::from_le_bytes(*bytes).to_f32())
}

/// The part of the cube that is shown, by its corners.
fn shown(snapshot: &Settings<'_>, aabb_scale: u32) -> Result<[Vec3; 2], String> {
    let half = 0.5 * aabb_scale as f32;
    let all = [Vec3::splat(0.5 - half), Vec3::splat(0.5 + half)];
    let Some(shown) = snapshot.find("render_aabb") else {
        return Ok(all);
    };
    // A turned one is not cut to.
    if let Some(turn) = snapshot.find("render_aabb_to_local") {
        for (i, row) in turn.items()?.iter().enumerate() {
            if row.vector()? != Mat3::IDENTITY.row(i.min(2)) {
                return Ok(all);
            }
        }
    }
    let (min, max) = (shown.get("min")?, shown.get("max")?);
    // Infinite corners, as an empty box has, are not written as numbers.
    let (Ok(min), Ok(max)) = (min.vector(), max.vector()) else {
        return Ok(all);
    };
    let shown = [min.max(all[0]), max.min(all[1])];
    Ok(if shown[0].cmplt(shown[1]).all() {
        shown
    } else {
        all
    })
}

/// Which cells are occupied (`src/testbed_nerf.cu`, `grid_to_bitfield`).
fn occupied(snapshot: &Settings<'_>, aabb_scale: u32) -> Result<Vec<bool>, String> {
    let Some(bytes) = snapshot.find("density_grid_binary") else {
        return Ok(Vec::new());
    };
    let size = snapshot.count("density_grid_size", GRID, 0..=4096)?;
    if size != GRID {
        return Err(snapshot.fail("density_grid_size: not 128"));
    }
    let bytes = bytes.bytes()?;
    let n_cells = GRID.pow(3) as usize;
    let n_cascades = aabb_scale.ilog2() as usize + 1;
    if bytes.is_empty() {
        return Ok(Vec::new());
    }
    if bytes.len() < 2 * n_cells * n_cascades {
        return Err(snapshot.fail("density_grid_binary: shorter than its cascades"));
    }
    let inner = halves(&bytes[..2 * n_cells]).map(|x| f64::from(x.max(0.0)));
    let mean = (inner.sum::<f64>() / n_cells as f64) as f32;
    let threshold = mean.min(MIN_THICKNESS);
    let all = halves(bytes).take(n_cells * n_cascades);
    Ok(all.map(|thickness| thickness > threshold).collect())
}
