//! What a robot answers.

use serde::{Deserialize, Serialize};

use super::counters::{FrameCounters, SlotCounters, TaskCounters};
use super::crash_report::CrashReport;
use super::device_info::DeviceInfo;
use super::status::Status;
use crate::behaviours::ScriptStatus;
use crate::credentials::{KEY_BYTES, NONCE_BYTES, PROOF_BYTES, SALT_BYTES};
use crate::features::Features;

#[cfg(doc)]
use super::Request;

/// The state of a region that is not active.
pub const NO_STATE: u16 = u16::MAX;

/// What a robot answers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Response<'a> {
    /// To [`Request::Hello`].
    Hello(#[serde(borrow)] DeviceInfo<'a>),
    /// To [`Request::Begin`] and [`Request::Chunk`].
    Received {
        /// Number of bytes of the blob that are there, from its first on, without a gap.
        len: u32,
    },
    /// To [`Request::Commit`]: the mission runs.
    Committed {
        /// Its hash.
        mission: u32,
        /// Active regions that went on as they were: 0 unless the swap was warm, and where the two
        /// missions have nothing in common, the one before had failed or was stopped, or one of
        /// them has no names.
        carried: u16,
    },
    /// Done, and nothing to tell.
    Done,
    /// To [`Request::Status`].
    Status(Status),
    /// To [`Request::Task`], [`Request::Values`] and [`Request::Selftest`].
    TaskText {
        /// Length of the whole text.
        total: u16,
        /// UTF-8 text from the offset asked for; none at its end.
        text: &'a [u8],
    },
    /// To [`Request::ReadBlob`].
    Blob {
        /// Length of the whole blob.
        total: u32,
        /// Bytes from the offset asked for; none at its end.
        data: &'a [u8],
    },
    /// To [`Request::States`].
    States {
        /// Number of the next macro step since the mission started; those that were missed count.
        /// By it a reader of several parts sees whether they belong together.
        step: u64,
        /// Region instances of the mission.
        total: u16,
        /// Current local state of each region instance from the first asked for, two bytes each,
        /// little endian; [`NO_STATE`] for a region that is not active.
        states: &'a [u8],
    },
    /// To [`Request::SlotCounters`].
    Slot(SlotCounters),
    /// To [`Request::TaskCounters`].
    TaskInstance(TaskCounters),
    /// To [`Request::CrashReport`].
    CrashReport {
        /// What is known in numbers.
        words: CrashReport,
        /// The end of the path of the file that panicked, at most
        /// [`MAX_PLACE_BYTES`](super::MAX_PLACE_BYTES); none where none did.
        file: &'a [u8],
    },
    /// To [`Request::BlackBox`].
    BlackBox {
        /// Sequence number that the next record will have: behind the newest.
        end: u32,
        /// Records from the one asked for on, each of
        /// [`RECORD_BYTES`](crate::black_box::RECORD_BYTES); none where there are no more, and from
        /// a robot that keeps none.
        records: &'a [u8],
    },
    /// To [`Request::Challenge`].
    Challenge {
        /// Good for one [`Request::Signed`] within [`NONCE_LIFE_US`](crate::access::NONCE_LIFE_US).
        nonce: [u8; NONCE_BYTES],
        /// Of the last upload that was accepted.
        counter: u64,
    },
    /// To [`Request::Param`].
    Param {
        /// Bits of its value.
        value: u32,
        /// Bits of the value that the mission gives it.
        of_mission: u32,
        /// Bits of the value that was [saved](Request::SaveParams) for it.
        saved: Option<u32>,
    },
    /// To [`Request::SetParam`]: it is in force since the last macro step began.
    ParamSet {
        /// Bits of the value before.
        before: u32,
    },
    /// To [`Request::SaveParams`]: they are in the flash.
    ParamsSaved {
        /// How many.
        count: u8,
    },
    /// To [`Request::Clock`].
    Clock {
        /// Microseconds since the robot started.
        now_us: u64,
    },
    /// To [`Request::Features`].
    Features {
        /// What it was built with.
        built_in: Features,
        /// Milliseconds that a request may take longer than others because its flash is written; 0
        /// where nothing is.
        flash_ms: u16,
    },
    /// To [`Request::Identify`].
    Identity(Identity),
    /// To requests that insert a behaviour.
    Behaviour {
        /// Names it in requests.
        key: u16,
    },
    /// To [`Request::BehaviourList`].
    BehaviourList {
        /// How the script is.
        script: ScriptStatus,
        /// What stands on the list, the head first, of
        /// [`ENTRY_BYTES`](crate::behaviours::ENTRY_BYTES) each.
        entries: &'a [u8],
    },
    /// To [`Request::FrameCounters`].
    Frame(FrameCounters),
}

/// Which key a robot has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// The robot's public key.
    pub key: [u8; KEY_BYTES],
    /// From which the owner of the key [derives](crate::proof::Secret::of_owner) the robot's
    /// secret.
    pub salt: [u8; SALT_BYTES],
    /// Good for one [`Request::OpenSession`] within
    /// [`NONCE_LIFE_US`](crate::access::NONCE_LIFE_US).
    pub nonce: [u8; NONCE_BYTES],
    /// Of the last upload that was accepted.
    pub counter: u64,
    /// [`of_identity`](crate::proof::KeyedSecret::of_identity)
    pub proof: [u8; PROOF_BYTES],
}
