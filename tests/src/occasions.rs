//! How often what is easy to get wrong happened in runs, so that agreement is never agreement about
//! nothing.
//!
//! An interpreter need not look at what cannot have changed. Most of what is counted here is a way
//! in which something has changed, and a transition was taken for it.

use std::collections::HashMap;

use host_tools::model::{
    Action, Guard, Model, Source, State, StateKind, Target, Transition, Trigger,
};

use crate::reference::Taken;

/// Flags of one state that an interpreter may look at together, and region instances or events that
/// one word holds.
const WINDOW_FLAGS: usize = 15;
const WORD_BITS: usize = 32;

/// Levels of superstates beyond which a transition counts as deep.
const DEEP: usize = 8;

/// The counters.
#[derive(Clone, Copy, Debug, Default)]
pub struct Occasions {
    conjunctions: usize,
    mixed_conjunctions: usize,
    wide_conjunctions: usize,
    flags_beyond_the_window: usize,
    parent_flags_of_earlier_regions: usize,
    parent_flags_of_later_regions: usize,
    flags_set_inside: usize,
    busy_superstates: usize,
    idle_superstates: usize,
    timeouts: [usize; 3],
    exits_of_tasks: usize,
    exits_of_superstates: usize,
    events_beyond_a_word: usize,
    events_that_collide: usize,
    regions_beyond_a_word: usize,
    in_rows: usize,
    in_rows_of_clear: usize,
    at_ends_of_rows: usize,
    far_in_rows: usize,
    behind_rows: usize,
    in_timed_rows: usize,
    entered_again: usize,
    superstates_left_across_words: usize,
    superstates_entered_across_words: usize,
    deep: usize,
}

/// Who changed a flag of a superstate last: the macro step and the region instance.
type Writers = HashMap<(usize, usize), (u64, usize)>;

impl Occasions {
    /// Adds those of one run of the machine of `model`.
    pub fn add(&mut self, model: &Model, run: &[Taken<'_>]) {
        let numbers = event_numbers(model);
        let mut writers = Writers::new();
        for taken in run {
            self.add_guard(taken, &writers);
            self.add_event(&numbers, taken);
            self.add_place(taken);
            self.add_row(taken);
            for action in &taken.transition.actions {
                if let Action::Parent(flag, _) = action {
                    writers.insert(
                        (taken.instance.start, *flag),
                        (taken.step, taken.region_number),
                    );
                }
            }
        }
    }

    fn add_guard(&mut self, taken: &Taken<'_>, writers: &Writers) {
        let star = (taken.transition.trigger == Trigger::Star).then_some(Guard::Exit);
        let Some(guard) = star.as_ref().or(taken.transition.guard.as_ref()) else {
            return;
        };
        let mut flags = Vec::new();
        let is_conjunction = literals(guard, true, &mut flags);
        let source = match taken.transition.source {
            Source::State(state) => taken.region.states.get(state),
            Source::Initial => None,
        };
        let is_own = |flag: &Guard| source.and_then(|state| place(flag, state)).is_some();
        let (own, others): (Vec<_>, Vec<_>) = flags.iter().partition(|(flag, _)| is_own(flag));
        if is_conjunction && others.is_empty() && own.len() > 1 {
            self.conjunctions += 1;
            self.wide_conjunctions += usize::from(own.len() > 4);
            let wanted = own.iter().filter(|(_, value)| *value).count();
            self.mixed_conjunctions += usize::from(wanted > 0 && wanted < own.len());
        }
        let beyond = |flag: &Guard| {
            let place = source.and_then(|state| place(flag, state));
            place.is_some_and(|place| place >= WINDOW_FLAGS)
        };
        self.flags_beyond_the_window += usize::from(own.iter().any(|(flag, _)| beyond(flag)));

        let on_pulse = matches!(taken.transition.trigger, Trigger::Pulse | Trigger::Star);
        for (flag, value) in flags {
            let kind = source.map(|state| &state.kind);
            match (flag, kind) {
                (Guard::Parent(flag), _) if on_pulse => {
                    if let Some(&(step, region)) = writers.get(&(taken.instance.start, *flag)) {
                        let earlier = step == taken.step && region < taken.region_number;
                        let later = step + 1 == taken.step && region > taken.region_number;
                        self.parent_flags_of_earlier_regions += usize::from(earlier);
                        self.parent_flags_of_later_regions += usize::from(later);
                    }
                }
                (Guard::Own(flag), Some(StateKind::Super { .. })) if on_pulse => {
                    let writer = writers.get(&(taken.inside[0].start, *flag));
                    let is_new = writer.is_some_and(|(step, _)| step + 1 == taken.step);
                    self.flags_set_inside += usize::from(is_new);
                }
                (Guard::Busy, Some(StateKind::Super { .. })) if on_pulse => {
                    self.busy_superstates += usize::from(taken.busy && value);
                    self.idle_superstates += usize::from(!taken.busy && !value);
                }
                (Guard::Timeout, Some(kind)) if taken.timeout && value => {
                    self.timeouts[match kind {
                        StateKind::Simple => 0,
                        StateKind::Task { .. } => 1,
                        StateKind::Super { .. } => 2,
                    }] += 1;
                }
                (Guard::Exit, Some(kind)) if value => match kind {
                    StateKind::Super { .. } => self.exits_of_superstates += 1,
                    _ => self.exits_of_tasks += 1,
                },
                _ => {}
            }
        }
    }

    fn add_event(&mut self, numbers: &HashMap<usize, usize>, taken: &Taken<'_>) {
        let number = |trigger| match trigger {
            Trigger::Pulse | Trigger::Star => 0,
            Trigger::Event(event) => numbers.get(&event).copied().unwrap_or(0),
        };
        let own = number(taken.transition.trigger);
        self.events_beyond_a_word += usize::from(own >= WORD_BITS);
        let collides = taken.region.transitions.iter().any(|other| {
            let other_number = number(other.trigger);
            other.source == taken.transition.source
                && other_number != own
                && other_number % WORD_BITS == own % WORD_BITS
        });
        self.events_that_collide += usize::from(collides);
    }

    fn add_place(&mut self, taken: &Taken<'_>) {
        self.regions_beyond_a_word += usize::from(taken.region_number >= WORD_BITS);
        let [left, entered] = taken.inside.clone().map(|inside| {
            let last = inside.end.saturating_sub(1);
            !inside.is_empty() && inside.start / WORD_BITS != last / WORD_BITS
        });
        self.superstates_left_across_words += usize::from(left);
        self.superstates_entered_across_words += usize::from(entered);
        self.deep += usize::from(taken.depth > DEEP);
    }

    /// Transitions on the pulse of one source that ask for one flag each, in the order of the
    /// flags: they can be looked at together.
    fn add_row(&mut self, taken: &Taken<'_>) {
        let Source::State(source) = taken.transition.source else {
            return;
        };
        let state = &taken.region.states[source];
        let on_pulse = |it: &&Transition| {
            it.source == taken.transition.source
                && matches!(it.trigger, Trigger::Pulse | Trigger::Star)
        };
        let on_pulse: Vec<_> = taken.region.transitions.iter().filter(on_pulse).collect();
        let Some(own) = on_pulse
            .iter()
            .position(|it| std::ptr::eq(*it, taken.transition))
        else {
            return;
        };
        let bits: Vec<usize> = on_pulse
            .iter()
            .map_while(|it| place_of_bit(it, state))
            .collect();
        let goes_on = |pair: &&[usize]| pair[0] + 1 == pair[1];
        let row = 1 + bits.windows(2).take_while(goes_on).count();
        if bits.len() > 1 && row > 1 {
            if state.timeout_us.is_some() {
                self.in_timed_rows += usize::from(own < row);
            } else if own < row {
                self.in_rows += 1;
                self.in_rows_of_clear += usize::from(bits[own] >= IF_CLEAR);
                self.at_ends_of_rows += usize::from(own + 1 == row);
                self.far_in_rows += usize::from(own >= 2);
            } else {
                self.behind_rows += 1;
            }
        }
        let is_task = matches!(state.kind, StateKind::Task { .. });
        let sends = matches!(taken.transition.actions[..], [Action::Send(_)]);
        let is_again = taken.transition.target == Target::State(source);
        self.entered_again +=
            usize::from(is_task && sends && is_again && state.timeout_us.is_none());
    }

    /// Fails where something happened too rarely.
    ///
    /// # Panics
    /// So that a test fails.
    pub fn assert_all(&self) {
        let least = [
            ("conjunctions of own flags", self.conjunctions, 200),
            ("conjunctions with negations", self.mixed_conjunctions, 100),
            ("conjunctions of five or more", self.wide_conjunctions, 50),
            (
                "flags beyond the 15th of a state",
                self.flags_beyond_the_window,
                50,
            ),
            (
                "flags around, set by an earlier region in the same pulse",
                self.parent_flags_of_earlier_regions,
                20,
            ),
            (
                "flags around, set by a later region in the last macro step",
                self.parent_flags_of_later_regions,
                20,
            ),
            (
                "flags of a superstate set inside in the last macro step",
                self.flags_set_inside,
                20,
            ),
            ("busy superstates", self.busy_superstates, 20),
            ("idle superstates", self.idle_superstates, 50),
            ("timeouts of simple states", self.timeouts[0], 100),
            ("timeouts of task states", self.timeouts[1], 100),
            ("timeouts of superstates", self.timeouts[2], 50),
            ("exits of task states", self.exits_of_tasks, 100),
            ("exits of superstates", self.exits_of_superstates, 50),
            (
                "events with numbers from 32 on",
                self.events_beyond_a_word,
                100,
            ),
            (
                "events with a number that is that of another modulo 32",
                self.events_that_collide,
                100,
            ),
            (
                "transitions of region instances from the 32nd on",
                self.regions_beyond_a_word,
                1_000,
            ),
            ("transitions in a row of bits", self.in_rows, 200),
            ("in a row of cleared bits", self.in_rows_of_clear, 50),
            ("at the end of a row", self.at_ends_of_rows, 50),
            ("from the third of a row on", self.far_in_rows, 5),
            ("behind a row", self.behind_rows, 20),
            ("in a row of a state with timeout", self.in_timed_rows, 50),
            ("of a task to itself that send", self.entered_again, 100),
            (
                "superstates left whose regions span words",
                self.superstates_left_across_words,
                20,
            ),
            (
                "superstates entered whose regions span words",
                self.superstates_entered_across_words,
                50,
            ),
            ("deep transitions", self.deep, 10),
        ];
        for (what, found, least) in least {
            assert!(
                found >= least,
                "the runs have {found} {what}, too few to say much: {self:?}"
            );
        }
    }
}

/// The flags that a guard reads, each with the value that it is wanted with, and whether the guard
/// is their conjunction.
fn literals<'g>(guard: &'g Guard, value: bool, into: &mut Vec<(&'g Guard, bool)>) -> bool {
    match guard {
        Guard::Not(inner) => literals(inner, !value, into),
        Guard::And(terms) | Guard::Or(terms) => {
            let joins = matches!(guard, Guard::And(_)) == value;
            let all = terms.iter().map(|term| literals(term, value, into));
            all.fold(joins, |all, one| all && one)
        }
        flag => {
            into.push((flag, value));
            true
        }
    }
}

/// The place of a flag among those of its own state; none for those of the superstate around, and
/// for busy of a superstate.
fn place(flag: &Guard, state: &State) -> Option<usize> {
    match (flag, &state.kind) {
        (Guard::Timeout, StateKind::Simple) => Some(0),
        (_, StateKind::Simple) => None,
        (Guard::Exit, _) => Some(0),
        (Guard::Timeout, _) => Some(1),
        (Guard::Busy, StateKind::Task { .. }) => Some(2),
        (Guard::Own(flag), StateKind::Task { .. }) => Some(3 + flag),
        (Guard::Own(flag), StateKind::Super { .. }) => Some(2 + flag),
        _ => None,
    }
}

/// Added to the place of a flag that is wanted reset. Places up to it are all taken: what is always
/// wanted stands behind the last of them.
const IF_CLEAR: usize = WINDOW_FLAGS + 1;

/// The bit that a guard asks for, if it asks for one alone.
fn place_of_bit(transition: &Transition, state: &State) -> Option<usize> {
    let guard = match (transition.trigger, &transition.guard) {
        (Trigger::Star, _) => &Guard::Exit,
        (_, Some(guard)) => guard,
        (_, None) => return Some(IF_CLEAR + WINDOW_FLAGS),
    };
    let mut flags = Vec::new();
    literals(guard, true, &mut flags);
    let [(flag, value)] = flags[..] else {
        return None;
    };
    let place = place(flag, state).filter(|&place| place < WINDOW_FLAGS)?;
    Some(if value { place } else { IF_CLEAR + place })
}

/// The number of each event in a blob: that of its first mention in the instance tree, from 1.
fn event_numbers(model: &Model) -> HashMap<usize, usize> {
    let mut numbers = HashMap::new();
    let mut seen = Vec::new();
    visit(model, model.machine.unwrap_or(0), &mut seen);
    for container in seen {
        for listed in &model.containers[container].events {
            let next = numbers.len() + 1;
            numbers.entry(listed.event).or_insert(next);
        }
    }
    numbers
}

/// Puts a container and all that it uses in the order of their first use.
fn visit(model: &Model, container: usize, seen: &mut Vec<usize>) {
    if seen.contains(&container) {
        return;
    }
    seen.push(container);
    let regions = model.containers[container].regions.iter();
    for state in regions.flat_map(|region| &region.states) {
        if let StateKind::Super { container } = state.kind {
            visit(model, container, seen);
        }
    }
}
