//! The host's end of the link to a robot: asks, uploads, listens.
//!
//! One request is open at a time. It has a number; if no answer comes in time it is sent again under the same number, and the robot,
//! which remembers its last answer, does nothing twice. Between answers the robot sends streams, which are put together here and
//! kept until [`LinkClient::take_events`] fetches them. Whatever noise a line makes, a request either ends with the robot's own
//! answer to it, or with an error.

pub mod error;
pub mod log_lines;
mod streams;
mod timing;

use std::time::{Duration, Instant};

use rt_firmware::link::frame::{self, DELIMITER, FrameError, FrameReader, MAX_FRAME_BYTES};
use rt_firmware::link::message::{
    Capacities, Channel, DeviceInfo, FromDevice, LinkError, MAX_CHUNK, PROTOCOL_VERSION, Request,
    ResetReason, Response, SlotCounters, Status, TaskCounters, ToDevice,
};

use crate::serial::ByteLink;

pub use error::ClientError;
use streams::Assembler;
pub use streams::StreamEvent;
use timing::ReplyTime;

/// How long a request may take in all, repetitions included.
const REQUEST_DEADLINE: Duration = Duration::from_secs(6);

/// How long the robot may be busy with the request before.
const BUSY_WAIT: Duration = Duration::from_millis(5);

/// The smallest chunk that a noisy line brings an upload down to, in bytes.
const SMALLEST_CHUNK: usize = 16;

/// Chunks in a row that must pass at once before longer ones are tried again.
const CHUNKS_BEFORE_GROWTH: u32 = 4;

/// How often an upload may begin again, or a chunk be refused, before it is given up.
const UPLOAD_SETBACK_LIMIT: u32 = 20;

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
}

/// What is current on a robot.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CurrentStates {
    /// Macro steps that were begun when this was read.
    pub step: u64,
    /// Current local state of each region instance, in the blob's numbers.
    pub states: Vec<u16>,
}

/// What a link has seen so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCounts {
    /// Requests that had to be sent again.
    pub retries: u64,
    /// Frames from the robot that were spoiled.
    pub bad_frames: u64,
    /// Bytes sent.
    pub bytes_sent: u64,
}

/// A session with a robot.
pub struct LinkClient<L> {
    link: L,
    incoming: Incoming,
    seq: u8,
    reply_time: ReplyTime,
    counts: LinkCounts,
}

impl<L: ByteLink> LinkClient<L> {
    /// Begins a session: the robot forgets what it last answered, and ends its streams.
    ///
    /// # Errors
    /// [`ClientError`]: the robot does not answer, or does not speak as this program does.
    pub fn connect(link: L) -> Result<(Self, RobotInfo), ClientError> {
        let mut client = LinkClient {
            link,
            incoming: Incoming::new(),
            // Not the number that the client before began with: its answers may still be on the line.
            seq: std::process::id() as u8,
            reply_time: ReplyTime::default(),
            counts: LinkCounts::default(),
        };
        let info = client.hello()?;
        Ok((client, info))
    }

    /// Asks the robot who it is. Ends its streams, as at the beginning of a session.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn hello(&mut self) -> Result<RobotInfo, ClientError> {
        let (protocol, info) = self.ask("hello", Request::Hello, |response| match response {
            Response::Hello(info) => Some((info.protocol, RobotInfo::from(info))),
            _ => None,
        })?;
        if protocol == PROTOCOL_VERSION {
            Ok(info)
        } else {
            Err(ClientError::OtherVersion { robot: protocol })
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

    /// Motors off, latched until [`LinkClient::start`].
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn stop(&mut self) -> Result<(), ClientError> {
        self.ask_to_do("stop", Request::Stop)
    }

    /// The mission starts anew.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn start(&mut self) -> Result<(), ClientError> {
        self.ask_to_do("start", Request::Start)
    }

    /// Chooses the streams that the robot sends from now on.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn subscribe(&mut self, trace: bool, log: bool) -> Result<(), ClientError> {
        self.ask_to_do("subscribe", Request::Subscribe { trace, log })
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

    /// How a task state is, and what was counted of it; `task_instance` is its index in the running mission.
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
        let bytes = self.read_all("tasks", |offset| {
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
        self.read_all("read the mission", |offset| {
            let offset = u32::try_from(offset).ok()?;
            Some(Request::ReadBlob { offset })
        })
    }

    /// The current states of the mission that runs, all of one macro step where the robot's pace allows that.
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
            whole &= *first_step.get_or_insert(step) == step;
            let (pairs, _) = part.as_chunks::<2>();
            states.extend(pairs.iter().map(|pair| u16::from_le_bytes(*pair)));
            if states.len() >= usize::from(total) || pairs.is_empty() {
                return Ok((whole, CurrentStates { step, states }));
            }
        }
    }

    /// Brings a mission to the robot and lets it take over between two macro steps. `progress` is told the bytes that are there.
    /// Answers the mission's hash when it runs.
    ///
    /// # Errors
    /// [`ClientError`]; a refusal leaves the robot with the mission that it had.
    pub fn upload(
        &mut self,
        blob: &[u8],
        progress: &mut dyn FnMut(usize),
    ) -> Result<u32, ClientError> {
        self.stage(blob, progress)?;
        self.commit()
    }

    /// Brings a mission to the robot without letting it take over.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn stage(
        &mut self,
        blob: &[u8],
        progress: &mut dyn FnMut(usize),
    ) -> Result<(), ClientError> {
        let mut setbacks = 0;
        let mut set_back = |error: LinkError| {
            setbacks += 1;
            if setbacks > UPLOAD_SETBACK_LIMIT {
                Err(ClientError::UploadStuck { error })
            } else {
                Ok(())
            }
        };
        let mut chunk = MAX_CHUNK;
        let mut passed_at_once = 0;
        let mut there = self.begin(blob)?;
        loop {
            progress(there);
            if there >= blob.len() {
                return Ok(());
            }
            let end = blob.len().min(there + chunk);
            let data = &blob[there..end];
            let retries_before = self.counts.retries;
            match self.send_chunk(there, data) {
                Ok(length) => there = length,
                // A sending that was given up has arrived after all, or the robot has lost its place.
                Err(ClientError::Refused {
                    error: error @ LinkError::WrongOffset { expected },
                    ..
                }) => {
                    set_back(error)?;
                    there = expected as usize;
                }
                Err(ClientError::Refused {
                    error: error @ LinkError::NoUpload,
                    ..
                }) => {
                    set_back(error)?;
                    there = self.begin(blob)?;
                }
                Err(ClientError::NoReply { .. }) if chunk > SMALLEST_CHUNK => {
                    set_back(LinkError::NoAnswer)?;
                }
                Err(error) => return Err(error),
            }
            if self.counts.retries == retries_before {
                passed_at_once += 1;
                if passed_at_once >= CHUNKS_BEFORE_GROWTH {
                    chunk = MAX_CHUNK.min(chunk * 2);
                    passed_at_once = 0;
                }
            } else {
                // The shorter a frame, the likelier it passes.
                chunk = SMALLEST_CHUNK.max(chunk / 2);
                passed_at_once = 0;
            }
        }
    }

    /// Lets the mission that was brought take over. Answers its hash when it runs.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn commit(&mut self) -> Result<u32, ClientError> {
        self.ask("commit", Request::Commit, |response| match response {
            Response::Committed { mission } => Some(mission),
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

    /// Listens to the streams for up to `timeout`; returns when something has come.
    ///
    /// # Errors
    /// [`ClientError::Line`]
    pub fn listen(&mut self, timeout: Duration) -> Result<(), ClientError> {
        self.incoming.receive(&mut self.link, timeout, |_, _| ())?;
        Ok(())
    }

    /// What the streams brought since the last call.
    pub fn take_events(&mut self) -> Vec<StreamEvent> {
        std::mem::take(&mut self.incoming.events)
    }

    /// What this link has seen so far.
    pub fn counts(&self) -> LinkCounts {
        LinkCounts {
            bad_frames: self.incoming.bad_frames,
            ..self.counts
        }
    }

    fn begin(&mut self, blob: &[u8]) -> Result<usize, ClientError> {
        let request = "upload";
        let len = u32::try_from(blob.len()).map_err(|_| ClientError::Refused {
            request,
            error: LinkError::TooLong,
        })?;
        let crc = frame::checksum(blob);
        self.ask(request, Request::Begin { len, crc }, received)
    }

    fn send_chunk(&mut self, offset: usize, data: &[u8]) -> Result<usize, ClientError> {
        // `begin` has seen that the blob's length fits.
        let offset = offset as u32;
        self.ask("upload", Request::Chunk { offset, data }, received)
    }

    fn ask_to_do(&mut self, name: &'static str, request: Request<'_>) -> Result<(), ClientError> {
        self.ask(name, request, |response| match response {
            Response::Done => Some(()),
            _ => None,
        })
    }

    /// Reads something that comes in pieces, each asked for by its offset, until it is whole.
    fn read_all(
        &mut self,
        name: &'static str,
        request: impl Fn(usize) -> Option<Request<'static>>,
    ) -> Result<Vec<u8>, ClientError> {
        let bad = ClientError::BadAnswer { request: name };
        let mut bytes = Vec::new();
        loop {
            let Some(request) = request(bytes.len()) else {
                return Err(bad);
            };
            let total = self.ask(name, request, |response| match response {
                Response::TaskText { total, text } => {
                    bytes.extend_from_slice(text);
                    Some((usize::from(total), text.is_empty()))
                }
                Response::Blob { total, data } => {
                    bytes.extend_from_slice(data);
                    Some((total as usize, data.is_empty()))
                }
                _ => None,
            })?;
            match total {
                (total, _) if bytes.len() == total => return Ok(bytes),
                (total, false) if bytes.len() < total => {}
                _ => return Err(bad),
            }
        }
    }

    /// Sends a request until its answer is there, and reads that with `read`; `None` from there is an answer that does not fit.
    fn ask<T>(
        &mut self,
        name: &'static str,
        request: Request<'_>,
        mut read: impl FnMut(Response<'_>) -> Option<T>,
    ) -> Result<T, ClientError> {
        let started = Instant::now();
        loop {
            match self.exchange(name, request, started, &mut read)? {
                Ok(Some(answer)) => return Ok(answer),
                Ok(None) => return Err(ClientError::BadAnswer { request: name }),
                // The robot saw noise, or has its hands full: the request is as good as new.
                Err(LinkError::Malformed | LinkError::Busy)
                    if started.elapsed() < REQUEST_DEADLINE =>
                {
                    std::thread::sleep(BUSY_WAIT);
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

    /// Sends a request under a new number until its answer is there.
    fn exchange<T>(
        &mut self,
        name: &'static str,
        request: Request<'_>,
        started: Instant,
        read: &mut impl FnMut(Response<'_>) -> Option<T>,
    ) -> Result<Result<Option<T>, LinkError>, ClientError> {
        self.seq = self.seq.wrapping_add(1);
        let seq = self.seq;
        let mut wire = [0; MAX_FRAME_BYTES + 1];
        // Ends whatever noise came before.
        wire[0] = DELIMITER;
        let length = frame::encode(&ToDevice { seq, request }, &mut wire[1..]).map_err(|_| {
            ClientError::Refused {
                request: name,
                error: LinkError::TooLong,
            }
        })?;
        let wire = &wire[..=length];
        let mut attempt = 0;
        loop {
            self.link.send(wire)?;
            self.counts.bytes_sent += wire.len() as u64;
            let sent = Instant::now();
            let deadline = sent + self.reply_time.wait(attempt, wire.len());
            let mut answer = None;
            while answer.is_none() {
                let now = Instant::now();
                if now >= deadline {
                    break;
                }
                self.incoming
                    .receive(&mut self.link, deadline - now, |number, result| {
                        if number == seq && answer.is_none() {
                            answer = Some(result.map(&mut *read));
                        }
                    })?;
            }
            if let Some(answer) = answer {
                if attempt == 0 {
                    self.reply_time.seen(sent.elapsed());
                }
                return Ok(answer);
            }
            if started.elapsed() >= REQUEST_DEADLINE {
                return Err(ClientError::NoReply {
                    request: name,
                    waited: started.elapsed(),
                });
            }
            attempt += 1;
            self.counts.retries += 1;
        }
    }
}

fn received(response: Response<'_>) -> Option<usize> {
    match response {
        Response::Received { len } => Some(len as usize),
        _ => None,
    }
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
        }
    }
}

/// The receiving half: bytes to frames to replies and events.
struct Incoming {
    reader: FrameReader,
    trace: Assembler,
    log: Assembler,
    events: Vec<StreamEvent>,
    bad_frames: u64,
}

impl Incoming {
    fn new() -> Self {
        Incoming {
            reader: FrameReader::new(),
            trace: Assembler::new(Channel::Trace),
            log: Assembler::new(Channel::Log),
            events: Vec::new(),
            bad_frames: 0,
        }
    }

    /// Takes what the line has, waiting up to `timeout` for its first byte. Replies go to `on_reply`, streams to the events.
    fn receive(
        &mut self,
        link: &mut impl ByteLink,
        timeout: Duration,
        mut on_reply: impl FnMut(u8, Result<Response<'_>, LinkError>),
    ) -> std::io::Result<()> {
        let mut bytes = [0; READ_BYTES];
        let count = link.receive(&mut bytes, timeout)?;
        for &byte in &bytes[..count] {
            let Some(frame) = self.reader.push(byte) else {
                continue;
            };
            match frame::decode(frame) {
                Ok(FromDevice::Reply { seq, result }) => on_reply(seq, result),
                Ok(FromDevice::Stream(part)) => match part.channel {
                    Channel::Trace => self.trace.take(&part, &mut self.events),
                    Channel::Log => self.log.take(&part, &mut self.events),
                },
                Err(
                    FrameError::TooLong
                    | FrameError::NotCobs
                    | FrameError::WrongChecksum
                    | FrameError::NotAMessage,
                ) => self.bad_frames += 1,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
