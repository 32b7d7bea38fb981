//! What a machine takes over from the one that ran before it: a warm swap.
//!
//! Machines are compared by names, path by path. A region goes on if the region of its path was active, and that one's state exists here under its name and is of the same kind: both simple, both a superstate,
//! or both a state of a task with the same signature, in a slot or in slot 0. All else starts at `initial`. Containers and machine may have other names; events, slots, parameters and transitions are
//! those of the new machine from its first macro step on. `docs/src/semantics.md` says it for people.
//!
//! **Bounds.** No recursion, no memory but the arena's. Each region instance is looked up once, and its states one by one, so that time is at most proportional to state instances times names.

use core::ops::Deref;

use super::{Interpreter, WORD_BITS, bit_of};
use crate::format;
use crate::reads::Reads;
use crate::tables::{Names, State, StateKind, Tables};

/// Stands for no region instance of the machine before.
const NOBODY: u32 = u32::MAX;

/// How much of a machine goes on as it was.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TakenOver {
    /// Active region instances that have the state of the machine before.
    pub regions: u16,
    /// Active region instances that start anew.
    pub anew: u16,
}

/// Told of each task state that both machines have: the task instance here and there, with the tables that they stand in.
pub trait TaskPairs {
    /// Both are states of tasks with the same signature, under the same path.
    fn pair(&mut self, here: (&Tables<'_>, usize), there: (&Tables<'_>, usize));
}

/// Wants to know of none.
impl TaskPairs for () {
    fn pair(&mut self, _: (&Tables<'_>, usize), _: (&Tables<'_>, usize)) {}
}

/// The names of one region after another. Going ahead costs what is between, going back begins anew.
#[derive(Clone)]
struct Place<'a> {
    tables: Tables<'a>,
    /// Behind the names of the region's states that were read last.
    rest: Names<'a>,
    container: usize,
    flags: Names<'a>,
    region: usize,
    name: &'a [u8],
    /// From the name of its first state on.
    states: Names<'a>,
}

impl<'a> Place<'a> {
    /// The first region. None where names were left out.
    fn first(tables: Tables<'a>) -> Option<Self> {
        let mut rest = tables.names()?;
        skip(&mut rest, tables.event_count());
        rest.next()?;
        let flags = rest.clone();
        skip(&mut rest, tables.container(0)?.flags);
        let name = rest.next()?;
        Some(Place {
            tables,
            states: rest.clone(),
            rest,
            container: 0,
            flags,
            region: 0,
            name,
        })
    }

    /// Goes to a region template.
    fn go_to(&mut self, region: usize) -> Option<()> {
        if region < self.region {
            *self = Self::first(self.tables)?;
        }
        while self.region < region {
            let named = self.states_of(self.region)?;
            self.rest = self.states.clone();
            skip(&mut self.rest, named.len().saturating_sub(2));
            self.region += 1;
            let container = self.tables.region(self.region)?.container;
            while self.container < container {
                self.container += 1;
                self.rest.next()?;
                self.flags = self.rest.clone();
                skip(&mut self.rest, self.tables.container(self.container)?.flags);
            }
            self.name = self.rest.next()?;
            self.states = self.rest.clone();
        }
        Some(())
    }

    /// The states of a region template, from `initial` to `final`.
    fn states_of(&self, region: usize) -> Option<core::ops::Range<usize>> {
        let end = match self.tables.region(region + 1) {
            Some(next) => next.first_state,
            None => self.tables.state_count(),
        };
        Some(self.tables.region(region)?.first_state..end)
    }

    /// Goes to the region of a state, and gives the state's name: none for `initial` and `final`.
    fn name_of(&mut self, state: usize) -> Option<Option<&'a [u8]>> {
        self.go_to(self.tables.region_of_state(state))?;
        let first = self.states_of(self.region)?.start;
        match self.tables.state(state)?.kind {
            StateKind::Initial | StateKind::Final => Some(None),
            _ => Some(Some(self.states.clone().nth(state - first - 1)?)),
        }
    }
}

fn skip(names: &mut Names<'_>, count: usize) {
    if let Some(last) = count.checked_sub(1) {
        names.nth(last);
    }
}

/// The state of a region over there that a state here goes on as; both places go to their regions.
fn counterpart(
    here: &mut Place<'_>,
    state: usize,
    there: &mut Place<'_>,
    region: usize,
) -> Option<usize> {
    let name = here.name_of(state)?;
    there.go_to(region)?;
    let states = there.states_of(region)?;
    let found = match (name, here.tables.state(state)?.kind) {
        (None, StateKind::Initial) => states.start,
        (None, _) => states.end - 1,
        (Some(name), _) => {
            let named = states.len().saturating_sub(2);
            let at = there.states.clone().take(named).position(|it| it == name)?;
            states.start + 1 + at
        }
    };
    is_same_kind(&here.tables, state, &there.tables, found).then_some(found)
}

fn is_same_kind(here: &Tables<'_>, state: usize, there: &Tables<'_>, other: usize) -> bool {
    let (Some(State { kind: a, .. }), Some(State { kind: b, .. })) =
        (here.state(state), there.state(other))
    else {
        return false;
    };
    match (a, b) {
        (StateKind::Task { real_time: a, .. }, StateKind::Task { real_time: b, .. }) => {
            let signature = |tables: &Tables<'_>, state| {
                let task_state = tables.task_state(tables.task_state_at(state)?)?;
                Some(tables.task(task_state.task)?.signature_hash)
            };
            a == b && signature(here, state) == signature(there, other)
        }
        (a, b) => core::mem::discriminant(&a) == core::mem::discriminant(&b),
    }
}

/// Finds the region instance over there with the path of one here.
struct Pairs<'h, 't> {
    here: Place<'h>,
    there: Place<'t>,
    /// For the superstates around.
    around_here: Place<'h>,
    around_there: Place<'t>,
    /// The last container instance here, and the one over there, so that siblings need not look again.
    last: Option<(usize, Option<usize>)>,
}

impl<'h, 't> Pairs<'h, 't> {
    fn new(here: Tables<'h>, there: Tables<'t>) -> Option<Self> {
        let (here, there) = (Place::first(here)?, Place::first(there)?);
        Some(Pairs {
            around_here: here.clone(),
            around_there: there.clone(),
            here,
            there,
            last: None,
        })
    }

    /// The region instance with the path of this one; `pair_of` tells those of the ones before it. Both places stand at their regions then.
    fn find(&mut self, region: usize, pair_of: impl Fn(usize) -> u32) -> Option<usize> {
        let (here, there) = (self.here.tables, self.there.tables);
        let instance = here.region_instance(region)?.instance;
        let other = match self.last {
            Some((last, other)) if last == instance => other,
            _ => {
                let other = self.instance(instance, pair_of);
                self.last = Some((instance, other));
                other
            }
        };
        let other = there.instance(other?)?;
        let template = here.region_of_state(here.region_instance(region)?.initial);
        self.here.go_to(template)?;
        let mut candidate = other.first_region;
        let first = there.container(other.container)?.first_region;
        for template in first.. {
            if there.region(template)?.container != other.container {
                return None;
            }
            self.there.go_to(template)?;
            if self.there.name == self.here.name {
                return Some(candidate);
            }
            candidate = there.region_instance(candidate)?.next;
        }
        None
    }

    /// The container instance with the path of this one.
    fn instance(&mut self, instance: usize, pair_of: impl Fn(usize) -> u32) -> Option<usize> {
        if instance == 0 {
            return Some(0);
        }
        let (region, superstate) = self.here.tables.superstate_of(instance)?;
        let pair = Some(pair_of(region)).filter(|pair| *pair != NOBODY)?;
        let there = self.there.tables;
        let around = there.region_instance(pair as usize)?;
        let template = there.region_of_state(around.initial);
        let other = counterpart(
            &mut self.around_here,
            superstate,
            &mut self.around_there,
            template,
        )?;
        match there.state(other)?.kind {
            StateKind::Super { instance_offset } => Some(around.instance + instance_offset),
            _ => None,
        }
    }
}

impl<B: Deref<Target = [u8]>, R: Reads<B>> Interpreter<'_, B, R> {
    /// Takes over what the machine before has in common with this one: states, timers, flags, enable bits. To be called before the first macro step, between two
    /// macro steps of the other, which goes no further. A machine that stopped by a fault hands over nothing, nor does one without names.
    pub fn take_over(
        &mut self,
        before: &Interpreter<'_, B, R>,
        tasks: &mut impl TaskPairs,
    ) -> TakenOver {
        if before.fault.is_none() {
            self.find_pairs(before, tasks);
        }
        let taken_over = self.take_states(before);
        // Whoever was asleep wakes up once more, and all timers are looked at: too often does no harm.
        self.wake_all(0..self.layout.regions);
        self.look_at_timers_in(1);
        taken_over
    }

    /// Writes to each region instance its pair in the place of its timer, and the state that goes on as its current one.
    fn find_pairs(&mut self, before: &Interpreter<'_, B, R>, tasks: &mut impl TaskPairs) {
        let (entered, current_states) = (self.parts.entered, self.parts.current);
        for region in 0..self.layout.regions {
            R::store(self.arena, entered, region, NOBODY);
        }
        let (here, there) = (self.verified.tables(), before.tables());
        let Some(mut pairs) = Pairs::new(here, there) else {
            return;
        };
        for region in 0..self.layout.regions {
            let arena = &*self.arena;
            let pair = pairs.find(region, |other| R::load(arena, entered, other));
            let Some((pair, instances)) = pair.and_then(|pair| {
                let instance = |tables: &Tables<'_>, region| {
                    tables.instance(tables.region_instance(region)?.instance)
                };
                Some((pair, (instance(&here, region)?, instance(&there, pair)?)))
            }) else {
                continue;
            };
            R::store(self.arena, entered, region, pair as u32);
            let current = before.is_region_active(pair).then(|| before.current(pair));
            let template = pairs.there.region;
            let Some(states) = pairs.here.states_of(pairs.here.region) else {
                continue;
            };
            for state in states {
                let Some(other) = counterpart(&mut pairs.here, state, &mut pairs.there, template)
                else {
                    continue;
                };
                if current == Some(other) {
                    R::store_half(self.arena, current_states, region, state as u16);
                }
                let offset = |tables: &Tables<'_>, state| match tables.state(state)?.kind {
                    StateKind::Task { task_offset, .. } => Some(task_offset),
                    _ => None,
                };
                if let (Some(task), Some(other)) = (offset(&here, state), offset(&there, other)) {
                    tasks.pair(
                        (&here, instances.0.first_task + task),
                        (&there, instances.1.first_task + other),
                    );
                }
            }
        }
    }

    /// Makes what [`find_pairs`](Self::find_pairs) found true: activity, flags, timers, enable bits.
    fn take_states(&mut self, before: &Interpreter<'_, B, R>) -> TakenOver {
        let mut taken_over = TakenOver::default();
        for region in 0..self.layout.regions {
            let entered = self.parts.entered;
            let pair = self.load(entered, region);
            self.store(entered, region, 0);
            if !self.is_region_active(region) {
                continue;
            }
            let goes_on = pair != NOBODY && before.is_region_active(pair as usize);
            if goes_on && self.take_state(region, before, pair as usize).is_some() {
                taken_over.regions += 1;
            } else {
                taken_over.anew += 1;
            }
        }
        taken_over
    }

    /// Takes the current state of a region instance over, which [`find_pairs`](Self::find_pairs) has found. None where it starts anew.
    fn take_state(
        &mut self,
        region: usize,
        before: &Interpreter<'_, B, R>,
        pair: usize,
    ) -> Option<()> {
        let there = before.tables();
        let (old_index, new_index) = (before.current(pair), self.current(region));
        let old = there.state(old_index)?;
        let (new, instance_index, first_flag) = {
            let here = self.verified.tables();
            let record = here.region_instance(region)?;
            let new = here.state(new_index)?;
            (new, record.instance, record.first_flag + new.first_flag)
        };
        let (old_first, _) = there.flags_of_state(pair, old_index)?;
        match new.kind {
            // The state is another one, so that the region stands at its `initial`.
            StateKind::Initial if old.kind != StateKind::Initial => return None,
            StateKind::Initial => return Some(()),
            StateKind::Final => {
                let head = self.verified.tables().instance(instance_index)?.first_flag;
                self.set_flag_to(head + format::FLAG_EXIT, true);
            }
            StateKind::Simple => {}
            StateKind::Task { task_offset, .. } => {
                for bit in (0..new.flags.min(old.flags)).filter(|bit| *bit != format::FLAG_TIMEOUT)
                {
                    self.set_flag_to(first_flag + bit, before.flag(old_first + bit));
                }
                let StateKind::Task {
                    task_offset: other, ..
                } = old.kind
                else {
                    return None;
                };
                let task =
                    self.verified.tables().instance(instance_index)?.first_task + task_offset;
                let around = there.region_instance(pair)?.instance;
                if before.is_enabled(there.instance(around)?.first_task + other) {
                    self.enable(task);
                }
            }
            StateKind::Super { instance_offset } => {
                self.take_control_flags(
                    (instance_index + instance_offset, first_flag),
                    before,
                    (there.region_instance(pair)?, &old, old_first),
                );
                let mut inside = self.first_region_in(instance_index + instance_offset)?;
                let end = self.next(region);
                while inside < end {
                    let word = inside / WORD_BITS;
                    self.set_active(word, self.active(word) | bit_of(inside));
                    inside = self.next(inside);
                }
            }
        }
        self.take_timer(region, (new, first_flag), before, pair, (old, old_first));
        Some(())
    }

    fn first_region_in(&self, instance: usize) -> Option<usize> {
        Some(self.verified.tables().instance(instance)?.first_region)
    }

    /// Takes the control flags of a superstate over: those of the same name.
    fn take_control_flags(
        &mut self,
        (inside, first_flag): (usize, usize),
        before: &Interpreter<'_, B, R>,
        (around, old, old_first): (crate::tables::RegionInstance, &State, usize),
    ) -> Option<()> {
        let StateKind::Super { instance_offset } = old.kind else {
            return None;
        };
        let container_of = |tables: Tables<'_>, instance| {
            let container = tables.instance(instance)?.container;
            tables.container(container)
        };
        let old_container = container_of(before.tables(), around.instance + instance_offset)?;
        let mut there = Place::first(before.tables())?;
        there.go_to(old_container.first_region)?;
        let here = self.verified.tables();
        let container = container_of(here, inside)?;
        let mut names = Place::first(here)?;
        names.go_to(container.first_region)?;
        let mut flags = names.flags.clone();
        for flag in 0..container.flags {
            let name = flags.next()?;
            let mut others = there.flags.clone().take(old_container.flags);
            let Some(other) = others.position(|other| other == name) else {
                continue;
            };
            let is_set = before.flag(old_first + format::CONTAINER_CONTROL_FLAGS + other);
            let bit = first_flag + format::CONTAINER_CONTROL_FLAGS + flag;
            let (flags, place) = (self.parts.flags, bit / WORD_BITS);
            let word = R::load(self.arena, flags, place);
            let bit = 1 << (bit % WORD_BITS);
            let word = if is_set { word | bit } else { word & !bit };
            R::store(self.arena, flags, place, word);
        }
        Some(())
    }

    /// Takes the time over for which a state has been current, and whether that was too long.
    fn take_timer(
        &mut self,
        region: usize,
        (new, first_flag): (State, usize),
        before: &Interpreter<'_, B, R>,
        pair: usize,
        (old, old_first): (State, usize),
    ) {
        if new.timeout_us.is_none() {
            return;
        }
        let flag = |state: &State| match state.kind {
            StateKind::Simple => 0,
            _ => format::FLAG_TIMEOUT,
        };
        let mut age = 0;
        if old.timeout_us.is_some() {
            if before.flag(old_first + flag(&old)) {
                self.set_flag_to(first_flag + flag(&new), true);
            } else {
                let entered = before.load(before.parts.entered, pair);
                let steps = u64::from(before.now().wrapping_sub(entered));
                let us = steps * u64::from(before.period_us);
                let limit = self.limit(self.current_record(region));
                let same = us.checked_div(self.period_us.into()).unwrap_or(0);
                age = u32::try_from(same).unwrap_or(u32::MAX).min(limit);
            }
        }
        let entered = self.now().wrapping_sub(age);
        self.store(self.parts.entered, region, entered);
    }
}
