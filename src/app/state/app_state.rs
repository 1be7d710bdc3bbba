//! What the window shows: plain values, without threads, files or textures.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::export::ExportState;
use super::history::History;
use super::look::Look;
use super::messages::Messages;
use super::palette::Palette;
use super::source::{EnvironmentContent, EnvironmentEntry, Source};
use super::training_state::{Level, Phase, TrainingState};
use super::watch::{Comparison, WatchState};
use crate::app::inspect::InspectState;
use crate::app::lighting::LightingState;
use crate::app::object::ObjectState;
use crate::app::session::leaving::Leaving;
use crate::app::session::preferences::Preferences;
use crate::app::session::saving::SessionState;
use crate::app::viewport::camera_control::{Viewpoint, nearest_view, point_looked_at, up_axis};
use crate::app::work::pace::Pace;
use crate::data::{Dataset, View};
use crate::geometry::{Aabb, Camera, Hit};
use crate::neif::{Environment, ObjectModel, Region};
use crate::render::library::environment_name;
use crate::render::preview::progressive::Recomputed;
use crate::render::{DrawnBy, Layer, PreviewScene, Scene};
use crate::train::Snapshot;

/// The camera and where it came from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewState {
    /// Where the camera is.
    pub viewpoint: Viewpoint,
    /// The view whose camera it stands at, index into [`AppState::views`].
    pub at_view: Option<usize>,
    /// Where it began.
    pub home: Viewpoint,
    /// What to frame.
    pub bounds: Option<Aabb>,
    /// The world's up axis.
    pub up: Vec3,
    /// Whether the person has moved it.
    pub was_moved: bool,
}

impl Default for ViewState {
    fn default() -> Self {
        let home = Viewpoint::look_at(Vec3::new(2.0, -2.0, 1.0), Vec3::ZERO, Vec3::Z);
        Self {
            viewpoint: home,
            at_view: None,
            home,
            bounds: None,
            up: Vec3::Z,
            was_moved: false,
        }
    }
}

/// Comparison with the photo of the view the camera stands at.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Compare {
    /// The wipe's line, 0 (left) to 1 (right) of the photo; none is off.
    pub wipe: Option<f32>,
    /// Whether the photo covers everything while a key is held.
    pub is_photo_held: bool,
    /// Another comparison instead of the wipe.
    pub with_photo: Comparison,
}

/// What a typed path is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathPurpose {
    /// Open what is there.
    Open,
    /// Save the run there.
    Save,
    /// Write the table of figures there.
    Log,
    /// Write the masks of the object that was found there.
    Masks,
    /// Save the session there.
    SaveSession,
    /// Light the object with what is there.
    AddEnvironment,
}

/// The window in which a path is chosen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PathDialog {
    /// What for.
    pub purpose: PathPurpose,
    /// What is typed.
    pub typed: String,
    /// What is wrong, if anything.
    pub note: Option<String>,
    /// Whether the system's file dialog is up.
    pub is_browsing: bool,
}

/// The graphics adapter.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Adapter {
    /// As the driver calls it.
    pub name: String,
    /// Whether the processor does its work.
    pub is_software: bool,
    /// Interface and driver.
    pub details: String,
}

/// What is known of the shown preview picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ShownPicture {
    /// Width and height in pixels.
    pub size: (u32, u32),
    /// Resolution divisor per axis.
    pub scale: u32,
    /// The training step it shows.
    pub step: u64,
    /// Whether a finer one follows.
    pub is_refining: bool,
    /// What of it was computed anew.
    pub recomputed: Recomputed,
}

impl ShownPicture {
    /// Share of its pixels that were taken over from the picture before, `[0, 1]`; none of an empty picture.
    pub fn reused_share(&self) -> Option<f32> {
        let n = f64::from(self.size.0) * f64::from(self.size.1);
        let computed = (self.recomputed.background + self.recomputed.object) as f64;
        // Pixels on the silhouette are computed twice.
        (n > 0.0).then(|| (1.0 - computed / n).clamp(0.0, 1.0) as f32)
    }
}

/// The windows over the main one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Overlays {
    /// Open or save a path.
    pub path_dialog: Option<PathDialog>,
    /// The table of keys.
    pub is_help_open: bool,
    /// "Stop without saving?"
    pub is_stop_asked: bool,
    /// The field in which a command is looked for.
    pub palette: Option<Palette>,
}

/// All of it.
#[derive(Clone, Debug, Default)]
pub struct AppState {
    /// What is open.
    pub source: Source,
    /// How training goes.
    pub training: TrainingState,
    /// How training and the window share the processor.
    pub pace: Pace,
    /// The opened capture, once it is read.
    pub dataset: Option<Arc<Dataset>>,
    /// The newest state of the fields.
    pub snapshot: Option<Arc<Snapshot>>,
    /// The edits.
    pub look: Look,
    /// Whether the edits are hidden for comparison.
    pub is_original_shown: bool,
    /// Which part of the picture is shown.
    pub layer: Layer,
    /// How the environment is seen, grabbed and compared.
    pub lighting: LightingState,
    /// Environments to choose from beside the capture's own.
    pub environments: Vec<EnvironmentEntry>,
    /// The camera.
    pub view: ViewState,
    /// Comparison with the photo.
    pub compare: Compare,
    /// The picked point.
    pub inspect: InspectState,
    /// The object of photos without masks, while it is selected.
    pub object: ObjectState,
    /// How training is watched.
    pub watch: WatchState,
    /// What was said.
    pub messages: Messages,
    /// Windows over the main one.
    pub overlays: Overlays,
    /// What is taken away.
    pub export: ExportState,
    /// Opened lately, newest first.
    pub recent: Vec<PathBuf>,
    /// The graphics adapter.
    pub adapter: Adapter,
    /// What draws the preview.
    pub drawn_by: DrawnBy,
    /// The picture on screen.
    pub shown: Option<ShownPicture>,
    /// What is set once and found again.
    pub preferences: Preferences,
    /// Steps back and forth.
    pub history: History,
    /// Where the session is saved.
    pub session: SessionState,
    /// The question before training is lost.
    pub leaving: Option<Leaving>,
    /// Whether the window closes without asking.
    pub is_leaving_for_sure: bool,
    /// Whether the window is to fill the screen.
    pub is_full_screen: bool,
}

impl AppState {
    /// Whether steps are being taken, of the object's training or of an environment that is made of a scan: pictures leave them
    /// most of the processor then.
    pub fn is_learning(&self) -> bool {
        self.training.phase == Phase::Training || !self.lighting.imports.is_empty()
    }

    /// Whether a window over the main one wants an answer.
    pub fn is_asking(&self) -> bool {
        self.leaving.is_some() || self.overlays != Overlays::default()
    }

    /// Takes in what draws the preview; says so where a graphics card has failed.
    pub fn set_drawn_by(&mut self, drawn_by: DrawnBy) {
        if let Some(news) = drawn_by.news_after(&self.drawn_by) {
            self.messages.say(Level::Warning, news);
        }
        self.drawn_by = drawn_by;
    }

    /// What the preview shows, with edits unless the original is asked for; none before the first
    /// snapshot.
    pub fn scene(&self) -> Option<Scene> {
        let snapshot = self.snapshot.as_ref()?;
        Some(self.scene_of(snapshot))
    }

    /// The same for another snapshot.
    pub fn scene_of(&self, snapshot: &Snapshot) -> Scene {
        if self.is_original_shown {
            self.scene_with(snapshot, &Look::default())
        } else {
            self.scene_with(snapshot, &self.look)
        }
    }

    /// The same with the look that is kept as B, if one is.
    pub fn kept_scene_of(&self, snapshot: &Snapshot) -> Option<Scene> {
        let kept = self.lighting.kept.as_ref()?;
        Some(self.scene_with(snapshot, kept))
    }

    fn scene_with(&self, snapshot: &Snapshot, look: &Look) -> Scene {
        let mut scene = snapshot.scene();
        if let Some(environment) = self.environment_of(look) {
            scene.swap_environment(Arc::clone(environment));
        }
        let scene = Scene {
            regions: look.regions,
            transform: look.transform,
            edit: look.edit,
            background: self.lighting.background,
            display_ev: self.lighting.display_ev,
            tone_map: self.lighting.tone_map,
            ..scene
        };
        match self.compared_view() {
            Some(view) => snapshot.exposed_like(view, scene),
            None => scene,
        }
    }

    /// The view whose photo the picture is compared with, if any.
    fn compared_view(&self) -> Option<&View> {
        let index = self.view.at_view?;
        let is_compared = self.compare.wipe.is_some() || self.compare.with_photo != Comparison::Off;
        let dataset = self.dataset.as_ref().filter(|_| is_compared)?;
        dataset.views().nth(index)
    }

    /// The index of the environment in a file; added to the list, not read yet, where it is not in it.
    pub fn environment_of_file(&mut self, path: &Path) -> usize {
        let known = self
            .environments
            .iter()
            .position(|entry| entry.path == path);
        known.unwrap_or_else(|| {
            self.environments.push(EnvironmentEntry {
                name: environment_name(path),
                path: path.to_owned(),
                about: String::new(),
                content: EnvironmentContent::NotLoaded,
            });
            self.environments.len() - 1
        })
    }

    /// Files of the environments that were taken off the list.
    pub fn removed_environments(&self) -> impl Iterator<Item = &Path> {
        let removed = self.lighting.removed.iter();
        removed.filter_map(move |index| Some(&*self.environments.get(*index)?.path))
    }

    /// Takes the environments of these files off the list, and no others.
    pub fn remove_environments(&mut self, files: &[PathBuf]) {
        let entries = self.environments.iter().enumerate();
        let removed = entries.filter(|(_, entry)| files.contains(&entry.path));
        self.lighting.removed = removed.map(|(index, _)| index).collect();
    }

    /// The chosen environment, unless it is the capture's own or not read yet.
    pub fn chosen_environment(&self) -> Option<&Arc<Environment>> {
        self.environment_of(&self.look)
    }

    /// The chosen environment, or the capture's own.
    pub fn shown_environment(&self) -> Option<&Arc<Environment>> {
        let own = self.snapshot.as_ref().map(|own| &own.environment);
        self.chosen_environment().or(own)
    }

    /// The trained object, where there is one.
    pub fn object(&self) -> Option<&ObjectModel> {
        self.snapshot.as_ref()?.object.as_deref()
    }

    /// The point of the object that is seen at a pixel of a window of that size.
    pub fn hit_at(&self, at: Vec2, window: (u32, u32)) -> Option<Hit> {
        let ray = self.window_camera(window).ray(at.x, at.y);
        self.object()?.tracer.intersect(&ray, 0.0, f32::INFINITY)
    }

    /// A scene as a camera sees it, of the layer that is shown.
    pub fn picture_of(&self, scene: Scene, camera: Camera) -> PreviewScene {
        PreviewScene {
            scene,
            camera,
            layer: self.layer,
            highlight: self.highlight(),
        }
    }

    /// The camera of a window of that size in pixels.
    pub fn window_camera(&self, window: (u32, u32)) -> Camera {
        self.view.viewpoint.camera_for(window.0, window.1)
    }

    fn environment_of(&self, look: &Look) -> Option<&Arc<Environment>> {
        match &self.environments.get(look.environment?)?.content {
            EnvironmentContent::Ready(environment) => Some(environment),
            _ => None,
        }
    }

    /// All views of the capture: training, validation, test.
    pub fn views(&self) -> impl Iterator<Item = &View> {
        self.dataset.iter().flat_map(|dataset| dataset.views())
    }

    /// A view by its index among [`Self::views`].
    pub fn view_at(&self, index: usize) -> Option<&View> {
        self.views().nth(index)
    }

    /// The view whose camera is most like the current one.
    pub fn nearest_view(&self) -> Option<usize> {
        nearest_view(&self.view.viewpoint.camera, self.views())
    }

    /// Takes in a capture and puts the camera where its first photo was taken.
    pub fn set_dataset(&mut self, dataset: Arc<Dataset>) {
        if let Some(first) = dataset.views().next() {
            let cameras = || dataset.train.iter().map(|view| &view.camera);
            let bounds = dataset.mesh.as_ref().map(|mesh| mesh.bounds());
            let pivot = bounds
                .map(|bounds| bounds.center())
                .or_else(|| point_looked_at(cameras()))
                .unwrap_or_else(|| first.camera.position() + first.camera.forward());
            let home = Viewpoint::of_camera(&first.camera, pivot);
            let was_moved = self.view.was_moved;
            let viewpoint = if was_moved { self.view.viewpoint } else { home };
            let at_view = (!was_moved).then_some(0);
            self.view = ViewState {
                viewpoint,
                at_view,
                home,
                bounds,
                up: dataset.origin.up.unwrap_or_else(|| up_axis(cameras())),
                was_moved,
            };
        }
        self.dataset = Some(dataset);
    }

    /// Puts the camera where a model without photos can be seen.
    pub fn look_at_model(&mut self, snapshot: &Snapshot) {
        let up = snapshot.environment.up();
        let object = snapshot.object.as_ref();
        let bounds = object.map(|object| object.tracer.mesh().bounds());
        let inner = snapshot.environment.inner_box();
        let home = if let Some(bounds) = bounds {
            let eye = bounds.center() + (Vec3::new(1.0, -1.0, 0.0) + up * 0.5) * bounds.diagonal();
            let mut home = Viewpoint::look_at(eye, bounds.center(), up);
            home.frame(&bounds);
            home
        } else {
            let side = if up.x.abs() < 0.5 { Vec3::X } else { Vec3::Y };
            let eye = inner.center() - side * (0.1 * inner.diagonal());
            Viewpoint::look_at(eye, inner.center(), up)
        };
        self.view = ViewState {
            viewpoint: home,
            at_view: None,
            home,
            bounds,
            up,
            was_moved: false,
        };
    }

    /// The region that the material panel changes; none is the whole object.
    pub fn scope(&self) -> Option<(usize, &Region)> {
        let index = self.inspect.scope?;
        Some((index, self.look.regions.get(index)?))
    }

    /// The region that is shown in a signal colour.
    pub fn highlight(&self) -> Option<Region> {
        self.look.regions.get(self.inspect.hovered?).copied()
    }
}

#[cfg(test)]
pub(in crate::app) mod tests {
    use super::*;
    use crate::data::{Photo, Split};
    use crate::render::test_scene::{camera, scene};
    use crate::train::photos::photo_exposures::PhotoExposures;

    /// The test scene as training has it at a step.
    pub(in crate::app) fn snapshot(step: u64) -> Arc<Snapshot> {
        let scene = scene();
        Arc::new(Snapshot {
            step,
            object: scene.object,
            environment: scene.environment,
            exposures: None,
        })
    }

    /// A capture of one grey photo, `a`, and a trained scene in which it has `gain`.
    pub(in crate::app) fn one_photo(gain: Vec3) -> (Arc<Dataset>, Snapshot) {
        let view = View {
            name: "a".to_owned(),
            file: PathBuf::new(),
            split: Split::Train,
            camera: camera(4, 3),
            photo: Photo::Ldr {
                width: 4,
                height: 3,
                pixels: vec![[30_000; 3]; 12],
            },
            mask: None,
        };
        let dataset = Dataset::of_views(vec![view]);
        let snapshot = Snapshot {
            exposures: Some(Arc::new(PhotoExposures::of(&dataset, &[gain]))),
            ..Snapshot::clone(&snapshot(1))
        };
        (Arc::new(dataset), snapshot)
    }

    #[test]
    fn beside_its_photo_a_picture_has_the_photo_s_exposure() {
        let gain = Vec3::new(2.0, 1.0, 0.5);
        let (dataset, snapshot) = one_photo(gain);
        let mut state = AppState {
            dataset: Some(dataset),
            ..AppState::default()
        };
        let shown = |state: &AppState| state.scene_of(&snapshot).transform.white_balance;
        state.compare.wipe = Some(0.5);
        assert_eq!(shown(&state), Vec3::ONE, "no photo is taken from here");
        state.view.at_view = Some(0);
        assert_eq!(shown(&state), gain, "the wipe");
        state.compare.wipe = None;
        assert_eq!(shown(&state), Vec3::ONE, "no comparison");
        state.compare.with_photo = Comparison::Beside;
        assert_eq!(shown(&state), gain, "beside it");
    }
}
