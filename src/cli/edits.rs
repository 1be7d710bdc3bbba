//! Flags that change the material or move the environment.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use glam::Vec3;
use neif::neif::surface::region::ObjectEdit;
use neif::neif::{EnvironmentTransform, MaterialEdit, Regions, RoughnessEdit};

use super::failure::Failure;
use super::values;

/// Moves the environment: scale, then rotation, then translation, in world axes about the origin.
#[derive(Debug, clap::Args)]
#[expect(clippy::struct_field_names, reason = "the flags are named so")]
pub(crate) struct EnvironmentFlags {
    /// Rotate the environment about the world's x, then y, then z axis, in degrees
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    env_rotate: Option<Vec3>,
    /// Move the environment, in scene units
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    env_translate: Option<Vec3>,
    /// Scale the environment
    #[arg(long, value_name = "S", value_parser = values::positive)]
    env_scale: Option<f32>,
    /// Brighten the environment, in photographic stops
    #[arg(long, value_name = "EV", value_parser = values::finite, allow_hyphen_values = true)]
    env_exposure: Option<f32>,
}

impl EnvironmentFlags {
    /// What the flags say.
    pub(crate) fn transform(&self) -> EnvironmentTransform {
        let identity = EnvironmentTransform::default();
        EnvironmentTransform {
            rotate_deg: self.env_rotate.unwrap_or(identity.rotate_deg),
            translate: self.env_translate.unwrap_or(identity.translate),
            scale: self.env_scale.unwrap_or(identity.scale),
            exposure_ev: self.env_exposure.unwrap_or(identity.exposure_ev),
            ..identity
        }
    }
}

/// Changes the material of the whole object, or as a file says.
#[derive(Debug, clap::Args)]
pub(crate) struct MaterialFlags {
    /// Read the edits from a JSON file: those of the whole object and of regions of it
    #[arg(long, value_name = "FILE.json", conflicts_with_all = ["roughness", "roughness_scale",
          "roughness_offset", "tint", "tint_scale", "diffuse_gain"])]
    edit: Option<PathBuf>,
    /// Roughness everywhere, 0 (mirror) to 1
    #[arg(long, value_name = "V", value_parser = values::unit_interval,
          conflicts_with_all = ["roughness_scale", "roughness_offset"])]
    roughness: Option<f32>,
    /// Multiply the roughness
    #[arg(long, value_name = "V", value_parser = values::not_negative)]
    roughness_scale: Option<f32>,
    /// Add to the roughness, after scaling
    #[arg(long, value_name = "V", value_parser = values::finite, allow_hyphen_values = true)]
    roughness_offset: Option<f32>,
    /// Colour the reflections: multiplies the specular tint
    #[arg(long, value_name = "R,G,B", value_parser = values::colour)]
    tint: Option<Vec3>,
    /// Strengthen or weaken the reflections
    #[arg(long, value_name = "V", value_parser = values::not_negative)]
    tint_scale: Option<f32>,
    /// Multiply the diffuse colour, by one number or one for each channel
    #[arg(long, value_name = "V|R,G,B", value_parser = values::gain)]
    diffuse_gain: Option<Vec3>,
}

impl MaterialFlags {
    /// What the flags or the file say.
    pub(crate) fn edit(&self) -> Result<ObjectEdit, Failure> {
        match &self.edit {
            Some(file) => read(file).map_err(Failure::unusable),
            None => Ok(ObjectEdit {
                whole: self.whole(),
                regions: Regions::default(),
            }),
        }
    }

    fn whole(&self) -> MaterialEdit {
        let identity = MaterialEdit::default();
        MaterialEdit {
            roughness: match self.roughness {
                Some(roughness) => RoughnessEdit::Constant(roughness),
                None => RoughnessEdit::Map {
                    scale: self.roughness_scale.unwrap_or(1.0),
                    offset: self.roughness_offset.unwrap_or(0.0),
                },
            },
            tint_scale: self.tint_scale.unwrap_or(identity.tint_scale),
            tint_color: self.tint.unwrap_or(identity.tint_color),
            diffuse_gain: self.diffuse_gain.unwrap_or(identity.diffuse_gain),
        }
    }
}

fn read(file: &Path) -> anyhow::Result<ObjectEdit> {
    let text = std::fs::read_to_string(file).with_context(|| file.display().to_string())?;
    let edit: ObjectEdit =
        serde_json::from_str(&text).with_context(|| file.display().to_string())?;
    anyhow::ensure!(
        edit.whole.is_finite(),
        "{}: `whole` holds a number that is not finite",
        file.display()
    );
    Ok(edit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edit_file_is_read_and_a_bad_one_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("edit.json");
        let text = r#"{"whole": {"tint_scale": 0.5}, "regions": [
            {"seed": [0, 0, 1], "extent": "part", "edit": {"roughness": {"constant": 0.4}}},
            {"seed": [0, 1, 0], "extent": {"material": {"threshold": 0.2}}}]}"#;
        std::fs::write(&file, text).unwrap();
        let edit = read(&file).unwrap();
        assert_eq!((edit.whole.tint_scale, edit.regions.len()), (0.5, 2));
        std::fs::write(&file, text.replace("0.2", "7")).unwrap();
        let error = format!("{:#}", read(&file).unwrap_err());
        assert!(
            error.contains("edit.json") && error.contains("region 2"),
            "{error}"
        );
    }
}
