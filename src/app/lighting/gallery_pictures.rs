//! The pictures in the gallery: of the files on the list, and of the environment that was opened or is being trained,
//! which follow training.

use std::path::Path;
use std::sync::{Arc, Weak};

use egui::{Context, TextureHandle, TextureId, TextureOptions};

use super::thumbnails::{Kept, Subject, Thumbnails};
use crate::app::state::app_state::AppState;
use crate::app::state::training_state::Phase;
use crate::app::viewport::texture;
use crate::neif::Environment;
use crate::train::Snapshot;

/// While training runs, its environment is pictured again after so many times the steps: a picture takes about 0.2 s of
/// one core, and some seven of them follow a run of 10,000 steps.
const STEPS_FACTOR: u64 = 4;

/// The environment of a snapshot that was asked for.
#[derive(Debug)]
struct Asked {
    /// Distinguishes it from later ones, and keeps nothing of it.
    environment: Weak<Environment>,
    step: u64,
    is_done: bool,
}

/// The thread that makes them, and those that are there.
pub(in crate::app) struct GalleryPictures {
    thumbnails: Thumbnails,
    of_files: Vec<(Arc<Path>, TextureHandle)>,
    own: Option<TextureHandle>,
    asked: Option<Asked>,
}

impl GalleryPictures {
    /// Starts the thread.
    pub(in crate::app) fn new(ctx: &Context) -> std::io::Result<Self> {
        let wake = ctx.clone();
        Ok(Self {
            thumbnails: Thumbnails::new(Kept::in_system(), move || wake.request_repaint())?,
            of_files: Vec::new(),
            own: None,
            asked: None,
        })
    }

    /// Those of files, with the files.
    pub(in crate::app) fn of_files(&self) -> Vec<(Arc<Path>, TextureId)> {
        let files = self.of_files.iter();
        files
            .map(|(path, texture)| (Arc::clone(path), texture.id()))
            .collect()
    }

    /// That of the environment that was opened or is being trained.
    pub(in crate::app) fn own(&self) -> Option<TextureId> {
        self.own.as_ref().map(TextureHandle::id)
    }

    /// Takes in what is finished, and asks for what is missing.
    pub(in crate::app) fn update(&mut self, ctx: &Context, state: &AppState) {
        while let Some((subject, photo)) = self.thumbnails.next() {
            let picture = (photo.size, photo.pixels.as_slice());
            match subject {
                Subject::File(path) => {
                    let texture =
                        texture::upload(ctx, "thumbnail", picture, TextureOptions::LINEAR);
                    self.of_files.push((path.into(), texture));
                }
                Subject::Loaded(environment) => {
                    if let Some(asked) = &mut self.asked
                        && asked.is_of(&environment)
                    {
                        asked.is_done = true;
                        texture::renew(ctx, &mut self.own, "own thumbnail", picture);
                    }
                }
            }
        }
        for entry in &state.environments {
            self.thumbnails.ask(&entry.path);
        }
        let is_training = state.training.phase == Phase::Training;
        if let Some(snapshot) = &state.snapshot
            && is_due(self.asked.as_ref(), snapshot, is_training)
            && self
                .thumbnails
                .ask_loaded(Arc::clone(&snapshot.environment))
        {
            self.asked = Some(Asked {
                environment: Arc::downgrade(&snapshot.environment),
                step: snapshot.step,
                is_done: false,
            });
        }
    }

    /// Drops the picture of what was open before.
    pub(in crate::app) fn forget_own(&mut self) {
        (self.own, self.asked) = (None, None);
    }
}

impl Asked {
    fn is_of(&self, environment: &Arc<Environment>) -> bool {
        self.environment.as_ptr() == Arc::as_ptr(environment)
    }
}

/// Whether the snapshot's environment is worth another picture: one at a time, the last one of a run always, and
/// while steps are taken one now and then.
fn is_due(asked: Option<&Asked>, snapshot: &Snapshot, is_training: bool) -> bool {
    let Some(asked) = asked else { return true };
    let later = asked.step.saturating_mul(STEPS_FACTOR).max(1);
    // Fewer steps than before are those of another run.
    let is_soon = is_training && (asked.step..later).contains(&snapshot.step);
    asked.is_done && !is_soon && !asked.is_of(&snapshot.environment)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;
    use std::time::{Duration, Instant};

    use super::*;
    use crate::app::state::app_state::tests::snapshot;
    use crate::app::state::source::Source;
    use crate::train::session::events::FinishReason;

    #[test]
    fn the_environment_of_a_capture_has_a_picture_while_it_trains_and_another_at_the_end() {
        let ctx = Context::default();
        let mut gallery = GalleryPictures::new(&ctx).unwrap();
        let mut state = AppState {
            source: Source::Capture(PathBuf::from("/capture")),
            snapshot: Some(snapshot(10)),
            ..AppState::default()
        };
        state.training.phase = Phase::Training;
        let mut pictured = |state: &AppState| {
            let start = Instant::now();
            loop {
                gallery.update(&ctx, state);
                if let Some(asked) = gallery.asked.as_ref().filter(|asked| asked.is_done) {
                    return (asked.step, gallery.own().is_some());
                }
                assert!(start.elapsed().as_secs() < 60, "no picture came");
                std::thread::sleep(Duration::from_millis(5));
            }
        };
        assert_eq!(pictured(&state), (10, true));
        state.snapshot = Some(snapshot(12));
        assert_eq!(pictured(&state), (10, true), "too little is new");
        state.training.phase = Phase::Finished(FinishReason::Budget);
        assert_eq!(pictured(&state), (12, true), "nothing follows it");
        gallery.forget_own();
        assert_eq!(gallery.own(), None);
    }

    #[test]
    fn pictures_become_rare_while_training_and_another_run_begins_anew() {
        let pictured = snapshot(100);
        let asked = |is_done| Asked {
            environment: Arc::downgrade(&pictured.environment),
            step: 100,
            is_done,
        };
        let due = |is_done, step, is_training| {
            is_due(Some(&asked(is_done)), &snapshot(step), is_training)
        };
        assert!(is_due(None, &pictured, true), "the first one");
        assert!(!is_due(Some(&asked(true)), &pictured, false), "the same");
        let while_training = [100, 399, 400, 3].map(|step| due(true, step, true));
        assert_eq!(while_training, [false, false, true, true]);
        assert!(due(true, 101, false), "training rests");
        assert!(!due(false, 400, true), "one at a time");
    }
}
