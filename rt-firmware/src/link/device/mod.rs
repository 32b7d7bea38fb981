//! The robot's end of the link: takes frames, answers requests, sends streams where there is room.
//!
//! A board's bytes come and go by its `port`. What leaves is `outgoing` until the port has taken it: answers first, and `streams` where there is room. Requests are carried out at the `desk`,
//! which sees to it that whoever sent one may (`signing`), and in time: some are `answers` of what this side knows, others take the `letter` to the real-time side. An upload is a transaction,
//! from its `upload` to its `stage`. `kept_mission` is what the board keeps for the robot, and `emergency` the stop that waits for no letter.
//!
//! Whoever sends requests has a `conversation` of its own: anyone, or the owner in a session.
//!
//! *Invariant:* a request that comes again is not carried out again: its answer is sent again.

mod answers;
mod conversation;
mod desk;
mod emergency;
mod kept_mission;
mod letter;
mod outgoing;
mod port;
mod signing;
mod stage;
mod streams;
mod upload;

pub(crate) use desk::Desk;
pub use port::LinkPort;

use core::sync::atomic::Ordering;

use crate::features::{KEYS, PARAMS};
use crate::link::frame::{FrameReader, MAX_MESSAGE_BYTES, MAX_REPLY_FRAME_BYTES, parse, unpack};
use crate::link::message::{
    Channel, LinkError, MAX_STREAM_BYTES, Request, Response, ToDevice, UNKNOWN,
};
use crate::mail::{Letter, NO_DEADLINE};
use conversation::{Answered, Before, Conversation, Sender};
use desk::{Reaction, Ticket};
use kept_mission::keep_in_mind;
use letter::answer_of;
use outgoing::Outgoing;
use streams::{CHANNELS, STREAM_OVERHEAD};

/// Whether a request is carried out each time that it comes.
fn is_done_again(request: &Request<'_>) -> bool {
    request.is_stop() && !planted!(StopSuppressed)
}

/// Conversations of a robot: anyone's, and that of the owner of its key where it can have one.
const CONVERSATIONS: usize = if KEYS { 2 } else { 1 };
const ANYONE: usize = 0;
const OWNER: usize = CONVERSATIONS - 1;

/// The link side of a runtime. A board polls it from a task of a low priority, when bytes have arrived or left, and now and then.
pub struct LinkSide<'q, 'm> {
    reader: FrameReader,
    conversations: [Conversation; CONVERSATIONS],
    stream: Outgoing<{ MAX_STREAM_BYTES + STREAM_OVERHEAD }>,
    stream_seq: [u8; CHANNELS],
    /// Whose turn it is to send.
    next_channel: Channel,
    /// Frames that arrived spoiled.
    spoiled_frames: u32,
    desk: Desk<'q, 'm>,
}

impl<'q, 'm> LinkSide<'q, 'm> {
    pub(crate) fn new(desk: Desk<'q, 'm>) -> Self {
        LinkSide {
            reader: FrameReader::new(),
            conversations: [const { Conversation::NEW }; CONVERSATIONS],
            stream: Outgoing::NOTHING,
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
        let kept = self.desk.about.kept;
        let may_start = kept.is_none_or(|kept| kept.may_start_by_itself());
        self.desk.start_kept(port, may_start);
    }

    /// Does what can be done without waiting. Returns whether there is more to do at once: bytes to send that the port did not take,
    /// or streams to go on with.
    pub fn poll(&mut self, port: &mut impl LinkPort) -> bool {
        let now_us = port.now_us();
        if let Some(keeper) = port.keeper() {
            keeper.tick(now_us);
        }
        loop {
            self.desk.signs.link.store(true, Ordering::Relaxed);
            self.desk.take_freed(port);
            self.take_answer(port);
            self.desk.keep_stop(port);
            self.go_on_with_owner(port);
            self.receive(port);
            // A frame that was begun comes first, then an answer, then streams: so an answer waits for one stream frame at most.
            if self.stream.is_begun() && !self.stream.send(port) {
                return true;
            }
            let Some(reply) = self.next_reply() else {
                break;
            };
            if !reply.send(port) {
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

    /// Requests of the host's that were counted.
    #[cfg(test)]
    pub(crate) fn requests_heard(&self) -> u32 {
        self.desk.signs.requests.load(Ordering::Relaxed)
    }

    /// Whether an answer of the real-time side is awaited: a board may poll again after the next slot.
    pub fn is_waiting(&self) -> bool {
        self.desk.asked.is_some()
    }

    /// The answer that is to be sent next: one that was begun, then the owner's.
    fn next_reply(&mut self) -> Option<&mut Outgoing<MAX_REPLY_FRAME_BYTES>> {
        let replies = self.conversations.iter().map(|one| &one.reply);
        let begun = replies.clone().position(Outgoing::is_begun);
        let next = begun.or_else(|| replies.clone().rposition(|reply| !reply.is_done()))?;
        self.conversations.get_mut(next).map(|one| &mut one.reply)
    }

    /// Takes bytes up to the end of a request, and answers it.
    fn receive(&mut self, port: &mut impl LinkPort) {
        while self.conversations.iter().all(Conversation::has_room) {
            let Some(byte) = port.receive() else { return };
            let Some(frame) = self.reader.push(byte) else {
                continue;
            };
            let Ok(message) = unpack(frame) else {
                self.spoiled_frames = self.spoiled_frames.wrapping_add(1);
                continue;
            };
            let [anyone, ..] = &mut self.conversations;
            let Ok(ToDevice { seq, request }) = parse(message) else {
                // It arrived as it was sent, so that sending it again is no use: say so. Its number comes first.
                anyone.answer(&[], false);
                let seq = message.first().copied().unwrap_or_default();
                anyone.set_reply(
                    Answered { seq, of: UNKNOWN },
                    Err(LinkError::Malformed),
                    None,
                );
                continue;
            };
            let (sender, request) = match self.desk.sender(&request, port) {
                Ok(Some(found)) => found,
                // One that somebody has kept.
                Ok(None) => continue,
                Err(error) => {
                    anyone.answer(&[], false);
                    let of = request.kind();
                    anyone.set_reply(Answered { seq, of }, Err(error), None);
                    continue;
                }
            };
            let place = match sender {
                Sender::Anyone => ANYONE,
                Sender::Owner { .. } => OWNER,
            };
            let Some(conversation) = self.conversations.get_mut(place) else {
                continue;
            };
            if request == Request::Hello {
                self.stream_seq = [0; CHANNELS];
                // What was to be sent is of the session before.
                if !self.stream.is_begun() {
                    self.stream = Outgoing::NOTHING;
                }
                conversation.begin();
            }
            match conversation.before(message) {
                // The answer is still to come.
                Before::UnderWay => continue,
                // The answer was lost.
                Before::Answered if !planted!(CarriedOutTwice) && !is_done_again(&request) => {
                    conversation.answer_again();
                    continue;
                }
                _ => {}
            }
            self.desk.streams_are_sent = self.stream.is_done();
            carry_out(
                conversation,
                &mut self.desk,
                message,
                seq,
                sender,
                &request,
                port,
            );
        }
    }

    /// Carries out what the owner has waited with for a stranger's request, once the real-time side has answered that.
    fn go_on_with_owner(&mut self, port: &mut impl LinkPort) {
        let Some(conversation) = self.conversations.get_mut(OWNER) else {
            return;
        };
        if self.desk.letter.is_none() || !conversation.reply.is_done() {
            return;
        }
        let mut room = [0; MAX_MESSAGE_BYTES];
        let message = conversation.take_waiting(&mut room);
        let Ok(ToDevice { seq, request }) = parse(message) else {
            return;
        };
        // It was found to be the owner's when it came.
        let Request::Proven {
            number, request, ..
        } = request
        else {
            return;
        };
        if let Ok(request) = parse(request) {
            let sender = Sender::Owner { number };
            carry_out(
                conversation,
                &mut self.desk,
                message,
                seq,
                sender,
                &request,
                port,
            );
        }
    }

    /// Passes an answer of the real-time side on.
    fn take_answer(&mut self, port: &mut impl LinkPort) {
        let place = match &self.desk.asked {
            Some(Ticket {
                sender: Sender::Owner { .. },
                ..
            }) => OWNER,
            _ => ANYONE,
        };
        let Some(conversation) = self.conversations.get_mut(place) else {
            return;
        };
        // An answer that is on its way out comes to its end first.
        if !conversation.has_room() {
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
        if let Some(asked) = asked
            && conversation.take_asked()
        {
            if let Letter::ValuesWanted { number, mission } = *letter {
                self.desk.values.begin(number, mission);
            }
            let (seq, of) = (asked.seq, asked.of);
            let proof = asked.sender.proof(self.desk.keys.session());
            let result = kept.and_then(|()| answer_of(letter));
            conversation.set_reply(Answered { seq, of }, result, proof);
        }
        self.desk.put_away(letter);
    }
}

/// Carries a request out that has not come before, and answers it, or lets its answer come later.
fn carry_out(
    conversation: &mut Conversation,
    desk: &mut Desk<'_, '_>,
    message: &[u8],
    seq: u8,
    sender: Sender,
    request: &Request<'_>,
    port: &mut impl LinkPort,
) {
    let is_chunk = matches!(request, Request::Chunk { .. });
    let session = desk.keys.session();
    if let Request::OpenSession { .. } = request {
        let opened = desk.open_session(request, port);
        let owner = Sender::Owner { number: 0 };
        let session = desk.keys.session().filter(|_| opened.is_ok());
        conversation.answer(message, false);
        let of = request.kind();
        let result = opened.map(|()| Response::Done);
        conversation.set_reply(Answered { seq, of }, result, owner.proof(session));
        return;
    }
    let is_in_the_way = desk.is_with_a_stranger() && sender != Sender::Anyone;
    match desk.react(seq, sender, request, port) {
        // The stranger's request is answered before the next slot has ended.
        (_, Reaction::Answer(Err(LinkError::Busy)))
            if is_in_the_way && !planted!(OwnerWaitsInVain) =>
        {
            conversation.wait(message);
        }
        (of, Reaction::Answer(result)) => {
            conversation.answer(message, is_chunk);
            conversation.set_reply(Answered { seq, of }, result, sender.proof(session));
        }
        (_, Reaction::Later) => conversation.ask(message),
    }
}
