//! What environments are called, as files and in lists.

use std::path::Path;

/// Most characters of a file's name without its ending; at four bytes each they fit where 255 bytes may be used.
const MOST_CHARS: usize = 50;
/// What a name without a usable character becomes.
const NAMELESS: &str = "environment";
/// What Windows keeps for devices, with any ending; `COM1` and the like come on top.
const DEVICES: [&str; 4] = ["CON", "PRN", "AUX", "NUL"];

/// The name of the environment in a file. Runs all call theirs the same; the folder's name says more.
pub fn environment_name(path: &Path) -> String {
    let text = |name: &std::ffi::OsStr| name.to_string_lossy().into_owned();
    let stem = text(path.file_stem().unwrap_or(path.as_os_str()));
    match path.parent().and_then(Path::file_name) {
        Some(folder) if stem == NAMELESS => text(folder),
        _ => stem,
    }
}

/// A name as it may stand before the ending of a file's name, on any system: without separators, wildcards, control
/// characters, and dots or spaces at its ends.
pub(super) fn file_name(name: &str) -> String {
    let is_bad = |c: char| c.is_control() || r#"/\:*?"<>|"#.contains(c);
    let is_edge = |c: char| c == '.' || c.is_whitespace();
    let usable: String = name
        .trim_matches(is_edge)
        .chars()
        .map(|c| if is_bad(c) { '_' } else { c })
        .take(MOST_CHARS)
        .collect();
    let usable = usable.trim_end_matches(is_edge);
    if usable.is_empty() {
        NAMELESS.to_owned()
    } else if is_device(usable) {
        format!("_{usable}")
    } else {
        usable.to_owned()
    }
}

fn is_device(name: &str) -> bool {
    let stem = name.split('.').next().unwrap_or(name).trim_end();
    let stem = stem.to_ascii_uppercase();
    let is_port = |kind| {
        let number = stem.strip_prefix(kind);
        number.is_some_and(|n| n.len() == 1 && n.chars().all(|c| c.is_ascii_digit()))
    };
    DEVICES.contains(&stem.as_str()) || is_port("COM") || is_port("LPT")
}

/// What makes a name one that is not taken: nothing, or the first of ` 2`, ` 3`, … that does.
pub(super) fn free_suffix(is_taken: impl Fn(&str) -> bool) -> String {
    let numbered = (2..).map(|n: u64| format!(" {n}"));
    let mut suffixes = std::iter::once(String::new()).chain(numbered);
    let free = suffixes.find(|suffix| !is_taken(suffix));
    free.expect("more numbers than files")
}

/// Brings the names that are most like `name` to the front.
pub(super) fn sort_by_likeness(names: &mut [String], name: &str) {
    let name = name.to_lowercase();
    names.sort_by_cached_key(|other| edit_distance(&name, &other.to_lowercase()));
}

/// The least number of characters to insert, delete or replace that makes `b` of `a` (Levenshtein's distance).
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, from) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, to) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(from != *to);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_s_environment_is_called_like_its_folder() {
        for (path, name) in [
            ("runs/vase/environment.safetensors", "vase"),
            ("room.safetensors", "room"),
            ("environment.safetensors", "environment"),
        ] {
            assert_eq!(environment_name(Path::new(path)), name, "{path}");
        }
    }

    #[test]
    fn file_names_are_safe_on_any_system() {
        for (name, expected) in [
            ("studio 1.5", "studio 1.5"),
            ("../../etc/passwd", "_.._etc_passwd"),
            (r"C:\light", "C__light"),
            (" .hidden. ", "hidden"),
            ("a\n\0b", "a__b"),
            ("...", "environment"),
            ("", "environment"),
            ("nul.tar", "_nul.tar"),
            ("Com1", "_Com1"),
            ("comet", "comet"),
            ("Café – Abend", "Café – Abend"),
        ] {
            assert_eq!(file_name(name), expected, "{name:?}");
        }
        let long = file_name(&"ü".repeat(400));
        assert_eq!(long.chars().count(), MOST_CHARS);
    }

    #[test]
    fn taken_names_are_numbered() {
        let taken = ["room", "room 2"];
        let free = |name: &str| free_suffix(|suffix| taken.contains(&&*format!("{name}{suffix}")));
        assert_eq!([free("room"), free("hall")], [" 3", ""].map(String::from));
    }

    #[test]
    fn what_was_nearly_typed_comes_first() {
        for (a, b, expected) in [
            ("", "abc", 3),
            ("kitten", "sitting", 3),
            ("flaw", "lawn", 2),
            ("a", "a", 0),
        ] {
            assert_eq!(edit_distance(a, b), expected, "{a} {b}");
            assert_eq!(edit_distance(b, a), expected, "{b} {a}");
        }
        let mut names = ["attic", "Galery", "gallery"].map(String::from);
        sort_by_likeness(&mut names, "galery");
        assert_eq!(names, ["Galery", "gallery", "attic"].map(String::from));
    }
}
