//! Who is told what happens: the trace, the black box, a recording, samples of values, and the
//! snapshot of the robot's health that the link reads and tells its subscribers.

use esm_core::{BlobBuffer, Interpreter, StepSummary};
use esm_link::message::{Mode, Silent};
use esm_link::trial::Trial;

use super::events::Event;
use super::slots::nanoseconds;
use super::trace::Trace;
use crate::black_box::KEEPS_RECORDS;
use crate::board::Board;
use crate::ports::Executor;
use crate::recorder::Recorder;
use crate::retained_ram::RetainedRam;
use crate::status::{Health, SnapshotWriter};
use crate::telemetry::Sampler;

/// Those who are told.
pub(crate) struct Observers<'m> {
    trace: Trace<'m>,
    /// What a reset leaves alone; the black box is in it.
    kept: Option<&'m RetainedRam>,
    record: Recorder<'m>,
    sampler: Sampler<'m>,
    snapshot: SnapshotWriter<'m>,
    /// What the snapshot tells next.
    health: Health,
    /// Longest start delay since the mission started.
    max_delay_ticks: u32,
}

/// What the snapshot tells beside what was told in passing.
pub(super) struct Present {
    pub(super) mode: Mode,
    /// Activations of the mission.
    pub(super) executed: u64,
    pub(super) background_busy: bool,
    pub(super) changed_params: u8,
    pub(super) saved_params: u8,
    pub(super) trial: Option<Trial>,
    /// Nominal end of the last activation, on the robot's clock.
    pub(super) robot_us: u64,
}

impl<'m> Observers<'m> {
    pub(crate) fn new(
        trace: Trace<'m>,
        kept: Option<&'m RetainedRam>,
        record: Recorder<'m>,
        sampler: Sampler<'m>,
        snapshot: SnapshotWriter<'m>,
    ) -> Self {
        Observers {
            trace,
            kept,
            record,
            sampler,
            snapshot,
            health: Health::EMPTY,
            max_delay_ticks: 0,
        }
    }

    /// Tells what happened at this robot time.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn tell(&mut self, at_us: u64, event: Event) {
        match event {
            Event::Started { mission, .. } => self.health.mission = Some(mission),
            Event::FellBack(fell_back) => self.health.fell_back = Some(fell_back),
            Event::DeadlineMiss { count, .. } => {
                self.health.missed = self.health.missed.saturating_add(count);
            }
            _ => {}
        }
        if KEEPS_RECORDS
            && let Some(kept) = self.kept
            && let Some(record) = event.black_box_record()
        {
            kept.black_box.record(at_us, record);
        }
        self.trace.record(event.trace_record());
    }

    /// The next macro step is told whole: something outside of macro steps changed which tasks are
    /// enabled.
    pub(super) fn tell_next_step_in_full(&mut self) {
        self.trace.write_next_in_full();
    }

    /// A mission starts, from its beginning or warm.
    pub(super) fn begin_mission(&mut self, at_us: u64, mission: u32, start_us: u64, warm: bool) {
        self.trace.write_next_in_full();
        self.tell(at_us, Event::Started { mission, start_us });
        self.record.started(mission, start_us, warm);
        self.sampler.started(mission);
    }

    /// Macro steps are left out before the next one.
    pub(super) fn skip_steps(&mut self, missed: u32) {
        self.record.skipped(missed);
        self.trace.write_next_in_full();
    }

    /// A macro step is next.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn before_step(&mut self, interpreter: &Interpreter<'_, BlobBuffer<'_>>) {
        self.record.before_step(interpreter);
    }

    /// A macro step is over, whether or not it came to its end.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn after_step(&mut self, interpreter: &Interpreter<'_, BlobBuffer<'_>>) {
        self.record.after_step(interpreter);
    }

    /// A macro step came to its end.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn end_step(
        &mut self,
        summary: &StepSummary,
        interpreter: &Interpreter<'_, BlobBuffer<'_>>,
        executor: &Executor<'_>,
    ) {
        self.health.steps = summary.step + 1;
        self.health.t_us = summary.t_us();
        self.sampler.after_step(executor, summary.t_us());
        self.trace.step(summary, interpreter);
    }

    /// Samples of these nets are told from the next macro step on.
    pub(super) fn begin_samples(
        &mut self,
        number: u8,
        mission: u32,
        period_ms: u16,
        nets: impl Iterator<Item = u16>,
    ) {
        self.sampler.begin(number, mission, period_ms, nets);
    }

    /// What a reset leaves alone.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn kept(&self) -> Option<&'m RetainedRam> {
        self.kept
    }

    /// Keeps who was silent, so that the watchdog is fed no more.
    pub(super) fn keep_silent(&self, who: Silent) {
        if let Some(kept) = self.kept {
            kept.set_silent(who);
        }
    }

    /// Keeps whether an emergency stop is latched.
    pub(super) fn keep_emergency_stop(&self, is_latched: bool) {
        if let Some(kept) = self.kept {
            kept.set_emergency_stop(is_latched);
        }
    }

    /// Counters of a robot before its next mission.
    pub(super) fn begin_health(&mut self) {
        self.health = Health {
            missed: self.health.missed,
            overruns: self.health.overruns,
            fell_back: self.health.fell_back,
            ..Health::EMPTY
        };
        self.max_delay_ticks = 0;
    }

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

    /// Counts an overrun of a slot, and returns how many there were.
    pub(super) fn count_overrun(&mut self) -> u32 {
        self.health.overruns = self.health.overruns.saturating_add(1);
        self.health.overruns
    }

    /// Activations that were missed since the robot started.
    pub(super) fn missed(&self) -> u32 {
        self.health.missed
    }

    /// Tells the link how the robot is.
    pub(super) fn show(&mut self, present: Present) {
        self.health.mode = present.mode;
        // What wraps is the number that is told.
        self.health.executed = present.executed as u32;
        self.health.background_busy = present.background_busy;
        self.health.changed_params = present.changed_params;
        self.health.saved_params = present.saved_params;
        self.health.trial = present.trial;
        if let Some(kept) = self.kept {
            kept.set_alive(present.robot_us);
        }
        self.snapshot.write(&self.health);
    }
}
