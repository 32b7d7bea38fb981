//! `esm check`: everything that is wrong with a set of files.

use std::path::PathBuf;

use clap::Args;

use super::console::Console;
use super::exit::CommandError;

/// Says what is wrong with a mission: every error and warning at once
///
/// Reads FILE and all that it uses, and reports each mistake with its code, its place, the source line and, where there is one,
/// the likely fix. The exit status is 1 if there is an error; warnings alone leave it 0.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm check missions/patrol.esm
  esm check missions/patrol.esm --json | jq -r 'select(.severity == \"error\") | .line'

With --json, one object a line on standard output: code, severity (error, warning), file, line, col (from 1), message.")]
pub struct CheckArgs {
    /// The mission, or a file of tasks and containers
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// One JSON object a line, for programs
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &CheckArgs, console: &mut Console) -> Result<(), CommandError> {
    let _ = (args, console);
    Err(CommandError::World(anyhow::anyhow!(
        "`esm check` is not connected yet"
    )))
}
