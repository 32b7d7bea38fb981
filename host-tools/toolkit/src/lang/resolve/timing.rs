//! Time: what is asked for must be there (E010).
//!
//! What tasks that share a slot take together is added up by
//! [`sharing`](crate::lang::analysis::sharing).

use crate::lang::analysis::activity::{Activity, StateId};
use crate::lang::analysis::sharing::{Loads, Member};
use crate::lang::diagnostic::{Code, Diagnostic};
use crate::model::{Model, StateKind};
use crate::schedule::{self, SlotSpec};

use super::scope::Names;
use super::slots::SlotTable;
use super::{ContainerFacts, Kind, StateFacts};

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
        let mut loads = loads_of(facts, slots, model, activity, order);
        for slot in 0..model.slots.len() {
            // The slots that are left then count as long enough.
            let Ok(summed) = loads.sum(slot) else {
                return;
            };
            let needed_us = summed.most.us;
            if let Some((_, duration_us)) = slots.times_us(model, slot)
                && needed_us > u64::from(duration_us)
            {
                report_sum(&loads, slot, needed_us, facts, model, names);
            }
        }
    }
}

// ─── Utilisation ─────────────────────────────────────────────────────────────────────────────────

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

// ─── One task in its slot ────────────────────────────────────────────────────────────────────────

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

// ─── Tasks that share a slot ─────────────────────────────────────────────────────────────────────

/// The task states that can be active and fit their slot alone, and the superstates around them.
fn loads_of<'m>(
    facts: &[ContainerFacts<'_>],
    slots: &SlotTable,
    model: &'m Model,
    activity: &Activity,
    order: &[usize],
) -> Loads<'m> {
    let mut loads = Loads::new(model, order);
    for (state, facts) in states(facts) {
        if !activity.is_active(state) {
            continue;
        }
        match facts.kind {
            Kind::Task(task) => {
                if let Some(slot) = facts.slot
                    && let Some(member) = member(state, task, slot, slots, model)
                {
                    loads.add_task(slot, member);
                }
            }
            Kind::Super(container) => loads.add_super(state, container),
            Kind::Simple | Kind::Unknown => {}
        }
    }
    loads
}

fn report_sum(
    loads: &Loads<'_>,
    index: usize,
    needed_us: u64,
    facts: &[ContainerFacts<'_>],
    model: &Model,
    names: &mut Names<'_, '_>,
) {
    /// As many task states are shown.
    const MAX_SHOWN: usize = 4;
    let Some(slot) = model.slots.get(index) else {
        return;
    };
    let message = format!(
        "tasks that can be active together in slot {} take up to {needed_us} us, it lasts {} us",
        slot.number, slot.duration_us
    );
    let mut diagnostic = Diagnostic::new(Code::E010, slot.span, message).hint(format!(
        "give the slot at least {needed_us} us, or one of its tasks another slot"
    ));
    for member in loads.members(index).iter().take(MAX_SHOWN) {
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
        wcet_us: Some(wcet_us),
        group: task.exclusive.as_deref(),
    })
}
