//! Writes small text files on a thread of its own, one after the other, each whole or not at all.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;

use crossbeam::channel::{Receiver, Sender, bounded};

use super::threads::spawn;
use crate::data::write_atomically;

/// Files that may wait; a person cannot ask for more in the time that one takes.
const QUEUE: usize = 64;

/// What to do with a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::app) enum Keep {
    /// Write this text; the folder is made where it is missing.
    Write(String),
    /// Remove it, if it is there.
    Remove,
}

/// What to say of a file: that it was written, if anything, or why it could not be.
type Ending = Result<Option<String>, String>;

/// The thread's handle; dropping it waits until all is written.
#[derive(Debug)]
pub(in crate::app) struct Keeper {
    jobs: Option<Sender<(PathBuf, Keep, Option<&'static str>)>>,
    endings: Receiver<Ending>,
    thread: Option<JoinHandle<()>>,
}

impl Keeper {
    /// Starts the thread; `wake` is called after each file.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub(in crate::app) fn new(wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let (jobs, queue) = bounded::<(PathBuf, Keep, Option<&'static str>)>(QUEUE);
        let (sender, endings) = bounded(QUEUE);
        let thread = spawn("neif-keep", 0, move || {
            for (path, keep, done) in queue {
                let shown = path.display();
                let ending = carry_out(&path, &keep)
                    .map(|()| done.map(|done| format!("{done} {shown}")))
                    .map_err(|error| format!("{shown}: cannot be written: {error}"));
                // A full queue means that nobody listens; the files matter more.
                if sender.try_send(ending).is_ok() {
                    wake();
                }
            }
        })?;
        Ok(Self {
            jobs: Some(jobs),
            endings,
            thread: Some(thread),
        })
    }

    /// Queues a file. Never waits.
    pub(in crate::app) fn keep(&self, path: &Path, keep: Keep) {
        self.queue(path, keep, None);
    }

    /// Queues a text that the person asked to be written, which is said after `done` when it is.
    pub(in crate::app) fn save(&self, path: &Path, text: String, done: &'static str) {
        self.queue(path, Keep::Write(text), Some(done));
    }

    fn queue(&self, path: &Path, keep: Keep, done: Option<&'static str>) {
        let Some(jobs) = &self.jobs else { return };
        if jobs.try_send((path.to_owned(), keep, done)).is_err() {
            tracing::warn!("{}: not written: too many files wait", path.display());
        }
    }

    /// What is to be said of the next file that is done, if there is one.
    pub(in crate::app) fn next(&self) -> Option<Ending> {
        self.endings.try_recv().ok()
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        self.jobs = None;
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that writes files broke down");
        }
    }
}

fn carry_out(path: &Path, keep: &Keep) -> std::io::Result<()> {
    match keep {
        Keep::Write(text) => {
            if let Some(folder) = path.parent() {
                std::fs::create_dir_all(folder)?;
            }
            write_atomically(path, |file| file.write_all(text.as_bytes()))
        }
        Keep::Remove => match std::fs::remove_file(path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error),
            _ => Ok(()),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_written_in_order_before_the_keeper_goes() {
        let folder = tempfile::tempdir().unwrap();
        let (kept, gone) = (folder.path().join("new/kept"), folder.path().join("gone"));
        let keeper = Keeper::new(|| {}).unwrap();
        keeper.keep(&kept, Keep::Write("old".to_owned()));
        keeper.keep(&gone, Keep::Write("x".to_owned()));
        keeper.keep(&kept, Keep::Write("new".to_owned()));
        keeper.keep(&gone, Keep::Remove);
        keeper.keep(&gone, Keep::Remove);
        drop(keeper);
        assert_eq!(std::fs::read_to_string(&kept).unwrap(), "new");
        assert!(!gone.exists());
    }

    #[test]
    fn what_cannot_be_written_is_said_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        std::fs::write(&file, "").unwrap();
        let keeper = Keeper::new(|| {}).unwrap();
        keeper.keep(&file.join("below"), Keep::Write(String::new()));
        let ending = keeper.endings.recv().unwrap();
        assert!(ending.unwrap_err().contains("below"));
    }
}
