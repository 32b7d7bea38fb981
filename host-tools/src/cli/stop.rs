//! `esm stop`: motors off.

use std::io::Write;

use clap::Args;

use super::console::Console;
use super::exit::CommandError;
use super::robot::RobotArgs;

/// Stops a robot: motors off, and off they stay until `esm start`
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  esm stop --port /dev/ttyUSB0")]
pub struct StopArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &StopArgs, console: &mut Console) -> Result<(), CommandError> {
    let (mut robot, _) = args.robot.connect()?;
    robot.stop()?;
    writeln!(
        console.out(),
        "stopped: the motors are off, and stay off until `esm start`"
    )?;
    Ok(())
}
