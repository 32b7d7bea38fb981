//! What a macro step that was run consisted of: from what was current and awake before it and the
//! transitions that the interpreter told of.
//!
//! Nothing here decides which transition is taken. It goes the same way once more, with the
//! interpreter's decisions, and takes note of what lay at it. Where the way through a guard depends
//! on flags, the longest one counts; where a fault ends the machine in the midst of an event, the
//! events that were waiting count as well.

use std::collections::{BTreeSet, VecDeque};
use std::ops::Deref;

use esm_core::reads::Reads;
use esm_core::{Fault, Interpreter, MAX_MICRO_STEPS, Observer, TransitionTaken, format};

use super::costs::{Construct, Counts, Ledger};
use super::machine::{Action, Kind, Machine, State, Transition, Trigger, WORD_BITS, words};

/// What an interpreter told of one macro step.
#[derive(Clone, Debug, Default)]
pub struct Told {
    /// The transitions in the order in which they were taken, each with the number of tasks that
    /// were disabled by it.
    pub taken: Vec<(TransitionTaken, usize)>,
    /// Tasks that were disabled after the last transition.
    pub disabled: usize,
}

impl Observer for Told {
    fn transition(&mut self, taken: TransitionTaken) {
        let disabled = std::mem::take(&mut self.disabled);
        self.taken.push((taken, disabled));
    }

    fn disabled(&mut self, _task_instance: u16) {
        self.disabled += 1;
    }
}

/// What a macro step finds.
#[derive(Clone, Debug)]
pub struct Before {
    /// The state of each region instance.
    current: Vec<usize>,
    active: Vec<bool>,
    awake: Vec<bool>,
    /// Whether all timers are looked at.
    looks_at_timers: bool,
    /// Per region instance whether its timer runs; and whether it is due, so that its regions wake.
    timers: Vec<(bool, bool)>,
}

/// When states with timeouts were entered, by region instance. It is followed from the start of a
/// machine on.
#[derive(Clone, Debug)]
pub struct Entered {
    at_us: Vec<u64>,
}

impl Machine {
    /// Before the first macro step.
    #[must_use]
    pub fn entered(&self) -> Entered {
        Entered {
            at_us: vec![0; self.regions.len()],
        }
    }

    /// Looks at a machine that is about to make a macro step at `t_us`.
    pub fn before<B: Deref<Target = [u8]>, R: Reads<B>>(
        &self,
        interpreter: &Interpreter<'_, B, R>,
        entered: &Entered,
        t_us: u64,
    ) -> Before {
        let regions = 0..self.regions.len();
        let tables = interpreter.tables();
        let timer = |index: usize| {
            let place = interpreter.current(index);
            let state = self.states.get(place);
            let limit_us = state.and_then(|state| state.timeout_us);
            let (Some(state), Some(limit_us)) = (state, limit_us) else {
                return (false, false);
            };
            let bit = match state.kind {
                Kind::Simple => 0,
                _ => format::FLAG_TIMEOUT,
            };
            let is_over = tables
                .flags_of_state(index, place)
                .is_some_and(|(first, _)| interpreter.flag(first + bit));
            let runs = interpreter.is_region_active(index) && !is_over;
            let since_us = entered.at_us.get(index).copied().unwrap_or_default();
            (
                runs,
                runs && t_us.saturating_sub(since_us) > u64::from(limit_us),
            )
        };
        Before {
            current: regions.clone().map(|it| interpreter.current(it)).collect(),
            active: regions
                .clone()
                .map(|it| interpreter.is_region_active(it))
                .collect(),
            awake: regions
                .clone()
                .map(|it| interpreter.is_region_awake(it))
                .collect(),
            looks_at_timers: interpreter.looks_at_timers(),
            timers: regions.map(timer).collect(),
        }
    }

    /// Counts what a macro step at `t_us` consisted of; with how many of its transitions were not
    /// met on the way, which are none unless this here and the interpreter differ. `fault`: how it
    /// ended, if it did.
    pub fn tally(
        &self,
        before: Before,
        told: &Told,
        fault: Option<Fault>,
        entered: &mut Entered,
        t_us: u64,
    ) -> (Counts, usize) {
        let mut walk = Walk {
            machine: self,
            counts: Counts::default(),
            current: before.current,
            active: before.active,
            awake: before.awake,
            entered,
            t_us,
            told: told.taken.iter().peekable(),
            queue: VecDeque::new(),
            micro: 0,
        };
        self.step(&mut walk.counts);
        if before.looks_at_timers {
            self.timers(&mut walk.counts);
            for (index, (runs, is_due)) in before.timers.into_iter().enumerate() {
                if runs {
                    self.timer_runs(&mut walk.counts, index, is_due);
                }
                if is_due && let Some(region) = self.regions.get(index) {
                    walk.wake(index..region.next);
                }
            }
        }
        // The interpreter looks at its first word alone before it begins to walk.
        let is_far = self.regions.len() > WORD_BITS;
        if before.looks_at_timers || is_far || walk.awake.contains(&true) {
            walk.pulse();
        }
        while let Some(channel) = walk.queue.pop_front() {
            walk.micro += 1;
            if walk.micro > u16::from(MAX_MICRO_STEPS) - 1 {
                break;
            }
            walk.event(channel);
        }
        let not_met = walk.told.count();
        let mut counts = walk.counts;
        if fault.is_some() {
            self.fault(&mut counts, told.disabled);
            self.unfinished(&mut counts);
        }
        (counts, not_met)
    }

    /// The transition that a fault leaves unfinished, at most.
    pub(super) fn unfinished(&self, ledger: &mut impl Ledger) {
        ledger.add(Construct::Taken, 1);
        ledger.add(Construct::LeaveTask, 1);
        ledger.add(Construct::Row, 1);
        ledger.add(Construct::RowSend, self.queue_capacity + 1);
    }
}

/// A macro step that is gone through once more.
struct Walk<'w> {
    machine: &'w Machine,
    counts: Counts,
    current: Vec<usize>,
    active: Vec<bool>,
    awake: Vec<bool>,
    entered: &'w mut Entered,
    t_us: u64,
    told: std::iter::Peekable<std::slice::Iter<'w, (TransitionTaken, usize)>>,
    queue: VecDeque<usize>,
    micro: u16,
}

impl Walk<'_> {
    fn pulse(&mut self) {
        let mut visits = BTreeSet::new();
        let mut at = 0;
        while let (Some(active), Some(awake)) = (self.active.get(at), self.awake.get_mut(at)) {
            if *active && std::mem::take(awake) {
                visits.insert(words(0..at + 1));
                at = self.visit(at, Trigger::Pulse);
            } else {
                at += 1;
            }
        }
        self.machine.pulse(&mut self.counts, Some(visits.len()));
    }

    fn event(&mut self, channel: usize) {
        let trigger = Trigger::Channel(channel);
        let mut visits = BTreeSet::new();
        let mut resume = 0;
        for at in self.machine.listeners(trigger) {
            if at >= resume && self.active.get(at) == Some(&true) {
                visits.insert(words(0..at + 1));
                resume = self.visit(at, trigger);
            }
        }
        self.machine
            .event(&mut self.counts, channel, Some(visits.len()));
    }

    /// Visits a region instance; gives the first one that may be visited after it.
    fn visit(&mut self, at: usize, trigger: Trigger) -> usize {
        let machine = self.machine;
        let place = self.current.get(at).copied().unwrap_or_default();
        let (Some(region), Some(state)) = (machine.regions.get(at), machine.states.get(place))
        else {
            return at + 1;
        };
        let micro = self.micro;
        let here = self.told.next_if(|(taken, _)| {
            u16::from(taken.micro) == micro && usize::from(taken.region_instance) == at
        });
        let last = here.map(|(taken, _)| usize::from(taken.transition));
        machine.visit(&mut self.counts, state, trigger);
        for index in machine.transitions_on(state, trigger) {
            let Some(transition) = machine.transitions.get(index) else {
                break;
            };
            machine.look(&mut self.counts, at, transition, trigger);
            if Some(index) == last {
                break;
            }
        }
        let transition = last.and_then(|last| machine.transitions.get(last));
        let (Some(transition), Some(&(_, disabled))) = (transition, here) else {
            return at + 1;
        };
        self.take(at, state, transition, disabled);
        region.next
    }

    fn take(&mut self, at: usize, left: &State, transition: &Transition, disabled: usize) {
        let machine = self.machine;
        // Of a task state that is left, its own is one of them.
        let inside = matches!(left.kind, Kind::Super { .. }).then_some(disabled);
        machine.take(&mut self.counts, at, left, transition, inside);
        self.queue.extend(machine.sent(at, transition));
        let (Some(region), Some(entered)) = (
            machine.regions.get(at),
            machine.states.get(transition.target),
        ) else {
            return;
        };
        if matches!(left.kind, Kind::Super { .. }) {
            for active in self
                .active
                .get_mut(at + 1..region.next)
                .into_iter()
                .flatten()
            {
                *active = false;
            }
        }
        let writes_around = transition.actions.contains(&Action::WriteAround);
        if writes_around || entered.kind == Kind::Final {
            self.wake(machine.woken_with(region.instance));
        }
        self.enter(at, transition.target);
        if let Some(instance) = machine.inside(at, entered) {
            for inside in machine.regions_of(instance) {
                if let (Some(active), Some(awake), Some(region)) = (
                    self.active.get_mut(inside),
                    self.awake.get_mut(inside),
                    machine.regions.get(inside),
                ) {
                    *active = true;
                    *awake = false;
                    self.enter(inside, region.states.start);
                }
            }
        }
    }

    fn enter(&mut self, at: usize, state: usize) {
        if let Some(current) = self.current.get_mut(at) {
            *current = state;
        }
        if let Some(since_us) = self.entered.at_us.get_mut(at) {
            *since_us = self.t_us;
        }
        let entered = self.machine.states.get(state);
        if let Some(awake) = self.awake.get_mut(at) {
            *awake = entered.is_some_and(State::wakes_itself);
        }
    }

    fn wake(&mut self, regions: std::ops::Range<usize>) {
        for awake in self.awake.get_mut(regions).into_iter().flatten() {
            *awake = true;
        }
    }
}
