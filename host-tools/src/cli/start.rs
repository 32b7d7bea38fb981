//! `esm start`: takes back `esm stop`, and with `--release` an emergency stop.

use std::io::Write;

use anyhow::anyhow;
use clap::Args;
use esm_link::message::{LinkError, Mode};

use super::console::Console;
use super::exit::CommandError;
use super::robot::RobotArgs;
use super::status::RUN_ANEW;
use crate::reading::Reader;

/// Lets a robot that was stopped move again: its mission starts anew
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm start --port /dev/ttyUSB0
  esm start --release --port /dev/ttyUSB0   # after `esm stop --emergency`")]
pub struct StartArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// Ends an emergency stop first
    #[arg(long)]
    pub release: bool,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &StartArgs, console: &mut Console) -> Result<(), CommandError> {
    let (mut robot, _) = args.robot.connect(console)?;
    if args.release {
        robot.release().map_err(|error| match error.refusal() {
            Some(LinkError::EmergencyStopped) => CommandError::Input(anyhow!(
                "the button of the robot's emergency stop is still pressed: let go of it, then `esm start --release` again"
            )),
            _ => error.into(),
        })?;
    }
    let before = robot.status()?;
    robot.start()?;
    let told = match (before.mode, before.mission) {
        (Mode::Running, Some(mission)) => {
            if Reader::default().has_finished(&mut robot, mission)? {
                format!("the mission has finished already, and nothing is begun: {RUN_ANEW}")
            } else {
                "the mission runs already, and goes on as it was".to_owned()
            }
        }
        (_, Some(_)) => "started: the mission runs from its beginning".to_owned(),
        (_, None) => "started: the robot has no mission yet, `esm upload` brings one".to_owned(),
    };
    writeln!(console.out(), "{told}")?;
    Ok(())
}
