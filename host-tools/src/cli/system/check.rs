//! `esm system check`: whether the ends of all links fit.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use super::loaded::Loaded;
use crate::clean::counted;
use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::cli::mission::Audience;

/// Says what is wrong with a system: its file, its missions, and both ends of each link
///
/// Each frame that one mission sends must be received by the other end with the same identifier,
/// type or number of flags, payload and period. The exit status is 1 if there is an error.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm system check robot.system
  esm system check robot.system --json | jq -r .message

With --json, one object a line on standard output: code, severity (error, warning), file, line, col (from 1), message.")]
pub struct CheckArgs {
    /// The system file
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// One JSON object a line, for programs
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// If the file cannot be read, or something in the system has errors.
pub fn execute(args: &CheckArgs, console: &mut Console) -> Result<(), CommandError> {
    let loaded = Loaded::load(&args.file)?;
    let audience = match args.json {
        true => Audience::Program,
        false => Audience::Person,
    };
    loaded.tell(audience, console)?;
    let (errors, warnings) = loaded.counts();
    if !args.json {
        let file = args.file.display();
        let (of_errors, of_warnings) = (counted(errors, "error"), counted(warnings, "warning"));
        writeln!(console.out(), "{file}: {of_errors}, {of_warnings}")?;
    }
    match errors {
        0 => Ok(()),
        _ => Err(CommandError::Told),
    }
}
