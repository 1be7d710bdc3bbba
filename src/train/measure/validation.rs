//! How good the fields are on photos that are not trained on, cheaply, and whether they still
//! get better.
//!
//! Measured are whole pixel rows drawn at random, the same every time, so that two measurements
//! compare. Test views have no part in it.

use std::collections::BTreeSet;
use std::sync::Arc;

use rayon::prelude::*;

use super::metrics::SquaredError;
use crate::data::{Dataset, View};
use crate::geometry::SurfaceTracer;
use crate::neif::ObjectModel;
use crate::render::{
    GBuffer, Layer, PathOptions, Scene, ShadeScratch, compose, shade_background, shade_object,
};
use crate::train::random::SlotRandom;
use crate::train::session::events::{TrainEvent, Validation};
use crate::train::session::plan::Plan;
use crate::train::session::saved::snapshot::Snapshot;

/// Plans shorter than this are never ended early, in seconds: there is little to save.
const MIN_PLAN_SECS: f64 = 120.0;
/// Share of the plan that is always trained.
const MIN_FRACTION: f32 = 0.5;
/// A run has settled when the last quarter of its time brought less than this, in dB.
const MIN_GAIN_DB: f64 = 0.05;
/// Measurements that the last quarter needs, so that one unlucky value decides nothing.
const MIN_RECENT: usize = 3;

/// The rows that are measured, traced once.
#[derive(Debug)]
pub(in crate::train) struct Validator {
    tracer: Option<Arc<SurfaceTracer>>,
    rows: Vec<Row>,
}

/// One row of pixels of one validation view.
#[derive(Debug)]
struct Row {
    view: usize,
    pixels: Vec<u32>,
    gbuffer: GBuffer,
}

/// Squared errors over the measured pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::train) struct Measured {
    all: SquaredError,
    object: SquaredError,
    background: SquaredError,
}

/// What was measured: over all validation views, and of each.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::train) struct Measurement {
    pub(in crate::train) total: Measured,
    views: Vec<Measured>,
}

impl Validator {
    /// Draws rows of about `n_pixels` over all validation views, and traces them.
    pub(in crate::train) fn new(
        dataset: &Dataset,
        object: Option<&ObjectModel>,
        seed: u64,
        n_pixels: usize,
    ) -> Self {
        let rows = draw_rows(&dataset.val, seed, n_pixels)
            .into_par_iter()
            .map(|(view, y)| {
                let camera = &dataset.val[view].camera;
                let tracer = object.map(|object| &*object.tracer);
                Row {
                    view,
                    pixels: (y * camera.width..(y + 1) * camera.width).collect(),
                    gbuffer: GBuffer::trace(tracer, camera, y..y + 1, PathOptions::FINE),
                }
            })
            .collect();
        Self {
            tracer: object.map(|object| Arc::clone(&object.tracer)),
            rows,
        }
    }

    /// Whether its rows were traced on the object's mesh.
    pub(in crate::train) fn is_of(&self, object: Option<&ObjectModel>) -> bool {
        let tracer = object.map(|object| Arc::as_ptr(&object.tracer));
        self.tracer.as_ref().map(Arc::as_ptr) == tracer
    }

    /// Measures the model, each view with its photo's exposure; `None` when there is no validation view.
    pub(in crate::train) fn measure(
        &self,
        snapshot: &Snapshot,
        dataset: &Dataset,
    ) -> Option<Measurement> {
        let like = |view: &View| snapshot.exposed_like(view, snapshot.scene());
        let scenes: Vec<Scene> = dataset.val.iter().map(like).collect();
        let rows: Vec<Measured> = self
            .rows
            .par_iter()
            .map_init(ShadeScratch::default, |scratch, row| {
                row.measure(&scenes[row.view], &dataset.val[row.view], scratch)
            })
            .collect();
        // Summed in order, so that the result does not depend on the threads.
        let mut measurement = Measurement {
            views: vec![Measured::default(); dataset.val.len()],
            ..Measurement::default()
        };
        for (row, measured) in self.rows.iter().zip(&rows) {
            measurement.total = measurement.total.plus(measured);
            measurement.views[row.view] = measurement.views[row.view].plus(measured);
        }
        (!rows.is_empty()).then_some(measurement)
    }
}

impl Measurement {
    /// The event that reports the views.
    pub(in crate::train) fn of_views(&self) -> TrainEvent {
        let psnr = |m: &Measured| m.object.psnr().or_else(|| m.all.psnr());
        TrainEvent::ViewsValidated(self.views.iter().map(psnr).collect())
    }
}

impl Row {
    fn measure(&self, scene: &Scene, view: &View, scratch: &mut ShadeScratch) -> Measured {
        let mut object = vec![[0.0; 3]; self.pixels.len()];
        let mut background = object.clone();
        shade_object(
            scene,
            &self.gbuffer,
            &self.pixels,
            Layer::Final,
            &mut object,
            scratch,
        );
        shade_background(scene, &view.camera, &self.pixels, &mut background, scratch);
        let mut measured = Measured::default();
        for (i, &pixel) in self.pixels.iter().enumerate() {
            let coverage = self.gbuffer.coverage()[i];
            let render = compose(scene, Layer::Final, coverage, object[i], background[i]);
            let truth = view.photo.srgb(pixel as usize);
            let mask = view.mask.as_ref();
            let is_object = mask.is_some_and(|mask| mask.is_object(pixel as usize));
            // Without a model of the object its pixels cannot be right and say nothing.
            if is_object && scene.object.is_none() {
                continue;
            }
            measured.all.add(render, truth);
            if is_object {
                measured.object.add(render, truth);
            } else {
                measured.background.add(render, truth);
            }
        }
        measured
    }
}

impl Measured {
    fn plus(&self, other: &Self) -> Self {
        Self {
            all: self.all.plus(other.all),
            object: self.object.plus(other.object),
            background: self.background.plus(other.background),
        }
    }

    /// The event that reports it; `None` when no pixel was measured or one was not finite.
    pub(in crate::train) fn at(&self, step: u64, elapsed_secs: f64) -> Option<Validation> {
        Some(Validation {
            step,
            elapsed_secs,
            psnr: self.all.psnr()?,
            psnr_object: self.object.psnr(),
            psnr_background: self.background.psnr(),
        })
    }
}

/// Draws (view, row) pairs: about `n_pixels`, spread evenly over the views, a row of each at least.
fn draw_rows(views: &[View], seed: u64, n_pixels: usize) -> Vec<(usize, u32)> {
    let mut random = SlotRandom::new(seed, 0, 0x7661_6c69);
    let share = n_pixels / views.len().max(1);
    let mut rows = Vec::new();
    for (index, view) in views.iter().enumerate() {
        let (width, height) = (view.camera.width, view.camera.height);
        let wanted = (share / width.max(1) as usize).clamp(1, height.max(1) as usize);
        let mut chosen = BTreeSet::new();
        // Bounded, because a set that is nearly full is hit again and again.
        for _ in 0..wanted * 8 {
            if chosen.len() < wanted {
                chosen.insert(random.index(height.max(1) as usize) as u32);
            }
        }
        rows.extend(chosen.into_iter().map(|y| (index, y)));
    }
    rows
}

/// Watches the measurements for the moment from which more training brings little.
#[derive(Clone, Debug, Default)]
pub(in crate::train) struct Settling {
    history: Vec<Validation>,
}

impl Settling {
    /// Adds a measurement.
    pub(in crate::train) fn add(&mut self, validation: Validation) {
        self.history.push(validation);
    }

    /// True when neither the whole image nor the object gained [`MIN_GAIN_DB`] over the last
    /// quarter of the elapsed time. Never in the first half of the plan nor in plans under
    /// [`MIN_PLAN_SECS`] or in steps: what the falling learning rate brings comes last.
    pub(in crate::train) fn is_settled(&self, plan: &Plan, elapsed_secs: f64) -> bool {
        let may = plan.is_timed()
            && plan.end() > MIN_PLAN_SECS
            && plan.fraction(elapsed_secs) >= MIN_FRACTION;
        if !may {
            return false;
        }
        let recent_from = 0.75 * elapsed_secs;
        let (before, recent): (Vec<&Validation>, Vec<&Validation>) = self
            .history
            .iter()
            .partition(|v| v.elapsed_secs < recent_from);
        let gain = |pick: fn(&Validation) -> f64| {
            let best = |of: &[&Validation]| of.iter().map(|v| pick(v)).fold(f64::MIN, f64::max);
            best(&recent) - best(&before)
        };
        !before.is_empty()
            && recent.len() >= MIN_RECENT
            && gain(|v| v.psnr) < MIN_GAIN_DB
            && gain(|v| v.psnr_object.unwrap_or(0.0)) < MIN_GAIN_DB
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::session::plan::Budget;

    fn history(psnr_at: impl Fn(f64) -> f64) -> Settling {
        let mut settling = Settling::default();
        for secs in (0..=200).step_by(10) {
            settling.add(Validation {
                step: 0,
                elapsed_secs: f64::from(secs),
                psnr: psnr_at(f64::from(secs)),
                ..Validation::default()
            });
        }
        settling
    }

    #[test]
    fn a_flat_run_settles_in_the_second_half_of_a_long_plan_only() {
        let flat = history(|secs| 30.0 - 5.0 * (-secs / 20.0).exp());
        let plan = |secs| Plan::new(Budget::Seconds(secs));
        assert!(flat.is_settled(&plan(300.0), 200.0));
        for (plan, why) in [
            (plan(900.0), "the first half is always trained"),
            (plan(100.0), "short plans run to their end"),
            (Plan::new(Budget::Steps(10)), "steps are exact"),
        ] {
            assert!(!flat.is_settled(&plan, 200.0), "{why}");
        }
    }

    #[test]
    fn a_run_that_gains_goes_on() {
        let plan = Plan::new(Budget::Seconds(300.0));
        for noise in [0.0, 0.1] {
            let gaining = history(|secs| 20.0 + secs * 0.01 + (secs * 7.0).sin() * noise);
            assert!(!gaining.is_settled(&plan, 200.0), "noise of {noise} dB");
        }
    }
}
