//! `esm status`: how a robot is.

use clap::Args;

use super::argument::Port;
use super::console::Console;
use super::exit::CommandError;

/// Shows what a robot runs, since when, its counters and faults, and why it was last reset
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm status --port /dev/ttyUSB0
  esm status --port /dev/ttyUSB0 --json | jq .active")]
pub struct StatusArgs {
    /// Where the robot is: a serial line, unix:PATH or tcp:HOST:PORT
    #[arg(long, value_name = "PORT")]
    pub port: Port,

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
