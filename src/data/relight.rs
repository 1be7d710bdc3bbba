//! Ground truth for edits: `relight/<edit>/edit.json`, which says exactly what was changed and
//! lists photos of the result.

use std::path::Path;

use glam::Vec3;
use serde::Deserialize;

use super::load::load_views;
use super::{DataError, Dataset, Problem, View, read_frames};

/// A rigid move of the surroundings in world axes about the world's origin, rotation first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct EnvironmentMove {
    /// Rotation in degrees about x, then y, then z.
    pub rotate_deg_xyz: Vec3,
    /// Translation in scene units, after the rotation.
    pub translate: Vec3,
}

/// The values of an edit; absent fields are unchanged.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct RelightApply {
    /// How the surroundings were moved.
    pub environment_transform: Option<EnvironmentMove>,
    /// The perceptual roughness that replaced the object's everywhere.
    pub roughness: Option<f32>,
    /// The factor on the specular lobe.
    pub specular_scale: Option<f32>,
    /// The capture (a sibling folder's name) whose surroundings replaced this one's.
    pub environment_of: Option<String>,
    /// Anything else that the file asks for and this program does not know.
    #[serde(flatten)]
    pub unknown: serde_json::Map<String, serde_json::Value>,
}

/// One edit with photos of its result.
#[derive(Clone, Debug)]
pub struct RelightCase {
    /// The folder's name, such as `env_rot90`.
    pub name: String,
    /// The edit in words.
    pub description: String,
    /// The edit in numbers.
    pub apply: RelightApply,
    /// Photos of the edited scene.
    pub views: Vec<View>,
    /// What was wrong with them.
    pub problems: Vec<Problem>,
}

/// The part of `edit.json` beside the frames.
#[derive(Deserialize)]
struct EditFile {
    #[serde(default)]
    edit: String,
    apply: RelightApply,
}

impl Dataset {
    /// The edits in `root/relight`, sorted by name; empty when there is no such folder.
    ///
    /// Folders without an `edit.json` are passed over; a broken `edit.json` is an error.
    pub fn relight_cases(root: &Path) -> Result<Vec<RelightCase>, DataError> {
        let folder = root.join("relight");
        if !folder.is_dir() {
            return Ok(Vec::new());
        }
        let mut edits = Vec::new();
        for entry in folder.read_dir().map_err(|e| DataError::io(&folder, e))? {
            let path = entry.map_err(|e| DataError::io(&folder, e))?.path();
            if path.join("edit.json").is_file() {
                edits.push(path);
            }
        }
        edits.sort();
        edits.iter().map(|path| read_case(path)).collect()
    }
}

fn read_case(folder: &Path) -> Result<RelightCase, DataError> {
    let json = folder.join("edit.json");
    let text = std::fs::read_to_string(&json).map_err(|e| DataError::io(&json, e))?;
    let edit: EditFile = serde_json::from_str(&text).map_err(|source| DataError::Json {
        path: json.clone(),
        source,
    })?;
    check_apply(&json, &edit.apply)?;
    let frames = read_frames(&json)?;
    let loaded = load_views(&frames, &|| ());
    Ok(RelightCase {
        name: folder
            .file_name()
            .map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
        description: edit.edit,
        apply: edit.apply,
        views: loaded.views.into_iter().flatten().collect(),
        problems: loaded.findings.into_problems(),
    })
}

fn check_apply(json: &Path, apply: &RelightApply) -> Result<(), DataError> {
    let fail = |field: &str, problem: String| DataError::Field {
        path: json.to_owned(),
        frame: None,
        field: format!("apply.{field}"),
        problem,
    };
    match apply.roughness {
        Some(r) if !(0.0..=1.0).contains(&r) => {
            return Err(fail("roughness", format!("{r} is not within 0..1")));
        }
        _ => (),
    }
    match apply.specular_scale {
        Some(s) if !(s >= 0.0 && s.is_finite()) => {
            return Err(fail("specular_scale", format!("{s} is not a factor")));
        }
        _ => (),
    }
    match apply.environment_transform {
        Some(m) if !(m.rotate_deg_xyz.is_finite() && m.translate.is_finite()) => {
            Err(fail("environment_transform", "not finite".to_owned()))
        }
        _ => Ok(()),
    }
}
