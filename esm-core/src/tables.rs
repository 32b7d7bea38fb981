//! The tables of a blob, read in place.
//!
//! [`Tables`] is a set of borrowed slices, one for each section of the [format](mod@crate::format),
//! and a decoder for each kind of record. Nothing is copied and nothing panics: an index outside a
//! table reads as `None`. All indices are positions in tables; what they are relative to stands
//! with each field.

use zerocopy::FromBytes;

use crate::format::{self, Section};
use crate::layout::{self, Record};

pub use crate::layout::record_bytes;
use crate::signature::{PortCounts, Signature};

/// A time slot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Slot {
    /// The number that it was declared with, 1 or above.
    pub number: u32,
    /// Period in microseconds.
    pub period_us: u32,
    /// Duration in microseconds.
    pub duration_us: u32,
    /// First nominal start in microseconds, below the period.
    pub start_us: u32,
}

/// A container template: what all its instances share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Container {
    /// Its first region in the table of regions; the others follow.
    pub first_region: usize,
    /// Control flags, which stand behind `exit` and `timeout` at the head of its flag block.
    pub flags: usize,
    /// Different events that its transitions send.
    pub channels: usize,
    /// Its first instance.
    pub first_instance: usize,
    /// Bits of the flag block of an instance, containers inside included.
    pub flag_span: usize,
    /// Task instances in an instance, at any depth.
    pub task_span: usize,
    /// Region instances of an instance and inside it, at any depth.
    pub region_span: usize,
    /// Container instances that an instance is, itself and those inside it counted.
    pub instance_span: usize,
}

/// A region template.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// Its first state, which is its `initial` pseudo-state; the others follow in source order,
    /// `final` is the last.
    pub first_state: usize,
    /// The container that it belongs to.
    pub container: usize,
}

/// What a local state is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StateKind {
    /// The pseudo-state in which a region starts.
    Initial,
    /// The pseudo-state that sets the exit flag of the superstate around it.
    Final,
    /// A state without content.
    Simple,
    /// A task runs while this state is current.
    Task {
        /// Task instance, relative to [`Instance::first_task`].
        task_offset: usize,
        /// Whether it runs in a slot; false for slot 0.
        real_time: bool,
    },
    /// An instance of a container is inside.
    Super {
        /// Container instance inside, relative to the instance that holds this state.
        instance_offset: usize,
    },
}

/// A local state of a region template, pseudo-states included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct State {
    /// Events that its transitions are on: bit 0 for the pulse, and for each other event the bit of
    /// its number's remainder by 32.
    pub events: u32,
    /// First transition out of it; first those on the pulse in source order, then the others by the
    /// numbers of their events.
    pub first_transition: usize,
    /// First transition that is not on the pulse.
    pub first_event_transition: usize,
    /// First bit of its flag block, relative to [`Instance::first_flag`].
    pub first_flag: usize,
    /// Bits that entering it resets. Task state: exit, timeout, busy, control flags. Superstate:
    /// exit, timeout, control flags. Simple state: timeout, or none where nothing needs it.
    pub flags: usize,
    /// What it is.
    pub kind: StateKind,
    /// Longest stay before its timeout flag is set.
    pub timeout_us: Option<u32>,
}

/// A transition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transition {
    /// [`format::PULSE`] or the number of an event.
    pub event: u16,
    /// Whether it changes nothing but the current state.
    pub is_plain: bool,
    /// The state that it leads to.
    pub target: usize,
    /// Its guard as the format writes it; see [`Tables::guard_of`].
    pub guard: u16,
    /// Its action as the format writes it; see [`Tables::actions_of`].
    pub action: u16,
}

/// What must hold for a transition to be taken. Bits are those of the window: bit 0 is the first
/// flag of the state that is left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Guard {
    /// Always true.
    True,
    /// A flag has a value.
    Flag {
        /// Bit of the window, below [`format::WINDOW_FLAGS`].
        bit: usize,
        /// The value that makes it true.
        value: bool,
    },
    /// All flags of a mask have their values.
    Mask {
        /// Bits of the window that are looked at.
        mask: u16,
        /// Those of them that must be set; the others must be clear.
        value: u16,
    },
    /// Tests, one after another; see [`Tables::program_of`].
    Program {
        /// The first [`Code`].
        first: usize,
    },
}

/// One instruction of a guard or an action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Code {
    /// Guard: goes on with the next instruction unless the flag has the value `jump_if`, else
    /// jumps.
    Test {
        /// Bit relative to [`Instance::first_flag`].
        flag: usize,
        /// Value that jumps.
        jump_if: bool,
        /// Instructions ahead; `None` where the guard is false.
        jump: Option<usize>,
    },
    /// Guard: the same for the busy flag of the superstate that the transition leaves.
    TestBusyInside {
        /// Value that jumps.
        jump_if: bool,
        /// Instructions ahead; `None` where the guard is false.
        jump: Option<usize>,
    },
    /// Ends a guard as true.
    End,
    /// Action: appends an event to the queue.
    Send {
        /// Channel, relative to [`Instance::first_channel`].
        channel: usize,
        /// Whether it is the last action.
        last: bool,
    },
    /// Action: changes a control flag.
    Write {
        /// Bit relative to [`Instance::first_flag`].
        flag: usize,
        /// The new value.
        value: bool,
        /// Whether it is the last action.
        last: bool,
    },
}

/// A container instance: the machine (instance 0) or what is inside one superstate. Numbered depth
/// first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instance {
    /// Its container.
    pub container: usize,
    /// Its first region instance.
    pub first_region: usize,
    /// First bit of its flag block: `exit` of its superstate.
    pub first_flag: usize,
    /// Its first channel.
    pub first_channel: usize,
    /// The first task instance inside it, at any depth.
    pub first_task: usize,
    /// The region instance that holds its superstate; 0 for the machine, where it means nothing.
    /// See [`Tables::superstate_of`].
    pub around: usize,
}

/// A region instance. Numbered depth first: what is inside a region's superstates stands between it
/// and the next of its siblings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegionInstance {
    /// Where the walk goes on when this region and all inside it are done: always above its own
    /// index; the number of region instances at the end.
    pub next: usize,
    /// [`Instance::first_flag`] of its instance.
    pub first_flag: usize,
    /// Its `initial` state.
    pub initial: usize,
    /// The instance that it belongs to.
    pub instance: usize,
}

/// An event as sent from one container instance, and the row of region instances that listen to it;
/// see [`Tables::is_listening`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Number of the event.
    pub event: u16,
    /// First word of its row in the table of listeners.
    pub first_row_word: usize,
    /// Region instances that come before its row, in words of 32.
    pub first_region_word: usize,
    /// Words of its row.
    pub region_words: usize,
}

/// A task that the mission uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Task<'a> {
    /// Its signature.
    pub signature: Signature<'a>,
    /// Hash of the signature.
    pub signature_hash: u64,
    /// Number of its `exclusive` group, if it has one.
    pub exclusive: Option<u16>,
    /// Ports of its signature.
    pub ports: PortCounts,
}

/// A task state of a container template.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TaskState {
    /// Its task.
    pub task: usize,
    /// Its slot; `None` for slot 0, the time that is left.
    pub slot: Option<usize>,
    /// First of its parameter values, which stand in the order of the signature.
    pub first_param: usize,
    /// The state.
    pub state: usize,
}

/// A task state of a container instance. Numbered in the order of the instance tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TaskInstance {
    /// The state in the tables.
    pub state: usize,
    /// The region instance that it belongs to.
    pub region: usize,
    /// First of its connections, one for each data port in the order of the signature.
    pub first_connection: usize,
    /// First bit of its flag block in the whole machine.
    pub first_flag: usize,
    /// Its [`TaskState`].
    pub task_state: usize,
}

/// Where what belongs to a task instance stands: looked up once, and read as often as it is needed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TaskPlaces {
    /// First bit of its flag block: exit, timeout, busy, control flags in the order of the
    /// signature.
    pub first_flag: u16,
    /// Which of the first 16 control flags it has: one bit each, the first in the lowest.
    pub control_flags: u16,
    /// [`TaskState::first_param`].
    pub first_param: u16,
    /// [`TaskInstance::first_connection`].
    pub first_connection: u16,
    /// [`TaskInstance::region`].
    pub region: u16,
}

/// A net: data ports joined by data paths, over all container borders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Net {
    /// [`fnv1a`](crate::signature::fnv1a) of the type's name.
    pub type_hash: u64,
}

/// First byte and number of records of each section of a blob.
pub(crate) type Sections = [(u32, u32); Section::ALL.len()];

/// All tables of a blob. Cheap to copy: two references.
#[derive(Clone, Copy, Debug)]
pub struct Tables<'a> {
    bytes: &'a [u8],
    sections: &'a Sections,
}

impl From<&layout::Slot> for Slot {
    #[inline]
    fn from(record: &layout::Slot) -> Self {
        Self {
            number: record.number.get(),
            period_us: record.period_us.get(),
            duration_us: record.duration_us.get(),
            start_us: record.start_us.get(),
        }
    }
}

impl From<&layout::Container> for Container {
    #[inline]
    fn from(record: &layout::Container) -> Self {
        Self {
            first_region: record.first_region.get(),
            flags: record.flags.get(),
            channels: record.channels.get(),
            first_instance: record.first_instance.get(),
            flag_span: record.flag_span.get(),
            task_span: record.task_span.get(),
            region_span: record.region_span.get(),
            instance_span: record.instance_span.get(),
        }
    }
}

impl From<&layout::Region> for Region {
    #[inline]
    fn from(record: &layout::Region) -> Self {
        Self {
            first_state: record.first_state.get(),
            container: record.container.get(),
        }
    }
}

impl<'a> Task<'a> {
    fn of(record: &layout::Task, texts: &'a [u8]) -> Self {
        let start = record.text_start.get();
        let text = texts.get(start..start + record.text_length.get());
        Self {
            signature: Signature::new(text.unwrap_or(&[])),
            signature_hash: record.signature_hash.get(),
            exclusive: record.exclusive.index().map(|group| group as u16),
            ports: PortCounts {
                data: record.data.get(),
                flags: record.flags.get(),
                params: record.params.get(),
            },
        }
    }
}

impl State {
    /// The state of a record, if its kind is known, with the timeout that stands among the timers.
    fn of(record: &layout::State, timeout_us: impl Fn(usize) -> Option<u32>) -> Option<Self> {
        let shape = record.shape.get();
        let a = record.a.get();
        let kind = match shape >> format::STATE_KIND_SHIFT {
            format::STATE_INITIAL => StateKind::Initial,
            format::STATE_FINAL => StateKind::Final,
            format::STATE_SIMPLE => StateKind::Simple,
            kind @ (format::STATE_TASK | format::STATE_BACKGROUND_TASK) => StateKind::Task {
                task_offset: a,
                real_time: kind == format::STATE_TASK,
            },
            format::STATE_SUPER => StateKind::Super { instance_offset: a },
            _ => return None,
        };
        let has_timeout = shape & format::STATE_HAS_TIMEOUT != 0;
        let timeout_us = has_timeout.then(|| timeout_us(record.b.get()));
        Some(Self {
            events: record.events.get(),
            first_transition: record.first_transition.get(),
            first_event_transition: record.first_event_transition.get(),
            first_flag: record.first_flag.get(),
            flags: usize::from(shape & format::STATE_FLAGS_MASK),
            kind,
            timeout_us: timeout_us.flatten(),
        })
    }
}

impl From<&layout::Transition> for Transition {
    fn from(record: &layout::Transition) -> Self {
        let event = record.event.get();
        Self {
            event: event & !format::TRANSITION_IS_PLAIN,
            is_plain: event & format::TRANSITION_IS_PLAIN != 0,
            target: record.target.get(),
            guard: record.guard.get(),
            action: record.action.get(),
        }
    }
}

impl Code {
    /// The instruction of a record, if its operation is known.
    fn of(record: &layout::Code) -> Option<Self> {
        let operand = record.operand.get();
        let control = record.control.get();
        let low = control & format::CODE_LOW_MASK;
        let jump = (low != 0).then_some(usize::from(low));
        let last = low != 0;
        Some(match control >> format::CODE_OPERATION_SHIFT {
            format::CODE_END => Self::End,
            operation @ (format::CODE_JUMP_IF_CLEAR | format::CODE_JUMP_IF_SET) => Self::Test {
                flag: operand,
                jump_if: operation == format::CODE_JUMP_IF_SET,
                jump,
            },
            operation @ (format::CODE_JUMP_IF_IDLE_INSIDE | format::CODE_JUMP_IF_BUSY_INSIDE) => {
                Self::TestBusyInside {
                    jump_if: operation == format::CODE_JUMP_IF_BUSY_INSIDE,
                    jump,
                }
            }
            format::CODE_SEND => Self::Send {
                channel: operand,
                last,
            },
            operation @ (format::CODE_CLEAR | format::CODE_SET) => Self::Write {
                flag: operand,
                value: operation == format::CODE_SET,
                last,
            },
            _ => return None,
        })
    }
}

impl From<&layout::RegionInstance> for RegionInstance {
    fn from(record: &layout::RegionInstance) -> Self {
        Self {
            next: record.next.get(),
            first_flag: record.first_flag.get(),
            initial: record.initial.get(),
            instance: record.instance.get(),
        }
    }
}

impl From<&layout::Instance> for Instance {
    fn from(record: &layout::Instance) -> Self {
        Self {
            container: record.container.get(),
            first_region: record.first_region.get(),
            first_flag: record.first_flag.get(),
            first_channel: record.first_channel.get(),
            first_task: record.first_task.get(),
            around: record.around.get(),
        }
    }
}

impl From<&layout::Channel> for Channel {
    fn from(record: &layout::Channel) -> Self {
        Self {
            event: record.event.get(),
            first_row_word: record.first_row_word.get(),
            first_region_word: record.first_region_word.get(),
            region_words: record.region_words.get(),
        }
    }
}

impl From<&layout::TaskState> for TaskState {
    fn from(record: &layout::TaskState) -> Self {
        Self {
            task: record.task.get(),
            slot: record.slot.index(),
            first_param: record.first_param.get(),
            state: record.state.get(),
        }
    }
}

impl From<&layout::TaskInstance> for TaskInstance {
    fn from(record: &layout::TaskInstance) -> Self {
        Self {
            state: record.state.get(),
            region: record.region.get(),
            first_connection: record.first_connection.get(),
            first_flag: record.first_flag.get(),
            task_state: record.task_state.get(),
        }
    }
}

impl<'a> Tables<'a> {
    #[inline]
    pub(crate) fn new(bytes: &'a [u8], sections: &'a Sections) -> Self {
        Self { bytes, sections }
    }

    /// The blob.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// The byte of the blob at which a section begins.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn start_at(&self, section: usize) -> usize {
        self.sections
            .get(section)
            .map_or(0, |(start, _)| *start as usize)
    }

    /// The bytes of a section.
    // Inlined, it would be a large part of the verifier.
    #[inline(never)]
    pub(crate) fn section(&self, section: Section) -> &'a [u8] {
        let (start, records) = self.sections[section as usize];
        let start = start as usize;
        let end = start + records as usize * record_bytes(section);
        self.bytes.get(start..end).unwrap_or(&[])
    }

    /// The records of a section.
    #[inline]
    pub(crate) fn records<T: Record>(&self) -> &'a [T] {
        // Nothing is left over in a section.
        <[T]>::ref_from_prefix(self.section(T::SECTION)).map_or(&[], |(records, _)| records)
    }

    /// A record.
    #[inline]
    pub(crate) fn record<T: Record>(&self, index: usize) -> Option<&'a T> {
        let from = self.bytes_from(T::SECTION, index);
        T::ref_from_prefix(from).ok().map(|(record, _)| record)
    }

    /// The bytes from a record on; none where there is no such record.
    // Inlined, it would be a large part of the verifier.
    #[inline(never)]
    fn bytes_from(&self, section: Section, index: usize) -> &'a [u8] {
        let (start, records) = self.sections[section as usize];
        if index >= records as usize {
            return &[];
        }
        let at = start as usize + index * record_bytes(section);
        self.bytes.get(at..).unwrap_or(&[])
    }

    /// Number of records of a section.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn count(&self, section: Section) -> usize {
        let (_, records) = self.sections[section as usize];
        records as usize
    }

    /// The record of the mission. It is there in each blob that passed.
    fn mission(&self) -> Option<&'a layout::Mission> {
        self.record(0)
    }

    /// Events that the queue holds at most, 1 to 255.
    #[must_use]
    pub fn queue_capacity(&self) -> usize {
        self.mission().map_or(0, |mission| mission.queue.get())
    }

    /// Index of the slot that runs the interpreter.
    #[must_use]
    pub fn interpreter_slot(&self) -> usize {
        self.mission()
            .map_or(0, |mission| mission.interpreter_slot.get())
    }

    /// Number of events; their numbers start at 1, since 0 is the pulse.
    #[must_use]
    pub fn event_count(&self) -> usize {
        self.mission().map_or(0, |mission| mission.events.get())
    }

    /// Bits of all flags.
    #[must_use]
    pub fn flag_count(&self) -> usize {
        self.mission().map_or(0, |mission| mission.flags.get())
    }

    /// Number of `exclusive` groups.
    #[must_use]
    pub fn exclusive_group_count(&self) -> usize {
        self.mission()
            .map_or(0, |mission| mission.exclusive_groups.get())
    }

    /// The slots in the order of their declaration.
    pub fn slots(&self) -> impl ExactSizeIterator<Item = Slot> + use<'a> {
        self.records::<layout::Slot>().iter().map(Slot::from)
    }

    /// One slot.
    #[must_use]
    pub fn slot(&self, index: usize) -> Option<Slot> {
        self.record::<layout::Slot>(index).map(Slot::from)
    }

    /// The containers in the order in which the instance tree first uses them; the machine is
    /// container 0.
    pub fn containers(&self) -> impl ExactSizeIterator<Item = Container> + use<'a> {
        self.records::<layout::Container>()
            .iter()
            .map(Container::from)
    }

    /// One container.
    #[must_use]
    pub fn container(&self, index: usize) -> Option<Container> {
        self.record::<layout::Container>(index).map(Container::from)
    }

    /// The region templates, container by container.
    pub fn regions(&self) -> impl ExactSizeIterator<Item = Region> + use<'a> {
        self.records::<layout::Region>().iter().map(Region::from)
    }

    /// One region template.
    #[must_use]
    pub fn region(&self, index: usize) -> Option<Region> {
        self.record::<layout::Region>(index).map(Region::from)
    }

    /// Number of states of all region templates, pseudo-states included.
    #[must_use]
    pub fn state_count(&self) -> usize {
        self.count(Section::States)
    }

    /// One state.
    #[must_use]
    pub fn state(&self, index: usize) -> Option<State> {
        State::of(self.record(index)?, |timer| self.timeout_us(timer))
    }

    /// A timeout, by its index among the timers.
    #[must_use]
    pub fn timeout_us(&self, timer: usize) -> Option<u32> {
        let record: &layout::Timer = self.record(timer)?;
        Some(record.timeout_us.get())
    }

    /// The region template that a state belongs to. Takes logarithmic time.
    #[must_use]
    pub fn region_of_state(&self, state: usize) -> usize {
        self.records::<layout::Region>()
            .partition_point(|region| region.first_state.get() <= state)
            .saturating_sub(1)
    }

    /// Number of transitions of all region templates.
    #[must_use]
    pub fn transition_count(&self) -> usize {
        self.count(Section::Transitions)
    }

    /// One transition.
    #[must_use]
    pub fn transition(&self, index: usize) -> Option<Transition> {
        self.record::<layout::Transition>(index)
            .map(Transition::from)
    }

    /// The state that a transition leaves. Takes logarithmic time.
    #[must_use]
    pub fn source_of_transition(&self, transition: usize) -> usize {
        self.records::<layout::State>()
            .partition_point(|state| state.first_transition.get() <= transition)
            .saturating_sub(1)
    }

    /// The transitions out of a state: first those on the pulse in source order, then the others by
    /// the numbers of their events, those on one event in source order.
    #[must_use]
    pub fn transitions_of(&self, state: usize) -> core::ops::Range<usize> {
        match self.state(state) {
            Some(found) => found.first_transition..self.transition_end(state),
            None => 0..0,
        }
    }

    /// One past the last transition out of a state, which is the first out of the next.
    pub(crate) fn transition_end(&self, state: usize) -> usize {
        match self.record::<layout::State>(state + 1) {
            Some(next) => next.first_transition.get(),
            None => self.transition_count(),
        }
    }

    /// Number of instructions of all guards and actions.
    #[must_use]
    pub fn code_count(&self) -> usize {
        self.count(Section::Code)
    }

    /// One instruction.
    #[must_use]
    pub fn code(&self, index: usize) -> Option<Code> {
        self.record(index).and_then(Code::of)
    }

    /// The guard of a transition; none where it is written in a way that means nothing.
    #[must_use]
    pub fn guard_of(&self, transition: usize) -> Option<Guard> {
        let guard = self.transition(transition)?.guard;
        let flag = |bit, value| {
            (bit < format::WINDOW_FLAGS).then_some(Guard::Flag {
                bit: usize::from(bit),
                value,
            })
        };
        if guard == format::GUARD_TRUE {
            Some(Guard::True)
        } else if guard < format::GUARD_IF_CLEAR {
            flag(guard, true)
        } else if guard < format::GUARD_PROGRAM {
            flag(guard - format::GUARD_IF_CLEAR, false)
        } else if guard < format::GUARD_MASK {
            let first = usize::from(guard - format::GUARD_PROGRAM);
            Some(Guard::Program { first })
        } else {
            let record = usize::from(guard - format::GUARD_MASK);
            let record: &layout::Mask = self.record(record)?;
            Some(Guard::Mask {
                mask: record.mask.get(),
                value: record.value.get(),
            })
        }
    }

    /// The tests of a transition's guard, where it is a program, without the end.
    pub fn program_of(&self, transition: usize) -> impl Iterator<Item = Code> + use<'a> {
        let first = match self.guard_of(transition) {
            Some(Guard::Program { first }) => Some(first),
            _ => None,
        };
        let tables = *self;
        let codes = first.into_iter().flat_map(|first| first..);
        codes
            .map_while(move |at| tables.code(at))
            .take_while(|code| matches!(code, Code::Test { .. } | Code::TestBusyInside { .. }))
    }

    /// The actions of a transition: [`Code::Send`] and [`Code::Write`].
    pub fn actions_of(&self, transition: usize) -> impl Iterator<Item = Code> + use<'a> {
        let action = self
            .transition(transition)
            .map_or(format::ACTION_NONE, |transition| transition.action);
        let send = (action >= format::ACTION_SEND).then(|| Code::Send {
            channel: usize::from(action - format::ACTION_SEND),
            last: true,
        });
        let mut next = (action != format::ACTION_NONE && send.is_none())
            .then(|| usize::from(action - format::ACTION_ROW));
        let tables = *self;
        let row = core::iter::from_fn(move || {
            let at = next?;
            let code = tables.code(at)?;
            let (Code::Send { last, .. } | Code::Write { last, .. }) = code else {
                return None;
            };
            next = (!last).then_some(at + 1);
            Some(code)
        });
        send.into_iter().chain(row)
    }

    /// Number of container instances.
    #[must_use]
    pub fn instance_count(&self) -> usize {
        self.count(Section::Instances)
    }

    /// One container instance.
    #[must_use]
    pub fn instance(&self, index: usize) -> Option<Instance> {
        self.record::<layout::Instance>(index).map(Instance::from)
    }

    /// The superstate that a container instance is inside of: region instance and state; none for
    /// the machine. Takes time proportional to the number of states of its region.
    #[must_use]
    pub fn superstate_of(&self, instance: usize) -> Option<(usize, usize)> {
        let around = (instance != 0).then_some(self.instance(instance)?.around)?;
        let region = self.region_instance(around)?;
        let state = (region.initial..self.state_count()).find(|state| {
            self.state(*state).is_none_or(|state| match state.kind {
                StateKind::Super { instance_offset } => {
                    region.instance + instance_offset == instance
                }
                StateKind::Final => true,
                _ => false,
            })
        })?;
        let is_super = matches!(self.state(state)?.kind, StateKind::Super { .. });
        is_super.then_some((around, state))
    }

    /// The task instances inside a container instance, at any depth.
    #[must_use]
    pub fn tasks_inside(&self, instance: usize) -> core::ops::Range<usize> {
        let Some(instance) = self.instance(instance) else {
            return 0..0;
        };
        let span = self
            .container(instance.container)
            .map_or(0, |container| container.task_span);
        instance.first_task..instance.first_task + span
    }

    /// The first region instance inside a state, if it is a superstate, of a region instance.
    #[must_use]
    pub fn first_region_inside(&self, region_instance: usize, state: usize) -> Option<usize> {
        let StateKind::Super { instance_offset } = self.state(state)?.kind else {
            return None;
        };
        let around = self.region_instance(region_instance)?.instance;
        Some(self.instance(around + instance_offset)?.first_region)
    }

    /// Number of region instances.
    #[must_use]
    pub fn region_instance_count(&self) -> usize {
        self.count(Section::RegionInstances)
    }

    /// One region instance.
    #[must_use]
    pub fn region_instance(&self, index: usize) -> Option<RegionInstance> {
        self.record::<layout::RegionInstance>(index)
            .map(RegionInstance::from)
    }

    /// Number of channels.
    #[must_use]
    pub fn channel_count(&self) -> usize {
        self.count(Section::Channels)
    }

    /// One channel.
    #[must_use]
    pub fn channel(&self, index: usize) -> Option<Channel> {
        self.record::<layout::Channel>(index).map(Channel::from)
    }

    /// Whether a region instance listens to what is sent on `channel`: whether the event is visible
    /// in its container instance, and its template has a transition on it. Takes constant time.
    #[must_use]
    pub fn is_listening(&self, channel: &Channel, region_instance: usize) -> bool {
        const WORD_BITS: usize = 32;
        let offset = (region_instance / WORD_BITS).wrapping_sub(channel.first_region_word);
        if offset >= channel.region_words {
            return false;
        }
        self.record::<layout::Listener>(channel.first_row_word + offset)
            .is_some_and(|word| word.regions.get() << (region_instance % WORD_BITS) >> 31 != 0)
    }

    /// The tasks that the mission uses.
    pub fn tasks(&self) -> impl ExactSizeIterator<Item = Task<'a>> + use<'a> {
        let texts = self.section(Section::Signatures);
        let records = self.records::<layout::Task>().iter();
        records.map(move |record| Task::of(record, texts))
    }

    /// One task.
    #[must_use]
    pub fn task(&self, index: usize) -> Option<Task<'a>> {
        let texts = self.section(Section::Signatures);
        Some(Task::of(self.record(index)?, texts))
    }

    /// Number of task states of all container templates.
    #[must_use]
    pub fn task_state_count(&self) -> usize {
        self.count(Section::TaskStates)
    }

    /// One task state.
    #[must_use]
    pub fn task_state(&self, index: usize) -> Option<TaskState> {
        self.record::<layout::TaskState>(index).map(TaskState::from)
    }

    /// The record of a task state, by the state. Takes logarithmic time.
    #[must_use]
    pub fn task_state_at(&self, state: usize) -> Option<usize> {
        let records = self.records::<layout::TaskState>();
        records
            .binary_search_by_key(&state, |record| record.state.get())
            .ok()
    }

    /// The 32 bits of a parameter value: of an `i32`, `u32` or `f32` its own, of a `bool` 0 or 1.
    #[must_use]
    pub fn param(&self, index: usize) -> Option<u32> {
        let record: &layout::Param = self.record(index)?;
        Some(record.value.get())
    }

    /// Number of task instances.
    #[must_use]
    pub fn task_instance_count(&self) -> usize {
        self.count(Section::TaskInstances)
    }

    /// One task instance.
    #[must_use]
    pub fn task_instance(&self, index: usize) -> Option<TaskInstance> {
        self.record::<layout::TaskInstance>(index)
            .map(TaskInstance::from)
    }

    /// The template that a task instance is made of: its task, slot and parameters.
    #[must_use]
    pub fn task_state_of(&self, task_instance: usize) -> Option<TaskState> {
        self.task_state(self.task_instance(task_instance)?.task_state)
    }

    /// First bit of a task instance's flag block (exit, timeout, busy, control flags in the order
    /// of the signature), and its length.
    #[must_use]
    pub fn flags_of_task(&self, task_instance: usize) -> Option<(usize, usize)> {
        let instance: &layout::TaskInstance = self.record(task_instance)?;
        let state: &layout::State = self.record(instance.state.get())?;
        let flags = state.shape.get() & format::STATE_FLAGS_MASK;
        Some((instance.first_flag.get(), usize::from(flags)))
    }

    /// Where what belongs to a task instance stands.
    #[must_use]
    pub fn task_places(&self, task_instance: usize) -> Option<TaskPlaces> {
        let instance: &layout::TaskInstance = self.record(task_instance)?;
        let state: &layout::State = self.record(instance.state.get())?;
        let task_state: &layout::TaskState = self.record(instance.task_state.get())?;
        let flags = usize::from(state.shape.get() & format::STATE_FLAGS_MASK);
        let control_flags = flags.saturating_sub(format::TASK_CONTROL_FLAGS).min(16);
        Some(TaskPlaces {
            first_flag: instance.first_flag.get() as u16,
            control_flags: ((1u32 << control_flags) - 1) as u16,
            first_param: task_state.first_param.get() as u16,
            first_connection: instance.first_connection.get() as u16,
            region: instance.region.get() as u16,
        })
    }

    /// The nets of a task's data ports, by their place in the signature; see
    /// [`TaskPlaces::first_connection`].
    pub fn nets_from(&self, first_connection: u16) -> impl Fn(usize) -> Option<usize> + use<'a> {
        let records = self.records::<layout::Connection>();
        let records = records.get(usize::from(first_connection)..).unwrap_or(&[]);
        move |port| records.get(port)?.net.index()
    }

    /// First bit of the flag block of a state in a region instance, and its length.
    #[must_use]
    pub fn flags_of_state(&self, region_instance: usize, state: usize) -> Option<(usize, usize)> {
        let region = self.region_instance(region_instance)?;
        let state = self.state(state)?;
        Some((region.first_flag + state.first_flag, state.flags))
    }

    /// The net on a connection: `None` outside the table, `Some(None)` for a port that is left
    /// open.
    #[must_use]
    pub fn connection(&self, index: usize) -> Option<Option<usize>> {
        let record: &layout::Connection = self.record(index)?;
        Some(record.net.index())
    }

    /// Number of nets.
    #[must_use]
    pub fn net_count(&self) -> usize {
        self.count(Section::Nets)
    }

    /// One net.
    #[must_use]
    pub fn net(&self, index: usize) -> Option<Net> {
        let record: &layout::Net = self.record(index)?;
        Some(Net {
            type_hash: record.type_hash.get(),
        })
    }

    /// The links.
    #[must_use]
    pub fn links(&self) -> &'a [layout::Link] {
        self.records()
    }

    /// The frames of all links.
    #[must_use]
    pub fn frames(&self) -> &'a [layout::Frame] {
        self.records()
    }

    /// The name table, unless it was left out.
    #[must_use]
    pub fn names(&self) -> Option<Names<'a>> {
        let bytes = self.section(Section::Names);
        (!bytes.is_empty()).then_some(Names { rest: bytes })
    }
}

/// The names of a mission in the order of the [format](crate::format#names).
#[derive(Clone, Debug)]
pub struct Names<'a> {
    rest: &'a [u8],
}

impl Names<'_> {
    /// Whether nothing is left, not even a name that is cut off.
    #[must_use]
    pub fn is_at_end(&self) -> bool {
        self.rest.is_empty()
    }
}

impl<'a> Iterator for Names<'a> {
    /// An ASCII identifier.
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let mut at = 0;
        let length = format::read_varint(self.rest, &mut at)?;
        let (name, rest) = self.rest.get(at..)?.split_at_checked(length as usize)?;
        self.rest = rest;
        Some(name)
    }
}
