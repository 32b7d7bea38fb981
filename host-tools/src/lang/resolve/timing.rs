//! Time: what is asked for must be there (E010).
//!
//! Tasks that share a slot run one after another in it, as far as they can be active together. That is worked out on the tree: of
//! the states of a region one is active, of the regions of a container all are. Of an `exclusive` group one runs at a time.
//! States that nothing leads to are never active ([`Activity`]).
//!
//! Each slot is added up by itself, through the containers that have one of its tasks inside, so that what is kept at a time is one
//! sum a container.

use std::collections::{BTreeMap, HashMap, HashSet};

use crate::lang::analysis::activity::{Activity, StateId};
use crate::lang::diagnostic::{Code, Diagnostic};
use crate::model::{Model, StateKind};
use crate::schedule::{self, SlotSpec};

use super::scope::Names;
use super::slots::SlotTable;
use super::{ContainerFacts, Kind, StateFacts};

/// How many `exclusive` groups are told apart in one slot. The tasks of further groups count as if they were in none.
const MAX_GROUPS_IN_SLOT: usize = 8;

/// Steps that the sums of all slots may take together. The slots that are left then count as long enough.
const MAX_STEPS: usize = 10_000_000;

/// Reports whatever needs more time than there is.
pub(super) fn check(
    facts: &[ContainerFacts<'_>],
    slots: &SlotTable,
    model: &Model,
    activity: &Activity,
    names: &mut Names<'_, '_>,
) {
    check_utilisation(slots, model, names);
    check_wcets(facts, slots, model, names);
    if let Some(order) = activity.children_first() {
        let mut loads = Loads::new(facts, slots, model, activity, order);
        for slot in 0..model.slots.len() {
            let Ok(needed_us) = loads.most_us(slot) else {
                return;
            };
            if let Some((_, duration_us)) = slots.times_us(model, slot)
                && needed_us > u64::from(duration_us)
            {
                loads.report(slot, needed_us, facts, names);
            }
        }
    }
}

// ─── Utilisation ──────────────────────────────────────────────────────────────────────────────────────────────────────

fn check_utilisation(slots: &SlotTable, model: &Model, names: &mut Names<'_, '_>) {
    let specs: Vec<SlotSpec> = model
        .slots
        .iter()
        .enumerate()
        .filter_map(|(index, slot)| {
            let (period_us, duration_us) = slots.times_us(model, index)?;
            Some(SlotSpec {
                number: slot.number,
                period_us,
                duration_us,
                fixed_start_us: None,
            })
        })
        .filter(|slot| slot.duration_us <= slot.period_us)
        .collect();
    let (Some(first), Some(reason)) = (model.slots.first(), schedule::overcommitted(&specs)) else {
        return;
    };
    names.report(
        Diagnostic::new(
            Code::E010,
            first.span,
            format!("the slots cannot fit together: {reason}"),
        )
        .hint(reason.cure(&specs).to_string()),
    );
}

// ─── One task in its slot ─────────────────────────────────────────────────────────────────────────────────────────────

/// A task state that names a slot itself must fit it. What a task names is checked with the task.
fn check_wcets(
    facts: &[ContainerFacts<'_>],
    slots: &SlotTable,
    model: &Model,
    names: &mut Names<'_, '_>,
) {
    for (container, facts) in model.containers.iter().zip(facts) {
        for (region, states) in container.regions.iter().zip(&facts.states) {
            for (state, facts) in region.states.iter().zip(states) {
                let StateKind::Task { task, .. } = state.kind else {
                    continue;
                };
                if let (Kind::Task(_), Some(slot)) = (facts.kind, facts.own_slot)
                    && let Some(wcet_us) = model.tasks.get(task).and_then(|task| task.wcet_us)
                    && let Some((_, duration_us)) = slots.times_us(model, slot)
                    && wcet_us > duration_us
                {
                    report_wcet(&state.name, facts, slot, wcet_us, model, names);
                }
            }
        }
    }
}

fn report_wcet(
    state: &str,
    facts: &StateFacts,
    slot: usize,
    wcet_us: u32,
    model: &Model,
    names: &mut Names<'_, '_>,
) {
    let Some(slot) = model.slots.get(slot) else {
        return;
    };
    let message = format!(
        "task state `{state}` takes up to {wcet_us} us, slot {} lasts {} us",
        slot.number, slot.duration_us
    );
    names.report(
        Diagnostic::new(Code::E010, facts.span, message)
            .hint(format!(
                "give slot {} a longer duration, or the task state another slot",
                slot.number
            ))
            .related(slot.span, "the slot"),
    );
}

// ─── Tasks that share a slot ──────────────────────────────────────────────────────────────────────────────────────────

/// The most that can be active in one slot at a time, in microseconds: for each set of `exclusive` groups (as bits) the greatest sum
/// with at most one task of each of these groups, all other tasks counted in full.
type Load = Vec<u64>;

/// No steps are left.
struct TooLarge;

/// A task state that fits its slot.
#[derive(Clone, Copy)]
struct Member<'l> {
    state: StateId,
    wcet_us: u32,
    /// Its `exclusive` group.
    group: Option<&'l str>,
}

struct Loads<'l> {
    model: &'l Model,
    /// Per slot, its task states that can be active and fit alone, in the order of the model.
    members: Vec<Vec<Member<'l>>>,
    /// Per container, the superstates that are instances of it and can be active.
    outside: Vec<Vec<StateId>>,
    /// Per container, its place in an order in which each stands behind all that it uses.
    rank: Vec<usize>,
    steps_left: usize,
    /// Per container, what its regions ask of the slot that is looked at; empty in between.
    regions: Vec<BTreeMap<usize, Load>>,
}

impl<'l> Loads<'l> {
    fn new(
        facts: &[ContainerFacts<'_>],
        slots: &SlotTable,
        model: &'l Model,
        activity: &Activity,
        order: &[usize],
    ) -> Self {
        let mut loads = Loads {
            model,
            members: vec![Vec::new(); model.slots.len()],
            outside: vec![Vec::new(); facts.len()],
            rank: vec![0; facts.len()],
            steps_left: MAX_STEPS,
            regions: vec![BTreeMap::new(); facts.len()],
        };
        for (place, &container) in order.iter().enumerate() {
            if let Some(rank) = loads.rank.get_mut(container) {
                *rank = place;
            }
        }
        for (state, facts) in states(facts) {
            if !activity.is_active(state) {
                continue;
            }
            match facts.kind {
                Kind::Task(task) => {
                    if let Some(slot) = facts.slot
                        && let Some(member) = member(state, task, slot, slots, model)
                        && let Some(members) = loads.members.get_mut(slot)
                    {
                        members.push(member);
                    }
                }
                Kind::Super(container) => {
                    if let Some(outside) = loads.outside.get_mut(container) {
                        outside.push(state);
                    }
                }
                Kind::Simple | Kind::Unknown => {}
            }
        }
        loads
    }

    /// The most that can be active in a slot at a time, in microseconds.
    fn most_us(&mut self, slot: usize) -> Result<u64, TooLarge> {
        let members = self
            .members
            .get_mut(slot)
            .map(std::mem::take)
            .unwrap_or_default();
        let opened = self.open(&members);
        if let Some(of_slot) = self.members.get_mut(slot) {
            *of_slot = members;
        }
        let mut most = 0;
        for container in opened? {
            let load = self.container(container)?;
            // Without a machine each container may be the whole.
            if self
                .model
                .machine
                .is_none_or(|machine| machine == container)
            {
                most = most.max(load.iter().copied().max().unwrap_or(0));
            }
            let users = self
                .outside
                .get_mut(container)
                .map(std::mem::take)
                .unwrap_or_default();
            for user in &users {
                self.either(*user, &load)?;
            }
            if let Some(outside) = self.outside.get_mut(container) {
                *outside = users;
            }
        }
        Ok(most)
    }

    fn step(&mut self, steps: usize) -> Result<(), TooLarge> {
        self.steps_left = self.steps_left.checked_sub(steps).ok_or(TooLarge)?;
        Ok(())
    }

    /// Notes what task states ask of their slot. Gives the containers around them, each behind all that it uses.
    fn open(&mut self, members: &[Member<'l>]) -> Result<Vec<usize>, TooLarge> {
        let mut groups: HashMap<&str, usize> = HashMap::new();
        for group in members.iter().filter_map(|member| member.group) {
            let index = groups.len();
            if index < MAX_GROUPS_IN_SLOT {
                groups.entry(group).or_insert(index);
            }
        }
        let mut is_open = HashSet::new();
        let mut opened = Vec::new();
        for member in members {
            let wcet_us = u64::from(member.wcet_us);
            let group = member.group.and_then(|group| groups.get(group).copied());
            let load: Load = (0..1 << groups.len())
                .map(|set: usize| match group {
                    Some(group) if set >> group & 1 == 0 => 0,
                    _ => wcet_us,
                })
                .collect();
            self.either(member.state, &load)?;
            if is_open.insert(member.state.container) {
                opened.push(member.state.container);
            }
        }
        let mut next = 0;
        while let Some(&inside) = opened.get(next) {
            next += 1;
            let users = self.outside.get(inside).map_or(0, Vec::len);
            self.step(1 + users)?;
            for user in self.outside.get(inside).into_iter().flatten() {
                if is_open.insert(user.container) {
                    opened.push(user.container);
                }
            }
        }
        opened.sort_by_key(|&container| self.rank.get(container));
        Ok(opened)
    }

    /// Takes one more state of a region, which is active instead of the others.
    fn either(&mut self, state: StateId, load: &Load) -> Result<(), TooLarge> {
        self.step(load.len())?;
        let Some(regions) = self.regions.get_mut(state.container) else {
            return Ok(());
        };
        let most = regions
            .entry(state.region)
            .or_insert_with(|| vec![0; load.len()]);
        for (most, &new) in most.iter_mut().zip(load) {
            *most = new.max(*most);
        }
        Ok(())
    }

    /// What a container asks of the slot, once all is known of its regions.
    fn container(&mut self, container: usize) -> Result<Load, TooLarge> {
        let regions = self
            .regions
            .get_mut(container)
            .map(std::mem::take)
            .unwrap_or_default();
        let mut regions = regions.into_values();
        let mut sum = regions.next().unwrap_or_default();
        for load in regions {
            // As many pairs are there of a set of groups and a part of it.
            self.step(3_usize.pow(load.len().max(1).ilog2()))?;
            sum = together(&sum, &load);
        }
        Ok(sum)
    }

    fn report(
        &self,
        index: usize,
        needed_us: u64,
        facts: &[ContainerFacts<'_>],
        names: &mut Names<'_, '_>,
    ) {
        /// As many task states are shown.
        const MAX_SHOWN: usize = 4;
        let Some(slot) = self.model.slots.get(index) else {
            return;
        };
        let message = format!(
            "tasks that can be active together in slot {} take up to {needed_us} us, it lasts {} us",
            slot.number, slot.duration_us
        );
        let mut diagnostic = Diagnostic::new(Code::E010, slot.span, message).hint(format!(
            "give the slot at least {needed_us} us, or one of its tasks another slot"
        ));
        let members = self.members.get(index).into_iter().flatten();
        for member in members.take(MAX_SHOWN) {
            let id = member.state;
            let state = facts
                .get(id.container)
                .and_then(|facts| facts.states.get(id.region)?.get(id.state));
            if let Some(state) = state {
                diagnostic = diagnostic.related(state.span, "runs in it");
            }
        }
        names.report(diagnostic);
    }
}

/// The load of two regions of one container, which are active at the same time.
fn together(a: &Load, b: &Load) -> Load {
    let load = |load: &Load, set: usize| load.get(set).copied().unwrap_or(0);
    (0..a.len().max(b.len()))
        .map(|set| {
            // All ways to give each group of the set to one of the two.
            let mut of_a = set;
            let mut most = 0;
            loop {
                most = most.max(load(a, of_a).saturating_add(load(b, set & !of_a)));
                if of_a == 0 {
                    return most;
                }
                of_a = (of_a - 1) & set;
            }
        })
        .collect()
}

/// All states with what is known of them.
fn states<'f>(
    facts: &'f [ContainerFacts<'_>],
) -> impl Iterator<Item = (StateId, &'f StateFacts)> + 'f {
    facts.iter().enumerate().flat_map(|(container, facts)| {
        let regions = facts.states.iter().enumerate();
        regions.flat_map(move |(region, states)| {
            let states = states.iter().enumerate();
            states.map(move |(state, facts)| {
                let id = StateId {
                    container,
                    region,
                    state,
                };
                (id, facts)
            })
        })
    })
}

/// A task state as a member of its slot; `None` if it does not even fit alone.
fn member<'l>(
    state: StateId,
    task: usize,
    slot: usize,
    slots: &SlotTable,
    model: &'l Model,
) -> Option<Member<'l>> {
    let (_, duration_us) = slots.times_us(model, slot)?;
    let task = model.tasks.get(task)?;
    let wcet_us = task.wcet_us.filter(|&wcet_us| wcet_us <= duration_us)?;
    Some(Member {
        state,
        wcet_us,
        group: task.exclusive.as_deref(),
    })
}
