//! `esm fallback`: back to the mission before the one on trial.

use std::io::Write;

use clap::Args;

use super::confirm::on_trial;
use super::console::Console;
use super::exit::CommandError;
use super::robot::{RobotArgs, is_back};
use crate::run::mission::hash_text;

/// Gives up the mission that a robot runs on trial: the one before runs again, from its beginning
///
/// The robot changes over between two macro steps. Where there was no mission before, its motors
/// are off.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  esm upload missions/patrol.esm --trial '60 s' --port /dev/ttyUSB0
  esm fallback --port /dev/ttyUSB0")]
pub struct FallbackArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &FallbackArgs, console: &mut Console) -> Result<(), CommandError> {
    let (mut robot, _) = args.robot.connect(console)?;
    let mission = on_trial(&robot.status()?)?;
    robot.fall_back(mission)?;
    let given_up = hash_text(mission);
    let now = is_back(&robot.status()?);
    writeln!(console.out(), "{given_up} is given up: {now}")?;
    Ok(())
}
