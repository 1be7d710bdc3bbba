//! How learned values are stored: as trained, or grid values in 16 bits.
//!
//! A grid holds nearly all of a field's values and needs few digits of each; the networks behind it are small and stay
//! in single precision. What is read back is single precision again.

use std::path::Path;

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

/// Names of a field's two arrays; the second is there only where grid values are stored apart.
#[derive(Clone, Copy, Debug)]
pub(super) struct ParamNames {
    /// Networks, and the grid where it is not apart.
    pub(super) params: &'static str,
    /// Grid values.
    pub(super) grid: &'static str,
}

impl Storage {
    /// Adds a field's parameters to a file; the networks' are the first `n_networks`.
    pub(super) fn insert(
        self,
        file: &mut TensorFile,
        names: ParamNames,
        params: &[f32],
        n_networks: usize,
    ) {
        let n_single = if self == Self::F32 {
            params.len()
        } else {
            n_networks
        };
        let (single, grid) = params.split_at(n_single);
        file.insert_f32(names.params, &[single.len()], single.to_vec());
        if !grid.is_empty() {
            let values = match self {
                Self::F16 => {
                    TensorValues::as_f16(grid).unwrap_or_else(|| TensorValues::as_bf16(grid))
                }
                Self::F32 | Self::Bf16 => TensorValues::as_bf16(grid),
            };
            file.insert(names.grid, &[grid.len()], values);
        }
    }
}

/// All of a field's parameters, however they are stored; refused when one is not finite.
pub(super) fn read_params(
    file: &TensorFile,
    path: &Path,
    names: ParamNames,
) -> Result<Vec<f32>, NeifError> {
    let mut params = read_finite(file, path, names.params)?;
    if file.tensors.contains_key(names.grid) {
        params.extend(read_finite(file, path, names.grid)?);
    }
    Ok(params)
}

fn read_finite(
    file: &TensorFile,
    path: &Path,
    tensor: &'static str,
) -> Result<Vec<f32>, NeifError> {
    let values = file.floats(tensor)?;
    if values.iter().any(|v| !v.is_finite()) {
        return Err(NeifError::NotFinite {
            file: path.to_owned(),
            tensor,
        });
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAMES: ParamNames = ParamNames {
        params: "field.params",
        grid: "field.grid",
    };

    fn stored(storage: Storage, params: &[f32]) -> (TensorFile, Vec<f32>) {
        let mut file = TensorFile::default();
        storage.insert(&mut file, NAMES, params, 2);
        let path = Path::new("a.safetensors");
        let file = TensorFile::from_bytes(&file.to_bytes(), path).unwrap();
        let back = read_params(&file, path, NAMES).unwrap();
        (file, back)
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
            file.tensors[NAMES.grid].values,
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
                file.tensors[NAMES.grid].values,
                TensorValues::Bf16(_)
            ));
        }
    }

    #[test]
    fn a_broken_value_is_refused_in_any_precision() {
        for storage in [Storage::F32, Storage::F16, Storage::Bf16] {
            let mut file = TensorFile::default();
            storage.insert(&mut file, NAMES, &[0.0, 0.0, f32::NAN], 2);
            let error = read_params(&file, Path::new("a"), NAMES).unwrap_err();
            assert!(matches!(error, NeifError::NotFinite { .. }), "{error}");
        }
    }
}
