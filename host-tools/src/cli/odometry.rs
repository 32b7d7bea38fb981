//! `esm odometry`: where a robot has gone, from a log of its encoders.

use std::io::Write;
use std::path::PathBuf;

use anyhow::anyhow;
use clap::{Args, ValueEnum};
use serde::Serialize;

use super::console::Console;
use super::exit::CommandError;
use super::{argument, file};
use crate::clean::counted;
use crate::odometry::tick_log::{CounterWidth, Measures, Reckoned, TickLog};

/// Works out from a log of encoder ticks where a robot has gone
///
/// The robot starts at the origin and looks along x; y is to its left, and angles are
/// counter-clockwise. Between two rows both wheels roll evenly, on an arc, which is worked out
/// exactly.
#[derive(Debug, Args)]
#[command(after_help = "\
The log has the columns t_us,left,right. Where its first line names them, they may come in any order and among others. \
Counters may wrap at 16 or 32 bits, counted with or without a sign: what fits in 16 bits is taken to wrap there, else what \
fits in 32. --counter-bits says it where a wheel turns by more than 32,767 ticks from one row to the next.

Examples:
  esm odometry ticks.csv --ticks-per-rev 1440 --wheel-radius-mm 32.3 --base-mm 160
  esm odometry ticks.csv --ticks-per-rev 1440 --wheel-radius-mm 32.3 --base-mm 160 --json | jq .theta_deg

With --json: x_mm, y_mm, theta_deg (above -180, up to 180), distance_mm (forwards less backwards), rotation_deg (all turns), \
rows, counter_bits.")]
pub struct OdometryArgs {
    /// The log
    #[arg(value_name = "CSV")]
    pub log: PathBuf,

    /// Ticks of an encoder for one turn of its wheel
    #[arg(long, value_name = "N", value_parser = argument::measure, allow_negative_numbers = true)]
    pub ticks_per_rev: f64,

    /// Radius of the wheels, in millimetres
    #[arg(long, value_name = "R", value_parser = argument::measure, allow_negative_numbers = true)]
    pub wheel_radius_mm: f64,

    /// Distance between the wheels, in millimetres
    #[arg(long, value_name = "B", value_parser = argument::measure, allow_negative_numbers = true)]
    pub base_mm: f64,

    /// Bits of the counters [default: as the counts tell]
    #[arg(long, value_name = "BITS")]
    pub counter_bits: Option<CounterBits>,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// How wide counters are, on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum CounterBits {
    /// They wrap at 16 bits
    #[value(name = "16")]
    Bits16,
    /// They wrap at 32 bits
    #[value(name = "32")]
    Bits32,
    /// They do not wrap
    #[value(name = "64")]
    Bits64,
}

impl From<CounterBits> for CounterWidth {
    fn from(bits: CounterBits) -> Self {
        match bits {
            CounterBits::Bits16 => CounterWidth::Bits16,
            CounterBits::Bits32 => CounterWidth::Bits32,
            CounterBits::Bits64 => CounterWidth::Bits64,
        }
    }
}

/// What `--json` says.
#[derive(Serialize)]
struct Answer {
    x_mm: f64,
    y_mm: f64,
    theta_deg: f64,
    distance_mm: f64,
    rotation_deg: f64,
    rows: u64,
    counter_bits: u32,
}

/// Runs the command.
///
/// # Errors
/// If the log cannot be read, is none, or has no rows.
pub fn execute(args: &OdometryArgs, console: &mut Console) -> Result<(), CommandError> {
    let measures = Measures {
        ticks_per_rev: args.ticks_per_rev,
        wheel_radius_mm: args.wheel_radius_mm,
        base_mm: args.base_mm,
    };
    let mut log = TickLog::new(measures, args.counter_bits.map(CounterWidth::from));
    file::each_line(&args.log, "tick log", |line| log.line(line))?;
    let reckoned = (log.end())
        .map_err(|error| CommandError::Input(anyhow!("{}: {error}", args.log.display())))?;
    let bits = reckoned.counter_width.bits();
    if args.counter_bits.is_none() && is_doubtful(&reckoned) {
        console.note(&format!(
            "note: {}:{}: a wheel turns by {} ticks at once, if its counter has {bits} bits; say --counter-bits if it has more",
            args.log.display(),
            reckoned.fastest.line,
            reckoned.fastest.ticks
        ));
    }
    if args.json {
        return console.json_line(&Answer {
            x_mm: reckoned.x_mm,
            y_mm: reckoned.y_mm,
            theta_deg: reckoned.theta_deg,
            distance_mm: reckoned.distance_mm,
            rotation_deg: reckoned.rotation_deg,
            rows: reckoned.rows,
            counter_bits: bits,
        });
    }
    let out = console.out();
    writeln!(
        out,
        "{}: {}, counters of {bits} bits",
        args.log.display(),
        counted(reckoned.rows, "row")
    )?;
    for (name, value, unit) in [
        ("x", reckoned.x_mm, "mm"),
        ("y", reckoned.y_mm, "mm"),
        ("theta", reckoned.theta_deg, "degrees"),
        (
            "distance",
            reckoned.distance_mm,
            "mm, forwards less backwards",
        ),
        (
            "rotation",
            reckoned.rotation_deg,
            "degrees, counter-clockwise",
        ),
    ] {
        // None of them is shown as -0.000.
        let shown = if value.abs() < 0.0005 { 0.0 } else { value };
        writeln!(out, "  {name:<8} {shown:>12.3} {unit}")?;
    }
    Ok(())
}

/// Whether a wheel turns so far between two rows, a quarter of its counter's range, that the
/// counter may be wider than the log's values tell.
fn is_doubtful(reckoned: &Reckoned) -> bool {
    let width = reckoned.counter_width;
    width != CounterWidth::Bits64 && reckoned.fastest.ticks >> (width.bits() - 2) > 0
}
