//! The host's stop, which waits for no letter: the real-time side looks for it before each exchange with the body.

use super::LinkSide;
use super::desk::{Desk, Reaction};
use super::port::LinkPort;
use crate::link::message::{FromDevice, LinkError, Request, Response};

/// A stop that was read and is not answered yet.
#[derive(Clone, Copy)]
pub(crate) struct Awaited {
    /// Number of the request.
    pub(super) seq: u8,
    /// Of the wish.
    pub(super) wish: u32,
    /// What is answered then.
    pub(super) result: Result<(), LinkError>,
}

/// Whether a request stops the robot: it is read also where no time is left for others.
pub(super) fn is_stop(request: &Request<'_>) -> bool {
    matches!(request, Request::Stop | Request::EmergencyStop)
}

impl Desk<'_, '_> {
    /// Lets the real-time side stop the robot, for the request of this number.
    pub(super) fn stop<'a>(&mut self, seq: u8, port: &mut impl LinkPort) -> Reaction<'a> {
        let wish = self.signs.stops.read();
        self.signs.stops.call();
        port.wake_real_time();
        let result = Ok(());
        self.awaited_stop = Some(Awaited { seq, wish, result });
        Reaction::Later
    }
}

impl LinkSide<'_, '_> {
    /// Answers the stop that was read last, if the robot stands still for it.
    pub(super) fn tell_stopped(&mut self) {
        if !self.reply.is_done() {
            return;
        }
        let signs = self.desk.signs;
        let awaited = &mut self.desk.awaited_stop;
        let Some(Awaited { seq, result, .. }) =
            awaited.take_if(|stop| signs.stops.is_done(stop.wish))
        else {
            return;
        };
        if self.last.is_some_and(|(last, _)| last == seq) {
            self.awaited = false;
        }
        // Also where something else was asked for meanwhile: who wants a stop is to know of it.
        self.acknowledges = false;
        self.reply.set(&FromDevice::Reply {
            seq,
            result: result.map(|()| Response::Done),
        });
    }
}
