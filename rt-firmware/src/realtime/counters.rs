//! What is counted of activations: executions, overruns, and those that were missed; and how much
//! of it leads to the safe state.

use super::RealTime;
use super::events::Event;
use super::timetable::Activation;
use crate::board::Board;
use esm_link::message::SafeReason;

impl RealTime<'_, '_> {
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn count_execution(
        &mut self,
        board: &mut impl Board,
        slot: usize,
        delay_ticks: u32,
        took_ticks: u32,
    ) {
        if !self.execution.count(slot, delay_ticks, took_ticks) {
            self.count_unusual(board, slot, delay_ticks, took_ticks);
        }
    }

    /// Counts an execution that is not a usual one.
    #[inline(never)]
    fn count_unusual<B: Board>(
        &mut self,
        board: &mut B,
        slot: usize,
        delay_ticks: u32,
        took_ticks: u32,
    ) {
        let execution = &mut self.execution;
        let overruns_in_a_row = execution.count_unusual::<B>(slot, delay_ticks, took_ticks);
        self.observers.count_delay::<B>(delay_ticks);
        if let Some(in_a_row) = overruns_in_a_row {
            self.count_overrun(board, in_a_row);
        }
    }

    #[cold]
    #[inline(never)]
    fn count_overrun(&mut self, board: &mut impl Board, in_a_row: u16) {
        let overruns = self.observers.count_overrun();
        self.execution.tell_overruns(overruns);
        let allowed = self.execution.allowed_overruns_in_a_row(&self.machine);
        if in_a_row > allowed.unwrap_or(self.safety.allowed_overruns_in_a_row()) {
            self.fail_safe(board, SafeReason::Overruns);
        }
    }

    pub(super) fn count_deadline_misses(
        &mut self,
        board: &mut impl Board,
        activation: &Activation,
        missed: u32,
    ) {
        self.note_deadline_misses(activation.slot, missed);
        if self.safety.is_missed_too_often(missed) && self.safety.is_running() {
            self.fail_safe(board, SafeReason::DeadlineMiss);
        }
    }

    // Not inlined: no task should run on top of what a trace record needs of the stack.
    #[inline(never)]
    pub(super) fn note_deadline_misses(&mut self, slot: usize, missed: u32) {
        if missed == 0 {
            return;
        }
        let event = Event::DeadlineMiss {
            slot,
            count: missed,
        };
        let robot_us = self.timetable.previous_end_us();
        self.observers.tell(robot_us, event);
        self.execution.tell_missed(self.observers.missed());
    }
}
