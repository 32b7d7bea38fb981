//! A robot's trace records, turned into a trace.

use std::io::{self, Write};
use std::sync::Arc;

use rt_firmware::link::trace::{FaultCode, TraceRecord};

use super::directory::Directory;
use super::{Snapshot, Step, TraceWriter};

/// Follows the records that a robot sends of one mission, and writes its trace.
///
/// A robot says which macro step a transition belongs to when that step ends, so transitions are kept until then. Records that are no
/// part of a trace (runs in slot 0, overruns, missed occurrences) change nothing here.
pub struct RecordTrace<W> {
    writer: TraceWriter<W>,
    period_us: u64,
    /// Number of the next macro step, unless its record says otherwise.
    next_step: u64,
    last: LastStates,
    /// Transitions of the macro step under way: micro step, region instance, transition.
    taken: Vec<(u8, u16, u16)>,
}

/// What was current after the last macro step that a robot told of.
#[derive(Clone, Debug, Default)]
pub struct LastStates {
    /// Index in the blob of the current state, by region instance.
    current: Vec<usize>,
    /// By task instance.
    enabled: Vec<bool>,
}

impl Snapshot for LastStates {
    fn current(&self, region: usize) -> usize {
        self.current.get(region).copied().unwrap_or_default()
    }

    fn is_enabled(&self, task: usize) -> bool {
        self.enabled.get(task).copied().unwrap_or_default()
    }
}

/// What a record ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// A macro step.
    Step(Step),
    /// The machine.
    Fault(Step, &'static str),
}

impl<W: Write> RecordTrace<W> {
    /// Starts with the first macro step of a mission.
    pub fn new(out: W, directory: Arc<Directory>) -> Self {
        let last = LastStates {
            current: vec![0; directory.regions().len()],
            enabled: vec![false; directory.task_states().len()],
        };
        let period_us = directory.interpreter_period_us().into();
        RecordTrace {
            writer: TraceWriter::new(out, directory),
            period_us,
            next_step: 0,
            last,
            taken: Vec::new(),
        }
    }

    /// What was current after the last macro step.
    pub fn states(&self) -> &LastStates {
        &self.last
    }

    /// The transitions of the macro step under way: micro step, region instance, transition.
    pub fn taken(&self) -> &[(u8, u16, u16)] {
        &self.taken
    }

    /// Takes the next record, and writes the lines of a macro step when the record ends one.
    ///
    /// # Errors
    /// When the lines cannot be written.
    pub fn record(&mut self, record: &TraceRecord<'_>) -> io::Result<Option<Ended>> {
        match *record {
            TraceRecord::Started { .. } => {
                self.next_step = 0;
                self.taken.clear();
                Ok(None)
            }
            TraceRecord::Transition {
                micro,
                region_instance,
                transition,
            } => {
                self.taken.push((micro, region_instance, transition));
                Ok(None)
            }
            TraceRecord::Step {
                step,
                micro_steps,
                states,
                enabled,
            } => {
                for (region, state) in states {
                    if let Some(current) = self.last.current.get_mut(usize::from(region)) {
                        *current = usize::from(state);
                    }
                }
                self.last.enabled.fill(false);
                for task in enabled {
                    if let Some(enabled) = self.last.enabled.get_mut(usize::from(task)) {
                        *enabled = true;
                    }
                }
                self.end_step(step, micro_steps)
            }
            TraceRecord::Same { micro_steps } => self.end_step(self.next_step, micro_steps),
            TraceRecord::Fault { step, code } => {
                let at = self.write_taken(step)?;
                let code = match code {
                    FaultCode::EventQueueOverflow => esm_core::Fault::EventQueueOverflow,
                    FaultCode::MacroStepLimit => esm_core::Fault::MacroStepLimit,
                };
                self.writer.fault(at, code.code())?;
                Ok(Some(Ended::Fault(at, code.code())))
            }
            TraceRecord::JobStarted { .. }
            | TraceRecord::JobEnded { .. }
            | TraceRecord::Overrun { .. }
            | TraceRecord::Missed { .. }
            | TraceRecord::MotorsOff { .. } => Ok(None),
        }
    }

    fn end_step(&mut self, step: u64, micro_steps: u8) -> io::Result<Option<Ended>> {
        let at = self.write_taken(step)?;
        self.writer.step(at, micro_steps.into(), &self.last)?;
        Ok(Some(Ended::Step(at)))
    }

    fn write_taken(&mut self, step: u64) -> io::Result<Step> {
        let at = Step {
            step,
            t_us: step.saturating_mul(self.period_us),
        };
        self.next_step = step.saturating_add(1);
        for (micro, region, transition) in self.taken.drain(..) {
            self.writer
                .transition(at, micro.into(), region.into(), transition.into())?;
        }
        Ok(at)
    }

    /// Hands what was written so far to whoever reads it.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }

    /// Where the lines went.
    pub fn into_inner(self) -> W {
        self.writer.into_inner()
    }
}
