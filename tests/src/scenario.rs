//! What happens to a machine from outside, as data: the reference takes it as it is, `esm sim` as the text it prints.

use std::fmt;

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
