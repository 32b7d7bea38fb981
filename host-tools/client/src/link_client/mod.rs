//! The host's end of the link to a robot: asks, uploads, listens.
//!
//! One request is open at a time. It has a number; if no answer comes in time it is sent again
//! under the same number, and the robot, which remembers its last answer, does nothing twice.
//! Between answers the robot sends streams, which are put together here and kept until
//! [`LinkClient::take_events`] fetches them. Whatever noise a line makes, a request either ends
//! with the robot's own answer to it, or with an error.

/// Whether this defect is planted. Only tests have defects to plant: each must make them fail.
#[cfg(test)]
macro_rules! mutant {
    ($bug:ident) => {
        crate::link_client::mutants::is_mutant(crate::link_client::mutants::Bug::$bug)
    };
}
#[cfg(not(test))]
macro_rules! mutant {
    ($bug:ident) => {
        false
    };
}

pub mod behaviours;
pub mod error;
mod log_frames;
pub mod log_lines;
mod loss;
#[cfg(test)]
mod mutants;
mod owner;
mod session;
mod signing;
mod timing;
mod upload;

use std::time::{Duration, Instant};

use esm_link::access::{
    Access, MAX_PROVEN_BYTES, MAX_SIGNED_BYTES, NO_UPLOAD, Needs, may_be_proven, needs,
};
use esm_link::black_box::{RECORD_BYTES, Record};
use esm_link::features::{Feature, Features};
use esm_link::frame::{self, DELIMITER, FrameReader, MAX_FRAME_BYTES};
use esm_link::message::{
    Capacities, Channel, CrashReport, DeviceInfo, FrameCounters, FromDevice, LinkError,
    PROTOCOL_VERSION, PROVEN_HEADER_BYTES, Request, ResetReason, Response, SlotCounters, Status,
    Swap, TaskCounters, ToDevice, Uploads, version_in_hello,
};
use esm_link::selftest::{Ask, Measures};

use crate::serial::ByteLink;
use crate::serial::clock::Clock;

pub use error::{ClientError, Flaw};
pub use esm_toolkit::streams::StreamEvent;
use esm_toolkit::streams::{Assembler, Waiting};
use esm_toolkit::values::{ask_for_fields, ask_for_values};
use session::{Answer, Expected, innermost_kind};
use signing::Signing;
pub use signing::{KeyLoader, RobotIdentity};
pub use timing::NOISY_DEADLINE;
use timing::{Allowance, Patience, REQUEST_DEADLINE, ReplyTime};

/// How long the robot may be busy with the request before.
const BUSY_WAIT: Duration = Duration::from_millis(5);

/// No robot looks at no signature for longer.
const LONGEST_PAUSE: Duration = Duration::from_secs(2);

/// How long an answer is waited for at least that takes the verification of a signature.
const VERIFICATION_WAIT: Duration = Duration::from_millis(500);

/// How long a reply is waited for when a corrupt frame came in its place.
const CORRUPT_WAIT: Duration = Duration::from_millis(10);

/// How long a wait may last before it is looked whether it is to end.
const STOP_LOOK: Duration = Duration::from_millis(100);

/// A robot hears of a host that looks after it as often as this at least. A mission that watches
/// for that warns after half a second where it says nothing else.
pub const CALL_INTERVAL: Duration = Duration::from_millis(200);

/// What stops a robot, and its name.
const STOP: (&str, Request<'static>) = ("stop", Request::Stop);
const EMERGENCY_STOP: (&str, Request<'static>) = ("emergency stop", Request::EmergencyStop);

/// What a mission's blob has at most, in bytes, whatever a robot says that it has room for: more
/// than any robot of this kind has flash.
const MAX_BLOB_BYTES: u32 = 256 * 1024;

/// What a task's declaration has at most, and what a type's fields have, as text, in bytes.
const MAX_TEXT_BYTES: u32 = 16 * 1024;

/// What a black box holds at most, in records: a MiB of flash.
const MAX_BLACK_BOX_RECORDS: usize = 1024 * 1024 / RECORD_BYTES;

/// Those of a robot that has not said any.
const NO_CAPACITIES: Capacities = Capacities {
    blob_bytes: 0,
    arena_words: 0,
    slots: 0,
    task_instances: 0,
    nets: 0,
    exclusive_groups: 0,
};

/// Bytes taken from the line at once.
const READ_BYTES: usize = 1024;

/// What a robot says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RobotInfo {
    /// Name and version of the firmware.
    pub firmware: String,
    /// Name of the board.
    pub board: String,
    /// Number of task types in the firmware's registry.
    pub task_types: u8,
    /// What a mission may use.
    pub capacities: Capacities,
    /// Hash of the mission that runs, if one does.
    pub mission: Option<u32>,
    /// Why the robot started the last time.
    pub reset: ResetReason,
    /// How it takes uploads.
    pub uploads: Uploads,
    /// Whether it has a key.
    pub access: Access,
}

/// What a robot says of its firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BuiltIn {
    /// What it was built with.
    pub features: Features,
    /// So much longer than others a request may take that lets the robot write its flash.
    pub flash_time: Duration,
}

impl BuiltIn {
    /// Of a firmware that does not say it: the robot itself refuses what it lacks.
    const UNTOLD: BuiltIn = BuiltIn {
        features: Features(u32::MAX),
        flash_time: Duration::ZERO,
    };

    /// Features that the firmware was built without.
    pub fn left_out(&self) -> Vec<Feature> {
        Feature::ALL
            .into_iter()
            .filter(|feature| !self.features.has(*feature))
            .collect()
    }
}

/// A mission that has taken over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Committed {
    /// Its hash.
    pub mission: u32,
    /// Active regions that went on as they were.
    pub carried: u16,
}

/// A parameter of the mission that runs, by the bits of its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParamBits {
    /// The value that it has now.
    pub value: u32,
    /// The value that the mission gives it.
    pub of_mission: u32,
    /// The value that was saved for it.
    pub saved: Option<u32>,
}

/// What is current on a robot.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CurrentStates {
    /// Macro steps that were begun when this was read.
    pub step: u64,
    /// Current local state of each region instance, in the blob's numbers.
    pub states: Vec<u16>,
}

/// Streams that a robot is to send.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Streams {
    /// Trace records.
    pub trace: bool,
    /// Bytes of the log.
    pub log: bool,
    /// What enters the interpreter, from the mission's beginning or with all that it is now. Asked
    /// for once more, it begins anew with the latter.
    pub record: bool,
}

impl Streams {
    /// No stream.
    pub const NONE: Streams = Streams {
        trace: false,
        log: false,
        record: false,
    };
}

/// What a link has seen so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCounts {
    /// Requests that had to be sent again.
    pub retries: u64,
    /// Frames from the robot that were corrupt.
    pub bad_frames: u64,
    /// Bytes sent.
    pub bytes_sent: u64,
}

/// A session with a robot.
pub struct LinkClient<L> {
    link: L,
    /// By which everything here waits.
    clock: Clock,
    incoming: Incoming,
    seq: u8,
    reply_time: ReplyTime,
    counts: LinkCounts,
    /// When something was sent last.
    sent: Instant,
    /// What the robot said of uploads.
    uploads: Uploads,
    /// What it said that a mission may use.
    capacities: Capacities,
    /// How long all requests together may wait.
    allowance: Allowance,
    /// What it said of its firmware, once it was asked.
    built_in: Option<BuiltIn>,
    /// Whether whoever waits for an answer has had enough.
    stop: Option<Box<dyn Fn() -> bool + Send>>,
    /// Whether nothing is to be waited for any more, be it the last thing that is asked.
    end: Option<Box<dyn Fn() -> bool + Send>>,
    signing: Signing,
    /// What lets the robot hear that somebody is here, until it is answered.
    calling: Option<Frame>,
}

/// A request as it goes over the line, behind a delimiter, and what its answer must be.
struct Frame {
    seq: u8,
    wire: [u8; MAX_FRAME_BYTES + 1],
    length: usize,
    expected: Expected,
}

impl Frame {
    fn wire(&self) -> &[u8] {
        self.wire.get(..self.length).unwrap_or_default()
    }
}

/// Whether the bytes of a blob are those that it ends with the checksum of.
fn has_its_checksum(blob: &[u8]) -> bool {
    blob.split_last_chunk()
        .is_some_and(|(bytes, crc)| frame::checksum(bytes) == u32::from_le_bytes(*crc))
}

impl<L: ByteLink> LinkClient<L> {
    /// Begins a session: the robot forgets what it last answered, and ends its streams.
    ///
    /// # Errors
    /// [`ClientError`]: the robot does not answer, or does not speak as this program does.
    pub fn connect(link: L) -> Result<(Self, RobotInfo), ClientError> {
        Self::connect_within(link, None, None)
    }

    /// The same, with an end to all waiting of the session ([`LinkClient::limit_waits`]), and to
    /// all at once ([`LinkClient::stop_when`]).
    ///
    /// # Errors
    /// [`ClientError`]: the robot does not answer, or does not speak as this program does.
    pub fn connect_within(
        link: L,
        limit: Option<Duration>,
        stop: Option<Box<dyn Fn() -> bool + Send>>,
    ) -> Result<(Self, RobotInfo), ClientError> {
        let mut client = Self::new(link, limit, stop);
        let info = client.hello()?;
        Ok((client, info))
    }

    /// Begins a session with a stop, which does not wait for any answer, or with an emergency stop.
    /// Whether the robot has stopped is to be asked.
    ///
    /// # Errors
    /// [`ClientError`], as of [`LinkClient::connect`]
    pub fn connect_to_stop(
        link: L,
        is_emergency: bool,
        limit: Option<Duration>,
        stop: Option<Box<dyn Fn() -> bool + Send>>,
    ) -> Result<(Self, RobotInfo), ClientError> {
        let mut client = Self::new(link, limit, stop);
        let (name, request) = if is_emergency { EMERGENCY_STOP } else { STOP };
        let stop = client.frame(name, request, Expected::Plain)?;
        client.send_wire(stop.wire())?;
        let info = client.hello()?;
        Ok((client, info))
    }

    fn new(link: L, limit: Option<Duration>, stop: Option<Box<dyn Fn() -> bool + Send>>) -> Self {
        let clock = link.clock();
        LinkClient {
            link,
            incoming: Incoming::new(),
            // Not the number that the client before began with: its answers may still be on the
            // line. A simulated one has but this client.
            seq: if clock.is_simulated() {
                0
            } else {
                std::process::id() as u8
            },
            sent: clock.now(),
            allowance: Allowance::new(limit, clock.now()),
            clock,
            reply_time: ReplyTime::default(),
            counts: LinkCounts::default(),
            // Until the robot has said more.
            uploads: Uploads {
                chunk_bytes: 1,
                window_bytes: 1,
            },
            capacities: NO_CAPACITIES,
            built_in: None,
            stop,
            end: None,
            signing: Signing::default(),
            calling: None,
        }
    }

    /// Asks the robot who it is. Ends its streams, as at the beginning of a session, and forgets
    /// what they brought.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn hello(&mut self) -> Result<RobotInfo, ClientError> {
        self.incoming.end_streams();
        let (protocol, info) = self.ask("hello", Request::Hello, |response| match response {
            Response::Hello(info) => Some((info.protocol, RobotInfo::from(info))),
            _ => None,
        })?;
        if protocol != PROTOCOL_VERSION && !mutant!(OtherVersionAsked) {
            return Err(ClientError::OtherVersion { robot: protocol });
        }
        self.uploads = info.uploads;
        self.capacities = info.capacities;
        // It may have another firmware than before.
        self.built_in = None;
        self.signing.told(info.access);
        Ok(info)
    }

    /// What the robot's firmware was built with. It is asked once a session.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn built_in(&mut self) -> Result<BuiltIn, ClientError> {
        if let Some(known) = self.built_in {
            return Ok(known);
        }
        let name = "features";
        let mut patience = Patience::new(self.clock.now());
        let mut read = |response: Response<'_>| match response {
            Response::Features { built_in, flash_ms } => Some(BuiltIn {
                features: built_in,
                flash_time: Duration::from_millis(flash_ms.into()),
            }),
            _ => None,
        };
        // A firmware of before there was this request does not understand it, however often it is
        // sent; noise comes once.
        let mut built_in = BuiltIn::UNTOLD;
        for _ in 0..2 {
            let request = Request::Features;
            match self.exchange(name, request, Duration::ZERO, &mut patience, &mut read)? {
                Ok(Some(told)) => {
                    built_in = told;
                    break;
                }
                Ok(None) => return Err(ClientError::BadAnswer { request: name }),
                Err(LinkError::Malformed) => {}
                Err(error) => {
                    return Err(ClientError::Refused {
                        request: name,
                        error,
                    });
                }
            }
        }
        self.built_in = Some(built_in);
        Ok(built_in)
    }

    /// Fails where the robot's firmware was built without this, before anything is asked for that
    /// needs it.
    ///
    /// # Errors
    /// [`ClientError::NotBuiltIn`], and what else [`ClientError`] knows.
    pub fn require(&mut self, feature: Feature) -> Result<(), ClientError> {
        if self.built_in()?.features.has(feature) {
            Ok(())
        } else {
            Err(ClientError::NotBuiltIn { feature })
        }
    }

    /// How the robot is.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn status(&mut self) -> Result<Status, ClientError> {
        self.ask("status", Request::Status, |response| match response {
            Response::Status(status) => Some(status),
            _ => None,
        })
    }

    /// Microseconds since the robot started, by its own clock.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn robot_us(&mut self) -> Result<u64, ClientError> {
        self.ask("clock", Request::Clock, |response| match response {
            Response::Clock { now_us } => Some(now_us),
            _ => None,
        })
    }

    /// What the board has measured of itself.
    ///
    /// # Errors
    /// [`ClientError`]; refused with [`LinkError::NotBuiltIn`] by a firmware without `selftest`.
    pub fn measures(&mut self) -> Result<Measures, ClientError> {
        let (ask, length) = Ask::Measures.bytes();
        let ask = &ask[..length];
        self.ask(
            "measures",
            Request::Selftest { ask },
            |response| match response {
                Response::TaskText { text, .. } => Measures::of(text),
                _ => None,
            },
        )
    }

    /// Lets the robot's end of the line have another rate for so long, which is
    /// [`MAX_RATE_MS`](esm_link::selftest::MAX_RATE_MS) at most, and then its own again.
    ///
    /// # Errors
    /// [`ClientError`]; refused with [`LinkError::NotBuiltIn`] where it cannot have that rate.
    pub fn try_rate(&mut self, baud: u32, time: Duration) -> Result<(), ClientError> {
        let ms = u32::try_from(time.as_millis()).unwrap_or(u32::MAX);
        let (ask, length) = Ask::LineRate { baud, ms }.bytes();
        let ask = &ask[..length];
        self.ask_to_do("another rate", Request::Selftest { ask })
    }

    /// Gives this end of the line another rate.
    ///
    /// # Errors
    /// What the system says.
    pub fn set_rate(&mut self, baud: u32) -> std::io::Result<()> {
        self.link.set_rate(baud)
    }

    /// Motors off, latched until [`LinkClient::start`].
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn stop(&mut self) -> Result<(), ClientError> {
        self.ask_to_do(STOP.0, STOP.1)
    }

    /// Emergency stop: motors off, latched over missions and resets until [`LinkClient::release`].
    ///
    /// # Errors
    /// [`ClientError`]; with the refusal [`LinkError::StopNotStored`] the motors are off all the
    /// same.
    pub fn emergency_stop(&mut self) -> Result<(), ClientError> {
        self.ask_to_do(EMERGENCY_STOP.0, EMERGENCY_STOP.1)
    }

    /// Ends an emergency stop. The robot stands still until [`LinkClient::start`].
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn release(&mut self) -> Result<(), ClientError> {
        self.ask_to_do("release", Request::Release)
    }

    /// The mission starts anew.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn start(&mut self) -> Result<(), ClientError> {
        self.ask_to_do("start", Request::Start)
    }

    /// How the robot's run before this one ended, and where, if it was a panic.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn crash_report(&mut self) -> Result<(CrashReport, String), ClientError> {
        self.ask(
            "last words",
            Request::CrashReport,
            |response| match response {
                Response::CrashReport { words, file } => {
                    Some((words, String::from_utf8_lossy(file).into_owned()))
                }
                _ => None,
            },
        )
    }

    /// What the robot's black box holds, oldest first. Records of kinds that this program
    /// does not know are passed over.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn black_box(&mut self) -> Result<Vec<Record>, ClientError> {
        let name = "black box";
        let mut records: Vec<Record> = Vec::new();
        let mut from = None;
        // What is written while this reads is for the next time.
        let mut last = None;
        loop {
            let (end, part) = self.ask(name, Request::BlackBox { from }, |response| {
                let Response::BlackBox { end, records } = response else {
                    return None;
                };
                Some((end, records.to_vec()))
            })?;
            let end = *last.get_or_insert(end);
            let (whole, _) = part.as_chunks::<RECORD_BYTES>();
            let Some([first, second, third, fourth, ..]) = whole.last().copied() else {
                return Ok(records);
            };
            let is_before_end = |record: &Record| (record.sequence.wrapping_sub(end) as i32) < 0;
            records.extend(
                (whole.iter())
                    .filter_map(Record::from_bytes)
                    .filter(is_before_end),
            );
            let bad = |flaw| ClientError::BadParts {
                request: name,
                flaw,
            };
            if records.len() > MAX_BLACK_BOX_RECORDS {
                return Err(bad(Flaw::TooLong {
                    said: records.len() as u64,
                    most: MAX_BLACK_BOX_RECORDS as u64,
                    unit: "records",
                }));
            }
            let next = u32::from_le_bytes([first, second, third, fourth]).wrapping_add(1);
            if (next.wrapping_sub(end) as i32) >= 0 {
                return Ok(records);
            }
            // A robot that goes back would be asked forever.
            if from.is_some_and(|from| (next.wrapping_sub(from) as i32) <= 0) {
                return Err(bad(Flaw::GoesBack));
            }
            from = Some(next);
        }
    }

    /// Chooses the streams that the robot sends from now on.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn subscribe(&mut self, streams: Streams) -> Result<(), ClientError> {
        let Streams { trace, log, record } = streams;
        self.ask_to_do("subscribe", Request::Subscribe { trace, log, record })
    }

    /// Lets the robot tell how it is from now on whenever its mode, its mission or the trial of
    /// that changes, and each `period` of the mission's time but where that is 0; or, with `None`,
    /// no more.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn watch(&mut self, period: Option<Duration>) -> Result<(), ClientError> {
        let period_ms = period.map_or(0, |period| period.as_millis());
        let request = Request::Watch {
            news: period.is_some(),
            period_ms: u32::try_from(period_ms).unwrap_or(u32::MAX),
        };
        self.ask_to_do("watch", request)
    }

    /// What values on a net of the mission of this hash are made of, by the net's index in its
    /// blob: a line for each field, its name, a colon, its type.
    ///
    /// # Errors
    /// [`ClientError`]; refused with [`LinkError::OtherMission`] where another mission runs, with
    /// [`LinkError::NotBuiltIn`] by a firmware without telemetry.
    pub fn fields(&mut self, mission: u32, net: u16) -> Result<String, ClientError> {
        let name = "fields of a value";
        let bad = ClientError::BadAnswer { request: name };
        let mut parts = Parts::new(name, MAX_TEXT_BYTES);
        loop {
            let Ok(offset) = u16::try_from(parts.there()) else {
                return Err(bad);
            };
            let ask = ask_for_fields(mission, net, offset);
            let is_whole = self.ask(
                name,
                Request::Values { ask: &ask },
                |response| match response {
                    Response::TaskText { total, text } => Some(parts.take(total.into(), text)),
                    _ => None,
                },
            )??;
            if is_whole {
                return String::from_utf8(parts.bytes).map_err(|_| bad);
            }
        }
    }

    /// Lets the robot send values of these nets of the mission of this hash from now on, by their
    /// indices in its blob: each `period` of the mission's time at most, which is a minute at most,
    /// or after each macro step where that is 0. Answers the number that those samples have.
    ///
    /// # Errors
    /// [`ClientError`]; refused with [`LinkError::OtherMission`] where another mission runs, with
    /// [`LinkError::CapacityExceeded`] where there are more nets than the robot can tell of at a
    /// time, with [`LinkError::NotBuiltIn`] by a firmware without telemetry.
    pub fn values(
        &mut self,
        mission: u32,
        nets: &[u16],
        period: Duration,
    ) -> Result<u8, ClientError> {
        let period_ms = u16::try_from(period.as_millis()).unwrap_or(u16::MAX);
        let ask = ask_for_values(mission, period_ms, nets);
        self.ask_to_do("values", Request::Values { ask: &ask })?;
        Ok(self.seq)
    }

    /// Lets the robot send no more values.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn end_values(&mut self) -> Result<(), ClientError> {
        self.ask_to_do("values", Request::Values { ask: &[] })
    }

    /// What was counted of a slot; `slot` is its index in the running mission.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn slot_counters(&mut self, slot: u8) -> Result<SlotCounters, ClientError> {
        self.ask(
            "counters",
            Request::SlotCounters { slot },
            |response| match response {
                Response::Slot(counters) => Some(counters),
                _ => None,
            },
        )
    }

    /// What was counted of a frame of a link; `frame` is its index in the running mission.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn frame_counters(&mut self, frame: u16) -> Result<FrameCounters, ClientError> {
        self.ask(
            "counters",
            Request::FrameCounters { frame },
            |response| match response {
                Response::Frame(counters) => Some(counters),
                _ => None,
            },
        )
    }

    /// How a task state is, and what was counted of it; `task_instance` is its index in the running
    /// mission.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn task_counters(&mut self, task_instance: u16) -> Result<TaskCounters, ClientError> {
        self.ask(
            "counters",
            Request::TaskCounters { task_instance },
            |response| match response {
                Response::TaskInstance(counters) => Some(counters),
                _ => None,
            },
        )
    }

    /// The declaration of the firmware's task type number `index`, as `.esm` text.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn task_declaration(&mut self, index: u8) -> Result<String, ClientError> {
        let bytes = self.read_all("tasks", MAX_TEXT_BYTES, |offset| {
            let offset = u16::try_from(offset).ok()?;
            Some(Request::Task { index, offset })
        })?;
        String::from_utf8(bytes).map_err(|_| ClientError::BadAnswer { request: "tasks" })
    }

    /// The blob of the mission that runs, byte for byte.
    ///
    /// # Errors
    /// [`ClientError`]; refused with [`LinkError::NoMission`] where none runs.
    pub fn running_blob(&mut self) -> Result<Vec<u8>, ClientError> {
        // A robot that falls back while it is read gives parts of two missions, whose checksum is
        // that of neither.
        const READS: u32 = 5;
        let mut read = self.read_running_blob();
        for _ in 1..READS {
            let is_mixed = match &read {
                Err(ClientError::BadAnswer { .. }) => true,
                Err(ClientError::BadParts { flaw, .. }) => !matches!(flaw, Flaw::TooLong { .. }),
                _ => false,
            };
            if !is_mixed {
                break;
            }
            read = self.read_running_blob();
        }
        read
    }

    /// The same, read once.
    fn read_running_blob(&mut self) -> Result<Vec<u8>, ClientError> {
        const NAME: &str = "read the mission";
        let most = self.capacities.blob_bytes.min(MAX_BLOB_BYTES);
        let blob = self.read_all(NAME, most, |offset| {
            let offset = u32::try_from(offset).ok()?;
            Some(Request::ReadBlob { offset })
        })?;
        if has_its_checksum(&blob) || mutant!(MixedBlobTaken) {
            Ok(blob)
        } else {
            Err(ClientError::BadAnswer { request: NAME })
        }
    }

    /// The current states of the mission that runs, all of one macro step where the robot's pace
    /// allows that.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn current_states(&mut self) -> Result<CurrentStates, ClientError> {
        const READS: u32 = 5;
        let mut seen = CurrentStates::default();
        for _ in 0..READS {
            let (whole, states) = self.read_states()?;
            seen = states;
            if whole {
                break;
            }
        }
        Ok(seen)
    }

    /// Reads the states once; answers also whether all parts were of one macro step.
    fn read_states(&mut self) -> Result<(bool, CurrentStates), ClientError> {
        let request = "states";
        // A region has its state in half a word at least.
        let most = u64::from(self.capacities.arena_words) * 2;
        let bad = |flaw| ClientError::BadParts { request, flaw };
        let mut states = Vec::new();
        let mut first_step = None;
        let mut whole = true;
        loop {
            let first =
                u16::try_from(states.len()).map_err(|_| ClientError::BadAnswer { request })?;
            let (step, total, part) =
                self.ask(
                    request,
                    Request::States { first },
                    |response| match response {
                        Response::States {
                            step,
                            total,
                            states,
                        } => Some((step, total, states.to_vec())),
                        _ => None,
                    },
                )?;
            if u64::from(total) > most {
                return Err(bad(Flaw::TooLong {
                    said: total.into(),
                    most,
                    unit: "states",
                }));
            }
            whole &= *first_step.get_or_insert(step) == step;
            let (pairs, _) = part.as_chunks::<2>();
            states.extend(pairs.iter().map(|pair| u16::from_le_bytes(*pair)));
            let (there, total) = (states.len(), usize::from(total));
            if there >= total {
                return Ok((whole, CurrentStates { step, states }));
            }
            if pairs.is_empty() {
                return Err(bad(Flaw::NoEnd { there, total }));
            }
        }
    }

    /// Brings a mission to the robot and lets it take over between two macro steps, without a
    /// trial. `progress` is told the bytes that are there. Answers the mission's hash when it runs.
    ///
    /// # Errors
    /// [`ClientError`]; a refusal leaves the robot with the mission that it had.
    pub fn upload(
        &mut self,
        blob: &[u8],
        progress: &mut dyn FnMut(usize),
    ) -> Result<u32, ClientError> {
        self.stage(blob, progress)?;
        self.commit(Swap::default())
            .map(|committed| committed.mission)
    }

    /// Lets the mission that was brought take over. Answers when it runs.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn commit(&mut self, swap: Swap) -> Result<Committed, ClientError> {
        self.ask("commit", Request::Commit(swap), |response| match response {
            Response::Committed { mission, carried } => Some(Committed { mission, carried }),
            _ => None,
        })
    }

    /// The mission of this hash, which is on trial, is to stay.
    ///
    /// # Errors
    /// [`ClientError`]; refused with [`LinkError::NotOnTrial`] where another mission runs, or none
    /// is on trial.
    pub fn confirm(&mut self, mission: u32) -> Result<(), ClientError> {
        self.ask_to_do("confirm", Request::Confirm { mission })
    }

    /// Back to the mission before the one of this hash, which is on trial.
    ///
    /// # Errors
    /// [`ClientError`]; refused with [`LinkError::NotOnTrial`] where another mission runs, or none
    /// is on trial.
    pub fn fall_back(&mut self, mission: u32) -> Result<(), ClientError> {
        self.ask_to_do("fall back", Request::FallBack { mission })
    }

    /// The value of a parameter of the running mission, the one that the mission gives it, and the
    /// one that was saved, by their bits; `param` is its index in the blob.
    ///
    /// # Errors
    /// [`ClientError`]; refused with [`LinkError::OtherMission`] where another mission runs than
    /// the one of this hash.
    pub fn param(&mut self, mission: u32, param: u16) -> Result<ParamBits, ClientError> {
        let request = Request::Param { mission, param };
        self.ask("read the parameter", request, |response| match response {
            Response::Param {
                value,
                of_mission,
                saved,
            } => Some(ParamBits {
                value,
                of_mission,
                saved,
            }),
            _ => None,
        })
    }

    /// Gives a parameter of the running mission another value, by its bits, from the next macro
    /// step on. Answers the bits of the value before.
    ///
    /// # Errors
    /// [`ClientError`]; refused with [`LinkError::ParamOutside`] and others where the robot's task
    /// does not take the value.
    pub fn set_param(&mut self, mission: u32, param: u16, value: u32) -> Result<u32, ClientError> {
        let request = Request::SetParam {
            mission,
            param,
            value,
        };
        self.ask("set the parameter", request, |response| match response {
            Response::ParamSet { before } => Some(before),
            _ => None,
        })
    }

    /// Lets the robot keep the values of parameters that differ now from those of the mission of
    /// this hash, and start it with them from now on. Answers how many there are.
    ///
    /// # Errors
    /// [`ClientError`]; refused with [`LinkError::NoStore`] by a robot that has no flash to keep
    /// them in, with [`LinkError::OnTrial`] while the mission is on trial.
    pub fn save_params(&mut self, mission: u32) -> Result<u8, ClientError> {
        let request = Request::SaveParams { mission };
        self.ask("save parameters", request, |response| match response {
            Response::ParamsSaved { count } => Some(count),
            _ => None,
        })
    }

    /// Lets the robot forget an upload.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn abort(&mut self) -> Result<(), ClientError> {
        self.ask_to_do("abort", Request::Abort)
    }

    /// Ends requests and uploads that are under way as soon as `stop` says so, with
    /// [`ClientError::Interrupted`]. The robot is not told: it goes on with what it has. `None`
    /// lets everything come to its end again.
    pub fn stop_when(&mut self, stop: Option<Box<dyn Fn() -> bool + Send>>) {
        self.stop = stop;
    }

    /// From now on all that waits ends with [`ClientError::Interrupted`] as soon as `end` says so,
    /// whatever [`LinkClient::stop_when`] says.
    pub fn end_when(&mut self, end: Option<Box<dyn Fn() -> bool + Send>>) {
        self.end = end;
    }

    /// From now on all requests and uploads together may wait for the robot so long; after that
    /// they fail with [`ClientError::TooSlow`]. `None` lets the session last as long as each of
    /// them alone makes it. Time in which nothing is asked does not count.
    pub fn limit_waits(&mut self, limit: Option<Duration>) {
        self.allowance = Allowance::new(limit, self.clock.now());
    }

    /// Lets an upload wait longer, where there is a limit, by `time` for each byte that the robot
    /// takes: so one that takes none is given up as soon as any other, and one that takes them
    /// slowly when all could have arrived.
    pub fn allow_for_each_byte(&mut self, time: Duration) {
        self.allowance.set_each_byte(time);
    }

    /// Lets them wait longer, where there is a limit: there is more to do than was known.
    pub fn extend_waits(&mut self, more: Duration) {
        self.allowance.extend(more);
    }

    /// Fails where it is to end.
    fn check_stop(&mut self, request: &'static str) -> Result<(), ClientError> {
        if [&self.stop, &self.end]
            .into_iter()
            .flatten()
            .any(|is_over| is_over())
        {
            return Err(ClientError::Interrupted { request });
        }
        self.allowance.look(self.clock.now(), request)
    }

    /// Listens to the streams for up to `timeout`; returns when something has come.
    ///
    /// # Errors
    /// [`ClientError::Line`]
    pub fn listen(&mut self, timeout: Duration) -> Result<(), ClientError> {
        let calling = &mut self.calling;
        self.incoming.receive(&mut self.link, timeout, |answer| {
            let is_to_it = |call: &Frame| call.seq == answer.seq && call.expected.accepts(answer);
            if calling.as_ref().is_some_and(is_to_it) {
                *calling = None;
            }
        })?;
        Ok(())
    }

    /// Listens for a while as [`listen`](Self::listen) does, and lets the robot hear that somebody
    /// listens.
    ///
    /// # Errors
    /// [`ClientError::Line`]
    pub fn attend(&mut self, timeout: Duration) -> Result<(), ClientError> {
        self.call()?;
        self.listen(timeout.min(CALL_INTERVAL))
    }

    /// Lets the robot hear that somebody is here, if it has heard nothing for a [`CALL_INTERVAL`]:
    /// a mission may watch for that. What it answers is not waited for, so that a robot that is
    /// silent keeps nobody from listening.
    ///
    /// # Errors
    /// [`ClientError::Line`]
    pub fn call(&mut self) -> Result<(), ClientError> {
        if self.clock.since(self.sent) < CALL_INTERVAL {
            return Ok(());
        }
        // The same as long as it is not answered: who keeps requests back has one of them at most.
        let call = match self.calling.take() {
            Some(call) => call,
            None => self.next_frame("clock", Request::Clock)?,
        };
        self.send_wire(call.wire())?;
        self.calling = Some(call);
        Ok(())
    }

    /// What the streams brought since the last call.
    pub fn take_events(&mut self) -> Vec<StreamEvent> {
        self.incoming.events.take()
    }

    /// The line, for another session.
    pub fn into_line(self) -> L {
        self.link
    }

    /// The clock by which it waits: the line's.
    pub fn clock(&self) -> &Clock {
        &self.clock
    }

    /// What this link has seen so far.
    pub fn counts(&self) -> LinkCounts {
        LinkCounts {
            bad_frames: self.incoming.bad_frames,
            ..self.counts
        }
    }

    fn ask_to_do(&mut self, name: &'static str, request: Request<'_>) -> Result<(), ClientError> {
        self.ask(name, request, |response| match response {
            Response::Done => Some(()),
            _ => None,
        })
    }

    /// Reads something of `most` bytes at most that comes in pieces, each asked for by its offset,
    /// until it is whole.
    fn read_all(
        &mut self,
        name: &'static str,
        most: u32,
        request: impl Fn(usize) -> Option<Request<'static>>,
    ) -> Result<Vec<u8>, ClientError> {
        let mut parts = Parts::new(name, most);
        loop {
            let Some(request) = request(parts.there()) else {
                return Err(ClientError::BadAnswer { request: name });
            };
            let is_whole = self.ask(name, request, |response| match response {
                Response::TaskText { total, text } => Some(parts.take(total.into(), text)),
                Response::Blob { total, data } => Some(parts.take(total, data)),
                _ => None,
            })??;
            if is_whole {
                return Ok(parts.bytes);
            }
        }
    }

    /// Sends a request until its answer is there, and reads that with `read`; `None` from there is
    /// an answer that does not fit.
    fn ask<T>(
        &mut self,
        name: &'static str,
        request: Request<'_>,
        mut read: impl FnMut(Response<'_>) -> Option<T>,
    ) -> Result<T, ClientError> {
        let mut patience = Patience::new(self.clock.now());
        self.open_session_for(&request, &mut patience)?;
        let longer = if is_kept(&request) && !mutant!(FlashForgotten) {
            self.built_in()?.flash_time
        } else {
            Duration::ZERO
        };
        let mut is_misunderstood = false;
        // It was on its way when the session ended.
        let mut may_be_done = false;
        loop {
            let answer = if is_command(&request) && !mutant!(DeadlineForgotten) {
                self.exchange_in_time(name, request, longer, &mut patience, &mut read)?
            } else if self.signing.is_for(&request) {
                self.exchange_signed(name, request, NO_UPLOAD, longer, &mut patience, &mut read)?
            } else {
                self.exchange(name, request, longer, &mut patience, &mut read)?
            };
            match answer {
                Ok(Some(answer)) => return Ok(answer),
                Ok(None) => return Err(ClientError::BadAnswer { request: name }),
                // Noise whose checksum is right comes once. A firmware that does not know the
                // request never does.
                Err(LinkError::Malformed) if !is_misunderstood => {
                    is_misunderstood = true;
                    self.pause(name, BUSY_WAIT, &mut patience)?;
                }
                // The robot has started anew, or another session of its owner was begun: this one
                // ends here. What is masked for it is to be masked anew.
                Err(LinkError::NoSession)
                    if self.signing.session.is_some()
                        && !matches!(request, Request::InstallKey { .. })
                        && patience.lasts() =>
                {
                    may_be_done |= needs(&request) == Needs::Key;
                    self.signing.session = None;
                    self.pause(name, BUSY_WAIT, &mut patience)?;
                    self.open_session_for(&request, &mut patience)?;
                }
                // The robot has its hands full, or came to it too late to do it: the request is as
                // good as new.
                Err(LinkError::Busy | LinkError::NoAnswer) if patience.lasts() => {
                    self.pause(name, BUSY_WAIT, &mut patience)?;
                }
                Err(LinkError::Late)
                    if patience.is_fresh(self.clock.now()) && !has_its_own_time(&request) =>
                {
                    self.pause(name, BUSY_WAIT, &mut patience)?;
                }
                // Somebody else has sent it a wrong signature.
                Err(LinkError::TooSoon { ms }) if patience.lasts() => {
                    let wait = Duration::from_millis(ms.into()).min(LONGEST_PAUSE);
                    self.pause(name, wait, &mut patience)?;
                }
                Err(error) if may_be_done => {
                    return Err(ClientError::MayBeDone {
                        request: name,
                        error,
                    });
                }
                Err(error) => {
                    return Err(ClientError::Refused {
                        request: name,
                        error,
                    });
                }
            }
        }
    }

    /// Lets time pass before a request is sent anew.
    fn pause(
        &mut self,
        name: &'static str,
        wait: Duration,
        patience: &mut Patience,
    ) -> Result<(), ClientError> {
        let mut left = wait;
        while !left.is_zero() {
            self.check_stop(name)?;
            let part = left.min(STOP_LOOK);
            self.clock.pause(part);
            left -= part;
        }
        patience.look(self.clock.now());
        Ok(())
    }

    /// Sends a command that the robot may carry out as long as its answer is waited for, and no
    /// longer. The time of that is also `whole`'s.
    fn exchange_in_time<T>(
        &mut self,
        name: &'static str,
        command: Request<'_>,
        longer: Duration,
        whole: &mut Patience,
        read: &mut impl FnMut(Response<'_>) -> Option<T>,
    ) -> Result<Result<Option<T>, LinkError>, ClientError> {
        let mut room = [0; MAX_SIGNED_BYTES];
        let bytes = postcard::to_slice(&command, &mut room).map_err(|_| ClientError::Refused {
            request: name,
            error: LinkError::TooLong,
        })?;
        let now_us = self.robot_us()?;
        // From here on, so that nobody gives up before that time.
        let mut patience = Patience::new(self.clock.now());
        let patience_us =
            REQUEST_DEADLINE.as_micros() as u64 * if mutant!(DeadlineTooFar) { 2 } else { 1 };
        let request = Request::Within {
            by_us: now_us.saturating_add(patience_us),
            request: bytes,
        };
        let answer = if self.signing.is_for(&command) {
            let upload = match command {
                Request::Commit(_) => self.signing.upload,
                _ => NO_UPLOAD,
            };
            self.exchange_signed(name, request, upload, longer, &mut patience, read)
        } else {
            self.exchange(name, request, longer, &mut patience, read)
        };
        whole.adopt(patience);
        answer
    }

    /// Sends a request under a new number until its answer is there, for which the robot may take
    /// `longer` than for others.
    fn exchange<T>(
        &mut self,
        name: &'static str,
        request: Request<'_>,
        longer: Duration,
        patience: &mut Patience,
        read: &mut impl FnMut(Response<'_>) -> Option<T>,
    ) -> Result<Result<Option<T>, LinkError>, ClientError> {
        let frame = self.next_frame(name, request)?;
        self.exchange_frame(name, request, &frame, longer, patience, read)
    }

    /// Sends a frame that holds a request until the answer is there.
    fn exchange_frame<T>(
        &mut self,
        name: &'static str,
        request: Request<'_>,
        frame: &Frame,
        longer: Duration,
        patience: &mut Patience,
        read: &mut impl FnMut(Response<'_>) -> Option<T>,
    ) -> Result<Result<Option<T>, LinkError>, ClientError> {
        let wire = frame.wire();
        let kind = innermost_kind(&request);
        // The only request that an owner needs an answer to before the robot can tell who asks.
        let may_compete = matches!(request, Request::Identify { .. });
        // Answers came that are not the robot's own, as far as anybody knows.
        let mut unproven = false;
        self.calling = None;
        self.incoming.other_version = None;
        self.incoming.has_asked_for_streams |= asks_for_streams(&request);
        let mut is_first = true;
        // Sendings in a row of which nothing was heard: a line that brings corrupt frames is bad,
        // and not slow.
        let mut attempt = 0;
        // The longest that a corrupt frame took to come: until an answer was timed nothing better
        // is known.
        let mut heard_within = None;
        loop {
            self.send_wire(wire)?;
            let sent = self.clock.now();
            let mut wait = match heard_within {
                Some(time) if !self.reply_time.is_known() => {
                    ReplyTime::of(time).wait(attempt, wire.len())
                }
                _ => self.reply_time.wait(attempt, wire.len()),
            };
            attempt += 1;
            if is_verified(&request) {
                wait = wait.max(VERIFICATION_WAIT);
            }
            let mut deadline = sent + wait + longer;
            let mut answer = None;
            while answer.is_none() {
                let now = self.clock.now();
                if now >= deadline {
                    break;
                }
                self.check_stop(name)?;
                let bad_before = self.incoming.bad_frames;
                let wait = (deadline - now).min(STOP_LOOK);
                let mut is_crowded = false;
                let heard = self.incoming.receive(&mut self.link, wait, |received| {
                    // With the number that a session happens to begin with, an answer of the
                    // session before may still be on its way.
                    let is_old = request == Request::Hello
                        && !matches!(received.result, Ok(Response::Hello(_)))
                        && !mutant!(OldHelloTaken);
                    let is_its_own = received.seq == frame.seq || mutant!(StaleAnswerTaken);
                    if !is_its_own || is_old || answer.is_some() {
                        is_crowded |= !is_its_own && received.is_of(kind);
                        return;
                    }
                    if frame.expected.is_ended_by(received) {
                        answer = Some(Err(LinkError::NoSession));
                    } else if !received.is_of(kind) {
                        // To another request, under the same number.
                    } else if frame.expected.accepts(received) {
                        answer = Some(received.result.map(&mut *read));
                    } else {
                        unproven = true;
                    }
                })?;
                if let (Request::Hello, Some(robot)) = (request, self.incoming.other_version) {
                    return Err(ClientError::OtherVersion { robot });
                }
                patience.look(self.clock.now());
                let corrupt = self.incoming.bad_frames - bad_before;
                patience.corrupt(corrupt);
                if heard || corrupt > 0 {
                    patience.sign_of_life();
                }
                if corrupt > 0 {
                    attempt = 0;
                    heard_within = heard_within.max(Some(self.clock.since(sent)));
                    // Most likely it was the answer.
                    deadline = deadline.min(self.clock.now() + CORRUPT_WAIT);
                }
                if is_crowded && may_compete {
                    // Somebody else has asked for the same and was answered. No second request of
                    // a kind waits in the robot, and just now it has room for one.
                    attempt = 0;
                    deadline = now;
                }
            }
            if let Some(answer) = answer {
                let took = self.clock.since(sent);
                if !is_verified(&request) && longer.is_zero() {
                    if is_first {
                        self.reply_time.seen(took);
                    } else if let (Some(time), false) = (heard_within, self.reply_time.is_known()) {
                        // On a bad line few are answered the first time: better this than nothing.
                        self.reply_time.seen(took.max(time));
                    }
                }
                return Ok(answer);
            }
            if let Err(error) = patience.check(name) {
                return Err(if unproven {
                    ClientError::Unproven { request: name }
                } else {
                    error
                });
            }
            is_first = false;
            self.counts.retries += 1;
            if mutant!(Renumbered) {
                return self.exchange(name, request, longer, patience, read);
            }
        }
    }

    /// A request under a new number, in the owner's session where there is one.
    fn next_frame(
        &mut self,
        name: &'static str,
        request: Request<'_>,
    ) -> Result<Frame, ClientError> {
        let Some(session) = self
            .signing
            .session
            .as_mut()
            .filter(|_| may_be_proven(&request))
        else {
            return self.frame(name, request, Expected::Plain);
        };
        let mut room = [0; MAX_PROVEN_BYTES];
        let Some((proven, expected)) = session.prove(&request, &mut room) else {
            return Err(too_long(name));
        };
        self.frame(name, proven, expected)
    }

    /// A request under a new number, as it is.
    fn frame(
        &mut self,
        name: &'static str,
        request: Request<'_>,
        expected: Expected,
    ) -> Result<Frame, ClientError> {
        self.seq = self.seq.wrapping_add(1);
        let seq = self.seq;
        let mut wire = [0; MAX_FRAME_BYTES + 1];
        // Ends whatever noise came before.
        wire[0] = DELIMITER;
        let length = frame::encode(&ToDevice { seq, request }, &mut wire[1..])
            .map_err(|_| too_long(name))?;
        Ok(Frame {
            seq,
            wire,
            length: 1 + length,
            expected,
        })
    }

    fn send_wire(&mut self, wire: &[u8]) -> Result<(), ClientError> {
        self.link.send(wire).map_err(|error| match error.kind() {
            // Ctrl-C came while the line took no bytes.
            std::io::ErrorKind::Interrupted => ClientError::Interrupted { request: "send" },
            _ => error.into(),
        })?;
        self.sent = self.clock.now();
        self.counts.bytes_sent += wire.len() as u64;
        Ok(())
    }
}

/// Bytes that come in parts, each with the length of the whole.
struct Parts {
    request: &'static str,
    /// What the whole can have at most.
    most: u32,
    total: Option<u32>,
    bytes: Vec<u8>,
}

impl Parts {
    fn new(request: &'static str, most: u32) -> Self {
        Parts {
            request,
            most,
            total: None,
            bytes: Vec::new(),
        }
    }

    fn there(&self) -> usize {
        self.bytes.len()
    }

    /// Takes the next part. Answers whether the whole is there.
    fn take(&mut self, said: u32, part: &[u8]) -> Result<bool, ClientError> {
        let before = *self.total.get_or_insert(said);
        let total = said as usize;
        let flaw = if said > self.most && !mutant!(LengthBelieved) {
            Flaw::TooLong {
                said: said.into(),
                most: self.most.into(),
                unit: "bytes",
            }
        } else if said != before {
            Flaw::OtherLength {
                before: before as usize,
                now: total,
            }
        } else {
            self.bytes.extend_from_slice(part);
            match self.there() {
                there if there == total => return Ok(true),
                there if there > total => Flaw::Overfull { there, total },
                there if part.is_empty() => Flaw::NoEnd { there, total },
                _ => return Ok(false),
            }
        };
        Err(ClientError::BadParts {
            request: self.request,
            flaw,
        })
    }
}

fn too_long(request: &'static str) -> ClientError {
    ClientError::Refused {
        request,
        error: LinkError::TooLong,
    }
}

/// Whether a request changes what the robot does, so that it must not be carried out when nobody
/// expects that any more. A stop is welcome at any time; what is about keys is bound to a nonce, or
/// to the key itself.
fn is_command(request: &Request<'_>) -> bool {
    needs(request) == Needs::Key
        && !matches!(request, Request::InstallKey { .. } | Request::RemoveKey)
}

/// Whether it says by itself until when it holds: sent anew, it would come later still.
fn has_its_own_time(request: &Request<'_>) -> bool {
    matches!(request, Request::Drive { .. })
}

/// Whether the robot keeps something in its flash before it answers. An emergency stop is among
/// them, but must not wait for anything.
fn is_kept(request: &Request<'_>) -> bool {
    matches!(
        request,
        Request::Commit(_)
            | Request::Confirm { .. }
            | Request::FallBack { .. }
            | Request::SaveParams { .. }
            | Request::Release
            | Request::InstallKey { .. }
            | Request::RemoveKey
    )
}

/// Whether the robot verifies a signature before it answers.
fn is_verified(request: &Request<'_>) -> bool {
    matches!(
        request,
        Request::Signed { .. } | Request::Sign { .. } | Request::InstallKey { .. }
    )
}

/// Whether the robot may send streams from this request on.
fn asks_for_streams(request: &Request<'_>) -> bool {
    matches!(
        request,
        Request::Subscribe { .. } | Request::Watch { .. } | Request::Values { .. }
    )
}

impl From<DeviceInfo<'_>> for RobotInfo {
    fn from(info: DeviceInfo<'_>) -> Self {
        RobotInfo {
            firmware: info.firmware.to_owned(),
            board: info.board.to_owned(),
            task_types: info.task_types,
            capacities: info.capacities,
            mission: info.mission,
            reset: info.reset,
            uploads: info.uploads,
            access: info.access,
        }
    }
}

/// The receiving half: bytes to frames to replies and events.
struct Incoming {
    reader: FrameReader,
    trace: Assembler,
    log: Assembler,
    record: Assembler,
    values: Assembler,
    events: Waiting,
    /// This session has asked for streams: what comes before is of another one.
    has_asked_for_streams: bool,
    bad_frames: u64,
    /// Version that a robot of another one told in its answer to `hello`.
    other_version: Option<u16>,
}

impl Incoming {
    fn new() -> Self {
        Incoming {
            reader: FrameReader::new(),
            trace: Assembler::new(Channel::Trace),
            log: Assembler::new(Channel::Log),
            record: Assembler::new(Channel::Record),
            values: Assembler::new(Channel::Values),
            events: Waiting::default(),
            has_asked_for_streams: false,
            bad_frames: 0,
            other_version: None,
        }
    }

    /// Streams end here; those that come from now on are numbered anew.
    fn end_streams(&mut self) {
        *self = Incoming {
            reader: std::mem::take(&mut self.reader),
            bad_frames: self.bad_frames,
            ..Incoming::new()
        };
    }

    /// Takes what the line has, waiting up to `timeout` for its first byte. Replies go to
    /// `on_reply`, streams to the events. Answers whether a frame came that was whole.
    fn receive(
        &mut self,
        link: &mut impl ByteLink,
        timeout: Duration,
        mut on_reply: impl FnMut(&Answer<'_>),
    ) -> std::io::Result<bool> {
        let mut heard = false;
        let mut bytes = [0; READ_BYTES];
        let count = link.receive(&mut bytes, timeout)?;
        for &byte in &bytes[..count] {
            let Some(frame) = self.reader.push(byte) else {
                continue;
            };
            let Ok(message) = frame::unpack(frame) else {
                self.bad_frames += 1;
                continue;
            };
            match frame::parse(message) {
                Ok(FromDevice::Reply { seq, result, of }) => on_reply(&Answer {
                    seq,
                    of,
                    result,
                    proof: None,
                }),
                Ok(FromDevice::Proven {
                    seq,
                    proof,
                    result,
                    of,
                }) => on_reply(&Answer {
                    seq,
                    of,
                    result,
                    proof: Some((
                        proof,
                        message.get(PROVEN_HEADER_BYTES..).unwrap_or_default(),
                    )),
                }),
                Ok(_) if !self.has_asked_for_streams => {}
                Ok(FromDevice::StatusEvent(news)) => {
                    self.events.push(StreamEvent::StatusEvent(news))
                }
                Ok(FromDevice::Stream(part)) => match part.channel {
                    Channel::Trace => self.trace.take(&part, &mut self.events),
                    Channel::Log => self.log.take(&part, &mut self.events),
                    Channel::Record => self.record.take(&part, &mut self.events),
                    Channel::Values => self.values.take(&part, &mut self.events),
                },
                Err(_) => {
                    self.other_version = version_in_hello(message);
                    self.bad_frames += 1;
                    continue;
                }
            }
            heard = true;
        }
        Ok(heard)
    }
}

#[cfg(test)]
mod tests;
