//! The one-way order of the modules, each of which may use only those before it; the size of rooms and files; what is built in.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

const ORDER: [&str; 8] = [
    "color", "geometry", "data", "neif", "scans", "render", "train", "app",
];

/// Longest source file that is accepted, in lines.
const MAX_LINES: usize = 500;
/// Dependencies of dependencies that are listed for their features alone: `winit`'s Wayland without a library to link.
const FOR_FEATURES: [&str; 1] = ["winit"];
/// Licences of dependencies that allow use in a program under MIT or Apache-2.0; MPL-2.0 asks only for its own files' source.
const LICENCES: [&str; 10] = [
    "Apache-2.0",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "ISC",
    "MIT",
    "MPL-2.0",
    "OFL-1.1",
    "Ubuntu-font-1.0",
    "Unicode-3.0",
    "Zlib",
];
/// Where dependencies come from.
const REGISTRY: &str = "registry+https://github.com/rust-lang/crates.io-index";
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

#[test]
fn every_source_file_that_is_named_exists() {
    let (mut files, mut texts) = (BTreeSet::new(), Vec::new());
    for place in [
        "src",
        "tests",
        "benches",
        "examples",
        "fuzz/fuzz_targets",
        "docs",
    ] {
        walk(Path::new(place), &mut |path| {
            files.insert(path.to_string_lossy().replace('\\', "/"));
        });
    }
    texts.extend(files.iter().map(PathBuf::from));
    texts.extend(["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md"].map(PathBuf::from));
    texts.retain(|path| {
        let kinds = ["md", "rs", "wgsl"];
        path.extension()
            .is_some_and(|e| kinds.iter().any(|kind| e == *kind))
    });
    let mut n_named = 0;
    let mut offences = Vec::new();
    for path in texts {
        let text = fs::read_to_string(&path).expect("readable text");
        // Between backticks is every second piece of a line.
        let quoted = text
            .lines()
            .flat_map(|line| line.split('`').skip(1).step_by(2));
        for name in quoted {
            let is_path = Path::new(name).extension().is_some_and(|e| e == "rs")
                && !name.contains(['*', '{', '<', ' ']);
            let end = format!("/{name}");
            n_named += usize::from(is_path);
            let is_named = |file: &String| file == name || file.ends_with(&end);
            if is_path && !files.iter().any(is_named) {
                offences.push(format!("{}: {name}", path.display()));
            }
        }
    }
    assert!(n_named > 100, "the search found only {n_named} names");
    assert!(offences.is_empty(), "{}", offences.join("\n"));
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let modules = modules();
    let mut imports: BTreeMap<&Path, BTreeSet<&Path>> = BTreeMap::new();
    for (module, text) in &modules {
        let known = |path: &Path| {
            let mut above = path.ancestors().filter(|path| *path != Path::new(""));
            above.find_map(|path| modules.get_key_value(path))
        };
        let named = paths_in(text);
        let found = named
            .iter()
            .filter_map(|path| known(&resolved(path, module)));
        let is_kin = |other: &Path| other.starts_with(module) || module.starts_with(other);
        let others = found.map(|(other, _)| other.as_path());
        imports.insert(module, others.filter(|other| !is_kin(other)).collect());
    }
    let n_imports: usize = imports.values().map(BTreeSet::len).sum();
    assert!(n_imports > 500, "the search found only {n_imports} imports");
    // What imports nothing is in no circle, nor what is left without an import then; the same the other way round.
    loop {
        let n = imports.len();
        let left: BTreeSet<&Path> = imports.keys().copied().collect();
        for others in imports.values_mut() {
            others.retain(|other| left.contains(other));
        }
        imports.retain(|_, others| !others.is_empty());
        let wanted: BTreeSet<&Path> = imports.values().flatten().copied().collect();
        imports.retain(|module, _| wanted.contains(module));
        if imports.len() == n {
            break;
        }
    }
    assert!(imports.is_empty(), "circles among {imports:#?}");
}

#[test]
fn every_dependency_is_used() {
    let manifest = fs::read_to_string("Cargo.toml").expect("the manifest");
    let mut names = Vec::new();
    let mut is_listed = false;
    for line in manifest.lines() {
        if line.starts_with('[') {
            is_listed = line.ends_with("dependencies]");
        } else if let Some((name, _)) = line.split_once(" = ").filter(|_| is_listed) {
            names.push(name.replace('-', "_"));
        }
    }
    assert!(names.len() > 20, "the search found only {names:?}");
    for folder in ["src", "tests"] {
        visit(Path::new(folder), &mut |_, text| {
            names.retain(|name| {
                let paths = [format!("{name}::"), format!("use {name};")];
                !paths.iter().any(|path| text.contains(path))
            });
        });
    }
    names.retain(|name| !FOR_FEATURES.contains(&name.as_str()));
    assert!(names.is_empty(), "used nowhere: {names:?}");
}

#[test]
fn every_dependency_is_from_crates_io_under_a_licence_that_allows_it() {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["metadata", "--format-version=1", "--locked", "--offline"]);
    let output = cargo.arg("--filter-platform=host-tuple").output();
    let output = output.expect("cargo runs").stdout;
    let metadata: Value = serde_json::from_slice(&output).expect("metadata");
    let packages = metadata["packages"].as_array().expect("packages");
    assert!(packages.len() > 200, "only {} packages", packages.len());
    let mut offences = Vec::new();
    for package in packages.iter().filter(|p| p["name"] != "neif") {
        let [name, licence, source] = ["name", "license", "source"].map(|key| &package[key]);
        if source != REGISTRY || !licence.as_str().is_some_and(is_allowed) {
            offences.push(format!("{name}: {licence} from {source}"));
        }
    }
    assert!(offences.is_empty(), "{}", offences.join("\n"));
}

/// Whether an SPDX expression leaves an allowed choice. One without parentheses is read as if its `OR` bound tighter, which
/// allows less.
fn is_allowed(expression: &str) -> bool {
    let is_known = |licence: &str| {
        let licence = licence.trim().trim_matches(['(', ')']);
        LICENCES.contains(&licence)
    };
    let any = |choices: &str| {
        choices
            .split(" OR ")
            .flat_map(|c| c.split('/'))
            .any(is_known)
    };
    expression.split(" AND ").all(any)
}

/// The modules of the library by their paths below `src`, with their text but for tests.
fn modules() -> BTreeMap<PathBuf, String> {
    let mut modules = BTreeMap::new();
    let mut tests = BTreeSet::new();
    visit(Path::new("src"), &mut |path, text| {
        let path = path.strip_prefix("src").expect("below it");
        let module = if path.ends_with("mod.rs") {
            path.parent().expect("a folder").to_owned()
        } else {
            path.with_extension("")
        };
        let lines: Vec<&str> = text.lines().collect();
        let of_tests = lines.windows(2).filter(|two| two[0] == "#[cfg(test)]");
        for name in of_tests.filter_map(|two| two[1].split("mod ").nth(1)?.strip_suffix(';')) {
            tests.insert(module.join(name));
        }
        let mut code = String::new();
        let mut is_test = false;
        for (i, line) in lines.iter().enumerate() {
            is_test |=
                *line == "#[cfg(test)]" && lines.get(i + 1).is_some_and(|l| l.ends_with('{'));
            if !is_test && !line.trim_start().starts_with("//") {
                code.push_str(line);
                code.push('\n');
            }
            is_test &= *line != "}";
        }
        modules.insert(module, code);
    });
    for main in ["main", "lib"] {
        modules.remove(Path::new(main));
    }
    modules.retain(|module, _| !tests.contains(module));
    modules
}

/// The paths that a file names: what it imports, and what it calls by a path from `crate`, `super` or `self`.
fn paths_in(text: &str) -> Vec<String> {
    let mut paths = Vec::new();
    for statement in text.split_inclusive(';') {
        let start = statement.find("use ").filter(|at| {
            let line = statement[..*at].rsplit('\n').next().unwrap_or_default();
            line.trim_start().is_empty() || line.trim_start().starts_with("pub")
        });
        if let Some(start) = start {
            let tree: String = statement[start + 4..].split_whitespace().collect();
            expand("", tree.trim_end_matches(';'), &mut paths);
        }
        let words = statement[..start.unwrap_or(statement.len())]
            .split(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':'));
        let is_path = |word: &&str| {
            ["crate::", "super::", "self::"]
                .iter()
                .any(|s| word.starts_with(s))
        };
        paths.extend(words.filter(is_path).map(str::to_owned));
    }
    paths
}

/// Adds the paths of a tree of imports.
fn expand(prefix: &str, tree: &str, paths: &mut Vec<String>) {
    let Some((head, inner)) = tree.split_once('{') else {
        paths.push(format!("{prefix}{tree}"));
        return;
    };
    let (mut depth, mut from) = (0, 0);
    let inner = inner.strip_suffix('}').unwrap_or(inner);
    for (at, c) in inner.char_indices().chain([(inner.len(), ',')]) {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                expand(&format!("{prefix}{head}"), &inner[from..at], paths);
                from = at + 1;
            }
            _ => (),
        }
    }
}

/// A path as it is meant in a module, below `src`; what is not of this crate leads nowhere.
fn resolved(path: &str, module: &Path) -> PathBuf {
    let mut place = module.to_owned();
    for name in path.split("::") {
        match name {
            "crate" => place = PathBuf::new(),
            "super" => _ = place.pop(),
            "self" => (),
            _ => place.push(name),
        }
    }
    place
}

/// Calls `check` with every Rust file at or below `path`; nothing when there is none.
fn visit(path: &Path, check: &mut dyn FnMut(&Path, &str)) {
    walk(path, &mut |path| {
        if path.extension().is_some_and(|e| e == "rs") {
            check(
                path,
                &fs::read_to_string(path).expect("readable source file"),
            );
        }
    });
}

/// Calls `check` with every file at or below `path`; nothing when there is none.
fn walk(path: &Path, check: &mut dyn FnMut(&Path)) {
    if path.is_dir() {
        for entry in fs::read_dir(path).expect("readable folder") {
            walk(&entry.expect("readable entry").path(), check);
        }
    } else if path.is_file() {
        check(path);
    }
}
