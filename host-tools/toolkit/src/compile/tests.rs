//! Behaviour of compiled machines on the interpreter, and the verifier against what is no blob.

use esm_core::format::{self, Envelope, MAX_SLOTS, MAX_TIME_US, PULSE, Section};
use esm_core::tables::{Code, Guard as BlobGuard, StateKind as BlobStateKind};
use esm_core::{
    Cause, Fault, Interpreter, MAX_STEPS, Observer, Refusal, StepSummary, TransitionTaken,
    Verified, texts, verify,
};
use proptest::prelude::*;

use super::test_models::{
    STARTS_US, cd_player, container, everything, flag, limited, model, pulse, region, simple,
    superstate, task, task_state,
};
use super::{Capacity, CompileError, compile};
use crate::model::{Action, Direction, Guard, Model, Slot, SlotRef, Trigger};

fn verified(model: &Model) -> Verified<Vec<u8>> {
    verify(compile(model, &STARTS_US).unwrap())
        .map_err(|(_, refusal)| refusal)
        .unwrap()
}

/// A machine that owns its arena.
struct Machine {
    interpreter: Interpreter<'static, Vec<u8>>,
}

/// Remembers what it was told.
#[derive(Default, Debug, PartialEq)]
struct Log {
    taken: Vec<TransitionTaken>,
    enabled: Vec<u16>,
    disabled: Vec<u16>,
}

impl Observer for Log {
    fn transition(&mut self, taken: TransitionTaken) {
        self.taken.push(taken);
    }

    fn enabled(&mut self, task_instance: u16) {
        self.enabled.push(task_instance);
    }

    fn disabled(&mut self, task_instance: u16) {
        self.disabled.push(task_instance);
    }
}

impl Machine {
    fn of(model: &Model) -> Self {
        Self::run(verified(model))
    }

    fn run(verified: Verified<Vec<u8>>) -> Self {
        let arena = vec![0; verified.arena_words()].leak();
        let interpreter = Interpreter::new(verified, arena).unwrap();
        Self { interpreter }
    }

    fn step(&mut self) -> Result<StepSummary, Fault> {
        self.interpreter.macro_step(&mut ())
    }

    fn steps(&mut self, count: usize) {
        for _ in 0..count {
            self.step().unwrap();
        }
    }

    fn log(&mut self) -> Log {
        let mut log = Log::default();
        self.interpreter.macro_step(&mut log).unwrap();
        log
    }

    /// Current states of active regions, by their place in the region: `i` for initial, `f` for
    /// final.
    fn active(&self) -> String {
        let tables = self.interpreter.tables();
        let mut at = 0;
        let mut text = String::new();
        while let Some(region) = tables.region_instance(at) {
            let current = self.interpreter.current(at);
            let state = tables.state(current).unwrap();
            let place = match state.kind {
                BlobStateKind::Initial => "i".to_owned(),
                BlobStateKind::Final => "f".to_owned(),
                _ => (current - region.initial - 1).to_string(),
            };
            text.push_str(&place);
            at = match tables.first_region_inside(at, current) {
                Some(inside) => {
                    text.push('(');
                    inside
                }
                None => region.next,
            };
        }
        text
    }
}

#[test]
fn the_cd_player_plays() {
    let mut machine = Machine::of(&cd_player());
    let (play, stop, pause, open_close, cd, next, end_pause) = (0, 2, 3, 4, 5, 6, 1);
    machine.steps(1);
    let script = [
        (open_close, "10"),
        (open_close, "00"),
        (cd, "20"),
        (play, "4(i0"),
        // The first pulse inside takes the song region out of `initial`, then the event moves it.
        (next, "4(10"),
        (next, "4(20"),
        (next, "4(20"),
        (pause, "30"),
        (end_pause, "4(i0"),
        (stop, "20"),
        (stop, "20"),
    ];
    for (button, expected) in script {
        machine.interpreter.set_flag(0, button, true);
        machine.steps(1);
        assert_eq!(machine.active(), expected, "button {button}");
    }
}

#[test]
fn the_cd_player_takes_at_most_ten_bytes_a_transition() {
    let machine = verified(&cd_player());
    let tables = machine.tables();
    let bytes = 8 * tables.transition_count() + 4 * tables.code_count();
    assert!(
        bytes <= 10 * tables.transition_count(),
        "{bytes} bytes for {} transitions",
        tables.transition_count()
    );
}

#[test]
fn a_region_takes_at_most_eight_bytes_of_memory_besides_its_flags() {
    let regions = 64;
    let words = |regions| {
        let timed = |_| region("r", vec![limited("A", 1_000)], vec![pulse(None, Some(0))]);
        let root = container("Root", &[], (0..regions).map(timed).collect());
        let machine = verified(&model(&[], Vec::new(), vec![root]));
        machine.arena_words() - machine.tables().flag_count().div_ceil(32)
    };
    let bytes = 4 * (words(2 * regions) - words(regions));
    assert!(bytes <= 8 * regions, "{bytes} bytes for {regions} regions");
}

#[test]
fn guards_get_the_cheapest_form_that_fits() {
    fn not(guard: Guard) -> Guard {
        Guard::Not(Box::new(guard))
    }
    let flag_is = |bit, value| BlobGuard::Flag { bit, value };
    let mask = |mask, value| BlobGuard::Mask { mask, value };
    let program = BlobGuard::Program { first: 0 };
    let (simple_state, of_task, of_super) = (0, 1, 2);
    use Guard::{And, Busy, Exit, Or, Own, Parent, Timeout};
    // The source, its guard, the form.
    let cases = [
        (simple_state, None, BlobGuard::True),
        (simple_state, Some(Timeout), flag_is(0, true)),
        (of_task, Some(Exit), flag_is(0, true)),
        (of_task, Some(not(not(Timeout))), flag_is(1, true)),
        (of_task, Some(not(Busy)), flag_is(2, false)),
        // The last flag that is looked at together with the others, and the first that is not.
        (of_task, Some(Own(11)), flag_is(14, true)),
        (of_task, Some(Own(12)), program),
        (of_task, Some(And(vec![Exit, Own(12)])), program),
        (of_super, Some(Own(0)), flag_is(2, true)),
        (of_super, Some(Busy), program),
        (of_super, Some(And(vec![Exit, not(Busy)])), program),
        (of_task, Some(And(vec![Exit, not(Own(0))])), mask(0b1001, 1)),
        (of_task, Some(not(Or(vec![Own(0), Exit]))), mask(0b1001, 0)),
        (
            of_task,
            Some(And(vec![
                Own(0),
                not(Or(vec![Busy, not(And(vec![Exit, Timeout]))])),
            ])),
            mask(0b1111, 0b1011),
        ),
        // The same twice is one flag; what contradicts itself is no conjunction that has a mask.
        (of_task, Some(And(vec![Exit, Exit])), flag_is(0, true)),
        (of_task, Some(And(vec![Exit, not(Exit)])), program),
        (of_task, Some(Or(vec![Exit, Timeout])), program),
        (of_task, Some(not(And(vec![Exit, Timeout]))), program),
        (of_task, Some(Parent(0)), program),
        (of_task, Some(And(vec![Exit, Parent(0)])), program),
    ];
    for (source, guard, expected) in cases {
        let flags = || {
            (0..14)
                .map(|_| flag("f", Direction::Out))
                .collect::<Vec<_>>()
        };
        let said = format!("state {source}: {guard:?}");
        let mut asks = pulse(Some(source), Some(0));
        asks.guard = guard;
        let states = vec![
            simple("A"),
            task_state("T", 0, SlotRef::Slot(1)),
            superstate("S", 2),
        ];
        let around = region("r", vec![superstate("S", 1)], vec![pulse(None, Some(0))]);
        let mut middle = container(
            "Middle",
            &[],
            vec![region("r", states, vec![pulse(None, Some(0)), asks])],
        );
        let still = region("r", vec![simple("A")], vec![pulse(None, Some(0))]);
        let mut inner = container("Inner", &[], vec![still]);
        (middle.flags, inner.flags) = (flags(), flags());
        let model = model(
            &[],
            vec![task("T", flags())],
            vec![container("Root", &[], vec![around]), middle, inner],
        );
        let machine = verified(&model);
        // The machine's and the region's ways out of `initial` come before.
        assert_eq!(machine.tables().guard_of(2), Some(expected), "{said}");
    }
}

#[test]
fn transitions_stand_by_event_and_within_one_in_source_order() {
    let on = |event| pulse(Some(0), Some(0)).on_event(event);
    let transitions = vec![
        on(1).act(Action::Send(0)),
        pulse(None, Some(0)),
        on(0),
        pulse(Some(0), Some(0)).act(Action::Send(1)),
        on(1),
        pulse(Some(0), Some(0)),
        on(0).act(Action::Send(0)),
    ];
    let events = [(0, false, false), (1, false, false)];
    let root = container(
        "Root",
        &events,
        vec![region("r", vec![simple("A")], transitions)],
    );
    let machine = verified(&model(&["E", "F"], Vec::new(), vec![root]));
    let tables = machine.tables();
    let found: Vec<_> = (0..tables.transition_count())
        .map(|index| {
            let transition = tables.transition(index).unwrap();
            let sends = tables.actions_of(index).count() == 1;
            (transition.event, sends, transition.is_plain)
        })
        .collect();
    let expected = [
        (0, false, true),
        (0, true, false),
        (0, false, true),
        (1, false, true),
        (1, true, false),
        (2, true, false),
        (2, false, true),
    ];
    assert_eq!(found, expected);
    assert_eq!(tables.state(1).unwrap().events, 0b111);
}

#[test]
fn only_regions_with_transitions_on_an_event_listen_to_it() {
    let deaf = || region("deaf", vec![simple("A")], vec![pulse(None, Some(0))]);
    let hears = |event| {
        let transitions = vec![
            pulse(None, Some(0)),
            pulse(Some(0), Some(0)).on_event(event),
        ];
        region("hears", vec![simple("A")], transitions)
    };
    let mut regions: Vec<_> = (0..70).map(|_| deaf()).collect();
    regions[33] = hears(0);
    regions[64] = hears(0);
    regions[2] = region(
        "sends",
        vec![simple("A")],
        vec![
            pulse(None, Some(0)).act(Action::Send(0)),
            pulse(Some(0), Some(0)).act(Action::Send(1)),
        ],
    );
    let events = [(0, false, false), (1, false, false)];
    let root = container("Root", &events, regions);
    let machine = verified(&model(&["E", "F"], Vec::new(), vec![root]));
    let tables = machine.tables();
    let channels: Vec<_> = (0..tables.channel_count())
        .map(|index| tables.channel(index).unwrap())
        .collect();
    let listening: Vec<Vec<usize>> = channels
        .iter()
        .map(|channel| {
            (0..70)
                .filter(|it| tables.is_listening(channel, *it))
                .collect()
        })
        .collect();
    assert_eq!(listening, [vec![33, 64], vec![]]);
    assert_eq!(
        (channels[0].first_region_word, channels[0].region_words),
        (1, 2)
    );
    assert_eq!(channels[1].region_words, 0);
}

#[test]
fn the_envelope_is_postcard() {
    let blob = compile(&everything(), &STARTS_US).unwrap();
    let body = &blob[format::MAGIC.len()..blob.len() - format::CRC_BYTES];
    let envelope: Envelope<'_> = postcard::from_bytes(body).unwrap();
    assert_eq!(
        envelope.nets.len(),
        8 * verify(blob.clone()).unwrap().tables().net_count()
    );
    assert_eq!(postcard::to_stdvec(&envelope).unwrap(), body);
}

#[test]
fn equal_models_give_equal_blobs() {
    for model in [cd_player(), everything()] {
        let first = compile(&model, &STARTS_US);
        assert!(first.is_ok());
        assert_eq!(first, compile(&model, &STARTS_US));
    }
}

#[test]
fn a_container_is_stored_once_however_often_it_is_used() {
    let machine = verified(&everything());
    let tables = machine.tables();
    assert_eq!(tables.containers().len(), 3);
    // Rover, First, Nested, Left, Right.
    assert_eq!(tables.instance_count(), 5);
    let containers: Vec<_> = (0..5)
        .map(|index| tables.instance(index).unwrap().container)
        .collect();
    assert_eq!(containers, [0, 1, 2, 1, 1]);
    // Three legs with Back and Log each, then Ring.
    assert_eq!(tables.task_instance_count(), 7);
}

#[test]
fn paths_through_container_ports_make_one_net() {
    let machine = verified(&everything());
    let tables = machine.tables();
    let connections: Vec<_> = (0..tables.task_instance_count())
        .map(|index| {
            let first = tables.task_instance(index).unwrap().first_connection;
            let task = tables.task_state_of(index).unwrap().task;
            let ports = tables.task(task).unwrap().ports.data;
            (first..first + ports)
                .map(|index| tables.connection(index).unwrap())
                .collect::<Vec<_>>()
        })
        .collect();
    // Only the first leg's scan is joined outside; in the others each port has a net of its own.
    let expected = [
        vec![Some(0), Some(1)],
        vec![None],
        vec![Some(2), Some(3)],
        vec![None],
        vec![Some(4), Some(5)],
        vec![None],
        vec![Some(0)],
    ];
    assert_eq!(connections, expected);
}

/// A chain of superstates: each holds one region, whose one state is the next superstate, down to a
/// simple state.
fn nested(depth: usize) -> Model {
    let mut containers: Vec<_> = (1..depth)
        .map(|inside| {
            let inside = superstate("Inside", inside);
            container(
                "Level",
                &[],
                vec![region("r", vec![inside], vec![pulse(None, Some(0))])],
            )
        })
        .collect();
    containers.push(container(
        "Bottom",
        &[],
        vec![region(
            "r",
            vec![simple("Last")],
            vec![pulse(None, Some(0))],
        )],
    ));
    model(&[], Vec::new(), containers)
}

#[test]
fn going_down_takes_a_pulse_a_level() {
    let depth = 300;
    let mut machine = Machine::of(&nested(depth));
    for level in 1..=depth {
        machine.steps(1);
        let entered = machine.active().matches('(').count();
        assert_eq!(entered, level.min(depth - 1));
    }
    assert!(machine.active().ends_with("(0"));
    // Nothing is left to do, and the machine knows it.
    let summary = machine.step().unwrap();
    assert!(!summary.changed);
    assert_eq!(summary.step, depth as u64);
}

#[test]
fn thousands_of_states_fit() {
    let count = 5_000;
    let chain = |from| pulse(Some(from), Some((from + 1) % count));
    let mut transitions = vec![pulse(None, Some(0))];
    transitions.extend((0..count).map(chain));
    let states = (0..count).map(|_| simple("S")).collect();
    let one_region = model(
        &[],
        Vec::new(),
        vec![container(
            "Wide",
            &[],
            vec![region("r", states, transitions)],
        )],
    );
    let mut machine = Machine::of(&one_region);
    machine.steps(1 + count);
    assert_eq!(machine.active(), "0");

    let leaf = container(
        "Leaf",
        &[(0, true, true)],
        vec![region(
            "r",
            vec![simple("A"), simple("B")],
            vec![
                pulse(None, Some(0)),
                pulse(Some(0), Some(1)).on_event(0),
                pulse(Some(1), Some(0)).act(Action::Send(0)),
            ],
        )],
    );
    let regions =
        (0..2_000).map(|_| region("r", vec![superstate("S", 1)], vec![pulse(None, Some(0))]));
    let mut root = container("Many", &[(0, false, false)], regions.collect());
    root.regions.push(region(
        "kick",
        vec![simple("K"), simple("L"), simple("M")],
        vec![
            pulse(None, Some(0)),
            pulse(Some(0), Some(1)),
            pulse(Some(1), Some(2)).act(Action::Send(0)),
        ],
    ));
    let mut machine = Machine::of(&model(&["E"], Vec::new(), vec![root, leaf]));
    machine.steps(3);
    assert_eq!(machine.active(), "0(1".repeat(2_000) + "2");
}

#[test]
fn nesting_that_explodes_is_refused_with_the_capacity() {
    let mut containers: Vec<_> = (1..64)
        .map(|inside| {
            let both = vec![superstate("A", inside), superstate("B", inside)];
            container(
                "Level",
                &[],
                vec![region("r", both, vec![pulse(None, Some(0))])],
            )
        })
        .collect();
    containers.push(container(
        "Bottom",
        &[],
        vec![region("r", vec![simple("S")], vec![pulse(None, Some(0))])],
    ));
    let error = compile(&model(&[], Vec::new(), containers), &STARTS_US).unwrap_err();
    assert!(
        matches!(
            error,
            CompileError::Limit {
                capacity: Capacity::Flags | Capacity::RegionInstances | Capacity::Instances,
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn outer_wins_over_inner_and_regions_act_in_order() {
    let inside = container(
        "Inside",
        &[(0, true, false)],
        vec![region(
            "r",
            vec![simple("A"), simple("B")],
            vec![pulse(None, Some(0)), pulse(Some(0), Some(1)).on_event(0)],
        )],
    );
    let root = container(
        "Root",
        &[(0, false, false)],
        vec![
            region(
                "motion",
                vec![superstate("S", 1), simple("Out")],
                vec![pulse(None, Some(0)), pulse(Some(0), Some(1)).on_event(0)],
            ),
            region(
                "kick",
                vec![simple("A"), simple("B"), simple("C")],
                vec![
                    pulse(None, Some(0)),
                    pulse(Some(0), Some(1)),
                    pulse(Some(1), Some(2)).act(Action::Send(0)),
                ],
            ),
        ],
    );
    let mut machine = Machine::of(&model(&["E"], Vec::new(), vec![root, inside]));
    machine.steps(2);
    assert_eq!(machine.active(), "0(01");
    let log = machine.log();
    let order: Vec<_> = log
        .taken
        .iter()
        .map(|taken| (taken.micro, taken.region_instance))
        .collect();
    assert_eq!(order, [(0, 2), (1, 0)]);
    assert_eq!(machine.active(), "12");
}

/// A root region that goes from a state with a limit to another when that is over.
fn timer(limit_us: u32, period_us: u32) -> Model {
    let root = container(
        "Root",
        &[],
        vec![region(
            "r",
            vec![limited("A", limit_us), simple("B")],
            vec![
                pulse(None, Some(0)),
                pulse(Some(0), Some(1)).if_(Guard::Timeout),
            ],
        )],
    );
    let mut model = model(&[], Vec::new(), vec![root]);
    model.slots.truncate(1);
    model.slots[0].period_us = period_us;
    model.slots[0].duration_us = model.slots[0].duration_us.min(period_us);
    model
}

#[test]
fn timeouts_are_strict_at_any_scale() {
    // Entered at t = 0; left at the first multiple of the period that is above the limit.
    let cases = [
        (0, 1_000, 1),
        (999, 1_000, 1),
        (1_000, 1_000, 2),
        (5_000, 1_000, 6),
        (4_000_000_000, 1_000_000_000, 5),
        (4_000_000_000, 4_000_000_000, 2),
        (3_999_999_999, 4_000_000_000, 1),
        (4_000_000_000, 3_999_999_999, 2),
        (4_000_000_000, 300_000_000, 14),
    ];
    for (limit_us, period_us, expected) in cases {
        let model = timer(limit_us, period_us);
        let blob = verify(compile(&model, &[0]).unwrap()).unwrap();
        let mut machine = Machine::run(blob);
        machine.steps(1);
        let mut steps = 1;
        while machine.active() == "0" && steps < 100 {
            machine.steps(1);
            steps += 1;
        }
        assert_eq!(steps - 1, expected, "limit {limit_us}, period {period_us}");
    }
}

#[test]
fn missed_occurrences_count_as_time() {
    let mut machine = Machine::run(verify(compile(&timer(5_000, 1_000), &[0]).unwrap()).unwrap());
    machine.steps(1);
    machine.interpreter.skip(5);
    let summary = machine.step().unwrap();
    assert_eq!((summary.step, summary.t_us()), (6, 6_000));
    assert_eq!(machine.active(), "1");
}

/// A model with so many slots, one behind the other, and where they start.
fn with_slots(count: u32) -> (Model, Vec<u32>) {
    let mut model = timer(5_000, 1_000_000);
    let first = model.slots[0].clone();
    model.slots = (0..count)
        .map(|slot| Slot {
            number: slot + 1,
            duration_us: 1,
            ..first.clone()
        })
        .collect();
    (model, (0..count).collect())
}

#[test]
fn more_slots_than_can_be_compared_in_time_are_refused_before_they_are() {
    let (most, more) = (u32::from(MAX_SLOTS), u32::from(MAX_SLOTS) + 1);
    let (model, starts_us) = with_slots(most + 1);
    let refused = compile(&model, &starts_us).unwrap_err().to_string();
    assert!(
        refused.contains("slots") && refused.contains("4096"),
        "{refused}"
    );

    let (model, starts_us) = with_slots(3);
    let blob = compile(&model, &starts_us).unwrap();
    let body = &blob[format::MAGIC.len()..blob.len() - format::CRC_BYTES];
    for (count, is_told_by_length) in [(more, true), (4 * most, true), (most, false)] {
        // None has a number. Whoever says so has looked at one.
        let slots = vec![0; 16 * count as usize];
        let mut envelope: Envelope<'_> = postcard::from_bytes(body).unwrap();
        envelope.slots = &slots;
        let mut other = format::MAGIC.to_vec();
        other.extend(postcard::to_stdvec(&envelope).unwrap());
        let refusal = verify(sealed(&other)).unwrap_err().1;
        let by_length = refusal == Refusal::SectionLength(Section::Slots);
        assert_eq!(by_length, is_told_by_length, "{count}: {refusal:?}");
    }
}

/// A machine that has entered its state with a timeout in the macro step before the one with a
/// number.
fn timed_at(verified: &Verified<Vec<u8>>, step: u64) -> Machine {
    let mut machine = Machine::run(verified.clone());
    machine.steps(1);
    assert_eq!(machine.active(), "0");
    let mut words = machine.interpreter.state_words().to_vec();
    let first = words.len() - machine.interpreter.entered_words().len();
    for entered in &mut words[first..] {
        *entered = (step as u32).wrapping_sub(1);
    }
    let mut progress = machine.interpreter.progress();
    progress.steps = step;
    let arena = Vec::leak(vec![0; verified.arena_words()]);
    machine.interpreter = Interpreter::resume(verified.clone(), arena, &words, progress).unwrap();
    machine
}

#[test]
fn times_that_do_not_fit_stand_still_and_wrap_nowhere() {
    let period_us = MAX_TIME_US;
    let verified = verify(compile(&timer(period_us, period_us), &[0]).unwrap()).unwrap();
    let mut machine = Machine::run(verified);
    machine.steps(1);
    let mut expected = 1_u64;
    let mut last_us = 0;
    for _ in 0..70_000 {
        machine.interpreter.skip(u32::MAX);
        expected = (expected + u64::from(u32::MAX)).min(MAX_STEPS.max(expected));
        let summary = machine.step().unwrap();
        assert_eq!(summary.step, expected);
        assert_eq!(machine.active(), "1", "it was overdue");
        assert!(summary.t_us() >= last_us);
        (expected, last_us) = (expected + 1, summary.t_us());
    }
    assert!(expected > MAX_STEPS, "{expected}");
    assert_eq!(last_us, u64::MAX);
}

proptest! {
    /// Wherever a machine is in its time, and however many macro steps it misses, a timeout is
    /// taken in the first macro step whose time is above the limit.
    #[test]
    fn timeouts_are_strict_behind_any_skips(
        limit_us in prop_oneof![0..=MAX_TIME_US, Just(0), Just(MAX_TIME_US)],
        period_us in prop_oneof![1..=MAX_TIME_US, 1..=10_u32, Just(1), Just(MAX_TIME_US)],
        begun in prop_oneof![1..=MAX_STEPS, Just(1), Just(u64::from(u32::MAX)), Just(MAX_STEPS), Just(MAX_STEPS - 1)],
        skips in prop::collection::vec(prop_oneof![0..=u32::MAX, 0..=3_u32, Just(u32::MAX)], 1..5),
    ) {
        let blob = compile(&timer(limit_us, period_us), &[0]).unwrap();
        let verified = verify(blob).unwrap();
        let mut machine = timed_at(&verified, begun);
        let (entered, mut next) = (begun - 1, begun);
        for missed in skips {
            machine.interpreter.skip(missed);
            next = next.max(MAX_STEPS.min(next + u64::from(missed)));
            let summary = machine.step().unwrap();
            prop_assert_eq!(summary.step, next);
            let exact_us = u128::from(next) * u128::from(period_us);
            prop_assert_eq!(u128::from(summary.t_us()), exact_us.min(u64::MAX.into()));
            let passed_us = u128::from(next - entered) * u128::from(period_us);
            let expected = if passed_us > u128::from(limit_us) { "1" } else { "0" };
            prop_assert_eq!(machine.active(), expected);
            next += 1;
        }
    }
}

#[test]
fn entering_resets_and_leaving_disables() {
    let inside = container(
        "Inside",
        &[],
        vec![region(
            "r",
            vec![
                task_state("Fast", 0, SlotRef::Slot(1)),
                task_state("Slow", 0, SlotRef::NonRealTime),
            ],
            vec![
                pulse(None, Some(0)),
                pulse(Some(0), Some(1)).if_(Guard::Own(0)),
            ],
        )],
    );
    let root = container(
        "Root",
        &[],
        vec![
            region(
                "motion",
                vec![superstate("S", 1), simple("Out")],
                vec![
                    pulse(None, Some(0)),
                    pulse(Some(0), Some(1)).on_event(0),
                    pulse(Some(1), Some(0)).if_(Guard::Timeout),
                ],
            ),
            region(
                "control",
                vec![task_state("C", 0, SlotRef::Slot(1))],
                vec![
                    pulse(None, Some(0)),
                    pulse(Some(0), Some(0))
                        .if_(Guard::Own(0))
                        .act(Action::Send(0)),
                ],
            ),
        ],
    );
    let mut root = root;
    root.regions[0].states[1].timeout_us = Some(0);
    root.events = container("", &[(0, false, false)], Vec::new()).events;
    let flags = vec![flag("f", Direction::Out)];
    let model = model(&["E"], vec![task("T", flags)], vec![root, inside]);
    let mut machine = Machine::of(&model);
    let (fast, slow, control) = (0, 1, 2);
    machine.steps(2);
    assert_eq!(machine.active(), "0(00");
    assert_eq!(machine.interpreter.enabled_words(), [0b101]);

    machine.interpreter.set_busy(fast, true);
    assert!(machine.interpreter.is_busy_inside(0, 1));
    machine.interpreter.set_flag(control, 0, true);
    let log = machine.log();
    // C left and entered anew; then S, and with it Fast, left.
    assert_eq!(log.disabled, [2, 0]);
    assert_eq!(log.enabled, [2]);
    assert!(!machine.interpreter.task_flag(control, 0));
    assert!(machine.interpreter.is_busy(fast));
    assert_eq!(machine.interpreter.enabled_words(), [0b100]);

    machine.steps(2);
    assert_eq!(machine.active(), "0(00");
    assert!(!machine.interpreter.is_busy(fast));
    machine.interpreter.set_flag(fast, 0, true);
    machine.steps(1);
    assert_eq!(machine.active(), "0(10");
    assert_eq!(machine.interpreter.enabled_words(), [0b110]);
    // A background task goes on though its state is left.
    machine.interpreter.set_flag(control, 0, true);
    machine.steps(1);
    assert_eq!(machine.active(), "10");
    assert!(machine.interpreter.is_enabled(slow) && !machine.interpreter.is_current(slow));
    machine.interpreter.clear_enabled(slow);
    assert!(!machine.interpreter.is_enabled(slow) && !machine.interpreter.has_exited(slow));
    machine.interpreter.report_exit(control);
    assert!(machine.interpreter.has_exited(control) && !machine.interpreter.is_enabled(control));
}

#[test]
fn any_final_sets_the_exit_flag_around_it() {
    let inside = container(
        "Inside",
        &[],
        vec![
            region("a", vec![], vec![pulse(None, None)]),
            region("b", vec![simple("Stays")], vec![pulse(None, Some(0))]),
        ],
    );
    let root = container(
        "Root",
        &[],
        vec![region(
            "r",
            vec![superstate("S", 1), simple("After")],
            vec![
                pulse(None, Some(0)),
                pulse(Some(0), Some(1)).on(Trigger::Star),
                pulse(Some(1), None),
            ],
        )],
    );
    let mut machine = Machine::of(&model(&[], Vec::new(), vec![root, inside]));
    let mut seen = Vec::new();
    for _ in 0..5 {
        let finished = machine.step().unwrap().finished;
        seen.push((machine.active(), finished));
    }
    let expected = [
        ("0(ii", false),
        ("0(f0", false),
        ("1", false),
        ("f", true),
        ("f", true),
    ];
    assert!(
        seen.iter()
            .map(|(active, finished)| (active.as_str(), *finished))
            .eq(expected),
        "{seen:?}"
    );
}

#[test]
fn guards_mean_what_they_say() {
    // Every guard over four flags, against a direct evaluation, for all sixteen patterns.
    fn value(guard: &Guard, flags: u32) -> bool {
        match guard {
            Guard::Own(flag) => flags >> flag & 1 != 0,
            Guard::Not(inner) => !value(inner, flags),
            Guard::And(terms) => terms.iter().all(|term| value(term, flags)),
            Guard::Or(terms) => terms.iter().any(|term| value(term, flags)),
            _ => unreachable!("not generated"),
        }
    }
    let atom = (0..4_usize).prop_map(Guard::Own);
    let guard = atom.prop_recursive(5, 24, 4, |inner| {
        let terms = || prop::collection::vec(inner.clone(), 2..5);
        prop_oneof![
            inner.clone().prop_map(|guard| Guard::Not(Box::new(guard))),
            terms().prop_map(Guard::And),
            terms().prop_map(Guard::Or),
        ]
    });
    let mut runner = proptest::test_runner::TestRunner::new(ProptestConfig::with_cases(64));
    runner
        .run(&guard, |guard| {
            let flags = ["a", "b", "c", "d"].map(|name| flag(name, Direction::Out));
            let root = container(
                "Root",
                &[],
                vec![region(
                    "r",
                    vec![task_state("T", 0, SlotRef::Slot(1)), simple("Yes")],
                    vec![
                        pulse(None, Some(0)),
                        pulse(Some(0), Some(1)).if_(guard.clone()),
                        pulse(Some(1), Some(0)),
                    ],
                )],
            );
            let tasks = vec![task("T", flags.to_vec())];
            let mut machine = Machine::of(&model(&[], tasks, vec![root]));
            machine.steps(1);
            for pattern in 0..16 {
                for flag in 0..4 {
                    machine
                        .interpreter
                        .set_flag(0, flag, pattern >> flag & 1 != 0);
                }
                machine.steps(1);
                let expected = if value(&guard, pattern) { "1" } else { "0" };
                prop_assert_eq!(machine.active(), expected);
                if expected == "1" {
                    machine.steps(1);
                }
            }
            Ok(())
        })
        .unwrap();
}

#[test]
fn faults_stop_the_machine_and_its_real_time_tasks() {
    let sends = |count: usize| {
        let mut kick = pulse(Some(0), Some(0));
        for _ in 0..count {
            kick = kick.act(Action::Send(0));
        }
        let root = container(
            "Root",
            &[(0, false, false)],
            vec![
                region(
                    "tasks",
                    vec![
                        task_state("Fast", 0, SlotRef::Slot(1)),
                        task_state("Slow", 0, SlotRef::NonRealTime),
                    ],
                    vec![pulse(None, Some(0))],
                ),
                region(
                    "slow",
                    vec![task_state("Slow", 0, SlotRef::NonRealTime)],
                    vec![pulse(None, Some(0))],
                ),
                region("kick", vec![simple("K")], vec![pulse(None, Some(0)), kick]),
                region(
                    "echo",
                    vec![simple("E")],
                    vec![
                        pulse(None, Some(0)),
                        pulse(Some(0), Some(0)).on_event(0).act(Action::Send(0)),
                    ],
                ),
            ],
        );
        model(&["E"], vec![task("T", Vec::new())], vec![root])
    };
    let cases = [
        (2, Fault::MacroStepLimit),
        (32, Fault::MacroStepLimit),
        (33, Fault::EventQueueOverflow),
    ];
    for (count, fault) in cases {
        let mut machine = Machine::of(&sends(count));
        machine.steps(1);
        assert_eq!(machine.interpreter.enabled_words(), [0b101]);
        let mut log = Log::default();
        assert_eq!(machine.interpreter.macro_step(&mut log), Err(fault));
        let last = log.taken.last().map(|taken| taken.micro);
        let expected = match fault {
            Fault::MacroStepLimit => Some(254),
            Fault::EventQueueOverflow => None,
        };
        assert_eq!(last, expected, "{count} sends");
        assert_eq!(machine.interpreter.enabled_words(), [0b100]);
        assert_eq!(machine.step(), Err(fault));
    }
}

#[test]
fn a_superstate_that_cannot_be_left_stays_with_all_inside() {
    let still = || region("r", vec![simple("A")], vec![pulse(None, Some(0))]);
    let leave = pulse(Some(0), Some(1))
        .act(Action::Send(0))
        .act(Action::Send(0));
    let root = container(
        "Root",
        &[(0, false, false)],
        vec![region(
            "r",
            vec![superstate("S", 1), simple("Out")],
            vec![pulse(None, Some(0)), leave],
        )],
    );
    let inside = container("Inside", &[], vec![still(), still()]);
    let mut model = model(&["E"], Vec::new(), vec![root, inside]);
    model.queue = 1;
    let mut machine = Machine::of(&model);
    machine.steps(1);
    assert_eq!(machine.step(), Err(Fault::EventQueueOverflow));
    assert!((0..3).all(|region| machine.interpreter.is_region_active(region)));
    assert_eq!(machine.active(), "0(ii");
}

#[test]
fn events_are_seen_where_they_are_forwarded_to() {
    // Root holds A and B side by side; each holds an inner one. Who is in state 1 has seen the
    // event. By container: forwarded in, forwarded out. The sender is the inner one of A.
    /// Name, forwarding of the three containers, who sees it.
    type Case = (&'static str, [(bool, bool); 3], [bool; 5]);
    let cases: [Case; 5] = [
        (
            "local",
            [(false, false); 3],
            [false, false, true, false, false],
        ),
        (
            "up one",
            [(false, false), (false, false), (false, true)],
            [false, true, true, false, false],
        ),
        (
            "up to the root",
            [(false, false), (false, true), (false, true)],
            [true, true, true, false, false],
        ),
        (
            "up and down one",
            [(false, false), (true, true), (false, true)],
            [true, true, true, true, false],
        ),
        (
            "everywhere",
            [(false, false), (true, true), (true, true)],
            [true; 5],
        ),
    ];
    for (name, [root_forwards, outer_forwards, inner_forwards], expected) in cases {
        let listen = || {
            region(
                "listen",
                vec![simple("No"), simple("Yes")],
                vec![pulse(None, Some(0)), pulse(Some(0), Some(1)).on_event(0)],
            )
        };
        let kick = region(
            "kick",
            vec![task_state("K", 0, SlotRef::Slot(1)), simple("Sent")],
            vec![
                pulse(None, Some(0)),
                pulse(Some(0), Some(1))
                    .if_(Guard::Own(0))
                    .act(Action::Send(0)),
            ],
        );
        let inside = |index| {
            region(
                "r",
                vec![superstate("S", index)],
                vec![pulse(None, Some(0))],
            )
        };
        let forwards = |(down, up)| [(0, down, up)];
        let containers = vec![
            container(
                "Root",
                &forwards(root_forwards),
                vec![listen(), inside(1), inside(1)],
            ),
            container(
                "Outer",
                &forwards(outer_forwards),
                vec![listen(), inside(2)],
            ),
            container("Inner", &forwards(inner_forwards), vec![listen(), kick]),
        ];
        let kicker = task("Kick", vec![flag("f", Direction::Out)]);
        let mut machine = Machine::of(&model(&["E"], vec![kicker], containers));
        machine.steps(4);
        machine.interpreter.set_flag(0, 0, true);
        machine.steps(1);
        // The listening regions of Root, A, A's inner, B, B's inner.
        let tables = machine.interpreter.tables();
        let seen = [0, 1, 2, 3, 4].map(|instance| {
            let region = tables.instance(instance).unwrap().first_region;
            let initial = tables.region_instance(region).unwrap().initial;
            machine.interpreter.current(region) == initial + 2
        });
        assert_eq!(seen, expected, "{name}");
    }
}

#[test]
fn every_flipped_byte_and_every_prefix_is_refused() {
    let blob = compile(&everything(), &STARTS_US).unwrap();
    for at in 0..blob.len() {
        let mut flipped = blob.clone();
        flipped[at] ^= 0x10;
        assert!(verify(flipped).is_err(), "byte {at}");
        assert!(verify(&blob[..at]).is_err(), "prefix {at}");
    }
}

#[test]
fn what_is_wrong_is_told() {
    let blob = compile(&cd_player(), &STARTS_US).unwrap();
    let mut other = blob.clone();
    other[3] = b'9';
    assert_eq!(verify(other).unwrap_err().1, Refusal::Magic);
    let mut other = blob.clone();
    *other.last_mut().unwrap() ^= 1;
    assert!(matches!(
        verify(other).unwrap_err().1,
        Refusal::Checksum { .. }
    ));
    let error = compile(&cd_player(), &[0, 50]).unwrap_err();
    assert_eq!(error, CompileError::Schedule { number: 2 });
    let truncated = sealed(&blob[..blob.len() / 2]);
    assert_eq!(verify(truncated).unwrap_err().1, Refusal::Cut);
}

/// Puts a right CRC behind a body.
fn sealed(body: &[u8]) -> Vec<u8> {
    let mut blob = body.to_vec();
    blob.extend_from_slice(&format::crc32(body).to_le_bytes());
    blob
}

/// Runs a blob that passed the verifier with random flags, for as long as it may. What it must not
/// do is panic or hang.
fn survive(blob: Verified<Vec<u8>>, seed: u64) {
    if blob.arena_words() > 1 << 16 {
        return;
    }
    let tasks = blob.tables().task_instance_count();
    let mut machine = Machine::run(blob);
    let mut random = seed | 1;
    for _ in 0..50 {
        for task in 0..tasks.min(64) {
            random = random
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            let bits = random >> 33;
            machine
                .interpreter
                .set_flag(task, (bits & 3) as usize, bits & 4 != 0);
            machine.interpreter.set_busy(task, bits & 8 != 0);
            if bits & 0x70 == 0 {
                machine.interpreter.report_exit(task);
            }
        }
        if machine.step().is_err() {
            break;
        }
    }
    let end = machine.interpreter.tables().region_instance_count();
    let active = (0..end).filter(|region| machine.interpreter.is_region_active(*region));
    assert!(active.into_iter().all(|region| {
        let tables = machine.interpreter.tables();
        let initial = tables.region_instance(region).unwrap().initial;
        let region_of = |state| tables.region_of_state(state);
        region_of(machine.interpreter.current(region)) == region_of(initial)
    }));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// The CRC is right, the content is not: it is the verifier that stands between.
    #[test]
    fn mutated_blobs_are_refused_or_run(
        everything_else in any::<bool>(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), any::<bool>()), 1..4),
        seed in any::<u64>(),
    ) {
        let model = if everything_else { everything() } else { cd_player() };
        let blob = compile(&model, &STARTS_US).unwrap();
        let mut body = blob[..blob.len() - format::CRC_BYTES].to_vec();
        for (index, value, small) in changes {
            let at = index.index(body.len());
            body[at] = if small { body[at].wrapping_add(value % 5).wrapping_sub(2) } else { value };
        }
        if let Ok(verified) = verify(sealed(&body)) {
            // Whatever it says, it says it without a panic.
            let _ = texts::check(&verified.tables());
            let _ = crate::inspect::Report::of(&verified).to_string();
            survive(verified, seed);
        }
    }

    #[test]
    fn random_bytes_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let mut body = format::MAGIC.to_vec();
        body.extend_from_slice(&bytes);
        prop_assert!(verify(sealed(&body)).is_err());
        prop_assert!(verify(bytes).is_err());
    }
}

#[test]
fn every_single_byte_change_with_a_right_crc_is_refused_or_runs() {
    let blob = compile(&everything(), &STARTS_US).unwrap();
    let body = &blob[..blob.len() - format::CRC_BYTES];
    let mut refused = 0;
    for at in 0..body.len() {
        for change in [1, 0x80, 0xFF] {
            let mut other = body.to_vec();
            other[at] ^= change;
            match verify(sealed(&other)) {
                Ok(verified) => survive(verified, at as u64),
                Err(_) => refused += 1,
            }
        }
    }
    // Names, parameter values, operands within range and the like are free; the rest is not.
    assert!(
        refused > body.len(),
        "{refused} of {} refused",
        3 * body.len()
    );
}

/// A change of one field, and what it must be refused with.
type Planted = (&'static str, Section, usize, u16, Cause);

#[test]
fn each_rule_of_the_format_is_kept() {
    // Field numbers count 16-bit fields from the table's start; values replace them. `everything`
    // has 5 instances, 10 region instances.
    let blob = compile(&everything(), &STARTS_US).unwrap();
    let body = &blob[format::MAGIC.len()..blob.len() - format::CRC_BYTES];
    let cases: [Planted; 23] = [
        ("queue of 0", Section::Mission, 0, 0, Cause::Range),
        ("queue of 256", Section::Mission, 0, 256, Cause::Range),
        ("interpreter slot", Section::Mission, 1, 2, Cause::Index),
        (
            "start behind period",
            Section::Slots,
            6,
            1_000,
            Cause::Range,
        ),
        (
            "interpreter slot that starts late",
            Section::Mission,
            1,
            1,
            Cause::Range,
        ),
        (
            "slots on each other",
            Section::Slots,
            14,
            50,
            Cause::Overlap,
        ),
        ("region order", Section::Containers, 8, 3, Cause::Order),
        ("region span", Section::Containers, 6, 11, Cause::Template),
        ("self-contained", Section::Instances, 6, 0, Cause::Kind),
        ("walk back", Section::RegionInstances, 4, 0, Cause::Template),
        (
            "walk in place",
            Section::RegionInstances,
            4,
            1,
            Cause::Template,
        ),
        (
            "walk out of an instance",
            Section::RegionInstances,
            4,
            9,
            Cause::Template,
        ),
        (
            "foreign state",
            Section::RegionInstances,
            2,
            1,
            Cause::Template,
        ),
        (
            "foreign flags",
            Section::RegionInstances,
            5,
            0,
            Cause::Template,
        ),
        ("target initial", Section::Transitions, 1, 0, Cause::Index),
        ("target elsewhere", Section::Transitions, 1, 5, Cause::Index),
        ("unknown event", Section::Transitions, 4, 9, Cause::Index),
        ("pseudo-state kind", Section::States, 5, 0x4000, Cause::Kind),
        ("flag order", Section::States, 12, 3, Cause::Order),
        ("unknown net", Section::Connections, 0, 99, Cause::Index),
        (
            "net of another type",
            Section::Connections,
            0,
            1,
            Cause::Type,
        ),
        (
            "channel of the pulse",
            Section::Channels,
            0,
            PULSE,
            Cause::Index,
        ),
        ("signature hash", Section::Tasks, 0, 0, Cause::Text),
    ];
    for (name, section, field, value, expected) in cases {
        let mut envelope: Envelope<'_> = postcard::from_bytes(body).unwrap();
        let mut changed = section_of(&mut envelope, section).to_vec();
        changed[2 * field..2 * field + 2].copy_from_slice(&value.to_le_bytes());
        *section_of(&mut envelope, section) = &changed;
        let mut other = format::MAGIC.to_vec();
        other.extend(postcard::to_stdvec(&envelope).unwrap());
        let refusal = match verify(sealed(&other)) {
            Ok(verified) => texts::check(&verified.tables()).expect_err(name),
            Err((_, refusal)) => refusal,
        };
        let Refusal::Record { cause, .. } = refusal else {
            panic!("{name}: {refusal:?}");
        };
        assert_eq!(cause, expected, "{name}: {refusal:?}");
    }
}

fn section_of<'e, 'a>(envelope: &'e mut Envelope<'a>, section: Section) -> &'e mut &'a [u8] {
    match section {
        Section::Mission => &mut envelope.mission,
        Section::Slots => &mut envelope.slots,
        Section::Containers => &mut envelope.containers,
        Section::States => &mut envelope.states,
        Section::Transitions => &mut envelope.transitions,
        Section::Instances => &mut envelope.instances,
        Section::RegionInstances => &mut envelope.region_instances,
        Section::Channels => &mut envelope.channels,
        Section::Tasks => &mut envelope.tasks,
        Section::Connections => &mut envelope.connections,
        other => panic!("no case changes {other:?}"),
    }
}

#[test]
fn jumps_stay_inside_their_guard() {
    let blob = compile(&everything(), &STARTS_US).unwrap();
    let verified = verify(blob).unwrap();
    let tables = verified.tables();
    let mut jumps = 0;
    for transition in 0..tables.transition_count() {
        let tests: Vec<_> = tables.program_of(transition).collect();
        for (at, code) in tests.iter().enumerate() {
            if let Code::Test {
                jump: Some(jump), ..
            } = code
            {
                assert!(at + jump <= tests.len());
                jumps += 1;
            }
        }
    }
    assert!(jumps > 0);
}

#[test]
fn a_machine_without_regions_has_nothing_to_run() {
    let text = "interpreter slot 1; slot 1 period 10 ms duration 1 ms; machine M { event E; }";
    let checked = crate::lang::load_text("m.esm", text);
    assert!(!checked.has_errors(), "the grammar allows it");
    let error = super::compile(&checked.model.unwrap(), &[0]).unwrap_err();
    assert!(matches!(&error, CompileError::NothingToRun { machine } if machine == "M"));
    assert!(error.to_string().contains("give it one"), "{error}");
}
