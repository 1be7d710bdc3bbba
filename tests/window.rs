//! The real window on a display of its own: what a person does in the first minutes, by mouse and keys.
//!
//! Needs Xvfb, xdotool and a graphics adapter (lavapipe will do), and says so where one is missing; with
//! `NEIF_TEST_WINDOW=1` that is a failure. It waits for lines of the program's log, never for a time.
#![cfg(all(feature = "gui", target_os = "linux"))]
#![expect(clippy::print_stdout, reason = "tests report what they skip")]

#[path = "window/display.rs"]
mod display;
#[path = "window/program.rs"]
mod program;
#[path = "cli/splats.rs"]
mod splats;
#[path = "cli/without_masks.rs"]
mod without_masks;

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};

use display::{Display, Place, Shot};
use program::Program;

/// Training before anything is edited, seconds.
const TRAINED_SECS: f64 = 10.0;
/// Training before the object is looked for in the place, and with the object, seconds.
const PLACE_SECS: f64 = 15.0;
const OBJECT_SECS: f64 = 5.0;
/// Share of the viewport's pixels that an edit changes at least.
const LEAST_CHANGE: f64 = 0.01;
/// The same after an edit was taken back.
const MOST_LEFT: f64 = 0.005;
/// Share of the pixels about a stroke that its outline changes at least.
const LEAST_STROKED: f64 = 0.05;

#[test]
fn a_person_trains_edits_undoes_takes_a_picture_and_leaves() {
    let _alone = alone();
    let Some(display) = display() else { return };
    let home = tempfile::tempdir().expect("a folder");
    let mut window = open(&display, home.path(), &[]);
    window.wait(|line| elapsed_secs(line) >= Some(TRAINED_SECS));
    display.focus("neif");

    let mark = window.mark();
    display.key("space");
    window.wait_after(mark, |line| line.contains("PauseOrResume"));
    settled(&window, mark);
    let trained = drawn(&display, &window);
    assert!(trained.n_colors() > 100, "the viewport is empty");
    let own = display.shot(within_picture(window.place("As captured")));
    assert!(own.n_colors() > 40, "its environment has no picture");
    let differs = |from: &Shot, shown: &Shot| shown.difference(from) > LEAST_CHANGE;

    // That of roughness; there is more than one named “Scale”.
    let slider = window.place("Offset");
    let mark = understood(&window, "Edit(", || {
        display.drag(None, slider.at(0.3, 0.5), slider.at(0.5, 0.5));
    });
    shows(&display, &window, mark, sharp, |shown| {
        differs(&trained, shown)
    });

    // What is rough in a turned environment takes the longest to settle.
    let undone = || understood(&window, "History(Undo)", || display.key("ctrl+z"));
    let mark = undone();
    shows(&display, &window, mark, settled, |shown| {
        shown.difference(&trained) < MOST_LEFT
    });

    let viewport = window.place("viewport");
    let mark = understood(&window, "MoveEnvironment(", || {
        display.drag(Some("shift"), viewport.at(0.3, 0.2), viewport.at(0.6, 0.2));
    });
    let turned = shows(&display, &window, mark, settled, |shown| {
        differs(&trained, shown)
    });

    let tile = window.place("gallery");
    let mark = understood(&window, "ChooseEnvironment(", || {
        display.click(tile.at(0.5, 0.3));
    });
    shows(&display, &window, mark, sharp, |shown| {
        differs(&turned, shown)
    });

    let mark = undone();
    shows(&display, &window, mark, settled, |shown| {
        shown.difference(&turned) < MOST_LEFT
    });

    let mark = window.mark();
    display.key("F12");
    let written = window.wait_after(mark, |line| line.contains(".png"));
    assert!(!written.contains("ERROR"), "{written}");

    // A scan lights the object as soon as something is learned of it, and the object stands where one clicks.
    let scan = home.path().join("room.splat");
    splats::write_room(&scan);
    let mark = understood(&window, "AskPath(Open)", || display.key("ctrl+o"));
    // The field takes letters from the frame after its first.
    redraw(&display, &window);
    redraw(&display, &window);
    display.type_text(scan.to_str().expect("a path of plain letters"));
    display.key("Return");
    window.wait_after(mark, |line| line.contains("import event=Progress"));
    let lit = shows(&display, &window, mark, pictured, |shown| {
        differs(&turned, shown)
    });
    let mark = understood(&window, "ToggleSettingDown", || display.key("p"));
    let viewport = window.place("viewport");
    understood(&window, "SetDown", || {
        display.click(viewport.at(0.25, 0.8));
    });
    shows(&display, &window, mark, pictured, |shown| {
        differs(&lit, shown)
    });

    display.key("ctrl+q");
    // The bundled demo is nobody's work: nothing is asked.
    window.ends_well();
    let picture = png_below(home.path()).expect("a screenshot");
    assert!(image::open(&picture).is_ok(), "{}", picture.display());
}

#[test]
fn a_person_selects_the_object_of_photos_without_masks_mends_it_trains_and_edits() {
    let _alone = alone();
    let Some(display) = display() else { return };
    let home = tempfile::tempdir().expect("a folder");
    let capture = home.path().join("scene");
    without_masks::write_without_masks(&capture, 3);
    let capture = capture.to_str().expect("a path of plain letters");
    let window = open(&display, home.path(), &["view", capture]);
    let select = window.place("Select the object…");
    window.wait(|line| elapsed_secs(line) >= Some(PLACE_SECS));
    display.focus("neif");
    let mark = understood(&window, "Object(Select(true))", || {
        display.click(select.at(0.5, 0.5));
    });
    let rests = |line: &str| line.contains("object search rests");
    window.wait_after(mark, rests);

    // The middle ball, in the middle of the photo.
    let photo = window.place("object photo");
    let found = |line: &str| line.contains("object found");
    let mark = understood(&window, "Object(PointAt(", || {
        display.click(photo.at(0.5, 0.5));
    });
    window.wait_after(mark, found);
    window.wait_after(mark, rests);
    let before = outline(&display, &window, photo);
    assert!(before.n_colors() > 100, "there is no photo");

    // What is below it is table; it is taken for the ball's, and taken back.
    let table = photo.part(0.3..0.7, 0.8..1.0);
    let bare = outline(&display, &window, table);
    let mark = understood(&window, "Object(Lift)", || {
        display.drag(None, table.at(0.1, 0.5), table.at(0.9, 0.5));
    });
    window.wait_after(mark, found);
    window.wait_after(mark, rests);
    let change = outline(&display, &window, table).difference(&bare);
    assert!(
        change > LEAST_STROKED,
        "the outline does not follow: {change}"
    );
    let mark = understood(&window, "History(Undo)", || display.key("ctrl+z"));
    window.wait_after(mark, found);
    window.wait_after(mark, rests);
    let left = outline(&display, &window, photo).difference(&before);
    assert!(left < MOST_LEFT, "the stroke is still there: {left}");

    let train = window.place("Looks right: train");
    let mark = understood(&window, "Object(Train)", || {
        display.click(train.at(0.5, 0.5));
    });
    window.wait_after(mark, |line| line.contains("has_object: true"));
    window.wait_after(mark, |line| elapsed_secs(line) >= Some(OBJECT_SECS));
    let mark = understood(&window, "PauseOrResume", || display.key("space"));
    settled(&window, mark);
    let slider = window.place("Offset");
    let mark = understood(&window, "Edit(", || {
        display.drag(None, slider.at(0.3, 0.5), slider.at(0.5, 0.5));
    });
    pictured(&window, mark);
    assert!(
        drawn(&display, &window).n_colors() > 100,
        "the viewport is empty"
    );
}

/// One window at a time: two would share the processor.
fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    // A test that failed leaves nothing behind for the next.
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The photo with the object's outline, without the brush.
fn outline(display: &Display, window: &Program, photo: Place) -> Shot {
    // The picture follows the news by a frame or two.
    for _ in 0..3 {
        redraw(display, window);
    }
    display.shot(photo)
}

/// A display; none, with a line, where something that is needed is missing.
fn display() -> Option<Display> {
    let must = std::env::var_os("NEIF_TEST_WINDOW").is_some();
    let missing = ["Xvfb", "xdotool"].into_iter().find(|program| {
        let mut try_it = Command::new(program);
        let quiet = try_it.stdout(Stdio::null()).stderr(Stdio::null());
        quiet.arg("-version").status().is_err()
    });
    if let Some(program) = missing {
        assert!(!must, "{program} is missing");
        println!("skipped: there is no {program} to open a window and drive it");
        return None;
    }
    Some(Display::new())
}

/// Starts the program; without arguments it trains on the bundled demo.
fn open(display: &Display, home: &Path, arguments: &[&str]) -> Program {
    let settings = home.join(".config/neif");
    std::fs::create_dir_all(&settings).expect("a folder");
    let (width, height) = display::SIZE;
    let text = format!("window = [{width}.0, {height}.0]\n");
    std::fs::write(settings.join("settings.toml"), text).expect("a file");
    Program::start(display.name(), home, arguments)
}

/// Acts, and waits until it was understood; returns what came before in the log.
fn understood(window: &Program, command: &str, act: impl Fn()) -> usize {
    let mark = window.mark();
    act();
    window.wait_after(mark, |line| {
        line.contains("command=") && line.contains(command)
    });
    mark
}

/// The viewport as soon as it is right; until then pictures that were being made may come, so `wait` waits for the next.
fn shows(
    display: &Display,
    window: &Program,
    mut mark: usize,
    wait: fn(&Program, usize),
    is_right: impl Fn(&Shot) -> bool,
) -> Shot {
    loop {
        wait(window, mark);
        mark = window.mark();
        let shown = drawn(display, window);
        if is_right(&shown) {
            return shown;
        }
    }
}

/// Waits for any picture: while a scan is learned they never settle.
fn pictured(window: &Program, mark: usize) {
    window.wait_after(mark, |line| line.contains("preview name="));
}

/// Waits for a picture of full resolution, whatever refines it then.
fn sharp(window: &Program, mark: usize) {
    window.wait_after(mark, |line| {
        line.contains("preview name=") && line.contains(" scale=1 ")
    });
}

/// Waits for a picture that nothing better follows.
fn settled(window: &Program, mark: usize) {
    window.wait_quiet(mark, |line| {
        line.contains("preview name=") && line.contains("is_last=true")
    });
}

/// The viewport as it is drawn now.
fn drawn(display: &Display, window: &Program) -> Shot {
    redraw(display, window);
    display.shot(window.place("viewport"))
}

/// Waits for a frame that begins after now.
fn redraw(display: &Display, window: &Program) {
    let mark = window.mark();
    display.nudge();
    window.wait_after(mark, |line| line.contains(" drawing "));
}

/// The middle of a tile's picture, without its frame and the name below.
fn within_picture(tile: Place) -> Place {
    tile.part(0.1..0.9, 0.1..0.5)
}

/// Training time in a line about its progress.
fn elapsed_secs(line: &str) -> Option<f64> {
    let (_, rest) = line
        .split_once("Progress(")?
        .1
        .split_once("elapsed_secs: ")?;
    rest.split(',').next()?.parse().ok()
}

fn png_below(folder: &Path) -> Option<std::path::PathBuf> {
    let entries = std::fs::read_dir(folder).ok()?.flatten();
    entries.into_iter().find_map(|entry| {
        let path = entry.path();
        if path.is_dir() && !path.ends_with(".cache") {
            png_below(&path)
        } else {
            path.extension()
                .is_some_and(|extension| extension == "png")
                .then_some(path)
        }
    })
}
