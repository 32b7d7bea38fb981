//! `esm new`: what one begins with, as files that build.
//!
//! | module | what it makes |
//! |---|---|
//! | [`robot`] | a crate of the user's own |
//! | [`part`] | a task, a behaviour or a mission of a robot |
//! | [`board`] | a folder of the framework's checkout |
//! | [`crate_of_robot`] | the robot's crate that a part is added to, and its registry |
//! | [`files`] | files of templates, where none is |
//! | [`names`] | names that Rust, cargo and the firmware take |
//! | [`framework`] | finds the checkout that a robot depends on |
//! | [`locks`] | lock files of the versions that were tested |

pub mod board;
pub mod crate_of_robot;
pub mod files;
pub mod framework;
pub mod locks;
pub mod names;
pub mod part;
pub mod robot;

use clap::{Args, Subcommand};

use super::console::Console;
use super::exit::CommandError;

/// Makes a robot of your own, adds tasks, behaviours and missions to it, or begins a board
///
/// Nothing that is there is written over.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm new robot my_robot             a crate that builds, with a task, a mission and firmware
  esm new robot my_pico --board pico
  esm new task watch_ahead           in the robot's folder
  esm new behaviour come_near
  esm new mission explore
  esm new board my_board             in the framework's checkout")]
pub struct NewArgs {
    /// What is to be made
    #[command(subcommand)]
    pub what: What,
}

/// What can be made.
#[derive(Debug, Subcommand)]
#[allow(
    missing_docs,
    reason = "each variant carries the documentation of its arguments"
)]
pub enum What {
    Robot(robot::NewRobotArgs),
    Task(part::NewTaskArgs),
    Behaviour(part::NewBehaviourArgs),
    Mission(part::NewMissionArgs),
    Board(board::NewBoardArgs),
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &NewArgs, console: &mut Console) -> Result<(), CommandError> {
    match &args.what {
        What::Robot(args) => robot::execute(args, console),
        What::Task(args) => part::task(args, console),
        What::Behaviour(args) => part::behaviour(args, console),
        What::Mission(args) => part::mission(args, console),
        What::Board(args) => board::execute(args, console),
    }
}
