//! The blob, byte by byte.
//!
//! A blob is one mission: machine, schedule, data paths, parameters. It is made of
//!
//! 1. the four bytes `ESM1`, in which the digit is the version of this format;
//! 2. the [`Envelope`] in [postcard](https://postcard.jamesmunns.com/wire-format) encoding. All its fields are byte strings, so on the wire it is the
//!    sections below one after another, each a varint (seven bits a byte, low ones first, the highest bit says that another byte follows) with the
//!    section's length in bytes, and the bytes themselves;
//! 3. the CRC-32 (IEEE 802.3) of all bytes before it, four bytes, little endian. It is also the *mission hash*.
//!
//! A section is a table of records of one fixed size, without gaps. All numbers are little endian, and unless something else is said they are 16 bits
//! wide. `0xFFFF` stands for *none* where one is possible. Counts are not stored: they follow from the lengths.
//!
//! # Sections
//!
//! | section | record | fields |
//! |---|---|---|
//! | mission | 10, just one | queue capacity (1–255); index of the interpreter's slot; number of events; number of flag bits; number of exclusive groups |
//! | slots | 16 | number, period, duration, first start: 32 bits each, times in µs |
//! | containers | 16 | first region; control flags; channels; first instance; then what an instance takes with all inside it: flag bits; task instances; region instances; container instances |
//! | regions | 4 | first state; container |
//! | states | 16 | first transition; first transition not on the pulse; first flag; shape; *a*; *b*; timeout in µs (32 bits) |
//! | transitions | 6 | event; target state; first code |
//! | code | 4 | operand; operation (top 3 bits) and jump or last mark (low 13 bits) |
//! | instances | 16 | container; first region instance; first flag; first channel; first task instance; end of task instances; region instance and state of the superstate around it |
//! | region instances | 8 | next; first flag; initial state; instance |
//! | channels | 10 | event; first instance; number of instances; first byte of visibility bits (32 bits, all ones: whole window) |
//! | visibility | 1 | bits, lowest first |
//! | tasks | 20 | signature hash (64 bits); start of the signature's text; its length; exclusive group or none; data ports; flags; parameters |
//! | signatures | 1 | the texts of the signatures, see [`crate::signature`] |
//! | task states | 6 | task; slot, or none for slot 0; first parameter |
//! | parameters | 4 | 32 bits of a value |
//! | task instances | 6 | state; region instance; first connection |
//! | connections | 2 | net, or none for an open port |
//! | nets | 8 | hash of the type's name (64 bits) |
//! | names | 1 | see below |
//!
//! **Templates and instances.** A container is stored once, however often it is used: containers, regions, states, transitions and code are templates.
//! What differs from instance to instance are bases (first flag, first channel, first task instance), to which everything in a template is
//! relative. A *shape* holds the kind of a state in its top 3 bits (0 initial, 1 final, 2 simple, 3 real-time task, 4 slot-0 task, 5 superstate), in bit 12
//! whether it has a timeout, and below how many flag bits entering it resets. For a task state *a* is the task instance relative to the instance's
//! first, *b* the task state; for a superstate *a* is the first region instance inside relative to the region instance that holds
//! the state, *b* the container instance inside relative to the instance that holds it; otherwise both are 0.
//!
//! **Order.** Everything stands in one order, and the parts of a thing stand together: the regions of container 0, of container 1, …; the
//! states of region 0, of region 1, … with `initial` first and `final` last; the transitions of state 0, of state 1, …, in each those on the pulse first;
//! the code of transition 0, of transition 1, …; the channels of instance 0, … So an end is where the next thing begins, and nothing is shared but by the rules.
//!
//! **Instance tree.** Container instances, region instances and task instances are numbered depth first, regions and states in source order. The
//! machine is instance 0 of container 0. A region instance's *next* is its next sibling, or, for the last of an instance, the *next* of the region instance
//! around, or the number of region instances. The walk of the interpreter starts at 0 and goes either to the first region instance inside the current
//! superstate or to *next*; both are above where it stands, so it ends without recursion or a stack.
//!
//! **Flags.** The block of a container instance starts with `exit` and `timeout` of its superstate (at the root: of the machine, whose exit flag says that it
//! is finished) and its control flags in the order of declaration. The blocks of its states follow, region by region: a simple state has its timeout
//! flag or nothing; a task state exit, timeout, busy and its control flags in the order of the signature; a superstate the whole block of the instance inside. So the first flag of an
//! instance is its superstate's, and every flag that a transition can name is a bit at a fixed distance from the first flag of its instance.
//!
//! **Guards and actions.** Bit 15 of a transition's event says that it has code; otherwise its guard is true and it has no actions. Code starts
//! with the tests of the guard: operation 1 jumps if the flag is clear, 2 if it is set, 3 and 4 do so by the busy flag of the superstate that the transition leaves,
//! which is the *or* of those of the active task states inside. A jump of 0 ends the guard as false, else it counts records ahead, at most to the first record
//! that is no test: when that is reached, the guard is true. It is operation 0 where there are no actions, otherwise the first action: 5 sends on a
//! channel, 6 clears a flag, 7 sets one; the low bit marks the last.
//!
//! **Channels.** An event that is sent in a container instance has a channel there, one for each pair of instance and sent event. It carries the event's number and
//! where it is visible: a window of instances, and in the window a bit each.
//!
//! # Names
//!
//! The names that signatures do not hold, each a varint with its length and an ASCII identifier; the section is empty if they were left out. First the events in the order
//! of their numbers; then for each container its name, its control flags and for each region its name and those of its states, pseudo-states left out;
//! then the `exclusive` groups.
//!
//! # Limits
//!
//! 65,535 records in any table that is addressed with 16 bits, 65,535 flag bits, 4,095 flags of one state, 32,767 events, [`MAX_STATE_INSTANCES`] state instances, jumps over at most 8,191
//! tests, times of at most [`MAX_TIME_US`].

use serde::{Deserialize, Serialize};

/// The first four bytes of a blob.
pub const MAGIC: [u8; 4] = *b"ESM1";
/// Bytes of the CRC at the end of a blob.
pub const CRC_BYTES: usize = 4;
/// Event number of the pulse.
pub const PULSE: u16 = 0;
/// Stands for no index.
pub const NONE: u16 = u16::MAX;
/// The longest period and timeout: 4,000 s. Below 2³² µs, so that the age of a state can be told from 32 bits.
pub const MAX_TIME_US: u32 = 4_000_000_000;
/// The greatest number of an event.
pub const MAX_EVENT: u16 = TRANSITION_HAS_CODE - 1;
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

/// Set in the event of a transition that has a guard or an action.
pub const TRANSITION_HAS_CODE: u16 = 1 << 15;

/// Where the operation of an instruction stands.
pub const CODE_OPERATION_SHIFT: u16 = 13;
/// The bits of an instruction that hold its jump, or in bit 0 its last mark.
pub const CODE_LOW_MASK: u16 = (1 << CODE_OPERATION_SHIFT) - 1;
/// Guard ends, no actions.
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

/// Visibility of a channel that its whole window sees.
pub const CHANNEL_NO_BITS: u32 = u32::MAX;

/// Bit of `exit` in the flag block of a task state or superstate.
pub const FLAG_EXIT: usize = 0;
/// Bit of `timeout` in the flag block of a task state or superstate; in that of a simple state it is bit 0.
pub const FLAG_TIMEOUT: usize = 1;
/// Bit of `busy` in the flag block of a task state.
pub const FLAG_BUSY: usize = 2;
/// Bit of the first control flag in the flag block of a task state.
pub const TASK_CONTROL_FLAGS: usize = 3;
/// Bit of the first control flag in the flag block of a container.
pub const CONTAINER_CONTROL_FLAGS: usize = 2;

macro_rules! sections {
    ($( $(#[$doc:meta])* $variant:ident $field:ident, )*) => {
        /// The sections of a blob, in their order.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        #[repr(u8)]
        pub enum Section { $( $(#[$doc])* $variant, )* }

        impl Section {
            /// All sections in their order.
            pub const ALL: [Self; [$(Self::$variant),*].len()] = [$(Self::$variant),*];
        }

        /// What postcard encodes between [`MAGIC`] and the CRC. Compilers write it; [`crate::verify()`] reads the same bytes without serde, which
        /// would take more flash than all of the verifier's checks.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
        pub struct Envelope<'a> {
            $( $(#[$doc])* #[serde(borrow)] pub $field: &'a [u8], )*
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
    /// Container instances.
    Instances instances,
    /// Region instances.
    RegionInstances region_instances,
    /// Events by sender.
    Channels channels,
    /// Bits of the channels' windows.
    Visibility visibility,
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
}

/// CRC-32 (IEEE 802.3) of `bytes`.
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    // Bit by bit: a table would be 1 KiB of flash for a job that is done once an upload.
    const CRC: crc::Crc<u32, crc::NoTable> =
        crc::Crc::<u32, crc::NoTable>::new(&crc::CRC_32_ISO_HDLC);
    CRC.checksum(bytes)
}

/// Reads a postcard varint of at most 32 bits; returns it and what follows.
pub(crate) fn read_varint(bytes: &[u8]) -> Option<(u32, &[u8])> {
    const VALUE_BITS: u32 = 7;
    let mut value = 0;
    let mut rest = bytes;
    let mut shift = 0;
    while shift < u32::BITS {
        let (byte, tail) = rest.split_first()?;
        rest = tail;
        value |= u32::from(byte & 0x7F) << shift;
        if byte & 0x80 == 0 {
            return Some((value, rest));
        }
        shift += VALUE_BITS;
    }
    None
}
