//! `esm system run`: all processors of a robot at once.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::anyhow;
use clap::Args;

use super::loaded::Loaded;
use super::summary::{Summary, lines, summaries, words};
use super::then::ThenOn;
use super::{partners, recordings};
use crate::boards;
use crate::cli::argument::Time;
use crate::cli::console::{self, Console};
use crate::cli::exit::CommandError;
use crate::cli::mission::Audience;
use crate::cli::{file, stage};
use crate::host_board::{self, RobotMaker};
use crate::host_run::{Ended, Planned, RunMission};
use crate::medium::PS_IN_US;
use crate::medium::clock::{Clock, Life};
use crate::plant::{BodyParameters, Plant};
use crate::qemu::firmware;
use crate::run::drive::DEFAULT_SEED;
use crate::run::interrupt::Interrupt;
use crate::system::declaration::System;
use crate::system::lock_step::Member;
use crate::system::merged_trace::{self, ProcessorTrace};
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
  esm system run robot.system --trace - --until '5 s' | jq 'select(.processor == \"head\")'
  esm system run robot.system --then '5 s head other_head.esm' --then '7 s base other_base.esm' --warm
  esm system run robot.system --record robot.recs --until '60 s'")]
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

    /// Uploads another mission to one of the processors at that plant time, while the robot moves;
    /// may be given several times
    #[arg(long, value_name = "'TIME PROCESSOR FILE'")]
    pub then: Vec<ThenOn>,

    /// What one mission has in common with the next goes on as it is, as with `esm upload --warm`
    #[arg(long, requires = "then")]
    pub warm: bool,

    /// Keeps what enters the interpreter of each processor, what receives frames included, in this
    /// folder, to be run again with `esm system replay`
    #[arg(long, value_name = "DIR")]
    pub record: Option<PathBuf>,

    /// One JSON object with the figures of the run, for programs
    #[arg(long)]
    pub json: bool,
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
    loaded.exchange(&args.then)?;
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
    keep_files(args, &system, &loaded)?;
    let world = match (&args.world, loaded.world.take()) {
        (None, Some(world)) => world,
        (asked, _) => stage::world(asked.as_deref(), Some(&args.file))?,
    };
    let world_name = world.name.clone();
    let plant = Plant::new(world, BodyParameters::default(), args.seed)
        .map_err(|error| CommandError::Input(error.into()))?;
    let processors = processors(&system, &mut loaded, args, console)?;
    let lives: Vec<(usize, Member)> = (processors.iter())
        .map(|it| (it.index, it.member.clone()))
        .collect();
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
    let name = |(index, _): &(usize, Member)| {
        let processor = system.processors.get(*index);
        processor.map_or("", |it| it.name.text.as_str())
    };
    let names: Vec<&str> = lives.iter().map(name).collect();
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
    let traces: Vec<ProcessorTrace<'_>> = (outcome.processors.iter().zip(&lives).zip(&names))
        .filter_map(|((ended, (_, member)), name)| {
            trace_of(ended.as_ref()?, member.life.clock, name)
        })
        .collect();
    if let Some(folder) = &args.record {
        recordings::write(folder, &system, &lives, &outcome.processors)?;
    }
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
        processors: summaries(&system, &lives, &outcome.processors),
        lines: lines(&system, &outcome.traffic),
        links: partners::summaries(&system, &lives, &outcome, end_us),
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
fn keep_files(args: &RunArgs, system: &System, loaded: &Loaded) -> Result<(), CommandError> {
    if let Some(folder) = &args.record {
        recordings::make_folder(folder, system)?;
    }
    let Some(trace) = args.trace.as_deref().filter(|path| *path != Path::new("-")) else {
        return Ok(());
    };
    let missions = loaded.all_missions().map(|it| it.path.as_path());
    let inputs = missions
        .chain([args.file.as_path()])
        .chain(args.world.as_deref());
    file::keep_sources(trace, inputs)?;
    file::has_folder(trace, "trace")
}

/// The processors, each with what it has of the body, and anew behind each reset within the run.
fn processors(
    system: &System,
    loaded: &mut Loaded,
    args: &RunArgs,
    console: &mut Console,
) -> Result<Vec<system_run::Processor>, CommandError> {
    let records = args.record.is_some();
    let until_ps = args.until.us.saturating_mul(PS_IN_US);
    let mut processors = Vec::new();
    for (index, (processor, mission)) in
        (system.processors.iter().zip(&mut loaded.missions)).enumerate()
    {
        let name = &processor.name.text;
        // One without a blob has errors, which were told.
        let blob = mission
            .as_mut()
            .and_then(|it| Some((it.blob.take()?, &it.path)));
        let (blob, path) = blob.ok_or(CommandError::Told)?;
        let emulated = match &processor.board {
            Some(board) if board.text != host_board::BOARD => {
                Some(emulated(name, &board.text, path, records, console)?)
            }
            _ => None,
        };
        let title = path
            .file_stem()
            .map_or_else(|| name.into(), |stem| stem.to_string_lossy());
        let mission = RunMission::new(&title, blob).map_err(|it| CommandError::Input(it.into()))?;
        let lives = processor.lives().into_iter();
        for life in lives.filter(|it| it.from_ps < until_ps.max(1)) {
            processors.push(system_run::Processor {
                index,
                member: Member {
                    mission: mission.clone(),
                    then: Vec::new(),
                    life,
                },
                pins: processor.pins.clone(),
                emulated: emulated.clone(),
            });
        }
    }
    // In the order of their times.
    for (at_us, index, mission) in &mut loaded.then {
        let blob = mission.blob.take().ok_or(CommandError::Told)?;
        let title = mission.path.file_stem().unwrap_or_default();
        let taken = RunMission::new(&title.to_string_lossy(), blob)
            .map_err(|it| CommandError::Input(it.into()))?;
        let at_ps = at_us.saturating_mul(PS_IN_US);
        for processor in processors.iter_mut().filter(|it| it.index == *index) {
            take_over(processor, at_ps, (&mission.path, &taken), args.warm)?;
        }
    }
    Ok(processors)
}

/// Lets a mission take over on a processor at a plant time. One that is reset after it begins anew
/// with that mission.
fn take_over(
    processor: &mut system_run::Processor,
    at_ps: u64,
    (path, mission): (&Path, &RunMission),
    warm: bool,
) -> Result<(), CommandError> {
    let member = &mut processor.member;
    let Life {
        clock,
        from_ps,
        to_ps,
    } = member.life;
    if at_ps >= to_ps {
        return Ok(());
    }
    let wires = |mission: &RunMission| -> Vec<(String, u32, u8)> {
        let links = mission.links.iter();
        links
            .map(|it| (it.name.clone(), it.rate_bps, it.bits))
            .collect()
    };
    // A link is known by its number, and a cable stays where it is.
    if wires(mission) != wires(&member.mission) {
        return Err(CommandError::Input(anyhow!(
            "{} has other links than `{}`, from which it takes over: declare the same ones in the same order, each with its rate and the bits of a byte; the frames may be others",
            path.display(),
            member.mission.name
        )));
    }
    let emulated = processor.emulated.as_mut();
    if at_ps <= from_ps && from_ps > 0 {
        // It was taken over before the reset, or is what comes next.
        member.mission = mission.clone();
        if let Some(emulated) = emulated {
            emulated.missions = vec![path.to_owned()];
        }
        return Ok(());
    }
    member.then.push(Planned {
        at_us: clock.local_us(at_ps),
        mission: mission.clone(),
        warm,
    });
    if let Some(emulated) = emulated {
        emulated.missions.push(path.to_owned());
    }
    Ok(())
}

/// The emulated board of a processor.
fn emulated(
    name: &str,
    board: &str,
    mission: &Path,
    records: bool,
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
        missions: vec![mission.to_owned()],
        records,
    })
}

fn trace_of<'t>(ended: &'t Ended, clock: Clock, name: &'t str) -> Option<ProcessorTrace<'t>> {
    Some(ProcessorTrace {
        name,
        clock,
        starts_us: ended.told.missions.iter().map(|it| it.start_us).collect(),
        lines: std::str::from_utf8(&ended.told.out).ok()?,
    })
}
