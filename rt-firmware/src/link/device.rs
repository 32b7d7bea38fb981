//! The robot's end of the link: takes frames, answers requests, sends streams where there is room.

use core::sync::atomic::{AtomicBool, Ordering};

use esm_core::{Refusal, Verified};
use heapless::spsc::{Consumer, Producer};

use super::access::{Access, Needs, may_have_deadline, needs};
use super::frame::{
    CRC_BYTES, FrameError, FrameReader, MAX_REPLY_FRAME_BYTES, checksum, decode, encode,
};
use super::key_safe::KeySafe;
use super::keys::{Keys, SignedUpload};
use super::message::{
    Capacities, Capacity, Channel, DeviceInfo, FromDevice, LastWords, LinkError, MAX_CHUNK,
    MAX_PART, MAX_STREAM_BYTES, Mode, PROTOCOL_VERSION, Request, Response, Status, Stream, Swap,
    ToDevice, Uploads,
};
use super::news::{News, Watch};
use super::trial::{MissionKeeper, TRIAL_AT_START_MS};
use crate::black_box::KEEPS_RECORDS;
use crate::check::{check, check_slots};
use crate::features::{Feature, Features, KEYS, NEWS, PARAMS, RECORD, TELEMETRY, WARM};
use crate::mail::{Bytes, Freed, Letter, NO_DEADLINE, Posted};
use crate::ports::Registry;
use crate::realtime::params::SavedParams;
use crate::realtime::upcoming::{Rooms, Upcoming};
use crate::recorder::RecordReader;
use crate::ring::RingReader;
use crate::runtime::About;
use crate::status::SnapshotReader;
use crate::store::keep::{Kept, Start};
use crate::supervision::Signs;
use crate::telemetry::SampleReader;
use esm_core::BlobBuffer;

/// Bytes of a stream's frame beside those of the stream: kind, channel, number, continuation, count of dropped records (5), length,
/// checksum, COBS, delimiter.
const STREAM_OVERHEAD: usize = 1 + 1 + 1 + 1 + 5 + 1 + CRC_BYTES + 1 + 1;
/// Streams.
const CHANNELS: usize = 4;

/// The byte link of a board, and its log.
pub trait LinkPort {
    /// Bytes of an upload that a host may have on their way. Three chunks are 46 ms of a line of 115,200 baud: more than an answer takes
    /// to come into being and to travel, through a host's converter that looks at its line each 16 ms too. The robot keeps none of them
    /// anywhere but in the blob itself, so that a larger window takes no memory; but all of it is sent again where the line lost a byte.
    const WINDOW_BYTES: u16 = 3 * MAX_CHUNK as u16;

    /// Whether the board keeps what is logged. A host that wants the log of one that does not is refused.
    const KEEPS_LOG: bool = true;

    /// Milliseconds that the board's flash takes at most for what one request has it keep: to erase and write the place of a mission. A host waits so much longer
    /// for the answer before it asks again.
    const FLASH_MS: u16 = 0;

    /// Microseconds since the robot started, on the clock that [`Board::now_ticks`](crate::Board::now_ticks) counts.
    fn now_us(&mut self) -> u64;

    /// The next byte that arrived. A board keeps at least as many as arrive while the link waits for its turn.
    fn receive(&mut self) -> Option<u8>;

    /// Sends a byte. False if there is no room for it now.
    fn send(&mut self, byte: u8) -> bool;

    /// Takes bytes off the log; returns how many.
    fn read_log(&mut self, room: &mut [u8]) -> usize {
        let _ = room;
        0
    }

    /// Bytes that the log dropped for want of room; wraps.
    fn log_dropped(&self) -> u32 {
        0
    }

    /// Where the board keeps the robot's key. None: it has none, and cannot.
    fn key_safe(&mut self) -> Option<&mut dyn KeySafe> {
        None
    }

    /// The most bytes of stack that were in use since the start, where the board measures it. Asked for with each status.
    fn deepest_stack_bytes(&mut self) -> Option<u32> {
        None
    }

    /// Who remembers across a reset which mission is on trial and which was confirmed, if the board has somebody for it.
    fn keeper(&mut self) -> Option<&mut dyn MissionKeeper> {
        None
    }
}

/// A frame on its way out.
struct Outgoing<const N: usize> {
    frame: [u8; N],
    len: u8,
    sent: u8,
}

impl<const N: usize> Outgoing<N> {
    const NOTHING: Self = Outgoing {
        frame: [0; N],
        len: 0,
        sent: 0,
    };

    fn is_done(&self) -> bool {
        self.sent == self.len
    }

    fn is_begun(&self) -> bool {
        self.sent > 0 && !self.is_done()
    }

    fn set(&mut self, message: &FromDevice<'_>) {
        const { assert!(N <= u8::MAX as usize) };
        self.len = write(message, &mut self.frame);
        self.sent = 0;
    }

    /// Sends what the port takes. Returns whether the frame is gone.
    fn send(&mut self, port: &mut impl LinkPort) -> bool {
        while self.sent < self.len {
            let Some(byte) = self.frame.get(usize::from(self.sent)) else {
                break;
            };
            if !port.send(*byte) {
                return false;
            }
            self.sent += 1;
        }
        true
    }
}

/// Writes a message as a frame; returns its length.
#[inline(never)]
fn write(message: &FromDevice<'_>, frame: &mut [u8]) -> u8 {
    // What the firmware was built without it never says, and need not be able to write.
    if !is_said(message) {
        return 0;
    }
    // What does not fit is a defect of the message types, for which there is a test; then nothing is sent.
    encode(message, frame).unwrap_or(0) as u8
}

/// Whether this firmware has what a message is about.
fn is_said(message: &FromDevice<'_>) -> bool {
    match message {
        FromDevice::News(_) => NEWS,
        FromDevice::Reply {
            result:
                Ok(
                    Response::Param { .. }
                    | Response::ParamSet { .. }
                    | Response::ParamsSaved { .. },
                ),
            ..
        } => PARAMS,
        FromDevice::Reply {
            result: Ok(Response::Challenge { .. }),
            ..
        } => KEYS,
        _ => true,
    }
}

/// The link side of a runtime. A board polls it from a task of a low priority, when bytes have arrived or left, and now and then.
pub struct LinkSide<'q, 'm> {
    reader: FrameReader,
    reply: Outgoing<MAX_REPLY_FRAME_BYTES>,
    /// The reply says how far an upload has come, and no more: a later one speaks for it.
    acknowledges: bool,
    stream: Outgoing<{ MAX_STREAM_BYTES + STREAM_OVERHEAD }>,
    /// Number and checksum of the last request.
    last: Option<(u8, u32)>,
    /// The last request's answer is still to come.
    awaited: bool,
    stream_seq: [u8; CHANNELS],
    /// Whose turn it is to send.
    next_channel: Channel,
    /// Frames that arrived spoiled.
    spoiled_frames: u32,
    desk: Desk<'q, 'm>,
}

/// What requests are answered from.
pub(crate) struct Desk<'q, 'm> {
    pub(crate) registry: Registry<'m>,
    pub(crate) capacities: Capacities,
    pub(crate) about: About<'m>,
    /// Buffers that no mission is in.
    pub(crate) blobs: [Option<BlobBuffer<'m>>; 2],
    /// Memory of missions that do not run, and what has to do with it.
    pub(crate) rooms: Rooms<'m>,
    pub(crate) upload: Option<Upload<'m>>,
    /// The letter, while it is here.
    pub(crate) letter: Option<&'m mut Letter<'m>>,
    /// The request that is carried out, as long as it has asked nobody.
    pub(crate) ticket: Option<Ticket>,
    /// The request whose answer the letter will bring.
    pub(crate) asked: Option<Ticket>,
    pub(crate) to_real_time: Producer<'q, Posted<'m>>,
    pub(crate) from_real_time: Consumer<'q, &'m mut Letter<'m>>,
    pub(crate) freed: Consumer<'q, Freed<'m>>,
    /// The keeper's mission is to be started, as soon as the letter is here.
    pub(crate) start_wanted: bool,
    pub(crate) snapshot: SnapshotReader<'m>,
    pub(crate) trace: RingReader<'m>,
    pub(crate) trace_wanted: &'m AtomicBool,
    pub(crate) signs: &'m Signs,
    pub(crate) record: RecordReader<'m>,
    pub(crate) values: SampleReader<'m>,
    /// No part of a stream is on its way out.
    pub(crate) streams_are_sent: bool,
    pub(crate) log_wanted: bool,
    pub(crate) keys: Keys,
    /// The wish for news, if there is one.
    pub(crate) watch: Option<Watch>,
    /// The keeper was told that an emergency stop is latched, whoever latched it.
    pub(crate) stop_is_kept: bool,
}

/// What a request goes by while it is carried out.
#[derive(Clone, Copy)]
pub(crate) struct Ticket {
    seq: u8,
    /// When it is too late for it, on the board's clock in microseconds.
    by_us: u64,
}

/// A blob that arrives.
pub(crate) struct Upload<'m> {
    blob: BlobBuffer<'m>,
    len: u32,
    crc: u32,
    signed: Option<SignedUpload>,
}

impl Upload<'_> {
    fn received(&self) -> u32 {
        self.blob.len() as u32
    }
}

/// What becomes of a request.
enum Reaction<'a> {
    /// This is the answer.
    Answer(Result<Response<'a>, LinkError>),
    /// The real-time side was asked.
    Later,
}

impl<'q, 'm> LinkSide<'q, 'm> {
    pub(crate) fn new(desk: Desk<'q, 'm>) -> Self {
        LinkSide {
            reader: FrameReader::new(),
            reply: Outgoing::NOTHING,
            acknowledges: false,
            stream: Outgoing::NOTHING,
            last: None,
            awaited: false,
            stream_seq: [0; CHANNELS],
            next_channel: Channel::Trace,
            spoiled_frames: 0,
            desk,
        }
    }

    /// Starts the mission that the board's keeper has for the robot, if it has one. To be called once, before all else.
    ///
    /// A robot that was reset by a defect again and again, each time after no time, starts none: see [`Kept::may_start_by_itself`](crate::Kept::may_start_by_itself).
    /// One whose board remembers an emergency stop starts it, too, and moves nothing.
    pub fn start(&mut self, port: &mut impl LinkPort) {
        if port
            .keeper()
            .is_some_and(|keeper| keeper.is_emergency_stopped())
        {
            self.desk.latch_emergency_stop();
        }
        if self
            .desk
            .about
            .kept
            .is_none_or(|kept| kept.may_start_by_itself())
        {
            self.desk.start_kept(port);
        }
    }

    /// Does what can be done without waiting. Returns whether there is more to do at once: bytes to send that the port did not take,
    /// or streams to go on with.
    pub fn poll(&mut self, port: &mut impl LinkPort) -> bool {
        self.desk.signs.link.store(true, Ordering::Relaxed);
        loop {
            self.desk.take_freed(port);
            self.take_answer(port);
            self.desk.keep_stop(port);
            self.receive(port);
            // A frame that was begun comes first, then an answer, then streams: so an answer waits for one stream frame at most.
            if self.stream.is_begun() && !self.stream.send(port) {
                return true;
            }
            if self.reply.is_done() {
                break;
            }
            if !self.reply.send(port) {
                return true;
            }
            // The answer is out: there may be another request behind it.
        }
        if self.stream.is_done() {
            self.fill_stream(port);
        }
        let idle = self.stream.is_done();
        self.stream.send(port);
        !idle
    }

    /// Whether an answer of the real-time side is awaited: a board may poll again after the next slot.
    pub fn is_waiting(&self) -> bool {
        self.desk.asked.is_some()
    }

    /// Takes bytes up to the end of a request, and answers it.
    fn receive(&mut self, port: &mut impl LinkPort) {
        // Chunks come one behind the other: none of them waits for the wire to take the answer to the one before.
        while self.reply.is_done() || (self.acknowledges && self.reply.sent == 0) {
            let Some(byte) = port.receive() else { return };
            let Some(frame) = self.reader.push(byte) else {
                continue;
            };
            // The checksum of the encoded bytes tells requests apart before they are decoded in place.
            let crc = checksum(frame);
            let message = match decode::<ToDevice<'_>>(frame) {
                Ok(message) => message,
                Err(FrameError::NotAMessage) => {
                    // It arrived as it was sent, so that sending it again is no use: say so. Its number comes first.
                    let seq = frame.first().copied().unwrap_or_default();
                    self.last = None;
                    self.acknowledges = false;
                    self.reply.set(&FromDevice::Reply {
                        seq,
                        result: Err(LinkError::Malformed),
                    });
                    continue;
                }
                Err(_) => {
                    self.spoiled_frames = self.spoiled_frames.wrapping_add(1);
                    continue;
                }
            };
            // Only this side counts them, so load and store suffice.
            let requests = &self.desk.signs.requests;
            requests.store(
                requests.load(Ordering::Relaxed).wrapping_add(1),
                Ordering::Relaxed,
            );
            let seq = message.seq;
            if message.request == Request::Hello {
                self.stream_seq = [0; CHANNELS];
            } else if self.last == Some((seq, crc)) && !planted!(CarriedOutTwice) {
                // Asked again: the answer was lost, or is still to come.
                if !self.awaited {
                    self.reply.sent = 0;
                }
                continue;
            }
            self.last = Some((seq, crc));
            self.desk.streams_are_sent = self.stream.is_done();
            let is_chunk = matches!(message.request, Request::Chunk { .. });
            match self.desk.react(seq, &message.request, port) {
                Reaction::Answer(result) => {
                    self.awaited = false;
                    self.acknowledges = is_chunk;
                    self.reply.set(&FromDevice::Reply { seq, result });
                }
                Reaction::Later => self.awaited = true,
            }
        }
    }

    /// Passes an answer of the real-time side on.
    fn take_answer(&mut self, port: &mut impl LinkPort) {
        let Some((asked, letter)) = self.desk.open_letter() else {
            return;
        };
        if PARAMS && let Letter::Changed(saved) = *letter {
            // The flash has it before the robot counts on it.
            let is_late = asked.is_some_and(|asked| port.now_us() > asked.by_us);
            let kept = match port.keeper() {
                _ if is_late => Err(LinkError::Late),
                Some(keeper) => keeper.save_params(&saved),
                None => Err(LinkError::NoStore),
            };
            match kept {
                Ok(()) => {
                    *letter = Letter::Saved(saved);
                    self.desk.letter = Some(letter);
                    // What was saved is in force, however late it has become.
                    let by_us = NO_DEADLINE;
                    self.desk.ticket = asked.map(|asked| Ticket { by_us, ..asked });
                    self.desk.post();
                    return;
                }
                Err(error) => *letter = Letter::Failed(error),
            }
        }
        let kept = keep_in_mind(letter, port.keeper());
        if let Letter::Released = letter {
            // Pressed again meanwhile, the button has latched another stop.
            self.desk.stop_is_kept = false;
        }
        if let (true, Some((last, _))) = (self.awaited, self.last)
            && asked.is_some_and(|asked| asked.seq == last)
        {
            self.awaited = false;
            self.acknowledges = false;
            if let Letter::ValuesWanted { number, mission } = *letter {
                self.desk.values.begin(number, mission);
            }
            self.reply.set(&FromDevice::Reply {
                seq: last,
                result: kept.and_then(|()| answer_of(letter)),
            });
        }
        self.desk.put_away(letter);
    }

    /// Makes a frame of what a stream holds, if one of them holds something.
    #[inline(never)]
    fn fill_stream(&mut self, port: &mut impl LinkPort) {
        if let Some(news) = self.desk.news(self.spoiled_frames) {
            self.stream.set(&FromDevice::News(news));
            return;
        }
        for _ in 0..CHANNELS {
            let channel = self.next_channel;
            self.next_channel = match channel {
                Channel::Trace => Channel::Log,
                Channel::Log => Channel::Record,
                Channel::Record if TELEMETRY => Channel::Values,
                Channel::Record | Channel::Values => Channel::Trace,
            };
            let mut bytes = [0; MAX_STREAM_BYTES];
            let (len, continues, dropped) = match channel {
                Channel::Trace => {
                    let part = self.desk.trace.read(&mut bytes);
                    (part.len, part.continues, self.desk.trace.dropped())
                }
                Channel::Log if self.desk.log_wanted => {
                    (port.read_log(&mut bytes), false, port.log_dropped())
                }
                Channel::Log => continue,
                Channel::Record => {
                    let part = self.desk.record.read(&mut bytes);
                    (part.len, part.continues, self.desk.record.dropped())
                }
                Channel::Values => {
                    let snapshot = &self.desk.snapshot;
                    let runs = || snapshot.read().map(|health| health.mission);
                    let len = self.desk.values.read(&mut bytes, runs);
                    (len, false, self.desk.values.dropped())
                }
            };
            let wanted = match channel {
                Channel::Trace => self.desk.trace_wanted.load(Ordering::Relaxed),
                Channel::Log | Channel::Values => true,
                Channel::Record => self.desk.record.is_wanted(),
            };
            let (Some(bytes), Some(seq)) =
                (bytes.get(..len), self.stream_seq.get_mut(channel as usize))
            else {
                continue;
            };
            if bytes.is_empty() || !wanted {
                continue;
            }
            self.stream.set(&FromDevice::Stream(Stream {
                channel,
                seq: *seq,
                continues,
                dropped,
                bytes,
            }));
            *seq = seq.wrapping_add(1);
            return;
        }
    }
}

/// Checks a blob by itself, before the robot has a say.
// Not inlined: nothing else should run on top of what the verifier needs of the stack.
#[inline(never)]
fn verified(blob: BlobBuffer<'_>) -> Result<Verified<BlobBuffer<'_>>, (BlobBuffer<'_>, Refusal)> {
    esm_core::verify(blob)
}

/// Lets the keeper remember what a letter says of a trial.
fn keep_in_mind(
    letter: &Letter<'_>,
    keeper: Option<&mut dyn MissionKeeper>,
) -> Result<(), LinkError> {
    let Some(keeper) = keeper else { return Ok(()) };
    match *letter {
        Letter::Swapped {
            mission,
            on_trial: false,
            ..
        }
        | Letter::Confirmed { mission } => keeper.trial_confirmed(mission),
        // What comes back as it went does not even begin.
        Letter::Swap { ref mission, .. } => {
            keeper.trial_failed(mission.mission().hash());
            Ok(())
        }
        Letter::Released => keeper.set_emergency_stop(false),
        _ => Ok(()),
    }
}

/// Takes a request out of the one that brings its deadline, if it is in one. Answers that.
fn take_out(request: &mut Request<'_>) -> Result<u64, LinkError> {
    let Request::Within {
        by_us,
        request: bytes,
    } = *request
    else {
        return Ok(NO_DEADLINE);
    };
    *request = deserialized(bytes)?;
    if may_have_deadline(request) {
        // What goes beyond that is as far away.
        Ok(by_us.min(NO_DEADLINE))
    } else {
        Err(LinkError::Malformed)
    }
}

/// A request that another one holds.
#[inline(never)]
fn deserialized(bytes: &[u8]) -> Result<Request<'_>, LinkError> {
    match postcard::take_from_bytes(bytes) {
        Ok((request, [])) => Ok(request),
        _ => Err(LinkError::Malformed),
    }
}

/// What the board keeps of parameters.
fn saved_params(port: &mut impl LinkPort) -> SavedParams {
    let keeper = port.keeper();
    keeper.map_or(SavedParams::NONE, |keeper| keeper.saved_params())
}

/// A part of a text, from this byte on.
fn task_text<'a>(text: &'static str, offset: usize) -> Response<'a> {
    let text = text.as_bytes();
    let rest = text.get(offset..).unwrap_or_default();
    Response::TaskText {
        total: text.len() as u16,
        text: rest.get(..MAX_PART).unwrap_or(rest),
    }
}

/// The answer that a letter brings.
fn answer_of<'l>(letter: &'l Letter<'_>) -> Result<Response<'l>, LinkError> {
    match letter {
        Letter::Swapped {
            mission, carried, ..
        } => Ok(Response::Committed {
            mission: *mission,
            carried: *carried,
        }),
        Letter::Failed(error) => Err(*error),
        Letter::Blob { total, bytes } => Ok(Response::Blob {
            total: *total,
            data: bytes.as_slice(),
        }),
        Letter::States { step, total, bytes } => Ok(Response::States {
            step: *step,
            total: *total,
            states: bytes.as_slice(),
        }),
        Letter::Slot(counters) => Ok(Response::Slot(*counters)),
        Letter::Task(counters) => Ok(Response::TaskInstance(*counters)),
        Letter::Param {
            value,
            of_mission,
            saved,
        } => Ok(Response::Param {
            value: *value,
            of_mission: *of_mission,
            saved: *saved,
        }),
        Letter::Fields { text, offset } => Ok(task_text(text, usize::from(*offset))),
        Letter::ParamsSaved { count } => Ok(Response::ParamsSaved { count: *count }),
        Letter::ParamSet { before } => Ok(Response::ParamSet { before: *before }),
        Letter::Done
        | Letter::Confirmed { .. }
        | Letter::Released
        | Letter::ValuesWanted { .. } => Ok(Response::Done),
        // It came back as it went.
        _ => Err(LinkError::Late),
    }
}

impl<'m> Desk<'_, 'm> {
    /// Carries a request out, if whoever sent it may.
    fn react<'a, P: LinkPort>(
        &'a mut self,
        seq: u8,
        request: &Request<'_>,
        port: &mut P,
    ) -> Reaction<'a> {
        let mut request = *request;
        match self.allowed(&mut request, port) {
            Ok(by_us) => {
                self.ticket = Some(Ticket { seq, by_us });
                self.carry_out(&request, port)
            }
            Err(error) => Reaction::Answer(Err(error)),
        }
    }

    /// Whether who sent a request may, and it is not too late for it. Takes it out of what it is in, and answers its deadline.
    fn allowed(
        &mut self,
        request: &mut Request<'_>,
        port: &mut impl LinkPort,
    ) -> Result<u64, LinkError> {
        let signed = match *request {
            Request::Signed { signature, request } => Some((signature, request)),
            _ => None,
        };
        if let Some((_, bytes)) = signed {
            *request = deserialized(bytes)?;
        }
        let by_us = take_out(request)?;
        match signed {
            Some((signature, bytes)) => self.check_signed(request, signature, bytes, port)?,
            None => match (needs(request), self.keys.access(port.key_safe())) {
                (Needs::Nothing, _) | (Needs::Key, Access::Unsupported | Access::Open) => {}
                (Needs::Key, Access::Locked) if planted!(KeyForgotten) => {}
                (Needs::Key, Access::Locked) => return Err(LinkError::NeedsKey),
                (Needs::Key, Access::Unreadable) => return Err(LinkError::NotKept),
            },
        }
        let forgotten = match signed {
            Some(_) => planted!(SignedCarriedOutLate),
            None => planted!(CarriedOutLate),
        };
        // A signature takes its time, too: it is looked at the clock behind it.
        if port.now_us() > by_us && !forgotten {
            return Err(LinkError::Late);
        }
        Ok(by_us)
    }

    /// Carries a request out.
    fn carry_out<'a, P: LinkPort>(
        &'a mut self,
        request: &Request<'_>,
        port: &mut P,
    ) -> Reaction<'a> {
        match *request {
            Request::Hello => {
                self.trace_wanted.store(false, Ordering::Relaxed);
                self.log_wanted = false;
                self.watch = None;
                self.values.end();
                // To end one is never refused.
                let _ = self.record.want(false);
                let access = self.keys.access(port.key_safe());
                Reaction::Answer(Ok(Response::Hello(self.introduce(P::WINDOW_BYTES, access))))
            }
            Request::Begin { len, crc } => Reaction::Answer(self.begin(len, crc, port)),
            Request::Chunk { offset, data } => Reaction::Answer(self.chunk(offset, data)),
            Request::Commit(swap) => self.commit(swap, port),
            Request::Abort => {
                if !planted!(AbortForgotten) {
                    self.end_upload();
                }
                Reaction::Answer(Ok(Response::Done))
            }
            Request::Status => {
                let kept = port.keeper().map(|keeper| keeper.kept());
                Reaction::Answer(self.status(port.deepest_stack_bytes(), kept))
            }
            Request::Stop => self.ask(Letter::Stop),
            Request::Start => self.ask(Letter::Start),
            Request::EmergencyStop => Reaction::Answer(self.emergency_stop(port)),
            Request::Release => self.ask(Letter::Release),
            Request::Task { index, offset } => Reaction::Answer(self.task_text(index, offset)),
            Request::ReadBlob { offset } => self.ask(Letter::ReadBlob { offset }),
            Request::States { first } => self.ask(Letter::ReadStates { first }),
            Request::SlotCounters { slot } => self.ask(Letter::ReadSlot { slot }),
            Request::TaskCounters { task_instance } => self.ask(Letter::ReadTask { task_instance }),
            Request::Confirm { mission } => self.ask(Letter::Confirm { mission }),
            Request::FallBack { mission } => self.ask(Letter::FallBack { mission }),
            Request::LastWords => Reaction::Answer(self.last_words()),
            Request::BlackBox { from } => Reaction::Answer(self.black_box(from)),
            Request::Param { .. } | Request::SetParam { .. } | Request::SaveParams { .. }
                if !PARAMS =>
            {
                Reaction::Answer(Err(LinkError::NotBuiltIn))
            }
            Request::Param { mission, param } => self.ask(Letter::ReadParam { mission, param }),
            Request::SetParam {
                mission,
                param,
                value,
            } => self.ask(Letter::SetParam {
                mission,
                param,
                value,
            }),
            Request::SaveParams { mission } => match port.keeper() {
                Some(_) => self.ask(Letter::ReadChanged { mission }),
                None => Reaction::Answer(Err(LinkError::NoStore)),
            },
            Request::Watch { news: true, .. } if !NEWS => {
                Reaction::Answer(Err(LinkError::NotBuiltIn))
            }
            Request::Watch { news, period_ms } => {
                self.watch = news.then(|| Watch::new(period_ms));
                Reaction::Answer(Ok(Response::Done))
            }
            Request::Subscribe { log: true, .. } if !P::KEEPS_LOG => {
                Reaction::Answer(Err(LinkError::NotBuiltIn))
            }
            Request::Subscribe { trace, log, record } => {
                if let Err(error) = self.record.want(record) {
                    return Reaction::Answer(Err(error));
                }
                self.trace_wanted.store(trace, Ordering::Relaxed);
                self.log_wanted = log;
                Reaction::Answer(Ok(Response::Done))
            }
            Request::Challenge
            | Request::Sign { .. }
            | Request::InstallKey { .. }
            | Request::RemoveKey => Reaction::Answer(match port.key_safe() {
                Some(safe) => self.of_keys(request, safe),
                None => Err(LinkError::NoKeySupport),
            }),
            Request::Clock => Reaction::Answer(Ok(Response::Clock {
                now_us: port.now_us(),
            })),
            Request::Features => Reaction::Answer(Ok(self.features(port))),
            Request::Values { .. } if !TELEMETRY => Reaction::Answer(Err(LinkError::NotBuiltIn)),
            Request::Values { ask: [] } => {
                self.values.end();
                Reaction::Answer(Ok(Response::Done))
            }
            Request::Values { ask } => {
                let number = self.ticket.map_or(0, |ticket| ticket.seq);
                let ask = Bytes::first_of(ask);
                self.ask(Letter::AskValues { number, ask })
            }
            // They hold a plain one: `allowed` gives nothing else out.
            Request::Signed { .. } | Request::Within { .. } => {
                Reaction::Answer(Err(LinkError::Malformed))
            }
        }
    }

    /// Stops the robot, without the letter, which may be under way.
    fn emergency_stop(&mut self, port: &mut impl LinkPort) -> Result<Response<'_>, LinkError> {
        self.latch_emergency_stop();
        self.stop_is_kept = true;
        if let Some(keeper) = port.keeper() {
            keeper.set_emergency_stop(true)?;
        }
        Ok(Response::Done)
    }

    /// Lets the keeper remember a stop that the button has latched, so that it outlasts a loss of power, too. Once: a flash that does not take it wears out by asking again.
    fn keep_stop(&mut self, port: &mut impl LinkPort) {
        let is_latched = self.signs.emergency_stop.load(Ordering::Relaxed);
        if is_latched == self.stop_is_kept {
            return;
        }
        self.stop_is_kept = is_latched;
        if is_latched
            && let Some(keeper) = port.keeper()
            && keeper.set_emergency_stop(true).is_err()
        {
            error!("the flash does not keep the emergency stop: a loss of power ends it");
        }
    }

    /// Lets the real-time side switch the motors off before it next exchanges anything with the body, and after each reset.
    fn latch_emergency_stop(&self) {
        if let Some(kept) = self.about.kept {
            kept.set_emergency_stop(true);
        }
        self.signs.emergency_stop.store(true, Ordering::Release);
    }

    /// Whether the key has signed this request, which `bytes` are.
    fn check_signed(
        &mut self,
        request: &Request<'_>,
        signature: &[u8],
        bytes: &[u8],
        port: &mut impl LinkPort,
    ) -> Result<(), LinkError> {
        let safe = port.key_safe().ok_or(LinkError::NoKeySupport)?;
        if needs(request) != Needs::Key {
            return Err(LinkError::Malformed);
        }
        // So that a nonce is not spent on what cannot be done now.
        if self.letter.is_none() {
            return Err(LinkError::Busy);
        }
        let upload = match (request, &self.upload) {
            (
                Request::Commit(_),
                Some(Upload {
                    signed: Some(signed),
                    ..
                }),
            ) => Some(signed),
            _ => None,
        };
        self.keys.check_command(safe, signature, upload, bytes)
    }

    /// Answers what is about keys alone.
    #[inline(never)]
    fn of_keys(
        &mut self,
        request: &Request<'_>,
        safe: &mut dyn KeySafe,
    ) -> Result<Response<'_>, LinkError> {
        match *request {
            Request::Challenge => {
                let (nonce, counter, key) = self.keys.challenge(safe)?;
                Ok(Response::Challenge {
                    nonce,
                    counter,
                    key,
                })
            }
            Request::Sign { counter, signature } => {
                let upload = self.upload.as_mut().ok_or(LinkError::NoUpload)?;
                if upload.received() != upload.len {
                    return Err(LinkError::Incomplete {
                        received: upload.received(),
                    });
                }
                upload.signed =
                    Some(
                        self.keys
                            .check_upload(safe, counter, signature, &upload.blob)?,
                    );
                Ok(Response::Done)
            }
            Request::InstallKey {
                key,
                seed,
                signature,
            } => {
                self.keys.install(safe, key, seed, signature)?;
                // What another key has signed is not signed.
                if let Some(upload) = &mut self.upload {
                    upload.signed = None;
                }
                Ok(Response::Done)
            }
            Request::RemoveKey => {
                self.keys.remove(safe)?;
                Ok(Response::Done)
            }
            _ => Err(LinkError::Malformed),
        }
    }

    fn news(&mut self, spoiled_frames: u32) -> Option<News> {
        let watch = self.watch.as_mut().filter(|_| NEWS)?;
        watch.news(self.snapshot.read()?, spoiled_frames)
    }

    fn introduce(&self, window_bytes: u16, access: Access) -> DeviceInfo<'_> {
        DeviceInfo {
            protocol: PROTOCOL_VERSION,
            firmware: self.about.firmware,
            board: self.about.board,
            task_types: self.registry.len() as u8,
            capacities: self.capacities,
            mission: self.snapshot.read().and_then(|health| health.mission),
            reset: self.about.reset,
            uploads: Uploads {
                chunk_bytes: MAX_CHUNK as u16,
                window_bytes,
            },
            access,
        }
    }

    /// What this firmware was built with, as far as its board has the parts for it.
    fn features<P: LinkPort>(&self, port: &mut P) -> Response<'static> {
        let has_store = port.keeper().is_some();
        let built_in = Features::NONE
            .with(Feature::Record, RECORD)
            .with(Feature::Log, P::KEEPS_LOG)
            .with(Feature::News, NEWS)
            .with(Feature::Params, PARAMS)
            .with(Feature::Warm, WARM)
            .with(Feature::Keys, port.key_safe().is_some())
            .with(Feature::Store, has_store)
            .with(
                Feature::BlackBox,
                KEEPS_RECORDS && self.about.kept.is_some(),
            )
            .with(Feature::Telemetry, TELEMETRY);
        Response::Features {
            built_in,
            flash_ms: if has_store { P::FLASH_MS } else { 0 },
        }
    }

    fn status(
        &self,
        stack_bytes: Option<u32>,
        kept: Option<Kept>,
    ) -> Result<Response<'_>, LinkError> {
        let health = self.snapshot.read().ok_or(LinkError::NoAnswer)?;
        // Latched is latched, also where the real-time side has had no occasion to say so.
        let mode = if self.signs.emergency_stop.load(Ordering::Relaxed) {
            Mode::EmergencyStopped
        } else {
            health.mode
        };
        Ok(Response::Status(Status {
            mode,
            mission: health.mission,
            steps: health.steps,
            t_us: health.t_us,
            executed: health.executed,
            missed: health.missed,
            overruns: health.overruns,
            max_delay_ns: health.max_delay_ns,
            trace_dropped: self.trace.dropped(),
            background_busy: health.background_busy,
            stack_bytes,
            reset: self.about.reset,
            trial: health.trial,
            fell_back: health.fell_back,
            kept,
            changed_params: health.changed_params,
            record_dropped: self.record.dropped(),
            record_pending: !(self.record.is_empty() && self.streams_are_sent),
            saved_params: health.saved_params,
            stop_pressed: self.signs.stop_pressed.load(Ordering::Relaxed),
        }))
    }

    /// How the run before this one ended.
    #[inline(never)]
    fn last_words(&mut self) -> Result<Response<'_>, LinkError> {
        let Some(kept) = self.about.kept else {
            return Ok(Response::LastWords {
                words: LastWords::of(self.about.reset),
                file: &[],
            });
        };
        let (words, place) = kept.last_words();
        let file = self.note(Bytes::first_of(place.as_bytes()))?;
        Ok(Response::LastWords { words, file })
    }

    /// Records from this sequence number on, as many as fit.
    #[inline(never)]
    fn black_box(&mut self, from: Option<u32>) -> Result<Response<'_>, LinkError> {
        let mut bytes = Bytes::EMPTY;
        let Some(kept) = self.about.kept else {
            return Ok(Response::BlackBox {
                end: 0,
                records: &[],
            });
        };
        let end = kept.black_box.end();
        let mut next = from;
        // The end is looked at first, so that this ends however fast records are written.
        while next != Some(end)
            && let Some(record) = kept.black_box.first_from(next)
            && bytes.push(record.to_bytes())
        {
            next = Some(record.sequence.wrapping_add(1));
        }
        let records = self.note(bytes)?;
        Ok(Response::BlackBox { end, records })
    }

    /// Keeps bytes until they are sent, in the letter that nobody writes now.
    fn note(&mut self, bytes: Bytes) -> Result<&[u8], LinkError> {
        let letter = self.letter.as_mut().ok_or(LinkError::Busy)?;
        **letter = Letter::Note(bytes);
        match &**letter {
            Letter::Note(bytes) => Ok(bytes.as_slice()),
            _ => Ok(&[]),
        }
    }

    fn task_text(&self, index: u8, offset: u16) -> Result<Response<'_>, LinkError> {
        let declaration = self
            .registry
            .declaration(usize::from(index))
            .ok_or(LinkError::NoSuchIndex)?;
        Ok(task_text(declaration.source, usize::from(offset)))
    }

    /// The buffer for the next mission holds the one before as long as one is on trial.
    fn refuse_on_trial(&self) -> Result<(), LinkError> {
        let health = self.snapshot.read().ok_or(LinkError::NoAnswer)?;
        health.trial.map_or(Ok(()), |_| Err(LinkError::OnTrial))
    }

    fn begin(
        &mut self,
        len: u32,
        crc: u32,
        port: &mut impl LinkPort,
    ) -> Result<Response<'_>, LinkError> {
        self.refuse_on_trial()?;
        // Whose trial has just ended has given its buffer back before it said so.
        self.take_freed(port);
        let resumed = self.upload.as_ref().filter(|upload| {
            let is_same_len = upload.len == len || planted!(OtherLengthResumed);
            let is_same_blob = upload.crc == crc || planted!(OtherBlobResumed);
            is_same_len && is_same_blob
        });
        if let Some(upload) = resumed {
            return Ok(Response::Received {
                len: upload.received(),
            });
        }
        if len > self.capacities.blob_bytes && !planted!(CapacityForgotten) {
            return Err(LinkError::CapacityExceeded {
                what: Capacity::BlobBytes,
                needed: len,
                available: self.capacities.blob_bytes,
            });
        }
        self.end_upload();
        let mut blob = self
            .blobs
            .iter_mut()
            .find_map(Option::take)
            .ok_or(LinkError::Busy)?;
        blob.clear();
        self.upload = Some(Upload {
            blob,
            len,
            crc,
            signed: None,
        });
        Ok(Response::Received { len: 0 })
    }

    fn chunk(&mut self, offset: u32, data: &[u8]) -> Result<Response<'_>, LinkError> {
        let upload = self.upload.as_mut().ok_or(LinkError::NoUpload)?;
        let received = upload.received();
        // What came before is passed over: it was sent again because its answer was lost, or late.
        let known = received
            .checked_sub(if planted!(GapTaken) {
                offset.min(received)
            } else {
                offset
            })
            .ok_or(LinkError::WrongOffset { expected: received })?;
        let known = if planted!(OverlapRepeated) { 0 } else { known };
        let data = data.get(known as usize..).unwrap_or_default();
        let is_too_long = data.len() as u32 > upload.len - received && !planted!(LengthForgotten);
        if is_too_long || !upload.blob.push(data) {
            return Err(LinkError::TooLong);
        }
        Ok(Response::Received {
            len: upload.received(),
        })
    }

    /// Checks the blob that was uploaded, and hands it over.
    // Not inlined: what it needs of the stack is needed for no other request.
    #[inline(never)]
    fn commit<'a>(&mut self, swap: Swap, port: &mut impl LinkPort) -> Reaction<'a> {
        self.tell_of_mission(true);
        match self.stage(swap, port) {
            Ok(()) => self.post(),
            Err(error) => {
                self.tell_of_mission(false);
                Reaction::Answer(Err(error))
            }
        }
    }

    /// Tells the real-time side that a mission is to come, so that it looks for it in time.
    fn tell_of_mission(&self, is_coming: bool) {
        if WARM {
            self.signs
                .mission_is_coming
                .store(is_coming, Ordering::Relaxed);
        }
    }

    /// Checks the blob that was uploaded, and puts it into the letter.
    fn stage(&mut self, swap: Swap, port: &mut impl LinkPort) -> Result<(), LinkError> {
        // The upload stays: it can be taken cold.
        if swap.warm && !WARM {
            return Err(LinkError::NotBuiltIn);
        }
        if self.letter.is_none() {
            return Err(LinkError::Busy);
        }
        self.refuse_on_trial()?;
        let upload = self.upload.as_ref().ok_or(LinkError::NoUpload)?;
        if upload.received() != upload.len && !planted!(IncompleteTaken) {
            return Err(LinkError::Incomplete {
                received: upload.received(),
            });
        }
        let crc = upload.crc;
        let signed = upload.signed;
        if signed.is_none()
            && !planted!(UnsignedTaken)
            && self.keys.access(port.key_safe()) == Access::Locked
        {
            return Err(LinkError::NotSigned);
        }
        let Some(Upload { blob, .. }) = self.upload.take() else {
            return Err(LinkError::NoUpload);
        };
        if checksum(&blob) != crc && !planted!(WholeUnchecked) {
            self.keep(blob);
            return Err(LinkError::WrongChecksum);
        }
        if let Err(error) = check_slots(&blob, &self.capacities) {
            self.keep(blob);
            return Err(error);
        }
        let verified = match verified(blob) {
            Ok(verified) => verified,
            Err((blob, refusal)) => {
                self.keep(blob);
                return Err(LinkError::Invalid(refusal));
            }
        };
        if let Err(error) = check(&verified, self.registry, &self.capacities) {
            self.keep(verified.into_bytes());
            return Err(error);
        }
        let mission = self.prepare(verified, swap.warm)?;
        let accepted = self
            .accept(signed.as_ref(), port)
            .and_then(|()| match port.keeper() {
                Some(keeper) => keeper.trial_begins(mission.mission().bytes()),
                None => Ok(()),
            });
        match (accepted, &mut self.letter) {
            (Ok(()), Some(letter)) => {
                **letter = Letter::Swap {
                    mission,
                    swap,
                    saved: saved_params(port),
                };
                Ok(())
            }
            (accepted, _) => {
                let blob = self.rooms.take_apart(mission);
                self.keep(blob);
                Err(accepted.err().unwrap_or(LinkError::Busy))
            }
        }
    }

    /// Makes what a mission needs, while the one before drives. Keeps the buffer of one that it cannot be made for.
    #[inline(never)]
    fn prepare(
        &mut self,
        mission: Verified<BlobBuffer<'m>>,
        warm: bool,
    ) -> Result<Upcoming<'m>, LinkError> {
        match self.rooms.prepare(mission, warm, self.registry) {
            Ok(mission) => Ok(mission),
            Err((error, blob)) => {
                if let Some(blob) = blob {
                    self.keep(blob);
                }
                Err(error)
            }
        }
    }

    /// Takes buffers that missions were in, and lets the keeper remember which of them failed.
    fn take_freed(&mut self, port: &mut impl LinkPort) {
        while let Some(Freed {
            mut blob,
            spare,
            fell_back,
        }) = self.freed.dequeue()
        {
            self.rooms.keep(&mut blob, spare);
            self.keep(blob);
            if let (Some(fell_back), Some(keeper)) = (fell_back, port.keeper()) {
                self.start_wanted |= keeper.trial_failed(fell_back.mission);
            }
        }
        if self.start_wanted {
            self.start_wanted = !self.start_kept(port);
        }
    }

    /// Starts the mission that the board's keeper has for the robot, if it has one. Returns false if that is to be tried again, for the letter is under way.
    // Not inlined: what it needs of the stack is needed for nothing else.
    #[inline(never)]
    fn start_kept(&mut self, port: &mut impl LinkPort) -> bool {
        let Some(keeper) = port.keeper() else {
            return true;
        };
        if self.letter.is_none() {
            return false;
        }
        let Some(mut blob) = self.blobs.iter_mut().find_map(Option::take) else {
            return false;
        };
        let (registry, capacities) = (self.registry, &self.capacities);
        let mut start = Start::Nothing;
        blob.fill(|room| {
            start = keeper.choose(room, &mut |bytes| {
                check_slots(bytes, capacities).is_ok()
                    && esm_core::verify(bytes)
                        .is_ok_and(|verified| check(&verified, registry, capacities).is_ok())
            });
            match start {
                Start::Mission { len, .. } => len,
                Start::Nothing => 0,
            }
        });
        let Start::Mission { on_trial, .. } = start else {
            self.keep(blob);
            return true;
        };
        let mission = match verified(blob) {
            Ok(mission) => self.prepare(mission, false),
            Err((blob, _)) => {
                self.keep(blob);
                return true;
            }
        };
        match (mission, &mut self.letter) {
            (Ok(mission), Some(letter)) => {
                let trial_ms = if on_trial { TRIAL_AT_START_MS } else { 0 };
                let swap = Swap {
                    warm: false,
                    trial_ms,
                };
                **letter = Letter::Swap {
                    mission,
                    swap,
                    saved: saved_params(port),
                };
                // Nobody asked for it.
                self.ticket = None;
                self.post();
            }
            (Ok(mission), None) => {
                let blob = self.rooms.take_apart(mission);
                self.keep(blob);
            }
            // It was kept.
            (Err(_), _) => {}
        }
        true
    }

    /// Keeps the counter of a signed upload, before its mission runs: what follows is newer, whatever happens.
    fn accept(
        &mut self,
        signed: Option<&SignedUpload>,
        port: &mut impl LinkPort,
    ) -> Result<(), LinkError> {
        match (signed, port.key_safe()) {
            (Some(signed), Some(safe)) => self.keys.accept(safe, signed),
            _ => Ok(()),
        }
    }

    fn end_upload(&mut self) {
        if let Some(upload) = self.upload.take() {
            self.keep(upload.blob);
        }
    }

    /// Puts a buffer back.
    fn keep(&mut self, blob: BlobBuffer<'m>) {
        if let Some(place) = self.blobs.iter_mut().find(|place| place.is_none()) {
            *place = Some(blob);
        }
    }

    /// Asks the real-time side.
    #[inline(never)]
    fn ask<'a>(&mut self, question: Letter<'m>) -> Reaction<'a> {
        match &mut self.letter {
            Some(letter) => {
                **letter = question;
                self.post()
            }
            None => Reaction::Answer(Err(LinkError::Busy)),
        }
    }

    /// Sends the letter to the real-time side, with what was put into it: for the request that is carried out, if one is.
    fn post<'a>(&mut self) -> Reaction<'a> {
        let Some(letter) = self.letter.take() else {
            return Reaction::Answer(Err(LinkError::Busy));
        };
        let asked = self.ticket.take();
        let by_us = match asked {
            Some(ticket) if !planted!(DeadlineForgotten) => ticket.by_us,
            _ => NO_DEADLINE,
        };
        match self.to_real_time.enqueue(Posted { letter, by_us }) {
            Ok(()) => {
                self.asked = asked;
                Reaction::Later
            }
            // There is one letter, so that there is always room.
            Err(Posted { letter, .. }) => {
                self.put_away(letter);
                Reaction::Answer(Err(LinkError::Busy))
            }
        }
    }

    /// The letter, if it has come back, and the request that it answers.
    fn open_letter(&mut self) -> Option<(Option<Ticket>, &'m mut Letter<'m>)> {
        let letter = self.from_real_time.dequeue()?;
        Some((self.asked.take(), letter))
    }

    /// Keeps the letter until there is something to ask, and the buffer that is in one that could not be sent.
    fn put_away(&mut self, letter: &'m mut Letter<'m>) {
        self.tell_of_mission(false);
        match core::mem::replace(letter, Letter::Empty) {
            Letter::Swap { mission, .. } => {
                let blob = self.rooms.take_apart(mission);
                self.keep(blob);
            }
            Letter::Swapped { pairs, .. } => self.rooms.keep_table(pairs),
            _ => {}
        }
        self.letter = Some(letter);
    }
}
