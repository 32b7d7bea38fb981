//! `esm stop`: motors off, with `--emergency` whatever comes.

use std::io::Write;

use anyhow::anyhow;
use clap::Args;
use esm_link::message::Mode;

use super::console::Console;
use super::exit::CommandError;
use super::robot::RobotArgs;
use crate::link_client::ClientError;

/// Stops a robot: motors off, and off they stay until `esm start`
///
/// Takes the port over from any other command of the same user that has it, such as `esm log`,
/// `top` or `upload`; beside one that is suspended, or another user's, it uses a serial line all
/// the same. `esm top` and `esm log` go on behind it, others end and say why.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm stop                                   # the only robot that is plugged in
  esm stop --port /dev/ttyUSB0               # at once: no other port is asked first
  esm stop --emergency --port /dev/ttyUSB0   # until `esm start --release`")]
pub struct StopArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// Latches the stop: neither another mission nor a reset ends it, only `esm start --release`
    #[arg(long)]
    pub emergency: bool,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &StopArgs, console: &mut Console) -> Result<(), CommandError> {
    let mut robot = args.robot.connect_to_stop(args.emergency, console)?;
    let taken = if args.emergency {
        robot.emergency_stop()
    } else {
        robot.stop()
    };
    if matches!(
        taken,
        Err(ClientError::OtherKey { .. } | ClientError::NotLocked | ClientError::Key(_))
    ) {
        console.note(
            "a stop was sent, but that the robot stands is not proven with the key that was named: look at the robot",
        );
    }
    taken?;
    // What it answered is one thing, how it is another: somebody else may have started it again.
    let told = match (robot.status()?.mode, args.emergency) {
        (Mode::EmergencyStopped, _) => {
            "emergency stop, latched: the motors are off, whatever comes, until `esm start --release`"
        }
        (Mode::Stopped, false) => "stopped: the motors are off, and stay off until `esm start`",
        (Mode::Empty, false) => "stopped: the robot has no mission, and its motors are off",
        (Mode::Safe(_), false) => {
            "stopped: the robot is in its safe state, and its motors are off until `esm start`"
        }
        (Mode::Running, _) => {
            return Err(CommandError::World(anyhow!(
                "the robot took the stop, but it runs again: somebody else commands it. Switch it off by hand; `esm stop --emergency` holds until `esm start --release`"
            )));
        }
        (Mode::Stopped | Mode::Empty | Mode::Safe(_), true) => {
            return Err(CommandError::World(anyhow!(
                "the robot's motors are off, but the emergency stop is not latched any more: somebody else has released it. Switch it off by hand"
            )));
        }
    };
    writeln!(console.out(), "{told}")?;
    if !robot.is_proven() {
        writeln!(
            console.out(),
            "the robot has an owner, and this is not the owner's key: that it has stopped is what it says, and not proven"
        )?;
    }
    Ok(())
}
