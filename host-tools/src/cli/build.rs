//! `esm build`: a mission as the blob that a robot takes.

use std::path::PathBuf;

use clap::Args;

use super::console::Console;
use super::exit::CommandError;

/// Compiles a mission to the blob that a robot takes
///
/// The blob holds the machine, its schedule, data paths and parameters, and the names that traces and status need. OUT appears
/// whole or not at all: a build that fails leaves the old file alone.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm build missions/patrol.esm -o patrol.blob
  esm build missions/patrol.esm -o patrol.blob --json | jq .bytes

With --json: bytes, states, transitions, containers, instances, events, flags, ram_bytes.")]
pub struct BuildArgs {
    /// The mission
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// Where the blob goes
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,

    /// What was built as one JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &BuildArgs, console: &mut Console) -> Result<(), CommandError> {
    let _ = (args, console);
    Err(CommandError::World(anyhow::anyhow!(
        "`esm build` is not connected yet"
    )))
}
