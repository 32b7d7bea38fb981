//! Measures that a person has taken on the floor, for a robot's file.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::anyhow;
use serde::Serialize;

use super::numbers::to_digits;
use super::write::Target;
use crate::cli::argument;
use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::cli::robot_toml::Change;

/// A tape and a count have no more digits than these.
const DIGITS: i32 = 5;

/// Two numbers that were measured together, such as `9.87,10`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair(f64, f64);

impl std::str::FromStr for Pair {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (first, second) = text
            .split_once(',')
            .ok_or("expected two numbers with a comma between, such as 9.87,10")?;
        let number = |text: &str| argument::measure(text.trim());
        Ok(Pair(number(first)?, number(second)?))
    }
}

impl Pair {
    fn ratio(self) -> f64 {
        self.0 / self.1
    }
}

/// What a person has measured.
#[derive(Clone, Copy, Debug, Default)]
pub struct ByHand {
    /// A way by the tape, and by the robot's pose.
    pub way: Option<Pair>,
    /// Turns on the spot that it made, and those by its pose.
    pub turns: Option<Pair>,
    /// Counts of an encoder, and the turns of its wheel that they are of.
    pub counts: Option<Pair>,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report<'r> {
    file: &'r Path,
    base_m: f64,
    radius_m: f64,
    counts_per_revolution: f64,
}

impl ByHand {
    /// Whether nothing was measured.
    pub fn is_empty(&self) -> bool {
        self.way.is_none() && self.turns.is_none() && self.counts.is_none()
    }

    /// Writes what was measured into robots' files, and says what they say now.
    ///
    /// # Errors
    /// There is no robot's file among the targets, a mission is, or a measure cannot be.
    pub fn write(
        &self,
        targets: &[Target],
        json: bool,
        console: &mut Console,
    ) -> Result<(), CommandError> {
        let mut files = Vec::new();
        for target in targets {
            match target {
                Target::Robot(file) => files.push(file),
                Target::Mission { path, .. } => {
                    return Err(CommandError::Usage(anyhow!(
                        "{} is a mission: measures go into a robot's file (.toml)",
                        path.display()
                    )));
                }
            }
        }
        if files.is_empty() {
            return Err(CommandError::Usage(anyhow!(
                "name the robot's file that the measures go into: `--write robot.toml`"
            )));
        }
        for file in files {
            let before = file.measured();
            // What is a file's is an `f32`, whose digits a file has.
            let of_file = |number: f32| to_digits(f64::from(number), 7);
            let mut report = Report {
                file: file.path(),
                base_m: of_file(before.wheel_base_m),
                radius_m: of_file(before.wheel_radius_m),
                counts_per_revolution: of_file(before.counts_per_revolution),
            };
            let mut changes: Vec<Change> = Vec::new();
            if let Some(counts) = self.counts {
                report.counts_per_revolution = to_digits(counts.ratio(), DIGITS);
                changes.push(("counts_per_revolution", report.counts_per_revolution));
            }
            if let Some(way) = self.way {
                report.radius_m = to_digits(report.radius_m * way.ratio(), DIGITS);
                changes.push(("radius_m", report.radius_m));
            }
            if let Some(turns) = self.turns {
                report.base_m = to_digits(report.base_m / turns.ratio(), DIGITS);
                changes.push(("base_m", report.base_m));
            }
            file.write_wheels(&changes)?;
            if json {
                console.json_line(&report)?;
                continue;
            }
            let mut text = format!("{}:", file.path().display());
            for (key, number) in &changes {
                // Writing to a string cannot fail.
                let _ = write!(text, " {key} = {number}");
            }
            text += "; it holds in the firmware that is built from it next\n";
            console.text(&text)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_numbers_stand_with_a_comma_between() {
        assert_eq!("9.87,10".parse(), Ok(Pair(9.87, 10.0)));
        assert_eq!("9.87, 10".parse(), Ok(Pair(9.87, 10.0)));
        for (text, expected) in [
            ("9.87", "expected two numbers"),
            ("9.87,0", "above zero"),
            ("a,1", "expected a number"),
            ("inf,1", "no robot has"),
        ] {
            let said = text.parse::<Pair>().unwrap_err();
            assert!(said.contains(expected), "{text}: {said}");
        }
    }
}
