//! The meaning of a machine, by the shortest route from its definition.
//!
//! Everything here is a tree that is walked by recursion: an instance of a container has regions, a
//! region has its states, a superstate has the instance inside it. Nothing is prepared, packed or
//! remembered. That makes it slow, needs memory without bound, and makes it easy to hold beside the
//! algorithm of Merz, Rudol and Wzorek (2006, Fig. 4):
//!
//! ```text
//! macro step at t                                 visit(instance C, event)
//!   queue := [ pulse ]                              for each region of C, in source order
//!   while queue is not empty                          s := current local state; note its timeout
//!     event := first of queue, removed                x := first transition of s on `event` whose guard is true
//!     visit(root, event)                              take x, or else visit(inside of s, event)
//! ```

use std::collections::{BTreeSet, VecDeque};
use std::fmt::Write as _;
use std::ops::Range;

use host_tools::model::{
    Action, Container, Guard, Model, SlotRef, Source, StateKind, Target, Transition, Trigger,
};

use crate::scenario::{self, Scenario};

/// A macro step has at most this many micro steps.
const MICRO_STEP_LIMIT: usize = 255;

/// What came of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// The trace, one JSON object a line.
    pub trace: Vec<String>,
    /// Indices into [`Scenario::entries`] of the expectations that did not hold, ascending.
    pub failed: Vec<usize>,
}

/// A transition that was taken, with what was so when it was: for tests that count how often what
/// matters happened.
#[derive(Clone, Debug)]
pub struct Taken<'m> {
    /// The transition.
    pub transition: &'m Transition,
    /// The container that it is written in.
    pub container: &'m Container,
    /// The region that it is written in.
    pub region: &'m host_tools::model::Region,
    /// The region instances of that container's instance, and those inside of it. The first belongs
    /// to no other instance.
    pub instance: Range<usize>,
    /// The region instance, numbered depth first.
    pub region_number: usize,
    /// Superstates around it.
    pub depth: usize,
    /// The number of the macro step.
    pub step: u64,
    /// The region instances inside the superstate that was left, and inside the one that was
    /// entered.
    pub inside: [Range<usize>; 2],
    /// Whether `timeout` of the source read true, and whether `busy` did.
    pub timeout: bool,
    /// See `timeout`.
    pub busy: bool,
}

/// Runs the machine of `model` under `scenario` from t = 0 to its end, or to the first fault.
///
/// # Panics
/// Where the model has no machine, or the scenario names what the machine does not have: both are
/// made by the tests themselves.
pub fn run(model: &Model, scenario: &Scenario) -> Outcome {
    run_noting(model, scenario).0
}

/// [`run`], and all transitions that were taken.
///
/// # Panics
/// As [`run`] does.
pub fn run_noting<'m>(model: &'m Model, scenario: &Scenario) -> (Outcome, Vec<Taken<'m>>) {
    let interpreter_slot = model.interpreter_slot.expect("an interpreter slot");
    let period_us = scenario
        .period_us
        .unwrap_or(u64::from(model.slots[interpreter_slot].period_us));
    let mut machine = Machine::new(model);
    let mut failed = BTreeSet::new();
    let mut order: Vec<usize> = (0..scenario.entries.len()).collect();
    order.sort_by_key(|&entry| scenario.entries[entry].at_us);
    let mut waiting: VecDeque<usize> = order.into();

    for step in 0..=scenario.until_us / period_us {
        let t_us = step * period_us;
        let mut expectations = Vec::new();
        while let Some(&entry) = waiting.front()
            && scenario.entries[entry].at_us <= t_us
        {
            waiting.pop_front();
            match &scenario.entries[entry].action {
                scenario::Action::Expect { .. } => expectations.push(entry),
                change => machine.change(change),
            }
        }
        if let Err(fault) = machine.macro_step(step, t_us) {
            machine.trace.push(format!(
                r#"{{"kind":"fault","step":{step},"t_us":{t_us},"code":"{}"}}"#,
                fault.code()
            ));
            failed.extend(expectations);
            break;
        }
        failed.extend(
            expectations
                .into_iter()
                .filter(|&entry| !machine.holds(&scenario.entries[entry].action)),
        );
    }
    failed.extend(waiting.into_iter().filter(|&entry| {
        matches!(
            scenario.entries[entry].action,
            scenario::Action::Expect { .. }
        )
    }));
    let outcome = Outcome {
        trace: machine.trace,
        failed: failed.into_iter().collect(),
    };
    (outcome, machine.taken)
}

/// Runs the machine of `model` for some macro steps. Before each, `choose` is told which states are
/// active and what changes would make a part of some guard true that is false, and says what
/// changes.
///
/// # Panics
/// Where the model has no machine, or a change names what it does not have.
pub fn steer(
    model: &Model,
    period_us: u64,
    steps: u64,
    mut choose: impl FnMut(u64, &[String], &[scenario::Action]) -> Vec<scenario::Action>,
) {
    let mut machine = Machine::new(model);
    for step in 0..steps {
        let mut wishes = Vec::new();
        machine.add_wishes(ROOT, &mut wishes);
        for change in choose(step, &machine.active(), &wishes) {
            machine.change(&change);
        }
        if machine.macro_step(step, step * period_us).is_err() {
            return;
        }
    }
}

/// Paths of all states of the machine in the order of the instance tree, pseudo-states included,
/// each with what it is.
pub fn states(model: &Model) -> Vec<(String, Option<StateKind>)> {
    let machine = Machine::new(model);
    let mut found = Vec::new();
    machine.list_states(ROOT, &mut found);
    found
}

/// Why a run ended early.
#[derive(Clone, Copy, Debug)]
enum Fault {
    EventQueueOverflow,
    MacroStepLimit,
}

impl Fault {
    fn code(self) -> &'static str {
        match self {
            Fault::EventQueueOverflow => "event-queue-overflow",
            Fault::MacroStepLimit => "macro-step-limit",
        }
    }
}

/// The instance of the machine itself.
const ROOT: usize = 0;

/// What a region is in.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Local {
    Initial,
    State(usize),
    Final,
}

/// A state of a region of an instance.
#[derive(Clone, Copy, Debug)]
struct Place {
    instance: usize,
    region: usize,
    state: usize,
}

/// An instance of a container.
struct Instance {
    container: usize,
    /// The superstate that holds it; none for the root.
    holder: Option<Place>,
    /// Path of the holder with a `/` behind it; empty for the root.
    prefix: String,
    regions: Vec<Region>,
    /// Numbers of its region instances and of those inside of it.
    region_numbers: Range<usize>,
}

/// A region of an instance, now.
struct Region {
    /// All regions are numbered depth first.
    number: usize,
    current: Local,
    start_us: u64,
    states: Vec<State>,
}

/// A state of an instance, now. It keeps its flags while it is not current.
struct State {
    exit: bool,
    timeout: bool,
    busy: bool,
    /// One a flag of its task or container.
    control: Vec<bool>,
    /// Task states only.
    enabled: bool,
    /// Superstates only: the instance inside.
    inside: Option<usize>,
}

/// What stands in the queue.
struct Event {
    /// Index into the model's events; none for the pulse.
    name: Option<usize>,
    /// The instances in which it is visible; of no use for the pulse, which is visible in all.
    visible_in: BTreeSet<usize>,
}

struct Machine<'m> {
    model: &'m Model,
    instances: Vec<Instance>,
    queue: VecDeque<Event>,
    step: u64,
    micro: usize,
    t_us: u64,
    trace: Vec<String>,
    taken: Vec<Taken<'m>>,
    /// Regions made so far.
    regions: usize,
}

impl<'m> Machine<'m> {
    fn new(model: &'m Model) -> Self {
        let mut machine = Machine {
            model,
            instances: Vec::new(),
            queue: VecDeque::new(),
            step: 0,
            micro: 0,
            t_us: 0,
            trace: Vec::new(),
            taken: Vec::new(),
            regions: 0,
        };
        machine.instantiate(model.machine.expect("a machine"), None, String::new());
        machine
    }

    /// Makes the instance of `container` and, depth first, everything inside it; gives its index.
    fn instantiate(&mut self, container: usize, holder: Option<Place>, prefix: String) -> usize {
        let model = self.model;
        let instance = self.instances.len();
        self.instances.push(Instance {
            container,
            holder,
            prefix: prefix.clone(),
            regions: Vec::new(),
            region_numbers: self.regions..self.regions,
        });
        for (region, declared) in model.containers[container].regions.iter().enumerate() {
            self.instances[instance].regions.push(Region {
                number: self.regions,
                current: Local::Initial,
                start_us: 0,
                states: Vec::new(),
            });
            self.regions += 1;
            for (state, declared_state) in declared.states.iter().enumerate() {
                let here = Place {
                    instance,
                    region,
                    state,
                };
                let (flags, inside) = match &declared_state.kind {
                    StateKind::Simple => (0, None),
                    StateKind::Task { task, .. } => (model.tasks[*task].flags.len(), None),
                    StateKind::Super { container } => (
                        model.containers[*container].flags.len(),
                        Some(self.instantiate(
                            *container,
                            Some(here),
                            format!("{prefix}{}/{}/", declared.name, declared_state.name),
                        )),
                    ),
                };
                self.instances[instance].regions[region].states.push(State {
                    exit: false,
                    timeout: false,
                    busy: false,
                    control: vec![false; flags],
                    enabled: false,
                    inside,
                });
            }
        }
        self.instances[instance].region_numbers.end = self.regions;
        instance
    }

    // ---- The algorithm --------------------------------------------------------------------------

    fn macro_step(&mut self, step: u64, t_us: u64) -> Result<(), Fault> {
        (self.step, self.micro, self.t_us) = (step, 0, t_us);
        self.queue.push_back(Event {
            name: None,
            visible_in: BTreeSet::new(),
        });
        while let Some(event) = self.queue.pop_front() {
            if self.micro == MICRO_STEP_LIMIT {
                return Err(Fault::MacroStepLimit);
            }
            self.visit(ROOT, &event)?;
            self.micro += 1;
        }
        let line = format!(
            r#"{{"kind":"step","step":{step},"t_us":{t_us},"micro_steps":{},"active":{},"enabled":{}}}"#,
            self.micro,
            json_list(&self.active()),
            json_list(&self.enabled()),
        );
        self.trace.push(line);
        Ok(())
    }

    fn visit(&mut self, instance: usize, event: &Event) -> Result<(), Fault> {
        let container = self.container(instance);
        for (region, declared) in container.regions.iter().enumerate() {
            let now = &self.instances[instance].regions[region];
            let (source, current_place) = match now.current {
                Local::Final => continue, // can only be entered
                Local::Initial => (Source::Initial, None),
                Local::State(state) => (
                    Source::State(state),
                    Some(Place {
                        instance,
                        region,
                        state,
                    }),
                ),
            };
            if let Some(place) = current_place
                && let Some(limit_us) = declared.states[place.state].timeout_us
                && self.t_us - now.start_us > u64::from(limit_us)
            {
                self.state_mut(place).timeout = true;
            }
            let taken = declared.transitions.iter().find(|transition| {
                transition.source == source
                    && triggers(transition, event, instance)
                    && self.guard_of(transition, instance, current_place)
            });
            if let Some(transition) = taken {
                self.take(transition, instance, region, event)?;
            } else if let Some(place) = current_place
                && let Some(inside) = self.state(place).inside
            {
                self.visit(inside, event)?;
            }
        }
        Ok(())
    }

    fn take(
        &mut self,
        transition: &'m Transition,
        instance: usize,
        region: usize,
        event: &Event,
    ) -> Result<(), Fault> {
        let sends = |action: &&Action| matches!(action, Action::Send(_));
        let capacity = usize::from(self.model.queue);
        if self.queue.len() + transition.actions.iter().filter(sends).count() > capacity {
            return Err(Fault::EventQueueOverflow);
        }
        self.note(transition, instance, region);

        if let Source::State(state) = transition.source {
            self.disable(Place {
                instance,
                region,
                state,
            });
        }
        let target = match transition.target {
            Target::Final => None,
            Target::State(state) => Some(Place {
                instance,
                region,
                state,
            }),
        };
        if let Some(place) = target {
            let entered = self.state_mut(place);
            (entered.exit, entered.timeout, entered.busy) = (false, false, false);
            entered.control.fill(false);
        }

        let (mut sent, mut set, mut cleared) = (Vec::new(), Vec::new(), Vec::new());
        for action in &transition.actions {
            let (place, flag, value) = match *action {
                Action::Send(name) => {
                    sent.push(self.model.events[name].clone());
                    let visible_in = self.visible_in(instance, name);
                    self.queue.push_back(Event {
                        name: Some(name),
                        visible_in,
                    });
                    continue;
                }
                Action::Own(flag, value) => (target.expect("a target with flags"), flag, value),
                Action::Parent(flag, value) => (self.holder(instance), flag, value),
            };
            self.state_mut(place).control[flag] = value;
            let written = if value { &mut set } else { &mut cleared };
            written.push(self.flag_path(place, flag));
        }
        self.write_transition(transition, instance, region, event, &sent, &set, &cleared);

        match target {
            None => {
                if let Some(holder) = self.instances[instance].holder {
                    self.state_mut(holder).exit = true;
                }
            }
            Some(place) if matches!(self.kind(place), StateKind::Task { .. }) => {
                self.state_mut(place).enabled = true;
            }
            Some(_) => {}
        }
        let t_us = self.t_us;
        let now = &mut self.instances[instance].regions[region];
        now.start_us = t_us;
        now.current = target.map_or(Local::Final, |place| Local::State(place.state));
        if let Some(inside) = target.and_then(|place| self.state(place).inside) {
            for region in &mut self.instances[inside].regions {
                region.current = Local::Initial;
                region.start_us = t_us;
            }
        }
        Ok(())
    }

    /// Keeps that a transition is about to be taken.
    fn note(&mut self, transition: &'m Transition, instance: usize, region: usize) {
        let place = |state| Place {
            instance,
            region,
            state,
        };
        let source = match transition.source {
            Source::Initial => None,
            Source::State(state) => Some(place(state)),
        };
        let target = match transition.target {
            Target::Final => None,
            Target::State(state) => Some(place(state)),
        };
        let inside = |place: Option<Place>| {
            let inside = place.and_then(|place| self.state(place).inside);
            inside.map_or(0..0, |inside| self.instances[inside].region_numbers.clone())
        };
        let container = self.container(instance);
        self.taken.push(Taken {
            transition,
            container,
            region: &container.regions[region],
            instance: self.instances[instance].region_numbers.clone(),
            region_number: self.instances[instance].regions[region].number,
            depth: self.instances[instance].prefix.matches('/').count() / 2,
            step: self.step,
            inside: [inside(source), inside(target)],
            timeout: source.is_some_and(|place| self.state(place).timeout),
            busy: source.is_some_and(|place| self.busy(place)),
        });
    }

    /// Disables the state if it is a real-time task state, and every such state that is active
    /// inside it.
    fn disable(&mut self, place: Place) {
        match self.kind(place) {
            StateKind::Simple => {}
            StateKind::Task { slot, .. } => {
                if *slot != SlotRef::NonRealTime {
                    self.state_mut(place).enabled = false;
                }
            }
            StateKind::Super { .. } => {
                for inner in self.current_inside(place) {
                    self.disable(inner);
                }
            }
        }
    }

    /// The instances in which `name`, sent in `sender`, is visible: the least set that the rules of
    /// forwarding allow.
    fn visible_in(&self, sender: usize, name: usize) -> BTreeSet<usize> {
        let lists = |instance: usize, forwarded: fn(bool, bool) -> bool| {
            self.container(instance).events.iter().any(|listed| {
                listed.event == name && forwarded(listed.forwarded_in, listed.forwarded_out)
            })
        };
        let mut visible = BTreeSet::from([sender]);
        loop {
            let before = visible.len();
            for (index, instance) in self.instances.iter().enumerate() {
                let Some(holder) = instance.holder else {
                    continue;
                };
                if visible.contains(&index) && lists(index, |_, out| out) {
                    visible.insert(holder.instance);
                }
                if visible.contains(&holder.instance) && lists(index, |into, _| into) {
                    visible.insert(index);
                }
            }
            if visible.len() == before {
                return visible;
            }
        }
    }

    fn guard_of(&self, transition: &Transition, instance: usize, source: Option<Place>) -> bool {
        if transition.trigger == Trigger::Star {
            return self.state(source.expect("a source with an exit flag")).exit;
        }
        transition
            .guard
            .as_ref()
            .is_none_or(|guard| self.is_true(guard, instance, source))
    }

    fn is_true(&self, guard: &Guard, instance: usize, source: Option<Place>) -> bool {
        let source_state = || source.expect("a source with flags");
        match guard {
            Guard::Exit => self.state(source_state()).exit,
            Guard::Timeout => self.state(source_state()).timeout,
            Guard::Busy => self.busy(source_state()),
            Guard::Own(flag) => self.state(source_state()).control[*flag],
            Guard::Parent(flag) => self.state(self.holder(instance)).control[*flag],
            Guard::Not(inner) => !self.is_true(inner, instance, source),
            Guard::And(terms) => terms
                .iter()
                .all(|term| self.is_true(term, instance, source)),
            Guard::Or(terms) => terms
                .iter()
                .any(|term| self.is_true(term, instance, source)),
        }
    }

    /// Of a task state its own flag, of a superstate that of any active task state inside.
    fn busy(&self, place: Place) -> bool {
        match self.kind(place) {
            StateKind::Simple => false,
            StateKind::Task { .. } => self.state(place).busy,
            StateKind::Super { .. } => self
                .current_inside(place)
                .into_iter()
                .any(|inner| self.busy(inner)),
        }
    }

    // ---- From outside ---------------------------------------------------------------------------

    fn change(&mut self, action: &scenario::Action) {
        match action {
            scenario::Action::Write { state, flag, value } => {
                let place = self.find(state).expect("a state of the machine");
                let index = self.flag_index(place, flag).expect("a flag of the state");
                self.state_mut(place).control[index] = *value;
            }
            scenario::Action::Exit { state } => {
                let place = self.find(state).expect("a state of the machine");
                let finished = self.state_mut(place);
                finished.exit = true;
                finished.enabled = false;
            }
            scenario::Action::Busy { state, value } => {
                let place = self.find(state).expect("a state of the machine");
                self.state_mut(place).busy = *value;
            }
            scenario::Action::Expect { .. } => {}
        }
    }

    /// The changes from outside that would give a flag the value that a guard of a current state
    /// wants it to have.
    fn add_wishes(&self, instance: usize, wishes: &mut Vec<scenario::Action>) {
        let regions = &self.container(instance).regions;
        for (region, now) in self.instances[instance].regions.iter().enumerate() {
            let Local::State(state) = now.current else {
                continue;
            };
            let place = Place {
                instance,
                region,
                state,
            };
            for transition in &regions[region].transitions {
                if transition.source != Source::State(state) {
                    continue;
                }
                match &transition.guard {
                    Some(guard) => self.add_wish(guard, true, place, wishes),
                    None if transition.trigger == Trigger::Star => {
                        self.add_wish(&Guard::Exit, true, place, wishes);
                    }
                    None => {}
                }
            }
            if let Some(inside) = now.states[state].inside {
                self.add_wishes(inside, wishes);
            }
        }
    }

    fn add_wish(
        &self,
        guard: &Guard,
        value: bool,
        place: Place,
        wishes: &mut Vec<scenario::Action>,
    ) {
        match (guard, self.kind(place)) {
            (Guard::Not(inner), _) => self.add_wish(inner, !value, place, wishes),
            (Guard::And(terms) | Guard::Or(terms), _) => {
                for term in terms {
                    self.add_wish(term, value, place, wishes);
                }
            }
            (Guard::Busy, StateKind::Super { .. }) => {
                for inner in self.current_inside(place) {
                    self.add_wish(guard, value, inner, wishes);
                }
            }
            (flag, StateKind::Task { .. })
                if self.is_true(flag, place.instance, Some(place)) != value =>
            {
                let state =
                    self.local_path(place.instance, place.region, Local::State(place.state));
                match flag {
                    Guard::Exit if value => wishes.push(scenario::Action::Exit { state }),
                    Guard::Busy => wishes.push(scenario::Action::Busy { state, value }),
                    Guard::Own(flag) => wishes.push(scenario::Action::Write {
                        state,
                        flag: self.flag_names(place)[*flag].to_owned(),
                        value,
                    }),
                    _ => {}
                }
            }
            _ => {}
        }
    }

    fn holds(&self, expectation: &scenario::Action) -> bool {
        let scenario::Action::Expect { state, flag, value } = expectation else {
            return true;
        };
        let found = match flag {
            None => self.active().contains(state),
            Some(flag) => {
                let place = self.find(state).expect("a state of the machine");
                match flag.as_str() {
                    "exit" => self.state(place).exit,
                    "timeout" => self.state(place).timeout,
                    // Nothing inside a superstate that is not current is active.
                    "busy" => match self.kind(place) {
                        StateKind::Super { .. } => {
                            self.active().contains(state) && self.busy(place)
                        }
                        _ => self.busy(place),
                    },
                    name => {
                        self.state(place).control
                            [self.flag_index(place, name).expect("a flag of the state")]
                    }
                }
            }
        };
        found == *value
    }

    // ---- The trace ------------------------------------------------------------------------------

    #[allow(clippy::too_many_arguments)] // each is one field of the line
    fn write_transition(
        &mut self,
        transition: &Transition,
        instance: usize,
        region: usize,
        event: &Event,
        sent: &[String],
        set: &[String],
        cleared: &[String],
    ) {
        let from = match transition.source {
            Source::Initial => Local::Initial,
            Source::State(state) => Local::State(state),
        };
        let to = match transition.target {
            Target::Final => Local::Final,
            Target::State(state) => Local::State(state),
        };
        let mut line = String::new();
        write!(
            line,
            r#"{{"kind":"transition","step":{},"micro":{},"t_us":{},"event":"{}","from":"{}","to":"{}","sent":{},"set":{},"cleared":{}}}"#,
            self.step,
            self.micro,
            self.t_us,
            event.name.map_or("pulse", |name| &self.model.events[name]),
            self.local_path(instance, region, from),
            self.local_path(instance, region, to),
            json_list(sent),
            json_list(set),
            json_list(cleared),
        )
        .expect("a string takes all that is written");
        self.trace.push(line);
    }

    fn active(&self) -> Vec<String> {
        let mut found = Vec::new();
        self.list_active(ROOT, &mut found);
        found
    }

    fn list_active(&self, instance: usize, found: &mut Vec<String>) {
        for (region, now) in self.instances[instance].regions.iter().enumerate() {
            found.push(self.local_path(instance, region, now.current));
            if let Local::State(state) = now.current
                && let Some(inside) = now.states[state].inside
            {
                self.list_active(inside, found);
            }
        }
    }

    fn enabled(&self) -> Vec<String> {
        let mut found = Vec::new();
        self.list_enabled(ROOT, &mut found);
        found
    }

    fn list_enabled(&self, instance: usize, found: &mut Vec<String>) {
        for (region, now) in self.instances[instance].regions.iter().enumerate() {
            for (state, state_now) in now.states.iter().enumerate() {
                if state_now.enabled {
                    found.push(self.local_path(instance, region, Local::State(state)));
                }
                if let Some(inside) = state_now.inside {
                    self.list_enabled(inside, found);
                }
            }
        }
    }

    fn list_states(&self, instance: usize, found: &mut Vec<(String, Option<StateKind>)>) {
        for (region, declared) in self.container(instance).regions.iter().enumerate() {
            for pseudo in [Local::Initial, Local::Final] {
                found.push((self.local_path(instance, region, pseudo), None));
            }
            for (state, declared_state) in declared.states.iter().enumerate() {
                let path = self.local_path(instance, region, Local::State(state));
                found.push((path, Some(declared_state.kind.clone())));
                if let Some(inside) = self.instances[instance].regions[region].states[state].inside
                {
                    self.list_states(inside, found);
                }
            }
        }
    }

    // ---- Names and places -----------------------------------------------------------------------

    fn container(&self, instance: usize) -> &'m Container {
        &self.model.containers[self.instances[instance].container]
    }

    fn state(&self, place: Place) -> &State {
        &self.instances[place.instance].regions[place.region].states[place.state]
    }

    fn state_mut(&mut self, place: Place) -> &mut State {
        &mut self.instances[place.instance].regions[place.region].states[place.state]
    }

    fn kind(&self, place: Place) -> &'m StateKind {
        &self.container(place.instance).regions[place.region].states[place.state].kind
    }

    /// The superstate that holds the instance: where `^` points.
    fn holder(&self, instance: usize) -> Place {
        self.instances[instance].holder.expect("no `^` at the root")
    }

    /// The current states (not the pseudo-states) directly inside a superstate.
    fn current_inside(&self, place: Place) -> Vec<Place> {
        let Some(instance) = self.state(place).inside else {
            return Vec::new();
        };
        let regions = self.instances[instance].regions.iter().enumerate();
        regions
            .filter_map(|(region, now)| match now.current {
                Local::State(state) => Some(Place {
                    instance,
                    region,
                    state,
                }),
                Local::Initial | Local::Final => None,
            })
            .collect()
    }

    fn local_path(&self, instance: usize, region: usize, local: Local) -> String {
        let declared = &self.container(instance).regions[region];
        let name = match local {
            Local::Initial => "initial",
            Local::Final => "final",
            Local::State(state) => &declared.states[state].name,
        };
        format!(
            "{}{}/{name}",
            self.instances[instance].prefix, declared.name
        )
    }

    fn flag_names(&self, place: Place) -> Vec<&'m str> {
        let flags = match self.kind(place) {
            StateKind::Simple => return Vec::new(),
            StateKind::Task { task, .. } => &self.model.tasks[*task].flags,
            StateKind::Super { container } => &self.model.containers[*container].flags,
        };
        flags.iter().map(|flag| flag.name.as_str()).collect()
    }

    fn flag_path(&self, place: Place, flag: usize) -> String {
        let state = self.local_path(place.instance, place.region, Local::State(place.state));
        format!("{state}.{}", self.flag_names(place)[flag])
    }

    fn flag_index(&self, place: Place, name: &str) -> Option<usize> {
        self.flag_names(place).iter().position(|flag| *flag == name)
    }

    fn find(&self, path: &str) -> Option<Place> {
        self.instances
            .iter()
            .enumerate()
            .flat_map(|(instance, now)| {
                now.regions
                    .iter()
                    .enumerate()
                    .flat_map(move |(region, now)| {
                        (0..now.states.len()).map(move |state| Place {
                            instance,
                            region,
                            state,
                        })
                    })
            })
            .find(|place| {
                self.local_path(place.instance, place.region, Local::State(place.state)) == path
            })
    }
}

/// Whether the event is the transition's and is visible where the transition is written.
fn triggers(transition: &Transition, event: &Event, instance: usize) -> bool {
    match (transition.trigger, event.name) {
        (Trigger::Pulse | Trigger::Star, None) => true,
        (Trigger::Event(wanted), Some(name)) => {
            wanted == name && event.visible_in.contains(&instance)
        }
        _ => false,
    }
}

/// `["a","b"]`. Names are identifiers, so nothing in them needs escaping.
fn json_list(names: &[String]) -> String {
    let quoted: Vec<String> = names.iter().map(|name| format!("\"{name}\"")).collect();
    format!("[{}]", quoted.join(","))
}
