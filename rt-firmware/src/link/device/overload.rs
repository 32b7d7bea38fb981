//! More comes over the line than can be answered: what is read while an answer waits for the wire, so that what waits behind it is not lost.
//!
//! An answer is longer than most requests, so that whoever asks without a pause fills the queue, however fast the robot is. What is in
//! it is then read on: chunks of an upload are taken, since any later answer speaks for them, and stops are
//! carried out. What else there is is left out and counted, and whoever sent it asks again.

use super::desk::Desk;
use super::port::LinkPort;
use super::stop::Awaited;
use crate::link::message::{Request, ToDevice};

/// With more bytes than this in the queue, and an answer on its way out, requests are read that are not answered: 22 ms of a line of 115,200 baud.
/// A client that waits for its answers never comes to it.
const OVERLOAD_BYTES: i32 = 256;

impl Desk<'_, '_> {
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
                // What is wrong with it is told to the one that comes behind it.
                let _ = self.chunk(offset, data);
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
