//! Where requests are carried out: who may, until when, and by whom each is done.
//!
//! *Invariant:* nothing is done for a request before it is known that whoever sent it may, and that
//! it is not too late.

use core::sync::atomic::Ordering;

use super::client_session::Sender;
use super::handler::{PendingRequest, Reaction, RequestHandler};
use super::line_rate::LineRate;
use super::port::LinkPort;
use crate::features::{PARAMS, SELFTEST, STATUS_EVENTS, TELEMETRY};
use crate::link::status_event::Watch;
use crate::realtime::mailbox::{Bytes, Command, NO_DEADLINE};
use esm_link::access::{
    Access, MAX_DEADLINE_US, Needs, Recurrence, may_be_proven, may_have_deadline, needs,
};
use esm_link::message::{LinkError, Request, Response};
use esm_link::selftest::{Ask, MEASURES_BYTES};

impl RequestHandler<'_, '_> {
    /// Who sent a request. Takes it out of what proves that.
    pub(super) fn sender<'a>(
        &mut self,
        request: &Request<'a>,
        port: &mut impl LinkPort,
    ) -> Result<(Sender, Request<'a>), LinkError> {
        let Request::Proven {
            number,
            ref proof,
            request: bytes,
        } = *request
        else {
            // Where there is an owner, nobody else counts as the host.
            if self.keys.access(port.key_store()) != Access::Locked || mutant!(StrangerHeard) {
                self.hear();
            }
            return Ok((Sender::Anyone, *request));
        };
        let is_new = match self.keys.check_proven(number, proof, bytes)? {
            Recurrence::New => true,
            Recurrence::Again => false,
        };
        let request = deserialized(bytes)?;
        if !may_be_proven(&request) {
            return Err(LinkError::Malformed);
        }
        if is_new {
            self.hear();
        }
        Ok((Sender::Owner { number }, request))
    }

    /// Whether this one's chunks are taken, as [`allowed`](Self::allowed) has it.
    pub(super) fn may_upload(&mut self, sender: Sender, port: &mut impl LinkPort) -> bool {
        match self.keys.access(port.key_store()) {
            Access::Unsupported | Access::Open => true,
            Access::Locked => sender != Sender::Anyone,
            Access::Unreadable | Access::Recovering | Access::Damaged => false,
        }
    }

    /// Counts a request of the host's, for a mission that looks after that.
    fn hear(&self) {
        // Only this side counts them, so load and store suffice.
        let requests = &self.heartbeats.requests;
        requests.store(
            requests.load(Ordering::Relaxed).wrapping_add(1),
            Ordering::Relaxed,
        );
    }

    /// Begins a session, if it is the owner's.
    pub(super) fn open_session(
        &mut self,
        request: &Request<'_>,
        port: &mut impl LinkPort,
    ) -> Result<(), LinkError> {
        let Request::OpenSession {
            client,
            robot,
            proof,
        } = request
        else {
            return Err(LinkError::Malformed);
        };
        let now_us = port.now_us();
        let safe = port.key_store().ok_or(LinkError::NoKeySupport)?;
        self.keys.open_session(safe, now_us, client, robot, proof)
    }

    /// Carries a request out, if whoever sent it may. Answers its kind besides, or that of what it
    /// holds.
    pub(super) fn handle<'a, P: LinkPort>(
        &'a mut self,
        seq: u8,
        sender: Sender,
        request: &Request<'_>,
        port: &mut P,
    ) -> (u8, Reaction<'a>) {
        let mut request = *request;
        let allowed = self.allowed(sender, &mut request, port);
        let of = request.kind();
        let reaction = match allowed {
            Ok(by_us) => {
                self.pending = Some(PendingRequest {
                    seq,
                    sender,
                    of,
                    by_us,
                    stops: self.stops_before,
                });
                self.carry_out(&request, port)
            }
            Err(error) => Reaction::Answer(Err(error)),
        };
        (of, reaction)
    }

    /// Whether who sent a request may, and it is not too late for it. Takes it out of what it is
    /// in, and answers its deadline.
    fn allowed(
        &mut self,
        sender: Sender,
        request: &mut Request<'_>,
        port: &mut impl LinkPort,
    ) -> Result<u64, LinkError> {
        let access = self.keys.access(port.key_store());
        let is_owner = sender != Sender::Anyone || mutant!(StrangerIsOwner);
        let signed = match *request {
            Request::Signed { signature, request } => Some((signature, request)),
            _ => None,
        };
        if let Some((_, bytes)) = signed {
            // Verifying takes time, which strangers are not to have.
            if !is_owner && matches!(access, Access::Locked | Access::Recovering) {
                return Err(LinkError::NoSession);
            }
            *request = deserialized(bytes)?;
        }
        let deadline = take_out(request)?;
        let latest_us = port.now_us().saturating_add(MAX_DEADLINE_US);
        if deadline.is_some_and(|by_us| by_us > latest_us) && !mutant!(DeadlineUnlimited) {
            return Err(LinkError::DeadlineTooFar);
        }
        let mut by_us = deadline.unwrap_or(NO_DEADLINE);
        // Beside damaged records nothing is kept but a key of the same owner, which begins them
        // anew.
        if matches!(access, Access::Recovering | Access::Damaged)
            && needs(request) != Needs::Nothing
            && !matches!(request, Request::Challenge | Request::InstallKey { .. })
        {
            return Err(LinkError::NotStored);
        }
        match signed {
            Some((signature, bytes)) => {
                let until_us = self.check_signed(request, signature, bytes, port)?;
                by_us = by_us.min(until_us);
            }
            None => match (needs(request), access) {
                (Needs::Nothing, _) | (_, Access::Unsupported | Access::Open | Access::Damaged) => {
                }
                (_, Access::Unreadable) => return Err(LinkError::NotStored),
                (Needs::Session, _) if is_owner => {}
                (Needs::Session, _) => return Err(LinkError::NoSession),
                (Needs::Key, _) if mutant!(KeyForgotten) => {}
                (Needs::Key, _) => return Err(LinkError::NeedsKey),
            },
        }
        let forgotten = match signed {
            Some(_) => mutant!(SignedCarriedOutLate),
            None => mutant!(CarriedOutLate),
        };
        // A signature takes its time, too: it is looked at the clock behind it.
        if port.now_us() > by_us && !forgotten {
            return Err(LinkError::Late);
        }
        Ok(by_us)
    }

    /// Carries a request out: a function for each, where it is more than a word to the real-time
    /// side.
    fn carry_out<'a, P: LinkPort>(
        &'a mut self,
        request: &Request<'_>,
        port: &mut P,
    ) -> Reaction<'a> {
        #[cfg(feature = "behaviours")]
        if let Request::Behaviours(asked) = request
            && let Some(reaction) = self.of_kept_script(asked, port)
        {
            return reaction;
        }
        match *request {
            Request::Hello => {
                self.end_streams();
                let access = self.keys.access(port.key_store());
                Reaction::Answer(Ok(Response::Hello(self.introduce(P::WINDOW_BYTES, access))))
            }
            Request::Begin { len, crc } => Reaction::Answer(self.begin(len, crc, port)),
            Request::Chunk { offset, data } => Reaction::Answer(self.chunk(offset, data)),
            Request::Commit(swap) => self.commit(swap, port),
            Request::Abort => {
                self.abort();
                done(Ok(()))
            }
            Request::Status => Reaction::Answer(self.whole_status(port)),
            Request::Stop => {
                self.pending = None;
                self.stop(port)
            }
            Request::Start => self.ask(Command::Start),
            Request::EmergencyStop => Reaction::Answer(self.emergency_stop(port)),
            Request::Release => self.release(),
            Request::Task { index, offset } => Reaction::Answer(self.task_text(index, offset)),
            Request::ReadBlob { offset } => self.ask(Command::ReadBlob { offset }),
            Request::States { first } => self.ask(Command::ReadStates { first }),
            Request::SlotCounters { slot } => self.ask(Command::ReadSlot { slot }),
            Request::TaskCounters { task_instance } => {
                self.ask(Command::ReadTask { task_instance })
            }
            #[cfg(not(feature = "links"))]
            Request::FrameCounters { .. } => Reaction::Answer(Err(LinkError::NotBuiltIn)),
            #[cfg(feature = "links")]
            Request::FrameCounters { frame } => self.ask(Command::ReadFrame { frame }),
            Request::Confirm { mission } => self.confirm(mission, port),
            Request::FallBack { mission } => self.ask(Command::FallBack { mission }),
            Request::CrashReport => Reaction::Answer(self.crash_report()),
            Request::BlackBox { from } => Reaction::Answer(self.black_box(from)),
            Request::Param { .. } | Request::SetParam { .. } | Request::SaveParams { .. }
                if !PARAMS =>
            {
                Reaction::Answer(Err(LinkError::NotBuiltIn))
            }
            Request::Param { mission, param } => self.ask(Command::ReadParam { mission, param }),
            Request::SetParam {
                mission,
                param,
                value,
            } => self.ask(Command::SetParam {
                mission,
                param,
                value,
            }),
            Request::SaveParams { mission } => match port.mission_store() {
                Some(_) => self.ask(Command::ReadChanged { mission }),
                None => Reaction::Answer(Err(LinkError::NoStore)),
            },
            Request::Watch { news, period_ms } => done(self.watch(news, period_ms)),
            Request::Subscribe { trace, log, record } => {
                done(self.subscribe::<P>(trace, log, record))
            }
            Request::Identify { .. }
            | Request::Challenge
            | Request::Sign { .. }
            | Request::InstallKey { .. }
            | Request::RemoveKey => {
                let now_us = port.now_us();
                Reaction::Answer(match port.key_store() {
                    Some(safe) => self.of_keys(request, safe, now_us),
                    None => Err(LinkError::NoKeySupport),
                })
            }
            Request::Clock => Reaction::Answer(Ok(Response::Clock {
                now_us: port.now_us(),
            })),
            Request::Features => Reaction::Answer(Ok(self.features(port))),
            Request::Values { ask } => self.ask_values(ask),
            Request::Selftest { ask } => Reaction::Answer(self.of_selftest(ask, port)),
            Request::BehaviourList
            | Request::Behaviours(_)
            | Request::Drive { .. }
            | Request::EndDrive => self.ask_behaviours(request, port.now_us()),
            // They hold a plain one, or were looked at before: `allowed` gives nothing else out.
            Request::Signed { .. }
            | Request::Within { .. }
            | Request::Proven { .. }
            | Request::OpenSession { .. } => Reaction::Answer(Err(LinkError::Malformed)),
        }
    }

    /// A client begins: nothing is sent any more that one before it wanted.
    fn end_streams(&mut self) {
        self.trace_wanted.store(false, Ordering::Relaxed);
        self.log_wanted = false;
        self.watch = None;
        self.values.end();
        // To end one is never refused.
        let _ = self.record.want(false);
    }

    /// The upload ends, and nothing of it is kept.
    fn abort(&mut self) {
        if !mutant!(AbortForgotten) {
            self.end_upload();
        }
    }

    /// How the robot is, its stack and its flash included.
    fn whole_status(&self, port: &mut impl LinkPort) -> Result<Response<'_>, LinkError> {
        let kept = port
            .mission_store()
            .map(|mission_store| mission_store.kept());
        let flash = port
            .mission_store()
            .map(|mission_store| mission_store.flash_health());
        self.status(port.deepest_stack_bytes(), kept, flash)
    }

    /// Asks that the mission on trial stays.
    fn confirm<'a>(&mut self, mission: u32, port: &mut impl LinkPort) -> Reaction<'a> {
        let again = port
            .mission_store()
            .is_some_and(|mission_store| mission_store.kept().is_on_trial());
        self.ask(Command::Confirm { mission, again })
    }

    /// Status events are wanted, or no more.
    fn watch(&mut self, news: bool, period_ms: u32) -> Result<(), LinkError> {
        if news && !STATUS_EVENTS {
            return Err(LinkError::NotBuiltIn);
        }
        self.watch = news.then(|| Watch::new(period_ms));
        Ok(())
    }

    /// These streams are wanted, and no others.
    fn subscribe<P: LinkPort>(
        &mut self,
        trace: bool,
        log: bool,
        record: bool,
    ) -> Result<(), LinkError> {
        if log && !P::KEEPS_LOG {
            return Err(LinkError::NotBuiltIn);
        }
        self.record.want(record)?;
        self.trace_wanted.store(trace, Ordering::Relaxed);
        self.log_wanted = log;
        Ok(())
    }

    /// Tells what the board has measured, or lets its line have another rate for a while.
    fn of_selftest(
        &mut self,
        ask: &[u8],
        port: &mut impl LinkPort,
    ) -> Result<Response<'_>, LinkError> {
        if !SELFTEST {
            return Err(LinkError::NotBuiltIn);
        }
        match Ask::of(ask)? {
            Ask::Measures => {
                self.measures = port.measures().bytes();
                Ok(Response::TaskText {
                    total: MEASURES_BYTES as u16,
                    text: &self.measures,
                })
            }
            Ask::LineRate { baud, ms } if port.takes_line_rate(baud) => {
                self.line_rate = LineRate::Wanted { baud, ms };
                Ok(Response::Done)
            }
            Ask::LineRate { .. } => Err(LinkError::NotBuiltIn),
        }
    }

    /// Asks for values on nets, or ends that where nothing is asked for.
    fn ask_values<'a>(&mut self, ask: &[u8]) -> Reaction<'a> {
        if !TELEMETRY {
            return Reaction::Answer(Err(LinkError::NotBuiltIn));
        }
        if ask.is_empty() {
            self.values.end();
            return Reaction::Answer(Ok(Response::Done));
        }
        let number = self.pending.map_or(0, |pending| pending.seq);
        let ask = Bytes::first_of(ask);
        self.ask(Command::AskValues { number, ask })
    }
}

/// The reaction to a request that asks for nothing to be told.
fn done<'a>(result: Result<(), LinkError>) -> Reaction<'a> {
    Reaction::Answer(result.map(|()| Response::Done))
}

/// Takes a request out of the one that brings its deadline, if it is in one. Answers that.
fn take_out(request: &mut Request<'_>) -> Result<Option<u64>, LinkError> {
    let Request::Within {
        by_us,
        request: bytes,
    } = *request
    else {
        return Ok(None);
    };
    *request = deserialized(bytes)?;
    if may_have_deadline(request) {
        Ok(Some(by_us))
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
