//! `esm confirm`: the mission on trial stays.

use std::io::Write;

use anyhow::anyhow;
use clap::Args;
use rt_firmware::link::message::Status;

use super::console::Console;
use super::exit::CommandError;
use super::robot::{Robot, RobotArgs};
use crate::run::mission::hash_text;
use crate::run::story;

/// Ends the trial of the mission that a robot runs: it stays
///
/// The robot forgets the mission before. Without this, it goes back to it by itself when the time of the trial is over.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  esm upload missions/patrol.esm --trial '60 s' --port /dev/ttyUSB0
  esm confirm --port /dev/ttyUSB0")]
pub struct ConfirmArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &ConfirmArgs, console: &mut Console) -> Result<(), CommandError> {
    let (mut robot, _) = args.robot.connect()?;
    let mission = on_trial(&mut robot)?;
    robot.confirm(mission)?;
    writeln!(console.out(), "confirmed: {} stays", hash_text(mission))?;
    Ok(())
}

/// Hash of the mission that is on trial.
///
/// # Errors
/// None is, or the robot does not answer.
pub(super) fn on_trial(robot: &mut Robot) -> Result<u32, CommandError> {
    let status = robot.status()?;
    match (status.trial, status.mission) {
        (Some(_), Some(mission)) => Ok(mission),
        _ => Err(CommandError::Input(anyhow!(
            "no mission is on trial{}",
            last_words(&status)
        ))),
    }
}

/// What became of the last one, if the robot gave one up.
fn last_words(status: &Status) -> String {
    status.fell_back.map_or_else(String::new, |fell_back| {
        format!(
            "; the robot gave {} up: {}",
            hash_text(fell_back.mission),
            story::fall_back_reason(fell_back.reason)
        )
    })
}
