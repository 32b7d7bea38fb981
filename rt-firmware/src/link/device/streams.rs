//! Streams and status events, which are sent where there is room between answers.
//!
//! *Invariant:* each stream has its turn, however much another one has to send.

use core::sync::atomic::Ordering;

use super::LinkSide;
use super::handler::RequestHandler;
use super::outgoing::CHANNELS;
use super::port::LinkPort;
use crate::features::{STATUS_EVENTS, TELEMETRY};
use esm_link::message::{Channel, FromDevice, MAX_STREAM_BYTES, Stream};
use esm_link::status_event::StatusEvent;

impl LinkSide<'_, '_> {
    /// Makes a frame of what a stream holds, if one of them holds something.
    #[inline(never)]
    pub(super) fn fill_stream(&mut self, port: &mut impl LinkPort) {
        if let Some(news) = self.handler.news(self.corrupt_frames) {
            self.stream.set(&FromDevice::StatusEvent(news));
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
                    let part = self.handler.trace.read(&mut bytes);
                    (part.len, part.continues, self.handler.trace.dropped())
                }
                Channel::Log if self.handler.log_wanted => {
                    (port.read_log(&mut bytes), false, port.log_dropped())
                }
                Channel::Log => continue,
                Channel::Record => {
                    let part = self.handler.record.read(&mut bytes);
                    (part.len, part.continues, self.handler.record.dropped())
                }
                Channel::Values => {
                    let snapshot = &self.handler.snapshot;
                    let runs = || snapshot.read().map(|health| health.mission);
                    let len = self.handler.values.read(&mut bytes, runs);
                    (len, false, self.handler.values.dropped())
                }
            };
            let wanted = match channel {
                Channel::Trace => self.handler.trace_wanted.load(Ordering::Relaxed),
                Channel::Log | Channel::Values => true,
                Channel::Record => self.handler.record.is_wanted(),
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

impl RequestHandler<'_, '_> {
    fn news(&mut self, corrupt_frames: u32) -> Option<StatusEvent> {
        let watch = self.watch.as_mut().filter(|_| STATUS_EVENTS)?;
        watch.news(self.snapshot.read()?, corrupt_frames)
    }
}
