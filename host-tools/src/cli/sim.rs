//! `esm sim`: the machine alone, in virtual time.

use std::path::PathBuf;

use clap::Args;

use super::console::Console;
use super::exit::CommandError;

/// Runs the machine alone, in virtual time, against a scenario
///
/// The machine runs on the interpreter that the firmware has. The tasks do not: the scenario says what they would report, and
/// what must hold. The exit status is 1 if an expectation fails or the machine ends in a fault.
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
/// What kept it from ending well.
pub fn execute(args: &SimArgs, console: &mut Console) -> Result<(), CommandError> {
    let _ = (args, console);
    Err(CommandError::World(anyhow::anyhow!(
        "`esm sim` is not connected yet"
    )))
}
