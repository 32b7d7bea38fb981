//! The mission that is driven.

use anyhow::anyhow;

use super::numbers::{TASK, values_of};
use crate::cli::exit::CommandError;
use crate::lang;
use crate::tune::Gains;

/// The mission that is driven.
pub const MISSION: &str = include_str!("../../../../missions/tune.esm");
/// The tasks that it has.
pub const ROVER: &str = include_str!("../../../../missions/rover.esm");

/// The mission with these gains.
pub fn mission_with(gains: &Gains) -> Result<String, CommandError> {
    let files = [("tune.esm", MISSION), ("rover.esm", ROVER)];
    let rewritten = lang::load_texts(&files).with_values(TASK, &values_of(gains));
    let rewritten = rewritten.ok_or_else(|| CommandError::Input(anyhow!("tune.esm has errors")))?;
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
