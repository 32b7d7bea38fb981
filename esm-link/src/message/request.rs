//! What a host can ask for.

use serde::{Deserialize, Serialize};

use crate::behaviours::BehaviourRequest;
use crate::credentials::{NONCE_BYTES, PROOF_BYTES};

#[cfg(doc)]
use super::{DeviceInfo, LinkError, MAX_CHUNK, Mode, Response, Uploads};
#[cfg(doc)]
use crate::credentials::KEY_BYTES;

/// What a host can ask for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Request<'a> {
    /// Who are you? Also begins a session: the robot forgets its last answer and ends all streams.
    /// Answer: [`Response::Hello`].
    Hello,
    /// Begin an upload, or go on with one of the same length and checksum. Answer:
    /// [`Response::Received`].
    Begin {
        /// Length of the blob in bytes.
        len: u32,
        /// CRC-32 of the whole blob.
        crc: u32,
    },
    /// Bytes of the blob. Answer: [`Response::Received`], or [`LinkError::WrongOffset`] where bytes
    /// before these are missing. A host may send chunks ahead of their answers, up to
    /// [`Uploads::window_bytes`]; an answer speaks for all chunks before it, and the robot may
    /// leave out answers that a later one makes superfluous.
    Chunk {
        /// Where they belong in the blob. What of them the robot has already is passed over.
        offset: u32,
        /// At most [`MAX_CHUNK`] bytes.
        data: &'a [u8],
    },
    /// Check the blob and switch to it between two macro steps. Answer, when it runs:
    /// [`Response::Committed`].
    Commit(Swap),
    /// Forget the upload. Answer: [`Response::Done`].
    Abort,
    /// How are you? Answer: [`Response::Status`].
    Status,
    /// Motors off, latched until [`Request::Start`]. Answer, when they are: [`Response::Done`].
    Stop,
    /// Leave a stop or a safe state: the mission starts anew. Answer, when it has:
    /// [`Response::Done`].
    Start,
    /// The declaration of a task type. Answer: [`Response::TaskText`].
    Task {
        /// Which task type, below [`DeviceInfo::task_types`].
        index: u8,
        /// The first byte wanted.
        offset: u16,
    },
    /// Bytes of the running mission's blob. Answer: [`Response::Blob`].
    ReadBlob {
        /// The first byte wanted.
        offset: u32,
    },
    /// Current states of the running mission. Answer: [`Response::States`].
    States {
        /// The first region instance wanted.
        first: u16,
    },
    /// What was counted of a slot. Answer: [`Response::Slot`].
    SlotCounters {
        /// Index of the slot in the running mission's blob.
        slot: u8,
    },
    /// Which streams to send from now on. Answer: [`Response::Done`].
    Subscribe {
        /// Trace records.
        trace: bool,
        /// Log bytes.
        log: bool,
        /// A recording of what enters the interpreter, which begins anew with each such request.
        record: bool,
    },
    /// What was counted of a task state. Answer: [`Response::TaskInstance`].
    TaskCounters {
        /// Index of the task instance in the running mission's blob.
        task_instance: u16,
    },
    /// The mission on trial is to stay. Answer, when the one before is forgotten:
    /// [`Response::Done`].
    Confirm {
        /// Its hash: what is confirmed is what the host has seen.
        mission: u32,
    },
    /// Back to the mission before the one on trial, between two macro steps. Answer, when it runs:
    /// [`Response::Done`].
    FallBack {
        /// Hash of the mission on trial.
        mission: u32,
    },
    /// How did the run of the firmware before this one end? Answer: [`Response::CrashReport`].
    CrashReport,
    /// Records of the black box, oldest first. Answer: [`Response::BlackBox`].
    BlackBox {
        /// Sequence number of the first one wanted, or the oldest that there is. Those that are
        /// gone are passed over.
        from: Option<u32>,
    },
    /// A nonce for the next [`Request::Signed`]; the one before is void. Within a
    /// [session](Request::OpenSession) only. Answer: [`Response::Challenge`].
    Challenge,
    /// A request that the robot's key has signed, within a session. Answer: that request's.
    Signed {
        /// The signature of [`command`](crate::access::command):
        /// [`SIGNATURE_BYTES`](crate::access::SIGNATURE_BYTES).
        signature: &'a [u8],
        /// The request as it is serialized, without a number; one that
        /// [needs](crate::access::needs) a key.
        request: &'a [u8],
    },
    /// The signature of the blob that was uploaded, which a robot with a key wants before
    /// [`Request::Commit`]. Answer: [`Response::Done`].
    Sign {
        /// Greater than that of any upload before, by
        /// [`MAX_COUNTER_STEP`](crate::access::MAX_COUNTER_STEP) at most.
        counter: u64,
        /// The signature of [`upload`](crate::access::upload):
        /// [`SIGNATURE_BYTES`](crate::access::SIGNATURE_BYTES).
        signature: &'a [u8],
    },
    /// From now on the robot has this key. Answer, when it is kept: [`Response::Done`].
    InstallKey {
        /// The public key: [`KEY_BYTES`] bytes.
        key: &'a [u8],
        /// Names the robot's secret: [`SALT_BYTES`](crate::access::SALT_BYTES) random bytes, new
        /// with each installation.
        salt: &'a [u8],
        /// What robot and owner know alone: [`SECRET_BYTES`](crate::access::SECRET_BYTES) bytes.
        /// Within a session they are [masked](crate::proof::mask).
        secret: &'a [u8],
        /// The key's own signature of [`install`](crate::access::install):
        /// [`SIGNATURE_BYTES`](crate::access::SIGNATURE_BYTES).
        signature: &'a [u8],
    },
    /// From now on the robot has no key. Answer, when it is forgotten: [`Response::Done`].
    RemoveKey,
    /// The value of a parameter of the running mission. Answer: [`Response::Param`].
    Param {
        /// Hash of the mission.
        mission: u32,
        /// Index of the parameter in its blob.
        param: u16,
    },
    /// Give a parameter of the running mission another value, for all instances of its task state,
    /// until a mission starts or starts anew. Answer, when it is in force: [`Response::ParamSet`].
    SetParam {
        /// Hash of the mission.
        mission: u32,
        /// Index of the parameter in its blob.
        param: u16,
        /// Bits of the value.
        value: u32,
    },
    /// Tell [status events](crate::status_event) from now on, or no more. Answer:
    /// [`Response::Done`], and then the first status events.
    Watch {
        /// Whether status events are wanted.
        news: bool,
        /// A sample each so many milliseconds of the mission's time, at least
        /// [`SHORTEST_PERIOD_MS`](crate::status_event::SHORTEST_PERIOD_MS); 0 for none.
        period_ms: u32,
    },
    /// Keep the values that differ now from the mission's: with them it starts from now on. Where
    /// none differs, none is kept. Answer, when the flash has them: [`Response::ParamsSaved`].
    SaveParams {
        /// Hash of the mission.
        mission: u32,
    },
    /// Emergency stop: motors off from the next exchange with the body on, over starts, other
    /// missions and resets, until [`Request::Release`]. Answer, when it is latched:
    /// [`Response::Done`].
    EmergencyStop,
    /// Ends an emergency stop: the robot is [stopped](Mode::Stopped) then, and [`Request::Start`]
    /// starts it. Answer: [`Response::Done`], also where there was none.
    Release,
    /// What does your clock say? Answer: [`Response::Clock`].
    Clock,
    /// Do this, unless it is too late: then it is answered with [`LinkError::Late`], and nothing is
    /// done. Answer: that of the request.
    Within {
        /// The last microsecond on the robot's [clock](Request::Clock) at which it may still be
        /// done.
        by_us: u64,
        /// The request as it is serialized, without a number; one that [may have a
        /// deadline](crate::access::may_have_deadline).
        request: &'a [u8],
    },
    /// What was the firmware built with, and how long does its flash take? Answer:
    /// [`Response::Features`].
    Features,
    /// Send [values](crate::telemetry) on these nets from now on, and no others; or say what values
    /// are made of. Answer: [`Response::Done`], or [`Response::TaskText`].
    Values {
        /// Which: see [`Ask`](crate::telemetry::Ask). Nothing: no values from now on.
        ask: &'a [u8],
    },
    /// Which key do you have? The first step of a session. Answer: [`Response::Identity`].
    Identify {
        /// Random bytes, so that the answer is of now.
        nonce: [u8; NONCE_BYTES],
    },
    /// Begins a session with the owner of the key, in place of the one before. Answer:
    /// [`Response::Done`], with a proof for the number 0.
    OpenSession {
        /// The nonce of [`Request::Identify`].
        client: [u8; NONCE_BYTES],
        /// The nonce of [`Response::Identity`].
        robot: [u8; NONCE_BYTES],
        /// [`opening`](crate::proof::Session::opening)
        proof: [u8; PROOF_BYTES],
    },
    /// A request of the owner's session. Answer: that request's, [with a
    /// proof](super::FromDevice::Proven).
    Proven {
        /// Greater than that of the one before in this session.
        number: u32,
        /// [`of_request`](crate::proof::Session::of_request)
        proof: [u8; PROOF_BYTES],
        /// The request as it is serialized, without a number.
        request: &'a [u8],
    },
    /// What stands on the list of behaviours, and how is the script? Answer:
    /// [`Response::BehaviourList`].
    BehaviourList,
    /// Change the list of behaviours. Answer: as the request says.
    Behaviours(#[serde(borrow)] BehaviourRequest<'a>),
    /// REMOTE_CONTROL: move like this, before all behaviours, which resume when the time is over.
    /// Answer, when it is on the list: [`Response::Done`].
    Drive {
        /// Ahead, in metres per second.
        forward_m_per_s: f32,
        /// To the left, in radians per second.
        turn_rad_per_s: f32,
        /// The last microsecond on the robot's [clock](Request::Clock) at which it holds, at most
        /// [`MAX_DRIVE_US`](crate::behaviours::MAX_DRIVE_US) ahead.
        until_us: u64,
    },
    /// REMOTE_CONTROL ends. Answer: [`Response::Done`], also where nobody drove.
    EndDrive,
    /// What a board that measures itself is asked. Answer: [`Response::TaskText`] with
    /// [`Measures`](crate::selftest::Measures), or [`Response::Done`].
    Selftest {
        /// Which: see [`Ask`](crate::selftest::Ask).
        ask: &'a [u8],
    },
    /// What was counted of a frame of a link? Answer: [`Response::Frame`].
    FrameCounters {
        /// Its index in the mission.
        frame: u16,
    },
}

impl Request<'_> {
    /// The number of its kind in a message: an answer repeats it.
    pub const fn kind(&self) -> u8 {
        match self {
            Request::Hello => 0,
            Request::Begin { .. } => 1,
            Request::Chunk { .. } => 2,
            Request::Commit(_) => 3,
            Request::Abort => 4,
            Request::Status => 5,
            Request::Stop => 6,
            Request::Start => 7,
            Request::Task { .. } => 8,
            Request::ReadBlob { .. } => 9,
            Request::States { .. } => 10,
            Request::SlotCounters { .. } => 11,
            Request::Subscribe { .. } => 12,
            Request::TaskCounters { .. } => 13,
            Request::Confirm { .. } => 14,
            Request::FallBack { .. } => 15,
            Request::CrashReport => 16,
            Request::BlackBox { .. } => 17,
            Request::Challenge => 18,
            Request::Signed { .. } => 19,
            Request::Sign { .. } => 20,
            Request::InstallKey { .. } => 21,
            Request::RemoveKey => 22,
            Request::Param { .. } => 23,
            Request::SetParam { .. } => 24,
            Request::Watch { .. } => 25,
            Request::SaveParams { .. } => 26,
            Request::EmergencyStop => 27,
            Request::Release => 28,
            Request::Clock => 29,
            Request::Within { .. } => 30,
            Request::Features => 31,
            Request::Values { .. } => 32,
            Request::Identify { .. } => 33,
            Request::OpenSession { .. } => 34,
            Request::Proven { .. } => 35,
            Request::BehaviourList => 36,
            Request::Behaviours(_) => 37,
            Request::Drive { .. } => 38,
            Request::EndDrive => 39,
            Request::Selftest { .. } => 40,
            Request::FrameCounters { .. } => 41,
        }
    }

    /// Whether it stops the robot, also [within a time](Request::Within): it is carried out
    /// whenever it comes, also if it came before.
    pub fn is_stop(&self) -> bool {
        const STOP: u8 = Request::Stop.kind();
        const EMERGENCY_STOP: u8 = Request::EmergencyStop.kind();
        match self {
            Request::Stop | Request::EmergencyStop => true,
            Request::Within { request, .. } => matches!(request, [STOP | EMERGENCY_STOP]),
            _ => false,
        }
    }
}

/// How a mission takes over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Swap {
    /// Warm: what both missions have, by name and kind, goes on as it is: states, timers, flags,
    /// nets, and what tasks know. Otherwise all starts anew.
    pub warm: bool,
    /// How long it runs on trial, in milliseconds: if it is not [confirmed](Request::Confirm) until
    /// then, or fails before, the robot goes back to the mission before by itself. 0: it stays
    /// whatever comes.
    pub trial_ms: u32,
}
