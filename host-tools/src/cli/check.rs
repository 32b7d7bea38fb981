//! `esm check`: everything that is wrong with a set of files.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use super::console::Console;
use super::exit::CommandError;
use super::mission::{self, Audience};
use crate::boards;
use crate::clean::counted;
use crate::compile::{NameTable, machine_without_regions};
use crate::lang::Severity;
use crate::time::work_limit;

/// Says what is wrong with a mission: every error and warning at once
///
/// Reads FILE and all that it uses, and reports each mistake with its code, its place, the source line and, where there is one,
/// the likely fix. Of the files that FILE takes in, what is unused is only counted. A mission without other errors is also compared with what the board has room for. The exit status is 1 if there is
/// an error; warnings alone leave it 0.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm check missions/patrol.esm
  esm check missions/patrol.esm --board host
  esm check missions/patrol.esm --all
  esm check missions/patrol.esm --json | jq -r 'select(.severity == \"error\") | .line'

With --json, one object a line on standard output: code, severity (error, warning), file, line, col (from 1), message.")]
pub struct CheckArgs {
    /// The mission, or a file of tasks and containers
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// One JSON object a line, for programs
    #[arg(long)]
    pub json: bool,

    /// Show also what is unused in the files that FILE takes in, as --json does
    #[arg(long)]
    pub all: bool,

    /// The board that it is for, whose capacities it must not exceed
    #[arg(long, value_name = "BOARD", default_value = boards::DEFAULT)]
    pub board: String,
}

/// Runs the command.
///
/// # Errors
/// If the file cannot be read, or has errors.
pub fn execute(args: &CheckArgs, console: &mut Console) -> Result<(), CommandError> {
    let board = boards::find(&args.board).map_err(|unknown| CommandError::Usage(unknown.into()))?;
    let mut checked = mission::read(&args.file)?;
    let is_empty = |model| machine_without_regions(model).is_some();
    if checked.model.as_ref().is_some_and(is_empty) {
        // Nothing is wrong with it; there is just nothing to compile.
        checked.lay_out(work_limit(mission::LAY_OUT_LIMIT));
    } else {
        mission::lay_out_and_compile(&mut checked, Some(board), NameTable::Kept)?;
    }
    let audience = if args.json {
        Audience::Program
    } else {
        Audience::Person
    };
    let mut folded = 0;
    if args.all && !args.json {
        mission::tell_all(&checked, console);
    } else {
        mission::tell(&checked, audience, console)?;
        if !args.json {
            folded = mission::tell_unused(&checked, console);
        }
    }
    let of_severity = |severity| {
        checked
            .diagnostics
            .iter()
            .filter(|found| found.severity() == severity)
            .count() as u64
    };
    let (errors, warnings) = (of_severity(Severity::Error), of_severity(Severity::Warning));
    if !args.json {
        let warnings = warnings.saturating_sub(folded as u64);
        let (errors, warnings) = (counted(errors, "error"), counted(warnings, "warning"));
        writeln!(
            console.out(),
            "{}: {errors}, {warnings}",
            args.file.display()
        )?;
    }
    if errors > 0 {
        Err(CommandError::Told)
    } else {
        Ok(())
    }
}
