//! What a mission is to reach in a world, and whether it has.
//!
//! A goal file says it: an entry a line, each once; `#` starts a comment.
//!
//! ```text
//! world office                  # where the mission drives
//! until 90 s                    # robot time at which it is looked where the robot is
//! goal start within 0.25 m      # its centre is that near to where it was at the start
//! ```
//!
//! A goal may also be a place of the world, `goal 1.6,2.4 within 0.25 m`, or a number of rooms that
//! the robot has come into, `goal 3 rooms`. With `script errand.script` the mission is sent that
//! script of behaviours, which stands beside it.

use std::fmt;
use std::str::FromStr;

use thiserror::Error;

use crate::plant::Plant;
use crate::scenario::time::{Time, TimeError};
use crate::world::{self, LineError, Point};

/// The largest tolerance, in metres: beyond it nothing would be said.
const WITHIN_LIMIT_M: f64 = 10.0;

/// What a mission is to reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Goal {
    /// The robot's centre is near a place.
    Near {
        /// The place.
        place: Place,
        /// How near at least, in metres.
        within_m: f64,
    },
    /// The robot has come into so many rooms of the world, each counted once.
    Rooms {
        /// How many at least.
        count: usize,
    },
}

/// A place that a robot is to reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// Where it started.
    Start,
    /// A point of the world.
    At(Point),
}

/// How a run ended, by its goal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reached {
    /// Whether the goal is reached.
    pub is_reached: bool,
    /// How far the robot's centre is from the goal, in metres; none where the goal is no place.
    pub off_m: Option<f64>,
}

impl Goal {
    /// How a run ended whose plant this is.
    pub fn judge(&self, plant: &Plant) -> Reached {
        match *self {
            Goal::Near { place, within_m } => {
                let place = match place {
                    Place::Start => plant.world().start.position,
                    Place::At(point) => point,
                };
                let off_m = libm::sqrt(place.squared_distance_m2(plant.pose().position));
                Reached {
                    is_reached: off_m <= within_m,
                    off_m: Some(off_m),
                }
            }
            Goal::Rooms { count } => Reached {
                is_reached: plant.statistics().rooms_entered().len() >= count,
                off_m: None,
            },
        }
    }
}

/// Why a text is no [`Goal`].
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum GoalError {
    /// It has another form.
    #[error("`{text}` is no goal; write `X,Y within 0.25 m`, `start within 0.25 m` or `3 rooms`")]
    Form {
        /// The text.
        text: String,
    },
    /// What stands for the place is none.
    #[error(transparent)]
    Place(LineError),
    /// What stands for the tolerance is none.
    #[error("`{word}` is no distance from a goal; write metres above 0, at most 10")]
    Within {
        /// What stands there.
        word: String,
    },
    /// What stands for the rooms is no number of them.
    #[error(
        "`{word}` is no number of rooms; write one from 1 to {}",
        world::ROOM_LIMIT
    )]
    Rooms {
        /// What stands there.
        word: String,
    },
}

impl FromStr for Goal {
    type Err = GoalError;

    fn from_str(text: &str) -> Result<Self, GoalError> {
        let words: Vec<&str> = text.split_whitespace().collect();
        match words[..] {
            [place, "within", distance, "m"] => Ok(Goal::Near {
                place: match place {
                    "start" => Place::Start,
                    _ => Place::At(world::point(place).map_err(GoalError::Place)?),
                },
                within_m: (distance.parse().ok())
                    .filter(|within_m| *within_m > 0.0 && *within_m <= WITHIN_LIMIT_M)
                    .ok_or_else(|| GoalError::Within {
                        word: distance.to_owned(),
                    })?,
            }),
            [count, "rooms" | "room"] => Ok(Goal::Rooms {
                count: (count.parse().ok())
                    .filter(|count| (1..=world::ROOM_LIMIT).contains(count))
                    .ok_or_else(|| GoalError::Rooms {
                        word: count.to_owned(),
                    })?,
            }),
            _ => Err(GoalError::Form {
                text: text.trim().to_owned(),
            }),
        }
    }
}

impl fmt::Display for Goal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Goal::Near { place, within_m } => {
                match place {
                    Place::Start => f.write_str("start")?,
                    Place::At(Point { x_m, y_m }) => write!(f, "{x_m},{y_m}")?,
                }
                write!(f, " within {within_m} m")
            }
            Goal::Rooms { count: 1 } => f.write_str("1 room"),
            Goal::Rooms { count } => write!(f, "{count} rooms"),
        }
    }
}

/// A goal file, read.
#[derive(Clone, Debug, PartialEq)]
pub struct GoalFile {
    /// The world, as it is asked for: a name, or a file.
    pub world: String,
    /// Robot time at which the run ends.
    pub until: Time,
    /// What is to be reached by then.
    pub goal: Goal,
    /// The file of a script that the mission is sent, beside it.
    pub script: Option<String>,
}

/// What is wrong with a goal file.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum GoalFileError {
    /// A line is wrong.
    #[error("line {line}: {cause}")]
    Line {
        /// The line, from 1.
        line: usize,
        /// What is wrong with it.
        cause: EntryError,
    },
    /// An entry is not there.
    #[error("the file has no `{entry}` line: add one, as in `{example}`")]
    Missing {
        /// The word that starts the missing line.
        entry: &'static str,
        /// Such a line.
        example: &'static str,
    },
}

/// What is wrong with a line of a goal file.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum EntryError {
    /// The line's first word is none of the four.
    #[error("`{word}` starts no entry; a line starts with `world`, `until`, `goal` or `script`")]
    Unknown {
        /// The word.
        word: String,
    },
    /// The line's word must not come twice.
    #[error("a second `{entry}` line; remove one")]
    Repeated {
        /// The word.
        entry: &'static str,
    },
    /// A world is not named in one word.
    #[error("expected `world NAME`")]
    World,
    /// A script is not named in one word.
    #[error("expected `script FILE`")]
    Script,
    /// The time is none.
    #[error(transparent)]
    Until(#[from] TimeError),
    /// A run without a length has no end to look at.
    #[error("a run takes time; write when it ends, as in `until 60 s`")]
    NoTime,
    /// The goal is none.
    #[error(transparent)]
    Goal(#[from] GoalError),
}

impl FromStr for GoalFile {
    type Err = GoalFileError;

    fn from_str(text: &str) -> Result<Self, GoalFileError> {
        let mut world = None;
        let mut until = None;
        let mut goal = None;
        let mut script = None;
        for (line, text) in (1..).zip(text.lines()) {
            let entry = text.split('#').next().unwrap_or_default().trim();
            let (word, rest) = entry.split_once(char::is_whitespace).unwrap_or((entry, ""));
            let rest = rest.trim();
            let taken = match word {
                "" => Ok(()),
                "world" => (one_word(rest).ok_or(EntryError::World))
                    .and_then(|name| put(&mut world, "world", name)),
                "until" => end(rest).and_then(|time| put(&mut until, "until", time)),
                "goal" => (rest.parse().map_err(EntryError::Goal))
                    .and_then(|parsed| put(&mut goal, "goal", parsed)),
                "script" => (one_word(rest).ok_or(EntryError::Script))
                    .and_then(|file| put(&mut script, "script", file)),
                _ => Err(EntryError::Unknown {
                    word: word.to_owned(),
                }),
            };
            taken.map_err(|cause| GoalFileError::Line { line, cause })?;
        }
        let missing = |entry, example| GoalFileError::Missing { entry, example };
        Ok(GoalFile {
            world: world.ok_or(missing("world", "world office"))?,
            until: until.ok_or(missing("until", "until 60 s"))?,
            goal: goal.ok_or(missing("goal", "goal start within 0.25 m"))?,
            script,
        })
    }
}

fn put<T>(place: &mut Option<T>, entry: &'static str, value: T) -> Result<(), EntryError> {
    match place.replace(value) {
        None => Ok(()),
        Some(_) => Err(EntryError::Repeated { entry }),
    }
}

fn one_word(text: &str) -> Option<String> {
    let is_one_word = !text.is_empty() && !text.contains(char::is_whitespace);
    is_one_word.then(|| text.to_owned())
}

fn end(text: &str) -> Result<Time, EntryError> {
    let time: Time = text.parse()?;
    (time.us > 0).then_some(time).ok_or(EntryError::NoTime)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::BodyParameters;
    use crate::world::World;

    #[test]
    fn goals_are_read_as_they_are_written() {
        let near = |place, within_m| Ok(Goal::Near { place, within_m });
        for (text, expected) in [
            ("start within 0.25 m", near(Place::Start, 0.25)),
            (
                " -1.5,2   within 1 m ",
                near(Place::At(Point::new(-1.5, 2.0)), 1.0),
            ),
            ("3 rooms", Ok(Goal::Rooms { count: 3 })),
            ("1 room", Ok(Goal::Rooms { count: 1 })),
            (
                "0 rooms",
                Err("`0` is no number of rooms; write one from 1 to 256"),
            ),
            (
                "a few rooms",
                Err(
                    "`a few rooms` is no goal; write `X,Y within 0.25 m`, `start within 0.25 m` or `3 rooms`",
                ),
            ),
            (
                "",
                Err("`` is no goal; write `X,Y within 0.25 m`, `start within 0.25 m` or `3 rooms`"),
            ),
            (
                "start within 0.25",
                Err(
                    "`start within 0.25` is no goal; write `X,Y within 0.25 m`, `start within 0.25 m` or `3 rooms`",
                ),
            ),
            (
                "home within 0.25 m",
                Err(
                    "`home` is no point; write `X,Y` in metres, without blanks, at most 1000 m from the origin",
                ),
            ),
            (
                "start within 0 m",
                Err("`0` is no distance from a goal; write metres above 0, at most 10"),
            ),
            (
                "start within NaN m",
                Err("`NaN` is no distance from a goal; write metres above 0, at most 10"),
            ),
        ] {
            let read = text.parse::<Goal>();
            let told = read.clone().map_err(|error| error.to_string());
            assert_eq!(told, expected.map_err(str::to_owned), "{text}");
            if let Ok(goal) = read {
                assert_eq!(goal.to_string().parse(), Ok(goal));
            }
        }
    }

    #[test]
    fn a_goal_file_has_a_world_an_end_and_a_goal() {
        let text = "# where it is to be\nworld office   # known\n\nuntil 90 s\ngoal 3 rooms\n";
        let expected = GoalFile {
            world: "office".to_owned(),
            until: Time { us: 90_000_000 },
            goal: Goal::Rooms { count: 3 },
            script: None,
        };
        assert_eq!(text.parse(), Ok(expected.clone()));
        let scripted = GoalFile {
            script: Some("square.script".to_owned()),
            ..expected
        };
        assert_eq!(format!("{text}script square.script").parse(), Ok(scripted));
        for (text, expected) in [
            (
                "",
                "the file has no `world` line: add one, as in `world office`",
            ),
            (
                "world a\ngoal 1 room",
                "the file has no `until` line: add one, as in `until 60 s`",
            ),
            (
                "world a\nuntil 1 s",
                "the file has no `goal` line: add one, as in `goal start within 0.25 m`",
            ),
            (
                "world a\nworld b",
                "line 2: a second `world` line; remove one",
            ),
            ("world", "line 1: expected `world NAME`"),
            ("world a b", "line 1: expected `world NAME`"),
            ("script", "line 1: expected `script FILE`"),
            (
                "script a\nscript b",
                "line 2: a second `script` line; remove one",
            ),
            (
                "\nuntil 60",
                "line 2: the unit is missing: write `us`, `ms` or `s` behind the number, as in `200 ms`",
            ),
            (
                "until 0 s",
                "line 1: a run takes time; write when it ends, as in `until 60 s`",
            ),
            (
                "goal home",
                "line 1: `home` is no goal; write `X,Y within 0.25 m`, `start within 0.25 m` or `3 rooms`",
            ),
            (
                "seed 1",
                "line 1: `seed` starts no entry; a line starts with `world`, `until`, `goal` or `script`",
            ),
        ] {
            let error = text.parse::<GoalFile>().unwrap_err();
            assert_eq!(error.to_string(), expected, "{text:?}");
        }
    }

    #[test]
    fn a_place_is_reached_within_its_tolerance_and_rooms_by_their_number() {
        let world = "world w\nstart 1,1 0\nwall 0,0 9,0\nroom a 0,0 2,0 2,2 0,2";
        let plant = Plant::new(World::parse(world).unwrap(), BodyParameters::default(), 1);
        let plant = plant.unwrap();
        for (goal, is_reached, off_m) in [
            ("start within 0.01 m", true, Some(0.0)),
            ("1.3,1.4 within 0.51 m", true, Some(0.5)),
            ("1.3,1.4 within 0.49 m", false, Some(0.5)),
            // The room in which it started it has not come into.
            ("1 room", false, None),
        ] {
            let reached = goal.parse::<Goal>().unwrap().judge(&plant);
            assert_eq!(reached.is_reached, is_reached, "{goal}");
            assert_eq!(reached.off_m.is_some(), off_m.is_some(), "{goal}");
            let off_by_m = reached.off_m.zip(off_m).map_or(0.0, |(a, b)| a - b);
            assert!(off_by_m.abs() < 1e-9, "{goal}: {reached:?}");
        }
    }
}
