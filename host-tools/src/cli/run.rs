//! `esm run`: a mission on a board, with a simulated robot body around it.

use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;
use thiserror::Error;

use super::argument::{Time, TimeError};
use super::console::Console;
use super::exit::CommandError;

/// Drives a mission: compiles it, starts a board, uploads, and shows what the robot does
///
/// The firmware, its task code and its timers are real; the robot's body (motors, encoders, sonars, battery) and the world around
/// it are simulated. The default board runs in an emulator, the board `host` runs the same code as a part of this process and is
/// much faster. Ctrl-C ends the run and leaves nothing behind.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm run missions/patrol.esm --until '60 s'
  esm run missions/patrol.esm --board host --world missions/worlds/office.world --until '120 s' --trace patrol.jsonl
  esm run missions/patrol.esm --until '120 s' --then '60 s missions/follow_wall.esm' --out pictures/
  esm run missions/patrol.esm --record patrol.rec --until '60 s'
  esm run missions/patrol.esm --board host --replay patrol.rec --until '60 s'")]
pub struct RunArgs {
    /// The mission
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// The board to run on
    #[arg(long, value_name = "BOARD", default_value = "lm3s6965")]
    pub board: String,

    /// The world to drive in
    #[arg(long, value_name = "WORLD")]
    pub world: Option<PathBuf>,

    /// Robot time after which the run ends, such as '60 s'; without it, Ctrl-C does
    #[arg(long, value_name = "TIME")]
    pub until: Option<Time>,

    /// Where the trace goes, as JSON Lines; `-` for standard output
    #[arg(long, value_name = "OUT")]
    pub trace: Option<PathBuf>,

    /// Keeps what entered the interpreter, so that the run can be had again with --replay
    #[arg(long, value_name = "OUT")]
    pub record: Option<PathBuf>,

    /// Takes what the clock cannot repeat from a recording (the board `host`)
    #[arg(long, value_name = "RECORDING", conflicts_with = "record")]
    pub replay: Option<PathBuf>,

    /// Uploads another mission at that robot time, while the robot moves; may be given several times
    #[arg(long, value_name = "'TIME FILE'")]
    pub then: Vec<Then>,

    /// Directory for the pictures: the path over the map and the states over time, as SVG and PNG
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// No faster than the wall clock, for a person watching
    #[arg(long)]
    pub realtime: bool,

    /// The firmware to start on an emulated board, instead of the one that the checkout builds
    #[arg(long, value_name = "ELF", env = "ESM_FIRMWARE")]
    pub firmware: Option<PathBuf>,
}

/// A mission that takes over during a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Then {
    /// Robot time from the start of the run.
    pub at: Time,
    /// The mission.
    pub file: PathBuf,
}

/// Why a text is no [`Then`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ThenError {
    /// It does not start with a time.
    #[error("{0}; write a time and a mission, as in '60 s missions/follow_wall.esm'")]
    Time(#[from] TimeError),
    /// Nothing behind the time.
    #[error(
        "the mission is missing: write a time and a mission, as in '60 s missions/follow_wall.esm'"
    )]
    NoFile,
}

impl FromStr for Then {
    type Err = ThenError;

    fn from_str(text: &str) -> Result<Self, ThenError> {
        let text = text.trim();
        let unit_start = text
            .find(|c: char| !c.is_ascii_digit() && !c.is_whitespace())
            .ok_or(if text.is_empty() {
                TimeError::NoNumber
            } else {
                TimeError::NoUnit
            })?;
        let unit_end = text[unit_start..]
            .find(char::is_whitespace)
            .map_or(text.len(), |length| unit_start + length);
        let at = text[..unit_end].parse()?;
        let file = text[unit_end..].trim();
        if file.is_empty() {
            Err(ThenError::NoFile)
        } else {
            Ok(Then {
                at,
                file: file.into(),
            })
        }
    }
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &RunArgs, console: &mut Console) -> Result<(), CommandError> {
    let _ = (args, console);
    Err(CommandError::World(anyhow::anyhow!(
        "`esm run` is not connected yet"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_of_mission_is_a_time_and_a_file() {
        let then = |us, file: &str| {
            Ok(Then {
                at: Time { us },
                file: file.into(),
            })
        };
        let cases = [
            ("60 s a.esm", then(60_000_000, "a.esm")),
            (
                "60s  missions/my robot.esm ",
                then(60_000_000, "missions/my robot.esm"),
            ),
            ("1500 ms ms", then(1_500_000, "ms")),
            ("60 s", Err(ThenError::NoFile)),
            ("60", Err(ThenError::Time(TimeError::NoUnit))),
            ("60 a.esm", Err(ThenError::Time(TimeError::UnknownUnit))),
            ("a.esm", Err(ThenError::Time(TimeError::NoNumber))),
            ("", Err(ThenError::Time(TimeError::NoNumber))),
        ];
        for (text, expected) in cases {
            assert_eq!(text.parse(), expected, "{text:?}");
        }
    }
}
