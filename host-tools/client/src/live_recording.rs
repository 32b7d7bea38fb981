//! A recording of a robot at the other end of a line: one that runs already, changes its mission,
//! falls silent or is reset, over a line that loses some of what it says.

use std::collections::HashMap;
use std::io::{self, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use esm_core::Verified;
use esm_link::message::{Channel, LinkError, Mode};
use esm_link::recording::MAX_QUIET;
use thiserror::Error;

use crate::link_client::{ClientError, LinkClient, RobotInfo, StreamEvent, Streams};
use crate::run::mission::{Mission, hash_text};
use crate::serial::ByteLink;
use crate::serial::clock::Clock;
use crate::values::Subscription;
use esm_toolkit::inspect;
use esm_toolkit::recording::file::Header;
use esm_toolkit::recording::writer::{Counts, RecordingWriter};
use esm_toolkit::trace::directory::NoDirectory;

/// After how much silence the robot is asked how far it is. One whose machine just has nothing to
/// tell is left alone; any other is asked for all that its machine is, and one that was reset so
/// hears that it is to go on.
const SILENCE: Duration = Duration::from_secs(5);

/// So much is lost at most if this program is killed, and macro steps before which nothing entered.
const FLUSH_TIME: Duration = Duration::from_secs(1);

/// How long what was asked for may take before it is asked for again.
const FIRST_WAIT: Duration = Duration::from_millis(200);

/// After how long without a sample, and three periods, the robot is asked for values again.
const FORGOTTEN: Duration = Duration::from_secs(5);

/// How long the last records may take at the end.
const LONGEST_END: Duration = Duration::from_secs(2);

/// How long a wait for the next words may last at the end.
const LISTEN_TIME: Duration = Duration::from_millis(20);

/// Keeps what enters a robot's interpreter, as it comes over the link.
pub struct LiveRecording<W> {
    writer: RecordingWriter<W>,
    /// What is wanted of the robot, the recording among it.
    streams: Streams,
    /// By which it waits: the line's.
    clock: Clock,
    /// When what came was last written.
    flushed: Instant,
    /// When the recording last brought something, or was asked for.
    heard: Instant,
    /// What was asked for and has not come yet.
    asked: Option<Asked>,
    /// Corrupt frames of the line that are known of.
    bad_frames: u64,
    /// Missions that ran, and ended before they could be read.
    missed: Vec<u32>,
    /// Blobs of the missions in the recording, by their hashes.
    blobs: HashMap<u32, Vec<u8>>,
    /// Which values are kept, if any are.
    values: Option<KeptValues>,
}

/// Which values a recording keeps.
struct KeptValues {
    /// The mission's time from one sample to the next.
    period: Duration,
    /// What the robot was asked for, of the mission of this hash; none where it has no values to
    /// tell of.
    asked: Option<(u32, Option<Subscription>)>,
    /// When a sample last came, or they were asked for.
    heard: Instant,
}

impl KeptValues {
    /// Whether the robot is to be asked for those of this mission: it was not yet, or it was reset
    /// since and has forgotten.
    fn is_due(&self, mission: u32, clock: &Clock) -> bool {
        let silence = FORGOTTEN.max(self.period * 3);
        match &self.asked {
            Some((asked, subscription)) if *asked == mission => {
                subscription.is_some() && clock.since(self.heard) > silence
            }
            _ => true,
        }
    }
}

/// All that the machine is was asked for.
struct Asked {
    at: Instant,
    /// How long it may take. What a bad line loses is asked for soon; a machine that stands still
    /// tells nothing.
    wait: Duration,
    /// Beginnings that were there before.
    beginnings: u64,
}

/// Something that whoever records should know of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Noted {
    /// So many records or parts did not come. The recording goes on with all that the machine is.
    Gap(u32),
    /// A mission ran and was another before it could be read: what it did cannot be replayed.
    DeadlineMiss(u32),
    /// The values of a mission are not kept, or not all of them, and why.
    NoValues(String),
}

/// Why a recording ends before anybody wanted that.
#[derive(Debug, Error)]
pub enum LiveError {
    /// The line, or the robot.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The file.
    #[error("cannot write the recording: {0}")]
    File(#[from] io::Error),
    /// The mission on the robot is none.
    #[error("the robot's mission {} is not valid: {refusal:?}", hash_text(*hash))]
    BadMission {
        /// Its hash.
        hash: u32,
        /// Why not.
        refusal: esm_core::Refusal,
    },
    /// What the mission does cannot be told.
    #[error("the robot's mission {} cannot be replayed: {cause}", hash_text(*hash))]
    NoNames {
        /// Its hash.
        hash: u32,
        /// Why not.
        cause: NoDirectory,
    },
}

impl<W: Write> LiveRecording<W> {
    /// Lets a robot send `streams` and a recording, which begins with all that its machine is now.
    /// `out` gives the file, and is called where the robot does not refuse. Missions that are
    /// `known` need not be read from the robot.
    ///
    /// # Errors
    /// [`LiveError`]; refused with [`LinkError::NotBuiltIn`] by a firmware that cannot record.
    pub fn begin<L: ByteLink, E: From<LiveError>>(
        robot: &mut LinkClient<L>,
        info: &RobotInfo,
        streams: Streams,
        known: &[&Mission],
        out: impl FnOnce() -> Result<W, E>,
    ) -> Result<Self, E> {
        Self::begin_as(robot, info, streams, (known, false), out)
    }

    /// The same, of a recording that keeps all that comes, for whoever looks at guards while the
    /// robot runs.
    ///
    /// # Errors
    /// As [`LiveRecording::begin`].
    pub fn begin_whole<L: ByteLink>(
        robot: &mut LinkClient<L>,
        info: &RobotInfo,
        streams: Streams,
        out: W,
    ) -> Result<Self, LiveError> {
        Self::begin_as(robot, info, streams, (&[], true), || {
            Ok::<W, LiveError>(out)
        })
    }

    fn begin_as<L: ByteLink, E: From<LiveError>>(
        robot: &mut LinkClient<L>,
        info: &RobotInfo,
        streams: Streams,
        (known, keeps_all): (&[&Mission], bool),
        out: impl FnOnce() -> Result<W, E>,
    ) -> Result<Self, E> {
        let streams = Streams {
            record: true,
            ..streams
        };
        robot.subscribe(streams).map_err(LiveError::from)?;
        let head = Header {
            board: info.board.clone(),
            firmware: info.firmware.clone(),
            program: concat!("esm ", env!("CARGO_PKG_VERSION")).to_owned(),
            seed: None,
        };
        let mut writer = RecordingWriter::new(out()?, head, None).map_err(LiveError::from)?;
        if keeps_all {
            writer.keep_all();
        }
        for mission in known {
            add(&mut writer, mission).map_err(LiveError::from)?;
        }
        let clock = robot.clock().clone();
        let mut recording = LiveRecording {
            writer,
            streams,
            flushed: clock.now(),
            heard: clock.now(),
            clock,
            asked: None,
            bad_frames: robot.counts().bad_frames,
            missed: Vec::new(),
            blobs: (known.iter())
                .map(|mission| (mission.hash, mission.blob.clone()))
                .collect(),
            values: None,
        };
        recording.read_mission(robot)?;
        recording.note_asked(FIRST_WAIT);
        Ok(recording)
    }

    /// Keeps the values on the nets of each mission that runs, too: a sample each `period` of its
    /// time at most.
    pub fn keep_values(&mut self, period: Duration) {
        self.values = Some(KeptValues {
            period,
            asked: None,
            heard: self.clock.now(),
        });
    }

    /// Asks for the values of the mission that runs, where they are not known to come. To be called
    /// each time that events were looked for.
    ///
    /// # Errors
    /// [`LiveError`]
    pub fn look_after_values<L: ByteLink>(
        &mut self,
        robot: &mut LinkClient<L>,
    ) -> Result<Option<Noted>, LiveError> {
        let (Some(values), Some(running)) = (&mut self.values, self.writer.running()) else {
            return Ok(None);
        };
        if !values.is_due(running, &self.clock) {
            return Ok(None);
        }
        let Some(blob) = self.blobs.get(&running) else {
            return Ok(None);
        };
        values.heard = self.clock.now();
        let (subscription, noted) = match Subscription::of_kept(robot, blob, values.period) {
            Ok(Some(kept)) => {
                let left_out = kept.left_out();
                (Some(kept.subscription), left_out)
            }
            Ok(None) => (None, None),
            Err(error) => match error.of_line() {
                Ok(error) => return Err(error.into()),
                Err(answer) => (
                    None,
                    Some(format!("the recording is without values: {answer}")),
                ),
            },
        };
        let was_told = (values.asked.as_ref()).is_some_and(|(asked, _)| *asked == running);
        if let Some(subscription) = &subscription
            && !was_told
        {
            self.writer.nets(running, subscription.nets())?;
        }
        values.asked = Some((running, subscription));
        Ok(noted.filter(|_| !was_told).map(Noted::NoValues))
    }

    /// Takes an event of the robot's streams; those of others are passed over.
    ///
    /// # Errors
    /// [`LiveError`]
    pub fn take<L: ByteLink>(
        &mut self,
        robot: &mut LinkClient<L>,
        event: &StreamEvent,
    ) -> Result<Option<Noted>, LiveError> {
        match event {
            StreamEvent::Record(records) => {
                self.heard = self.clock.now();
                let Some(hash) = self.writer.records(records)? else {
                    return Ok(None);
                };
                // The next one may run by now.
                self.read_mission(robot)?;
                if self.writer.knows(hash) || self.missed.contains(&hash) {
                    return Ok(None);
                }
                self.missed.push(hash);
                Ok(Some(Noted::DeadlineMiss(hash)))
            }
            StreamEvent::Gap {
                channel: Channel::Record,
                missing,
            } => {
                self.writer.gap(*missing)?;
                self.ask_anew(robot, FIRST_WAIT)?;
                Ok(Some(Noted::Gap(*missing)))
            }
            StreamEvent::Values { .. } => {
                if let Some(values) = &mut self.values
                    && let Some((mission, Some(subscription))) = &values.asked
                    && let Some(sample) = subscription.raw(*mission, event)
                {
                    values.heard = self.clock.now();
                    self.writer.sample(sample)?;
                }
                Ok(None)
            }
            StreamEvent::Gap { .. }
            | StreamEvent::LinesLost(_)
            | StreamEvent::Trace(_)
            | StreamEvent::Log(_)
            | StreamEvent::ValuesEnded { .. }
            | StreamEvent::StatusEvent(_) => Ok(None),
        }
    }

    /// Asks for all that the machine is where something may be missing: a frame was corrupt, what
    /// was asked for did not come, or nothing came for long. Writes what came. To be called each
    /// time that events were looked for.
    ///
    /// # Errors
    /// [`LiveError`]
    pub fn look_after<L: ByteLink>(&mut self, robot: &mut LinkClient<L>) -> Result<(), LiveError> {
        if self.clock.since(self.flushed) >= FLUSH_TIME {
            self.writer.flush()?;
            self.flushed = self.clock.now();
        }
        let beginnings = self.counts().beginnings;
        let is_lost = self.writer.take_lost();
        let wait = match &self.asked {
            Some(asked) if asked.beginnings == beginnings && !is_lost => {
                if self.clock.since(asked.at) < asked.wait {
                    return Ok(());
                }
                (asked.wait * 2).min(SILENCE)
            }
            _ => {
                self.asked = None;
                let is_good = robot.counts().bad_frames == self.bad_frames && !is_lost;
                if is_good && self.clock.since(self.heard) < SILENCE {
                    return Ok(());
                }
                if is_good && self.has_nothing_to_tell(robot)? {
                    self.heard = self.clock.now();
                    return Ok(());
                }
                FIRST_WAIT
            }
        };
        self.ask_anew(robot, wait)
    }

    /// Whether the robot's machine runs, and is no further than it may be without a word.
    fn has_nothing_to_tell<L: ByteLink>(
        &self,
        robot: &mut LinkClient<L>,
    ) -> Result<bool, LiveError> {
        let status = robot.status()?;
        let ahead = (self.writer.next_step()).and_then(|next| status.steps.checked_sub(next));
        Ok(status.mode == Mode::Running
            && status.mission == self.writer.running()
            && ahead.is_some_and(|ahead| ahead <= MAX_QUIET.into()))
    }

    /// Writes all that came so far.
    ///
    /// # Errors
    /// [`LiveError::File`]
    pub fn flush(&mut self) -> Result<(), LiveError> {
        self.flushed = self.clock.now();
        Ok(self.writer.flush()?)
    }

    /// Hash and blob of the mission whose macro steps the recording goes on with, where it is
    /// there.
    pub fn running(&self) -> Option<(u32, &[u8])> {
        let hash = self.writer.running()?;
        Some((hash, self.blobs.get(&hash)?))
    }

    /// Number of the next macro step that the recording lacks of that mission.
    pub fn next_step(&self) -> Option<u64> {
        self.writer.next_step()
    }

    /// What it holds so far.
    pub fn counts(&self) -> Counts {
        self.writer.counts()
    }

    /// Lets the robot tell all that it has, asks once more what the machine is, so that a replay
    /// can be compared with it, and ends the streams. Whatever becomes of that, the file is whole;
    /// what went wrong comes with it.
    ///
    /// # Errors
    /// What the file has.
    pub fn finish<L: ByteLink>(
        mut self,
        robot: &mut LinkClient<L>,
    ) -> io::Result<(W, Counts, Option<LiveError>)> {
        let ended = self.take_last(robot);
        let steps = ended.as_ref().ok().copied().flatten();
        let (out, counts) = self.writer.finish(steps)?;
        Ok((out, counts, ended.err()))
    }

    /// Ends a recording of a robot that cannot be asked any more, with what came last.
    ///
    /// # Errors
    /// What the file has.
    pub fn break_off(mut self, last: &[StreamEvent]) -> io::Result<(W, Counts)> {
        for event in last {
            match event {
                StreamEvent::Record(records) => {
                    self.writer.records(records)?;
                }
                StreamEvent::Gap {
                    channel: Channel::Record,
                    missing,
                } => self.writer.gap(*missing)?,
                StreamEvent::Values { .. } => {
                    if let Some((mission, Some(subscription))) = self
                        .values
                        .as_ref()
                        .and_then(|values| values.asked.as_ref())
                        && let Some(sample) = subscription.raw(*mission, event)
                    {
                        self.writer.sample(sample)?;
                    }
                }
                _ => {}
            }
        }
        self.writer.finish(None)
    }

    /// Takes what is still to come; answers how many macro steps the mission of a robot has made
    /// that stands still.
    fn take_last<L: ByteLink>(
        &mut self,
        robot: &mut LinkClient<L>,
    ) -> Result<Option<u64>, LiveError> {
        let began = self.clock.now();
        let beginnings = self.counts().beginnings;
        let mut steps = None;
        // A machine that stands still tells nothing more but its status.
        if robot.status()?.mode == Mode::Running {
            self.ask_anew(robot, FIRST_WAIT)?;
        }
        while self.clock.since(began) < LONGEST_END {
            let status = robot.status()?;
            robot.listen(LISTEN_TIME)?;
            for event in robot.take_events() {
                self.take(robot, &event)?;
            }
            self.look_after(robot)?;
            let runs = status.mode == Mode::Running;
            let is_known = status.mission.is_some() && status.mission == self.writer.running();
            steps = (!runs && is_known).then_some(status.steps);
            if !status.record_pending && (!runs || self.counts().beginnings > beginnings) {
                break;
            }
        }
        if self.values.is_some() {
            robot.end_values()?;
        }
        robot.subscribe(Streams::NONE)?;
        Ok(steps)
    }

    fn ask_anew<L: ByteLink>(
        &mut self,
        robot: &mut LinkClient<L>,
        wait: Duration,
    ) -> Result<(), LiveError> {
        robot.subscribe(self.streams)?;
        self.bad_frames = robot.counts().bad_frames;
        self.note_asked(wait);
        Ok(())
    }

    fn note_asked(&mut self, wait: Duration) {
        self.heard = self.clock.now();
        self.asked = Some(Asked {
            at: self.heard,
            wait,
            beginnings: self.counts().beginnings,
        });
    }

    /// Adds a mission that the robot is about to be given, so that it need not be read from there.
    ///
    /// # Errors
    /// [`LiveError::File`]
    pub fn mission(&mut self, mission: &Mission) -> Result<(), LiveError> {
        self.blobs.insert(mission.hash, mission.blob.clone());
        Ok(add(&mut self.writer, mission)?)
    }

    /// Waits, for a while, until all is there that was asked for.
    ///
    /// # Errors
    /// [`LiveError`]
    pub fn settle<L: ByteLink>(&mut self, robot: &mut LinkClient<L>) -> Result<(), LiveError> {
        let began = self.clock.now();
        loop {
            for event in robot.take_events() {
                self.take(robot, &event)?;
            }
            self.look_after(robot)?;
            if self.asked.is_none() || self.clock.since(began) >= LONGEST_END {
                return Ok(());
            }
            robot.listen(LISTEN_TIME)?;
        }
    }

    /// Adds the mission that runs, if one does and it is not in the recording.
    fn read_mission<L: ByteLink>(&mut self, robot: &mut LinkClient<L>) -> Result<(), LiveError> {
        if (robot.status()?.mission).is_none_or(|hash| self.writer.knows(hash)) {
            return Ok(());
        }
        let blob = match robot.running_blob() {
            Ok(blob) => blob,
            Err(error) if error.refusal() == Some(LinkError::NoMission) => return Ok(()),
            Err(error) => return Err(error.into()),
        };
        let verified = esm_core::verify(blob).map_err(|(blob, refusal)| {
            let hash = blob
                .split_last_chunk()
                .map_or(0, |(_, hash)| u32::from_le_bytes(*hash));
            LiveError::BadMission { hash, refusal }
        })?;
        self.blobs
            .insert(verified.hash(), verified.bytes().to_vec());
        Ok(add(&mut self.writer, &mission_of(verified)?)?)
    }
}

/// A mission that was read from a robot, by the name of its machine.
///
/// # Errors
/// [`LiveError::NoNames`]
pub fn mission_of(verified: Verified<Vec<u8>>) -> Result<Mission, LiveError> {
    let hash = verified.hash();
    let name = inspect::Report::of(&verified).machine;
    let mission = Mission::new(Path::new(&name), verified);
    let mission = mission.map_err(|cause| LiveError::NoNames { hash, cause })?;
    // It need not look like a path.
    Ok(Mission { name, ..mission })
}

fn add<W: Write>(writer: &mut RecordingWriter<W>, mission: &Mission) -> io::Result<()> {
    let period_us = mission.directory.interpreter_period_us();
    writer.mission(&mission.name, mission.hash, &mission.blob, period_us)
}
