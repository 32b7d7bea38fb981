//! The blob, byte by byte.
//!
//! A blob is one mission: machine, schedule, data paths, parameters. It is made of
//!
//! 1. the four bytes `ESM2`, in which the digit is the version of this format;
//! 2. the [`Envelope`] in [postcard](https://postcard.jamesmunns.com/wire-format) encoding. All its
//!    fields are byte strings, so on the wire it is the sections below one after another, each a
//!    varint (seven bits a byte, low ones first, the highest bit says that another byte follows)
//!    with the section's length in bytes, and the bytes themselves;
//! 3. the CRC-32 (IEEE 802.3) of all bytes before it, four bytes, little endian. It is also the
//!    *mission hash*.
//!
//! A section is a table of records of one fixed size, without gaps. All numbers are little endian,
//! and unless something else is said they are 16 bits wide. `0xFFFF` stands for *none* where one is
//! possible. Counts are not stored: they follow from the lengths.
//!
//! # Sections
//!
//! | section | record | fields |
//! |---|---|---|
//! | mission | 10, just one | queue capacity (1–255); index of the interpreter's slot; number of events; number of flag bits; number of exclusive groups |
//! | slots | 16 | number, period, duration, first start: 32 bits each, times in µs |
//! | containers | 16 | first region; control flags; channels; first instance; then what an instance takes with all inside it: flag bits; task instances; region instances; container instances |
//! | regions | 4 | first state; container |
//! | states | 16 | events (32 bits); first transition; first transition not on the pulse; first flag; shape; *a*; *b* |
//! | transitions | 8 | event and, in bit 15, the plain mark; target state; guard; action |
//! | code | 4 | operand; operation (top 3 bits) and jump or last mark (low 13 bits). Or, where a guard says so, mask; value |
//! | timers | 4 | timeout in µs (32 bits) |
//! | instances | 12 | container; first region instance; first flag; first channel; first task instance; region instance around, 0 at the root |
//! | region instances | 8 | next; first flag; initial state; instance |
//! | channels | 8 | event; first word of its row; first region word; region words |
//! | listeners | 4 | words of rows (32 bits) |
//! | tasks | 20 | signature hash (64 bits); start of the signature's text; its length; exclusive group or none; data ports; flags; parameters |
//! | signatures | 1 | the texts of the signatures, see [`crate::signature`] |
//! | task states | 8 | task; slot, or none for slot 0; first parameter; state |
//! | parameters | 4 | 32 bits of a value |
//! | task instances | 10 | state; region instance; first connection; first flag in the whole machine; task state |
//! | connections | 2 | net, or none for an open port |
//! | nets | 8 | hash of the type's name (64 bits) |
//! | names | 1 | see below |
//! | links | 16 | bits a second; gap in µs (32 bits each); header bytes and, in the high byte, bits of a byte; task of `transmit` and of `receive`, or none; 0 |
//! | frames | 28 | configuration (64 bits); period, first start, and how old a value may be, or 0 for three periods (32 bits each, in µs); identifier and, in bit 15, whether it is received; link; bytes of the payload; flags, 0 for a value |
//!
//! A mission without links ends behind the names: it has neither of the last two sections.
//!
//! **Templates and instances.** A container is stored once, however often it is used: containers,
//! regions, states, transitions and code are templates. What differs from instance to instance are
//! bases (first flag, first channel, first task instance), to which everything in a template is
//! relative.
//!
//! **States.** Bit 0 of a state's *events* is set if it has a transition on the pulse, or on an
//! event whose number is a multiple of 32; bit `n` above that if it has one on an event whose
//! number leaves the remainder `n`. No other bit is set. A *shape* holds the kind of the state in
//! its top 3 bits (0 initial, 1 final, 2 simple, 3 real-time task, 4 background task, 5
//! superstate), in bit 12 whether it has a timeout, and below how many flag bits entering it
//! resets. For a task state *a* is the task instance relative to the instance's first; for a
//! superstate it is the container instance inside relative to the instance that holds it; otherwise
//! it is 0. For a state with a timeout *b* is its record among the timers. For others it is the
//! length of the *row*: the number of its first transitions on the pulse whose guards are below 32
//! and each one more than the guard before, or 0 if that is 1.
//!
//! **Order.** Everything stands in one order, and the parts of a thing stand together: the regions
//! of container 0, of container 1, …; the states of region 0, of region 1, … with `initial` first
//! and `final` last; the transitions of state 0, of state 1, …; the code of transition 0, of
//! transition 1, …, in each that of the guard first; the timers and the task states in the order of
//! their states; the channels of instance 0, … So an end is where the next thing begins, and
//! nothing is shared but by the rules. Of the transitions of a state those on the pulse come first,
//! in source order; then the others by the numbers of their events, those on one event in source
//! order.
//!
//! **Instance tree.** Container instances, region instances and task instances are numbered depth
//! first, regions and states in source order. The machine is instance 0 of container 0. A region
//! instance's *next* is its next sibling, or, for the last of an instance, the *next* of the region
//! instance around, or the number of region instances. So what is inside a region instance stands
//! between it and its *next*, and walking in the order of numbers is walking outer before inner and
//! regions in source order.
//!
//! **Flags.** The block of a container instance starts with `exit` and `timeout` of its superstate
//! (at the root: of the machine, whose exit flag says that it is finished) and its control flags in
//! the order of declaration. The blocks of its states follow, region by region: a simple state has
//! its timeout flag or nothing; a task state exit, timeout, busy and its control flags in the order
//! of the signature; a superstate the whole block of the instance inside. So the first flag of an
//! instance is its superstate's, and every flag that a transition can name is a bit at a fixed
//! distance from the first flag of its instance.
//!
//! **Guards.** Most guards ask for flags of the state that is left, and there is a short form for
//! them. The *window* of a state is made of the first 15 flags that entering it resets, the first
//! in the lowest bit; flags behind them have the long form.
//!
//! | guard | is true if |
//! |---|---|
//! | *n* = 0–14 | bit *n* of the window is set |
//! | 16 + *n* = 16–30 | bit *n* of the window is clear |
//! | 31 | always |
//! | 32–32,767 | the program from code record *guard* − 32 on says so |
//! | 32,768 + *i* | (window xor value) and mask is 0, with mask and value of code record *i* |
//!
//! 15 means nothing. A bit must be one of the state's own flags. A mask has at least two bits, all
//! of them the state's own flags, and a value only bits of its mask. `initial` has no flags: only
//! 31 and programs can be guards there.
//!
//! A program is a row of tests, of which each jumps or goes on to the next, and ends with operation
//! 0, which says that the guard is true. Operation 1 jumps if the flag is clear, 2 if it is set, 3
//! and 4 do so by the busy flag of the superstate that the transition leaves, which is the *or* of
//! those of the active task states inside. A jump of 0 ends the guard as false, else it counts
//! records ahead, at most to the end. Operands count from the first flag of the instance. A test
//! names only flags at the head of its instance's block (exit, timeout, control flags) or own flags
//! of the state that is left: nothing else can make a guard of a state true, and a machine in which
//! none of them changes can rest.
//!
//! **Actions.** 0 is none; 32,768 + *c* one `send` on channel *c* of the instance; any other number
//! 1 + the code record of the first of a row, in which operation 5 sends on a channel, 6 clears a
//! flag and 7 sets one, and the low bit of the last is set. Operands count as in a program, with
//! own flags those of the state that is entered; `exit` and `timeout` are not for actions to write.
//! The *plain mark* stands at each transition that changes nothing but the current state: from
//! `initial` or a simple state to a simple state without flags, without actions; and at each one on
//! the pulse from a real-time task state without timeout and with at most 25 flags to itself whose
//! action is one `send`.
//!
//! **Channels.** An event that is sent in a container instance has a channel there, one for each
//! pair of instance and sent event. It carries the event's number and the row of those who listen:
//! a bit for each region instance in which the event is visible and whose template has a transition
//! on it. Word *k* of the row is for the region instances from 32 · (first region word + *k*) on,
//! the first in the highest bit. A row neither begins nor ends with a word without bits. Rows may
//! be shared.
//!
//! **Frames.** Those of link 0, of link 1, …; of each link first what it sends, then what it
//! receives. The data ports of a dispatcher's task are the values of its frames in this order. Its
//! flags are first those that its flag frames carry, then those that come by themselves: one for
//! each frame that is sent, two for each that is received, and the last of `receive` is `errors`.
//! What is said here of links and frames, [`crate::frames::check`] looks at.
//!
//! # Names
//!
//! The names that signatures do not hold, each a varint with its length and an ASCII identifier;
//! the section is empty if they were left out. First the events in the order of their numbers; then
//! for each container its name, its control flags and for each region its name and those of its
//! states, pseudo-states left out; then the `exclusive` groups.
//!
//! # Limits
//!
//! 65,535 records in any table that is addressed with 16 bits, 65,535 flag bits, 4,095 flags of one
//! state, 32,767 events, [`MAX_STATE_INSTANCES`] state instances, jumps over at most 8,191 tests,
//! 32,736 code records, [`MAX_SLOTS`] slots, times of at most [`MAX_TIME_US`].

use serde::{Deserialize, Serialize};

/// The first four bytes of a blob.
pub const MAGIC: [u8; 4] = *b"ESM2";
/// Bytes of the CRC at the end of a blob.
pub const CRC_BYTES: usize = 4;
/// Event number of the pulse.
pub const PULSE: u16 = 0;
/// Stands for no index.
pub const NONE: u16 = u16::MAX;
/// The longest period and timeout: 4,000 s. Below 2³² µs, so that the age of a state can be told
/// from 32 bits.
pub const MAX_TIME_US: u32 = 4_000_000_000;
/// The most slots of a mission: each is compared with each, so that this bounds the time of the
/// check. It is as many as can be laid out, and far more than any firmware has room for.
pub const MAX_SLOTS: u16 = 4_096;
/// The greatest number of an event.
pub const MAX_EVENT: u16 = TRANSITION_IS_PLAIN - 1;
/// The most flags that one state can have.
pub const MAX_STATE_FLAGS: u16 = STATE_FLAGS_MASK;
/// The longest jump of a guard, in tests.
pub const MAX_JUMP: u16 = CODE_LOW_MASK;
/// The most state instances that a mission can have, pseudo-states included.
pub const MAX_STATE_INSTANCES: usize = 1 << 20;
/// The greatest capacity of the event queue.
pub const MAX_QUEUE: usize = 255;

/// Where the kind of a state stands in its shape.
pub const STATE_KIND_SHIFT: u16 = 13;
/// Set in the shape of a state with a timeout.
pub const STATE_HAS_TIMEOUT: u16 = 1 << 12;
/// The bits of a shape that count flags.
pub const STATE_FLAGS_MASK: u16 = STATE_HAS_TIMEOUT - 1;
/// Kind of the `initial` pseudo-state.
pub const STATE_INITIAL: u16 = 0;
/// Kind of the `final` pseudo-state.
pub const STATE_FINAL: u16 = 1;
/// Kind of a simple state.
pub const STATE_SIMPLE: u16 = 2;
/// Kind of a task state with a slot.
pub const STATE_TASK: u16 = 3;
/// Kind of a task state in slot 0.
pub const STATE_BACKGROUND_TASK: u16 = 4;
/// Kind of a superstate.
pub const STATE_SUPER: u16 = 5;

/// Set in the event of a transition that changes nothing but the current state.
pub const TRANSITION_IS_PLAIN: u16 = 1 << 15;

/// The most flags of a task state that enters itself anew by a plain transition.
pub const PLAIN_FLAGS: u16 = 25;

/// Flags in the window that guards see.
pub const WINDOW_FLAGS: u16 = 15;
/// Guard: a bit of the window is clear; to this the bit is added. Without it: the bit is set.
pub const GUARD_IF_CLEAR: u16 = 16;
/// Guard that is always true.
pub const GUARD_TRUE: u16 = 31;
/// Guard: a program; to this its first code record is added.
pub const GUARD_PROGRAM: u16 = 32;
/// Guard: a mask; to this its code record is added.
pub const GUARD_MASK: u16 = 1 << 15;

/// No action.
pub const ACTION_NONE: u16 = 0;
/// Actions in a row; to this its first code record is added.
pub const ACTION_ROW: u16 = 1;
/// One `send`; to this the channel is added.
pub const ACTION_SEND: u16 = 1 << 15;

/// The most records of code: guards and actions must be able to name them.
pub const MAX_CODE: usize = (GUARD_MASK - GUARD_PROGRAM) as usize;

/// Where the operation of an instruction stands.
pub const CODE_OPERATION_SHIFT: u16 = 13;
/// The bits of an instruction that hold its jump, or in bit 0 its last mark.
pub const CODE_LOW_MASK: u16 = (1 << CODE_OPERATION_SHIFT) - 1;
/// A guard's program ends; the guard is true.
pub const CODE_END: u16 = 0;
/// Jumps if the flag is clear.
pub const CODE_JUMP_IF_CLEAR: u16 = 1;
/// Jumps if the flag is set.
pub const CODE_JUMP_IF_SET: u16 = 2;
/// Jumps if nothing is busy inside the superstate that is left.
pub const CODE_JUMP_IF_IDLE_INSIDE: u16 = 3;
/// Jumps if something is busy inside the superstate that is left.
pub const CODE_JUMP_IF_BUSY_INSIDE: u16 = 4;
/// Sends an event.
pub const CODE_SEND: u16 = 5;
/// Clears a flag.
pub const CODE_CLEAR: u16 = 6;
/// Sets a flag.
pub const CODE_SET: u16 = 7;

/// Bit of `exit` in the flag block of a task state or superstate.
pub const FLAG_EXIT: usize = 0;
/// Bit of `timeout` in the flag block of a task state or superstate; in that of a simple state it
/// is bit 0.
pub const FLAG_TIMEOUT: usize = 1;
/// Bit of `busy` in the flag block of a task state.
pub const FLAG_BUSY: usize = 2;
/// Bit of the first control flag in the flag block of a task state.
pub const TASK_CONTROL_FLAGS: usize = 3;
/// Bit of the first control flag in the flag block of a container.
pub const CONTAINER_CONTROL_FLAGS: usize = 2;

macro_rules! sections {
    ($( $(#[$doc:meta])* $variant:ident $field:ident, )*
     ; $( $(#[$last_doc:meta])* $last:ident $last_field:ident, )*) => {
        /// The sections of a blob, in their order.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        #[repr(u8)]
        pub enum Section { $( $(#[$doc])* $variant, )* $( $(#[$last_doc])* $last, )* }

        impl Section {
            /// All sections in their order.
            pub const ALL: [Self; [$(Self::$variant,)* $(Self::$last,)*].len()] =
                [$(Self::$variant,)* $(Self::$last,)*];

            /// How many sections every blob has; those behind them only one with links.
            pub(crate) const ALWAYS: usize = [$(Self::$variant),*].len();

            /// The section with a number; the first if there is none.
            // Spelt out it is no code but the comparison, where a table would have to be looked up.
            #[cfg_attr(feature = "speed", inline(always))]
            pub(crate) fn with_number(number: u8) -> Self {
                match number {
                    $( number if number == Self::$variant as u8 => Self::$variant, )*
                    $( number if number == Self::$last as u8 => Self::$last, )*
                    _ => Self::Mission,
                }
            }
        }

        /// What postcard encodes between [`MAGIC`] and the CRC. Compilers write it;
        /// [`crate::verify()`] reads the same bytes without serde, which would take more flash than
        /// all of the verifier's checks.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
        pub struct Envelope<'a> {
            $( $(#[$doc])* #[serde(borrow)] pub $field: &'a [u8], )*
        }

        /// What follows the [`Envelope`] in a mission with links.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
        pub struct Communication<'a> {
            $( $(#[$last_doc])* #[serde(borrow)] pub $last_field: &'a [u8], )*
        }
    };
}

sections! {
    /// Numbers of the whole mission.
    Mission mission,
    /// Time slots.
    Slots slots,
    /// Container templates.
    Containers containers,
    /// Region templates.
    Regions regions,
    /// Local states.
    States states,
    /// Transitions.
    Transitions transitions,
    /// Guards and actions.
    Code code,
    /// Timeouts of states.
    Timers timers,
    /// Container instances.
    Instances instances,
    /// Region instances.
    RegionInstances region_instances,
    /// Events by sender.
    Channels channels,
    /// Rows of the region instances that listen to channels.
    Listeners listeners,
    /// Tasks in use.
    Tasks tasks,
    /// Texts of their signatures.
    Signatures signatures,
    /// Task states of templates.
    TaskStates task_states,
    /// Values of parameters.
    Params params,
    /// Task states of instances.
    TaskInstances task_instances,
    /// Nets of their data ports.
    Connections connections,
    /// Nets.
    Nets nets,
    /// Names.
    Names names,
    ;
    /// Links.
    Links links,
    /// What crosses them.
    Frames frames,
}

/// Set in the identifier of a frame that is received.
pub const FRAME_IS_RECEIVED: u16 = 1 << 15;

/// CRC-32 (IEEE 802.3) of `bytes`.
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    crc32_continued(0, bytes)
}

/// CRC-32 of bytes that stand behind others, whose CRC-32 is known.
///
/// ```
/// use esm_core::format::{crc32, crc32_continued};
/// assert_eq!(crc32_continued(crc32(b"12345"), b"6789"), crc32(b"123456789"));
/// ```
#[must_use]
pub fn crc32_continued(before: u32, bytes: &[u8]) -> u32 {
    let mut crc = !before;
    for byte in bytes {
        crc ^= u32::from(*byte);
        for _ in 0..2 {
            crc = (crc >> 4) ^ CRC_OF_HALF_BYTE[crc as usize % CRC_OF_HALF_BYTE.len()];
        }
    }
    !crc
}

/// What four bits that are shifted out do to a CRC. A table for whole bytes would be 1 KiB of flash
/// for a job that is done once an upload; without any, this job would take a third of the
/// verifier's time.
const CRC_OF_HALF_BYTE: [u32; 16] = {
    const POLYNOMIAL: u32 = 0xEDB8_8320;
    let mut table = [0; 16];
    let mut bits = 0;
    while bits < table.len() {
        let mut crc = bits as u32;
        let mut shifted = 0;
        while shifted < 4 {
            crc = (crc >> 1) ^ (POLYNOMIAL * (crc & 1));
            shifted += 1;
        }
        table[bits] = crc;
        bits += 1;
    }
    table
};

/// Reads a postcard varint of at most 32 bits, and moves behind it.
#[inline]
pub(crate) fn read_varint(bytes: &[u8], at: &mut usize) -> Option<u32> {
    const VALUE_BITS: u32 = 7;
    let mut value = 0;
    let mut shift = 0;
    while shift < u32::BITS {
        let byte = *bytes.get(*at)?;
        *at += 1;
        value |= u32::from(byte & 0x7F) << shift;
        if byte & 0x80 == 0 {
            return Some(value);
        }
        shift += VALUE_BITS;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::crc32;

    #[test]
    fn a_checksum_is_the_one_of_ethernet() {
        let every_byte: [u8; 256] = core::array::from_fn(|byte| byte as u8);
        for (bytes, expected) in [
            (&b""[..], 0),
            (b"123456789", 0xCBF4_3926),
            (&every_byte, 0x2905_8C73),
        ] {
            assert_eq!(crc32(bytes), expected, "{bytes:?}");
        }
    }
}
