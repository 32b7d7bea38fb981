//! What happens to a machine from outside, as data: the reference takes it as it is, `esm sim` as
//! the text it prints. Files are read here a second time, so that the reference depends on no other
//! reader.

use std::fmt;
use std::str::FromStr;

/// A scenario: timed changes and expectations, in any order of their times.
#[derive(Clone, Debug, Default)]
pub struct Scenario {
    /// Overrides the period of the interpreter slot, in microseconds.
    pub period_us: Option<u64>,
    /// The last macro step is the last multiple of the period not above this.
    pub until_us: u64,
    /// Entries in the order of the file.
    pub entries: Vec<Entry>,
}

/// One line with a time.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Takes effect at the first macro step at or after this time, in microseconds.
    pub at_us: u64,
    /// What it does.
    pub action: Action,
}

/// What a line does. Paths are region and state names in turn from the root, joined by `/`.
#[derive(Clone, Debug)]
pub enum Action {
    /// `set` or `clear`: an `out` flag of a task state.
    Write {
        /// Path of the task state.
        state: String,
        /// Name of the flag.
        flag: String,
        /// `true` for `set`.
        value: bool,
    },
    /// `exit`: the task reports that it is finished.
    Exit {
        /// Path of the task state.
        state: String,
    },
    /// `busy` or `free`: the busy flag of a task state.
    Busy {
        /// Path of the task state.
        state: String,
        /// `true` for `busy`.
        value: bool,
    },
    /// `expect` or `expect not`: looks at the machine after the macro step.
    Expect {
        /// Path of a state, pseudo-states included.
        state: String,
        /// A control or system flag of the state; without one, the state is to be current.
        flag: Option<String>,
        /// `false` for `expect not`.
        value: bool,
    },
}

impl fmt::Display for Entry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "at {} us ", self.at_us)?;
        match &self.action {
            Action::Write { state, flag, value } => {
                write!(f, "{} {state}.{flag}", if *value { "set" } else { "clear" })
            }
            Action::Exit { state } => write!(f, "exit {state}"),
            Action::Busy { state, value } => {
                write!(f, "{} {state}", if *value { "busy" } else { "free" })
            }
            Action::Expect { state, flag, value } => {
                write!(f, "expect {}{state}", if *value { "" } else { "not " })?;
                flag.iter().try_for_each(|flag| write!(f, ".{flag}"))
            }
        }
    }
}

impl fmt::Display for Scenario {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(period_us) = self.period_us {
            writeln!(f, "period {period_us} us")?;
        }
        for entry in &self.entries {
            writeln!(f, "{entry}")?;
        }
        writeln!(f, "until {} us", self.until_us)
    }
}

impl FromStr for Scenario {
    type Err = String;

    /// Reads a file that is known to be right. What is wrong with one that is not is said in a few
    /// words.
    fn from_str(text: &str) -> Result<Self, String> {
        let mut scenario = Scenario::default();
        let mut has_end = false;
        for (line, number) in text.lines().zip(1..) {
            let line = line.split('#').next().unwrap_or_default();
            let words: Vec<&str> = line.split_whitespace().collect();
            let wrong = |cause: &str| format!("line {number}: {cause}: {line}");
            match words[..] {
                [] => {}
                ["period", count, unit] => {
                    scenario.period_us =
                        Some(time_us(count, unit).ok_or_else(|| wrong("no time"))?);
                }
                ["until", count, unit] => {
                    scenario.until_us = time_us(count, unit).ok_or_else(|| wrong("no time"))?;
                    has_end = true;
                }
                ["at", count, unit, ref what @ ..] => scenario.entries.push(Entry {
                    at_us: time_us(count, unit).ok_or_else(|| wrong("no time"))?,
                    action: action(what).ok_or_else(|| wrong("no action"))?,
                }),
                _ => return Err(wrong("no entry")),
            }
        }
        if has_end {
            Ok(scenario)
        } else {
            Err("there is no `until`".to_owned())
        }
    }
}

/// A time in microseconds.
pub fn time_us(count: &str, unit: &str) -> Option<u64> {
    let unit_us = match unit {
        "us" => 1,
        "ms" => 1_000,
        "s" => 1_000_000,
        _ => return None,
    };
    count.parse::<u64>().ok()?.checked_mul(unit_us)
}

/// The words behind the time.
fn action(words: &[&str]) -> Option<Action> {
    let state_and_flag = |name: &str| {
        name.split_once('.')
            .map(|(state, flag)| (state.to_owned(), flag.to_owned()))
    };
    Some(match *words {
        [word @ ("set" | "clear"), name] => {
            let (state, flag) = state_and_flag(name)?;
            let value = word == "set";
            Action::Write { state, flag, value }
        }
        ["exit", state] => Action::Exit {
            state: state.to_owned(),
        },
        [word @ ("busy" | "free"), state] => Action::Busy {
            state: state.to_owned(),
            value: word == "busy",
        },
        ["expect", name] | ["expect", "not", name] => {
            let (state, flag) = match state_and_flag(name) {
                Some((state, flag)) => (state, Some(flag)),
                None => (name.to_owned(), None),
            };
            let value = words.len() == 2;
            Action::Expect { state, flag, value }
        }
        _ => return None,
    })
}
