//! `esm umbmark run`: the square test on the simulated robot.

use std::path::PathBuf;

use anyhow::anyhow;
use clap::Args;
use rt_firmware::rover::Measures;

use super::squares::Squares as Course;
use crate::bench::{in_order, processors};
use crate::clean::counted;
use crate::cli::argument;
use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::cli::file;
use crate::cli::seeds::Seeds;
use crate::host_board::RobotMaker;
use crate::odometry::umbmark::{Direction, Evaluation, Squares};
use crate::plant::BodyParameters;
use crate::run::interrupt::Interrupt;

/// The longest side that the mission's task drives, in millimetres.
const LONGEST_SIDE_MM: f64 = 20_000.0;

/// Drives the squares on the simulated rover, and evaluates them
///
/// The robot drives by its odometry on the board `host`, once a seed in each direction. Where it
/// really is, the simulator tells; from that the place is taken off that its odometry tells.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm umbmark run
  esm umbmark run --seeds 1..=10 -o squares.csv
  esm umbmark run --true-base-mm 206 --json
  esm umbmark run --true-base-mm 206 --gyro=0.99

With -o the table is kept that `esm umbmark squares.csv --side-mm 1000 --base-mm 201.5` reads.")]
pub struct RunArgs {
    /// The seeds of noise and slip, from the first to the last, or one: a square in each direction
    /// for each
    #[arg(long, value_name = "FIRST..=LAST", default_value = "1..=5")]
    pub seeds: Seeds,

    /// Side of the square, in millimetres, at most 20,000
    #[arg(long, value_name = "L", value_parser = argument::measure, default_value = "1000")]
    pub side_mm: f64,

    /// Distance between the wheels of the simulated body, in millimetres [default: the one that the
    /// rover's firmware works with]
    #[arg(long, value_name = "B", value_parser = argument::measure)]
    pub true_base_mm: Option<f64>,

    /// Takes how far the robot turns from its gyroscope, whose rates are multiplied by SCALE, 0.9
    /// to 1.1
    #[arg(
        long,
        value_name = "SCALE",
        value_parser = gyro_scale,
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "1.0"
    )]
    pub gyro: Option<f64>,

    /// Where the table of the squares goes
    #[arg(short, long, value_name = "CSV")]
    pub output: Option<PathBuf>,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// The scale of a gyroscope, as the task `Gyro` takes it.
fn gyro_scale(word: &str) -> Result<f64, String> {
    let scale = word.parse::<f64>().ok();
    scale
        .filter(|scale| (0.9..=1.1).contains(scale))
        .ok_or_else(|| "write a number from 0.9 to 1.1".to_owned())
}

/// The wheel base that the rover's firmware works with, in millimetres, as a person writes it.
pub fn base_mm() -> f64 {
    // Not a binary fraction: 201.5, and nothing behind it.
    let tenths_mm = f64::from(Measures::ROVER.chassis.wheel_base_m) * 1e4;
    libm::round(tenths_mm) / 10.0
}

/// Drives the squares, keeps the table where that is asked for, and evaluates it.
///
/// # Errors
/// If a square is not driven to its end, or the squares say nothing.
pub fn evaluated(
    args: &RunArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<Evaluation, CommandError> {
    if args.side_mm > LONGEST_SIDE_MM {
        return Err(CommandError::Usage(anyhow!(
            "a side of {} mm is longer than the robot's tasks drive: give at most {LONGEST_SIDE_MM}",
            args.side_mm
        )));
    }
    if let Some(output) = &args.output {
        file::keep_sources(output, [])?;
        file::has_folder(output, "table")?;
    }
    let interrupt = Interrupt::take_over()?;
    let mut body = BodyParameters::default();
    if let Some(true_base_mm) = args.true_base_mm {
        body.wheel_base_m = true_base_mm / 1e3;
    }
    let course = Course::new(args.side_mm / 1e3, body, args.gyro)?;
    let ways = [Direction::Clockwise, Direction::CounterClockwise];
    let work: Vec<(Direction, u64)> = (ways.into_iter())
        .flat_map(|way| args.seeds.0.clone().map(move |seed| (way, seed)))
        .collect();
    let bar = console.progress("driving", work.len() as u64);
    let mut table = "direction,x_mm,y_mm\n".to_owned();
    let mut done = 0;
    let driven = in_order(
        processors(),
        &work,
        |(way, seed)| (*way, course.drive(*way, *seed, robot, interrupt)),
        |(way, driven)| {
            let end = driven?;
            done += 1;
            bar.set_position(done);
            let name = match way {
                Direction::Clockwise => "cw",
                Direction::CounterClockwise => "ccw",
            };
            // A tape has no micrometres.
            table += &format!("{name},{:.1},{:.1}\n", end.x_mm, end.y_mm);
            Ok::<(), CommandError>(())
        },
    );
    bar.finish_and_clear();
    driven?;
    // What is written is what is evaluated.
    let mut squares = Squares::default();
    for line in table.lines() {
        (squares.line(line.as_bytes())).map_err(|error| CommandError::Input(error.into()))?;
    }
    if let Some(output) = &args.output {
        file::write_whole(output, table.as_bytes(), "table")?;
        let squares = counted(done, "square");
        console.note(&format!("{squares} in {}", output.display()));
    }
    (squares.evaluate(args.side_mm, base_mm())).map_err(|error| CommandError::Input(error.into()))
}
