//! Motors off: the host's stop, the emergency stop, and the safe state that the robot goes to by
//! itself. And the watchdog, which is fed while all live who should.
//!
//! *Invariant:* what is latched ends by what the host says alone, and the reason for which a robot
//! stopped first stays.

use super::RealTime;
use super::events::Event;
use super::trial::is_the_missions_fault;
use crate::board::Board;
use esm_link::message::{Mode, SafeReason};

impl RealTime<'_, '_> {
    /// Puts the robot into its safe state: for what a board finds out outside of activations.
    pub fn fail_safe(&mut self, board: &mut impl Board, reason: SafeReason) {
        self.forget_next();
        let mode = Mode::Safe(reason);
        let is_new = self.safety.go_to(mode);
        if is_the_missions_fault(reason) {
            self.machine.fail_trial(reason);
        }
        self.tell_motors_off(mode, is_new);
        board.motors_off();
        self.tell_health();
    }

    /// Motors off, and so they stay.
    #[inline(never)]
    pub(super) fn set_stopped<B: Board>(&mut self, mode: Mode, board: &mut B) {
        self.forget_next();
        self.safety.set_mode(mode);
        self.tell_motors_off(mode, true);
        board.motors_off();
    }

    // Not inlined: there are more who switch the motors off than kinds of records.
    #[inline(never)]
    fn tell_motors_off(&mut self, mode: Mode, is_new: bool) {
        let robot_us = self.timetable.previous_end_us();
        self.observers
            .tell(robot_us, Event::MotorsOff { mode, is_new });
    }

    /// Stops the robot if somebody wants that: by its button, or by the link's line. To be called
    /// before each exchange with the body.
    #[inline(never)]
    pub(super) fn look_for_stops<B: Board>(&mut self, board: &mut B) {
        let is_called = self.safety.take_stop_call();
        if self.safety.mode() != Mode::EmergencyStopped
            && (self.safety.is_emergency_latched() || is_stop_pressed(board))
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
        let (read, is_new) = self.safety.look_at_wishes();
        if is_new {
            if self.safety.mode().is_latched() {
                // Once more, whoever switched them on.
                board.motors_off();
            } else {
                self.set_stopped(Mode::Stopped, board);
            }
            self.commands.refuse_start();
            self.tell_health();
        }
        self.safety.set_stopped_for(read);
    }

    /// Stops the robot for an emergency, until it is released.
    #[cold]
    #[inline(never)]
    fn stop_for_emergency<B: Board>(&mut self, board: &mut B) {
        self.safety.latch();
        self.observers.keep_emergency_stop(true);
        self.set_stopped(Mode::EmergencyStopped, board);
        self.hold_still(board);
        self.tell_health();
    }

    /// Motors off during an emergency stop, whoever may have switched them on.
    #[inline(never)]
    pub(super) fn hold_still<B: Board>(&mut self, board: &mut B) {
        board.motors_off();
        self.safety.tell_press(is_stop_pressed(board));
    }

    /// Feeds the watchdog if all have shown that they live who should have.
    #[inline(never)]
    pub(super) fn feed_watchdog<B: Board>(&mut self, board: &mut B, now_ticks: u64) {
        let (machine, execution) = (&self.machine, &mut self.execution);
        let first_silent_slot = || {
            let mission = machine.mission();
            let count = mission.map_or(0, |mission| mission.tables().slots().len());
            execution.first_silent_slot(count)
        };
        let fed = self
            .safety
            .may_feed(now_ticks, B::TICKS_PER_US, first_silent_slot);
        match fed {
            Ok(()) => board.feed_watchdog(),
            Err(who) => self.observers.keep_silent(who),
        }
    }
}

/// Whether somebody presses the emergency stop: asked here where an instruction more does not
/// matter, so that the code for it is not there again and again.
#[inline(never)]
pub(super) fn is_stop_pressed<B: Board>(board: &mut B) -> bool {
    board.is_emergency_stop_pressed()
}
