//! `esm tasks`: what a firmware can do.

use clap::Args;

use super::argument::Port;
use super::console::Console;
use super::exit::CommandError;
use crate::host_board::RobotMaker;

/// Prints a firmware's task declarations as `.esm`, so that nobody copies signatures by hand
///
/// Asks the robot at PORT, or else a board that is started for the question.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm tasks > rover_tasks.esm
  esm tasks --port /dev/ttyUSB0 > rover_tasks.esm")]
pub struct TasksArgs {
    /// Where the robot is: a serial line, unix:PATH or tcp:HOST:PORT
    #[arg(long, value_name = "PORT", conflicts_with = "board")]
    pub port: Option<Port>,

    /// The board to ask
    #[arg(long, value_name = "BOARD", default_value = "lm3s6965")]
    pub board: String,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(
    args: &TasksArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    let _ = (args, robot, console);
    Err(CommandError::World(anyhow::anyhow!(
        "`esm tasks` is not connected yet"
    )))
}
