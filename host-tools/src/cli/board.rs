//! `esm board`: an emulated robot that waits for missions.

use std::path::PathBuf;

use clap::Args;

use super::console::Console;
use super::exit::CommandError;
use crate::host_board::RobotMaker;

/// Starts an emulated robot that waits for missions on a serial line
///
/// Runs in real time until Ctrl-C and prints the port that `esm upload`, `status`, `log`, `stop`, `start` and `tasks` take.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm board --world missions/worlds/office.world
  esm upload missions/patrol.esm --port /dev/pts/7      # with the port that `esm board` printed")]
pub struct BoardArgs {
    /// The board to run on
    #[arg(long, value_name = "BOARD", default_value = "lm3s6965")]
    pub board: String,

    /// The world to drive in
    #[arg(long, value_name = "WORLD")]
    pub world: Option<PathBuf>,

    /// The firmware to start on an emulated board, instead of the one that the checkout builds
    #[arg(long, value_name = "ELF", env = "ESM_FIRMWARE")]
    pub firmware: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(
    args: &BoardArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    let _ = (args, robot, console);
    Err(CommandError::World(anyhow::anyhow!(
        "`esm board` is not connected yet"
    )))
}
