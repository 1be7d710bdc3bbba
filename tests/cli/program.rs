//! Runs the built program and looks at what it did.

use std::{
    io::{BufRead as _, BufReader, Read as _},
    path::Path,
    process::{Command, Output, Stdio},
};

use serde_json::Value;

/// How a run of the program ended.
#[derive(Debug)]
pub(crate) struct Run {
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Run {
    /// The run, which must have ended with code 0.
    pub(crate) fn succeeds(self) -> Self {
        assert_eq!(self.code, 0, "{}\n{}", self.stdout, self.stderr);
        self
    }

    /// The whole output as one JSON value.
    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.stdout).expect("the output is one JSON value")
    }

    /// The output as one JSON value a line.
    pub(crate) fn json_lines(&self) -> Vec<Value> {
        let parse = |line| serde_json::from_str(line).expect("every line is JSON");
        self.stdout.lines().map(parse).collect()
    }
}

/// Runs the program to its end.
pub(crate) fn neif(args: &[&str]) -> Run {
    neif_in(Path::new("."), args)
}

/// Runs the program in a folder to its end.
pub(crate) fn neif_in(folder: &Path, args: &[&str]) -> Run {
    let output = command(args).current_dir(folder).output();
    run_of(&output.expect("the program starts"))
}

fn run_of(output: &Output) -> Run {
    Run {
        code: output.status.code().unwrap_or(-1),
        stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

/// Runs the program and presses Ctrl-C once it has written a line that contains `sign`.
pub(crate) fn interrupted_after(args: &[&str], sign: &str) -> Run {
    let mut command = command(args);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("the program starts");
    let mut lines = BufReader::new(child.stdout.take().expect("an output")).lines();
    let mut stdout = String::new();
    for line in lines.by_ref() {
        let line = line.expect("text");
        stdout.extend([&line, "\n"]);
        if line.contains(sign) {
            break;
        }
    }
    press_ctrl_c(child.id());
    for line in lines {
        stdout.extend([&line.expect("text"), "\n"]);
    }
    let mut stderr = String::new();
    let errors = child.stderr.take().expect("an error output");
    BufReader::new(errors)
        .read_to_string(&mut stderr)
        .expect("text");
    Run {
        code: child.wait().expect("an end").code().unwrap_or(-1),
        stdout,
        stderr,
    }
}

/// Runs the program with this search path to its end.
pub(crate) fn neif_with_path(path: &str, args: &[&str]) -> Run {
    let output = command(args).env("PATH", path).output();
    run_of(&output.expect("the program starts"))
}

/// Runs the program in a folder with the library in another one to its end.
pub(crate) fn neif_with_library(library: &Path, folder: &Path, args: &[&str]) -> Run {
    let mut command = command(args);
    command.current_dir(folder).env("NEIF_LIBRARY", library);
    run_of(&command.output().expect("the program starts"))
}

/// Runs the program and presses Ctrl-C once it has noted progress with `sign` in it.
pub(crate) fn interrupted_while_noting(args: &[&str], sign: &str) -> Run {
    let mut command = command(args);
    command.stdout(Stdio::null()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("the program starts");
    let mut stderr = String::new();
    let notes = BufReader::new(child.stderr.take().expect("an error output"));
    let mut is_pressed = false;
    for note in notes.lines() {
        let note = note.expect("text");
        stderr.extend([&note, "\n"]);
        if !is_pressed && note.contains(sign) {
            is_pressed = true;
            press_ctrl_c(child.id());
        }
    }
    Run {
        code: child.wait().expect("an end").code().unwrap_or(-1),
        stdout: String::new(),
        stderr,
    }
}

fn press_ctrl_c(process: u32) {
    let pid = process.to_string();
    let kill = Command::new("kill").args(["-INT", &pid]).status();
    assert!(kill.is_ok_and(|status| status.success()), "kill {pid}");
}

/// True when two picture files show exactly the same.
pub(crate) fn same_picture(a: &Path, b: &Path) -> bool {
    let open = |path: &Path| image::open(path).expect("a picture").to_rgb8();
    open(a) == open(b)
}

fn command(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_neif"));
    command.args(args);
    command.env_remove("NEIF_LOG").env_remove("NEIF_LPIPS");
    command
}
