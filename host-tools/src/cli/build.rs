//! `esm build`: a mission as the blob that a robot takes.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::console::Console;
use super::exit::CommandError;
use super::file;
use super::mission::{self, Audience};
use crate::boards;
use crate::bound::{Machine, bound};
use crate::clean::counted;
use crate::compile::NameTable;
use crate::fit;
use crate::inspect::Counts;

/// Compiles a mission to the blob that a robot takes
///
/// The blob holds the machine, its schedule, data paths and parameters, and the names that traces
/// and status need. OUT appears whole or not at all: a build that fails leaves the old file alone.
/// With --board, a mission that needs more than that board has room for is not built (E012);
/// without, it is built, and it is told where the default board has no room for it.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm build missions/patrol.esm -o patrol.blob
  esm build missions/patrol.esm -o patrol.blob --board host
  esm build missions/patrol.esm -o patrol.blob --json | jq .bytes
  esm build missions/patrol.esm -o patrol.blob --strip

With --json: bytes, states, transitions, containers, instances, events, flags, ram_bytes, and where the board's interpreter
was measured macro_step_instructions and macro_step_events: the most that a macro step takes (`esm bound` says where from).")]
pub struct BuildArgs {
    /// The mission
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// Where the blob goes
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,

    /// The board that it is for, whose capacities it must not exceed
    #[arg(long, value_name = "BOARD")]
    pub board: Option<String>,

    /// What was built as one JSON object, for programs
    #[arg(long)]
    pub json: bool,

    /// Leaves out all names but those of tasks: a smaller blob, of which traces and status cannot
    /// say what it does
    #[arg(long)]
    pub strip: bool,
}

/// What `--json` says.
#[derive(Serialize)]
struct Built<'c> {
    #[serde(flatten)]
    counts: &'c Counts,
    #[serde(skip_serializing_if = "Option::is_none")]
    macro_step_instructions: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    macro_step_events: Option<u64>,
}

/// Runs the command.
///
/// # Errors
/// If the mission cannot be compiled or the blob cannot be written.
pub fn execute(args: &BuildArgs, console: &mut Console) -> Result<(), CommandError> {
    file::keep_sources(&args.output, [args.file.as_path()])?;
    let audience = if args.json {
        Audience::Program
    } else {
        Audience::Person
    };
    let find = |name| boards::find(name).map_err(|unknown| CommandError::Usage(unknown.into()));
    let board = args.board.as_deref().map(find).transpose()?;
    let names = if args.strip {
        NameTable::LeftOut
    } else {
        NameTable::Kept
    };
    let verified = mission::compiled(&args.file, board, names, audience, console)?;
    file::write_whole(&args.output, verified.bytes(), "blob")?;
    if board.is_none() {
        let default = find(boards::DEFAULT)?;
        for shortage in fit::shortages(&verified, default) {
            console.note(&format!("note: {shortage}"));
        }
    }
    let counts = Counts::of(&verified);
    let costs = board.map_or_else(|| find(boards::DEFAULT), Ok)?.costs();
    let bound = costs.map(|costs| bound(&Machine::of(&verified.tables()), &costs));
    if args.json {
        return console.json_line(&Built {
            counts: &counts,
            macro_step_instructions: bound.as_ref().map(|bound| bound.instructions),
            macro_step_events: bound.as_ref().map(|bound| bound.micro_steps),
        });
    }
    let said = |count: usize, what| counted(count as u64, what);
    let (states, transitions) = (
        said(counts.states, "state"),
        said(counts.transitions, "transition"),
    );
    let (containers, instances) = (
        said(counts.containers, "container"),
        said(counts.instances, "instance"),
    );
    let (events, flags) = (said(counts.events, "event"), said(counts.flags, "flag bit"));
    let (
        output,
        hash,
        Counts {
            bytes, ram_bytes, ..
        },
    ) = (args.output.display(), verified.hash(), counts);
    let out = console.out();
    writeln!(out, "{output}: {bytes} bytes, mission {hash:08x}")?;
    writeln!(
        out,
        "  {states}, {transitions}, {containers} (the machine included), {instances} of them"
    )?;
    writeln!(
        out,
        "  {events}, {flags}; runs in {ram_bytes} bytes of memory"
    )?;
    if let Some(bound) = bound {
        writeln!(
            out,
            "  a macro step takes at most {} instructions",
            bound.instructions
        )?;
    }
    Ok(())
}
