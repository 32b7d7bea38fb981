//! `esm tune`: what a robot's motors are like, and gains that suit them.

mod by_hand;
mod found;
mod numbers;
mod robot;
mod simulated;
mod tune_mission;
mod write;

use std::path::PathBuf;

use clap::Args;

use self::by_hand::{ByHand, Pair};
use self::found::{Found, report};
use self::tune_mission::{MISSION, mission_with};
use self::write::Target;
use super::console::Console;
use super::exit::CommandError;
use super::robot::RobotArgs;
use super::run::read_recording;
use crate::host_board::RobotMaker;
use crate::recording::player::Recording;
use crate::run::drive::DEFAULT_SEED;

/// Works out what a robot's motors are like, and gains of `WheelSpeed` that suit them
///
/// The robot drives half a metre slowly and 1.2 m fast, forwards and back, and turns on the spot.
/// From what its motors get and how fast its wheels roll follow the speed at full power, the power
/// that friction takes, the lag, and the gains. Then it drives the same once more with those, which
/// shows whether they are better. With FILE, a recording, nothing is driven. Without a port the
/// simulated rover drives.
///
/// What a person has measured on the floor (`--way`, `--turns`, `--counts`) goes into a robot's
/// file as it is: wheel base, radius of the wheels, counts of an encoder. Nothing is driven then.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm tune
  esm tune --port /dev/ttyACM0 --write robot.toml --write patrol.esm
  esm tune drive.rec --json
  esm tune --way 9.87,10 --turns 9.8,10 --write robot.toml
  esm tune --counts 14396,10 --write robot.toml

The robot sees nothing while it drives: it needs 1.5 m by 0.5 m of free floor ahead of it, or its wheels in the air. Ctrl-C stops \
it. Afterwards it has the mission tune.esm: give it its own again.

With --json: period_s, motors (side, full_speed_m_per_s, friction_power, lag_s, error_m_per_s), gains (proportional_s_per_m, \
integral_per_m), speed_error_m_per_s (before, after; null where nothing was driven with the new gains), written (the files). With measures of a person: file, base_m, radius_m, \
counts_per_revolution.")]
pub struct TuneArgs {
    /// A recording of a drive with `WheelSpeed`'s `control` and `Odometry`'s `speeds` on nets, a
    /// sample each macro step
    #[arg(value_name = "FILE", conflicts_with_all = ["port", "seed", "once"])]
    pub file: Option<PathBuf>,

    /// Where the result goes, too: into a robot's file (.toml) full speed and friction, into a
    /// mission (.esm) the gains of its task states `WheelSpeed`. May be given several times
    #[arg(long, value_name = "FILE")]
    pub write: Vec<PathBuf>,

    /// Drives once: nothing shows whether the new gains are better
    #[arg(long)]
    pub once: bool,

    /// A way ahead, in metres: by the tape, and by the robot's pose (`esm values`)
    #[arg(long, value_name = "TAPE,POSE", conflicts_with_all = ["file", "port", "seed", "once"])]
    pub way: Option<Pair>,

    /// Turns on the spot: those that it made, and those by its pose
    #[arg(long, value_name = "MADE,POSE", conflicts_with_all = ["file", "port", "seed", "once"])]
    pub turns: Option<Pair>,

    /// Counts of an encoder, and the turns of its wheel, by hand, that they are of
    #[arg(long, value_name = "COUNTS,TURNS", conflicts_with_all = ["file", "port", "seed", "once"])]
    pub counts: Option<Pair>,

    /// Seed of the noise in sensors and wheels of the simulated rover [default: 1]
    #[arg(long, value_name = "N", conflicts_with = "port")]
    pub seed: Option<u64>,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// Runs the command. `robot` is what the board `host` has.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(
    args: &TuneArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    // Before anything moves.
    let targets: Vec<Target> = (args.write.iter())
        .map(|path| Target::of(path))
        .collect::<Result<_, _>>()?;
    let by_hand = ByHand {
        way: args.way,
        turns: args.turns,
        counts: args.counts,
    };
    if !by_hand.is_empty() {
        return by_hand.write(&targets, args.json, console);
    }
    let (found, after) = match &args.file {
        Some(path) => (Found::of(&read_recording(path)?)?, None),
        None => driven(args, robot, console)?,
    };
    let mut written = Vec::new();
    for target in &targets {
        console.note(&target.write(&found)?);
        written.push(target.path());
    }
    report(&found, after, &written, args.json, console)
}

/// Drives, and drives again with what was found. Returns by how much the wheels then missed their
/// set points, too, in metres per second.
fn driven(
    args: &TuneArgs,
    maker: RobotMaker,
    console: &mut Console,
) -> Result<(Found, Option<f64>), CommandError> {
    let drive = |mission: &str, console: &mut Console| -> Result<Recording, CommandError> {
        if args.robot.port.is_some() {
            robot::drive(&args.robot, mission, console)
        } else {
            simulated::drive(mission, args.seed.unwrap_or(DEFAULT_SEED), maker)
        }
    };
    if args.robot.port.is_none() {
        console.note("the simulated rover drives; `--port` names a robot");
    }
    let found = Found::of(&drive(MISSION, console)?)?;
    if args.once {
        return Ok((found, None));
    }
    let again = drive(&mission_with(&found.gains)?, console)?;
    let after = Found::of(&again)?.speed_error_m_per_s;
    Ok((found, Some(after)))
}
