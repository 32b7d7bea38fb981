//! The host's stop, which waits for no letter: the real-time side looks for it before each exchange
//! with the body.

use super::LinkSide;
use super::conversation::AwaitedStop;
use super::desk::{Desk, Reaction};
use super::port::LinkPort;
use esm_link::message::Response;

impl Desk<'_, '_> {
    /// Lets the real-time side stop the robot.
    pub(super) fn stop<'a>(&mut self, port: &mut impl LinkPort) -> Reaction<'a> {
        let wish = self.signs.stops.read();
        self.signs.stops.call();
        port.wake_real_time();
        let result = Ok(());
        Reaction::WhenStopped { wish, result }
    }
}

impl LinkSide<'_, '_> {
    /// Answers stops that were read, if the robot stands still for them.
    pub(super) fn tell_stopped(&mut self) {
        let stops = &self.desk.signs.stops;
        let session = self.desk.keys.session();
        for conversation in &mut self.conversations {
            if !conversation.reply.is_done() {
                continue;
            }
            let Some(AwaitedStop {
                answered,
                sender,
                result,
                ..
            }) = conversation.take_stop(|wish| stops.is_done(wish))
            else {
                continue;
            };
            // Also where something else was asked for meanwhile: who wants a stop is to know of it.
            conversation.answer(&[], false);
            let result = result.map(|()| Response::Done);
            conversation.set_reply(answered, result, sender.proof(session));
        }
    }
}
