//! Gives way to other threads of the same program.

/// Lowers the calling thread's priority: 0 is the window's, 19 gives way to everything.
#[cfg(target_os = "linux")]
pub fn lower_thread_priority(nice: i32) {
    // On Linux `None` is the calling thread, not the process.
    if let Err(error) = rustix::process::setpriority_process(None, nice) {
        tracing::debug!("cannot lower the priority: {error}");
    }
}

/// Elsewhere priorities are per process, which would slow the window too.
#[cfg(not(target_os = "linux"))]
pub fn lower_thread_priority(_nice: i32) {}
