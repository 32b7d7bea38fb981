//! `esm check`: everything that is wrong with a set of files.

use std::collections::{BTreeMap, HashSet};
use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;

use super::console::Console;
use super::exit::CommandError;
use super::file;
use super::mission::{self, Audience};
use crate::boards;
use crate::clean::counted;
use crate::compile::{NameTable, machine_without_regions};
use crate::lang::{self, Checked, Code, Diagnostic, Severity};
use crate::time::work_limit;

/// What `--fix` mends: how something is written, and a name that was probably meant. Behind the
/// fixes of other codes stands a choice, such as the value of a parameter, that only a person can
/// make.
const MENDED: [Code; 3] = [Code::E001, Code::E002, Code::E006];

/// As many mistakes are mended at a time: each is a check of the whole set, and who has more runs
/// the command again.
const MAX_MENDED: usize = 100;

/// Says what is wrong with a mission: every error and warning at once
///
/// Reads FILE and all that it uses, and reports each mistake with its code, its place, the source
/// line and, where there is one, the likely fix, with the line as it would be (`fix:`). Of the
/// files that FILE takes in, what is unused is only counted. A mission without other errors is also
/// compared with what the board has room for. The exit status is 1 if there is an error; warnings
/// alone leave it 0.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm check missions/patrol.esm
  esm check missions/patrol.esm --board host
  esm check missions/patrol.esm --all
  esm check square.esm --fix
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

    /// Mend FILE first: each mistake in how it is written (E001, E002, E006) that has one fix and
    /// no other
    #[arg(long)]
    pub fix: bool,

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
    if args.fix {
        mend(&args.file, console)?;
    }
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

/// Mends the mistakes of a file that have one fix and no other, and writes the file where it has
/// changed. A file with errors does nothing yet that a change could spoil; what a warning is about
/// may be meant.
fn mend(path: &Path, console: &mut Console) -> Result<(), CommandError> {
    let mut checked = mission::read(path)?;
    let identity = lang::identity(path);
    let mut tried: HashSet<(Code, String)> = HashSet::new();
    let mut mended = Vec::new();
    while mended.len() < MAX_MENDED {
        let Some(found) = mendable(&checked, &tried) else {
            break;
        };
        let kind = (found.code, found.message.clone());
        let place = checked.position(found.span);
        let fix = found.fixes.first();
        let text = fix.and_then(|fix| fix.apply(&checked.files.first()?.text));
        let line = fix.map(|fix| format!("{}:{}: {}", path.display(), place.line, fix.title));
        let (Some(text), Some(line)) = (text, line) else {
            break;
        };
        let open = BTreeMap::from([(identity.clone(), text)]);
        let after = lang::load_over(path, &open).map_err(|error| mission::unread(path, &error))?;
        if count(&after, &kind) < count(&checked, &kind) {
            mended.push(line);
            checked = after;
        } else {
            tried.insert(kind);
        }
    }
    if let Some(text) = checked.files.first().filter(|_| !mended.is_empty()) {
        file::write_whole(path, text.text.as_bytes(), "mended file")?;
    }
    for line in mended {
        console.note(&format!("mended {line}"));
    }
    Ok(())
}

/// The first error in the file itself that one fix mends, and no other, and was not tried in vain.
fn mendable<'c>(checked: &'c Checked, tried: &HashSet<(Code, String)>) -> Option<&'c Diagnostic> {
    checked.diagnostics.iter().find(|found| {
        MENDED.contains(&found.code)
            && matches!(found.fixes.as_slice(), [fix] if fix.edits.iter().all(|edit| edit.span.file == 0))
            && !tried.contains(&(found.code, found.message.clone()))
    })
}

fn count(checked: &Checked, (code, message): &(Code, String)) -> usize {
    let same = |found: &&Diagnostic| found.code == *code && found.message == *message;
    checked.diagnostics.iter().filter(same).count()
}
