//! A virtual display, its mouse and keys, and what it shows.

use std::io::{BufRead as _, BufReader};
use std::ops::Range;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

/// Width and height, pixels: the smallest window.
pub(crate) const SIZE: (usize, usize) = (960, 600);
/// Between two movements of the mouse.
const TICK: Duration = Duration::from_millis(30);
/// Largest difference of a channel of two pixels that count as equal.
const TOLERANCE: u8 = 12;

/// A rectangle on the display, pixels; `x` and `y` are its middle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) width: f64,
    pub(crate) height: f64,
}

impl Place {
    /// A point in it, both shares 0 to 1 from its left top.
    pub(crate) fn at(&self, across: f64, down: f64) -> (f64, f64) {
        (
            self.x + (across - 0.5) * self.width,
            self.y + (down - 0.5) * self.height,
        )
    }

    /// A part of it, both ranges 0 to 1 from its left top.
    pub(crate) fn part(&self, across: Range<f64>, down: Range<f64>) -> Self {
        let middle = |range: &Range<f64>| 0.5 * (range.start + range.end);
        let (x, y) = self.at(middle(&across), middle(&down));
        Self {
            x,
            y,
            width: (across.end - across.start) * self.width,
            height: (down.end - down.start) * self.height,
        }
    }
}

/// A part of what a display shows.
#[derive(Clone, Debug)]
pub(crate) struct Shot {
    pixels: Vec<[u8; 3]>,
}

impl Shot {
    /// Share of the pixels that differ.
    pub(crate) fn difference(&self, other: &Self) -> f64 {
        assert_eq!(self.pixels.len(), other.pixels.len(), "of the same size");
        let differs =
            |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|c| a[c].abs_diff(b[c]) > TOLERANCE);
        let n = self
            .pixels
            .iter()
            .zip(&other.pixels)
            .filter(differs)
            .count();
        n as f64 / self.pixels.len().max(1) as f64
    }

    pub(crate) fn n_colors(&self) -> usize {
        let mut colors = self.pixels.clone();
        colors.sort_unstable();
        colors.dedup();
        colors.len()
    }
}

/// An X server without a screen.
pub(crate) struct Display {
    server: Child,
    name: String,
    /// Holds what it shows, in a file.
    folder: tempfile::TempDir,
}

impl Display {
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let (width, height) = SIZE;
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-nolisten", "tcp", "-fbdir"])
            .arg(folder.path())
            .args(["-screen", "0", &format!("{width}x{height}x24")])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb starts");
        let mut number = String::new();
        let mut output = BufReader::new(server.stdout.take().expect("its output"));
        output.read_line(&mut number).expect("a display number");
        assert!(!number.trim().is_empty(), "Xvfb has no display");
        Self {
            server,
            name: format!(":{}", number.trim()),
            folder,
        }
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Keys go to the window of that title from now on.
    pub(crate) fn focus(&self, title: &str) {
        let found = self.tool(&["search", "--name", title]);
        let window = found.lines().next().expect("a window");
        self.tool(&["windowfocus", window]);
    }

    pub(crate) fn key(&self, key: &str) {
        self.tool(&["key", key]);
    }

    /// Types on the keyboard.
    pub(crate) fn type_text(&self, text: &str) {
        self.tool(&["type", "--delay", "12", text]);
    }

    pub(crate) fn move_to(&self, (x, y): (f64, f64)) {
        let [x, y] = [x, y].map(|v| format!("{v:.0}"));
        self.tool(&["mousemove", &x, &y]);
        sleep(TICK);
    }

    pub(crate) fn click(&self, at: (f64, f64)) {
        self.move_to(at);
        self.tool(&["click", "1"]);
    }

    /// Has the window under the mouse draw once more.
    pub(crate) fn nudge(&self) {
        for x in [4.0, 6.0] {
            self.move_to((x, 4.0));
        }
    }

    /// With the left button, while a key is held if one is named.
    pub(crate) fn drag(&self, key: Option<&str>, from: (f64, f64), to: (f64, f64)) {
        let hold = |what| key.map(|key| self.tool(&[what, key]));
        self.move_to(from);
        hold("keydown");
        self.tool(&["mousedown", "1"]);
        for i in 0..=10 {
            let t = f64::from(i) / 10.0;
            self.move_to((from.0 + t * (to.0 - from.0), from.1 + t * (to.1 - from.1)));
        }
        self.tool(&["mouseup", "1"]);
        hold("keyup");
    }

    /// What it shows there.
    pub(crate) fn shot(&self, place: Place) -> Shot {
        let file = std::fs::read(self.folder.path().join("Xvfb_screen0")).expect("its screen");
        // The header of an X window dump: big-endian words.
        let word = |i: usize| {
            let bytes = file[4 * i..4 * i + 4].try_into().expect("four bytes");
            u32::from_be_bytes(bytes) as usize
        };
        let (header, row_bytes, n_colors) = (word(0), word(12), word(19));
        let start = header + 12 * n_colors;
        let (left, top) = place.at(0.0, 0.0);
        let (right, bottom) = place.at(1.0, 1.0);
        let (columns, rows) = (left as usize..right as usize, top as usize..bottom as usize);
        let pixel = |x: usize, y: usize| {
            let at = start + y * row_bytes + 4 * x;
            [file[at + 2], file[at + 1], file[at]]
        };
        let pixels = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
        Shot {
            pixels: pixels.map(|(x, y)| pixel(x, y)).collect(),
        }
    }

    fn tool(&self, arguments: &[&str]) -> String {
        let mut tool = Command::new("xdotool");
        let output = tool.args(arguments).env("DISPLAY", &self.name).output();
        let output = output.expect("xdotool runs");
        assert!(output.status.success(), "xdotool {arguments:?}: {output:?}");
        String::from_utf8_lossy(&output.stdout).into_owned()
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        // It may have ended by itself.
        self.server.kill().unwrap_or_default();
        drop(self.server.wait());
    }
}
