//! `esm behaviours`: the behaviours of a firmware, and the list of those that a robot does.
//!
//! | module | what it holds |
//! |---|---|
//! | `declared` | what a firmware declares, as a table and as JSON |
//! | [`list`] | what stands on a robot's list, and what is changed there |

mod declared;
pub mod list;

use clap::{Args, Subcommand};

use super::console::Console;
use super::exit::CommandError;
use super::tasks::{self, AskedArgs};
use crate::host_board::RobotMaker;
use list::{InsertArgs, KeyArgs, ShowArgs};

/// Lists the behaviours of a firmware, or shows and changes those that a robot does
///
/// Without a word behind it, it lists what behaviours a firmware has, what each is for and what
/// parameters it has: it asks the robot at PORT, or else a board that is started for the question.
#[derive(Debug, Args)]
#[command(
    args_conflicts_with_subcommands = true,
    after_help = "\
Examples:
  esm behaviours --board host
  esm behaviours --port /dev/ttyACM0 --json
  esm behaviours show --port /dev/ttyACM0
  esm behaviours insert 'go_to x_m = 1.5 unless near range_m = 0.3 -> cancel'
  esm behaviours insert --head 'turn_to angle_rad = 3.14'
  esm behaviours cancel 7"
)]
pub struct BehavioursArgs {
    /// What to do with those that a robot does.
    #[command(subcommand)]
    pub action: Option<Action>,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub asked: AskedArgs,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// What to do with the behaviours that a robot does.
#[derive(Debug, Subcommand)]
#[allow(
    missing_docs,
    reason = "each variant carries the documentation of its arguments"
)]
pub enum Action {
    Show(ShowArgs),
    Insert(InsertArgs),
    /// Takes a behaviour off the list: a script goes on with its next step, a task state of the
    /// mission has failed
    #[command(after_help = "Example:\n  esm behaviours cancel 7")]
    Cancel(KeyArgs),
    /// Suspends a behaviour: the robot stands still in its turn, until it is resumed
    #[command(after_help = "Example:\n  esm behaviours suspend 7")]
    Suspend(KeyArgs),
    /// Resumes a behaviour that was suspended by hand
    #[command(after_help = "Example:\n  esm behaviours resume 7")]
    Resume(KeyArgs),
}

/// Runs the command. `robot` is what the board `host` has.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(
    args: &BehavioursArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    match &args.action {
        None => {
            let (text, firmware) = tasks::declarations(&args.asked, robot, console)?;
            let tasks = tasks::declared_in(&text, console)?;
            declared::tell(&firmware, &tasks, args.json, console)
        }
        Some(Action::Show(args)) => list::show(args, console),
        Some(Action::Insert(args)) => list::insert(args, console),
        Some(Action::Cancel(args)) => list::cancel(args, console),
        Some(Action::Suspend(args)) => list::suspend(args, console),
        Some(Action::Resume(args)) => list::resume(args, console),
    }
}
