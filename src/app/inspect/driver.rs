//! Decides when values and panorama of the picked point are computed again.
//!
//! What the person changes is followed at once; a new snapshot alone is worth a coarse panorama every few seconds while
//! training runs, and a full one when it does not.

use std::sync::Arc;

use glam::Vec3;

use crate::app::inspect::Pick;
use crate::app::work::preview_driver::Situation;
use crate::render::{PointView, Scene};

/// Widths of the panorama, one after the other, pixels; the last is about as wide as the panel.
const WIDTHS: [u32; 3] = [64, 128, 320];
/// Widest panorama while training runs, pixels: about 0.1 s of one core.
const TRAINING_WIDTH: u32 = 128;
/// A new snapshot alone is followed so often while training runs, in seconds.
pub(in crate::app) const REFRESH_SECS: f64 = 5.0;

/// What the picked point's neighbourhood looks like now.
#[derive(Clone, Debug)]
pub(in crate::app) struct Wanted {
    pub(in crate::app) pick: Pick,
    pub(in crate::app) view: PointView,
    /// Object, environment and edits.
    pub(in crate::app) scene: Scene,
    pub(in crate::app) up: Vec3,
    pub(in crate::app) is_sharp: bool,
}

/// What was asked for.
#[derive(Clone, Debug)]
struct Asked {
    wanted: Wanted,
    /// The first request about this point.
    first_number: u64,
    /// The first request about this panorama, how wide it has become, and how wide it was asked for.
    panorama_number: u64,
    reached: u32,
    aimed_width: u32,
    at_secs: f64,
}

/// What a request is to be about.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::app) struct Decision {
    /// Widths of the panorama that are still missing.
    pub(in crate::app) widths: Vec<u32>,
    is_new_point: bool,
    is_new_panorama: bool,
}

/// Remembers what was asked for and what came of it.
#[derive(Debug, Default)]
pub(in crate::app) struct InspectDriver {
    asked: Option<Asked>,
}

impl InspectDriver {
    /// What to ask for now, if anything.
    pub(in crate::app) fn decide(&self, wanted: &Wanted, now: &Situation) -> Option<Decision> {
        let missing = |reached: u32| -> Vec<u32> {
            let is_allowed = |w: &u32| !now.is_training || *w <= TRAINING_WIDTH;
            let widths = WIDTHS.into_iter().filter(is_allowed);
            widths.filter(|w| *w > reached).collect()
        };
        let Some(asked) = &self.asked else {
            return Some(Decision {
                widths: missing(0),
                is_new_point: true,
                is_new_panorama: true,
            });
        };
        let old = &asked.wanted;
        let is_new_point = old.pick != wanted.pick;
        let is_edited = is_new_point || old.view != wanted.view || !same_look(old, wanted);
        let is_trained = !same_model(&old.scene, &wanted.scene);
        let is_due = !now.is_training || now.now_secs - asked.at_secs >= REFRESH_SECS;
        if is_trained && is_due {
            return Some(Decision {
                // One picture at once: a coarser one in between would flicker.
                widths: if is_new_point || !now.is_training {
                    missing(0)
                } else {
                    vec![TRAINING_WIDTH]
                },
                is_new_point,
                is_new_panorama: true,
            });
        }
        let is_new_panorama = is_new_point || !same_panorama(old, wanted);
        let reached = if is_new_panorama { 0 } else { asked.reached };
        let can_be_finer = !now.is_training && asked.aimed_width == TRAINING_WIDTH;
        let is_wanted = is_edited || is_new_panorama || can_be_finer;
        is_wanted.then(|| Decision {
            widths: missing(reached),
            is_new_point,
            is_new_panorama,
        })
    }

    /// Takes note of the number of the request that was made of a decision.
    pub(in crate::app) fn was_requested(
        &mut self,
        wanted: Wanted,
        decision: &Decision,
        number: u64,
        now: &Situation,
    ) {
        let old = self.asked.take();
        let kept = |is_new: bool, of: fn(&Asked) -> u64| {
            let old = old.as_ref().filter(|_| !is_new);
            old.map_or(number, of)
        };
        let before = old.as_ref().filter(|_| !decision.is_new_panorama);
        let reached = before.map_or(0, |asked| asked.reached);
        self.asked = Some(Asked {
            first_number: kept(decision.is_new_point, |asked| asked.first_number),
            panorama_number: kept(decision.is_new_panorama, |asked| asked.panorama_number),
            reached,
            aimed_width: decision.widths.last().copied().unwrap_or(reached),
            wanted,
            at_secs: now.now_secs,
        });
    }

    /// Whether values of a request are about the point that is picked.
    pub(in crate::app) fn is_current(&self, number: u64) -> bool {
        let asked = self.asked.as_ref();
        asked.is_some_and(|asked| number >= asked.first_number)
    }

    /// Takes note of a finished panorama; returns whether it is about the point that is picked.
    pub(in crate::app) fn was_reached(&mut self, number: u64, width: u32) -> bool {
        if let Some(asked) = &mut self.asked
            && number >= asked.panorama_number
        {
            asked.reached = asked.reached.max(width);
        }
        self.is_current(number)
    }

    /// Forgets everything: nothing is picked.
    pub(in crate::app) fn clear(&mut self) {
        self.asked = None;
    }
}

/// Whether the person left edits and environment alone.
fn same_look(a: &Wanted, b: &Wanted) -> bool {
    let (x, y) = (&a.scene, &b.scene);
    x.edit == y.edit && x.regions == y.regions && same_light(a, b)
}

fn same_light(a: &Wanted, b: &Wanted) -> bool {
    let (x, y) = (&a.scene, &b.scene);
    x.transform == y.transform
        && (x.has_own_light() == y.has_own_light())
        && (x.has_own_light() || Arc::ptr_eq(&x.environment, &y.environment))
}

/// Whether the panoramas show the same, apart from what training changed.
fn same_panorama(a: &Wanted, b: &Wanted) -> bool {
    let (x, y) = (&a.scene, &b.scene);
    let is_as_rough = x.edit.roughness == y.edit.roughness && x.regions == y.regions;
    a.is_sharp == b.is_sharp && a.up == b.up && same_light(a, b) && (b.is_sharp || is_as_rough)
}

/// Whether both are of the same snapshot.
fn same_model(a: &Scene, b: &Scene) -> bool {
    let object = |scene: &Scene| scene.object.as_ref().map(Arc::as_ptr);
    object(a) == object(b) && Arc::ptr_eq(&a.environment, &b.environment)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::RoughnessEdit;
    use crate::render::test_scene::{camera, object, scene};

    fn wanted() -> Wanted {
        let pick = Pick {
            position: Vec3::splat(0.4),
            normal: Vec3::Z,
            face_normal: Vec3::Z,
        };
        Wanted {
            pick,
            view: pick.seen_by(&camera(100, 100)),
            scene: scene(),
            up: Vec3::Z,
            is_sharp: false,
        }
    }

    fn at(now_secs: f64, is_training: bool) -> Situation {
        Situation {
            now_secs,
            is_training,
            trained_secs: 0.0,
            n_cores: 1,
            drag_share: 1.0,
        }
    }

    /// Asks for what is decided and finishes it; the widths.
    fn ask(
        driver: &mut InspectDriver,
        wanted: &Wanted,
        number: u64,
        at: &Situation,
    ) -> Option<Vec<u32>> {
        let decision = driver.decide(wanted, at)?;
        driver.was_requested(wanted.clone(), &decision, number, at);
        for &width in &decision.widths {
            assert!(driver.was_reached(number, width), "about this point");
        }
        Some(decision.widths)
    }

    #[test]
    fn a_moved_camera_asks_for_values_alone_and_an_edit_for_the_panorama_too() {
        let mut driver = InspectDriver::default();
        let mut now = wanted();
        let all = Some(WIDTHS.to_vec());
        assert_eq!(ask(&mut driver, &now, 1, &at(0.0, false)), all);
        assert_eq!(ask(&mut driver, &now, 2, &at(1.0, false)), None, "done");
        now.view.distance += 1.0;
        let none = Some(Vec::new());
        assert_eq!(ask(&mut driver, &now, 2, &at(2.0, false)), none);
        now.scene.edit.roughness = RoughnessEdit::Constant(0.5);
        assert_eq!(ask(&mut driver, &now, 3, &at(3.0, false)), all);
        now.is_sharp = true;
        assert_eq!(ask(&mut driver, &now, 4, &at(4.0, false)), all);
        now.scene.edit.roughness = RoughnessEdit::Constant(0.7);
        assert_eq!(ask(&mut driver, &now, 5, &at(5.0, false)), none, "sharp");
        now.pick.position = Vec3::ZERO;
        assert_eq!(ask(&mut driver, &now, 6, &at(6.0, false)), all);
        assert!(!driver.is_current(5), "about the point before");
    }

    #[test]
    fn snapshots_are_followed_coarsely_and_seldom_while_training_runs() {
        let mut driver = InspectDriver::default();
        let mut now = wanted();
        let coarse = Some(vec![64, TRAINING_WIDTH]);
        assert_eq!(ask(&mut driver, &now, 1, &at(0.0, true)), coarse);
        now.scene.object = Some(object(7));
        assert_eq!(ask(&mut driver, &now, 2, &at(1.0, true)), None, "too soon");
        let one = Some(vec![TRAINING_WIDTH]);
        assert_eq!(ask(&mut driver, &now, 2, &at(REFRESH_SECS, true)), one);
        // When training ends, what is missing follows.
        assert_eq!(ask(&mut driver, &now, 3, &at(9.0, false)), Some(vec![320]));
        assert_eq!(ask(&mut driver, &now, 4, &at(9.1, false)), None);
    }
}
