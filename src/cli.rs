//! The command line: what can be asked for, and who does it. One file a command.

mod capture;
mod commands;
mod edits;
mod failure;
mod interrupt;
mod library;
mod output;
mod photos_found;
mod place;
mod scenes;
mod sheet;
mod shots;
mod training;
mod values;

use std::time::Instant;

use clap::{Parser, Subcommand};

use self::commands::{
    bench, env, env_import, env_library, eval, export, info, masks, mesh, render, train, view,
};
use self::failure::Failure;

/// Relight photographed objects: train a neural illumination field on posed photos, edit the
/// object's material and its environment, and render the result.
///
/// Without a command: the window, or where there is no display the demo without one.
#[derive(Debug, Parser)]
#[command(name = "neif", version)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Show captures, runs or environments in the window
    View(view::ViewArgs),
    /// Say what a capture, run or environment is and what is wrong with it
    Info(info::InfoArgs),
    /// Train on a capture
    Train(train::TrainArgs),
    /// Measure a trained run against photos that were held out
    Eval(eval::EvalArgs),
    /// Render pictures of a trained run, with edits and other light
    Render(render::RenderArgs),
    /// Find the object in photos without masks, and write masks
    Masks(masks::MasksArgs),
    /// Make a mesh of the object from the masks, depth maps or points of a capture
    Mesh(mesh::MeshArgs),
    /// Write the object with baked textures for other programs (glTF), and its environment
    Export(export::ExportArgs),
    /// Measure this program on this machine
    #[command(subcommand)]
    Bench(bench::BenchCommand),
    /// An environment alone: train it, import it, look at it, keep it in the library
    #[command(subcommand)]
    Env(env::EnvCommand),
}

/// Reads the arguments and does what they ask for. `started` is when the process began, from
/// which time budgets count.
pub(crate) fn run(started: Instant) -> Result<(), Failure> {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        // Help and version are asked for and succeed; the rest ends the process with code 2.
        Err(error) => error.exit(),
    };
    init_logging();
    match cli.command {
        None => view::window_or_demo(started),
        Some(Command::View(args)) => view::run(&args),
        Some(Command::Info(args)) => info::run(&args),
        Some(Command::Train(args)) => train::run(&args, started),
        Some(Command::Eval(args)) => eval::run(&args),
        Some(Command::Render(args)) => render::run(&args),
        Some(Command::Masks(args)) => masks::run(&args, started),
        Some(Command::Mesh(args)) => mesh::run(&args, started),
        Some(Command::Export(args)) => export::run(&args),
        Some(Command::Bench(command)) => bench::run(&command),
        Some(Command::Env(env::EnvCommand::Train(args))) => env::train(&args, started),
        Some(Command::Env(env::EnvCommand::Import(args))) => env_import::run(&args, started),
        Some(Command::Env(env::EnvCommand::Panorama(args))) => env::panorama(&args),
        Some(Command::Env(env::EnvCommand::List(args))) => env_library::list(&args),
        Some(Command::Env(env::EnvCommand::Add(args))) => env_library::add(&args),
        Some(Command::Env(env::EnvCommand::Remove(args))) => env_library::remove(&args),
    }
}

/// Warnings go to the standard error; `NEIF_LOG=debug` shows more.
fn init_logging() {
    use tracing_subscriber::EnvFilter;
    let filter = EnvFilter::try_from_env("NEIF_LOG").unwrap_or_else(|_| EnvFilter::new("warn"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .init();
}
