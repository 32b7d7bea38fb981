//! A macro step, told again micro step by micro step.
//!
//! The interpreter tells which transitions it took, in order. What flags were when a guard was
//! evaluated follows from what they were before the macro step and from what the transitions before
//! it in the same macro step did.

use std::ops::Deref;
use std::rc::Rc;

use esm_core::tables::{Code, Guard, StateKind, Tables};
use esm_core::{Fault, Interpreter, Observer, TransitionTaken, format};

use super::choices::{Choice, MicroStep};
use super::player::RecordedMission;
use crate::inspect::guards::{GuardReader, Read};
use crate::trace::directory::Directory;

/// A macro step, and what the machine was before it, with what had entered.
#[derive(Clone, Debug, Default)]
pub(super) struct MadeStep {
    /// Its number in its mission.
    pub step: u64,
    /// Flags, the first in the lowest bit of the first word. Behind them are enable bits.
    flags: Vec<u32>,
    /// Current states of the region instances.
    current: Vec<usize>,
    /// In which macro step each of them was entered, where it has a timeout: the low bits of its
    /// number.
    entered: Vec<u32>,
    /// Whether it looks at timers.
    looks_at_timers: bool,
    /// The transitions that were taken, in order.
    pub taken: Vec<TransitionTaken>,
    /// The fault that ended it.
    pub fault: Option<Fault>,
    /// Flags behind the moment before.
    pub flags_before: Vec<u32>,
}

impl Observer for MadeStep {
    fn transition(&mut self, taken: TransitionTaken) {
        self.taken.push(taken);
    }
}

impl MadeStep {
    /// The next macro step of a machine, of which nothing is known yet but where it begins.
    pub(super) fn of<B: Deref<Target = [u8]>>(machine: &Interpreter<'_, B>) -> Self {
        let entered = machine.entered_words();
        MadeStep {
            step: machine.progress().steps,
            flags: machine.input_words().to_vec(),
            current: (0..entered.len())
                .map(|region| machine.current(region))
                .collect(),
            entered: entered.to_vec(),
            looks_at_timers: machine.looks_at_timers(),
            ..MadeStep::default()
        }
    }

    /// The transitions of each micro step in which some were taken.
    pub(super) fn micro_steps(&self) -> impl Iterator<Item = &[TransitionTaken]> {
        self.taken.chunk_by(|a, b| a.micro == b.micro)
    }
}

/// Words that a [`MadeStep`] of this machine takes beside its transitions, about.
pub(super) fn step_words<B: Deref<Target = [u8]>>(machine: &Interpreter<'_, B>) -> u64 {
    let regions = machine.entered_words().len();
    // The current state of each is as long as two words, and flags are kept twice.
    (3 * regions + 2 * machine.input_words().len()).max(1) as u64
}

/// Counts the micro steps in which transitions are taken.
#[derive(Default)]
pub(super) struct MicroSteps {
    /// How many there were.
    pub count: u64,
    /// How many transitions.
    pub transitions: u64,
    last: Option<u8>,
}

impl Observer for MicroSteps {
    fn transition(&mut self, taken: TransitionTaken) {
        self.transitions += 1;
        if self.last != Some(taken.micro) {
            self.last = Some(taken.micro);
            self.count += 1;
        }
    }
}

/// A transition that was taken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Taken {
    /// Path of its source.
    pub from: String,
    /// Path of its target.
    pub to: String,
    /// Its guard as in the source, if it has one.
    pub guard: Option<String>,
    /// The flags in it, each with its value when it was evaluated.
    pub terms: Vec<(String, bool)>,
    /// Whether the guard is true of these values, as it must be.
    pub holds: bool,
    /// Events that it sent.
    pub sent: Vec<String>,
    /// Paths of the flags that it set.
    pub set: Vec<String>,
    /// Paths of the flags that it cleared.
    pub cleared: Vec<String>,
    /// The transitions of the same state on the same event that come before it, whose guards were
    /// false.
    pub passed: Vec<Passed>,
}

/// A transition that was not taken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Passed {
    /// Path of its target.
    pub to: String,
    /// Its guard as in the source, if it has one.
    pub guard: Option<String>,
    /// The flags in it, each with its value when it was evaluated.
    pub terms: Vec<(String, bool)>,
}

/// An event in the queue of a macro step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Queued {
    /// Its channel; none for the pulse.
    pub channel: Option<usize>,
    /// The region instance and the transition that sent it.
    pub by: Option<(usize, usize)>,
}

/// The region instances that a transition made begin, each with its state: its own first, then
/// those inside its target.
pub(super) fn begun(tables: &Tables<'_>, taken: &TransitionTaken) -> Vec<(usize, usize)> {
    let region = usize::from(taken.region_instance);
    let Some(transition) = tables.transition(taken.transition.into()) else {
        return Vec::new();
    };
    let mut begun = vec![(region, transition.target)];
    let Some(mut inside) = tables.first_region_inside(region, transition.target) else {
        return begun;
    };
    let instance = tables.region_instance(inside).map(|it| it.instance);
    // Each is numbered above the one before.
    while let Some(record) = tables.region_instance(inside)
        && Some(record.instance) == instance
    {
        begun.push((inside, record.initial));
        inside = record.next;
    }
    begun
}

/// A machine's flags and current states within a macro step, as they follow from the transitions
/// that the interpreter took.
#[derive(Clone)]
pub(super) struct Retold<'m> {
    pub tables: Tables<'m>,
    pub directory: &'m Directory,
    guards: Rc<GuardReader<'m>>,
    pub period_us: u64,
    pub step: u64,
    flags: Vec<u32>,
    current: Vec<usize>,
    entered: Vec<u32>,
    /// The events of the macro step, in order, those that wait included.
    pub queue: Vec<Queued>,
}

impl<'m> Retold<'m> {
    pub(super) fn new(mission: &'m RecordedMission, guards: Rc<GuardReader<'m>>) -> Self {
        Retold {
            tables: mission.verified.tables(),
            directory: &mission.directory,
            guards,
            period_us: mission.directory.interpreter_period_us().into(),
            step: 0,
            flags: Vec::new(),
            current: Vec::new(),
            entered: Vec::new(),
            queue: Vec::new(),
        }
    }

    /// Goes to the beginning of a macro step, where timers run out if it looks at them.
    pub(super) fn begin(&mut self, made: &MadeStep) {
        self.step = made.step;
        self.flags.clone_from(&made.flags);
        self.current.clone_from(&made.current);
        self.entered.clone_from(&made.entered);
        self.queue.clear();
        self.queue.push(Queued {
            channel: None,
            by: None,
        });
        if !made.looks_at_timers {
            return;
        }
        for region in self.active_regions() {
            if let Some((flag, age_us, limit_us)) = self.timer(region)
                && age_us > limit_us
            {
                self.write(flag, true);
            }
        }
    }

    /// What a transition is that is taken next.
    pub(super) fn words(&self, taken: &TransitionTaken) -> Option<Taken> {
        let (region, transition) = (
            usize::from(taken.region_instance),
            usize::from(taken.transition),
        );
        let words = self.directory.transition(region, transition)?;
        let (guard, terms) = self.guard(region, transition);
        Some(Taken {
            from: words.from.to_owned(),
            to: words.to.to_owned(),
            guard,
            terms,
            holds: self.holds(region, transition),
            sent: words.sent.iter().map(|event| (*event).to_owned()).collect(),
            set: words.set,
            cleared: words.cleared,
            passed: self.passed(region, transition),
        })
    }

    /// The guard of a transition, and the flags in it with their values.
    fn guard(&self, region: usize, transition: usize) -> (Option<String>, Vec<(String, bool)>) {
        let guard = self.guards.read(transition);
        let term = |term: &Read| (term.name.clone(), self.is_set(region, term.bit));
        let terms = guard.terms.iter().map(term).collect();
        (guard.text, terms)
    }

    /// What there is to choose from in a micro step, before its transitions are taken.
    pub(super) fn choices(
        &self,
        micro: usize,
        is_taken: impl Fn(usize, usize) -> bool,
    ) -> MicroStep {
        let channel = self.queue.get(micro).and_then(|queued| queued.channel);
        let channel = channel.and_then(|channel| self.tables.channel(channel));
        let event = channel.map_or(format::PULSE, |channel| channel.event);
        let choices = self.active_regions().into_iter().flat_map(|region| {
            let transitions = self.tables.transitions_of(self.current(region));
            let hears = channel.is_none_or(|channel| self.tables.is_listening(&channel, region));
            let is_taken = &is_taken;
            transitions.filter_map(move |transition| {
                let words = self.directory.transition(region, transition)?;
                let own = self.tables.transition(transition)?.event;
                let (guard, terms) = self.guard(region, transition);
                Some(Choice {
                    from: words.from.to_owned(),
                    to: words.to.to_owned(),
                    event: words.event.to_owned(),
                    is_heard: own == event && hears,
                    guard,
                    terms,
                    holds: self.holds(region, transition),
                    is_taken: is_taken(region, transition),
                })
            })
        });
        MicroStep {
            event: self.directory.event(event).to_owned(),
            choices: choices.collect(),
        }
    }

    fn passed(&self, region: usize, transition: usize) -> Vec<Passed> {
        let source = self.tables.source_of_transition(transition);
        let event = |transition| self.tables.transition(transition).map(|it| it.event);
        self.tables
            .transitions_of(source)
            .take_while(|other| *other < transition)
            .filter(|other| event(*other) == event(transition))
            .filter_map(|other| {
                let words = self.directory.transition(region, other)?;
                let (guard, terms) = self.guard(region, other);
                Some(Passed {
                    to: words.to.to_owned(),
                    guard,
                    terms,
                })
            })
            .collect()
    }

    /// Does what a transition did.
    pub(super) fn take(&mut self, taken: &TransitionTaken) {
        let (region, transition) = (
            usize::from(taken.region_instance),
            usize::from(taken.transition),
        );
        self.enter(region, transition);
        for (region, state) in begun(&self.tables, taken) {
            if let Some(current) = self.current.get_mut(region) {
                *current = state;
            }
            if let Some(entered) = self.entered.get_mut(region) {
                *entered = self.step as u32;
            }
        }
    }

    /// The current state of a region instance, as an index into the tables.
    pub(super) fn current(&self, region: usize) -> usize {
        self.current.get(region).copied().unwrap_or(usize::MAX)
    }

    /// Paths of the states that are current.
    pub(super) fn active(&self) -> Vec<String> {
        let active = self.directory.active(|region| self.current(region));
        let paths = active.filter_map(|id| self.directory.state(id));
        paths.map(|state| state.path.clone()).collect()
    }

    /// Whether a state, by its index in the tables, is current in a region instance that is active.
    pub(super) fn is_active(&self, region: usize, state: usize) -> bool {
        self.current(region) == state && self.active_regions().contains(&region)
    }

    fn active_regions(&self) -> Vec<usize> {
        let active = self.directory.active(|region| self.current(region));
        active.map(|id| id.region).collect()
    }

    /// The timer of the current state of an active region instance: its flag, how long the state
    /// has been current, and its limit.
    pub(super) fn timer(&self, region: usize) -> Option<(usize, u64, u64)> {
        let current = self.current(region);
        let state = self.tables.state(current)?;
        let limit_us = state.timeout_us?;
        let offset = match state.kind {
            StateKind::Task { .. } | StateKind::Super { .. } => format::FLAG_TIMEOUT,
            _ => 0,
        };
        let (first, _) = self.tables.flags_of_state(region, current)?;
        let entered = self.entered.get(region)?;
        let steps = (self.step as u32).wrapping_sub(*entered);
        let age_us = u64::from(steps) * self.period_us;
        Some((first + offset, age_us, limit_us.into()))
    }

    /// Does what entering the target and the actions of a transition do to flags and the queue.
    fn enter(&mut self, region: usize, transition: usize) {
        let tables = self.tables;
        let (Some(taken), Some(here)) = (
            tables.transition(transition),
            tables.region_instance(region),
        ) else {
            return;
        };
        if let Some((first, flags)) = tables.flags_of_state(region, taken.target) {
            for flag in first..first + flags {
                self.write(flag, false);
            }
        }
        let first_channel = tables.instance(here.instance).map(|it| it.first_channel);
        for action in tables.actions_of(transition) {
            match action {
                Code::Write { flag, value, .. } => self.write(here.first_flag + flag, value),
                Code::Send { channel, .. } => self.queue.push(Queued {
                    channel: first_channel.map(|first| first + channel),
                    by: Some((region, transition)),
                }),
                Code::Test { .. } | Code::TestBusyInside { .. } | Code::End => {}
            }
        }
        if tables
            .state(taken.target)
            .is_some_and(|state| state.kind == StateKind::Final)
        {
            self.write(here.first_flag + format::FLAG_EXIT, true);
        }
    }

    fn write(&mut self, flag: usize, value: bool) {
        let bit = 1 << (flag % 32);
        if let Some(word) = self.flags.get_mut(flag / 32) {
            *word = if value { *word | bit } else { *word & !bit };
        }
    }

    /// All flags, the first in the lowest bit of the first word.
    pub(super) fn flags(&self) -> &[u32] {
        &self.flags
    }

    /// A flag by its bit in the whole machine.
    pub(super) fn flag(&self, flag: usize) -> bool {
        let word = self.flags.get(flag / 32);
        word.is_some_and(|word| word >> (flag % 32) & 1 != 0)
    }

    /// A flag that a guard in a region instance reads, counted from the first of its container
    /// instance; or the busy flag of its superstate.
    pub(super) fn is_set(&self, region: usize, bit: Option<usize>) -> bool {
        let Some(here) = self.tables.region_instance(region) else {
            return false;
        };
        match bit {
            Some(bit) => self.flag(here.first_flag + bit),
            None => self.is_busy_within(region),
        }
    }

    /// Whether an active task state inside the current superstate of a region instance is busy.
    fn is_busy_within(&self, region: usize) -> bool {
        let tables = &self.tables;
        let Some(around) = tables.region_instance(region) else {
            return false;
        };
        let mut at = tables.first_region_inside(region, self.current(region));
        while let Some(inside) = at
            && inside < around.next
        {
            let state = self.current(inside);
            let is_busy = tables
                .state(state)
                .is_some_and(|state| matches!(state.kind, StateKind::Task { .. }))
                && tables
                    .flags_of_state(inside, state)
                    .is_some_and(|(first, _)| self.flag(first + format::FLAG_BUSY));
            if is_busy {
                return true;
            }
            at = tables
                .first_region_inside(inside, state)
                .or_else(|| tables.region_instance(inside).map(|it| it.next));
        }
        false
    }

    /// Whether the guard of a transition is true.
    fn holds(&self, region: usize, transition: usize) -> bool {
        self.holds_of(transition, |bit| self.is_set(region, bit))
    }

    /// Whether the guard of a transition is true where a flag, or the busy flag of the superstate,
    /// is what `value` says; flags are counted from the first of the container instance.
    pub(super) fn holds_of(
        &self,
        transition: usize,
        value: impl Fn(Option<usize>) -> bool,
    ) -> bool {
        let tables = &self.tables;
        let source = tables.source_of_transition(transition);
        let first = tables.state(source).map_or(0, |state| state.first_flag);
        let flag = |bit: usize| value(Some(first + bit));
        match tables.guard_of(transition) {
            None => false,
            Some(Guard::True) => true,
            Some(Guard::Flag { bit, value }) => flag(bit) == value,
            Some(Guard::Mask { mask, value }) => (0..u16::BITS as usize)
                .filter(|bit| mask >> bit & 1 != 0)
                .all(|bit| flag(bit) == (value >> bit & 1 != 0)),
            Some(Guard::Program { .. }) => {
                let tests: Vec<Code> = tables.program_of(transition).collect();
                let mut at = 0;
                while let Some(test) = tests.get(at) {
                    let (is_set, jump_if, jump) = match *test {
                        Code::Test {
                            flag,
                            jump_if,
                            jump,
                        } => (value(Some(flag)), jump_if, jump),
                        Code::TestBusyInside { jump_if, jump } => (value(None), jump_if, jump),
                        _ => return true,
                    };
                    match (is_set == jump_if, jump) {
                        (false, _) => at += 1,
                        (true, None) => return false,
                        // Always ahead: verified.
                        (true, Some(jump)) => at += jump.max(1),
                    }
                }
                true
            }
        }
    }
}
