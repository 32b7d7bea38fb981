//! `esm umbmark`: wheel base and wheels of a robot, from squares that it drove.

mod run;
mod squares;

use std::io::Write;
use std::path::PathBuf;

use anyhow::anyhow;
use clap::{Args, Subcommand};
use serde::Serialize;

use super::console::Console;
use super::exit::CommandError;
use super::robot_toml::RobotToml;
use super::{argument, file};
use crate::clean::counted;
use crate::host_board::RobotMaker;
use crate::odometry::umbmark::{Direction, Evaluation, Offset, Squares};

pub use run::RunArgs;

/// Works out a robot's wheel base and the ratio of its wheels from squares that it drove
///
/// Let the robot drive a square by its odometry, back to where it began: five times clockwise and
/// five times counter-clockwise. Measure where it really ends each time, from where it began: x
/// along the first side, y to the left of it. `esm umbmark run` has the simulated robot drive them.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
#[command(after_help = "\
The table has the columns direction,x_mm,y_mm; a direction is cw (clockwise) or ccw. If the odometry was not back at the \
start, subtract the place that it tells from the one that you have measured.

Examples:
  esm umbmark squares.csv --side-mm 1000 --base-mm 160
  esm umbmark squares.csv --side-mm 1000 --base-mm 160 --write robot.toml
  esm umbmark run -o squares.csv
  esm umbmark --cw -12,-20 --cw -15,-18 --ccw -4,9 --ccw -6,8 --side-mm 1000 --base-mm 160 --json

With --json: cw and ccw (runs, x_mm, y_mm, r_mm: the centre of gravity of where they ended, and its distance), e_max_syst_mm, \
alpha_deg and beta_deg (with alpha_x_deg, alpha_y_deg, beta_x_deg, beta_y_deg, of which they are the means), radius_mm (null: straight), \
e_b, e_d, base_mm (the true wheel base), left_diameter_factor, right_diameter_factor.

After J. Borenstein and L. Feng, \"Measurement and Correction of Systematic Odometry Errors in Mobile Robots\", \
IEEE Transactions on Robotics and Automation 12(6), 1996.")]
pub struct UmbmarkArgs {
    /// Squares that are still to be driven.
    #[command(subcommand)]
    pub action: Option<Action>,

    /// The table of where the squares ended
    #[arg(value_name = "CSV", conflicts_with_all = ["cw", "ccw"], required_unless_present_any = ["cw", "ccw"])]
    pub table: Option<PathBuf>,

    /// Where a clockwise square ended, in millimetres; once for each
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true)]
    pub cw: Vec<Offset>,

    /// Where a counter-clockwise square ended
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true)]
    pub ccw: Vec<Offset>,

    /// Side of the square, in millimetres
    #[arg(long, value_name = "L", value_parser = argument::measure, allow_negative_numbers = true, required = true)]
    pub side_mm: Option<f64>,

    /// Distance between the wheels that the odometry worked with, in millimetres
    #[arg(long, value_name = "B", value_parser = argument::measure, allow_negative_numbers = true, required = true)]
    pub base_mm: Option<f64>,

    /// A robot's file (.toml) that the wheel base goes into
    #[arg(long, value_name = "ROBOT.toml")]
    pub write: Option<PathBuf>,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// What is done before the squares are evaluated.
#[derive(Debug, Subcommand)]
#[allow(
    missing_docs,
    reason = "each variant carries the documentation of its arguments"
)]
pub enum Action {
    Run(RunArgs),
}

/// What `--json` says.
#[derive(Serialize)]
struct Answer {
    cw: Centre,
    ccw: Centre,
    e_max_syst_mm: f64,
    alpha_deg: f64,
    alpha_x_deg: f64,
    alpha_y_deg: f64,
    beta_deg: f64,
    beta_x_deg: f64,
    beta_y_deg: f64,
    radius_mm: Option<f64>,
    e_b: f64,
    e_d: f64,
    base_mm: f64,
    left_diameter_factor: f64,
    right_diameter_factor: f64,
}

/// The centre of gravity of where the squares of one direction ended.
#[derive(Serialize)]
struct Centre {
    runs: u64,
    x_mm: f64,
    y_mm: f64,
    r_mm: f64,
}

impl Answer {
    fn of(found: &Evaluation) -> Self {
        let [cw, ccw] = [0, 1].map(|direction| Centre {
            runs: found.runs[direction],
            x_mm: found.centres[direction].x_mm,
            y_mm: found.centres[direction].y_mm,
            r_mm: found.centres[direction].length_mm(),
        });
        let [alpha_x_deg, alpha_y_deg] = found.alphas_rad.map(f64::to_degrees);
        let [beta_x_deg, beta_y_deg] = found.betas_rad.map(f64::to_degrees);
        Self {
            cw,
            ccw,
            e_max_syst_mm: found.e_max_syst_mm,
            alpha_deg: found.alpha_rad.to_degrees(),
            alpha_x_deg,
            alpha_y_deg,
            beta_deg: found.beta_rad.to_degrees(),
            beta_x_deg,
            beta_y_deg,
            radius_mm: found.radius_mm,
            e_b: found.e_b,
            e_d: found.e_d,
            base_mm: found.base_mm,
            left_diameter_factor: found.diameter_factors[0],
            right_diameter_factor: found.diameter_factors[1],
        }
    }
}

/// Runs the command. `robot` is what the board `host` has.
///
/// # Errors
/// If the table cannot be read or is none, a square is not driven, or the squares say nothing of
/// the robot.
pub fn execute(
    args: &UmbmarkArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    // Before anything is worked out.
    let robot_toml = args.write.as_deref().map(RobotToml::read).transpose()?;
    let (found, base_mm, json) = match (&args.action, args.side_mm, args.base_mm) {
        (Some(Action::Run(run)), _, _) => (
            run::evaluated(run, robot, console)?,
            run::base_mm(),
            run.json,
        ),
        (None, Some(side_mm), Some(base_mm)) => {
            (evaluated(args, side_mm, base_mm)?, base_mm, args.json)
        }
        (None, _, _) => {
            return Err(CommandError::Usage(anyhow!(
                "give the side of the square with `--side-mm`, and the wheel base with `--base-mm`"
            )));
        }
    };
    let answer = Answer::of(&found);
    match json {
        true => console.json_line(&answer)?,
        false => tell(base_mm, &answer, console)?,
    }
    if let Some(robot) = &robot_toml {
        // A tenth of a millimetre: more than squares say.
        let base_m = libm::round(answer.base_mm * 10.0) / 10_000.0;
        robot.write_wheels(&[("base_m", base_m)])?;
        console.note(&format!(
            "{}: base_m = {base_m}; it holds in the firmware that is built from it next",
            robot.path().display()
        ));
    }
    Ok(())
}

/// What squares say that were driven before.
fn evaluated(args: &UmbmarkArgs, side_mm: f64, base_mm: f64) -> Result<Evaluation, CommandError> {
    let mut squares = Squares::default();
    let ends = (args.cw.iter().map(|end| (Direction::Clockwise, end))).chain(
        args.ccw
            .iter()
            .map(|end| (Direction::CounterClockwise, end)),
    );
    for (direction, end) in ends {
        squares.add(direction, *end);
    }
    if let Some(table) = &args.table {
        file::each_line(table, "table of squares", |line| squares.line(line))?;
    }
    squares
        .evaluate(side_mm, base_mm)
        .map_err(|error| match &args.table {
            Some(table) => CommandError::Input(anyhow!("{}: {error}", table.display())),
            None => CommandError::Usage(error.into()),
        })
}

fn tell(base_mm: f64, answer: &Answer, console: &mut Console) -> Result<(), CommandError> {
    let out = console.out();
    for (name, centre) in [
        ("clockwise", &answer.cw),
        ("counter-clockwise", &answer.ccw),
    ] {
        writeln!(
            out,
            "{name:<18} {}, on average to x {:.1} mm, y {:.1} mm: {:.1} mm off",
            counted(centre.runs, "run"),
            centre.x_mm,
            centre.y_mm,
            centre.r_mm
        )?;
    }
    writeln!(out, "E_max,syst         {:.1} mm", answer.e_max_syst_mm)?;
    writeln!(
        out,
        "type A             alpha {:.4} degrees a corner (from x {:.4}, from y {:.4}): E_b {:.5}",
        answer.alpha_deg, answer.alpha_x_deg, answer.alpha_y_deg, answer.e_b
    )?;
    writeln!(
        out,
        "type B             beta {:.4} degrees a side (from x {:.4}, from y {:.4}), {}: E_d {:.5}",
        answer.beta_deg,
        answer.beta_x_deg,
        answer.beta_y_deg,
        match answer.radius_mm {
            Some(radius_mm) => format!("a radius of {:.1} m", radius_mm / 1_000.0),
            None => "straight".to_owned(),
        },
        answer.e_d
    )?;
    writeln!(
        out,
        "wheel base         {:.2} mm in the place of {base_mm} mm",
        answer.base_mm
    )?;
    writeln!(
        out,
        "wheel diameters    left times {:.6}, right times {:.6}",
        answer.left_diameter_factor, answer.right_diameter_factor
    )?;
    Ok(())
}
