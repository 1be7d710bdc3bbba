//! Where an environment that is made goes: into a file, or into the library.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use neif::neif::{Environment, Storage};
use neif::render::library::{Library, Record};
use neif::train::session::options::SessionOptions;
use neif::train::session::saved::run_folder::ENVIRONMENT;
use serde_json::json;

use super::failure::Failure;
use super::library::failure;
use super::scenes::make_folder_of;
use super::{output, training};

/// What `--out` says for the library instead of a file.
const LIBRARY: &str = "library";

/// What the library keeps of an environment beside its light.
#[derive(Debug, Default, clap::Args)]
pub(crate) struct AboutArgs {
    /// Where it came from, such as an address [default: the file or folder]
    #[arg(long, value_name = "TEXT")]
    origin: Option<String>,
    /// What may be done with it, such as CC0
    #[arg(long, value_name = "TEXT")]
    licence: Option<String>,
}

impl AboutArgs {
    /// With the name that is asked for, of what was made from `source`.
    pub(crate) fn record(&self, name: Option<&str>, source: &Path) -> Record {
        let source = || {
            let path = std::path::absolute(source).unwrap_or_else(|_| source.to_owned());
            path.display().to_string()
        };
        Record {
            name: name.map(str::to_owned),
            origin: Some(self.origin.clone().unwrap_or_else(source)),
            licence: self.licence.clone(),
            added_unix_secs: None,
        }
    }

    fn is_given(&self) -> bool {
        self.origin.is_some() || self.licence.is_some()
    }
}

/// Where an environment that is made will be.
#[derive(Debug)]
pub(crate) enum Place {
    /// A file that does not exist yet.
    File(PathBuf),
    /// A new one of the library.
    Library(Library),
}

impl Place {
    /// Trains an environment, and puts it here.
    pub(crate) fn fill(
        &self,
        options: SessionOptions,
        json: bool,
        record: Record,
    ) -> Result<(), Failure> {
        let storage = options.storage;
        let outcome = training::train(options, json)?;
        let environment = Environment::clone(&outcome.snapshot.environment);
        let file = self.put(environment, storage, record)?;
        if !json {
            outcome.report(&file)?;
        } else if let Self::Library(_) = self {
            // The library chooses the name.
            output::json_line(&json!({"event": "added", "path": file.to_string_lossy()}))?;
        }
        outcome.verdict()
    }

    /// What `--out` means: the library by that word, else a new file or one in a folder, which is made.
    pub(crate) fn of(out: &Path, about: &AboutArgs) -> Result<Self, Failure> {
        if out == Path::new(LIBRARY) {
            let library = Library::of_system();
            library.made_folder().map_err(failure)?;
            return Ok(Self::Library(library));
        }
        if about.is_given() {
            let what =
                "--origin and --licence are kept in the library; put it there with --out library";
            return Err(Failure::unusable(anyhow::anyhow!(what)));
        }
        Ok(Self::File(new_file(out)?))
    }

    /// Writes the environment, and returns its file; the record is kept in the library only, but for the name.
    pub(crate) fn put(
        &self,
        environment: Environment,
        storage: Storage,
        record: Record,
    ) -> Result<PathBuf, Failure> {
        let environment = match &record.name {
            Some(name) => environment.renamed(name),
            None => environment,
        };
        match self {
            Self::File(file) => {
                environment.save(file, storage)?;
                Ok(file.clone())
            }
            Self::Library(library) => {
                let entry = library.add(&Arc::new(environment), storage, record);
                Ok(entry.map_err(failure)?.file)
            }
        }
    }
}

/// The file that `--out ENV` means, itself or inside a folder: it must not exist yet, and its folder is made.
fn new_file(out: &Path) -> Result<PathBuf, Failure> {
    let is_file = out.extension().is_some() && !out.is_dir();
    let target = if is_file {
        out.to_owned()
    } else {
        out.join(ENVIRONMENT)
    };
    if target.exists() {
        let what = "exists already; remove it or choose another --out";
        return Err(Failure::at(&target, what));
    }
    make_folder_of(&target)?;
    Ok(target)
}
