//! Writes small text files on a thread of its own, one after the other, each whole or not at all.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;

use crossbeam::channel::{Receiver, Sender, bounded};

use crate::data::write_atomically;

/// Files that may wait; a person cannot ask for more in the time that one takes.
const QUEUE: usize = 64;

/// What to do with a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Keep {
    /// Write this text; the folder is made where it is missing.
    Write(String),
    /// Remove it, if it is there.
    Remove,
}

/// What became of it.
#[derive(Debug)]
pub struct Kept {
    /// The file.
    pub path: PathBuf,
    /// Why it could not be done, with the file's name.
    pub result: Result<(), String>,
}

/// The thread's handle; dropping it waits until all is written.
#[derive(Debug)]
pub struct Keeper {
    jobs: Option<Sender<(PathBuf, Keep)>>,
    results: Receiver<Kept>,
    thread: Option<JoinHandle<()>>,
}

impl Keeper {
    /// Starts the thread; `wake` is called after each file.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn new(wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let (jobs, queue) = bounded::<(PathBuf, Keep)>(QUEUE);
        let (sender, results) = bounded(QUEUE);
        let thread = std::thread::Builder::new()
            .name("neif-keep".to_owned())
            .spawn(move || {
                for (path, keep) in queue {
                    let result = carry_out(&path, &keep)
                        .map_err(|error| format!("{}: cannot be written: {error}", path.display()));
                    // A full queue means that nobody listens; the files matter more.
                    if sender.try_send(Kept { path, result }).is_ok() {
                        wake();
                    }
                }
            })?;
        Ok(Self {
            jobs: Some(jobs),
            results,
            thread: Some(thread),
        })
    }

    /// Queues a file. Never waits.
    pub fn keep(&self, path: &Path, keep: Keep) {
        let Some(jobs) = &self.jobs else { return };
        if jobs.try_send((path.to_owned(), keep)).is_err() {
            tracing::warn!("{}: not written: too many files wait", path.display());
        }
    }

    /// The next file that is done, if there is one.
    pub fn next(&self) -> Option<Kept> {
        self.results.try_recv().ok()
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
    fn what_cannot_be_written_is_told_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        std::fs::write(&file, "").unwrap();
        let keeper = Keeper::new(|| {}).unwrap();
        keeper.keep(&file.join("below"), Keep::Write(String::new()));
        let kept = keeper.results.recv().unwrap();
        assert!(kept.result.unwrap_err().contains("below"));
    }
}
