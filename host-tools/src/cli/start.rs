//! `esm start`: takes back `esm stop`.

use clap::Args;

use super::argument::Port;
use super::console::Console;
use super::exit::CommandError;

/// Lets a robot that was stopped move again: its mission starts anew
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  esm start --port /dev/ttyUSB0")]
pub struct StartArgs {
    /// Where the robot is: a serial line, unix:PATH or tcp:HOST:PORT
    #[arg(long, value_name = "PORT")]
    pub port: Port,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &StartArgs, console: &mut Console) -> Result<(), CommandError> {
    let _ = (args, console);
    Err(CommandError::World(anyhow::anyhow!(
        "`esm start` is not connected yet"
    )))
}
