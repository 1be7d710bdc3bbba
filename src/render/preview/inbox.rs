//! A slot for a worker's next request: a newer one takes the place of one that waits, and says so to one that runs.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Where requests to one worker thread are put.
#[derive(Debug)]
pub struct Inbox<T> {
    slot: Mutex<Slot<T>>,
    news: Condvar,
    /// Set while something newer waits.
    superseded: AtomicBool,
    n_requests: AtomicU64,
}

#[derive(Debug)]
struct Slot<T> {
    request: Option<(u64, T)>,
    is_closed: bool,
}

impl<T> Slot<T> {
    fn is_quiet(&self) -> bool {
        self.request.is_none() && !self.is_closed
    }
}

impl<T> Default for Inbox<T> {
    fn default() -> Self {
        Self {
            slot: Mutex::new(Slot {
                request: None,
                is_closed: false,
            }),
            news: Condvar::new(),
            superseded: AtomicBool::new(false),
            n_requests: AtomicU64::new(0),
        }
    }
}

impl<T> Inbox<T> {
    /// Asks instead of whatever waits or runs; returns the request's number, which grows from 1.
    pub fn put(&self, request: T) -> u64 {
        let number = self.n_requests.fetch_add(1, Ordering::Relaxed) + 1;
        let mut slot = self.slot();
        slot.request = Some((number, request));
        self.superseded.store(true, Ordering::Relaxed);
        drop(slot);
        self.news.notify_one();
        number
    }

    /// Waits for a request and its number; `None` when there will be none.
    pub fn take(&self) -> Option<(u64, T)> {
        let mut slot = self.slot();
        loop {
            if slot.is_closed {
                return None;
            }
            if let Some(request) = slot.request.take() {
                self.superseded.store(false, Ordering::Relaxed);
                return Some(request);
            }
            slot = self.news.wait(slot).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Set while something newer than what was taken last waits: the flag to cancel work by.
    pub fn superseded(&self) -> &AtomicBool {
        &self.superseded
    }

    /// Whether something newer waits.
    pub fn is_superseded(&self) -> bool {
        self.superseded.load(Ordering::Relaxed)
    }

    /// Waits so long; whether nothing newer has come.
    pub fn stays_quiet(&self, moment: Duration) -> bool {
        let wait = self
            .news
            .wait_timeout_while(self.slot(), moment, |slot| slot.is_quiet());
        let (slot, _) = wait.unwrap_or_else(PoisonError::into_inner);
        slot.is_quiet()
    }

    /// Ends the work: what runs is superseded, and nothing is taken any more.
    pub fn close(&self) {
        self.slot().is_closed = true;
        self.superseded.store(true, Ordering::Relaxed);
        self.news.notify_one();
    }

    /// A panic elsewhere cannot leave these plain values half written.
    fn slot(&self) -> MutexGuard<'_, Slot<T>> {
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_request_is_taken_and_says_so_to_what_runs() {
        let inbox = Inbox::default();
        assert_eq!((inbox.put("old"), inbox.put("new")), (1, 2));
        assert_eq!(inbox.take(), Some((2, "new")));
        assert!(!inbox.is_superseded() && inbox.stays_quiet(Duration::ZERO));
        inbox.put("newer");
        assert!(inbox.is_superseded() && !inbox.stays_quiet(Duration::from_hours(1)));
        inbox.close();
        assert_eq!(inbox.take(), None, "closed");
    }
}
