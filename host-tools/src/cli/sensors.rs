//! Recorded ranges that a run takes in the place of a world.

use std::path::Path;

use anyhow::{Context, anyhow};
use rt_firmware::body::SONARS;
use rt_firmware::tasks::ARRAY_SONARS;

use super::exit::CommandError;
use super::{file, stage};
use crate::plant::RecordedRanges;
use crate::run::drive::Planned;

/// The world that the robot drives in meanwhile: one without anything to run into.
pub const WORLD: &str = "empty";

/// The task that pings the ring of sonars.
const RING: &str = "SonarRing";
/// The task that pings the array of sonars.
const ARRAY: &str = "SonarArray";

/// The ranges in a file, for the sonars of these missions.
///
/// # Errors
/// If it cannot be read, is no table, or has not a column for each sonar.
pub fn recorded(
    path: &Path,
    missions: &[Planned],
    firmware: Option<&Path>,
) -> Result<RecordedRanges, CommandError> {
    let name = path.display();
    let text = file::read_text(path, "table of ranges")?;
    let ranges = RecordedRanges::parse(&text)
        .with_context(|| format!("cannot take ranges from {name}"))
        .map_err(CommandError::Input)?;
    let uses = |task: &str| {
        let mut all = missions
            .iter()
            .flat_map(|planned| &planned.mission.task_names);
        all.any(|name| name == task)
    };
    let places = match (uses(RING), uses(ARRAY)) {
        (true, false) => ring(firmware)?,
        (false, true) => (0..ARRAY_SONARS).collect(),
        (false, false) => {
            return Err(CommandError::Input(anyhow!(
                "the mission has no sonars that could take the ranges of {name}: it needs a task state of \
                 `{RING}` or `{ARRAY}`"
            )));
        }
        (true, true) => {
            return Err(CommandError::Input(anyhow!(
                "the ranges of {name} are for one set of sonars, and there are task states of both `{RING}` and \
                 `{ARRAY}`"
            )));
        }
    };
    if ranges.sonars() != places.len() {
        return Err(CommandError::Input(anyhow!(
            "{name} has {} columns, and the mission has {} sonars: write one column for each sonar",
            ranges.sonars(),
            places.len()
        )));
    }
    Ok(ranges.at_places(&places))
}

/// Where the sonars of the ring look, in eighths of a turn.
fn ring(firmware: Option<&Path>) -> Result<Vec<usize>, CommandError> {
    let robot = stage::robot_beside(firmware)?;
    Ok(robot.map_or_else(|| (0..SONARS).collect(), |robot| robot.sonars_look()))
}
