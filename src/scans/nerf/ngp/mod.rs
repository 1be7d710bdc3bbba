//! Snapshots of instant-ngp: `MessagePack`, compressed or not (`src/testbed.cu`, `save_snapshot`).
//!
//! A snapshot holds the training's settings and, under `snapshot`, all numbers in a row: the density network, the colour
//! network and the grid (`include/neural-graphics-primitives/nerf_network.h`, `set_params_impl`). Networks are padded to
//! multiples of sixteen: the grid's features with zeros, directions with ones. Space is the cube
//! from 0 to 1, or a larger one around it, into which positions come scaled, moved and with their axes turned
//! (`nerf_loader.h`, `nerf_position_to_ngp`).

mod networks;
mod settings;

use std::io::Read as _;
use std::path::Path;

use flate2::read::MultiGzDecoder;
use flate2::read::ZlibDecoder;
use glam::{Mat3, UVec3, Vec3};
use rmpv::ValueRef;

use self::networks::halves;
use self::settings::Settings;
use super::hash_field::HashField;
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
    let ([0x80..=0x8f, rest @ ..] | [0xde, _, _, rest @ ..]) = head else {
        return false;
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
    let settings = Settings {
        value: &value,
        name: String::new(),
    };
    snapshot(&settings).map_err(fail)
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

/// What the whole file says.
fn snapshot(settings: &Settings<'_>) -> Result<Snapshot, String> {
    let snapshot = settings.get("snapshot")?;
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
        field: settings.field(&snapshot, aabb_scale, is_hdr)?,
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
