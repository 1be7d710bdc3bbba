//! The program with its window, and its log.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{JoinHandle, sleep};
use std::time::{Duration, Instant};

use super::display::Place;

/// How long anything may take.
const PATIENCE: Duration = Duration::from_mins(4);
/// Between two looks at the log.
const TICK: Duration = Duration::from_millis(20);
/// Without another picture for so long, the one that is shown stays.
const QUIET: Duration = Duration::from_millis(600);
/// What no line of the log may hold.
const FAULTS: [&str; 5] = [
    "panicked",
    "ERROR",
    "wgpu error",
    "Validation Error",
    // Said where Wayland is looked for in vain.
    "XDG_RUNTIME_DIR",
];

/// The running program; killed when dropped.
pub(crate) struct Program {
    child: Child,
    lines: Arc<Mutex<Vec<String>>>,
    reader: Option<JoinHandle<()>>,
}

impl Program {
    /// Starts it with these arguments.
    pub(crate) fn start(display: &str, home: &Path, arguments: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_neif"))
            .args(arguments)
            .env("DISPLAY", display)
            .env("HOME", home)
            .env("NEIF_LOG", "warn,neif=trace")
            .env("NO_COLOR", "1")
            .env("WINIT_X11_SCALE_FACTOR", "1")
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("WAYLAND_SOCKET")
            .env_remove("XDG_RUNTIME_DIR")
            .env_remove("XDG_CONFIG_HOME")
            .env_remove("XDG_CACHE_HOME")
            .env_remove("XDG_DATA_HOME")
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let errors = BufReader::new(child.stderr.take().expect("its log"));
        let lines = Arc::new(Mutex::new(Vec::new()));
        let theirs = Arc::clone(&lines);
        let read = move || {
            for line in errors.lines().map_while(Result::ok) {
                theirs
                    .lock()
                    .unwrap_or_else(PoisonError::into_inner)
                    .push(line);
            }
        };
        let reader = std::thread::Builder::new().spawn(read).expect("a thread");
        Self {
            child,
            lines,
            reader: Some(reader),
        }
    }

    /// The number of lines so far.
    pub(crate) fn mark(&self) -> usize {
        self.with(<[String]>::len)
    }

    /// The first line that answers; a failure where none comes.
    pub(crate) fn wait(&self, is_it: impl Fn(&str) -> bool) -> String {
        self.wait_after(0, is_it)
    }

    /// The same among the lines after a mark.
    pub(crate) fn wait_after(&self, mark: usize, is_it: impl Fn(&str) -> bool) -> String {
        let end = Instant::now() + PATIENCE;
        let mut looked_at = mark;
        loop {
            let found = self.with(|lines| {
                let found = lines[looked_at..].iter().find(|line| is_it(line)).cloned();
                looked_at = lines.len();
                found
            });
            if let Some(found) = found {
                return found;
            }
            self.check();
            assert!(Instant::now() < end, "waited in vain; {}", self.end());
            sleep(TICK);
        }
    }

    /// Waits until such a line has come after a mark, and for a while no other one of a picture.
    pub(crate) fn wait_quiet(&self, mark: usize, is_it: impl Fn(&str) -> bool) {
        let mut mark = mark;
        loop {
            self.wait_after(mark, &is_it);
            mark = self.mark();
            sleep(QUIET);
            let is_quiet = self.with(|lines| {
                let later = &lines[mark..];
                !later.iter().any(|line| line.contains("preview name="))
            });
            if is_quiet {
                return;
            }
        }
    }

    /// Where a control was drawn last.
    pub(crate) fn place(&self, name: &str) -> Place {
        let named = format!(" place name=\"{name}\" ");
        let end = Instant::now() + PATIENCE;
        loop {
            let line = self.with(|lines| {
                let mut newest = lines.iter().rev();
                newest.find(|line| line.contains(&named)).cloned()
            });
            if let Some(line) = line {
                let value = |key: &str| {
                    let (_, rest) = line.split_once(key)?;
                    rest.split(' ').next()?.parse::<f64>().ok()
                };
                let value = |key| value(key).unwrap_or_else(|| panic!("no{key}in {line}"));
                return Place {
                    x: value(" x="),
                    y: value(" y="),
                    width: value(" width="),
                    height: value(" height="),
                };
            }
            self.check();
            assert!(Instant::now() < end, "{name} is nowhere; {}", self.end());
            sleep(TICK);
        }
    }

    /// Waits until it has ended by itself, without a fault.
    pub(crate) fn ends_well(&mut self) {
        let end = Instant::now() + PATIENCE;
        let status = loop {
            if let Some(status) = self.child.try_wait().expect("its status") {
                break status;
            }
            assert!(Instant::now() < end, "it does not end; {}", self.end());
            sleep(TICK);
        };
        if let Some(reader) = self.reader.take() {
            reader.join().expect("its log was read");
        }
        assert!(status.success(), "{status}; {}", self.end());
        self.with(find_fault);
    }

    /// Fails where the program has.
    fn check(&self) {
        self.with(find_fault);
    }

    fn with<T>(&self, look: impl FnOnce(&[String]) -> T) -> T {
        look(&self.lines.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// The end of the log, without what is drawn.
    fn end(&self) -> String {
        self.with(|lines| {
            let shown = lines
                .iter()
                .filter(|line| !line.contains(" place name=") && !line.contains(" drawing "));
            let shown: Vec<&str> = shown.map(String::as_str).collect();
            let tail = shown[shown.len().saturating_sub(30)..].join("\n");
            format!("the log ends with\n{tail}")
        })
    }
}

fn find_fault(lines: &[String]) {
    let is_fault = |line: &&String| FAULTS.iter().any(|fault| line.contains(fault));
    let fault = lines.iter().find(is_fault);
    assert!(fault.is_none(), "{fault:?}");
}

impl Drop for Program {
    fn drop(&mut self) {
        // It may have ended by itself.
        self.child.kill().unwrap_or_default();
        drop(self.child.wait());
    }
}
