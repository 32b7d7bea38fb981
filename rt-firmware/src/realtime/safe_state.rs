//! Motors off: the host's stop, the emergency stop, and the safe state that the robot goes to by
//! itself.
//!
//! *Invariant:* what is latched ends by what the host says alone, and the reason for which a robot
//! stopped first stays.

use core::sync::atomic::Ordering;

use super::RealTime;
use super::trial::is_the_missions_fault;
use crate::board::Board;
use crate::realtime::mailbox::Command;
use esm_link::black_box::Event;
use esm_link::message::{LinkError, Mode, SafeReason};
use esm_link::trace::{EMERGENCY, TraceEvent};

impl RealTime<'_, '_> {
    /// Puts the robot into its safe state: for what a board finds out outside of activations.
    pub fn fail_safe(&mut self, board: &mut impl Board, reason: SafeReason) {
        self.forget_next();
        if !self.mode.is_latched() {
            self.mode = Mode::Safe(reason);
            self.note(Event::Mode(self.mode));
        }
        if let Some(trial) = &mut self.trial
            && is_the_missions_fault(reason)
        {
            trial.failed.get_or_insert(reason);
        }
        self.trace.record(TraceEvent::MotorsOff {
            reason: Some(reason.number()),
        });
        board.motors_off();
        self.tell_health();
    }

    /// Motors off, and so they stay.
    #[inline(never)]
    pub(super) fn set_stopped<B: Board>(&mut self, mode: Mode, board: &mut B) {
        self.forget_next();
        self.mode = mode;
        self.note(Event::Mode(mode));
        let reason = (mode == Mode::EmergencyStopped).then_some(EMERGENCY);
        self.trace.record(TraceEvent::MotorsOff { reason });
        board.motors_off();
    }

    /// Whether somebody wants the robot to stop who was not heard yet.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn is_stop_wanted<B: Board>(&self, board: &mut B) -> bool {
        self.heartbeats.stops.is_called() || board.is_emergency_stop_pressed()
    }

    /// Stops the robot if somebody wants that: by its button, or by the link's line. To be called
    /// before each exchange with the body.
    #[inline(never)]
    pub(super) fn look_for_stops<B: Board>(&mut self, board: &mut B) {
        let is_called = self.heartbeats.stops.is_called();
        if is_called {
            self.heartbeats.stops.take_call();
        }
        if self.mode != Mode::EmergencyStopped
            && (self.heartbeats.is_emergency_stopped() || is_stop_pressed(board))
        {
            self.stop_for_emergency(board);
        }
        if is_called {
            self.stop_as_wished(board);
        }
    }

    /// Stops the robot if that was wished for since it stopped the last time. What is under way and
    /// older does not start it.
    #[cold]
    #[inline(never)]
    fn stop_as_wished<B: Board>(&mut self, board: &mut B) {
        // What is read first is answered: a wish that comes after it is counted in the next round.
        let read = self.heartbeats.stops.count_read();
        let wishes = self.heartbeats.stops.count();
        if wishes != self.stops {
            self.stops = wishes;
            if self.mode.is_latched() {
                // Once more, whoever switched them on.
                board.motors_off();
            } else {
                self.set_stopped(Mode::Stopped, board);
            }
            self.refuse_start();
            self.tell_health();
        }
        self.heartbeats.stops.set_done(read);
    }

    /// A start that is under way does not come through.
    fn refuse_start(&mut self) {
        if let Some(command) = (self.waiting).take_if(|command| matches!(command, Command::Start)) {
            *command = Command::Failed(LinkError::StopCame);
            self.send(command);
        }
        if let Some(command) = &mut self.answered
            && let Command::Started = **command
        {
            **command = Command::Failed(LinkError::StopCame);
        }
    }

    /// Stops the robot for an emergency, until it is released.
    #[cold]
    #[inline(never)]
    pub(super) fn stop_for_emergency<B: Board>(&mut self, board: &mut B) {
        if !self.heartbeats.emergency_stop.load(Ordering::Relaxed) {
            self.count_press();
        }
        self.heartbeats
            .emergency_stop
            .store(true, Ordering::Relaxed);
        if let Some(kept) = self.kept {
            kept.set_emergency_stop(true);
        }
        self.set_stopped(Mode::EmergencyStopped, board);
        self.hold_still(board);
        self.tell_health();
    }

    /// Motors off during an emergency stop, whoever may have switched them on.
    #[inline(never)]
    pub(super) fn hold_still<B: Board>(&mut self, board: &mut B) {
        board.motors_off();
        let is_pressed = is_stop_pressed(board);
        self.heartbeats
            .stop_pressed
            .store(is_pressed, Ordering::Relaxed);
        if is_pressed {
            self.count_press();
        }
    }

    /// The button is pressed: what was sent before does not end this.
    fn count_press(&mut self) {
        self.heartbeats.stops.press();
        // The robot stops for it now.
        self.stops = self.stops.wrapping_add(1);
    }
}

/// Whether somebody presses the emergency stop: asked here where an instruction more does not
/// matter, so that the code for it is not there again and again.
#[inline(never)]
pub(super) fn is_stop_pressed<B: Board>(board: &mut B) -> bool {
    board.is_emergency_stop_pressed()
}
