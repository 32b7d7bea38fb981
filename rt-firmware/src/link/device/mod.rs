//! The robot's end of the link: takes frames, answers requests, sends streams where there is room.
//!
//! A board's bytes come and go by its `port`. What leaves is `outgoing` until the port has taken
//! it: answers first, and `streams` where there is room. Requests are carried out by the `handler`:
//! `request_handler` sees to it that whoever sent one may (`signing`), and in time: some are
//! `answers` of what this side knows, others become the command to the real-time side, which brings
//! the `reply`. An upload is a transaction, from its `upload` to its `stage`. `stored_mission` is
//! what the board keeps for the robot, and `stop` and `emergency` the stops that wait for no
//! command. `budget` is how much time all of it may take.
//!
//! Whoever sends requests has a `client_session` of its own: anyone, or the owner in a session.
//!
//! *Invariant:* a request that comes again is not carried out again: its answer is sent again.

mod answers;
mod behaviours;
mod budget;
mod client_session;
mod emergency;
mod handler;
#[cfg(feature = "behaviours")]
mod kept_script;
mod line_rate;
mod outgoing;
mod overload;
mod port;
mod reply;
mod request_handler;
#[cfg(feature = "behaviours")]
mod script_keeper;
mod signing;
mod stage;
mod stop;
mod stored_mission;
mod streams;
mod upload;

pub(crate) use handler::RequestHandler;
pub(crate) use line_rate::LineRate;
pub use port::LinkPort;
#[cfg(feature = "behaviours")]
pub(crate) use script_keeper::ScriptKeeper;

use core::sync::atomic::Ordering;

use crate::features::{KEYS, PARAMS, SELFTEST};
use crate::link::stop_listener::StopListener;
use crate::realtime::mailbox::{Command, Content, NO_DEADLINE, Reply};
use budget::Budget;
use client_session::{Answered, AwaitedStop, Before, ClientSession, Sender};
use esm_link::frame::{FrameReader, MAX_MESSAGE_BYTES, MAX_REPLY_FRAME_BYTES, parse, unpack};
use esm_link::message::{
    Channel, LinkError, MAX_STREAM_BYTES, Request, Response, ToDevice, UNKNOWN,
};
use handler::{PendingRequest, Reaction};
use outgoing::{CHANNELS, Outgoing, STREAM_OVERHEAD};
use reply::answer_of;
use stored_mission::persist_trial;

/// Whether a request is carried out each time that it comes.
fn is_done_again(request: &Request<'_>) -> bool {
    request.is_stop() && !mutant!(StopSuppressed)
}

/// Sessions of a robot: anyone's, and that of the owner of its key where it can have one.
const SESSIONS: usize = if KEYS { 2 } else { 1 };
const ANYONE: usize = 0;
const OWNER: usize = SESSIONS - 1;

/// Bytes of the line after which the link looks at the time that it has taken.
const BYTES_BETWEEN_LOOKS: u32 = 64;

/// The link side of a runtime. A board polls it from a task of a low priority, when bytes have
/// arrived or left, and now and then.
pub struct LinkSide<'q, 'm> {
    reader: FrameReader,
    sessions: [ClientSession; SESSIONS],
    stream: Outgoing<{ MAX_STREAM_BYTES + STREAM_OVERHEAD }>,
    stream_seq: [u8; CHANNELS],
    /// Whose turn it is to send.
    next_channel: Channel,
    /// Frames that arrived corrupt, and requests that were left out for want of time.
    corrupt_frames: u32,
    /// Bytes of the line that had found no room when that was looked at last.
    lost_bytes: u32,
    budget: Budget,
    handler: RequestHandler<'q, 'm>,
}

impl<'q, 'm> LinkSide<'q, 'm> {
    pub(crate) fn new(handler: RequestHandler<'q, 'm>) -> Self {
        LinkSide {
            reader: FrameReader::new(),
            sessions: [const { ClientSession::NEW }; SESSIONS],
            stream: Outgoing::NOTHING,
            stream_seq: [0; CHANNELS],
            next_channel: Channel::Trace,
            corrupt_frames: 0,
            lost_bytes: 0,
            budget: Budget::FULL,
            handler,
        }
    }

    /// Starts the mission that the board's mission store has for the robot, if it has one. To be
    /// called once, before all else.
    ///
    /// A robot that was reset by a defect again and again, each time after no time, starts none:
    /// see [`RetainedRam::may_start_by_itself`](crate::RetainedRam::may_start_by_itself). One whose
    /// board remembers an emergency stop starts it, too, and moves nothing.
    pub fn start(&mut self, port: &mut impl LinkPort) {
        if port
            .mission_store()
            .is_some_and(|mission_store| mission_store.is_emergency_stopped())
        {
            self.handler
                .heartbeats
                .latch_emergency_stop(self.handler.about.kept);
        }
        let kept = self.handler.about.kept;
        let may_start = kept.is_none_or(|kept| kept.may_start_by_itself());
        self.handler.start_kept(port, may_start);
        #[cfg(feature = "behaviours")]
        self.handler.begin_with_kept_script(port, may_start);
    }

    /// Hears stops among the bytes of the line, where a board takes them in: one for each line.
    pub fn stop_listener(&self) -> StopListener<'m> {
        StopListener::new(self.handler.heartbeats, self.handler.about.kept)
    }

    /// Does what can be done without waiting, as long as there is [time for
    /// it](LinkPort::LINK_PERCENT). Returns whether there is more to do at once: bytes to send that
    /// the port did not take, or streams to go on with.
    pub fn poll(&mut self, port: &mut impl LinkPort) -> bool {
        self.begin_turn(port);
        let now_us = port.now_us();
        if let Some(mission_store) = port.mission_store() {
            mission_store.tick(now_us);
        }
        if SELFTEST {
            self.handler.line_rate.look(port);
        }
        let has_more = self.work(port);
        if SELFTEST && !has_more {
            self.handler.line_rate.begin(port);
        }
        self.charge(port);
        // What is left waits for its time.
        has_more && self.budget.is_left()
    }

    fn begin_turn<P: LinkPort>(&mut self, port: &mut P) {
        let slots_us = self.handler.heartbeats.slots_us();
        self.budget.begin::<P>(port.now_us(), slots_us);
        let lost_bytes = self.handler.heartbeats.stops.lost_bytes();
        if lost_bytes != self.lost_bytes {
            // Whatever frames they were of.
            self.lost_bytes = lost_bytes;
            self.corrupt_frames = self.corrupt_frames.wrapping_add(1);
        }
    }

    /// Counts what the link has done as work.
    fn charge<P: LinkPort>(&mut self, port: &mut P) {
        let heartbeats = self.handler.heartbeats;
        let slots_us = heartbeats.slots_us();
        let worked_us = self.budget.charge::<P>(port.now_us(), slots_us);
        // Only this side counts it, so load and store suffice.
        let before_us = heartbeats.link_us.load(Ordering::Relaxed);
        let link_us = before_us.wrapping_add(worked_us);
        heartbeats.link_us.store(link_us, Ordering::Relaxed);
    }

    /// Whether there is time for what comes next: for a stop that was heard also where there is
    /// none for others.
    fn may_receive(&mut self) -> bool {
        self.budget.is_left()
            || self.budget.is_left_for_a_stop()
                && self
                    .handler
                    .place
                    .is_stop_ahead(&self.handler.heartbeats.stops)
    }

    fn work(&mut self, port: &mut impl LinkPort) -> bool {
        loop {
            self.handler.heartbeats.link.store(true, Ordering::Relaxed);
            self.handler.take_freed(port);
            self.take_answer(port);
            self.tell_stopped();
            self.tell_chunks();
            self.handler.store_stop(port);
            self.go_on(port);
            self.receive(port);
            #[cfg(feature = "behaviours")]
            self.handler.go_on_with_kept_script(port);
            // Where the real-time side was called, it has come already.
            self.tell_stopped();
            // A frame that was begun comes first, then an answer, then streams: so an answer waits
            // for one stream frame at most.
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
        if self.stream.is_done() && self.budget.is_left() {
            self.fill_stream(port);
        }
        let idle = self.stream.is_done();
        self.stream.send(port);
        !idle
    }

    /// Requests of the host's that were counted.
    #[cfg(all(test, feature = "keys"))]
    pub(crate) fn requests_heard(&self) -> u32 {
        self.handler.heartbeats.requests.load(Ordering::Relaxed)
    }

    /// Whether an answer of the real-time side is awaited: a board may poll again after the next
    /// slot.
    pub fn is_waiting(&self) -> bool {
        #[cfg(feature = "behaviours")]
        if self.handler.script_keeper.is_asked() {
            return true;
        }
        self.handler.asked.is_some() || self.sessions.iter().any(ClientSession::awaits_stop)
    }

    /// The answer that is to be sent next: one that was begun, then the owner's.
    fn next_reply(&mut self) -> Option<&mut Outgoing<MAX_REPLY_FRAME_BYTES>> {
        let replies = self.sessions.iter().map(|one| &one.reply);
        let begun = replies.clone().position(Outgoing::is_begun);
        let next = begun.or_else(|| replies.clone().rposition(|reply| !reply.is_done()))?;
        self.sessions.get_mut(next).map(|one| &mut one.reply)
    }

    /// Takes requests, and answers them, as long as there is room for that.
    fn receive(&mut self, port: &mut impl LinkPort) {
        let mut room = [0; MAX_MESSAGE_BYTES];
        while self.sessions.iter().all(ClientSession::may_have_room) || self.handler.is_overloaded()
        {
            if self.receive_frame(port, &mut room).is_none() {
                return;
            }
            self.charge(port);
        }
    }

    /// Takes bytes up to the end of a frame, and what is in it. Nothing if bytes or time are up.
    fn receive_frame(
        &mut self,
        port: &mut impl LinkPort,
        room: &mut [u8; MAX_MESSAGE_BYTES],
    ) -> Option<()> {
        loop {
            if !self.may_receive() {
                return None;
            }
            let byte = port.receive()?;
            // Noise is work, too.
            if self
                .handler
                .place
                .take()
                .is_multiple_of(BYTES_BETWEEN_LOOKS)
            {
                self.charge(port);
            }
            let Some(frame) = self.reader.push(byte) else {
                continue;
            };
            let message = match unpack(frame) {
                Ok(message) => room.get_mut(..message.len()).map(|place| {
                    place.copy_from_slice(message);
                    &*place
                }),
                Err(_) => None,
            };
            match message {
                Some(message) => self.take(message, port),
                None => self.leave_out(),
            }
            return Some(());
        }
    }

    /// A frame is passed over: it is noise, or there is no time or no room for what it holds. Who
    /// sent it asks again.
    fn leave_out(&mut self) {
        self.corrupt_frames = self.corrupt_frames.wrapping_add(1);
    }

    /// Takes a message that has arrived.
    fn take(&mut self, message: &[u8], port: &mut impl LinkPort) {
        let handler = &mut self.handler;
        handler.stops_before = handler.place.wishes_before(&handler.heartbeats.stops);
        let Ok(ToDevice { seq, request }) = parse(message) else {
            // It arrived as it was sent, so that sending it again is no use: say so. Its number
            // comes first.
            let seq = message.first().copied().unwrap_or_default();
            self.refuse(Answered { seq, of: UNKNOWN }, LinkError::Malformed);
            return;
        };
        let (sender, request) = match self.handler.sender(&request, port) {
            Ok(found) => found,
            Err(error) => {
                let of = request.kind();
                self.refuse(Answered { seq, of }, error);
                return;
            }
        };
        if !self.budget.is_left() && !request.is_stop() {
            // It stands before a stop that is to be answered.
            self.leave_out();
            return;
        }
        let Some(client_session) = self.sessions.get_mut(place_of(sender)) else {
            return;
        };
        let is_chunk = matches!(request, Request::Chunk { .. });
        if client_session.has_room_for(is_chunk) {
            self.take_from(message, seq, sender, &request, port);
        } else if !self.handler.take_unanswered(
            client_session,
            message,
            seq,
            sender,
            &request,
            port,
        ) {
            self.leave_out();
        }
    }

    /// Takes a request of which it is known who sent it, where there is room for its answer.
    fn take_from(
        &mut self,
        message: &[u8],
        seq: u8,
        sender: Sender,
        request: &Request<'_>,
        port: &mut impl LinkPort,
    ) {
        let Some(client_session) = self.sessions.get_mut(place_of(sender)) else {
            return;
        };
        if *request == Request::Hello {
            self.stream_seq = [0; CHANNELS];
            // What was to be sent is of the session before.
            if !self.stream.is_begun() {
                self.stream = Outgoing::NOTHING;
            }
            client_session.begin();
        }
        match client_session.before(message) {
            // The answer is still to come.
            Before::UnderWay => return,
            // The answer was lost.
            Before::Answered if !mutant!(CarriedOutTwice) && !is_done_again(request) => {
                client_session.answer_again();
                return;
            }
            _ => {}
        }
        self.handler.streams_are_sent = self.stream.is_done();
        let before_us = self.budget.left_us();
        carry_out(
            client_session,
            &mut self.handler,
            message,
            seq,
            sender,
            request,
            port,
        );
        if sender != Sender::Anyone {
            self.charge(port);
            self.budget.pay_for_owner(before_us);
        }
    }

    /// Refuses what is nobody's request, if there is room for an answer.
    fn refuse(&mut self, answered: Answered, error: LinkError) {
        let [anyone, ..] = &mut self.sessions;
        if anyone.has_room_for(false) {
            anyone.answer(&[], false);
            anyone.set_reply(answered, Err(error), None);
        } else {
            self.leave_out();
        }
    }

    /// Goes on with requests that waited: for the wire to take the answer before, or, the owner's,
    /// for what the real-time side does for a stranger.
    fn go_on(&mut self, port: &mut impl LinkPort) {
        let mut room = [0; MAX_MESSAGE_BYTES];
        for place in [OWNER, ANYONE] {
            let is_in_the_way = place == OWNER && self.handler.is_with_a_stranger();
            let Some(client_session) = self.sessions.get_mut(place) else {
                return;
            };
            if is_in_the_way || !client_session.reply.is_done() {
                continue;
            }
            let (message, stops) = client_session.take_waiting(&mut room);
            let handler = &mut self.handler;
            handler.stops_before = match mutant!(WaitingComesAnew) {
                true => handler.place.wishes_before(&handler.heartbeats.stops),
                false => stops,
            };
            let Ok(ToDevice { seq, request }) = parse(message) else {
                continue;
            };
            // Who sent it was found out when it came.
            match request {
                Request::Proven {
                    number, request, ..
                } => {
                    let sender = Sender::Owner { number };
                    if let Ok(request) = parse(request) {
                        self.take_from(message, seq, sender, &request, port);
                    }
                }
                request => self.take_from(message, seq, Sender::Anyone, &request, port),
            }
        }
    }

    /// Passes an answer of the real-time side on.
    fn take_answer(&mut self, port: &mut impl LinkPort) {
        let place = match &self.handler.asked {
            Some(PendingRequest {
                sender: Sender::Owner { .. },
                ..
            }) => OWNER,
            _ => ANYONE,
        };
        let Some(client_session) = self.sessions.get_mut(place) else {
            return;
        };
        // An answer that is on its way out comes to its end first.
        if !client_session.reply.is_done() {
            return;
        }
        let Some((asked, content)) = self.handler.open_reply() else {
            return;
        };
        #[cfg(feature = "behaviours")]
        if asked.is_none() {
            let now_us = port.now_us();
            self.handler.take_answer_to_kept_script(content, now_us);
        }
        // A trial that ended before the answer was given is not confirmed by it.
        self.handler.take_freed(port);
        if PARAMS && let Content::Reply(Reply::Changed(saved)) = *content {
            // The flash has it before the robot counts on it.
            let is_late = asked.is_some_and(|asked| port.now_us() > asked.by_us);
            let kept = match port.mission_store() {
                _ if is_late => Err(LinkError::Late),
                Some(mission_store) => mission_store.save_params(&saved),
                None => Err(LinkError::NoStore),
            };
            match kept {
                Ok(()) => {
                    *content = Content::Command(Command::Saved(saved));
                    self.handler.command = Some(content);
                    // What was saved is in force, however late it has become.
                    let by_us = NO_DEADLINE;
                    self.handler.pending = asked.map(|asked| PendingRequest { by_us, ..asked });
                    self.handler.post();
                    return;
                }
                Err(error) => content.refuse(error),
            }
        }
        let kept = match content {
            // Another stop is latched meanwhile, and is what is kept.
            Content::Reply(Reply::Released)
                if self
                    .handler
                    .heartbeats
                    .emergency_stop
                    .load(Ordering::Relaxed) =>
            {
                Ok(())
            }
            _ => persist_trial(content, port.mission_store()),
        };
        if let Content::Reply(Reply::Released) = content {
            // Pressed again while the flash was written, the button has latched a stop that is to
            // be kept.
            self.handler.stop_is_stored = false;
        }
        if let Some(asked) = asked
            && client_session.take_asked()
        {
            if let Content::Reply(Reply::ValuesWanted { number, mission }) = *content {
                self.handler.values.begin(number, mission);
            }
            let (seq, of) = (asked.seq, asked.of);
            let proof = asked.sender.proof(self.handler.keys.session());
            let result = kept.and_then(|()| answer_of(content));
            client_session.set_reply(Answered { seq, of }, result, proof);
        }
        self.handler.put_away(content);
    }
}

/// Whose session it is.
fn place_of(sender: Sender) -> usize {
    match sender {
        Sender::Anyone => ANYONE,
        Sender::Owner { .. } => OWNER,
    }
}

/// Carries a request out that has not come before, and answers it, or lets its answer come later.
fn carry_out(
    client_session: &mut ClientSession,
    handler: &mut RequestHandler<'_, '_>,
    message: &[u8],
    seq: u8,
    sender: Sender,
    request: &Request<'_>,
    port: &mut impl LinkPort,
) {
    let is_chunk = matches!(request, Request::Chunk { .. });
    let session = handler.keys.session();
    if let Request::OpenSession { .. } = request {
        let opened = handler.open_session(request, port);
        let owner = Sender::Owner { number: 0 };
        let session = handler.keys.session().filter(|_| opened.is_ok());
        client_session.answer(message, false);
        let of = request.kind();
        let result = opened.map(|()| Response::Done);
        client_session.set_reply(Answered { seq, of }, result, owner.proof(session));
        return;
    }
    let is_in_the_way = handler.is_with_a_stranger() && sender != Sender::Anyone;
    match handler.handle(seq, sender, request, port) {
        // The stranger's request is answered before the next slot has ended.
        (_, Reaction::Answer(Err(LinkError::Busy)))
            if is_in_the_way && !mutant!(OwnerWaitsInVain) =>
        {
            client_session.wait(message, handler.stops_before);
        }
        (of, Reaction::Answer(result)) => {
            client_session.answer(message, is_chunk);
            client_session.set_reply(Answered { seq, of }, result, sender.proof(session));
        }
        (_, Reaction::Later) => client_session.ask(message),
        (of, Reaction::WhenStopped { wish, result }) => {
            client_session.await_stop(AwaitedStop {
                answered: Answered { seq, of },
                sender,
                wish,
                result,
            });
        }
    }
}
