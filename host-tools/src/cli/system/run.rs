//! `esm system run`: all processors of a robot at once.

use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::anyhow;
use clap::Args;
use serde::Serialize;

use super::loaded::Loaded;
use crate::boards;
use crate::cli::argument::Time;
use crate::cli::console::{self, Console};
use crate::cli::exit::CommandError;
use crate::cli::mission::Audience;
use crate::cli::{file, stage};
use crate::host_board::{self, RobotMaker};
use crate::host_run::{Ended, RunMission};
use crate::medium::PS_IN_US;
use crate::medium::clock::Clock;
use crate::plant::{BodyParameters, Plant};
use crate::qemu::firmware;
use crate::run::drive::DEFAULT_SEED;
use crate::run::interrupt::Interrupt;
use crate::system::declaration::System;
use crate::system::lock_step::Member;
use crate::system::merged_trace::{self, ProcessorTrace};
use crate::system::wiring::Sent;
use crate::system_run::{self, Plan, SystemError};

/// Runs all processors of a robot at once, around one simulated body
///
/// Each processor is a host board or one in the emulator, with a clock of its own. Whose slot comes
/// first by plant time goes first, so that two runs are equal to the byte. The trace of all has the
/// lines of each processor's own trace in the order of plant time, with `processor` and `plant_us`
/// before the rest.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm system run robot.system --until '60 s'
  esm system run robot.system --world corridor --trace robot.jsonl --json
  esm system run robot.system --trace - --until '5 s' | jq 'select(.processor == \"head\")'")]
pub struct RunArgs {
    /// The system file
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// Plant time after which the run ends
    #[arg(long, value_name = "TIME", default_value = "60 s")]
    pub until: Time,

    /// The world to drive in, instead of that of the file: a file, or the name of one that ships
    #[arg(long, value_name = "WORLD")]
    pub world: Option<PathBuf>,

    /// Where the trace goes, as JSON Lines; `-` for standard output
    #[arg(long, value_name = "OUT")]
    pub trace: Option<PathBuf>,

    /// Seed of the noise in sensors, wheels and links; a run with the same seed is the same run
    #[arg(long, value_name = "N", default_value_t = DEFAULT_SEED)]
    pub seed: u64,

    /// Presses the button of the robot's emergency stop at that plant time, for all processors. It
    /// locks: it stays pressed to the end of the run
    #[arg(long, value_name = "TIME")]
    pub estop: Option<Time>,

    /// One JSON object with the figures of the run, for programs
    #[arg(long)]
    pub json: bool,
}

/// A run in figures.
#[derive(Serialize)]
struct Summary {
    world: String,
    plant_time_s: f64,
    distance_m: f64,
    collisions: u32,
    rooms_entered: Vec<String>,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    interrupted: bool,
    processors: Vec<ProcessorSummary>,
    lines: Vec<LineSummary>,
}

/// What one end of a line has sent.
#[derive(Serialize)]
struct LineSummary {
    from: String,
    to: String,
    frames: u64,
    /// By how much the first bit of any of them was later than its start, at most.
    latest_us: f64,
}

/// A processor's part of it.
#[derive(Serialize)]
struct ProcessorSummary {
    processor: String,
    mission: String,
    board: String,
    macro_steps: u64,
    transitions: u64,
    fault: Option<String>,
    finished_s: Option<f64>,
}

/// Runs the command. `robot` is what each board has.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(
    args: &RunArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    let trace_to_standard_output = args.trace.as_deref() == Some(Path::new("-"));
    if trace_to_standard_output && args.json {
        return Err(CommandError::Usage(anyhow!(
            "both the trace and the summary would go to standard output: name a file for the trace, or leave out `--json`"
        )));
    }
    let interrupt = Interrupt::take_over()?;
    let mut loaded = Loaded::load(&args.file)?;
    let audience = match args.json && loaded.counts().0 > 0 {
        true => Audience::Program,
        false => Audience::Person,
    };
    loaded.tell(audience, console)?;
    if loaded.counts().0 > 0 {
        return Err(CommandError::Told);
    }
    let Some(system) = loaded.system.take() else {
        return Err(CommandError::Told);
    };
    keep_files(args, &loaded)?;
    let world = match (&args.world, loaded.world.take()) {
        (None, Some(world)) => world,
        (asked, _) => stage::world(asked.as_deref(), Some(&args.file))?,
    };
    let world_name = world.name.clone();
    let plant = Plant::new(world, BodyParameters::default(), args.seed)
        .map_err(|error| CommandError::Input(error.into()))?;
    let processors = processors(&system, &mut loaded, console)?;
    let clocks: Vec<Clock> = processors.iter().map(|it| it.member.clock).collect();
    let plan = Plan {
        robot,
        processors,
        links: system.links.clone(),
        plant,
        seed: args.seed,
        until_us: args.until.us,
        stop_at_us: args.estop.map(|at| at.us),
    };
    let trace = match &args.trace {
        Some(path) if !trace_to_standard_output => Some(file::create(path, "trace")?),
        _ => None,
    };
    let names: Vec<&str> = (system.processors.iter())
        .map(|it| it.name.text.as_str())
        .collect();
    let is_quiet = args.json || trace_to_standard_output;
    let mut failed = None;
    let mut end_us = args.until.us;
    let mut hear = |index: usize, plant_us: u64, given: crate::host_run::Given| {
        let name = names.get(index).copied().unwrap_or_default();
        let words = given.words.into_iter().map(|(_, said)| said);
        let log = (given.log.into_iter()).map(|(_, line)| format!("       log | {line}"));
        for said in words.chain(log).filter(|_| !is_quiet) {
            if let Err(error) = console.text(&format!("{name:>8} {said}\n")) {
                failed = Some(error);
            }
        }
        let goes_on = failed.is_none() && !interrupt.is_requested();
        if !goes_on {
            end_us = plant_us;
        }
        goes_on
    };
    let outcome = system_run::run(plan, &mut hear).map_err(|error| match error {
        SystemError::Thread(_) | SystemError::Emulated { .. } => CommandError::World(error.into()),
        _ => CommandError::Input(error.into()),
    })?;
    if let Some(error) = failed {
        return Err(error);
    }
    let traces: Vec<ProcessorTrace<'_>> = (outcome.processors.iter().zip(&clocks).zip(&names))
        .filter_map(|((ended, clock), name)| trace_of(ended.as_ref()?, *clock, name))
        .collect();
    let unwritten = |error: merged_trace::MergeError| CommandError::World(error.into());
    if let Some(mut out) = trace {
        merged_trace::write(&traces, &mut out).map_err(unwritten)?;
        out.flush()?;
    } else if trace_to_standard_output {
        let mut out = console::json_output();
        merged_trace::write(&traces, &mut out).map_err(unwritten)?;
        out.flush()?;
    }
    let summary = Summary {
        world: world_name,
        plant_time_s: end_us as f64 / 1e6,
        distance_m: outcome.plant.distance_m(),
        collisions: outcome.plant.collisions(),
        rooms_entered: outcome.plant.statistics().rooms_entered().to_vec(),
        interrupted: end_us < args.until.us,
        processors: summaries(&system, &outcome.processors),
        lines: lines(&system, &outcome.traffic),
    };
    if args.json {
        console.json_line(&summary)?;
    } else if trace_to_standard_output {
        console.note(words(&summary).trim_end());
    } else {
        console.text(&format!("\n{}", words(&summary)))?;
    }
    let faults: Vec<String> = (summary.processors.iter())
        .filter_map(|it| Some(format!("{}: {}", it.processor, it.fault.as_ref()?)))
        .collect();
    match faults[..] {
        [] => Ok(()),
        _ => Err(CommandError::Input(anyhow!(
            "a mission ended early: {}",
            faults.join("; ")
        ))),
    }
}

/// Refuses an output in the place of what the run is made of.
fn keep_files(args: &RunArgs, loaded: &Loaded) -> Result<(), CommandError> {
    let Some(trace) = args.trace.as_deref().filter(|path| *path != Path::new("-")) else {
        return Ok(());
    };
    let missions = loaded.missions.iter().flatten().map(|it| it.path.as_path());
    let inputs = missions
        .chain([args.file.as_path()])
        .chain(args.world.as_deref());
    file::keep_sources(trace, inputs)?;
    file::has_folder(trace, "trace")
}

/// The processors, each with what it has of the body.
fn processors(
    system: &System,
    loaded: &mut Loaded,
    console: &mut Console,
) -> Result<Vec<system_run::Processor>, CommandError> {
    let mut processors = Vec::new();
    for (processor, mission) in system.processors.iter().zip(&mut loaded.missions) {
        let name = &processor.name.text;
        // One without a blob has errors, which were told.
        let blob = mission
            .as_mut()
            .and_then(|it| Some((it.blob.take()?, &it.path)));
        let (blob, path) = blob.ok_or(CommandError::Told)?;
        let emulated = match &processor.board {
            Some(board) if board.text != host_board::BOARD => {
                Some(emulated(name, &board.text, path, console)?)
            }
            _ => None,
        };
        let title = path
            .file_stem()
            .map_or_else(|| name.into(), |stem| stem.to_string_lossy());
        let mission = RunMission::new(&title, blob).map_err(|it| CommandError::Input(it.into()))?;
        let clock = Clock::new(processor.start_us * PS_IN_US, processor.drift_ppb);
        processors.push(system_run::Processor {
            member: Member { mission, clock },
            pins: processor.pins.clone(),
            emulated,
        });
    }
    Ok(processors)
}

/// The emulated board of a processor.
fn emulated(
    name: &str,
    board: &str,
    mission: &Path,
    console: &mut Console,
) -> Result<system_run::Emulated, CommandError> {
    let board = boards::find(board).map_err(|it| CommandError::Input(it.into()))?;
    let Some(links) = board.links else {
        return Err(CommandError::Input(anyhow!(
            "`{name}` is a {}, which has no firmware with links: write `board host`, or another of {}",
            board.name,
            boards::linked()
        )));
    };
    let here = std::env::current_dir()?;
    let firmware = firmware::find_with(board, Some(links), None, &here, |said| console.note(said))?;
    Ok(system_run::Emulated {
        board,
        firmware,
        mission: mission.to_owned(),
    })
}

fn trace_of<'t>(ended: &'t Ended, clock: Clock, name: &'t str) -> Option<ProcessorTrace<'t>> {
    Some(ProcessorTrace {
        name,
        clock,
        start_us: ended.told.missions.first()?.start_us,
        lines: std::str::from_utf8(&ended.told.out).ok()?,
    })
}

fn summaries(system: &System, ended: &[Option<Ended>]) -> Vec<ProcessorSummary> {
    let mut summaries = Vec::new();
    for (processor, ended) in system.processors.iter().zip(ended) {
        let told = ended.as_ref().map(|it| &it.told);
        let board = processor.board.as_ref().map(|it| it.text.clone());
        summaries.push(ProcessorSummary {
            processor: processor.name.text.clone(),
            mission: processor.mission.text.clone(),
            board: board.unwrap_or_else(|| host_board::BOARD.to_owned()),
            macro_steps: told.map_or(0, |it| it.counts.macro_steps),
            transitions: told.map_or(0, |it| it.counts.transitions),
            fault: told.and_then(|it| it.fault.clone()),
            finished_s: told.and_then(|it| Some(it.finished_us? as f64 / 1e6)),
        });
    }
    summaries
}

fn lines(system: &System, traffic: &[Option<[Sent; 2]>]) -> Vec<LineSummary> {
    let mut lines = Vec::new();
    for (link, sent) in system.links.iter().zip(traffic) {
        let names = link.ends.each_ref().map(|end| {
            let processor = system.processors.get(end.processor);
            let processor = processor.map_or("", |it| it.name.text.as_str());
            format!("{processor}.{}", end.link)
        });
        let [first, second] = names;
        let Some([there, back]) = sent else {
            continue;
        };
        for (from, to, sent) in [(&first, &second, there), (&second, &first, back)] {
            lines.push(LineSummary {
                from: from.clone(),
                to: to.clone(),
                frames: sent.count,
                latest_us: sent.latest_ps as f64 / PS_IN_US as f64,
            });
        }
    }
    lines
}

fn words(summary: &Summary) -> String {
    let mut text = String::new();
    let rooms = match &summary.rooms_entered[..] {
        [] => "none".to_owned(),
        rooms => rooms.join(", "),
    };
    // Writing to a string does not fail.
    let _ = writeln!(
        text,
        "world {}, {:.1} s{}: {:.2} m, {} collisions, rooms {rooms}",
        summary.world,
        summary.plant_time_s,
        if summary.interrupted {
            " (interrupted)"
        } else {
            ""
        },
        summary.distance_m,
        summary.collisions,
    );
    for it in &summary.processors {
        let end = match (&it.fault, it.finished_s) {
            (Some(fault), _) => format!(", ended early: {fault}"),
            (None, Some(finished_s)) => format!(", finished at {finished_s:.3} s"),
            (None, None) => String::new(),
        };
        let _ = writeln!(
            text,
            "  {} ({} on {}): {} macro steps, {} transitions{end}",
            it.processor, it.mission, it.board, it.macro_steps, it.transitions
        );
    }
    text
}
