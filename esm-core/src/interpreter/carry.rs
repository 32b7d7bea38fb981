//! What a machine takes over from the one that ran before it: a warm swap.
//!
//! Machines are compared by names, path by path. A region goes on if the region of its path was active, and that one's state exists here under its name and is of the same kind: both simple, both a superstate,
//! or both a state of a task with the same signature, in a slot or in slot 0. All else starts at `initial`. Containers and machine may have other names; events, slots, parameters and transitions are
//! those of the new machine from its first macro step on. `docs/src/semantics.md` says it for people.
//!
//! **Bounds.** No recursion, no memory but the arena's. Each region instance is looked up once, and its states one by one, so that time is at most proportional to state instances times names.
//! Names are looked for where the one before was found, so that between machines that differ little it is proportional to the names of the region instances.

use core::ops::Deref;

use super::{Interpreter, WORD_BITS, bit_of};
use crate::dispatcher::periods_in;
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

    /// The first region template of the container that the place stands in.
    fn first_in_container(&self) -> Option<usize> {
        Some(self.tables.container(self.container)?.first_region)
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

/// The states of one region, looked for by their names. Whoever asks in their order finds each at once: a search goes on behind what was found last, once round.
struct Search<'a> {
    /// From `initial` to `final`, which have no names.
    states: core::ops::Range<usize>,
    names: Names<'a>,
    /// Number of the named state that is looked at next, and the names from its own on.
    next: usize,
    rest: Names<'a>,
}

impl<'a> Search<'a> {
    /// In the region that a place stands at.
    fn at(place: &Place<'a>) -> Option<Self> {
        Some(Search {
            states: place.states_of(place.region)?,
            names: place.states.clone(),
            next: 0,
            rest: place.states.clone(),
        })
    }

    fn named(&mut self, name: &[u8]) -> Option<usize> {
        let count = self.states.len().saturating_sub(2);
        for _ in 0..count {
            if self.next == count {
                self.next = 0;
                self.rest = self.names.clone();
            }
            let found = self.rest.next()?;
            self.next += 1;
            if found == name {
                return Some(self.states.start + self.next);
            }
        }
        None
    }
}

/// A state goes on as this one over there: its task instances here and there, counted from the first of the container instance, if they are of a task.
/// None if the states are of different kinds.
fn same_kind(
    (here, state): (&Tables<'_>, usize),
    (there, other): (&Tables<'_>, usize),
) -> Option<Option<(usize, usize)>> {
    match (here.state(state)?.kind, there.state(other)?.kind) {
        (
            StateKind::Task {
                real_time: a,
                task_offset: task,
                ..
            },
            StateKind::Task {
                real_time: b,
                task_offset: other_task,
                ..
            },
        ) => {
            let signature = |tables: &Tables<'_>, state| {
                let task_state = tables.task_state(tables.task_state_at(state)?)?;
                Some(tables.task(task_state.task)?.signature_hash)
            };
            let same = a == b && signature(here, state) == signature(there, other);
            same.then_some(Some((task, other_task)))
        }
        (a, b) => (core::mem::discriminant(&a) == core::mem::discriminant(&b)).then_some(None),
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
        let first = there.container(other.container)?.first_region;
        // As a rule the region is the same one of its container.
        let before = template.checked_sub(self.here.first_in_container()?)?;
        if let Some(same) = self.named_alike(other.container, first + before) {
            let mut candidate = other.first_region;
            for _ in first..same {
                candidate = there.region_instance(candidate)?.next;
            }
            return Some(candidate);
        }
        let mut candidate = other.first_region;
        for template in first.. {
            if there.region(template)?.container != other.container {
                return None;
            }
            if self.named_alike(other.container, template).is_some() {
                return Some(candidate);
            }
            candidate = there.region_instance(candidate)?.next;
        }
        None
    }

    /// This region template over there, to which the place there goes, if it is in the container and has the name of the region that the place here stands at.
    fn named_alike(&mut self, container: usize, template: usize) -> Option<usize> {
        if self.there.tables.region(template)?.container != container {
            return None;
        }
        self.there.go_to(template)?;
        (self.there.name == self.here.name).then_some(template)
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
        let name = self.around_here.name_of(superstate)?;
        self.around_there.go_to(template)?;
        let other = Search::at(&self.around_there)?.named(name?)?;
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
        self.clock.look_in(1);
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
            let states = pairs.here.states_of(pairs.here.region);
            let (Some(states), Some(mut search)) = (states, Search::at(&pairs.there)) else {
                continue;
            };
            let mut names = pairs.here.states.clone();
            let (initial, last) = (states.start, states.end.saturating_sub(1));
            for state in states {
                // Only what has a name can be of another kind over there.
                let other = if state == initial {
                    search.states.start
                } else if state == last {
                    search.states.end.saturating_sub(1)
                } else {
                    let other = names.next().and_then(|name| search.named(name));
                    let Some((other, of_task)) = other.and_then(|other| {
                        Some((other, same_kind((&here, state), (&there, other))?))
                    }) else {
                        continue;
                    };
                    if let Some((task, other_task)) = of_task {
                        tasks.pair(
                            (&here, instances.0.first_task + task),
                            (&there, instances.1.first_task + other_task),
                        );
                    }
                    other
                };
                if current == Some(other) {
                    R::store_half(self.arena, current_states, region, state as u16);
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
                let steps = u64::from(before.clock.now().wrapping_sub(entered));
                let us = steps * u64::from(before.period_us);
                let limit = self.limit(self.current_record(region));
                let same = match self.period_us {
                    // Where no time passes, none has.
                    0 => 0,
                    period_us => periods_in(us, period_us),
                };
                age = u32::try_from(same).unwrap_or(u32::MAX).min(limit);
            }
        }
        let entered = self.clock.now().wrapping_sub(age);
        self.store(self.parts.entered, region, entered);
    }
}
