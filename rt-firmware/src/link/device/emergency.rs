//! The emergency stop, which waits for no letter, and is kept over a loss of power.

use core::sync::atomic::Ordering;

use super::desk::{Desk, Reaction};
use super::port::LinkPort;
use crate::mail::Letter;
use esm_link::message::{LinkError, Response};

impl Desk<'_, '_> {
    /// Asks the real-time side to end the emergency stop that is latched now.
    pub(super) fn release<'a>(&mut self) -> Reaction<'a> {
        // What is under way already is not changed by one that comes too early.
        if self.letter.is_some() {
            self.signs.release.store(true, Ordering::Relaxed);
        }
        self.ask(Letter::Release)
    }

    /// Stops the robot, without the letter, which may be under way.
    pub(super) fn emergency_stop(
        &mut self,
        port: &mut impl LinkPort,
    ) -> Result<Response<'_>, LinkError> {
        self.signs.stops.read();
        self.signs.latch_emergency_stop(self.about.kept);
        self.stop_is_kept = true;
        port.wake_real_time();
        if let Some(keeper) = port.keeper() {
            keeper.set_emergency_stop(true)?;
        }
        Ok(Response::Done)
    }

    /// Lets the keeper remember a stop that the button has latched, so that it outlasts a loss of
    /// power, too. Once: a flash that does not take it wears out by asking again.
    pub(super) fn keep_stop(&mut self, port: &mut impl LinkPort) {
        let is_latched = self.signs.emergency_stop.load(Ordering::Relaxed);
        if is_latched == self.stop_is_kept {
            return;
        }
        self.stop_is_kept = is_latched;
        if is_latched
            && let Some(keeper) = port.keeper()
            && keeper.set_emergency_stop(true).is_err()
        {
            error!("the flash does not keep the emergency stop: a loss of power ends it");
        }
    }
}
