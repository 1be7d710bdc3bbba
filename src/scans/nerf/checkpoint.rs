//! Checkpoints of `torch.save`: tensors by name, in either of its two layouts (`torch/serialization.py`).
//!
//! Since torch 1.6 a checkpoint is an uncompressed zip archive with the pickle in `…/data.pkl` and a file `…/data/KEY` for
//! each storage. Before, it was five pickles in a row (a magic number, the protocol, facts about the machine, the object,
//! the keys of the storages in order) and then each storage, its count of numbers before it. Only the numbers of the
//! tensors asked for are read.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use half::{bf16, f16};
use zip::ZipArchive;

use super::torch_pickle::{self, NumberKind, Storage, Tensor};
use crate::data::DataError;

/// Bytes of the largest file read.
pub(super) const MAX_BYTES: u64 = 2 << 30;
/// Bytes of the pickles: they hold names and shapes.
const MAX_PICKLE_BYTES: u64 = 32 << 20;
/// The pickled magic number at the start of an older checkpoint.
const LEGACY_MAGIC: [u8; 15] = [
    0x80, 2, 0x8a, 10, 0x6c, 0xfc, 0x9c, 0x46, 0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19, b'.',
];

/// A checkpoint, its numbers still in the file.
#[derive(Debug)]
pub(super) struct Checkpoint {
    path: PathBuf,
    tensors: BTreeMap<String, Tensor>,
    place: StorageLayout,
}

/// Where storages lie.
#[derive(Debug)]
enum StorageLayout {
    /// In files of an archive, named by this and their key.
    Zip(String),
    /// At these offsets in the file, by key.
    Legacy(BTreeMap<String, u64>),
}

/// Whether a file that starts so is a checkpoint of torch.
pub(super) fn is_checkpoint(head: &[u8]) -> bool {
    if head.starts_with(&LEGACY_MAGIC) {
        return true;
    }
    // The first file of the archive: its name follows 30 bytes, two of which hold the name's length.
    let (Some(length), true) = (head.get(26..28), head.starts_with(b"PK\x03\x04")) else {
        return false;
    };
    let end = 30 + usize::from(u16::from_le_bytes([length[0], length[1]]));
    head.get(30..end)
        .is_some_and(|name| name.ends_with(b"/data.pkl"))
}

impl Checkpoint {
    /// Reads what tensors a checkpoint holds.
    pub(super) fn read(path: &Path) -> Result<Self, DataError> {
        let io = |e| DataError::io(path, e);
        let broken = |problem: String| DataError::unusable(path, format!("the pickle: {problem}"));
        let mut file = BufReader::new(File::open(path).map_err(io)?);
        let n_bytes = file.get_ref().metadata().map_err(io)?.len();
        if n_bytes > MAX_BYTES {
            let problem = format!("larger than {} GiB", MAX_BYTES >> 30);
            return Err(DataError::unusable(path, problem));
        }
        let mut head = Vec::new();
        let length = LEGACY_MAGIC.len() as u64;
        (&mut file)
            .take(length)
            .read_to_end(&mut head)
            .map_err(io)?;
        file.seek(SeekFrom::Start(0)).map_err(io)?;
        let (tensors, place) = if head == LEGACY_MAGIC {
            read_legacy(&mut file, n_bytes).map_err(broken)?
        } else {
            read_zip(file).map_err(broken)?
        };
        Ok(Self {
            path: path.to_owned(),
            tensors,
            place,
        })
    }

    /// The file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// The tensors' names, in order.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.tensors.keys().map(String::as_str)
    }

    /// A tensor's sides.
    pub(super) fn shape(&self, name: &str) -> Option<&[usize]> {
        self.tensors.get(name).map(|tensor| &tensor.shape[..])
    }

    /// A tensor's numbers, the last index running fastest.
    pub(super) fn floats(&self, name: &str) -> Result<Vec<f32>, DataError> {
        let fail = |problem: &str| DataError::unusable(&self.path, format!("{name}: {problem}"));
        let tensor = self.tensors.get(name).ok_or_else(|| fail("missing"))?;
        let n = n_numbers(tensor).ok_or_else(|| fail("its shape exceeds its storage"))?;
        if matches!(tensor.storage.kind, NumberKind::Other(_)) {
            return Err(fail("stored as numbers that are no floats"));
        }
        let bytes = self
            .storage_bytes(&tensor.storage)
            .map_err(|problem| fail(&problem))?;
        let kind = tensor.storage.kind;
        let size = kind.n_bytes();
        let mut floats = Vec::with_capacity(n);
        let mut index = vec![0; tensor.shape.len()];
        for _ in 0..n {
            let steps = index.iter().zip(&tensor.strides);
            let at = tensor.offset + steps.map(|(i, stride)| i * stride).sum::<usize>();
            let number = bytes.get(at * size..(at + 1) * size);
            floats.push(float(
                kind,
                number.ok_or_else(|| fail("the file ends early"))?,
            ));
            for (i, side) in index.iter_mut().zip(&tensor.shape).rev() {
                *i += 1;
                if *i < *side {
                    break;
                }
                *i = 0;
            }
        }
        Ok(floats)
    }

    fn storage_bytes(&self, storage: &Storage) -> Result<Vec<u8>, String> {
        let n_bytes = (storage.n as u64)
            .checked_mul(storage.kind.n_bytes() as u64)
            .filter(|n| *n <= MAX_BYTES)
            .ok_or("its storage is too large")?;
        let mut file = BufReader::new(File::open(&self.path).map_err(|e| e.to_string())?);
        let mut bytes = Vec::new();
        match &self.place {
            StorageLayout::Zip(folder) => {
                let mut archive = ZipArchive::new(file).map_err(|e| e.to_string())?;
                let name = format!("{folder}{}", storage.key);
                let entry = archive.by_name(&name);
                let entry = entry.map_err(|e| format!("{name}: {e}"))?;
                let read = entry.take(n_bytes).read_to_end(&mut bytes);
                read.map_err(|e| format!("{name}: {e}"))?;
            }
            StorageLayout::Legacy(offsets) => {
                let offset = offsets.get(&storage.key).ok_or("its storage is missing")?;
                let moved = file.seek(SeekFrom::Start(*offset));
                moved.map_err(|e| e.to_string())?;
                let read = file.take(n_bytes).read_to_end(&mut bytes);
                read.map_err(|e| e.to_string())?;
            }
        }
        if (bytes.len() as u64) < n_bytes {
            return Err("the file ends early".to_owned());
        }
        Ok(bytes)
    }
}

/// How many numbers a tensor has; `None` where they are not all in its storage, or more than it.
fn n_numbers(tensor: &Tensor) -> Option<usize> {
    let sides = tensor.shape.iter();
    let n = sides
        .clone()
        .try_fold(1_usize, |n, side| n.checked_mul(*side))?;
    if tensor.strides.len() != tensor.shape.len() || n > tensor.storage.n {
        return None;
    }
    let last = sides
        .zip(&tensor.strides)
        .try_fold(tensor.offset, |last, (side, stride)| {
            last.checked_add(side.saturating_sub(1).checked_mul(*stride)?)
        })?;
    (n == 0 || last < tensor.storage.n).then_some(n)
}

fn float(kind: NumberKind, bytes: &[u8]) -> f32 {
    let mut little = [0; 8];
    little[..bytes.len()].copy_from_slice(bytes);
    let bits = u64::from_le_bytes(little);
    match kind {
        NumberKind::F16 => f16::from_bits(bits as u16).to_f32(),
        NumberKind::Bf16 => bf16::from_bits(bits as u16).to_f32(),
        NumberKind::F32 => f32::from_bits(bits as u32),
        NumberKind::F64 => f64::from_bits(bits) as f32,
        NumberKind::I64 | NumberKind::Other(_) => bits as i64 as f32,
    }
}

type Contents = (BTreeMap<String, Tensor>, StorageLayout);

fn read_zip(file: BufReader<File>) -> Result<Contents, String> {
    let mut archive = ZipArchive::new(file).map_err(|e| e.to_string())?;
    let names = archive.file_names().filter_map(Result::ok);
    let name = names.into_iter().find(|name| name.ends_with("/data.pkl"));
    let name = name.ok_or("the archive has none")?.into_owned();
    let mut bytes = Vec::new();
    let entry = archive.by_name(&name).map_err(|e| e.to_string())?;
    let read = entry.take(MAX_PICKLE_BYTES).read_to_end(&mut bytes);
    read.map_err(|e| e.to_string())?;
    let named = torch_pickle::tensors(&bytes)?;
    let folder = name.trim_end_matches(".pkl");
    Ok((named.tensors, StorageLayout::Zip(format!("{folder}/"))))
}

fn read_legacy(file: &mut BufReader<File>, n_file_bytes: u64) -> Result<Contents, String> {
    let mut bytes = Vec::new();
    let read = file.take(MAX_PICKLE_BYTES).read_to_end(&mut bytes);
    read.map_err(|e| e.to_string())?;
    let mut at = LEGACY_MAGIC.len();
    // The protocol and facts about the machine.
    for _ in 0..2 {
        at += torch_pickle::length(&bytes[at..])?;
    }
    let named = torch_pickle::tensors(&bytes[at..])?;
    at += named.n_bytes;
    let (keys, n_bytes) = torch_pickle::texts(&bytes[at..])?;
    let mut at = (at + n_bytes) as u64;
    let mut offsets = BTreeMap::new();
    for key in keys {
        let mut count = [0; 8];
        file.seek(SeekFrom::Start(at)).map_err(|e| e.to_string())?;
        file.read_exact(&mut count).map_err(|e| e.to_string())?;
        let size = named.sizes.get(&key).ok_or("a storage is of no tensor")?;
        at += 8;
        let n = u64::from_le_bytes(count).checked_mul(*size as u64);
        offsets.insert(key, at);
        at = n
            .and_then(|n| at.checked_add(n))
            .filter(|at| *at <= n_file_bytes)
            .ok_or("the file ends early")?;
    }
    Ok((named.tensors, StorageLayout::Legacy(offsets)))
}
