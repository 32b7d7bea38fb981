//! The robot's end of the link: takes frames, answers requests, sends streams where there is room.
//!
//! A board's bytes come and go by its `port`. What leaves is `outgoing` until the port has taken it: answers first, and `streams` where there is room. Requests are carried out at the `desk`,
//! which sees to it that whoever sent one may (`signing`), and in time: some are `answers` of what this side knows, others take the `letter` to the real-time side. An upload is a transaction,
//! from its `upload` to its `stage`. `kept_mission` is what the board keeps for the robot, and `stop` and `emergency` the stops that wait for no letter. `budget` is how much time all of it may take.
//!
//! *Invariant:* one request is carried out at a time, and one that comes again under its number is not carried out again: its answer is sent again.

mod answers;
mod budget;
mod desk;
mod emergency;
mod kept_mission;
mod letter;
mod outgoing;
mod overload;
mod port;
mod signing;
mod stage;
mod stop;
mod streams;
mod upload;

pub(crate) use desk::Desk;
pub use port::LinkPort;

use core::sync::atomic::Ordering;

use crate::features::PARAMS;
use crate::link::frame::{FrameError, FrameReader, MAX_REPLY_FRAME_BYTES, checksum, decode};
use crate::link::message::{Channel, FromDevice, LinkError, MAX_STREAM_BYTES, Request, ToDevice};
use crate::link::stop_listener::StopListener;
use crate::mail::{Letter, NO_DEADLINE};
use budget::Budget;
use desk::{Reaction, Ticket};
use kept_mission::keep_in_mind;
use letter::answer_of;
use outgoing::Outgoing;
use stop::is_stop;
use streams::{CHANNELS, STREAM_OVERHEAD};

/// Bytes of the line after which the link looks at the time that it has taken.
const BYTES_BETWEEN_LOOKS: u32 = 64;

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
    /// Frames that arrived spoiled, and requests that were left out for want of time.
    spoiled_frames: u32,
    /// Bytes of the line that had found no room when that was looked at last.
    lost_bytes: u32,
    budget: Budget,
    desk: Desk<'q, 'm>,
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
            lost_bytes: 0,
            budget: Budget::FULL,
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
            self.desk.signs.latch_emergency_stop(self.desk.about.kept);
        }
        let kept = self.desk.about.kept;
        let may_start = kept.is_none_or(|kept| kept.may_start_by_itself());
        self.desk.start_kept(port, may_start);
    }

    /// Hears stops among the bytes of the line, where a board takes them in: one for each line.
    pub fn stop_listener(&self) -> StopListener<'m> {
        StopListener::new(self.desk.signs, self.desk.about.kept)
    }

    /// Does what can be done without waiting, as long as there is [time for it](LinkPort::LINK_PERCENT). Returns whether there is more to do at once: bytes to send that the port did not take,
    /// or streams to go on with.
    pub fn poll(&mut self, port: &mut impl LinkPort) -> bool {
        self.begin_turn(port);
        let has_more = self.work(port);
        self.charge(port);
        // What is left waits for its time.
        has_more && self.budget.is_left()
    }

    fn begin_turn<P: LinkPort>(&mut self, port: &mut P) {
        let slots_us = self.desk.signs.slots_us.load(Ordering::Relaxed);
        self.budget.begin::<P>(port.now_us(), slots_us);
        let lost_bytes = self.desk.signs.stops.lost_bytes();
        if lost_bytes != self.lost_bytes {
            // Whatever frames they were of.
            self.lost_bytes = lost_bytes;
            self.spoiled_frames = self.spoiled_frames.wrapping_add(1);
        }
    }

    /// Counts what the link has done as work.
    fn charge<P: LinkPort>(&mut self, port: &mut P) {
        let signs = self.desk.signs;
        let slots_us = signs.slots_us.load(Ordering::Relaxed);
        let worked_us = self.budget.charge::<P>(port.now_us(), slots_us);
        // Only this side counts it, so load and store suffice.
        let before_us = signs.link_us.load(Ordering::Relaxed);
        let link_us = before_us.wrapping_add(worked_us);
        signs.link_us.store(link_us, Ordering::Relaxed);
    }

    /// Whether there is time for what comes next: for a stop that was heard also where there is none for others.
    fn may_receive(&mut self) -> bool {
        self.budget.is_left()
            || self.budget.is_left_for_a_stop()
                && self.desk.place.is_stop_ahead(&self.desk.signs.stops)
    }

    fn work(&mut self, port: &mut impl LinkPort) -> bool {
        loop {
            self.desk.signs.link.store(true, Ordering::Relaxed);
            self.desk.take_freed(port);
            self.take_answer(port);
            self.tell_stopped();
            self.tell_chunk();
            self.desk.keep_stop(port);
            self.receive(port);
            // Where the real-time side was called, it has come already.
            self.tell_stopped();
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
        if self.stream.is_done() && self.budget.is_left() {
            self.fill_stream(port);
        }
        let idle = self.stream.is_done();
        self.stream.send(port);
        !idle
    }

    /// Whether an answer of the real-time side is awaited: a board may poll again after the next slot.
    pub fn is_waiting(&self) -> bool {
        self.desk.asked.is_some() || self.desk.awaited_stop.is_some()
    }

    /// Whether there is room for another answer.
    fn can_answer(&self) -> bool {
        self.reply.is_done() || (self.acknowledges && self.reply.sent == 0)
    }

    /// Takes bytes up to the end of a request, and answers it.
    fn receive(&mut self, port: &mut impl LinkPort) {
        // Chunks come one behind the other: none of them waits for the wire to take the answer to the one before.
        while self.can_answer() || self.desk.is_overloaded() {
            if !self.may_receive() {
                return;
            }
            let Some(byte) = port.receive() else { return };
            // Noise is work, too.
            if self.desk.place.take().is_multiple_of(BYTES_BETWEEN_LOOKS) {
                self.charge(port);
            }
            let Some(frame) = self.reader.push(byte) else {
                continue;
            };
            // The checksum of the encoded bytes tells requests apart before they are decoded in place.
            let crc = checksum(frame);
            let message = match decode::<ToDevice<'_>>(frame) {
                Ok(message) => message,
                Err(FrameError::NotAMessage)
                    if self.reply.is_done() || (self.acknowledges && self.reply.sent == 0) =>
                {
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
            if !self.budget.is_left() && !is_stop(&message.request) {
                // It stands before a stop that is to be answered. Who sent it asks again.
                self.spoiled_frames = self.spoiled_frames.wrapping_add(1);
                continue;
            }
            let can_answer = self.reply.is_done() || (self.acknowledges && self.reply.sent == 0);
            if !can_answer {
                if !self.desk.take_unanswered(&message, port) {
                    self.spoiled_frames = self.spoiled_frames.wrapping_add(1);
                }
                self.charge(port);
                continue;
            }
            // Only this side counts them, so load and store suffice.
            let requests = &self.desk.signs.requests;
            requests.store(
                requests.load(Ordering::Relaxed).wrapping_add(1),
                Ordering::Relaxed,
            );
            let seq = message.seq;
            if message.request == Request::Hello {
                self.stream_seq = [0; CHANNELS];
                // What was to be sent is of the session before.
                if !self.stream.is_begun() {
                    self.stream = Outgoing::NOTHING;
                }
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
            self.charge(port);
        }
    }

    /// Passes an answer of the real-time side on.
    fn take_answer(&mut self, port: &mut impl LinkPort) {
        // An answer that is on its way out, as one about a chunk may be, comes to its end first.
        if self.reply.is_begun() {
            return;
        }
        let Some((asked, letter)) = self.desk.open_letter() else {
            return;
        };
        // A trial that ended before the answer was given is not confirmed by it.
        self.desk.take_freed(port);
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
        let kept = match letter {
            // Another stop is latched meanwhile, and is what is kept.
            Letter::Released if self.desk.signs.emergency_stop.load(Ordering::Relaxed) => Ok(()),
            _ => keep_in_mind(letter, port.keeper()),
        };
        if let Letter::Released = letter {
            // Pressed again while the flash was written, the button has latched a stop that is to be kept.
            self.desk.stop_is_kept = false;
        }
        // What a stop waits for is no letter.
        if let (true, Some((last, _))) = (self.awaited, self.last)
            && self.desk.awaited_stop.is_none_or(|stop| stop.seq != last)
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
}
