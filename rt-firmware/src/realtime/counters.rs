//! What is counted of activations: delays, executions, overruns, and those that were missed; and
//! how much of it leads to the safe state.

use core::sync::atomic::Ordering::Relaxed;

use super::RealTime;
use super::running::Activation;
use super::slots::nanoseconds;
use crate::board::Board;
use esm_link::black_box::Event;
use esm_link::message::SafeReason;
use esm_link::trace::TraceEvent;

impl RealTime<'_, '_> {
    /// Counts how late an activation began. One that was no later than another of its slot need
    /// not be.
    pub(super) fn count_delay<B: Board>(&mut self, delay_ticks: u32) {
        if delay_ticks > self.max_delay_ticks {
            self.note_delay(delay_ticks, B::TICKS_PER_US);
        }
    }

    #[cold]
    #[inline(never)]
    fn note_delay(&mut self, delay_ticks: u32, ticks_per_us: u32) {
        self.max_delay_ticks = delay_ticks;
        self.health.max_delay_ns = nanoseconds(delay_ticks, ticks_per_us);
    }

    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn count_execution(
        &mut self,
        board: &mut impl Board,
        slot: usize,
        delay_ticks: u32,
        took_ticks: u32,
    ) {
        if let Some(entry) = self.tasks.lists.slots.get_mut(slot)
            && !entry.count(delay_ticks, took_ticks)
        {
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
        let Some(entry) = self.tasks.lists.slots.get_mut(slot) else {
            return;
        };
        let duration_ticks = entry.duration_us().saturating_mul(B::TICKS_PER_US);
        let is_overrun = entry.count_unusual(delay_ticks, took_ticks, duration_ticks);
        let in_a_row = entry.overruns_in_a_row();
        self.count_delay::<B>(delay_ticks);
        if is_overrun {
            self.count_overrun(board, in_a_row);
        }
    }

    #[cold]
    #[inline(never)]
    fn count_overrun(&mut self, board: &mut impl Board, in_a_row: u16) {
        self.health.overruns = self.health.overruns.saturating_add(1);
        self.executor.inputs().overruns = self.health.overruns;
        if in_a_row > self.allowed_overruns_in_a_row() {
            self.fail_safe(board, SafeReason::Overruns);
        }
    }

    /// How many overruns in a row of one slot do not lead to the safe state.
    fn allowed_overruns_in_a_row(&self) -> u16 {
        match (self.supervisor, &self.mission) {
            (Some((instance, allowed)), Some(mission))
                if mission.interpreter.is_enabled(usize::from(instance)) =>
            {
                allowed
            }
            _ => self.limits.overruns_in_a_row,
        }
    }

    /// Counts time that others had none of: what the link may take is a part of the rest.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn count_time(&self, took_ticks: u32) {
        let slots_ticks = &self.heartbeats.slots_ticks;
        // Only this side counts it, so load and store suffice.
        slots_ticks.store(slots_ticks.load(Relaxed).wrapping_add(took_ticks), Relaxed);
    }

    pub(super) fn count_deadline_misses(
        &mut self,
        board: &mut impl Board,
        activation: &Activation,
        missed: u32,
    ) {
        self.note_deadline_misses(activation.slot, missed);
        if missed > self.limits.missed_in_a_row && self.is_running() {
            self.fail_safe(board, SafeReason::DeadlineMiss);
        }
    }

    // Not inlined: no task should run on top of what a trace record needs of the stack.
    #[inline(never)]
    pub(super) fn note_deadline_misses(&mut self, slot: usize, missed: u32) {
        if missed == 0 {
            return;
        }
        self.health.missed = self.health.missed.saturating_add(missed);
        self.executor.inputs().missed = self.health.missed;
        self.note(Event::DeadlineMiss {
            slot: u8::try_from(slot).unwrap_or(u8::MAX),
            count: missed,
        });
        self.trace.record(TraceEvent::DeadlineMiss {
            slot: slot as u16,
            count: missed,
        });
    }
}
