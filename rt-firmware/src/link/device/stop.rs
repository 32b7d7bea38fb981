//! The host's stop, which waits for no command: the real-time side looks for it before each
//! exchange with the body.

use super::LinkSide;
use super::client_session::AwaitedStop;
use super::handler::{Reaction, RequestHandler};
use super::port::LinkPort;
use esm_link::message::Response;

impl RequestHandler<'_, '_> {
    /// Lets the real-time side stop the robot.
    pub(super) fn stop<'a>(&mut self, port: &mut impl LinkPort) -> Reaction<'a> {
        let wish = self.heartbeats.stops.read();
        self.heartbeats.stops.call();
        port.wake_real_time();
        let result = Ok(());
        Reaction::WhenStopped { wish, result }
    }
}

impl LinkSide<'_, '_> {
    /// Answers stops that were read, if the robot stands still for them.
    pub(super) fn tell_stopped(&mut self) {
        let stops = &self.handler.heartbeats.stops;
        let session = self.handler.keys.session();
        for client_session in &mut self.sessions {
            if !client_session.reply.is_done() {
                continue;
            }
            let Some(AwaitedStop {
                answered,
                sender,
                result,
                ..
            }) = client_session.take_stop(|wish| stops.is_done(wish))
            else {
                continue;
            };
            // Also where something else was asked for meanwhile: who wants a stop is to know of it.
            client_session.answer(&[], false);
            let result = result.map(|()| Response::Done);
            client_session.set_reply(answered, result, sender.proof(session));
        }
    }
}
