//! Records of the black box, as a robot sends them with
//! [`Response::BlackBox`](crate::message::Response::BlackBox).

use crate::message::{Mode, ResetReason};

/// Bytes of a record as the link carries it.
pub const RECORD_BYTES: usize = 16;

/// One thing that happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// The firmware started. Times count from here.
    Started(ResetReason),
    /// The firmware ended by itself, for this reason. `detail` is the line of a panic, the address
    /// of a fault.
    Ended {
        /// Why.
        reason: ResetReason,
        /// Where.
        detail: u32,
    },
    /// A mission started, by an upload or a `Start`.
    Mission {
        /// Its hash.
        hash: u32,
    },
    /// A transition was taken; both are indices in the mission's blob.
    Transition {
        /// The region instance.
        region_instance: u16,
        /// The transition, in its region.
        transition: u16,
    },
    /// The robot stopped, or went to its safe state.
    Mode(Mode),
    /// A task took longer than its slot.
    Overrun {
        /// Index of the task instance in the mission's blob.
        task_instance: u16,
        /// How long it took, in µs; 65,535 stands for more, too.
        took_us: u16,
    },
    /// Activations of a slot did not start within their period.
    DeadlineMiss {
        /// Index of the slot in the mission's blob; 255 stands for more, too.
        slot: u8,
        /// How many.
        count: u32,
    },
}

/// An event, when it was, and its place among all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record {
    /// Counts all records; wraps.
    pub sequence: u32,
    /// Robot time in µs, 48 bits: since the first macro step of the first mission after the start.
    pub at_us: u64,
    /// What happened.
    pub event: Event,
}

mod kind {
    pub const STARTED: u8 = 1;
    pub const ENDED: u8 = 2;
    pub const MISSION: u8 = 3;
    pub const TRANSITION: u8 = 4;
    pub const MODE: u8 = 5;
    pub const OVERRUN: u8 = 6;
    pub const DEADLINE_MISS: u8 = 7;
}

impl Event {
    /// Kind, small and large value.
    #[inline(always)]
    pub fn pack(self) -> (u8, u8, u32) {
        let pair = |high: u16, low: u16| u32::from(high) << 16 | u32::from(low);
        match self {
            Event::Started(reason) => (kind::STARTED, reason as u8, 0),
            Event::Ended { reason, detail } => (kind::ENDED, reason as u8, detail),
            Event::Mission { hash } => (kind::MISSION, 0, hash),
            Event::Transition {
                region_instance,
                transition,
            } => (kind::TRANSITION, 0, pair(region_instance, transition)),
            Event::Mode(mode) => (kind::MODE, mode.number(), 0),
            Event::Overrun {
                task_instance,
                took_us,
            } => (kind::OVERRUN, 0, pair(task_instance, took_us)),
            Event::DeadlineMiss { slot, count } => (kind::DEADLINE_MISS, slot, count),
        }
    }

    /// The event of this kind with these values; `None` if this program does not know it.
    pub fn unpack(kind: u8, small: u8, large: u32) -> Option<Event> {
        let (high, low) = ((large >> 16) as u16, large as u16);
        Some(match kind {
            kind::STARTED => Event::Started(ResetReason::from_number(small)?),
            kind::ENDED => Event::Ended {
                reason: ResetReason::from_number(small)?,
                detail: large,
            },
            kind::MISSION => Event::Mission { hash: large },
            kind::TRANSITION => Event::Transition {
                region_instance: high,
                transition: low,
            },
            kind::MODE => Event::Mode(Mode::from_number(small)?),
            kind::OVERRUN => Event::Overrun {
                task_instance: high,
                took_us: low,
            },
            kind::DEADLINE_MISS => Event::DeadlineMiss {
                slot: small,
                count: large,
            },
            _ => return None,
        })
    }
}

impl Record {
    /// The record in these bytes; `None` if it is of a kind that this program does not know.
    pub fn from_bytes(bytes: &[u8; RECORD_BYTES]) -> Option<Record> {
        let [
            s0,
            s1,
            s2,
            s3,
            t0,
            t1,
            t2,
            t3,
            t4,
            t5,
            kind,
            small,
            large @ ..,
        ] = *bytes;
        Some(Record {
            sequence: u32::from_le_bytes([s0, s1, s2, s3]),
            at_us: u64::from_le_bytes([t0, t1, t2, t3, t4, t5, 0, 0]),
            event: Event::unpack(kind, small, u32::from_le_bytes(large))?,
        })
    }

    /// The record as the link carries it: sequence number (4 bytes), time (6), kind, small value,
    /// large value (4); little endian.
    pub fn to_bytes(&self) -> [u8; RECORD_BYTES] {
        let (kind, small, large) = self.event.pack();
        let [s0, s1, s2, s3] = self.sequence.to_le_bytes();
        let [t0, t1, t2, t3, t4, t5, ..] = self.at_us.to_le_bytes();
        let [l0, l1, l2, l3] = large.to_le_bytes();
        [
            s0, s1, s2, s3, t0, t1, t2, t3, t4, t5, kind, small, l0, l1, l2, l3,
        ]
    }
}
