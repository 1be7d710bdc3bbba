//! The one-way order of the modules: each may use only those before it.

use std::{collections::BTreeMap, fs, path::Path};

const ORDER: [&str; 7] = [
    "color", "geometry", "data", "neif", "render", "train", "app",
];

/// Longest source file that is accepted, in lines.
const MAX_LINES: usize = 600;
/// Most source files in one folder.
const MAX_FILES: usize = 15;

#[test]
fn modules_depend_only_on_earlier_ones() {
    let mut offences = Vec::new();
    for (rank, module) in ORDER.iter().enumerate() {
        // `use crate::{…}` would hide a name from this search, so it is refused too.
        let mut forbidden = vec!["crate::{".to_owned()];
        forbidden.extend(
            ORDER[rank + 1..]
                .iter()
                .map(|later| format!("crate::{later}")),
        );
        for path in [format!("src/{module}.rs"), format!("src/{module}")] {
            visit(Path::new(&path), &mut |path, text| {
                for (i, line) in text.lines().enumerate() {
                    if forbidden.iter().any(|name| line.contains(name.as_str())) {
                        offences.push(format!("{}:{}: {}", path.display(), i + 1, line.trim()));
                    }
                }
            });
        }
    }
    assert!(
        offences.is_empty(),
        "backward dependencies:\n{}",
        offences.join("\n")
    );
}

#[test]
fn every_source_file_says_what_it_is_and_stays_readable() {
    let mut offences = Vec::new();
    let mut n_files = 0;
    for folder in ["src", "tests", "benches"] {
        visit(Path::new(folder), &mut |path, text| {
            n_files += 1;
            if !text.starts_with("//!") {
                offences.push(format!("{}: no header", path.display()));
            }
            let n_lines = text.lines().count();
            if n_lines > MAX_LINES {
                offences.push(format!("{}: {n_lines} lines", path.display()));
            }
        });
    }
    assert!(n_files > 20, "the search found only {n_files} files");
    assert!(offences.is_empty(), "{}", offences.join("\n"));
}

#[test]
fn rooms_are_small_enough_to_know() {
    let mut n_in = BTreeMap::new();
    visit(Path::new("src"), &mut |path, _| {
        *n_in.entry(path.parent().map(Path::to_owned)).or_insert(0) += 1;
    });
    assert!(
        n_in.len() > 20,
        "the search found only {} folders",
        n_in.len()
    );
    n_in.retain(|_, n| *n > MAX_FILES);
    assert!(n_in.is_empty(), "{n_in:?}");
}

/// Calls `check` with every Rust file at or below `path`; nothing when there is none.
fn visit(path: &Path, check: &mut dyn FnMut(&Path, &str)) {
    if path.is_dir() {
        for entry in fs::read_dir(path).expect("readable source folder") {
            visit(&entry.expect("readable entry").path(), check);
        }
    } else if path.is_file() && path.extension().is_some_and(|e| e == "rs") {
        check(
            path,
            &fs::read_to_string(path).expect("readable source file"),
        );
    }
}
