//! A machine that runs, watched from inside: laws that hold for every table that passed the
//! verifier, whoever wrote it.
//!
//! The watcher keeps its own account of what is current and what is enabled, from nothing but what
//! the observer is told, and holds it against the interpreter after each macro step:
//!
//! - A transition is taken from the state that is current, in a region that is active, to a state
//!   of the same region. In one micro step regions act in their order, and nothing inside a
//!   superstate acts after that was left.
//! - The first event of a macro step is the pulse, no other one is, and there are at most 255.
//! - A real-time task is enabled only while its state is current, and none is after a fault.
//! - What is outside a task's own flags, or outside the tables, cannot be changed from outside.
//! - A second machine, whose reads are checked, does the same.
//! - So does [`Plain`], which looks at everything each time: nothing that mattered was skipped.

use esm_core::format::{FLAG_BUSY, FLAG_EXIT, PULSE, TASK_CONTROL_FLAGS};
use esm_core::reads::{Checked, Reads};
use esm_core::tables::{StateKind, Tables};
use esm_core::{
    Fault, Interpreter, MAX_MICRO_STEPS, Observer, StepSummary, TransitionTaken, Verified,
};

use crate::random::Random;

use super::plain::Plain;

/// Words lent to the interpreter beyond what it needs; it must leave them alone.
const SURPLUS_WORDS: usize = 2;

/// Activations that pass unseen at once are mostly few; now and then as many as there can be. A
/// robot is in its safe state long before.
const MANY_SKIPPED: usize = 1 << 16;

/// Runs a machine for some macro steps, with random things happening in between.
///
/// # Panics
/// Where a law does not hold.
pub fn run(verified: Verified<Vec<u8>>, random: &mut Random, steps: usize) {
    let words = verified.arena_words();
    assert_eq!(verified.ram_bytes(), 4 * words);
    let tables_of = verified.clone();
    let tables = tables_of.tables();
    let mut too_small = vec![0; words.saturating_sub(1)];
    let refused = Interpreter::new(verified.clone(), &mut too_small);
    assert!(refused.is_err_and(|refused| refused.needed_words == words));

    let mut arena = vec![7; words + SURPLUS_WORDS];
    let mut checked_arena = arena.clone();
    let machine = Interpreter::new(verified.clone(), &mut arena);
    let checked = Interpreter::<_, Checked>::with_reads(verified, &mut checked_arena);
    let (Ok(mut machine), Ok(mut checked)) = (machine, checked) else {
        panic!("a blob that passed wants more memory than it says");
    };
    let (mut watch, mut checked_watch) = (Watch::new(tables), Watch::new(tables));
    let mut plain = Plain::new(tables);
    for _ in 0..steps {
        let outcome = step(&mut machine, &mut watch);
        assert_eq!(outcome, step(&mut checked, &mut checked_watch));
        assert_eq!(watch.taken, checked_watch.taken);
        assert_eq!(outcome, plain.macro_step());
        assert_eq!(watch.taken, plain.taken);
        compare(&machine, &plain, &tables);
        compare(&checked, &plain, &tables);
        if outcome.is_err() {
            assert_eq!(step(&mut machine, &mut watch), outcome, "a fault is final");
            assert_eq!(step(&mut checked, &mut checked_watch), outcome);
            break;
        }
        ask(&machine, &tables, random);
        for _ in 0..random.below(5) {
            let change = Change::random(&tables, random);
            let before = Snapshot::of(&machine);
            change.make(&mut machine, &mut watch);
            change.make(&mut checked, &mut checked_watch);
            change.make_plain(&mut plain);
            let after = Snapshot::of(&machine);
            change.check(&tables, &before, &after);
        }
    }
    drop((machine, checked));
    assert_eq!(arena[words..], [7; SURPLUS_WORDS]);
    assert_eq!(arena, checked_arena);
}

/// Flags, enabled tasks and current states are those of the plain machine.
fn compare<R: Reads<Vec<u8>>>(
    machine: &Interpreter<'_, Vec<u8>, R>,
    plain: &Plain<'_>,
    tables: &Tables<'_>,
) {
    for (flag, &value) in plain.flags.iter().enumerate() {
        assert_eq!(machine.flag(flag), value, "flag {flag}");
    }
    for (task, &enabled) in plain.enabled.iter().enumerate() {
        assert_eq!(machine.is_enabled(task), enabled, "task instance {task}");
    }
    for region in 0..tables.region_instance_count() {
        let active = machine.is_region_active(region);
        let current = active.then(|| machine.current(region));
        assert_eq!(current, plain.current(region), "region instance {region}");
    }
}

/// One macro step, and the watcher's account held against the machine.
fn step<R: Reads<Vec<u8>>>(
    machine: &mut Interpreter<'_, Vec<u8>, R>,
    watch: &mut Watch<'_>,
) -> Result<StepSummary, Fault> {
    watch.begin();
    let outcome = machine.macro_step(watch);
    assert_eq!(machine.fault(), outcome.err());
    watch.compare(machine);
    match &outcome {
        Ok(summary) => {
            assert_eq!(summary.finished, machine.is_finished());
            assert_eq!(summary.changed, !watch.taken.is_empty());
            let last = watch.taken.last().map_or(0, |taken| taken.micro);
            assert!(last < summary.micro_steps);
            assert!((1..=MAX_MICRO_STEPS).contains(&summary.micro_steps));
        }
        Err(_) => assert!(
            !watch.real_time_tasks().any(|task| machine.is_enabled(task)),
            "a fault disables all real-time tasks"
        ),
    }
    outcome
}

/// Something that happens between two macro steps.
#[derive(Clone, Copy, Debug)]
enum Change {
    Flag {
        task: usize,
        flag: usize,
        value: bool,
    },
    Exit {
        task: usize,
    },
    Busy {
        task: usize,
        value: bool,
    },
    Disable {
        task: usize,
    },
    Skip {
        missed: u32,
    },
}

impl Change {
    fn random(tables: &Tables<'_>, random: &mut Random) -> Self {
        // Now and then a task or flag that does not exist: a caller's mistake must not reach
        // another's memory.
        let task = random.below(tables.task_instance_count() + 2);
        match random.below(8) {
            0..=2 => Change::Flag {
                task,
                flag: random.below(20),
                value: random.chance(70),
            },
            3 => Change::Exit { task },
            4 | 5 => Change::Busy {
                task,
                value: random.chance(60),
            },
            6 => Change::Disable { task },
            _ => Change::Skip {
                missed: match random.below(10) {
                    0 => match random.below(4) {
                        0 => u32::MAX,
                        _ => random.bits() as u32,
                    },
                    1 => random.below(MANY_SKIPPED) as u32,
                    _ => random.below(4) as u32,
                },
            },
        }
    }

    fn make<R: Reads<Vec<u8>>>(
        self,
        machine: &mut Interpreter<'_, Vec<u8>, R>,
        watch: &mut Watch<'_>,
    ) {
        match self {
            Change::Flag { task, flag, value } => machine.set_flag(task, flag, value),
            Change::Busy { task, value } => machine.set_busy(task, value),
            Change::Skip { missed } => machine.skip(missed),
            Change::Exit { task } => {
                machine.report_exit(task);
                watch.forget(task);
            }
            Change::Disable { task } => {
                machine.clear_enabled(task);
                watch.forget(task);
            }
        }
    }

    fn make_plain(self, machine: &mut Plain<'_>) {
        match self {
            Change::Flag { task, flag, value } => {
                machine.write(task, TASK_CONTROL_FLAGS + flag, value);
            }
            Change::Busy { task, value } => machine.write(task, FLAG_BUSY, value),
            Change::Skip { missed } => machine.skip(missed),
            Change::Exit { task } => {
                machine.write(task, FLAG_EXIT, true);
                machine.disable(task);
            }
            Change::Disable { task } => machine.disable(task),
        }
    }

    /// Nothing else has changed.
    fn check(self, tables: &Tables<'_>, before: &Snapshot, after: &Snapshot) {
        let (task, flag) = match self {
            Change::Flag { task, flag, .. } => (task, TASK_CONTROL_FLAGS + flag),
            Change::Exit { task } => (task, FLAG_EXIT),
            Change::Busy { task, .. } => (task, FLAG_BUSY),
            Change::Disable { .. } | Change::Skip { .. } => (usize::MAX, 0),
        };
        let own = tables.flags_of_task(task).unwrap_or((0, 0));
        let changed = (flag < own.1).then_some(own.0 + flag);
        for (bit, (before, after)) in before.flags.iter().zip(&after.flags).enumerate() {
            assert!(
                before == after || changed == Some(bit),
                "{self:?}: bit {bit}"
            );
        }
        let disabled = match self {
            Change::Exit { task } | Change::Disable { task } => Some(task),
            _ => None,
        };
        for (task, (before, after)) in before.enabled.iter().zip(&after.enabled).enumerate() {
            let right = before == after || (disabled == Some(task) && !after);
            assert!(right, "{self:?}: task {task}");
        }
        assert_eq!(before.current, after.current, "{self:?}");
    }
}

/// All that a machine says of itself.
struct Snapshot {
    flags: Vec<bool>,
    enabled: Vec<bool>,
    current: Vec<usize>,
}

impl Snapshot {
    fn of(machine: &Interpreter<'_, Vec<u8>>) -> Self {
        let tables = machine.tables();
        let tasks = 0..tables.task_instance_count();
        let regions = 0..tables.region_instance_count();
        Snapshot {
            flags: (0..tables.flag_count())
                .map(|it| machine.flag(it))
                .collect(),
            enabled: tasks.map(|it| machine.is_enabled(it)).collect(),
            current: regions.map(|it| machine.current(it)).collect(),
        }
    }
}

/// Asks whatever can be asked, also of what does not exist.
fn ask(machine: &Interpreter<'_, Vec<u8>>, tables: &Tables<'_>, random: &mut Random) {
    for _ in 0..4 {
        let region = random.below(tables.region_instance_count() + 2);
        let state = random.below(tables.state_count() + 2);
        let task = random.below(tables.task_instance_count() + 2);
        let instance = random.below(tables.instance_count() + 2);
        let exists = tables.region_instance(region).is_some();
        assert!(exists || !machine.is_current_state(region, state));
        assert!(tables.instance(instance).is_some() || !machine.is_active(instance));
        let is_super = tables
            .state(state)
            .is_some_and(|state| matches!(state.kind, StateKind::Super { .. }));
        assert!(is_super || !machine.is_busy_inside(region, state));
        let flag = random.below(1 << 16);
        assert!(flag < tables.flag_count().next_multiple_of(32) || !machine.flag(flag));
        if tables.task_instance(task).is_none() {
            let of_none = machine.is_current(task)
                || machine.has_exited(task)
                || machine.is_busy(task)
                || machine.task_flag(task, random.below(20));
            assert!(!of_none, "task {task} does not exist");
        }
    }
}

/// The watcher.
struct Watch<'a> {
    tables: Tables<'a>,
    /// Current state of each region instance.
    current: Vec<usize>,
    enabled: Vec<bool>,
    /// The task that was enabled since the last transition.
    just_enabled: Option<usize>,
    /// Transitions of this macro step.
    taken: Vec<TransitionTaken>,
    /// The micro step that goes on, and the first region instance that may still act in it.
    micro: u8,
    from_region: usize,
}

impl<'a> Watch<'a> {
    fn new(tables: Tables<'a>) -> Self {
        Watch {
            tables,
            current: (0..tables.region_instance_count())
                .filter_map(|index| Some(tables.region_instance(index)?.initial))
                .collect(),
            enabled: vec![false; tables.task_instance_count()],
            just_enabled: None,
            taken: Vec::new(),
            micro: 0,
            from_region: 0,
        }
    }

    fn begin(&mut self) {
        self.taken.clear();
        (self.micro, self.from_region) = (0, 0);
        assert_eq!(self.just_enabled, None);
    }

    fn forget(&mut self, task: usize) {
        if let Some(enabled) = self.enabled.get_mut(task) {
            *enabled = false;
        }
    }

    fn is_real_time(&self, task: usize) -> bool {
        let state = self.tables.task_instance(task).map(|it| it.state);
        state
            .and_then(|state| self.tables.state(state))
            .is_some_and(
                |state| matches!(state.kind, StateKind::Task { real_time, .. } if real_time),
            )
    }

    fn real_time_tasks(&self) -> impl Iterator<Item = usize> {
        (0..self.enabled.len()).filter(|task| self.is_real_time(*task))
    }

    /// Whether all superstates around a region instance are current, by the watcher's account.
    fn is_active(&self, region: usize) -> bool {
        let mut region = region;
        loop {
            let of = self.tables.region_instance(region).expect("it exists");
            if of.instance == 0 {
                return true;
            }
            let (parent, state) = self.tables.superstate_of(of.instance).expect("it exists");
            if self.current[parent] != state {
                return false;
            }
            assert!(parent < region, "the way up ends");
            region = parent;
        }
    }

    fn compare<R: Reads<Vec<u8>>>(&self, machine: &Interpreter<'_, Vec<u8>, R>) {
        for (region, &state) in self.current.iter().enumerate() {
            // The current state of a region that is not active means nothing.
            let active = self.is_active(region);
            let current = active.then(|| machine.current(region));
            assert_eq!(current, active.then_some(state), "region instance {region}");
            assert_eq!(
                machine.is_region_active(region),
                active,
                "region instance {region}"
            );
        }
        for (task, &enabled) in self.enabled.iter().enumerate() {
            assert_eq!(machine.is_enabled(task), enabled, "task instance {task}");
            if enabled && self.is_real_time(task) {
                assert!(machine.is_current(task), "enabled and not current: {task}");
            }
        }
    }

    /// A state is current now; if it is a superstate, so are the initial states inside.
    fn enter(&mut self, region: usize, state: usize) {
        let tables = self.tables;
        self.current[region] = state;
        let here = tables.region_instance(region).expect("it exists");
        let instance = tables.instance(here.instance).expect("it exists");
        let entered = tables.state(state).expect("it exists");
        let mut expected = None;
        match entered.kind {
            StateKind::Task { task_offset, .. } => {
                expected = Some(instance.first_task + task_offset);
            }
            StateKind::Super { .. } => {
                let first = tables.first_region_inside(region, state);
                let mut at = first.expect("it exists");
                while at < here.next {
                    let inside = tables.region_instance(at).expect("it exists");
                    self.current[at] = inside.initial;
                    at = inside.next;
                }
            }
            StateKind::Initial => panic!("`initial` is never entered"),
            StateKind::Final | StateKind::Simple => {}
        }
        assert_eq!(
            self.just_enabled.take(),
            expected,
            "entering enables the task"
        );
    }
}

impl Observer for Watch<'_> {
    fn transition(&mut self, taken: TransitionTaken) {
        let region = usize::from(taken.region_instance);
        let index = usize::from(taken.transition);
        if taken.micro != self.micro {
            assert!(self.micro < taken.micro && taken.micro < MAX_MICRO_STEPS);
            (self.micro, self.from_region) = (taken.micro, 0);
        }
        assert!(region >= self.from_region, "regions act in their order");
        let here = self.tables.region_instance(region).expect("it exists");
        let transition = self.tables.transition(index).expect("it exists");
        let source = self.tables.source_of_transition(index);
        assert_eq!(self.current[region], source, "it leaves what is current");
        assert!(self.is_active(region), "what is not active does not act");
        let of = |state| self.tables.region_of_state(state);
        assert_eq!(of(source), of(transition.target));
        assert_eq!(transition.event == PULSE, taken.micro == 0);
        // What was inside the state that was left does not see this event, nor does what is inside
        // the one that was entered.
        self.from_region = here.next;
        self.enter(region, transition.target);
        self.taken.push(taken);
    }

    fn enabled(&mut self, task_instance: u16) {
        let task = usize::from(task_instance);
        assert!(self.just_enabled.replace(task).is_none());
        self.enabled[task] = true;
    }

    fn disabled(&mut self, task_instance: u16) {
        let task = usize::from(task_instance);
        assert!(self.is_real_time(task), "leaving ends no slot-0 run");
        assert!(
            std::mem::replace(&mut self.enabled[task], false),
            "only what was enabled is disabled"
        );
    }
}
