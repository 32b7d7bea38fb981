//! `esm record`: a drive as an MCAP file, which Foxglove and Lichtblick open.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::anyhow;
use clap::Args;
use serde::Serialize;

use super::argument::Time;
use super::console::{self, Console};
use super::exit::{CommandError, ExitStatus};
use super::file::{self, Draft};
use super::recorder::Recorder;
use super::robot::{self, RobotArgs};
use super::run::read_recording;
use super::{kept_values, stage};
use crate::boards;
use crate::clean::counted;
use crate::files::MAX_BLOB_BYTES;
use crate::host_board::RobotMaker;
use crate::keys;
use crate::link_client::Streams;
use crate::recording::file::{FileEnd, MARK};
use crate::recording::mcap_file::{self, Channel, McapFileError};
use crate::recording::player::Recording;
use crate::recording::told::Told;
use crate::run::board::LinkWay;
use crate::run::drive::{DEFAULT_SEED, Heard, Plan, Planned, drive};
use crate::run::interrupt::Interrupt;

/// How long a wait for the robot's next words may last before Ctrl-C is looked for.
const LISTEN_TIME: Duration = Duration::from_millis(100);

/// How long Ctrl-C waits for a file that is nearly written.
const GRACE: Duration = Duration::from_millis(500);

/// Records a drive as an MCAP file: poses, twists, ranges and all other values, states, transitions
///
/// FILE is a recording that exists already, or a mission, which is driven in a simulated world.
/// Without FILE the robot at a port is recorded, until Ctrl-C. Foxglove and Lichtblick open the
/// file. Equal recordings give equal files: its times are robot times.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm record patrol.rec -o patrol.mcap
  esm record missions/patrol.esm --board host --until '60 s' -o patrol.mcap
  esm record missions/patrol.esm --world corridor --until '60 s' --record patrol.rec -o patrol.mcap
  esm record --port /dev/ttyUSB0 -o drive.mcap
  esm record --port /dev/ttyUSB0 --until '60 s' --sample '20 ms' -o drive.mcap")]
pub struct RecordArgs {
    /// A recording, or a mission to drive; without it, the robot at the port is recorded
    #[arg(value_name = "FILE")]
    pub file: Option<PathBuf>,

    /// Where the MCAP file goes
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,

    /// The board that a mission is driven on [default: lm3s6965]
    #[arg(long, value_name = "BOARD")]
    pub board: Option<String>,

    /// The world that a mission is driven in: a file, or the name of one that ships [default:
    /// office]
    #[arg(long, value_name = "WORLD")]
    pub world: Option<PathBuf>,

    /// Robot time after which a drive ends; of a robot at a port, time on the wall. Without it,
    /// Ctrl-C ends it
    #[arg(long, value_name = "TIME")]
    pub until: Option<Time>,

    /// Seed of the noise in sensors and wheels of a drive [default: 1]
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,

    /// The firmware to start on an emulated board, instead of the one that the checkout builds
    #[arg(long, value_name = "ELF", env = "ESM_FIRMWARE")]
    pub firmware: Option<PathBuf>,

    /// How often values are recorded: a sample each TIME of the mission's at most; with '0 s' after
    /// each macro step [default: 100 ms]
    #[arg(long, value_name = "TIME")]
    pub sample: Option<Time>,

    /// Keeps the recording of a drive, too, for `esm replay` and `esm plot`
    #[arg(long, value_name = "REC")]
    pub record: Option<PathBuf>,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report<'r> {
    board: &'r str,
    firmware: &'r str,
    seed: Option<u64>,
    /// Names of the missions, in the order in which they ran.
    missions: Vec<&'r str>,
    start_us: Option<u64>,
    end_us: Option<u64>,
    /// What is in the file.
    channels: Vec<Channel>,
    messages: u64,
    bytes: u64,
    /// Why it ends early, or `null`.
    error: Option<String>,
}

/// Runs the command. `robot` is what the board `host` has.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(
    args: &RecordArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    let key = keys::path(args.robot.key.as_deref()).ok();
    let inputs = [&args.file, &args.world, &args.firmware, &key];
    let mut outputs = vec![args.output.as_path()];
    outputs.extend(args.record.as_deref());
    for output in &outputs {
        let inputs = inputs.into_iter().flatten().map(PathBuf::as_path);
        file::keep_sources(output, inputs)?;
    }
    file::keep_apart(&outputs)?;
    for (path, what) in [
        (Some(args.output.as_path()), "MCAP file"),
        (args.record.as_deref(), "recording"),
    ] {
        path.map_or(Ok(()), |path| file::has_folder(path, what))?;
    }
    let Some(path) = &args.file else {
        let only_driven = [
            ("--board", args.board.is_some()),
            ("--world", args.world.is_some()),
            ("--seed", args.seed.is_some()),
        ];
        refuse(&only_driven, "a robot at a port is recorded as it is")?;
        return driven(args, console, |path, console| watch(args, path, console));
    };
    let of_port = [
        ("--port", args.robot.port.is_some()),
        ("--line-noise", args.robot.line.line_noise.is_some()),
    ];
    refuse(&of_port, "it is of a robot at a port, and FILE is given")?;
    let begins_with = file::read(path, MAX_BLOB_BYTES, "file")?;
    if !begins_with.starts_with(MARK) {
        return driven(args, console, |record, console| {
            run(args, path, record, robot, console)
        });
    }
    let of_drive = [
        ("--board", args.board.is_some()),
        ("--world", args.world.is_some()),
        ("--until", args.until.is_some()),
        ("--seed", args.seed.is_some()),
        ("--sample", args.sample.is_some()),
        ("--record", args.record.is_some()),
    ];
    refuse(&of_drive, "FILE is a recording, and nothing is driven")?;
    let recording = read_recording(path)?;
    let out = begin(args)?;
    let (remove, shown) = (out.remover(), args.output.display().to_string());
    Interrupt::take_over()?.insist(GRACE, ExitStatus::WorldFailed as u8, move || {
        remove();
        console::warn(&format!("error: interrupted; {shown} is as it was"));
    });
    write(&recording, path, out, args, console)
}

/// Refuses options that make no sense here.
fn refuse(options: &[(&str, bool)], why: &str) -> Result<(), CommandError> {
    match options.iter().find(|(_, is_given)| *is_given) {
        Some((option, _)) => Err(CommandError::Usage(anyhow!("leave out `{option}`: {why}"))),
        None => Ok(()),
    }
}

/// Records a drive, and writes what the recording tells also where the drive ended early.
fn driven(
    args: &RecordArgs,
    console: &mut Console,
    drive: impl FnOnce(&Path, &mut Console) -> Result<(), CommandError>,
) -> Result<(), CommandError> {
    let folder = tempfile::tempdir()?;
    let path = match &args.record {
        Some(path) => path.clone(),
        None => folder.path().join("drive.rec"),
    };
    let ended = drive(&path, console);
    if !path.is_file() {
        return ended;
    }
    let recording = match read_recording(&path) {
        Ok(recording) => recording,
        Err(error) => return ended.and(Err(error)),
    };
    if ended.is_err() && recording.stretches.is_empty() {
        return ended;
    }
    // Whoever has ended the drive wants to have what it was.
    let out = begin(args)?;
    ended.and(write(&recording, &path, out, args, console))
}

/// Drives a mission in a world.
fn run(
    args: &RecordArgs,
    mission: &Path,
    record: &Path,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    let interrupt = Interrupt::take_over()?;
    let staged = stage::mission(mission, console)?;
    stage::require_names(&staged.mission)?;
    let world = stage::world(args.world.as_deref(), Some(mission))?;
    let board = args.board.as_deref().unwrap_or(boards::DEFAULT);
    let board = stage::board(board, args.firmware.as_deref(), robot, console)?;
    let mut plan = Plan {
        link: LinkWay::Exchange,
        seed: args.seed.unwrap_or(DEFAULT_SEED),
        until_us: args.until.map(|until| until.us),
        body: stage::body(args.firmware.as_deref())?,
        key: Some(robot::key_at(args.robot.key.as_deref())),
        sample_period: Some(period(args)),
        ..Plan::new(board, world, vec![Planned::first(staged.mission)])
    };
    plan.check()?;
    plan.record = Some(Box::new(file::create(record, "recording")?));
    let run = drive(plan, io::sink(), interrupt, &mut |heard| {
        match heard {
        Heard::Warning(text) => console.note(&format!("warning: {text}")),
        Heard::FinishedWithoutEnd => console.note(
            "the robot stands, and the run goes on: Ctrl-C ends it, or `--until TIME` when it is started",
        ),
        _ => {}
    }
    })?;
    match run.summary.fault {
        Some(fault) => Err(CommandError::Input(anyhow!("the run ended early: {fault}"))),
        None => Ok(()),
    }
}

/// Records the robot at a port.
fn watch(args: &RecordArgs, record: &Path, console: &mut Console) -> Result<(), CommandError> {
    let interrupt = Interrupt::take_over()?;
    let (mut robot, info) = args.robot.connect(console)?;
    let mut recorder = Recorder::begin(record, &mut robot, &info, Streams::NONE, &[])?;
    recorder.keep_values(period(args));
    // There is no end but that.
    robot.limit_waits(None);
    robot.stop_when(Some(Box::new(move || interrupt.is_requested())));
    let clock = robot.clock().clone();
    let began = clock.now();
    let longest = args.until.map(|until| Duration::from_micros(until.us));
    let mut listen = || {
        while !interrupt.is_requested()
            && longest.is_none_or(|longest| clock.since(began) < longest)
        {
            robot.attend(LISTEN_TIME)?;
            for event in robot.take_events() {
                recorder.take(&mut robot, &event, console)?;
            }
            recorder.look_after(&mut robot, console)?;
        }
        Ok(())
    };
    let ended = match listen() {
        Err(CommandError::World(_)) if interrupt.is_requested() => Ok(()),
        ended => ended,
    };
    robot::end_soon(&mut robot);
    recorder.finish(&mut robot, ended, console)
}

/// Time from one sample to the next.
fn period(args: &RecordArgs) -> Duration {
    (args.sample).map_or(kept_values::PERIOD, |sample| {
        Duration::from_micros(sample.us)
    })
}

/// Counts what is written through it.
struct Counted<W> {
    out: W,
    bytes: u64,
}

impl<W: Write> Write for Counted<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.out.write(bytes)?;
        self.bytes += count as u64;
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// Begins the MCAP file.
fn begin(args: &RecordArgs) -> Result<Draft, CommandError> {
    Draft::begin(&args.output, "MCAP file")
}

/// Writes what a recording tells, as far as it can be run again.
fn write(
    recording: &Recording,
    path: &Path,
    out: Draft,
    args: &RecordArgs,
    console: &mut Console,
) -> Result<(), CommandError> {
    let (told, ended) = Told::of(recording);
    let mut out = Counted { out, bytes: 0 };
    let channels = mcap_file::write(recording, &told, &mut out);
    let channels = channels.map_err(|error| match error {
        McapFileError::File(cause) => CommandError::World(anyhow!(
            "cannot write the MCAP file {}: {cause}",
            args.output.display()
        )),
        error => CommandError::Input(anyhow!("{}: {error}", path.display())),
    })?;
    let Counted { out, bytes } = out;
    out.finish()?;
    let messages = channels.iter().map(|channel| channel.messages).sum();
    if args.json {
        let head = &recording.head;
        console.json_line(&Report {
            board: &head.board,
            firmware: &head.firmware,
            seed: head.seed,
            missions: (told.missions.iter())
                .map(|mission| mission.name.as_str())
                .collect(),
            start_us: told.span_us.map(|(start_us, _)| start_us),
            end_us: told.span_us.map(|(_, end_us)| end_us),
            messages,
            bytes,
            error: ended.as_ref().err().map(ToString::to_string),
            channels,
        })?;
    } else {
        let width = channels.iter().map(|channel| channel.topic.chars().count());
        let width = width.max().unwrap_or_default();
        let mut text = String::new();
        for Channel {
            topic,
            schema,
            messages,
        } in &channels
        {
            text += &format!("  {topic:<width$}  {schema}  {messages}\n");
        }
        let messages = counted(messages, "message");
        text += &format!("{messages}, {bytes} bytes in {}\n", args.output.display());
        console.text(&text)?;
    }
    note_end(recording, path, console);
    ended.map_err(|error| CommandError::Input(error.into()))
}

/// Says what a recording lacks that was read.
pub(super) fn note_end(recording: &Recording, path: &Path, console: &mut Console) {
    let shown = path.display();
    if !recording.has_samples() {
        console.note(&format!(
            "note: {shown} holds no values; states and transitions are there"
        ));
    }
    if let FileEnd::Cut { at } = recording.end {
        console.note(&format!(
            "note: the writing of {shown} was broken off at byte {at}; all before it is there"
        ));
    }
}
