//! The compressed `.ply` of `SuperSplat` (`PlayCanvas`; github.com/playcanvas/splat-transform, `decompress-ply.ts`): Gaussians of
//! 16 bytes within the bounds of their chunk of 256, and their harmonics, a byte each, in an element of their own.

use std::path::Path;

use glam::{Quat, Vec3};

use super::encoding::{constant_of, degree_of, smallest_three};
use super::inria_ply::says_antialiased;
use super::ply_file::{Element, Field, PlyFile, Rows};
use super::{Collector, Splat, Splats};
use crate::data::DataError;

/// Gaussians of a chunk.
const N_IN_CHUNK: usize = 256;
/// What is told of a chunk: the least and the most.
const CENTERS: [&str; 6] = ["min_x", "min_y", "min_z", "max_x", "max_y", "max_z"];
const SCALES: [&str; 6] = [
    "min_scale_x",
    "min_scale_y",
    "min_scale_z",
    "max_scale_x",
    "max_scale_y",
    "max_scale_z",
];
const COLORS: [&str; 6] = ["min_r", "min_g", "min_b", "max_r", "max_g", "max_b"];
/// Harmonics are stored within ± this.
const MAX_HARMONIC: f32 = 4.0;

/// What the numbers of a chunk's Gaussians are between.
#[derive(Debug)]
struct Chunk {
    center: [Vec3; 2],
    /// Logarithms.
    scale: [Vec3; 2],
    /// sRGB; beyond 0 to 1, too.
    color: [Vec3; 2],
}

/// The harmonics beyond the constant one.
#[derive(Debug)]
struct Rest {
    /// Channel after channel.
    fields: Vec<Field>,
    rows: Rows,
}

/// Whether a PLY holds compressed Gaussians.
pub(super) fn is_compressed(file: &PlyFile) -> bool {
    let vertex = file.element("vertex");
    vertex.is_some_and(|vertex| vertex.field("packed_position").is_some())
}

/// Reads the elements `chunk`, `vertex` and, where there is one, `sh`.
pub(super) fn read(path: &Path) -> Result<Splats, DataError> {
    let file = PlyFile::open(path)?;
    let element = |name: &str| {
        let missing = || DataError::unusable(path, format!("no element {name}"));
        file.element(name).ok_or_else(missing)
    };
    let vertex = element("vertex")?;
    let chunks = read_chunks(path, &file, element("chunk")?, vertex.n)?;
    let names = ["position", "rotation", "scale", "color"].map(|name| format!("packed_{name}"));
    let fields = vertex.fields(path, names.each_ref().map(String::as_str))?;
    let mut rest = Rest::open(path, &file, vertex.n)?;
    let mut rows = file.rows(vertex)?;
    let degree = rest.as_ref().and_then(|rest| degree_of(rest.fields.len()));
    let degree = degree.unwrap_or(0);
    let mut found = Collector::new(vertex.n, degree);
    let mut harmonics = vec![[0.0; 3]; (degree + 1).pow(2)];
    for i in 0..vertex.n {
        let row = rows.next()?;
        let Some(packed) = packed(&fields, row) else {
            let problem = "element vertex: packed_* are not unsigned integers of 32 bits";
            return Err(DataError::unusable(path, problem));
        };
        let (splat, constant) = chunks[i / N_IN_CHUNK].splat(packed);
        harmonics[0] = constant;
        if let Some(rest) = &mut rest {
            rest.read(&mut harmonics[1..])?;
        }
        found.push(splat, &harmonics);
    }
    found.finish(path, says_antialiased(&file.comments))
}

/// The chunks of `n` Gaussians.
fn read_chunks(
    path: &Path,
    file: &PlyFile,
    element: &Element,
    n: usize,
) -> Result<Vec<Chunk>, DataError> {
    if element.n < n.div_ceil(N_IN_CHUNK) {
        let problem = format!("element chunk: {} are too few for {n} Gaussians", element.n);
        return Err(DataError::unusable(path, problem));
    }
    let centers = element.fields(path, CENTERS)?;
    let scales = element.fields(path, SCALES)?;
    // Early files have none.
    let has_colors = element.field(COLORS[0]).is_some();
    let colors = has_colors
        .then(|| element.fields(path, COLORS))
        .transpose()?;
    let mut rows = file.rows(element)?;
    let mut chunks = Vec::with_capacity(element.n);
    for _ in 0..element.n {
        let row = rows.next()?;
        let color = colors.as_ref().map(|fields| bounds(fields, row));
        chunks.push(Chunk {
            center: bounds(&centers, row),
            scale: bounds(&scales, row),
            color: color.unwrap_or([Vec3::ZERO, Vec3::ONE]),
        });
    }
    Ok(chunks)
}

fn bounds(fields: &[Field; 6], row: &[u8]) -> [Vec3; 2] {
    let [a, b, c, d, e, f] = fields.each_ref().map(|field| field.number(row));
    [Vec3::new(a, b, c), Vec3::new(d, e, f)]
}

/// Position, rotation, scale and colour of a record.
fn packed(fields: &[Field; 4], row: &[u8]) -> Option<[u32; 4]> {
    let [position, rotation, scale, color] = fields.each_ref().map(|field| field.bits(row));
    Some([position?, rotation?, scale?, color?])
}

impl Chunk {
    /// A Gaussian of it and its constant harmonic.
    fn splat(&self, packed: [u32; 4]) -> (Splat, [f32; 3]) {
        let [position, rotation, scale, color] = packed;
        let between = |[least, most]: [Vec3; 2], t: Vec3| least * (1.0 - t) + most * t;
        let three = |bits: u32| {
            let [x, y, z] = [unit(bits >> 21, 11), unit(bits >> 11, 10), unit(bits, 11)];
            Vec3::new(x, y, z)
        };
        let color_in_chunk = Vec3::new(
            unit(color >> 24, 8),
            unit(color >> 16, 8),
            unit(color >> 8, 8),
        );
        let splat = Splat {
            center: between(self.center, three(position)),
            scale: between(self.scale, three(scale)).exp(),
            rotation: quaternion(rotation),
            opacity: unit(color, 8),
        };
        (splat, constant_of(between(self.color, color_in_chunk)))
    }
}

/// The lowest bits as a number from 0 to 1.
fn unit(bits: u32, n_bits: u32) -> f32 {
    let most = (1 << n_bits) - 1;
    (bits & most) as f32 / most as f32
}

/// Of w, x, y, z the index of the largest in two bits, then ten for each of the others.
fn quaternion(bits: u32) -> Quat {
    let others =
        [20, 10, 0].map(|shift| (unit(bits >> shift, 10) - 0.5) * std::f32::consts::SQRT_2);
    let [w, x, y, z] = smallest_three((bits >> 30) as usize, others);
    Quat::from_xyzw(x, y, z, w)
}

impl Rest {
    /// The harmonics of `n` Gaussians; `None` where the file has none.
    fn open(path: &Path, file: &PlyFile, n: usize) -> Result<Option<Self>, DataError> {
        let Some(element) = file.element("sh") else {
            return Ok(None);
        };
        let fields = element.series("f_rest_");
        let n_fields = fields.len();
        if element.n != n || !matches!(degree_of(n_fields), Some(1..=3)) {
            let n_sh = element.n;
            let problem =
                format!("element sh: {n_sh} of {n_fields} properties f_rest_* for {n} Gaussians");
            return Err(DataError::unusable(path, problem));
        }
        let rows = file.rows(element)?;
        Ok(Some(Self { fields, rows }))
    }

    /// Those of the next Gaussian.
    fn read(&mut self, harmonics: &mut [[f32; 3]]) -> Result<(), DataError> {
        let row = self.rows.next()?;
        let n = self.fields.len() / 3;
        for (i, harmonic) in harmonics.iter_mut().enumerate() {
            *harmonic =
                [0, 1, 2].map(|channel| harmonic_of(self.fields[channel * n + i].number(row)));
        }
        Ok(())
    }
}

/// A harmonic by its byte: the middle of what is rounded to it, but the ends themselves.
fn harmonic_of(byte: f32) -> f32 {
    let unit = match byte {
        0.0 => 0.0,
        255.0 => 1.0,
        _ => (byte + 0.5) / 256.0,
    };
    (2.0 * unit - 1.0) * MAX_HARMONIC
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use super::super::test_files::{
        check_damaged, color, directions, error_of, random_splats, read_bytes,
    };
    use super::*;

    /// What `SuperSplat` would write of one chunk, by its `CompressedChunk`.
    fn file_of(splats: &Splats, has_colors: bool) -> Vec<u8> {
        let n = (splats.degree + 1).pow(2);
        let pack = |v: f32, bits: u32| (v * ((1 << bits) - 1) as f32).round() as u32;
        let pack_three = |t: Vec3| pack(t.x, 11) << 21 | pack(t.y, 10) << 11 | pack(t.z, 11);
        // Wider than any of the test's.
        let limits = [(-5.0_f32, 5.0_f32), (-6.0, 0.0), (-0.5, 1.5)];
        let unit = |v: Vec3, (a, b): (f32, f32)| (v - a) / (b - a);
        let mut text = "ply\nformat binary_little_endian 1.0\nelement chunk 1\n".to_owned();
        let columns = [CENTERS, SCALES, COLORS];
        let n_columns = if has_colors { 3 } else { 2 };
        for column in columns[..n_columns].iter().flatten() {
            writeln!(text, "property float {column}").unwrap();
        }
        writeln!(text, "element vertex {}", splats.splats.len()).unwrap();
        for name in ["position", "rotation", "scale", "color"] {
            writeln!(text, "property uint packed_{name}").unwrap();
        }
        if splats.degree > 0 {
            writeln!(text, "element sh {}", splats.splats.len()).unwrap();
            for i in 0..3 * (n - 1) {
                writeln!(text, "property uchar f_rest_{i}").unwrap();
            }
        }
        let mut bytes = (text + "end_header\n").into_bytes();
        for (least, most) in &limits[..n_columns] {
            bytes.extend([least.to_le_bytes(); 3].concat());
            bytes.extend([most.to_le_bytes(); 3].concat());
        }
        for (i, splat) in splats.splats.iter().enumerate() {
            let [x, y, z, w] = splat.rotation.to_array();
            let all = [w, x, y, z];
            let largest = (0..4)
                .max_by(|a, b| all[*a].abs().total_cmp(&all[*b].abs()))
                .unwrap();
            let mut rotation = largest as u32;
            for other in (0..4).filter(|k| *k != largest) {
                let v = all[other] * all[largest].signum();
                rotation = rotation << 10 | pack(v * 0.5_f32.sqrt() + 0.5, 10);
            }
            let srgb = Vec3::from(splats.harmonics[i * n]) * 0.282_094_8 + 0.5;
            let range = if has_colors { limits[2] } else { (0.0, 1.0) };
            let srgb = unit(srgb, range);
            let rgb = pack(srgb.x, 8) << 24 | pack(srgb.y, 8) << 16 | pack(srgb.z, 8) << 8;
            bytes.extend(pack_three(unit(splat.center, limits[0])).to_le_bytes());
            bytes.extend(rotation.to_le_bytes());
            let scale = unit(splat.scale.map(f32::ln), limits[1]);
            bytes.extend(pack_three(scale).to_le_bytes());
            bytes.extend((rgb | pack(splat.opacity, 8)).to_le_bytes());
        }
        for harmonics in splats.harmonics.chunks(n) {
            for channel in 0..3 {
                let byte =
                    |h: &[f32; 3]| ((h[channel] / 8.0 + 0.5) * 256.0).clamp(0.0, 255.0) as u8;
                bytes.extend(harmonics[1..].iter().map(byte));
            }
        }
        bytes
    }

    #[test]
    fn gaussians_are_read_back_to_their_quantisation() {
        for (degree, has_colors) in [(0, false), (0, true), (1, true), (2, true), (3, true)] {
            let splats = random_splats(100, degree);
            let found = read_bytes("a.ply", &file_of(&splats, has_colors));
            assert_eq!((found.splats.len(), found.degree), (100, degree));
            for (i, (a, b)) in found.splats.iter().zip(&splats.splats).enumerate() {
                assert!(
                    a.center.abs_diff_eq(b.center, 5.1 / 1023.0),
                    "{i}: {}",
                    a.center
                );
                let ratio = (a.scale / b.scale).map(f32::ln).abs().max_element();
                assert!(ratio < 3.1 / 1023.0, "{i}: {ratio}");
                assert!(a.rotation.dot(b.rotation).abs() > 1.0 - 1e-5, "{i}");
                assert!((a.opacity - b.opacity).abs() < 0.51 / 255.0, "{i}");
                let tolerance = if degree == 0 { 1.01 / 255.0 } else { 0.12 };
                for d in directions() {
                    let (a, b) = (color(&found, i, d), color(&splats, i, d));
                    assert!(a.abs_diff_eq(b, tolerance), "{i} along {d}: {a}, {b}");
                }
            }
            let pairs = found
                .harmonics
                .iter()
                .flatten()
                .zip(splats.harmonics.iter().flatten());
            let most = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(most < 4.01 / 256.0, "{most}");
        }
    }

    #[test]
    fn chunks_are_of_256_gaussians() {
        let splats = random_splats(300, 0);
        let bytes = file_of(&splats, false);
        assert!(
            error_of("a.ply", &bytes).contains("element chunk"),
            "one chunk"
        );
        let text = bytes.windows(8).position(|w| w == b"chunk 1\n").unwrap();
        let mut two = bytes.clone();
        two[text + 6] = b'2';
        let end = bytes
            .windows(11)
            .position(|w| w == b"end_header\n")
            .unwrap()
            + 11;
        // The second chunk is one further along x.
        let mut chunk = bytes[end..end + 48].to_vec();
        chunk[..4].copy_from_slice(&(-4.0_f32).to_le_bytes());
        chunk[12..16].copy_from_slice(&6.0_f32.to_le_bytes());
        two.splice(end + 48..end + 48, chunk);
        let found = read_bytes("a.ply", &two);
        for (i, (a, b)) in found.splats.iter().zip(&splats.splats).enumerate() {
            let expected = b.center + Vec3::X * f32::from(u8::from(i >= 256));
            assert!(
                a.center.abs_diff_eq(expected, 5.1 / 1023.0),
                "{i}: {}",
                a.center
            );
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        let splats = random_splats(3, 1);
        let text = file_of(&splats, true);
        let replaced = |from: &str, to: &str| {
            let at = text.windows(from.len()).position(|w| w == from.as_bytes());
            let mut bytes = text.clone();
            bytes.splice(at.unwrap()..at.unwrap() + from.len(), to.bytes());
            error_of("a.ply", &bytes)
        };
        assert!(
            replaced("max_scale_y", "other").contains("max_scale_y"),
            "chunk"
        );
        assert!(
            replaced("packed_color", "other").contains("packed_color"),
            "vertex"
        );
        assert!(
            replaced("uint packed_scale", "float packed_scale").contains("packed_"),
            "type"
        );
        assert!(
            replaced("element sh 3", "element sh 2").contains("element sh"),
            "sh"
        );
        assert!(
            replaced("element vertex 3", "element vertex 99999").contains("chunk"),
            "many"
        );
    }

    #[test]
    fn damaged_files_are_read_or_refused() {
        check_damaged("a.ply", &file_of(&random_splats(30, 1), true));
    }
}
