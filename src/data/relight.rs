//! Ground truth for edits: `relight/<edit>/edit.json`, which says exactly what was changed and
//! lists photos of the result.

use std::path::Path;

use glam::Vec3;
use rayon::prelude::*;
use serde::Deserialize;

use super::files::capture_path::{list_folder, read_json};
use super::photos::photo_budget::Reduction;
use super::photos::views::{load_views, of_split};
use super::{CaptureChoices, DataError, Dataset, Problem, Split, View, read_frames};

/// The largest `edit.json` read.
const MAX_BYTES: u64 = 128 << 20;

/// A rigid move of the environment in world axes about the world's origin, rotation first.
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
    /// How the environment was moved.
    pub environment_transform: Option<EnvironmentMove>,
    /// The perceptual roughness that replaced the object's everywhere.
    pub roughness: Option<f32>,
    /// The factor on the specular lobe.
    pub specular_scale: Option<f32>,
    /// The capture (a sibling folder's name) whose environment replaced this one's.
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
        let edits = list_folder(&folder, |path| path.join("edit.json").is_file())?;
        edits.iter().map(|path| read_case(path)).collect()
    }
}

fn read_case(folder: &Path) -> Result<RelightCase, DataError> {
    let json = folder.join("edit.json");
    let edit: EditFile = read_json(&json, MAX_BYTES)?;
    check_apply(&json, &edit.apply)?;
    let frames = read_frames(&json)?;
    let max_megapixels = CaptureChoices::default().max_megapixels;
    let reduction = Reduction::to_fit(frames.par_iter(), max_megapixels);
    let loaded = load_views(&frames, reduction, &|| ());
    Ok(RelightCase {
        name: folder
            .file_name()
            .map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
        description: edit.edit,
        apply: edit.apply,
        views: of_split(Split::Test, loaded.views),
        problems: loaded.findings.into_problems(),
    })
}

fn check_apply(json: &Path, apply: &RelightApply) -> Result<(), DataError> {
    let fail =
        |field: &str, problem: String| DataError::field(json, format!("apply.{field}"), problem);
    if let Some(r) = apply.roughness.filter(|r| !(0.0..=1.0).contains(r)) {
        return Err(fail("roughness", format!("{r} is not within 0..1")));
    }
    if let Some(s) = apply
        .specular_scale
        .filter(|s| !(0.0..=f32::MAX).contains(s))
    {
        return Err(fail("specular_scale", format!("{s} is not a factor")));
    }
    let transform = apply.environment_transform.unwrap_or_default();
    if !(transform.rotate_deg_xyz.is_finite() && transform.translate.is_finite()) {
        return Err(fail("environment_transform", "not finite".to_owned()));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::test_asserts::assert_error;
    use super::super::test_capture::TestCapture;
    use super::*;

    fn write_edit(capture: &TestCapture, apply: &serde_json::Value) {
        let folder = capture.path("relight/an_edit");
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::copy(capture.path("test/r_0.png"), folder.join("r_0.png")).unwrap();
        let text = std::fs::read_to_string(capture.path("transforms_test.json")).unwrap();
        let mut json: serde_json::Value = serde_json::from_str(&text).unwrap();
        let frames = json["frames"].as_array_mut().unwrap();
        frames.truncate(1);
        frames[0]["file_path"] = "r_0.png".into();
        frames[0]["mask_path"] = "../../test_mask/r_0.png".into();
        json["edit"] = "in words".into();
        json["apply"] = apply.clone();
        std::fs::write(folder.join("edit.json"), json.to_string()).unwrap();
    }

    #[test]
    fn an_edit_is_read_with_its_views_and_masks() {
        let capture = TestCapture::new(3);
        let apply = serde_json::json!({
            "environment_transform": {"rotate_deg_xyz": [0, 0, 90], "translate": [0.3, 0, 0]},
            "roughness": 0.4, "glow": 7,
        });
        write_edit(&capture, &apply);
        let cases = Dataset::relight_cases(capture.root()).unwrap();
        let [case] = &cases[..] else {
            panic!("one case, not {}", cases.len());
        };
        assert_eq!((&*case.name, &*case.description), ("an_edit", "in words"));
        let moved = case.apply.environment_transform.unwrap();
        assert_eq!(moved.rotate_deg_xyz, Vec3::new(0.0, 0.0, 90.0), "rotation");
        assert_eq!(moved.translate, Vec3::new(0.3, 0.0, 0.0), "translation");
        assert_eq!(case.apply.roughness, Some(0.4), "roughness");
        assert!(case.apply.unknown.contains_key("glow"), "unknown is kept");
        assert!(case.views[0].mask.is_some(), "mask by ../..");
        assert!(case.problems.is_empty(), "{:?}", case.problems);
    }

    #[test]
    fn values_out_of_range_are_errors_that_name_the_field() {
        let capture = TestCapture::new(3);
        write_edit(&capture, &serde_json::json!({"roughness": 1.5}));
        let cases = Dataset::relight_cases(capture.root());
        assert_error(cases, &["apply.roughness"]);
    }

    #[test]
    fn a_capture_without_edits_has_none() {
        let capture = TestCapture::new(3);
        let cases = Dataset::relight_cases(capture.root()).unwrap();
        assert!(cases.is_empty(), "{cases:?}");
    }
}
