//! Session files (`*.neif-session`): what was open and how it looked, as readable TOML.
//!
//! A session names files and holds none of them: the trained model lies in its run folder. Paths are
//! absolute; what is not where it was is looked for beside the session file.

use std::path::{Path, PathBuf};

use glam::{Affine3A, Vec3};
use serde::{Deserialize, Serialize};

use super::preferences::Panels;
use crate::app::state::look::StoredLook;
use crate::app::viewport::camera_control::Viewpoint;
use crate::data::KeyView;
use crate::geometry::{Camera, Distortion};
use crate::neif::{EnvironmentTransform, MaterialEdit, Regions};
use crate::render::{Background, Layer, ToneMap};

/// The files' extension.
pub const EXTENSION: &str = "neif-session";
/// Version of the layout.
pub(in crate::app) const VERSION: u32 = 1;
/// Largest width or height of a camera's picture, in pixels.
const MAX_SIDE: u32 = 1 << 16;

/// What was open.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SourceKind {
    /// The bundled capture.
    Demo,
    /// A capture.
    Capture,
    /// A saved run.
    Run,
    /// An environment alone.
    Environment,
}

/// What was open, and where.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedSource {
    /// What it is.
    pub kind: SourceKind,
    /// Where it is.
    pub path: PathBuf,
    /// The folder that its training was saved in, if it was.
    pub run: Option<PathBuf>,
}

/// Where the camera was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedCamera {
    /// The photo's camera that it stood at, as `train / name`.
    pub view: Option<String>,
    /// Width and height of its picture, in pixels.
    pub size: [u32; 2],
    /// Horizontal and vertical focal length, in pixels.
    pub focal: [f32; 2],
    /// Principal point, in pixels from the top left.
    pub center: [f32; 2],
    /// Right, up and backward axis, then the position, in world units.
    pub pose: [[f32; 3]; 4],
    /// The point that it turns about.
    pub pivot: Vec3,
}

/// A view of a camera path.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedKey {
    /// When it is reached, seconds.
    pub time_secs: f64,
    /// Where the camera is then.
    pub camera: SavedCamera,
}

/// All of a session.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SessionFile {
    /// Of the layout.
    pub version: u32,
    /// The part of the picture that was shown.
    pub layer: Layer,
    /// Training time for the next run, in seconds.
    pub budget_secs: f64,
    /// The wipe's place, 0 to 1, while it was on.
    pub wipe: Option<f32>,
    /// The chosen environment; none is the capture's own.
    pub environment: Option<PathBuf>,
    /// What stood behind the object.
    #[serde(default)]
    pub background: Background,
    /// Exposure of the picture, stops.
    #[serde(default)]
    pub display_ev: f32,
    /// How light brighter than white was shown.
    #[serde(default)]
    pub tone_map: ToneMap,
    /// Files taken off the list of environments.
    #[serde(default)]
    pub removed: Vec<PathBuf>,
    /// Parts of the object that are edited on their own.
    #[serde(default)]
    pub regions: Regions,
    /// What was open.
    pub source: Option<SavedSource>,
    /// The material's edits.
    #[serde(default)]
    pub material: MaterialEdit,
    /// Where the environment stood.
    #[serde(default)]
    pub transform: EnvironmentTransform,
    /// The camera.
    pub camera: Option<SavedCamera>,
    /// The look that was kept as B.
    pub kept: Option<StoredLook>,
    /// The views of the camera path.
    #[serde(default)]
    pub keys: Vec<SavedKey>,
    /// The side panels.
    #[serde(default)]
    pub panels: Panels,
}

impl SavedCamera {
    pub(in crate::app) fn of_viewpoint(&Viewpoint { camera, pivot }: &Viewpoint) -> Self {
        let axes = camera.world_from_camera.matrix3;
        let position = camera.world_from_camera.translation;
        Self {
            view: None,
            size: [camera.width, camera.height],
            focal: [camera.fx, camera.fy],
            center: [camera.cx, camera.cy],
            pose: [axes.x_axis, axes.y_axis, axes.z_axis, position].map(|v| v.to_array()),
            pivot,
        }
    }

    /// The same as the window's camera, with a plain lens.
    pub fn viewpoint(&self) -> Viewpoint {
        let [x, y, z, position] = self.pose.map(Vec3::from);
        let camera = Camera {
            width: self.size[0],
            height: self.size[1],
            fx: self.focal[0],
            fy: self.focal[1],
            cx: self.center[0],
            cy: self.center[1],
            distortion: Distortion::default(),
            world_from_camera: Affine3A::from_cols(x.into(), y.into(), z.into(), position.into()),
        };
        Viewpoint {
            camera,
            pivot: self.pivot,
        }
    }

    fn problem(&self) -> Option<&'static str> {
        let [x, y, z, _] = self.pose.map(Vec3::from);
        let is_rotation = (x.cross(y).dot(z) - 1.0).abs() < 0.01
            && [x, y, z]
                .iter()
                .all(|axis| (axis.length() - 1.0).abs() < 0.01);
        if self.size.iter().any(|side| !(1..=MAX_SIDE).contains(side)) {
            Some("`camera.size` must be from 1 to 65536")
        } else if self.focal.iter().any(|&focal| focal <= 0.0) {
            Some("`camera.focal` must be above zero")
        } else {
            (!is_rotation).then_some("`camera.pose` is no rotation")
        }
    }
}

impl SavedKey {
    pub(in crate::app) fn of(key: &KeyView) -> Self {
        let viewpoint = Viewpoint {
            camera: key.camera,
            pivot: key.camera.position(),
        };
        Self {
            time_secs: key.time_secs,
            camera: SavedCamera::of_viewpoint(&viewpoint),
        }
    }

    /// The same as the path takes it.
    pub fn key_view(&self) -> KeyView {
        KeyView {
            camera: self.camera.viewpoint().camera,
            time_secs: self.time_secs,
        }
    }
}

impl SessionFile {
    /// As the file holds it.
    pub fn to_text(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// What is wrong, and in which field.
    pub fn parse(text: &str) -> Result<Self, String> {
        let table: toml::Table = text
            .parse()
            .map_err(|error: toml::de::Error| format!("no session: {}", error.message()))?;
        match table.get("version").and_then(toml::Value::as_integer) {
            Some(version) if version == i64::from(VERSION) => {}
            Some(version) => {
                return Err(format!(
                    "a session of version {version}; this program reads version {VERSION}"
                ));
            }
            None => return Err("no session: field `version` is missing".to_owned()),
        }
        let session: Self = toml::from_str(text).map_err(|error| describe(&error, text))?;
        session.check()?;
        Ok(session)
    }

    fn check(&self) -> Result<(), String> {
        // Written again, so that numbers too large for 32 bits are found as well.
        let table = toml::Table::try_from(self).map_err(|error| error.to_string())?;
        if let Some(field) = not_finite(&toml::Value::Table(table), "") {
            return Err(format!("`{field}` must be a finite number"));
        }
        if self.transform.scale <= 0.0 {
            return Err("`transform.scale` must be above zero".to_owned());
        }
        let keys = self.keys.iter().map(|key| &key.camera);
        match self
            .camera
            .iter()
            .chain(keys)
            .find_map(SavedCamera::problem)
        {
            Some(problem) => Err(problem.to_owned()),
            None => Ok(()),
        }
    }

    /// Reads a file; paths that are not where they were are taken from its folder where they are there.
    ///
    /// # Errors
    /// What is wrong, with the file's name.
    pub fn read(path: &Path) -> Result<Self, String> {
        let failed = |reason: String| format!("{}: {reason}", path.display());
        let text = std::fs::read_to_string(path).map_err(|error| failed(error.to_string()))?;
        let mut session = Self::parse(&text).map_err(failed)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let source = session.source.iter_mut();
        let source =
            source.flat_map(|source| std::iter::once(&mut source.path).chain(&mut source.run));
        let kept = session.kept.iter_mut();
        let kept = kept.flat_map(|kept| &mut kept.environment);
        let environments = session.environment.iter_mut().chain(kept);
        for path in source.chain(environments).chain(&mut session.removed) {
            let beside = path.file_name().map(|name| folder.join(name));
            if let Some(beside) = beside.filter(|beside| !path.exists() && beside.exists()) {
                *path = beside;
            }
        }
        Ok(session)
    }
}

/// The error with the line that it is in.
fn describe(error: &toml::de::Error, text: &str) -> String {
    let line = error.span().map(|span| {
        let before = text.get(..span.start).unwrap_or_default();
        before.matches('\n').count() + 1
    });
    match line {
        Some(line) => format!("line {line}: {}", error.message()),
        None => error.message().to_owned(),
    }
}

/// The first field that is not a finite number, by its path.
fn not_finite(value: &toml::Value, path: &str) -> Option<String> {
    match value {
        toml::Value::Float(number) => (!number.is_finite()).then(|| path.to_owned()),
        toml::Value::Array(items) => items.iter().find_map(|item| not_finite(item, path)),
        toml::Value::Table(fields) => fields.iter().find_map(|(name, field)| {
            let dot = if path.is_empty() { "" } else { "." };
            not_finite(field, &format!("{path}{dot}{name}"))
        }),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::app::state::app_state::AppState;
    use crate::app::state::source::Source;
    use crate::neif::RoughnessEdit;

    fn session(numbers: [f32; 6]) -> SessionFile {
        let [a, b, c, d, e, f] = numbers;
        let mut state = AppState {
            source: Source::Capture("/data/mug".into()),
            layer: Layer::Normal,
            ..AppState::default()
        };
        state.watch.budget_secs = 61.5;
        state.look.edit = MaterialEdit {
            roughness: RoughnessEdit::Constant(a),
            tint_color: Vec3::new(b, c, d),
            ..MaterialEdit::default()
        };
        state.look.transform.rotate_deg = Vec3::new(d, e, f);
        state.view.viewpoint =
            Viewpoint::look_at(Vec3::new(e, f, a), Vec3::new(b, c, 20.0), Vec3::Z);
        state.view.was_moved = true;
        state.look.environment = Some(state.environment_of_file(Path::new("/env/hall.hdr")));
        SessionFile::of(&state, Some("/runs/mug".into()))
    }

    proptest! {
        #[test]
        fn a_session_comes_back_from_its_text(numbers in prop::array::uniform6(-10.0_f32..10.0)) {
            let session = session(numbers);
            prop_assert_eq!(SessionFile::parse(&session.to_text()), Ok(session));
        }

        #[test]
        fn no_text_breaks_the_reader(text in ".{0,200}") {
            let text = format!("version = 1\n{text}");
            prop_assert!(SessionFile::parse(&text).is_err(), "{}", text);
        }
    }

    #[test]
    fn what_is_wrong_is_said_with_its_field() {
        let good = session([0.5; 6]).to_text();
        for (from, to, said) in [
            ("version = 1", "version = 2", "version 2"),
            ("version = 1", "", "`version` is missing"),
            ("\"normal\"", "\"shiny\"", "shiny"),
            ("budget_secs = 61.5", "budget_secs = nan", "`budget_secs`"),
            (
                "constant = 0.5",
                "constant = 1e300",
                "`material.roughness.constant`",
            ),
            ("size = [400, 300]", "size = [400, 0]", "`camera.size`"),
        ] {
            let text = good.replacen(from, to, 1);
            assert_ne!(text, good, "{from} is in\n{good}");
            let error = SessionFile::parse(&text).unwrap_err();
            assert!(error.contains(said), "{error} for {to}");
        }
    }

    #[test]
    fn files_that_were_moved_along_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("mug.neif-session");
        std::fs::write(&file, session([0.5; 6]).to_text()).unwrap();
        std::fs::create_dir(folder.path().join("mug")).unwrap();
        let read = SessionFile::read(&file).unwrap();
        let source = read.source.unwrap();
        assert_eq!(source.path, folder.path().join("mug"));
        assert_eq!(read.environment, Some("/env/hall.hdr".into()), "is nowhere");
    }
}
