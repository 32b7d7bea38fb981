//! `esm upload`: a new mission for a robot that is on.

use std::fmt;
use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::anyhow;
use clap::{Args, ValueEnum};
use esm_core::Verified;
use esm_link::features::Feature;
use esm_link::message::{Capacities, LinkError, Mode, NO_STATE, Swap};
use esm_link::trial::{FallBack, FallBackReason};
use serde::Serialize;

use super::argument::Time;
use super::console::Console;
use super::exit::CommandError;
use super::recorder::{self, Recorder};
use super::robot::{self, LONGEST_WAITS, OnTheLine, Robot, RobotArgs, is_back, what_runs};
use super::status::mode_words;
use super::{file, stage};
use crate::clean::counted;
use crate::inspect::changes::{Changes, Migration};
use crate::inspect::refusal::Explained;
use crate::keys;
use crate::link_client::{ClientError, RobotInfo, Streams};
use crate::recording::live;
use crate::run::interrupt::Interrupt;
use crate::run::mission::{Mission, hash_text};
use crate::run::story;
use crate::schedule::handover::{Handover, SlotTable};
use crate::serial::wire::is_taken_over;
use crate::trial::{self, End, LONGEST_TRIAL, Outcome, Tried};

/// Gives a robot that is on a new mission
///
/// Compiles FILE if it is a source, checks it against what the robot says of itself, uploads it
/// while the old mission runs, and lets the robot switch between two macro steps. A robot that
/// refuses the blob says why and drives on with what it has.
///
/// The new mission runs on trial first. If it faults, or takes longer than its slots too often, the
/// robot goes back to the mission before by itself, and so it does if nothing is heard from here.
/// When it has run well for a second, it is confirmed. With `--trial` that is left to you:
/// `esm confirm`, `esm fallback`.
///
/// An upload that was broken off (a lost line, a host that was switched off) goes on where it was
/// when the same is uploaded again. Ctrl-C ends it in order: the robot forgets what it has of the
/// new mission, or goes back to the one before where the new one runs on trial already.
///
/// With `--record`, what enters the robot's interpreter is kept for `esm replay`, from before the
/// upload to the confirmation.
///
/// As long as another mission is on trial the robot has no room for this one: the end of that trial
/// is waited for, or `--on-trial` says what becomes of it at once.
///
/// What changes against the mission that runs is shown before it is sent: states, transitions,
/// parameters, slots, by name. With `--warm` also what goes on.
///
/// Slots that the running mission has, too, keep their start, so that they go on without a gap.
/// Where that is impossible, as few move as need to; which, and the one longer gap of each, is said
/// before anything is sent. The starts in a blob are what they are.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm upload missions/patrol.esm --port /dev/ttyUSB0
  esm upload patrol.blob --port tcp:robot.local:4000
  esm upload missions/patrol.esm --port /dev/ttyUSB0 --warm --diff
  esm upload missions/patrol.esm --port /dev/ttyUSB0 --warm
  esm upload missions/patrol.esm --port /dev/ttyUSB0 --trial '60 s'
  esm upload missions/patrol.esm --port /dev/ttyUSB0 --record swap.rec
  esm upload missions/patrol.esm --port /dev/ttyUSB0 --on-trial fallback   # without waiting for the end of another one's trial
  esm upload missions/patrol.esm --port /dev/ttyUSB0 --no-gap --json")]
pub struct UploadArgs {
    /// The mission, or a blob that `esm build` made of it
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// Sends nothing where a slot that both missions have cannot go on as it runs
    #[arg(long)]
    pub no_gap: bool,

    /// What both missions have goes on as it is: states, timers, flags, nets, what tasks know. All
    /// else starts anew
    #[arg(long)]
    pub warm: bool,

    /// Shows what the upload would change, and sends nothing
    #[arg(long)]
    pub diff: bool,

    /// Leaves it to you to confirm the mission within this time: otherwise the robot goes back to
    /// the one before. 1 s to 3600 s
    #[arg(long, value_name = "TIME", value_parser = trial_time)]
    pub trial: Option<Time>,

    /// Keeps what enters the interpreter meanwhile, to be run again with `esm replay`
    #[arg(long, value_name = "REC", conflicts_with = "diff")]
    pub record: Option<PathBuf>,

    /// What becomes of another mission that is on trial there still, so that the robot has no room
    /// for this one
    #[arg(long, value_name = "WHAT", value_enum, default_value_t)]
    pub on_trial: OnTrial,

    /// One JSON object, for programs: what was sent, and what becomes of the slots that both
    /// missions have
    #[arg(long)]
    pub json: bool,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,
}

/// What becomes of a mission that is on trial when another is to be uploaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum OnTrial {
    /// The end of its trial is waited for
    #[default]
    Wait,
    /// It is confirmed: the mission follows it
    Confirm,
    /// It is given up: the mission follows the one before it
    Fallback,
}

/// What became of a mission that was on trial, in the form of its JSON.
#[derive(Serialize)]
struct EarlierTrial {
    /// Its hash, in hex.
    mission: String,
    /// Whether it stayed until the upload.
    confirmed: bool,
    /// Why the robot gave it up, if it did.
    fell_back: Option<&'static str>,
    /// Time that was waited for that, in seconds.
    waited_s: f64,
}

/// What was done, in the form of its JSON.
#[derive(Serialize)]
struct Uploaded {
    /// The mission's file.
    file: String,
    /// Hash of its blob, in hex.
    hash: String,
    /// Size of its blob.
    bytes: usize,
    /// Time that the upload took, in seconds.
    upload_s: f64,
    /// With `--warm`: active regions that went on as they were.
    carried_regions: Option<u16>,
    /// How the robot is behind it, as `esm status` names it; none where it did not say.
    mode: Option<&'static str>,
    /// Whether the mission runs and all its final states are reached already.
    finished: bool,
    /// Whether the mission stays.
    confirmed: bool,
    /// Why the robot gave it up, if it did.
    fell_back: Option<&'static str>,
    /// What became of the mission that was on trial before, if one was.
    earlier_trial: Option<EarlierTrial>,
    #[serde(flatten)]
    handover: Handover,
    /// How it differs from the mission before, if there was one.
    #[serde(flatten)]
    preview: Option<Preview>,
}

/// What an upload changes.
#[derive(Serialize)]
struct Preview {
    /// How the missions differ.
    changes: Changes,
    /// With `--warm`: what goes on, by the states that the robot is in now.
    carry_over: Option<Migration>,
}

/// What `--diff` has compared, in the form of its JSON.
#[derive(Serialize)]
struct Compared<'p> {
    /// How the missions differ; none where none runs.
    changes: Option<&'p Changes>,
    /// With `--warm`: what goes on, by the states that the robot is in now.
    carry_over: Option<&'p Migration>,
}

/// How many bytes a line of so many bits a second carries for each byte of a mission at most: where
/// it spoils one byte in ten.
const LINE_BYTES_A_BYTE: u32 = 100;

/// Bits that a byte takes on a serial line.
const BITS_A_BYTE: u32 = 10;

/// On a slower line than this, in bits a second, everything may take as much longer as it is
/// slower.
const SLOW_LINE: u32 = 9_600;

/// Lets the robot take longer than other commands do, as long as it takes bytes of the mission; and
/// on a slow line.
fn limit_waits(robot: &mut Robot, baud: u32) {
    let line_byte = Duration::from_secs(1) * BITS_A_BYTE / baud;
    robot.allow_for_each_byte(line_byte * LINE_BYTES_A_BYTE);
    robot.extend_waits(LONGEST_WAITS * (SLOW_LINE / baud).saturating_sub(1));
}

/// How many differences of a kind are shown before an upload, and with `--diff`.
const SHOWN: usize = 4;
const SHOWN_ALONE: usize = 100;

impl Preview {
    fn of(
        running: &Verified<Vec<u8>>,
        mission: &Mission,
        warm: bool,
        robot: &mut Robot,
    ) -> Result<Self, CommandError> {
        let next = stage::verified(&mission.file, mission.blob.clone())?;
        let carry_over = if warm {
            let states = robot.current_states()?.states;
            let current = |region: usize| {
                let state = states.get(region).filter(|state| **state != NO_STATE)?;
                Some(usize::from(*state))
            };
            // Without names nothing goes on.
            Migration::between(&running.tables(), current, &next.tables()).ok()
        } else {
            None
        };
        Ok(Preview {
            changes: Changes::between(running, &next),
            carry_over,
        })
    }

    fn text(&self, most: usize) -> String {
        let carried = self.carry_over.as_ref().map(|carried| carried.text(most));
        self.changes.text(most) + &carried.unwrap_or_default()
    }
}

/// Shows what an upload would change.
fn show(preview: Option<Preview>, json: bool, console: &mut Console) -> Result<(), CommandError> {
    if json {
        // The keys are there also where there is nothing to compare with.
        return console.json_line(&Compared {
            changes: preview.as_ref().map(|preview| &preview.changes),
            carry_over: (preview.as_ref()).and_then(|preview| preview.carry_over.as_ref()),
        });
    }
    match preview {
        Some(preview) => console.text(&preview.text(SHOWN_ALONE)),
        None => console.text("the robot has no mission: all of it is new\n"),
    }
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &UploadArgs, console: &mut Console) -> Result<(), CommandError> {
    if let Some(output) = &args.record {
        let key = keys::path(args.robot.key.as_deref()).ok();
        let inputs = [Some(args.file.as_path()), key.as_deref()];
        file::keep_sources(output, inputs.into_iter().flatten())?;
    }
    let mut staged = stage::mission(&args.file, console)?;
    if args.record.is_some() {
        stage::require_names(&staged.mission)?;
    }
    let interrupt = Interrupt::take_over()?;
    let (mut robot, info) = args.robot.connect_to_upload(console)?;
    if !args.diff {
        limit_waits(&mut robot, args.robot.line.baud);
    }
    if args.warm {
        robot.require(Feature::Warm)?;
    }
    if args.record.is_some() {
        robot.require(Feature::Record)?;
    }
    if staged.mission.has_links {
        robot.require(Feature::Links)?;
    }
    // Whoever only looks sees what runs now.
    let earlier_trial = if args.diff {
        None
    } else {
        end_earlier_trial(args.on_trial, &mut robot, interrupt, console)?
    };
    let is_needed = args.diff || args.warm || args.no_gap || args.record.is_some();
    let running = running_mission(&mut robot, is_needed, console)?;
    let handover = match &running {
        Some(running) => staged.follow(&SlotTable::of(&running.tables()), args.no_gap, console)?,
        None => Handover::default(),
    };
    let mission = &staged.mission;
    let preview = match &running {
        Some(running) => Some(Preview::of(running, mission, args.warm, &mut robot)?),
        None => None,
    };
    if let (Some(running), true) = (&running, args.warm) {
        if !mission.has_names {
            console.note(&stage::nothing_goes_on(&mission.file.display()));
        } else if running.tables().names().is_none() {
            console.note(&stage::nothing_goes_on(&"the mission that runs"));
        }
    }
    if args.diff {
        return show(preview, args.json, console);
    }
    if let (Some(preview), false) = (&preview, args.json) {
        console.text(&preview.text(SHOWN))?;
    }
    check_room(mission, &info)?;
    let mut recorder = match &args.record {
        Some(path) => {
            let running = running.map(live::mission_of).transpose();
            let running = running.map_err(|error| recorder::failed(error, path))?;
            let known: Vec<&Mission> = running.iter().collect();
            Some(Recorder::begin(path, &mut robot, &info, RECORD, &known)?)
        }
        None => None,
    };
    let ended = install(
        args,
        mission,
        Found {
            earlier_trial,
            handover,
            preview,
        },
        interrupt,
        &mut robot,
        &mut recorder,
        console,
    );
    match recorder {
        Some(recorder) => recorder.finish(&mut robot, ended, console),
        None => ended,
    }
}

/// What is wanted beside the answers: a recording.
const RECORD: Streams = Streams {
    record: true,
    ..Streams::NONE
};

/// What was found on the robot before anything was sent.
struct Found {
    /// The mission that was on trial, and what became of it.
    earlier_trial: Option<EarlierTrial>,
    /// What becomes of the slots that run.
    handover: Handover,
    /// How the mission that runs differs, if one does.
    preview: Option<Preview>,
}

/// Sends the mission, lets it take over, and waits for what becomes of its trial, if that is not
/// somebody else's.
fn install(
    args: &UploadArgs,
    mission: &Mission,
    found: Found,
    interrupt: Interrupt,
    robot: &mut Robot,
    recorder: &mut Option<Recorder>,
    console: &mut Console,
) -> Result<(), CommandError> {
    if let Some(recorder) = recorder {
        recorder.expect(mission, robot, console)?;
    }
    let bar = console.progress(
        &format!("uploading {}", mission.name),
        mission.blob.len() as u64,
    );
    let clock = robot.clock().clone();
    let started = clock.now();
    let trial_time = args.trial.map_or_else(
        || trial::trial_time(mission.directory.interpreter_period_us()),
        |trial| Duration::from_micros(trial.us),
    );
    let swap = Swap {
        warm: args.warm,
        trial_ms: trial_time.min(LONGEST_TRIAL).as_millis() as u32,
    };
    robot.stop_when(Some(Box::new(move || interrupt.is_requested())));
    let mut there_before = None;
    let sent = robot.stage(&mission.blob, &mut |bytes| {
        there_before.get_or_insert(bytes);
        bar.set_position(bytes as u64);
    });
    bar.finish_and_clear();
    // A switch that was asked for is waited for: nobody should be in doubt about what runs.
    robot::hold_out(robot);
    if let Some(there @ 1..) = there_before {
        console.note(&format!(
            "went on at byte {there} of {}: the robot had the rest from an upload that was broken off",
            mission.blob.len()
        ));
    }
    let staged = match sent {
        Err(ClientError::Interrupted { .. }) => return Err(aborted(robot)),
        Ok(()) if interrupt.is_requested() => return Err(aborted(robot)),
        // What the line lost meanwhile is asked for, so that the swap follows from what was before.
        sent => sent
            .and_then(|()| match recorder {
                Some(recorder) => recorder.expect(mission, robot, console),
                None => Ok(()),
            })
            .and_then(|()| robot.status()),
    };
    let status = staged.map_err(|error| {
        ended_by(
            error,
            mission,
            "the robot drives on with what it has; the same upload goes on where this one ended",
        )
    })?;
    let committed = robot
        .commit(swap)
        .map_err(|error| ended_by(error, mission, &unknown_whether_it_runs(mission, swap)))?;
    let tried = Tried::since(&status, committed.mission, trial_time);
    let upload_s = clock.since(started).as_secs_f64();
    let outcome = match args.trial {
        Some(_) => None,
        None => {
            robot.stop_when(Some(Box::new(move || interrupt.is_requested())));
            robot.extend_waits(tried.limit());
            let outcome = trial::watch_and(robot, tried, |robot| match recorder {
                Some(recorder) => recorder.keep_up(robot, console),
                None => Ok(()),
            });
            robot::hold_out(robot);
            match outcome {
                Err(ClientError::Interrupted { .. }) => {
                    return Err(given_up(robot, committed.mission));
                }
                Err(error) => return Err(not_confirmed(error, mission, swap)),
                Ok(outcome) => Some(outcome),
            }
        }
    };
    let standing = Standing::of(robot, mission, committed.mission);
    let told = Uploaded {
        mode: standing.mode.map(|mode| mode_words(mode).0),
        finished: standing.finished,
        file: mission.file.display().to_string(),
        hash: mission.hash_text(),
        bytes: mission.blob.len(),
        upload_s,
        carried_regions: args.warm.then_some(committed.carried),
        confirmed: matches!(
            outcome,
            Some(Outcome::Confirmed | Outcome::ConfirmedStopped)
        ),
        preview: found.preview,
        fell_back: match outcome {
            Some(Outcome::FellBack(fell_back)) => Some(story::fall_back_reason(fell_back.reason)),
            _ => None,
        },
        earlier_trial: found.earlier_trial,
        handover: found.handover,
    };
    if args.json {
        console.json_line(&told)?;
    } else if stays_for_now(outcome) {
        let Uploaded {
            file, hash, bytes, ..
        } = &told;
        writeln!(
            console.out(),
            "{file} ({hash}) {standing}: {bytes} bytes in {upload_s:.2} s"
        )?;
        tell_carried(&told, console)?;
        tell_trial(args.trial, console)?;
        if let Some(what_to_do) = standing.what_to_do(outcome) {
            console.note(&what_to_do);
        }
    }
    failure(&told, outcome, robot)
}

/// How the robot is when it has taken a mission over.
struct Standing {
    /// None where the robot did not say: the upload is done all the same.
    mode: Option<Mode>,
    /// Whether the mission runs and all its final states are reached.
    finished: bool,
    /// Whether the button of the emergency stop is pressed.
    stop_pressed: bool,
}

impl Standing {
    /// Asks a robot that has taken this mission over.
    fn of(robot: &mut Robot, mission: &Mission, hash: u32) -> Self {
        let unknown = Standing {
            mode: None,
            finished: false,
            stop_pressed: false,
        };
        let status = robot.status().ok();
        let Some(status) = status.filter(|status| status.mission == Some(hash)) else {
            return unknown;
        };
        let has_finished = |states: Vec<u16>| {
            let current = |region: usize| states.get(region).copied().map_or(0, usize::from);
            mission.directory.has_finished(current)
        };
        Standing {
            mode: Some(status.mode),
            finished: status.mode == Mode::Running
                && (robot.current_states()).is_ok_and(|current| has_finished(current.states)),
            stop_pressed: status.stop_pressed,
        }
    }

    /// What keeps the mission from running, and what to do about it.
    fn what_to_do(&self, outcome: Option<Outcome>) -> Option<String> {
        let stopped = match self.mode? {
            Mode::EmergencyStopped => format!(
                "an emergency stop is latched: the motors are off until {}`esm start --release`",
                if self.stop_pressed {
                    "its button is let go of and "
                } else {
                    ""
                }
            ),
            Mode::Stopped => {
                "the robot is stopped: the motors are off until `esm start`".to_owned()
            }
            _ => return None,
        };
        let untried = match outcome {
            Some(Outcome::ConfirmedStopped) => {
                "; the mission is confirmed without a trial, so that the robot keeps it should it fail then"
            }
            _ => "",
        };
        Some(format!("{stopped}{untried}"))
    }
}

impl fmt::Display for Standing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.mode {
            Some(Mode::Running) if self.finished => {
                "has finished already, all its final states are reached"
            }
            Some(Mode::Running) => "runs",
            _ => "is the robot's mission now",
        })
    }
}

/// Whether the robot has the mission, for all that is known, and keeps it or waits for a word on
/// it.
fn stays_for_now(outcome: Option<Outcome>) -> bool {
    matches!(
        outcome,
        None | Some(Outcome::Confirmed | Outcome::ConfirmedStopped)
    )
}

/// What an error is as the end of the command. `robot_does` says what the robot does meanwhile,
/// where that is known of it neither by its refusal nor by a key that was missing before anything
/// was asked of it.
fn ended_by(error: ClientError, mission: &Mission, robot_does: &str) -> CommandError {
    match error.refusal() {
        Some(refusal) => CommandError::Input(anyhow!(
            "the robot refused {}: {}; it goes on with what it had",
            mission.file.display(),
            mission.refusal(refusal)
        )),
        None if matches!(
            error,
            ClientError::NoKey | ClientError::Key(_) | ClientError::OtherKey { .. }
        ) =>
        {
            error.into()
        }
        None if matches!(&error, ClientError::Line(line) if is_taken_over(line)) => {
            let stopped = "the robot is stopped by it; `esm status` tells what it has";
            on_the_line(format!("{error}\n{stopped}"), error)
        }
        None => on_the_line(format!("{error}\n{robot_does}"), error),
    }
}

/// What is said where nobody heard whether the robot has changed over.
fn unknown_whether_it_runs(mission: &Mission, swap: Swap) -> String {
    format!(
        "whether {} ({}) runs is not known: if so, it is on trial, and the robot goes back to what it had before by itself when {} s are over; `esm status` tells, `esm confirm` keeps it",
        mission.file.display(),
        mission.hash_text(),
        seconds(swap)
    )
}

/// What an error is while a mission on trial is watched, and confirmed.
fn not_confirmed(error: ClientError, mission: &Mission, swap: Swap) -> CommandError {
    let runs = format!("{} ({}) runs", mission.file.display(), mission.hash_text());
    match error.refusal() {
        Some(refusal) => CommandError::Input(anyhow!(
            "{runs}, but the robot did not confirm it: {}; unless `esm confirm` succeeds, it goes back to what it had before, when the trial is over or the robot starts again",
            mission.refusal(refusal)
        )),
        None => {
            let robot_does = format!(
                "{runs}, and was not heard to be confirmed: unless it is, the robot goes back to what it had before by itself when the {} s of its trial are over; `esm status` tells, `esm confirm` keeps it",
                seconds(swap)
            );
            ended_by(error, mission, &robot_does)
        }
    }
}

/// How long a trial is.
fn seconds(swap: Swap) -> f64 {
    f64::from(swap.trial_ms) / 1e3
}

/// Sees to it that no other mission is on trial, which the robot would have no room beside for.
/// Answers what became of the one that was.
fn end_earlier_trial(
    wanted: OnTrial,
    robot: &mut Robot,
    interrupt: Interrupt,
    console: &mut Console,
) -> Result<Option<EarlierTrial>, CommandError> {
    let status = robot.status()?;
    let (Some(trial), Some(mission), Some(tried)) =
        (status.trial, status.mission, Tried::found(&status))
    else {
        return Ok(None);
    };
    let hash = hash_text(mission);
    let clock = robot.clock().clone();
    let started = clock.now();
    let asked = match wanted {
        OnTrial::Confirm => robot.confirm(mission).map(|()| Some(End::Confirmed)),
        OnTrial::Fallback => robot.fall_back(mission).map(|()| {
            let reason = FallBackReason::Asked;
            Some(End::FellBack(FallBack { mission, reason }))
        }),
        OnTrial::Wait => {
            console.note(&format!(
                "{hash} is on trial there for {:.1} s more, which is waited for; `--on-trial confirm` or `--on-trial fallback` ends it at once",
                f64::from(trial.left_ms) / 1e3
            ));
            Ok(None)
        }
    };
    let asked = match asked {
        // It ended in this moment by itself.
        Err(error) if error.refusal() == Some(LinkError::NotOnTrial) => None,
        asked => asked?,
    };
    let bar = console.progress(&hash, trial.left_ms.into());
    robot.stop_when(Some(Box::new(move || interrupt.is_requested())));
    let mut left_s = f64::from(trial.left_ms) / 1e3;
    let end = match asked {
        Some(end) => Ok(end),
        None => {
            robot.extend_waits(tried.limit());
            trial::outlast(robot, tried, &mut |left| {
                left_s = left.as_secs_f64();
                bar.set_message(&format!("{hash} is on trial for {left_s:.1} s more"));
                bar.set_position(u64::from(trial.left_ms).saturating_sub(left.as_millis() as u64));
            })
        }
    };
    robot::hold_out(robot);
    bar.finish_and_clear();
    let (confirmed, fell_back) = match end {
        Ok(End::Confirmed) => (true, None),
        Ok(End::FellBack(fell_back)) => (false, Some(story::fall_back_reason(fell_back.reason))),
        Ok(End::Unknown) => (false, None),
        Ok(End::Standstill) => {
            return Err(CommandError::World(anyhow!(
                "{hash} is on trial there, and the robot's time stands still, so that its trial has no end; nothing was sent. `--on-trial confirm` or `--on-trial fallback` ends it"
            )));
        }
        Err(ClientError::Interrupted { .. }) => {
            return Err(CommandError::World(anyhow!(
                "interrupted; nothing was sent, and {hash} is on trial for {left_s:.1} s more"
            )));
        }
        Err(error) => return Err(error.into()),
    };
    let what = match (confirmed, fell_back) {
        (true, _) => format!("{hash} is confirmed"),
        (false, Some(why)) => format!("{hash} is given up: {why}"),
        (false, None) => format!("{hash} runs no more"),
    };
    console.note(&what);
    Ok(Some(EarlierTrial {
        mission: hash,
        confirmed,
        fell_back,
        waited_s: clock.since(started).as_secs_f64(),
    }))
}

/// Lets the robot forget the upload, and says what it runs.
fn aborted(robot: &mut Robot) -> CommandError {
    robot::end_soon(robot);
    let ended = robot.abort().and_then(|()| robot.status());
    match ended {
        Ok(status) => CommandError::World(anyhow!("interrupted; {}", what_runs(&status))),
        Err(error) => on_the_line(
            format!(
                "interrupted, and the robot could not be told: {error}\nit drives on with what it has"
            ),
            error,
        ),
    }
}

fn on_the_line(said: String, cause: ClientError) -> CommandError {
    CommandError::World(OnTheLine { cause, said }.into())
}

/// Lets the robot go back to the mission before, and says what it runs.
fn given_up(robot: &mut Robot, hash: u32) -> CommandError {
    robot::end_soon(robot);
    let ended = match robot.fall_back(hash) {
        // It was faster.
        Err(error) if error.refusal() == Some(LinkError::NotOnTrial) => robot.status(),
        ended => ended.and_then(|()| robot.status()),
    };
    let hash = hash_text(hash);
    match ended {
        Ok(status) => CommandError::World(anyhow!(
            "interrupted while {hash} ran on trial; {}",
            what_runs(&status)
        )),
        Err(error) => on_the_line(
            format!(
                "interrupted while {hash} ran on trial, and the robot could not be told: {error}\nit goes back to the mission before when the time of the trial is over"
            ),
            error,
        ),
    }
}

/// Reads how long a trial is.
fn trial_time(text: &str) -> Result<Time, String> {
    let time: Time = text.parse().map_err(|error| format!("{error}"))?;
    let allowed = 1_000_000..=LONGEST_TRIAL.as_micros() as u64;
    if allowed.contains(&time.us) {
        Ok(time)
    } else {
        Err("a trial is 1 s to 3600 s long".to_owned())
    }
}

/// Says how much of the mission before goes on, if it was to.
fn tell_carried(told: &Uploaded, console: &mut Console) -> Result<(), CommandError> {
    match told.carried_regions {
        Some(0) => console.note(
            "nothing goes on as it was: the two missions have nothing in common, one has no names, or the robot stood still",
        ),
        Some(regions) => writeln!(
            console.out(),
            "as they were: {}",
            counted(regions.into(), "active region")
        )?,
        None => {}
    }
    Ok(())
}

/// Says what the person is to do about the trial, if anything.
fn tell_trial(trial: Option<Time>, console: &mut Console) -> Result<(), CommandError> {
    if let Some(trial) = trial {
        let seconds = trial.us as f64 / 1e6;
        writeln!(
            console.out(),
            "on trial for {seconds} s: `esm confirm` keeps it, `esm fallback` goes back"
        )?;
    }
    Ok(())
}

/// What an outcome is as the end of the command.
fn failure(
    told: &Uploaded,
    outcome: Option<Outcome>,
    robot: &mut Robot,
) -> Result<(), CommandError> {
    let Uploaded { file, hash, .. } = told;
    let left_alone = |why: String| {
        Err(CommandError::World(anyhow!(
            "{file} ({hash}) is not confirmed: {why}; the robot goes back to the mission before when the time of the trial is over"
        )))
    };
    match outcome {
        None | Some(Outcome::Confirmed | Outcome::ConfirmedStopped) => Ok(()),
        Some(Outcome::FellBack(fell_back)) => {
            let why = story::fall_back_reason(fell_back.reason);
            let now = is_back(&robot.status()?);
            Err(CommandError::Input(anyhow!(
                "the robot gave {file} ({hash}) up: {why}; {now}"
            )))
        }
        Some(Outcome::Safe(reason)) => left_alone(story::safe_reason(reason).to_owned()),
        Some(Outcome::Standstill) => left_alone("the robot's time stands still".to_owned()),
        Some(Outcome::Unknown) => Err(CommandError::World(anyhow!(
            "{file} ({hash}) runs no more, and the robot does not say why: it was reset, or somebody else gave it another mission; `esm status` says what it runs"
        ))),
    }
}

/// The mission that runs on the robot, if one does. Over a line that lets its long answers not
/// pass, a mission can still be sent, where nothing of the old one is needed for that.
fn running_mission(
    robot: &mut Robot,
    is_needed: bool,
    console: &mut Console,
) -> Result<Option<Verified<Vec<u8>>>, CommandError> {
    let blob = match robot.running_blob() {
        Ok(blob) => blob,
        Err(error) if error.refusal() == Some(LinkError::NoMission) => return Ok(None),
        Err(ClientError::NoReply {
            corrupt_frames: 1..,
            ..
        }) if !is_needed => {
            console.note(
                "the line is too bad to read the mission that runs: what changes is not shown, and all slots begin anew",
            );
            return Ok(None);
        }
        Err(error) => return Err(error.into()),
    };
    let verified = esm_core::verify(blob).map_err(|(_, refusal)| {
        CommandError::World(anyhow!(
            "the robot's running mission cannot be read: {}",
            Explained(refusal)
        ))
    })?;
    Ok(Some(verified))
}

/// Compares the mission with what the robot says of itself, before anything is sent.
fn check_room(mission: &Mission, info: &RobotInfo) -> Result<(), CommandError> {
    let Capacities {
        blob_bytes,
        arena_words,
        task_instances,
        ..
    } = info.capacities;
    let needs = [
        ("bytes", mission.blob.len(), blob_bytes),
        (
            "words of memory for its state",
            mission.arena_words,
            arena_words,
        ),
        (
            "task states",
            mission.directory.task_states().len(),
            u32::from(task_instances),
        ),
    ];
    for (what, needed, available) in needs {
        if needed > available as usize {
            return Err(CommandError::Input(anyhow!(
                "{} needs {needed} {what}, the robot ({} on {}) has room for {available}; nothing was sent",
                mission.file.display(),
                info.firmware,
                info.board
            )));
        }
    }
    Ok(())
}
