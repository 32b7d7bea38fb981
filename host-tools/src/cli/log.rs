//! `esm log`: what a robot says.

use clap::Args;

use std::path::PathBuf;

use super::argument::Port;
use super::console::Console;
use super::exit::CommandError;

/// Shows what the firmware logs, decoded, as it comes
///
/// Runs until Ctrl-C. Lines that the robot could not keep are counted and said.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm log --port /dev/ttyUSB0
  esm log --port unix:/tmp/robot --firmware target/firmware/lm3s6965/rover.elf")]
pub struct LogArgs {
    /// Where the robot is: a serial line, unix:PATH or tcp:HOST:PORT
    #[arg(long, value_name = "PORT")]
    pub port: Port,

    /// The firmware that the robot runs, whose file holds the texts of the log
    #[arg(long, value_name = "ELF", env = "ESM_FIRMWARE")]
    pub firmware: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &LogArgs, console: &mut Console) -> Result<(), CommandError> {
    let _ = (args, console);
    Err(CommandError::World(anyhow::anyhow!(
        "`esm log` is not connected yet"
    )))
}
