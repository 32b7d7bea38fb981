//! Slots, and the one that runs the interpreter.

use std::collections::{HashMap, HashSet};

use crate::lang::diagnostic::{Code, Diagnostic, Edit, Fix};
use crate::lang::tree::{Name, Number, Rate, StateKind};
use crate::model::{Model, Slot, SlotRef, Span};

use super::declarations::{Trees, remove};
use super::demand::Demand;
use super::scope::Names;

const US_PER_SECOND: u32 = 1_000_000;

/// As many slots are proposed where one is missing.
pub(super) const MAX_SLOTS_PROPOSED: usize = 4;

/// All slots of the set, by number.
pub(super) struct SlotTable {
    indices: HashMap<u32, (usize, Span)>,
    /// Per slot of the model, whether its period and duration are known.
    is_known: Vec<bool>,
    /// Whether some slot may exist whose number is not known.
    is_incomplete: bool,
    /// Whether a number that no slot has is an error.
    must_be_declared: bool,
}

impl SlotTable {
    /// Declares the slots of all files.
    pub(super) fn declare(
        set: &Trees<'_>,
        has_machine: bool,
        model: &mut Model,
        names: &mut Names<'_, '_>,
    ) -> Self {
        let mut table = SlotTable {
            indices: HashMap::new(),
            is_known: Vec::new(),
            is_incomplete: set.is_incomplete(),
            must_be_declared: has_machine,
        };
        for slot in set.trees.iter().flat_map(|file| &file.slots) {
            let period_us = match slot.rate {
                Some(Rate::PeriodUs(period_us)) => Some(period_us),
                Some(Rate::Hertz(hertz)) => period_of_rate(hertz, slot.span, names),
                None => None,
            };
            let Some(number) = slot.number else {
                table.is_incomplete = true;
                continue;
            };
            names.refer(number.span, number.span);
            if let Some(&(_, first)) = table.indices.get(&number.value) {
                names.defined_twice("slot", &number.value.to_string(), number.span, first);
                continue;
            }
            if let (Some(period_us), Some(duration_us)) = (period_us, slot.duration_us)
                && duration_us > period_us
            {
                names.report(
                    Diagnostic::new(
                        Code::E010,
                        slot.span,
                        format!(
                            "slot {} lasts {duration_us} us, longer than its period of {period_us} us",
                            number.value
                        ),
                    )
                    .hint("shorten the duration or lengthen the period"),
                );
            }
            table
                .indices
                .insert(number.value, (model.slots.len(), number.span));
            table
                .is_known
                .push(period_us.is_some() && slot.duration_us.is_some());
            model.slots.push(Slot {
                number: number.value,
                period_us: period_us.unwrap_or(1),
                duration_us: slot.duration_us.unwrap_or(0),
                docs: names.docs(slot.docs),
                span: slot.span,
            });
        }
        table
    }

    /// The slot that a task state names, or an `interpreter`; an unknown one is reported.
    pub(super) fn resolve(
        &self,
        number: Number,
        demand: Demand,
        names: &mut Names<'_, '_>,
    ) -> Option<SlotRef> {
        let found = self.find(number, names);
        if found.is_none() {
            self.report_unknown(number, demand, names);
        }
        found
    }

    /// The slot that a task names. An unknown one is an error where the task is used only.
    pub(super) fn find(&self, number: Number, names: &mut Names<'_, '_>) -> Option<SlotRef> {
        if number.value == 0 {
            return Some(SlotRef::NonRealTime);
        }
        let &(index, place) = self.indices.get(&number.value)?;
        names.refer(number.span, place);
        Some(SlotRef::Slot(index))
    }

    /// Reports a slot that is not declared, unless that was done already; not in a set without a
    /// machine.
    pub(super) fn report_unknown(&self, number: Number, demand: Demand, names: &mut Names<'_, '_>) {
        if !self.must_be_declared || self.is_incomplete || !names.is_news(number.value) {
            return;
        }
        let (period_ms, duration_ms) = demand.times_ms();
        let declaration = format!(
            "slot {} period {period_ms} ms duration {duration_ms} ms;",
            number.value
        );
        // A library's task names the slot, and the mission that uses the task lacks it.
        let elsewhere = demand.user.filter(|user| user.file != number.span.file);
        let place = if elsewhere.is_some() {
            "declare it in your mission"
        } else {
            "declare it"
        };
        names.unknown_related(
            Name(number.span),
            "slot",
            format!("{place}: `{declaration}`"),
            elsewhere.map(|user| (user, "the task is used here")),
        );
    }

    /// Period and duration of a slot of the model, both in microseconds, where both are known.
    pub(super) fn times_us(&self, model: &Model, index: usize) -> Option<(u32, u32)> {
        let slot = model.slots.get(index)?;
        self.is_known
            .get(index)
            .is_some_and(|&known| known)
            .then_some((slot.period_us, slot.duration_us))
    }

    /// Per slot of the model, whether its period and duration are known.
    pub(super) fn known(self) -> Vec<bool> {
        self.is_known
    }

    /// Whether all slots of the set are known with their times.
    pub(super) fn is_whole(&self) -> bool {
        !self.is_incomplete && self.is_known.iter().all(|&known| known)
    }
}

/// The period of a rate in microseconds. A rate that has none is reported.
pub(super) fn period_of_rate(hertz: u32, span: Span, names: &mut Names<'_, '_>) -> Option<u32> {
    if US_PER_SECOND.is_multiple_of(hertz) {
        return Some(US_PER_SECOND / hertz);
    }
    let nearest = nearest_rates(hertz)
        .map(|rate| format!("{rate} Hz"))
        .collect::<Vec<_>>()
        .join(" or ");
    names.report(
        Diagnostic::new(
            Code::E010,
            span,
            format!("a rate of {hertz} Hz has no period of whole microseconds"),
        )
        .hint(format!(
            "the nearest that have one are {nearest}; or give the period, `period {} us`",
            nearest_period_us(hertz)
        )),
    );
    None
}

/// The period of whole microseconds that comes nearest to a rate.
fn nearest_period_us(hertz: u32) -> u32 {
    (US_PER_SECOND.saturating_add(hertz / 2) / hertz.max(1)).max(1)
}

/// The rates below and above that have a period of whole microseconds.
fn nearest_rates(hertz: u32) -> impl Iterator<Item = u32> {
    let below = (1..hertz.min(US_PER_SECOND + 1))
        .rev()
        .find(|rate| US_PER_SECOND.is_multiple_of(*rate));
    let above = (hertz..=US_PER_SECOND).find(|rate| US_PER_SECOND.is_multiple_of(*rate));
    below.into_iter().chain(above)
}

/// Slots that tasks or task states name.
fn slots_of_tasks(set: &Trees<'_>) -> HashSet<u32> {
    let of_states = set.states().filter_map(|state| match state.kind {
        StateKind::Task { slot, .. } => slot.value(),
        StateKind::Simple | StateKind::Super { .. } => None,
    });
    set.tasks()
        .filter_map(|task| task.slot.value())
        .chain(of_states)
        .map(|number| number.value)
        .collect()
}

/// Finds the slot that runs the interpreter. A machine needs one.
pub(super) fn declare_interpreter(
    set: &Trees<'_>,
    machine: Option<Span>,
    slots: &SlotTable,
    model: &mut Model,
    names: &mut Names<'_, '_>,
) {
    let mut first: Option<Span> = None;
    for interpreter in set.trees.iter().flat_map(|file| &file.interpreters) {
        if let Some(first) = first {
            let diagnostic =
                Diagnostic::new(Code::E003, interpreter.span, "a second `interpreter`")
                    .hint("remove one of the two: one slot runs the interpreter")
                    .related(first, "the first one")
                    .fix(remove(
                        "remove the second `interpreter`",
                        interpreter.span,
                        names,
                    ));
            names.report(diagnostic);
            continue;
        }
        first = Some(interpreter.span);
        model.interpreter_slot = interpreter.slot.and_then(|number| {
            match slots.resolve(number, Demand::default(), names) {
                Some(SlotRef::Slot(index)) => Some(index),
                _ => None,
            }
        });
    }
    if let (Some(machine), None, false) = (machine, first, set.is_incomplete()) {
        // Slots of tasks need not have time left.
        let taken = slots_of_tasks(set);
        let free = model
            .slots
            .iter()
            .map(|slot| slot.number)
            .filter(|number| !taken.contains(number))
            .take(MAX_SLOTS_PROPOSED)
            .map(|number| format!("interpreter slot {number};"));
        let new_number =
            (1..).find(|number| !slots.indices.contains_key(number) && !taken.contains(number));
        let new = new_number.map(|number| {
            format!("interpreter slot {number}; slot {number} period 20 ms duration 2 ms;")
        });
        let proposed: Vec<String> = free.chain(new).collect();
        let mut diagnostic = Diagnostic::new(
            Code::E013,
            machine,
            "no slot is said to run the interpreter of this machine",
        );
        if let Some(first) = proposed.first() {
            let hint = format!("name one that no task runs in: `{first}`");
            diagnostic = diagnostic.hint(hint);
        }
        for declaration in proposed {
            let title = format!("write `{declaration}`");
            let insert = Edit::before(machine, format!("{declaration}\n\n"));
            diagnostic = diagnostic.fix(Fix::one(title, insert));
        }
        names.report(diagnostic);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_that_have_a_period() {
        for (hertz, expected) in [
            (300, vec![250, 320]),
            (3, vec![2, 4]),
            (700_000, vec![500_000, 1_000_000]),
            (2_000_000, vec![1_000_000]),
            (u32::MAX, vec![1_000_000]),
        ] {
            assert_eq!(
                nearest_rates(hertz).collect::<Vec<_>>(),
                expected,
                "{hertz} Hz"
            );
        }
        for (hertz, expected_us) in [(300, 3_333), (60, 16_667), (7, 142_857), (u32::MAX, 1)] {
            assert_eq!(nearest_period_us(hertz), expected_us, "{hertz} Hz");
        }
    }
}
