//! What host and robot say to each other. Messages are postcard, in [frames](super::frame).

use esm_core::Refusal;
use serde::{Deserialize, Serialize};

use super::access::{Access, KEY_BYTES, NONCE_BYTES};
use super::news::News;
use super::trial::{FallBack, Trial};
use crate::features::Features;
use crate::store::keep::Kept;
use crate::supervision::Silent;

/// Version of everything in this module. A host and a robot with different versions only exchange [`Request::Hello`], whose
/// encoding, and that of its answer's first field, never changes.
pub const PROTOCOL_VERSION: u16 = 3;
/// Greatest number of bytes in [`Request::Chunk`].
pub const MAX_CHUNK: usize = 176;
/// Greatest number of bytes in [`Response::Blob`], [`Response::TaskText`] and [`Response::States`].
pub const MAX_PART: usize = 128;
/// Greatest number of bytes that one stream message carries.
pub const MAX_STREAM_BYTES: usize = 96;
/// Number of buckets that start delays are counted in.
pub const DELAY_BUCKETS: usize = 8;

/// A message from the host.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ToDevice<'a> {
    /// Differs from that of the request before. A request that is sent again keeps its number.
    pub seq: u8,
    /// What the host wants.
    #[serde(borrow)]
    pub request: Request<'a>,
}

/// The version that a robot tells in its answer to [`Request::Hello`], from a serialized message of any version. This much of it never changes.
pub fn version_in_hello(message: &[u8]) -> Option<u16> {
    /// [`FromDevice::Reply`], its number, that it is no error, [`Response::Hello`], and [`DeviceInfo::protocol`].
    type Beginning = (u8, u8, u8, u8, u16);
    match postcard::take_from_bytes::<Beginning>(message) {
        Ok(((0, _, 0, 0, version), _)) => Some(version),
        _ => None,
    }
}

/// What a host can ask for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Request<'a> {
    /// Who are you? Also begins a session: the robot forgets its last answer and ends all streams. Answer: [`Response::Hello`].
    Hello,
    /// Begin an upload, or go on with one of the same length and checksum. Answer: [`Response::Received`].
    Begin {
        /// Length of the blob in bytes.
        len: u32,
        /// CRC-32 of the whole blob.
        crc: u32,
    },
    /// Bytes of the blob. Answer: [`Response::Received`], or [`LinkError::WrongOffset`] where bytes before these are missing. A host may send
    /// chunks ahead of their answers, up to [`Uploads::window_bytes`]; an answer speaks for all chunks before it, and the robot may leave
    /// out answers that a later one makes superfluous.
    Chunk {
        /// Where they belong in the blob. What of them the robot has already is passed over.
        offset: u32,
        /// At most [`MAX_CHUNK`] bytes.
        data: &'a [u8],
    },
    /// Check the blob and switch to it between two macro steps. Answer, when it runs: [`Response::Committed`].
    Commit(Swap),
    /// Forget the upload. Answer: [`Response::Done`].
    Abort,
    /// How are you? Answer: [`Response::Status`].
    Status,
    /// Motors off, latched until [`Request::Start`]. Answer, when they are: [`Response::Done`].
    Stop,
    /// Leave a stop or a safe state: the mission starts anew. Answer, when it has: [`Response::Done`].
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
    /// The mission on trial is to stay. Answer, when the one before is forgotten: [`Response::Done`].
    Confirm {
        /// Its hash: what is confirmed is what the host has seen.
        mission: u32,
    },
    /// Back to the mission before the one on trial, between two macro steps. Answer, when it runs: [`Response::Done`].
    FallBack {
        /// Hash of the mission on trial.
        mission: u32,
    },
    /// How did the run of the firmware before this one end? Answer: [`Response::LastWords`].
    LastWords,
    /// Records of the flight recorder, oldest first. Answer: [`Response::BlackBox`].
    BlackBox {
        /// Sequence number of the first one wanted, or the oldest that there is. Those that are gone are passed over.
        from: Option<u32>,
    },
    /// A number for the next [`Request::Signed`]; the one before is void. Answer: [`Response::Challenge`].
    Challenge,
    /// A request that the robot's key has signed. Answer: that request's.
    Signed {
        /// The signature of [`command`](super::access::command): [`SIGNATURE_BYTES`](super::access::SIGNATURE_BYTES).
        signature: &'a [u8],
        /// The request as it is serialized, without a number; one that [needs](super::access::needs) a key.
        request: &'a [u8],
    },
    /// The signature of the blob that was uploaded, which a robot with a key wants before [`Request::Commit`]. Answer: [`Response::Done`].
    Sign {
        /// Greater than that of any upload before.
        counter: u64,
        /// The signature of [`upload`](super::access::upload): [`SIGNATURE_BYTES`](super::access::SIGNATURE_BYTES).
        signature: &'a [u8],
    },
    /// From now on the robot has this key. Answer, when it is kept: [`Response::Done`].
    InstallKey {
        /// The public key: [`KEY_BYTES`] bytes.
        key: &'a [u8],
        /// [`SEED_BYTES`](super::access::SEED_BYTES) bytes that nobody can guess, for the robot to make nonces from.
        seed: &'a [u8],
        /// The key's own signature of [`install`](super::access::install): [`SIGNATURE_BYTES`](super::access::SIGNATURE_BYTES).
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
    /// Give a parameter of the running mission another value, for all instances of its task state, until a mission starts or starts anew. Answer, when it is in
    /// force: [`Response::ParamSet`].
    SetParam {
        /// Hash of the mission.
        mission: u32,
        /// Index of the parameter in its blob.
        param: u16,
        /// Bits of the value.
        value: u32,
    },
    /// Tell [news](super::news) from now on, or no more. Answer: [`Response::Done`], and then the first news.
    Watch {
        /// Whether news are wanted.
        news: bool,
        /// A sample each so many milliseconds of the mission's time, at least [`SHORTEST_PERIOD_MS`](super::news::SHORTEST_PERIOD_MS); 0 for none.
        period_ms: u32,
    },
    /// Keep the values that differ now from the mission's: with them it starts from now on. Where none differs, none is kept. Answer, when the flash has them:
    /// [`Response::ParamsSaved`].
    SaveParams {
        /// Hash of the mission.
        mission: u32,
    },
    /// Emergency stop: motors off from the next exchange with the body on, over starts, other missions and resets, until [`Request::Release`]. Answer, when it is
    /// latched: [`Response::Done`].
    EmergencyStop,
    /// Ends an emergency stop: the robot is [stopped](Mode::Stopped) then, and [`Request::Start`] starts it. Answer: [`Response::Done`], also where there was none.
    Release,
    /// What does your clock say? Answer: [`Response::Clock`].
    Clock,
    /// Do this, unless it is too late: then it is answered with [`LinkError::Late`], and nothing is done. Answer: that of the request.
    Within {
        /// The last microsecond on the robot's [clock](Request::Clock) at which it may still be done.
        by_us: u64,
        /// The request as it is serialized, without a number; one that [may have a deadline](super::access::may_have_deadline).
        request: &'a [u8],
    },
    /// What was the firmware built with, and how long does its flash take? Answer: [`Response::Features`].
    Features,
    /// Send [values](super::telemetry) on these nets from now on, and no others; or say what values are made of. Answer: [`Response::Done`], or [`Response::TaskText`].
    Values {
        /// Which: see [`Ask`](super::telemetry::Ask). Nothing: no values from now on.
        ask: &'a [u8],
    },
}

/// How a mission takes over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Swap {
    /// Warm: what both missions have, by name and kind, goes on as it is: states, timers, flags, nets, and what tasks know. Otherwise all starts anew.
    pub warm: bool,
    /// How long it runs on trial, in milliseconds: if it is not [confirmed](Request::Confirm) until then, or fails before, the robot goes back to the mission before by itself.
    /// 0: it stays whatever comes.
    pub trial_ms: u32,
}

/// A message from the robot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum FromDevice<'a> {
    /// The answer to a request.
    Reply {
        /// The request's number.
        seq: u8,
        /// What came of it.
        #[serde(borrow)]
        result: Result<Response<'a>, LinkError>,
    },
    /// A part of a stream.
    Stream(#[serde(borrow)] Stream<'a>),
    /// What the host wanted to be told.
    News(News),
}

/// A part of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stream<'a> {
    /// Which stream.
    pub channel: Channel,
    /// Counts the parts of this stream, modulo 256: a gap is a part that was lost on the wire.
    pub seq: u8,
    /// Whether `bytes` go on with a record that did not fit into the part before. Otherwise they begin with a new record.
    pub continues: bool,
    /// Records (trace, record) or bytes (log) that the robot dropped so far for want of room; wraps.
    pub dropped: u32,
    /// At most [`MAX_STREAM_BYTES`] bytes.
    pub bytes: &'a [u8],
}

/// The streams.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Channel {
    /// [Trace records](super::trace), whole ones.
    Trace,
    /// What the firmware's log holds: defmt frames on a board, text on the host.
    Log,
    /// [Recorded inputs](super::record), whole ones.
    Record,
    /// [Values on nets](super::telemetry), a sample a part.
    Values,
}

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
        /// Active regions that went on as they were: 0 unless the swap was warm, and where the two missions have nothing in common, the one before had failed or was stopped, or
        /// one of them has no names.
        carried: u16,
    },
    /// Done, and nothing to tell.
    Done,
    /// To [`Request::Status`].
    Status(Status),
    /// To [`Request::Task`] and [`Request::Values`].
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
        /// Macro steps that were begun, so that a reader of several parts sees whether they belong together.
        step: u64,
        /// Region instances of the mission.
        total: u16,
        /// Current local state of each region instance from the first asked for, two bytes each, little endian; [`NO_STATE`] for
        /// a region that is not active.
        states: &'a [u8],
    },
    /// To [`Request::SlotCounters`].
    Slot(SlotCounters),
    /// To [`Request::TaskCounters`].
    TaskInstance(TaskCounters),
    /// To [`Request::LastWords`].
    LastWords {
        /// What is known in numbers.
        words: LastWords,
        /// The end of the path of the file that panicked, at most [`MAX_PLACE_BYTES`](crate::kept::MAX_PLACE_BYTES); none where none did.
        file: &'a [u8],
    },
    /// To [`Request::BlackBox`].
    BlackBox {
        /// Sequence number that the next record will have: behind the newest.
        end: u32,
        /// Records from the one asked for on, each of [`RECORD_BYTES`](crate::black_box::RECORD_BYTES); none where there are no more, and
        /// from a robot that keeps none.
        records: &'a [u8],
    },
    /// To [`Request::Challenge`].
    Challenge {
        /// Good for one [`Request::Signed`].
        nonce: [u8; NONCE_BYTES],
        /// Of the last upload that was accepted.
        counter: u64,
        /// The robot's public key.
        key: [u8; KEY_BYTES],
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
        /// Milliseconds that a request may take longer than others because its flash is written; 0 where nothing is.
        flash_ms: u16,
    },
}

/// The state of a region that is not active.
pub const NO_STATE: u16 = u16::MAX;

/// What a robot is, and what it has room for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DeviceInfo<'a> {
    /// [`PROTOCOL_VERSION`]
    pub protocol: u16,
    /// Name and version of the firmware.
    pub firmware: &'a str,
    /// Name of the board.
    pub board: &'a str,
    /// Number of task types.
    pub task_types: u8,
    /// What a mission may use.
    pub capacities: Capacities,
    /// Hash of the mission that runs.
    pub mission: Option<u32>,
    /// Why the robot started the last time.
    pub reset: ResetReason,
    /// How it takes uploads.
    pub uploads: Uploads,
    /// Whether it has a key.
    pub access: Access,
}

/// How a robot takes uploads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Uploads {
    /// Bytes of a [`Request::Chunk`] at most: [`MAX_CHUNK`] or less.
    pub chunk_bytes: u16,
    /// Bytes of the blob that may be on their way, sent and not answered yet, whatever the size of the chunks that they are in.
    pub window_bytes: u16,
}

/// What a mission may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Capacities {
    /// Bytes of a blob.
    pub blob_bytes: u32,
    /// 32-bit words for the interpreter: current states, timers, flags, event queue.
    pub arena_words: u32,
    /// Slots.
    pub slots: u16,
    /// Task instances.
    pub task_instances: u16,
    /// Nets.
    pub nets: u16,
    /// Groups of exclusive tasks.
    pub exclusive_groups: u16,
}

/// One of the [`Capacities`], or what follows from them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Capacity {
    /// Bytes of a blob.
    BlobBytes,
    /// Words for the interpreter.
    ArenaWords,
    /// Slots.
    Slots,
    /// Task instances.
    TaskInstances,
    /// Nets.
    Nets,
    /// Groups of exclusive tasks.
    ExclusiveGroups,
    /// Entries of the table of what a mission has in common with the one that it is to take over from warm: two for each of the [words](Capacities::arena_words).
    Pairs,
}

/// Why a robot started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ResetReason {
    /// The power came on, or nothing is known.
    PowerOn,
    /// The reset pin.
    Pin,
    /// The hardware watchdog: a task did not return.
    Watchdog,
    /// The program panicked.
    Panic,
    /// The processor met a fault (bad access, bad instruction, stack overflow).
    CpuFault,
    /// The supply voltage fell.
    BrownOut,
    /// The firmware asked for it.
    Software,
}

/// How a run of the firmware ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LastWords {
    /// Why, and so why the robot started the last time.
    pub reason: ResetReason,
    /// Robot time of the last occurrence of the interpreter's slot, in µs since that run's first macro step of its first mission; 0 if not known.
    pub after_us: u64,
    /// The task instance that was being executed by a slot, by its index in the mission's blob.
    pub task: Option<u16>,
    /// The line of the panic, if it was one.
    pub line: u32,
    /// What the processor said of its fault, if it was one; zeros otherwise.
    pub fault: CoreFault,
    /// Who showed no sign of life, so that the watchdog was fed no more.
    pub silent: Option<Silent>,
    /// Starts after a watchdog, a panic or a fault in a row, this one included, none of which was healthy for long.
    pub bad_starts: u32,
}

impl LastWords {
    /// Of a run that left nothing but its reason.
    pub const fn of(reason: ResetReason) -> Self {
        LastWords {
            reason,
            after_us: 0,
            task: None,
            line: 0,
            fault: CoreFault {
                pc: 0,
                lr: 0,
                status: 0,
                hard_status: 0,
                address: 0,
            },
            silent: None,
            bad_starts: 0,
        }
    }
}

/// A fault of a processor, in the registers of an ARMv7-M core.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CoreFault {
    /// The instruction that faulted.
    pub pc: u32,
    /// Where its function was called from.
    pub lr: u32,
    /// Configurable fault status (CFSR).
    pub status: u32,
    /// Hard fault status (HFSR).
    pub hard_status: u32,
    /// The address of a bad access (MMFAR or BFAR), 0 if it is not known.
    pub address: u32,
}

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
    /// A net that a port of this task is on carries values of another type. The mission must be built again.
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
    /// A mission is on trial, and the buffer for the next holds the one before: confirm it or fall back first.
    OnTrial,
    /// The mission of this hash is not on trial: it was confirmed already, or the robot has gone back to the one before.
    NotOnTrial,
    /// The robot has a key, which must sign this request: send it as [`Request::Signed`].
    NeedsKey,
    /// The robot has a key, which must sign the upload: send [`Request::Sign`] before [`Request::Commit`].
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
    /// What belongs to the key cannot be read or written: nothing was changed.
    NotKept,
    /// After a wrong signature the robot looks at none for some time: send it again then.
    TooSoon {
        /// Milliseconds until then.
        ms: u32,
    },
    /// The flash did not take it: a mission that was to take over does not, one that was to be confirmed is so until the next reset only.
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
    /// An emergency stop is latched, or released, but the flash did not take it: a loss of power undoes it.
    StopNotKept,
    /// The robot came to a request [after the time](Request::Within) that it was to be done by: it was not done.
    Late,
}

/// How the robot is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Status {
    /// What it is doing.
    pub mode: Mode,
    /// Hash of its mission.
    pub mission: Option<u32>,
    /// Macro steps that were completed since the mission started.
    pub steps: u64,
    /// Nominal start of the last macro step, in microseconds since the mission started.
    pub t_us: u64,
    /// Occurrences of slots that were executed since the mission started.
    pub executed: u32,
    /// Occurrences of slots that did not start within their period, since the robot started.
    pub missed: u32,
    /// Occurrences of slots whose tasks took longer than the slot's duration, since the robot started.
    pub overruns: u32,
    /// Longest delay between the nominal and the actual start of an occurrence since the mission started, in nanoseconds.
    pub max_delay_ns: u32,
    /// Trace records dropped since the robot started.
    pub trace_dropped: u32,
    /// Whether a slot-0 run is under way.
    pub background_busy: bool,
    /// The most bytes of stack that were in use since the robot started, where the board measures it.
    pub stack_bytes: Option<u32>,
    /// Why the robot started the last time.
    pub reset: ResetReason,
    /// If the mission runs on trial.
    pub trial: Option<Trial>,
    /// The last mission that was given up on trial since the robot started.
    pub fell_back: Option<FallBack>,
    /// Where the mission is that runs, and what else its flash has; none of a robot that keeps no missions.
    pub kept: Option<Kept>,
    /// Parameters whose values differ from the mission's.
    pub changed_params: u8,
    /// Records of recordings dropped since the robot started.
    pub record_dropped: u32,
    /// Whether something that was recorded was not sent yet, or another stream's part stands before it.
    pub record_pending: bool,
    /// Values of parameters that were [saved](Request::SaveParams) for the mission.
    pub saved_params: u8,
    /// The button of the emergency stop is pressed, so that no [`Request::Release`] is taken; looked at while a stop is latched.
    pub stop_pressed: bool,
}

/// What a robot is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// It has no mission.
    Empty,
    /// Its mission runs.
    Running,
    /// It was stopped by the host: motors are off until [`Request::Start`].
    Stopped,
    /// Something broke: motors are off until [`Request::Start`] or a new mission.
    Safe(SafeReason),
    /// Somebody stopped it for an emergency: motors are off until [`Request::Release`], whatever comes.
    EmergencyStopped,
}

impl Mode {
    /// Whether it is latched: neither another mission nor a fault ends it.
    pub fn is_latched(self) -> bool {
        matches!(self, Mode::Stopped | Mode::EmergencyStopped)
    }
}

/// Why a robot went to its safe state by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SafeReason {
    /// The machine sent more events than its queue holds.
    EventQueueOverflow,
    /// A macro step had too many micro steps.
    MacroStepLimit,
    /// Too many overruns.
    Overruns,
    /// Too many occurrences missed in a row.
    Missed,
    /// The robot's body does not answer.
    BodyLost,
    /// The battery is low.
    LowBattery,
    /// The host did not call for too long, and the mission needs it.
    LinkLost,
    /// The board found something else.
    Board,
}

/// What was counted of a slot since the mission started. What a reader wants to know of the slot besides (period, duration, start) is in the
/// mission's blob.
///
/// Counters of occurrences stay at their greatest value once they are there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SlotCounters {
    /// The slot's number in the `.esm` file.
    pub number: u32,
    /// Executions that ended, overruns included, while the mission ran. After a stop and in the safe state occurrences begin, and execute nothing.
    pub executed: u32,
    /// Occurrences that did not start within their period.
    pub missed: u32,
    /// Executions that took longer than the slot's duration; stays at 65,535.
    pub overruns: u32,
    /// Sum of all executions, in nanoseconds. It stands still where `executed` does.
    pub total_execution_ns: u64,
    /// Shortest execution, in nanoseconds.
    pub min_execution_ns: u32,
    /// Longest execution, in nanoseconds.
    pub max_execution_ns: u32,
    /// Shortest delay between nominal and actual start of an execution, in nanoseconds.
    pub min_delay_ns: u32,
    /// Longest delay between nominal and actual start of an execution, in nanoseconds.
    pub max_delay_ns: u32,
    /// Delays shorter than this are in the first bucket. Each further bucket reaches four times as far; the last has no end.
    pub first_bucket_ns: u32,
    /// Executions by their delay; each stays at 65,535. [`delay_counts`](Self::delay_counts) knows more.
    pub delays: [u16; DELAY_BUCKETS],
}

impl SlotCounters {
    /// Mean execution in nanoseconds, 0 before the first.
    pub fn mean_execution_ns(&self) -> u64 {
        self.total_execution_ns
            .checked_div(u64::from(self.executed))
            .unwrap_or(0)
    }

    /// Executions by their delay, and of each number whether it is the number, or there may be more. A bucket that is full by itself has what the
    /// others leave of all executions; of several, each has at least what it shows.
    pub fn delay_counts(&self) -> [(u32, bool); DELAY_BUCKETS] {
        let is_full = |count: u16| count == u16::MAX;
        let full = self.delays.iter().filter(|count| is_full(**count)).count();
        let others = self.delays.iter().filter(|count| !is_full(**count));
        let rest = others.fold(self.executed, |rest, count| {
            rest.saturating_sub(u32::from(*count))
        });
        self.delays.map(|count| match (is_full(count), full) {
            (false, _) => (u32::from(count), true),
            (true, 1) => (rest.max(u32::from(count)), self.executed < u32::MAX),
            (true, _) => (u32::from(count), false),
        })
    }

    /// Delays in this bucket are shorter than this, in nanoseconds; `None` for the last, which has no end.
    pub fn bucket_end_ns(&self, bucket: usize) -> Option<u64> {
        let factor = 4_u64.checked_pow(u32::try_from(bucket).ok()?)?;
        (bucket + 1 < DELAY_BUCKETS).then(|| u64::from(self.first_bucket_ns).saturating_mul(factor))
    }
}

/// How a task state is, and what was counted of it since the mission started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TaskCounters {
    /// Whether its task is enabled.
    pub enabled: bool,
    /// Whether it is enabled but cannot be executed.
    pub busy: bool,
    /// Executions that took longer than the slot's duration; saturates.
    pub overruns: u16,
}

#[cfg(test)]
mod tests {
    use super::super::trial::FallBackReason;
    use super::*;
    use crate::link::access::{MAX_SIGNED_BYTES, SEED_BYTES, SIGNATURE_BYTES};
    use crate::link::frame::{MAX_FRAME_BYTES, MAX_REPLY_FRAME_BYTES, encode};
    use crate::link::news::Cause;
    use crate::link::telemetry::MAX_ASK_BYTES;
    use crate::store::SlotState;
    use crate::store::keep::Source;

    #[test]
    fn a_bucket_of_delays_that_is_full_by_itself_is_known_all_the_same() {
        const FULL: u16 = u16::MAX;
        for (executed, delays, expected) in [
            (12, [7, 5, 0], [(7, true), (5, true), (0, true)]),
            (
                1_000_012,
                [FULL, 5, 0],
                [(1_000_007, true), (5, true), (0, true)],
            ),
            (
                1_000_012,
                [FULL, 5, FULL],
                [(65_535, false), (5, true), (65_535, false)],
            ),
            (
                u32::MAX,
                [3, FULL, 0],
                [(3, true), (u32::MAX - 3, false), (0, true)],
            ),
        ] {
            let mut counters = SlotCounters {
                executed,
                ..SlotCounters::default()
            };
            counters.delays[..3].copy_from_slice(&delays);
            assert_eq!(
                counters.delay_counts()[..3],
                expected,
                "{executed}: {delays:?}"
            );
        }
    }

    #[test]
    fn the_greatest_messages_fit_into_a_frame() {
        let chunk = [0xa5; MAX_CHUNK];
        let part = [0xa5; MAX_PART];
        let mut frame = [0; MAX_FRAME_BYTES];
        let mut reply = [0; MAX_REPLY_FRAME_BYTES];
        let text = "a name that is about as long as one wants";
        let info = DeviceInfo {
            protocol: u16::MAX,
            firmware: text,
            board: text,
            task_types: u8::MAX,
            capacities: Capacities {
                blob_bytes: u32::MAX,
                arena_words: u32::MAX,
                slots: u16::MAX,
                task_instances: u16::MAX,
                nets: u16::MAX,
                exclusive_groups: u16::MAX,
            },
            mission: Some(u32::MAX),
            reset: ResetReason::Software,
            access: Access::Unreadable,
            uploads: Uploads {
                chunk_bytes: u16::MAX,
                window_bytes: u16::MAX,
            },
        };
        let status = Status {
            mode: Mode::Safe(SafeReason::Board),
            mission: Some(u32::MAX),
            steps: u64::MAX,
            t_us: u64::MAX,
            executed: u32::MAX,
            missed: u32::MAX,
            overruns: u32::MAX,
            max_delay_ns: u32::MAX,
            trace_dropped: u32::MAX,
            background_busy: true,
            stack_bytes: Some(u32::MAX),
            reset: ResetReason::Software,
            trial: Some(Trial {
                left_ms: u32::MAX,
                before: Some(u32::MAX),
            }),
            fell_back: Some(FallBack {
                mission: u32::MAX,
                reason: FallBackReason::Failed(SafeReason::Board),
            }),
            kept: Some(Kept {
                runs: Source::Firmware,
                slots: [SlotState::NoRoom { len: u32::MAX }; 2],
            }),
            changed_params: u8::MAX,
            saved_params: u8::MAX,
            record_dropped: u32::MAX,
            record_pending: true,
            stop_pressed: true,
        };
        let signature = [0xa5; SIGNATURE_BYTES];
        let install = Request::InstallKey {
            key: &[0xa5; KEY_BYTES],
            seed: &[0xa5; SEED_BYTES],
            signature: &signature,
        };
        let mut signed = [0; MAX_SIGNED_BYTES];
        assert!(postcard::to_slice(&install, &mut signed).is_ok());
        let requests = [
            Request::Chunk {
                offset: u32::MAX,
                data: &chunk,
            },
            Request::Sign {
                counter: u64::MAX,
                signature: &signature,
            },
            install,
            Request::Signed {
                signature: &signature,
                request: &signed,
            },
            Request::Within {
                by_us: u64::MAX,
                request: &signed,
            },
            Request::Values {
                ask: &chunk[..MAX_ASK_BYTES],
            },
        ];
        for request in requests {
            assert!(
                encode(&ToDevice { seq: 255, request }, &mut frame).is_ok(),
                "{request:?}"
            );
        }
        let responses = [
            Response::Challenge {
                nonce: [0xa5; NONCE_BYTES],
                counter: u64::MAX,
                key: [0xa5; KEY_BYTES],
            },
            Response::Hello(info),
            Response::Status(status),
            Response::TaskText {
                total: u16::MAX,
                text: &part,
            },
            Response::Blob {
                total: u32::MAX,
                data: &part,
            },
            Response::States {
                step: u64::MAX,
                total: u16::MAX,
                states: &part,
            },
            Response::LastWords {
                words: LastWords {
                    reason: ResetReason::Software,
                    after_us: u64::MAX,
                    task: Some(u16::MAX),
                    line: u32::MAX,
                    fault: CoreFault {
                        pc: u32::MAX,
                        lr: u32::MAX,
                        status: u32::MAX,
                        hard_status: u32::MAX,
                        address: u32::MAX,
                    },
                    silent: Some(Silent::Slot(u8::MAX)),
                    bad_starts: u32::MAX,
                },
                file: &part[..crate::kept::MAX_PLACE_BYTES],
            },
            Response::BlackBox {
                end: u32::MAX,
                records: &part,
            },
            Response::Features {
                built_in: Features(u32::MAX),
                flash_ms: u16::MAX,
            },
            Response::Slot(SlotCounters {
                number: u32::MAX,
                missed: u32::MAX,
                overruns: u32::MAX,
                executed: u32::MAX,
                total_execution_ns: u64::MAX,
                min_execution_ns: u32::MAX,
                max_execution_ns: u32::MAX,
                min_delay_ns: u32::MAX,
                max_delay_ns: u32::MAX,
                first_bucket_ns: u32::MAX,
                delays: [u16::MAX; DELAY_BUCKETS],
            }),
        ];
        for response in responses {
            assert!(
                encode(
                    &FromDevice::Reply {
                        seq: 255,
                        result: Ok(response)
                    },
                    &mut reply
                )
                .is_ok(),
                "{response:?}"
            );
        }
        // As the book says.
        let counters = responses.into_iter().find_map(|response| match response {
            Response::Slot(counters) => Some(counters),
            _ => None,
        });
        let bytes = postcard::to_slice(&counters.expect("it is there"), &mut frame)
            .expect("it fits")
            .len();
        assert_eq!(bytes, 79);
        let stream = Stream {
            channel: Channel::Log,
            seq: 255,
            continues: true,
            dropped: u32::MAX,
            bytes: &chunk[..MAX_STREAM_BYTES],
        };
        assert!(encode(&FromDevice::Stream(stream), &mut frame).is_ok());
        let news = News {
            seq: u8::MAX,
            cause: Cause::Mode,
            mode: status.mode,
            mission: status.mission,
            on_trial: true,
            fell_back: status.fell_back,
            steps: u64::MAX,
            t_us: u64::MAX,
            executed: u32::MAX,
            missed: u32::MAX,
            overruns: u32::MAX,
            max_delay_ns: u32::MAX,
            spoiled_frames: u32::MAX,
        };
        // The room of a stream's part.
        let room = &mut frame[..MAX_STREAM_BYTES];
        assert_eq!(encode(&FromDevice::News(news), room), Ok(71));
    }
}
