//! `esm system`: robots with several processors.

mod check;
mod loaded;
mod run;

use clap::{Args, Subcommand};

use super::console::Console;
use super::exit::CommandError;
use crate::host_board::RobotMaker;

pub use check::CheckArgs;
pub use run::RunArgs;

/// Robots with several processors: checks the links between their missions, and runs all at once
///
/// A system file names the processors with their missions, what each has of the robot's body, and
/// the links between them.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm system check robot.system
  esm system run robot.system --until '60 s' --trace robot.jsonl")]
pub struct SystemArgs {
    /// What is done with the system.
    #[command(subcommand)]
    pub task: SystemTask,
}

/// What is done with a system.
#[derive(Debug, Subcommand)]
#[allow(
    missing_docs,
    reason = "each variant carries the documentation of its arguments"
)]
pub enum SystemTask {
    Check(CheckArgs),
    Run(RunArgs),
}

/// Runs the command. `robot` is what the board `host` has.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(
    args: &SystemArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    match &args.task {
        SystemTask::Check(args) => check::execute(args, console),
        SystemTask::Run(args) => run::execute(args, robot, console),
    }
}
