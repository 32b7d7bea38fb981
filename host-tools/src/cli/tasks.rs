//! `esm tasks`: what a firmware can do.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use super::argument::Port;
use super::console::Console;
use super::exit::CommandError;
use super::robot::{self, LineArgs, Robot};
use super::stage;
use crate::host_board::RobotMaker;
use crate::link_client::{LinkClient, RobotInfo};
use crate::lockstep::pace::Pace;
use crate::lockstep::plant_side::PlantSide;
use crate::plant::{BodyParameters, Plant};
use crate::run::board::{LinkWay, RunningBoard};

/// Prints a firmware's task declarations as `.esm`, so that nobody copies signatures by hand
///
/// Asks the robot at PORT, or else a board that is started for the question.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm tasks > rover_tasks.esm
  esm tasks --port /dev/ttyUSB0 > rover_tasks.esm")]
pub struct TasksArgs {
    /// Where the robot is: a serial line, unix:PATH or tcp:HOST:PORT
    #[arg(long, value_name = "PORT", conflicts_with = "board")]
    pub port: Option<Port>,

    /// The board to ask
    #[arg(long, value_name = "BOARD", default_value = "lm3s6965")]
    pub board: String,

    /// The firmware to ask on an emulated board, instead of the one that the checkout builds
    #[arg(long, value_name = "ELF", env = "ESM_FIRMWARE")]
    pub firmware: Option<PathBuf>,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub line: LineArgs,
}

/// Runs the command. `robot` is what the board `host` has.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(
    args: &TasksArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    if let Some(port) = &args.port {
        let (mut client, info) = robot::connect(port, args.line, console)?;
        return print(&mut client, &info, console);
    }
    // A board by itself, in a world that it never drives in.
    let board = stage::board(&args.board, args.firmware.as_deref(), robot, console)?;
    let plant = Plant::new(stage::world(None, None)?, BodyParameters::default(), 0)
        .map_err(|error| CommandError::Input(error.into()))?;
    let plant = PlantSide::new(plant, Pace::new(false), None);
    let (_running, line) = RunningBoard::start(board, &plant, None, LinkWay::Uart)?;
    let (mut client, info) = LinkClient::connect(line)?;
    print(&mut client, &info, console)
}

fn print(robot: &mut Robot, info: &RobotInfo, console: &mut Console) -> Result<(), CommandError> {
    writeln!(
        console.out(),
        "// The tasks of {} on the board {}, as `esm tasks` printed them.",
        info.firmware,
        info.board
    )?;
    for index in 0..info.task_types {
        let declaration = robot.task_declaration(index)?;
        writeln!(console.out(), "\n{}", declaration.trim_end())?;
    }
    Ok(())
}
