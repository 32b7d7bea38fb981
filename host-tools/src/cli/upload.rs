//! `esm upload`: a new mission for a robot that is on.

use std::path::PathBuf;

use clap::Args;

use super::console::Console;
use super::exit::CommandError;
use super::robot::RobotArgs;

/// Gives a robot that is on a new mission
///
/// Compiles FILE if it is a source, checks it against what the robot says of itself, uploads it while the old mission runs, and
/// lets the robot switch between two macro steps. A robot that refuses the blob says why and drives on with what it has.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm upload missions/patrol.esm --port /dev/ttyUSB0
  esm upload patrol.blob --port tcp:robot.local:4000")]
pub struct UploadArgs {
    /// The mission, or a blob that `esm build` made of it
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &UploadArgs, console: &mut Console) -> Result<(), CommandError> {
    let _ = (args, console);
    Err(CommandError::World(anyhow::anyhow!(
        "`esm upload` is not connected yet"
    )))
}
