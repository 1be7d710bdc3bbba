//! `.spz` (Niantic; github.com/nianticlabs/spz, `load-spz.cc`): one array a parameter, each of bytes; versions 1 to 3 in one gzip
//! stream, version 4 with one Zstandard stream an array. Extensions are left out, and harmonics of a fourth degree.
//!
//! Its coordinates are right, up, back by definition, those of a `.ply` right, down, front: Gaussians are turned into the
//! latter, as the library's `convertCoordinates(RUB, RDF)` does, so that a capture app's `.spz` and `.ply` are the same scene.
//! (The library's `ply_to_spz` leaves coordinates as they are, so that what it makes of a `.ply` lies upside down here.)

use std::fs::File;
use std::io::{BufReader, Read, Seek as _, SeekFrom};
use std::path::Path;

use flate2::read::GzDecoder;
use glam::{Quat, Vec3};
use half::f16;
use ruzstd::decoding::StreamingDecoder;

use super::encoding::{MAX_DEGREE, N_REST, check_expansion, smallest_three};
use super::{Collector, Splat, Splats};
use crate::data::DataError;

const MAGIC: &[u8] = b"NGSP";
/// Length of the header before version 4 and from there on, bytes.
const OLD_HEADER: usize = 16;
const HEADER: usize = 32;
const ANTIALIASED: u8 = 1;
/// Colours are stored as 0.5 and this much of the constant coefficient.
const COLOR_SCALE: f32 = 0.15;
/// Largest window of a Zstandard stream, bytes: what its own tool accepts.
const MAX_WINDOW: u64 = 1 << 27;
/// Axes that are turned: to the other side with the y and z axes.
const TURNED: Vec3 = Vec3::new(1.0, -1.0, -1.0);
/// The harmonics' signs in turned axes: of each power of y or z one change.
const TURNED_HARMONICS: [f32; 16] = [
    1.0, //
    -1.0, -1.0, 1.0, //
    -1.0, 1.0, 1.0, -1.0, 1.0, //
    -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0,
];

/// What the file says of itself.
#[derive(Debug)]
struct Header {
    version: u32,
    n: usize,
    /// Of the file's harmonics.
    degree: usize,
    /// Of coordinates after the binary point.
    n_fraction_bits: u8,
    is_antialiased: bool,
}

/// Whether a file starts as one, packed or not.
pub(super) fn is_spz(path: &Path) -> bool {
    let Ok(file) = File::open(path) else {
        return false;
    };
    let mut reader = BufReader::new(file);
    starts_as_spz(&mut reader)
        || (reader.rewind().is_ok() && starts_as_spz(&mut GzDecoder::new(reader)))
}

fn starts_as_spz(reader: &mut impl Read) -> bool {
    let mut magic = [0; MAGIC.len()];
    reader.read_exact(&mut magic).is_ok() && magic == MAGIC
}

/// Reads any version.
pub(super) fn read(path: &Path) -> Result<Splats, DataError> {
    let io = |e| DataError::io(path, e);
    let file = File::open(path).map_err(io)?;
    let n_file = file.metadata().map_err(io)?.len();
    let mut reader = BufReader::new(file);
    let is_packed_as_one = !starts_as_spz(&mut reader);
    reader.rewind().map_err(io)?;
    let (header, arrays) = if is_packed_as_one {
        read_gzip(path, reader, n_file)?
    } else {
        read_streams(path, reader, n_file)?
    };
    header.unpack(path, &arrays)
}

/// The header and arrays of versions before 4.
fn read_gzip(
    path: &Path,
    reader: BufReader<File>,
    n_file: u64,
) -> Result<(Header, Vec<u8>), DataError> {
    let broken = |e| DataError::unusable(path, format!("gzip stream: {e}"));
    let mut reader = GzDecoder::new(reader);
    let mut head = [0; OLD_HEADER];
    reader.read_exact(&mut head).map_err(broken)?;
    let header = Header::of(path, &head, 1..=3)?;
    let n_bytes = header.n_bytes();
    check_expansion(n_file, n_bytes).map_err(|e| DataError::unusable(path, e))?;
    let mut arrays = Vec::new();
    let mut rest = (&mut reader).take(n_bytes);
    rest.read_to_end(&mut arrays).map_err(broken)?;
    if (arrays.len() as u64) < n_bytes {
        return Err(header.too_short(path, arrays.len()));
    }
    // The checksum is at the end, after extensions.
    std::io::copy(&mut reader.take(n_file), &mut std::io::sink()).map_err(broken)?;
    Ok((header, arrays))
}

/// The header and arrays of version 4.
fn read_streams(
    path: &Path,
    mut reader: BufReader<File>,
    n_file: u64,
) -> Result<(Header, Vec<u8>), DataError> {
    let broken = |e| DataError::unusable(path, format!("header: {e}"));
    let mut head = [0; HEADER];
    reader.read_exact(&mut head).map_err(broken)?;
    let header = Header::of(path, &head, 4..=4)?;
    check_expansion(n_file, header.n_bytes()).map_err(|e| DataError::unusable(path, e))?;
    let (words, _) = head.as_chunks();
    let mut at = u64::from(u32::from_le_bytes(words[4]));
    reader.seek(SeekFrom::Start(at)).map_err(broken)?;
    let sizes = header.sizes().map(|size| (size * header.n) as u64);
    let n_streams = sizes.iter().filter(|size| **size > 0).count();
    let mut table = vec![[0; 8]; 2 * n_streams];
    for number in &mut table {
        reader.read_exact(number).map_err(broken)?;
    }
    at += 16 * n_streams as u64;
    let mut arrays = Vec::new();
    for (i, size) in sizes.into_iter().take(n_streams).enumerate() {
        let [packed, unpacked] = [0, 1].map(|k| u64::from_le_bytes(table[2 * i + k]));
        if unpacked != size {
            let problem = format!("stream {i}: {unpacked} bytes, not {size}");
            return Err(DataError::unusable(path, problem));
        }
        reader.seek(SeekFrom::Start(at)).map_err(broken)?;
        at = at.saturating_add(packed);
        let n_before = arrays.len();
        if let Err(problem) = inflate(&mut (&mut reader).take(packed), size, &mut arrays) {
            return Err(DataError::unusable(path, format!("stream {i}: {problem}")));
        }
        if (arrays.len() - n_before) as u64 != size {
            return Err(header.too_short(path, arrays.len()));
        }
    }
    Ok((header, arrays))
}

/// Appends what a Zstandard stream holds, at most so many bytes.
fn inflate(stream: &mut impl Read, most: u64, bytes: &mut Vec<u8>) -> Result<(), String> {
    let decoder = StreamingDecoder::new_with_max_window_size(stream, MAX_WINDOW);
    let mut rest = decoder.map_err(|e| e.to_string())?.take(most);
    rest.read_to_end(bytes).map_err(|e| e.to_string())?;
    Ok(())
}

impl Header {
    fn of(
        path: &Path,
        head: &[u8],
        versions: std::ops::RangeInclusive<u32>,
    ) -> Result<Self, DataError> {
        let (words, _) = head.as_chunks::<4>();
        let [degree, n_fraction_bits, flags, _] = words[3];
        let version = u32::from_le_bytes(words[1]);
        let header = Self {
            version,
            n: u32::from_le_bytes(words[2]) as usize,
            degree: usize::from(degree),
            n_fraction_bits,
            is_antialiased: flags & ANTIALIASED != 0,
        };
        let problem = if words[0] != MAGIC {
            "not of Gaussians: no NGSP".to_owned()
        } else if !versions.contains(&version) {
            format!("version {version} of .spz is not supported: 1 to 4 are, the last without gzip")
        } else if header.degree >= N_REST.len() {
            format!("harmonics of degree {degree}, not 0 to 4")
        } else {
            return Ok(header);
        };
        Err(DataError::unusable(path, problem))
    }

    /// Bytes of a Gaussian in each array: position, opacity, colour, scale, rotation, harmonics.
    fn sizes(&self) -> [usize; 6] {
        let position = if self.version == 1 { 6 } else { 9 };
        let rotation = if self.version < 3 { 3 } else { 4 };
        [position, 1, 3, 3, rotation, 3 * N_REST[self.degree]]
    }

    /// Length of all arrays.
    fn n_bytes(&self) -> u64 {
        self.sizes().iter().sum::<usize>() as u64 * self.n as u64
    }

    fn too_short(&self, path: &Path, n_found: usize) -> DataError {
        let Self { n, .. } = self;
        let n_bytes = self.n_bytes();
        let problem = format!("{n} Gaussians take {n_bytes} bytes, and {n_found} are there");
        DataError::unusable(path, problem)
    }

    /// The Gaussians of the arrays, one after the other.
    fn unpack(&self, path: &Path, arrays: &[u8]) -> Result<Splats, DataError> {
        let sizes = self.sizes();
        let mut rest = arrays;
        let arrays = sizes.map(|size| {
            let (array, after) = rest.split_at(size * self.n);
            rest = after;
            array
        });
        let degree = self.degree.min(MAX_DEGREE);
        let mut found = Collector::new(self.n, degree);
        let mut harmonics = vec![[0.0; 3]; (degree + 1).pow(2)];
        for i in 0..self.n {
            let of = |k: usize| &arrays[k][i * sizes[k]..][..sizes[k]];
            let bytes = |k: usize| Vec3::new(of(k)[0].into(), of(k)[1].into(), of(k)[2].into());
            let splat = Splat {
                center: self.position(of(0)) * TURNED,
                scale: (bytes(3) / 16.0 - 10.0).exp(),
                rotation: turned(self.rotation(of(4))),
                opacity: f32::from(of(1)[0]) / 255.0,
            };
            harmonics[0] = ((bytes(2) / 255.0 - 0.5) / COLOR_SCALE).to_array();
            let (coded, _) = of(5).as_chunks::<3>();
            let signs = &TURNED_HARMONICS[1..];
            for ((harmonic, coded), sign) in harmonics[1..].iter_mut().zip(coded).zip(signs) {
                *harmonic = coded.map(|byte| sign * (f32::from(byte) - 128.0) / 128.0);
            }
            found.push(splat, &harmonics);
        }
        found.finish(path, self.is_antialiased)
    }

    fn position(&self, bytes: &[u8]) -> Vec3 {
        if self.version == 1 {
            let (halves, _) = bytes.as_chunks::<2>();
            return Vec3::from_array([0, 1, 2].map(|k| f16::from_le_bytes(halves[k]).to_f32()));
        }
        let (words, _) = bytes.as_chunks::<3>();
        let unit = (-f32::from(self.n_fraction_bits)).exp2();
        // The shift down spreads the sign.
        let fixed = |[a, b, c]: [u8; 3]| i32::from_le_bytes([0, a, b, c]) >> 8;
        Vec3::from_array([0, 1, 2].map(|k| fixed(words[k]) as f32 * unit))
    }

    fn rotation(&self, bytes: &[u8]) -> Quat {
        if self.version < 3 {
            let vector = [0, 1, 2].map(|k| f32::from(bytes[k]) / 127.5 - 1.0);
            return Quat::from_array(smallest_three(3, vector));
        }
        let bits = bytes.iter().rev();
        let bits = bits.fold(0, |bits, byte| bits << 8 | u32::from(*byte));
        // Sign and nine bits each, the last one lowest.
        let others = [20, 10, 0].map(|shift| {
            let length = (bits >> shift & 511) as f32 / 511.0 * std::f32::consts::FRAC_1_SQRT_2;
            if bits >> shift & 512 == 0 {
                length
            } else {
                -length
            }
        });
        Quat::from_array(smallest_three((bits >> 30) as usize, others))
    }
}

/// A rotation in turned axes.
fn turned(rotation: Quat) -> Quat {
    let Vec3 { x, y, z } = rotation.xyz() * TURNED;
    Quat::from_xyzw(x, y, z, rotation.w)
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use flate2::Compression;
    use flate2::write::GzEncoder;
    use glam::Mat3;
    use ruzstd::encoding::{CompressionLevel, compress_to_vec};

    use super::super::test_files::{
        check_damaged, check_damaged_inside, color, directions, error_of, random_splats, read_bytes,
    };
    use super::*;

    /// As `packGaussians` does, without turning.
    fn arrays_of(splats: &Splats, version: u32) -> [Vec<u8>; 6] {
        let byte = |v: f32| v.round().clamp(0.0, 255.0) as u8;
        let mut arrays = [(); 6].map(|()| Vec::new());
        for splat in &splats.splats {
            for v in splat.center.to_array() {
                if version == 1 {
                    arrays[0].extend(f16::from_f32(v).to_le_bytes());
                } else {
                    arrays[0].extend(&((v * 4096.0).round() as i32).to_le_bytes()[..3]);
                }
            }
            arrays[1].push(byte(splat.opacity * 255.0));
            let scales = splat.scale.to_array();
            arrays[3].extend(scales.map(|s| byte((s.ln() + 10.0) * 16.0)));
            let all = splat.rotation.to_array();
            if version < 3 {
                let sign = 127.5 * all[3].signum();
                arrays[4].extend([0, 1, 2].map(|k| byte(all[k] * sign + 127.5)));
                continue;
            }
            let largest = (0..4).max_by(|a, b| all[*a].abs().total_cmp(&all[*b].abs()));
            let largest = largest.unwrap();
            let mut bits = largest as u32;
            for other in (0..4).filter(|k| *k != largest) {
                let v = all[other] * all[largest].signum() * 511.0 * 2.0_f32.sqrt();
                bits = bits << 10 | u32::from(v < 0.0) << 9 | v.abs().round() as u32;
            }
            arrays[4].extend(bits.to_le_bytes());
        }
        for harmonics in splats.harmonics.chunks((splats.degree + 1).pow(2)) {
            arrays[2].extend(harmonics[0].map(|h| byte((h * 0.15 + 0.5) * 255.0)));
            let rest = harmonics[1..].iter().flatten();
            arrays[5].extend(rest.map(|h| byte(h * 128.0 + 128.0)));
        }
        arrays
    }

    fn header_of(splats: &Splats, version: u32, flags: u8) -> Vec<u8> {
        let mut bytes = b"NGSP".to_vec();
        bytes.extend(version.to_le_bytes());
        bytes.extend((splats.splats.len() as u32).to_le_bytes());
        bytes.extend([splats.degree as u8, 12, flags]);
        bytes
    }

    fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    /// A file of a version before 4, unpacked.
    fn plain(splats: &Splats, version: u32, flags: u8) -> Vec<u8> {
        let mut bytes = header_of(splats, version, flags);
        bytes.push(0);
        bytes.extend(arrays_of(splats, version).concat());
        bytes
    }

    /// A file of version 4.
    fn version_4(splats: &Splats, flags: u8) -> Vec<u8> {
        let arrays = arrays_of(splats, 4);
        let arrays = arrays.iter().filter(|array| !array.is_empty());
        let pack = |array: &Vec<u8>| compress_to_vec(&array[..], CompressionLevel::Fastest);
        let streams: Vec<_> = arrays.map(|array| (array.len(), pack(array))).collect();
        let mut bytes = header_of(splats, 4, flags);
        bytes.push(streams.len() as u8);
        // An extension of eight bytes lies before the table.
        bytes.extend(40_u32.to_le_bytes());
        bytes.extend([0; 20]);
        for (n, stream) in &streams {
            bytes.extend((stream.len() as u64).to_le_bytes());
            bytes.extend((*n as u64).to_le_bytes());
        }
        bytes.extend(streams.into_iter().flat_map(|(_, stream)| stream));
        bytes
    }

    /// Compares with what was written, whose y and z point the other way.
    fn assert_close(found: &Splats, written: &Splats, version: u32) {
        assert_eq!(found.splats.len(), written.splats.len());
        assert_eq!(found.degree, written.degree);
        let turn = Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0));
        let (center, rotation) = match version {
            1 => (2e-3, 0.12),
            2 => (0.51 / 4096.0, 0.12),
            _ => (0.51 / 4096.0, 5e-3),
        };
        for (i, (a, b)) in found.splats.iter().zip(&written.splats).enumerate() {
            let expected = turn * b.center;
            assert!(a.center.abs_diff_eq(expected, center), "{i}: {}", a.center);
            let ratio = (a.scale / b.scale).map(f32::ln).abs().max_element();
            assert!(ratio < 0.51 / 16.0, "{i}: {ratio}");
            let expected = turn * Mat3::from_quat(b.rotation) * turn;
            let found_axes = Mat3::from_quat(a.rotation);
            assert!(
                found_axes.abs_diff_eq(expected, rotation),
                "{i}: {found_axes}"
            );
            assert!((a.opacity - b.opacity).abs() < 0.51 / 255.0, "{i}");
            for d in directions() {
                let (a, b) = (color(found, i, d), color(written, i, turn * d));
                assert!(a.abs_diff_eq(b, 0.04), "{i} along {d}: {a}, {b}");
            }
        }
    }

    #[test]
    fn gaussians_of_each_version_are_read_back_turned() {
        for degree in 0..=3 {
            let mut splats = random_splats(100, degree);
            // A small fourth component is lost in three bytes.
            splats.splats.retain(|s| s.rotation.w.abs() > 0.15);
            splats
                .harmonics
                .truncate(splats.splats.len() * (degree + 1).pow(2));
            for version in 1..=3 {
                let bytes = gzip(&plain(&splats, version, 0));
                assert_close(&read_bytes("a.spz", &bytes), &splats, version);
            }
            let found = read_bytes("a.spz", &version_4(&splats, 1));
            assert_close(&found, &splats, 4);
            assert!(found.is_antialiased, "flag");
        }
    }

    #[test]
    fn harmonics_of_a_fourth_degree_are_left_out() {
        let mut splats = random_splats(5, 4);
        let found = read_bytes("a.spz", &version_4(&splats, 0));
        assert!(!found.is_antialiased, "flag");
        splats.degree = 3;
        splats.harmonics = splats
            .harmonics
            .chunks(25)
            .flat_map(|h| h[..16].to_vec())
            .collect();
        assert_close(&found, &splats, 4);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let splats = random_splats(5, 1);
        let mut bytes = plain(&splats, 9, 0);
        assert!(
            error_of("a.spz", &gzip(&bytes)).contains("version 9"),
            "version"
        );
        bytes[4] = 3;
        assert!(
            error_of("a.spz", &gzip(&bytes[..160])).contains("5 Gaussians"),
            "short"
        );
        bytes[12] = 7;
        assert!(
            error_of("a.spz", &gzip(&bytes)).contains("degree 7"),
            "degree"
        );
        bytes[12] = 1;
        bytes[8..12].fill(255);
        assert!(
            error_of("a.spz", &gzip(&bytes)).contains("cannot hold"),
            "count"
        );
        let mut bytes = version_4(&splats, 0);
        bytes[8..12].fill(255);
        assert!(error_of("a.spz", &bytes).contains("cannot hold"), "count");
        let mut bytes = version_4(&splats, 0);
        bytes[48] += 1;
        assert!(error_of("a.spz", &bytes).contains("stream 0"), "length");
    }

    #[test]
    fn damaged_files_are_read_or_refused() {
        let splats = random_splats(30, 2);
        check_damaged("a.spz", &gzip(&plain(&splats, 3, 0)));
        check_damaged_inside("a.spz", &plain(&splats, 2, 0), gzip);
        check_damaged("b.spz", &version_4(&splats, 0));
    }
}
