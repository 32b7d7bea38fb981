//! Any bytes as a blob.

use esm_core::format::{
    ACTION_SEND, FLAG_EXIT, FLAG_TIMEOUT, GUARD_TRUE, NONE, PLAIN_FLAGS, PULSE, WINDOW_FLAGS,
};
use esm_core::tables::{Code, Guard, State, StateKind, Tables};
use esm_core::{Dispatcher, Refusal, Verified, texts};
use host_tools::inspect::{self, refusal::Explained};
use host_tools::trace::directory::{Directory, NoDirectory};

use crate::random::Random;

use super::records::repaired;
use super::watched;

/// Macro steps that a blob which passed is run for.
const STEPS: usize = 6;

/// Activations of slots that are handed out.
const ACTIVATIONS: usize = 64;

/// Slots that a dispatcher is tried with.
const SLOTS: usize = 64;

/// Verifies the bytes as they are, and with magic and CRC made right; takes everything from what
/// passes, and runs it.
///
/// # Panics
/// Where a law does not hold.
pub fn verifier(bytes: &[u8]) {
    judge(bytes);
    let repaired = repaired(bytes);
    if repaired != bytes {
        judge(&repaired);
    }
}

fn judge(bytes: &[u8]) {
    let verdict = esm_core::verify(bytes.to_vec());
    let again = esm_core::verify(bytes);
    assert_eq!(
        verdict.as_ref().map(drop).map_err(|(_, refusal)| *refusal),
        again.as_ref().map(drop).map_err(|(_, refusal)| *refusal),
        "the same bytes are judged the same, whoever holds them"
    );
    match verdict {
        Err((given_back, refusal)) => {
            assert_eq!(given_back, bytes, "a refused blob is given back as it was");
            told(refusal);
        }
        Ok(verified) => {
            read_everywhere(&verified.tables());
            dispatch(&verified.tables());
            if texts::check(&verified.tables()).is_ok() {
                read_as_tools_do(&verified);
            }
            // What happens to the machine follows from the blob, so that the same bytes do the
            // same.
            let mut random = Random::new(u64::from(verified.hash()));
            watched::run(verified, &mut random, STEPS);
        }
    }
}

fn told(refusal: Refusal) {
    let text = Explained(refusal).to_string();
    assert!(!text.is_empty() && text.is_ascii(), "{text:?}");
}

/// What tools read of a blob whose texts are right.
fn read_as_tools_do(verified: &Verified<Vec<u8>>) {
    let report = inspect::Report::of(verified);
    assert_eq!(
        report.to_string(),
        inspect::Report::of(verified).to_string()
    );
    serde_json::to_string(&report).expect("a report has a JSON form");
    let directory = Directory::of(&verified.tables());
    let is_nameless = matches!(directory, Err(NoDirectory::NoNames));
    assert_eq!(is_nameless, verified.tables().names().is_none());
}

/// Reads every record, and what every index in it stands for. Each must be there: that is what
/// passing means.
pub fn read_everywhere(tables: &Tables<'_>) {
    let slots = tables.slots().len();
    assert!(tables.slot(tables.interpreter_slot()).is_some());
    assert!((1..=255).contains(&tables.queue_capacity()));
    let mut next_state = 0;
    for (index, container) in tables.containers().enumerate() {
        let first = tables.region(container.first_region).expect("a region");
        assert_eq!(first.container, index);
        let instance = tables.instance(container.first_instance);
        assert_eq!(instance.expect("an instance").container, index);
    }
    for (index, region) in tables.regions().enumerate() {
        assert_eq!(region.first_state, next_state);
        assert!(tables.container(region.container).is_some());
        next_state = read_region(tables, index, region.first_state);
    }
    assert_eq!(next_state, tables.state_count());
    for index in 0..tables.transition_count() {
        let source = tables.source_of_transition(index);
        assert!(tables.transitions_of(source).contains(&index));
    }
    for task_state in (0..tables.task_state_count()).map(|index| tables.task_state(index)) {
        let task_state = task_state.expect("a task state");
        let task = tables.task(task_state.task).expect("a task");
        assert!(task_state.slot.is_none_or(|slot| slot < slots));
        for param in 0..task.ports.params {
            assert!(tables.param(task_state.first_param + param).is_some());
        }
    }
    for task in tables.tasks() {
        let groups = tables.exclusive_group_count();
        assert!(task.exclusive.is_none_or(|it| usize::from(it) < groups));
    }
    for index in 0..tables.instance_count() {
        let instance = tables.instance(index).expect("an instance");
        let container = tables.container(instance.container).expect("a container");
        let tasks = tables.tasks_inside(index);
        assert_eq!(tasks.len(), container.task_span);
        assert!(tasks.end <= tables.task_instance_count());
        assert_eq!(tables.superstate_of(index).is_none(), index == 0);
        assert!(instance.first_flag + container.flag_span <= tables.flag_count());
        for channel in 0..container.channels {
            assert!(tables.channel(instance.first_channel + channel).is_some());
        }
    }
    for index in 0..tables.region_instance_count() {
        let region = tables.region_instance(index).expect("a region instance");
        assert!(index < region.next && region.next <= tables.region_instance_count());
        assert!(tables.instance(region.instance).is_some());
        let initial = tables.state(region.initial).expect("a state");
        assert_eq!(initial.kind, StateKind::Initial);
    }
    for index in 0..tables.channel_count() {
        let channel = tables.channel(index).expect("a channel");
        assert!((1..=tables.event_count()).contains(&usize::from(channel.event)));
        // No bit is set for a region instance that is none.
        let regions = tables.region_instance_count();
        for region in regions..regions + 64 {
            assert!(!tables.is_listening(&channel, region));
        }
    }
    for index in 0..tables.task_instance_count() {
        read_task_instance(tables, index);
    }
}

/// Reads the states of a region and what leaves them; returns where the next region begins.
fn read_region(tables: &Tables<'_>, region: usize, first_state: usize) -> usize {
    let mut index = first_state;
    loop {
        let state = tables.state(index).expect("a state");
        assert_eq!(tables.region_of_state(index), region);
        assert_eq!(state.kind == StateKind::Initial, index == first_state);
        let mut events = 0;
        let mut last = 0;
        for transition in tables.transitions_of(index) {
            let found = tables.transition(transition).expect("a transition");
            assert!(usize::from(found.event) <= tables.event_count());
            assert!(last <= found.event, "sorted by event");
            (last, events) = (found.event, events | 1 << (found.event % 32));
            assert_eq!(
                found.event == 0,
                transition < state.first_event_transition,
                "those on the pulse come first"
            );
            assert_eq!(tables.region_of_state(found.target), region);
            assert!(found.target != first_state, "`initial` cannot be entered");
            read_guard(tables, transition, &state);
            read_actions(tables, transition, &state);
        }
        assert_eq!(state.events, events);
        index += 1;
        if state.kind == StateKind::Final {
            return index;
        }
    }
}

/// Reads the guard of a transition: it asks for flags of its own, and jumps lead ahead and no
/// farther than to the end.
fn read_guard(tables: &Tables<'_>, transition: usize, source: &State) {
    let window = source.flags.min(usize::from(WINDOW_FLAGS));
    match tables.guard_of(transition).expect("a guard") {
        Guard::True => {}
        Guard::Flag { bit, .. } => assert!(bit < window),
        Guard::Mask { mask, value } => {
            assert!(mask.count_ones() > 1 && usize::from(mask) < 1 << window);
            assert_eq!(value & !mask, 0);
        }
        Guard::Program { first } => {
            let tests: Vec<Code> = tables.program_of(transition).collect();
            assert_eq!(tables.code(first + tests.len()), Some(Code::End));
            for (index, code) in tests.iter().enumerate() {
                match *code {
                    Code::Test { jump, .. } | Code::TestBusyInside { jump, .. } => {
                        assert!(jump.is_none_or(|jump| index + jump <= tests.len()));
                    }
                    Code::End | Code::Send { .. } | Code::Write { .. } => panic!("no test"),
                }
            }
        }
    }
    if source.flags == 0 {
        let guard = tables.transition(transition).map_or(0, |it| it.guard);
        assert!(guard >= GUARD_TRUE, "there are no flags to ask for");
    }
}

/// Reads the actions of a transition, and whether it is plain.
fn read_actions(tables: &Tables<'_>, transition: usize, source: &State) {
    let found = tables.transition(transition).expect("a transition");
    let target = tables.state(found.target).expect("a state");
    let actions: Vec<Code> = tables.actions_of(transition).collect();
    assert_eq!(actions.is_empty(), found.action == 0);
    for (index, code) in actions.iter().enumerate() {
        match *code {
            Code::Send { last, .. } | Code::Write { last, .. } => {
                assert_eq!(last, index + 1 == actions.len());
            }
            Code::Test { .. } | Code::TestBusyInside { .. } | Code::End => panic!("no action"),
        }
        if let Code::Write { flag, .. } = *code {
            let not_for_actions = [FLAG_EXIT, FLAG_TIMEOUT];
            assert!(!not_for_actions.contains(&flag));
            assert!(!not_for_actions.contains(&flag.wrapping_sub(target.first_flag)));
        }
    }
    let is_small = |state: &State| matches!(state.kind, StateKind::Initial | StateKind::Simple);
    let is_plain = is_small(source)
        && target.kind == StateKind::Simple
        && target.flags == 0
        && actions.is_empty();
    let is_real_time = |state: &State| {
        matches!(
            state.kind,
            StateKind::Task {
                real_time: true,
                ..
            }
        )
    };
    let is_again = is_real_time(source)
        && source.timeout_us.is_none()
        && source.flags <= usize::from(PLAIN_FLAGS)
        && tables.source_of_transition(transition) == found.target
        && found.event == PULSE
        && found.action >= ACTION_SEND;
    assert_eq!(found.is_plain, is_plain || is_again);
}

fn read_task_instance(tables: &Tables<'_>, index: usize) {
    let instance = tables.task_instance(index).expect("a task instance");
    assert!(tables.region_instance(instance.region).is_some());
    let task_state = tables.task_state_of(index).expect("its task state");
    let task = tables.task(task_state.task).expect("its task");
    let (first, length) = tables.flags_of_task(index).expect("its flags");
    assert!(first + length <= tables.flag_count());
    assert_eq!(
        length,
        3 + task.ports.flags,
        "exit, timeout, busy, and its own"
    );
    for port in 0..task.ports.data {
        let net = tables.connection(instance.first_connection + port);
        let net = net.expect("a connection");
        assert!(net.is_none_or(|net| net < tables.net_count() && net != usize::from(NONE)));
    }
}

/// Hands out activations of the slots: in the order of their starts, each in its period, none at
/// the time of another that lasts.
pub fn dispatch(tables: &Tables<'_>) {
    let Ok(mut dispatcher) = Dispatcher::<SLOTS>::new(tables.slots()) else {
        assert!(
            tables.slots().len() > SLOTS,
            "slots that passed can be dispatched"
        );
        return;
    };
    let (mut busy_from_us, mut free_from_us) = (0, 0);
    for _ in 0..ACTIVATIONS {
        let next = dispatcher.next();
        let slot = tables.slot(next.slot).expect("a slot");
        let period_us = u64::from(slot.period_us);
        assert_eq!(next.start_us % period_us, u64::from(slot.start_us));
        // A slot without duration may start together with another.
        let is_point = slot.duration_us == 0 && next.start_us == busy_from_us;
        let is_apart = next.start_us >= free_from_us;
        assert!(is_apart || is_point, "two slots overlap: {slot:?}");
        assert_eq!(dispatcher.take(next.start_us), Some(next));
        busy_from_us = next.start_us;
        free_from_us = free_from_us.max(next.start_us + u64::from(slot.duration_us));
    }
}
