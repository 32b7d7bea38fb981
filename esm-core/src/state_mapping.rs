//! What two machines have in common: what a warm swap goes by.
//!
//! Machines are compared by names, path by path. A region of one is that of the other if both have
//! its path, and so is a state of it that is of the same kind: both simple, both a superstate, or
//! both a state of a task with the same signature, in a slot or in slot 0. Containers and machine
//! may have other names.
//!
//! None of this depends on what is current. So it can be found out while the machine before still
//! runs, by whoever has the time, and what is left for the swap itself is [to
//! copy](crate::Interpreter::take_over) what is current.
//!
//! **Bounds.** No recursion, no memory but the table. Each region instance is looked up once, and
//! its states one by one, so that time is at most proportional to state instances times names.
//! Names are looked for where the one before was found, so that between machines that differ little
//! it is proportional to the names of the region instances.

use core::ops::Range;

use crate::format;
use crate::tables::{Container, Names, StateKind, Tables};

/// Stands for nothing over there.
const NOBODY: u16 = u16::MAX;

/// Entries of the table for each region instance: its pair, and what to add to a state over there
/// to find the place of its entry.
const OF_REGION: usize = 2;
/// Entries for a pair of tasks, of nets.
const OF_PAIR: usize = 2;
/// Entries for a control flag of a superstate: region instance, state over there, bit here, bit
/// over there.
const OF_FLAG: usize = 4;

/// The table has not enough entries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MappingTooLarge {
    /// Entries that are needed at least.
    pub needed: usize,
    /// Entries that there are.
    pub available: usize,
}

/// What one machine ("here") has in common with another ("there"), in a table that the caller
/// lends: two entries for each region instance here, one for each state over there of a region that
/// both have, two for each task state and for each net that both have, four for each control flag
/// of a superstate that both have.
#[derive(Debug)]
pub struct StateMapping<'p> {
    table: &'p mut [u16],
    /// Where what comes behind the region instances, the states, the tasks and the nets begins, and
    /// where the table ends.
    states: usize,
    tasks: usize,
    nets: usize,
    flags: usize,
    end: usize,
}

impl<'p> StateMapping<'p> {
    /// Nothing in common yet.
    pub fn new(table: &'p mut [u16]) -> Self {
        StateMapping {
            table,
            states: 0,
            tasks: 0,
            nets: 0,
            flags: 0,
            end: 0,
        }
    }

    /// Gives the table back.
    pub fn into_table(self) -> &'p mut [u16] {
        self.table
    }

    /// Finds out what two machines have in common: nothing, where names were left out. `outputs_of`
    /// says of the task with a signature's hash which of its data ports it writes, bit by bit;
    /// their nets are paired.
    ///
    /// # Errors
    /// The table is too short; then there is nothing in common.
    pub fn find(
        &mut self,
        here: &Tables<'_>,
        there: &Tables<'_>,
        outputs_of: impl Fn(u64) -> u8,
    ) -> Result<(), MappingTooLarge> {
        self.clear();
        let regions = here.region_instance_count();
        for _ in 0..OF_REGION * regions {
            self.push(NOBODY);
        }
        self.states = self.end;
        self.find_states(here, there);
        self.tasks = self.end;
        self.find_tasks(here, there);
        self.nets = self.end;
        self.find_nets(here, there, outputs_of);
        self.flags = self.end;
        self.find_flags(here, there);
        let (needed, available) = (self.end, self.table.len().min(NOBODY.into()));
        if needed > available {
            self.clear();
            return Err(MappingTooLarge { needed, available });
        }
        Ok(())
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.states = 0;
        self.tasks = 0;
        self.nets = 0;
        self.flags = 0;
        self.end = 0;
    }

    /// The region instance over there with the path of this one.
    pub(crate) fn region(&self, region: usize) -> Option<usize> {
        let at = OF_REGION * region;
        (at < self.states).then(|| self.entry(at)).flatten()
    }

    /// The state here of a region instance as which a state of its pair goes on.
    pub(crate) fn state(&self, region: usize, other: usize) -> Option<usize> {
        let base = self.table.get(OF_REGION * region + 1)?;
        let at = usize::from(base.wrapping_add(other as u16));
        (self.states..self.tasks)
            .contains(&at)
            .then(|| self.entry(at))
            .flatten()
    }

    /// The task instances that both have: here and there, in the order of the states here.
    pub fn tasks(&self) -> impl Iterator<Item = (usize, usize)> + Clone {
        self.pairs(self.tasks..self.nets)
    }

    /// The nets that tasks write that both have: here and there, in the order of the tasks. A net
    /// may have several pairs.
    pub fn nets(&self) -> impl Iterator<Item = (usize, usize)> {
        self.pairs(self.nets..self.flags)
    }

    /// The control flags that superstates of the same path have by the same name: region instance
    /// here, state over there, bit here, bit over there.
    pub(crate) fn flags(&self) -> impl Iterator<Item = [usize; OF_FLAG]> {
        let entries = self.table.get(self.flags..self.end).unwrap_or_default();
        let (flags, _) = entries.as_chunks::<OF_FLAG>();
        flags.iter().map(|flag| flag.map(usize::from))
    }

    fn pairs(&self, entries: Range<usize>) -> impl Iterator<Item = (usize, usize)> + Clone {
        let entries = self.table.get(entries).unwrap_or_default();
        let (pairs, _) = entries.as_chunks::<OF_PAIR>();
        pairs
            .iter()
            .map(|[a, b]| (usize::from(*a), usize::from(*b)))
    }

    fn entry(&self, at: usize) -> Option<usize> {
        let entry = *self.table.get(at)?;
        (entry != NOBODY).then_some(entry.into())
    }

    fn set(&mut self, at: usize, value: usize) {
        if let Some(entry) = self.table.get_mut(at) {
            *entry = value as u16;
        }
    }

    /// Appends an entry, or counts that it would have been.
    fn push(&mut self, value: u16) {
        self.set(self.end, value.into());
        self.end += 1;
    }

    /// Regions, and the states in them.
    fn find_states(&mut self, here: &Tables<'_>, there: &Tables<'_>) -> Option<()> {
        let mut finder = Finder::new(*here, *there)?;
        for region in 0..here.region_instance_count() {
            let Some(pair) = finder.find(region, |other| self.region(other)) else {
                continue;
            };
            let states = finder.here.states_of(finder.here.region)?;
            let others = finder.there.states_of(finder.there.region)?;
            let mut search = Search::at(&finder.there)?;
            let base = self.end.wrapping_sub(others.start);
            self.set(OF_REGION * region, pair);
            self.set(OF_REGION * region + 1, base);
            for _ in others.clone() {
                self.push(NOBODY);
            }
            let mut names = finder.here.states.clone();
            let (initial, last) = (states.start, states.end.saturating_sub(1));
            for state in states {
                // Only what has a name can be of another kind over there.
                let other = if state == initial {
                    Some(others.start)
                } else if state == last {
                    Some(others.end.saturating_sub(1))
                } else {
                    let other = names.next().and_then(|name| search.named(name));
                    other.filter(|other| is_same_kind((here, state), (there, *other)))
                };
                if let Some(other) = other {
                    self.set(base.wrapping_add(other), state);
                }
            }
        }
        Some(())
    }

    /// The region instance over there with the path of this one, and the states of both.
    fn both(
        &self,
        region: usize,
        (here, there): (&Tables<'_>, &Tables<'_>),
    ) -> Option<(usize, Range<usize>, Range<usize>)> {
        let pair = self.region(region)?;
        let states = |tables: &Tables<'_>, region| {
            let initial = tables.region_instance(region)?.initial;
            states_of(tables, tables.region_of_state(initial))
        };
        Some((pair, states(here, region)?, states(there, pair)?))
    }

    fn find_tasks(&mut self, here: &Tables<'_>, there: &Tables<'_>) {
        for region in 0..here.region_instance_count() {
            let Some((pair, states, others)) = self.both(region, (here, there)) else {
                continue;
            };
            for state in states {
                let tasks = task_at(here, region, state).and_then(|task| {
                    let mut others = others.clone();
                    let other = others.find(|other| self.state(region, *other) == Some(state))?;
                    Some((task, task_at(there, pair, other)?))
                });
                if let Some((task, other)) = tasks {
                    self.push(task as u16);
                    self.push(other as u16);
                }
            }
        }
    }

    fn find_nets(&mut self, here: &Tables<'_>, there: &Tables<'_>, outputs_of: impl Fn(u64) -> u8) {
        let first_connection = |tables: &Tables<'_>, task| {
            let instance = tables.task_instance(task);
            instance.map_or(0, |instance| instance.first_connection)
        };
        for at in (self.tasks..self.nets).step_by(OF_PAIR) {
            let (Some(task), Some(other)) = (self.entry(at), self.entry(at + 1)) else {
                continue;
            };
            let outputs = (here.task_state_of(task))
                .and_then(|state| here.task(state.task))
                .map_or(0, |task| outputs_of(task.signature_hash));
            let (first, other_first) =
                (first_connection(here, task), first_connection(there, other));
            for port in (0..u8::BITS as usize).filter(|port| outputs >> port & 1 != 0) {
                let (Some(Some(net)), Some(Some(other))) = (
                    here.connection(first + port),
                    there.connection(other_first + port),
                ) else {
                    continue;
                };
                // What there is no room for is not seen again: so it is counted once.
                if self.end > self.table.len() {
                    return;
                }
                if !self
                    .pairs(self.nets..self.end)
                    .any(|pair| pair == (net, other))
                {
                    self.push(net as u16);
                    self.push(other as u16);
                }
            }
        }
    }

    fn find_flags(&mut self, here: &Tables<'_>, there: &Tables<'_>) -> Option<()> {
        let mut names = Place::first(*here)?;
        let mut other_names = Place::first(*there)?;
        for region in 0..here.region_instance_count() {
            let Some((pair, _, others)) = self.both(region, (here, there)) else {
                continue;
            };
            for other in others {
                let Some(state) = self.state(region, other) else {
                    continue;
                };
                let (Some(inside), Some(other_inside)) =
                    (inside(here, region, state), inside(there, pair, other))
                else {
                    continue;
                };
                names.go_to(inside.first_region)?;
                other_names.go_to(other_inside.first_region)?;
                let (first, _) = here.flags_of_state(region, state)?;
                let (other_first, _) = there.flags_of_state(pair, other)?;
                for (flag, name) in names.flags.clone().take(inside.flags).enumerate() {
                    let mut others = other_names.flags.clone().take(other_inside.flags);
                    if let Some(other_flag) = others.position(|other| other == name) {
                        let bit = |first, flag| first + format::CONTAINER_CONTROL_FLAGS + flag;
                        self.push(region as u16);
                        self.push(other as u16);
                        self.push(bit(first, flag) as u16);
                        self.push(bit(other_first, other_flag) as u16);
                    }
                }
            }
        }
        Some(())
    }
}

/// The states of a region template, from `initial` to `final`.
fn states_of(tables: &Tables<'_>, region: usize) -> Option<Range<usize>> {
    let end = match tables.region(region + 1) {
        Some(next) => next.first_state,
        None => tables.state_count(),
    };
    Some(tables.region(region)?.first_state..end)
}

/// The task instance of a state of a region instance, if it is one of a task.
fn task_at(tables: &Tables<'_>, region: usize, state: usize) -> Option<usize> {
    let StateKind::Task { task_offset, .. } = tables.state(state)?.kind else {
        return None;
    };
    let instance = tables.instance(tables.region_instance(region)?.instance)?;
    Some(instance.first_task + task_offset)
}

/// The container inside a state of a region instance, if it is a superstate.
fn inside(tables: &Tables<'_>, region: usize, state: usize) -> Option<Container> {
    let StateKind::Super { instance_offset } = tables.state(state)?.kind else {
        return None;
    };
    let around = tables.region_instance(region)?.instance;
    tables.container(tables.instance(around + instance_offset)?.container)
}

/// The names of one region after another. Going ahead costs what is between, going back begins
/// anew.
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
    fn states_of(&self, region: usize) -> Option<Range<usize>> {
        states_of(&self.tables, region)
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

/// The states of one region, looked for by their names. Whoever asks in their order finds each at
/// once: a search goes on behind what was found last, once round.
struct Search<'a> {
    /// From `initial` to `final`, which have no names.
    states: Range<usize>,
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

/// Whether a state goes on as this one over there.
fn is_same_kind((here, state): (&Tables<'_>, usize), (there, other): (&Tables<'_>, usize)) -> bool {
    let (Some(of_state), Some(of_other)) = (here.state(state), there.state(other)) else {
        return false;
    };
    match (of_state.kind, of_other.kind) {
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
struct Finder<'h, 't> {
    here: Place<'h>,
    there: Place<'t>,
    /// For the superstates around.
    around_here: Place<'h>,
    around_there: Place<'t>,
    /// The last container instance here, and the one over there, so that siblings need not look
    /// again.
    last: Option<(usize, Option<usize>)>,
}

impl<'h, 't> Finder<'h, 't> {
    fn new(here: Tables<'h>, there: Tables<'t>) -> Option<Self> {
        let (here, there) = (Place::first(here)?, Place::first(there)?);
        Some(Finder {
            around_here: here.clone(),
            around_there: there.clone(),
            here,
            there,
            last: None,
        })
    }

    /// The region instance with the path of this one; `pair_of` tells those of the ones before it.
    /// Both places stand at their regions then.
    fn find(&mut self, region: usize, pair_of: impl Fn(usize) -> Option<usize>) -> Option<usize> {
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

    /// This region template over there, to which the place there goes, if it is in the container
    /// and has the name of the region that the place here stands at.
    fn named_alike(&mut self, container: usize, template: usize) -> Option<usize> {
        if self.there.tables.region(template)?.container != container {
            return None;
        }
        self.there.go_to(template)?;
        (self.there.name == self.here.name).then_some(template)
    }

    /// The container instance with the path of this one.
    fn instance(
        &mut self,
        instance: usize,
        pair_of: impl Fn(usize) -> Option<usize>,
    ) -> Option<usize> {
        if instance == 0 {
            return Some(0);
        }
        let (region, superstate) = self.here.tables.superstate_of(instance)?;
        let there = self.there.tables;
        let around = there.region_instance(pair_of(region)?)?;
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
