//! A compiled mission as its interpreter walks it, and what each part of a walk consists of.
//!
//! Here alone is written down what the interpreter does for a visit, a guard, a transition, as a
//! list of [constructs](Construct). What it did in a macro step that was run
//! ([`tally`](super::tally)) and what it can do at most ([`worst`](super::worst)) are made of the
//! same lists.

use std::collections::BTreeMap;
use std::ops::Range;

use esm_core::tables::{self, Code, StateKind, Tables};

use super::costs::{Construct, Ledger};

/// What a region is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Trigger {
    /// The pulse.
    Pulse,
    /// An event that was sent on this channel.
    Channel(usize),
    /// An event, whichever: for what holds of all of them.
    Any,
}

/// The tables of a mission, read once.
#[derive(Clone, Debug)]
pub struct Machine {
    /// Region instances, depth first.
    pub(super) regions: Vec<Region>,
    /// States of all templates.
    pub(super) states: Vec<State>,
    /// Transitions of all templates.
    pub(super) transitions: Vec<Transition>,
    pub(super) instances: Vec<Instance>,
    pub(super) channels: Vec<Channel>,
    /// The region instances that listen, one list for all channels with the same.
    pub(super) rows: Vec<Vec<usize>>,
    pub(super) tasks: usize,
    pub(super) queue_capacity: usize,
}

/// A region instance.
#[derive(Clone, Debug)]
pub(super) struct Region {
    /// Its container instance.
    pub(super) instance: usize,
    /// The region instance that is not inside this one and comes next.
    pub(super) next: usize,
    /// Its states in the tables: `initial` is the first, `final` the last.
    pub(super) states: Range<usize>,
}

/// A container instance.
#[derive(Clone, Debug)]
pub(super) struct Instance {
    pub(super) first_region: usize,
    pub(super) first_channel: usize,
    /// The region instance that holds its superstate; none for the machine.
    pub(super) around: Option<usize>,
    /// Task instances inside, at any depth.
    pub(super) tasks: usize,
    /// The most of them that can be current at a time.
    pub(super) tasks_together: usize,
}

/// A state of a template.
#[derive(Clone, Debug)]
pub(super) struct State {
    pub(super) kind: Kind,
    pub(super) timeout_us: Option<u32>,
    /// Which events its transitions are on, as the interpreter looks first: by the remainders of
    /// their numbers by 32.
    pub(super) events: u32,
    /// Its flags, relative to the first one of its instance: entering it resets them.
    pub(super) flags: Range<usize>,
    /// Transitions on the pulse.
    pub(super) on_pulse: Range<usize>,
    /// Transitions on events.
    pub(super) on_events: Range<usize>,
    /// Whether transitions lead to it from `initial`, whatever their guards say.
    pub(super) is_reachable: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Initial,
    Final,
    Simple,
    Task,
    /// The container instance inside, relative to the one that holds it.
    Super {
        instance_offset: usize,
    },
}

/// A transition of a template.
#[derive(Clone, Debug)]
pub(super) struct Transition {
    pub(super) event: u16,
    pub(super) is_plain: bool,
    pub(super) target: usize,
    pub(super) guard: Guard,
    pub(super) actions: Vec<Action>,
    /// Whether the actions are a row, and not a single one that needs none.
    pub(super) has_row: bool,
}

/// What there is to evaluate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Guard {
    /// Nothing: it is true.
    True,
    /// One flag.
    Flag,
    /// Several flags at once.
    Mask,
    /// Tests, of which at most these are made on one way to its end.
    Program { tests: usize, busy_tests: usize },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Action {
    /// On this channel, relative to the instance's first.
    Send(usize),
    /// A flag of the target.
    WriteOwn,
    /// A flag of the superstate around.
    WriteAround,
}

/// An event as sent from one container instance.
#[derive(Clone, Debug)]
pub(super) struct Channel {
    pub(super) event: u16,
    /// Index into [`Machine::rows`].
    pub(super) row: usize,
    /// Words of that row.
    pub(super) words: usize,
}

/// Region instances in a word of the interpreter.
pub(super) const WORD_BITS: usize = 32;
/// Flags that are reset at once.
const RESET_BITS: usize = 25;
/// Bits of [`State::events`].
const EVENT_BITS: u16 = 32;
/// The bit of the pulse among them.
const PULSE_BIT: u32 = 1;

impl Machine {
    /// Reads the tables of a verified blob.
    #[must_use]
    pub fn of(tables: &Tables<'_>) -> Self {
        let mut states: Vec<State> = (0..tables.state_count())
            .map_while(|index| state(tables, index))
            .collect();
        let transitions: Vec<Transition> = (0..tables.transition_count())
            .map_while(|index| transition(tables, &states, index))
            .collect();
        mark_reachable(&mut states, &transitions);
        let regions: Vec<Region> = (0..tables.region_instance_count())
            .map_while(|index| {
                let region = tables.region_instance(index)?;
                let template = tables.region_of_state(region.initial);
                let end = tables
                    .region(template + 1)
                    .map_or(tables.state_count(), |next| next.first_state);
                Some(Region {
                    instance: region.instance,
                    next: region.next,
                    states: region.initial..end,
                })
            })
            .collect();
        let mut instances: Vec<Instance> = (0..tables.instance_count())
            .map_while(|index| {
                let instance = tables.instance(index)?;
                Some(Instance {
                    first_region: instance.first_region,
                    first_channel: instance.first_channel,
                    around: (index != 0).then_some(instance.around),
                    tasks: tables.tasks_inside(index).len(),
                    tasks_together: 0,
                })
            })
            .collect();
        count_tasks_together(&mut instances, &regions, &states);
        let (channels, rows) = channels(tables);
        Machine {
            regions,
            states,
            transitions,
            instances,
            channels,
            rows,
            tasks: tables.task_instance_count(),
            queue_capacity: tables.queue_capacity(),
        }
    }

    // ─── What it consists of ─────────────────────────────────────────────────────────────────────

    /// Beginning and end of a macro step.
    pub(super) fn step(&self, ledger: &mut impl Ledger) {
        ledger.add(Construct::Quiet, 1);
    }

    /// Beginning and end of the pulse, where anything is awake. `visits`: words of which some are
    /// visited; as many as there can be, where that is not known.
    pub(super) fn pulse(&self, ledger: &mut impl Ledger, visits: Option<usize>) {
        let words = words(0..self.regions.len());
        ledger.add(Construct::Step, 1);
        ledger.add(Construct::PulseWord, words);
        ledger.add(Construct::PulseWordVisit, visits.unwrap_or(words));
    }

    /// A look at all timers, without those that run.
    pub(super) fn timers(&self, ledger: &mut impl Ledger) {
        ledger.add(Construct::Timers, 1);
        ledger.add(Construct::TimerRegion, self.regions.len());
    }

    /// A timer that runs, of the current state of a region instance.
    pub(super) fn timer_runs(&self, ledger: &mut impl Ledger, index: usize, is_due: bool) {
        ledger.add(Construct::TimerRuns, 1);
        if is_due && let Some(region) = self.regions.get(index) {
            ledger.add(Construct::WakeWord, words(index..region.next));
        }
    }

    /// Whatever an event takes besides visits. `visits`: as in [`Self::pulse`].
    pub(super) fn event(&self, ledger: &mut impl Ledger, channel: usize, visits: Option<usize>) {
        let words = self.channels.get(channel).map_or(0, |it| it.words);
        ledger.add(Construct::Event, 1);
        ledger.add(Construct::EventWord, words);
        ledger.add(Construct::EventWordVisit, visits.unwrap_or(words));
    }

    /// A machine that ends by a fault, in the midst of a transition.
    pub(super) fn fault(&self, ledger: &mut impl Ledger, disabled: usize) {
        ledger.add(Construct::Fault, 1);
        ledger.add(Construct::TaskInside, self.tasks);
        ledger.add(Construct::TaskDisabled, disabled);
    }

    /// The transitions of a state that are looked at.
    pub(super) fn transitions_on(&self, state: &State, trigger: Trigger) -> Range<usize> {
        match trigger {
            Trigger::Pulse => state.on_pulse.clone(),
            Trigger::Any => state.on_events.clone(),
            Trigger::Channel(channel) => {
                let event = self.channels.get(channel).map_or(0, |it| it.event);
                if state.events >> (event % EVENT_BITS) & 1 == 0 {
                    0..0
                } else {
                    state.on_events.clone()
                }
            }
        }
    }

    /// Whether a transition is on what a region is shown.
    pub(super) fn is_on(&self, transition: &Transition, trigger: Trigger) -> bool {
        match trigger {
            Trigger::Pulse | Trigger::Any => true,
            Trigger::Channel(channel) => self
                .channels
                .get(channel)
                .is_some_and(|channel| channel.event == transition.event),
        }
    }

    /// A visit of a region in a state, up to its transitions.
    pub(super) fn visit(&self, ledger: &mut impl Ledger, state: &State, trigger: Trigger) {
        match trigger {
            Trigger::Pulse => {
                ledger.add(Construct::PulseVisit, 1);
            }
            Trigger::Channel(_) | Trigger::Any => {
                ledger.add(Construct::Listener, 1);
                let waits = !self.transitions_on(state, trigger).is_empty();
                ledger.add(Construct::EventVisit, usize::from(waits));
            }
        }
    }

    /// A look at a transition of a region instance, its guard included.
    pub(super) fn look(
        &self,
        ledger: &mut impl Ledger,
        index: usize,
        transition: &Transition,
        trigger: Trigger,
    ) {
        ledger.add(
            match trigger {
                Trigger::Pulse => Construct::PulseTransition,
                Trigger::Channel(_) | Trigger::Any => Construct::EventTransition,
            },
            1,
        );
        if !self.is_on(transition, trigger) {
            return;
        }
        match transition.guard {
            Guard::True => {}
            Guard::Flag => {
                let on_event = usize::from(trigger != Trigger::Pulse);
                ledger.add(Construct::FlagGuard, on_event);
            }
            Guard::Mask => ledger.add(Construct::MaskGuard, 1),
            Guard::Program { tests, busy_tests } => {
                ledger.add(Construct::Program, 1);
                ledger.add(Construct::Test, tests);
                ledger.add(Construct::BusyTest, busy_tests);
                let inside = match self.regions.get(index) {
                    Some(region) => region.next.saturating_sub(index + 1),
                    None => 0,
                };
                ledger.add(Construct::BusyRegion, busy_tests * inside);
            }
        }
    }

    /// A transition that a region instance takes: out of `left`, its actions, into its target.
    /// `disabled`: tasks inside a superstate that are disabled; as many as there can be, where that
    /// is not known.
    pub(super) fn take(
        &self,
        ledger: &mut impl Ledger,
        index: usize,
        left: &State,
        transition: &Transition,
        disabled: Option<usize>,
    ) {
        if transition.is_plain {
            // Of those that are plain, only a task state that is entered anew sends.
            let is_again = !transition.actions.is_empty();
            let construct = if is_again {
                Construct::Again
            } else {
                Construct::Plain
            };
            ledger.add(construct, 1);
            return;
        }
        ledger.add(Construct::Taken, 1);
        let (Some(region), Some(entered)) =
            (self.regions.get(index), self.states.get(transition.target))
        else {
            return;
        };
        match left.kind {
            Kind::Task => ledger.add(Construct::LeaveTask, 1),
            Kind::Super { instance_offset } => {
                ledger.add(Construct::LeaveSuper, 1);
                ledger.add(Construct::LeaveWord, words(index + 1..region.next));
                if let Some(inside) = self.instances.get(region.instance + instance_offset) {
                    ledger.add(Construct::TaskInside, inside.tasks);
                    ledger.add(
                        Construct::TaskDisabled,
                        disabled.unwrap_or(inside.tasks_together),
                    );
                }
            }
            Kind::Initial | Kind::Final | Kind::Simple => {}
        }
        let resets = entered.flags.len().div_ceil(RESET_BITS);
        ledger.add(Construct::MoreFlags, resets.saturating_sub(1));
        ledger.add(Construct::Row, usize::from(transition.has_row));
        for action in &transition.actions {
            match action {
                Action::Send(_) if transition.has_row => ledger.add(Construct::RowSend, 1),
                Action::Send(_) => ledger.add(Construct::Send, 1),
                Action::WriteOwn => ledger.add(Construct::RowWrite, 1),
                Action::WriteAround => {
                    ledger.add(Construct::RowWrite, 1);
                    ledger.add(Construct::WriteAround, 1);
                    let woken = words(self.woken_with(region.instance));
                    ledger.add(Construct::WakeWord, woken);
                }
            }
        }
        let is_timed = entered.timeout_us.is_some();
        ledger.add(Construct::EnterTimed, usize::from(is_timed));
        match entered.kind {
            Kind::Task => ledger.add(Construct::EnterTask, 1),
            Kind::Final => {
                ledger.add(Construct::EnterFinal, 1);
                let woken = words(self.woken_with(region.instance));
                ledger.add(Construct::WakeWord, woken);
            }
            Kind::Super { instance_offset } => {
                ledger.add(Construct::EnterSuper, 1);
                let inside = self.regions_of(region.instance + instance_offset).count();
                ledger.add(Construct::RegionInside, inside);
            }
            Kind::Initial | Kind::Simple => {}
        }
    }

    // ─── How it is connected ─────────────────────────────────────────────────────────────────────

    /// The region instances that are shown an event, in ascending order; for the pulse and for any
    /// event, all of them.
    pub(super) fn listeners(&self, trigger: Trigger) -> Vec<usize> {
        let row = match trigger {
            Trigger::Pulse | Trigger::Any => None,
            Trigger::Channel(channel) => self.channels.get(channel),
        };
        match row {
            Some(channel) => self.rows.get(channel.row).cloned().unwrap_or_default(),
            None => (0..self.regions.len()).collect(),
        }
    }

    /// The region instance around another.
    pub(super) fn around(&self, index: usize) -> Option<usize> {
        self.instances
            .get(self.regions.get(index)?.instance)?
            .around
    }

    /// The region instances that are woken when a flag of a container instance's superstate is
    /// written.
    pub(super) fn woken_with(&self, instance: usize) -> Range<usize> {
        let around = self.instances.get(instance).and_then(|it| it.around);
        match around.and_then(|around| Some((around, self.regions.get(around)?))) {
            Some((around, region)) => around..region.next,
            None => 0..self.regions.len(),
        }
    }

    /// The channels that a transition of a region instance sends on.
    pub(super) fn sent<'m>(
        &'m self,
        index: usize,
        transition: &'m Transition,
    ) -> impl Iterator<Item = usize> + 'm {
        let instance = self.regions.get(index).map_or(0, |region| region.instance);
        let first = self
            .instances
            .get(instance)
            .map_or(0, |it| it.first_channel);
        transition
            .actions
            .iter()
            .filter_map(move |action| match action {
                Action::Send(channel) => Some(first + channel),
                Action::WriteOwn | Action::WriteAround => None,
            })
    }

    /// The regions of a container instance, without those inside them.
    pub(super) fn regions_of(&self, instance: usize) -> impl Iterator<Item = usize> + '_ {
        let mut next = self.instances.get(instance).map(|it| it.first_region);
        std::iter::from_fn(move || {
            let at = next?;
            let region = self.regions.get(at).filter(|it| it.instance == instance)?;
            next = Some(region.next);
            Some(at)
        })
    }

    /// The container instance inside a state of a region instance, if that is a superstate.
    pub(super) fn inside(&self, index: usize, state: &State) -> Option<usize> {
        let Kind::Super { instance_offset } = state.kind else {
            return None;
        };
        Some(self.regions.get(index)?.instance + instance_offset)
    }
}

/// The words that have bits of these region instances.
pub(super) fn words(regions: Range<usize>) -> usize {
    if regions.is_empty() {
        return 0;
    }
    regions.end.div_ceil(WORD_BITS) - regions.start / WORD_BITS
}

impl State {
    /// Whether it is looked at on the pulse once it is entered.
    pub(super) fn wakes_itself(&self) -> bool {
        self.events & PULSE_BIT != 0
    }
}

impl Guard {
    /// Whether it is true whatever the flags are, so that no transition behind it on the same event
    /// is ever looked at.
    pub(super) fn is_always_true(self) -> bool {
        matches!(
            self,
            Guard::True
                | Guard::Program {
                    tests: 0,
                    busy_tests: 0
                }
        )
    }
}

// ─── Reading it ──────────────────────────────────────────────────────────────────────────────────

fn state(tables: &Tables<'_>, index: usize) -> Option<State> {
    let state = tables.state(index)?;
    let all = tables.transitions_of(index);
    Some(State {
        kind: match state.kind {
            StateKind::Initial => Kind::Initial,
            StateKind::Final => Kind::Final,
            StateKind::Simple => Kind::Simple,
            StateKind::Task { .. } => Kind::Task,
            StateKind::Super { instance_offset } => Kind::Super { instance_offset },
        },
        timeout_us: state.timeout_us,
        events: state.events,
        flags: state.first_flag..state.first_flag + state.flags,
        on_pulse: all.start..state.first_event_transition,
        on_events: state.first_event_transition..all.end,
        is_reachable: false,
    })
}

fn transition(tables: &Tables<'_>, states: &[State], index: usize) -> Option<Transition> {
    let transition = tables.transition(index)?;
    let guard = match tables.guard_of(index)? {
        tables::Guard::True => Guard::True,
        tables::Guard::Flag { .. } => Guard::Flag,
        tables::Guard::Mask { .. } => Guard::Mask,
        tables::Guard::Program { .. } => {
            let tests = tables.program_of(index).filter_map(|code| match code {
                Code::Test { jump, .. } => Some((false, jump)),
                Code::TestBusyInside { jump, .. } => Some((true, jump)),
                Code::Send { .. } | Code::Write { .. } | Code::End => None,
            });
            let (tests, busy_tests) = longest(&tests.collect::<Vec<_>>());
            Guard::Program { tests, busy_tests }
        }
    };
    let own = states.get(transition.target)?.flags.clone();
    let actions = tables.actions_of(index).filter_map(|code| match code {
        Code::Send { channel, .. } => Some(Action::Send(channel)),
        Code::Write { flag, .. } if own.contains(&flag) => Some(Action::WriteOwn),
        Code::Write { .. } => Some(Action::WriteAround),
        Code::Test { .. } | Code::TestBusyInside { .. } | Code::End => None,
    });
    Some(Transition {
        event: transition.event,
        is_plain: transition.is_plain,
        target: transition.target,
        guard,
        actions: actions.collect(),
        has_row: transition.action != esm_core::format::ACTION_NONE
            && transition.action < esm_core::format::ACTION_SEND,
    })
}

/// All channels, and the lists of region instances that listen to them, each list once.
fn channels(tables: &Tables<'_>) -> (Vec<Channel>, Vec<Vec<usize>>) {
    let mut rows = Vec::new();
    let mut known: BTreeMap<(usize, usize, usize), usize> = BTreeMap::new();
    let channels = (0..tables.channel_count()).map_while(|index| {
        let channel = tables.channel(index)?;
        let place = (
            channel.first_row_word,
            channel.first_region_word,
            channel.region_words,
        );
        let row = *known.entry(place).or_insert_with(|| {
            let first = WORD_BITS * channel.first_region_word;
            let regions = first..first + WORD_BITS * channel.region_words;
            rows.push(
                regions
                    .filter(|region| tables.is_listening(&channel, *region))
                    .collect(),
            );
            rows.len() - 1
        });
        Some(Channel {
            event: channel.event,
            row,
            words: channel.region_words,
        })
    });
    (channels.collect(), rows)
}

/// The most tests of flags, and the most of what is busy inside, that one way through a program
/// makes. A test either goes on to the next one or jumps ahead.
fn longest(tests: &[(bool, Option<usize>)]) -> (usize, usize) {
    let mut most = vec![(0, 0); tests.len() + 1];
    for (at, &(is_busy, jump)) in tests.iter().enumerate().rev() {
        let from = |place: usize| most.get(place).copied().unwrap_or_default();
        let (next, jumped): ((usize, usize), _) =
            (from(at + 1), jump.map_or((0, 0), |jump| from(at + jump)));
        let (plain, busy) = (next.0.max(jumped.0), next.1.max(jumped.1));
        if let Some(place) = most.get_mut(at) {
            *place = (plain + usize::from(!is_busy), busy + usize::from(is_busy));
        }
    }
    most.first().copied().unwrap_or_default()
}

/// Marks the states that transitions lead to from `initial`, whatever their guards say.
fn mark_reachable(states: &mut [State], transitions: &[Transition]) {
    let mut open: Vec<usize> = (0..states.len())
        .filter(|&state| matches!(states.get(state).map(|it| it.kind), Some(Kind::Initial)))
        .collect();
    while let Some(index) = open.pop() {
        let Some(state) = states.get_mut(index).filter(|state| !state.is_reachable) else {
            continue;
        };
        state.is_reachable = true;
        let targets = transitions.get(state.on_pulse.start..state.on_events.end);
        open.extend(targets.unwrap_or_default().iter().map(|it| it.target));
    }
}

/// Finds for each instance how many tasks inside can be current at a time: of a region one state,
/// of a container all regions.
fn count_tasks_together(instances: &mut [Instance], regions: &[Region], states: &[State]) {
    // What is inside a region has higher numbers than it, so it is added up before.
    for region in regions.iter().rev() {
        let of_state = |state: &State| match state.kind {
            Kind::Task => 1,
            Kind::Super { instance_offset } => instances
                .get(region.instance + instance_offset)
                .map_or(0, |inside| inside.tasks_together),
            Kind::Initial | Kind::Final | Kind::Simple => 0,
        };
        let states = states.get(region.states.clone()).unwrap_or_default();
        let most = states
            .iter()
            .filter(|it| it.is_reachable)
            .map(of_state)
            .max();
        if let Some(instance) = instances.get_mut(region.instance) {
            instance.tasks_together += most.unwrap_or_default();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_way_through_a_program_goes_on_or_jumps_ahead() {
        let cases = [
            (vec![], (0, 0)),
            (vec![(false, None)], (1, 0)),
            (vec![(false, None), (false, None)], (2, 0)),
            (vec![(false, Some(2)), (true, None), (false, None)], (2, 1)),
            (vec![(true, Some(1)), (true, None)], (0, 2)),
        ];
        for (tests, expected) in cases {
            assert_eq!(longest(&tests), expected, "{tests:?}");
        }
    }

    #[test]
    fn a_range_of_regions_touches_the_words_that_have_its_bits() {
        let cases = [
            (0..0, 0),
            (0..1, 1),
            (0..32, 1),
            (0..33, 2),
            (31..33, 2),
            (32..64, 1),
            (5..5, 0),
        ];
        for (regions, expected) in cases {
            assert_eq!(words(regions.clone()), expected, "{regions:?}");
        }
    }
}
