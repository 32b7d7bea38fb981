//! Scenario files: what the tasks report, and when, and what must hold.
//!
//! A scenario stands in for the tasks of a machine that [`crate::sim`] runs. It is read in two
//! steps: [`parse`] knows the grammar and nothing of any machine; [`bind::bind`] finds the names in
//! one. Both report all that they can find, not only the first mistake, and each with its place.
//!
//! ```text
//! period 10 ms                          # overrides the interpreter slot's
//! at 20 ms set    motion/Cruise.near    # an out flag of a task state; `clear` takes it back
//! at 60 ms exit   motion/Escape/turn/Back
//! at 70 ms busy   motion/Cruise         # `free` takes it back
//! at 40 ms expect not motion/Cruise.near
//! model motion/Escape/turn/Back exit after 400 ms    # stands in for the task, each time
//! until 200 ms
//! ```

pub mod bind;
pub mod models;
mod names;
pub mod ports;
mod report;
pub mod time;

use std::fmt;

use thiserror::Error;

use esm_core::format::MAX_TIME_US;

use crate::nearest::nearest;
use time::{Time, TimeError};

/// A place in a scenario file, both counted from 1, columns in characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// Line.
    pub line: usize,
    /// Column, in characters.
    pub col: usize,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.line, self.col)
    }
}

/// A scenario as it is written, its names not yet looked up.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Scenario {
    /// The interpreter's period in microseconds, where the scenario overrides the slot's. Never 0.
    pub period_us: Option<u32>,
    /// The lines that start with `at`, in the order of the file.
    pub entries: Vec<Entry>,
    /// The lines that start with `model`, in the order of the file.
    pub models: Vec<ModelLine>,
    /// Time of the last macro step that may run, in microseconds.
    pub until_us: u64,
    /// Where that is said.
    pub until_place: Place,
}

/// The most macro steps that a scenario can ask for: a day of robot time at a period of 1 ms, and
/// more than a minute of work.
pub const MAX_MACRO_STEPS: u64 = 100_000_000;

/// A line that starts with `at`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Its time, in microseconds from the first macro step.
    pub at_us: u64,
    /// What happens.
    pub command: Command,
    /// To what: a path, with or without a flag.
    pub name: Name,
}

/// A line that starts with `model`: what stands in for the task of a state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ModelLine {
    /// The words behind `model`: the state's path first. A comma is a word of its own.
    pub words: Vec<Name>,
    /// Where the line ends.
    pub end: Place,
}

/// The most models of a scenario: each is looked at before each macro step.
pub const MAX_MODELS: usize = 1_000;

/// What an entry does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// The task sets one of its `out` flags.
    Set,
    /// The task clears one of its `out` flags.
    Clear,
    /// The task reports that it is finished.
    Exit,
    /// The task cannot be executed.
    Busy,
    /// Takes `busy` back.
    Free,
    /// A state is current, or a flag is set.
    Expect,
    /// A state is not current, or a flag is not set.
    ExpectNot,
}

/// A name in a scenario: `motion/Escape/turn/Back`, or with a flag `motion/Cruise.near`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Name {
    /// The whole name as it is written.
    pub text: String,
    /// Where it starts.
    pub place: Place,
}

/// A mistake in a scenario.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mistake {
    /// Where.
    pub place: Place,
    /// What.
    pub cause: MistakeCause,
}

/// What is wrong with a scenario. Each message says what to write instead, where that can be known.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum MistakeCause {
    /// A line starts with something else than a keyword.
    #[error("a line starts with `at`, `model`, `period` or `until`, not with `{found}`{}", did_you_mean(.meant))]
    UnknownLine {
        /// The word found.
        found: String,
        /// A keyword near it.
        meant: Option<String>,
    },
    /// An unknown word behind the time of an `at` line.
    #[error("`{found}` is nothing that can happen: write `set`, `clear`, `exit`, `busy`, `free` or `expect`{}", did_you_mean(.meant))]
    UnknownCommand {
        /// The word found.
        found: String,
        /// A command near it.
        meant: Option<String>,
    },
    /// A line that ends too early.
    #[error("the line ends here, but {expected} must follow")]
    Missing {
        /// What must follow.
        expected: &'static str,
    },
    /// More on a line than belongs there.
    #[error("`{found}` is too much: the line is complete before it")]
    Excess {
        /// The first word too many.
        found: String,
    },
    /// A time that is none.
    #[error("{0}")]
    Time(TimeError),
    /// `period 0 ms`
    #[error("the period must be longer than nothing")]
    ZeroPeriod,
    /// A period above the language's limit of times.
    #[error("the period must not be above {} s", MAX_TIME_US / 1_000_000)]
    LongPeriod,
    /// A second `period` or `until`.
    #[error("`{word}` stands in line {first_line} already: one of the two has to go")]
    Twice {
        /// `period` or `until`.
        word: &'static str,
        /// Line of the first.
        first_line: usize,
    },
    /// More macro steps than are ever run.
    #[error(
        "that is {steps} macro steps, and at most {MAX_MACRO_STEPS} are run: end earlier, or give a longer `period`"
    )]
    TooManySteps {
        /// Up to `until`, at the period of the scenario or the slot.
        steps: u64,
    },
    /// No `until` line.
    #[error("the scenario does not say when it ends: add a line such as `until 200 ms`")]
    NoUntil,
    /// A path without a part between two slashes, or without a flag behind the dot.
    #[error(
        "`{name}` is no path: write regions and states in turn, as in `motion/Escape/turn/Back`, a flag behind a dot"
    )]
    MalformedName {
        /// The name found.
        name: String,
    },
    /// No such region.
    #[error("{container} has no region `{found}`{}", did_you_mean(.meant))]
    UnknownRegion {
        /// The machine or the superstate that was looked in, as a person calls it.
        container: String,
        /// The name found.
        found: String,
        /// A region near it.
        meant: Option<String>,
    },
    /// No such state.
    #[error("region `{region}` has no state `{found}`{}", did_you_mean(.meant))]
    UnknownState {
        /// Path of the region.
        region: String,
        /// The name found.
        found: String,
        /// A state near it.
        meant: Option<String>,
    },
    /// A path that goes on behind a state with nothing in it.
    #[error("`{path}` is no superstate: there is nothing inside it")]
    NothingInside {
        /// Path of the state.
        path: String,
    },
    /// A path that ends with a region.
    #[error("`{path}` is a region: go on with one of its states, as in `{path}/{example}`")]
    RegionOnly {
        /// Path of the region.
        path: String,
        /// One of its states.
        example: String,
    },
    /// No such flag.
    #[error("`{path}` has no flag `{found}`{}", did_you_mean(.meant))]
    UnknownFlag {
        /// Path of the state.
        path: String,
        /// The name found.
        found: String,
        /// A flag near it.
        meant: Option<String>,
    },
    /// `set` or `clear` of something else than an `out` flag of a task state.
    #[error(
        "`{name}` is not for a task to write: `set` and `clear` take an out flag of a task state"
    )]
    NotWritable {
        /// The name found.
        name: String,
    },
    /// `set` or `clear` of a path without a flag.
    #[error("a flag must follow, as in `{path}.{example}`")]
    FlagNeeded {
        /// The path found.
        path: String,
        /// A flag that could follow.
        example: String,
    },
    /// `exit`, `busy` or `free` with a flag.
    #[error("the path of a task state is all that belongs here: leave `.{flag}` out")]
    FlagExcess {
        /// The flag found.
        flag: String,
    },
    /// `exit`, `busy` or `free` of something else than a task state.
    #[error("`{path}` is no task state: there is no task that could report anything")]
    NoTaskState {
        /// The path found.
        path: String,
    },
    /// More `model` lines than are looked at.
    #[error("more than {MAX_MODELS} lines start with `model`: leave some out")]
    TooManyModels,
    /// A model that does something unknown.
    #[error(
        "`{found}` is nothing that a model does: write `set`, `clear`, `exit`, `busy`, `free` or `data`{}",
        did_you_mean(.meant)
    )]
    UnknownModel {
        /// The word found.
        found: String,
        /// A word near it.
        meant: Option<String>,
    },
    /// Another word than the ones that can stand there.
    #[error("`{found}` stands where {expected} is wanted")]
    Instead {
        /// The word found.
        found: String,
        /// What is wanted.
        expected: &'static str,
    },
    /// A word that is no number, or not a finite one.
    #[error("`{found}` is no number")]
    NoNumber {
        /// The word found.
        found: String,
    },
    /// A table whose rows go back.
    #[error("each row of a table comes behind the one before: `{found}` does not")]
    RowsGoBack {
        /// The row's first column.
        found: String,
    },
    /// No such data port, or the model uses it the other way round.
    #[error("`{path}` has no {way} data port `{found}` that is on a path of the mission{}", did_you_mean(.meant))]
    UnknownPort {
        /// Path of the state.
        path: String,
        /// `in` or `out`.
        way: &'static str,
        /// The name found.
        found: String,
        /// A port near it.
        meant: Option<String>,
    },
}

/// The end of a message that knows what could have been meant.
fn did_you_mean(meant: &Option<String>) -> String {
    meant
        .as_ref()
        .map(|meant| format!(": did you mean `{meant}`?"))
        .unwrap_or_default()
}

const LINE_WORDS: [&str; 4] = ["at", "model", "period", "until"];

const COMMANDS: [(&str, Command); 6] = [
    ("set", Command::Set),
    ("clear", Command::Clear),
    ("exit", Command::Exit),
    ("busy", Command::Busy),
    ("free", Command::Free),
    ("expect", Command::Expect),
];

/// Reads a scenario.
///
/// # Errors
/// Every mistake that can be seen without a machine, in the order of the file.
pub fn parse(text: &str) -> Result<Scenario, Vec<Mistake>> {
    let (scenario, mistakes) = read(text);
    if mistakes.is_empty() {
        Ok(scenario)
    } else {
        Err(mistakes)
    }
}

/// Reads a scenario as far as it goes, with all mistakes: so that those in its names can be told
/// together with them.
fn read(text: &str) -> (Scenario, Vec<Mistake>) {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut reading = Reading::default();
    for (index, line) in text.lines().enumerate() {
        if let Err(mistake) = reading.line(Cursor::new(line, index + 1)) {
            reading.mistakes.push(mistake);
        }
    }
    // An `until` line that is wrong in itself has been told already.
    if reading.until.is_none() && !reading.until_seen {
        let place = Place {
            line: text.lines().count().max(1),
            col: 1,
        };
        reading.mistakes.push(Mistake {
            place,
            cause: MistakeCause::NoUntil,
        });
    }
    let (until_us, until_place) = reading.until.unwrap_or((0, Place { line: 1, col: 1 }));
    let scenario = Scenario {
        period_us: reading.period.map(|(us, _)| us),
        entries: reading.entries,
        models: reading.models,
        until_us,
        until_place,
    };
    (scenario, reading.mistakes)
}

/// What the lines so far have said.
#[derive(Default)]
struct Reading {
    period: Option<(u32, Place)>,
    until: Option<(u64, Place)>,
    until_seen: bool,
    entries: Vec<Entry>,
    models: Vec<ModelLine>,
    mistakes: Vec<Mistake>,
}

impl Reading {
    fn line(&mut self, mut cursor: Cursor<'_>) -> Result<(), Mistake> {
        let Some((place, word)) = cursor.word() else {
            return Ok(());
        };
        match word {
            "period" => {
                let time_place = cursor.next_place();
                let time = cursor.time()?;
                cursor.end()?;
                let period_us = match u32::try_from(time.us) {
                    Ok(0) => Err(MistakeCause::ZeroPeriod),
                    Ok(us) if us <= MAX_TIME_US => Ok(us),
                    _ => Err(MistakeCause::LongPeriod),
                };
                let period_us = period_us.map_err(|cause| Mistake {
                    place: time_place,
                    cause,
                })?;
                once("period", &mut self.period, period_us, place)
            }
            "until" => {
                self.until_seen = true;
                let time = cursor.time()?;
                cursor.end()?;
                once("until", &mut self.until, time.us, place)
            }
            "at" => {
                let at_us = match cursor.time() {
                    Ok(time) => time.us,
                    Err(mistake) => {
                        // What follows can be wrong as well, and it is clear where it starts.
                        if !cursor.back_to_command(place) {
                            return Err(mistake);
                        }
                        self.mistakes.push(mistake);
                        0
                    }
                };
                let entry = cursor.entry(at_us, &mut self.mistakes)?;
                self.entries.push(entry);
                cursor.end()
            }
            "model" => {
                if self.models.len() == MAX_MODELS {
                    let cause = MistakeCause::TooManyModels;
                    return Err(Mistake { place, cause });
                }
                self.models.push(cursor.model());
                Ok(())
            }
            _ => {
                let meant = nearest(word, LINE_WORDS);
                Err(Mistake {
                    place,
                    cause: MistakeCause::UnknownLine {
                        found: word.into(),
                        meant: meant.map(String::from),
                    },
                })
            }
        }
    }
}

/// Keeps a value that may be given once.
fn once<V>(
    word: &'static str,
    kept: &mut Option<(V, Place)>,
    value: V,
    place: Place,
) -> Result<(), Mistake> {
    match kept {
        &mut Some((_, first)) => Err(Mistake {
            place,
            cause: MistakeCause::Twice {
                word,
                first_line: first.line,
            },
        }),
        None => {
            *kept = Some((value, place));
            Ok(())
        }
    }
}

/// A place in a line, its comment cut off.
struct Cursor<'a> {
    line: &'a str,
    rest: &'a str,
    place: Place,
}

impl<'a> Cursor<'a> {
    fn new(line: &'a str, number: usize) -> Self {
        let content = line.split_once('#').map_or(line, |(content, _)| content);
        let content = content.trim_end();
        Cursor {
            line: content,
            rest: content,
            place: Place {
                line: number,
                col: 1,
            },
        }
    }

    /// Takes the first `bytes` bytes, which end at a character's end.
    fn take(&mut self, bytes: usize) -> &'a str {
        let (taken, rest) = self.rest.split_at(bytes);
        self.place.col += taken.chars().count();
        self.rest = rest;
        taken
    }

    fn take_while(&mut self, belongs: impl Fn(char) -> bool) -> &'a str {
        let bytes = self.rest.find(|c| !belongs(c)).unwrap_or(self.rest.len());
        self.take(bytes)
    }

    /// Where the next word starts; the end of the line if there is none.
    fn next_place(&mut self) -> Place {
        self.take_while(char::is_whitespace);
        self.place
    }

    /// The next word and its place.
    fn word(&mut self) -> Option<(Place, &'a str)> {
        let place = self.next_place();
        let word = self.take_while(|c| !c.is_whitespace());
        (!word.is_empty()).then_some((place, word))
    }

    fn need_word(&mut self, expected: &'static str) -> Result<(Place, &'a str), Mistake> {
        self.word().ok_or(Mistake {
            place: self.place,
            cause: MistakeCause::Missing { expected },
        })
    }

    /// A number and its unit, with or without blanks between them.
    fn time(&mut self) -> Result<Time, Mistake> {
        let place = self.next_place();
        if self.rest.is_empty() {
            return Err(Mistake {
                place,
                cause: MistakeCause::Missing {
                    expected: "a time such as `200 ms`",
                },
            });
        }
        let start = self.rest;
        self.take_while(|c| c.is_ascii_digit());
        self.take_while(char::is_whitespace);
        self.take_while(|c| !c.is_whitespace());
        let written = &start[..start.len() - self.rest.len()];
        written.parse().map_err(|error| Mistake {
            place,
            cause: MistakeCause::Time(error),
        })
    }

    /// Goes back to the first word behind the first that is a command. Gives whether there is one.
    fn back_to_command(&mut self, first: Place) -> bool {
        self.rest = self.line;
        self.place = Place { col: 1, ..first };
        self.word();
        loop {
            self.next_place();
            let (rest, place) = (self.rest, self.place);
            match self.word() {
                None => return false,
                Some((_, word)) if COMMANDS.iter().any(|(name, _)| *name == word) => {
                    (self.rest, self.place) = (rest, place);
                    return true;
                }
                Some(_) => {}
            }
        }
    }

    fn entry(&mut self, at_us: u64, mistakes: &mut Vec<Mistake>) -> Result<Entry, Mistake> {
        let (place, word) =
            self.need_word("what happens: `set`, `clear`, `exit`, `busy`, `free` or `expect`")?;
        let mut command = match COMMANDS.iter().find(|(name, _)| *name == word) {
            Some((_, command)) => *command,
            None => {
                let meant = nearest(word, COMMANDS.map(|(name, _)| name));
                let mistake = Mistake {
                    place,
                    cause: MistakeCause::UnknownCommand {
                        found: word.into(),
                        meant: meant.map(String::from),
                    },
                };
                // Where it is clear what was meant, the name behind it is looked at too.
                let command = COMMANDS.iter().find(|(name, _)| Some(*name) == meant);
                match command {
                    Some((_, command)) if !self.rest.trim_start().is_empty() => {
                        mistakes.push(mistake);
                        *command
                    }
                    _ => return Err(mistake),
                }
            }
        };
        let expected = "a path such as `motion/Cruise`";
        let (mut place, mut text) = self.need_word(expected)?;
        if command == Command::Expect && text == "not" {
            command = Command::ExpectNot;
            (place, text) = self.need_word(expected)?;
        }
        Ok(Entry {
            at_us,
            command,
            name: Name {
                text: text.into(),
                place,
            },
        })
    }

    /// The words of a line, a comma behind one as a word of its own.
    fn model(&mut self) -> ModelLine {
        let mut words = Vec::new();
        while let Some((place, word)) = self.word() {
            let bare = word.trim_end_matches(',');
            let commas = bare.len()..word.len();
            let starts = (!bare.is_empty()).then_some(0..bare.len());
            for part in starts.into_iter().chain(commas.map(|at| at..at + 1)) {
                let before = word[..part.start].chars().count();
                words.push(Name {
                    text: word[part].to_owned(),
                    place: Place {
                        col: place.col + before,
                        ..place
                    },
                });
            }
        }
        ModelLine {
            words,
            end: self.place,
        }
    }

    fn end(&mut self) -> Result<(), Mistake> {
        match self.word() {
            Some((place, word)) => Err(Mistake {
                place,
                cause: MistakeCause::Excess { found: word.into() },
            }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_line_is_read() {
        let text = "\u{feff}# a comment\n\n  period 10ms # another\r\nat 20 ms set motion/Cruise.near\nat 1500us\tclear a/B.c#c\n\
                    at 0s exit a/B\nat 70 ms busy a/B\nat 70 ms free a/B\nuntil 1 s\nat 2 s expect a/B\nat 2 s expect not a/B.busy";
        let scenario = parse(text).unwrap();
        assert_eq!(
            (scenario.period_us, scenario.until_us),
            (Some(10_000), 1_000_000)
        );
        let entries: Vec<_> = scenario
            .entries
            .iter()
            .map(|entry| (entry.at_us, entry.command, entry.name.text.as_str()))
            .collect();
        let expected = [
            (20_000, Command::Set, "motion/Cruise.near"),
            (1_500, Command::Clear, "a/B.c"),
            (0, Command::Exit, "a/B"),
            (70_000, Command::Busy, "a/B"),
            (70_000, Command::Free, "a/B"),
            (2_000_000, Command::Expect, "a/B"),
            (2_000_000, Command::ExpectNot, "a/B.busy"),
        ];
        assert_eq!(entries, expected);
        assert_eq!(scenario.entries[1].name.place, Place { line: 5, col: 17 });
    }

    #[test]
    fn every_mistake_has_its_place_and_says_what_to_do() {
        let cases = [
            (
                "ta 1 ms exit a/B",
                "1:1",
                "a line starts with `at`, `model`, `period` or `until`, not with `ta`: did you mean `at`?",
            ),
            ("at 1 ms Set a/B.c", "1:9", "did you mean `set`?"),
            ("at 1 ms", "1:8", "the line ends here, but what happens"),
            ("at 1 ms set", "1:12", "a path such as"),
            ("at 1 ms expect not # x", "1:19", "a path such as"),
            ("at", "1:3", "a time such as"),
            ("at x", "1:4", "whole number"),
            ("at 10 set a/B.c", "1:4", "the unit of a time"),
            ("ät 1 ms exit a/B", "1:1", "not with `ät`"),
            ("at 1 ms exit ä/B c", "1:18", "`c` is too much"),
            ("period 0 us", "1:8", "longer than nothing"),
            ("period 4001 s", "1:8", "must not be above 4000 s"),
            ("period 1 ms 2", "1:13", "`2` is too much"),
            ("until 1 s", "2:1", "`until` stands in line 1 already"),
        ];
        for (line, place, message) in cases {
            let mistakes = parse(&format!("{line}\nuntil 1 ms")).unwrap_err();
            assert_eq!(mistakes.len(), 1, "{line}: {mistakes:?}");
            assert_eq!(mistakes[0].place.to_string(), place, "{line}");
            let said = mistakes[0].cause.to_string();
            assert!(said.contains(message), "{line}: {said}");
        }
    }

    #[test]
    fn until_is_required_and_asked_for_once() {
        let cases = [
            ("", Err("1:1")),
            ("at 1 ms exit a/B\n# end\n", Err("2:1")),
            // What is wrong with the line that is there is all that is to be said.
            ("until soon", Err("1:7")),
            ("until 0 ms", Ok(0)),
        ];
        for (text, expected) in cases {
            let found = parse(text)
                .map(|scenario| scenario.until_us)
                .map_err(|mistakes| {
                    assert_eq!(mistakes.len(), 1, "{text:?}");
                    mistakes[0].place.to_string()
                });
            assert_eq!(found, expected.map_err(String::from), "{text:?}");
        }
    }

    #[test]
    fn all_mistakes_are_told_in_one_go() {
        let mistakes = parse("at 1 ms\nfoo\nperiod 1 ms\nperiod 2 ms\n").unwrap_err();
        let lines: Vec<_> = mistakes.iter().map(|mistake| mistake.place.line).collect();
        assert_eq!(lines, [1, 2, 4, 4]);
    }

    #[test]
    fn a_line_is_read_on_where_it_is_clear_how() {
        // What is read of a line with a mistake, and how many mistakes.
        let cases = [
            ("at soon set a/B.c", Some(Command::Set), 1),
            ("at 10 exit a/B", Some(Command::Exit), 1),
            ("at 1 ms expekt not a/B", Some(Command::ExpectNot), 1),
            ("at 1 ms exit a/B c", Some(Command::Exit), 1),
            ("at 1 ms nothing a/B", None, 1),
            ("at 1 ms sett", None, 1),
            ("at soon", None, 1),
        ];
        for (line, command, count) in cases {
            let (scenario, mistakes) = read(&format!("{line}\nuntil 1 ms"));
            let read = scenario.entries.first().map(|entry| entry.command);
            assert_eq!(
                (read, mistakes.len()),
                (command, count),
                "{line}: {mistakes:?}"
            );
        }
    }
}
