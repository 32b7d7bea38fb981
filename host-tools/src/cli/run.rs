//! `esm run`: a mission on a board, with a simulated robot body around it.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, anyhow};
use clap::{Args, ValueEnum};
use rt_firmware::body::SONARS;
use thiserror::Error;

use super::argument::{Time, TimeError};
use super::by_hand::{self, ByHandArgs};
use super::console::{self, Console, Progress};
use super::exit::CommandError;
use super::kept_values::KeptValues;
use super::{file, robot, sensors, stage};
use crate::host_board::{HostBoardError, RobotMaker};
use crate::keys;
use crate::link_client::ClientError;
use crate::lockstep::plant_side::{PlantFault, SonarBreak, StuckWheel};
use crate::pictures::{Leg, MissionStates, PathPicture, PathSample, Timeline};
use crate::recording::file::MAX_FILE_BYTES;
use crate::recording::player::Recording;
use crate::run::board::{BoardError, LinkWay};
use crate::run::drive::{DEFAULT_SEED, Heard, Plan, Planned, Run, RunError, drive};
use crate::run::entered::Entered;
use crate::run::interrupt::Interrupt;
use crate::run::summary::MissionSummary;
use crate::schedule::handover::Handover;
use crate::serial::noise::Noise;

/// Drives a mission: compiles it, starts a board, uploads, and shows what the robot does
///
/// The firmware, its task code and its timers are real; the robot's body (motors, encoders, sonars,
/// battery) and the world around it are simulated. The default board runs in an emulator, the board
/// `host` runs the same code as a part of this process and is much faster. Ctrl-C ends the run and
/// leaves nothing behind. Without --until a run goes on when its mission has finished.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm run missions/patrol.esm --until '60 s'
  esm run missions/patrol.esm --board host --world corridor --until '120 s' --trace patrol.jsonl
  esm run missions/patrol.esm --until '120 s' --then '60 s missions/follow_wall.esm' --out pictures/
  esm run missions/patrol.esm --until '20 s' --then '5 s missions/follow_wall.esm' --line-noise 0.01 --seed 7
  esm run missions/on_a_lead.esm --cut-link '5 s' --until '10 s'
  esm run missions/patrol.esm --estop '5 s' --until '10 s'
  esm run missions/patrol.esm --break 'sonar 0 dead at 10 s' --until '20 s'
  esm run missions/guard.esm --board host --world visitors --seed 17 --vary --until '60 s' --json
  esm run missions/wall_rules.esm --board host --sensors missions/wall_rules/ranges.csv --trace decisions.jsonl
  esm run missions/patrol.esm --record patrol.rec --until '60 s'
  esm run missions/patrol.esm --board host --replay patrol.rec --until '60 s'")]
pub struct RunArgs {
    /// The mission
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// The board to run on
    #[arg(long, value_name = "BOARD", default_value = crate::boards::DEFAULT)]
    pub board: String,

    /// The world to drive in: a file, or the name of one that ships, `office`, `corridor`, `track`,
    /// `empty`, `visitors`, `office_floor`, `shut_doors` or `cluttered` [default: office]
    #[arg(long, value_name = "WORLD")]
    pub world: Option<PathBuf>,

    /// Feeds the sonars with recorded ranges instead of those of a world: a column a sonar of the
    /// mission, a row a period, in metres, nothing where a sonar did not answer. The run ends after
    /// the last row
    #[arg(long, value_name = "CSV", conflicts_with = "world")]
    pub sensors: Option<PathBuf>,

    /// Robot time after which the run ends, such as '60 s'; without it, Ctrl-C does
    #[arg(long, value_name = "TIME")]
    pub until: Option<Time>,

    /// Where the trace goes, as JSON Lines; `-` for standard output
    #[arg(long, value_name = "OUT")]
    pub trace: Option<PathBuf>,

    /// Keeps what enters the interpreter as it comes, to be run again with `esm replay`, or
    /// with --replay
    #[arg(long, value_name = "REC")]
    pub record: Option<PathBuf>,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub values: KeptValues,

    /// Takes what the clock cannot repeat from a recording (the board `host`)
    #[arg(long, value_name = "REC", conflicts_with = "record")]
    pub replay: Option<PathBuf>,

    /// Uploads another mission at that robot time, while the robot moves; may be given several
    /// times
    #[arg(long, value_name = "'TIME FILE'")]
    pub then: Vec<Then>,

    /// What one mission has in common with the next goes on as it is, as with `esm upload --warm`
    #[arg(long, requires = "then")]
    pub warm: bool,

    /// Does not start where a slot that one mission shares with the next cannot go on as it runs
    #[arg(long, requires = "then")]
    pub no_gap: bool,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub by_hand: ByHandArgs,

    /// Directory for the pictures: the path over the map and the states over time, as SVG and PNG
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// Seed of the noise in sensors and wheels; a run with the same seed is the same run
    #[arg(long, value_name = "N", default_value_t = DEFAULT_SEED)]
    pub seed: u64,

    /// Varies what is around the robot with the seed, as `esm bench missions` does: people step in
    /// and away up to 2 s earlier or later, and in one seed of ten a sonar dies
    #[arg(long)]
    pub vary: bool,

    /// Lets the plant fall silent at that robot time, to see how the robot takes it
    #[arg(long, value_name = "TIME", hide = true)]
    pub freeze_plant_at: Option<Time>,

    /// Lets the robot hear nothing more from that robot time on, to see its link monitor at work
    #[arg(long, value_name = "TIME")]
    pub cut_link: Option<Time>,

    /// Presses the button of the robot's emergency stop at that robot time. It locks: it stays
    /// pressed to the end of the run
    #[arg(long, value_name = "TIME", conflicts_with = "freeze_plant_at")]
    pub estop: Option<Time>,

    /// Breaks a sonar at that robot time: `dead` (it does not answer), `deaf` (it hears nothing),
    /// `blind` (it sees something at its nose, always) or `noisy` (one ping in ten measures
    /// anything). Sonar 0 looks ahead, the others follow to the left, 45° each. Or lets something
    /// hold a wheel: 'wheel left at 3 s'. May be given several times
    #[arg(long = "break", value_name = "'sonar N FAULT at TIME'")]
    pub breaks: Vec<Break>,

    /// No faster than the wall clock, for a person watching
    #[arg(long)]
    pub realtime: bool,

    /// Prints the summary as one JSON object, for programs; what happens goes to standard error
    #[arg(long)]
    pub json: bool,

    /// How the bytes of the link come to the board [default: exchange; with --realtime
    /// and --replay, uart]
    #[arg(long, value_name = "WAY")]
    pub link: Option<LinkChoice>,

    /// Spoils so much of all bytes on their way to the robot, 0 to 1: corrupts, drops and doubles
    /// some, the same ones with the same --seed
    #[arg(long, value_name = "PART", value_parser = robot::noise)]
    pub line_noise: Option<Noise>,

    /// Keeps the robot's flash, with the missions in it, in this file from run to run; without it,
    /// the flash is blank at first and gone at the end
    #[arg(long, value_name = "FILE")]
    pub flash: Option<PathBuf>,

    /// The key that the robot has, if its flash holds one [default: esm/key in the folder for
    /// configuration, ~/.config]
    #[arg(long, value_name = "FILE", env = "ESM_KEY")]
    pub key: Option<PathBuf>,

    /// The firmware to start on an emulated board, instead of the one that the checkout builds
    #[arg(long, value_name = "ELF", env = "ESM_FIRMWARE")]
    pub firmware: Option<PathBuf>,
}

/// How the bytes of the link come to the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LinkChoice {
    /// Inside the plant exchange, at 115,200 baud of robot time: the run repeats to the byte,
    /// uploads included
    Exchange,
    /// Over the board's emulated UART (the board `host`: a pipe), by the clock on the wall
    Uart,
    /// Over the emulated board's USB, where it has one; otherwise as `exchange`
    Usb,
}

impl From<LinkChoice> for LinkWay {
    fn from(choice: LinkChoice) -> Self {
        match choice {
            LinkChoice::Exchange => LinkWay::Exchange,
            LinkChoice::Uart => LinkWay::Uart,
            LinkChoice::Usb => LinkWay::Usb,
        }
    }
}

/// A mission that takes over during a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Then {
    /// Robot time from the start of the run.
    pub at: Time,
    /// The mission.
    pub file: PathBuf,
}

/// Why a text is no [`Then`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ThenError {
    /// It does not start with a time.
    #[error("{0}; write a time and a mission, as in '60 s missions/follow_wall.esm'")]
    Time(#[from] TimeError),
    /// Nothing behind the time.
    #[error(
        "the mission is missing: write a time and a mission, as in '60 s missions/follow_wall.esm'"
    )]
    NoFile,
}

impl FromStr for Then {
    type Err = ThenError;

    fn from_str(text: &str) -> Result<Self, ThenError> {
        let text = text.trim();
        let unit_start = text
            .find(|c: char| !c.is_ascii_digit() && !c.is_whitespace())
            .ok_or(if text.is_empty() {
                TimeError::NoNumber
            } else {
                TimeError::NoUnit
            })?;
        let unit_end = text[unit_start..]
            .find(char::is_whitespace)
            .map_or(text.len(), |length| unit_start + length);
        let at = text[..unit_end].parse()?;
        let file = text[unit_end..].trim();
        if file.is_empty() {
            Err(ThenError::NoFile)
        } else {
            Ok(Then {
                at,
                file: file.into(),
            })
        }
    }
}

/// What breaks during a run, as a person writes it: `sonar 0 dead at 20 s`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Break {
    /// A sonar.
    Sonar(SonarBreak),
    /// A wheel that something holds: `wheel left at 20 s`.
    Wheel(StuckWheel),
}

/// Why a text is no [`Break`].
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum BreakError {
    /// Other words, or in another order.
    #[error(
        "write which sonar breaks how and when, as in 'sonar 0 dead at 20 s', or which wheel, as in 'wheel left at 20 s'"
    )]
    Form,
    /// There is no such wheel.
    #[error("there is no wheel `{word}`: write `left` or `right`")]
    Wheel {
        /// What stands for the side.
        word: String,
    },
    /// No sonar has that number.
    #[error("there is no sonar `{word}`: write a number from 0 to {}", SONARS - 1)]
    Sonar {
        /// What stands for the number.
        word: String,
    },
    /// No sonar breaks like that.
    #[error("a sonar cannot be `{word}`: write `dead`, `deaf`, `blind` or `noisy`")]
    Fault {
        /// What stands for the fault.
        word: String,
    },
    /// What stands for the time is none.
    #[error(transparent)]
    Time(#[from] TimeError),
}

impl FromStr for Break {
    type Err = BreakError;

    fn from_str(text: &str) -> Result<Self, BreakError> {
        let (what, time) = text.split_once(" at ").ok_or(BreakError::Form)?;
        let words: Vec<&str> = what.split_whitespace().collect();
        if let ["wheel", side] = words[..] {
            let side = side.parse().map_err(|()| BreakError::Wheel {
                word: side.to_owned(),
            })?;
            let at: Time = time.parse()?;
            let robot_us = at.us;
            return Ok(Break::Wheel(StuckWheel { side, robot_us }));
        }
        let ["sonar", sonar_word, fault_word] = words[..] else {
            return Err(BreakError::Form);
        };
        let sonar = (sonar_word.parse().ok().filter(|sonar| *sonar < SONARS)).ok_or_else(|| {
            BreakError::Sonar {
                word: sonar_word.to_owned(),
            }
        })?;
        let fault = (fault_word.parse()).map_err(|()| BreakError::Fault {
            word: fault_word.to_owned(),
        })?;
        let at: Time = time.parse()?;
        Ok(Break::Sonar(SonarBreak {
            sonar,
            fault,
            robot_us: at.us,
        }))
    }
}

/// Runs the command. `robot` is what the board `host` has.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(
    args: &RunArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    keep_files(args)?;
    let interrupt = Interrupt::take_over()?;
    let mut plan = plan(args, robot, console)?;
    plan.check()?;
    let trace_to_standard_output = args.trace.as_deref() == Some(Path::new("-"));
    if trace_to_standard_output && args.json {
        return Err(CommandError::Usage(anyhow!(
            "both the trace and the summary would go to standard output: name a file for the trace, or leave out `--json`"
        )));
    }
    let trace = make_files(args, &mut plan)?;
    let mut teller = Teller {
        console,
        // JSON on standard output is for a program, which wants nothing else there.
        aside: trace_to_standard_output || args.json,
        upload: None,
        failed: None,
    };
    let run = drive(plan, trace, interrupt, &mut |heard| teller.hear(&heard))?;
    if let Some(error) = teller.failed {
        return Err(error);
    }
    let summary = run.summary.to_string();
    if args.json {
        console.json_line(&run.summary)?;
    } else if trace_to_standard_output {
        console.note(summary.trim_end());
    } else {
        write!(console.out(), "\n{summary}")?;
    }
    if run.summary.wall_time_s.is_none() {
        console.note(&format!("{:.1} s on the wall", run.wall.as_secs_f64()));
    }
    keep(args, &run, console)?;
    match &run.summary.fault {
        Some(fault) => Err(CommandError::Input(anyhow!("the run ended early: {fault}"))),
        None => Ok(()),
    }
}

/// Refuses outputs in the place of what the run is made of, or of each other.
fn keep_files(args: &RunArgs) -> Result<(), CommandError> {
    let key = keys::path(args.key.as_deref()).ok();
    let mut inputs = vec![args.file.as_path()];
    inputs.extend(args.then.iter().map(|then| then.file.as_path()));
    let named = [
        &args.replay,
        &args.world,
        &args.sensors,
        &args.by_hand.script,
        &args.flash,
        &key,
        &args.firmware,
    ];
    inputs.extend(named.into_iter().flatten().map(PathBuf::as_path));
    let in_folder = |folder: &PathBuf| IN_FOLDER.map(|name| folder.join(name));
    let pictures = args.out.as_ref().map(in_folder);
    let mut outputs: Vec<&Path> = named_trace(args)
        .into_iter()
        .chain(args.record.as_deref())
        .collect();
    outputs.extend(pictures.iter().flatten().map(PathBuf::as_path));
    for output in &outputs {
        file::keep_sources(output, inputs.iter().copied())?;
    }
    // A flash that is not there yet is made.
    outputs.extend(args.flash.as_deref());
    file::keep_apart(&outputs)
}

/// What `--out` leaves in its folder.
const IN_FOLDER: [&str; 6] = [
    TRACE,
    "path.svg",
    "path.png",
    "states.svg",
    "states.png",
    SUMMARY,
];
const TRACE: &str = "trace.jsonl";
const SUMMARY: &str = "summary.json";

/// Everything that the run is made of, read and compiled; its files are still to be
/// [made](make_files).
fn plan(args: &RunArgs, robot: RobotMaker, console: &mut Console) -> Result<Plan, CommandError> {
    let mut thens: Vec<&Then> = args.then.iter().collect();
    thens.sort_by_key(|then| then.at);
    let first = stage::mission(&args.file, console)?;
    let mut running = first.slots().clone();
    let mut missions = vec![Planned {
        at_us: 0,
        mission: first.mission,
        warm: false,
        handover: Handover::default(),
    }];
    for then in thens {
        let mut next = stage::mission(&then.file, console)?;
        let handover = next.follow(&running, args.no_gap, console)?;
        running = next.slots().clone();
        missions.push(Planned {
            at_us: then.at.us,
            mission: next.mission,
            warm: args.warm,
            handover,
        });
    }
    if args.record.is_some() {
        let mut planned = missions.iter();
        planned.try_for_each(|planned| stage::require_names(&planned.mission))?;
    }
    let nameless = missions.iter().find(|planned| !planned.mission.has_names);
    if let (Some(planned), true) = (nameless, args.warm) {
        console.note(&stage::nothing_goes_on(&planned.mission.file.display()));
    }
    let replay = args.replay.as_deref().map(read_entered).transpose()?;
    let seed = replay.as_ref().map_or(args.seed, |entered| entered.seed);
    let sensors = (args.sensors.as_deref())
        .map(|table| sensors::recorded(table, &missions, args.firmware.as_deref()))
        .transpose()?;
    let asked = match &sensors {
        Some(_) => Some(Path::new(sensors::WORLD)),
        None => args.world.as_deref(),
    };
    let world = stage::world(asked, Some(&args.file))?;
    let board = stage::board(&args.board, args.firmware.as_deref(), robot, console)?;
    let plan = Plan {
        flash: None,
        key: Some(robot::key_at(args.key.as_deref())),
        body: stage::body(args.firmware.as_deref())?,
        world,
        board,
        seed,
        until_us: args.until.map(|until| until.us),
        realtime: args.realtime,
        link: link_way(args),
        noise: args.line_noise,
        missions,
        replay,
        cut_link_us: args.cut_link.map(|at| at.us),
        system: None,
        record: None,
        sample_period: args.values.period(),
        plant_fault: match (args.freeze_plant_at, args.estop) {
            (Some(at), _) => Some(PlantFault::FrozenFrom { robot_us: at.us }),
            (None, Some(at)) => Some(PlantFault::StopPressedFrom { robot_us: at.us }),
            (None, None) => None,
        },
        sensors,
        by_hand: by_hand::planned(&args.by_hand, &args.file, console)?,
        sonar_breaks: (args.breaks.iter())
            .filter_map(|broken| match broken {
                Break::Sonar(broken) => Some(*broken),
                Break::Wheel(_) => None,
            })
            .collect(),
        stuck_wheels: (args.breaks.iter())
            .filter_map(|broken| match broken {
                Break::Sonar(_) => None,
                Break::Wheel(stuck) => Some(*stuck),
            })
            .collect(),
    };
    Ok(if args.vary { plan.varied() } else { plan })
}

/// How the link goes: so that the run repeats, unless the wall clock or a recording says when
/// things happen.
fn link_way(args: &RunArgs) -> LinkWay {
    match args.link {
        Some(choice) => choice.into(),
        None if args.realtime || args.replay.is_some() => LinkWay::Uart,
        None => LinkWay::Exchange,
    }
}

/// What entered a simulated run, from its recording.
fn read_entered(path: &Path) -> Result<Entered, CommandError> {
    let recording = read_recording(path)?;
    recording
        .check_end()
        .with_context(|| format!("cannot replay {}", path.display()))
        .map_err(CommandError::Input)?;
    recording.entered().ok_or_else(|| {
        CommandError::Input(anyhow!(
            "{} is no recording of a whole run of esm run: to have its macro steps again, use esm replay",
            path.display()
        ))
    })
}

/// A recording in a file.
///
/// # Errors
/// If it cannot be read, or is none.
pub fn read_recording(path: &Path) -> Result<Recording, CommandError> {
    let bytes = file::read(path, MAX_FILE_BYTES, "recording")?;
    Recording::read(&bytes)
        .with_context(|| format!("cannot replay {}", path.display()))
        .map_err(CommandError::Input)
}

/// Opens and makes the files of a run. None is made, and none emptied, where it can be seen before
/// that not all can be had.
fn make_files(args: &RunArgs, plan: &mut Plan) -> Result<Tee, CommandError> {
    let flash = args.flash.as_deref();
    let outputs = [
        (flash, "flash"),
        (args.record.as_deref(), "recording"),
        (named_trace(args), "trace"),
    ];
    for (path, what) in outputs {
        path.map_or(Ok(()), |path| file::has_folder(path, what))?;
    }
    // It may be another board's, or in use.
    let is_there = flash.is_some_and(Path::exists);
    if is_there {
        plan.flash = stage::flash(flash, &plan.board)?;
    }
    let trace = open_trace(args)?;
    if let Some(path) = &args.record {
        plan.record = Some(Box::new(file::create(path, "recording")?));
    }
    if !is_there {
        plan.flash = stage::flash(flash, &plan.board)?;
    }
    Ok(trace)
}

/// The file for the trace, if it goes to one.
fn named_trace(args: &RunArgs) -> Option<&Path> {
    (args.trace.as_deref()).filter(|path| *path != Path::new("-"))
}

/// Where the trace goes: a file, standard output, the pictures' directory, or several of them.
fn open_trace(args: &RunArgs) -> Result<Tee, CommandError> {
    let mut tee = Tee::default();
    if let Some(directory) = &args.out {
        fs::create_dir_all(directory)
            .with_context(|| format!("cannot make the directory {}", directory.display()))
            .map_err(CommandError::World)?;
        tee.0
            .push(Box::new(file::create(&directory.join(TRACE), "trace")?));
    }
    match (named_trace(args), &args.trace) {
        (Some(path), _) => tee.0.push(Box::new(file::create(path, "trace")?)),
        (None, Some(_)) => tee.0.push(Box::new(console::json_output())),
        (None, None) => {}
    }
    Ok(tee)
}

/// Writes the recording and the pictures, where they are asked for.
fn keep(args: &RunArgs, run: &Run<Tee>, console: &mut Console) -> Result<(), CommandError> {
    if let (Some(path), Some(counts)) = (&args.record, &run.recorded) {
        console.note(&format!(
            "recorded in {}: {counts}, {:.1} bytes a transition",
            path.display(),
            counts.record_bytes as f64 / run.summary.transitions.max(1) as f64
        ));
    }
    let Some(directory) = &args.out else {
        return Ok(());
    };
    let scenes = [
        ("path", path_picture(run).scene()),
        ("states", timeline(run).scene()),
    ];
    for (name, scene) in scenes {
        let svg = directory.join(name).with_extension("svg");
        file::write_whole(&svg, scene.to_svg().as_bytes(), "picture")?;
        let png = scene
            .to_png()
            .map_err(|error| CommandError::World(error.into()))?;
        file::write_whole(&directory.join(name).with_extension("png"), &png, "picture")?;
    }
    let mut summary = serde_json::to_vec_pretty(&run.summary).map_err(io::Error::from)?;
    summary.push(b'\n');
    file::write_whole(&directory.join(SUMMARY), &summary, "summary")?;
    console.note(&format!(
        "pictures, trace and summary are in {}",
        directory.display()
    ));
    Ok(())
}

fn path_picture(run: &Run<Tee>) -> PathPicture {
    let samples = run.plant.statistics().path();
    let leg = |mission: &MissionStates| Leg {
        name: mission.name.clone(),
        samples: samples
            .iter()
            .filter(|sample| (mission.start_us..=mission.end_us).contains(&sample.t_us))
            .map(|sample| PathSample {
                t_us: sample.t_us,
                x_m: sample.pose.position.x_m as f32,
                y_m: sample.pose.position.y_m as f32,
            })
            .collect(),
    };
    let summary = &run.summary;
    PathPicture {
        facts: vec![format!(
            "{:.1} m in {:.0} s, {} collisions, {} rooms entered",
            summary.distance_m,
            summary.robot_time_s,
            summary.collisions,
            summary.rooms_entered.len()
        )],
        legs: run.told.missions.iter().map(leg).collect(),
        robot_radius_m: run.plant.body().radius_m as f32,
        ..PathPicture::over(run.plant.world())
    }
}

fn timeline(run: &Run<Tee>) -> Timeline {
    Timeline {
        title: format!("states on {}", run.summary.board),
        missions: run.told.missions.clone(),
        marks: run.told.marks.clone(),
    }
}

/// Writes the same to several places.
#[derive(Default)]
struct Tee(Vec<Box<dyn Write>>);

impl Write for Tee {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.write_all(bytes)?;
        Ok(bytes.len())
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.iter_mut().try_for_each(|out| out.write_all(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.iter_mut().try_for_each(Write::flush)
    }
}

/// Tells a person what happens, as it happens.
struct Teller<'c> {
    console: &'c mut Console,
    /// Whether words for the person go to standard error.
    aside: bool,
    upload: Option<Progress>,
    /// Why nothing can be told any more.
    failed: Option<CommandError>,
}

impl Teller<'_> {
    fn hear(&mut self, heard: &Heard<'_>) {
        match heard {
            Heard::Happened(line) => self.line(line),
            // Without the board's own time, which begins when the board is switched on and is not
            // the robot time of the lines around it.
            Heard::Log(line) => self.line(&format!("       log | {}", line.words())),
            Heard::UploadBegins(mission) => {
                let (name, bytes) = (&mission.name, mission.blob.len());
                self.upload = Some(
                    self.console
                        .progress(&format!("uploading {name}"), bytes as u64),
                );
            }
            Heard::Uploaded(bytes) => {
                if let Some(bar) = &self.upload {
                    bar.set_position(*bytes as u64);
                }
            }
            Heard::UploadEnds(mission) => {
                if let Some(bar) = self.upload.take() {
                    bar.finish_and_clear();
                }
                let MissionSummary {
                    file,
                    hash,
                    bytes,
                    upload_s,
                    ..
                } = mission;
                self.line(&format!(
                    "    upload | {file} ({hash}): {bytes} bytes in {upload_s:.2} s"
                ));
            }
            Heard::FinishedWithoutEnd => self.console.note(
                "the robot stands, and the run goes on: Ctrl-C ends it, or `--until TIME` when it is started",
            ),
            Heard::Warning(text) => self.console.note(&format!("warning: {text}")),
        }
    }

    fn line(&mut self, text: &str) {
        if self.aside {
            self.console.note(text);
        } else if let Err(error) = self.told(text) {
            // The run goes on: its files are wanted whether or not somebody listens.
            self.failed.get_or_insert(error.into());
        }
    }

    /// A line of what happens is seen when it happens, through a pipe too.
    fn told(&mut self, text: &str) -> io::Result<()> {
        writeln!(self.console.out(), "{text}")?;
        self.console.flush()
    }
}

impl From<RunError> for CommandError {
    fn from(error: RunError) -> Self {
        match error {
            RunError::Trace(error) | RunError::Recording(error) => error.into(),
            RunError::Board(error) => error.into(),
            RunError::Link {
                cause: ClientError::OtherKey { .. } | ClientError::NotBuiltIn { .. },
                ..
            } => CommandError::Input(error.into()),
            RunError::Plant(_) | RunError::Refused { .. } | RunError::OtherMissions { .. } => {
                CommandError::Input(error.into())
            }
            RunError::Link { .. }
            | RunError::Standstill { .. }
            | RunError::TraceGap { .. }
            | RunError::BadTrace => CommandError::World(error.into()),
        }
    }
}

impl From<BoardError> for CommandError {
    fn from(error: BoardError) -> Self {
        match error {
            BoardError::Host(HostBoardError::Registry(_)) => CommandError::Input(error.into()),
            BoardError::CannotReplay
            | BoardError::CannotReplayInStep
            | BoardError::NoUsb { .. } => CommandError::Usage(error.into()),
            BoardError::Emulator(_) | BoardError::Host(_) => CommandError::World(error.into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::{SonarFault, WheelSide};

    #[test]
    fn a_sonar_breaks_as_it_is_written() {
        let broken = |sonar, fault, robot_us| {
            Ok(Break::Sonar(SonarBreak {
                sonar,
                fault,
                robot_us,
            }))
        };
        let word = |word: &str| word.to_owned();
        for (text, expected) in [
            (
                "sonar 0 dead at 20 s",
                broken(0, SonarFault::Dead, 20_000_000),
            ),
            (
                " sonar 7  deaf at 1500ms",
                broken(7, SonarFault::Deaf, 1_500_000),
            ),
            ("sonar 3 blind at 0 s", broken(3, SonarFault::Blind, 0)),
            ("sonar 1 noisy at 0 s", broken(1, SonarFault::Noisy, 0)),
            (
                "sonar 8 dead at 1 s",
                Err(BreakError::Sonar { word: word("8") }),
            ),
            (
                "sonar -1 dead at 1 s",
                Err(BreakError::Sonar { word: word("-1") }),
            ),
            (
                "sonar 0 mute at 1 s",
                Err(BreakError::Fault { word: word("mute") }),
            ),
            (
                "sonar 0 dead at 1",
                Err(BreakError::Time(TimeError::NoUnit)),
            ),
            ("sonar 0 dead", Err(BreakError::Form)),
            (
                "wheel left at 3 s",
                Ok(Break::Wheel(StuckWheel {
                    side: WheelSide::Left,
                    robot_us: 3_000_000,
                })),
            ),
            ("wheel 0 at 1 s", Err(BreakError::Wheel { word: word("0") })),
            ("wheel 0 dead at 1 s", Err(BreakError::Form)),
            ("", Err(BreakError::Form)),
        ] {
            assert_eq!(text.parse(), expected, "{text:?}");
        }
    }

    #[test]
    fn a_change_of_mission_is_a_time_and_a_file() {
        let then = |us, file: &str| {
            Ok(Then {
                at: Time { us },
                file: file.into(),
            })
        };
        let cases = [
            ("60 s a.esm", then(60_000_000, "a.esm")),
            (
                "60s  missions/my robot.esm ",
                then(60_000_000, "missions/my robot.esm"),
            ),
            ("1500 ms ms", then(1_500_000, "ms")),
            ("60 s", Err(ThenError::NoFile)),
            ("60", Err(ThenError::Time(TimeError::NoUnit))),
            ("60 a.esm", Err(ThenError::Time(TimeError::UnknownUnit))),
            ("a.esm", Err(ThenError::Time(TimeError::NoNumber))),
            ("", Err(ThenError::Time(TimeError::NoNumber))),
        ];
        for (text, expected) in cases {
            assert_eq!(text.parse(), expected, "{text:?}");
        }
    }
}
