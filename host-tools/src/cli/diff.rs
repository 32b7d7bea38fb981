//! `esm diff`: how two missions differ.

use std::path::PathBuf;

use clap::Args;

use super::console::Console;
use super::exit::CommandError;
use super::stage;
use crate::inspect::changes::Changes;

/// How many differences of a kind are shown.
const SHOWN: usize = 100;

/// Says how two missions differ: states, transitions, parameters, tasks, slots, ways of data
///
/// Compares what robots get: the tables of the blobs, by name. `esm upload --diff` does the same
/// with the mission that a robot runs.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm diff missions/patrol.esm patrol_faster.esm
  esm diff before.blob after.blob --json | jq .parameters")]
pub struct DiffArgs {
    /// A mission, or a blob that `esm build` made of it
    #[arg(value_name = "OLD")]
    pub old: PathBuf,

    /// Another one
    #[arg(value_name = "NEW")]
    pub new: PathBuf,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// A file cannot be read, or has errors.
pub fn execute(args: &DiffArgs, console: &mut Console) -> Result<(), CommandError> {
    let mut blob = |path| {
        let staged = stage::mission(path, console)?;
        stage::verified(path, staged.mission.blob)
    };
    let (old, new) = (blob(&args.old)?, blob(&args.new)?);
    let changes = Changes::between(&old, &new);
    if args.json {
        console.json_line(&changes)
    } else {
        console.text(&changes.text(SHOWN))
    }
}
