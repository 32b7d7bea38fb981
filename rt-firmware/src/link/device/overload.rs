//! More comes over the line than can be answered: what is read while an answer waits for the wire,
//! so that what waits behind it is not lost.
//!
//! An answer is longer than most requests, so that whoever asks without a pause fills the queue,
//! however fast the robot is. What is in it is then read on: chunks of an upload are taken, of
//! which the last is answered as soon as there is room, and stops are carried out. Of the rest one
//! request waits, of another kind than the one that is answered; what else there is is left out and
//! counted, and whoever sent it asks again.

use super::LinkSide;
use super::client_session::{Answered, AwaitedStop, ClientSession, Sender, UntoldChunk};
use super::handler::{Reaction, RequestHandler, Upload};
use super::port::LinkPort;
use esm_link::message::{Request, Response};

/// With more bytes than this in the queue, and an answer on its way out, requests are read that are
/// not answered: 22 ms of a line of 115,200 baud. A client that waits for its answers never comes
/// to it.
const OVERLOAD_BYTES: i32 = 256;

impl LinkSide<'_, '_> {
    /// Answers the last chunks that were taken while there was no room for an answer.
    pub(super) fn tell_chunks(&mut self) {
        let len = self.handler.received();
        let session = self.handler.keys.session();
        for client_session in &mut self.sessions {
            if !client_session.reply.is_done() {
                continue;
            }
            let Some(UntoldChunk {
                answered,
                sender,
                result,
            }) = client_session.untold_chunk.take()
            else {
                continue;
            };
            client_session.answer(&[], true);
            let result = result.map(|()| Response::Received { len });
            client_session.set_reply(answered, result, sender.proof(session));
        }
    }
}

impl RequestHandler<'_, '_> {
    /// Bytes of the upload that are there.
    fn received(&self) -> u32 {
        self.upload.as_ref().map_or(0, Upload::received)
    }

    /// Whether more waits than can be answered. A board without a
    /// [`StopListener`](crate::StopListener) does not know.
    pub(super) fn is_overloaded(&self) -> bool {
        self.place.bytes_behind(&self.heartbeats.stops) > OVERLOAD_BYTES
            && !mutant!(OverloadForgotten)
    }

    /// Does with a request what can be done without an answer now. Returns false if it is left out.
    pub(super) fn take_unanswered(
        &mut self,
        client_session: &mut ClientSession,
        message: &[u8],
        seq: u8,
        sender: Sender,
        request: &Request<'_>,
        port: &mut impl LinkPort,
    ) -> bool {
        let of = request.kind();
        let answered = Answered { seq, of };
        match *request {
            Request::Chunk { offset, data } if self.may_upload(sender, port) => {
                let result = self.chunk(offset, data).map(|_| ());
                client_session.untold_chunk = Some(UntoldChunk {
                    answered,
                    sender,
                    result,
                });
                true
            }
            Request::Stop => {
                if let Reaction::WhenStopped { wish, result } = self.stop(port) {
                    client_session.await_stop(AwaitedStop {
                        answered,
                        sender,
                        wish,
                        result,
                    });
                }
                true
            }
            Request::EmergencyStop => {
                let result = self.emergency_stop(port).map(|_| ());
                client_session.await_stop(AwaitedStop {
                    answered,
                    sender,
                    wish: self.heartbeats.stops.count_read(),
                    result,
                });
                true
            }
            _ if client_session.may_wait(of) => {
                client_session.wait(message, self.stops_before);
                true
            }
            _ => false,
        }
    }
}
