//! `esm selftest`: a robot measures itself.

mod emulated;
mod examine;
pub mod faults;
mod missions;
mod person;
mod report;

use std::path::PathBuf;

use anyhow::anyhow;
use clap::Args;
use esm_link::features::Feature;
use esm_link::message::Mode;

use self::examine::{Examination, Eyes};
use self::faults::Fault;
use self::missions::{Declared, Parts};
use self::person::{Person, Simulation};
use self::report::Report;
use super::console::Console;
use super::exit::CommandError;
use super::robot::{Robot, RobotArgs, has_lost_robot, is_taken_over};
use super::{file, tasks};
use crate::host_board::RobotMaker;
use crate::link_client::RobotInfo;
use crate::run::drive::DEFAULT_SEED;
use crate::run::interrupt::Interrupt;
use crate::selftest::Finding;
use crate::serial::port::Port;

/// Lets a robot measure itself, and says number by number what is as it should be
///
/// Clock, slots, line, flash and stack; sonars, battery and gyroscope while it stands; motors and
/// encoders while its wheels turn. What is wired wrongly is named, with what to do about it. It
/// takes half a minute.
///
/// The robot is stopped, gets two missions on trial one after the other, and then has the mission
/// again that it had, stopped: `esm start` starts it. Nothing moves unless its wheels are off the
/// ground (`--wheels-lifted`, or the answer at a terminal). `esm stop`, the button and Ctrl-C stop
/// it at once.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm selftest --port /dev/ttyACM0
  esm selftest --wheels-lifted --write selftest.md
  esm selftest --board host
  esm selftest --board host --fault left-encoder-backwards

A motor that turns backwards and an encoder that counts backwards look alike to the robot: so at a terminal it is asked how the wheels \
turned. A simulation knows it.

The status is 1 where something is not as it should be. With --json: board, firmware, esm (versions), planted (faults), passed, findings (name, \
value, unit, limit, pass, advice; pass is null where nothing was measured, and advice says why).")]
pub struct SelftestArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// A simulated robot on this board instead
    #[arg(long, value_name = "BOARD", conflicts_with = "port")]
    pub board: Option<String>,

    /// The wheels are off the ground, and may turn
    #[arg(long, conflicts_with = "board")]
    pub wheels_lifted: bool,

    /// Plants a fault in the simulated robot, to see that it is found. May be given several times
    #[arg(
        long,
        value_name = "FAULT",
        requires = "board",
        conflicts_with = "port"
    )]
    pub fault: Vec<Fault>,

    /// Seed of the noise in sensors and wheels of the simulated robot [default: 1]
    #[arg(long, value_name = "N", requires = "board", conflicts_with = "port")]
    pub seed: Option<u64>,

    /// The firmware to start on an emulated board, instead of the one that the checkout builds
    #[arg(long, value_name = "ELF", requires = "board", conflicts_with = "port")]
    pub firmware: Option<PathBuf>,

    /// Writes a page in Markdown, for a bug report
    #[arg(long, value_name = "FILE")]
    pub write: Option<PathBuf>,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// Runs the command. `robot` is what the board `host` has.
///
/// # Errors
/// What kept it from ending well, or what is not as it should be.
pub fn execute(
    args: &SelftestArgs,
    maker: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    let interrupt = Interrupt::take_over()?;
    let (info, findings) = match &args.board {
        Some(board) => {
            let seed = args.seed.unwrap_or(DEFAULT_SEED);
            let firmware = args.firmware.as_deref();
            let mut emulated = emulated::start(board, firmware, &args.fault, seed, maker, console)?;
            let mut eyes = Simulation {
                plant: &emulated.plant,
            };
            let robot = &mut emulated.robot;
            robot.stop_when(Some(Box::new(move || interrupt.is_requested())));
            let findings = examined(robot, &emulated.info, None, true, &mut eyes, console)?;
            (emulated.info, findings)
        }
        None => {
            let (mut robot, info) = args.robot.connect_to_upload(console)?;
            robot.stop_when(Some(Box::new(move || interrupt.is_requested())));
            let is_there = person::is_there(console);
            let drives = args.wheels_lifted || (is_there && person::has_lifted_wheels(console)?);
            let baud = match &args.robot.port {
                Some(Port::Tty(_)) | None => Some(args.robot.line.baud),
                Some(_) => None,
            };
            // What is told meanwhile and what is asked go to the same person.
            let mut beside = Console::without_output();
            let mut eyes = Person {
                console: is_there.then_some(&mut beside),
            };
            let findings = examined(&mut robot, &info, baud, drives, &mut eyes, console)?;
            (info, findings)
        }
    };
    let planted = args.fault.iter().map(Fault::to_string).collect();
    let report = Report::of(&info, planted, &findings);
    if let Some(path) = &args.write {
        file::write_whole(path, report.page().as_bytes(), "page")?;
    }
    if args.json {
        console.json_line(&report)?;
    } else {
        console.text(&report.text())?;
    }
    match report.passed {
        true => Ok(()),
        false => Err(CommandError::Told),
    }
}

/// Lets a robot measure itself.
fn examined(
    robot: &mut Robot,
    info: &RobotInfo,
    baud: Option<u32>,
    drives: bool,
    eyes: &mut dyn Eyes,
    console: &mut Console,
) -> Result<Vec<Finding>, CommandError> {
    let status = robot.status()?;
    if status.mode == Mode::EmergencyStopped {
        return Err(CommandError::Input(anyhow!(
            "an emergency stop is latched on the robot: `esm start --release`, then run it again"
        )));
    }
    if status.trial.is_some() {
        return Err(CommandError::Input(anyhow!(
            "a mission is on trial on the robot: `esm confirm` or `esm fallback`, then run it again"
        )));
    }
    robot.require(Feature::Telemetry)?;
    console.note("the robot measures itself, for half a minute: Ctrl-C stops it");
    let had_mission = status.mission.is_some();
    // It has limits of its own.
    robot.limit_waits(None);
    let mut declared = Vec::new();
    for index in 0..info.task_types {
        let text = robot.task_declaration(index)?;
        let tasks = tasks::declared_in(&text, console)?;
        declared.extend(tasks.into_iter().map(|task| Declared {
            task,
            text: text.clone(),
        }));
    }
    let parts = Parts::of(&declared, drives);
    let examination = Examination::new(robot, info, parts, baud);
    let findings = examination.carry_out(eyes);
    let lost = |error: &CommandError| has_lost_robot(error) || is_taken_over(error);
    if had_mission && !findings.as_ref().is_err_and(lost) {
        console.note("the robot is stopped, and has its own mission: `esm start` starts it");
    }
    findings
}
