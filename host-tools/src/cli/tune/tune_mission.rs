//! The mission that is driven.

use anyhow::anyhow;

use super::numbers::{TASK, values_of};
use crate::cli::exit::CommandError;
use crate::cli::own_drive::ROVER;
use crate::lang;
use crate::tune::Gains;

/// What it is called in messages.
pub const NAME: &str = "tune.esm";
/// Its text.
pub const MISSION: &str = include_str!("../../../shipped/missions/tune.esm");

/// The mission with these gains.
pub fn mission_with(gains: &Gains) -> Result<String, CommandError> {
    let files = [(NAME, MISSION), ("rover.esm", ROVER)];
    let rewritten = lang::load_texts(&files).with_values(TASK, &values_of(gains));
    let rewritten = rewritten.ok_or_else(|| CommandError::Input(anyhow!("{NAME} has errors")))?;
    Ok(rewritten.text)
}

#[cfg(test)]
mod tests {
    use super::*;

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
        assert_eq!(text.matches("proportional_s_per_m").count(), 1);
    }
}
