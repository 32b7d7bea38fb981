//! Why a request was not carried out.

use esm_core::Refusal;
use serde::{Deserialize, Serialize};

use super::device_info::Capacity;

#[cfg(doc)]
use super::Request;

/// Why a request was not carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum LinkError {
    /// The frame held no request of this protocol version.
    Malformed,
    /// [`Request::Chunk`] or [`Request::Commit`] without an upload: begin one.
    NoUpload,
    /// Bytes before those of a chunk are missing: go on at `expected`.
    WrongOffset {
        /// Bytes received so far.
        expected: u32,
    },
    /// A chunk goes beyond the length that was announced.
    TooLong,
    /// Not all of the blob was received.
    Incomplete {
        /// Bytes received so far.
        received: u32,
    },
    /// The blob that was received is not the one that was announced: upload it again.
    WrongChecksum,
    /// The blob is not valid, and why. It must be built again.
    Invalid(Refusal),
    /// The firmware has no task of this name.
    UnknownTask {
        /// Index of the task type in the blob.
        task: u16,
    },
    /// The firmware's task of this name has another signature: ports, flags or parameters differ.
    SignatureDiffers {
        /// Index of the task type in the blob.
        task: u16,
    },
    /// The mission has more task states of a type than the firmware has tasks.
    TooManyInstances {
        /// Index of the task type in the blob.
        task: u16,
        /// Task states of the mission.
        needed: u16,
        /// Tasks of the firmware.
        available: u16,
    },
    /// The mission is too large for this robot.
    CapacityExceeded {
        /// What there is too little of.
        what: Capacity,
        /// What the mission needs.
        needed: u32,
        /// What the robot has.
        available: u32,
    },
    /// There is no mission.
    NoMission,
    /// There is no task type, slot or region of this index.
    NoSuchIndex,
    /// The robot still works on the last request that changes something: ask again.
    Busy,
    /// The real-time side did not answer in time.
    NoAnswer,
    /// A net that a port of this task is on carries values of another type. The mission must be
    /// built again.
    NetTypeDiffers {
        /// Index of the task type in the blob.
        task: u16,
        /// The data port, by its place in the signature.
        port: u16,
    },
    /// A parameter of this task is outside the bounds that the firmware's task declares.
    ParamOutOfRange {
        /// Index of the task type in the blob.
        task: u16,
        /// The parameter, by its place among those of the signature.
        param: u16,
    },
    /// A mission is on trial, and the buffer for the next holds the one before: confirm it or fall
    /// back first.
    OnTrial,
    /// The mission of this hash is not on trial: it was confirmed already, or the robot has gone
    /// back to the one before.
    NotOnTrial,
    /// The robot has a key, which must sign this request: send it as [`Request::Signed`].
    NeedsKey,
    /// The robot has a key, which must sign the upload: send [`Request::Sign`] before
    /// [`Request::Commit`].
    NotSigned,
    /// The robot's key has not signed this.
    WrongSignature,
    /// An upload of this counter, or of a later one, was accepted already.
    OldCounter {
        /// The last one that was.
        last: u64,
    },
    /// There is no nonce: it was used, or never asked for. Send [`Request::Challenge`].
    NoChallenge,
    /// The robot has no key.
    NoKey,
    /// The robot's firmware cannot have a key.
    NoKeySupport,
    /// What belongs to the key cannot be read, or the flash did not take it. Where it took it all
    /// the same, that holds.
    NotStored,
    /// After a wrong signature the robot looks at none for some time: send it again then.
    TooSoon {
        /// Milliseconds until then.
        ms: u32,
    },
    /// The flash did not take it: a mission that was to take over does not, one that was to be
    /// confirmed is so until the next reset only.
    FlashRefused,
    /// Another mission runs than the one that was meant.
    OtherMission,
    /// The bits are no value of the parameter's type. NaN and the infinities are none.
    ParamNoValue,
    /// The value is outside the bounds that the firmware's task declares.
    ParamOutside {
        /// Bits of the least value.
        min: u32,
        /// Bits of the greatest value.
        max: u32,
    },
    /// As many parameters as the robot can keep differ from the mission's already.
    TooManyParams {
        /// How many can.
        available: u8,
    },
    /// This firmware was built without it.
    NotBuiltIn,
    /// The robot has no flash that it could keep this in.
    NoStore,
    /// An emergency stop is latched: [`Request::Release`] comes first.
    EmergencyStopped,
    /// An emergency stop is latched, or released, but the flash did not take it: a loss of power
    /// undoes it.
    StopNotStored,
    /// The robot came to a request [after the time](Request::Within) that it was to be done by: it
    /// was not done.
    Late,
    /// There is no session, or another one: send [`Request::Identify`] and
    /// [`Request::OpenSession`].
    NoSession,
    /// The proof is not that of the robot's secret, or not of this session.
    WrongProof,
    /// The counter of an upload is further from the last one than it may be.
    CounterTooFar {
        /// The last one that was accepted.
        last: u64,
    },
    /// The [deadline](Request::Within) is further ahead than it may be: ask for the clock.
    DeadlineTooFar,
    /// The flash was erased too often of late: this is not kept, and nothing has changed.
    FlashBudget {
        /// Seconds until it may be asked for again.
        s: u32,
    },
    /// A stop came while [`Request::Start`] was under way: the robot stands still.
    StopCame,
    /// No task `Behaviours` executes: the mission that runs has none, or the robot is stopped.
    NoBehaviours,
    /// The firmware has no behaviour with this signature, or `Behaviours` cannot run it.
    NotABehaviour,
    /// The list of behaviours has no room.
    ListFull,
    /// No behaviour of this key is on the list.
    NotOnList,
    /// There is no script to do this with, or not all of its steps are there.
    NoScript,
    /// A situation is none, or its value is no number or negative.
    NoSituation,
    /// A movement by hand is no number, or faster than it may be.
    TooFast,
    /// A position or a correction is no number, or beyond its [bounds](crate::position).
    PositionOutside,
    /// No task `GlobalPosition` executes that knows where the robot is: the mission that runs has
    /// none, or the robot is stopped.
    NoPosition,
    /// The value of a frame has another length than the frame's payload, or no task of the firmware
    /// has its type.
    PayloadDiffers {
        /// Index of the frame in the blob.
        frame: u16,
        /// Bytes of the value; 0 of a type that the firmware does not have.
        needed: u16,
    },
}
