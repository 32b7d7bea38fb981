//! `esm inspect`: what is in a blob.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use super::console::Console;
use super::exit::CommandError;
use super::{file, stage};
use crate::inspect::Report;

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
/// If the blob cannot be read or is refused.
pub fn execute(args: &InspectArgs, console: &mut Console) -> Result<(), CommandError> {
    let verified = stage::verified(&args.blob, file::read(&args.blob, "blob")?)?;
    let report = Report::of(&verified);
    if args.json {
        return console.json_line(&report);
    }
    write!(console.out(), "{report}")?;
    Ok(())
}
