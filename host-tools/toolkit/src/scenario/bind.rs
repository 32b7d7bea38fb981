//! A scenario's names, found in a machine.

use crate::trace::directory::Directory;

use super::models::{self, Model};
use super::names::SplitName;
use super::ports::Ports;
use super::{Command, Entry, MAX_MACRO_STEPS, Mistake, MistakeCause, Name, Scenario};

pub use super::names::{FlagKind, Subject};
pub use super::report::Report;

/// A scenario whose names are indices of one machine.
#[derive(Clone, Debug, PartialEq)]
pub struct BoundScenario {
    /// The interpreter's period in microseconds, where the scenario overrides the slot's. Never 0.
    pub period_us: Option<u32>,
    /// What happens before the macro steps, in the order in which it does.
    pub inputs: Vec<Input>,
    /// What must hold after the macro steps, in the order in which it is looked at.
    pub expectations: Vec<Expectation>,
    /// What stands in for tasks, in the order of the file.
    pub models: Vec<Model>,
    /// Time of the last macro step that may run, in microseconds.
    pub until_us: u64,
}

/// Something that a task reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Input {
    /// Its time, in microseconds from the first macro step.
    pub at_us: u64,
    /// Its line of the scenario, from 1.
    pub line: usize,
    /// Index of the task instance.
    pub task: usize,
    /// What is reported.
    pub report: Report,
}

/// Something that must hold after a macro step.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Expectation {
    /// Its time, in microseconds from the first macro step.
    pub at_us: u64,
    /// What is looked at.
    pub subject: Subject,
    /// What is expected of it: current or set, or not.
    pub holds: bool,
    /// The name, as the scenario has it.
    pub name: Name,
}

/// Reads a scenario for a machine with these data ports.
///
/// # Errors
/// Every mistake, in the order of the file: lines that cannot be read, and names that do not exist
/// or do not fit.
pub fn read(
    text: &str,
    directory: &Directory,
    ports: &Ports,
) -> Result<BoundScenario, Vec<Mistake>> {
    let (scenario, mut mistakes) = super::read(text);
    match bind(&scenario, directory, ports) {
        Ok(bound) if mistakes.is_empty() => return Ok(bound),
        Ok(_) => {}
        Err(more) => mistakes.extend(more),
    }
    mistakes.sort_by_key(|mistake| mistake.place);
    Err(mistakes)
}

/// Finds a scenario's names in a machine.
///
/// # Errors
/// Every name that does not exist or does not fit, in the order of the file; and an end that is too
/// far away.
pub fn bind(
    scenario: &Scenario,
    directory: &Directory,
    ports: &Ports,
) -> Result<BoundScenario, Vec<Mistake>> {
    let (mut inputs, mut expectations, mut mistakes) = (Vec::new(), Vec::new(), Vec::new());
    let mut models = Vec::new();
    for line in &scenario.models {
        match models::bound(line, directory, ports) {
            Ok(model) => models.push(model),
            Err(mistake) => mistakes.push(mistake),
        }
    }
    for entry in &scenario.entries {
        match bound(entry, directory) {
            Ok(Bound::Input(input)) => inputs.push(input),
            Ok(Bound::Expectation(expectation)) => expectations.push(expectation),
            Err(mistake) => mistakes.push(mistake),
        }
    }
    let period_us = scenario
        .period_us
        .unwrap_or(directory.interpreter_period_us());
    let steps = scenario.until_us / u64::from(period_us.max(1));
    if steps > MAX_MACRO_STEPS {
        mistakes.push(Mistake {
            place: scenario.until_place,
            cause: MistakeCause::TooManySteps { steps },
        });
    }
    if !mistakes.is_empty() {
        mistakes.sort_by_key(|mistake| mistake.place);
        return Err(mistakes);
    }
    // Stable sorts: what stands first in the file comes first among equal times.
    inputs.sort_by_key(|input| input.at_us);
    expectations.sort_by_key(|expectation| expectation.at_us);
    let Scenario {
        period_us,
        until_us,
        ..
    } = *scenario;
    Ok(BoundScenario {
        period_us,
        inputs,
        expectations,
        models,
        until_us,
    })
}

enum Bound {
    Input(Input),
    Expectation(Expectation),
}

fn bound(entry: &Entry, directory: &Directory) -> Result<Bound, Mistake> {
    let name = SplitName::of(&entry.name);
    let input = |task, report| {
        Bound::Input(Input {
            at_us: entry.at_us,
            line: entry.name.place.line,
            task,
            report,
        })
    };
    match entry.command {
        Command::Set | Command::Clear => {
            let (task, flag) = name.written_flag(directory)?;
            Ok(input(
                task,
                Report::Flag {
                    flag,
                    value: entry.command == Command::Set,
                },
            ))
        }
        Command::Exit => Ok(input(name.task(directory)?, Report::Exit)),
        Command::Busy => Ok(input(name.task(directory)?, Report::Busy(true))),
        Command::Free => Ok(input(name.task(directory)?, Report::Busy(false))),
        Command::Expect | Command::ExpectNot => {
            let subject = name.subject(directory)?;
            let holds = entry.command == Command::Expect;
            Ok(Bound::Expectation(Expectation {
                at_us: entry.at_us,
                subject,
                holds,
                name: entry.name.clone(),
            }))
        }
    }
}
