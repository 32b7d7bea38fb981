//! `esm tune`: what a robot's motors are like, and gains that suit them.

mod found;
mod robot;
mod simulated;
mod write;

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use clap::Args;

use self::found::{Found, report};
use self::write::Target;
use super::console::Console;
use super::exit::CommandError;
use super::robot::RobotArgs;
use super::run::read_recording;
use crate::host_board::RobotMaker;
use crate::recording::player::Recording;
use crate::run::drive::DEFAULT_SEED;
use crate::tune::Gains;

/// The mission that is driven.
const MISSION: &str = include_str!("../../../missions/tune.esm");
/// The tasks that it has.
const ROVER: &str = include_str!("../../../missions/rover.esm");

/// The task whose gains are looked for, and its parameters.
const TASK: &str = "WheelSpeed";
const PROPORTIONAL: &str = "proportional_s_per_m";
const INTEGRAL: &str = "integral_per_m";

/// Works out what a robot's motors are like, and gains of `WheelSpeed` that suit them
///
/// The robot drives half a metre slowly and 1.2 m fast, forwards and back, and turns on the spot.
/// From what its motors get and how fast its wheels roll follow the speed at full power, the power
/// that friction takes, the lag, and the gains. Then it drives the same once more with those, which
/// shows whether they are better. With FILE, a recording, nothing is driven. Without a port the
/// simulated rover drives.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm tune
  esm tune --port /dev/ttyACM0 --write robot.toml --write patrol.esm
  esm tune drive.rec --json

The robot sees nothing while it drives: it needs 1.5 m by 0.5 m of free floor ahead of it, or its wheels in the air. Ctrl-C stops \
it. Afterwards it has the mission tune.esm: give it its own again.

With --json: period_s, motors (side, full_speed_m_per_s, friction_power, lag_s, error_m_per_s), gains (proportional_s_per_m, \
integral_per_m), speed_error_m_per_s (before, after; null where nothing was driven with the new gains), written (the files).")]
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

/// The mission with these gains.
fn mission_with(gains: &Gains) -> Result<String, CommandError> {
    let files = [("tune.esm", MISSION), ("rover.esm", ROVER)];
    let rewritten = crate::lang::load_texts(&files).with_values(TASK, &values_of(gains));
    let rewritten = rewritten.ok_or_else(|| CommandError::Input(anyhow!("tune.esm has errors")))?;
    Ok(rewritten.text)
}

/// Gains as parameters, in the digits that they are told in.
fn values_of(gains: &Gains) -> [(&'static str, String); 2] {
    [
        (
            PROPORTIONAL,
            format!("{:?}", rounded(gains.proportional_s_per_m)),
        ),
        (INTEGRAL, format!("{:?}", rounded(gains.integral_per_m))),
    ]
}

/// A number to three digits: more than a drive says.
fn rounded(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return 0.0;
    }
    let digits = 2 - libm::floor(libm::log10(libm::fabs(value))) as i32;
    let scale = libm::pow(10.0, f64::from(digits));
    libm::round(value * scale) / scale
}

/// Whether a path ends like this.
fn ends_in(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|end| end == extension)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_digits() {
        for (value, expected) in [
            (1.23456, 1.23),
            (14.29, 14.3),
            (0.067_89, 0.0679),
            (0.0, 0.0),
        ] {
            assert_eq!(rounded(value), expected);
        }
    }

    #[test]
    fn the_mission_takes_the_gains_in_its_one_state() {
        let gains = Gains {
            proportional_s_per_m: 1.5,
            integral_per_m: 20.0,
        };
        let text = mission_with(&gains).expect("a mission");
        let state =
            "task Drive: WheelSpeed with { proportional_s_per_m = 1.5, integral_per_m = 20.0 };";
        assert_eq!(text.matches(state).count(), 1);
        assert_eq!(text.matches(PROPORTIONAL).count(), 1);
    }
}
