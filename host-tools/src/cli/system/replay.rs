//! `esm system replay`: a recorded run of all processors once more.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use clap::Args;
use serde::Serialize;

use super::recordings::{self, Recorded};
use crate::cli::console::{self, Console};
use crate::cli::exit::CommandError;
use crate::cli::expected::{self, Expected};
use crate::cli::file;
use crate::recording::file::FileEnd;
use crate::recording::player::{Outcome, replay};
use crate::system::merged_trace::{self, ProcessorTrace};

/// Runs what the recordings of a system hold once more, each processor by itself
///
/// A recording has what entered a processor's interpreter, what `receive` did with its frames
/// included. So neither the other processors nor the links are there, and the trace is that of the
/// run, byte for byte. One of the recordings alone is a matter of `esm replay`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm system run robot.system --until '60 s' --record robot.recs --trace robot.jsonl
  esm system replay robot.recs --trace again.jsonl
  esm system replay robot.recs --expect robot.jsonl
  esm replay robot.recs/head.rec --step")]
pub struct ReplayArgs {
    /// The folder with the recordings
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,

    /// Where the trace goes, as JSON Lines; `-` for standard output
    #[arg(long, value_name = "OUT")]
    pub trace: Option<PathBuf>,

    /// Compares the trace with this one, and says where they differ first
    #[arg(long, value_name = "TRACE")]
    pub expect: Option<PathBuf>,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    processors: Vec<ProcessorReport>,
}

/// What became of a recording.
#[derive(Serialize)]
struct ProcessorReport {
    processor: String,
    board: String,
    missions: Vec<String>,
    macro_steps: u64,
    transitions: u64,
    changes: u64,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &ReplayArgs, console: &mut Console) -> Result<(), CommandError> {
    let to_standard_output = args.trace.as_deref() == Some(Path::new("-"));
    if to_standard_output && args.json {
        return Err(CommandError::Usage(anyhow!(
            "both the trace and the report would go to standard output: name a file for the trace, or leave out `--json`"
        )));
    }
    if let Some(output) = args.trace.as_deref().filter(|_| !to_standard_output) {
        file::keep_sources(output, args.expect.as_deref())?;
        file::has_folder(output, "trace")?;
    }
    let expected = args.expect.as_deref().map(Expected::open).transpose()?;
    let recorded = recordings::read(&args.folder)?;
    let mut replayed = Vec::new();
    for it in &recorded {
        replayed.push(
            once_more(it)
                .with_context(|| it.processor.clone())
                .map_err(CommandError::Input)?,
        );
    }
    let mut traces = Vec::new();
    for (it, (lines, _)) in recorded.iter().zip(&replayed) {
        traces.push(ProcessorTrace {
            name: &it.processor,
            clock: it.clock,
            starts_us: it
                .recording
                .stretches
                .iter()
                .map(|it| it.start_us)
                .collect(),
            lines,
        });
    }
    let mut merged = Vec::new();
    merged_trace::write(&traces, &mut merged).map_err(|error| CommandError::Input(error.into()))?;
    match &args.trace {
        Some(_) if to_standard_output => {
            let mut out = console::json_output();
            out.write_all(&merged)?;
            out.flush()?;
        }
        Some(path) => file::write_whole(path, &merged, "trace")?,
        None => {}
    }
    let report = report(&recorded, replayed.iter().map(|(_, outcome)| outcome));
    if args.json {
        console.json_line(&report)?;
    } else {
        let text = words(&report);
        match to_standard_output {
            true => console.note(text.trim_end()),
            false => console.text(&text)?,
        }
    }
    let (Some(mut expected), Some(path)) = (expected, &args.expect) else {
        return Ok(());
    };
    expected.take(&merged);
    expected::judge(expected, path, console)
}

/// The trace of a recording.
fn once_more(recorded: &Recorded) -> Result<(String, Outcome), anyhow::Error> {
    let recording = &recorded.recording;
    // A system's run is written whole, at its end.
    if recording.end != FileEnd::Whole || recording.stretches.iter().any(|it| it.after_gap) {
        return Err(anyhow!(
            "the recording is not whole: what there is of it, `esm replay` runs once more"
        ));
    }
    let mut trace = Vec::new();
    let outcome = replay(recording, false, Some(&mut trace)).map_err(|(_, error)| error)?;
    Ok((String::from_utf8(trace)?, outcome))
}

fn report<'o>(recorded: &[Recorded], outcomes: impl Iterator<Item = &'o Outcome>) -> Report {
    let of = |(it, outcome): (&Recorded, &Outcome)| {
        let missions = it.recording.stretches.iter().filter_map(|stretch| {
            let mission = it.recording.mission(stretch.mission)?;
            Some(mission.name.clone())
        });
        ProcessorReport {
            processor: it.processor.clone(),
            board: it.recording.head.board.clone(),
            missions: missions.collect(),
            macro_steps: outcome.steps,
            transitions: outcome.transitions,
            changes: outcome.changes,
        }
    };
    Report {
        processors: recorded.iter().zip(outcomes).map(of).collect(),
    }
}

fn words(report: &Report) -> String {
    let of = |it: &ProcessorReport| {
        format!(
            "{} ({} on {}): {} macro steps, {} transitions, {} changes of flags entered\n",
            it.processor,
            it.missions.join(", then "),
            it.board,
            it.macro_steps,
            it.transitions,
            it.changes
        )
    };
    report.processors.iter().map(of).collect()
}
