//! What the sides of a runtime hand to each other.
//!
//! There is one place for a command or its reply between link and real-time side, and one for
//! a background run between real-time side and background. Whoever holds it may look into it;
//! giving it away is passing a reference through a queue. So nothing large is copied, nothing is
//! locked, and what is under way is always one thing.

use heapless::spsc::Queue;

use crate::list_command::{ListCommand, Report};
use crate::ports::BackgroundRun;
use crate::realtime::params::SavedParams;
use crate::realtime::staging::{MappingTable, SpareMemory, StagedMission};
use esm_core::BlobBuffer;
#[cfg(feature = "links")]
use esm_link::message::FrameCounters;
use esm_link::message::{LinkError, MAX_PART, SlotCounters, Swap, TaskCounters};
use esm_link::trial::FallBack;

/// One command or background run at a time; a queue holds one less than its length.
const PLACES: usize = 2;
/// There are two buffers for blobs, and a queue holds one less than its length.
const BUFFER_PLACES: usize = 3;

/// The queues between the sides.
pub struct Mailbox<'m> {
    pub(crate) to_real_time: Queue<Posted<'m>, PLACES>,
    pub(crate) to_link: Queue<&'m mut Content<'m>, PLACES>,
    pub(crate) to_background: Queue<&'m mut Option<BackgroundRun<'m>>, PLACES>,
    pub(crate) from_background: Queue<&'m mut Option<BackgroundRun<'m>>, PLACES>,
    pub(crate) freed: Queue<Freed<'m>, BUFFER_PLACES>,
}

/// Of what may be done at any time: no clock gets there, and its
/// [ticks](crate::Board::TICKS_PER_US), 65,535 a microsecond at most, are still a number.
pub(crate) const NO_DEADLINE: u64 = u64::MAX >> u16::BITS;

/// The command on its way to the real-time side.
pub(crate) struct Posted<'m> {
    pub(crate) content: &'m mut Content<'m>,
    /// When it is too late for what it asks for, on the board's clock in microseconds.
    pub(crate) by_us: u64,
    /// How often a stop had been wished for; none if one is heard already that came behind what is
    /// asked for.
    pub(crate) stops: u32,
}

/// A buffer that the real-time side needs no more. It goes back by itself, for a robot that falls
/// back answers nobody.
pub(crate) struct Freed<'m> {
    pub(crate) blob: BlobBuffer<'m>,
    pub(crate) spare: SpareMemory<'m>,
    /// The mission in it was given up.
    pub(crate) fell_back: Option<FallBack>,
}

impl Default for Mailbox<'_> {
    fn default() -> Self {
        Self::new()
    }
}

impl Mailbox<'_> {
    /// Nothing is under way.
    pub const fn new() -> Self {
        Mailbox {
            to_real_time: Queue::new(),
            to_link: Queue::new(),
            to_background: Queue::new(),
            from_background: Queue::new(),
            freed: Queue::new(),
        }
    }
}

/// What is in the one place for a command and its reply. A reply takes the place of its command: so
/// one enum of the two is as large as the larger, and a swap, which brings a mission, is given back
/// where it was put.
#[allow(
    clippy::large_enum_variant,
    reason = "there is one place, and no heap to box a part of it on"
)]
pub(crate) enum Content<'m> {
    /// Nothing.
    Empty,
    /// From the link to the real-time side.
    Command(Command<'m>),
    /// Back.
    Reply(Reply<'m>),
    /// Link, to itself: it makes an answer here that it need not ask for.
    Note(Bytes),
}

impl<'m> Content<'m> {
    /// Takes the mission of a swap out.
    // Not inlined: the rest of the command is then off the stack before the mission starts.
    #[inline(never)]
    pub(crate) fn take_mission(&mut self) -> Option<StagedMission<'m>> {
        match core::mem::replace(self, Self::Empty) {
            Self::Command(Command::Swap { mission, .. }) => Some(mission),
            other => {
                *self = other;
                None
            }
        }
    }
}

/// What the link asks of the real-time side.
#[allow(
    clippy::large_enum_variant,
    reason = "there is one command, and no heap to box a part of it on"
)]
pub(crate) enum Command<'m> {
    /// Switch to this mission.
    Swap {
        /// The mission.
        mission: StagedMission<'m>,
        /// How.
        swap: Swap,
        /// What was saved of parameters, for this mission or another.
        saved: SavedParams,
    },
    /// The mission on trial stays.
    Confirm {
        /// Its hash.
        mission: u32,
        /// The mission store has one on trial: perhaps it did not take the confirmation of one that
        /// is on trial no more.
        again: bool,
    },
    /// Back to the mission before.
    FallBack {
        /// Hash of the mission on trial.
        mission: u32,
    },
    /// Start anew.
    Start,
    /// End the emergency stop.
    Release,
    /// Bytes of the blob from here on.
    ReadBlob {
        /// The first byte wanted.
        offset: u32,
    },
    /// Current states from this region instance on.
    ReadStates {
        /// The first region instance wanted.
        first: u16,
    },
    /// What was counted of this slot.
    ReadSlot {
        /// Its index.
        slot: u8,
    },
    /// What was counted of this task instance.
    ReadTask {
        /// Its index.
        task_instance: u16,
    },
    /// What was counted of this frame of a link.
    #[cfg(feature = "links")]
    ReadFrame {
        /// Its index.
        frame: u16,
    },
    /// The value of this parameter.
    ReadParam {
        /// Hash of the mission that is meant.
        mission: u32,
        /// Index of the parameter in its blob.
        param: u16,
    },
    /// Another value for this parameter.
    SetParam {
        /// Hash of the mission that is meant.
        mission: u32,
        /// Index of the parameter in its blob.
        param: u16,
        /// Bits of the value.
        value: u32,
    },
    /// What differs from the mission's values?
    ReadChanged {
        /// Hash of the mission that is meant.
        mission: u32,
    },
    /// This was saved.
    Saved(SavedParams),
    /// Values, or what they are made of.
    AskValues {
        /// Number of the request.
        number: u8,
        /// What it asks for.
        ask: Bytes,
    },
    /// What the list of behaviours is to do.
    Behaviours(ListCommand),
}

/// What the real-time side replies.
pub(crate) enum Reply<'m> {
    /// The mission runs.
    Swapped {
        /// Hash of the new mission.
        mission: u32,
        /// Whether it runs on trial.
        on_trial: bool,
        /// Active regions that go on as they were.
        carried: u16,
        /// Given back.
        pairs: MappingTable<'m>,
    },
    /// The mission stays.
    Confirmed {
        /// Its hash.
        mission: u32,
    },
    /// It starts.
    Started,
    /// The emergency stop has ended.
    Released,
    /// It is done.
    Done,
    /// A part of the blob.
    Blob {
        /// Length of the blob.
        total: u32,
        /// Some of its bytes.
        bytes: Bytes,
    },
    /// Current states, two bytes each.
    States {
        /// Number of the next macro step since the mission started; those that were missed count.
        step: u64,
        /// Region instances of the mission.
        total: u16,
        /// Some of their states.
        bytes: Bytes,
    },
    /// What was counted of a slot.
    Slot(SlotCounters),
    /// What was counted of a task instance.
    Task(TaskCounters),
    /// What was counted of a frame of a link.
    #[cfg(feature = "links")]
    Frame(FrameCounters),
    /// A parameter.
    Param {
        /// Bits of its value.
        value: u32,
        /// Bits of the value that the mission gives it.
        of_mission: u32,
        /// Bits of the value that was saved for it.
        saved: Option<u32>,
    },
    /// The parameter has the value.
    ParamSet {
        /// Bits of the value before.
        before: u32,
    },
    /// What differs from the mission's values.
    Changed(SavedParams),
    /// With what was saved the mission starts from now on.
    ParamsSaved {
        /// How many values.
        count: u8,
    },
    /// What values are made of.
    Fields {
        /// All of it.
        text: &'static str,
        /// The first byte wanted.
        offset: u16,
    },
    /// Samples from now on are of the request of this number.
    ValuesWanted {
        /// The number.
        number: u8,
        /// Hash of the mission that they are of.
        mission: u32,
    },
    /// A behaviour was inserted.
    Behaviour {
        /// Its key.
        key: u16,
    },
    /// What stands on the list of behaviours.
    BehaviourList(Report),
    /// That cannot be done. What it comes to too late goes back as it came, as a command.
    Failed(LinkError),
}

impl<'m> Content<'m> {
    /// The command, if it is one.
    pub(crate) fn command(&self) -> Option<&Command<'m>> {
        match self {
            Content::Command(command) => Some(command),
            _ => None,
        }
    }

    /// Replies that it cannot be done.
    pub(crate) fn refuse(&mut self, error: LinkError) {
        *self = Content::Reply(Reply::Failed(error));
    }
}

/// As many bytes as one answer carries.
pub struct Bytes {
    bytes: [u8; MAX_PART],
    len: usize,
}

impl Bytes {
    /// No bytes.
    pub(crate) const EMPTY: Bytes = Bytes {
        bytes: [0; MAX_PART],
        len: 0,
    };

    /// The first bytes of these, as many as fit.
    pub(crate) fn first_of(source: &[u8]) -> Self {
        let mut bytes = Self::EMPTY;
        bytes.len = source.len().min(MAX_PART);
        for (place, byte) in bytes.bytes.iter_mut().zip(source) {
            *place = *byte;
        }
        bytes
    }

    /// Appends two bytes, little endian. False if they do not fit.
    pub(crate) fn push_u16(&mut self, value: u16) -> bool {
        self.push(value.to_le_bytes())
    }

    /// Appends all of these. False if they do not fit.
    pub(crate) fn push<const N: usize>(&mut self, bytes: [u8; N]) -> bool {
        let place = self
            .bytes
            .get_mut(self.len..)
            .and_then(|free| free.first_chunk_mut());
        let Some(place) = place else { return false };
        *place = bytes;
        self.len += N;
        true
    }

    /// The bytes.
    pub(crate) fn as_slice(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }
}
