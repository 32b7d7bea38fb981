//! `esm fmt`: one layout for every file.

use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use clap::Args;

use super::console::Console;
use super::difference;
use super::exit::CommandError;
use super::file;
use super::mission;
use crate::clean::counted;
use crate::lang::MAX_FILE_BYTES;
use crate::lang::format;

/// How deep folders are searched for files.
const MAX_FOLDER_DEPTH: usize = 32;

/// Stands for standard input on the command line.
const STANDARD_INPUT: &str = "-";

/// What standard input is called in messages.
const STANDARD_INPUT_NAME: &str = "<standard input>";

/// Lays files out in the one layout that all missions have
///
/// Blanks, line breaks and empty lines change, and nothing else: every word and comment stays, in
/// its order. A file that has the layout already is not touched, one with syntax errors is left
/// alone, and a file is replaced whole or not at all. Of a folder all `.esm` files in it are taken,
/// at any depth, but not what starts with a dot.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm fmt missions/patrol.esm               lay out one file
  esm fmt missions examples                 all .esm files in two folders
  esm fmt missions --check                  change nothing; exit status 1 if a file would change
  esm fmt - < patrol.esm                    from standard input to standard output, for editors")]
pub struct FmtArgs {
    /// Files and folders; `-` is standard input, laid out to standard output
    #[arg(value_name = "FILE", required = true)]
    pub files: Vec<PathBuf>,

    /// Change nothing: name the files that would change, show where, and end with status 1 if there
    /// are any
    #[arg(long, conflicts_with = "stdout")]
    pub check: bool,

    /// Write the result to standard output and leave the file alone; for one file
    #[arg(long)]
    pub stdout: bool,
}

/// Runs the command. Every file is done, whatever is wrong with those before it.
///
/// # Errors
/// If a file cannot be read or has syntax errors, or if it would change and `--check` was given;
/// else what kept it from being written.
pub fn execute(args: &FmtArgs, console: &mut Console) -> Result<(), CommandError> {
    let is_input = |path: &PathBuf| path.as_os_str() == STANDARD_INPUT;
    if args.files.iter().any(is_input) || args.stdout {
        return match args.files.as_slice() {
            [path] if is_input(path) && args.check => {
                let text = read_standard_input()?;
                let is_changed = check(Path::new(STANDARD_INPUT_NAME), &text, console)?;
                verdict(u64::from(is_changed), console)
            }
            [path] if is_input(path) => {
                let text = read_standard_input()?;
                print(STANDARD_INPUT_NAME, &text, console)
            }
            [path] if path.is_file() => print(&path.to_string_lossy(), &read(path)?, console),
            [path] => Err(CommandError::Input(anyhow!(
                "{} is not a file",
                path.display()
            ))),
            _ => Err(CommandError::Usage(anyhow!(
                "what goes to standard output is one file: name it alone"
            ))),
        };
    }
    let mut paths = Vec::new();
    // The first failure of the outside world, else that of a file.
    let mut failure: Option<CommandError> = None;
    for path in &args.files {
        if let Err(error) = collect(path, 0, &mut paths) {
            fail(&mut failure, error, console);
        }
    }
    // A file that is named twice is one file.
    let mut seen = std::collections::HashSet::new();
    paths.retain(|path| seen.insert(path.clone()));
    let mut changed = 0;
    for path in &paths {
        let done = read(path).and_then(|bytes| {
            if args.check {
                check(path, &bytes, console)
            } else {
                rewrite(path, &bytes, console)
            }
        });
        match done {
            Ok(is_changed) => changed += u64::from(is_changed),
            Err(error) => fail(&mut failure, error, console),
        }
    }
    match failure {
        Some(error) => Err(error),
        None if args.check => verdict(changed, console),
        None => Ok(()),
    }
}

/// Keeps the failure that decides the exit status; the others are told at once.
fn fail(first: &mut Option<CommandError>, error: CommandError, console: &mut Console) {
    let is_worse =
        matches!(error, CommandError::World(_)) && !matches!(first, Some(CommandError::World(_)));
    if let Some(told) = if first.is_none() || is_worse {
        first.replace(error)
    } else {
        Some(error)
    } {
        console.report(&told);
    }
}

fn verdict(changed: u64, console: &mut Console) -> Result<(), CommandError> {
    if changed == 0 {
        return Ok(());
    }
    console.note(&format!(
        "{} would change: `esm fmt` without `--check` lays out",
        counted(changed, "file")
    ));
    Err(CommandError::Told)
}

/// The files that a path stands for, those of a folder sorted by name.
fn collect(path: &Path, depth: usize, paths: &mut Vec<PathBuf>) -> Result<(), CommandError> {
    let input = |error: io::Error| {
        CommandError::Input(
            anyhow::Error::new(error).context(format!("cannot read {}", path.display())),
        )
    };
    if !fs::metadata(path).map_err(input)?.is_dir() {
        paths.push(path.to_owned());
        return Ok(());
    }
    if depth == MAX_FOLDER_DEPTH {
        return Err(CommandError::Input(anyhow!(
            "folders are nested more than {MAX_FOLDER_DEPTH} deep at {}",
            path.display()
        )));
    }
    let mut entries: Vec<(PathBuf, bool)> = Vec::new();
    for entry in fs::read_dir(path).map_err(input)? {
        let entry = entry.map_err(input)?;
        // A link to a folder is not followed: it may lead back.
        let is_folder = entry.file_type().map_err(input)?.is_dir();
        let name = entry.file_name();
        let is_hidden = name.to_string_lossy().starts_with('.');
        let is_source = Path::new(&name).extension().is_some_and(|it| it == "esm");
        if !is_hidden && (is_folder || is_source && entry.path().is_file()) {
            entries.push((entry.path(), is_folder));
        }
    }
    entries.sort();
    for (entry, is_folder) in entries {
        if is_folder {
            collect(&entry, depth + 1, paths)?;
        } else {
            paths.push(entry);
        }
    }
    Ok(())
}

fn read(path: &Path) -> Result<Vec<u8>, CommandError> {
    mission::refuse_blob(path)?;
    crate::lang::read_source(path).map_err(|error| mission::unread(path, &error))
}

fn read_standard_input() -> Result<Vec<u8>, CommandError> {
    let mut bytes = Vec::new();
    io::stdin()
        .lock()
        .take(MAX_FILE_BYTES + 1)
        .read_to_end(&mut bytes)
        .context("cannot read standard input")
        .map_err(CommandError::World)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(CommandError::Input(anyhow!(
            "standard input has more than {MAX_FILE_BYTES} bytes, a source file has at most that many"
        )));
    }
    Ok(bytes)
}

/// The text in its layout; syntax errors are told.
fn laid_out(name: &str, bytes: &[u8], console: &mut Console) -> Result<String, CommandError> {
    format::format(name, bytes).map_err(|refusal| {
        console.coloured(refusal.render(console.colour_error()).trim_end());
        console.note(&format!("{name} is left as it is: it has syntax errors"));
        CommandError::Told
    })
}

fn print(name: &str, bytes: &[u8], console: &mut Console) -> Result<(), CommandError> {
    let text = laid_out(name, bytes, console)?;
    console.text(&text)
}

/// Gives whether the file would change, and shows how.
fn check(path: &Path, bytes: &[u8], console: &mut Console) -> Result<bool, CommandError> {
    let name = path.display().to_string();
    let text = laid_out(&name, bytes, console)?;
    if text.as_bytes() == bytes {
        return Ok(false);
    }
    writeln!(console.out(), "{name} would change:")?;
    let before = String::from_utf8_lossy(bytes);
    console.text(&difference::first(&before, &text))?;
    Ok(true)
}

/// Gives whether the file has changed.
fn rewrite(path: &Path, bytes: &[u8], console: &mut Console) -> Result<bool, CommandError> {
    let text = laid_out(&path.to_string_lossy(), bytes, console)?;
    if text.as_bytes() == bytes {
        return Ok(false);
    }
    file::write_whole(path, text.as_bytes(), "laid out file")?;
    writeln!(console.out(), "laid out {}", path.display())?;
    Ok(true)
}
