//! An occurrence of a slot: the exchange with the body, the slot-0 run that has ended, in the interpreter's slot the macro step, then the slot's tasks, and a slot-0 run that waits.
//! Where the first task was made ready, the slot-0 run is taken back after the tasks.

use esm_core::Fault;

use super::RealTime;
use super::slots::SlotEntry;
use super::trace::StepObserver;
use crate::board::{Board, OccurrenceStart};
use esm_link::message::{Mode, SafeReason};

/// An occurrence that is being executed.
#[derive(Clone, Copy)]
pub(super) struct Occurrence {
    pub(super) slot: usize,
    /// Nominal start since the origin.
    pub(super) start_us: u64,
    pub(super) number: u64,
    pub(super) interpreter: bool,
}

impl<const SLOTS: usize> RealTime<'_, '_, SLOTS> {
    /// Notes that an occurrence begins, so long after its nominal start.
    #[inline(always)]
    pub(super) fn begin(
        &mut self,
        start_us: u64,
        duration_us: u32,
        delay_ticks: u32,
        ticks_per_us: u32,
    ) {
        let Some(mission) = &mut self.mission else {
            return;
        };
        mission.occurrences += 1;
        self.previous_end_us = mission.origin.us + start_us + u64::from(duration_us);
        if delay_ticks > self.max_delay_ticks {
            self.note_delay(delay_ticks, ticks_per_us);
        }
    }

    /// Executes an occurrence that began at `began_ticks`; its nominal start was at `start_ticks`.
    pub(super) fn execute<B: Board>(
        &mut self,
        board: &mut B,
        occurrence: &Occurrence,
        began_ticks: u64,
        start_ticks: u64,
    ) {
        let delay_ticks = u32::try_from(began_ticks - start_ticks).unwrap_or(u32::MAX);
        let Some(mission) = &self.mission else { return };
        let start_us = mission.robot_us(occurrence.start_us);
        let start = OccurrenceStart {
            slot: occurrence.slot,
            number: occurrence.number,
            start_us,
            start_ticks,
            previous_end_us: self.previous_end_us.min(start_us),
            interpreter: occurrence.interpreter,
        };
        let duration_us = self
            .tasks
            .lists
            .slots
            .get(occurrence.slot)
            .map_or(0, SlotEntry::duration_us);
        self.begin(
            occurrence.start_us,
            duration_us,
            delay_ticks,
            B::TICKS_PER_US,
        );
        if self.mode == Mode::EmergencyStopped {
            self.hold_still(board);
        }
        if let Err(reason) = board.begin_occurrence(&start)
            && self.mode == Mode::Running
        {
            self.fail_safe(board, reason);
        }
        self.take_job_back(Some(occurrence));
        if occurrence.interpreter {
            self.send_answered();
            self.listen(start_us);
            if self.mode == Mode::Running {
                self.macro_step(board, start_us);
            } else {
                board.motors_off();
            }
        }
        if self.mode == Mode::Running {
            let duration_ticks = duration_us.saturating_mul(B::TICKS_PER_US);
            let first = self
                .tasks
                .lists
                .slots
                .get(occurrence.slot)
                .and_then(SlotEntry::first_task);
            let period_us = self.dispatcher.period_us(occurrence.slot);
            self.execute_tasks(board, first, occurrence.start_us, period_us, duration_ticks);
            if self.tasks.look_for_jobs() {
                self.start_job(occurrence.start_us, occurrence.number);
            }
            let took_ticks = board.now_low_ticks().wrapping_sub(began_ticks as u32);
            self.count_execution(
                board,
                occurrence.slot,
                delay_ticks,
                took_ticks,
                duration_ticks,
            );
        }
        if occurrence.interpreter {
            self.tell_health();
        }
    }

    #[inline(never)]
    fn macro_step(&mut self, board: &mut impl Board, robot_us: u64) {
        let Some(mission) = &mut self.mission else {
            return;
        };
        mission.step_us = robot_us;
        let mut observer = StepObserver {
            tasks: &mut self.tasks,
            trace: &mut self.trace,
            black_box: self.kept.map(|kept| &kept.black_box),
            robot_us,
        };
        self.record.before_step(&mission.interpreter);
        let ended = mission.interpreter.macro_step(&mut observer);
        self.record.after_step(&mission.interpreter);
        match ended {
            Ok(summary) => {
                mission.next_step = summary.step + 1;
                self.health.steps = mission.next_step;
                self.health.t_us = summary.t_us();
                self.sampler.after_step(&self.executor, summary.t_us());
                self.trace.step(&summary, &mission.interpreter);
            }
            Err(fault) => {
                self.trace.fault(mission.next_step, fault);
                let reason = match fault {
                    Fault::EventQueueOverflow => SafeReason::EventQueueOverflow,
                    Fault::MacroStepLimit => SafeReason::MacroStepLimit,
                };
                self.fail_safe(board, reason);
            }
        }
    }
}
