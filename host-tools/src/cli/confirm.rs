//! `esm confirm`: the mission on trial stays.

use std::io::Write;

use anyhow::anyhow;
use clap::Args;
use esm_link::message::Status;

use super::console::Console;
use super::exit::CommandError;
use super::robot::RobotArgs;
use crate::run::mission::hash_text;
use crate::run::story;

/// Ends the trial of the mission that a robot runs: it stays
///
/// The robot forgets the mission before. Without this, it goes back to it by itself when the time
/// of the trial is over.
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
    let (mut robot, _) = args.robot.connect(console)?;
    let mission = unconfirmed(&robot.status()?)?;
    robot.confirm(mission)?;
    writeln!(console.out(), "confirmed: {} stays", hash_text(mission))?;
    Ok(())
}

/// Hash of the mission that runs and is not confirmed: on trial, or behind it, where the flash has
/// refused to keep that it is confirmed.
///
/// # Errors
/// There is none.
fn unconfirmed(status: &Status) -> Result<u32, CommandError> {
    match (status.mission, &status.kept) {
        (Some(mission), Some(kept)) if kept.is_on_trial() => Ok(mission),
        _ => on_trial(status),
    }
}

/// Hash of the mission that is on trial.
///
/// # Errors
/// None is.
pub(super) fn on_trial(status: &Status) -> Result<u32, CommandError> {
    match (status.trial, status.mission) {
        (Some(_), Some(mission)) => Ok(mission),
        _ => Err(CommandError::Input(anyhow!(
            "no mission is on trial{}",
            crash_report(status)
        ))),
    }
}

/// What became of the last one, if the robot gave one up.
fn crash_report(status: &Status) -> String {
    status.fell_back.map_or_else(String::new, |fell_back| {
        format!(
            "; the robot gave {} up: {}",
            hash_text(fell_back.mission),
            story::fall_back_reason(fell_back.reason)
        )
    })
}

#[cfg(test)]
mod tests {
    use esm_link::message::{BankState, Source, StoreStatus};
    use esm_link::trial::Trial;

    use super::*;
    use esm_client::samples::status;

    #[test]
    fn what_runs_and_is_not_confirmed_can_be() {
        let trial = Trial {
            left_ms: 5,
            before: None,
        };
        let kept = |state| StoreStatus {
            runs: Source::A,
            slots: [state, BankState::Spare],
        };
        for (mission, trial, kept, expected) in [
            (Some(7), Some(trial), None, Some(7)),
            (
                Some(7),
                Some(trial),
                Some(kept(BankState::OnTrial)),
                Some(7),
            ),
            // The flash has refused.
            (Some(7), None, Some(kept(BankState::OnTrial)), Some(7)),
            (Some(7), None, Some(kept(BankState::Runs)), None),
            (Some(7), None, None, None),
            (None, None, Some(kept(BankState::OnTrial)), None),
        ] {
            let status = Status {
                trial,
                kept,
                ..status(mission, 0)
            };
            assert_eq!(unconfirmed(&status).ok(), expected, "{status:?}");
        }
    }
}
