//! `esm replay`: a recorded run once more, from what entered its interpreter.

use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, BufWriter, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::anyhow;
use clap::Args;
use serde::Serialize;

use super::argument::Time;
use super::console::{self, Console};
use super::exit::{CommandError, ExitStatus};
use super::expected::{self, Expected};
use super::file::Draft;
use super::run::read_recording;
use super::step::{self, view::View};
use super::{file, terminal};
use crate::clean::Clean;
use crate::clean::counted;
use crate::recording::file::FileEnd;
use crate::recording::player::{Outcome, Recording, ReplayError, replay};
use crate::recording::walk::Walk;
use crate::run::interrupt::Interrupt;
use crate::run::mission::hash_text;

/// Runs what a recording holds once more, through the same interpreter, to the same trace
///
/// A recording has what entered the robot's interpreter: changes of flags, times, missions. Nothing
/// is simulated and no robot is needed: what the machine did follows from these. The trace is that
/// of the run, line by line.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm run missions/patrol.esm --record patrol.rec --trace patrol.jsonl --until '60 s'
  esm replay patrol.rec --trace again.jsonl
  esm replay patrol.rec --expect patrol.jsonl
  esm replay patrol.rec --step")]
pub struct ReplayArgs {
    /// The recording
    #[arg(value_name = "REC")]
    pub recording: PathBuf,

    /// Where the trace goes, as JSON Lines; `-` for standard output
    #[arg(long, value_name = "OUT")]
    pub trace: Option<PathBuf>,

    /// Compares the trace with this one, and says where they differ first
    #[arg(long, value_name = "TRACE")]
    pub expect: Option<PathBuf>,

    /// Goes on behind a gap, where the recording knows all of the machine again
    #[arg(long)]
    pub over_gaps: bool,

    /// Walks through the run, on the screen of a terminal: `n` next micro step with a transition,
    /// `b` back, `/` to a macro step, a time, a state or a flag, `q` ends. Otherwise by commands on
    /// standard input: `n`, `b`, `s STEP` to a macro step, `t TIME` to a robot time, such as
    /// `t 2 s`, `q`
    #[arg(long, conflicts_with_all = ["trace", "expect", "json"])]
    pub step: bool,

    /// With --step: by commands on standard input, on a terminal too
    #[arg(long, requires = "step")]
    pub plain: bool,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Report {
    board: String,
    firmware: String,
    seed: Option<u64>,
    /// `whole`, `cut` or `damaged`.
    file: &'static str,
    missions: Vec<MissionReport>,
    macro_steps: u64,
    transitions: u64,
    changes: u64,
    checks: u64,
    gaps: usize,
    record_bytes: u64,
    bytes_a_transition: Option<f64>,
    error: Option<String>,
}

/// A run of a mission.
#[derive(Debug, Serialize)]
struct MissionReport {
    name: Option<String>,
    hash: String,
    start_us: u64,
    macro_steps: u64,
    after_gap: bool,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &ReplayArgs, console: &mut Console) -> Result<(), CommandError> {
    if let Some(output) = &args.trace {
        let inputs = [Some(args.recording.as_path()), args.expect.as_deref()];
        file::keep_sources(output, inputs.into_iter().flatten())?;
    }
    let recording = read_recording(&args.recording)?;
    if args.step {
        let has_screen = std::io::stdin().is_terminal() && terminal::has_screen(console);
        return match has_screen && !args.plain {
            true => walk_on_screen(&recording, args, console),
            false => walk(&recording, args, console),
        };
    }
    let expected = args.expect.as_deref().map(Expected::open).transpose()?;
    let to_standard_output = args.trace.as_deref() == Some(Path::new("-"));
    // Only a file takes its name at the end. What goes to a device or a pipe may wait for it, and
    // leaves nothing behind.
    let is_file = |path: &Path| fs::metadata(path).map_or(true, |found| found.is_file());
    let interrupt = match &args.trace {
        Some(path) if !to_standard_output && is_file(path) => Some(Interrupt::take_over()?),
        _ => None,
    };
    let mut trace = Trace {
        interrupt,
        out: match &args.trace {
            Some(_) if to_standard_output => Some(BufWriter::new(console::json_output())),
            _ => None,
        },
        file: match &args.trace {
            Some(path) if !to_standard_output => Some(Draft::begin(path, "trace")?),
            _ => None,
        },
        expected,
    };
    if let (Some(interrupt), Some(file), Some(path)) = (trace.interrupt, &trace.file, &args.trace) {
        let (remove, told) = (file.remover(), interrupted(path));
        interrupt.insist(GRACE, ExitStatus::WorldFailed as u8, move || {
            remove();
            console::warn(&format!("error: {told}"));
        });
    }
    let is_wanted = args.trace.is_some() || args.expect.is_some();
    let ended = replay(&recording, args.over_gaps, is_wanted.then_some(&mut trace));
    if let (Some(path), true) = (&args.trace, trace.is_interrupted()) {
        return Err(CommandError::World(anyhow!("{}", interrupted(path))));
    }
    if let (Some(file), false) = (
        trace.file,
        matches!(&ended, Err((_, ReplayError::Trace(_)))),
    ) {
        file.finish()?;
    }
    let (outcome, error) = match ended {
        Ok(outcome) => (outcome, None),
        Err((_, ReplayError::Trace(error))) => return Err(unwritten(error)),
        Err((outcome, error)) => (outcome, Some(error)),
    };
    if args.json {
        console.json_line(&report(&recording, &outcome, error.as_ref()))?;
    } else if to_standard_output {
        console.note(told(&recording, &outcome).trim_end());
    } else {
        console.text(&told(&recording, &outcome))?;
    }
    note_end(&recording, &args.recording, error.as_ref(), console);
    if let Some(error) = error {
        return Err(CommandError::Input(error.into()));
    }
    let (Some(expected), Some(path)) = (trace.expected, &args.expect) else {
        return Ok(());
    };
    expected::judge(expected, path, console)
}

/// How long a replay that is interrupted may go on with the macro step that it is in.
const GRACE: Duration = Duration::from_millis(500);

fn interrupted(trace: &Path) -> String {
    format!("interrupted; {} is as it was", trace.display())
}

/// Where a trace goes as it comes.
struct Trace {
    /// Ends it.
    interrupt: Option<Interrupt>,
    out: Option<BufWriter<Clean<io::Stdout>>>,
    file: Option<Draft>,
    expected: Option<Expected<BufReader<File>>>,
}

impl Trace {
    fn is_interrupted(&self) -> bool {
        self.interrupt.is_some_and(Interrupt::is_requested)
    }
}

impl Write for Trace {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.is_interrupted() {
            return Err(io::Error::other("interrupted"));
        }
        if let Some(out) = &mut self.out {
            out.write_all(bytes)?;
        }
        if let Some(file) = &mut self.file {
            file.write_all(bytes)?;
        }
        if let Some(expected) = &mut self.expected {
            expected.take(bytes);
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.as_mut().map_or(Ok(()), Write::flush)
    }
}

/// A trace could not be written: nobody reads it any more, or the world is broken.
fn unwritten(error: io::Error) -> CommandError {
    match error.kind() {
        io::ErrorKind::BrokenPipe => CommandError::NobodyListens,
        _ => CommandError::World(ReplayError::Trace(error).into()),
    }
}

/// Walks through a recording on the screen.
fn walk_on_screen(
    recording: &Recording,
    args: &ReplayArgs,
    console: &mut Console,
) -> Result<(), CommandError> {
    let (walk, ended) = Walk::new(recording, args.over_gaps);
    let name = args.recording.file_name().unwrap_or_default();
    let name = name.to_string_lossy().into_owned();
    let why = ended.as_ref().map(ToString::to_string);
    step::show(View::new(recording, name, walk, why), console)?;
    note_end(recording, &args.recording, ended.as_ref(), console);
    ended.map_or(Ok(()), |error| Err(CommandError::Input(error.into())))
}

/// Walks through a recording as standard input says.
fn walk(
    recording: &Recording,
    args: &ReplayArgs,
    console: &mut Console,
) -> Result<(), CommandError> {
    let (mut walk, ended) = Walk::new(recording, args.over_gaps);
    note_end(recording, &args.recording, ended.as_ref(), console);
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let line = line.trim();
        let (command, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        let (moment, edge) = match command {
            "q" if rest.is_empty() => break,
            "n" if rest.is_empty() => (walk.forward(), "end"),
            "b" if rest.is_empty() => (walk.back(), "beginning"),
            "s" | "t" => {
                let place = match command {
                    "s" => rest.parse().map_err(|_| format!("no macro step: `{rest}`")),
                    _ => rest
                        .parse::<Time>()
                        .map(|time| time.us)
                        .map_err(|error| error.to_string()),
                };
                match place {
                    Ok(place) if command == "s" => (walk.to_step(place), "end"),
                    Ok(place) => (walk.to_time(place), "end"),
                    Err(error) => {
                        console.note(&error);
                        continue;
                    }
                }
            }
            _ => {
                console.note(
                    "commands: n next, b back, s STEP to a macro step, t TIME to a robot time, q ends",
                );
                continue;
            }
        };
        let text = match moment {
            Some(moment) => moment.to_string(),
            None => format!("the {edge} of what can be replayed\n"),
        };
        console.text(&text)?;
        console.flush()?;
    }
    match ended {
        Some(error) => Err(CommandError::Input(error.into())),
        None => Ok(()),
    }
}

/// Says where a file ends that does not end well, unless the error is that.
fn note_end(
    recording: &Recording,
    path: &Path,
    error: Option<&ReplayError>,
    console: &mut Console,
) {
    let path = path.display();
    match recording.end {
        FileEnd::Whole => {}
        FileEnd::Damaged { .. } if matches!(error, Some(ReplayError::Damaged { .. })) => {}
        FileEnd::Cut { at } => console.note(&format!(
            "note: the writing of {path} was broken off at byte {at}; all before it was replayed"
        )),
        FileEnd::Damaged { at } => console.note(&format!(
            "warning: {path} was changed since it was written: what comes from byte {at} on was not read"
        )),
    }
}

fn told(recording: &Recording, outcome: &Outcome) -> String {
    let mut text = format!(
        "recorded on {} ({})\n",
        recording.head.board, recording.head.firmware
    );
    for stretch in &recording.stretches {
        let name = recording
            .mission(stretch.mission)
            .map_or("a mission that is not in it", |mission| &mission.name);
        let steps = counted(stretch.made, "macro step");
        text += &format!(
            "  from {:.3} s: {name} ({}), {steps}{}\n",
            stretch.start_us as f64 / 1e6,
            hash_text(stretch.mission),
            if stretch.after_gap {
                ", after a gap"
            } else {
                ""
            }
        );
    }
    text += &format!(
        "replayed {}, {}, from {} bytes",
        counted(outcome.steps, "macro step"),
        counted(outcome.transitions, "transition"),
        recording.record_bytes
    );
    if let Some(bytes) = bytes_a_transition(recording, outcome) {
        text += &format!(": {bytes:.2} a transition");
    }
    text + "\n"
}

fn bytes_a_transition(recording: &Recording, outcome: &Outcome) -> Option<f64> {
    (outcome.transitions > 0).then(|| recording.record_bytes as f64 / outcome.transitions as f64)
}

fn report(recording: &Recording, outcome: &Outcome, error: Option<&ReplayError>) -> Report {
    let missions = recording.stretches.iter().map(|stretch| MissionReport {
        name: recording
            .mission(stretch.mission)
            .map(|mission| mission.name.clone()),
        hash: hash_text(stretch.mission),
        start_us: stretch.start_us,
        macro_steps: stretch.made,
        after_gap: stretch.after_gap,
    });
    Report {
        board: recording.head.board.clone(),
        firmware: recording.head.firmware.clone(),
        seed: recording.head.seed,
        file: match recording.end {
            FileEnd::Whole => "whole",
            FileEnd::Cut { .. } => "cut",
            FileEnd::Damaged { .. } => "damaged",
        },
        missions: missions.collect(),
        macro_steps: outcome.steps,
        transitions: outcome.transitions,
        changes: outcome.changes,
        checks: outcome.checks,
        gaps: (recording.stretches.iter())
            .filter(|stretch| stretch.after_gap)
            .count(),
        record_bytes: recording.record_bytes,
        bytes_a_transition: bytes_a_transition(recording, outcome)
            .map(|bytes| libm::round(bytes * 100.0) / 100.0),
        error: error.map(ToString::to_string),
    }
}
