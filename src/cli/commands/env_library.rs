//! `neif env list`, `add` and `remove`: the library of environments.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use neif::neif::distant::{ImportOptions, Imported, import_environment, is_environment_file};
use neif::neif::{Environment, Storage};
use neif::render::library::{Entry, Library, environment_name};
use neif::scans::Scan;
use neif::train::session::saved::run_folder::ENVIRONMENT;
use serde_json::{Value, json};

use crate::cli::failure::{Failure, OrUnusable as _};
use crate::cli::library::failure;
use crate::cli::output;
use crate::cli::place::AboutArgs;

#[derive(Debug, clap::Args)]
pub(crate) struct EnvListArgs {
    /// Write JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
pub(crate) struct EnvAddArgs {
    /// An environment file, a run folder, or a panorama (.hdr, .exr, .png, .jpg), z up
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// What it is called [default: the file's name, or the run folder's]; with a number where another one is called so
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    #[command(flatten)]
    about: AboutArgs,
}

#[derive(Debug, clap::Args)]
pub(crate) struct EnvRemoveArgs {
    /// What it is called
    #[arg(value_name = "NAME")]
    name: String,
}

pub(crate) fn list(args: &EnvListArgs) -> Result<(), Failure> {
    let library = Library::of_system();
    let entries = library.entries().map_err(failure)?;
    let described: Vec<Described<'_>> = entries.iter().map(Described::of).collect();
    if args.json {
        let folder = library.folder().map(Path::to_string_lossy);
        let environments: Vec<Value> = described.iter().map(Described::json).collect();
        output::json_line(&json!({"folder": folder, "environments": environments}))?;
    } else {
        let header = "| name | kind | MB | origin | licence | path |";
        output::table(header, described.iter().map(Described::row))?;
    }
    for problem in described.iter().flat_map(|described| &described.problems) {
        output::note(problem);
    }
    Ok(())
}

/// An environment of the library with what its file says.
struct Described<'a> {
    entry: &'a Entry,
    /// None where the file is no environment.
    kind: Option<String>,
    bytes: Option<u64>,
    problems: Vec<String>,
}

impl<'a> Described<'a> {
    fn of(entry: &'a Entry) -> Self {
        let mut problems = Vec::from_iter(entry.problem.clone());
        let kind = entry
            .kind()
            .map_err(|error| problems.push(error.to_string()));
        let metadata = std::fs::metadata(&entry.file);
        Self {
            entry,
            kind: kind.ok().map(|kind| kind.to_string()),
            bytes: metadata.ok().map(|metadata| metadata.len()),
            problems,
        }
    }

    fn json(&self) -> Value {
        let (entry, record) = (self.entry, &self.entry.record);
        json!({
            "name": entry.name,
            "kind": self.kind,
            "bundled": entry.is_bundled,
            "bytes": self.bytes,
            "origin": record.origin,
            "licence": record.licence,
            "added_unix_secs": record.added_unix_secs,
            "path": entry.file.to_string_lossy(),
            "problems": self.problems,
        })
    }

    fn row(&self) -> String {
        let (entry, record) = (self.entry, &self.entry.record);
        let origin = record.origin.as_deref();
        let origin = match (entry.is_bundled, origin) {
            (true, Some(origin)) => format!("bundled: {origin}"),
            (true, None) => "bundled".to_owned(),
            (false, origin) => origin.unwrap_or_default().to_owned(),
        };
        let size = self.bytes.map(|bytes| format!("{:.1}", bytes as f64 / 1e6));
        let cells = [
            &entry.name,
            self.kind.as_deref().unwrap_or("unusable"),
            &size.unwrap_or_default(),
            &origin,
            record.licence.as_deref().unwrap_or_default(),
            &entry.file.to_string_lossy(),
        ];
        format!("| {} |", cells.map(cell).join(" | "))
    }
}

/// A text that stays within its cell of a table.
fn cell(text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    words.join(" ").replace('|', "\\|")
}

pub(crate) fn add(args: &EnvAddArgs) -> Result<(), Failure> {
    let library = Library::of_system();
    library.made_folder().map_err(failure)?;
    let inside = args.file.join(ENVIRONMENT);
    let file = if inside.is_file() {
        &inside
    } else {
        &args.file
    };
    if !is_environment_file(file) && Scan::is_scan(file) {
        let import = format!("`neif env import {} --out library`", file.display());
        let what = format!("a scan, which an environment is trained on: {import}");
        return Err(Failure::at(file, what));
    }
    let name = args.name.clone().unwrap_or_else(|| environment_name(file));
    let record = args.about.record(Some(&name), &args.file);
    let entry = if file
        .extension()
        .is_some_and(|ending| ending == "safetensors")
    {
        let environment = Arc::new(Environment::load(file).or_unusable()?);
        library.add_file(file, &environment, record)
    } else {
        let imported = import_environment(file, &ImportOptions::default()).or_unusable()?;
        let Imported {
            environment,
            notices,
        } = imported;
        for notice in notices {
            output::note(&format!("{}: {notice}", file.display()));
        }
        let environment = Arc::new(environment.renamed(&name));
        library.add(&environment, Storage::default(), record)
    };
    let entry = entry.map_err(failure)?;
    output::line(&format!("{}: {}", entry.name, entry.file.display()))?;
    Ok(())
}

pub(crate) fn remove(args: &EnvRemoveArgs) -> Result<(), Failure> {
    let entry = Library::of_system().remove(&args.name).map_err(failure)?;
    output::line(&format!("{}: removed", entry.name))?;
    Ok(())
}
