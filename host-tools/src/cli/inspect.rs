//! `esm inspect`: what is in a blob.

use std::path::PathBuf;

use clap::Args;

use super::console::Console;
use super::exit::CommandError;

/// Shows what is in a blob, read by the code that the firmware uses
///
/// A blob that the firmware would refuse is refused here, with the reason and the place.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm inspect patrol.blob
  esm inspect patrol.blob --json | jq .slots")]
pub struct InspectArgs {
    /// The blob, as `esm build` writes it
    #[arg(value_name = "BLOB")]
    pub blob: PathBuf,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &InspectArgs, console: &mut Console) -> Result<(), CommandError> {
    let _ = (args, console);
    Err(CommandError::World(anyhow::anyhow!(
        "`esm inspect` is not connected yet"
    )))
}
