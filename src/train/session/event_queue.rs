//! The way out of the training thread: a bounded queue that never makes training wait.

use std::{
    collections::VecDeque,
    sync::{Mutex, PoisonError},
    time::Duration,
};

use crossbeam::channel::{Sender, TrySendError};

use super::events::TrainEvent;

/// How long the last events may wait for a reader that is behind.
const LAST_CALL: Duration = Duration::from_secs(5);

/// Sends events and wakes their reader. Where the reader is behind, progress is dropped (newer
/// progress replaces it) and everything else waits here.
pub(in crate::train) struct EventQueue {
    sender: Sender<TrainEvent>,
    backlog: Mutex<VecDeque<TrainEvent>>,
    wake: Box<dyn Fn() + Send + Sync>,
}

impl EventQueue {
    /// A queue into `sender`; `wake` is called after each event and must not block.
    pub(in crate::train) fn new(
        sender: Sender<TrainEvent>,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> Self {
        Self {
            sender,
            backlog: Mutex::default(),
            wake: Box::new(wake),
        }
    }

    /// Hands over an event without waiting.
    pub(in crate::train) fn send(&self, event: TrainEvent) {
        let mut backlog = self.backlog.lock().unwrap_or_else(PoisonError::into_inner);
        let is_progress = matches!(event, TrainEvent::Progress(_));
        backlog.push_back(event);
        while let Some(event) = backlog.pop_front() {
            if let Err(TrySendError::Full(event)) = self.sender.try_send(event) {
                backlog.push_front(event);
                break;
            }
        }
        if is_progress && matches!(backlog.back(), Some(TrainEvent::Progress(_))) {
            backlog.pop_back();
        }
        drop(backlog);
        self.wake();
    }

    /// Wakes the reader to look at something.
    pub(in crate::train) fn wake(&self) {
        (self.wake)();
    }

    /// Hands over what is left, waiting a while for a reader that is behind.
    pub(in crate::train) fn close(&self) {
        let mut backlog = self.backlog.lock().unwrap_or_else(PoisonError::into_inner);
        for event in backlog.drain(..) {
            if self.sender.send_timeout(event, LAST_CALL).is_err() {
                break;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::session::events::Progress;

    #[test]
    fn a_slow_reader_loses_progress_and_nothing_else() {
        let (sender, receiver) = crossbeam::channel::bounded(2);
        let queue = EventQueue::new(sender, || {});
        let progress = |step| {
            TrainEvent::Progress(Progress {
                step,
                ..Progress::default()
            })
        };
        queue.send(progress(1));
        queue.send(TrainEvent::Paused);
        queue.send(progress(2));
        queue.send(TrainEvent::Resumed);
        assert_eq!(
            receiver.try_iter().collect::<Vec<_>>(),
            [progress(1), TrainEvent::Paused]
        );
        queue.send(progress(3));
        assert_eq!(
            receiver.try_iter().collect::<Vec<_>>(),
            [TrainEvent::Resumed, progress(3)]
        );
    }

    #[test]
    fn a_reader_that_went_away_does_not_stop_training() {
        let (sender, receiver) = crossbeam::channel::bounded(1);
        let queue = EventQueue::new(sender, || {});
        drop(receiver);
        queue.send(TrainEvent::Paused);
        queue.close();
    }
}
