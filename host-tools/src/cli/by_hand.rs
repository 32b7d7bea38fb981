//! What a run tells the list of behaviours while it goes, as a person writes it.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::anyhow;
use clap::Args;
use esm_link::position::Correction;
use thiserror::Error;

use super::argument::{Time, TimeError};
use super::console::Console;
use super::drive::steering;
use super::exit::CommandError;
use super::position::place::{PlaceError, place};
use super::script;
use crate::lang;
use crate::run::by_hand::{ByHand, Driven, Placed};
use crate::script::Script;

/// When a script is sent: the mission that runs has made its list by then.
pub const SCRIPT_AT_US: u64 = 500_000;

/// What the list of behaviours is told.
#[derive(Debug, Args)]
pub struct ByHandArgs {
    /// Sends a script of behaviours after half a second of robot time, which a task `Behaviours` of
    /// the mission does
    #[arg(long, value_name = "FILE", conflicts_with = "replay")]
    pub script: Option<PathBuf>,

    /// Steers by hand from one robot time to another: metres per second ahead, a comma, radians per
    /// second to the left. May be given several times
    #[arg(
        long,
        value_name = "'FROM TO AHEAD,LEFT'",
        conflicts_with = "replay",
        allow_hyphen_values = true
    )]
    pub drive: Vec<Steered>,

    /// Tells the robot at a robot time where it is (`set`, and all of x_m, y_m and heading_rad), or
    /// how far it is from where it believes itself to be (`by`). May be given several times
    #[arg(
        long,
        value_name = "'TIME set|by POSITION'",
        conflicts_with = "replay",
        allow_hyphen_values = true
    )]
    pub position: Vec<Placing>,
}

/// A robot that is told where it is, as a person writes it: `3 s by x_m = 0.1`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placing(pub Placed);

/// Why a text is no [`Placing`].
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum PlacingError {
    /// Other words, or in another order.
    #[error("write a time, `set` or `by`, and a position, as in '3 s by x_m = 0.1'")]
    Form,
    /// What stands for a time is none.
    #[error(transparent)]
    Time(#[from] TimeError),
    /// What stands for a position is none.
    #[error(transparent)]
    Place(#[from] PlaceError),
}

impl FromStr for Placing {
    type Err = PlacingError;

    fn from_str(text: &str) -> Result<Self, PlacingError> {
        let (number, rest) = text.trim().split_once(' ').ok_or(PlacingError::Form)?;
        let (unit, rest) = rest.trim().split_once(' ').ok_or(PlacingError::Form)?;
        let (word, rest) = rest.trim().split_once(' ').ok_or(PlacingError::Form)?;
        let correction = match word {
            "set" => Correction::Set,
            "by" => Correction::Difference,
            _ => return Err(PlacingError::Form),
        };
        let at: Time = format!("{number} {unit}").parse()?;
        Ok(Self(Placed {
            at_us: at.us,
            correction,
            by: place(rest, correction)?,
        }))
    }
}

/// A robot steered by hand, as a person writes it: `2 s 5 s 0.2,0.5`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steered(pub Driven);

/// Why a text is no [`Steered`].
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SteeredError {
    /// Other words, or in another order.
    #[error("write two times and a movement, as in '2 s 5 s 0.2,0.5'")]
    Form,
    /// What stands for a time is none.
    #[error(transparent)]
    Time(#[from] TimeError),
    /// It ends before it begins.
    #[error("the second time is not behind the first")]
    Backwards,
    /// What stands for the movement is none.
    #[error("{0}")]
    Twist(String),
}

impl FromStr for Steered {
    type Err = SteeredError;

    fn from_str(text: &str) -> Result<Self, SteeredError> {
        let words: Vec<&str> = text.split_whitespace().collect();
        let [from, from_unit, to, to_unit, twist] = words[..] else {
            return Err(SteeredError::Form);
        };
        let from: Time = format!("{from} {from_unit}").parse()?;
        let to: Time = format!("{to} {to_unit}").parse()?;
        if to.us <= from.us {
            return Err(SteeredError::Backwards);
        }
        let twist = steering::twist(twist).map_err(SteeredError::Twist)?;
        Ok(Self(Driven {
            from_us: from.us,
            to_us: to.us,
            twist,
        }))
    }
}

/// What is told in a run of a mission, whose tasks the script is checked against.
///
/// # Errors
/// The script has mistakes, which are told, or movements overlap.
pub fn planned(
    args: &ByHandArgs,
    mission: &Path,
    console: &mut Console,
) -> Result<ByHand, CommandError> {
    let mut driven: Vec<Driven> = args.drive.iter().map(|steered| steered.0).collect();
    driven.sort_by_key(|driven| driven.from_us);
    let overlap = |pair: &[Driven]| matches!(pair, [a, b] if b.from_us < a.to_us);
    if driven.windows(2).any(overlap) {
        return Err(CommandError::Usage(anyhow!(
            "two movements of --drive are at one time"
        )));
    }
    let script = args.script.as_deref();
    let script = script.map(|file| script_for(file, mission, console));
    let script = script.transpose()?.map(|script| (SCRIPT_AT_US, script));
    let mut placed: Vec<Placed> = args.position.iter().map(|placing| placing.0).collect();
    placed.sort_by_key(|placed| placed.at_us);
    Ok(ByHand {
        script,
        driven,
        placed,
    })
}

/// The script of a file, checked against the tasks of a mission that has been compiled.
///
/// # Errors
/// It cannot be read, or has mistakes, which are told.
pub fn script_for(
    file: &Path,
    mission: &Path,
    console: &mut Console,
) -> Result<Script, CommandError> {
    let text = script::text_of(file)?;
    let checked = lang::load(mission).map_err(|error| CommandError::Input(error.into()))?;
    // Its mistakes have been told when it was compiled.
    let model = checked.model.ok_or(CommandError::Told)?;
    script::checked(file, &text, &model.tasks, false, console)
}

#[cfg(test)]
mod tests {
    use rt_firmware::tasks::{Pose, Twist};

    use super::*;

    #[test]
    fn a_position_comes_at_a_time() {
        let placed = |at_us, correction, x_m| {
            Ok(Placing(Placed {
                at_us,
                correction,
                by: Pose { x_m, ..Pose::START },
            }))
        };
        assert_eq!(
            "3 s by x_m = -0.1".parse(),
            placed(3_000_000, Correction::Difference, -0.1)
        );
        assert_eq!(
            "1500 ms set x_m = 5, y_m = 0, heading_rad = 0".parse(),
            placed(1_500_000, Correction::Set, 5.0)
        );
        for text in [
            "",
            "3 s",
            "3 s set",
            "3 s at x_m = 1",
            "3 k by x_m = 0",
            "3 s set x_m = 1",
        ] {
            assert!(text.parse::<Placing>().is_err(), "{text}");
        }
    }

    #[test]
    fn steering_is_two_times_and_a_movement() {
        let driven = |from_us, to_us, forward_m_per_s, turn_rad_per_s| {
            Ok(Steered(Driven {
                from_us,
                to_us,
                twist: Twist {
                    forward_m_per_s,
                    turn_rad_per_s,
                },
            }))
        };
        assert_eq!(
            "2 s 5500 ms 0.2,-0.5".parse(),
            driven(2_000_000, 5_500_000, 0.2, -0.5)
        );
        for text in [
            "",
            "2 s 5 s",
            "5 s 2 s 0.2,0.5",
            "2 s 2 s 0,0",
            "2 s 5 s 3,0",
            "2 s 5 k 0,0",
        ] {
            assert!(text.parse::<Steered>().is_err(), "{text}");
        }
    }
}
