//! `esm log`: what a robot says.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use clap::Args;
use esm_link::features::Feature;
use esm_link::message::{Channel, Mode};
use esm_link::status_event::{Cause, StatusEvent};
use serde::Serialize;

use super::argument::Time;
use super::console::Console;
use super::exit::CommandError;
use super::kept_values::KeptValues;
use super::recorder::Recorder;
use super::robot::{self, Robot, RobotArgs, is_taken_over};
use super::status::mode_words;
use super::{file, stage};
use crate::clean::counted;
use crate::host_board;
use crate::keys;
use crate::link_client::error::without;
use crate::link_client::log_lines::LogReader;
use crate::link_client::{ClientError, StreamEvent, Streams};
use crate::reading::{ReadError, Reader};
use crate::run::interrupt::Interrupt;
use crate::run::mission::hash_text;
use crate::run::story;

/// How long a wait for the next line may last before Ctrl-C is looked for.
const LISTEN_TIME: Duration = Duration::from_millis(100);

/// How often that long is waited before a port that `esm stop` has is tried again.
const PAUSES_A_TRY: u32 = 5;

/// How long `esm stop` may have the port before the log is given up: longer than it waits for any
/// answer.
const RETURN_WAIT: Duration = Duration::from_secs(40);

/// Shows what the firmware logs, decoded, as it comes
///
/// Runs until Ctrl-C. Lines that are missing are counted and told where they were: `12 lines lost`.
/// `esm stop` from elsewhere takes the port over for the time that it needs, which is said; the log
/// goes on after it, a recording ends with it. Where a line begins with a time, it is in seconds of
/// the board's clock, since it was switched on.
///
/// With --record, what enters the robot's interpreter is kept as it comes, for `esm replay`: from
/// now on, with all that the machine is now. What the line loses is a gap, which is said, and
/// behind which the recording goes on. The file is whole whatever ends the command.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm log --port /dev/ttyUSB0
  esm log --port /dev/ttyUSB0 --news '1 s'
  esm log --port /dev/ttyUSB0 --json | jq -c 'select(.what == \"lost\")'
  esm log --port /dev/ttyUSB0 --record drive.rec
  esm log --port unix:/tmp/robot --firmware rover.elf

With --json one object a line. `what` is `line` (with clock, level, text), `lost` (with lines that the robot had no room for, pieces that the line
lost, and lines that cannot be read) or `news` (with cause, mode, finished, mission, t_us and the counters).")]
pub struct LogArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// The firmware that the robot runs, whose file holds the texts of the log
    #[arg(long, value_name = "ELF", env = "ESM_FIRMWARE")]
    pub firmware: Option<PathBuf>,

    /// Shows, too, when the robot's mission, the trial of that or its mode changes, and how it is
    /// each TIME of the mission's, if one is given
    #[arg(long, value_name = "TIME", num_args = 0..=1, default_missing_value = "0 s")]
    pub news: Option<Time>,

    /// Keeps what enters the interpreter, too, to be run again with `esm replay`
    #[arg(long, value_name = "REC")]
    pub record: Option<PathBuf>,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub values: KeptValues,

    /// One JSON object a line, for programs
    #[arg(long)]
    pub json: bool,
}

/// What a robot said, in the form of its JSON.
#[derive(Serialize)]
#[serde(tag = "what", rename_all = "snake_case")]
enum Said<'l> {
    /// A line of its log.
    Line {
        /// Time of the board's clock, since it was switched on, where the line has one.
        clock: Option<&'l str>,
        /// How grave it is, where it says so.
        level: Option<String>,
        /// Its words.
        text: &'l str,
    },
    /// What is missing between the line before and the one behind.
    Lost {
        /// Lines that the robot had no room for.
        lines: u32,
        /// Pieces of the log that the line to the robot lost, with unknown lines in them.
        pieces: u32,
        /// Lines that came and cannot be read.
        unreadable: u64,
    },
    /// How the robot is.
    #[serde(rename = "news")]
    StatusEvent(Told),
}

/// News of a robot, in the form of their JSON.
#[derive(Serialize)]
struct Told {
    /// Why they came: `now`, `news`, `mission`, `trial` or `mode`.
    cause: &'static str,
    /// As `esm status` names it.
    mode: &'static str,
    /// Why the robot is in its safe state, if it is.
    safe_reason: Option<&'static str>,
    /// Whether the mission runs and all its final states are reached; none where the line let that
    /// not be read.
    finished: Option<bool>,
    /// Hash of the mission.
    mission: Option<String>,
    /// Whether it is on trial.
    on_trial: bool,
    /// Mission time, in microseconds.
    t_us: u64,
    /// Macro steps of the mission.
    steps: u64,
    /// Activations executed since the mission started.
    slots_executed: u32,
    /// Activations missed since the robot started.
    slots_missed: u32,
    /// Executions that took too long since the robot started.
    overruns: u32,
    /// Longest start delay since the mission started, in nanoseconds.
    longest_dispatch_delay_ns: u32,
    /// Frames from this host that came corrupt.
    #[serde(rename = "spoiled_frames")]
    corrupt_frames: u32,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &LogArgs, console: &mut Console) -> Result<(), CommandError> {
    if let Some(output) = &args.record {
        let key = keys::path(args.robot.key.as_deref()).ok();
        let inputs = [args.firmware.as_deref(), key.as_deref()];
        file::keep_sources(output, inputs.into_iter().flatten())?;
    }
    let interrupt = Interrupt::take_over()?;
    let (mut robot, info) = args.robot.connect(console)?;
    let wanted = wanted(args, &mut robot, console)?;
    let log = if wanted.log {
        reader(&info.board, args.firmware.as_deref(), console)?
    } else {
        LogReader::text()
    };
    let recording = match &args.record {
        Some(path) => {
            let mut recorder = Recorder::begin(path, &mut robot, &info, wanted, &[])?;
            if let Some(period) = args.values.period() {
                recorder.keep_values(period);
            }
            Some(recorder)
        }
        None => {
            robot.subscribe(wanted)?;
            None
        }
    };
    watch(args, &mut robot)?;
    let mut listener = Listener {
        robot,
        log,
        recording,
        reader: Reader::default(),
        json: args.json,
    };
    loop {
        // What is asked of the robot meanwhile need not come to its end if the person has seen
        // enough, and there is no end otherwise.
        listener.robot.limit_waits(None);
        listener
            .robot
            .stop_when(Some(Box::new(move || interrupt.is_requested())));
        let ended = match listener.listen(interrupt, console) {
            Err(CommandError::World(_)) if interrupt.is_requested() => Ok(()),
            ended => ended,
        };
        robot::end_soon(&mut listener.robot);
        match ended {
            Err(error) if listener.recording.is_none() && is_taken_over(&error) => {
                match listener.begin_again(args, wanted, interrupt, console)? {
                    Some(again) => listener = again,
                    None => return Ok(()),
                }
            }
            ended => return listener.finish(ended, console),
        }
    }
}

/// Asks for news, if they are wanted.
fn watch(args: &LogArgs, robot: &mut Robot) -> Result<(), CommandError> {
    if let Some(period) = args.news {
        robot.watch(Some(Duration::from_micros(period.us)))?;
    }
    Ok(())
}

/// What is wanted beside a recording: the log. A robot that keeps none can be listened to all the
/// same, if there is something else to hear.
fn wanted(
    args: &LogArgs,
    robot: &mut Robot,
    console: &mut Console,
) -> Result<Streams, CommandError> {
    if args.record.is_some() {
        robot.require(Feature::Record)?;
    }
    if args.news.is_some() {
        robot.require(Feature::StatusEvent)?;
    }
    let log = match robot.require(Feature::Log) {
        Err(ClientError::NotBuiltIn { feature })
            if args.record.is_some() || args.news.is_some() =>
        {
            console.note(&format!(
                "the robot's firmware was built without the feature `{}`: {}",
                feature.name(),
                without(feature)
            ));
            false
        }
        required => {
            required?;
            true
        }
    };
    Ok(Streams {
        log,
        ..Streams::NONE
    })
}

/// Who listens to a robot.
struct Listener {
    robot: Robot,
    log: LogReader,
    recording: Option<Recorder>,
    /// Reads whether the mission that runs has finished.
    reader: Reader,
    /// Whether a program listens.
    json: bool,
}

impl Listener {
    /// Tells what the robot says, and records, until Ctrl-C.
    fn listen(&mut self, interrupt: Interrupt, console: &mut Console) -> Result<(), CommandError> {
        while !interrupt.is_requested() {
            self.robot.attend(LISTEN_TIME)?;
            for event in self.robot.take_events() {
                if let Some(recording) = &mut self.recording {
                    recording.take(&mut self.robot, &event, console)?;
                }
                self.hear(&event, console)?;
            }
            if let Some(recording) = &mut self.recording {
                recording.look_after(&mut self.robot, console)?;
            }
        }
        Ok(())
    }

    /// Waits until `esm stop` has done what it has taken the line for, and goes on. `None` after
    /// Ctrl-C. A recording ends instead: it is whole up to there.
    fn begin_again(
        self,
        args: &LogArgs,
        wanted: Streams,
        interrupt: Interrupt,
        console: &mut Console,
    ) -> Result<Option<Self>, CommandError> {
        let Listener {
            robot,
            mut log,
            reader,
            json,
            ..
        } = self;
        // The port is closed before it is opened again.
        drop(robot);
        console.note("`esm stop` has taken the port over; the log goes on when it is done");
        let begun = Instant::now();
        loop {
            // A socket is free at once, and the stop not over.
            for _ in 0..PAUSES_A_TRY {
                thread::sleep(LISTEN_TIME);
                if interrupt.is_requested() {
                    return Ok(None);
                }
            }
            let connected = args.robot.connect_quietly().and_then(|(mut robot, _)| {
                robot.subscribe(wanted)?;
                watch(args, &mut robot)?;
                Ok(robot)
            });
            match connected {
                Ok(robot) => {
                    log.gap();
                    console.note("the log goes on; what the robot said meanwhile did not come");
                    return Ok(Some(Listener {
                        robot,
                        log,
                        recording: None,
                        reader,
                        json,
                    }));
                }
                Err(_) if interrupt.is_requested() => return Ok(None),
                Err(CommandError::World(_)) if begun.elapsed() < RETURN_WAIT => {}
                Err(error) => return Err(error),
            }
        }
    }

    fn hear(&mut self, event: &StreamEvent, console: &mut Console) -> Result<(), CommandError> {
        match event {
            StreamEvent::Log(bytes) => {
                for line in self.log.lines(bytes) {
                    if self.json {
                        console.json_line(&Said::Line {
                            clock: line.timestamp.as_deref(),
                            level: line.level.map(|level| level.to_string()),
                            text: &line.text,
                        })?;
                    } else {
                        writeln!(console.out(), "{line}")?;
                    }
                }
                let unreadable = self.log.take_unreadable();
                if unreadable > 0 {
                    self.lost(0, 0, unreadable, console)?;
                }
                console.flush()?;
            }
            StreamEvent::LinesLost(lines) => self.lost(*lines, 0, 0, console)?,
            StreamEvent::Gap {
                channel: Channel::Log,
                missing,
            } => {
                self.log.gap();
                self.lost(0, *missing, 0, console)?;
            }
            StreamEvent::StatusEvent(news) => {
                let finished = self.finished(news)?;
                if self.json {
                    console.json_line(&Said::StatusEvent(Told::of(news, finished)))?;
                } else {
                    writeln!(console.out(), "{}", told(news, finished))?;
                }
                console.flush()?;
            }
            StreamEvent::Gap { .. }
            | StreamEvent::Trace(_)
            | StreamEvent::Record(_)
            | StreamEvent::Values { .. }
            | StreamEvent::ValuesEnded { .. } => {}
        }
        Ok(())
    }

    /// Tells what is missing here.
    fn lost(
        &self,
        lines: u32,
        pieces: u32,
        unreadable: u64,
        console: &mut Console,
    ) -> Result<(), CommandError> {
        if self.json {
            console.json_line(&Said::Lost {
                lines,
                pieces,
                unreadable,
            })?;
            return Ok(console.flush()?);
        }
        let mut parts = Vec::new();
        if lines > 0 {
            let lines = counted(lines.into(), "line");
            parts.push(format!("{lines} lost: the robot had no room for more"));
        }
        if pieces > 0 {
            let pieces = counted(pieces.into(), "piece");
            parts.push(format!(
                "lines lost: {pieces} did not come through the line"
            ));
        }
        if unreadable > 0 {
            let lines = counted(unreadable, "line");
            parts.push(format!(
                "{lines} lost: spoiled, or of another firmware than the file that was named"
            ));
        }
        writeln!(console.out(), "{}", parts.join("; "))?;
        Ok(console.flush()?)
    }

    /// Whether the mission that the news are of has finished. None where the line is too bad to
    /// read that.
    fn finished(&mut self, news: &StatusEvent) -> Result<Option<bool>, CommandError> {
        let (Mode::Running, Some(mission)) = (news.mode, news.mission) else {
            return Ok(Some(false));
        };
        match self.reader.has_finished(&mut self.robot, mission) {
            Err(ReadError::Client(ClientError::NoReply {
                corrupt_frames: 1..,
                ..
            })) => Ok(None),
            asked => Ok(Some(asked?)),
        }
    }

    /// Ends streams and recording, whatever has ended the listening.
    fn finish(
        mut self,
        ended: Result<(), CommandError>,
        console: &mut Console,
    ) -> Result<(), CommandError> {
        let ended = match self.recording {
            Some(recording) => recording.finish(&mut self.robot, ended, console),
            None => ended,
        };
        if ended.is_ok() {
            // Should the robot have gone meanwhile, there is nothing left to end.
            let _ = self.robot.subscribe(Streams::NONE);
            let _ = self.robot.watch(None);
        }
        ended
    }
}

/// News as a line.
fn told(news: &StatusEvent, finished: Option<bool>) -> String {
    let mission = news.mission.map(hash_text);
    let mission = mission.as_deref().unwrap_or("no mission");
    let trial = if news.on_trial { ", on trial" } else { "" };
    let mode = match news.mode {
        Mode::Empty => "no mission".to_owned(),
        Mode::Running => match finished {
            Some(true) => format!("{mission} has finished{trial}"),
            Some(false) => format!("{mission} runs{trial}"),
            None => format!("{mission} runs or has finished{trial}"),
        },
        Mode::Stopped => format!("stopped, its mission is {mission}{trial}"),
        Mode::EmergencyStopped => {
            format!("emergency stop, latched, its mission is {mission}{trial}")
        }
        Mode::Safe(reason) => format!("safe state: {}", story::safe_reason(reason)),
    };
    let gave_up = match (news.cause, news.fell_back) {
        (Cause::Mission, Some(fell_back)) if news.mission != Some(fell_back.mission) => format!(
            "; gave {} up: {}",
            hash_text(fell_back.mission),
            story::fall_back_reason(fell_back.reason)
        ),
        _ => String::new(),
    };
    let cause = cause_words(news.cause);
    format!(
        "{cause}: {mode}{gave_up}; mission time {:.3} s: {} steps, {} slots executed, {} missed, {} overruns, {:.1} µs at most late; {} frames from here spoiled",
        news.t_us as f64 / 1e6,
        news.steps,
        news.executed,
        news.missed,
        news.overruns,
        f64::from(news.max_delay_ns) / 1e3,
        news.corrupt_frames
    )
}

/// Why news came, in a word.
fn cause_words(cause: Cause) -> &'static str {
    match cause {
        Cause::Begun => "now",
        Cause::Period => "news",
        Cause::Mission => "mission",
        Cause::Trial => "trial",
        Cause::Mode => "mode",
    }
}

impl Told {
    fn of(news: &StatusEvent, finished: Option<bool>) -> Self {
        let (mode, safe_reason) = mode_words(news.mode);
        Told {
            cause: cause_words(news.cause),
            mode,
            safe_reason,
            finished,
            mission: news.mission.map(hash_text),
            on_trial: news.on_trial,
            t_us: news.t_us,
            steps: news.steps,
            slots_executed: news.executed,
            slots_missed: news.missed,
            overruns: news.overruns,
            longest_dispatch_delay_ns: news.max_delay_ns,
            corrupt_frames: news.corrupt_frames,
        }
    }
}

/// What decodes the log of that board: the host board's is plain text, another's needs its
/// firmware's file.
fn reader(
    board: &str,
    named: Option<&Path>,
    console: &mut Console,
) -> Result<LogReader, CommandError> {
    if board == host_board::BOARD {
        return Ok(LogReader::text());
    }
    let path = stage::find_firmware(named, console)?;
    LogReader::firmware(&path).map_err(|error| CommandError::World(error.into()))
}
