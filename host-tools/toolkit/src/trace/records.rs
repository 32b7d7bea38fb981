//! A robot's trace records, turned into a trace.

use std::io::{self, Write};
use std::sync::Arc;

use esm_link::trace::{FaultCode, TraceEvent};

use super::directory::Directory;
use super::{Snapshot, Step, TraceWriter};

/// Follows the records that a robot sends of one mission, and writes its trace.
///
/// A robot says which macro step a transition belongs to when that step ends, so transitions are
/// kept until then. Records that are no part of a trace (runs in slot 0, overruns, missed
/// activations) change nothing here.
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
    pub fn record(&mut self, record: &TraceEvent<'_>) -> io::Result<Option<Ended>> {
        match *record {
            TraceEvent::Started { .. } => {
                self.next_step = 0;
                self.taken.clear();
                Ok(None)
            }
            TraceEvent::Transition {
                micro,
                region_instance,
                transition,
            } => {
                self.taken.push((micro, region_instance, transition));
                Ok(None)
            }
            TraceEvent::Step {
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
            TraceEvent::Same { micro_steps } => self.end_step(self.next_step, micro_steps),
            TraceEvent::Fault { step, code } => {
                let at = self.write_taken(step)?;
                let code = match code {
                    FaultCode::EventQueueOverflow => esm_core::Fault::EventQueueOverflow,
                    FaultCode::MacroStepLimit => esm_core::Fault::MacroStepLimit,
                };
                self.writer.fault(at, code.code())?;
                Ok(Some(Ended::Fault(at, code.code())))
            }
            TraceEvent::BackgroundRunStarted { .. }
            | TraceEvent::BackgroundRunEnded { .. }
            | TraceEvent::Overrun { .. }
            | TraceEvent::DeadlineMiss { .. }
            | TraceEvent::MotorsOff { .. }
            | TraceEvent::FellBack { .. }
            | TraceEvent::Noted(_) => Ok(None),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::{FLOOD, ROVER, directory_and_blob};
    use esm_core::{Interpreter, Observer, TransitionTaken};
    use esm_link::trace::{RecordSink, write_step};

    /// The records of a robot, as they come over the wire.
    #[derive(Default)]
    struct Wire(Vec<u8>);

    impl RecordSink for Wire {
        fn put(&mut self, byte: u8) {
            self.0.push(byte);
        }
    }

    impl Observer for Wire {
        fn transition(&mut self, taken: TransitionTaken) {
            let TransitionTaken {
                micro,
                region_instance,
                transition,
            } = taken;
            TraceEvent::Transition {
                micro,
                region_instance,
                transition,
            }
            .write(self);
        }
    }

    /// Runs a machine whose first task sets its first flag before macro step 2 and reports its end
    /// before step 7; gives the records and the trace that a writer makes of the same run.
    fn recorded(machine: &str, steps: u64) -> (Arc<Directory>, Vec<u8>, String) {
        let (directory, blob) = directory_and_blob(machine);
        let verified = esm_core::verify(&blob[..]).unwrap();
        let mut arena = vec![0; verified.arena_words()];
        let mut machine = Interpreter::new(verified, &mut arena).unwrap();
        let mut writer = TraceWriter::new(Vec::new(), Arc::clone(&directory));
        let mut wire = Wire::default();
        TraceEvent::Started {
            mission: 7,
            start_us: 0,
        }
        .write(&mut wire);
        for step in 0..steps {
            match step {
                2 => machine.set_flag(0, 0, true),
                7 => machine.report_exit(0),
                _ => {}
            }
            let before = wire.0.len();
            let at = Step {
                step,
                t_us: step * 10_000,
            };
            let ended = machine.macro_step(&mut wire);
            for (micro, region, transition) in transitions(&wire.0[before..]) {
                writer
                    .transition(at, micro.into(), region.into(), transition.into())
                    .unwrap();
            }
            match ended {
                Ok(summary) if !summary.changed && step % 3 == 0 && step != 7 => {
                    TraceEvent::Same {
                        micro_steps: summary.micro_steps,
                    }
                    .write(&mut wire);
                    writer
                        .step(at, summary.micro_steps.into(), &machine)
                        .unwrap();
                }
                Ok(summary) => {
                    let active: Vec<(u16, u16)> = directory
                        .active(|region| machine.current(region))
                        .map(|id| (id.region as u16, machine.current(id.region) as u16))
                        .collect();
                    let tasks = 0..directory.task_states().len();
                    let enabled: Vec<u16> = tasks
                        .filter(|task| machine.is_enabled(*task))
                        .map(|task| task as u16)
                        .collect();
                    write_step(
                        &mut wire,
                        step,
                        summary.micro_steps,
                        active.into_iter(),
                        enabled.into_iter(),
                    );
                    writer
                        .step(at, summary.micro_steps.into(), &machine)
                        .unwrap();
                }
                Err(fault) => {
                    TraceEvent::Fault {
                        step,
                        code: FaultCode::EventQueueOverflow,
                    }
                    .write(&mut wire);
                    writer.fault(at, fault.code()).unwrap();
                    break;
                }
            }
        }
        (
            directory,
            wire.0,
            String::from_utf8(writer.into_inner()).unwrap(),
        )
    }

    fn transitions(mut bytes: &[u8]) -> Vec<(u8, u16, u16)> {
        let mut taken = Vec::new();
        while let Ok(TraceEvent::Transition {
            micro,
            region_instance,
            transition,
        }) = TraceEvent::take(&mut bytes)
        {
            taken.push((micro, region_instance, transition));
        }
        taken
    }

    #[test]
    fn a_robots_records_give_the_trace_of_the_same_run_on_the_host() {
        for (machine, steps) in [(ROVER, 30), (FLOOD, 5)] {
            let (directory, records, expected) = recorded(machine, steps);
            let mut trace = RecordTrace::new(Vec::new(), directory);
            let mut rest = &records[..];
            while !rest.is_empty() {
                trace.record(&TraceEvent::take(&mut rest).unwrap()).unwrap();
            }
            assert_eq!(String::from_utf8(trace.into_inner()).unwrap(), expected);
            assert!(expected.lines().count() > 3, "{expected}");
        }
    }

    #[test]
    fn records_that_fit_no_machine_change_nothing() {
        let (directory, _) = directory_and_blob(ROVER);
        let mut trace = RecordTrace::new(Vec::new(), directory);
        trace
            .record(&TraceEvent::Transition {
                micro: 0,
                region_instance: 999,
                transition: 0,
            })
            .unwrap();
        trace
            .record(&TraceEvent::Transition {
                micro: 0,
                region_instance: 0,
                transition: 9_999,
            })
            .unwrap();
        trace.record(&TraceEvent::Same { micro_steps: 1 }).unwrap();
        let text = String::from_utf8(trace.into_inner()).unwrap();
        assert_eq!(text.lines().count(), 1, "{text}");
    }
}
