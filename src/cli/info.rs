//! `neif info`: what a path is, and what is wrong with it.

use std::path::{Path, PathBuf};

use neif::data::{Dataset, LoadOptions};
use neif::neif::{Environment, Material};
use neif::train::run_folder::RunFolder;
use serde_json::{Value, json};

use super::failure::{Failure, OrUnusable as _};
use super::output;

/// Arguments of `neif info`.
#[derive(Debug, clap::Args)]
pub(crate) struct InfoArgs {
    /// A capture, a run folder, or a file of trained surroundings or of a trained object
    #[arg(value_name = "PATH")]
    path: PathBuf,
    /// Write JSON
    #[arg(long)]
    json: bool,
}

/// `neif info`.
pub(crate) fn run(args: &InfoArgs) -> Result<(), Failure> {
    let path = &args.path;
    let is_tensors = path.extension().is_some_and(|e| e == "safetensors");
    let found = if RunFolder::is_run(path) {
        about_run(path)?
    } else if is_tensors {
        about_tensors(path)?
    } else {
        about_capture(path)?
    };
    if args.json {
        output::json_line(&found)?;
    } else {
        output::line(&for_people(&found))?;
    }
    Ok(())
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
    }))
}

/// A file of tensors: surroundings, else an object.
fn about_tensors(path: &Path) -> Result<Value, Failure> {
    let mut found = match Environment::load(path) {
        Ok(environment) => about_environment(&environment),
        Err(error) => {
            let material = Material::load(path);
            // Neither: the first error says more, since files alone are mostly surroundings.
            let material = material.map_err(|_ignored| Failure::unusable(error))?;
            json!({"kind": "object", "parameters": material.params.len()})
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
        "gamma": environment.gamma(),
        "inner_box": [inner.min.to_array(), inner.max.to_array()],
        "up": environment.up().to_array(),
    })
}

fn about_capture(path: &Path) -> Result<Value, Failure> {
    let dataset = Dataset::load(path, &LoadOptions::default()).or_unusable()?;
    let first = dataset.train.first();
    let size = first.map(|view| [view.camera.width, view.camera.height]);
    Ok(json!({
        "kind": "capture",
        "name": dataset.name,
        "train": dataset.train.len(),
        "val": dataset.val.len(),
        "test": dataset.test.len(),
        "size": size,
        "faces": dataset.mesh.as_ref().map(|mesh| mesh.triangles.len()),
        "problems": dataset.problems,
    }))
}

/// One line a fact, nested facts indented.
fn for_people(found: &Value) -> String {
    let mut lines = Vec::new();
    append(&mut lines, found, 0);
    lines.join("\n")
}

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
            Value::String(fact) => lines.push(format!("{margin}{name}: {fact}")),
            other => lines.push(format!("{margin}{name}: {other}")),
        }
    }
}
