//! Where requests are carried out: who may, until when, and by whom each is done.
//!
//! *Invariant:* nothing is done for a request before it is known that whoever sent it may, and that it is not too late.

use core::sync::atomic::{AtomicBool, Ordering};

use esm_core::BlobBuffer;
use heapless::spsc::{Consumer, Producer};

use super::port::LinkPort;
use super::stop::Awaited;
use super::upload::Upload;
use crate::features::{NEWS, PARAMS, TELEMETRY};
use crate::link::access::{Access, Needs, may_have_deadline, needs};
use crate::link::keys::Keys;
use crate::link::message::{Capacities, LinkError, Request, Response};
use crate::link::news::Watch;
use crate::link::stops::Place;
use crate::mail::{Bytes, Freed, Letter, NO_DEADLINE, Posted};
use crate::ports::Registry;
use crate::realtime::upcoming::Rooms;
use crate::recorder::RecordReader;
use crate::ring::RingReader;
use crate::runtime::About;
use crate::status::SnapshotReader;
use crate::supervision::Signs;
use crate::telemetry::SampleReader;

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
    /// The stop that was read last, until the robot has stopped.
    pub(crate) awaited_stop: Option<Awaited>,
    /// The last chunk that was taken and not answered, and what became of it.
    pub(crate) untold_chunk: Option<(u8, Result<(), LinkError>)>,
    /// Where the link stands among the bytes of its line.
    pub(crate) place: Place,
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
    pub(super) seq: u8,
    /// When it is too late for it, on the board's clock in microseconds.
    pub(super) by_us: u64,
}

/// What becomes of a request.
pub(super) enum Reaction<'a> {
    /// This is the answer.
    Answer(Result<Response<'a>, LinkError>),
    /// The real-time side was asked.
    Later,
}

impl Desk<'_, '_> {
    /// Carries a request out, if whoever sent it may.
    pub(super) fn react<'a, P: LinkPort>(
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
            Request::Stop => {
                let seq = self.ticket.take().map_or(0, |ticket| ticket.seq);
                self.stop(seq, port)
            }
            Request::Start => self.ask(Letter::Start),
            Request::EmergencyStop => Reaction::Answer(self.emergency_stop(port)),
            Request::Release => self.release(),
            Request::Task { index, offset } => Reaction::Answer(self.task_text(index, offset)),
            Request::ReadBlob { offset } => self.ask(Letter::ReadBlob { offset }),
            Request::States { first } => self.ask(Letter::ReadStates { first }),
            Request::SlotCounters { slot } => self.ask(Letter::ReadSlot { slot }),
            Request::TaskCounters { task_instance } => self.ask(Letter::ReadTask { task_instance }),
            Request::Confirm { mission } => {
                let again = port
                    .keeper()
                    .is_some_and(|keeper| keeper.kept().is_on_trial());
                self.ask(Letter::Confirm { mission, again })
            }
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
