//! A robot that is connected, as the page sees it: a recording that grows.
//!
//! What the robot streams becomes the bytes of a recording that leaves nothing out, and the page
//! replays them. A timer that runs out tells nothing by itself: how far the robot's macro steps are
//! comes from its trace, and the page's replay goes on up to there.

use std::collections::VecDeque;
use std::io::{self, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use esm_link::features::Feature;
use esm_link::message::Channel;
use esm_link::trace::TraceEvent;
use serde_json::{Value, json};

use super::server::{Answers, Listener};
use super::site::Site;
use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::cli::kept_values;
use crate::cli::robot::{self, Robot, RobotArgs};
use crate::host_board;
use crate::link_client::error::without;
use crate::link_client::log_lines::LogReader;
use crate::link_client::{ClientError, StreamEvent, Streams};
use crate::recording::live::{LiveError, LiveRecording, Noted};
use crate::run::interrupt::Interrupt;
use crate::run::mission::hash_text;

/// How long a wait for the robot's next words may last before Ctrl-C is looked for.
const LISTEN_TIME: Duration = Duration::from_millis(50);

/// From one question to the robot to the next, for a slot's counters and for its time in turn: the
/// line has room for that beside all else, and news wait for one answer at most.
const COUNTERS_TIME: Duration = Duration::from_millis(150);

/// Answers that say how old a mission is, at most: of a few seconds, for a clock may go wrong.
const MOST_ANSWERS: usize = 8;

/// From one word to the page to the next, where no transition was taken.
const QUIET_TIME: Duration = Duration::from_millis(100);

/// Bytes of the recording that the page is given: with more it would fall behind. More than an hour
/// of a robot that tells as much as its line has room for.
const MOST_BYTES: usize = 48 << 20;

/// Notes that are kept.
const MOST_NOTES: usize = 50;

/// Lines of the robot's log that are kept for a page that asks late.
const MOST_LINES: usize = 2_000;

/// What is told of the robot.
#[derive(Default)]
struct Told {
    /// How often it changed.
    version: u64,
    /// The recording, in whole frames.
    bytes: Vec<u8>,
    /// Macro steps of the mission that runs.
    steps: Option<u64>,
    board: String,
    notes: Vec<String>,
    /// Lines of the robot's log, each with the mission time at which it was heard, as well as that
    /// is known; and how many came before them.
    log: VecDeque<(Option<u64>, String)>,
    log_before: u64,
    slots: Vec<Value>,
    /// When the mission that runs began, by the clock of this computer, as well as it is known.
    began: Option<Instant>,
    error: Option<String>,
}

/// The same, shared by who writes it and who answers the page.
#[derive(Default)]
struct Shared(Mutex<Told>);

impl Shared {
    /// What is told. A panic of the other side leaves it whole.
    fn change<T>(&self, change: impl FnOnce(&mut Told) -> T) -> T {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Answers for Shared {
    fn answer(&self, query: &str, is_due: bool) -> Option<Vec<u8>> {
        let number = |name: &str| {
            let mut pairs = query.split('&').filter_map(|pair| pair.split_once('='));
            let (_, value) = pairs.find(|(key, _)| *key == name)?;
            value.parse::<u64>().ok()
        };
        self.change(|told| {
            let is_known = number("seen") == Some(told.version);
            if is_known && !is_due {
                return None;
            }
            let from = number("from").and_then(|from| usize::try_from(from).ok());
            let from = from.unwrap_or(0).min(told.bytes.len());
            let first = number("log").unwrap_or(0).saturating_sub(told.log_before);
            let first = usize::try_from(first)
                .unwrap_or(usize::MAX)
                .min(told.log.len());
            let head = json!({
                "from": from,
                "log": told.log.range(first..).collect::<Vec<_>>(),
                "log_lines": told.log_before + told.log.len() as u64,
                "seen": told.version.to_string(),
                "steps": told.steps,
                "board": told.board,
                "notes": told.notes,
                "slots": told.slots,
                "mission_us": told.began.map(|began| began.elapsed().as_micros() as u64),
                "error": told.error,
            });
            let head = head.to_string().into_bytes();
            // A head has some hundred bytes.
            let mut answer = (head.len() as u32).to_le_bytes().to_vec();
            answer.extend(head);
            answer.extend(told.bytes.get(from..).unwrap_or_default());
            Some(answer)
        })
    }
}

impl Told {
    fn say(&mut self, line: String) {
        let at_us = self.began.map(|began| began.elapsed().as_micros() as u64);
        self.log.push_back((at_us, line));
        if self.log.len() > MOST_LINES {
            self.log.pop_front();
            self.log_before += 1;
        }
    }
}

/// Bytes of the recording until somebody fetches them.
#[derive(Clone, Default)]
struct Out(Arc<Mutex<Vec<u8>>>);

impl Out {
    fn take(&self) -> Vec<u8> {
        std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Write for Out {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kept.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// How far the macro steps of a robot are, by its trace.
#[derive(Default)]
struct Steps {
    made: Option<u64>,
    /// Whether a transition was taken in the macro step whose end is next.
    is_moving: bool,
    /// Whether one was taken since the page was told something.
    is_moved: bool,
}

impl Steps {
    fn take(&mut self, records: &[u8]) {
        let mut rest = records;
        while !rest.is_empty() {
            let Ok(event) = TraceEvent::take(&mut rest) else {
                self.made = None;
                return;
            };
            match event {
                TraceEvent::Step { step, .. } | TraceEvent::Fault { step, .. } => {
                    self.made = step.checked_add(1);
                }
                TraceEvent::Same { .. } => {
                    self.made = self.made.and_then(|made| made.checked_add(1));
                }
                TraceEvent::Started { .. } => self.made = None,
                TraceEvent::Transition { .. } => {
                    self.is_moving = true;
                    continue;
                }
                _ => continue,
            }
            self.is_moved |= std::mem::take(&mut self.is_moving);
        }
    }
}

/// A session with the robot.
pub struct Live {
    robot: Robot,
    recording: LiveRecording<Out>,
    out: Out,
    told: Shared,
    log: Option<LogReader>,
}

impl Live {
    /// Connects to the robot, and lets it stream.
    ///
    /// # Errors
    /// What is wrong with the port, or with the robot behind it.
    pub fn connect(
        args: &RobotArgs,
        firmware: Option<&Path>,
        console: &mut Console,
    ) -> Result<Self, CommandError> {
        let (mut robot, info) = args.connect(console)?;
        let (log, no_log) = log_of(&mut robot, &info.board, firmware)?;
        let streams = Streams {
            trace: true,
            log: log.is_some(),
            ..Streams::NONE
        };
        let out = Out::default();
        let begun = LiveRecording::begin_whole(&mut robot, &info, streams, out.clone());
        let mut recording = begun.map_err(|error| {
            // It need not speak to nobody.
            let _ = robot.subscribe(Streams::NONE);
            failed(error)
        })?;
        recording.keep_values(kept_values::PERIOD);
        let told = Shared::default();
        told.change(|told| {
            told.board.clone_from(&info.board);
            told.notes.extend(no_log);
        });
        Ok(Live {
            robot,
            recording,
            out,
            told,
            log,
        })
    }

    /// Serves the page, and tells it what the robot does, until it is to end or the robot is lost.
    ///
    /// # Errors
    /// What ended it before.
    pub fn follow(
        self,
        listener: &Listener,
        site: &Site,
        is_requested: impl Fn() -> bool + Sync,
    ) -> Result<(), CommandError> {
        let Live {
            mut robot,
            mut recording,
            out,
            told,
            mut log,
        } = self;
        // There is no end but that, as for `esm record`.
        robot.limit_waits(None);
        let interrupt = Interrupt::take_over()?;
        robot.stop_when(Some(Box::new(move || interrupt.is_requested())));
        let is_over = AtomicBool::new(false);
        thread::scope(|scope| {
            let served = scope.spawn(|| {
                let is_over = || is_over.load(Ordering::Relaxed) || is_requested();
                listener.serve(site, Some(&told), is_over)
            });
            let followed = (|| {
                let mut turn = Turn::default();
                while !is_requested() && !served.is_finished() {
                    turn.make(&mut robot, &mut recording, log.as_mut(), (&out, &told))?;
                    listener.wake();
                }
                Ok(())
            })();
            let followed = match followed {
                // What was asked for last was broken off.
                Err(_) if is_requested() => Ok(()),
                followed => followed.map_err(failed),
            };
            if let Err(error) = &followed {
                told.change(|told| {
                    told.version += 1;
                    told.error = Some(error.to_string());
                });
            }
            is_over.store(true, Ordering::Relaxed);
            listener.wake();
            let served = served.join().map_err(|_| {
                CommandError::World(anyhow!("the page's server has ended by a defect"))
            });
            robot::end_soon(&mut robot);
            if followed.is_ok() {
                // Whoever has gone away hears no more of it.
                let _ = robot.end_values();
                let _ = robot.subscribe(Streams::NONE);
            }
            followed.and(served?.map_err(CommandError::from))
        })
    }
}

/// What is known from one turn to the next.
#[derive(Default)]
struct Turn {
    steps: Steps,
    beginnings: u64,
    /// The mission whose slots are counted, how many it has, and the next one to ask for.
    slots: Option<(u32, u8, u8)>,
    /// Whether what is told of slots is of the mission before.
    is_new: bool,
    asked: Option<Instant>,
    /// Whether the robot was asked for its time last, and not for a slot's counters.
    asks_time: bool,
    /// Counters of a slot that the page is told of next.
    waiting: Option<(usize, Value)>,
    /// Whether lines of the log came that the page was not told of.
    has_lines: bool,
    /// When the page was told something last.
    told: Option<Instant>,
    /// When the trace told of a transition, if that was just now.
    moved: Option<Instant>,
    /// How far the recording was.
    recorded: Option<u64>,
    timed: Option<Timed>,
}

/// When a mission began, by the clock of this computer: what the last answers say.
struct Timed {
    mission: u32,
    /// How long each answer took, and when the mission began by it.
    answers: VecDeque<(Duration, Instant)>,
}

impl Timed {
    fn hear(&mut self, took: Duration, began: Instant) {
        self.answers.push_back((took, began));
        if self.answers.len() > MOST_ANSWERS {
            self.answers.pop_front();
        }
    }

    /// An answer names the start of a macro step, which may be a period ago: so the earliest
    /// beginning is the best, of those answers that came as quickly as any.
    fn began(&self) -> Option<Instant> {
        let shortest = self.answers.iter().map(|(took, _)| *took).min()?;
        let quick = (self.answers.iter()).filter(|(took, _)| *took <= shortest * 3 / 2);
        quick.map(|(_, began)| *began).min()
    }
}

impl Turn {
    fn make(
        &mut self,
        robot: &mut Robot,
        recording: &mut LiveRecording<Out>,
        mut log: Option<&mut LogReader>,
        (out, told): (&Out, &Shared),
    ) -> Result<(), LiveError> {
        robot.attend(LISTEN_TIME)?;
        let mut notes = Vec::new();
        let mut lines = Vec::new();
        for event in robot.take_events() {
            if let StreamEvent::Trace(records) = &event {
                self.steps.take(records);
            }
            if let StreamEvent::Gap { .. } = &event {
                self.steps.made = None;
            }
            if let Some(log) = log.as_deref_mut() {
                lines.extend(heard(log, &event));
            }
            notes.extend(recording.take(robot, &event)?);
        }
        if !lines.is_empty() {
            // They go along with what is told next.
            told.change(|told| lines.into_iter().for_each(|line| told.say(line)));
            self.has_lines = true;
        }
        recording.look_after(robot)?;
        notes.extend(recording.look_after_values(robot)?);
        recording.flush()?;
        let beginnings = recording.counts().beginnings;
        if std::mem::replace(&mut self.beginnings, beginnings) != beginnings {
            // What the trace said may be of the mission before.
            self.steps.made = None;
        }
        let steps = self.steps.made.filter(|made| {
            let next = recording.next_step();
            next.is_some_and(|next| *made >= next)
        });
        let (mut counted, mut began) = (None, None);
        if self.is_to_ask(robot) {
            self.asks_time = !self.asks_time;
            match self.asks_time {
                true => began = self.time_mission(robot)?,
                false => counted = self.count_slots(robot, recording)?,
            }
        }
        let clock = robot.clock();
        if std::mem::take(&mut self.steps.is_moved) {
            self.moved = Some(clock.now());
        } else if self
            .moved
            .is_some_and(|moved| clock.since(moved) >= QUIET_TIME)
        {
            self.moved = None;
        }
        let recorded = recording.next_step();
        let has_records = std::mem::replace(&mut self.recorded, recorded) != recorded;
        // What the trace tells of may come a moment later in the recording, which says why.
        let is_moved = match self.moved {
            Some(moved) => has_records || self.told.is_none_or(|told| told < moved),
            None => false,
        };
        let is_quiet = !is_moved && notes.is_empty();
        if is_quiet && (self.told).is_some_and(|told| clock.since(told) < QUIET_TIME) {
            self.waiting = counted.or(self.waiting.take());
            told.change(|told| told.began = began.or(told.began));
            return Ok(());
        }
        self.told = Some(clock.now());
        let counted = counted.or(self.waiting.take());
        let bytes = out.take();
        told.change(|told| {
            let has_lines = std::mem::take(&mut self.has_lines);
            let is_same = bytes.is_empty() && notes.is_empty() && counted.is_none();
            if is_same && told.steps == steps && !has_lines {
                return;
            }
            told.version += 1;
            told.steps = steps;
            told.began = began.or(told.began);
            if told.bytes.len() + bytes.len() <= MOST_BYTES {
                told.bytes.extend(bytes);
            } else if told.error.is_none() {
                told.error = Some(
                    "the page has been told so much that it takes no more: start the command anew"
                        .to_owned(),
                );
            }
            told.notes.extend(notes.iter().map(words_of));
            let first = told.notes.len().saturating_sub(MOST_NOTES);
            told.notes.drain(..first);
            if let Some((place, slot)) = counted {
                if std::mem::take(&mut self.is_new) {
                    told.slots.clear();
                }
                match told.slots.get_mut(place) {
                    Some(entry) => *entry = slot,
                    None => told.slots.push(slot),
                }
            }
        });
        Ok(())
    }

    /// Whether it is time to ask the robot for what it does not stream.
    fn is_to_ask(&mut self, robot: &Robot) -> bool {
        let clock = robot.clock();
        let is_due = |asked| clock.since(asked) >= COUNTERS_TIME;
        if self.asked.is_none_or(is_due) {
            self.asked = Some(clock.now());
            return true;
        }
        false
    }

    /// Asks the robot how old its mission is. Answers when it began by the clock of this computer,
    /// where that is known better than before.
    fn time_mission(&mut self, robot: &mut Robot) -> Result<Option<Instant>, LiveError> {
        let clock = robot.clock().clone();
        let asked = clock.now();
        let status = robot.status()?;
        let took = clock.since(asked);
        let Some(mission) = status.mission else {
            return Ok(None);
        };
        let Some(began) = (asked + took / 2).checked_sub(Duration::from_micros(status.t_us)) else {
            return Ok(None);
        };
        if self
            .timed
            .as_ref()
            .is_none_or(|timed| timed.mission != mission)
        {
            let answers = VecDeque::new();
            self.timed = Some(Timed { mission, answers });
        }
        let timed = self.timed.as_mut();
        Ok(timed.and_then(|timed| {
            timed.hear(took, began);
            timed.began()
        }))
    }

    /// Asks for the counters of one slot.
    fn count_slots(
        &mut self,
        robot: &mut Robot,
        recording: &LiveRecording<Out>,
    ) -> Result<Option<(usize, Value)>, LiveError> {
        let Some((mission, blob)) = recording.running() else {
            return Ok(None);
        };
        if self.slots.is_none_or(|(known, _, _)| known != mission) {
            let count = esm_core::verify(blob).map_or(0, |blob| blob.tables().slots().len());
            self.slots = Some((mission, u8::try_from(count).unwrap_or(u8::MAX), 0));
            self.is_new = true;
        }
        let Some((_, count, next)) = &mut self.slots else {
            return Ok(None);
        };
        if *count == 0 {
            return Ok(None);
        }
        let place = *next % *count;
        *next = (place + 1) % *count;
        let counted = match robot.slot_counters(place) {
            Ok(counted) => counted,
            // Another mission runs by now, or none.
            Err(error) if error.refusal().is_some() => return Ok(None),
            Err(error) => return Err(error.into()),
        };
        let mean_ns = counted.total_execution_ns / u64::from(counted.executed.max(1));
        let duration_us = esm_core::verify(blob)
            .ok()
            .and_then(|blob| blob.tables().slot(place.into()))
            .map_or(1, |slot| slot.duration_us.max(1));
        let slot = json!({
            "number": counted.number,
            "executed": counted.executed,
            "missed": counted.missed,
            "overruns": counted.overruns,
            "load": mean_ns as f64 / 1e3 / f64::from(duration_us),
            "delay_us": f64::from(counted.max_delay_ns) / 1e3,
        });
        Ok(Some((place.into(), slot)))
    }
}

/// What reads the log of a robot on that board; or why it is not shown.
///
/// # Errors
/// The file that was named is no firmware with a log, or the robot is lost.
fn log_of(
    robot: &mut Robot,
    board: &str,
    firmware: Option<&Path>,
) -> Result<(Option<LogReader>, Option<String>), CommandError> {
    let not_shown = |why: &str| (None, Some(format!("the robot's log is not shown: {why}")));
    match robot.require(Feature::Log) {
        Err(ClientError::NotBuiltIn { feature }) => return Ok(not_shown(without(feature))),
        required => required?,
    }
    if board == host_board::BOARD {
        return Ok((Some(LogReader::text()), None));
    }
    let Some(path) = firmware else {
        return Ok(not_shown("name the firmware that it runs with --firmware"));
    };
    let reader = LogReader::firmware(path).map_err(|error| CommandError::World(error.into()))?;
    Ok((Some(reader), None))
}

/// What an event of the streams says in the log.
fn heard(log: &mut LogReader, event: &StreamEvent) -> Vec<String> {
    match event {
        StreamEvent::Log(bytes) => {
            let mut lines: Vec<String> = (log.lines(bytes).iter())
                .map(|line| line.words().to_string())
                .collect();
            match log.take_unreadable() {
                0 => {}
                unreadable => lines.push(format!("{unreadable} lines of the log cannot be read")),
            }
            lines
        }
        StreamEvent::Gap {
            channel: Channel::Log,
            missing,
        } => {
            log.gap();
            vec![format!("{missing} pieces of the log lost")]
        }
        StreamEvent::LinesLost(lines) => vec![format!("{lines} lines of the log lost")],
        _ => Vec::new(),
    }
}

fn words_of(noted: &Noted) -> String {
    match noted {
        Noted::Gap(missing) => format!("{missing} records or parts did not come"),
        Noted::DeadlineMiss(hash) => format!(
            "the mission {} ran for too short a time to be read",
            hash_text(*hash)
        ),
        Noted::NoValues(why) => why.clone(),
    }
}

fn failed(error: LiveError) -> CommandError {
    match error {
        LiveError::Client(error) => error.into(),
        LiveError::File(cause) => CommandError::World(cause.into()),
        LiveError::BadMission { .. } | LiveError::NoNames { .. } => {
            CommandError::Input(error.into())
        }
    }
}

#[cfg(test)]
mod tests {
    use esm_link::trace::RecordSink;

    use super::*;

    #[test]
    fn a_mission_began_when_the_earliest_quick_answer_says() {
        let ms = Duration::from_millis;
        let start = Instant::now() + ms(1000);
        let mut timed = Timed {
            mission: 7,
            answers: VecDeque::new(),
        };
        assert_eq!(timed.began(), None);
        let mut hear = |took, late| {
            timed.hear(ms(took), start + ms(late));
            timed.began().unwrap()
        };
        assert_eq!(hear(20, 115), start + ms(115));
        assert_eq!(hear(18, 95), start + ms(95));
        assert_eq!(hear(22, 110), start + ms(95));
        // What took long says nothing.
        assert_eq!(hear(200, 10), start + ms(95));
        // After a while the last ones count: it is a second later by the robot's clock.
        for _ in 0..MOST_ANSWERS - 1 {
            hear(20, 1100);
        }
        assert_eq!(hear(20, 1107), start + ms(1100));
    }

    #[test]
    fn a_transition_is_told_of_once_its_macro_step_has_ended() {
        #[derive(Default)]
        struct Bytes(Vec<u8>);
        impl RecordSink for Bytes {
            fn put(&mut self, byte: u8) {
                self.0.push(byte);
            }
        }
        let written = |event: TraceEvent<'_>| {
            let mut bytes = Bytes::default();
            event.write(&mut bytes);
            bytes.0
        };
        let transition = written(TraceEvent::Transition {
            micro: 0,
            region_instance: 1,
            transition: 2,
        });
        let same = written(TraceEvent::Same { micro_steps: 1 });
        let mut steps = Steps {
            made: Some(4),
            ..Steps::default()
        };
        steps.take(&same);
        assert_eq!((steps.made, steps.is_moved), (Some(5), false));
        steps.take(&transition);
        assert_eq!((steps.made, steps.is_moved), (Some(5), false));
        steps.take(&same);
        assert_eq!((steps.made, steps.is_moved), (Some(6), true));
    }

    fn head(answer: &[u8]) -> (Value, &[u8]) {
        let (length, rest) = answer.split_first_chunk().unwrap();
        let (head, bytes) = rest.split_at(u32::from_le_bytes(*length) as usize);
        (serde_json::from_slice(head).unwrap(), bytes)
    }

    #[test]
    fn a_page_is_told_what_it_lacks_and_nothing_where_nothing_is_new() {
        let shared = Shared::default();
        shared.change(|told| {
            told.version = 3;
            told.bytes = b"abcdef".to_vec();
            told.steps = Some(7);
        });
        let answer = shared.answer("from=4&seen=2", false).unwrap();
        let (told, bytes) = head(&answer);
        assert_eq!(
            (&told["from"], &told["seen"], &told["steps"]),
            (&json!(4), &json!("3"), &json!(7))
        );
        assert_eq!(bytes, b"ef");
        assert_eq!(shared.answer("from=6&seen=3", false), None);
        assert!(shared.answer("from=6&seen=3", true).is_some());
        // What makes no sense is the beginning.
        for query in [
            "",
            "from",
            "from=x&seen=y",
            "from=-1",
            "seen=99999999999999999999",
        ] {
            let answer = shared.answer(query, false).unwrap();
            assert_eq!(head(&answer).1, b"abcdef", "{query}");
        }
        // No page has more than there is.
        let answer = shared.answer("from=99&seen=0", false).unwrap();
        let (told, bytes) = head(&answer);
        assert_eq!((&told["from"], bytes), (&json!(6), &b""[..]));
    }
}
