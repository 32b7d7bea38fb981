//! Squares that a simulated robot drives by its odometry, for `esm umbmark run`.

use std::time::Duration;

use anyhow::anyhow;
use esm_toolkit::values::Shape;

use crate::cli::exit::CommandError;
use crate::cli::own_drive::{OwnDrive, compiled};
use crate::host_board::RobotMaker;
use crate::odometry::umbmark::{Direction, Offset};
use crate::parameters::Value;
use crate::plant::{BodyParameters, Plant};
use crate::recording::player::Recording;
use crate::run::interrupt::Interrupt;
use crate::run::mission::Mission;
use crate::world::World;

/// The mission: counter-clockwise, with sides of 1 m.
const SQUARE: &str = include_str!("square.esm");

/// The same with a gyroscope.
const SQUARE_WITH_GYRO: &str = include_str!("square_gyro.esm");

/// What in it says with what the gyroscope's rates are multiplied.
const SCALE: &str = "scale = 1.0";

/// What in both says how long a side is, and which way the corners go.
const SIDE: &str = "distance_m = 1.0";
const TO_THE_LEFT: &str = " / set .left";

/// What the mission is called in messages.
const NAME: &str = "square.esm";

/// How slowly a square is driven at the slowest, in metres per second, and how long its corners
/// take at most, all four: far more than each takes.
const SLOWEST_M_PER_S: f64 = 0.1;
const CORNERS_S: f64 = 60.0;

/// How often the pose is kept.
const SAMPLE_PERIOD: Duration = Duration::from_millis(100);

/// A robot that is to drive squares of one size.
pub struct Squares {
    /// Clockwise, counter-clockwise.
    missions: [Mission; 2],
    world: World,
    body: BodyParameters,
    until_us: u64,
}

impl Squares {
    /// Squares with sides of `side_m`, driven by this body. With a scale its turns are measured by
    /// the gyroscope, whose rates are multiplied by that.
    ///
    /// # Errors
    /// If the mission does not compile.
    pub fn new(
        side_m: f64,
        body: BodyParameters,
        gyro_scale: Option<f64>,
    ) -> Result<Self, CommandError> {
        let text = match gyro_scale {
            None => SQUARE.to_owned(),
            Some(scale) => SQUARE_WITH_GYRO.replace(SCALE, &format!("scale = {scale:?}")),
        };
        let mission = |direction| square(&text, direction, side_m);
        // Both ways round, with a side to spare everywhere.
        let far_m = 2.0 * side_m + 1.0;
        let hall = format!(
            "world hall\nstart 0,0 0\nwall -{far_m},-{far_m} {far_m},-{far_m} {far_m},{far_m} -{far_m},{far_m} -{far_m},-{far_m}"
        );
        Ok(Squares {
            missions: [
                mission(Direction::Clockwise)?,
                mission(Direction::CounterClockwise)?,
            ],
            world: World::parse(&hall).map_err(|error| CommandError::Input(error.into()))?,
            body,
            until_us: ((4.0 * side_m / SLOWEST_M_PER_S + CORNERS_S) * 1e6) as u64,
        })
    }

    /// Drives one square. Returns where the robot really is at its end, from where its odometry
    /// takes it to be.
    ///
    /// # Errors
    /// If the square is not driven to its end.
    pub fn drive(
        &self,
        direction: Direction,
        seed: u64,
        robot: RobotMaker,
        interrupt: Interrupt,
    ) -> Result<Offset, CommandError> {
        let [clockwise, counter_clockwise] = &self.missions;
        let square = OwnDrive {
            what: "a square",
            mission: match direction {
                Direction::Clockwise => clockwise,
                Direction::CounterClockwise => counter_clockwise,
            },
            world: &self.world,
            body: self.body,
            seed,
            sample_period: SAMPLE_PERIOD,
            until_us: self.until_us,
        };
        let (plant, recording) = square.carry_out(robot, interrupt)?;
        Ok(off(&plant, last_pose(&recording)?))
    }
}

/// The mission that goes round this way.
fn square(text: &str, direction: Direction, side_m: f64) -> Result<Mission, CommandError> {
    let text = text.replace(SIDE, &format!("distance_m = {side_m:?}"));
    let text = match direction {
        Direction::Clockwise => text.replace(TO_THE_LEFT, ""),
        Direction::CounterClockwise => text,
    };
    compiled(NAME, &text)
}

/// Where the robot took itself to be at last, in metres: the mission has one net with a pose.
fn last_pose(recording: &Recording) -> Result<[f64; 2], CommandError> {
    let unread = |error: &dyn std::fmt::Display| {
        CommandError::Input(anyhow!("what the robot told of its pose: {error}"))
    };
    let mut last = None;
    for sample in recording.samples() {
        let sample = sample.map_err(|error| unread(&error))?;
        for (watched, values) in sample.nets.iter().zip(&sample.values) {
            if watched.shape() == Shape::Pose
                && let Some([Value::F32(x_m), Value::F32(y_m), ..]) = values.as_deref()
            {
                last = Some([f64::from(*x_m), f64::from(*y_m)]);
            }
        }
    }
    last.ok_or_else(|| unread(&"nothing"))
}

/// From where the robot takes itself to be to where it really is, along the first side and to the
/// left of it.
fn off(plant: &Plant, [x_m, y_m]: [f64; 2]) -> Offset {
    let (start, end) = (plant.world().start.position, plant.pose().position);
    Offset {
        x_mm: (end.x_m - start.x_m - x_m) * 1e3,
        y_mm: (end.y_m - start.y_m - y_m) * 1e3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mission_has_one_place_for_its_side_and_one_for_its_corners() {
        // That of the corners stands in a comment, too, without the blank.
        for what in [SIDE, TO_THE_LEFT] {
            assert_eq!(SQUARE.matches(what).count(), 1, "{what}");
            assert_eq!(SQUARE_WITH_GYRO.matches(what).count(), 1, "{what}");
        }
        assert_eq!(SQUARE_WITH_GYRO.matches(SCALE).count(), 1);
    }
}
