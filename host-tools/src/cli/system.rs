//! `esm system`: robots with several processors.

mod check;
mod draw;
mod loaded;
mod partners;
mod recordings;
mod replay;
mod run;
mod schedule;
mod summary;
mod then;

use clap::{Args, Subcommand};

use super::console::Console;
use super::exit::CommandError;
use crate::host_board::RobotMaker;

pub use check::CheckArgs;
pub use draw::DrawArgs;
pub use replay::ReplayArgs;
pub use run::RunArgs;
pub use schedule::ScheduleArgs;

/// Robots with several processors: checks the links between their missions, and runs all at once
///
/// A system file names the processors with their missions, what each has of the robot's body, and
/// the links between them.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm system check robot.system
  esm system draw robot.system -o robot.svg
  esm system schedule robot.system
  esm system run robot.system --until '60 s' --trace robot.jsonl
  esm system replay robot.recs --trace again.jsonl")]
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
    Draw(DrawArgs),
    Schedule(ScheduleArgs),
    Run(RunArgs),
    Replay(ReplayArgs),
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
        SystemTask::Draw(args) => draw::execute(args, console),
        SystemTask::Schedule(args) => schedule::execute(args, console),
        SystemTask::Run(args) => run::execute(args, robot, console),
        SystemTask::Replay(args) => replay::execute(args, console),
    }
}
