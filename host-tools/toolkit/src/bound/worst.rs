//! The most that a macro step of a mission can take.
//!
//! Of the states of a region one is current, of the regions of a container all are, as long as no
//! superstate around them takes a transition. So for one event the most is found on the instance
//! tree from the inside out: of each region the state, and of that the transition, that make it and
//! all inside take longest. Which events one macro step can have follows from who sends what on
//! what: where that is no circle, an event's own visits and the events that these send are added up
//! from the last events to the pulse. Where events cause each other in a circle, or are more than a
//! macro step may have, the limit of micro steps is what ends it.
//!
//! Flags and the history of states are left out of it: each event finds all regions in the states
//! that are worst for it. So the sum is never too small, and may be too large.

use std::collections::{BTreeMap, BTreeSet};

use esm_core::MAX_MICRO_STEPS;

use super::costs::Costs;
use super::machine::{Machine, Trigger};

/// Steps that finding the worst events may take: beyond them, any event counts as the worst of all.
pub const MAX_STEPS: usize = 20_000_000;

/// The most that a macro step takes, and what it is made of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Bound {
    /// Instructions.
    pub instructions: u64,
    /// Events that the macro step has, the pulse included.
    pub micro_steps: u64,
    /// Where these come from.
    pub events: Events,
    /// What it is made of, the pulse first.
    pub parts: Vec<Part>,
}

/// Why a macro step has no more events.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Events {
    /// No event causes itself, so this is all that the pulse can lead to.
    Counted,
    /// They cause each other in a circle: the limit of micro steps ends it.
    Circle,
    /// There are more than a macro step may have.
    Limited,
    /// The mission is too large to tell its events apart: the limit of micro steps, with the worst
    /// of all events.
    TooLarge,
}

/// One event of it, and how often it comes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    /// The event.
    pub trigger: Trigger,
    /// How often.
    pub times: u64,
    /// Instructions that one takes.
    pub instructions: u64,
    /// The regions that it visits, in the order of the instance tree.
    pub shares: Vec<Share>,
}

/// What a region does with an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Share {
    /// The region instance.
    pub region: usize,
    /// Its current state.
    pub state: usize,
    /// The transition that it takes, if it takes one.
    pub transition: Option<usize>,
    /// Instructions.
    pub instructions: u64,
}

/// What is worst for one event.
struct Evaluated {
    /// With all that follows.
    total: u64,
    /// By region instance.
    choices: BTreeMap<usize, Choice>,
}

/// What is inside a container instance.
#[derive(Clone, Copy, Default)]
struct Inside {
    /// Where it is visited.
    total: u64,
    /// Where it is not: for the timers of its states, which are looked at all the same.
    timers: u64,
}

#[derive(Clone, Copy)]
struct Choice {
    share: Share,
    /// With what is inside and what follows.
    total: u64,
}

/// The most that a macro step of this machine takes.
#[must_use]
pub fn bound(machine: &Machine, costs: &Costs) -> Bound {
    let search = Search { machine, costs };
    let Some(order) = search.order() else {
        return search.limited(&[Trigger::Any], Events::TooLarge);
    };
    let triggers: Vec<Trigger> = order
        .channels
        .iter()
        .map(|it| Trigger::Channel(*it))
        .collect();
    if order.has_circle {
        return search.limited(&triggers, Events::Circle);
    }
    // The number of events is a sum as that of instructions is, with 1 for each.
    let mut events = vec![0_u64; machine.channels.len()];
    for &channel in &order.channels {
        let follow = search.most_events(Trigger::Channel(channel), &events);
        if let Some(events) = events.get_mut(channel) {
            *events = follow.saturating_add(1);
        }
    }
    let most_events = search.most_events(Trigger::Pulse, &events);
    if most_events >= u64::from(MAX_MICRO_STEPS) {
        return search.limited(&triggers, Events::Limited);
    }
    let mut totals = vec![0_u64; machine.channels.len()];
    for &channel in &order.channels {
        let evaluated = search.evaluate(Trigger::Channel(channel), &totals);
        if let Some(total) = totals.get_mut(channel) {
            *total = search
                .own(Trigger::Channel(channel))
                .saturating_add(evaluated.total);
        }
    }
    let mut parts = Vec::new();
    let mut times = vec![0_u64; machine.channels.len()];
    let backwards = order.channels.iter().rev().map(|it| Trigger::Channel(*it));
    let mut micro_steps = 0_u64;
    let mut instructions = 0;
    for trigger in std::iter::once(Trigger::Pulse).chain(backwards) {
        let count = match trigger {
            Trigger::Channel(channel) => times.get(channel).copied().unwrap_or_default(),
            Trigger::Pulse | Trigger::Any => 1,
        };
        if count == 0 {
            continue;
        }
        let evaluated = search.evaluate(trigger, &totals);
        if trigger == Trigger::Pulse {
            instructions = search.own(trigger).saturating_add(evaluated.total);
        }
        let part = search.part(trigger, count, &evaluated);
        for share in &part.shares {
            for channel in search.sent(share) {
                if let Some(times) = times.get_mut(channel) {
                    *times = times.saturating_add(count);
                }
            }
        }
        micro_steps = micro_steps.saturating_add(count);
        parts.push(part);
    }
    if most_events > machine.queue_capacity as u64 {
        instructions = instructions.saturating_add(search.fault());
    }
    Bound {
        instructions,
        micro_steps,
        events: Events::Counted,
        parts,
    }
}

struct Search<'m> {
    machine: &'m Machine,
    costs: &'m Costs,
}

/// The channels on which events can be sent.
struct Order {
    /// Each behind all that it leads to, if there is no circle.
    channels: Vec<usize>,
    has_circle: bool,
}

impl Search<'_> {
    /// The channels that the pulse leads to; none if finding what is worst for each takes more than
    /// [`MAX_STEPS`].
    fn order(&self) -> Option<Order> {
        #[derive(Clone, Copy, PartialEq)]
        enum Mark {
            New,
            Open,
            Done,
        }
        let machine = self.machine;
        // Each is looked at for its successors, the number of events, what they take, and what that
        // is made of.
        const LOOKS: usize = 4;
        let mut steps_left = MAX_STEPS;
        let mut marks = vec![Mark::New; machine.channels.len()];
        let mut channels = Vec::new();
        let mut has_circle = false;
        let mut open: Vec<(Option<usize>, std::collections::btree_set::IntoIter<usize>)> =
            vec![(None, self.successors(Trigger::Pulse).into_iter())];
        while let Some((channel, successors)) = open.last_mut() {
            let Some(next) = successors.next() else {
                if let Some(done) = *channel {
                    if let Some(mark) = marks.get_mut(done) {
                        *mark = Mark::Done;
                    }
                    channels.push(done);
                }
                open.pop();
                continue;
            };
            let Some(mark) = marks.get_mut(next) else {
                continue;
            };
            match *mark {
                Mark::New => {
                    *mark = Mark::Open;
                    let trigger = Trigger::Channel(next);
                    steps_left = steps_left.checked_sub(LOOKS * self.size(trigger))?;
                    open.push((Some(next), self.successors(trigger).into_iter()));
                }
                Mark::Open => has_circle = true,
                Mark::Done => {}
            }
        }
        Some(Order {
            channels,
            has_circle,
        })
    }

    /// States and transitions of the regions that an event is shown.
    fn size(&self, trigger: Trigger) -> usize {
        let machine = self.machine;
        let regions = self.looked_at(trigger).into_iter();
        let of_region = regions.filter_map(|index| {
            let states = machine.regions.get(index)?.states.clone();
            let states = machine.states.get(states)?.iter();
            let of_state = states.map(|it| 1 + it.on_events.end - it.on_pulse.start);
            Some(of_state.sum::<usize>())
        });
        of_region.sum()
    }

    /// The regions that are shown an event and those around them, in ascending order.
    fn looked_at(&self, trigger: Trigger) -> BTreeSet<usize> {
        let machine = self.machine;
        let mut regions: BTreeSet<usize> = machine.listeners(trigger).into_iter().collect();
        for index in regions.clone() {
            let mut around = machine.around(index);
            while let Some(outer) = around.filter(|outer| regions.insert(*outer)) {
                around = machine.around(outer);
            }
        }
        regions
    }

    /// The channels that transitions on an event can send on.
    fn successors(&self, trigger: Trigger) -> BTreeSet<usize> {
        let machine = self.machine;
        let mut found = BTreeSet::new();
        for index in machine.listeners(trigger) {
            let Some(region) = machine.regions.get(index) else {
                continue;
            };
            let states = machine
                .states
                .get(region.states.clone())
                .unwrap_or_default();
            for state in states.iter().filter(|state| state.is_reachable) {
                for at in machine.transitions_on(state, trigger) {
                    if let Some(transition) = machine.transitions.get(at)
                        && machine.is_on(transition, trigger)
                    {
                        found.extend(machine.sent(index, transition));
                    }
                }
            }
        }
        found
    }

    /// What an event takes besides its visits.
    fn own(&self, trigger: Trigger) -> u64 {
        let mut sum = self.costs.sum();
        match trigger {
            Trigger::Pulse => {
                self.machine.step(&mut sum);
                self.machine.pulse(&mut sum, None);
                if self.has_timers() {
                    self.machine.timers(&mut sum);
                }
            }
            Trigger::Channel(channel) => self.machine.event(&mut sum, channel, None),
            Trigger::Any => {
                // Of all channels the worst.
                let of_channel = |channel| {
                    let mut sum = self.costs.sum();
                    self.machine.event(&mut sum, channel, None);
                    sum.instructions
                };
                let all = (0..self.machine.channels.len()).map(of_channel);
                sum.instructions = all.max().unwrap_or_default();
            }
        }
        sum.instructions
    }

    fn fault(&self) -> u64 {
        let mut sum = self.costs.sum();
        let together = self
            .machine
            .instances
            .first()
            .map_or(0, |it| it.tasks_together);
        self.machine.fault(&mut sum, together);
        self.machine.unfinished(&mut sum);
        sum.instructions
    }

    /// The most events that can follow from one, where `events` says how many each channel leads
    /// to.
    fn most_events(&self, trigger: Trigger, events: &[u64]) -> u64 {
        let costs = Costs::default();
        let search = Search {
            machine: self.machine,
            costs: &costs,
        };
        search.evaluate(trigger, events).total
    }

    /// Whether any state that can be current has a timeout.
    fn has_timers(&self) -> bool {
        let mut states = self.machine.states.iter();
        states.any(|it| it.is_reachable && it.timeout_us.is_some())
    }

    /// Finds what is worst for one event, where each event that is sent takes what `follows` says
    /// of its channel.
    fn evaluate(&self, trigger: Trigger, follows: &[u64]) -> Evaluated {
        let machine = self.machine;
        let shown: BTreeSet<usize> = machine.listeners(trigger).into_iter().collect();
        let mut choices = BTreeMap::new();
        // By container instance, the sum over its regions.
        let mut inside: BTreeMap<usize, Inside> = BTreeMap::new();
        // What is inside a region has higher numbers than it.
        for &index in self.looked_at(trigger).iter().rev() {
            let Some(region) = machine.regions.get(index) else {
                continue;
            };
            let mut best: Option<Choice> = None;
            let mut most_timers = 0;
            for place in region.states.clone() {
                let Some(state) = machine.states.get(place).filter(|it| it.is_reachable) else {
                    continue;
                };
                let within = machine.inside(index, state);
                let within = within.and_then(|instance| inside.get(&instance).copied());
                let within = within.unwrap_or_default();
                let mut timer = self.costs.sum();
                if trigger == Trigger::Pulse && state.timeout_us.is_some() {
                    machine.timer_runs(&mut timer, index, true);
                }
                let timer = timer.instructions;
                most_timers = most_timers.max(timer.saturating_add(within.timers));
                let mut consider = |instructions: u64, transition, more: u64| {
                    let instructions = instructions.saturating_add(timer);
                    let total = instructions.saturating_add(more);
                    if best.is_none_or(|best| total > best.total) {
                        let share = Share {
                            region: index,
                            state: place,
                            transition,
                            instructions,
                        };
                        best = Some(Choice { share, total });
                    }
                };
                if !shown.contains(&index) {
                    consider(0, None, within.total);
                    continue;
                }
                let mut looked = self.costs.sum();
                machine.visit(&mut looked, state, trigger);
                let mut is_left = false;
                for at in machine.transitions_on(state, trigger) {
                    let Some(transition) = machine.transitions.get(at) else {
                        break;
                    };
                    machine.look(&mut looked, index, transition, trigger);
                    if !machine.is_on(transition, trigger) {
                        continue;
                    }
                    let mut taken = looked.clone();
                    machine.take(&mut taken, index, state, transition, None);
                    let sent = machine.sent(index, transition);
                    let follow = sent.filter_map(|channel| follows.get(channel).copied());
                    // What is inside is not visited, but its timers were looked at before.
                    let own = taken.instructions.saturating_add(within.timers);
                    consider(own, Some(at), follow.fold(0, u64::saturating_add));
                    if transition.guard.is_always_true() && trigger != Trigger::Any {
                        is_left = true;
                        break;
                    }
                }
                if !is_left {
                    consider(looked.instructions, None, within.total);
                }
            }
            if let Some(best) = best {
                let sum = inside.entry(region.instance).or_default();
                sum.total = sum.total.saturating_add(best.total);
                sum.timers = sum.timers.saturating_add(most_timers);
                choices.insert(index, best);
            }
        }
        Evaluated {
            total: inside.get(&0).map_or(0, |inside| inside.total),
            choices,
        }
    }

    /// The channels that a region sends on in this choice.
    fn sent(&self, share: &Share) -> Vec<usize> {
        let transition = share
            .transition
            .and_then(|it| self.machine.transitions.get(it));
        transition.map_or_else(Vec::new, |transition| {
            self.machine.sent(share.region, transition).collect()
        })
    }

    /// The regions that an event visits when it finds what is worst.
    fn part(&self, trigger: Trigger, times: u64, evaluated: &Evaluated) -> Part {
        let machine = self.machine;
        // From the outside to the inside: what is inside a state is a part only where that takes no
        // transition.
        let mut shares = Vec::new();
        let mut open: BTreeSet<usize> = machine.regions_of(0).collect();
        while let Some(index) = open.pop_first() {
            let Some(choice) = evaluated.choices.get(&index) else {
                continue;
            };
            if choice.share.instructions > 0 {
                shares.push(choice.share);
            }
            let state = machine.states.get(choice.share.state);
            let inside = state.and_then(|state| machine.inside(index, state));
            if let (None, Some(inside)) = (choice.share.transition, inside) {
                open.extend(machine.regions_of(inside));
            }
        }
        let visits = shares.iter().map(|share| share.instructions);
        Part {
            trigger,
            times,
            instructions: visits.fold(self.own(trigger), u64::saturating_add),
            shares,
        }
    }

    /// The bound where the limit of micro steps is what ends a macro step: each event after the
    /// pulse is the worst of these.
    fn limited(&self, triggers: &[Trigger], events: Events) -> Bound {
        let nothing = vec![0; self.machine.channels.len()];
        let pulse = self.evaluate(Trigger::Pulse, &nothing);
        let mut parts = vec![self.part(Trigger::Pulse, 1, &pulse)];
        let others = u64::from(MAX_MICRO_STEPS) - 1;
        let worst = triggers
            .iter()
            .map(|&trigger| {
                (
                    self.own(trigger) + self.evaluate(trigger, &nothing).total,
                    trigger,
                )
            })
            // The first of equals.
            .reduce(|best, next| if next.0 > best.0 { next } else { best });
        if let Some((_, trigger)) = worst {
            let evaluated = self.evaluate(trigger, &nothing);
            parts.push(self.part(trigger, others, &evaluated));
        }
        let instructions = parts.iter().fold(self.fault(), |sum, part| {
            sum.saturating_add(part.instructions.saturating_mul(part.times))
        });
        Bound {
            instructions,
            micro_steps: 1 + others,
            events,
            parts,
        }
    }
}
