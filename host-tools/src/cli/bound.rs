//! `esm bound`: the most instructions that a macro step can take.

use std::io::Write;
use std::path::PathBuf;

use anyhow::anyhow;
use clap::Args;
use serde::Serialize;

use super::console::Console;
use super::exit::CommandError;
use super::mission::{self, Audience};
use crate::boards::{self, Board};
use crate::bound::report::Report;
use crate::bound::search::{Effort, Subject};
use crate::bound::{Machine, bound};
use crate::clean::counted;
use crate::compile::NameTable;

/// Says how many instructions a macro step takes at most, and what takes them
///
/// The number holds for every macro step that the mission can come to, whatever its tasks do: it is
/// worked out from the compiled mission, over all states that can be current together and all
/// events that can follow from a pulse. What a part of a macro step takes was measured on the
/// board. With --search the mission is run as well, with tasks that do all they can to make a macro
/// step long: the longest that was found says how near the bound is.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm bound missions/patrol.esm
  esm bound missions/patrol.esm --search
  esm bound missions/patrol.esm --json | jq .instructions

With --json: instructions, micro_steps, events (counted, circle, limited, too-large), parts (event, times, state, to, instructions each), board, instruction_ns,
time_us, slot, duration_us, and with --search found_instructions and found_steps.")]
pub struct BoundArgs {
    /// The mission
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// The board that it is for
    #[arg(long, value_name = "BOARD", default_value = boards::DEFAULT)]
    pub board: String,

    /// Runs the mission in search of a long macro step
    #[arg(long)]
    pub search: bool,

    /// All that the macro step is made of, not only what takes most
    #[arg(long)]
    pub all: bool,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// Parts that are shown unless all are asked for.
const SHOWN: usize = 12;

/// The seed of a search: it is the same each time.
const SEED: u64 = 1;

/// What `--json` says.
#[derive(Serialize)]
struct Answer {
    #[serde(flatten)]
    report: Report,
    board: &'static str,
    instruction_ns: u32,
    /// Rounded up.
    time_us: u64,
    slot: u32,
    duration_us: u32,
    /// By the same costs.
    #[serde(skip_serializing_if = "Option::is_none")]
    found_instructions: Option<u64>,
    /// Macro steps that lead to it, itself included.
    #[serde(skip_serializing_if = "Option::is_none")]
    found_steps: Option<usize>,
}

/// Runs the command.
///
/// # Errors
/// If the mission cannot be compiled, or nothing was measured on the board.
pub fn execute(args: &BoundArgs, console: &mut Console) -> Result<(), CommandError> {
    let board = boards::find(&args.board).map_err(|unknown| CommandError::Usage(unknown.into()))?;
    let (Some(speed), Some(costs)) = (board.interpreter, board.costs()) else {
        return Err(CommandError::Usage(not_measured(board)));
    };
    let audience = if args.json {
        Audience::Program
    } else {
        Audience::Person
    };
    let verified = mission::compiled(&args.file, None, NameTable::Kept, audience, console)?;
    let tables = verified.tables();
    let report = Report::of(&bound(&Machine::of(&tables), &costs), &tables);
    let slot = tables.slot(tables.interpreter_slot()).unwrap_or_default();
    let found = if args.search {
        Subject::new(&verified).map(|subject| subject.search(&costs, Effort::USUAL, SEED))
    } else {
        None
    };
    let answer = Answer {
        time_us: speed.time_us(report.instructions),
        report,
        board: board.name,
        instruction_ns: speed.instruction_ns,
        slot: slot.number,
        duration_us: slot.duration_us,
        found_instructions: found.as_ref().map(|found| found.instructions),
        found_steps: found.as_ref().map(|found| found.inputs.len()),
    };
    if args.json {
        return console.json_line(&answer);
    }
    tell(args, &answer, console)
}

fn tell(args: &BoundArgs, answer: &Answer, console: &mut Console) -> Result<(), CommandError> {
    let report = &answer.report;
    let out = console.out();
    writeln!(
        out,
        "{}: a macro step takes at most {} instructions, with {} (the pulse included)",
        args.file.display(),
        report.instructions,
        counted(report.micro_steps, "event"),
    )?;
    writeln!(
        out,
        "  {} us at {} ns each on board `{}`; slot {} lasts {} us",
        answer.time_us, answer.instruction_ns, answer.board, answer.slot, answer.duration_us
    )?;
    let why = match report.events {
        "circle" => "events cause each other in a circle: as many count as a macro step may have",
        "limited" => "the pulse can lead to more events: as many count as a macro step may have",
        "too-large" => {
            "too large to tell its events apart: as many count as a macro step may have, each as the worst of all"
        }
        _ => "",
    };
    if !why.is_empty() {
        writeln!(out, "  {why}")?;
    }
    if let (Some(found), Some(steps)) = (answer.found_instructions, answer.found_steps) {
        writeln!(
            out,
            "  the longest that was found takes {found}, after {}: the bound is {:.2} times that",
            counted(steps.saturating_sub(1) as u64, "other macro step"),
            report.instructions as f64 / found.max(1) as f64
        )?;
    }
    let shown = if args.all {
        report.parts.len()
    } else {
        SHOWN.min(report.parts.len())
    };
    for part in report.parts.iter().take(shown) {
        writeln!(out, "  {:>8}  {}", part.instructions, part.says())?;
    }
    let left_out = report.parts.get(shown..).unwrap_or_default();
    if !left_out.is_empty() {
        let rest: u64 = left_out.iter().map(|part| part.instructions).sum();
        let parts = counted(left_out.len() as u64, "other part");
        writeln!(out, "  {rest:>8}  in {parts} (--all shows them)")?;
    }
    Ok(())
}

fn not_measured(board: &Board) -> anyhow::Error {
    let measured: Vec<String> = boards::all()
        .filter(|board| board.interpreter.is_some())
        .map(|board| format!("`{}`", board.name))
        .collect();
    anyhow!(
        "nobody has measured the interpreter of board `{}`; measured are {}",
        board.name,
        measured.join(", ")
    )
}
