//! `esm position`: where a robot is, and telling it where it is.
//!
//! | module | what it holds |
//! |---|---|
//! | [`place`](mod@place) | positions and corrections as a person writes them |

pub mod place;

use anyhow::anyhow;
use clap::Args;
use esm_link::features::Feature;
use esm_link::position::Correction;
use serde::Serialize;

use super::behaviours::list::connect;
use super::console::Console;
use super::exit::CommandError;
use super::robot::{self, Robot, RobotArgs};
use super::values;
use crate::parameters::Value;
use crate::run::interrupt::Interrupt;
use crate::run::mission::hash_text;
use crate::values::{Catalogue, Watched};
use place::{Difference, Position};

/// Types of values that say where a robot is: in the global frame, and as odometry counts.
const GLOBAL: &str = "GlobalPose";
const COUNTED: &str = "Pose";

/// Shows where a robot is, or tells it where it is
///
/// Its odometry counts from where it was switched on, and errors add up. Whoever knows better sets
/// the position in the global frame, or corrects it by a difference, as seen from the robot. What
/// the robot does meanwhile goes on as if nothing had happened. The mission that runs needs a task
/// state `GlobalPosition` whose region is active, such as `missions/by_hand.esm` has.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm position --port /dev/ttyACM0
  esm position --set 'x_m = 1, y_m = 0, heading_rad = 1.57'
  esm position --by 'x_m = 0.05, heading_rad = -0.02' --json")]
pub struct PositionArgs {
    /// The robot is there: x_m, y_m and heading_rad in the global frame
    #[arg(long, value_name = "POSITION", conflicts_with = "by")]
    pub set: Option<Position>,

    /// The robot is so far from where it believes itself to be: x_m ahead, y_m to the left,
    /// heading_rad to the left
    #[arg(long, value_name = "DIFFERENCE")]
    pub by: Option<Difference>,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// Where a robot is, in the form of its JSON.
#[derive(Debug, Serialize)]
struct Report<'n> {
    /// Hash of the mission.
    mission: String,
    /// When it was there, since the mission started.
    t_us: u64,
    /// The port that says so.
    port: &'n str,
    /// Whether that is in the global frame, in which the robot can be told where it is.
    global: bool,
    x_m: Value,
    y_m: Value,
    heading_rad: Value,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &PositionArgs, console: &mut Console) -> Result<(), CommandError> {
    let interrupt = Interrupt::take_over()?;
    let told = (args.set.map(|set| (Correction::Set, set.0)))
        .or_else(|| args.by.map(|by| (Correction::Difference, by.0)));
    let mut robot = match told {
        Some((correction, by)) => {
            let (mut robot, _) = connect(&args.robot, console)?;
            robot.require(Feature::Telemetry)?;
            robot.correct_position(correction, by)?;
            robot
        }
        None => {
            let (mut robot, _) = args.robot.connect(console)?;
            robot.require(Feature::Telemetry)?;
            robot
        }
    };
    let ended = show(&mut robot, args.json, &interrupt, console);
    let ended = match ended {
        Err(CommandError::World(_)) if interrupt.is_requested() => Ok(()),
        ended => ended,
    };
    robot::end_soon(&mut robot);
    // Should the robot have gone meanwhile, there is nothing left to end.
    let _ = robot.end_values();
    ended
}

/// The net that says where the robot is: in the global frame, if one does.
fn net_of(catalogue: &Catalogue) -> Result<&Watched, CommandError> {
    let of_type =
        |name: &str| (catalogue.nets.iter()).find(|watched| watched.net.type_name == name);
    of_type(GLOBAL).or_else(|| of_type(COUNTED)).ok_or_else(|| {
        CommandError::Input(anyhow!(
            "nothing in the mission that runs says where the robot is: it needs a task `GlobalPosition`, or a path from the `pose` of its `Odometry`"
        ))
    })
}

fn show(
    robot: &mut Robot,
    json: bool,
    interrupt: &Interrupt,
    console: &mut Console,
) -> Result<(), CommandError> {
    let catalogue = values::read(robot)?;
    let watched = net_of(&catalogue)?;
    let named = vec![(watched.net.name().to_owned(), watched.clone())];
    let subscription = values::begin(robot, catalogue.mission, &named, std::time::Duration::ZERO)?;
    let Some(reading) = values::first(robot, &subscription, interrupt)? else {
        return Ok(());
    };
    let first = reading.values.first().cloned().flatten();
    let Some([x_m, y_m, heading_rad]) = first.as_deref().and_then(<[Value]>::first_chunk) else {
        return Err(CommandError::World(anyhow!(
            "`{}` says nothing yet of where the robot is; ask again",
            watched.net.name()
        )));
    };
    let is_global = watched.net.type_name == GLOBAL;
    if json {
        return console.json_line(&Report {
            mission: hash_text(catalogue.mission),
            t_us: reading.t_us,
            port: watched.net.name(),
            global: is_global,
            x_m: *x_m,
            y_m: *y_m,
            heading_rad: *heading_rad,
        });
    }
    let frame = if is_global {
        "in the global frame"
    } else {
        "from where it was switched on"
    };
    console.text(&format!(
        "x {x_m:.3} m, y {y_m:.3} m, heading {heading_rad:.3} rad, {frame}\n"
    ))
}
