//! `esm bench`: what is measured over many runs.

mod courses;
mod missions;
mod report;

use clap::{Args, Subcommand};

use super::console::Console;
use super::exit::CommandError;
use crate::host_board::RobotMaker;

pub use missions::MissionsArgs;

/// Drives missions many times, and says how often they reach their goal and what they touch
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm bench missions
  esm bench missions missions/guard.esm --seeds 1..=20
  esm bench missions --seeds 1..=100 --strict --json")]
pub struct BenchArgs {
    /// What is measured.
    #[command(subcommand)]
    pub subject: Subject,
}

/// What is measured.
#[derive(Debug, Subcommand)]
#[allow(
    missing_docs,
    reason = "each variant carries the documentation of its arguments"
)]
pub enum Subject {
    Missions(MissionsArgs),
}

/// Runs the command. `robot` is what the board `host` has.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(
    args: &BenchArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    match &args.subject {
        Subject::Missions(args) => missions::execute(args, robot, console),
    }
}
