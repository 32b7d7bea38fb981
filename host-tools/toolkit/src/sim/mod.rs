//! The machine alone, in virtual time: [`run`] drives the interpreter that the firmware has through
//! a scenario.
//!
//! Tasks are stood in for by the scenario's inputs. Each takes effect before the first macro step
//! at or after its time; an expectation is looked at after the first macro step at or after its.
//! What models report comes behind them. No
//! flag changes by itself: what a robot's dispatchers would work out, such as busy flags, the
//! scenario has to say.

mod models;

use std::collections::VecDeque;
use std::fmt;
use std::io::{self, Write};
use std::sync::Arc;

use esm_core::format;
use esm_core::reads::StableBytes;
use esm_core::{Fault, Interpreter, Observer, TransitionTaken, Verified};

use crate::scenario::Name;
use crate::scenario::bind::{BoundScenario, Expectation, FlagKind, Report, Subject};
use crate::trace::directory::{Directory, StateId, StateKind};
use crate::trace::{Snapshot, Step, TraceWriter};
use models::{Models, Reported};

/// What came of a scenario.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Macro steps that were completed.
    pub steps: u64,
    /// Transitions that were taken.
    pub transitions: u64,
    /// Whether a region of the machine has reached `final`.
    pub finished: bool,
    /// The fault that stopped the machine, and where.
    pub fault: Option<(Step, Fault)>,
    /// Expectations that were met.
    pub met: usize,
    /// Expectations that were not, in the order of their times.
    pub failures: Vec<Failure>,
    /// Paths of what is current at the end, depth first.
    pub active: Vec<String>,
}

impl Outcome {
    /// Whether all expectations were met and the machine did not fault.
    pub fn is_good(&self) -> bool {
        self.failures.is_empty() && self.fault.is_none()
    }
}

/// An expectation that was not met.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// The expectation's time.
    pub at_us: u64,
    /// The name that was looked at, with its place in the scenario.
    pub name: Name,
    /// What was expected of it: current or set, or not.
    pub expected: bool,
    /// What was there instead.
    pub cause: FailureCause,
    /// The last transitions before it was looked at, at most [`LAST_TRANSITIONS`].
    pub before: Vec<Taken>,
    /// What happened in the last macro steps in which anything did, up to where it was looked at.
    pub timeline: Vec<Moment>,
}

/// Something on the way to an expectation that was not met.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Moment {
    /// Start of its macro step.
    pub t_us: u64,
    /// What it was.
    pub what: Happening,
}

/// What happened around a macro step, in this order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Happening {
    /// This line of the scenario took effect before it.
    Line(usize),
    /// A transition was taken in it.
    Taken(Taken),
    /// Paths of what was current after it, depth first.
    Current(Vec<String>),
    /// The expectation of this line was looked at after it, and not met.
    Failed(usize),
}

/// How many macro steps in which something happened a time line has at most, and how many
/// happenings of each: what a
/// person reads at a glance.
const TIMELINE_STEPS: usize = 4;
const HAPPENINGS_A_STEP: usize = 6;

/// A macro step in which something happened.
#[derive(Debug, Default)]
struct Busy {
    t_us: u64,
    /// Lines of the scenario that took effect before it.
    lines: Vec<usize>,
    /// Region instance and index of its transitions.
    taken: Vec<(usize, usize)>,
    /// What was current after it.
    active: Vec<StateId>,
}

/// How many transitions are told of before an expectation that was not met.
pub const LAST_TRANSITIONS: usize = 5;

/// A transition that was taken. `Display` says it in one line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Taken {
    /// Start of its macro step.
    pub t_us: u64,
    /// Name of its event.
    pub event: String,
    /// Path of its source.
    pub from: String,
    /// Path of its target.
    pub to: String,
}

impl fmt::Display for Taken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            event, from, to, ..
        } = self;
        write!(
            f,
            "{} ms: {from} -> {to} on {event}",
            milliseconds(self.t_us)
        )
    }
}

/// Why an expectation was not met.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FailureCause {
    /// Something else was so.
    Otherwise {
        /// Start of the macro step after which it was looked at.
        t_us: u64,
        /// Paths of what was current, depth first.
        active: Vec<String>,
        /// Names of the flags of the state that were set, where a flag was looked at.
        set_flags: Option<Vec<String>>,
    },
    /// The machine had faulted.
    AfterFault {
        /// Start of the macro step in which it did.
        t_us: u64,
    },
    /// No macro step at or after its time is run.
    AfterUntil {
        /// Start of the last macro step.
        last_us: u64,
    },
}

/// What a person reads behind the place of the failed line.
impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, not) = (&self.name.text, if self.expected { "" } else { "not " });
        write!(
            f,
            "expected {not}`{name}` at {} ms, but ",
            milliseconds(self.at_us)
        )?;
        match &self.cause {
            FailureCause::Otherwise {
                t_us,
                active,
                set_flags,
            } => {
                if let Some(flags) = set_flags {
                    let state = name
                        .split_once('.')
                        .map_or(name.as_str(), |(state, _)| state);
                    let flags = if flags.is_empty() {
                        "no flag".into()
                    } else {
                        flags.join(", ")
                    };
                    write!(f, "of `{state}` {flags} was set; ")?;
                }
                write!(
                    f,
                    "after the macro step at {} ms current was {}",
                    milliseconds(*t_us),
                    active.join(", ")
                )
            }
            FailureCause::AfterFault { t_us } => {
                write!(f, "the machine had faulted at {} ms", milliseconds(*t_us))
            }
            FailureCause::AfterUntil { last_us } => {
                write!(
                    f,
                    "the last macro step was at {} ms: raise `until`",
                    milliseconds(*last_us)
                )
            }
        }
    }
}

/// A time line as a person reads it: one line for each moment, with the scenario's own words where
/// it has any, and the
/// failed line marked.
pub fn timeline_text(timeline: &[Moment], scenario: &str) -> String {
    use std::fmt::Write;
    let words_of = |line: usize| {
        let text = scenario.lines().nth(line.saturating_sub(1));
        let text = text.unwrap_or_default();
        text.split('#').next().unwrap_or_default().trim().to_owned()
    };
    let rows: Vec<(String, &str, String)> = (timeline.iter())
        .map(|Moment { t_us, what }| {
            let (mark, told) = match what {
                Happening::Line(line) => (" ", format!("line {line}: {}", words_of(*line))),
                Happening::Taken(Taken {
                    event, from, to, ..
                }) => (" ", format!("{from} -> {to} on {event}")),
                Happening::Current(paths) => (" ", format!("current: {}", paths.join(", "))),
                Happening::Failed(line) => (">", format!("line {line}: {}", words_of(*line))),
            };
            (format!("{} ms", milliseconds(*t_us)), mark, told)
        })
        .collect();
    let width = rows.iter().map(|(time, ..)| time.len()).max();
    let width = width.unwrap_or_default();
    let mut text = String::new();
    for (time, mark, told) in rows {
        // Writing to a string does not fail.
        let _ = writeln!(text, "  {mark} {time:>width$}  {told}");
    }
    text
}

/// Microseconds as milliseconds, without decimals that say nothing.
pub fn milliseconds(us: u64) -> String {
    match us % 1_000 {
        0 => (us / 1_000).to_string(),
        rest => format!("{}.{rest:03}", us / 1_000)
            .trim_end_matches('0')
            .to_owned(),
    }
}

/// Why a run could not be made.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// The trace could not be written.
    #[error("the trace cannot be written: {0}")]
    Trace(#[from] io::Error),
    /// The machine needs more memory than a blob can ask for; no verified blob does.
    #[error("the machine needs {needed_words} words of memory, {given_words} were given")]
    Memory {
        /// Words that the interpreter asked for.
        needed_words: usize,
        /// Words that it was given.
        given_words: usize,
    },
}

/// Runs a scenario and writes the trace. `directory` and `scenario` are of the same blob.
///
/// Takes time in proportion to the macro steps up to the scenario's end, and memory for one of
/// them.
///
/// # Errors
/// If the trace cannot be written.
pub fn run<B: StableBytes>(
    verified: Verified<B>,
    directory: &Arc<Directory>,
    scenario: &BoundScenario,
    trace: impl Write,
) -> Result<Outcome, SimError> {
    let given_words = verified.arena_words();
    let mut arena = vec![0; given_words];
    let machine = Interpreter::new(verified, &mut arena).map_err(|refusal| SimError::Memory {
        needed_words: refusal.needed_words,
        given_words,
    })?;
    let period_us = scenario
        .period_us
        .unwrap_or(directory.interpreter_period_us())
        .max(1);
    let machine = machine.with_period_us(period_us);
    let writer = TraceWriter::new(trace, Arc::clone(directory));
    let mut simulation = Simulation {
        machine,
        directory,
        models: Models::new(&scenario.models),
        writer,
        recent: VecDeque::with_capacity(LAST_TRANSITIONS),
        busy: VecDeque::with_capacity(TIMELINE_STEPS + 2),
        outcome: Outcome::default(),
    };
    simulation.run(scenario, period_us.into())?;
    simulation.writer.flush()?;
    Ok(simulation.outcome)
}

struct Simulation<'m, B, W> {
    machine: Interpreter<'m, B>,
    directory: &'m Directory,
    models: Models<'m>,
    writer: TraceWriter<W>,
    /// Macro step's start, region instance and index of the last transitions.
    recent: VecDeque<(u64, usize, usize)>,
    /// The last macro steps in which something happened, one more than are told of: what was
    /// current after that is what
    /// the others begin with.
    busy: VecDeque<Busy>,
    outcome: Outcome,
}

impl<B: StableBytes, W: Write> Simulation<'_, B, W> {
    fn run(&mut self, scenario: &BoundScenario, period_us: u64) -> io::Result<()> {
        let mut inputs = scenario.inputs.iter().peekable();
        let mut expectations = scenario.expectations.iter().peekable();
        let last_us = scenario.until_us / period_us * period_us;
        let mut unmet = FailureCause::AfterUntil { last_us };
        for step in 0..=scenario.until_us / period_us {
            let at = Step {
                step,
                t_us: step * period_us,
            };
            let mut lines = Vec::new();
            while let Some(input) = inputs.next_if(|input| input.at_us <= at.t_us) {
                self.apply(input.task, input.report);
                lines.push(input.line);
            }
            lines.extend(self.apply_models(at));
            self.note(at, lines);
            if let Err(fault) = self.macro_step(at)? {
                self.outcome.fault = Some((at, fault));
                unmet = FailureCause::AfterFault { t_us: at.t_us };
                self.note_active(at);
                break;
            }
            self.note_active(at);
            self.note_entered(at);
            while let Some(expectation) =
                expectations.next_if(|expectation| expectation.at_us <= at.t_us)
            {
                self.check(expectation, at);
            }
        }
        for expectation in expectations {
            self.fail(expectation, unmet.clone());
        }
        self.outcome.active = self.active();
        Ok(())
    }

    /// Notes the lines that take effect before a macro step.
    fn note(&mut self, at: Step, lines: Vec<usize>) {
        if !lines.is_empty() {
            self.busy.push_back(Busy {
                t_us: at.t_us,
                lines,
                ..Busy::default()
            });
        }
    }

    /// Notes what is current after a macro step in which something happened.
    fn note_active(&mut self, at: Step) {
        let active = || (self.directory).active(|region| self.machine.current(region));
        if let Some(busy) = self.busy.back_mut().filter(|busy| busy.t_us == at.t_us) {
            busy.active = active().collect();
        }
        while self.busy.len() > TIMELINE_STEPS + 1 {
            self.busy.pop_front();
        }
    }

    /// What happened up to a macro step after which the expectation of this line was not met.
    fn timeline(&self, line: usize, last_us: u64) -> Vec<Moment> {
        let mut moments = Vec::new();
        let mut add = |t_us, what| moments.push(Moment { t_us, what });
        let paths = |active: &[StateId]| {
            let paths = active.iter().filter_map(|id| self.directory.state(*id));
            Happening::Current(paths.map(|state| state.path.clone()).collect())
        };
        let (before, shown) = if self.busy.len() > TIMELINE_STEPS {
            (self.busy.front(), 1)
        } else {
            (None, 0)
        };
        if let Some(before) = before {
            add(before.t_us, paths(&before.active));
        }
        for busy in self.busy.iter().skip(shown) {
            let lines = busy.lines.iter().map(|line| Happening::Line(*line));
            let taken = busy
                .taken
                .iter()
                .filter_map(|&(region, transition)| self.taken(busy.t_us, region, transition));
            let happened: Vec<_> = lines.chain(taken.map(Happening::Taken)).collect();
            let skipped = happened.len().saturating_sub(HAPPENINGS_A_STEP);
            for what in happened.into_iter().skip(skipped) {
                add(busy.t_us, what);
            }
        }
        if let Some(last) = self.busy.back() {
            add(last_us, paths(&last.active));
        }
        add(last_us, Happening::Failed(line));
        moments
    }

    fn apply(&mut self, task: usize, report: Report) {
        match report {
            Report::Flag { flag, value } => self.machine.set_flag(task, flag, value),
            Report::Exit => self.machine.report_exit(task),
            Report::Busy(busy) => self.machine.set_busy(task, busy),
        }
    }

    /// Lets models report before a macro step. Returns the lines of those with news.
    fn apply_models(&mut self, at: Step) -> Vec<usize> {
        let Self {
            models,
            machine,
            directory,
            ..
        } = self;
        let is_current = |id: StateId| {
            let state = directory.index_of(id);
            state.is_some_and(|state| machine.is_current_state(id.region, state))
        };
        let mut lines = Vec::new();
        for reported in models.report(at.t_us, is_current) {
            let Reported {
                line, task, report, ..
            } = reported;
            self.apply(task, report);
            lines.extend(reported.is_new.then_some(line));
        }
        lines
    }

    /// Tells models which states were entered in a macro step.
    fn note_entered(&mut self, at: Step) {
        let Some(busy) = self.busy.back().filter(|busy| busy.t_us == at.t_us) else {
            return;
        };
        if self.models.is_empty() {
            return;
        }
        for (region, transition) in &busy.taken {
            if let Some(words) = self.directory.transition(*region, *transition) {
                self.models.entered(words.to, at.t_us);
            }
        }
    }

    fn macro_step(&mut self, at: Step) -> io::Result<Result<(), Fault>> {
        let mut watcher = Watcher {
            writer: &mut self.writer,
            recent: &mut self.recent,
            busy: &mut self.busy,
            at,
            transitions: 0,
            written: Ok(()),
        };
        let ended = self.machine.macro_step(&mut watcher);
        let Watcher {
            transitions,
            written,
            ..
        } = watcher;
        written?;
        self.outcome.transitions += transitions;
        match ended {
            Ok(summary) => {
                self.outcome.steps += 1;
                self.outcome.finished = summary.finished;
                self.writer
                    .step(at, summary.micro_steps.into(), &self.machine)?;
                Ok(Ok(()))
            }
            Err(fault) => {
                self.writer.fault(at, fault.code())?;
                Ok(Err(fault))
            }
        }
    }

    fn check(&mut self, expectation: &Expectation, at: Step) {
        let (holds, set_flags) = match expectation.subject {
            Subject::State(state) => (self.is_current(state), None),
            Subject::Flag(state, flag) => (self.flag(state, flag), Some(self.set_flags(state))),
        };
        if holds == expectation.holds {
            self.outcome.met += 1;
        } else {
            let active = self.active();
            self.fail(
                expectation,
                FailureCause::Otherwise {
                    t_us: at.t_us,
                    active,
                    set_flags,
                },
            );
        }
    }

    fn fail(&mut self, expectation: &Expectation, cause: FailureCause) {
        let last_us = match cause {
            FailureCause::Otherwise { t_us, .. } | FailureCause::AfterFault { t_us } => t_us,
            FailureCause::AfterUntil { last_us } => last_us,
        };
        let timeline = self.timeline(expectation.name.place.line, last_us);
        let Expectation {
            at_us,
            ref name,
            holds: expected,
            ..
        } = *expectation;
        self.outcome.failures.push(Failure {
            at_us,
            name: name.clone(),
            expected,
            cause,
            before: self.before(),
            timeline,
        });
    }

    /// The last transitions in words.
    fn before(&self) -> Vec<Taken> {
        let in_words = |&(t_us, region, transition): &(u64, usize, usize)| {
            self.taken(t_us, region, transition)
        };
        self.recent.iter().filter_map(in_words).collect()
    }

    /// A transition in words.
    fn taken(&self, t_us: u64, region: usize, transition: usize) -> Option<Taken> {
        let words = self.directory.transition(region, transition)?;
        Some(Taken {
            t_us,
            event: words.event.to_owned(),
            from: words.from.to_owned(),
            to: words.to.to_owned(),
        })
    }

    fn active(&self) -> Vec<String> {
        let active = self.directory.active(|region| self.machine.current(region));
        active
            .filter_map(|id| self.directory.state(id))
            .map(|state| state.path.clone())
            .collect()
    }

    fn is_current(&self, id: StateId) -> bool {
        self.directory
            .index_of(id)
            .is_some_and(|state| self.machine.is_current_state(id.region, state))
    }

    fn flag(&self, id: StateId, flag: FlagKind) -> bool {
        let (Some(state), Some(index)) = (self.directory.state(id), self.directory.index_of(id))
        else {
            return false;
        };
        let control = match state.kind {
            StateKind::Task { .. } => format::TASK_CONTROL_FLAGS,
            _ => format::CONTAINER_CONTROL_FLAGS,
        };
        let bit = match (&state.kind, flag) {
            (StateKind::Super { .. }, FlagKind::Busy) => {
                return self.is_current(id) && self.machine.is_busy_inside(id.region, index);
            }
            // A simple state has no other flag than this.
            (StateKind::Simple, FlagKind::Timeout) => 0,
            (_, FlagKind::Exit) => format::FLAG_EXIT,
            (_, FlagKind::Timeout) => format::FLAG_TIMEOUT,
            (_, FlagKind::Busy) => format::FLAG_BUSY,
            (_, FlagKind::Control(index)) => control + index,
        };
        // A state that needs no timeout flag has no room for one: it is never set.
        let block = self.machine.tables().flags_of_state(id.region, index);
        block.is_some_and(|(first, length)| bit < length && self.machine.flag(first + bit))
    }

    /// Names of the flags of a state that are set.
    fn set_flags(&self, id: StateId) -> Vec<String> {
        let system = [
            ("exit", FlagKind::Exit),
            ("timeout", FlagKind::Timeout),
            ("busy", FlagKind::Busy),
        ];
        let state = self.directory.state(id);
        let has_exit = state.is_some_and(|state| {
            matches!(state.kind, StateKind::Task { .. } | StateKind::Super { .. })
        });
        let system = system
            .into_iter()
            .filter(|(_, kind)| has_exit || *kind == FlagKind::Timeout);
        let control = state.into_iter().flat_map(|state| &state.flags).enumerate();
        let control = control.map(|(index, flag)| (flag.name.as_str(), FlagKind::Control(index)));
        system
            .chain(control)
            .filter(|(_, kind)| self.flag(id, *kind))
            .map(|(name, _)| name.to_owned())
            .collect()
    }
}

impl<B: std::ops::Deref<Target = [u8]>> Snapshot for Interpreter<'_, B> {
    fn current(&self, region: usize) -> usize {
        self.current(region)
    }

    fn is_enabled(&self, task: usize) -> bool {
        self.is_enabled(task)
    }
}

/// Writes the transitions of a macro step. The first line that cannot be written ends the run.
struct Watcher<'w, W> {
    writer: &'w mut TraceWriter<W>,
    recent: &'w mut VecDeque<(u64, usize, usize)>,
    busy: &'w mut VecDeque<Busy>,
    at: Step,
    transitions: u64,
    written: io::Result<()>,
}

impl<W: Write> Observer for Watcher<'_, W> {
    fn transition(&mut self, taken: TransitionTaken) {
        self.transitions += 1;
        if self.recent.len() == LAST_TRANSITIONS {
            self.recent.pop_front();
        }
        let (region, transition) = (taken.region_instance.into(), taken.transition.into());
        self.recent.push_back((self.at.t_us, region, transition));
        let t_us = self.at.t_us;
        match self.busy.back_mut().filter(|busy| busy.t_us == t_us) {
            Some(busy) => busy.taken.push((region, transition)),
            None => self.busy.push_back(Busy {
                t_us,
                taken: vec![(region, transition)],
                ..Busy::default()
            }),
        }
        if self.written.is_ok() {
            self.written = self
                .writer
                .transition(self.at, taken.micro.into(), region, transition);
        }
    }
}

#[cfg(test)]
mod model_tests;
#[cfg(test)]
pub(crate) mod tests;
