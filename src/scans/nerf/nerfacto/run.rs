//! What lies in the folder of a nerfstudio run beside its checkpoints: the transform of the scene and the settings.

use std::path::{Path, PathBuf};

use glam::Vec3;
use serde::Deserialize;

use crate::data::DataError;

/// Bytes of a settings file.
const MAX_SETTINGS_BYTES: u64 = 4 << 20;

/// A file of the run that the checkpoint `run/nerfstudio_models/step-….ckpt` is of; or one beside the checkpoint.
fn run_file(checkpoint: &Path, name: &str) -> Option<PathBuf> {
    let folder = checkpoint.parent()?;
    let folders = [folder.parent(), Some(folder)];
    let mut files = folders
        .into_iter()
        .flatten()
        .map(|folder| folder.join(name));
    files.find(|file| {
        let size = std::fs::metadata(file).map(|data| data.len());
        size.is_ok_and(|size| size <= MAX_SETTINGS_BYTES)
    })
}

/// `dataparser_transforms.json`.
#[derive(Debug, Deserialize)]
pub(super) struct Transform {
    pub(super) transform: [[f32; 4]; 3],
    pub(super) scale: f32,
}

impl Transform {
    /// From the folder of a checkpoint's run.
    pub(super) fn near(checkpoint: &Path) -> Result<Self, DataError> {
        let Some(path) = run_file(checkpoint, "dataparser_transforms.json") else {
            return Ok(Self {
                transform: [
                    [1.0, 0.0, 0.0, 0.0],
                    [0.0, 1.0, 0.0, 0.0],
                    [0.0, 0.0, 1.0, 0.0],
                ],
                scale: 1.0,
            });
        };
        let text = std::fs::read(&path).map_err(|e| DataError::io(&path, e))?;
        let found: Self = serde_json::from_slice(&text)
            .map_err(|e| DataError::unusable(&path, format!("no transform: {e}")))?;
        let rows = found.transform.map(|[x, y, z, _]| Vec3::new(x, y, z));
        let near = |x: f32, y: f32| (x - y).abs() < 1e-3;
        let is_turn = (0..3).all(|i| {
            near(rows[i].length_squared(), 1.0) && near(rows[i].dot(rows[(i + 1) % 3]), 0.0)
        });
        if !is_turn {
            let problem = "transform: not a turn";
            return Err(DataError::unusable(&path, problem));
        }
        if !(found.scale > 0.0 && found.scale.is_finite()) {
            return Err(DataError::unusable(&path, "scale: not positive"));
        }
        Ok(found)
    }
}

/// The model's settings in `config.yml`: lines `key: value`.
#[derive(Debug, Default)]
pub(super) struct Settings(Vec<(String, String)>);

impl Settings {
    /// From the folder of a checkpoint's run.
    pub(super) fn near(checkpoint: &Path) -> Self {
        let path = run_file(checkpoint, "config.yml");
        let text = path.and_then(|path| std::fs::read_to_string(path).ok());
        Self::of(&text.unwrap_or_default())
    }

    /// The lines below the model's, as far in as the first of them: lists within have names of their own.
    fn of(text: &str) -> Self {
        let indent = |line: &str| line.len() - line.trim_start().len();
        let mut lines = text.lines();
        let model = lines.find(|line| line.contains("NerfactoModelConfig"));
        let mut lines = lines.peekable();
        let (Some(model), Some(first)) = (model, lines.peek()) else {
            return Self::default();
        };
        let (outer, inner) = (indent(model), indent(first));
        let below = lines.take_while(|line| indent(line) > outer);
        let same = below.filter(|line| indent(line) == inner);
        let pairs = same.filter_map(|line| line.trim().split_once(": "));
        Self(
            pairs
                .map(|(key, value)| (key.to_owned(), value.trim().to_owned()))
                .collect(),
        )
    }

    /// Whether there were any.
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The value with that key, where it is one of that kind.
    pub(super) fn get<T: std::str::FromStr>(&self, key: &str) -> Option<T> {
        let (_, value) = self.0.iter().find(|(k, _)| k == key)?;
        value.parse().ok()
    }
}
