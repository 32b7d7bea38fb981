//! Records of the black box, as a robot sends them with
//! [`Response::BlackBox`](crate::message::Response::BlackBox).

use crate::behaviours::Situation;
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
    /// A behaviour came onto the list, changed its state there, or left it.
    Behaviour {
        /// Its key on the list.
        key: u16,
        /// The lower half of the hash of its task's signature; 0 of IDLE and REMOTE_CONTROL.
        task: u16,
        /// Its state before, as the book numbers them; none where it was not on the list.
        from: Option<u8>,
        /// Its state since; none where it is not on the list any more.
        to: Option<u8>,
    },
    /// A situation came up beside a behaviour.
    Situation {
        /// The behaviour's key on the list.
        key: u16,
        /// As above.
        task: u16,
        /// The number of a [`Situation`], [`SAFETY_CHECK`] or
        /// [`OWN_SITUATION`].
        situation: u8,
        /// What was done: [`Reaction::kind`](crate::behaviours::Reaction::kind).
        reaction: u8,
    },
    /// Where the robot is, first half.
    PoseX {
        /// x in millimetres: 24 bits, which is 8 km.
        x_mm: i32,
        /// Its heading in thousandths of a radian.
        heading_mrad: i16,
    },
    /// Second half.
    PoseY {
        /// y in millimetres, as above.
        y_mm: i32,
        /// In which frame.
        frame: PoseFrame,
    },
    /// The robot was told where it is. Where it is since comes next.
    Corrected {
        /// It was told how far it is from where it believed itself to be, not where.
        is_difference: bool,
        /// That was no number, or beyond its bounds: nothing has changed.
        is_refused: bool,
    },
}

/// The situation SAFETY_CHECK: in four bits, the number behind all others.
pub const SAFETY_CHECK: u8 = 15;
/// A situation of the firmware's own, which no script names.
pub const OWN_SITUATION: u8 = 14;
const _: () = assert!(Situation::ALL.len() <= OWN_SITUATION as usize);

/// The frame that a pose is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PoseFrame {
    /// That in which odometry counts.
    Counted = 0,
    /// That in which the robot is told where it is.
    Global = 1,
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
    pub const BEHAVIOUR: u8 = 8;
    pub const SITUATION: u8 = 9;
    pub const POSE_X: u8 = 10;
    pub const POSE_Y: u8 = 11;
    pub const CORRECTED: u8 = 12;
}

/// No state, in the four bits of one.
const NO_STATE: u8 = 15;

/// The low 16 bits of 24, and the rest of them.
const fn split(value: i32) -> (u16, u8) {
    (value as u16, (value >> 16) as u8)
}

/// What was [`split`].
const fn joined(low: u16, high: u8) -> i32 {
    (high.cast_signed() as i32) << 16 | low as i32
}

impl Event {
    /// Whether it is about behaviours and where the robot is, of which there may be many.
    #[inline(always)]
    pub const fn is_about_behaviours(self) -> bool {
        matches!(
            self,
            Event::Behaviour { .. }
                | Event::Situation { .. }
                | Event::PoseX { .. }
                | Event::PoseY { .. }
                | Event::Corrected { .. }
        )
    }

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
            Event::Behaviour {
                key,
                task,
                from,
                to,
            } => {
                let state = |state: Option<u8>| state.unwrap_or(NO_STATE) & 15;
                (
                    kind::BEHAVIOUR,
                    state(from) << 4 | state(to),
                    pair(key, task),
                )
            }
            Event::Situation {
                key,
                task,
                situation,
                reaction,
            } => (
                kind::SITUATION,
                situation << 4 | reaction & 15,
                pair(key, task),
            ),
            Event::PoseX { x_mm, heading_mrad } => {
                let (low, high) = split(x_mm);
                (kind::POSE_X, high, pair(low, heading_mrad.cast_unsigned()))
            }
            Event::PoseY { y_mm, frame } => {
                let (low, high) = split(y_mm);
                (kind::POSE_Y, high, pair(low, frame as u16))
            }
            Event::Corrected {
                is_difference,
                is_refused,
            } => (
                kind::CORRECTED,
                u8::from(is_difference) | u8::from(is_refused) << 1,
                0,
            ),
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
            kind::BEHAVIOUR => {
                let state = |bits: u8| (bits != NO_STATE).then_some(bits);
                Event::Behaviour {
                    key: high,
                    task: low,
                    from: state(small >> 4),
                    to: state(small & 15),
                }
            }
            kind::SITUATION => Event::Situation {
                key: high,
                task: low,
                situation: small >> 4,
                reaction: small & 15,
            },
            kind::POSE_X => Event::PoseX {
                x_mm: joined(high, small),
                heading_mrad: low.cast_signed(),
            },
            kind::POSE_Y => Event::PoseY {
                y_mm: joined(high, small),
                frame: match low {
                    0 => PoseFrame::Counted,
                    1 => PoseFrame::Global,
                    _ => return None,
                },
            },
            kind::CORRECTED => Event::Corrected {
                is_difference: small & 1 != 0,
                is_refused: small & 2 != 0,
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
