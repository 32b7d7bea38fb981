//! `esm board`: an emulated robot that waits for missions.

use std::io::{self, BufRead, Write};
use std::path::PathBuf;
use std::sync::mpsc::{self, Receiver};
use std::thread;
use std::time::Duration;

use clap::{Args, ValueEnum};
use esm_link::features::Feature;

use super::console::Console;
use super::exit::CommandError;
use super::stage;
use crate::host_board::RobotMaker;
use crate::link_client::LinkClient;
use crate::lockstep::pace::Pace;
use crate::lockstep::plant_side::PlantSide;
use crate::plant::Plant;
use crate::run::board::{LinkWay, RunningBoard};
use crate::run::interrupt::Interrupt;
use crate::serial::pty::PtyServer;

/// How often Ctrl-C and the board's health are looked for.
const LOOK_INTERVAL: Duration = Duration::from_millis(50);

/// Starts an emulated robot that waits for missions on a serial line
///
/// Runs in real time until Ctrl-C and prints the port that `esm upload`, `top`, `status`, `log`,
/// `stop`, `start` and `tasks` take.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm board --world corridor
  esm board --flash robot.flash                         # with the missions that it was given before
  esm board --estop                                     # with a button under the Enter key
  esm board --board pico --link usb                     # over the USB of the emulated chip
  esm upload missions/patrol.esm --port /dev/pts/7      # with the port that `esm board` printed")]
pub struct BoardArgs {
    /// The board to run on
    #[arg(long, value_name = "BOARD", default_value = crate::boards::DEFAULT)]
    pub board: String,

    /// The world to drive in: a file, or the name of one that ships, `office`, `corridor`, `track`,
    /// `empty`, `visitors`, `office_floor`, `shut_doors` or `cluttered` [default: office]
    #[arg(long, value_name = "WORLD")]
    pub world: Option<PathBuf>,

    /// Seed of the noise in sensors and wheels
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Keeps the robot's flash, with the missions in it, in this file: a robot that is switched off
    /// and on runs its confirmed mission by itself
    #[arg(long, value_name = "FILE")]
    pub flash: Option<PathBuf>,

    /// The serial line of the board that leads to the port
    #[arg(long, value_name = "WAY", default_value = "uart")]
    pub link: BoardLink,

    /// Gives the button of the robot's emergency stop to the Enter key: it presses the button, and
    /// lets go of it the next time
    #[arg(long)]
    pub estop: bool,

    /// The firmware to start on an emulated board, instead of the one that the checkout builds
    #[arg(long, value_name = "ELF", env = "ESM_FIRMWARE")]
    pub firmware: Option<PathBuf>,
}

/// The serial line of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum BoardLink {
    /// Its UART
    Uart,
    /// Its USB, where it has one
    Usb,
}

impl From<BoardLink> for LinkWay {
    fn from(link: BoardLink) -> Self {
        match link {
            BoardLink::Uart => LinkWay::Uart,
            BoardLink::Usb => LinkWay::Usb,
        }
    }
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
    let link = args.link.into();
    board.check_link(link)?;
    let world = stage::world(args.world.as_deref(), None)?;
    let plant = Plant::new(world, stage::body(args.firmware.as_deref())?, args.seed)
        .map_err(|error| CommandError::Input(error.into()))?;
    let flash = stage::flash(args.flash.as_deref(), &board)?;
    let plant = PlantSide::new(plant, Pace::new(true), None).with_flash(flash);
    let (mut running, line) = RunningBoard::start(board, &plant, None, link)?;
    let line = match &args.flash {
        Some(_) => {
            // Nobody should find out at the next start that nothing was kept.
            let (mut robot, _) = LinkClient::connect(line)?;
            robot.require(Feature::Store)?;
            robot.into_line()
        }
        None => line,
    };
    let server = PtyServer::start(line)?;
    let port = server.path().display();
    writeln!(
        console.out(),
        "the robot is at {port}; Ctrl-C ends it\n\n  esm upload missions/patrol.esm --port {port}\n  esm top --port {port}\n  esm status --port {port}\n  esm log --port {port}"
    )?;
    let button = args.estop.then(Button::start).transpose()?;
    if button.is_some() {
        writeln!(
            console.out(),
            "\nEnter presses the button of the emergency stop, and Enter again lets go of it"
        )?;
    }
    console.flush()?;
    while !interrupt.is_requested() && !server.has_ended() {
        running.check()?;
        if let Some(pressed) = button.as_ref().and_then(Button::change) {
            plant.press_stop(pressed);
            let told = if pressed {
                "the button of the emergency stop is pressed"
            } else {
                "the button of the emergency stop is up again: `esm start --release` starts the robot"
            };
            writeln!(console.out(), "{told}")?;
            console.flush()?;
        }
        thread::sleep(LOOK_INTERVAL);
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

/// The Enter key of whoever started the board, as the button of the emergency stop: each line of
/// standard input presses it, or lets go of it.
struct Button {
    changes: Receiver<bool>,
}

impl Button {
    /// # Errors
    /// The system has no thread for it.
    fn start() -> io::Result<Self> {
        let (change, changes) = mpsc::channel();
        // It waits for a key as long as the process lives.
        thread::Builder::new().spawn(move || {
            let mut pressed = false;
            for _ in io::stdin().lock().lines().map_while(Result::ok) {
                pressed = !pressed;
                if change.send(pressed).is_err() {
                    break;
                }
            }
        })?;
        Ok(Button { changes })
    }

    /// Whether it is pressed now, if it was not a moment before, or the other way round.
    fn change(&self) -> Option<bool> {
        self.changes.try_recv().ok()
    }
}
