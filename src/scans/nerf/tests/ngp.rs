//! Snapshots of instant-ngp.

use std::io::Write as _;

use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use glam::UVec3;
use half::f16;

use super::super::ngp::cell_index;
use super::*;

/// `MessagePack`, what of it nlohmann's library writes.
enum Item {
    Map(Vec<(&'static str, Self)>),
    List(Vec<f64>),
    Text(&'static str),
    Int(u64),
    Number(f64),
    Bytes(Vec<u8>),
    Bool(bool),
}

impl Item {
    fn write(&self, out: &mut Vec<u8>) {
        match self {
            Self::Map(pairs) => {
                out.push(0x80 | pairs.len() as u8);
                for (key, value) in pairs {
                    Self::Text(key).write(out);
                    value.write(out);
                }
            }
            Self::List(numbers) => {
                out.push(0x90 | numbers.len() as u8);
                for x in numbers {
                    Self::Number(*x).write(out);
                }
            }
            Self::Text(text) => {
                out.extend([0xd9, text.len() as u8]);
                out.extend(text.as_bytes());
            }
            Self::Int(n) => {
                out.push(0xcf);
                out.extend(n.to_be_bytes());
            }
            Self::Number(x) => {
                out.push(0xcb);
                out.extend(x.to_be_bytes());
            }
            Self::Bytes(bytes) => {
                out.push(0xc6);
                out.extend((bytes.len() as u32).to_be_bytes());
                out.extend(bytes);
            }
            Self::Bool(is) => out.push(if *is { 0xc3 } else { 0xc2 }),
        }
    }

    /// Another value for a key, which `/` leads to.
    fn set(&mut self, path: &str, item: Self) {
        let (first, rest) = path
            .split_once('/')
            .map_or((path, None), |(a, b)| (a, Some(b)));
        let Self::Map(pairs) = self else {
            panic!("{path} leads nowhere");
        };
        let at = pairs.iter().position(|(key, _)| *key == first).unwrap();
        match rest {
            Some(rest) => pairs[at].1.set(rest, item),
            None => pairs[at].1 = item,
        }
    }
}

const LEVELS: i32 = 3;
const FEATURES: usize = 4;
const TABLE: u32 = 512;
const BASE: f64 = 4.0;
const GROWTH: f64 = 2.7;
const WIDTH: usize = 16;
/// Inputs and outputs of the matrices: twelve features and nothing, the density's sixteen and harmonics, with learnt
/// numbers and ones behind them where there are any.
const DENSITY: [(usize, usize); 2] = [(16, WIDTH), (WIDTH, 16)];
const COLOR: [(usize, usize); 3] = [(32, WIDTH), (WIDTH, WIDTH), (WIDTH, 16)];

/// Corners along a side and corners in the table, of each level.
fn levels() -> Vec<(f64, u32, u32)> {
    let level = |i| {
        let scale = BASE * GROWTH.powi(i) - 1.0;
        let side = scale.ceil() as u32 + 1;
        (scale, side, (side.pow(3).div_ceil(8) * 8).min(TABLE))
    };
    (0..LEVELS).map(level).collect()
}

fn params(color: &[(usize, usize)]) -> Vec<f32> {
    let mut random = Random(21);
    let mut params = Vec::new();
    for (n_in, n_out) in DENSITY.iter().chain(color) {
        params.extend(random.numbers(n_in * n_out, 2.4 / (*n_in as f32).sqrt()));
    }
    let n_corners: u32 = levels().iter().map(|level| level.2).sum();
    params.extend(random.numbers(n_corners as usize * FEATURES, 1.0));
    params
        .into_iter()
        .map(|x| f16::from_f32(x).to_f32())
        .collect()
}

fn halves(numbers: &[f32]) -> Vec<u8> {
    let halves = numbers.iter().map(|x| f16::from_f32(*x));
    halves.flat_map(f16::to_le_bytes).collect()
}

fn network(n_hidden: u64) -> Item {
    Item::Map(vec![
        ("activation", Item::Text("ReLU")),
        ("n_hidden_layers", Item::Int(n_hidden)),
        ("n_neurons", Item::Int(WIDTH as u64)),
        ("otype", Item::Text("FullyFusedMLP")),
        ("output_activation", Item::Text("None")),
    ])
}

fn snapshot(params: &[f32]) -> Item {
    Item::Map(vec![
        (
            "dir_encoding",
            Item::Map(vec![
                ("degree", Item::Int(4)),
                ("otype", Item::Text("SphericalHarmonics")),
            ]),
        ),
        (
            "encoding",
            Item::Map(vec![
                ("base_resolution", Item::Int(BASE as u64)),
                ("log2_hashmap_size", Item::Int(u64::from(TABLE.ilog2()))),
                ("n_features_per_level", Item::Int(FEATURES as u64)),
                ("n_levels", Item::Int(LEVELS as u64)),
                ("otype", Item::Text("HashGrid")),
                ("per_level_scale", Item::Number(GROWTH)),
            ]),
        ),
        ("network", network(1)),
        ("rgb_network", network(2)),
        (
            "snapshot",
            Item::Map(vec![
                ("density_grid_binary", Item::Bytes(Vec::new())),
                ("density_grid_size", Item::Int(128)),
                ("mode", Item::Text("nerf")),
                (
                    "nerf",
                    Item::Map(vec![
                        ("aabb_scale", Item::Int(2)),
                        (
                            "dataset",
                            Item::Map(vec![
                                ("from_mitsuba", Item::Bool(false)),
                                ("is_hdr", Item::Bool(false)),
                                ("n_extra_learnable_dims", Item::Int(0)),
                                ("offset", Item::List(vec![0.5, 0.4, 0.7])),
                                ("scale", Item::Number(0.4)),
                            ]),
                        ),
                    ]),
                ),
                ("params_binary", Item::Bytes(halves(params))),
                ("params_type", Item::Text("__half")),
                ("version", Item::Int(1)),
            ]),
        ),
    ])
}

fn bytes(snapshot: &Item) -> Vec<u8> {
    let mut out = Vec::new();
    snapshot.write(&mut out);
    out
}

/// The outputs of matrices one after the other, row by row in `params`.
fn layers(params: &mut &[f32], sizes: &[(usize, usize)], mut x: Vec<f64>) -> Vec<f64> {
    for (i, (n_in, n_out)) in sizes.iter().enumerate() {
        let (weights, rest) = params.split_at(n_in * n_out);
        *params = rest;
        let rows = weights.chunks(*n_in);
        let sum = |row: &[f32]| {
            row.iter()
                .zip(&x)
                .map(|(w, x)| f64::from(*w) * x)
                .sum::<f64>()
        };
        let last = i + 1 == sizes.len();
        x = rows
            .map(|row| if last { sum(row) } else { sum(row).max(0.0) })
            .collect();
    }
    x
}

fn grid(table: &[f32], p: [f64; 3]) -> Vec<f64> {
    let (mut out, mut first) = (Vec::new(), 0);
    for (scale, side, n) in levels() {
        let at = p.map(|x| x * scale + 0.5);
        let mut sums = [0.0; FEATURES];
        for corner in 0..8 {
            let up = [corner & 1, corner >> 1 & 1, corner >> 2];
            let (mut weight, mut c) = (1.0, [0_u32; 3]);
            for k in 0..3 {
                let to = at[k] - at[k].floor();
                weight *= if up[k] == 1 { to } else { 1.0 - to };
                c[k] = at[k].floor() as u32 + up[k];
            }
            let index = if side.pow(3) <= n {
                c[0] + side * c[1] + side * side * c[2]
            } else {
                c[0] ^ c[1].wrapping_mul(2_654_435_761) ^ c[2].wrapping_mul(805_459_861)
            };
            let corner = (first + (index % n) as usize) * FEATURES;
            for (sum, x) in sums.iter_mut().zip(&table[corner..]) {
                *sum += weight * f64::from(*x);
            }
        }
        out.extend(sums);
        first += n as usize;
    }
    out
}

/// What `sh_enc` computes, from the definition: the associated Legendre functions with the phase of Condon and Shortley.
pub(super) fn harmonics(d: [f64; 3]) -> Vec<f64> {
    let [x, y, z] = d;
    let pi = std::f64::consts::PI;
    let mut out = Vec::new();
    for l in 0..4_i32 {
        for m in -l..=l {
            let k = m.abs();
            // The part of the function in z, without the power of the sine, which x and y carry.
            let legendre = match (l, k) {
                (0, 0) | (1, 1) => 1.0,
                (1, 0) => z,
                (2, 0) => 0.5 * (3.0 * z * z - 1.0),
                (2, 1) => 3.0 * z,
                (2, 2) => 3.0,
                (3, 0) => 0.5 * (5.0 * z * z * z - 3.0 * z),
                (3, 1) => 1.5 * (5.0 * z * z - 1.0),
                (3, 2) => 15.0 * z,
                _ => 15.0,
            };
            // (x + i y)^k
            let (mut re, mut im) = (1.0, 0.0);
            for _ in 0..k {
                (re, im) = (re * x - im * y, re * y + im * x);
            }
            let factorial = |n: i32| (1..=n).map(f64::from).product::<f64>();
            let norm = f64::from(2 * l + 1) / (4.0 * pi) * factorial(l - k) / factorial(l + k);
            let norm = norm.sqrt() * if m == 0 { 1.0 } else { 2_f64.sqrt() };
            let sign = if k % 2 == 1 { -1.0 } else { 1.0 };
            let angular = if m < 0 { im } else { re };
            out.push(sign * norm * legendre * angular);
        }
    }
    out
}

/// Where a point of the scene lies in the cube, and its density and colour; `learnt` and ones follow the harmonics.
fn reference(
    params: &[f32],
    color: &[(usize, usize)],
    tail: &[f64],
    p: Vec3,
    d: Vec3,
) -> (f64, [f64; 3]) {
    let (p, d) = (p.to_array().map(f64::from), d.to_array().map(f64::from));
    let moved = [0.4 * p[0] + 0.5, 0.4 * p[1] + 0.4, 0.4 * p[2] + 0.7];
    // A cube of side 2 around 0.5.
    let at = [moved[1], moved[2], moved[0]].map(|x| 0.5 * x + 0.25);
    let n_networks: usize = DENSITY.iter().chain(color).map(|(a, b)| a * b).sum();
    let mut rest = params;
    let mut features = grid(&params[n_networks..], at);
    features.resize(16, 0.0);
    let mut x = layers(&mut rest, &DENSITY, features);
    let density = x[0].exp() * 0.4;
    x.extend(harmonics([d[1], d[2], d[0]]));
    x.extend(tail);
    let color = layers(&mut rest, color, x);
    (density, [0, 1, 2].map(|c| 1.0 / (1.0 + (-color[c]).exp())))
}

#[test]
fn a_snapshot_answers_as_the_program_computes() {
    let folder = tempfile::tempdir().unwrap();
    let params = params(&COLOR);
    let plain = bytes(&snapshot(&params));
    let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
    gzip.write_all(&plain).unwrap();
    let mut zlib = ZlibEncoder::new(Vec::new(), Compression::fast());
    zlib.write_all(&plain).unwrap();
    let packed = [gzip.finish().unwrap(), zlib.finish().unwrap()];
    for bytes in [&plain, &packed[0], &packed[1]] {
        let path = write(folder.path(), "a.ingp", bytes);
        assert!(is_nerf(&path), "recognised by its content");
        let nerf = read(&path).unwrap();
        let description = "neural radiance field of instant-ngp (hash grid, 12 features)";
        assert_eq!(nerf.describe(), description, "for people");
        assert_answers(&nerf, 1.4, |p, d| reference(&params, &COLOR, &[], p, d));
    }
}

#[test]
fn what_pictures_have_learnt_is_replaced_by_its_mean() {
    let color = [(48, WIDTH), (WIDTH, WIDTH), (WIDTH, 16)];
    let params = params(&color);
    let mut item = snapshot(&params);
    item.set("snapshot/nerf/dataset/n_extra_learnable_dims", Item::Int(2));
    let folder = tempfile::tempdir().unwrap();
    let nerf = read(&write(folder.path(), "a.msgpack", &bytes(&item))).unwrap();
    // None has learnt anything, so it is zero; fourteen ones follow.
    let mut tail = vec![0.0; 2];
    tail.extend([1.0; 14]);
    assert_answers(&nerf, 1.4, |p, d| reference(&params, &color, &tail, p, d));
}

#[test]
fn the_density_grid_says_where_anything_is() {
    // One cell of each cascade, in the order of the bits of its coordinates.
    let n_cells = 128_usize.pow(3);
    let cell = UVec3::new(100, 3, 77);
    let bits = |x: u32| {
        (0..7)
            .map(|b| ((x >> b & 1) as usize) << (3 * b))
            .sum::<usize>()
    };
    let index = bits(cell.x) + 2 * bits(cell.y) + 4 * bits(cell.z);
    assert_eq!(cell_index(cell), index, "interleaved");
    let mut densities = vec![0.0; 2 * n_cells];
    densities[index] = 1.0;
    densities[n_cells + index] = 1.0;
    let mut item = snapshot(&params(&COLOR));
    item.set(
        "snapshot/density_grid_binary",
        Item::Bytes(halves(&densities)),
    );
    let folder = tempfile::tempdir().unwrap();
    let nerf = read(&write(folder.path(), "a.msgpack", &bytes(&item))).unwrap();
    let occupancy = nerf.occupancy();
    for (half, center) in [(0.5, 0.5), (1.0, 0.5)] {
        let p = center + half * (2.0 * (cell.as_vec3() + 0.5) / 128.0 - 1.0);
        let width = 2.0 * half / 128.0;
        assert_eq!(occupancy.at(p), Some((true, width)), "the cell");
        assert_eq!(
            occupancy.at(p + width * Vec3::Z),
            Some((false, width)),
            "the next"
        );
    }
}

/// What is changed of the snapshot, and what is said about it.
fn faults_of_snapshot() -> Vec<(&'static str, Item, &'static str)> {
    vec![
        (
            "snapshot/mode",
            Item::Text("sdf"),
            "snapshot.mode: \"sdf\" is no radiance field",
        ),
        (
            "snapshot/params_type",
            Item::Text("int8"),
            "params_type: \"int8\"",
        ),
        (
            "snapshot/params_binary",
            Item::Bytes(vec![0; 10]),
            "params_binary: 5 numbers",
        ),
        (
            "snapshot/density_grid_size",
            Item::Int(64),
            "density_grid_size: not 128",
        ),
        (
            "snapshot/density_grid_binary",
            Item::Bytes(vec![0; 10]),
            "shorter than its cascades",
        ),
        (
            "snapshot/nerf/aabb_scale",
            Item::Int(3),
            "aabb_scale: not a power of two",
        ),
        (
            "snapshot/nerf/aabb_scale",
            Item::Int(1 << 40),
            "snapshot.nerf.aabb_scale: not a whole",
        ),
        (
            "snapshot/nerf/dataset/scale",
            Item::Number(-1.0),
            "scale: not positive",
        ),
        (
            "snapshot/nerf/dataset/offset",
            Item::List(vec![0.5]),
            "offset: not three numbers",
        ),
    ]
}

/// What is changed of the networks, and what is said about it.
fn faults_of_networks() -> Vec<(&'static str, Item, &'static str)> {
    vec![
        (
            "encoding/otype",
            Item::Text("Frequency"),
            "encoding: otype: \"frequency\" is not read",
        ),
        (
            "encoding/n_levels",
            Item::Int(1 << 31),
            "encoding.n_levels: not a whole number",
        ),
        (
            "encoding/n_features_per_level",
            Item::Int(3),
            "not 1, 2, 4 or 8",
        ),
        ("encoding/log2_hashmap_size", Item::Int(28), "params_binary"),
        (
            "network/otype",
            Item::Text("Other"),
            "network: otype: \"other\"",
        ),
        (
            "network/activation",
            Item::Text("Sine"),
            "network.activation: only \"ReLU\"",
        ),
        (
            "dir_encoding/otype",
            Item::Text("OneBlob"),
            "dir_encoding: otype",
        ),
        ("rgb_network", Item::Int(0), "rgb_network.otype: missing"),
    ]
}

#[test]
fn snapshots_that_are_not_read_say_why() {
    let folder = tempfile::tempdir().unwrap();
    let faults = faults_of_snapshot().into_iter().chain(faults_of_networks());
    for (path, item, expected) in faults {
        let mut changed = snapshot(&params(&COLOR));
        changed.set(path, item);
        let problem = read(&write(folder.path(), "a.msgpack", &bytes(&changed)));
        let problem = problem.err().unwrap().to_string();
        assert!(
            problem.contains("a.msgpack") && problem.contains(expected),
            "{problem}"
        );
    }
}

#[test]
fn damaged_snapshots_are_survived() {
    let plain = bytes(&snapshot(&params(&COLOR)));
    assert_survives_damage("a.msgpack", &plain);
}
