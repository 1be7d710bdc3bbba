//! A slot that holds the newest value: writers replace it, readers take what is there.
//!
//! Snapshots travel from the training thread to the window through one. The lock is held for a
//! pointer copy only, so neither side ever waits for the other's work.

use std::sync::{
    Arc, Mutex, PoisonError,
    atomic::{AtomicU64, Ordering},
};

/// A shared slot in which a newer value supersedes an older one that nobody has read.
#[derive(Debug)]
pub struct Latest<T> {
    value: Mutex<Option<Arc<T>>>,
    version: AtomicU64,
}

impl<T> Default for Latest<T> {
    fn default() -> Self {
        Self {
            value: Mutex::new(None),
            version: AtomicU64::new(0),
        }
    }
}

impl<T> Latest<T> {
    /// Replaces the value.
    pub fn publish(&self, value: Arc<T>) {
        // A panic elsewhere cannot leave a half-written pointer, so a poisoned lock is still good.
        *self.value.lock().unwrap_or_else(PoisonError::into_inner) = Some(value);
        self.version.fetch_add(1, Ordering::Release);
    }

    /// The newest value, if there has been one.
    pub fn get(&self) -> Option<Arc<T>> {
        self.value
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    /// How many values have been published: compare two to see whether there is news.
    pub fn version(&self) -> u64 {
        self.version.load(Ordering::Acquire)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_value_wins() {
        let slot = Latest::default();
        assert_eq!((slot.get(), slot.version()), (None, 0));
        slot.publish(Arc::new(1));
        slot.publish(Arc::new(2));
        assert_eq!((slot.get(), slot.version()), (Some(Arc::new(2)), 2));
    }
}
