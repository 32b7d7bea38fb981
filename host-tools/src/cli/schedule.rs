//! `esm schedule`: when each slot starts.

use std::path::PathBuf;

use clap::Args;

use super::console::Console;
use super::exit::CommandError;

/// Lays out the time slots: when each one starts, or why there is no way
///
/// FILE needs no machine: slots alone are enough. The answer is a schedule, a proof that there is none, or, where the time given
/// ran out, that it is undecided; only a schedule makes the exit status 0.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm schedule missions/patrol.esm
  esm schedule slots.esm --limit 10 --json | jq .feasible
  esm schedule missions/patrol.esm --svg slots.svg

With --json: feasible (true, false, or null where undecided in time), hyperperiod_us, utilisation, slots: [slot, start_us, \
period_us, duration_us]. It comes also where the answer is no.")]
pub struct ScheduleArgs {
    /// The file with the slots
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,

    /// Draws the schedule over one hyperperiod
    #[arg(long, value_name = "OUT")]
    pub svg: Option<PathBuf>,

    /// How long the search may take, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 60)]
    pub limit: u64,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &ScheduleArgs, console: &mut Console) -> Result<(), CommandError> {
    let _ = (args, console);
    Err(CommandError::World(anyhow::anyhow!(
        "`esm schedule` is not connected yet"
    )))
}
