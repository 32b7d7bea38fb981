//! `esm stop`: motors off, with `--emergency` whatever comes.

use std::io::Write;

use clap::Args;

use super::console::Console;
use super::exit::CommandError;
use super::robot::RobotArgs;

/// Stops a robot: motors off, and off they stay until `esm start`
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm stop --port /dev/ttyUSB0
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
    let (mut robot, _) = args.robot.connect()?;
    let told = if args.emergency {
        robot.emergency_stop()?;
        "emergency stop, latched: the motors are off, whatever comes, until `esm start --release`"
    } else {
        robot.stop()?;
        "stopped: the motors are off, and stay off until `esm start`"
    };
    writeln!(console.out(), "{told}")?;
    Ok(())
}
