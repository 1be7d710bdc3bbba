//! `NumPy` arrays: `.npy` files and those inside an `.npz` archive. Numbers only, read as `f64`.
//!
//! The format is that of `numpy/lib/format.py`: magic, version, a header written as a Python
//! dictionary, then the values. Counts are checked against the bytes at hand before allocation.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read as _};
use std::path::Path;

use zip::ZipArchive;

use super::capture_path::read_bytes;
use crate::data::DataError;

/// The largest file read whole: 10,000 poses take 1.4 MB.
const MAX_BYTES: u64 = 64 << 20;
/// The most arrays read from an archive: 10,000 views have six at most.
const MAX_ARRAYS: usize = 100_000;

/// An array of numbers in C order.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::data) struct Array {
    pub(in crate::data) shape: Vec<usize>,
    pub(in crate::data) values: Vec<f64>,
}

/// How a value is stored.
#[derive(Clone, Copy, Debug)]
pub(in crate::data) struct Kind {
    letter: u8,
    n_bytes: usize,
    big_endian: bool,
}

/// Reads an `.npy` file; errors name it and the field of its header.
pub(in crate::data) fn read_npy(path: &Path) -> Result<Array, DataError> {
    let bytes = read_bytes(path, MAX_BYTES)?;
    parse(&bytes).map_err(|(field, problem)| DataError::field(path, field, problem))
}

/// Reads the arrays of an `.npz` archive whose names `is_wanted`, by name without `.npy`.
pub(in crate::data) fn read_npz(
    path: &Path,
    is_wanted: impl Fn(&str) -> bool,
) -> Result<BTreeMap<String, Array>, DataError> {
    let broken = |e: &dyn std::fmt::Display| DataError::field(path, "archive", e.to_string());
    let file = File::open(path).map_err(|e| DataError::io(path, e))?;
    let mut archive = ZipArchive::new(BufReader::new(file)).map_err(|e| broken(&e))?;
    if archive.len() > MAX_ARRAYS {
        return Err(broken(&format!("more than {MAX_ARRAYS} arrays")));
    }
    let mut arrays = BTreeMap::new();
    let mut n_left = MAX_BYTES;
    for i in 0..archive.len() {
        let entry = archive.by_index(i).map_err(|e| broken(&e))?;
        let name = entry.name().map_err(|e| broken(&e))?;
        let name = name.trim_end_matches(".npy").to_owned();
        if !is_wanted(&name) {
            continue;
        }
        let mut bytes = Vec::new();
        // The size in the archive's directory is a claim; only what is unpacked counts.
        entry
            .take(n_left + 1)
            .read_to_end(&mut bytes)
            .map_err(|e| DataError::field(path, &name, e.to_string()))?;
        n_left = n_left
            .checked_sub(bytes.len() as u64)
            .ok_or_else(|| broken(&format!("unpacks to more than {} MiB", MAX_BYTES >> 20)))?;
        let array = parse(&bytes).map_err(|(field, problem)| {
            DataError::field(path, format!("{name}, {field}"), problem)
        })?;
        arrays.insert(name, array);
    }
    Ok(arrays)
}

/// The array in an `.npy` file's bytes, or the faulty field and what is wrong with it.
fn parse(bytes: &[u8]) -> Result<Array, (&'static str, String)> {
    let (header, values) = split_header(bytes)?;
    let entry = |key: &'static str| {
        let at = header.find(&format!("'{key}'"));
        let rest = at.map(|at| &header[at + key.len() + 2..]);
        rest.and_then(|rest| rest.trim_start().strip_prefix(':'))
            .map(str::trim_start)
            .ok_or_else(|| (key, "missing".to_owned()))
    };
    let kind = parse_kind(entry("descr")?)?;
    let fortran_order = entry("fortran_order")?.starts_with("True");
    let shape = parse_shape(entry("shape")?)?;
    let array = kind.array(&shape, fortran_order, values);
    array.map_err(|problem| ("shape", problem))
}

/// The header's text and the bytes of the values.
fn split_header(bytes: &[u8]) -> Result<(&str, &[u8]), (&'static str, String)> {
    let cut = || ("header", "the file ends in it".to_owned());
    let rest = bytes
        .strip_prefix(b"\x93NUMPY")
        .ok_or_else(|| ("magic", "not a NumPy file".to_owned()))?;
    let (version, rest) = rest.split_at_checked(2).ok_or_else(cut)?;
    let n_length = if version[0] == 1 { 2 } else { 4 };
    let (length, rest) = rest.split_at_checked(n_length).ok_or_else(cut)?;
    let length = length
        .iter()
        .rev()
        .fold(0_usize, |n, byte| n << 8 | usize::from(*byte));
    let (header, values) = rest.split_at_checked(length).ok_or_else(cut)?;
    let header =
        std::str::from_utf8(header).map_err(|_not_utf8| ("header", "not a text".to_owned()))?;
    Ok((header, values))
}

/// `'<f8'` and the like.
fn parse_kind(text: &str) -> Result<Kind, (&'static str, String)> {
    let quoted = text.split('\'').nth(1).unwrap_or_default();
    Kind::of(quoted).map_err(|problem| ("descr", problem))
}

/// `(3, 4)` and the like.
fn parse_shape(text: &str) -> Result<Vec<usize>, (&'static str, String)> {
    let list = text.strip_prefix('(').and_then(|rest| rest.split_once(')'));
    let (sides, _) = list.ok_or_else(|| ("shape", "not a list".to_owned()))?;
    let sides = sides.split(',').map(str::trim);
    let length = |side: &str| {
        let length = side.trim_end_matches('L').parse();
        length.map_err(|_unparsed| ("shape", format!("\"{side}\" is not a length")))
    };
    sides.filter(|side| !side.is_empty()).map(length).collect()
}

impl Kind {
    /// `<f8`, `f8` and the like, or what is wrong with it.
    pub(in crate::data) fn of(text: &str) -> Result<Self, String> {
        let fail = || format!("'{text}' is not an array of plain numbers");
        let (order, rest) = match text.as_bytes() {
            [order, rest @ ..] if b"<>|=".contains(order) => (*order, rest),
            rest => (b'=', rest),
        };
        let [letter, size @ ..] = rest else {
            return Err(fail());
        };
        let n_bytes = match (letter, size) {
            (b'i' | b'u', b"1") => 1,
            (b'i' | b'u', b"2") => 2,
            (b'f' | b'i' | b'u', b"4") => 4,
            (b'f' | b'i' | b'u', b"8") => 8,
            _ => return Err(fail()),
        };
        Ok(Self {
            letter: *letter,
            n_bytes,
            big_endian: order == b'>',
        })
    }

    /// The same with another order of bytes: `>` or any other.
    pub(super) fn in_order(self, order: &[u8]) -> Self {
        Self {
            big_endian: order == b">",
            ..self
        }
    }

    /// The array of that shape in `bytes`, or what is wrong with it.
    pub(in crate::data) fn array(
        self,
        shape: &[usize],
        is_fortran: bool,
        bytes: &[u8],
    ) -> Result<Array, String> {
        let n_values = shape
            .iter()
            .try_fold(1_usize, |n, side| n.checked_mul(*side))
            .filter(|n| *n <= bytes.len() / self.n_bytes)
            .ok_or_else(|| format!("{shape:?} is more than the {} bytes there", bytes.len()))?;
        let values = bytes.chunks_exact(self.n_bytes).take(n_values);
        let values: Vec<f64> = values.map(|bytes| self.value(bytes)).collect();
        Ok(Array {
            shape: shape.to_vec(),
            values: if is_fortran {
                in_c_order(shape, &values)
            } else {
                values
            },
        })
    }

    fn value(self, bytes: &[u8]) -> f64 {
        let mut little = [0; 8];
        little[..self.n_bytes].copy_from_slice(bytes);
        if self.big_endian {
            little[..self.n_bytes].reverse();
        }
        let raw = u64::from_le_bytes(little);
        let n_unused = 64 - 8 * self.n_bytes as u32;
        match self.letter {
            b'f' if self.n_bytes == 8 => f64::from_bits(raw),
            b'f' => f64::from(f32::from_bits(raw as u32)),
            b'i' => ((raw << n_unused) as i64 >> n_unused) as f64,
            _ => raw as f64,
        }
    }
}

/// Values stored with the first index running fastest, turned so that the last one does.
fn in_c_order(shape: &[usize], values: &[f64]) -> Vec<f64> {
    (0..values.len())
        .map(|mut i| {
            // Digits of the C index from the last axis on, weighed as Fortran does.
            let mut digits = vec![0; shape.len()];
            for (digit, side) in digits.iter_mut().zip(shape).rev() {
                *digit = i % side;
                i /= side;
            }
            let from = digits
                .iter()
                .zip(shape)
                .rev()
                .fold(0, |from, (digit, side)| from * side + digit);
            values[from]
        })
        .collect()
}

#[cfg(test)]
pub(in crate::data) mod tests {
    use std::io::{Cursor, Write as _};

    use zip::write::SimpleFileOptions;

    use super::*;
    use crate::data::test_asserts::assert_error;

    /// A `.npy` file of `f64`.
    pub(in crate::data) fn npy_of(shape: &[usize], values: &[f64]) -> Vec<u8> {
        let sides: Vec<String> = shape.iter().map(|side| format!("{side},")).collect();
        let header = format!(
            "{{'descr': '<f8', 'fortran_order': False, 'shape': ({}), }}\n",
            sides.join(" ")
        );
        let values: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        npy_with_header(&header, &values)
    }

    fn npy_with_header(header: &str, values: &[u8]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(values);
        bytes
    }

    /// An `.npz` archive.
    pub(in crate::data) fn npz_of(arrays: &[(String, Vec<u8>)]) -> Vec<u8> {
        let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
        for (name, bytes) in arrays {
            let options = SimpleFileOptions::default();
            archive.start_file(format!("{name}.npy"), options).unwrap();
            archive.write_all(bytes).unwrap();
        }
        archive.finish().unwrap().into_inner()
    }

    #[test]
    fn every_kind_of_number_is_read() {
        let header = |descr: &str| {
            format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (2,), }}")
        };
        for (descr, bytes) in [
            ("<f8", [3.0_f64, -2.0].map(f64::to_le_bytes).concat()),
            (">f4", [3.0_f32, -2.0].map(f32::to_be_bytes).concat()),
            ("<i8", [3_i64, -2].map(i64::to_le_bytes).concat()),
            (">i2", [3_i16, -2].map(i16::to_be_bytes).concat()),
            ("|i1", vec![3, 254]),
        ] {
            let array = parse(&npy_with_header(&header(descr), &bytes)).unwrap();
            assert_eq!(array.values, [3.0, -2.0], "{descr}");
        }
    }

    #[test]
    fn columns_first_become_rows_first() {
        let header = "{'descr': '<f8', 'fortran_order': True, 'shape': (2, 3), }";
        let values: Vec<u8> = [1.0_f64, 4.0, 2.0, 5.0, 3.0, 6.0]
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        let array = parse(&npy_with_header(header, &values)).unwrap();
        assert_eq!(array.values, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "rows first");
    }

    #[test]
    fn faults_name_the_field() {
        let bytes = |header: &str| npy_with_header(header, &[0; 16]);
        for (descr, shape, field) in [
            ("", "(2,)", "descr"),
            ("'descr': '|O', ", "(2,)", "descr"),
            ("'descr': [('a', '<f8')], ", "(2,)", "descr"),
            ("'descr': '<f8', ", "(3,)", "shape"),
            ("'descr': '<f8', ", "(-1,)", "shape"),
            ("'descr': '<f8', ", "(9999999999, 9999999999, 9)", "shape"),
        ] {
            let header = format!("{{{descr}'fortran_order': False, 'shape': {shape}}}");
            let (found, problem) = parse(&bytes(&header)).unwrap_err();
            assert_eq!(found, field, "{header}: {problem}");
        }
    }

    #[test]
    fn a_file_cut_anywhere_is_an_error() {
        let whole = npy_of(&[2, 2], &[1.0, 2.0, 3.0, 4.0]);
        for n in 0..whole.len() {
            assert!(parse(&whole[..n]).is_err(), "the first {n} bytes");
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        let whole = npz_of(&[("a".to_owned(), whole.clone()), ("b".to_owned(), whole)]);
        std::fs::write(&path, &whole).unwrap();
        let arrays = read_npz(&path, |name| name == "b").unwrap();
        assert!(arrays.keys().eq(["b"]), "only what is wanted");
        for n in 0..whole.len() {
            std::fs::write(&path, &whole[..n]).unwrap();
            assert_error(read_npz(&path, |_| true), &["a.npz"]);
        }
    }

    #[test]
    fn an_archive_that_unpacks_to_too_much_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bomb.npz");
        let zeros = vec![0; MAX_BYTES as usize + 1];
        std::fs::write(&path, npz_of(&[("a".to_owned(), zeros)])).unwrap();
        assert_error(read_npz(&path, |_| true), &["more than 64 MiB"]);
    }
}
