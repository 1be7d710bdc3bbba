//! How a step gets on threads: every loop of it whose turns do not depend on each other goes through [`Tasks`], so that a
//! benchmark can time each turn.

use std::fmt;

use rayon::prelude::*;

/// One turn of a loop that is made of different things.
pub(in crate::train) type Job<'a> = Box<dyn FnOnce() + Send + 'a>;

/// Times a step's tasks, for `neif bench scaling`: the trainer itself has no clock.
pub trait TaskClock: fmt::Debug + Sync {
    /// The time, in nanoseconds.
    fn now(&self) -> u64;

    /// A pass begins: tasks are its own, until the next one.
    fn begin(&self, pass: &'static str);

    /// A task that began at `start` is done.
    fn done(&self, start: u64);
}

/// Runs the tasks of a step on the current thread pool.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::train) struct Tasks<'a> {
    pub(super) clock: Option<&'a dyn TaskClock>,
}

impl Tasks<'_> {
    /// Does `work` for every item, in whatever order; `pass` is what the benchmark calls it.
    pub(in crate::train) fn each<T: Send>(
        self,
        pass: &'static str,
        items: impl IndexedParallelIterator<Item = T>,
        work: impl Fn(T) + Sync + Send,
    ) {
        let items = items.with_max_len(1);
        let Some(clock) = self.clock else {
            return items.for_each(work);
        };
        clock.begin(pass);
        items.for_each(|item| {
            let start = clock.now();
            work(item);
            clock.done(start);
        });
    }

    /// Does all jobs; the longest should come first.
    pub(in crate::train) fn all(self, pass: &'static str, jobs: Vec<Job<'_>>) {
        self.each(pass, jobs.into_par_iter(), |job| job());
    }
}
