//! The trace: records of what happens, in a ring, if somebody wants them.

use core::ops::Deref;
use core::sync::atomic::{AtomicBool, Ordering};

use esm_core::tables::Tables;
use esm_core::{Interpreter, StepSummary};

use crate::ring::RingWriter;
use esm_link::trace::{TraceEvent, write_step};

/// Room that transitions and steps leave to records that come seldom and must not be lost: a
/// machine that goes wild fills the ring with transitions before its fault is known.
const RESERVED_BYTES: usize = 48;

/// Writes trace records, if somebody wants them.
pub(crate) struct Trace<'m> {
    ring: RingWriter<'m>,
    wanted: &'m AtomicBool,
    /// The reader does not know the states and enabled tasks as they are, or the next step's
    /// number: it is written in full.
    stale: bool,
}

impl<'m> Trace<'m> {
    pub(crate) fn new(ring: RingWriter<'m>, wanted: &'m AtomicBool) -> Self {
        Trace {
            ring,
            wanted,
            stale: true,
        }
    }

    /// The reader cannot tell the next step from the one before: something outside of macro steps
    /// changed which tasks are enabled, or macro steps were left out.
    pub(crate) fn write_next_in_full(&mut self) {
        self.stale = true;
    }

    /// Writes a record.
    pub(crate) fn record(&mut self, record: TraceEvent<'_>) {
        let reserve = match record {
            TraceEvent::Transition { .. } | TraceEvent::Same { .. } => RESERVED_BYTES,
            _ => 0,
        };
        let wanted = self.wanted.load(Ordering::Relaxed);
        if !wanted || !self.ring.record(reserve, |sink| record.write(sink)) {
            self.stale = true;
        }
    }

    /// Writes the end of a macro step.
    pub(crate) fn step<B: Deref<Target = [u8]>>(
        &mut self,
        summary: &StepSummary,
        interpreter: &Interpreter<'_, B>,
    ) {
        if !self.stale && !summary.changed {
            self.record(TraceEvent::Same {
                micro_steps: summary.micro_steps,
            });
            return;
        }
        let written = self.wanted.load(Ordering::Relaxed)
            && self.ring.record(RESERVED_BYTES, |sink| {
                let states = ActiveStates {
                    tables: interpreter.tables(),
                    current: |region| interpreter.current(region),
                    at: 0,
                };
                let enabled = (0..interpreter.tables().task_instance_count())
                    .filter(|instance| interpreter.is_enabled(*instance))
                    .map(|instance| instance as u16);
                write_step(sink, summary.step, summary.micro_steps, states, enabled);
            });
        self.stale = !written;
    }
}

/// The current states of the active regions, each superstate followed by what is inside.
pub(crate) struct ActiveStates<'a, F> {
    pub(crate) tables: Tables<'a>,
    pub(crate) current: F,
    pub(crate) at: usize,
}

impl<F: Clone> Clone for ActiveStates<'_, F> {
    fn clone(&self) -> Self {
        ActiveStates {
            tables: self.tables,
            current: self.current.clone(),
            at: self.at,
        }
    }
}

impl<F: Fn(usize) -> usize> Iterator for ActiveStates<'_, F> {
    type Item = (u16, u16);

    fn next(&mut self) -> Option<(u16, u16)> {
        let region = self.tables.region_instance(self.at)?;
        let state = (self.current)(self.at);
        let item = (self.at as u16, state as u16);
        let inside = self.tables.first_region_inside(self.at, state);
        self.at = inside.unwrap_or(region.next);
        Some(item)
    }
}
