//! The drive of the simulated rover.

use std::time::Duration;

use super::tune_mission::NAME;
use crate::cli::exit::CommandError;
use crate::cli::own_drive::{OwnDrive, compiled};
use crate::host_board::RobotMaker;
use crate::plant::BodyParameters;
use crate::recording::player::Recording;
use crate::run::interrupt::Interrupt;
use crate::world::World;

/// Far more than the drive takes.
const UNTIL_US: u64 = 180_000_000;

/// Free floor.
const HALL: &str = "world hall\nstart 0,0 0\nwall -3,-3 3,-3 3,3 -3,3 -3,-3\n";

/// Drives the mission, and records it.
///
/// # Errors
/// The drive does not come to its end.
pub fn drive(text: &str, seed: u64, robot: RobotMaker) -> Result<Recording, CommandError> {
    let drive = OwnDrive {
        what: "the drive",
        mission: &compiled(NAME, text)?,
        world: &World::parse(HALL).map_err(|error| CommandError::Input(error.into()))?,
        body: BodyParameters::default(),
        seed,
        // Each macro step.
        sample_period: Duration::ZERO,
        until_us: UNTIL_US,
    };
    let (_, recording) = drive.carry_out(robot, Interrupt::take_over()?)?;
    Ok(recording)
}
