//! Threads beside the window's, each of a priority below it.

use std::io;
use std::thread::JoinHandle;

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::render::preview::priority::lower_thread_priority;

/// A pool of that many threads, one per core for none, each of that niceness.
pub(in crate::app) fn pool(
    name: &'static str,
    n_threads: usize,
    nice: i32,
) -> io::Result<ThreadPool> {
    ThreadPoolBuilder::new()
        .num_threads(n_threads)
        .thread_name(move |i| format!("{name}-{i}"))
        .start_handler(move |_| lower_thread_priority(nice))
        .build()
        .map_err(io::Error::other)
}

/// A thread of that niceness.
pub(in crate::app) fn spawn(
    name: &str,
    nice: i32,
    work: impl FnOnce() + Send + 'static,
) -> io::Result<JoinHandle<()>> {
    let thread = std::thread::Builder::new().name(name.to_owned());
    thread.spawn(move || {
        lower_thread_priority(nice);
        work();
    })
}
