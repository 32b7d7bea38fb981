//! The rules of the format that compare one number with another, as tables: three or four bytes a
//! line, where code would take four times as many.
//!
//! A line speaks of *values*, each known by a small number: the fields of the records that were
//! read last, how many records of each section there are and how many were come to, and what the
//! [verifier](mod@crate::verify) keeps beside them. It compares two values, of which the second may
//! be a sum; or it gives a value, or reads a record. The verifier applies the tables at each thing
//! that it walks over. The lists are written below as lines, and [packed](PACKED) when the crate is
//! compiled.

use crate::format::{self, Section};
use crate::layout::{
    Field, channel, code, connection, container, instance, listener, mask, mission, region,
    region_instance, slot, state, task, task_instance, task_state, timer, transition,
};
use crate::verify::Cause;
use Cause::{Direction, Index, Kind, Order, Overlap, Range, Template};
use Section::{
    Channels, Code, Connections, Containers, Instances, Listeners, Mission, Names, Nets, Params,
    RegionInstances, Regions, Signatures, Slots, States, TaskInstances, TaskStates, Tasks, Timers,
    Transitions,
};

/// Number of a value.
pub(crate) type Value = u8;

/// Values there are, and some more: so that any number that is masked is that of a value.
pub(crate) const VALUES: usize = 128;

macro_rules! values {
    ($(#[$doc:meta])* $first:ident = $number:expr; $( $(#[$docs:meta])* $name:ident after $before:ident, )*) => {
        $(#[$doc])*
        pub(crate) const $first: Value = $number;
        $( $(#[$docs])* pub(crate) const $name: Value = $before + 1; )*
    };
}

// Those that the verifier itself works with stand first: there loads are shorter.
values! {
    /** Always 0. */ ZERO = 0;
    /** Whether the region under test is the last of its instance, 0 or 1. */ IS_LAST after ZERO,
    /** Kind of the state. */ KIND after IS_LAST,
    /** The rest of its shape. */ WITHOUT_KIND after KIND,
    /** Whether it has a timeout, 0 or 1. */ TIMED after WITHOUT_KIND,
    /** The flags in its shape. */ FLAGS after TIMED,
    /** The state under test. */ STATE after FLAGS,
    /** The one behind. */ NEXT_STATE after STATE,
    /** One past the last state of its region. */ END_STATE after NEXT_STATE,
    /** One past its last transition. */ END_TRANSITION after END_STATE,
    /** Number of events. */ EVENTS after END_TRANSITION,
    /** Number of the record under test of the table that is walked through. */ NUMBER after EVENTS,
    /** Whether the transition has the plain mark, 0 or 1. */ MARK after NUMBER,
    /** Its event. */ EVENT after MARK,
    /** Event of the one before. */ LAST_EVENT after EVENT,
    /** Events of the state's transitions. */ EVENTS_SEEN after LAST_EVENT,
    /** First transition that is not on the pulse. */ FIRST_ON_EVENT after EVENTS_SEEN,
    /** Guards of the row at its head. */ ROW after FIRST_ON_EVENT,
    /** The guard with which the row goes on. */ ROW_GUARD after ROW,
    /** Flags at the head of the instance's block. */ HEAD after ROW_GUARD,
}

/// The record of the transition under test.
pub(crate) const OF_TRANSITION: Value = HEAD + 1;
/// A record that is looked at beside them.
pub(crate) const HERE: Value = OF_TRANSITION + 4;
/// The record of the instance under test.
const OF_INSTANCE: Value = HERE + 10;
/// That of its container.
const OF_CONTAINER: Value = OF_INSTANCE + 6;
/// That of the region template under test.
const OF_REGION: Value = OF_CONTAINER + 8;
/// That of the one behind.
const OF_NEXT_REGION: Value = OF_REGION + 2;
/// That of the state under test.
const OF_STATE: Value = OF_NEXT_REGION + 2;
/// How many records of each section were come to.
pub(crate) const SEEN: Value = OF_STATE + 8;
/// How many there are.
pub(crate) const COUNT: Value = SEEN + Section::ALL.len() as Value;

values! {
    /** Always 1. */ ONE = COUNT + Section::ALL.len() as Value;
    /** Always the number of a container's own flags: exit, timeout. */ OWN_FLAGS after ONE,
    /** Always that of a task's: exit, timeout, busy. */ TASK_FLAGS after OWN_FLAGS,
    /** Always the kind of task states with a slot. */ KIND_TASK after TASK_FLAGS,
    /** Always that of task states in slot 0. */ KIND_BACKGROUND after KIND_TASK,
    /** Always that of simple states. */ KIND_SIMPLE after KIND_BACKGROUND,
    /** Always that of superstates. */ KIND_SUPER after KIND_SIMPLE,
    /** Always what stands for none. */ NONE after KIND_SUPER,
    /** Always the most state instances. */ MAX_STATE_INSTANCES after NONE,
    /** Always the longest time. */ MAX_TIME after MAX_STATE_INSTANCES,
    /** Always the first action that sends. */ ACTION_SEND after MAX_TIME,
    /** Always the last action that is none or a row. */ ACTION_LAST_ROW after ACTION_SEND,
    /** Always the first guard that is a program. */ GUARD_PROGRAM after ACTION_LAST_ROW,
    /** Number of exclusive groups. */ GROUPS after GUARD_PROGRAM,
    /** State instances that were come to. */ STATE_INSTANCES after GROUPS,
    /** The region template under test, and then the one behind. */ TEMPLATE after STATE_INSTANCES,
    /** The region instance under test. */ REGION after TEMPLATE,
    /** What comes behind the last region of the instance. */ BEHIND after REGION,
    /** Parts of the instance that were come to: flags. */ TAKEN_FLAGS after BEHIND,
    /** Task instances. */ TAKEN_TASKS after TAKEN_FLAGS,
    /** Region instances. */ TAKEN_REGIONS after TAKEN_TASKS,
    /** Container instances. */ TAKEN_INSTANCES after TAKEN_REGIONS,
    /** First flag of the state, relative to the instance's. */ FIRST_FLAG after TAKEN_INSTANCES,
    /** *a* and *b* that the state must have. */ A after FIRST_FLAG,
    /** See [`A`]. */ B after A,
    /** Flags, and then shape, that it must have. */ RIGHT after B,
    /** What is needed for some lines only. */ SCRATCH after RIGHT,
    /** What is split from it. */ BELOW_SCRATCH after SCRATCH,
}
const _: () = assert!((BELOW_SCRATCH as usize) < VALUES);

// Slots are through before the first state, and channels come behind the last: what is kept of them
// stands where that of states does meanwhile.

/// The interpreter's slot.
const INTERPRETER_SLOT: Value = RIGHT;
/// The record of the slot under test.
const OF_SLOT: Value = OF_STATE;
/// Number of one before it.
const EARLIER: Value = STATE;
/// The greatest common divisor of their periods.
const BASE: Value = A;
/// How much later than the other one it starts.
const AFTER: Value = B;
/// Words of a row with all region instances that are full.
const FULL_WORDS: Value = TAKEN_FLAGS;
/// Region instances in the one that is not.
const REST: Value = FULL_WORDS + 1;
/// Words of such a row.
const REGION_WORDS: Value = RIGHT;
/// One past the last word of regions of a channel.
const END_WORD: Value = A;
/// One past the last word of its row.
const END_ROW: Value = B;

// Transitions are tested when all else of their state is, and code is read when the states that it
// speaks of were: the same holds of these.

/// Always the first guard that is a mask.
const GUARD_MASK: Value = ACTION_SEND;
/// Always the last guard that is none.
const GUARD_LAST_PROGRAM: Value = ACTION_LAST_ROW;
/// Always one past the operations of programs of states that are no superstates.
const END_OF_TESTS: Value = KIND_TASK;
/// Always one past those of superstates, and the first that is an action, which is `send`.
const CODE_SEND: Value = KIND_SUPER;
const _: () = assert!(
    format::GUARD_MASK == format::ACTION_SEND
        && format::CODE_JUMP_IF_IDLE_INSIDE == format::STATE_TASK
        && format::CODE_SEND == format::STATE_SUPER
);
/// Whether the transition must have the plain mark, 0 or 1.
const IS_PLAIN: Value = A;
/// Flags of the state that guards have short forms for.
const WINDOW: Value = RIGHT;
/// Operation of the code under test.
const OPERATION: Value = HERE + 2;
/// The rest of its control word.
const LOW: Value = OPERATION + 1;
/// The first operation that may stand there.
const FIRST_OPERATION: Value = LOW + 1;
/// One past the last.
const END_OPERATION: Value = FIRST_OPERATION + 1;
/// The first flag at the head of the instance's block that it may name.
const FIRST_OF_HEAD: Value = END_OPERATION + 1;
/// The farthest that a jump led to.
const FARTHEST: Value = FIRST_OF_HEAD + 1;
/// The first flag of the state that it may name.
const FIRST_OWN: Value = FARTHEST + 1;
/// One past the last.
const END_OWN: Value = FIRST_OWN + 1;

/// Records of a section that were come to: what comes next begins there.
const fn seen(section: Section) -> Value {
    SEEN + section as Value
}

/// Records of a section.
const fn count(section: Section) -> Value {
    COUNT + section as Value
}

/// A field of the record at `place`.
const fn at(place: Value, field: Field) -> Value {
    place + field.number() as Value
}

/// A field of [`HERE`].
const fn here(field: Field) -> Value {
    at(HERE, field)
}

/// A field of the instance under test.
pub(crate) const fn of_instance(field: Field) -> Value {
    at(OF_INSTANCE, field)
}

/// A field of its container.
pub(crate) const fn of_container(field: Field) -> Value {
    at(OF_CONTAINER, field)
}

/// A field of the region template under test.
pub(crate) const fn of_region(field: Field) -> Value {
    at(OF_REGION, field)
}

/// A field of the one behind.
pub(crate) const fn of_next_region(field: Field) -> Value {
    at(OF_NEXT_REGION, field)
}

/// A field of the state under test.
pub(crate) const fn of_state(field: Field) -> Value {
    at(OF_STATE, field)
}

/// A field of the slot under test.
const fn of_slot(field: Field) -> Value {
    at(OF_SLOT, field)
}

/// A field of the transition under test.
pub(crate) const fn of_transition(field: Field) -> Value {
    at(OF_TRANSITION, field)
}

/// One line.
#[derive(Clone, Copy)]
struct Rule {
    /// One of the constants of [`rule`]; for comparisons with the [`Cause`] above, in the bits from
    /// [`rule::CAUSE_SHIFT`] on.
    what: u8,
    left: Value,
    a: Value,
    b: Value,
}

/// What a line does. In the bits above stands, for comparisons, the number of the [`Cause`] for
/// which is refused what does not keep the rule.
pub(crate) mod rule {
    /// The list ends.
    pub(crate) const END: u8 = 0;
    /// Clears the bits in `left` that are clear in `a`. It needs no cause, and so it is told by
    /// where others have theirs.
    pub(crate) const AND: u8 = END | 1 << CAUSE_SHIFT;
    /// Right if `left` is the sum of `a` and `b`.
    pub(crate) const IS: u8 = 1;
    /// Right if it is below it.
    pub(crate) const BELOW: u8 = 2;
    /// Right if it is not above it.
    pub(crate) const AT_MOST: u8 = 3;
    /// Makes `left` that sum.
    pub(crate) const LET: u8 = 4;
    /// Makes `left` the difference of `a` and `b`.
    pub(crate) const SUBTRACT: u8 = 5;
    /// Makes `left` the remainder of `a` by `b`; 0 if that is 0.
    pub(crate) const REMAINDER: u8 = 6;
    /// Makes `left` the bits of `a` from bit number `b` on, and the value behind `left` those
    /// below.
    pub(crate) const SPLIT: u8 = 7;
    /// Sets the bit in `left` that `a` says, by its remainder by 32.
    pub(crate) const BIT: u8 = 8;
    /// Makes `left` the number with the low byte `a` and the high byte `b`.
    pub(crate) const NUMBER: u8 = 9;
    /// Reads the record `a` of the section `left` to the values from `b` on.
    pub(crate) const READ: u8 = 10;
    /// Passes over as many bytes as `b` says, and where that is 0 those in the bits from
    /// [`PASSED_SHIFT`] on; but not if `left` is `a`.
    pub(crate) const GIVEN: u8 = 11;
    /// The same, but not if `left` is below `a`.
    pub(crate) const GIVEN_BELOW: u8 = 12;
    /// Applies the list at `b` as long as `left` is below `a`.
    pub(crate) const WHILE: u8 = 13;
    /// Applies the list at `b` if `left` is `a`.
    pub(crate) const APPLY: u8 = 14;
    /// Adds `a` to `left`.
    pub(crate) const ADD: u8 = 15;

    pub(crate) const CAUSE_SHIFT: u32 = 4;
    pub(crate) const PASSED_SHIFT: u32 = CAUSE_SHIFT;
    /// The most bytes that those bits can say.
    pub(crate) const MAX_PASSED: usize = (u8::MAX >> PASSED_SHIFT) as usize;
    /// The bits that tell what a line does.
    pub(crate) const WHAT_MASK: u8 = (1 << CAUSE_SHIFT) - 1;
}

const fn line(what: u8, left: Value, a: Value, b: Value) -> Rule {
    Rule { what, left, a, b }
}

const fn compare(what: u8, left: Value, a: Value, b: Value, cause: Cause) -> Rule {
    line(what | (cause as u8) << rule::CAUSE_SHIFT, left, a, b)
}

const fn is(left: Value, right: Value, cause: Cause) -> Rule {
    compare(rule::IS, left, right, ZERO, cause)
}

const fn is_sum(left: Value, a: Value, b: Value, cause: Cause) -> Rule {
    compare(rule::IS, left, a, b, cause)
}

const fn below(left: Value, right: Value, cause: Cause) -> Rule {
    compare(rule::BELOW, left, right, ZERO, cause)
}

const fn below_sum(left: Value, a: Value, b: Value, cause: Cause) -> Rule {
    compare(rule::BELOW, left, a, b, cause)
}

const fn at_most(left: Value, right: Value, cause: Cause) -> Rule {
    compare(rule::AT_MOST, left, right, ZERO, cause)
}

const fn let_be(left: Value, right: Value) -> Rule {
    line(rule::LET, left, right, ZERO)
}

const fn let_sum(left: Value, a: Value, b: Value) -> Rule {
    line(rule::LET, left, a, b)
}

const fn add(left: Value, more: Value) -> Rule {
    line(rule::ADD, left, more, ZERO)
}

const fn subtract(left: Value, a: Value, b: Value) -> Rule {
    line(rule::SUBTRACT, left, a, b)
}

const fn remainder(left: Value, a: Value, b: Value) -> Rule {
    line(rule::REMAINDER, left, a, b)
}

/// Two values that stand one behind the other become the upper and the lower bits of a value.
const fn split(upper: Value, lower: Value, of: Value, bits: u8) -> Rule {
    assert!(lower == upper + 1, "one behind the other");
    line(rule::SPLIT, upper, of, bits)
}

const fn bit(left: Value, number: Value) -> Rule {
    line(rule::BIT, left, number, ZERO)
}

const fn and(left: Value, mask: Value) -> Rule {
    line(rule::AND, left, mask, ZERO)
}

const fn number(left: Value, number: u16) -> Rule {
    let [low, high] = number.to_le_bytes();
    line(rule::NUMBER, left, low, high)
}

const fn read(section: Section, index: Value, to: Value) -> Rule {
    line(rule::READ, section as u8, index, to)
}

/// The next `lines` apply only if two values are equal.
const fn given(left: Value, right: Value, lines: u8) -> Rule {
    line(rule::GIVEN, left, right, lines)
}

/// The next `lines` apply only if `left` is below `right`.
const fn given_below(left: Value, right: Value, lines: u8) -> Rule {
    line(rule::GIVEN_BELOW, left, right, lines)
}

/// Applies a list as long as `left` is below `right`.
const fn while_below(left: Value, right: Value, list: List) -> Rule {
    line(rule::WHILE, left, right, list as u8)
}

/// Applies a list if two values are equal.
const fn apply_given(left: Value, right: Value, list: List) -> Rule {
    line(rule::APPLY, left, right, list as u8)
}

/// Lists of rules. A list applies only such as stand behind it, so the depth to which they apply
/// one another is bounded.
#[derive(Clone, Copy)]
#[repr(u8)]
pub(crate) enum List {
    Mission,
    Slot,
    EarlierSlot,
    Divisor,
    Instance,
    Channel,
    Task,
    TaskInstance,
    Connection,
    Region,
    State,
    SimpleState,
    TaskState,
    Superstate,
    TemplateState,
    Transition,
    PulseTransition,
    Code,
}

/// The lists in the order of [`List`].
const LISTS: [&[Rule]; 18] = [
    MISSION,
    SLOT,
    EARLIER_SLOT,
    DIVISOR,
    INSTANCE,
    CHANNEL,
    TASK_RECORD,
    TASK_INSTANCE,
    CONNECTION,
    REGION_OF_INSTANCE,
    STATE_OF_INSTANCE,
    SIMPLE,
    TASK,
    SUPER,
    TEMPLATE_STATE,
    TRANSITION,
    PULSE_TRANSITION,
    CODE,
];

/// A list begins at a multiple of this, so that one byte can say where.
pub(crate) const LIST_ALIGNMENT: usize = 5;

/// All lists as the verifier reads them. A line is what it does, `left`, `a` and `b`, a byte each;
/// `b` is left out where it is 0, and the highest bit of `left` says that it is not. A list applies
/// another one by where that begins, in units of [`LIST_ALIGNMENT`]. Lines that may be passed over
/// are counted in bytes, and where those are few they stand with what the line does.
pub(crate) const PACKED: [u8; PACKED_BYTES] = {
    let mut packed = [0; PACKED_BYTES];
    let mut list = 0;
    while list < LISTS.len() {
        let rules = LISTS[list];
        let mut to = begin_of(list);
        let mut at = 0;
        while at < rules.len() {
            let Rule { what, left, a, b } = rules[at];
            assert!(left & LONG == 0, "a value");
            let passed = passed_bytes(rules, at);
            let what = match passed <= rule::MAX_PASSED {
                true => what | (passed as u8) << rule::PASSED_SHIFT,
                false => what,
            };
            let b = match what & rule::WHAT_MASK {
                rule::GIVEN | rule::GIVEN_BELOW if passed <= rule::MAX_PASSED => 0,
                rule::GIVEN | rule::GIVEN_BELOW => {
                    assert!(passed <= u8::MAX as usize, "a byte says how many");
                    passed as u8
                }
                rule::WHILE | rule::APPLY => {
                    assert!(b as usize > list, "lists apply later ones");
                    let begin = begin_of(b as usize) / LIST_ALIGNMENT;
                    assert!(begin <= u8::MAX as usize, "a byte says where");
                    begin as u8
                }
                _ => b,
            };
            packed[to] = what;
            packed[to + 1] = left;
            packed[to + 2] = a;
            to += SHORT_BYTES;
            if b != 0 {
                packed[to - 2] |= LONG;
                packed[to] = b;
                to += 1;
            }
            at += 1;
        }
        list += 1;
    }
    packed
};

/// In `left`: the line has a `b`.
pub(crate) const LONG: u8 = 1 << 7;
/// Bytes of a line without one.
pub(crate) const SHORT_BYTES: usize = 3;

/// All of them. A line is read with the byte behind it, which is there: at least the list's end.
/// Where less is left, it is this end.
const PACKED_BYTES: usize = begin_of(LISTS.len());

/// Where a list begins among those that are packed.
const fn begin_of(list: usize) -> usize {
    let mut begin = 0;
    let mut before = 0;
    while before < list {
        let rules = LISTS[before];
        // The end takes a byte.
        begin = (begin + bytes_of(rules, 0, rules.len()) + 1).next_multiple_of(LIST_ALIGNMENT);
        before += 1;
    }
    begin
}

/// Bytes of some lines of a list.
const fn bytes_of(rules: &[Rule], from: usize, to: usize) -> usize {
    let mut bytes = 0;
    let mut at = from;
    while at < to {
        let is_long = match rules[at].what {
            rule::GIVEN | rule::GIVEN_BELOW => passed_bytes(rules, at) > rule::MAX_PASSED,
            _ => rules[at].b != 0,
        };
        bytes += SHORT_BYTES + is_long as usize;
        at += 1;
    }
    bytes
}

/// Bytes of the lines that a line may pass over.
const fn passed_bytes(rules: &[Rule], at: usize) -> usize {
    match rules[at] {
        Rule {
            what: rule::GIVEN | rule::GIVEN_BELOW,
            b: lines,
            ..
        } => bytes_of(rules, at + 1, at + 1 + lines as usize),
        _ => 0,
    }
}

/// The mission, and then all tables that are walked through.
const MISSION: &[Rule] = &[
    number(ONE, 1),
    number(OWN_FLAGS, format::CONTAINER_CONTROL_FLAGS as u16),
    number(TASK_FLAGS, format::TASK_CONTROL_FLAGS as u16),
    number(KIND_TASK, format::STATE_TASK),
    number(KIND_BACKGROUND, format::STATE_BACKGROUND_TASK),
    number(KIND_SIMPLE, format::STATE_SIMPLE),
    number(KIND_SUPER, format::STATE_SUPER),
    number(NONE, format::NONE),
    number(ACTION_SEND, format::ACTION_SEND),
    number(ACTION_LAST_ROW, format::ACTION_SEND - 1),
    number(GUARD_PROGRAM, format::GUARD_PROGRAM),
    // There is one. Its queue holds an event at least, and the interpreter has its slot.
    read(Mission, ONE, HERE),
    is(count(Mission), ONE, Order),
    read(Mission, ZERO, HERE),
    below(ZERO, here(mission::QUEUE), Range),
    number(SCRATCH, format::MAX_QUEUE as u16),
    at_most(here(mission::QUEUE), SCRATCH, Range),
    number(SCRATCH, format::MAX_EVENT),
    at_most(here(mission::EVENTS), SCRATCH, Range),
    let_be(INTERPRETER_SLOT, here(mission::INTERPRETER_SLOT)),
    below(INTERPRETER_SLOT, count(Slots), Index),
    let_be(EVENTS, here(mission::EVENTS)),
    let_be(GROUPS, here(mission::EXCLUSIVE_GROUPS)),
    let_be(SCRATCH, here(mission::FLAGS)),
    // What the machine takes is all there is.
    read(Containers, ZERO, HERE),
    is(SCRATCH, here(container::FLAG_SPAN), Template),
    let_be(seen(TaskInstances), here(container::TASK_SPAN)),
    let_be(seen(RegionInstances), here(container::REGION_SPAN)),
    let_be(seen(Instances), here(container::INSTANCE_SPAN)),
    // The other tables are come to from these, or free.
    while_below(NUMBER, count(Slots), List::Slot),
    let_be(NUMBER, ZERO),
    while_below(NUMBER, count(Instances), List::Instance),
    split(FULL_WORDS, REST, count(RegionInstances), WORD_BITS_SHIFT),
    let_be(REGION_WORDS, FULL_WORDS),
    given_below(ZERO, REST, 1),
    add(REGION_WORDS, ONE),
    let_be(NUMBER, ZERO),
    while_below(NUMBER, count(Channels), List::Channel),
    let_be(NUMBER, ZERO),
    while_below(NUMBER, count(Tasks), List::Task),
    let_be(NUMBER, ZERO),
    while_below(NUMBER, count(TaskInstances), List::TaskInstance),
    let_be(NUMBER, ZERO),
    while_below(NUMBER, count(Connections), List::Connection),
    // Of these each was under test, or any number may be.
    let_be(seen(Mission), ONE),
    let_be(seen(Slots), count(Slots)),
    let_be(seen(Listeners), count(Listeners)),
    let_be(seen(Tasks), count(Tasks)),
    let_be(seen(Nets), count(Nets)),
    let_be(seen(Names), count(Names)),
];

/// A word of a row is for 2 to the power of this many region instances.
const WORD_BITS_SHIFT: u8 = u32::BITS.trailing_zeros() as u8;

/// A slot, with those before it. The interpreter's starts at 0, for the time of a machine is that
/// of its slots.
const SLOT: &[Rule] = &[
    read(Slots, NUMBER, OF_SLOT),
    below(ZERO, of_slot(slot::NUMBER), Range),
    at_most(of_slot(slot::PERIOD), MAX_TIME, Range),
    at_most(of_slot(slot::DURATION), of_slot(slot::PERIOD), Range),
    below(of_slot(slot::START), of_slot(slot::PERIOD), Range),
    given(NUMBER, INTERPRETER_SLOT, 1),
    is(of_slot(slot::START), ZERO, Range),
    let_be(EARLIER, ZERO),
    while_below(EARLIER, NUMBER, List::EarlierSlot),
    add(NUMBER, ONE),
];

/// A slot and one before it. Slots are strictly periodic: two of them never overlap if and only if
/// they do not within the greatest common divisor of their periods (Korst, Aarts, Lenstra 1996). A
/// slot without duration may start where another does.
const EARLIER_SLOT: &[Rule] = &[
    read(Slots, EARLIER, HERE),
    add(EARLIER, ONE),
    read(Slots, NUMBER, OF_SLOT),
    subtract(SCRATCH, of_slot(slot::NUMBER), here(slot::NUMBER)),
    below(ZERO, SCRATCH, Overlap),
    let_be(BASE, of_slot(slot::PERIOD)),
    let_be(SCRATCH, here(slot::PERIOD)),
    while_below(ZERO, SCRATCH, List::Divisor),
    // How much later this one starts than the other, within the divisor.
    remainder(AFTER, of_slot(slot::START), BASE),
    remainder(SCRATCH, here(slot::START), BASE),
    given_below(AFTER, SCRATCH, 1),
    add(AFTER, BASE),
    subtract(AFTER, AFTER, SCRATCH),
    given(AFTER, of_slot(slot::DURATION), 2),
    given(AFTER, ZERO, 1),
    let_be(AFTER, BASE),
    at_most(here(slot::DURATION), AFTER, Overlap),
    subtract(SCRATCH, BASE, AFTER),
    at_most(of_slot(slot::DURATION), SCRATCH, Overlap),
];

/// A step on the way to the greatest common divisor.
const DIVISOR: &[Rule] = &[
    remainder(AFTER, BASE, SCRATCH),
    let_be(BASE, SCRATCH),
    let_be(SCRATCH, AFTER),
];

/// An instance, and before its regions its container.
const INSTANCE: &[Rule] = &[
    read(Instances, NUMBER, OF_INSTANCE),
    // Its channels stand behind those of the instance before, and no container is passed over.
    is(of_instance(instance::FIRST_CHANNEL), seen(Channels), Order),
    at_most(of_instance(instance::CONTAINER), seen(Containers), Order),
    // The machine begins everywhere.
    given(NUMBER, ZERO, 4),
    is(of_instance(instance::FIRST_REGION), ZERO, Template),
    is(of_instance(instance::FIRST_FLAG), ZERO, Template),
    is(of_instance(instance::FIRST_TASK), ZERO, Template),
    is(of_instance(instance::AROUND), ZERO, Template),
    // Behind its last region comes what comes behind the region around; around the machine there is
    // none.
    read(RegionInstances, of_instance(instance::AROUND), HERE),
    let_be(BEHIND, here(region_instance::NEXT)),
    given(NUMBER, ZERO, 1),
    let_be(BEHIND, count(RegionInstances)),
    // The first instance of a container says so, and its regions are the next.
    read(Containers, of_instance(instance::CONTAINER), OF_CONTAINER),
    given(of_instance(instance::CONTAINER), seen(Containers), 3),
    is(of_container(container::FIRST_REGION), seen(Regions), Order),
    is(of_container(container::FIRST_INSTANCE), NUMBER, Order),
    add(seen(Containers), ONE),
    let_be(TEMPLATE, of_container(container::FIRST_REGION)),
    add(seen(Channels), of_container(container::CHANNELS)),
    // It takes the flags at its head and itself, and what its states take.
    let_sum(HEAD, OWN_FLAGS, of_container(container::FLAGS)),
    let_be(TAKEN_FLAGS, HEAD),
    let_be(TAKEN_TASKS, ZERO),
    let_be(TAKEN_REGIONS, ZERO),
    let_be(TAKEN_INSTANCES, ONE),
    let_be(IS_LAST, ZERO),
    while_below(IS_LAST, ONE, List::Region),
    // It took what its container says.
    read(Containers, of_instance(instance::CONTAINER), OF_CONTAINER),
    is(of_container(container::FLAG_SPAN), TAKEN_FLAGS, Template),
    is(of_container(container::TASK_SPAN), TAKEN_TASKS, Template),
    is(
        of_container(container::REGION_SPAN),
        TAKEN_REGIONS,
        Template,
    ),
    is(
        of_container(container::INSTANCE_SPAN),
        TAKEN_INSTANCES,
        Template,
    ),
    add(NUMBER, ONE),
];

/// A region of an instance, and its states.
const REGION_OF_INSTANCE: &[Rule] = &[
    let_sum(SCRATCH, TEMPLATE, ONE),
    read(Regions, SCRATCH, OF_NEXT_REGION),
    read(Regions, TEMPLATE, OF_REGION),
    let_be(TEMPLATE, SCRATCH),
    let_sum(REGION, of_instance(instance::FIRST_REGION), TAKEN_REGIONS),
    add(TAKEN_REGIONS, ONE),
    let_be(NEXT_STATE, of_region(region::FIRST_STATE)),
    let_be(END_STATE, at(OF_NEXT_REGION, region::FIRST_STATE)),
    given(END_STATE, NONE, 1),
    let_be(END_STATE, count(States)),
    // In a container's first instance its template is under test, too: two states at least, behind
    // those of the region before.
    given(of_container(container::FIRST_INSTANCE), NUMBER, 5),
    add(seen(Regions), ONE),
    is(NEXT_STATE, seen(States), Order),
    is(
        of_region(region::CONTAINER),
        of_instance(instance::CONTAINER),
        Order,
    ),
    let_sum(SCRATCH, NEXT_STATE, ONE),
    below(SCRATCH, END_STATE, Order),
    while_below(NEXT_STATE, END_STATE, List::State),
    // Its record is what the template makes of it. Behind the last region stands what is behind the
    // region around.
    read(RegionInstances, REGION, HERE),
    let_be(SCRATCH, BEHIND),
    let_be(IS_LAST, ONE),
    given(
        of_next_region(region::CONTAINER),
        of_instance(instance::CONTAINER),
        2,
    ),
    let_be(IS_LAST, ZERO),
    let_sum(SCRATCH, of_instance(instance::FIRST_REGION), TAKEN_REGIONS),
    is(here(region_instance::NEXT), SCRATCH, Template),
    is(
        here(region_instance::FIRST_FLAG),
        of_instance(instance::FIRST_FLAG),
        Template,
    ),
    is(
        here(region_instance::INITIAL),
        of_region(region::FIRST_STATE),
        Template,
    ),
    is(here(region_instance::INSTANCE), NUMBER, Template),
];

/// A state of an instance.
const STATE_OF_INSTANCE: &[Rule] = &[
    let_be(STATE, NEXT_STATE),
    add(NEXT_STATE, ONE),
    read(States, NEXT_STATE, HERE),
    let_be(END_TRANSITION, here(state::FIRST_TRANSITION)),
    given(END_TRANSITION, NONE, 1),
    let_be(END_TRANSITION, count(Transitions)),
    // Templates that are used often could make the pass much longer than the blob.
    read(States, STATE, OF_STATE),
    add(STATE_INSTANCES, ONE),
    at_most(STATE_INSTANCES, MAX_STATE_INSTANCES, Range),
    let_be(FIRST_FLAG, TAKEN_FLAGS),
    let_be(A, ZERO),
    let_be(RIGHT, NONE),
    split(
        KIND,
        WITHOUT_KIND,
        of_state(state::SHAPE),
        format::STATE_KIND_SHIFT as u8,
    ),
    split(
        TIMED,
        FLAGS,
        WITHOUT_KIND,
        format::STATE_HAS_TIMEOUT.trailing_zeros() as u8,
    ),
    apply_given(KIND, KIND_SIMPLE, List::SimpleState),
    apply_given(KIND, KIND_TASK, List::TaskState),
    apply_given(KIND, KIND_BACKGROUND, List::TaskState),
    apply_given(KIND, KIND_SUPER, List::Superstate),
    apply_given(
        of_container(container::FIRST_INSTANCE),
        NUMBER,
        List::TemplateState,
    ),
];

/// A simple state: it has a flag, its timeout, or nothing at all.
const SIMPLE: &[Rule] = &[
    add(TAKEN_FLAGS, FLAGS),
    let_be(RIGHT, ONE),
    number(SCRATCH, format::STATE_SIMPLE << format::STATE_KIND_SHIFT),
    given(of_state(state::SHAPE), SCRATCH, 1),
    let_be(RIGHT, ZERO),
];

/// A task state: the record of its task instance, and the template of that.
const TASK: &[Rule] = &[
    let_sum(SCRATCH, of_instance(instance::FIRST_TASK), TAKEN_TASKS),
    read(TaskInstances, SCRATCH, HERE),
    is(here(task_instance::STATE), STATE, Template),
    is(here(task_instance::REGION), REGION, Template),
    is_sum(
        here(task_instance::FIRST_FLAG),
        of_instance(instance::FIRST_FLAG),
        TAKEN_FLAGS,
        Template,
    ),
    let_be(SCRATCH, here(task_instance::TASK_STATE)),
    let_be(A, TAKEN_TASKS),
    add(TAKEN_TASKS, ONE),
    add(TAKEN_FLAGS, FLAGS),
    // No other task state has this state: each one's is tested here once, in its turn.
    given(of_container(container::FIRST_INSTANCE), NUMBER, 2),
    is(SCRATCH, seen(TaskStates), Template),
    add(seen(TaskStates), ONE),
    read(TaskStates, SCRATCH, HERE),
    is(here(task_state::STATE), STATE, Template),
    given(of_container(container::FIRST_INSTANCE), NUMBER, 8),
    // Its slot exists; in slot 0 there is none.
    given(KIND, KIND_BACKGROUND, 1),
    is(here(task_state::SLOT), NONE, Index),
    given(KIND, KIND_TASK, 1),
    below(here(task_state::SLOT), count(Slots), Index),
    is(here(task_state::FIRST_PARAM), seen(Params), Order),
    read(Tasks, here(task_state::TASK), HERE),
    add(seen(Params), here(task::PARAMS)),
    let_sum(RIGHT, TASK_FLAGS, here(task::FLAGS)),
];

/// A superstate: the record of the instance inside. What the first instance of the container around
/// makes of this state holds for all of them.
const SUPER: &[Rule] = &[
    let_sum(
        SCRATCH,
        of_container(container::FIRST_INSTANCE),
        TAKEN_INSTANCES,
    ),
    read(Instances, SCRATCH, HERE),
    let_be(RIGHT, here(instance::CONTAINER)),
    let_sum(SCRATCH, NUMBER, TAKEN_INSTANCES),
    read(Instances, SCRATCH, HERE),
    is(here(instance::CONTAINER), RIGHT, Template),
    is_sum(
        here(instance::FIRST_REGION),
        of_instance(instance::FIRST_REGION),
        TAKEN_REGIONS,
        Template,
    ),
    is_sum(
        here(instance::FIRST_FLAG),
        of_instance(instance::FIRST_FLAG),
        TAKEN_FLAGS,
        Template,
    ),
    is_sum(
        here(instance::FIRST_TASK),
        of_instance(instance::FIRST_TASK),
        TAKEN_TASKS,
        Template,
    ),
    is(here(instance::AROUND), REGION, Template),
    let_be(A, TAKEN_INSTANCES),
    // It takes what its container does.
    read(Containers, RIGHT, HERE),
    let_sum(RIGHT, OWN_FLAGS, here(container::FLAGS)),
    add(TAKEN_FLAGS, here(container::FLAG_SPAN)),
    add(TAKEN_TASKS, here(container::TASK_SPAN)),
    add(TAKEN_REGIONS, here(container::REGION_SPAN)),
    add(TAKEN_INSTANCES, here(container::INSTANCE_SPAN)),
];

/// A state of a template.
const TEMPLATE_STATE: &[Rule] = &[
    read(States, STATE, OF_STATE),
    // The first of its region is `initial` and the last is `final`, without anything; between them
    // are others.
    subtract(SCRATCH, of_state(state::SHAPE), FLAGS),
    add(RIGHT, SCRATCH),
    given(STATE, of_region(region::FIRST_STATE), 1),
    let_be(RIGHT, ZERO),
    given(NEXT_STATE, END_STATE, 2),
    number(RIGHT, format::STATE_FINAL << format::STATE_KIND_SHIFT),
    is(END_TRANSITION, seen(Transitions), Index),
    is(of_state(state::SHAPE), RIGHT, Kind),
    // Its parts begin where those of the state before end.
    is(of_state(state::FIRST_TRANSITION), seen(Transitions), Order),
    is(of_state(state::FIRST_FLAG), FIRST_FLAG, Order),
    is(of_state(state::A), A, Order),
    let_be(B, ZERO),
    given(TIMED, ONE, 2),
    let_be(B, seen(Timers)),
    add(seen(Timers), ONE),
    add(seen(States), ONE),
    given(TIMED, ONE, 2),
    read(Timers, B, HERE),
    at_most(here(timer::TIMEOUT), MAX_TIME, Range),
    // Its transitions, and what it says of their events.
    let_be(LAST_EVENT, ZERO),
    let_be(EVENTS_SEEN, ZERO),
    let_be(ROW, ZERO),
    let_be(FIRST_ON_EVENT, seen(Transitions)),
    while_below(seen(Transitions), END_TRANSITION, List::Transition),
    read(States, STATE, OF_STATE),
    split(SCRATCH, BELOW_SCRATCH, EVENTS_SEEN, u16::BITS as u8),
    is(of_state(state::EVENTS), BELOW_SCRATCH, Order),
    is(of_state(state::EVENTS_HIGH), SCRATCH, Order),
    is(
        of_state(state::FIRST_EVENT_TRANSITION),
        FIRST_ON_EVENT,
        Order,
    ),
    // Without a timeout it tells the length of its row, where that is not 1.
    given(TIMED, ZERO, 3),
    let_be(B, ROW),
    given(ROW, ONE, 1),
    let_be(B, ZERO),
    is(of_state(state::B), B, Order),
];

/// The next transition. In its guard and its actions a flag is one at the head of the block of its
/// instance or one of the state's own: for the guard of the state that is left, for actions of the
/// one that is entered. What is not for actions to write stands first in both.
const TRANSITION: &[Rule] = &[
    read(Transitions, seen(Transitions), OF_TRANSITION),
    read(States, of_transition(transition::TARGET), HERE),
    read(Transitions, seen(Transitions), OF_TRANSITION),
    add(seen(Transitions), ONE),
    split(
        MARK,
        EVENT,
        of_transition(transition::EVENT),
        format::TRANSITION_IS_PLAIN.trailing_zeros() as u8,
    ),
    bit(EVENTS_SEEN, EVENT),
    // From a pseudo-state or a simple state to a simple state without flags, without actions.
    let_be(IS_PLAIN, ZERO),
    given_below(KIND, KIND_TASK, 4),
    number(SCRATCH, format::STATE_SIMPLE << format::STATE_KIND_SHIFT),
    given(here(state::SHAPE), SCRATCH, 2),
    given(of_transition(transition::ACTION), ZERO, 1),
    let_be(IS_PLAIN, ONE),
    apply_given(EVENT, ZERO, List::PulseTransition),
    // They are sorted, and so the pulse comes first.
    at_most(LAST_EVENT, EVENT, Order),
    let_be(LAST_EVENT, EVENT),
    at_most(EVENT, EVENTS, Index),
    // It leads to a state of its region, but not to `initial`.
    below(
        of_region(region::FIRST_STATE),
        of_transition(transition::TARGET),
        Index,
    ),
    below(of_transition(transition::TARGET), END_STATE, Index),
    // The channel that a single `send` names exists.
    below_sum(
        of_transition(transition::ACTION),
        ACTION_SEND,
        of_container(container::CHANNELS),
        Index,
    ),
    is(MARK, IS_PLAIN, Kind),
    // A guard that is a bit: one of the window.
    let_be(WINDOW, FLAGS),
    number(SCRATCH, format::WINDOW_FLAGS),
    given_below(SCRATCH, WINDOW, 1),
    let_be(WINDOW, SCRATCH),
    split(
        SCRATCH,
        BELOW_SCRATCH,
        of_transition(transition::GUARD),
        format::GUARD_IF_CLEAR.trailing_zeros() as u8,
    ),
    number(SCRATCH, format::GUARD_TRUE),
    given_below(of_transition(transition::GUARD), SCRATCH, 1),
    below(BELOW_SCRATCH, WINDOW, Index),
    // A program: it begins with the next record, and ends behind all its jumps.
    given_below(SCRATCH, of_transition(transition::GUARD), 13),
    given_below(of_transition(transition::GUARD), GUARD_MASK, 12),
    read(Code, seen(Code), HERE),
    is_sum(
        of_transition(transition::GUARD),
        seen(Code),
        GUARD_PROGRAM,
        Order,
    ),
    let_be(FIRST_OPERATION, ZERO),
    let_be(END_OPERATION, END_OF_TESTS),
    given(KIND, KIND_SUPER, 1),
    let_be(END_OPERATION, CODE_SEND),
    let_be(FIRST_OF_HEAD, ZERO),
    let_be(FIRST_OWN, FIRST_FLAG),
    let_sum(END_OWN, FIRST_FLAG, FLAGS),
    let_be(FARTHEST, ZERO),
    let_be(OPERATION, ONE),
    while_below(ZERO, OPERATION, List::Code),
    // A mask: the next record has two bits at least, of the window, and no others in its value.
    given_below(GUARD_LAST_PROGRAM, of_transition(transition::GUARD), 12),
    read(Code, seen(Code), HERE),
    is_sum(
        of_transition(transition::GUARD),
        seen(Code),
        GUARD_MASK,
        Order,
    ),
    add(seen(Code), ONE),
    let_be(SCRATCH, ZERO),
    bit(SCRATCH, WINDOW),
    below(here(mask::MASK), SCRATCH, Index),
    let_be(SCRATCH, here(mask::VALUE)),
    and(SCRATCH, here(mask::MASK)),
    is(SCRATCH, here(mask::VALUE), Index),
    subtract(SCRATCH, here(mask::MASK), ONE),
    and(SCRATCH, here(mask::MASK)),
    below(ZERO, SCRATCH, Index),
    // A row of actions: it begins with the next record.
    given_below(ZERO, of_transition(transition::ACTION), 12),
    given_below(of_transition(transition::ACTION), ACTION_SEND, 11),
    read(States, of_transition(transition::TARGET), HERE),
    split(
        SCRATCH,
        BELOW_SCRATCH,
        here(state::SHAPE),
        format::STATE_HAS_TIMEOUT.trailing_zeros() as u8,
    ),
    let_sum(FIRST_OWN, here(state::FIRST_FLAG), OWN_FLAGS),
    let_sum(END_OWN, here(state::FIRST_FLAG), BELOW_SCRATCH),
    read(Code, seen(Code), HERE),
    is_sum(of_transition(transition::ACTION), seen(Code), ONE, Order),
    let_be(FIRST_OPERATION, CODE_SEND),
    let_be(END_OPERATION, NONE),
    let_be(FIRST_OF_HEAD, OWN_FLAGS),
    let_be(LOW, ZERO),
    while_below(LOW, ONE, List::Code),
];

/// The next record of a program or a row.
const CODE: &[Rule] = &[
    read(Code, seen(Code), HERE),
    split(
        OPERATION,
        LOW,
        here(code::CONTROL),
        format::CODE_OPERATION_SHIFT as u8,
    ),
    at_most(FIRST_OPERATION, OPERATION, Kind),
    below(OPERATION, END_OPERATION, Kind),
    // What it names is a flag or, to send, a channel.
    let_be(SCRATCH, FIRST_OWN),
    let_be(BELOW_SCRATCH, END_OWN),
    given_below(here(code::OPERAND), HEAD, 2),
    let_be(SCRATCH, FIRST_OF_HEAD),
    let_be(BELOW_SCRATCH, HEAD),
    given(OPERATION, CODE_SEND, 2),
    let_be(SCRATCH, ZERO),
    let_be(BELOW_SCRATCH, of_container(container::CHANNELS)),
    at_most(SCRATCH, here(code::OPERAND), Index),
    below(here(code::OPERAND), BELOW_SCRATCH, Index),
    // No jump leads past the end of a program.
    given(OPERATION, ZERO, 1),
    at_most(FARTHEST, seen(Code), Direction),
    let_sum(SCRATCH, seen(Code), LOW),
    given_below(FARTHEST, SCRATCH, 1),
    let_be(FARTHEST, SCRATCH),
    add(seen(Code), ONE),
];

/// A transition on the pulse.
const PULSE_TRANSITION: &[Rule] = &[
    // From a real-time task state without timeout and with few flags to itself, with a single
    // `send`.
    given(KIND, KIND_TASK, 5),
    given(of_transition(transition::TARGET), STATE, 4),
    number(SCRATCH, format::PLAIN_FLAGS + 1),
    given_below(WITHOUT_KIND, SCRATCH, 2),
    given_below(ACTION_LAST_ROW, of_transition(transition::ACTION), 1),
    let_be(IS_PLAIN, ONE),
    // Its guard may be the next of the row, which begins with the first of the state.
    let_sum(SCRATCH, ROW, of_state(state::FIRST_TRANSITION)),
    given(ROW, ZERO, 1),
    let_be(ROW_GUARD, of_transition(transition::GUARD)),
    given(SCRATCH, FIRST_ON_EVENT, 4),
    given_below(of_transition(transition::GUARD), GUARD_PROGRAM, 3),
    given(of_transition(transition::GUARD), ROW_GUARD, 2),
    add(ROW, ONE),
    add(ROW_GUARD, ONE),
    add(FIRST_ON_EVENT, ONE),
];

/// A channel: an event that exists, and words that do.
const CHANNEL: &[Rule] = &[
    read(Channels, NUMBER, HERE),
    add(NUMBER, ONE),
    below(ZERO, here(channel::EVENT), Index),
    at_most(here(channel::EVENT), EVENTS, Index),
    let_sum(
        END_WORD,
        here(channel::FIRST_REGION_WORD),
        here(channel::REGION_WORDS),
    ),
    at_most(END_WORD, REGION_WORDS, Index),
    let_sum(
        END_ROW,
        here(channel::FIRST_ROW_WORD),
        here(channel::REGION_WORDS),
    ),
    at_most(END_ROW, count(Listeners), Index),
    // No bit of a row stands for what is behind the last region instance.
    given_below(ZERO, here(channel::REGION_WORDS), 9),
    given_below(FULL_WORDS, END_WORD, 8),
    subtract(SCRATCH, END_ROW, ONE),
    read(Listeners, SCRATCH, HERE),
    number(SCRATCH, u32::BITS as u16),
    subtract(SCRATCH, SCRATCH, REST),
    let_be(BELOW_SCRATCH, ZERO),
    bit(BELOW_SCRATCH, SCRATCH),
    remainder(SCRATCH, here(listener::REGIONS), BELOW_SCRATCH),
    is(SCRATCH, ZERO, Range),
];

/// A task: its text is the next, and its group exists.
const TASK_RECORD: &[Rule] = &[
    read(Tasks, NUMBER, HERE),
    is(here(task::TEXT_START), seen(Signatures), Order),
    add(seen(Signatures), here(task::TEXT_LENGTH)),
    given_below(here(task::EXCLUSIVE), NONE, 1),
    below(here(task::EXCLUSIVE), GROUPS, Range),
    add(NUMBER, ONE),
];

/// A task instance: its connections are the next, as many as its task has data ports.
const TASK_INSTANCE: &[Rule] = &[
    read(TaskInstances, NUMBER, HERE),
    add(NUMBER, ONE),
    is(
        here(task_instance::FIRST_CONNECTION),
        seen(Connections),
        Order,
    ),
    read(TaskStates, here(task_instance::TASK_STATE), HERE),
    read(Tasks, here(task_state::TASK), HERE),
    add(seen(Connections), here(task::DATA)),
];

/// A connection: to a net, or none.
const CONNECTION: &[Rule] = &[
    read(Connections, NUMBER, HERE),
    given_below(here(connection::NET), NONE, 1),
    below(here(connection::NET), count(Nets), Index),
    add(NUMBER, ONE),
];
