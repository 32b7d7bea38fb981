//! What task states ask of a slot that is not declared: for the line that a message proposes.

use std::collections::HashMap;

use crate::lang::tree::{Given, Number, StateKind};
use crate::model::Span;

use super::declarations::Trees;
use super::scope::Names;

/// The longest period that a slot can have.
const MAX_PERIOD_MS: u64 = 4_000_000;

/// What is known of a slot that is not declared.
#[derive(Clone, Copy, Default)]
pub(super) struct Demand {
    /// How long the states that can be current together take.
    pub(super) needed_us: u64,
    /// Where a state that runs in it names its task.
    pub(super) user: Option<Span>,
}

impl Demand {
    /// Of one task state.
    pub(super) fn of_one(wcet_us: u32) -> Self {
        Self {
            needed_us: wcet_us.into(),
            user: None,
        }
    }

    /// A period and a duration in which there is room: whole milliseconds, and a fifth of the time,
    /// which leaves room for others.
    pub(super) fn times_ms(&self) -> (u64, u64) {
        let duration_ms = self.needed_us.div_ceil(1_000).clamp(1, MAX_PERIOD_MS);
        let period_ms = (duration_ms * 5).next_multiple_of(10).min(MAX_PERIOD_MS);
        (period_ms, duration_ms)
    }
}

/// What the states of tasks ask of these tasks' slots.
pub(super) struct Demands<'f> {
    /// By slot.
    needed_us: HashMap<u32, u64>,
    /// By task that a state uses: the first state that runs in the task's slot, if there is one.
    users: HashMap<&'f str, Option<Span>>,
}

impl<'f> Demands<'f> {
    /// Of all states of the tasks in `wanted`, each of which has a slot and a worst execution time.
    /// One state of a region is current at a time; a container runs as often as superstates name
    /// it.
    pub(super) fn of(
        set: &Trees<'f>,
        wanted: &HashMap<&'f str, (Number, u32)>,
        names: &Names<'f, '_>,
    ) -> Self {
        let mut demands = Demands {
            needed_us: HashMap::new(),
            users: HashMap::new(),
        };
        let superstates = superstates(set, names);
        for container in set.containers() {
            let name = container.name.map_or("", |name| names.text(name.0));
            let times = superstates.get(name).copied().unwrap_or(1);
            for region in &container.regions {
                let mut longest_us: HashMap<u32, u64> = HashMap::new();
                for state in &region.states {
                    let StateKind::Task {
                        task: Some(task),
                        slot,
                        ..
                    } = state.kind
                    else {
                        continue;
                    };
                    let name = names.text(task.0);
                    let Some(&(number, wcet_us)) = wanted.get(name) else {
                        continue;
                    };
                    let user = demands.users.entry(name).or_insert(None);
                    if slot == Given::Absent {
                        user.get_or_insert(task.0);
                        let longest_us = longest_us.entry(number.value).or_insert(0);
                        *longest_us = (*longest_us).max(wcet_us.into());
                    }
                }
                for (slot, us) in longest_us {
                    let needed_us = demands.needed_us.entry(slot).or_insert(0);
                    *needed_us = needed_us.saturating_add(us.saturating_mul(times));
                }
            }
        }
        demands
    }

    /// Of a slot, seen from a task that names it; none where no state uses the task.
    pub(super) fn get(&self, slot: u32, task: &str) -> Option<Demand> {
        let user = *self.users.get(task)?;
        let needed_us = self.needed_us.get(&slot).copied().unwrap_or(0);
        Some(Demand { needed_us, user })
    }
}

/// How many superstates name each container.
fn superstates<'f>(set: &Trees<'f>, names: &Names<'f, '_>) -> HashMap<&'f str, u64> {
    let mut times = HashMap::new();
    for state in set.states() {
        if let StateKind::Super {
            container: Some(name),
        } = state.kind
        {
            *times.entry(names.text(name.0)).or_insert(0) += 1;
        }
    }
    times
}
