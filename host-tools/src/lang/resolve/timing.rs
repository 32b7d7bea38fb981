//! Time: what is asked for must be there (E010).
//!
//! Tasks that share a slot run one after another in it, as far as they can be active together. That is worked out on the tree: of
//! the states of a region one is active, of the regions of a container all are. Of an `exclusive` group one runs at a time.
//! States that nothing leads to are never active ([`Activity`]).

use std::collections::HashMap;

use crate::lang::analysis::activity::{Activity, StateId};
use crate::lang::diagnostic::{Code, Diagnostic};
use crate::model::{Model, StateKind};

use super::scope::Names;
use super::slots::SlotTable;
use super::{ContainerFacts, Kind, StateFacts};

/// How many `exclusive` groups are told apart in one slot. The tasks of further groups count as if they were in none.
const MAX_GROUPS_IN_SLOT: usize = 8;

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
        let loads = Loads::new(facts, slots, model, activity);
        loads.check(facts, order, names);
    }
}

// ─── Utilisation ──────────────────────────────────────────────────────────────────────────────────────────────────────

fn check_utilisation(slots: &SlotTable, model: &Model, names: &mut Names<'_, '_>) {
    let times: Vec<(u32, u32)> = (0..model.slots.len())
        .filter_map(|index| slots.times_us(model, index))
        .filter(|(period_us, duration_us)| duration_us <= period_us)
        .collect();
    let Some(first) = model.slots.first() else {
        return;
    };
    if crate::schedule::exceeds_one(times.iter().copied()) {
        let percent = crate::schedule::utilisation(times.iter().copied()) * 100.0;
        let share = if percent < 100.01 {
            "a little more than 100".to_owned()
        } else {
            format!("{percent:.2}")
        };
        names.report(
            Diagnostic::new(
                Code::E010,
                first.span,
                format!("the slots together ask for {share} % of the time"),
            )
            .hint("shorten durations or lengthen periods until they ask for at most 100 %"),
        );
    }
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

/// Loads by slot, of a region or container.
type LoadBySlot = HashMap<usize, Load>;

struct Loads<'l> {
    slots: &'l SlotTable,
    model: &'l Model,
    activity: &'l Activity,
    /// Per slot, the groups that are told apart in it, by name.
    groups: HashMap<usize, HashMap<&'l str, usize>>,
}

impl<'l> Loads<'l> {
    fn new(
        facts: &[ContainerFacts<'_>],
        slots: &'l SlotTable,
        model: &'l Model,
        activity: &'l Activity,
    ) -> Self {
        let mut groups: HashMap<usize, HashMap<&'l str, usize>> = HashMap::new();
        for state in facts.iter().flat_map(|facts| &facts.states).flatten() {
            if let (Kind::Task(task), Some(slot)) = (state.kind, state.slot)
                && let Some(group) = model
                    .tasks
                    .get(task)
                    .and_then(|task| task.exclusive.as_deref())
            {
                let groups = groups.entry(slot).or_default();
                let index = groups.len();
                if index < MAX_GROUPS_IN_SLOT {
                    groups.entry(group).or_insert(index);
                }
            }
        }
        Loads {
            slots,
            model,
            activity,
            groups,
        }
    }

    fn check(&self, facts: &[ContainerFacts<'_>], order: &[usize], names: &mut Names<'_, '_>) {
        let mut loads: Vec<LoadBySlot> = vec![LoadBySlot::new(); facts.len()];
        let mut worst: HashMap<usize, u64> = HashMap::new();
        for &index in order {
            let Some(facts) = facts.get(index) else {
                continue;
            };
            let load = self.container(index, facts, &loads);
            // Without a machine each container may be the whole.
            if self.model.machine.is_none_or(|machine| machine == index) {
                for (&slot, load) in &load {
                    let most = load.iter().copied().max().unwrap_or(0);
                    let known = worst.entry(slot).or_default();
                    *known = most.max(*known);
                }
            }
            if let Some(slot) = loads.get_mut(index) {
                *slot = load;
            }
        }
        for index in 0..self.model.slots.len() {
            if let (Some(&needed_us), Some((_, duration_us))) =
                (worst.get(&index), self.slots.times_us(self.model, index))
                && needed_us > u64::from(duration_us)
            {
                self.report(index, needed_us, facts, names);
            }
        }
    }

    fn container(
        &self,
        container: usize,
        facts: &ContainerFacts<'_>,
        loads: &[LoadBySlot],
    ) -> LoadBySlot {
        let mut sum = LoadBySlot::new();
        for (region, states) in facts.states.iter().enumerate() {
            for (slot, load) in self.region(container, region, states, loads) {
                let before = sum.remove(&slot);
                sum.insert(
                    slot,
                    before.map_or_else(|| load.clone(), |before| together(&before, &load)),
                );
            }
        }
        sum
    }

    fn region(
        &self,
        container: usize,
        region: usize,
        states: &[StateFacts],
        loads: &[LoadBySlot],
    ) -> LoadBySlot {
        let mut most = LoadBySlot::new();
        for (state, facts) in states.iter().enumerate() {
            let id = StateId {
                container,
                region,
                state,
            };
            if !self.activity.is_reachable(id) {
                continue;
            }
            match facts.kind {
                Kind::Task(task) => {
                    if let Some(slot) = facts.slot
                        && let Some(load) = self.task(task, slot)
                    {
                        either(&mut most, slot, &load);
                    }
                }
                Kind::Super(container) => {
                    for (&slot, load) in loads.get(container).into_iter().flatten() {
                        either(&mut most, slot, load);
                    }
                }
                Kind::Simple | Kind::Unknown => {}
            }
        }
        most
    }

    /// What one task asks of a slot; nothing if it does not even fit alone.
    fn task(&self, task: usize, slot: usize) -> Option<Load> {
        let (_, duration_us) = self.slots.times_us(self.model, slot)?;
        let task = self.model.tasks.get(task)?;
        let wcet_us = task.wcet_us.filter(|&wcet_us| wcet_us <= duration_us)?;
        let groups = self.groups.get(&slot);
        let size = 1 << groups.map_or(0, HashMap::len);
        let group = task
            .exclusive
            .as_deref()
            .and_then(|group| groups?.get(group).copied());
        Some(match group {
            None => vec![u64::from(wcet_us); size],
            Some(group) => (0..size)
                .map(|set| {
                    if set >> group & 1 == 1 {
                        u64::from(wcet_us)
                    } else {
                        0
                    }
                })
                .collect(),
        })
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
        let states = facts.iter().enumerate().flat_map(|(container, facts)| {
            facts
                .states
                .iter()
                .enumerate()
                .flat_map(move |(region, states)| {
                    states.iter().enumerate().map(move |(state, facts)| {
                        let id = StateId {
                            container,
                            region,
                            state,
                        };
                        (id, facts)
                    })
                })
        });
        let sharing = states
            .filter(|(id, state)| {
                state.slot == Some(index)
                    && matches!(state.kind, Kind::Task(task) if self.task(task, index).is_some())
                    && self.activity.is_active(*id)
            })
            .map(|(_, state)| state);
        for state in sharing.take(MAX_SHOWN) {
            diagnostic = diagnostic.related(state.span, "runs in it");
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

/// Takes one more state of a region, which is active instead of the others.
fn either(most: &mut LoadBySlot, slot: usize, load: &Load) {
    let known = most.entry(slot).or_insert_with(|| vec![0; load.len()]);
    for (known, &new) in known.iter_mut().zip(load) {
        *known = new.max(*known);
    }
}
