//! Named arrays on disk in the safetensors format: checkpoints, trained objects, environments.
//!
//! Reading goes through the `safetensors` crate, which validates the header. The header is
//! written here, because the crate keeps the metadata in a hash map and so gives other bytes on
//! every run, while two runs with the same seed must leave identical files.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, Read as _, Write as _},
    path::{Path, PathBuf},
};

use half::{bf16, f16};
use safetensors::{Dtype, SafeTensorError, SafeTensors};
use serde::Deserialize;
use serde_json::json;

use crate::data::write_atomically;

/// Why a tensor file could not be read, written or used; every case names the file.
#[derive(Debug, thiserror::Error)]
pub enum TensorFileError {
    /// The operating system refused to read or write.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file is none (truncated, damaged or another format), or something that is needed is not in it.
    #[error("{path}: {problem}", path = path.display())]
    Unusable {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// An array has another shape or element type than the program needs.
    #[error("{path}: tensor `{tensor}` is {found}, expected {expected}", path = path.display())]
    Mismatch {
        /// The file.
        path: PathBuf,
        /// Name of the array.
        tensor: String,
        /// What the file holds, e.g. `F32 [4, 3]`.
        found: String,
        /// What was asked for, in the same form.
        expected: String,
    },
}

impl TensorFileError {
    fn io(path: &Path, source: io::Error) -> Self {
        Self::Io {
            path: path.to_owned(),
            source,
        }
    }

    fn unusable(path: &Path, problem: String) -> Self {
        Self::Unusable {
            path: path.to_owned(),
            problem,
        }
    }
}

/// The elements of one array, row-major.
#[derive(Clone, Debug, PartialEq)]
pub enum TensorValues {
    /// 32-bit floats.
    F32(Vec<f32>),
    /// 16-bit floats with eleven bits of precision, up to 65504.
    F16(Vec<f16>),
    /// 16-bit floats with eight bits of precision and the range of 32-bit ones.
    Bf16(Vec<bf16>),
    /// 16-bit words: codes or small indices, as the owner decides.
    U16(Vec<u16>),
    /// 64-bit words: counters and generator states.
    U64(Vec<u64>),
}

impl TensorValues {
    /// The element type as safetensors names it, bytes of one element, number of elements.
    fn layout(&self) -> (&'static str, usize, usize) {
        match self {
            Self::F32(values) => ("F32", 4, values.len()),
            Self::F16(values) => ("F16", 2, values.len()),
            Self::Bf16(values) => ("BF16", 2, values.len()),
            Self::U16(values) => ("U16", 2, values.len()),
            Self::U64(values) => ("U64", 8, values.len()),
        }
    }

    fn len(&self) -> usize {
        self.layout().2
    }

    /// The values as 16-bit floats of the higher precision; `None` when one is beyond their range.
    pub fn as_f16(values: &[f32]) -> Option<Self> {
        let halves: Vec<f16> = values.iter().map(|v| f16::from_f32(*v)).collect();
        let is_lost = |(half, v): (&f16, &f32)| half.is_infinite() && v.is_finite();
        (!halves.iter().zip(values).any(is_lost)).then_some(Self::F16(halves))
    }

    /// The values as 16-bit floats of the wider range.
    pub fn as_bf16(values: &[f32]) -> Self {
        // The last few finite numbers would be rounded to infinity.
        let largest = bf16::MAX.to_f32();
        let brain = |v: &f32| {
            bf16::from_f32(if v.is_finite() {
                v.clamp(-largest, largest)
            } else {
                *v
            })
        };
        Self::Bf16(values.iter().map(brain).collect())
    }

    /// Appends the elements in little-endian order.
    fn append_bytes(&self, bytes: &mut Vec<u8>) {
        fn append<T: Copy, const N: usize>(
            bytes: &mut Vec<u8>,
            values: &[T],
            encode: fn(T) -> [u8; N],
        ) {
            bytes.extend(values.iter().flat_map(|v| encode(*v)));
        }
        match self {
            Self::F32(values) => append(bytes, values, f32::to_le_bytes),
            Self::F16(values) => append(bytes, values, f16::to_le_bytes),
            Self::Bf16(values) => append(bytes, values, bf16::to_le_bytes),
            Self::U16(values) => append(bytes, values, u16::to_le_bytes),
            Self::U64(values) => append(bytes, values, u64::to_le_bytes),
        }
    }

    /// Reads little-endian elements; `None` for a type that is never written here.
    fn from_bytes(dtype: Dtype, bytes: &[u8]) -> Option<Self> {
        Some(match dtype {
            Dtype::F32 => Self::F32(elements(bytes, f32::from_le_bytes)),
            Dtype::F16 => Self::F16(elements(bytes, f16::from_le_bytes)),
            Dtype::BF16 => Self::Bf16(elements(bytes, bf16::from_le_bytes)),
            Dtype::U16 => Self::U16(elements(bytes, u16::from_le_bytes)),
            Dtype::U64 => Self::U64(elements(bytes, u64::from_le_bytes)),
            _ => return None,
        })
    }
}

/// Decodes fixed-size little-endian elements; the crate has checked that no byte is left over.
fn elements<T, const N: usize>(bytes: &[u8], decode: fn([u8; N]) -> T) -> Vec<T> {
    let (chunks, _rest) = bytes.as_chunks::<N>();
    chunks.iter().map(|chunk| decode(*chunk)).collect()
}

/// One array: `values.len()` is the product of `shape`.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Extents, outermost first.
    pub shape: Vec<usize>,
    /// The elements, row-major.
    pub values: TensorValues,
}

impl Tensor {
    /// `F32 [4, 3]`, for messages.
    fn describe(&self) -> String {
        format!("{} {:?}", self.values.layout().0, self.shape)
    }
}

/// Longest header that is read on its own, bytes.
const MOST_HEADER: u64 = 1 << 20;
/// What is wrong with a file that ends within its header.
const SHORT: &str = "it is too short";

/// The entries of a header that are no arrays.
#[derive(Deserialize)]
struct Header {
    #[serde(rename = "__metadata__", default)]
    metadata: BTreeMap<String, String>,
}

/// Arrays and text entries by name, as one file holds them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TensorFile {
    /// The arrays.
    pub tensors: BTreeMap<String, Tensor>,
    /// Free text entries: format version, configuration, box corners.
    pub metadata: BTreeMap<String, String>,
    /// Where it was read from; empty for one made in memory. Only messages use it.
    origin: PathBuf,
}

impl TensorFile {
    /// Reads and validates a whole file.
    ///
    /// # Errors
    /// When the file cannot be read, is no safetensors file, or holds an unknown element type.
    pub fn read(path: &Path) -> Result<Self, TensorFileError> {
        let bytes = std::fs::read(path).map_err(|e| TensorFileError::io(path, e))?;
        Self::from_bytes(&bytes, path)
    }

    /// Reads the text entries alone, from the beginning of a file: a few kilobytes of it, whatever its size. The arrays are
    /// not looked at.
    ///
    /// # Errors
    /// When the file cannot be read, or does not begin as a safetensors file.
    pub fn read_metadata(path: &Path) -> Result<Self, TensorFileError> {
        let io_error = |e| TensorFileError::io(path, e);
        let damaged = |what: &str| {
            TensorFileError::unusable(path, format!("not a valid safetensors file ({what})"))
        };
        let mut file = File::open(path).map_err(io_error)?;
        let mut length = [0; 8];
        file.read_exact(&mut length).map_err(|e| match e.kind() {
            io::ErrorKind::UnexpectedEof => damaged(SHORT),
            _ => io_error(e),
        })?;
        let length = u64::from_le_bytes(length);
        // Else a file that is none could ask for all memory.
        if length > MOST_HEADER {
            return Err(damaged("its header is too long"));
        }
        let mut header = Vec::new();
        let n_read = file.take(length).read_to_end(&mut header);
        if n_read.map_err(io_error)? as u64 != length {
            return Err(damaged(SHORT));
        }
        let header: Header =
            serde_json::from_slice(&header).map_err(|e| damaged(&e.to_string()))?;
        Ok(Self {
            tensors: BTreeMap::new(),
            metadata: header.metadata,
            origin: path.to_owned(),
        })
    }

    /// Decodes the bytes of a file; `path` is only used in messages.
    ///
    /// # Errors
    /// When the bytes are no safetensors file or hold an unknown element type.
    pub fn from_bytes(bytes: &[u8], path: &Path) -> Result<Self, TensorFileError> {
        let format_error = |e: SafeTensorError| {
            TensorFileError::unusable(path, format!("not a valid safetensors file ({e})"))
        };
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(format_error)?;
        let parsed = SafeTensors::deserialize(bytes).map_err(format_error)?;
        let mut tensors = BTreeMap::new();
        for (name, view) in parsed.tensors() {
            let values = TensorValues::from_bytes(view.dtype(), view.data()).ok_or_else(|| {
                let what = format!("the unsupported element type {:?}", view.dtype());
                TensorFileError::unusable(path, format!("tensor `{name}` has {what}"))
            })?;
            let shape = view.shape().to_vec();
            tensors.insert(name, Tensor { shape, values });
        }
        Ok(Self {
            tensors,
            metadata: header
                .metadata()
                .clone()
                .unwrap_or_default()
                .into_iter()
                .collect(),
            origin: path.to_owned(),
        })
    }

    /// The bytes of the file: equal contents give equal bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut header = serde_json::Map::new();
        if !self.metadata.is_empty() {
            header.insert("__metadata__".to_owned(), json!(self.metadata));
        }
        // Wide elements first, so that every array is aligned for readers that map the file.
        let mut ordered: Vec<_> = self.tensors.iter().collect();
        ordered.sort_by_key(|(_, tensor)| std::cmp::Reverse(tensor.values.layout().1));
        let mut end = 0;
        for (name, tensor) in &ordered {
            let (dtype, element_size, n) = tensor.values.layout();
            let start = end;
            end += n * element_size;
            header.insert(
                (*name).clone(),
                json!({
                    "dtype": dtype,
                    "shape": tensor.shape,
                    "data_offsets": [start, end],
                }),
            );
        }
        let mut text = serde_json::Value::Object(header).to_string();
        // The format wants the data to begin at a multiple of eight bytes.
        text.extend(std::iter::repeat_n(
            ' ',
            text.len().next_multiple_of(8) - text.len(),
        ));
        let mut bytes = Vec::with_capacity(8 + text.len() + end);
        bytes.extend_from_slice(&(text.len() as u64).to_le_bytes());
        bytes.extend_from_slice(text.as_bytes());
        for (_, tensor) in ordered {
            tensor.values.append_bytes(&mut bytes);
        }
        bytes
    }

    /// Writes the file whole or not at all: an existing file stays as it is on any failure.
    ///
    /// # Errors
    /// When the system refuses, e.g. because the disk is full.
    pub fn write(&self, path: &Path) -> Result<(), TensorFileError> {
        write_atomically(path, |file| file.write_all(&self.to_bytes()))
            .map_err(|e| TensorFileError::io(path, e))
    }

    /// Adds (or replaces) an array of floats.
    ///
    /// # Panics
    /// When the product of `shape` is not the number of values: a bug of the caller.
    pub fn insert_f32(&mut self, name: &str, shape: &[usize], values: Vec<f32>) {
        self.insert(name, shape, TensorValues::F32(values));
    }

    /// Adds (or replaces) an array of 16-bit words; panics as [`Self::insert_f32`] does.
    pub fn insert_u16(&mut self, name: &str, shape: &[usize], values: Vec<u16>) {
        self.insert(name, shape, TensorValues::U16(values));
    }

    /// Adds (or replaces) an array of 64-bit words; panics as [`Self::insert_f32`] does.
    pub fn insert_u64(&mut self, name: &str, shape: &[usize], values: Vec<u64>) {
        self.insert(name, shape, TensorValues::U64(values));
    }

    /// Adds (or replaces) an array of any type; panics as [`Self::insert_f32`] does.
    pub fn insert(&mut self, name: &str, shape: &[usize], values: TensorValues) {
        assert_eq!(
            shape.iter().product::<usize>(),
            values.len(),
            "tensor `{name}`: shape {shape:?} does not fit its values"
        );
        let shape = shape.to_vec();
        self.tensors
            .insert(name.to_owned(), Tensor { shape, values });
    }

    /// The floats of the array `name`, which must have exactly this shape.
    ///
    /// # Errors
    /// Naming file and tensor, when it is absent or of another shape or type.
    pub fn f32(&self, name: &str, shape: &[usize]) -> Result<&[f32], TensorFileError> {
        self.values(name, "F32", shape, |values| match values {
            TensorValues::F32(values) => Some(values),
            _ => None,
        })
    }

    /// All values of the array `name`, which must be one-dimensional and of floats of any size.
    ///
    /// # Errors
    /// Naming file and tensor, when it is absent or of another shape or type.
    pub fn floats(&self, name: &str) -> Result<Vec<f32>, TensorFileError> {
        let tensor = self.tensor(name)?;
        match &tensor.values {
            _ if tensor.shape.len() != 1 => {}
            TensorValues::F32(values) => return Ok(values.clone()),
            TensorValues::F16(values) => return Ok(values.iter().map(|v| v.to_f32()).collect()),
            TensorValues::Bf16(values) => return Ok(values.iter().map(|v| v.to_f32()).collect()),
            TensorValues::U16(_) | TensorValues::U64(_) => {}
        }
        Err(self.mismatch(name, "F32", &[tensor.values.len()], tensor))
    }

    /// The 16-bit words of the array `name`; errors as [`Self::f32`].
    pub fn u16(&self, name: &str, shape: &[usize]) -> Result<&[u16], TensorFileError> {
        self.values(name, "U16", shape, |values| match values {
            TensorValues::U16(values) => Some(values),
            _ => None,
        })
    }

    /// The 64-bit words of the array `name`; errors as [`Self::f32`].
    pub fn u64(&self, name: &str, shape: &[usize]) -> Result<&[u64], TensorFileError> {
        self.values(name, "U64", shape, |values| match values {
            TensorValues::U64(values) => Some(values),
            _ => None,
        })
    }

    fn values<'a, T>(
        &'a self,
        name: &str,
        dtype: &str,
        shape: &[usize],
        of_type: impl Fn(&'a TensorValues) -> Option<&'a Vec<T>>,
    ) -> Result<&'a [T], TensorFileError> {
        let tensor = self.tensor(name)?;
        let values = of_type(&tensor.values).filter(|_| tensor.shape == shape);
        let values = values.ok_or_else(|| self.mismatch(name, dtype, shape, tensor));
        values.map(Vec::as_slice)
    }

    /// The array `name` with whatever shape and type it has.
    ///
    /// # Errors
    /// Naming file and tensor, when it is absent.
    pub fn tensor(&self, name: &str) -> Result<&Tensor, TensorFileError> {
        let missing = || format!("tensor `{name}` is missing");
        let tensor = self.tensors.get(name);
        tensor.ok_or_else(|| TensorFileError::unusable(&self.origin, missing()))
    }

    /// The text entry `key`.
    ///
    /// # Errors
    /// Naming file and entry, when it is absent.
    pub fn text(&self, key: &str) -> Result<&str, TensorFileError> {
        let missing = || format!("metadata entry `{key}` is missing");
        let text = self.metadata.get(key).map(String::as_str);
        text.ok_or_else(|| TensorFileError::unusable(&self.origin, missing()))
    }

    /// Where it was read from; empty for one made in memory.
    pub fn origin(&self) -> &Path {
        &self.origin
    }

    fn mismatch(
        &self,
        name: &str,
        dtype: &str,
        shape: &[usize],
        found: &Tensor,
    ) -> TensorFileError {
        TensorFileError::Mismatch {
            path: self.origin.clone(),
            tensor: name.to_owned(),
            found: found.describe(),
            expected: format!("{dtype} {shape:?}"),
        }
    }
}

#[cfg(test)]
mod tests;
