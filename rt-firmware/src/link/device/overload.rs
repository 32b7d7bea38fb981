//! More comes over the line than can be answered: what is read while an answer waits for the wire, so that what waits behind it is not lost.
//!
//! An answer is longer than most requests, so that whoever asks without a pause fills the queue, however fast the robot is. What is in
//! it is then read on: chunks of an upload are taken, of which the last is answered as soon as there is room, and stops are
//! carried out. What else there is is left out and counted, and whoever sent it asks again.

use super::LinkSide;
use super::desk::Desk;
use super::port::LinkPort;
use super::stop::Awaited;
use super::upload::Upload;
use crate::link::message::{FromDevice, Request, Response, ToDevice};

/// With more bytes than this in the queue, and an answer on its way out, requests are read that are not answered: 22 ms of a line of 115,200 baud.
/// A client that waits for its answers never comes to it.
const OVERLOAD_BYTES: i32 = 256;

impl LinkSide<'_, '_> {
    /// Answers the last chunk that was taken while there was no room for an answer.
    pub(super) fn tell_chunk(&mut self) {
        if !self.reply.is_done() {
            return;
        }
        let Some((seq, result)) = self.desk.untold_chunk.take() else {
            return;
        };
        let len = self.desk.received();
        self.acknowledges = true;
        self.reply.set(&FromDevice::Reply {
            seq,
            result: result.map(|()| Response::Received { len }),
        });
    }
}

impl Desk<'_, '_> {
    /// Bytes of the upload that are there.
    fn received(&self) -> u32 {
        self.upload.as_ref().map_or(0, Upload::received)
    }

    /// Whether more waits than can be answered. A board without a [`StopListener`](crate::StopListener) does not know.
    pub(super) fn is_overloaded(&self) -> bool {
        self.place.bytes_behind(&self.signs.stops) > OVERLOAD_BYTES && !planted!(OverloadForgotten)
    }

    /// Does with a request what can be done without an answer now. Returns false if it is left out.
    pub(super) fn take_unanswered(
        &mut self,
        message: &ToDevice<'_>,
        port: &mut impl LinkPort,
    ) -> bool {
        match message.request {
            Request::Chunk { offset, data } => {
                let result = self.chunk(offset, data).map(|_| ());
                self.untold_chunk = Some((message.seq, result));
                true
            }
            Request::Stop => {
                self.stop(message.seq, port);
                true
            }
            Request::EmergencyStop => {
                let result = self.emergency_stop(port).map(|_| ());
                let wish = self.signs.stops.count_read();
                self.awaited_stop = Some(Awaited {
                    seq: message.seq,
                    wish,
                    result,
                });
                true
            }
            _ => false,
        }
    }
}
