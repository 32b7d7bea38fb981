//! The host's stop, which waits for no letter: the real-time side looks for it before each exchange with the body.

use super::LinkSide;
use super::desk::{Desk, Reaction};
use super::port::LinkPort;
use crate::link::message::{FromDevice, Request, Response};

/// A stop that was read and is not answered yet.
#[derive(Clone, Copy)]
pub(crate) struct Awaited {
    /// Number of the request.
    pub(super) seq: u8,
    /// Of the wish.
    wish: u32,
}

/// Whether a request stops the robot: it is read also where no time is left for others.
pub(super) fn is_stop(request: &Request<'_>) -> bool {
    matches!(request, Request::Stop | Request::EmergencyStop)
}

impl Desk<'_, '_> {
    /// Lets the real-time side stop the robot.
    pub(super) fn stop<'a>(&mut self, port: &mut impl LinkPort) -> Reaction<'a> {
        let wish = self.signs.stops.read();
        self.signs.stops.call();
        port.wake_real_time();
        if self.signs.stops.is_done(wish) {
            return Reaction::Answer(Ok(Response::Done));
        }
        let seq = self.ticket.take().map_or(0, |ticket| ticket.seq);
        self.awaited_stop = Some(Awaited { seq, wish });
        Reaction::Later
    }
}

impl LinkSide<'_, '_> {
    /// Answers the stop that was read last, if the robot stands still for it.
    pub(super) fn tell_stopped(&mut self) {
        if self.reply.is_begun() {
            return;
        }
        let signs = self.desk.signs;
        let awaited = &mut self.desk.awaited_stop;
        let Some(Awaited { seq, .. }) = awaited.take_if(|stop| signs.stops.is_done(stop.wish))
        else {
            return;
        };
        if self.awaited && self.last.is_some_and(|(last, _)| last == seq) {
            self.awaited = false;
            self.acknowledges = false;
            self.reply.set(&FromDevice::Reply {
                seq,
                result: Ok(Response::Done),
            });
        }
    }
}
