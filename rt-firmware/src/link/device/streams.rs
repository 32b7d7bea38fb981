//! Streams and news, which are sent where there is room between answers.
//!
//! *Invariant:* each stream has its turn, however much another one has to send.

use core::sync::atomic::Ordering;

use super::LinkSide;
use super::desk::Desk;
use super::port::LinkPort;
use crate::features::{NEWS, TELEMETRY};
use esm_link::frame::CRC_BYTES;
use esm_link::message::{Channel, FromDevice, MAX_STREAM_BYTES, Stream};
use esm_link::news::News;

/// Bytes of a stream's frame beside those of the stream: kind, channel, number, continuation, count
/// of dropped records (5), length, checksum, COBS, delimiter.
pub(super) const STREAM_OVERHEAD: usize = 1 + 1 + 1 + 1 + 5 + 1 + CRC_BYTES + 1 + 1;

/// Streams.
pub(super) const CHANNELS: usize = 4;

impl LinkSide<'_, '_> {
    /// Makes a frame of what a stream holds, if one of them holds something.
    #[inline(never)]
    pub(super) fn fill_stream(&mut self, port: &mut impl LinkPort) {
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

impl Desk<'_, '_> {
    fn news(&mut self, spoiled_frames: u32) -> Option<News> {
        let watch = self.watch.as_mut().filter(|_| NEWS)?;
        watch.news(self.snapshot.read()?, spoiled_frames)
    }
}
