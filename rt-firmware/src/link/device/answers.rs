//! Answers for which nobody need be asked: what the robot is, how it is, what it was built with,
//! and what was kept of the run before.

use core::sync::atomic::Ordering;

use super::handler::RequestHandler;
use super::port::LinkPort;
use crate::black_box::KEEPS_RECORDS;
use crate::features::{BEHAVIOURS, PARAMS, RECORD, SELFTEST, STATUS_EVENTS, TELEMETRY, WARM};
use crate::frames::LINKS;
use crate::realtime::mailbox::{Bytes, Content};
use esm_link::access::Access;
use esm_link::features::{Feature, Features};
use esm_link::message::{
    CrashReport, DeviceInfo, FlashHealth, LinkError, MAX_CHUNK, MAX_PART, Mode, PROTOCOL_VERSION,
    Response, Status, StoreStatus, Uploads,
};

impl RequestHandler<'_, '_> {
    pub(super) fn introduce(&self, window_bytes: u16, access: Access) -> DeviceInfo<'_> {
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
    pub(super) fn features<P: LinkPort>(&self, port: &mut P) -> Response<'static> {
        let has_store = port.mission_store().is_some();
        let built_in = Features::NONE
            .with(Feature::Record, RECORD)
            .with(Feature::Log, P::KEEPS_LOG)
            .with(Feature::StatusEvent, STATUS_EVENTS)
            .with(Feature::Params, PARAMS)
            .with(Feature::Warm, WARM)
            .with(Feature::Keys, port.key_store().is_some())
            .with(Feature::Store, has_store)
            .with(
                Feature::BlackBox,
                KEEPS_RECORDS && self.about.kept.is_some(),
            )
            .with(Feature::Telemetry, TELEMETRY)
            .with(Feature::Behaviours, BEHAVIOURS)
            .with(Feature::Links, LINKS > 0)
            .with(Feature::Selftest, SELFTEST);
        Response::Features {
            built_in,
            flash_ms: if has_store { P::FLASH_MS } else { 0 },
        }
    }

    pub(super) fn status(
        &self,
        stack_bytes: Option<u32>,
        kept: Option<StoreStatus>,
        flash: Option<FlashHealth>,
    ) -> Result<Response<'_>, LinkError> {
        let health = self.snapshot.read().ok_or(LinkError::NoAnswer)?;
        // Latched is latched, also where the real-time side has had no occasion to say so.
        let mode = if self.heartbeats.emergency_stop.load(Ordering::Relaxed) {
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
            stop_pressed: self.heartbeats.stop_pressed.load(Ordering::Relaxed),
            flash,
        }))
    }

    /// How the run before this one ended.
    #[inline(never)]
    pub(super) fn crash_report(&mut self) -> Result<Response<'_>, LinkError> {
        let Some(kept) = self.about.kept else {
            return Ok(Response::CrashReport {
                words: CrashReport::of(self.about.reset),
                file: &[],
            });
        };
        let (words, place) = kept.crash_report();
        let file = self.note(Bytes::first_of(place.as_bytes()))?.as_slice();
        Ok(Response::CrashReport { words, file })
    }

    /// Records from this sequence number on, as many as fit.
    #[inline(never)]
    pub(super) fn black_box(&mut self, from: Option<u32>) -> Result<Response<'_>, LinkError> {
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
        let records = self.note(bytes)?.as_slice();
        Ok(Response::BlackBox { end, records })
    }

    /// Keeps bytes until they are sent, in the command that nobody writes now.
    fn note(&mut self, bytes: Bytes) -> Result<&mut Bytes, LinkError> {
        let content = self.command.as_deref_mut().ok_or(LinkError::Busy)?;
        *content = Content::Note(bytes);
        match content {
            Content::Note(bytes) => Ok(bytes),
            _ => Err(LinkError::Busy),
        }
    }

    pub(super) fn task_text(&mut self, index: u8, offset: u16) -> Result<Response<'_>, LinkError> {
        let index = usize::from(index);
        let declaration = self.registry.declaration(index);
        let declaration = declaration.ok_or(LinkError::NoSuchIndex)?;
        let count = self.registry.capacity(index) as u32;
        // Written where it is kept until it is sent.
        let bytes = self.note(Bytes::EMPTY)?;
        let mut total = 0_u16;
        declaration.tell_source(count, &mut |piece| {
            for byte in piece {
                if total >= offset {
                    // What does not fit is in a later part.
                    bytes.push([*byte]);
                }
                total = total.saturating_add(1);
            }
        });
        Ok(Response::TaskText {
            total,
            text: bytes.as_slice(),
        })
    }
}

/// A part of a text, from this byte on.
pub(super) fn text_part<'a>(text: &'static str, offset: usize) -> Response<'a> {
    let text = text.as_bytes();
    let rest = text.get(offset..).unwrap_or_default();
    Response::TaskText {
        total: text.len() as u16,
        text: rest.get(..MAX_PART).unwrap_or(rest),
    }
}
