//! `neif info`: what a path is, and what is wrong with it.

use std::path::{Path, PathBuf};

use neif::data::{Dataset, LoadOptions, check};
use neif::neif::distant::is_environment_file;
use neif::neif::{Environment, SurfaceField};
use neif::scans::{Scan, Survey};
use neif::train::session::saved::run_folder::RunFolder;
use serde_json::{Value, json};

use crate::cli::capture::CaptureArgs;
use crate::cli::failure::{Failure, OrUnusable as _};
use crate::cli::photos_found::PhotosFound;
use crate::cli::{library, output};

#[derive(Debug, clap::Args)]
pub(crate) struct InfoArgs {
    /// A capture, a run folder, the file of an environment or of a trained object, a panorama (.hdr, .exr), or a name of the library
    #[arg(value_name = "PATH")]
    path: PathBuf,
    #[command(flatten)]
    capture: CaptureArgs,
    /// Write JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &InfoArgs) -> Result<(), Failure> {
    let named = (!args.path.exists()).then(|| library::named(&args.path).ok());
    let named = named.flatten().map(|entry| entry.file);
    let path = named.as_ref().unwrap_or(&args.path);
    let (facts, page) = if RunFolder::is_run(path) {
        listed(about_run(path)?)
    } else if is_environment_file(path) {
        listed(about_tensors(path)?)
    } else if Scan::is_scan(path) {
        listed(about_scan(path, &args.capture)?)
    } else {
        about_capture(path, &args.capture)?
    };
    if args.json {
        output::json_line(&facts)?;
    } else {
        output::line(&page)?;
    }
    Ok(())
}

/// The facts, and a page for people with one line a fact.
fn listed(facts: Value) -> (Value, String) {
    let mut lines = Vec::new();
    append(&mut lines, &facts, 0);
    (facts, lines.join("\n"))
}

fn about_run(path: &Path) -> Result<Value, Failure> {
    let folder = RunFolder::open(path).or_unusable()?;
    let config = folder.config().or_unusable()?;
    let scene = folder.scene().or_unusable()?;
    let dataset = folder.dataset_path(&config);
    let trained = folder.trained();
    let faces = scene
        .object
        .as_ref()
        .map(|o| o.tracer.mesh().triangles.len());
    let found = PhotosFound::of(&folder.log());
    Ok(json!({
        "kind": "run",
        "path": path.to_string_lossy(),
        "program": config.program,
        "steps": trained.map(|t| t.steps),
        "train_seconds": trained.map(|t| t.train_secs),
        "seed": config.train.seed,
        "has_object": scene.object.is_some(),
        "faces": faces,
        "dataset": dataset.to_string_lossy(),
        "dataset_found": dataset.exists(),
        "environment": about_environment(&scene.environment),
        "found": found.lines,
        "photos": found.photos,
    }))
}

/// A file of tensors: an environment, else an object. Or a panorama.
fn about_tensors(path: &Path) -> Result<Value, Failure> {
    let mut found = match Environment::open(path) {
        Ok(environment) => about_environment(&environment),
        Err(error) => {
            let material = SurfaceField::load(path);
            // Neither: the first error says more, since files alone are mostly environments.
            let material = material.map_err(|_ignored| Failure::unusable(error))?;
            json!({"kind": "object", "parameters": material.params().len()})
        }
    };
    found["path"] = json!(path.to_string_lossy());
    Ok(found)
}

fn about_environment(environment: &Environment) -> Value {
    let inner = environment.inner_box();
    json!({
        "kind": "environment",
        "name": environment.name(),
        "is_far": environment.is_far(),
        "gamma": environment.gamma(),
        "inner_box": [inner.min.to_array(), inner.max.to_array()],
        "up": environment.up().to_array(),
    })
}

/// What kind of scan it is, and what was found in it.
fn about_scan(path: &Path, args: &CaptureArgs) -> Result<Value, Failure> {
    let survey = Survey::of(path, &args.choices()).or_unusable()?;
    Ok(json!({
        "kind": "scan",
        "format": survey.scan.describe(),
        "size": survey.size,
        "up": survey.up.to_array(),
        "place": survey.at.to_array(),
    }))
}

/// What is in a capture and what is wrong with it, as JSON and as a page for people.
fn about_capture(path: &Path, args: &CaptureArgs) -> Result<(Value, String), Failure> {
    let options = LoadOptions {
        choices: args.choices(),
        ..LoadOptions::default()
    };
    let dataset = Dataset::load(path, &options).or_unusable()?;
    let report = check(&dataset);
    let mut facts = serde_json::to_value(&report)?;
    facts["kind"] = json!("capture");
    Ok((facts, report.to_string().trim_end().to_owned()))
}

/// Adds one line a fact, nested facts indented.
fn append(lines: &mut Vec<String>, value: &Value, indent: usize) {
    let margin = "  ".repeat(indent);
    let Value::Object(facts) = value else {
        return;
    };
    for (name, fact) in facts {
        let name = name.replace('_', " ");
        match fact {
            Value::Null => {}
            Value::Object(_) => {
                lines.push(format!("{margin}{name}:"));
                append(lines, fact, indent + 1);
            }
            // One a photo: for scripts, and for the window's list.
            Value::Array(facts) if facts.iter().any(Value::is_object) => {}
            Value::Array(facts) if facts.iter().any(Value::is_string) => {
                lines.push(format!("{margin}{name}:"));
                let facts = facts.iter().filter_map(Value::as_str);
                lines.extend(facts.map(|fact| format!("{margin}  {fact}")));
            }
            Value::String(fact) => lines.push(format!("{margin}{name}: {fact}")),
            other => lines.push(format!("{margin}{name}: {other}")),
        }
    }
}
