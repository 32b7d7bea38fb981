//! `esm log`: what a robot says.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;

use super::console::Console;
use super::exit::CommandError;
use super::robot::RobotArgs;
use super::stage;
use crate::host_board;
use crate::link_client::StreamEvent;
use crate::link_client::log_lines::LogReader;
use crate::run::interrupt::Interrupt;

/// How long a wait for the next line may last before Ctrl-C is looked for.
const LISTEN_TIME: Duration = Duration::from_millis(100);

/// Shows what the firmware logs, decoded, as it comes
///
/// Runs until Ctrl-C. Lines that the robot could not keep are counted and said. Where a line begins with a time, it is in seconds of
/// the board's clock, since it was switched on.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm log --port /dev/ttyUSB0
  esm log --port unix:/tmp/robot --firmware target/firmware/lm3s6965/rover.elf")]
pub struct LogArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// The firmware that the robot runs, whose file holds the texts of the log
    #[arg(long, value_name = "ELF", env = "ESM_FIRMWARE")]
    pub firmware: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &LogArgs, console: &mut Console) -> Result<(), CommandError> {
    let interrupt = Interrupt::take_over()?;
    let (mut robot, info) = args.robot.connect()?;
    let mut log = reader(&info.board, args.firmware.as_deref(), console)?;
    robot.subscribe(false, true)?;
    while !interrupt.is_requested() {
        robot.listen(LISTEN_TIME)?;
        for event in robot.take_events() {
            match event {
                StreamEvent::Log(bytes) => {
                    for line in log.lines(&bytes) {
                        writeln!(console.out(), "{line}")?;
                    }
                    console.flush()?;
                }
                StreamEvent::Gap { missing, .. } => {
                    console.note(&format!("({missing} lines or pieces did not come)"));
                }
                StreamEvent::Trace(_) => {}
            }
        }
    }
    // Should the robot have gone meanwhile, there is nothing left to end.
    let _ = robot.subscribe(false, false);
    Ok(())
}

/// What decodes the log of that board: the host board's is plain text, another's needs its firmware's file.
fn reader(
    board: &str,
    named: Option<&Path>,
    console: &mut Console,
) -> Result<LogReader, CommandError> {
    if board == host_board::BOARD {
        return Ok(LogReader::text());
    }
    let path = stage::find_firmware(named, console)?;
    LogReader::firmware(&path).map_err(|error| CommandError::World(error.into()))
}
