//! Whether the robot may move, and whether all are alive who should be: the mode, what goes wrong
//! too often, wishes to stop, and heartbeats.

use core::sync::atomic::Ordering;

use esm_link::message::{Mode, SafeReason, Silent};

use super::limits::Limits;
use crate::board::Board;
use crate::heartbeats::Heartbeats;
use crate::retained_ram::RetainedRam;
use crate::supervision::Supervision;

/// The mode, and what it is decided by.
pub(crate) struct Safety<'m> {
    mode: Mode,
    limits: Limits,
    /// What the other sides show of themselves, and how they call this one.
    heartbeats: &'m Heartbeats,
    supervision: Supervision,
    /// Wishes that the robot stops, as many as were looked at.
    stops: u32,
    /// Requests that had come when that was looked at last, and robot time when another one had.
    requests: u32,
    heard_us: u64,
}

impl<'m> Safety<'m> {
    pub(crate) fn new(limits: Limits, heartbeats: &'m Heartbeats) -> Self {
        Safety {
            mode: Mode::Empty,
            limits,
            heartbeats,
            supervision: Supervision::new(),
            stops: 0,
            requests: 0,
            heard_us: 0,
        }
    }

    /// What the robot is doing.
    pub(super) fn mode(&self) -> Mode {
        self.mode
    }

    /// Whether the mission runs. Modes as a whole are not compared for it.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn is_running(&self) -> bool {
        matches!(self.mode, Mode::Running)
    }

    /// Why the robot is in its safe state, if it is.
    pub(super) fn safe_reason(&self) -> Option<SafeReason> {
        match self.mode {
            Mode::Safe(reason) => Some(reason),
            _ => None,
        }
    }

    /// Changes the mode, whatever it was.
    pub(super) fn set_mode(&mut self, mode: Mode) {
        self.mode = mode;
    }

    /// Changes the mode, unless the robot was stopped and waits for the host. Says whether it did.
    pub(super) fn go_to(&mut self, mode: Mode) -> bool {
        let is_free = !self.mode.is_latched();
        if is_free {
            self.mode = mode;
        }
        is_free
    }

    /// Overruns in a row of one slot that do not lead to the safe state.
    pub(super) fn allowed_overruns_in_a_row(&self) -> u16 {
        self.limits.overruns_in_a_row
    }

    /// Whether so many activations in a row that were missed lead to the safe state.
    pub(super) fn is_missed_too_often(&self, missed: u32) -> bool {
        missed > self.limits.missed_in_a_row
    }

    /// Whether somebody wants the robot to stop who was not heard yet.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn is_stop_wanted<B: Board>(&self, board: &mut B) -> bool {
        self.heartbeats.stops.is_called() || board.is_emergency_stop_pressed()
    }

    /// Whether somebody has called for a stop. Takes the call back.
    pub(super) fn take_stop_call(&mut self) -> bool {
        let is_called = self.heartbeats.stops.is_called();
        if is_called {
            self.heartbeats.stops.take_call();
        }
        is_called
    }

    /// Looks at the wishes to stop. Answers how many the link has read, and whether there is one
    /// since the last look.
    pub(super) fn look_at_wishes(&mut self) -> (u32, bool) {
        // What is read first is answered: a wish that comes after it is counted in the next round.
        let read = self.heartbeats.stops.count_read();
        let wishes = self.heartbeats.stops.count();
        let is_new = wishes != self.stops;
        self.stops = wishes;
        (read, is_new)
    }

    /// The robot stands still for the first so many wishes that the link has read.
    pub(super) fn set_stopped_for(&self, read: u32) {
        self.heartbeats.stops.set_done(read);
    }

    /// Whether a stop was wished for since there were so many wishes.
    pub(super) fn is_overtaken(&self, stops: u32) -> bool {
        self.heartbeats.stops.overtakes(stops)
    }

    /// Whether an emergency stop is latched, also where no slot has looked yet.
    pub(super) fn is_emergency_latched(&self) -> bool {
        self.heartbeats.is_emergency_stopped()
    }

    /// Latches an emergency stop that is being looked at.
    pub(super) fn latch(&mut self) {
        if !self.heartbeats.emergency_stop.load(Ordering::Relaxed) {
            self.count_press();
        }
        self.heartbeats
            .emergency_stop
            .store(true, Ordering::Relaxed);
    }

    /// Latches an emergency stop once more that came while one was released.
    pub(super) fn latch_again(&self, kept: Option<&RetainedRam>) {
        self.heartbeats.latch_emergency_stop(kept);
    }

    /// Ends an emergency stop. Says whether one was latched.
    pub(super) fn release(&mut self) -> bool {
        // Who wanted it may have released it before any slot has looked.
        let is_latched = self.heartbeats.emergency_stop.load(Ordering::Relaxed);
        self.heartbeats
            .emergency_stop
            .store(false, Ordering::Relaxed);
        self.heartbeats.stop_pressed.store(false, Ordering::Relaxed);
        is_latched || self.mode == Mode::EmergencyStopped
    }

    /// Tells whether the button is pressed while an emergency stop is latched.
    pub(super) fn tell_press(&mut self, is_pressed: bool) {
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

    /// Another mission runs from this robot time on.
    pub(super) fn begin_mission(&mut self, start_us: u64, longest_period_us: u32) {
        self.heard_us = start_us;
        self.supervision.begin_mission(longest_period_us);
        self.go_to(Mode::Running);
    }

    /// Whether all have shown that they live who should have. `first_silent_slot` says which slot
    /// was not executed since it was asked last.
    pub(super) fn may_feed(
        &mut self,
        now_ticks: u64,
        ticks_per_us: u32,
        first_silent_slot: impl FnOnce() -> Option<usize>,
    ) -> Result<(), Silent> {
        let is_running = self.is_running();
        self.supervision.may_feed(
            now_ticks,
            ticks_per_us,
            self.heartbeats,
            is_running,
            first_silent_slot,
        )
    }

    /// Looks whether the host has called, in an activation that starts at this robot time. Answers
    /// for how long it has not, in microseconds.
    pub(super) fn listen(&mut self, robot_us: u64) -> u32 {
        let requests = self.heartbeats.requests.load(Ordering::Relaxed);
        if requests != self.requests {
            self.requests = requests;
            self.heard_us = robot_us;
        }
        let silent_us = robot_us.saturating_sub(self.heard_us);
        u32::try_from(silent_us).unwrap_or(u32::MAX)
    }

    /// Whether more is to be looked at, at the end of an activation, than the next one.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn is_called(&self) -> bool {
        self.heartbeats.attention.is_set()
    }

    /// Takes back that more is to be looked at.
    pub(super) fn take_call(&self) {
        self.heartbeats.attention.take_back();
    }

    /// Lets more be looked at.
    pub(super) fn call(&self) {
        self.heartbeats.attention.set();
    }

    /// Whether the link makes a mission, or has asked for one to take over.
    pub(super) fn is_mission_coming(&self) -> bool {
        self.heartbeats.mission_is_coming.load(Ordering::Relaxed)
    }

    /// Counts time that others had none of: what the link may take is a part of the rest.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn count_time(&self, took_ticks: u32) {
        let slots_ticks = &self.heartbeats.slots_ticks;
        // Only this side counts it, so load and store suffice.
        slots_ticks.store(
            slots_ticks.load(Ordering::Relaxed).wrapping_add(took_ticks),
            Ordering::Relaxed,
        );
    }

    /// Moves the ticks that were counted to their microseconds.
    pub(super) fn settle_time(&self, ticks_per_us: u32) {
        self.heartbeats.settle_slots(ticks_per_us);
    }
}
