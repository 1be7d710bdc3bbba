//! How learned values are stored: as trained, or grid values in 16 bits.
//!
//! A grid holds nearly all of a field's values and needs few digits of each; the networks behind it are small and stay
//! in single precision. What is read back is single precision again.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::NeifError;
use crate::data::files::tensor_file::{TensorFile, TensorValues};

/// Precision of the grid values in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Storage {
    /// 32 bits: bit for bit what was trained.
    #[default]
    F32,
    /// 16 bits with eleven of precision. Grids that exceed its range of ±65504 are stored as [`Self::Bf16`] instead.
    F16,
    /// 16 bits with eight of precision and the range of single precision.
    Bf16,
}

impl Storage {
    /// Adds a field's parameters to a file; the networks' are the first `n_networks`.
    fn insert(
        self,
        file: &mut TensorFile,
        format: &FieldFormat,
        params: &[f32],
        n_networks: usize,
    ) {
        let n_single = if self == Self::F32 {
            params.len()
        } else {
            n_networks
        };
        let (single, grid) = params.split_at(n_single);
        file.insert_f32(format.params, &[single.len()], single.to_vec());
        if !grid.is_empty() {
            let values = match self {
                Self::F16 => {
                    TensorValues::as_f16(grid).unwrap_or_else(|| TensorValues::as_bf16(grid))
                }
                Self::F32 | Self::Bf16 => TensorValues::as_bf16(grid),
            };
            file.insert(format.grid, &[grid.len()], values);
        }
    }
}

/// Metadata entry that names the kind of field; a file without it holds a grid.
pub(super) const KIND: &str = "kind";
/// The kinds.
pub(super) const GRID: &str = "grid";
pub(super) const PAPER: &str = "paper";
pub(super) const DISTANT: &str = "distant";

/// How files of one format hold a field.
#[derive(Debug)]
pub(super) struct FieldFormat {
    /// Marks the metadata of a file.
    pub(super) name: &'static str,
    /// Metadata entry with everything but the parameters; what the file is, too.
    pub(super) header: &'static str,
    /// What is wrong with a header whose numbers are out of range.
    pub(super) out_of_range: &'static str,
    /// Array of the networks' parameters, and the grid's where they are not apart.
    pub(super) params: &'static str,
    /// Array of grid values, where they are stored apart.
    pub(super) grid: &'static str,
}

/// A field's file that was read.
pub(super) struct StoredField {
    /// Its arrays and metadata.
    pub(super) file: TensorFile,
    format: &'static FieldFormat,
}

impl FieldFormat {
    /// Reads a file of the format.
    pub(super) fn read(&'static self, path: &Path) -> Result<StoredField, NeifError> {
        self.checked(TensorFile::read(path)?)
    }

    /// Reads the beginning of a file of the format, without its arrays: enough for [`StoredField::kind`].
    pub(super) fn read_metadata(&'static self, path: &Path) -> Result<StoredField, NeifError> {
        self.checked(TensorFile::read_metadata(path)?)
    }

    fn checked(&'static self, file: TensorFile) -> Result<StoredField, NeifError> {
        let stored = StoredField { file, format: self };
        if stored.file.text("format")? == self.name {
            return Ok(stored);
        }
        let what = format!("is not `{}`: no {} file", self.name, self.header);
        Err(stored.metadata("format", what))
    }

    /// Adds a field of a kind to `file` and writes that whole or not at all; the networks' parameters are the first `n_networks`.
    pub(super) fn write(
        &self,
        mut file: TensorFile,
        path: &Path,
        (kind, header): (&str, String),
        (storage, params, n_networks): (Storage, &[f32], usize),
    ) -> Result<(), NeifError> {
        storage.insert(&mut file, self, params, n_networks);
        for (key, value) in [("format", self.name), (KIND, kind), (self.header, &header)] {
            file.metadata.insert(key.to_owned(), value.to_owned());
        }
        Ok(file.write(path)?)
    }
}

impl StoredField {
    /// Which kind of field the file holds.
    pub(super) fn kind(&self) -> &str {
        self.file.metadata.get(KIND).map_or(GRID, String::as_str)
    }

    /// The error of a kind that is none.
    pub(super) fn unknown_kind(&self) -> NeifError {
        let what = format!("is `{}`, which this version does not know", self.kind());
        self.metadata(KIND, what)
    }

    /// The header, refused where it `is_sane` not.
    pub(super) fn header<H: DeserializeOwned>(
        &self,
        is_sane: impl FnOnce(&H) -> bool,
    ) -> Result<H, NeifError> {
        let field = self.format.header;
        let header = serde_json::from_str(self.file.text(field)?)
            .map_err(|e| self.metadata(field, e.to_string()))?;
        if is_sane(&header) {
            Ok(header)
        } else {
            Err(self.out_of_range())
        }
    }

    /// The error of numbers out of range.
    pub(super) fn out_of_range(&self) -> NeifError {
        self.metadata(self.format.header, self.format.out_of_range.to_owned())
    }

    /// What `make` makes of all parameters, however they are stored; refused when one is not finite or their number does not
    /// fit.
    pub(super) fn made<F>(&self, make: impl FnOnce(Vec<f32>) -> Option<F>) -> Result<F, NeifError> {
        let mut params = self.finite(self.format.params)?;
        if self.file.tensors.contains_key(self.format.grid) {
            params.extend(self.finite(self.format.grid)?);
        }
        let found = params.len();
        make(params).ok_or_else(|| NeifError::Shape {
            file: self.file.origin().to_owned(),
            tensor: self.format.params,
            found,
        })
    }

    fn finite(&self, tensor: &'static str) -> Result<Vec<f32>, NeifError> {
        let values = self.file.floats(tensor)?;
        if values.iter().any(|v| !v.is_finite()) {
            return Err(NeifError::NotFinite {
                file: self.file.origin().to_owned(),
                tensor,
            });
        }
        Ok(values)
    }

    fn metadata(&self, field: &'static str, what: String) -> NeifError {
        NeifError::Metadata {
            file: self.file.origin().to_owned(),
            field,
            what,
        }
    }
}

/// A header as text.
pub(super) fn header_text(header: &impl Serialize) -> String {
    serde_json::to_string(header).expect("plain numbers and strings serialise")
}

#[cfg(test)]
mod tests {
    use super::*;

    static FORMAT: FieldFormat = FieldFormat {
        name: "a format",
        header: "field",
        out_of_range: "is out of range",
        params: "field.params",
        grid: "field.grid",
    };

    fn file(storage: Storage, params: &[f32]) -> StoredField {
        let mut file = TensorFile::default();
        storage.insert(&mut file, &FORMAT, params, 2);
        let path = Path::new("a.safetensors");
        StoredField {
            file: TensorFile::from_bytes(&file.to_bytes(), path).unwrap(),
            format: &FORMAT,
        }
    }

    fn stored(storage: Storage, params: &[f32]) -> (TensorFile, Vec<f32>) {
        let stored = file(storage, params);
        let back = stored.made(Some).unwrap();
        (stored.file, back)
    }

    #[test]
    fn single_precision_comes_back_bit_for_bit_in_one_array() {
        let params = [0.1, -3e30, 1e-40, 0.7, -0.0];
        let (file, back) = stored(Storage::F32, &params);
        assert_eq!((file.tensors.len(), back.as_slice()), (1, &params[..]));
    }

    #[test]
    fn half_precision_rounds_the_grid_and_not_the_networks() {
        let params = [0.1, -3e30, 0.1, -65504.0, 1e-7];
        let (file, back) = stored(Storage::F16, &params);
        assert_eq!(back[..2], params[..2], "networks");
        assert!((back[2] / 0.1 - 1.0).abs() < 1.0 / 2048.0, "{}", back[2]);
        assert_eq!(back[3], -65504.0, "the largest half");
        assert!((back[4] - 1e-7).abs() < 3e-8, "a subnormal half");
        assert!(matches!(
            file.tensors[FORMAT.grid].values,
            TensorValues::F16(_)
        ));
    }

    #[test]
    fn values_beyond_half_precision_keep_their_range() {
        for storage in [Storage::F16, Storage::Bf16] {
            let params = [0.1, 0.2, 65520.0, f32::MAX, -1e30];
            let (file, back) = stored(storage, &params);
            for (a, b) in back.iter().zip(params) {
                assert!((a / b - 1.0).abs() < 1.0 / 128.0, "{a}, not {b}");
            }
            assert!(matches!(
                file.tensors[FORMAT.grid].values,
                TensorValues::Bf16(_)
            ));
        }
    }

    #[test]
    fn a_broken_value_is_refused_in_any_precision() {
        for storage in [Storage::F32, Storage::F16, Storage::Bf16] {
            let stored = file(storage, &[0.0, 0.0, f32::NAN]);
            let error = stored.made(Some).unwrap_err();
            assert!(matches!(error, NeifError::NotFinite { .. }), "{error}");
        }
    }
}
