//! Each rule of the blob format, broken once in a blob that is right: what the verifier says of it.

use esm_core::format::{
    self, ACTION_ROW, ACTION_SEND, CODE_END, CODE_JUMP_IF_BUSY_INSIDE, CODE_LOW_MASK,
    CODE_OPERATION_SHIFT, CODE_SET, GUARD_IF_CLEAR, GUARD_MASK, GUARD_PROGRAM, GUARD_TRUE,
    MAX_TIME_US, NONE, STATE_HAS_TIMEOUT, Section, TRANSITION_IS_PLAIN,
};
use esm_core::tables::{Guard, State, StateKind, Tables, Transition};
use esm_core::{Cause, Refusal, verify};

/// Two levels, two instances of the inner one, every form of guard and action, timers, tasks with
/// parameters and connections.
const MISSION: &str = "
    interpreter slot 1;
    slot 1 period 10 ms duration 1 ms;
    slot 2 period 20 ms duration 1 ms;
    task Job slot 2 { in flag go; out flag done; out flag stuck; in data i: T; out data o: T; param p: i32 = 1; }
    task Idle slot 0 { out flag done; }
    container Inner {
        in event Down; out event Up; in flag go; out flag ready;
        event Here;
        region r {
            state A timeout 1 s; state B timeout 2 s; state C; task T: Job; task U: Job timeout 3 s; task I: Idle;
            initial -> A [^go]; initial -> B;
            A -> B on Here; A -> C on Down; A -> C on pulse [timeout];
            B -> C on pulse [not timeout and ^go] / set ^ready, send Up;
            C -> T on Here / set .go; C -> U on Down / send Up; C -> B on Here / send Here;
            T -> I on pulse [.done and not .stuck]; T -> A on pulse [.done and ^go or exit]; T -> C on Here [not .stuck];
            U -> C on *;
            I -> C on pulse [exit];
        }
        region s { state On; initial -> On; On -> On on Here; On -> final on Down; }
        path T.o -> U.i; path U.o -> T.i;
    }
    machine M {
        event Down, Up;
        region m {
            state Off; super S: Inner; super Z: Inner timeout 5 s;
            initial -> Off;
            Off -> S on Up / set .go; Off -> Z on pulse;
            S -> Off on Up [.ready]; S -> Z on pulse [not busy]; Z -> S on pulse [timeout and .ready] / send Down;
        }
    }";

/// A change of one 16-bit field, and what is said of it: which record of which section is wrong,
/// and why.
struct Case {
    rule: &'static str,
    section: Section,
    record: usize,
    field: usize,
    change: fn(u16) -> u16,
    refused: (Section, usize, Cause),
}

fn compiled() -> Vec<u8> {
    let checked = crate::lang::load_text("m.esm", MISSION);
    assert!(!checked.has_errors(), "{:?}", checked.diagnostics);
    super::compile(&checked.model.unwrap(), &[0, 1_000]).unwrap()
}

/// The sections of a mission without links.
fn of_all_missions() -> impl Iterator<Item = Section> {
    (Section::ALL.into_iter()).filter(|it| !matches!(it, Section::Links | Section::Frames))
}

/// The blob with something else in its sections, its lengths and its CRC right.
fn changed(blob: &[u8], change: impl FnOnce(&mut [Vec<u8>])) -> Vec<u8> {
    let mut rest = &blob[format::MAGIC.len()..blob.len() - format::CRC_BYTES];
    let mut sections = Vec::new();
    for _ in Section::ALL
        .into_iter()
        .filter(|it| !matches!(it, Section::Links | Section::Frames))
    {
        let (section, behind) = postcard::take_from_bytes::<&[u8]>(rest).unwrap();
        sections.push(section.to_vec());
        rest = behind;
    }
    change(&mut sections);
    let mut other = format::MAGIC.to_vec();
    for section in &sections {
        other.extend(postcard::to_stdvec(section.as_slice()).unwrap());
    }
    let crc = format::crc32(&other);
    other.extend_from_slice(&crc.to_le_bytes());
    other
}

fn words_of(section: Section) -> usize {
    /// 16-bit words of a record of each section, as the format lists them; none of texts.
    const WORDS: [usize; Section::ALL.len()] = [
        5, 8, 8, 2, 8, 4, 2, 2, 6, 4, 4, 2, 10, 0, 4, 2, 5, 1, 4, 0, 8, 14,
    ];
    WORDS[section as usize]
}

/// What a blob is refused with, changed in one field.
fn refusal(blob: &[u8], case: &Case) -> Option<Refusal> {
    let other = changed(blob, |sections| {
        let at = 2 * (case.record * words_of(case.section) + case.field);
        let field = &mut sections[case.section as usize][at..at + 2];
        let old = u16::from_le_bytes([field[0], field[1]]);
        let new = (case.change)(old);
        assert_ne!(old, new, "{}: a change that changes nothing", case.rule);
        field.copy_from_slice(&new.to_le_bytes());
    });
    verify(other).err().map(|(_, refusal)| refusal)
}

/// The first state for which something holds.
fn state_where(tables: &Tables<'_>, holds: impl Fn(usize, &State) -> bool) -> usize {
    (0..tables.state_count())
        .find(|index| holds(*index, &tables.state(*index).unwrap()))
        .unwrap()
}

/// The first transition for which something holds, asked with the state that it leaves.
fn transition_where(
    tables: &Tables<'_>,
    holds: impl Fn(usize, &Transition, &State) -> bool,
) -> usize {
    (0..tables.transition_count())
        .find(|index| {
            let source = tables.state(tables.source_of_transition(*index)).unwrap();
            holds(*index, &tables.transition(*index).unwrap(), &source)
        })
        .unwrap()
}

fn kind_of(tables: &Tables<'_>, state: usize) -> StateKind {
    tables.state(state).unwrap().kind
}

#[test]
fn each_rule_is_kept_and_what_breaks_it_is_told() {
    use Cause::{Direction, Index, Kind, Order, Range, Template};
    use Section::{
        Channels, Code, Instances, Listeners, RegionInstances, States, TaskInstances, TaskStates,
        Timers, Transitions,
    };
    let blob = compiled();
    let verified = verify(blob.as_slice()).unwrap();
    let tables = &verified.tables();

    let is_super = |kind| matches!(kind, StateKind::Super { .. });
    let is_task = |kind| matches!(kind, StateKind::Task { .. });
    let has_both = state_where(tables, |index, state| {
        state.first_transition < state.first_event_transition
            && tables.transitions_of(index).end > state.first_event_transition
    });
    let behind = tables.transitions_of(has_both).end;
    let three_events = state_where(tables, |index, state| {
        tables.transitions_of(index).end > state.first_event_transition + 2
    });
    let first_of_three = tables.state(three_events).unwrap().first_event_transition;
    let quiet_task = state_where(tables, |_, state| {
        is_task(state.kind) && state.timeout_us.is_none()
    });
    let timed = state_where(tables, |_, state| state.timeout_us.is_some());
    let second_timed = state_where(tables, |index, state| {
        index > timed && state.timeout_us.is_some()
    });
    let second_task = state_where(tables, |index, state| {
        index > quiet_task && is_task(state.kind)
    });
    let superstate = state_where(tables, |_, state| is_super(state.kind));
    let last = state_where(tables, |_, state| state.kind == StateKind::Final);
    let simple_without_flags = state_where(tables, |_, state| {
        state.kind == StateKind::Simple && state.flags == 0
    });

    let plain = transition_where(tables, |_, transition, _| transition.is_plain);
    let acting = transition_where(tables, |_, transition, source| {
        transition.action != 0 && source.kind == StateKind::Simple
    });
    let of_initial = transition_where(tables, |_, transition, source| {
        source.kind == StateKind::Initial && transition.guard == GUARD_TRUE
    });
    let guarded = |of: fn(Guard) -> bool| {
        transition_where(tables, |index, _, source| {
            source.kind != StateKind::Initial && of(tables.guard_of(index).unwrap())
        })
    };
    let flag_guard = guarded(|guard| matches!(guard, Guard::Flag { value: true, .. }));
    let clear_guard = guarded(|guard| matches!(guard, Guard::Flag { value: false, .. }));
    let mask_guard = guarded(|guard| matches!(guard, Guard::Mask { .. }));
    let mask = usize::from(tables.transition(mask_guard).unwrap().guard - GUARD_MASK);
    let program_of_task = transition_where(tables, |index, _, source| {
        is_task(source.kind) && matches!(tables.guard_of(index), Some(Guard::Program { .. }))
    });
    let program = usize::from(tables.transition(program_of_task).unwrap().guard - GUARD_PROGRAM);
    let tests = tables.program_of(program_of_task).count();
    let row_of = |wanted: usize| {
        transition_where(tables, |index, transition, _| {
            transition.action != 0
                && transition.action < ACTION_SEND
                && tables.actions_of(index).count() == wanted
        })
    };
    let (long_row, write_row) = (row_of(2), row_of(1));
    let row = usize::from(tables.transition(long_row).unwrap().action - ACTION_ROW);
    let write = usize::from(tables.transition(write_row).unwrap().action - ACTION_ROW);
    let single_send = transition_where(tables, |_, transition, _| transition.action >= ACTION_SEND);

    let real_time = (0..tables.task_state_count())
        .find(|index| tables.task_state(*index).unwrap().slot.is_some())
        .unwrap();
    let background = (0..tables.task_state_count())
        .find(|index| tables.task_state(*index).unwrap().slot.is_none())
        .unwrap();
    let heard = (0..tables.channel_count())
        .find(|index| tables.channel(*index).unwrap().region_words > 0)
        .unwrap();
    let row_word = tables.channel(heard).unwrap().first_row_word;
    let (region, instance, task) = (1, 1, 1);
    assert!(tables.instance_count() > 2 && tables.task_instance_count() > 2);
    assert!(
        !tables.region_instance_count().is_multiple_of(32),
        "a row has bits left over"
    );
    assert_eq!(
        kind_of(tables, last + 1),
        StateKind::Initial,
        "another region follows"
    );

    let case = |rule, (section, record, field), change, refused| Case {
        rule,
        section,
        record,
        field,
        change,
        refused,
    };
    let flip: fn(u16) -> u16 = |old| old ^ 1 << 7;
    let more: fn(u16) -> u16 = |old| old + 1;
    let less: fn(u16) -> u16 = |old| old - 1;
    let without_lowest_bit: fn(u16) -> u16 = |old| old & (old - 1);
    let cases = [
        case(
            "no event too many, low",
            (States, has_both, 0),
            flip,
            (States, has_both, Order),
        ),
        case(
            "no event too many, high",
            (States, has_both, 1),
            flip,
            (States, has_both, Order),
        ),
        case(
            "no event too few",
            (States, has_both, 0),
            without_lowest_bit,
            (States, has_both, Order),
        ),
        case(
            "no event of final",
            (States, last, 0),
            |_| 1,
            (States, last, Order),
        ),
        case(
            "transitions in order",
            (States, has_both + 1, 2),
            more,
            (Transitions, behind, Order),
        ),
        case(
            "pulse first",
            (States, has_both, 3),
            more,
            (States, has_both, Order),
        ),
        case(
            "events behind the pulse",
            (States, has_both, 3),
            less,
            (States, has_both, Order),
        ),
        case(
            "events sorted",
            (Transitions, first_of_three + 2, 0),
            less,
            (Transitions, first_of_three + 2, Order),
        ),
        case(
            "flags in order",
            (States, timed, 4),
            more,
            (States, timed, Order),
        ),
        case(
            "flags of a task",
            (States, quiet_task, 5),
            more,
            (States, quiet_task, Kind),
        ),
        case(
            "flags of a superstate",
            (States, superstate, 5),
            more,
            (States, superstate, Kind),
        ),
        case(
            "flags of a simple state",
            (States, simple_without_flags, 5),
            |old| old + 2,
            (Transitions, of_initial, Kind),
        ),
        case(
            "no unknown kind",
            (States, simple_without_flags, 5),
            |_| 0xC000,
            (Transitions, of_initial, Kind),
        ),
        case(
            "no initial but the first",
            (States, simple_without_flags, 5),
            |_| 0,
            (Transitions, of_initial, Kind),
        ),
        case(
            "final last",
            (States, last, 5),
            |_| 0x4000,
            (States, last, Kind),
        ),
        case(
            "no timeout of final",
            (States, last, 5),
            |old| old | STATE_HAS_TIMEOUT,
            (States, last, Kind),
        ),
        case(
            "a timer of each timed state",
            (States, timed, 5),
            |old| old & !STATE_HAS_TIMEOUT,
            (States, second_timed, Order),
        ),
        case(
            "timers in order",
            (States, second_timed, 7),
            less,
            (States, second_timed, Order),
        ),
        case(
            "no timer of others",
            (States, simple_without_flags, 7),
            more,
            (States, simple_without_flags, Order),
        ),
        case(
            "timers in range",
            (Timers, 0, 1),
            |_| (MAX_TIME_US >> 16) as u16 + 1,
            (Timers, 0, Range),
        ),
        case(
            "task instances in order",
            (States, second_task, 6),
            less,
            (States, second_task, Order),
        ),
        case(
            "instances in order",
            (States, superstate, 6),
            more,
            (States, superstate, Order),
        ),
        case(
            "no part of simple states",
            (States, simple_without_flags, 6),
            more,
            (States, simple_without_flags, Order),
        ),
        case(
            "plain marked",
            (Transitions, plain, 0),
            |old| old & !TRANSITION_IS_PLAIN,
            (Transitions, plain, Kind),
        ),
        case(
            "others not marked",
            (Transitions, acting, 0),
            |old| old | TRANSITION_IS_PLAIN,
            (Transitions, acting, Kind),
        ),
        case(
            "no guard 15",
            (Transitions, flag_guard, 2),
            |_| 15,
            (Transitions, flag_guard, Index),
        ),
        case(
            "own flag set",
            (Transitions, flag_guard, 2),
            |_| 14,
            (Transitions, flag_guard, Index),
        ),
        case(
            "own flag clear",
            (Transitions, clear_guard, 2),
            |_| GUARD_IF_CLEAR + 14,
            (Transitions, clear_guard, Index),
        ),
        case(
            "no flags of initial",
            (Transitions, of_initial, 2),
            |_| 0,
            (Transitions, of_initial, Index),
        ),
        case(
            "a mask in its place",
            (Transitions, mask_guard, 2),
            more,
            (Code, mask, Order),
        ),
        case(
            "a mask has two bits",
            (Code, mask, 0),
            without_lowest_bit,
            (Code, mask, Index),
        ),
        case(
            "a mask of own flags",
            (Code, mask, 0),
            |old| old | 1 << 14,
            (Code, mask, Index),
        ),
        case(
            "a mask in the window",
            (Code, mask, 0),
            |old| old | 1 << 15,
            (Code, mask, Index),
        ),
        case(
            "a value in the mask",
            (Code, mask, 1),
            |_| 1 << 4,
            (Code, mask, Index),
        ),
        case(
            "a program in its place",
            (Transitions, program_of_task, 2),
            more,
            (Code, program, Order),
        ),
        case(
            "a test of a flag that it may name",
            (Code, program, 0),
            |old| old + 40,
            (Code, program, Index),
        ),
        case(
            "a program of tests",
            (Code, program, 1),
            |_| CODE_SET << CODE_OPERATION_SHIFT,
            (Code, program, Kind),
        ),
        case(
            "busy inside superstates only",
            (Code, program, 1),
            |_| CODE_JUMP_IF_BUSY_INSIDE << CODE_OPERATION_SHIFT,
            (Code, program, Kind),
        ),
        case(
            "jumps inside the program",
            (Code, program, 1),
            |old| old & !CODE_LOW_MASK | 40,
            (Code, program + tests, Direction),
        ),
        case(
            "a program has an end",
            (Code, program + tests, 1),
            |_| CODE_SET << CODE_OPERATION_SHIFT,
            (Code, program + tests, Kind),
        ),
        case(
            "a row in its place",
            (Transitions, long_row, 3),
            more,
            (Code, row, Order),
        ),
        case(
            "a row of actions",
            (Code, row, 1),
            |_| CODE_END << CODE_OPERATION_SHIFT | 1,
            (Code, row, Kind),
        ),
        case(
            "a row has an end",
            (Code, row + 1, 1),
            |old| old & !CODE_LOW_MASK,
            (Code, row + 2, Index),
        ),
        case(
            "a flag that an action may name",
            (Code, write, 0),
            |old| old + 40,
            (Code, write, Index),
        ),
        case(
            "a channel of a row",
            (Code, row + 1, 0),
            |_| 9,
            (Code, row + 1, Index),
        ),
        case(
            "a channel of the instance",
            (Transitions, single_send, 3),
            |_| ACTION_SEND + 9,
            (Transitions, single_send, Index),
        ),
        case(
            "root in container 0",
            (Instances, 0, 5),
            more,
            (Instances, 0, Template),
        ),
        case(
            "container of an instance",
            (Instances, instance + 1, 0),
            less,
            (States, superstate + 1, Kind),
        ),
        case(
            "regions of an instance",
            (Instances, instance, 1),
            more,
            (Instances, instance, Template),
        ),
        case(
            "flags of an instance",
            (Instances, instance, 2),
            more,
            (Instances, instance, Template),
        ),
        case(
            "channels of an instance",
            (Instances, instance, 3),
            more,
            (Instances, instance, Order),
        ),
        case(
            "tasks of an instance",
            (Instances, instance + 1, 4),
            less,
            (Instances, instance + 1, Template),
        ),
        case(
            "region around an instance",
            (Instances, instance, 5),
            more,
            (Instances, instance, Template),
        ),
        case(
            "next region",
            (RegionInstances, region, 0),
            less,
            (RegionInstances, region, Template),
        ),
        case(
            "next region, too far",
            (RegionInstances, region, 0),
            more,
            (RegionInstances, region, Template),
        ),
        case(
            "flags of a region",
            (RegionInstances, region, 1),
            more,
            (RegionInstances, region, Template),
        ),
        case(
            "initial of a region",
            (RegionInstances, region, 2),
            more,
            (RegionInstances, region, Template),
        ),
        case(
            "instance of a region",
            (RegionInstances, region, 3),
            more,
            (RegionInstances, region, Template),
        ),
        case(
            "state of a task",
            (TaskInstances, task, 0),
            less,
            (TaskInstances, task, Template),
        ),
        case(
            "region of a task",
            (TaskInstances, task, 1),
            less,
            (TaskInstances, task, Template),
        ),
        case(
            "connections of a task",
            (TaskInstances, task, 2),
            more,
            (TaskInstances, task, Order),
        ),
        case(
            "first connection",
            (TaskInstances, 0, 2),
            more,
            (TaskInstances, 0, Order),
        ),
        case(
            "flags of a task instance",
            (TaskInstances, task, 3),
            more,
            (TaskInstances, task, Template),
        ),
        case(
            "task state of a task",
            (TaskInstances, task, 4),
            less,
            (TaskInstances, task, Template),
        ),
        case(
            "slot of a real-time task",
            (TaskStates, real_time, 1),
            |_| NONE,
            (TaskStates, real_time, Index),
        ),
        case(
            "slot in the table",
            (TaskStates, real_time, 1),
            |_| 2,
            (TaskStates, real_time, Index),
        ),
        case(
            "no slot of others",
            (TaskStates, background, 1),
            |_| 0,
            (TaskStates, background, Index),
        ),
        case(
            "parameters in order",
            (TaskStates, 1, 2),
            more,
            (TaskStates, 1, Order),
        ),
        case(
            "state of a task state",
            (TaskStates, 1, 3),
            more,
            (TaskStates, 1, Template),
        ),
        case(
            "no channel of the pulse",
            (Channels, heard, 0),
            |_| 0,
            (Channels, heard, Index),
        ),
        case(
            "a row in the table",
            (Channels, heard, 1),
            |_| NONE,
            (Channels, heard, Index),
        ),
        case(
            "a row of regions",
            (Channels, heard, 2),
            |_| 40,
            (Channels, heard, Index),
        ),
        case(
            "a row of some words",
            (Channels, heard, 3),
            |_| NONE,
            (Channels, heard, Index),
        ),
        case(
            "no bits behind the last region",
            (Listeners, row_word, 0),
            |old| old | 1,
            (Listeners, row_word, Range),
        ),
    ];
    let mut wrong = Vec::new();
    for case in &cases {
        let (section, index, cause) = case.refused;
        let expected = Refusal::Record {
            section,
            index: index as u16,
            cause,
        };
        let found = refusal(&blob, case);
        if found != Some(expected) {
            wrong.push(format!("{}: {found:?} instead of {expected:?}", case.rule));
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn nothing_is_left_over() {
    let blob = compiled();
    for section in of_all_missions() {
        let record_bytes = 2 * words_of(section);
        let excess = |sections: &mut [Vec<u8>]| {
            let bytes = &mut sections[section as usize];
            let last = bytes[bytes.len() - record_bytes..].to_vec();
            bytes.extend(last);
        };
        // More slots, rows and nets than somebody uses do no harm; a slot more is there twice.
        let is_free = matches!(section, Section::Listeners | Section::Nets) || record_bytes == 0;
        assert_eq!(
            verify(changed(&blob, excess)).is_ok(),
            is_free,
            "one more of {section:?}"
        );
        let lacking = |sections: &mut [Vec<u8>]| {
            let bytes = &mut sections[section as usize];
            bytes.truncate(bytes.len() - record_bytes);
        };
        assert_eq!(
            verify(changed(&blob, lacking)).is_ok(),
            record_bytes == 0,
            "one less of {section:?}"
        );
    }
}

#[test]
fn a_blob_without_a_mission_is_refused() {
    let empty = changed(&compiled(), |sections| {
        sections.iter_mut().for_each(Vec::clear)
    });
    let expected = Refusal::Record {
        section: Section::Mission,
        index: 1,
        cause: Cause::Order,
    };
    assert_eq!(verify(empty).unwrap_err().1, expected);
}
