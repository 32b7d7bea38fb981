//! Warm swaps: what a machine takes over from the one before it.
//!
//! To the same machine a swap changes nothing, whatever it was doing. To another one, a plain
//! implementation that compares paths as texts says what must be current, and a plain checker that
//! the state is one that the machine could have come to.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::collections::BTreeMap;
use std::ops::Deref;

use esm_core::reads::{Checked, Reads};
use esm_core::tables::{StateKind, Tables};
use esm_core::{
    Interpreter, MappingTooLarge, Observer, StateMapping, TakenOver, TransitionTaken, format,
};
use esm_tests::random::Random;
use esm_tests::{environment, random_machine, subject};
use host_tools::compile::{NameTable, compile_with};
use host_tools::trace::directory::{self, Directory, StateId};

/// Machines of a run where nobody says how many.
const DEFAULT_MACHINES: u64 = 150;

/// Macro steps before and after a swap at most.
const STEPS: usize = 40;

type Machine<'m> = Interpreter<'m, Vec<u8>, Checked>;

fn machine<'m>(blob: &[u8], arena: &'m mut Vec<u32>) -> Machine<'m> {
    let verified = subject::verified(blob).unwrap();
    arena.resize(verified.arena_words(), 0);
    Interpreter::with_reads(verified, arena).unwrap()
}

/// What a robot does in two steps: finds out what both have in common, whatever is current, and
/// takes over.
fn take_over(new: &mut Machine<'_>, old: &Machine<'_>) -> TakenOver {
    let mut table = vec![0xAAAA; usize::from(u16::MAX)];
    let mut mapping = StateMapping::new(&mut table);
    mapping.find(&new.tables(), &old.tables(), |_| 0).unwrap();
    new.take_over(old, &mapping)
}

/// What the tasks of a machine do before a macro step.
#[derive(Clone, Copy, Debug)]
enum Change {
    Flag(usize, usize, bool),
    Busy(usize, bool),
    Exit(usize),
}

fn changes(random: &mut Random, tables: &Tables<'_>) -> Vec<Change> {
    let tasks = tables.task_instance_count();
    let mut changes = Vec::new();
    for _ in 0..random.below(4).min(tasks) {
        let task = random.below(tasks);
        let flags = tables.flags_of_task(task).unwrap().1 - format::TASK_CONTROL_FLAGS;
        changes.push(match random.below(10) {
            0 => Change::Exit(task),
            1 | 2 => Change::Busy(task, random.chance(50)),
            _ if flags == 0 => continue,
            _ => Change::Flag(task, random.below(flags), random.chance(60)),
        });
    }
    changes
}

fn apply(machine: &mut Machine<'_>, changes: &[Change]) {
    for change in changes {
        match *change {
            Change::Flag(task, flag, value) if machine.is_current(task) => {
                machine.set_flag(task, flag, value);
            }
            Change::Busy(task, value) if machine.is_current(task) => machine.set_busy(task, value),
            Change::Exit(task) if machine.is_current(task) && machine.is_enabled(task) => {
                machine.report_exit(task);
            }
            _ => {}
        }
    }
}

#[derive(Default, Debug, PartialEq)]
struct Seen(Vec<(u8, u16, u16)>);

impl Observer for Seen {
    fn transition(&mut self, taken: TransitionTaken) {
        self.0
            .push((taken.micro, taken.region_instance, taken.transition));
    }
}

/// What a macro step did, and how the machine is after it.
fn step(machine: &mut Machine<'_>) -> String {
    let mut seen = Seen::default();
    let ended = machine
        .macro_step(&mut seen)
        .map(|summary| (summary.micro_steps, summary.changed, summary.finished));
    let tables = machine.tables();
    let current: Vec<_> = (0..tables.region_instance_count())
        .filter(|region| machine.is_region_active(*region))
        .map(|region| (region, machine.current(region)))
        .collect();
    let enabled: Vec<_> = (0..tables.task_instance_count())
        .filter(|task| machine.is_current(*task))
        .map(|task| (task, machine.is_enabled(task)))
        .collect();
    format!("{seen:?} {ended:?} {current:?} {enabled:?}")
}

#[test]
fn a_swap_to_the_same_machine_is_none() {
    let first = environment::number("ESM_SEED", 1);
    let machines = environment::number("ESM_MACHINES", DEFAULT_MACHINES);
    let (mut transitions, mut regions, mut timeouts) = (0, 0, 0);
    for seed in first..first + machines {
        let text = random_machine::machine(seed);
        let blob = subject::build(&text).unwrap().blob;
        let mut random = Random::new(seed);
        let (mut a, mut b, mut c) = (Vec::new(), Vec::new(), Vec::new());
        let (mut left, mut stays) = (machine(&blob, &mut a), machine(&blob, &mut b));
        let mut next = machine(&blob, &mut c);
        timeouts += usize::from(text.contains("timeout"));
        let mut failed = false;
        for _ in 0..random.below(STEPS) {
            let changes = changes(&mut random, &stays.tables());
            apply(&mut left, &changes);
            apply(&mut stays, &changes);
            if random.chance(5) {
                left.skip(3);
                stays.skip(3);
            }
            assert_eq!(step(&mut left), step(&mut stays));
            failed |= left.fault().is_some();
        }
        if failed {
            continue;
        }
        let taken = take_over(&mut next, &left);
        assert_eq!(taken.anew, 0, "seed {seed}\n{text}");
        regions += usize::from(taken.regions);
        for number in 0..STEPS {
            let changes = changes(&mut random, &stays.tables());
            apply(&mut next, &changes);
            apply(&mut stays, &changes);
            let expected = step(&mut stays);
            transitions += expected.matches('(').count();
            assert_eq!(
                step(&mut next),
                expected,
                "seed {seed}, macro step {number}\n{text}"
            );
        }
    }
    println!("{transitions} {regions} {timeouts}");
    if machines >= DEFAULT_MACHINES {
        assert!(transitions > 10_000 && regions > 500 && timeouts > 20);
    }
}

/// A machine that is like another: some of its lines are gone, or it is another one.
fn mutated(random: &mut Random, seed: u64, text: &str) -> Option<Vec<u8>> {
    if random.chance(20) {
        let other = random_machine::machine(seed + 100_000);
        return subject::build(&other).ok().map(|built| built.blob);
    }
    let mut lines: Vec<&str> = text.lines().collect();
    for _ in 0..40 {
        let at = random.below(lines.len());
        let line = lines.remove(at);
        if subject::build(&lines.join("\n")).is_err() {
            lines.insert(at, line);
        } else if random.chance(30) {
            break;
        }
    }
    // Another order of what is left, so that nothing stands where it stood.
    subject::build(&lines.join("\n"))
        .ok()
        .map(|built| built.blob)
}

/// What makes a state go on as another: its kind, and the signature of its task.
fn kind_of<'t>(tables: &Tables<'t>, state: usize) -> (u8, &'t [u8]) {
    match tables.state(state).unwrap().kind {
        StateKind::Initial => (0, b""),
        StateKind::Final => (1, b""),
        StateKind::Simple => (2, b""),
        StateKind::Super { .. } => (3, b""),
        StateKind::Task { real_time, .. } => {
            let record = tables.task_state_at(state).unwrap();
            let task = tables.task_state(record).unwrap().task;
            let text = tables.task(task).unwrap().signature.text();
            (4 + u8::from(real_time), text)
        }
    }
}

/// By path of each region that must be active: the path of what must be current.
fn expected(
    (old, old_names): (&Machine<'_>, &Directory),
    (new, new_names): (&Tables<'_>, &Directory),
) -> BTreeMap<String, String> {
    let old_current: BTreeMap<&str, StateId> = old_names
        .regions()
        .iter()
        .filter(|region| old.is_region_active(region.index))
        .filter_map(|region| {
            let current = old_names.state_at(region.index, old.current(region.index))?;
            Some((region.path.as_str(), current))
        })
        .collect();
    let old_tables = old.tables();
    let mut current = BTreeMap::new();
    let mut waiting: Vec<Option<StateId>> = vec![None];
    while let Some(owner) = waiting.pop() {
        for region in new_names.regions_of(owner) {
            let goes_on = old_current.get(region.path.as_str()).and_then(|old_id| {
                let name = old_names.state(*old_id)?.name();
                let id = region.find(name)?;
                let kinds = (
                    kind_of(new, new_names.index_of(id)?),
                    kind_of(&old_tables, old_names.index_of(*old_id)?),
                );
                (kinds.0 == kinds.1).then_some(id)
            });
            let id = goes_on.unwrap_or(StateId {
                region: region.index,
                local: 0,
            });
            let state = new_names.state(id).unwrap();
            current.insert(region.path.clone(), state.path.clone());
            if matches!(state.kind, directory::StateKind::Super { .. }) {
                waiting.push(Some(id));
            }
        }
    }
    current
}

/// Says what is wrong with the state of a machine between two macro steps.
fn check<R: Reads<B>, B: Deref<Target = [u8]>>(
    machine: &Interpreter<'_, B, R>,
) -> Result<(), String> {
    let tables = machine.tables();
    let regions = tables.region_instance_count();
    for region in 0..regions {
        let record = tables.region_instance(region).unwrap();
        let around = tables.superstate_of(record.instance);
        let active = around.is_none_or(|(region, state)| machine.is_current_state(region, state));
        if machine.is_region_active(region) != active {
            return Err(format!(
                "region {region} is not as active as its superstate"
            ));
        }
        let current = machine.current(region);
        if tables.region_of_state(current) != tables.region_of_state(record.initial) {
            return Err(format!("region {region} is in a state of another"));
        }
        let is_final = matches!(tables.state(current).unwrap().kind, StateKind::Final);
        let head = tables.instance(record.instance).unwrap().first_flag;
        if active && is_final && !machine.flag(head + format::FLAG_EXIT) {
            return Err(format!("region {region} is at its end, and nobody knows"));
        }
    }
    for task in 0..tables.task_instance_count() {
        if machine.is_enabled(task) && !machine.is_current(task) {
            return Err(format!("task {task} is enabled and not current"));
        }
        if machine.is_current(task) && machine.is_enabled(task) == machine.has_exited(task) {
            return Err(format!(
                "task {task} has exited, and is enabled, or neither"
            ));
        }
    }
    Ok(())
}

#[test]
fn states_and_regions_go_on_in_whatever_order_they_are_declared() {
    let region = |name: &str, states: &[&str], initial: &str| {
        let states: String = states.iter().map(|it| format!("state {it}; ")).collect();
        format!("region {name} {{ {states} initial -> {initial}; }} ")
    };
    let build = |regions: String| {
        let text = format!(
            "interpreter slot 1; slot 1 period 20 ms duration 2 ms; machine M {{ {regions} }}"
        );
        subject::build(&text).unwrap().blob
    };
    let orders: [&[&str]; 5] = [
        &["A", "B", "C"],
        &["C", "B", "A"],
        &["B", "C", "A"],
        &["New", "A", "Newer", "C", "B"],
        &["B", "A", "New", "C"],
    ];
    for current in ["A", "B", "C"] {
        let here = region("r", &["A", "B", "C"], current) + &region("q", &["B", "A", "C"], "A");
        let blob = build(here);
        for order in orders {
            let other = ["A", "B", "C"]
                .into_iter()
                .find(|it| *it != current)
                .unwrap();
            let (r, q) = (region("r", order, other), region("q", order, "C"));
            for regions in [
                format!("{r}{q}"),
                format!("{q}{}{r}", region("p", &["A"], "A")),
            ] {
                let (mut a, mut b) = (Vec::new(), Vec::new());
                let there = build(regions.clone());
                let (mut old, mut new) = (machine(&blob, &mut a), machine(&there, &mut b));
                step(&mut old);
                let taken = take_over(&mut new, &old);
                assert_eq!(taken.regions, 2, "{current} to {regions}");
                let names = Directory::of(&new.tables()).unwrap();
                let path_of = |region: usize| {
                    let id = names.state_at(region, new.current(region)).unwrap();
                    names.state(id).unwrap().path.clone()
                };
                for found in names.regions() {
                    let expected = match &*found.path {
                        "r" => format!("r/{current}"),
                        "q" => "q/A".to_owned(),
                        _ => continue,
                    };
                    assert_eq!(path_of(found.index), expected, "{regions}");
                }
            }
        }
    }
}

#[test]
fn a_swap_to_another_machine_carries_over_what_has_the_same_path_and_kind() {
    let first = environment::number("ESM_SEED", 1);
    let machines = environment::number("ESM_MACHINES", DEFAULT_MACHINES);
    let mut sample = [0_usize; 4];
    for seed in first..first + machines {
        let text = random_machine::machine(seed);
        let mut random = Random::new(seed);
        let Some(other) = mutated(&mut random, seed, &text) else {
            continue;
        };
        let blob = subject::build(&text).unwrap().blob;
        let (mut a, mut b) = (Vec::new(), Vec::new());
        let (mut old, mut new) = (machine(&blob, &mut a), machine(&other, &mut b));
        for _ in 0..random.below(STEPS) {
            let changes = changes(&mut random, &old.tables());
            apply(&mut old, &changes);
            step(&mut old);
        }
        if old.fault().is_some() {
            continue;
        }
        let TakenOver { regions, anew } = take_over(&mut new, &old);
        let old_names = Directory::of(&old.tables()).unwrap();
        let new_names = Directory::of(&new.tables()).unwrap();
        let found: BTreeMap<String, String> = new_names
            .regions()
            .iter()
            .filter(|region| new.is_region_active(region.index))
            .map(|region| {
                let id = new_names.state_at(region.index, new.current(region.index));
                let state = new_names.state(id.unwrap()).unwrap();
                (region.path.clone(), state.path.clone())
            })
            .collect();
        let expected = expected((&old, &old_names), (&new.tables(), &new_names));
        assert_eq!(found, expected, "seed {seed}");
        assert_eq!(usize::from(regions + anew), found.len(), "seed {seed}");
        sample[0] += usize::from(regions);
        sample[1] += usize::from(anew);

        // Flags of what goes on, by name.
        for (path, id) in found
            .values()
            .filter_map(|path| Some((path, old_names.find(path)?)))
        {
            let (old_state, new_id) = (old_names.state(id).unwrap(), new_names.find(path).unwrap());
            let new_state = new_names.state(new_id).unwrap();
            let first = |names: &Directory, tables: &Tables<'_>, id: StateId| {
                let index = names.index_of(id).unwrap();
                tables.flags_of_state(id.region, index).unwrap().0
            };
            let old_first = first(&old_names, &old.tables(), id);
            let new_first = first(&new_names, &new.tables(), new_id);
            let (is_current, control) = match (&old_state.kind, &new_state.kind) {
                (
                    directory::StateKind::Task { instance, .. },
                    directory::StateKind::Task { instance: new_task },
                ) => {
                    let is_current = old.is_current(*instance);
                    if is_current {
                        assert_eq!(
                            old.is_enabled(*instance),
                            new.is_enabled(*new_task),
                            "seed {seed}: {path}"
                        );
                        assert_eq!(
                            old.is_busy(*instance),
                            new.is_busy(*new_task),
                            "seed {seed}: {path}"
                        );
                    }
                    (is_current, format::TASK_CONTROL_FLAGS)
                }
                (directory::StateKind::Super { .. }, directory::StateKind::Super { .. }) => {
                    let index = old_names.index_of(id).unwrap();
                    (
                        old.is_current_state(id.region, index),
                        format::CONTAINER_CONTROL_FLAGS,
                    )
                }
                _ => continue,
            };
            for (place, flag) in new_state.flags.iter().enumerate() {
                let other = old_state
                    .flags
                    .iter()
                    .position(|other| other.name == flag.name);
                let expected =
                    is_current && other.is_some_and(|other| old.flag(old_first + control + other));
                let same_task = matches!(old_state.kind, directory::StateKind::Task { .. });
                if is_current || !same_task {
                    let found = new.flag(new_first + control + place);
                    assert_eq!(found, expected, "seed {seed}: {path}.{}", flag.name);
                    sample[2] += usize::from(found);
                }
            }
        }
        check(&new).unwrap_or_else(|wrong| panic!("seed {seed}: {wrong}\n{text}"));
        for _ in 0..STEPS {
            let changes = changes(&mut random, &new.tables());
            apply(&mut new, &changes);
            step(&mut new);
            sample[3] += 1;
        }
    }
    println!("{sample:?}");
    if machines >= DEFAULT_MACHINES {
        let [regions, anew, flags, _] = sample;
        assert!(regions > 300 && anew > 50 && flags > 20, "{sample:?}");
    }
}

/// A machine that waits.
const WAITING: &str = "interpreter slot 1; slot 1 period 10 ms duration 100 us;
    machine M { region r { state Wait timeout 200 ms; state Over; initial -> Wait; Wait -> Over [timeout]; } }";

/// It waits for so long, with other macro steps.
fn waiting(period: &str, timeout: &str) -> Vec<u8> {
    let text = WAITING.replace("10 ms", period).replace("200 ms", timeout);
    subject::build(&text).unwrap().blob
}

/// Macro steps of the second machine until the first's wait is over, if it ran for so many itself.
fn steps_left(before: &[u8], steps: usize, after: &[u8]) -> usize {
    let (mut a, mut b) = (Vec::new(), Vec::new());
    let (mut old, mut new) = (machine(before, &mut a), machine(after, &mut b));
    for _ in 0..steps {
        step(&mut old);
    }
    take_over(&mut new, &old);
    let over = |machine: &Machine<'_>| machine.current(0) == 2;
    assert!(!over(&new));
    (1..10_000)
        .find(|_| {
            step(&mut new);
            over(&new)
        })
        .unwrap()
}

#[test]
fn timers_go_on_and_end_at_the_new_limit() {
    let ten = |timeout: &str| waiting("10 ms", timeout);
    let alone = steps_left(&ten("200 ms"), 1, &ten("200 ms"));
    assert_eq!(
        alone, 21,
        "the state is left when it is older than its limit"
    );
    for (what, before, steps, after, expected) in [
        ("the same", ten("200 ms"), 11, ten("200 ms"), alone - 10),
        ("longer", ten("200 ms"), 11, ten("300 ms"), alone - 10 + 10),
        (
            "shorter, and over already",
            ten("200 ms"),
            11,
            ten("50 ms"),
            1,
        ),
        (
            "half the period: the same time is twice the steps",
            ten("200 ms"),
            11,
            waiting("5 ms", "200 ms"),
            41 - 20,
        ),
    ] {
        assert_eq!(steps_left(&before, steps, &after), expected, "{what}");
    }
}

#[test]
fn a_machine_that_stopped_and_one_without_names_hand_over_nothing() {
    let flood = "interpreter slot 1; slot 1 period 10 ms duration 1 ms;
        machine M { event Again; region r { state A; state B; initial -> A; A -> B / send Again; B -> B on Again / send Again; } }";
    let flood = subject::build(flood).unwrap().blob;
    let (mut a, mut b) = (Vec::new(), Vec::new());
    let (mut old, mut new) = (machine(&flood, &mut a), machine(&flood, &mut b));
    for _ in 0..3 {
        step(&mut old);
    }
    assert!(old.fault().is_some());
    let nothing = TakenOver {
        regions: 0,
        anew: 1,
    };
    assert_eq!(take_over(&mut new, &old), nothing);

    let whole = subject::build(WAITING).unwrap().blob;
    let verified = subject::verified(&whole).unwrap();
    assert!(verified.tables().names().is_some());
    let starts: Vec<u32> = (verified.tables().slots())
        .map(|slot| slot.start_us)
        .collect();
    let model = subject::build(WAITING).unwrap().model;
    let stripped = compile_with(&model, &starts, NameTable::LeftOut).unwrap();
    let (mut a, mut b) = (Vec::new(), Vec::new());
    let (mut old, mut new) = (machine(&whole, &mut a), machine(&stripped, &mut b));
    for _ in 0..3 {
        step(&mut old);
    }
    assert_eq!(take_over(&mut new, &old), nothing);
}

#[test]
fn a_table_that_is_too_short_is_refused_with_what_is_needed() {
    let first = environment::number("ESM_SEED", 1);
    let mut longest = 0;
    for seed in first..first + 20 {
        let blob = subject::build(&random_machine::machine(seed)).unwrap().blob;
        let verified = subject::verified(&blob).unwrap();
        let tables = verified.tables();
        let found = |entries: usize| {
            let mut table = vec![0; entries];
            let mut mapping = StateMapping::new(&mut table);
            let found = mapping.find(&tables, &tables, |_| u8::MAX);
            let pairs = mapping.tasks().count() + mapping.nets().count();
            assert!(found.is_ok() || pairs == 0, "a part of it is nothing");
            found
        };
        let mut entries = 0;
        while let Err(MappingTooLarge { needed, available }) = found(entries) {
            assert!(needed > available && available == entries, "seed {seed}");
            entries = needed;
        }
        if entries > 0 {
            let refused = found(entries - 1).unwrap_err();
            assert_eq!(refused.needed, entries, "seed {seed}: all of it is counted");
        }
        longest = longest.max(entries);
    }
    assert!(longest > 50, "{longest}");
}
