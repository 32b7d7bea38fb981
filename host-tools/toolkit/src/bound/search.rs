//! The longest macro steps that can be found by running a mission: what the bound is held against.
//!
//! The mission is run by the interpreter itself, from its start. Before each macro step a task may
//! do whatever the runtime lets it do: a task state that is current and enabled may set or clear
//! each of its output flags, be busy, or finish; and time may pass, up to the longest timeout. What
//! is tried is drawn at random, so that all regions do something at the same moment again and
//! again; the best start is then changed in one place after another, as long as that makes it
//! longer. The same seed finds the same.

use esm_core::signature::Direction;
use esm_core::tables::Tables;
use esm_core::{Fault, Interpreter, Verified};

use super::costs::{Costs, Counts};
use super::machine::Machine;
use super::tally::{Entered, Told};
use crate::schedule::random::Random;

/// What a task does before a macro step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Its busy flag.
    Busy(bool),
    /// It has finished.
    Exit,
    /// A control flag, by its place in the signature.
    Flag(usize, bool),
}

/// What comes before a macro step, and the step itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Input {
    /// Activations that are left out before it.
    pub missed: u32,
    /// What tasks do, by task instance.
    pub changes: Vec<(usize, Change)>,
}

/// The start of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// Its macro steps, the long one last.
    pub inputs: Vec<Input>,
    /// What the last one takes by the model.
    pub instructions: u64,
}

/// A macro step that was run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ran {
    /// What it consisted of.
    pub counts: Counts,
    /// How it ended, if by a fault.
    pub fault: Option<Fault>,
    /// Transitions that the count did not meet: none, or what is counted is not what the
    /// interpreter did.
    pub not_met: usize,
}

/// How much is tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effort {
    /// Starts from the beginning.
    pub runs: usize,
    /// Macro steps of each.
    pub steps: usize,
    /// What is tried before each of them; the longest goes on.
    pub tries: usize,
}

impl Effort {
    /// What takes about a second for a mission of a robot.
    pub const USUAL: Self = Effort {
        runs: 60,
        steps: 12,
        tries: 6,
    };
}

/// A mission that is run again and again.
#[derive(Debug)]
pub struct Subject<'b> {
    blob: Verified<&'b [u8]>,
    machine: Machine,
    /// Per task instance, its flags that it sets itself.
    outputs: Vec<Vec<usize>>,
    /// Activations after which every timeout is over.
    all_timeouts: u32,
    period_us: u64,
}

/// A run so far.
struct Run<'m, 'b> {
    interpreter: Interpreter<'m, &'b [u8]>,
    entered: Entered,
    /// Time of the next macro step.
    t_us: u64,
}

impl<'b> Subject<'b> {
    /// A mission as `verify` gave it.
    #[must_use]
    pub fn new(blob: &'b Verified<Vec<u8>>) -> Option<Self> {
        let tables = blob.tables();
        let outputs = (0..tables.task_instance_count())
            .map(|instance| outputs(&tables, instance))
            .collect();
        let longest_us = (0..tables.state_count())
            .filter_map(|state| tables.state(state)?.timeout_us)
            .max();
        let period_us = tables
            .slot(tables.interpreter_slot())
            .map_or(1, |slot| slot.period_us.max(1));
        Some(Subject {
            machine: Machine::of(&tables),
            outputs,
            period_us: u64::from(period_us),
            all_timeouts: longest_us.map_or(0, |us| us / period_us + 1),
            blob: esm_core::verify(blob.bytes()).ok()?,
        })
    }

    /// Macro steps from the start with what is drawn at random before each: for measurements that
    /// want all kinds of them.
    #[must_use]
    pub fn wander(&self, steps: usize, seed: u64) -> Vec<Input> {
        let mut random = Random::new(seed);
        let mut inputs = Vec::new();
        for step in 0..steps {
            let choices = self.choices(&inputs);
            inputs.push(self.drawn(&choices, step, &mut random));
        }
        inputs
    }

    /// What is looked at.
    #[must_use]
    pub fn machine(&self) -> &Machine {
        &self.machine
    }

    /// Runs macro steps from the start and says what each consisted of. It ends with the first
    /// fault.
    #[must_use]
    pub fn run(&self, inputs: &[Input]) -> Vec<Ran> {
        let mut arena = vec![0; self.blob.arena_words()];
        let Some(mut run) = self.start(&mut arena) else {
            return Vec::new();
        };
        let mut ran = Vec::new();
        for input in inputs {
            let step = self.step(&mut run, input);
            ran.push(step);
            if step.fault.is_some() {
                break;
            }
        }
        ran
    }

    /// Searches for a long macro step.
    #[must_use]
    pub fn search(&self, costs: &Costs, effort: Effort, seed: u64) -> Found {
        let mut random = Random::new(seed);
        let mut best = Found::default();
        for _ in 0..effort.runs {
            let mut inputs = Vec::new();
            for _ in 0..effort.steps {
                let choices = self.choices(&inputs);
                let mut next: Option<(u64, Input)> = None;
                for attempt in 0..effort.tries {
                    let input = self.drawn(&choices, attempt, &mut random);
                    inputs.push(input);
                    let instructions = self.instructions(&inputs, costs);
                    let input = inputs.pop().unwrap_or_default();
                    if instructions > best.instructions {
                        best.inputs.clone_from(&inputs);
                        best.inputs.push(input.clone());
                        best.instructions = instructions;
                    }
                    // Where nothing is gained, a step that does little may lead to one that does
                    // much.
                    let gain = instructions + random.below(instructions.max(1));
                    if next.as_ref().is_none_or(|(most, _)| gain > *most) {
                        next = Some((gain, input));
                    }
                }
                inputs.extend(next.map(|(_, input)| input));
            }
        }
        self.improve(best, costs)
    }

    /// Changes one thing at a time, as long as that makes the last macro step longer.
    fn improve(&self, mut best: Found, costs: &Costs) -> Found {
        let mut goes_on = true;
        while goes_on {
            goes_on = false;
            for at in 0..best.inputs.len() {
                let choices = self.choices(best.inputs.get(..at).unwrap_or_default());
                for choice in choices {
                    let mut inputs = best.inputs.clone();
                    let Some(input) = inputs.get_mut(at) else {
                        continue;
                    };
                    match input.changes.iter().position(|change| *change == choice) {
                        Some(present) => drop(input.changes.remove(present)),
                        None => input.changes.push(choice),
                    }
                    let instructions = self.instructions(&inputs, costs);
                    if instructions > best.instructions {
                        best = Found {
                            inputs,
                            instructions,
                        };
                        goes_on = true;
                    }
                }
            }
        }
        best
    }

    /// What the last of these macro steps takes by the model; 0 where a fault comes before it.
    fn instructions(&self, inputs: &[Input], costs: &Costs) -> u64 {
        let ran = self.run(inputs);
        match ran.last() {
            Some(last) if ran.len() == inputs.len() => costs.total(&last.counts),
            _ => 0,
        }
    }

    /// All that tasks can do after these macro steps.
    fn choices(&self, inputs: &[Input]) -> Vec<(usize, Change)> {
        let mut arena = vec![0; self.blob.arena_words()];
        let Some(mut run) = self.start(&mut arena) else {
            return Vec::new();
        };
        for input in inputs {
            self.step(&mut run, input);
        }
        let mut choices = Vec::new();
        for (instance, outputs) in self.outputs.iter().enumerate() {
            if !run.interpreter.is_current(instance) || !run.interpreter.is_enabled(instance) {
                continue;
            }
            choices.push((instance, Change::Busy(!run.interpreter.is_busy(instance))));
            for &flag in outputs {
                let value = !run.interpreter.task_flag(instance, flag);
                choices.push((instance, Change::Flag(flag, value)));
            }
            choices.push((instance, Change::Exit));
        }
        choices
    }

    fn drawn(&self, choices: &[(usize, Change)], attempt: usize, random: &mut Random) -> Input {
        // First everything at once, then half of it, then little.
        let percent = match attempt % 3 {
            0 => 100,
            1 => 50,
            _ => 15,
        };
        let missed = match random.below(3) {
            0 => self.all_timeouts,
            _ => 0,
        };
        let changes = choices.iter().copied();
        Input {
            missed,
            changes: changes
                .filter(|(_, change)| {
                    // What is busy is not executed, and finishes less than others.
                    let percent = match change {
                        Change::Busy(true) => percent / 4,
                        _ => percent,
                    };
                    random.below(100) < percent
                })
                .collect(),
        }
    }

    fn start<'m>(&self, arena: &'m mut [u32]) -> Option<Run<'m, 'b>> {
        let interpreter = Interpreter::new(self.blob.clone(), arena).ok()?;
        Some(Run {
            interpreter,
            entered: self.machine.entered(),
            t_us: 0,
        })
    }

    fn step(&self, run: &mut Run<'_, '_>, input: &Input) -> Ran {
        run.interpreter.skip(input.missed);
        run.t_us += u64::from(input.missed) * self.period_us;
        for &(instance, change) in &input.changes {
            match change {
                Change::Busy(busy) => run.interpreter.set_busy(instance, busy),
                Change::Exit => run.interpreter.report_exit(instance),
                Change::Flag(flag, value) => run.interpreter.set_flag(instance, flag, value),
            }
        }
        let before = self
            .machine
            .before(&run.interpreter, &run.entered, run.t_us);
        let mut told = Told::default();
        let fault = run.interpreter.macro_step(&mut told).err();
        let (counts, not_met) =
            self.machine
                .tally(before, &told, fault, &mut run.entered, run.t_us);
        run.t_us += self.period_us;
        Ran {
            counts,
            fault,
            not_met,
        }
    }
}

/// The flags of a task that it sets itself, by their places in its signature.
fn outputs(tables: &Tables<'_>, instance: usize) -> Vec<usize> {
    let task = tables
        .task_state_of(instance)
        .and_then(|state| tables.task(state.task));
    let Some(task) = task else {
        return Vec::new();
    };
    let flags = task.signature.ports().filter_map(|port| match port {
        esm_core::signature::Port::Flag { direction, .. } => Some(direction),
        _ => None,
    });
    flags
        .enumerate()
        .filter(|(_, direction)| *direction == Direction::Out)
        .map(|(place, _)| place)
        .collect()
}
