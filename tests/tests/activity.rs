//! What the analysis calls impossible must never happen: random machines run through the reference
//! under scenarios that set flags at random, and no state is entered, no transition taken and no
//! two states are current together that the analysis rules out.
//!
//! `ESM_MACHINES` sets how many machines are made (150 if unset), `ESM_SEED` the seed of the first.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::collections::HashMap;

use esm_tests::random::Random;
use esm_tests::scenario::{Action, Entry, Scenario};
use esm_tests::{environment, random_machine, reference, subject};
use host_tools::lang::analysis::activity::{Activity, StateId, View};
use host_tools::lang::analysis::holes::Holes;
use host_tools::lang::analysis::side_by_side::SideBySide;
use host_tools::model::{Direction, Model, Source, StateKind, Target, Trigger};

const DEFAULT_MACHINES: u64 = 150;
const SCENARIOS_A_MACHINE: u64 = 3;

/// Where a local state is: its container and region, and which state it is; none for a
/// pseudo-state.
fn local(model: &Model, path: &str) -> (usize, usize, Option<usize>) {
    let mut container = model.machine.unwrap();
    let mut names = path.split('/');
    loop {
        let (region_name, state_name) = (names.next().unwrap(), names.next().unwrap());
        let regions = &model.containers[container].regions;
        let region = regions
            .iter()
            .position(|it| it.name == region_name)
            .unwrap();
        let states = &regions[region].states;
        let state = states.iter().position(|it| it.name == state_name);
        if names.clone().next().is_none() {
            return (container, region, state);
        }
        let StateKind::Super { container: inside } = states[state.unwrap()].kind else {
            panic!("{path}: only superstates have something inside");
        };
        container = inside;
    }
}

fn state(model: &Model, path: &str) -> Option<StateId> {
    let (container, region, state) = local(model, path);
    Some(StateId {
        container,
        region,
        state: state?,
    })
}

/// Every task does something at every step: what can be reached by luck is.
fn storm(seed: u64, model: &Model) -> Scenario {
    let mut random = Random::new(seed ^ 0x5707);
    let period_us = u64::from(model.slots[model.interpreter_slot.unwrap()].period_us);
    let states = reference::states(model);
    let tasks: Vec<(&String, usize)> = states
        .iter()
        .filter_map(|(path, kind)| match kind {
            Some(StateKind::Task { task, .. }) => Some((path, *task)),
            _ => None,
        })
        .collect();
    let steps = 60;
    let mut entries = Vec::new();
    for step in 0..steps {
        for _ in 0..tasks.len().min(30) {
            let (path, task) = *random.pick(&tasks).unwrap();
            let flags = &model.tasks[task].flags;
            let outs: Vec<_> = flags
                .iter()
                .filter(|flag| flag.direction == Direction::Out)
                .collect();
            let state = path.clone();
            let action = match (random.below(8), random.pick(&outs)) {
                (0, _) | (_, None) => Action::Exit { state },
                (1, _) => Action::Busy {
                    state,
                    value: random.chance(50),
                },
                (_, Some(flag)) => Action::Write {
                    state,
                    flag: flag.name.clone(),
                    value: random.chance(60),
                },
            };
            entries.push(Entry {
                at_us: step * period_us,
                action,
            });
        }
    }
    Scenario {
        period_us: None,
        until_us: steps * period_us,
        entries,
    }
}

/// The claims of the analysis about one machine, and what was seen of it.
struct Claims<'m> {
    model: &'m Model,
    activity: &'m Activity,
    nesting: SideBySide<'m>,
    together: HashMap<(StateId, StateId), bool>,
}

impl Claims<'_> {
    /// What a line of a trace shows that should be impossible.
    fn contradiction(&mut self, line: &serde_json::Value) -> Option<String> {
        match line["kind"].as_str().unwrap() {
            "transition" => self.of_transition(line),
            "step" => self.of_step(line),
            _ => None,
        }
    }

    fn of_transition(&self, line: &serde_json::Value) -> Option<String> {
        let (container, region, from) = local(self.model, line["from"].as_str().unwrap());
        let (_, _, to) = local(self.model, line["to"].as_str().unwrap());
        let event = line["event"].as_str().unwrap();
        let transitions = &self.model.containers[container].regions[region].transitions;
        let could_be = transitions.iter().enumerate().any(|(index, transition)| {
            let same_event = match transition.trigger {
                Trigger::Pulse | Trigger::Star => event == "pulse",
                Trigger::Event(name) => self.model.events[name] == event,
            };
            same_event
                && transition.source == from.map_or(Source::Initial, Source::State)
                && transition.target == to.map_or(Target::Final, Target::State)
                && self.activity.can_be_taken(container, region, index)
        });
        (!could_be).then(|| format!("no such transition can be taken: {line}"))
    }

    fn of_step(&mut self, line: &serde_json::Value) -> Option<String> {
        let paths: Vec<&str> = line["active"]
            .as_array()
            .unwrap()
            .iter()
            .map(|path| path.as_str().unwrap())
            .collect();
        let current: Vec<StateId> = paths
            .iter()
            .filter_map(|path| state(self.model, path))
            .collect();
        for (index, &a) in current.iter().enumerate() {
            if !self.activity.is_active(a) {
                return Some(format!("{a:?} is current and cannot be reached: {line}"));
            }
            for &b in &current[..index] {
                let nesting = &mut self.nesting;
                let can = *self
                    .together
                    .entry((a.min(b), a.max(b)))
                    .or_insert_with(|| nesting.can_be_together(a, b).unwrap());
                if !can {
                    return Some(format!("{a:?} and {b:?} cannot be together: {line}"));
                }
            }
        }
        None
    }
}

/// How much there was to contradict, so that agreement is never agreement about nothing.
#[derive(Debug, Default)]
struct Sample {
    states: usize,
    unreachable: usize,
    entered: usize,
    transitions: usize,
    impossible: usize,
    pairs_seen: usize,
    pairs_apart: usize,
}

#[test]
fn what_is_called_impossible_never_happens() {
    let first = environment::number("ESM_SEED", 1);
    let machines = environment::number("ESM_MACHINES", DEFAULT_MACHINES);
    let mut sample = Sample::default();
    for seed in first..first + machines {
        let text = random_machine::machine(seed);
        let model = subject::build(&text).unwrap().model;
        let holes = Holes::none(&model);
        let activity = Activity::of(&model, &holes, View::Known);
        let mut claims = Claims {
            model: &model,
            activity: &activity,
            nesting: SideBySide::new(&model, &holes, &activity).unwrap(),
            together: HashMap::new(),
        };
        let mut scenarios: Vec<Scenario> = (0..SCENARIOS_A_MACHINE)
            .map(|number| random_machine::scenario(seed * SCENARIOS_A_MACHINE + number, &model))
            .collect();
        scenarios.push(storm(seed, &model));
        let mut entered = std::collections::HashSet::new();
        for scenario in &scenarios {
            for line in reference::run(&model, scenario).trace {
                let line: serde_json::Value = serde_json::from_str(&line).unwrap();
                if let Some(contradiction) = claims.contradiction(&line) {
                    panic!(
                        "seed {seed}: {contradiction}\n--- machine\n{text}\n--- scenario\n{scenario}"
                    );
                }
                if line["kind"] == "transition" {
                    entered.extend(state(&model, line["to"].as_str().unwrap()));
                }
            }
        }
        sample.add(&mut claims, entered.len());
    }
    println!("{machines} machines from seed {first}: {sample:?}");
    if machines >= DEFAULT_MACHINES {
        assert!(sample.unreachable > 100, "{sample:?}");
        assert!(sample.impossible > 100, "{sample:?}");
        assert!(sample.pairs_seen > 500, "{sample:?}");
        assert!(sample.pairs_apart > 500, "{sample:?}");
        // An analysis that calls everything possible would agree as well.
        assert!(
            sample.entered * 3 > sample.states - sample.unreachable,
            "{sample:?}"
        );
    }
}

impl Sample {
    fn add(&mut self, claims: &mut Claims<'_>, entered: usize) {
        self.entered += entered;
        self.pairs_seen += claims.together.len();
        for (container, declared) in claims.model.containers.iter().enumerate() {
            if !claims.activity.is_container_active(container) {
                continue;
            }
            for (region, declared) in declared.regions.iter().enumerate() {
                let reachable = (0..declared.states.len())
                    .filter(|&state| {
                        claims.activity.is_active(StateId {
                            container,
                            region,
                            state,
                        })
                    })
                    .count();
                self.states += declared.states.len();
                self.unreachable += declared.states.len() - reachable;
                for a in 0..declared.states.len() {
                    for b in 0..a {
                        let [a, b] = [a, b].map(|state| StateId {
                            container,
                            region,
                            state,
                        });
                        let can = claims.nesting.can_be_together(a, b).unwrap();
                        self.pairs_apart += usize::from(!can);
                    }
                }
                self.transitions += declared.transitions.len();
                self.impossible += (0..declared.transitions.len())
                    .filter(|&index| !claims.activity.can_be_taken(container, region, index))
                    .count();
            }
        }
    }
}
