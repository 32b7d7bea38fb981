//! Random machines as `.esm` text, and random scenarios for them.
//!
//! A machine is free of errors by construction: every name it uses is defined, every flag is used
//! in its direction, containers are used downwards only. Within that it uses the whole language,
//! and is biased towards what is easy to get wrong: containers used many times, events that travel
//! up and down through several of them, queues of one or two places, transitions that send in a
//! circle, several regions that write one flag, timeouts that fall on a macro step exactly. Some
//! machines have many of a thing, so that no word of bits is enough for it: flags of a state,
//! events, regions.

use std::fmt::Write as _;

use host_tools::model::{Direction, Model, StateKind};

use crate::random::Random;
use crate::reference;
use crate::scenario::{Action, Entry, Scenario};

/// How large a machine and its scenario become at most.
#[derive(Clone, Copy, Debug)]
pub struct Size {
    /// Container instances, so that a run stays short.
    instances: usize,
    /// Containers of most machines.
    containers: usize,
    /// Containers of a machine in which they are nested deeply.
    nested: usize,
    /// Regions of a container.
    regions: usize,
    /// Regions of the machine, where it has many.
    many_regions: usize,
    /// States of a region.
    states: usize,
    /// Macro steps of a scenario.
    steps: usize,
}

/// Machines in which all that belongs together meets, in numbers.
pub const FULL: Size = Size {
    instances: 160,
    containers: 5,
    nested: 30,
    regions: 4,
    many_regions: 24,
    states: 5,
    steps: 60,
};

/// Machines of which many a second can be made and run, as a fuzzer wants them.
pub const SMALL: Size = Size {
    instances: 16,
    containers: 3,
    nested: 6,
    regions: 2,
    many_regions: 12,
    states: 4,
    steps: 20,
};

/// Control flags, events and so on draw their names from small pools, so that one name means
/// different things in different places.
const FLAG_NAMES: [&str; 5] = ["near", "far", "ready", "us", "f32"];
const EVENT_NAMES: [&str; 6] = ["Go", "Back", "Up", "Down", "ms", "Hz"];

/// Flags of a task or container that has many, besides those with a name. One task has no more
/// than 16.
const MORE_FLAGS: usize = 11;

/// Events of a machine that has many. A few are used more than the others: these, and those whose
/// numbers differ from theirs by a multiple of 32.
const MANY_EVENTS: usize = 80;
const HOT_EVENTS: [usize; 2] = [3, 32];
const EVENTS_A_WORD: usize = 32;

/// Flags of a state that can be looked at together.
const WINDOW_FLAGS: usize = 15;

/// Levels of `and`, `or` and `not` in a guard.
const GUARD_DEPTH: usize = 3;

/// A flag of a task or container.
#[derive(Clone)]
struct Flag {
    name: String,
    out: bool,
}

struct Task {
    name: String,
    flags: Vec<Flag>,
    params: Vec<&'static str>,
    has_slot: bool,
}

struct Container {
    name: String,
    flags: Vec<Flag>,
    /// Container instances that one use of it makes, itself included.
    instances: usize,
}

/// What a state offers to the transitions around it.
#[derive(Clone)]
struct Offer {
    /// The flags of a task state or superstate.
    flags: Option<Vec<Flag>>,
    has_timeout: bool,
    is_task: bool,
}

/// The text of the machine that belongs to `seed`. One declaration a line, so that lines can be
/// taken away one by one.
pub fn machine(seed: u64) -> String {
    machine_of(&mut Random::new(seed), FULL)
}

/// The text of the machine that a source of random numbers decides on.
pub fn machine_of(random: &mut Random, size: Size) -> String {
    Writer {
        random,
        size,
        text: String::new(),
        tasks: Vec::new(),
        containers: Vec::new(),
        with_data: false,
        with_many_flags: false,
        with_many_regions: false,
        event_names: EVENT_NAMES.map(str::to_owned).to_vec(),
    }
    .write()
}

struct Writer<'r> {
    random: &'r mut Random,
    size: Size,
    text: String,
    tasks: Vec<Task>,
    /// In the order of the file; each uses only those before it.
    containers: Vec<Container>,
    with_data: bool,
    with_many_flags: bool,
    with_many_regions: bool,
    event_names: Vec<String>,
}

impl Writer<'_> {
    fn write(mut self) -> String {
        self.with_data = self.random.chance(25);
        self.with_many_flags = self.random.chance(25);
        self.with_many_regions = self.random.chance(10);
        if self.random.chance(15) {
            self.event_names = (1..=MANY_EVENTS)
                .map(|number| format!("E{number}"))
                .collect();
        }
        self.line(format_args!("interpreter slot 1;"));
        let queue = match self.random.below(10) {
            0 => None,
            1..=3 => Some(self.random.between(1, 3)),
            4..=8 => Some(self.random.between(4, 40)),
            _ => Some(255),
        };
        if let Some(queue) = queue {
            self.line(format_args!("queue {queue};"));
        }
        self.write_slots();
        for index in 0..self.random.between(1, 4) {
            self.write_task(index);
        }
        if self.with_data {
            self.line(format_args!("task Source slot 2 {{"));
            self.line(format_args!("  out data value: Sample;"));
            self.line(format_args!("}}"));
        }
        let deep = self.random.chance(10);
        let containers = if deep {
            self.size.nested
        } else {
            self.random.between(0, self.size.containers)
        };
        for index in 0..containers {
            self.write_container(format!("Part{index}"), false, deep);
        }
        self.write_container("Machine".to_owned(), true, deep);
        self.text
    }

    fn line(&mut self, line: std::fmt::Arguments<'_>) {
        writeln!(self.text, "{line}").expect("a string takes all that is written");
    }

    fn write_slots(&mut self) {
        // Periods are multiples of the interpreter's and durations a small part of them, so that a
        // schedule always exists.
        let period_us = *self
            .random
            .pick(&[1_000, 5_000, 10_000, 7_777, 300])
            .expect("not empty");
        let duration_us = period_us / 5;
        let rate = match period_us {
            5_000 => Some(200),
            10_000 => Some(100),
            _ => None,
        };
        match rate {
            Some(rate) if self.random.chance(50) => self.line(format_args!(
                "slot 1 rate {rate} Hz duration {duration_us} us;"
            )),
            _ => self.line(format_args!(
                "slot 1 period {period_us} us duration {duration_us}us;"
            )),
        }
        let factor = self.random.between(1, 3);
        self.line(format_args!(
            "slot 2 period {} us duration {duration_us} us;",
            period_us * factor
        ));
        self.line(format_args!(
            "slot 7 period {} us duration {duration_us} us;",
            period_us * factor * 2
        ));
    }

    fn flags(&mut self) -> Vec<Flag> {
        let (more, percent, outs) = if self.with_many_flags && self.random.chance(75) {
            (MORE_FLAGS, 95, 85)
        } else {
            (0, 45, 60)
        };
        let more = (0..more).map(|number| format!("flag{number}"));
        let names: Vec<String> = FLAG_NAMES
            .into_iter()
            .map(str::to_owned)
            .chain(more)
            .collect();
        let mut flags = Vec::new();
        for name in names {
            if self.random.chance(percent) {
                let out = self.random.chance(outs);
                flags.push(Flag { name, out });
            }
        }
        flags
    }

    fn write_flags(&mut self, flags: &[Flag]) {
        for flag in flags {
            let direction = if flag.out { "out" } else { "in" };
            self.line(format_args!("  {direction} flag {};", flag.name));
        }
    }

    fn write_task(&mut self, index: usize) {
        let name = format!("Task{index}");
        let slot = match self.random.below(5) {
            0 => None,
            1 => Some(0),
            2 | 3 => Some(2),
            _ => Some(7),
        };
        let mut head = format!("task {name}");
        if let Some(slot) = slot {
            write!(head, " slot {slot}").expect("a string takes all that is written");
        }
        if self.random.chance(20) {
            head.push_str(" exclusive motors");
        }
        if self.random.chance(20) {
            head.push_str(" wcet 1 us");
        }
        // More than there ever are. No choice of chance, so that what was found with a seed is
        // found again.
        if index % 5 == 4 {
            head.push_str(" count 1000000");
        }
        self.line(format_args!("{head} {{"));
        let flags = self.flags();
        self.write_flags(&flags);
        if self.with_data {
            self.line(format_args!("  in data value: Sample optional;"));
        }
        let mut params = Vec::new();
        if self.random.chance(20) {
            self.line(format_args!("  param gain: f32 = 0.5 min -1 max 2.5;"));
            self.line(format_args!("  param count: i32 min -7 max 7;"));
            params = vec!["count"];
        }
        self.line(format_args!("}}"));
        self.tasks.push(Task {
            name,
            flags,
            params,
            has_slot: slot.is_some(),
        });
    }

    fn write_container(&mut self, name: String, is_machine: bool, deep: bool) {
        let keyword = if is_machine { "machine" } else { "container" };
        self.line(format_args!("{keyword} {name} {{"));
        let mut events = Vec::new();
        let is_wide = self.event_names.len() > EVENT_NAMES.len();
        let percent = match is_machine {
            true if is_wide => 100,
            true => 70,
            false => 55,
        };
        for event in self.event_names.clone() {
            if !self.random.chance(percent) {
                continue;
            }
            events.push(event.clone());
            if is_machine {
                self.line(format_args!("  event {event};"));
                continue;
            }
            let (into, out) = match self.random.below(4) {
                0 => (true, false),
                1 => (false, true),
                2 => (true, true),
                _ => (false, false),
            };
            if !into && !out {
                self.line(format_args!("  event {event};"));
            }
            if into {
                self.line(format_args!("  in event {event};"));
            }
            if out {
                self.line(format_args!("  out event {event};"));
            }
        }
        let flags = if is_machine { Vec::new() } else { self.flags() };
        self.write_flags(&flags);

        let mut instances = 1;
        let regions = if is_machine && self.with_many_regions {
            self.random
                .between(self.size.many_regions / 2, self.size.many_regions)
        } else {
            // What goes on beside would stop many a deep machine before it is far down.
            let most = if deep { 2 } else { self.size.regions };
            self.random.between(1, most.min(self.size.regions))
        };
        let mut task_states = Vec::new();
        for region in 0..regions {
            self.line(format_args!("  region r{region} {{"));
            let states = self.write_states(deep, region, &mut instances);
            for (state, offer) in states.iter().enumerate() {
                if offer.is_task {
                    task_states.push(format!("r{region}.s{state}.value"));
                }
            }
            self.write_transitions(&states, &events, &flags, deep && region == 0);
            self.line(format_args!("  }}"));
        }
        if self.with_data {
            self.line(format_args!("  region source {{"));
            self.line(format_args!("    task Only: Source;"));
            self.line(format_args!("    initial -> Only;"));
            self.line(format_args!("  }}"));
            if !task_states.is_empty() {
                self.line(format_args!(
                    "  path Only.value -> {};",
                    task_states.join(", ")
                ));
            }
        }
        self.line(format_args!("}}"));
        self.containers.push(Container {
            name,
            flags,
            instances,
        });
    }

    /// Writes the states of a region.
    fn write_states(&mut self, deep: bool, region: usize, instances: &mut usize) -> Vec<Offer> {
        let offer = |flags, has_timeout, is_task| Offer {
            flags,
            has_timeout,
            is_task,
        };
        let mut states = Vec::new();
        for state in 0..self.random.between(1, self.size.states) {
            let timeout = match self.random.below(10) {
                // Limits near small multiples of the period, where "strictly above" matters.
                0..=2 => {
                    let limit_us = self
                        .random
                        .pick(&[0, 999, 1_000, 5_000, 9_999, 10_000, 15_554, 20_000, 600])
                        .copied()
                        .unwrap_or(0);
                    format!(" timeout {limit_us} us")
                }
                3 if self.random.chance(20) => " timeout 4000 s".to_owned(),
                3 => format!(" timeout {} ms", self.random.between(1, 50)),
                _ => String::new(),
            };
            let has_timeout = !timeout.is_empty();
            let must_nest = deep && region == 0 && state == 0;
            let nest = must_nest || self.random.chance(if deep { 4 } else { 35 });
            let fitting: Vec<usize> = (0..self.containers.len())
                .filter(|&index| {
                    *instances + self.containers[index].instances <= self.size.instances
                })
                .collect();
            let chosen = if must_nest {
                fitting.last().copied()
            } else {
                self.random.pick(&fitting).copied()
            };
            if let Some(container) = chosen.filter(|_| nest) {
                let inside = &self.containers[container];
                *instances += inside.instances;
                let flags = Some(inside.flags.clone());
                let name = inside.name.clone();
                self.line(format_args!("    super s{state}: {name}{timeout};"));
                states.push(offer(flags, has_timeout, false));
            } else if self.random.chance(60) {
                let index = self.random.below(self.tasks.len());
                let task = &self.tasks[index];
                let (name, has_slot) = (task.name.clone(), task.has_slot);
                let has_params = !task.params.is_empty();
                let flags = Some(task.flags.clone());
                let slot = if !has_slot || self.random.chance(20) {
                    let slot = self.random.pick(&[0, 2, 7]).copied().unwrap_or(2);
                    format!(" slot {slot}")
                } else {
                    String::new()
                };
                let with = if has_params {
                    format!(" with {{ count = {} }}", self.random.below(8) as i32 - 4)
                } else {
                    String::new()
                };
                self.line(format_args!(
                    "    task s{state}: {name}{slot}{timeout}{with};"
                ));
                states.push(offer(flags, has_timeout, true));
            } else {
                self.line(format_args!("    state s{state}{timeout};"));
                states.push(offer(None, has_timeout, false));
            }
        }
        states
    }

    fn write_transitions(
        &mut self,
        states: &[Offer],
        events: &[String],
        parent_flags: &[Flag],
        goes_down: bool,
    ) {
        // The way in. Mostly unguarded, so that most of a machine is reached.
        let goes_straight = goes_down;
        for _ in 0..self.random.below(if goes_straight { 1 } else { 2 }) {
            self.write_transition(None, states, events, parent_flags);
        }
        // Down a machine that is nested deeply, its first state is the way.
        let first = if goes_straight {
            0
        } else {
            self.random.below(states.len())
        };
        let actions = if goes_straight {
            String::new()
        } else {
            self.actions(Some(&states[first]), events, parent_flags)
        };
        self.line(format_args!("    initial -> s{first}{actions};"));
        for source in 0..states.len() {
            if self.random.chance(15) {
                self.write_row(source, states, events, parent_flags);
            }
            let most = if events.len() > EVENT_NAMES.len() {
                7
            } else {
                4
            };
            for _ in 0..self.random.below(most) {
                self.write_transition(Some(source), states, events, parent_flags);
            }
        }
    }

    /// Writes transitions on the pulse that ask for one flag each, in the order of the flags: an
    /// interpreter may look at all of them at once. Some stay in their state and send.
    fn write_row(
        &mut self,
        source: usize,
        states: &[Offer],
        events: &[String],
        parent_flags: &[Flag],
    ) {
        let block = own_block(&states[source]);
        let first = match self.random.chance(40) {
            true => 0,
            false => self.random.below(block.len() + 1),
        };
        let not = if self.random.chance(40) { "not " } else { "" };
        let most = match self.random.chance(50) {
            true => block.len(),
            false => 3,
        };
        let readable = block.iter().skip(first).map_while(Option::as_ref);
        let mut guards: Vec<String> = readable
            .take(most)
            .map(|flag| format!(" [{not}{flag}]"))
            .collect();
        if self.random.chance(30) {
            guards.push(String::new());
        }
        for guard in guards {
            let (target, actions) = match self.event(events) {
                Some(event) if self.random.chance(50) => (source, format!(" / send {event}")),
                _ => {
                    let target = self.random.below(states.len());
                    let actions = self.actions(Some(&states[target]), events, parent_flags);
                    (target, actions)
                }
            };
            self.line(format_args!("    s{source} -> s{target}{guard}{actions};"));
        }
    }

    fn write_transition(
        &mut self,
        source: Option<usize>,
        states: &[Offer],
        events: &[String],
        parent_flags: &[Flag],
    ) {
        let offer = source.map(|source| &states[source]);
        let target = (!self.random.chance(8)).then(|| self.random.below(states.len()));
        let trigger = match self.random.below(10) {
            0 if offer.is_some_and(|offer| offer.flags.is_some()) => " on *".to_owned(),
            0..=2 => String::new(),
            3 => " on pulse".to_owned(),
            _ => match self.event(events) {
                Some(event) => format!(" on {event}"),
                None => String::new(),
            },
        };
        let on_pulse = !trigger.starts_with(" on ") || trigger.ends_with("pulse");
        // Unguarded pulses would hurry through the machine: most of them wait for something.
        let guard = if trigger != " on *" && self.random.chance(if on_pulse { 85 } else { 40 }) {
            self.guard(offer, parent_flags, GUARD_DEPTH)
                .map_or(String::new(), |guard| format!(" [{guard}]"))
        } else {
            String::new()
        };
        let actions = self.actions(target.map(|target| &states[target]), events, parent_flags);
        let source = source.map_or("initial".to_owned(), |source| format!("s{source}"));
        let target = target.map_or("final".to_owned(), |target| format!("s{target}"));
        self.line(format_args!(
            "    {source} -> {target}{trigger}{guard}{actions};"
        ));
    }

    /// One of the events that a container sees. Of many, mostly one of a few, so that what is sent
    /// is received.
    fn event<'e>(&mut self, events: &'e [String]) -> Option<&'e String> {
        let hot = if events.len() > EVENT_NAMES.len() && self.random.chance(90) {
            let turns = self.random.below(MANY_EVENTS / EVENTS_A_WORD) * EVENTS_A_WORD;
            let number = self.random.pick(&HOT_EVENTS).map_or(0, |hot| hot + turns);
            let name = format!("E{number}");
            events.iter().find(|event| **event == name)
        } else {
            None
        };
        hot.or_else(|| self.random.pick(events))
    }

    /// A conjunction of some of the flags of a source that a transition can read. Most are wanted
    /// reset, which they mostly are.
    fn conjunction(&mut self, source: &Offer) -> Option<String> {
        let mut flags = own_flags(source);
        // The last are those that are most often beyond what can be looked at together.
        let last = self.random.chance(40);
        if self.random.chance(60) {
            flags.truncate(WINDOW_FLAGS);
        }
        let mut terms = Vec::new();
        for _ in 0..self.random.between(2, 14) {
            if flags.is_empty() {
                break;
            }
            let place = match last {
                true => flags.len() - 1,
                false => self.random.below(flags.len()),
            };
            let flag = flags.swap_remove(place);
            let is_wanted = self.random.chance(if terms.is_empty() { 70 } else { 20 });
            terms.push(match (is_wanted, self.random.below(8)) {
                (true, 0) => format!("not not {flag}"),
                (true, _) => flag,
                (false, 0) => format!("not ({flag})"),
                (false, _) => format!("not {flag}"),
            });
        }
        let parts = terms.len();
        (parts > 1).then(|| terms.join(" and "))
    }

    /// A guard that is allowed at a source, or nothing where none is.
    fn guard(
        &mut self,
        source: Option<&Offer>,
        parent_flags: &[Flag],
        depth: usize,
    ) -> Option<String> {
        if depth == GUARD_DEPTH
            && source.is_some_and(|source| source.has_timeout)
            && self.random.chance(40)
        {
            return Some("timeout".to_owned());
        }
        if depth == GUARD_DEPTH
            && self
                .random
                .chance(if self.with_many_flags { 50 } else { 20 })
            && let Some(conjunction) = source.and_then(|source| self.conjunction(source))
        {
            return Some(conjunction);
        }
        if depth > 0 && self.random.chance(45) {
            let operator = match self.random.below(3) {
                0 => {
                    let inner = self.guard(source, parent_flags, depth - 1)?;
                    return Some(format!("not ({inner})"));
                }
                1 => " and ",
                _ => " or ",
            };
            let mut terms = Vec::new();
            for _ in 0..self.random.between(2, 3) {
                let term = self.guard(source, parent_flags, depth - 1)?;
                // Sometimes without the parentheses: then it is precedence that decides.
                terms.push(if self.random.chance(50) {
                    format!("({term})")
                } else {
                    term
                });
            }
            return Some(terms.join(operator));
        }
        let mut atoms: Vec<String> = parent_flags
            .iter()
            .map(|flag| format!("^{}", flag.name))
            .collect();
        atoms.extend(source.into_iter().flat_map(own_flags));
        let atom = self.random.pick(&atoms)?.clone();
        Some(if self.random.chance(35) {
            format!("not {atom}")
        } else {
            atom
        })
    }

    fn actions(
        &mut self,
        target: Option<&Offer>,
        events: &[String],
        parent_flags: &[Flag],
    ) -> String {
        let mut choices: Vec<String> = Vec::new();
        for flag in parent_flags.iter().filter(|flag| flag.out) {
            choices.push(format!("set ^{}", flag.name));
            choices.push(format!("clear ^{}", flag.name));
        }
        if let Some(flags) = target.and_then(|target| target.flags.as_ref()) {
            for flag in flags.iter().filter(|flag| !flag.out) {
                choices.push(format!("set .{}", flag.name));
                choices.push(format!("set .{}", flag.name));
                choices.push(format!("clear .{}", flag.name));
            }
        }
        let mut actions = Vec::new();
        for _ in 0..self.random.below(4) {
            if self.random.chance(35)
                && let Some(event) = self.event(events)
            {
                actions.push(format!("send {event}"));
            } else if let Some(choice) = self.random.pick(&choices) {
                actions.push(choice.clone());
            }
        }
        if actions.is_empty() {
            String::new()
        } else {
            format!(" / {}", actions.join(", "))
        }
    }
}

/// The flags of a state that transitions from it can read.
fn own_flags(offer: &Offer) -> Vec<String> {
    let mut flags = vec!["timeout".to_owned()];
    if let Some(own) = &offer.flags {
        flags.extend(["exit".to_owned(), "busy".to_owned()]);
        let outs = own.iter().filter(|flag| flag.out);
        flags.extend(outs.map(|flag| format!(".{}", flag.name)));
    }
    flags
}

/// The flags of a state in the order of its block; none where transitions from it cannot read one.
fn own_block(offer: &Offer) -> Vec<Option<String>> {
    let Some(own) = &offer.flags else {
        return vec![Some("timeout".to_owned())];
    };
    let mut block = vec![Some("exit".to_owned()), Some("timeout".to_owned())];
    if offer.is_task {
        block.push(Some("busy".to_owned()));
    }
    block.extend(
        own.iter()
            .map(|flag| flag.out.then(|| format!(".{}", flag.name))),
    );
    block
}

/// A random scenario for a machine: some macro steps, changes at and between them, in no order of
/// time.
pub fn scenario(seed: u64, model: &Model) -> Scenario {
    scenario_of(&mut Random::new(seed ^ 0x5ce0_a210), model, FULL)
}

/// The scenario for a machine that a source of random numbers decides on.
pub fn scenario_of(random: &mut Random, model: &Model, size: Size) -> Scenario {
    let slot_period_us = model
        .interpreter_slot
        .map_or(10_000, |slot| u64::from(model.slots[slot].period_us));
    let period_us = match random.below(10) {
        0 => Some(*random.pick(&[1, 10_000, 123_457]).expect("not empty")),
        // So long that times leave 32 bits, and so do the differences that a timeout is compared
        // with.
        1 => Some(3_000_000_000),
        _ => None,
    };
    let step_us = period_us.unwrap_or(slot_period_us);
    let steps = random.between(5, size.steps) as u64;
    let mut scenario = Scenario {
        period_us,
        until_us: steps * step_us + random.below(step_us as usize) as u64,
        entries: Vec::new(),
    };
    let states = reference::states(model);
    let tasks: Vec<(&str, &[host_tools::model::Flag])> = states
        .iter()
        .filter_map(|(path, kind)| match kind {
            Some(StateKind::Task { task, .. }) => {
                Some((path.as_str(), model.tasks[*task].flags.as_slice()))
            }
            _ => None,
        })
        .collect();
    let changes_a_step = random.below(12);
    reference::steer(model, step_us, steps, |step, active, wishes| {
        let mut changes = Vec::new();
        for _ in 0..random.below(changes_a_step + 1) {
            let wish = match random.chance(60) {
                true => random.pick(wishes).cloned(),
                false => None,
            };
            let Some(action) = wish.or_else(|| change(random, &tasks, active)) else {
                break;
            };
            changes.push(action.clone());
            // At the macro step or, which is the same, somewhere behind the one before.
            let earlier_us = if step > 0 && random.chance(30) {
                random.below(step_us as usize) as u64
            } else {
                0
            };
            let at_us = step * step_us - earlier_us;
            scenario.entries.push(Entry { at_us, action });
        }
        changes
    });
    for _ in 0..random.below(8) {
        if let Some(action) = expectation(random, &states, model) {
            let at_us = random.below((steps as usize + 3) * step_us as usize) as u64;
            let place = random.below(scenario.entries.len() + 1);
            scenario.entries.insert(place, Entry { at_us, action });
        }
    }
    scenario
}

/// Something that a task does, or what its dispatcher does: mostly one whose state is active.
fn change(
    random: &mut Random,
    tasks: &[(&str, &[host_tools::model::Flag])],
    active: &[String],
) -> Option<Action> {
    let mut picked = random.pick(tasks);
    if random.chance(85) {
        let is_active = |(path, _): &&(&str, _)| active.iter().any(|state| state == path);
        let current: Vec<_> = tasks.iter().filter(is_active).collect();
        picked = random.pick(&current).copied().or(picked);
    }
    let &(path, flags) = picked?;
    let state = path.to_owned();
    let outs: Vec<_> = flags
        .iter()
        .filter(|flag| flag.direction == Direction::Out)
        .collect();
    Some(match random.below(10) {
        0 | 1 => Action::Exit { state },
        2..=4 => Action::Busy {
            state,
            value: random.chance(75),
        },
        _ => match random.pick(&outs) {
            Some(flag) => Action::Write {
                state,
                flag: flag.name.clone(),
                value: random.chance(75),
            },
            None => Action::Exit { state },
        },
    })
}

/// An expectation that may hold or not.
fn expectation(
    random: &mut Random,
    states: &[(String, Option<StateKind>)],
    model: &Model,
) -> Option<Action> {
    let (state, kind) = random.pick(states)?;
    let mut flags: Vec<Option<String>> = vec![None, None];
    let declared = match kind {
        None => &[],
        Some(StateKind::Simple) => {
            flags.push(Some("timeout".to_owned()));
            &[][..]
        }
        Some(StateKind::Task { task, .. }) => model.tasks[*task].flags.as_slice(),
        Some(StateKind::Super { container }) => model.containers[*container].flags.as_slice(),
    };
    if matches!(kind, Some(StateKind::Task { .. } | StateKind::Super { .. })) {
        flags.extend(["exit", "timeout", "busy"].map(|flag| Some(flag.to_owned())));
    }
    flags.extend(declared.iter().map(|flag| Some(flag.name.clone())));
    Some(Action::Expect {
        state: state.clone(),
        flag: random.pick(&flags)?.clone(),
        value: random.chance(50),
    })
}
