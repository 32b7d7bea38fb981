//! `esm inspect`: what is in a blob, as tables or as source.

use std::io::Write;
use std::path::PathBuf;

use anyhow::anyhow;
use clap::Args;

use super::console::Console;
use super::exit::CommandError;
use super::{file, mission, stage};
use crate::files::MAX_BLOB_BYTES;
use crate::inspect::{self, Report};
use crate::time::work_limit;

/// Shows what is in a blob, read by the code that the firmware uses
///
/// A blob that the firmware would refuse is refused here, with the reason and the place. With --esm
/// the blob is given back as source, which compiles to the same bytes; names that are not in the
/// blob are made up.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm inspect patrol.blob
  esm inspect patrol.blob --json | jq .slots
  esm inspect patrol.blob --esm > again.esm")]
pub struct InspectArgs {
    /// The blob, as `esm build` writes it
    #[arg(value_name = "BLOB")]
    pub blob: PathBuf,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,

    /// The source of a mission that compiles to this blob
    #[arg(long, conflicts_with = "json")]
    pub esm: bool,
}

/// Runs the command.
///
/// # Errors
/// If the blob cannot be read or is refused, or if it is to be given back as source and is not the
/// blob of any.
pub fn execute(args: &InspectArgs, console: &mut Console) -> Result<(), CommandError> {
    let verified = stage::verified(&args.blob, file::read(&args.blob, MAX_BLOB_BYTES, "blob")?)?;
    if args.esm {
        let source = inspect::source(&verified, work_limit(mission::LAY_OUT_LIMIT * 2)).map_err(|cause| {
            let path = args.blob.display();
            CommandError::Input(anyhow!(
                "{path} cannot be given back as source, so it was not made by `esm build`: {cause}"
            ))
        })?;
        return console.text(&source);
    }
    let report = Report::of(&verified);
    if args.json {
        return console.json_line(&report);
    }
    write!(console.out(), "{report}")?;
    Ok(())
}
