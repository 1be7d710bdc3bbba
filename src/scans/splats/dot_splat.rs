//! The `.splat` of antimatter15 (github.com/antimatter15/splat, `convert.py`): 32 bytes a Gaussian and nothing else; centre and
//! scale as floats, then bytes of colour, opacity and rotation. Without harmonics.

use std::fs::File;
use std::io::{BufReader, Read as _};
use std::path::Path;

use glam::{Quat, Vec3};

use super::encoding::constant_of;
use super::{Collector, Splat, Splats, has_extension};
use crate::data::DataError;

/// Length of a record, bytes.
const RECORD: usize = 32;
/// Records that are looked at to tell such a file.
const N_LOOKED_AT: usize = 64;
/// Read at once, bytes.
const BUFFER: usize = 1 << 20;

/// Whether it looks like one, which has no mark to know it by: of that name, and most of its first records plausible.
pub(super) fn is_dot_splat(path: &Path) -> bool {
    if !has_extension(path, "splat") {
        return false;
    }
    let mut head = Vec::new();
    let read = File::open(path).and_then(|file| {
        let most = (RECORD * N_LOOKED_AT) as u64;
        file.take(most).read_to_end(&mut head)
    });
    let (records, _) = head.as_chunks();
    let n_plausible = records.iter().filter(|r| is_plausible(r)).count();
    read.is_ok() && n_plausible * 2 > records.len()
}

/// Reads all records.
pub(super) fn read(path: &Path) -> Result<Splats, DataError> {
    let io = |e| DataError::io(path, e);
    let file = File::open(path).map_err(io)?;
    let n_bytes = file.metadata().map_err(io)?.len() as usize;
    if !n_bytes.is_multiple_of(RECORD) {
        let problem = format!("{n_bytes} bytes are not a whole number of Gaussians of {RECORD}");
        return Err(DataError::unusable(path, problem));
    }
    let mut reader = BufReader::with_capacity(BUFFER, file);
    let mut found = Collector::new(n_bytes / RECORD, 0);
    let mut record = [0; RECORD];
    for _ in 0..n_bytes / RECORD {
        reader.read_exact(&mut record).map_err(io)?;
        let (splat, constant) = splat(&record);
        found.push(splat, &[constant]);
    }
    found.finish(path, false)
}

fn is_plausible(record: &[u8; RECORD]) -> bool {
    let (splat, _) = splat(record);
    let is_scale = |s: &f32| (0.0..1e6).contains(s);
    splat.center.abs().max_element() < 1e6 && splat.scale.to_array().iter().all(is_scale)
}

/// A Gaussian and its constant harmonic.
fn splat(record: &[u8; RECORD]) -> (Splat, [f32; 3]) {
    let (words, _) = record.as_chunks();
    let [x, y, z, a, b, c] = [0, 1, 2, 3, 4, 5].map(|i| f32::from_le_bytes(words[i]));
    let [red, green, blue, opacity] = words[6].map(|byte| f32::from(byte) / 255.0);
    let [qw, qx, qy, qz] = words[7].map(|byte| (f32::from(byte) - 128.0) / 128.0);
    let splat = Splat {
        center: Vec3::new(x, y, z),
        scale: Vec3::new(a, b, c),
        rotation: Quat::from_xyzw(qx, qy, qz, qw),
        opacity,
    };
    (splat, constant_of(Vec3::new(red, green, blue)))
}

#[cfg(test)]
mod tests {
    use super::super::test_files::{check_damaged, color, error_of, random_splats, read_bytes};
    use super::super::{is_splats, read};
    use super::*;

    /// As `convert.py` writes it.
    fn file_of(splats: &Splats) -> Vec<u8> {
        let mut bytes = Vec::new();
        for (splat, harmonic) in splats.splats.iter().zip(&splats.harmonics) {
            for v in splat
                .center
                .to_array()
                .iter()
                .chain(&splat.scale.to_array())
            {
                bytes.extend(v.to_le_bytes());
            }
            bytes.extend(harmonic.map(|h| ((0.5 + 0.282_094_8 * h) * 255.0) as u8));
            bytes.push((splat.opacity * 255.0) as u8);
            let [x, y, z, w] = splat.rotation.to_array();
            bytes.extend([w, x, y, z].map(|v| (v * 128.0 + 128.0).clamp(0.0, 255.0) as u8));
        }
        bytes
    }

    #[test]
    fn gaussians_are_read_back_to_their_quantisation() {
        let splats = random_splats(100, 0);
        let found = read_bytes("a.SPLAT", &file_of(&splats));
        assert_eq!((found.splats.len(), found.degree), (100, 0));
        for (i, (a, b)) in found.splats.iter().zip(&splats.splats).enumerate() {
            assert_eq!((a.center, a.scale), (b.center, b.scale));
            assert!((a.opacity - b.opacity).abs() < 1.01 / 255.0, "{i}");
            assert!(a.rotation.dot(b.rotation).abs() > 1.0 - 2e-4, "{i}");
            let (a, b) = (color(&found, i, Vec3::X), color(&splats, i, Vec3::X));
            assert!(a.abs_diff_eq(b, 1.01 / 255.0), "{i}: {a}, {b}");
        }
    }

    #[test]
    fn only_plausible_files_of_that_name_are_recognised() {
        let bytes = file_of(&random_splats(100, 0));
        let folder = tempfile::tempdir().unwrap();
        for (name, bytes) in [
            ("a.bin", &bytes[..]),
            (
                "text.splat",
                "no Gaussians in this text, which is long enough".as_bytes(),
            ),
            ("empty.splat", &[]),
        ] {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            assert!(!is_splats(&path), "{name}");
            assert!(
                read(&path).unwrap_err().to_string().contains(name),
                "{name}"
            );
        }
        assert!(
            error_of("a.splat", &bytes[..3199]).contains("3199 bytes"),
            "length"
        );
    }

    #[test]
    fn damaged_files_are_read_or_refused() {
        // Of no sixteenth is the length a multiple of 32.
        check_damaged("a.splat", &file_of(&random_splats(33, 0)));
    }
}
