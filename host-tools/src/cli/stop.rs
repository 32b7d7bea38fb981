//! `esm stop`: motors off.

use clap::Args;

use super::argument::Port;
use super::console::Console;
use super::exit::CommandError;

/// Stops a robot: motors off, and off they stay until `esm start`
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  esm stop --port /dev/ttyUSB0")]
pub struct StopArgs {
    /// Where the robot is: a serial line, unix:PATH or tcp:HOST:PORT
    #[arg(long, value_name = "PORT")]
    pub port: Port,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &StopArgs, console: &mut Console) -> Result<(), CommandError> {
    let _ = (args, console);
    Err(CommandError::World(anyhow::anyhow!(
        "`esm stop` is not connected yet"
    )))
}
