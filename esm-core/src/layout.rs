//! The records of a blob: one struct for each kind, byte for byte as it stands there.
//!
//! This is the only definition of the layout. The verifier and [`Tables`](crate::tables::Tables)
//! borrow records from a blob in place, the interpreter reads fields at their offsets in these
//! structs, and compilers fill the structs in.
//!
//! The views are [zerocopy]'s: it derives, from an ordinary struct, that any bytes of the
//! right length are a record and that a record is its bytes. Views of our own would need `unsafe`
//! for the same borrow, or would decode each record into a second struct first. All fields are
//! little endian and need no alignment, so a struct has no gaps.

use core::ops::Range;

use zerocopy::little_endian::{U16, U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use crate::format::{self, Section};

/// A 16-bit index or count.
#[derive(
    Clone, Copy, PartialEq, Eq, Debug, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned,
)]
#[repr(transparent)]
pub struct Short(U16);

impl Short {
    /// No index, where one is possible.
    pub const NONE: Self = Self(U16::new(format::NONE));

    /// A number of at most 16 bits.
    #[must_use]
    pub const fn new(number: usize) -> Self {
        debug_assert!(number <= u16::MAX as usize, "limits are checked before");
        Self(U16::new(number as u16))
    }

    /// An index, or [`Self::NONE`].
    #[must_use]
    pub const fn optional(index: Option<usize>) -> Self {
        match index {
            Some(index) => Self::new(index),
            None => Self::NONE,
        }
    }

    /// The number.
    #[cfg_attr(feature = "speed", inline(always))]
    #[must_use]
    pub const fn get(self) -> usize {
        self.0.get() as usize
    }

    /// The index, where it is one.
    #[cfg_attr(feature = "speed", inline(always))]
    #[must_use]
    pub const fn index(self) -> Option<usize> {
        match self.0.get() {
            format::NONE => None,
            index => Some(index as usize),
        }
    }
}

/// A record of a blob.
pub trait Record: FromBytes + IntoBytes + Immutable + KnownLayout + Unaligned + 'static {
    /// The table that it stands in.
    const SECTION: Section;
}

macro_rules! records {
    ($(
        $(#[$doc:meta])*
        $section:ident: $record:ident {
            $( $(#[$field_doc:meta])* $field:ident: $number:ty, )*
        }
    )*) => { $(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
        #[repr(C)]
        pub struct $record { $( $(#[$field_doc])* pub $field: $number, )* }

        impl Record for $record {
            const SECTION: Section = Section::$section;
        }
    )* };
}

records! {
    /// Numbers of the whole mission. There is one record.
    Mission: Mission {
        /// Events that the queue holds, 1 to 255.
        queue: Short,
        /// The slot that runs the interpreter.
        interpreter_slot: Short,
        /// Events; their numbers start at 1.
        events: Short,
        /// Bits of all flags.
        flags: Short,
        /// `exclusive` groups.
        exclusive_groups: Short,
    }

    /// A time slot; times in microseconds.
    Slots: Slot {
        /// The number that it was declared with, 1 or above.
        number: U32,
        /// Period.
        period_us: U32,
        /// Duration.
        duration_us: U32,
        /// First start, below the period.
        start_us: U32,
    }

    /// A container template.
    Containers: Container {
        /// Its first region; the others follow.
        first_region: Short,
        /// Control flags.
        flags: Short,
        /// Different events that its transitions send.
        channels: Short,
        /// Its first instance.
        first_instance: Short,
        /// Flag bits of an instance, with all inside it.
        flag_span: Short,
        /// Task instances of an instance, with all inside it.
        task_span: Short,
        /// Region instances of an instance, with all inside it.
        region_span: Short,
        /// Container instances of an instance: itself, and all inside it.
        instance_span: Short,
    }

    /// A region template.
    Regions: Region {
        /// Its first state, `initial`; the others follow, `final` is the last.
        first_state: Short,
        /// The container that it belongs to.
        container: Short,
    }

    /// A state of a region template.
    States: State {
        /// Events that its transitions are on, see [States](crate::format#states).
        events: U32,
        /// First transition out of it.
        first_transition: Short,
        /// First transition that is not on the pulse.
        first_event_transition: Short,
        /// First bit of its flag block, relative to that of its instance.
        first_flag: Short,
        /// Kind, timeout mark and number of flags.
        shape: U16,
        /// Task state: its task instance, relative to the first of the instance. Superstate: the
        /// container instance inside, relative to the instance. Otherwise 0.
        a: Short,
        /// With a timeout: its timer. Otherwise the length of its row of guards.
        b: Short,
    }

    /// A transition.
    Transitions: Transition {
        /// Number of its event, and the plain mark.
        event: U16,
        /// The state that it leads to.
        target: Short,
        /// See [Guards](crate::format#guards).
        guard: U16,
        /// See [Actions](crate::format#actions).
        action: U16,
    }

    /// An instruction of a guard or an action.
    Code: Code {
        /// Flag, relative to the first of the instance; or channel, relative to the first of the
        /// instance.
        operand: Short,
        /// Operation, and jump or last mark.
        control: U16,
    }

    /// A guard that compares several flags at once; it stands among the instructions.
    Code: Mask {
        /// Bits of the window that are compared.
        mask: U16,
        /// What they must be.
        value: U16,
    }

    /// The timeout of a state.
    Timers: Timer {
        /// Longest stay, in microseconds.
        timeout_us: U32,
    }

    /// A container instance.
    Instances: Instance {
        /// Its container.
        container: Short,
        /// Its first region instance.
        first_region: Short,
        /// First bit of its flag block.
        first_flag: Short,
        /// Its first channel.
        first_channel: Short,
        /// Its first task instance.
        first_task: Short,
        /// The region instance around it, 0 at the root.
        around: Short,
    }

    /// A region instance.
    RegionInstances: RegionInstance {
        /// The region instance behind it and all inside it.
        next: Short,
        /// First bit of the flag block of its instance.
        first_flag: Short,
        /// Its `initial` state.
        initial: Short,
        /// The instance that it belongs to.
        instance: Short,
    }

    /// An event as it is sent in a container instance.
    Channels: Channel {
        /// Its number.
        event: U16,
        /// First word of its row of listeners.
        first_row_word: Short,
        /// The word of region instances that its row begins with.
        first_region_word: Short,
        /// Words of its row.
        region_words: Short,
    }

    /// A word of rows of listeners.
    Listeners: Listener {
        /// 32 region instances, the first in the highest bit.
        regions: U32,
    }

    /// A task that the mission uses.
    Tasks: Task {
        /// Hash of its signature.
        signature_hash: U64,
        /// First byte of the signature's text.
        text_start: Short,
        /// Length of that text.
        text_length: Short,
        /// Its `exclusive` group, or none.
        exclusive: Short,
        /// Data ports.
        data: Short,
        /// Control flags.
        flags: Short,
        /// Parameters.
        params: Short,
    }

    /// A task state of a container template.
    TaskStates: TaskState {
        /// Its task.
        task: Short,
        /// Its slot, or none for slot 0.
        slot: Short,
        /// Its first parameter value; the others follow in the order of the signature.
        first_param: Short,
        /// The state.
        state: Short,
    }

    /// The value of a parameter.
    Params: Param {
        /// Its 32 bits.
        value: U32,
    }

    /// A task state of a container instance.
    TaskInstances: TaskInstance {
        /// The state.
        state: Short,
        /// The region instance that it belongs to.
        region: Short,
        /// Its first connection; one for each data port in the order of the signature.
        first_connection: Short,
        /// First bit of its flag block in the whole machine.
        first_flag: Short,
        /// The task state of its template.
        task_state: Short,
    }

    /// What a data port is connected with.
    Connections: Connection {
        /// A net, or none.
        net: Short,
    }

    /// A net of data ports.
    Nets: Net {
        /// Hash of the type's name.
        type_hash: U64,
    }

    /// A link.
    Links: Link {
        /// Bits a second.
        rate_bps: U32,
        /// How long it is silent between two frames, in microseconds.
        gap_us: U32,
        /// What medium and identifier take of a frame, in bytes, and in the high byte the bits
        /// that a byte takes on the wire.
        header_and_bits: U16,
        /// The task that sends, or none.
        transmit: Short,
        /// The task that receives, or none.
        receive: Short,
        /// 0.
        reserved: U16,
    }

    /// A frame of a link.
    Frames: Frame {
        /// What it means: sender and receiver of one meaning have one number.
        configuration: U64,
        /// Period in microseconds.
        period_us: U32,
        /// First start in microseconds, below the period; 0 for one that is received.
        start_us: U32,
        /// How old a received value may be in microseconds; 0 for three periods.
        late_us: U32,
        /// Identifier, and whether it is received.
        id: U16,
        /// Its link.
        link: Short,
        /// Bytes of the payload.
        payload: Short,
        /// Flags that it carries, the first in the lowest bit; 0 where it carries a value.
        flags: Short,
    }
}

impl State {
    /// Its kind, such as [`format::STATE_SIMPLE`].
    #[cfg_attr(feature = "speed", inline(always))]
    #[must_use]
    pub const fn kind(&self) -> u16 {
        self.shape.get() >> format::STATE_KIND_SHIFT
    }

    /// Whether it has a timeout.
    #[cfg_attr(feature = "speed", inline(always))]
    #[must_use]
    pub const fn has_timeout(&self) -> bool {
        self.shape.get() & format::STATE_HAS_TIMEOUT != 0
    }

    /// How many flags entering it resets.
    #[cfg_attr(feature = "speed", inline(always))]
    #[must_use]
    pub const fn flags(&self) -> usize {
        (self.shape.get() & format::STATE_FLAGS_MASK) as usize
    }

    /// Its own flags but the first ones, relative to the first flag of the instance.
    #[inline]
    #[must_use]
    pub const fn own_flags(&self, skipped: usize) -> Range<usize> {
        let first = self.first_flag.get();
        first + skipped..first + self.flags()
    }
}

impl Code {
    /// Its operation, such as [`format::CODE_SEND`].
    #[cfg_attr(feature = "speed", inline(always))]
    #[must_use]
    pub const fn operation(&self) -> u16 {
        self.control.get() >> format::CODE_OPERATION_SHIFT
    }

    /// Its jump, or its last mark.
    #[cfg_attr(feature = "speed", inline(always))]
    #[must_use]
    pub const fn low(&self) -> usize {
        (self.control.get() & format::CODE_LOW_MASK) as usize
    }
}

/// Bytes of a record of a section.
#[cfg_attr(feature = "speed", inline(always))]
#[must_use]
pub const fn record_bytes(section: Section) -> usize {
    RECORD_BYTES[section as usize] as usize
}

const RECORD_BYTES: [u8; Section::ALL.len()] = {
    let mut bytes = [0; _];
    let mut number = 0;
    while number < Section::ALL.len() {
        let section = Section::ALL[number];
        bytes[section as usize] = match section {
            Section::Mission => size_of::<Mission>(),
            Section::Slots => size_of::<Slot>(),
            Section::Containers => size_of::<Container>(),
            Section::Regions => size_of::<Region>(),
            Section::States => size_of::<State>(),
            Section::Transitions => size_of::<Transition>(),
            Section::Code => size_of::<Code>(),
            Section::Timers => size_of::<Timer>(),
            Section::Instances => size_of::<Instance>(),
            Section::RegionInstances => size_of::<RegionInstance>(),
            Section::Channels => size_of::<Channel>(),
            Section::Listeners => size_of::<Listener>(),
            Section::Tasks => size_of::<Task>(),
            Section::TaskStates => size_of::<TaskState>(),
            Section::Params => size_of::<Param>(),
            Section::TaskInstances => size_of::<TaskInstance>(),
            Section::Connections => size_of::<Connection>(),
            Section::Nets => size_of::<Net>(),
            Section::Links => size_of::<Link>(),
            Section::Frames => size_of::<Frame>(),
            // Texts.
            Section::Signatures | Section::Names => size_of::<u8>(),
        } as u8;
        number += 1;
    }
    bytes
};

/// The offset of a field, for the interpreter: it reads fields by the place of their record alone,
/// see [`crate::reads`].
#[derive(Clone, Copy)]
pub(crate) struct Field(usize);

impl Field {
    /// First byte of the field in its record.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) const fn offset(self) -> usize {
        self.0
    }
}

macro_rules! fields {
    ($( $module:ident: $record:ident { $( $name:ident $field:ident, )* } )*) => { $(
        pub(crate) mod $module {
            use core::mem::offset_of;

            use crate::layout::{Field, $record};
            $( pub(crate) const $name: Field = Field(offset_of!($record, $field)); )*
        }
    )* };
}

fields! {
    mission: Mission {
        QUEUE queue, INTERPRETER_SLOT interpreter_slot, FLAGS flags,
    }
    slot: Slot {
        PERIOD period_us,
    }
    container: Container {
        TASK_SPAN task_span,
    }
    state: State {
        FIRST_TRANSITION first_transition, FIRST_EVENT_TRANSITION first_event_transition,
        FIRST_FLAG first_flag, SHAPE shape, A a, B b,
    }
    transition: Transition {
        EVENT event, TARGET target, GUARD guard, ACTION action,
    }
    code: Code {
        OPERAND operand, CONTROL control,
    }
    instance: Instance {
        CONTAINER container, FIRST_REGION first_region, FIRST_FLAG first_flag,
        FIRST_CHANNEL first_channel, FIRST_TASK first_task, AROUND around,
    }
    region_instance: RegionInstance {
        NEXT next, FIRST_FLAG first_flag, INITIAL initial, INSTANCE instance,
    }
    channel: Channel {
        EVENT event, FIRST_ROW_WORD first_row_word, FIRST_REGION_WORD first_region_word,
        REGION_WORDS region_words,
    }
    task_instance: TaskInstance {
        STATE state, REGION region, FIRST_FLAG first_flag,
    }
}
