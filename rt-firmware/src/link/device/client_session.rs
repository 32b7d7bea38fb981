//! Who talks with the robot: anyone, or the owner in a session.
//!
//! Each has requests and answers of its own, so that what strangers send takes neither place nor
//! answer from the owner.
//!
//! *Invariant:* a request that comes again is told by all of its bytes, and is not carried out
//! again: its answer is sent again. A stop is carried out whenever it comes.

use super::outgoing::{Outgoing, ProofOf};
use esm_link::access::PROOF_BYTES;
use esm_link::frame::{MAX_MESSAGE_BYTES, MAX_REPLY_FRAME_BYTES};
use esm_link::keys::Session;
use esm_link::message::{FromDevice, LinkError, Response, UNKNOWN};

/// Who sent a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sender {
    /// Nobody knows.
    Anyone,
    /// The owner, in a session, with a request of this number.
    Owner {
        /// The number.
        number: u32,
    },
}

/// What an answer says of the request that it is to.
#[derive(Clone, Copy)]
pub(super) struct Answered {
    /// The message's number.
    pub(super) seq: u8,
    /// The request's kind.
    pub(super) of: u8,
}

/// A stop that was read and is not answered yet.
#[derive(Clone, Copy)]
pub(super) struct AwaitedStop {
    pub(super) answered: Answered,
    pub(super) sender: Sender,
    /// Of the wish.
    pub(super) wish: u32,
    /// What is answered then.
    pub(super) result: Result<(), LinkError>,
}

/// A chunk that was taken while there was no room for an answer.
#[derive(Clone, Copy)]
pub(super) struct UntoldChunk {
    pub(super) answered: Answered,
    pub(super) sender: Sender,
    pub(super) result: Result<(), LinkError>,
}

/// The bytes of a message.
struct Taken {
    bytes: [u8; MAX_MESSAGE_BYTES],
    len: u8,
}

impl Taken {
    const NOTHING: Taken = Taken {
        bytes: [0; MAX_MESSAGE_BYTES],
        len: 0,
    };

    fn is(&self, message: &[u8]) -> bool {
        let taken = self.bytes.get(..usize::from(self.len));
        let is_same_number = || self.bytes.first() == message.first();
        self.len > 0 && (taken == Some(message) || mutant!(ToldByNumber) && is_same_number())
    }

    fn set(&mut self, message: &[u8]) {
        const { assert!(MAX_MESSAGE_BYTES <= u8::MAX as usize) };
        self.len = 0;
        // A message that arrived has room: it is no longer than any.
        if let Some(place) = self.bytes.get_mut(..message.len()) {
            place.copy_from_slice(message);
            self.len = message.len() as u8;
        }
    }
}

/// What has become of a message that comes again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Before {
    /// It has not come before.
    New,
    /// It has its answer.
    Answered,
    /// The real-time side has it.
    UnderWay,
}

/// Requests and answers of one side.
pub(super) struct ClientSession {
    /// The message whose answer the reply is.
    answered: Taken,
    /// The message whose answer the real-time side will bring.
    asked: Taken,
    /// The message that waits until the real-time side has answered a stranger's.
    waiting: Taken,
    /// How many stops had been wished for when it was read.
    waiting_stops: u32,
    /// The stop that was read last, until the robot has stopped.
    awaited_stop: Option<AwaitedStop>,
    /// The last chunk that was taken and not answered.
    pub(super) untold_chunk: Option<UntoldChunk>,
    /// The kind of the request that the reply is to.
    replies_to: u8,
    pub(super) reply: Outgoing<MAX_REPLY_FRAME_BYTES>,
    /// The reply says how far an upload has come, and no more: a later one speaks for it.
    acknowledges: bool,
}

impl ClientSession {
    pub(super) const NEW: ClientSession = ClientSession {
        answered: Taken::NOTHING,
        asked: Taken::NOTHING,
        waiting: Taken::NOTHING,
        waiting_stops: 0,
        awaited_stop: None,
        untold_chunk: None,
        replies_to: UNKNOWN,
        reply: Outgoing::NOTHING,
        acknowledges: false,
    };

    /// Whether there may be room for an answer: for that to a chunk, at least.
    pub(super) fn may_have_room(&self) -> bool {
        self.has_room_for(true)
    }

    /// Whether there is room for an answer. One to a chunk gives way to the next: chunks come one
    /// behind the other, and none of them waits for the wire to take the answer to the one before.
    /// It gives way to no other.
    pub(super) fn has_room_for(&self, is_chunk: bool) -> bool {
        let gives_way = is_chunk && self.acknowledges && self.reply.is_unsent();
        self.waiting.len == 0 && (self.reply.is_done() || gives_way)
    }

    /// This message is carried out later: as one that was read when so many stops had been wished
    /// for.
    pub(super) fn wait(&mut self, message: &[u8], stops: u32) {
        self.waiting.set(message);
        self.waiting_stops = stops;
    }

    /// Whether a message may wait for the wire to take the answer before: the first of another kind
    /// than that, so that who asks for one thing again and again takes the line from nobody else.
    pub(super) fn may_wait(&self, kind: u8) -> bool {
        self.waiting.len == 0 && kind != self.replies_to
    }

    /// A stop is answered when the robot has stopped.
    pub(super) fn await_stop(&mut self, stop: AwaitedStop) {
        self.awaited_stop = Some(stop);
    }

    /// Whether one is.
    pub(super) fn awaits_stop(&self) -> bool {
        self.awaited_stop.is_some()
    }

    /// The stop that is to be answered now, if the robot has stopped for it.
    pub(super) fn take_stop(&mut self, is_done: impl FnOnce(u32) -> bool) -> Option<AwaitedStop> {
        self.awaited_stop.take_if(|stop| is_done(stop.wish))
    }

    /// The message that waited, in `room`, and how many stops had been wished for when it was read;
    /// nothing if none has.
    pub(super) fn take_waiting<'r>(
        &mut self,
        room: &'r mut [u8; MAX_MESSAGE_BYTES],
    ) -> (&'r [u8], u32) {
        *room = self.waiting.bytes;
        let len = core::mem::take(&mut self.waiting.len);
        let message = room.get(..usize::from(len)).unwrap_or_default();
        (message, self.waiting_stops)
    }

    /// Whether this message has come before.
    pub(super) fn before(&self, message: &[u8]) -> Before {
        if self.asked.is(message) {
            Before::UnderWay
        } else if self.answered.is(message) {
            Before::Answered
        } else {
            Before::New
        }
    }

    /// The answer is sent once more.
    pub(super) fn answer_again(&mut self) {
        self.reply.again();
    }

    /// What was before is forgotten, and what the real-time side still has is not answered.
    pub(super) fn begin(&mut self) {
        self.answered.set(&[]);
        self.asked.set(&[]);
    }

    /// The real-time side has this message now.
    pub(super) fn ask(&mut self, message: &[u8]) {
        self.asked.set(message);
    }

    /// The real-time side has answered what it had, if that is still to be told.
    pub(super) fn take_asked(&mut self) -> bool {
        if self.asked.len == 0 {
            return false;
        }
        core::mem::swap(&mut self.answered, &mut self.asked);
        self.acknowledges = false;
        self.asked.set(&[]);
        true
    }

    /// This is a message's answer.
    pub(super) fn answer(&mut self, message: &[u8], acknowledges: bool) {
        self.answered.set(message);
        self.acknowledges = acknowledges;
    }

    /// Makes the frame of an answer, with its proof where it is in the owner's session.
    pub(super) fn set_reply(
        &mut self,
        Answered { seq, of }: Answered,
        result: Result<Response<'_>, LinkError>,
        proof: Option<ProofOf>,
    ) {
        let message = match proof {
            Some(_) => FromDevice::Proven {
                seq,
                proof: [0; PROOF_BYTES],
                result,
                of,
            },
            None => FromDevice::Reply { seq, result, of },
        };
        self.replies_to = of;
        self.reply.set_proven(&message, proof.as_ref());
    }
}

impl Sender {
    /// What its answer is proven with.
    pub(super) fn proof(self, session: Option<Session>) -> Option<ProofOf> {
        match self {
            Sender::Anyone => None,
            Sender::Owner { number } => session.map(|session| ProofOf { session, number }),
        }
    }
}
