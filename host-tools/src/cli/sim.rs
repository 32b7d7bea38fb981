//! `esm sim`: the machine alone, in virtual time.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use esm_core::Fault;

use super::console::Console;
use super::exit::CommandError;
use super::file;
use super::mission::{self, Audience};
use crate::clean::counted;
use crate::compile::NameTable;
use crate::scenario::ports::Ports;
use crate::scenario::{self, Mistake, Place};
use crate::sim::{self, Outcome, SimError, milliseconds};

/// Runs the machine alone, in virtual time, against a scenario
///
/// The machine runs on the interpreter that the firmware has. The tasks do not: the scenario says
/// what they would report, and what must hold. The exit status is 1 if an expectation fails or the
/// machine ends in a fault.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm sim missions/patrol.esm patrol.scenario
  esm sim missions/patrol.esm patrol.scenario --trace - | jq -c .active

A scenario, one entry a line:
  period 10 ms                              # overrides the interpreter slot's
  at 20 ms set    motion/Cruise.near        # an out flag of a task state; `clear` takes it back
  at 60 ms exit   motion/Escape/turn/Back   # the task reports that it is finished
  at 70 ms busy   motion/Cruise             # the task cannot be executed; `free` takes it back
  at 40 ms expect motion/Escape             # after the macro step at 40 ms this is a current state
  at 40 ms expect not motion/Cruise.near    # a flag; .exit, .timeout and .busy too
  until 200 ms                              # the last macro step is the last multiple of the period not above this")]
pub struct SimArgs {
    /// The mission
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// What the tasks report and what must hold
    #[arg(value_name = "SCENARIO")]
    pub scenario: PathBuf,

    /// Where the trace goes, as JSON Lines; `-` for standard output
    #[arg(long, value_name = "OUT")]
    pub trace: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// If the mission or the scenario has errors, an expectation fails, the machine faults, or the
/// trace cannot be written.
pub fn execute(args: &SimArgs, console: &mut Console) -> Result<(), CommandError> {
    if let Some(path) = &args.trace {
        file::keep_sources(path, [args.file.as_path(), &args.scenario])?;
    }
    let verified = mission::compiled(&args.file, None, NameTable::Kept, Audience::Person, console)?;
    let directory = Arc::new(mission::names(&verified)?);
    let text = file::read_text(&args.scenario, "scenario")?;
    let ports = Ports::of(&verified.tables(), &directory);
    let bound = scenario::bind::read(&text, &directory, &ports);
    let bound = bound.map_err(|mistakes| tell_mistakes(&args.scenario, &mistakes, console))?;
    let outcome = match args.trace.as_deref() {
        None => sim::run(verified, &directory, &bound, std::io::sink())?,
        Some(path) if path == Path::new("-") => {
            sim::run(verified, &directory, &bound, console.json_out())?
        }
        Some(path) => sim::run(verified, &directory, &bound, file::create(path, "trace")?)?,
    };
    for failure in &outcome.failures {
        let Place { line, col } = failure.name.place;
        console.note(&format!(
            "{}:{line}:{col}: {failure}",
            args.scenario.display()
        ));
        let timeline = sim::timeline_text(&failure.timeline, &text);
        for moment in timeline.lines() {
            console.note(moment);
        }
    }
    tell_outcome(&outcome, args, console)
}

/// Tells what is wrong with a scenario.
fn tell_mistakes(path: &Path, mistakes: &[Mistake], console: &mut Console) -> CommandError {
    for Mistake { place, cause } in mistakes {
        console.note(&format!("{}:{place}: error: {cause}", path.display()));
    }
    CommandError::Told
}

/// Tells how the run ended, where it does not disturb the trace.
fn tell_outcome(
    outcome: &Outcome,
    args: &SimArgs,
    console: &mut Console,
) -> Result<(), CommandError> {
    if let Some((at, fault)) = &outcome.fault {
        let (step, ms) = (at.step, milliseconds(at.t_us));
        console.note(&format!(
            "fault: {} in macro step {step}, at {ms} ms: {}",
            fault.code(),
            remedy(*fault)
        ));
    }
    let Outcome {
        steps,
        transitions,
        met,
        finished,
        ..
    } = outcome;
    let (steps, transitions) = (
        counted(*steps, "macro step"),
        counted(*transitions, "transition"),
    );
    let met = counted(*met as u64, "expectation");
    let mut told = format!("{steps}, {transitions}; {met} met");
    if !outcome.failures.is_empty() {
        told += &format!(", {} failed", outcome.failures.len());
    }
    told += if *finished {
        "; finished in "
    } else {
        "; ended in "
    };
    told += &outcome.active.join(", ");
    if args.trace.as_deref() == Some(Path::new("-")) {
        console.note(&told);
    } else {
        writeln!(console.out(), "{told}")?;
    }
    if outcome.is_good() {
        Ok(())
    } else {
        Err(CommandError::Told)
    }
}

/// What a person can do about a fault.
fn remedy(fault: Fault) -> &'static str {
    match fault {
        Fault::EventQueueOverflow => {
            "raise `queue`, or break the circle in which events cause each other"
        }
        Fault::MacroStepLimit => "break the circle in which events cause each other",
    }
}

impl From<SimError> for CommandError {
    fn from(error: SimError) -> Self {
        match error {
            // Standard output may be where the trace goes: then a reader that has gone is no
            // failure.
            SimError::Trace(error) => error.into(),
            memory @ SimError::Memory { .. } => CommandError::Input(memory.into()),
        }
    }
}
