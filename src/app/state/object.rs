//! The object of a capture whose photos have no masks: whether it is to be found, and where a click shows it.

use glam::{Vec2, Vec3};

use super::app_state::AppState;
use super::source::Source;
use crate::render::Support;
use crate::scans::Scan;

impl AppState {
    /// Whether photos are open in which an object can be found, as their environment alone is trained.
    pub fn lacks_object(&self) -> bool {
        let is_of_photos = match &self.source {
            Source::Demo(path) | Source::Capture(path) => !Scan::is_named_so(path),
            _ => false,
        };
        let capture = self.training.capture.as_ref();
        is_of_photos && self.snapshot.is_some() && capture.is_some_and(|c| !c.has_object)
    }

    /// The point of the capture's environment that is seen at a pixel of a window of that size, world coordinates.
    pub fn environment_at(&self, at: Vec2, window: (u32, u32)) -> Option<Vec3> {
        let ray = self.window_camera(window).ray(at.x, at.y);
        let snapshot = self.snapshot.as_ref()?;
        Some(Support::met_by(&snapshot.environment, &ray)?.point)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::app::changes::apply::apply;
    use crate::app::inspect::InspectCommand;
    use crate::app::state::command::{Command, Effect, Train};
    use crate::app::state::training_state::CaptureInfo;
    use crate::geometry::Camera;
    use crate::render::test_scene::fog_where;
    use crate::train::Snapshot;
    use crate::train::masks::Selection;

    #[test]
    fn a_click_shows_the_object_to_be_found() {
        let mut state = AppState {
            source: Source::Capture("/photos".into()),
            snapshot: Some(Arc::new(Snapshot {
                step: 1,
                object: None,
                environment: fog_where(|x| x.x >= 0.4),
                exposures: None,
            })),
            ..AppState::default()
        };
        let info = CaptureInfo {
            n_train: 2,
            n_val: 0,
            size: (32, 24),
            has_object: false,
        };
        state.training.capture = Some(info);
        state.view.viewpoint.camera = Camera::look_at(Vec3::ZERO, Vec3::X, Vec3::Z, 0.8, 32, 24);
        let (at, window) = (Vec2::new(16.0, 12.0), (32, 24));
        let click = Command::Inspect(InspectCommand::PickAt { at, window });
        let mut effects = Vec::new();
        apply(&mut state, click.clone(), &mut effects);
        assert_eq!(effects, [], "nobody asked");
        let ask = Command::Train(Train::AskForObject(true));
        apply(&mut state, ask.clone(), &mut effects);
        apply(&mut state, click, &mut effects);
        let [Effect::FindObject(Selection { at: Some(at), .. })] = effects[..] else {
            panic!("{effects:?}");
        };
        assert!((at.x - 0.4).abs() < 0.05, "{at}");
        assert!(!state.training.asks_for_object, "one click is enough");
        state.source = Source::Capture("/scan.ply".into());
        apply(&mut state, ask, &mut effects);
        assert!(!state.training.asks_for_object, "a scan has no photos");
    }
}
