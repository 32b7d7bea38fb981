//! `esm board`: an emulated robot that waits for missions.

use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use super::console::Console;
use super::exit::CommandError;
use super::stage;
use crate::host_board::RobotMaker;
use crate::lockstep::pace::Pace;
use crate::lockstep::plant_side::PlantSide;
use crate::plant::{BodyParameters, Plant};
use crate::run::board::{LinkWay, RunningBoard};
use crate::run::interrupt::Interrupt;
use crate::serial::pty::PtyServer;

/// How often Ctrl-C and the board's health are looked for.
const LOOK_INTERVAL: Duration = Duration::from_millis(50);

/// Starts an emulated robot that waits for missions on a serial line
///
/// Runs in real time until Ctrl-C and prints the port that `esm upload`, `top`, `status`, `log`, `stop`, `start` and `tasks` take.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm board --world corridor
  esm board --flash robot.flash                         # with the missions that it was given before
  esm upload missions/patrol.esm --port /dev/pts/7      # with the port that `esm board` printed")]
pub struct BoardArgs {
    /// The board to run on
    #[arg(long, value_name = "BOARD", default_value = "lm3s6965")]
    pub board: String,

    /// The world to drive in: a file, or the name of one that ships, `office`, `corridor` or `track` [default: office]
    #[arg(long, value_name = "WORLD")]
    pub world: Option<PathBuf>,

    /// Seed of the noise in sensors and wheels
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Keeps the robot's flash, with the missions in it, in this file: a robot that is switched off and on runs its confirmed mission by itself
    #[arg(long, value_name = "FILE")]
    pub flash: Option<PathBuf>,

    /// The firmware to start on an emulated board, instead of the one that the checkout builds
    #[arg(long, value_name = "ELF", env = "ESM_FIRMWARE")]
    pub firmware: Option<PathBuf>,
}

/// Runs the command. `robot` is what the board `host` has.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(
    args: &BoardArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    let interrupt = Interrupt::take_over()?;
    let board = stage::board(&args.board, args.firmware.as_deref(), robot, console)?;
    let world = stage::world(args.world.as_deref(), None)?;
    let plant = Plant::new(world, BodyParameters::default(), args.seed)
        .map_err(|error| CommandError::Input(error.into()))?;
    let flash = stage::flash(args.flash.as_deref(), &board)?;
    let plant = PlantSide::new(plant, Pace::new(true), None).with_flash(flash);
    let (mut running, line) = RunningBoard::start(board, &plant, None, LinkWay::Uart)?;
    let server = PtyServer::start(line)?;
    let port = server.path().display();
    writeln!(
        console.out(),
        "the robot is at {port}; Ctrl-C ends it\n\n  esm upload missions/patrol.esm --port {port}\n  esm top --port {port}\n  esm status --port {port}\n  esm log --port {port}"
    )?;
    console.flush()?;
    while !interrupt.is_requested() && !server.has_ended() {
        running.check()?;
        std::thread::sleep(LOOK_INTERVAL);
    }
    let driven = plant.at_end();
    writeln!(
        console.out(),
        "driven: {:.2} m, {} collisions",
        driven.distance_m(),
        driven.collisions()
    )?;
    Ok(())
}
