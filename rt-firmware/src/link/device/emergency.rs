//! The emergency stop, which waits for no command, and is kept over a loss of power.

use core::sync::atomic::Ordering;

use super::handler::{Reaction, RequestHandler};
use super::port::LinkPort;
use crate::realtime::mailbox::Command;
use esm_link::message::{LinkError, Response};

impl RequestHandler<'_, '_> {
    /// Asks the real-time side to end the emergency stop that is latched now.
    pub(super) fn release<'a>(&mut self) -> Reaction<'a> {
        self.ask(Command::Release)
    }

    /// Stops the robot, without the command, which may be under way.
    pub(super) fn emergency_stop(
        &mut self,
        port: &mut impl LinkPort,
    ) -> Result<Response<'_>, LinkError> {
        self.heartbeats.stops.read();
        self.heartbeats.latch_emergency_stop(self.about.kept);
        self.stop_is_stored = true;
        port.wake_real_time();
        if let Some(mission_store) = port.mission_store() {
            mission_store.set_emergency_stop(true)?;
        }
        Ok(Response::Done)
    }

    /// Lets the mission store remember a stop that the button has latched, so that it outlasts a
    /// loss of power, too. Once: a flash that does not take it wears out by asking again.
    pub(super) fn store_stop(&mut self, port: &mut impl LinkPort) {
        let is_latched = self.heartbeats.emergency_stop.load(Ordering::Relaxed);
        if is_latched == self.stop_is_stored {
            return;
        }
        self.stop_is_stored = is_latched;
        if is_latched
            && let Some(mission_store) = port.mission_store()
            && mission_store.set_emergency_stop(true).is_err()
        {
            error!("the flash does not keep the emergency stop: a loss of power ends it");
        }
    }
}
