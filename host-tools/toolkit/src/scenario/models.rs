//! Models: what stands in for the task of a state while it is current, its flags and its data.
//!
//! ```text
//! model motion/Turn exit after 400 ms                       # each time that the state is entered
//! model sonars/Listen data ranges at 0 s 2.0, 3 s 0.1       # straight on between two rows
//! model motion/Cruise data twist by ranges 0.2 0.0, 1.0 0.3 # its own output by its own input
//! model safety/Watch set close while ranges below 0.15      # and cleared while not
//! ```
//!
//! A value of data is one number, whatever the port's type is.
//!
//! Source: Merz, Rudol, Wzorek 2006, section 4.1: models of flags for state transitioning, models
//! that generate or transform data for data flow.

use crate::nearest::nearest;
use crate::trace::directory::{Directory, StateId};

use super::names::SplitName;
use super::ports::{DataPort, Ports};
use super::report::Report;
use super::time::Time;
use super::{Mistake, MistakeCause, ModelLine, Name, Place};

/// The most rows of a table.
pub const MAX_ROWS: usize = 1_000;

/// A model whose names are indices of one machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Its line of the scenario, from 1.
    pub line: usize,
    /// The state for whose task it stands in.
    pub state: StateId,
    /// The state's path.
    pub path: String,
    /// Index of the task instance.
    pub task: usize,
    /// What it does while the state is current.
    pub does: Does,
}

/// What a model does.
#[derive(Clone, Debug, PartialEq)]
pub enum Does {
    /// Reports something once, so long after the state was entered.
    After {
        /// The time, in microseconds.
        time_us: u64,
        /// What is reported.
        report: Report,
    },
    /// Keeps a flag, `exit` or `busy` set while a value is on one side of a limit.
    While {
        /// The net that the value is on.
        net: usize,
        /// The side.
        side: Side,
        /// The limit.
        limit: f64,
        /// What is set.
        kept: Kept,
    },
    /// Writes a value to a net.
    Data {
        /// The net.
        net: usize,
        /// What the value follows.
        by: By,
        /// The value.
        table: Table,
    },
}

/// A side of a limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Smaller than the limit.
    Below,
    /// Greater than the limit.
    Above,
}

/// What a model keeps set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kept {
    /// A flag, by its index in the task's signature.
    Flag(usize),
    /// The task cannot be executed.
    Busy,
    /// The task has finished; it does not come back.
    Exit,
}

/// What a value follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum By {
    /// The time since the state was entered, in seconds.
    Time,
    /// The value on another net.
    Net(usize),
}

/// A function: straight on between two rows, level before the first and behind the last.
#[derive(Clone, Debug, PartialEq)]
pub struct Table(Vec<(f64, f64)>);

impl Table {
    /// Its value at `x`. There is at least one row.
    pub fn at(&self, x: f64) -> f64 {
        let behind = self.0.partition_point(|row| row.0 <= x);
        let before = behind.checked_sub(1).and_then(|row| self.0.get(row));
        match (before, self.0.get(behind)) {
            (Some((from, start)), Some((to, end))) => {
                start + (end - start) * ((x - from) / (to - from))
            }
            (Some((_, level)), None) | (None, Some((_, level))) => *level,
            (None, None) => 0.0,
        }
    }
}

/// Finds a model's names in a machine.
///
/// # Errors
/// The first mistake of the line.
pub(super) fn bound(
    line: &ModelLine,
    directory: &Directory,
    ports: &Ports,
) -> Result<Model, Mistake> {
    let mut words = Words {
        rest: &line.words,
        end: line.end,
    };
    let state = words.next("the path of a task state, such as `motion/Cruise`")?;
    let name = SplitName::of(state);
    let task = name.task(directory)?;
    let (id, entry) = name.state(directory)?;
    let owner = Owner {
        state,
        task,
        directory,
        ports,
    };
    let does = owner.does(&mut words)?;
    words.end()?;
    Ok(Model {
        line: state.place.line,
        state: id,
        path: entry.path.clone(),
        task,
        does,
    })
}

/// What can stand behind the state.
const ACTIONS: [&str; 6] = ["set", "clear", "exit", "busy", "free", "data"];

/// The state of a model, in its machine.
struct Owner<'a> {
    state: &'a Name,
    task: usize,
    directory: &'a Directory,
    ports: &'a Ports,
}

impl Owner<'_> {
    fn does(&self, words: &mut Words<'_>) -> Result<Does, Mistake> {
        let action =
            words.next("what it does: `set`, `clear`, `exit`, `busy`, `free` or `data`")?;
        match action.text.as_str() {
            "data" => self.data(words),
            "set" => {
                let flag = self.flag(words)?;
                self.when(
                    words,
                    Report::Flag { flag, value: true },
                    Some(Kept::Flag(flag)),
                )
            }
            "clear" => {
                let flag = self.flag(words)?;
                self.when(words, Report::Flag { flag, value: false }, None)
            }
            "exit" => self.when(words, Report::Exit, Some(Kept::Exit)),
            "busy" => self.when(words, Report::Busy(true), Some(Kept::Busy)),
            "free" => self.when(words, Report::Busy(false), None),
            found => Err(at(
                action,
                MistakeCause::UnknownModel {
                    found: found.to_owned(),
                    meant: nearest(found, ACTIONS).map(String::from),
                },
            )),
        }
    }

    /// An out flag of the state's task.
    fn flag(&self, words: &mut Words<'_>) -> Result<usize, Mistake> {
        let flag = words.next("an out flag of the task")?;
        // As `set` of an `at` line has it, with its place where the flag is.
        let path = &self.state.text;
        let before = path.chars().count() + 1;
        let whole = Name {
            text: format!("{path}.{}", flag.text),
            place: flag.place,
        };
        let found = SplitName::of(&whole).written_flag(self.directory);
        let (_, flag) = found.map_err(|mistake| Mistake {
            place: Place {
                col: mistake.place.col.saturating_sub(before).max(flag.place.col),
                ..mistake.place
            },
            ..mistake
        })?;
        Ok(flag)
    }

    /// `after TIME`, or `while PORT below NUMBER` for what can be kept.
    fn when(
        &self,
        words: &mut Words<'_>,
        report: Report,
        kept: Option<Kept>,
    ) -> Result<Does, Mistake> {
        let expected = match kept {
            Some(_) => "`after 400 ms` or `while PORT below 0.2`",
            None => "`after 400 ms`",
        };
        let word = words.next(expected)?;
        match (word.text.as_str(), kept) {
            ("after", _) => Ok(Does::After {
                time_us: words.time()?.us,
                report,
            }),
            ("while", Some(kept)) => {
                let net = self.port(words, "in")?;
                let side = words.next("`below` or `above`")?;
                let side = match side.text.as_str() {
                    "below" => Side::Below,
                    "above" => Side::Above,
                    _ => return Err(instead(side, "`below` or `above`")),
                };
                Ok(Does::While {
                    net,
                    side,
                    limit: words.number()?,
                    kept,
                })
            }
            _ => Err(instead(word, expected)),
        }
    }

    /// `PORT at TIME NUMBER, …` or `PORT by PORT NUMBER NUMBER, …`.
    fn data(&self, words: &mut Words<'_>) -> Result<Does, Mistake> {
        let net = self.port(words, "out")?;
        let expected = "`at` and a table over time, or `by` and a port and a table over its value";
        let word = words.next(expected)?;
        let by = match word.text.as_str() {
            "at" => By::Time,
            "by" => By::Net(self.port(words, "in")?),
            _ => return Err(instead(word, expected)),
        };
        let table = words.table(by)?;
        Ok(Does::Data { net, by, table })
    }

    /// The net of a data port of the state's task.
    fn port(&self, words: &mut Words<'_>, way: &'static str) -> Result<usize, Mistake> {
        let port = words.next("a data port of the task")?;
        let goes = |known: &&DataPort| match way {
            "in" => known.is_in,
            _ => known.is_out,
        };
        let usable = || (self.ports.of_task(self.task).filter(goes)).filter(|it| it.net.is_some());
        let found = usable().find(|known| known.name == port.text);
        found.and_then(|known| known.net).ok_or_else(|| {
            let names = usable().map(|known| known.name.as_str());
            at(
                port,
                MistakeCause::UnknownPort {
                    path: self.state.text.clone(),
                    way,
                    found: port.text.clone(),
                    meant: nearest(&port.text, names).map(String::from),
                },
            )
        })
    }
}

fn at(word: &Name, cause: MistakeCause) -> Mistake {
    Mistake {
        place: word.place,
        cause,
    }
}

fn instead(word: &Name, expected: &'static str) -> Mistake {
    let found = word.text.clone();
    at(word, MistakeCause::Instead { found, expected })
}

/// The words of a line that are still to be read.
struct Words<'a> {
    rest: &'a [Name],
    end: Place,
}

impl<'a> Words<'a> {
    fn next(&mut self, expected: &'static str) -> Result<&'a Name, Mistake> {
        let (word, rest) = self.rest.split_first().ok_or(Mistake {
            place: self.end,
            cause: MistakeCause::Missing { expected },
        })?;
        self.rest = rest;
        Ok(word)
    }

    fn end(&self) -> Result<(), Mistake> {
        self.rest.first().map_or(Ok(()), |word| {
            let found = word.text.clone();
            Err(at(word, MistakeCause::Excess { found }))
        })
    }

    fn number(&mut self) -> Result<f64, Mistake> {
        let word = self.next("a number")?;
        let number = word
            .text
            .parse()
            .ok()
            .filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| {
            let found = word.text.clone();
            at(word, MistakeCause::NoNumber { found })
        })
    }

    /// A number and its unit, in one word or two.
    fn time(&mut self) -> Result<Time, Mistake> {
        let word = self.next("a time such as `200 ms`")?;
        let is_number = word.text.chars().all(|c| c.is_ascii_digit());
        let unit = match is_number {
            true => self
                .next("the unit of the time: `us`, `ms` or `s`")?
                .text
                .as_str(),
            false => "",
        };
        let written = format!("{}{unit}", word.text);
        (written.parse()).map_err(|error| at(word, MistakeCause::Time(error)))
    }

    /// Rows with commas between, to the end of the line.
    fn table(&mut self, by: By) -> Result<Table, Mistake> {
        let mut rows: Vec<(f64, f64)> = Vec::new();
        loop {
            let first = self.rest.first();
            let x = match by {
                By::Time => self.time()?.us as f64 / 1e6,
                By::Net(_) => self.number()?,
            };
            if let Some(first) = first.filter(|_| rows.last().is_some_and(|row| row.0 >= x)) {
                let found = first.text.clone();
                return Err(at(first, MistakeCause::RowsGoBack { found }));
            }
            rows.push((x, self.number()?));
            match self.rest.first() {
                None => return Ok(Table(rows)),
                Some(comma) if comma.text == "," && rows.len() < MAX_ROWS => {
                    self.rest = &self.rest[1..];
                }
                Some(other) => return Err(instead(other, "a comma, and a row, or the line's end")),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_straight_between_its_rows_and_level_outside() {
        let table = Table(vec![(1.0, 10.0), (3.0, 20.0), (4.0, -5.0)]);
        for (x, expected) in [
            (-7.0, 10.0),
            (1.0, 10.0),
            (2.0, 15.0),
            (3.0, 20.0),
            (3.5, 7.5),
            (4.0, -5.0),
            (9.0, -5.0),
        ] {
            assert_eq!(table.at(x), expected, "{x}");
        }
    }
}
