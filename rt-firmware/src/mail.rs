//! What the sides of a runtime hand to each other.
//!
//! There is one letter between link and real-time side, and one job between real-time side and background. Whoever holds it may look into it;
//! giving it away is passing a reference through a queue. So nothing large is copied, nothing is locked, and what is under way is
//! always one thing.

use esm_core::Verified;
use heapless::spsc::Queue;

use crate::link::message::{LinkError, MAX_PART, SlotCounters, TaskCounters};
use crate::ports::Job;
use esm_core::BlobBuffer;

/// One letter or job at a time; a queue holds one less than its length.
const PLACES: usize = 2;

/// The ways between the sides.
pub struct Mail<'m> {
    pub(crate) to_real_time: Queue<&'m mut Letter<'m>, PLACES>,
    pub(crate) to_link: Queue<&'m mut Letter<'m>, PLACES>,
    pub(crate) to_background: Queue<&'m mut Option<Job<'m>>, PLACES>,
    pub(crate) from_background: Queue<&'m mut Option<Job<'m>>, PLACES>,
}

impl Default for Mail<'_> {
    fn default() -> Self {
        Self::new()
    }
}

impl Mail<'_> {
    /// Empty ways.
    pub const fn new() -> Self {
        Mail {
            to_real_time: Queue::new(),
            to_link: Queue::new(),
            to_background: Queue::new(),
            from_background: Queue::new(),
        }
    }
}

/// What link and real-time side say to each other.
pub enum Letter<'m> {
    /// Nothing.
    Empty,
    /// Link: switch to this mission.
    Swap(Verified<BlobBuffer<'m>>),
    /// Real time: it runs; here is the buffer of the one before.
    Swapped {
        /// Hash of the new mission.
        mission: u32,
        /// The buffer that is free now, if there was a mission.
        old: Option<BlobBuffer<'m>>,
    },
    /// Real time: it cannot run.
    SwapFailed {
        /// Why.
        error: LinkError,
        /// Its buffer.
        blob: BlobBuffer<'m>,
        /// The buffer of the mission before, which is gone too.
        old: Option<BlobBuffer<'m>>,
    },
    /// Link: motors off.
    Stop,
    /// Link: start anew.
    Start,
    /// Real time: it is done.
    Done,
    /// Link: bytes of the blob from here on.
    ReadBlob {
        /// The first byte wanted.
        offset: u32,
    },
    /// Real time: these.
    Blob {
        /// Length of the blob.
        total: u32,
        /// Some of its bytes.
        bytes: Bytes,
    },
    /// Link: current states from this region instance on.
    ReadStates {
        /// The first region instance wanted.
        first: u16,
    },
    /// Real time: these, two bytes each.
    States {
        /// Macro steps that were completed.
        step: u64,
        /// Region instances of the mission.
        total: u16,
        /// Some of their states.
        bytes: Bytes,
    },
    /// Link: what was counted of this slot.
    ReadSlot {
        /// Its index.
        slot: u8,
    },
    /// Real time: this.
    Slot(SlotCounters),
    /// Link: what was counted of this task instance.
    ReadTask {
        /// Its index.
        task_instance: u16,
    },
    /// Real time: this.
    Task(TaskCounters),
    /// Real time: that cannot be done.
    Failed(LinkError),
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
        let place = self
            .bytes
            .get_mut(self.len..)
            .and_then(|free| free.first_chunk_mut());
        let Some(place) = place else { return false };
        *place = value.to_le_bytes();
        self.len += value.to_le_bytes().len();
        true
    }

    /// The bytes.
    pub(crate) fn as_slice(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }
}
