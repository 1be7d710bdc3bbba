//! Decides when the preview renders what: at once for the person, within a budget for training.
//!
//! A change by hand is rendered as fast as the machine can, coarse to fine. A new snapshot alone
//! is worth a refresh that costs at most [`REFRESH_SHARE`] of the processor: coarse and often
//! while training is young and changes much, at full resolution and rarely later.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::render::{Passes, PreviewFrame, PreviewScene};
use crate::train::Snapshot;

/// Share of all cores that refreshes may take while training runs.
pub const REFRESH_SHARE: f64 = 0.06;
/// Refreshes are at least this far apart, in seconds.
const MIN_INTERVAL_SECS: f64 = 1.0;
/// A finer refresh may be as late as this share of the training time, since changes slow down.
const PATIENCE: f64 = 0.15;
/// ... but no later than this, in seconds.
const MAX_INTERVAL_SECS: f64 = 40.0;
/// While something is dragged, the snapshot stays the same for so long, so that what did not
/// change can be reused, in seconds.
const HOLD_SECS: f64 = 1.0;

/// Requests that are remembered: more than can be made while one picture is rendered.
const MAX_REQUESTS: usize = 1024;

/// What the driver needs to know now.
#[derive(Clone, Debug)]
pub struct Situation {
    /// The window's clock, in seconds.
    pub now_secs: f64,
    /// Whether steps are being taken.
    pub is_training: bool,
    /// Seconds of training so far.
    pub trained_secs: f64,
    /// Cores of the machine.
    pub n_cores: usize,
    /// Share of all cores that pictures of something dragged may take while training.
    pub drag_share: f64,
}

/// A request for the preview.
#[derive(Clone, Debug)]
pub struct Wanted {
    /// The snapshot that is shown.
    pub snapshot: Arc<Snapshot>,
    /// The picture.
    pub scene: PreviewScene,
    /// Which passes.
    pub passes: Passes,
}

/// Remembers what was asked for and what came of it.
#[derive(Debug, Default)]
pub struct PreviewDriver {
    asked: Option<Wanted>,
    /// Numbers of the last requests with the training steps they show, oldest first.
    requests: VecDeque<(u64, u64)>,
    /// Whether the last picture of the last request is there.
    is_done: bool,
    /// When the person last changed something that was asked for.
    touched_secs: Option<f64>,
    /// From when on a change or a newer snapshot that waits for its turn may be shown; none where nothing waits.
    due_secs: Option<f64>,
    /// When the last refresh was asked for, and from when on the next may be.
    refreshed_secs: f64,
    /// Cost of a picture in motion, in processor seconds.
    motion_cost_secs: Option<f64>,
    /// Cost of a full picture, in processor seconds, from the last finished passes.
    full_cost_secs: Option<f64>,
}

impl PreviewDriver {
    /// What to ask the preview for now, if anything. `scene` makes the picture of a snapshot.
    pub fn decide(
        &mut self,
        newest: &Arc<Snapshot>,
        scene: impl Fn(&Snapshot) -> PreviewScene,
        situation: &Situation,
    ) -> Option<Wanted> {
        let now = situation.now_secs;
        self.due_secs = None;
        // The last picture of a refinement takes long; the next snapshot would make it worthless.
        let passes = if situation.is_training {
            Passes::Glance
        } else {
            Passes::Refine
        };
        let Some(asked) = &self.asked else {
            return Some(self.ask(newest, scene(newest), passes, now));
        };
        // The same snapshot with what is wanted now shows whether the person changed something.
        let same_snapshot = Arc::clone(&asked.snapshot);
        let current = scene(&same_snapshot);
        let is_newer = !Arc::ptr_eq(&same_snapshot, newest);
        if !current.is_same(&asked.scene) {
            let touched = self.touched_secs.unwrap_or(f64::NEG_INFINITY);
            let (since, due) = (now - touched, touched + self.drag_interval_secs(situation));
            if situation.is_training && now < due {
                self.due_secs = Some(due);
                return None;
            }
            let is_dragging = since < HOLD_SECS;
            self.touched_secs = Some(now);
            let held = now - self.refreshed_secs < 3.0 * HOLD_SECS;
            return Some(if is_newer && !(is_dragging && held) {
                self.ask(newest, scene(newest), passes, now)
            } else {
                let refreshed = self.refreshed_secs;
                let wanted = self.ask(&same_snapshot, current, passes, now);
                self.refreshed_secs = refreshed;
                wanted
            });
        }
        if !self.is_done {
            return None;
        }
        if !situation.is_training {
            let is_coarse = asked.passes != Passes::Refine;
            return (is_newer || is_coarse)
                .then(|| self.ask(newest, scene(newest), Passes::Refine, now));
        }
        if !is_newer {
            return None;
        }
        let (scale, interval) = self.refresh_plan(situation);
        let due = self.refreshed_secs + interval;
        if now < due {
            self.due_secs = Some(due);
            return None;
        }
        Some(self.ask(newest, scene(newest), Passes::Only(scale), now))
    }

    /// Seconds until what waits for its turn may be asked for, to be woken in time. None where nothing waits: a new
    /// snapshot, a finished picture or the person wakes the window.
    pub fn wait_secs(&self, now_secs: f64) -> Option<f64> {
        self.due_secs.map(|due| (due - now_secs).max(0.0))
    }

    /// Least time between two pictures of something dragged while training.
    fn drag_interval_secs(&self, situation: &Situation) -> f64 {
        let cost = self.motion_cost_secs.unwrap_or(0.0);
        cost / (situation.drag_share * situation.n_cores as f64).max(1e-3)
    }

    /// The finest scale that patience and budget allow, and how far apart refreshes are then.
    fn refresh_plan(&self, situation: &Situation) -> (u32, f64) {
        let Some(cost) = self.full_cost_secs else {
            return (4, MIN_INTERVAL_SECS);
        };
        let per_sec = REFRESH_SHARE * situation.n_cores as f64;
        let interval =
            |scale: u32| (cost / (f64::from(scale * scale) * per_sec)).max(MIN_INTERVAL_SECS);
        let patience =
            (PATIENCE * situation.trained_secs).clamp(MIN_INTERVAL_SECS, MAX_INTERVAL_SECS);
        let scale = [1, 2]
            .into_iter()
            .find(|&scale| interval(scale) <= patience)
            .unwrap_or(4);
        (scale, interval(scale))
    }

    fn ask(
        &mut self,
        snapshot: &Arc<Snapshot>,
        scene: PreviewScene,
        passes: Passes,
        now_secs: f64,
    ) -> Wanted {
        let wanted = Wanted {
            snapshot: Arc::clone(snapshot),
            scene,
            passes,
        };
        self.asked = Some(wanted.clone());
        self.refreshed_secs = now_secs;
        self.is_done = false;
        wanted
    }

    /// Takes note of the number that the preview gave to what was last wanted.
    pub fn was_requested(&mut self, number: u64) {
        let step = self.asked.as_ref().map_or(0, |asked| asked.snapshot.step);
        self.requests.push_back((number, step));
        if self.requests.len() > MAX_REQUESTS {
            self.requests.pop_front();
        }
    }

    /// Takes in a finished picture; returns the training step that it shows, or none where it is
    /// of something that is no longer open. While something is dragged, pictures of requests that
    /// were superseded meanwhile are still the newest there are.
    pub fn was_shown(&mut self, frame: &PreviewFrame) -> Option<u64> {
        let (newest, _) = *self.requests.back()?;
        let (_, step) = *self
            .requests
            .iter()
            .find(|(number, _)| *number == frame.request)?;
        if frame.request == newest {
            self.is_done = frame.is_last;
        }
        // What changes by hand uses what was there before and says nothing of a refresh.
        match self.asked.as_ref().map(|asked| asked.passes) {
            Some(Passes::Only(_)) if frame.request == newest => {
                let pixels = f64::from(frame.scale * frame.scale);
                self.full_cost_secs = Some(frame.output.cpu_secs * pixels);
            }
            // The first of two; the second is of a view at rest.
            Some(Passes::Glance) if !frame.is_last => {
                self.motion_cost_secs = Some(frame.output.cpu_secs);
            }
            _ => {}
        }
        Some(step)
    }

    /// Forgets everything: something else was opened.
    pub fn clear(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::state::app_state::tests::snapshot;
    use crate::render::Layer;
    use crate::render::preview::progressive::PassOutput;
    use crate::render::test_scene::camera;

    fn picture(width: u32) -> impl Fn(&Snapshot) -> PreviewScene {
        move |snapshot| PreviewScene {
            scene: snapshot.scene(),
            camera: camera(width, 100),
            layer: Layer::Final,
            highlight: None,
        }
    }

    fn situation(now_secs: f64, is_training: bool) -> Situation {
        Situation {
            now_secs,
            is_training,
            trained_secs: now_secs,
            n_cores: 2,
            drag_share: 0.5,
        }
    }

    /// The last picture of a request.
    fn frame(request: u64, cpu_secs: f64) -> PreviewFrame {
        PreviewFrame {
            request,
            scale: 4,
            is_fine: false,
            is_last: true,
            output: PassOutput {
                cpu_secs,
                ..PassOutput::default()
            },
        }
    }

    /// What a driver asks for first.
    fn first(driver: &mut PreviewDriver, snapshot: &Arc<Snapshot>, is_training: bool) -> Wanted {
        let wanted = driver.decide(snapshot, picture(100), &situation(0.0, is_training));
        wanted.expect("the first picture")
    }

    /// Informs the driver that its last request is done at the cost of a full picture.
    fn finish(driver: &mut PreviewDriver, wanted: &Wanted, full_cost_secs: f64) {
        let scale = if let Passes::Only(scale) = wanted.passes {
            scale
        } else {
            1
        };
        // The preview numbers its requests upwards.
        let number = driver.requests.back().map_or(1, |(last, _)| last + 1);
        driver.was_requested(number);
        let frame = PreviewFrame {
            scale,
            ..frame(number, full_cost_secs / f64::from(scale * scale))
        };
        assert_eq!(driver.was_shown(&frame), Some(wanted.snapshot.step));
    }

    #[test]
    fn nothing_is_asked_for_twice() {
        let (mut driver, newest) = (PreviewDriver::default(), snapshot(1));
        let wanted = first(&mut driver, &newest, false);
        assert!(
            driver
                .decide(&newest, picture(100), &situation(0.1, false))
                .is_none()
        );
        finish(&mut driver, &wanted, 1.0);
        assert!(
            driver
                .decide(&newest, picture(100), &situation(9.0, false))
                .is_none()
        );
    }

    #[test]
    fn refreshes_stay_within_their_share_and_become_fine() {
        let mut driver = PreviewDriver::default();
        let mut wanted = first(&mut driver, &snapshot(0), true);
        let (mut spent, mut scales, cost) = (0.0, Vec::new(), 4.0);
        for tick in 1..3000 {
            finish(&mut driver, &wanted, cost);
            let now = f64::from(tick) * 0.1;
            if let Some(next) =
                driver.decide(&snapshot(tick as u64), picture(100), &situation(now, true))
            {
                let Passes::Only(scale) = next.passes else {
                    panic!("a refresh makes one pass")
                };
                scales.push(scale);
                spent += cost / f64::from(scale * scale);
                wanted = next;
            }
        }
        let share = spent / (300.0 * 2.0);
        assert!(
            share <= REFRESH_SHARE * 1.1,
            "{share} of the processor went to refreshes"
        );
        assert!(
            scales.contains(&2) && scales.last() == Some(&1),
            "never became fine: {scales:?}"
        );
    }

    #[test]
    fn the_window_is_woken_for_what_waits_and_for_nothing_else() {
        let (mut driver, newest) = (PreviewDriver::default(), snapshot(0));
        let wanted = first(&mut driver, &newest, true);
        let decide = |driver: &mut PreviewDriver, newest, now| {
            let wanted = driver.decide(newest, picture(100), &situation(now, true));
            (wanted.is_some(), driver.wait_secs(now))
        };
        assert_eq!(
            decide(&mut driver, &newest, 0.1),
            (false, None),
            "it is being drawn"
        );
        finish(&mut driver, &wanted, 0.01);
        assert_eq!(decide(&mut driver, &newest, 60.0), (false, None));
        driver.refreshed_secs = 60.0;
        let newest = snapshot(1);
        let (is_asked, wait) = decide(&mut driver, &newest, 60.25);
        assert!(!is_asked && wait == Some(0.75), "{wait:?}");
        assert_eq!(decide(&mut driver, &newest, 61.0), (true, None));
    }

    #[test]
    fn a_coarse_refresh_becomes_fine_when_training_rests() {
        let mut driver = PreviewDriver::default();
        let wanted = first(&mut driver, &snapshot(0), true);
        finish(&mut driver, &wanted, 4.0);
        let newest = snapshot(1);
        let refresh = driver
            .decide(&newest, picture(100), &situation(5.0, true))
            .expect("a refresh");
        assert_ne!(refresh.passes, Passes::Refine);
        finish(&mut driver, &refresh, 4.0);
        let fine = driver
            .decide(&newest, picture(100), &situation(5.1, false))
            .expect("the rest");
        assert_eq!(fine.passes, Passes::Refine);
    }

    #[test]
    fn a_drag_keeps_its_snapshot_so_that_parts_can_be_reused() {
        let mut driver = PreviewDriver::default();
        first(&mut driver, &snapshot(0), true);
        let mut steps = Vec::new();
        for i in 1..20 {
            let now = f64::from(i) * 0.05;
            let wanted = driver
                .decide(&snapshot(i as u64), picture(100 + i), &situation(now, true))
                .expect("a change");
            assert_eq!(wanted.passes, Passes::Glance);
            steps.push(wanted.snapshot.step);
        }
        steps.dedup();
        assert!(
            steps.len() <= 2,
            "snapshots changed under the drag: {steps:?}"
        );
    }

    #[test]
    fn a_drag_beside_training_leaves_time_between_pictures_and_ends_where_it_stopped() {
        let (mut driver, newest) = (PreviewDriver::default(), snapshot(0));
        let at = situation;
        first(&mut driver, &newest, true);
        driver.was_requested(1);
        // A tenth of a second at half of two cores.
        let motion = PreviewFrame {
            scale: 2,
            is_last: false,
            ..frame(1, 0.1)
        };
        driver.was_shown(&motion);
        let mut shown = Vec::new();
        for i in 1..=100 {
            let now = at(1.0 + f64::from(i) * 0.01, true);
            let wanted = driver.decide(&newest, picture(100 + i as u32), &now);
            shown.extend(wanted.map(|wanted| wanted.scene.camera.width));
        }
        assert!((9..=11).contains(&shown.len()), "{shown:?}");
        let wait = driver.wait_secs(2.0).expect("a change waits");
        assert!(wait <= 0.1, "woken after {wait} s");
        let last = driver.decide(&newest, picture(200), &at(2.0 + wait + 1e-6, true));
        assert_eq!(last.expect("the end").scene.camera.width, 200);
        let free = driver.decide(&newest, picture(201), &at(2.2, false));
        assert!(free.is_some(), "nothing waits when nothing trains");
    }

    #[test]
    fn pictures_of_superseded_requests_are_shown_but_not_those_of_something_closed() {
        let mut driver = PreviewDriver::default();
        for (number, width) in [(1, 100), (2, 101)] {
            let step = number + 10;
            let now = situation(100.0 * number as f64, false);
            driver
                .decide(&snapshot(step), picture(width), &now)
                .expect("a change");
            driver.was_requested(number);
        }
        assert_eq!(driver.was_shown(&frame(1, 0.1)), Some(11));
        assert!(!driver.is_done, "the newest is still to come");
        assert_eq!(driver.was_shown(&frame(2, 0.1)), Some(12));
        assert!(driver.is_done);
        driver.clear();
        assert_eq!(driver.was_shown(&frame(2, 0.1)), None);
    }
}
