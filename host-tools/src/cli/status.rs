//! `esm status`: how a robot is.

use clap::Args;

use super::console::Console;
use super::exit::CommandError;
use super::robot::RobotArgs;

/// Shows what a robot runs, since when, its counters and faults, and why it was last reset
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm status --port /dev/ttyUSB0
  esm status --port /dev/ttyUSB0 --json | jq .active")]
pub struct StatusArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &StatusArgs, console: &mut Console) -> Result<(), CommandError> {
    let _ = (args, console);
    Err(CommandError::World(anyhow::anyhow!(
        "`esm status` is not connected yet"
    )))
}
