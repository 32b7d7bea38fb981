//! The vectors in `tests/conformance/link.txt`, which other clients of the link are tested against:
//! made here from the firmware's own end, and compared with what it does today. `ESM_BLESS=1`
//! writes them again.

use std::fmt::Write;

use esm_link::access::{
    self, Access, KEY_BYTES, NO_UPLOAD, NONCE_BYTES, PROOF_BYTES, SALT_BYTES, SECRET_BYTES,
    SIGNATURE_BYTES, may_be_proven,
};
use esm_link::behaviours::{
    BehaviourRequest, Call, ListEntry, Origin, Reaction, ScriptState, ScriptStatus, Situation,
    Watch,
};
use esm_link::black_box::{Event, Record};
use esm_link::features::{Feature, Features};
use esm_link::frame::{
    CRC_BYTES, FrameReader, MAX_FRAME_BYTES, MAX_MESSAGE_BYTES, checksum, decode, encode,
};
use esm_link::message::{
    BankState, Capacities, Capacity, Channel, CoreFault, CrashReport, DELAY_BUCKETS, DeviceInfo,
    FlashHealth, FrameCounters, FromDevice, Identity, KeyValuesState, LinkError, MAX_CHUNK,
    MAX_PART, MAX_STREAM_BYTES, Mode, Request, ResetReason, Response, SafeReason, Silent,
    SlotCounters, Source, Status, StoreStatus, Stream, Swap, TaskCounters, ToDevice, UNKNOWN,
    Uploads, WayIn,
};
use esm_link::proof::{Secret, mask};
use esm_link::selftest::Ask;
use esm_link::status_event::{Cause, StatusEvent};
use esm_link::trial::{FallBack, FallBackReason, Trial};
use esm_tests::command::root;
use esm_tests::owner::{Installation, Owner, bytes_of as held};
use host_tools::keys::SigningKey;
use serde::Serialize;

use super::counting;
use super::robot::{Bench, Safe, with_robot};

const FILE: &str = "tests/conformance/link.txt";

const HEAD: &str = "\
# Vectors of the link's protocol, which docs/link.md describes. Bytes are in hexadecimal.
# Made by `ESM_BLESS=1 cargo test -p esm-tests --test runtime conformance`.
#
# frame NAME      a message, and the frame that it is in
# spoiled NAME    bytes of a line, and the messages that a receiver gets out of them, which may be none
# key NAME        the private part of a key, its public part, and the salt that is installed with it. FOR TESTS ONLY: everyone has this key
# signed NAME     what that key signs, and the signature
# session NAME    the secret of a robot with that key and salt, nonces of both sides, and the session's key that follows
# proof NAME      what is proven of that robot, or in that session, and the proof: the key of HMAC-SHA-256, the message, 16 bytes
# exchange NAME   what goes over the line of a robot that has just started, in order:
#     >  bytes from the client, which arrive
#     x  bytes from the client, which the line loses
#     <  bytes from the robot
#     t  so many microseconds pass
#   The client numbers its requests from 1 and puts a delimiter in front of each frame. It chooses the sizes of chunks as docs/link.md advises; what it
#   asks for, and when, is its own affair.
#   The nonces of the client's sessions are the texts \"client nonce 001\", \"client nonce 002\" and so on, in each exchange.
#   In exchanges about keys the robot starts with memory for a key and without one.
";

/// A key whose private part everyone may read here.
const TEST_KEY: &[u8; KEY_BYTES] = b"esm test key, known to everyone.";
/// Another one, which the robot does not have.
const OTHER_KEY: &[u8; KEY_BYTES] = b"esm test key, not of this robot.";
/// Names the secret of a robot with the test key.
const TEST_SALT: [u8; SALT_BYTES] = *b"esm test salt 01";

/// The bytes that are uploaded where they need not be a mission.
fn junk(length: usize) -> Vec<u8> {
    (0..length).map(|i| (i * 31 + i / 256) as u8).collect()
}

fn hex(bytes: &[u8]) -> String {
    let mut text = String::new();
    for byte in bytes {
        let _ = write!(text, "{byte:02x}");
    }
    text
}

fn frame_of(message: &impl Serialize) -> Vec<u8> {
    let mut frame = [0; MAX_FRAME_BYTES];
    let length = encode(message, &mut frame).unwrap();
    frame[..length].to_vec()
}

/// The message in a frame.
fn message_of(frame: &[u8]) -> Vec<u8> {
    let mut message = Vec::new();
    let mut rest = frame;
    while let Some((distance, after)) = rest.split_first().filter(|(first, _)| **first > 0) {
        let (bytes, next) = after.split_at(usize::from(*distance) - 1);
        message.extend(bytes);
        message.push(0);
        rest = next;
    }
    message.truncate(message.len() - 1 - CRC_BYTES);
    message
}

fn write_frame(text: &mut String, name: &str, message: &impl Serialize) {
    let frame = frame_of(message);
    let _ = writeln!(
        text,
        "\nframe {name}\nmessage {}\nbytes {}",
        hex(&message_of(&frame)),
        hex(&frame)
    );
}

fn write_frames(text: &mut String) {
    let chunk = junk(MAX_CHUNK);
    let params = [0.25_f32, -1.5].map(f32::to_le_bytes);
    // What names a step of a script is a step's alone.
    let [alone, of_step] = [Reaction::Flag, Reaction::Insert(3)].map(|reaction| {
        let watches = [
            (Situation::OutsideRange, Reaction::Cancel),
            (Situation::Near, reaction),
        ];
        watches.map(|(situation, reaction)| {
            let watch = Watch {
                situation,
                value: 0.5,
                reaction,
            };
            watch.to_bytes()
        })
    });
    let call = Call {
        task: u64::MAX,
        params: params.as_flattened(),
        watches: alone.as_flattened(),
    };
    let step = Call {
        watches: of_step.as_flattened(),
        ..call
    };
    let (measures, measures_length) = Ask::Measures.bytes();
    let (baud, ms) = (921_600, 2_000);
    let (rate, rate_length) = Ask::LineRate { baud, ms }.bytes();
    let requests = [
        ("request hello", Request::Hello),
        (
            "request begin",
            Request::Begin {
                len: 4096,
                crc: 0xcbf4_3926,
            },
        ),
        (
            "request chunk of nothing",
            Request::Chunk {
                offset: 0,
                data: &[],
            },
        ),
        (
            "request chunk of zeros",
            Request::Chunk {
                offset: 127,
                data: &[0; 16],
            },
        ),
        (
            "request chunk, the longest",
            Request::Chunk {
                offset: u32::MAX,
                data: &chunk,
            },
        ),
        (
            "request commit",
            Request::Commit(Swap {
                warm: true,
                trial_ms: 10_000,
            }),
        ),
        ("request abort", Request::Abort),
        ("request status", Request::Status),
        ("request stop", Request::Stop),
        ("request start", Request::Start),
        (
            "request task",
            Request::Task {
                index: 255,
                offset: 300,
            },
        ),
        ("request read blob", Request::ReadBlob { offset: 70_000 }),
        ("request states", Request::States { first: 128 }),
        ("request slot counters", Request::SlotCounters { slot: 3 }),
        (
            "request subscribe",
            Request::Subscribe {
                trace: true,
                log: false,
                record: true,
            },
        ),
        (
            "request task counters",
            Request::TaskCounters {
                task_instance: 1000,
            },
        ),
        (
            "request confirm",
            Request::Confirm {
                mission: 0x1234_abcd,
            },
        ),
        (
            "request fall back",
            Request::FallBack {
                mission: 0x1234_abcd,
            },
        ),
        ("request last words", Request::CrashReport),
        (
            "request watch",
            Request::Watch {
                news: true,
                period_ms: 1000,
            },
        ),
        (
            "request black box from the oldest",
            Request::BlackBox { from: None },
        ),
        (
            "request black box",
            Request::BlackBox { from: Some(70_000) },
        ),
        ("request challenge", Request::Challenge),
        (
            "request signed",
            Request::Signed {
                signature: &[0xa5; SIGNATURE_BYTES],
                request: &[7],
            },
        ),
        (
            "request sign",
            Request::Sign {
                counter: u64::MAX,
                signature: &[0x5a; SIGNATURE_BYTES],
            },
        ),
        (
            "request install key",
            Request::InstallKey {
                key: &[0x11; KEY_BYTES],
                salt: &[0x22; SALT_BYTES],
                secret: &[0x44; SECRET_BYTES],
                signature: &[0x33; SIGNATURE_BYTES],
            },
        ),
        ("request remove key", Request::RemoveKey),
        (
            "request param",
            Request::Param {
                mission: 0x1234_abcd,
                param: 300,
            },
        ),
        (
            "request set param",
            Request::SetParam {
                mission: 0x1234_abcd,
                param: 3,
                value: 0.3_f32.to_bits(),
            },
        ),
        (
            "request save params",
            Request::SaveParams {
                mission: 0x1234_abcd,
            },
        ),
        ("request emergency stop", Request::EmergencyStop),
        ("request release", Request::Release),
        ("request clock", Request::Clock),
        ("request features", Request::Features),
        (
            "request fields",
            Request::Values {
                ask: &[0, 0, 0xcd, 0xab, 0x34, 0x12, 44, 1, 128, 0],
            },
        ),
        (
            "request values",
            Request::Values {
                ask: &[1, 0, 0xcd, 0xab, 0x34, 0x12, 100, 0, 3, 0, 44, 1],
            },
        ),
        ("request no values", Request::Values { ask: &[] }),
        (
            "request identify",
            Request::Identify {
                nonce: [0x66; NONCE_BYTES],
            },
        ),
        (
            "request open session",
            Request::OpenSession {
                client: [0x66; NONCE_BYTES],
                robot: [0x77; NONCE_BYTES],
                proof: [0x88; PROOF_BYTES],
            },
        ),
        (
            "request proven",
            Request::Proven {
                number: 300,
                proof: [0x99; PROOF_BYTES],
                request: &[5],
            },
        ),
        (
            "request within a time",
            Request::Within {
                by_us: 1 << 40,
                request: &[7],
            },
        ),
        ("request behaviour list", Request::BehaviourList),
        (
            "request insert at the tail",
            Request::Behaviours(BehaviourRequest::InsertAtTail(call)),
        ),
        (
            "request insert at the head",
            Request::Behaviours(BehaviourRequest::InsertAtHead(Call {
                watches: &[],
                ..call
            })),
        ),
        (
            "request cancel",
            Request::Behaviours(BehaviourRequest::Cancel { key: 300 }),
        ),
        (
            "request suspend",
            Request::Behaviours(BehaviourRequest::Suspend { key: 1 }),
        ),
        (
            "request resume",
            Request::Behaviours(BehaviourRequest::Resume { key: 1 }),
        ),
        (
            "request step",
            Request::Behaviours(BehaviourRequest::Step {
                script: 0xfeed_beef,
                index: 15,
                call: step,
            }),
        ),
        (
            "request run",
            Request::Behaviours(BehaviourRequest::Run {
                script: 0xfeed_beef,
                steps: 2,
                all: 16,
            }),
        ),
        (
            "request end script",
            Request::Behaviours(BehaviourRequest::EndScript),
        ),
        (
            "request suspend script",
            Request::Behaviours(BehaviourRequest::SuspendScript),
        ),
        (
            "request resume script",
            Request::Behaviours(BehaviourRequest::ResumeScript),
        ),
        (
            "request position",
            Request::Behaviours(BehaviourRequest::Position {
                position: &[0, 0, 0, 0x48, 0x41, 0, 0, 0x40, 0xc0, 0, 0, 0xc0, 0x3f],
            }),
        ),
        (
            "request correct position",
            Request::Behaviours(BehaviourRequest::Position {
                position: &[1, 0, 0, 0x80, 0x3e, 0, 0, 0, 0, 0, 0, 0, 0xbf],
            }),
        ),
        (
            "request keep script",
            Request::Behaviours(BehaviourRequest::KeepScript {
                script: 0xfeed_beef,
            }),
        ),
        (
            "request remove script",
            Request::Behaviours(BehaviourRequest::KeepScript { script: 0 }),
        ),
        (
            "request kept script",
            Request::Behaviours(BehaviourRequest::KeptScript),
        ),
        (
            "request drive",
            Request::Drive {
                forward_m_per_s: 0.25,
                turn_rad_per_s: -1.5,
                until_us: 1 << 40,
            },
        ),
        ("request end drive", Request::EndDrive),
        (
            "request selftest measures",
            Request::Selftest {
                ask: &measures[..measures_length],
            },
        ),
        (
            "request selftest line rate",
            Request::Selftest {
                ask: &rate[..rate_length],
            },
        ),
        (
            "request frame counters",
            Request::FrameCounters { frame: 300 },
        ),
    ];
    for ((name, request), seq) in requests.into_iter().zip(0..) {
        write_frame(text, name, &ToDevice { seq, request });
    }
    let part = junk(MAX_PART);
    let entries = [
        (0, 0, Origin::Idle, false),
        (300, 0xabcd, Origin::Script, true),
    ];
    let entries = entries.map(|(key, task, origin, is_held)| {
        let entry = ListEntry {
            key,
            task,
            state: 3,
            origin,
            is_held,
        };
        entry.to_bytes()
    });
    let records = [
        Event::Started(ResetReason::Panic),
        Event::Transition {
            region_instance: 300,
            transition: 2,
        },
        Event::Mode(Mode::Safe(SafeReason::DeadlineMiss)),
    ];
    let records: Vec<u8> = (70_000..)
        .zip(records)
        .flat_map(|(sequence, event)| {
            let at_us = u64::from(sequence) << 24;
            Record {
                sequence,
                at_us,
                event,
            }
            .to_bytes()
        })
        .collect();
    let status = Status {
        mode: Mode::Safe(SafeReason::LowBattery),
        mission: Some(u32::MAX),
        steps: u64::MAX,
        t_us: u64::MAX,
        executed: u32::MAX,
        missed: 1,
        overruns: 128,
        max_delay_ns: 16_384,
        trace_dropped: 0,
        background_busy: true,
        stack_bytes: None,
        reset: ResetReason::Watchdog,
        trial: Some(Trial {
            left_ms: 9_999,
            before: Some(7),
        }),
        fell_back: Some(FallBack {
            mission: 128,
            reason: FallBackReason::Failed(SafeReason::Overruns),
        }),
        kept: Some(StoreStatus {
            runs: Source::B,
            slots: [BankState::NoRoom { len: 5000 }, BankState::OnTrial],
        }),
        changed_params: 200,
        saved_params: 201,
        record_dropped: 300,
        record_pending: true,
        stop_pressed: true,
        flash: Some(FlashHealth {
            records: KeyValuesState::Older(WayIn::NoKey),
            flaws: 300,
            mission_erases: 70_000,
            record_erases: 5,
        }),
    };
    let answers: [(&str, Result<Response<'_>, LinkError>); 75] = [
        (
            "hello",
            Ok(Response::Hello(DeviceInfo {
                protocol: 4,
                firmware: "a robot 1.2",
                board: "a board",
                task_types: 14,
                capacities: Capacities {
                    blob_bytes: 3328,
                    arena_words: 128,
                    slots: 16,
                    task_instances: 24,
                    nets: 23,
                    exclusive_groups: 4,
                },
                mission: Some(0x1234_abcd),
                reset: ResetReason::BrownOut,
                uploads: Uploads {
                    chunk_bytes: 176,
                    window_bytes: 528,
                },
                access: Access::Locked,
            })),
        ),
        ("received", Ok(Response::Received { len: 300 })),
        (
            "committed",
            Ok(Response::Committed {
                mission: 0x0102_0304,
                carried: 300,
            }),
        ),
        ("done", Ok(Response::Done)),
        ("status", Ok(Response::Status(status))),
        (
            "status of a robot without a mission",
            Ok(Response::Status(Status {
                mode: Mode::Empty,
                mission: None,
                stack_bytes: Some(900),
                trial: None,
                fell_back: None,
                kept: None,
                ..status
            })),
        ),
        (
            "task text",
            Ok(Response::TaskText {
                total: 130,
                text: &part,
            }),
        ),
        (
            "blob",
            Ok(Response::Blob {
                total: 70_000,
                data: &part,
            }),
        ),
        (
            "states",
            Ok(Response::States {
                step: 1 << 40,
                total: 4,
                states: &[1, 0, 0, 1, 255, 255, 3, 0],
            }),
        ),
        (
            "slot counters",
            Ok(Response::Slot(SlotCounters {
                number: 7,
                executed: u32::MAX,
                missed: 2,
                overruns: 3,
                total_execution_ns: u64::MAX,
                min_execution_ns: 4,
                max_execution_ns: 5,
                min_delay_ns: 6,
                max_delay_ns: 7,
                first_bucket_ns: 1000,
                delays: [u16::MAX; DELAY_BUCKETS],
            })),
        ),
        (
            "task counters",
            Ok(Response::TaskInstance(TaskCounters {
                enabled: true,
                busy: false,
                overruns: 300,
            })),
        ),
        (
            "last words",
            Ok(Response::CrashReport {
                words: CrashReport {
                    reason: ResetReason::CpuFault,
                    after_us: 1 << 40,
                    task: Some(300),
                    line: 7,
                    fault: CoreFault {
                        pc: 0x1234,
                        lr: 0x5679,
                        status: 0x0001_0000,
                        hard_status: 0x4000_0000,
                        address: u32::MAX,
                    },
                    silent: Some(Silent::Slot(200)),
                    bad_starts: 300,
                },
                file: b"src/tasks/cruise.rs",
            }),
        ),
        (
            "black box",
            Ok(Response::BlackBox {
                end: 70_003,
                records: &records,
            }),
        ),
        (
            "param",
            Ok(Response::Param {
                value: 0.3_f32.to_bits(),
                of_mission: 7,
                saved: None,
            }),
        ),
        (
            "param saved",
            Ok(Response::Param {
                value: 1,
                of_mission: 2,
                saved: Some(300),
            }),
        ),
        ("params saved", Ok(Response::ParamsSaved { count: 8 })),
        ("param set", Ok(Response::ParamSet { before: u32::MAX })),
        ("error malformed", Err(LinkError::Malformed)),
        ("error no upload", Err(LinkError::NoUpload)),
        (
            "error wrong offset",
            Err(LinkError::WrongOffset { expected: 176 }),
        ),
        ("error too long", Err(LinkError::TooLong)),
        (
            "error incomplete",
            Err(LinkError::Incomplete { received: 12 }),
        ),
        ("error wrong checksum", Err(LinkError::WrongChecksum)),
        (
            "error invalid",
            Err(LinkError::Invalid(esm_core::Refusal::Checksum {
                stored: 1,
                computed: u32::MAX,
            })),
        ),
        (
            "error too many instances",
            Err(LinkError::TooManyInstances {
                task: 1,
                needed: 200,
                available: 3,
            }),
        ),
        (
            "error capacity exceeded",
            Err(LinkError::CapacityExceeded {
                what: Capacity::Nets,
                needed: 400,
                available: 24,
            }),
        ),
        ("error no mission", Err(LinkError::NoMission)),
        ("error busy", Err(LinkError::Busy)),
        (
            "error net type differs",
            Err(LinkError::NetTypeDiffers { task: 1, port: 2 }),
        ),
        (
            "error parameter out of range",
            Err(LinkError::ParamOutOfRange { task: 1, param: 2 }),
        ),
        ("error on trial", Err(LinkError::OnTrial)),
        ("error not on trial", Err(LinkError::NotOnTrial)),
        (
            "challenge",
            Ok(Response::Challenge {
                nonce: [0xc3; NONCE_BYTES],
                counter: 1 << 40,
            }),
        ),
        (
            "identity",
            Ok(Response::Identity(Identity {
                key: [0x11; KEY_BYTES],
                salt: [0x22; SALT_BYTES],
                nonce: [0x77; NONCE_BYTES],
                counter: 1 << 40,
                proof: [0x88; PROOF_BYTES],
            })),
        ),
        ("error needs key", Err(LinkError::NeedsKey)),
        ("error not signed", Err(LinkError::NotSigned)),
        ("error wrong signature", Err(LinkError::WrongSignature)),
        (
            "error old counter",
            Err(LinkError::OldCounter { last: u64::MAX }),
        ),
        ("error no challenge", Err(LinkError::NoChallenge)),
        ("error no key", Err(LinkError::NoKey)),
        ("error no key support", Err(LinkError::NoKeySupport)),
        ("error not kept", Err(LinkError::NotStored)),
        ("error too soon", Err(LinkError::TooSoon { ms: 1000 })),
        ("error flash refused", Err(LinkError::FlashRefused)),
        ("error other mission", Err(LinkError::OtherMission)),
        (
            "error parameter without a value",
            Err(LinkError::ParamNoValue),
        ),
        (
            "error parameter outside",
            Err(LinkError::ParamOutside {
                min: 1,
                max: u32::MAX,
            }),
        ),
        (
            "error too many parameters",
            Err(LinkError::TooManyParams { available: 8 }),
        ),
        ("error not built in", Err(LinkError::NotBuiltIn)),
        ("error no store", Err(LinkError::NoStore)),
        ("error emergency stopped", Err(LinkError::EmergencyStopped)),
        ("error stop not kept", Err(LinkError::StopNotStored)),
        ("error late", Err(LinkError::Late)),
        ("error no session", Err(LinkError::NoSession)),
        ("error wrong proof", Err(LinkError::WrongProof)),
        (
            "error counter too far",
            Err(LinkError::CounterTooFar { last: 1 << 40 }),
        ),
        ("error deadline too far", Err(LinkError::DeadlineTooFar)),
        ("error flash budget", Err(LinkError::FlashBudget { s: 120 })),
        ("clock", Ok(Response::Clock { now_us: u64::MAX })),
        (
            "features",
            Ok(Response::Features {
                built_in: Features::NONE
                    .with(Feature::Record, true)
                    .with(Feature::Keys, true),
                flash_ms: 300,
            }),
        ),
        ("behaviour", Ok(Response::Behaviour { key: 300 })),
        (
            "behaviour list",
            Ok(Response::BehaviourList {
                script: ScriptStatus {
                    script: 0xfeed_beef,
                    steps: 8,
                    ended: 2,
                    state: ScriptState::Suspended,
                },
                entries: entries.as_flattened(),
            }),
        ),
        (
            "frame counters",
            Ok(Response::Frame(FrameCounters {
                passed: 1 << 20,
                missing: 300,
                repeated: 2,
                older: 3,
                link_errors: u32::MAX,
                link_dropped: 5,
            })),
        ),
        ("error no behaviours", Err(LinkError::NoBehaviours)),
        ("error not a behaviour", Err(LinkError::NotABehaviour)),
        ("error list full", Err(LinkError::ListFull)),
        ("error not on list", Err(LinkError::NotOnList)),
        ("error no script", Err(LinkError::NoScript)),
        ("error no situation", Err(LinkError::NoSituation)),
        ("error too fast", Err(LinkError::TooFast)),
        ("error position outside", Err(LinkError::PositionOutside)),
        ("error no position", Err(LinkError::NoPosition)),
        (
            "error payload differs",
            Err(LinkError::PayloadDiffers {
                frame: 3,
                needed: 300,
            }),
        ),
        (
            "error too many frames",
            Err(LinkError::CapacityExceeded {
                what: Capacity::Frames,
                needed: 129,
                available: 128,
            }),
        ),
        (
            "error too many steps",
            Err(LinkError::CapacityExceeded {
                what: Capacity::ScriptSteps,
                needed: 17,
                available: 16,
            }),
        ),
    ];
    for ((name, result), seq) in answers.into_iter().zip(100..) {
        write_frame(
            text,
            &format!("answer {name}"),
            &FromDevice::Reply { seq, result, of: 5 },
        );
    }
    write_frame(
        text,
        "proven answer done",
        &FromDevice::Proven {
            seq: 200,
            proof: [0x99; PROOF_BYTES],
            result: Ok(Response::Done),
            of: Request::Stop.kind(),
        },
    );
    write_frame(
        text,
        "answer to what is no request",
        &FromDevice::Reply {
            seq: 201,
            result: Err(LinkError::Malformed),
            of: UNKNOWN,
        },
    );
    let streams = [
        (
            "stream trace",
            Stream {
                channel: Channel::Trace,
                seq: 255,
                continues: true,
                dropped: 300,
                bytes: &[3, 1, 3, 2],
            },
        ),
        (
            "stream log",
            Stream {
                channel: Channel::Log,
                seq: 0,
                continues: false,
                dropped: 0,
                bytes: &part[..MAX_STREAM_BYTES],
            },
        ),
    ];
    // Of three nets, the second of which holds nothing: -0.5 and true, then -3.
    let words: [u32; 7] = [
        7 | 2 << 16,
        0b101,
        3,
        1 << 8,
        (-0.5_f32).to_bits(),
        1,
        (-3_i32).cast_unsigned(),
    ];
    let values: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    let mut ended = [0; 16];
    ended[..2].copy_from_slice(&[7, 1]);
    let values = [
        ("stream values", 255, 300, &values[..]),
        ("stream values that have ended", 0, 301, &ended[..]),
    ];
    let values = values.map(|(name, seq, dropped, bytes)| {
        let stream = Stream {
            channel: Channel::Values,
            seq,
            continues: false,
            dropped,
            bytes,
        };
        (name, stream)
    });
    for (name, stream) in streams.into_iter().chain(values) {
        write_frame(text, name, &FromDevice::Stream(stream));
    }
    let news = StatusEvent {
        seq: 255,
        cause: Cause::Trial,
        mode: Mode::Running,
        mission: Some(0x1234_abcd),
        on_trial: true,
        fell_back: Some(FallBack {
            mission: 0x1234_abce,
            reason: FallBackReason::Failed(SafeReason::Overruns),
        }),
        steps: 300,
        t_us: 1 << 40,
        executed: 1000,
        missed: 1,
        overruns: 2,
        max_delay_ns: 16_384,
        corrupt_frames: 3,
    };
    write_frame(text, "news", &FromDevice::StatusEvent(news));
    let stopped = StatusEvent {
        cause: Cause::Mode,
        mode: Mode::EmergencyStopped,
        ..news
    };
    write_frame(
        text,
        "news of an emergency stop",
        &FromDevice::StatusEvent(stopped),
    );
    // The beginning that never changes, and what only a later version knows.
    write_frame(
        text,
        "answer hello of version 300",
        &(0u8, 9u8, 0u8, 0u8, 300u16, [0xffu8; 4]),
    );
}

/// What a receiver gets out of bytes: messages, in hexadecimal.
fn received(bytes: &[u8]) -> Vec<String> {
    /// Takes any message.
    struct Any;
    impl<'de> serde::Deserialize<'de> for Any {
        fn deserialize<D: serde::Deserializer<'de>>(_: D) -> Result<Self, D::Error> {
            Ok(Any)
        }
    }
    let mut reader = FrameReader::new();
    let mut messages = Vec::new();
    for &byte in bytes {
        let Some(frame) = reader.push(byte) else {
            continue;
        };
        let encoded = [&frame[..], &[0]].concat();
        // Nothing is read of it, so that bytes are left over: but for these it was right.
        use esm_link::frame::FrameError::NotAMessage;
        if matches!(decode::<Any>(frame), Ok(_) | Err(NotAMessage)) {
            messages.push(hex(&message_of(&encoded)));
        }
    }
    messages
}

fn write_spoiled(text: &mut String) {
    let good = frame_of(&ToDevice {
        seq: 1,
        request: Request::Status,
    });
    let longest = frame_of(&ToDevice {
        seq: 2,
        request: Request::Chunk {
            offset: 1,
            data: &junk(MAX_CHUNK),
        },
    });
    let flipped = |at: usize| {
        let mut frame = good.clone();
        frame[at] ^= 0x10;
        frame
    };
    let cases: [(&str, Vec<u8>); 9] = [
        ("empty frames", [&[0; 5][..], &good].concat()),
        (
            "a frame without its beginning",
            [&good[2..], &good].concat(),
        ),
        (
            "a frame without its end, and the next with a delimiter in front",
            [&good[..3], &[0], &good].concat(),
        ),
        (
            "a frame without its end, and the next without a delimiter in front",
            [&good[..3], &good, &good].concat(),
        ),
        ("a changed byte", [flipped(3), good.clone()].concat()),
        ("a changed length", [flipped(0), good.clone()].concat()),
        (
            "noise that is longer than a frame can be",
            [&[0x55; MAX_FRAME_BYTES + 100][..], &[0], &good].concat(),
        ),
        (
            "noise without an end, and the longest frame behind its delimiter",
            [&[0xff; 30][..], &[0], &longest].concat(),
        ),
        (
            "a checksum without a message",
            [&[1, 1, 1, 1, 1, 0][..], &good].concat(),
        ),
    ];
    for (name, bytes) in cases {
        let _ = writeln!(text, "\nspoiled {name}\nbytes {}", hex(&bytes));
        for message in received(&bytes) {
            let _ = writeln!(text, "message {message}");
        }
    }
}

fn test_key() -> SigningKey {
    SigningKey::of(TEST_KEY)
}

fn write_signed(text: &mut String) {
    let key = test_key();
    let public = key.public().0;
    let _ = writeln!(
        text,
        "\nkey for tests only\nprivate {}\npublic {}\nsalt {}",
        hex(TEST_KEY),
        hex(&public),
        hex(&TEST_SALT)
    );
    let secret = key.secret(&TEST_SALT);
    let blob = junk(100);
    let counter = 300u64.to_le_bytes();
    let upload = key.sign(&access::upload(&TEST_SALT, &counter, &blob));
    let nonce = [0xc3; NONCE_BYTES];
    let start = bytes_of(Request::Start);
    let commit = bytes_of(Request::Commit(Swap {
        warm: true,
        trial_ms: 10_000,
    }));
    let cases: [(&str, &[&[u8]]); 4] = [
        ("key", &access::install(&public, &TEST_SALT, &secret.0)),
        ("upload", &access::upload(&TEST_SALT, &counter, &blob)),
        ("start", &access::command(&nonce, &NO_UPLOAD, &start)),
        ("commit", &access::command(&nonce, &upload, &commit)),
    ];
    for (name, message) in cases {
        let _ = writeln!(
            text,
            "\nsigned {name}\nmessage {}\nsignature {}",
            hex(&message.concat()),
            hex(&key.sign(message))
        );
    }
    write_proofs(text, &public, secret);
}

fn write_proofs(text: &mut String, public: &[u8; KEY_BYTES], secret: Secret) {
    let (client, robot) = ([0x66; NONCE_BYTES], [0x77; NONCE_BYTES]);
    let session = secret.keyed().session(&client, &robot);
    let _ = writeln!(
        text,
        "\nsession for tests only\nsecret {}\nclient {}\nrobot {}\nsession {}",
        hex(&secret.0),
        hex(&client),
        hex(&robot),
        hex(session.key())
    );
    let counter = 300u64;
    let identity = secret
        .keyed()
        .of_identity(&client, public, &TEST_SALT, &robot, counter);
    let (number, number_bytes) = (70_000u32, 70_000u32.to_le_bytes());
    let request = bytes_of(Request::Stop);
    // As it is behind the proof: that it is no error, that it is done, and of what.
    let answer = [0, 3, Request::Stop.kind()];
    let masked = mask(Secret([0; SECRET_BYTES]), &session, &TEST_SALT);
    let (of_robot, of_session) = (&secret.0[..], &session.key()[..]);
    // Name, key, pieces of the message, proof.
    type Case<'a> = (&'a str, &'a [u8], &'a [&'a [u8]], [u8; PROOF_BYTES]);
    let cases: [Case<'_>; 5] = [
        (
            "identity",
            of_robot,
            &[
                b"esm identity v1\0",
                &client,
                public,
                &TEST_SALT,
                &robot,
                &counter.to_le_bytes(),
            ],
            identity,
        ),
        (
            "opening",
            of_session,
            &[b"esm opening v1\0\0"],
            session.opening(),
        ),
        (
            "request",
            of_session,
            &[b"esm request v1\0\0", &number_bytes, &request],
            session.of_request(number, &request),
        ),
        (
            "answer",
            of_session,
            &[b"esm answer v1\0\0\0", &number_bytes, &answer],
            session.of_answer(number, &answer),
        ),
        (
            "mask",
            of_session,
            &[b"esm mask v1\0\0\0\0\0", &TEST_SALT],
            masked.0,
        ),
    ];
    for (name, key, message, proof) in cases {
        let _ = writeln!(
            text,
            "\nproof {name}\nkey {}\nmessage {}\nproof {}",
            hex(key),
            hex(&message.concat()),
            hex(&proof)
        );
    }
}

/// A request as it is within [`Request::Signed`].
fn bytes_of(request: Request<'_>) -> Vec<u8> {
    held(&request)
}

/// Writes what goes over a robot's line.
struct Exchange<'t, 'b, 'q, 'm, 'w> {
    text: &'t mut String,
    robot: &'b mut Bench<'q, 'm, 'w>,
    seq: u8,
    /// The client of this session knows what the firmware was built with.
    knows_features: bool,
    /// The session of the robot's owner, in which requests go if there is one.
    owner: Option<Owner>,
    /// Sessions that were opened.
    sessions: u32,
}

impl Exchange<'_, '_, '_, '_, '_> {
    fn line(&mut self, mark: char, bytes: &[u8]) {
        if !bytes.is_empty() {
            let _ = writeln!(self.text, "{mark} {}", hex(bytes));
        }
    }

    fn next(&mut self, request: Request<'_>) -> Vec<u8> {
        self.knows_features &= request != Request::Hello;
        match self.owner.as_mut().filter(|_| may_be_proven(&request)) {
            Some(owner) => {
                let proven = owner.prove(&request);
                self.plain_next(proven.request())
            }
            None => self.plain_next(request),
        }
    }

    fn plain_next(&mut self, request: Request<'_>) -> Vec<u8> {
        self.seq += 1;
        let seq = self.seq;
        [&[0][..], &frame_of(&ToDevice { seq, request })].concat()
    }

    /// Opens a session as the owner of this key.
    fn open_session(&mut self, key: &SigningKey) {
        self.sessions += 1;
        let mut client = [0; NONCE_BYTES];
        client.copy_from_slice(format!("client nonce {:03}", self.sessions).as_bytes());
        let mut frame = self.answer(Request::Identify { nonce: client });
        let Ok(FromDevice::Reply {
            result: Ok(Response::Identity(identity)),
            ..
        }) = decode(&mut frame)
        else {
            panic!("the robot has a key");
        };
        let owner = Owner::of(key, &client, &identity);
        self.ask(owner.opening(client, &identity));
        self.owner = Some(owner);
    }

    /// Somebody else sends a request.
    fn ask_by_anyone(&mut self, request: Request<'_>) {
        let owner = self.owner.take();
        self.ask(request);
        self.owner = owner;
    }

    fn poll(&mut self) -> Vec<u8> {
        self.robot.wire.now_us = self.robot.world.now_us();
        while self.robot.link.poll(&mut self.robot.wire) {}
        self.robot.wire.to_host.drain(..).collect()
    }

    /// Bytes arrive, and nothing is answered yet.
    fn send(&mut self, bytes: &[u8]) {
        self.line('>', bytes);
        self.robot.wire.to_robot.extend(bytes);
    }

    /// Writes what the robot says, which runs until it says something.
    fn hear(&mut self) -> Vec<u8> {
        for _ in 0..1_000 {
            let heard = self.poll();
            if !heard.is_empty() {
                self.line('<', &heard);
                return heard;
            }
            let next_us = self.robot.timer() / super::robot::TICKS_PER_US;
            let passed_us = next_us.saturating_sub(self.robot.world.now_us());
            self.robot.world.pass_us(passed_us);
        }
        panic!("the robot says nothing");
    }

    fn ask(&mut self, request: Request<'_>) {
        self.answer(request);
    }

    /// Asks; returns the last message of what the robot says.
    fn answer(&mut self, request: Request<'_>) -> Vec<u8> {
        let bytes = self.next(request);
        self.send(&bytes);
        let heard = self.hear();
        let last = heard.strip_suffix(&[0]).unwrap().rsplit(|byte| *byte == 0);
        last.into_iter().next().unwrap().to_vec()
    }

    /// What the firmware was built with, which a client asks for once a session, before the first
    /// request that may have the robot write its flash.
    fn features(&mut self) {
        if !self.knows_features {
            self.ask(Request::Features);
            self.knows_features = true;
        }
    }

    /// A request that is good for as long as a client waits for its answer, by the robot's clock,
    /// for which it asks.
    fn in_time(&mut self, request: Request<'_>) -> Vec<u8> {
        const PATIENCE_US: u64 = 6_000_000;
        if matches!(request, Request::Commit(_)) {
            self.features();
        }
        let mut frame = self.answer(Request::Clock);
        let Ok(
            FromDevice::Reply {
                result: Ok(Response::Clock { now_us }),
                ..
            }
            | FromDevice::Proven {
                result: Ok(Response::Clock { now_us }),
                ..
            },
        ) = decode(&mut frame)
        else {
            panic!("the robot has a clock");
        };
        bytes_of(Request::Within {
            by_us: now_us + PATIENCE_US,
            request: &bytes_of(request),
        })
    }

    /// Asks for something that changes what the robot does, as clients do.
    fn command(&mut self, request: Request<'_>) {
        let request = self.in_time(request);
        self.ask(postcard::from_bytes(&request).unwrap());
    }

    /// The same of a robot with the test key.
    fn command_signed(&mut self, upload: &[u8; SIGNATURE_BYTES], request: Request<'_>) {
        let request = self.in_time(request);
        self.ask_signed(&test_key(), upload, &request);
    }

    /// Asks for a nonce.
    fn challenge(&mut self) -> ([u8; NONCE_BYTES], u64) {
        let frame = self.answer(Request::Challenge);
        match decode(&mut frame.clone()) {
            Ok(FromDevice::Proven {
                result: Ok(Response::Challenge { nonce, counter }),
                ..
            }) => (nonce, counter),
            other => panic!("{other:?}"),
        }
    }

    /// Asks for a nonce and has a request carried out that some key signs with it.
    fn ask_signed(&mut self, key: &SigningKey, upload: &[u8; SIGNATURE_BYTES], request: &[u8]) {
        let (nonce, _) = self.challenge();
        let signature = key.sign(&access::command(&nonce, upload, request));
        self.ask(Request::Signed {
            signature: &signature,
            request,
        });
    }

    /// Gives the robot the test key.
    fn install_key(&mut self) {
        self.features();
        self.ask(Installation::of(&test_key(), TEST_SALT).request());
        self.ask(Request::Hello);
    }

    /// Brings a mission, which is not to run yet.
    fn stage(&mut self, blob: &[u8]) {
        self.ask(begin(blob));
        let mut there = 0;
        while there < blob.len() {
            let end = blob.len().min(there + MAX_CHUNK);
            self.ask(chunk(blob, there..end));
            there = end;
        }
    }

    /// Signs a mission that was brought, with the number behind the last one.
    fn sign(&mut self, blob: &[u8]) -> [u8; SIGNATURE_BYTES] {
        let (_, last) = self.challenge();
        let counter = last + 1;
        let signature = test_key().sign(&access::upload(&TEST_SALT, &counter.to_le_bytes(), blob));
        self.ask(Request::Sign {
            counter,
            signature: &signature,
        });
        signature
    }

    fn lose(&mut self, request: Request<'_>) {
        let bytes = self.next(request);
        self.line('x', &bytes);
    }

    fn pass_us(&mut self, us: u64) {
        let _ = writeln!(self.text, "t {us}");
        let until_us = self.robot.world.now_us() + us;
        let mut heard = Vec::new();
        while self.robot.world.now_us() < until_us {
            let next_us = self.robot.timer() / super::robot::TICKS_PER_US;
            heard.extend(self.poll());
            let now_us = self.robot.world.now_us();
            self.robot.world.pass_us(next_us.min(until_us) - now_us);
        }
        self.line('<', &heard);
    }
}

fn exchange(text: &mut String, name: &str, happen: impl FnOnce(&mut Exchange<'_, '_, '_, '_, '_>)) {
    let _ = writeln!(text, "\nexchange {name}");
    with_robot(|robot| {
        happen(&mut Exchange {
            text,
            robot,
            seq: 0,
            knows_features: false,
            owner: None,
            sessions: 0,
        });
    });
}

fn begin(blob: &[u8]) -> Request<'static> {
    Request::Begin {
        len: blob.len() as u32,
        crc: checksum(blob),
    }
}

fn chunk(blob: &[u8], range: std::ops::Range<usize>) -> Request<'_> {
    Request::Chunk {
        offset: range.start as u32,
        data: &blob[range],
    }
}

fn write_exchanges(text: &mut String) {
    exchange(text, "a robot without a mission", |line| {
        line.ask(Request::Hello);
        line.ask(Request::Status);
        line.ask(Request::ReadBlob { offset: 0 });
        line.ask(Request::Task {
            index: 0,
            offset: 0,
        });
        line.ask(Request::Task {
            index: 99,
            offset: 0,
        });
        line.ask(Request::Abort);
    });
    exchange(text, "what the firmware was built with", |line| {
        line.ask(Request::Hello);
        line.features();
    });
    let junk = junk(700);
    exchange(text, "an upload of 700 bytes that are no mission", |line| {
        line.ask(Request::Hello);
        line.ask(begin(&junk));
        for range in [0..176, 176..352, 352..528, 528..700] {
            line.ask(chunk(&junk, range));
        }
        line.command(Request::Commit(Swap::default()));
        line.ask(Request::Abort);
    });
    exchange(text, "an upload of 700 bytes with chunks ahead", |line| {
        line.ask(Request::Hello);
        line.ask(begin(&junk));
        for range in [0..176, 176..352, 352..528] {
            let bytes = line.next(chunk(&junk, range));
            line.send(&bytes);
        }
        line.hear();
        line.ask(chunk(&junk, 528..700));
        line.ask(Request::Abort);
    });
    exchange(
        text,
        "an upload of 700 bytes whose second chunk is lost",
        |line| {
            line.ask(Request::Hello);
            line.ask(begin(&junk));
            line.ask(chunk(&junk, 0..176));
            line.lose(chunk(&junk, 176..352));
            line.ask(chunk(&junk, 352..528));
            // Shorter ones, that grow as they pass.
            for range in [176..287, 287..406, 406..535, 535..674, 674..700] {
                line.ask(chunk(&junk, range));
            }
            line.ask(Request::Abort);
        },
    );
    exchange(text, "an upload that goes on where it was", |line| {
        line.ask(Request::Hello);
        line.ask(begin(&junk));
        line.ask(chunk(&junk, 0..176));
        // Another client.
        line.ask(Request::Hello);
        line.ask(begin(&junk));
        for range in [176..352, 352..528, 528..700] {
            line.ask(chunk(&junk, range));
        }
        line.ask(Request::Abort);
    });
    exchange(text, "a request that is sent again", |line| {
        line.ask(Request::Hello);
        let begin = line.next(begin(&junk));
        for _ in 0..2 {
            line.send(&begin);
            line.hear();
        }
        let stop = line.next(Request::Stop);
        for _ in 0..2 {
            line.send(&stop);
            line.hear();
        }
    });
    exchange(text, "noise, and requests that are none", |line| {
        line.send(&[0x55; 300]);
        line.ask(Request::Status);
        let unknown = [&[0][..], &frame_of(&(2u8, 200u8, 1u8))].concat();
        line.send(&unknown);
        line.hear();
        let longer = [&[0][..], &frame_of(&(3u8, 5u8, 0u8))].concat();
        line.send(&longer);
        line.hear();
        line.seq = 3;
        line.ask(Request::Status);
    });
    let blob = counting(3).blob();
    exchange(text, "a mission, its trace, a stop", |line| {
        line.ask(Request::Hello);
        line.ask(Request::Subscribe {
            trace: true,
            log: false,
            record: false,
        });
        line.stage(&blob);
        line.command(Request::Commit(Swap::default()));
        line.pass_us(45_000);
        line.ask(Request::Status);
        line.ask(Request::States { first: 0 });
        line.ask(Request::SlotCounters { slot: 1 });
        line.ask(Request::TaskCounters { task_instance: 0 });
        line.ask(Request::Stop);
        line.ask(Request::Status);
        line.command(Request::Start);
        line.ask(Request::Subscribe {
            trace: false,
            log: false,
            record: false,
        });
    });
    let blob = super::warm::listening(1, false);
    exchange(text, "values of a mission, and their end", |line| {
        line.ask(Request::Hello);
        line.stage(&blob);
        line.command(Request::Commit(Swap::default()));
        let mission = super::mission::hash(&blob);
        line.ask(Request::Values {
            ask: &super::values::ask_fields(mission, 0, 0),
        });
        line.ask(Request::Values {
            ask: &super::values::ask_values(mission, 20, &[0]),
        });
        line.pass_us(100_000);
        line.ask(Request::Values { ask: &[] });
    });
    exchange(text, "requests that come too late", |line| {
        line.ask(Request::Hello);
        // In time, then sent again after it: a stop is looked at anew each time that it comes.
        let stop = bytes_of(Request::Stop);
        let in_time = line.in_time(Request::Stop);
        let bytes = line.next(postcard::from_bytes(&in_time).unwrap());
        line.send(&bytes);
        line.hear();
        line.pass_us(7_000_000);
        line.send(&bytes);
        line.hear();
        // The same under another number, and one that is late by a microsecond or more.
        line.ask(postcard::from_bytes(&in_time).unwrap());
        line.ask(Request::Within {
            by_us: 0,
            request: &stop,
        });
        // What must not have a deadline.
        line.ask(Request::Within {
            by_us: u64::MAX,
            request: &bytes_of(Request::Hello),
        });
        line.ask(Request::Within {
            by_us: u64::MAX,
            request: &in_time,
        });
    });
    write_exchanges_with_keys(text);
}

fn write_exchanges_with_keys(text: &mut String) {
    let blob = counting(3).blob();
    let commit = bytes_of(Request::Commit(Swap::default()));
    let start = bytes_of(Request::Start);
    exchange(text, "a key, an upload and a start that it signs", |line| {
        line.robot.wire.safe = Some(Safe::default());
        line.ask(Request::Hello);
        line.install_key();
        line.open_session(&test_key());
        line.stage(&blob);
        let upload = line.sign(&blob);
        line.command_signed(&upload, Request::Commit(Swap::default()));
        line.ask(Request::Stop);
        line.command_signed(&NO_UPLOAD, Request::Start);
        line.ask(Request::Status);
        line.features();
        line.ask_signed(&test_key(), &NO_UPLOAD, &bytes_of(Request::RemoveKey));
        line.owner = None;
        line.ask(Request::Hello);
    });
    exchange(text, "what a robot with a key refuses", |line| {
        line.robot.wire.safe = Some(Safe::default());
        line.ask(Request::Hello);
        line.install_key();
        // What only its owner may: by somebody else, and by its owner without a signature.
        line.ask(Request::Start);
        line.ask(begin(&blob));
        line.ask(Request::Challenge);
        line.ask(Request::Identify {
            nonce: *b"somebody's nonce",
        });
        line.ask(Request::OpenSession {
            client: *b"somebody's nonce",
            robot: [0; NONCE_BYTES],
            proof: [0; PROOF_BYTES],
        });
        line.ask(Request::Proven {
            number: 1,
            proof: [0; PROOF_BYTES],
            request: &start,
        });
        line.open_session(&test_key());
        line.ask(Request::Start);
        line.ask_by_anyone(Request::Abort);
        line.ask_by_anyone(Request::Proven {
            number: 2,
            proof: [0; PROOF_BYTES],
            request: &start,
        });
        // Signed with another key; then too soon after that.
        line.ask_signed(&SigningKey::of(OTHER_KEY), &NO_UPLOAD, &start);
        line.ask_signed(&test_key(), &NO_UPLOAD, &start);
        line.pass_us(1_000_000);
        // The same bytes as one that was carried out, first without a nonce, then with another.
        let (nonce, _) = line.challenge();
        let signature = test_key().sign(&access::command(&nonce, &NO_UPLOAD, &start));
        let signed = Request::Signed {
            signature: &signature,
            request: &start,
        };
        line.ask(signed);
        line.ask(signed);
        line.challenge();
        line.ask(signed);
        line.pass_us(1_000_000);
        // An upload that its owner commits without having signed it; one with the number of the
        // last; one of other bytes.
        line.stage(&blob);
        line.ask(Request::Commit(Swap::default()));
        line.ask_signed(&test_key(), &NO_UPLOAD, &commit);
        line.pass_us(1_000_000);
        line.stage(&blob);
        let upload = line.sign(&blob);
        line.ask_signed(&test_key(), &upload, &commit);
        line.stage(&blob);
        line.ask(Request::Sign {
            counter: 1,
            signature: &upload,
        });
        line.ask(Request::Sign {
            counter: 2 + access::MAX_COUNTER_STEP,
            signature: &upload,
        });
        line.ask(Request::Sign {
            counter: 2,
            signature: &upload,
        });
        // A signature that comes too late, and a deadline that is too far.
        line.pass_us(1_000_000);
        let (nonce, _) = line.challenge();
        line.pass_us(access::NONCE_LIFE_US + 1);
        let signature = test_key().sign(&access::command(&nonce, &NO_UPLOAD, &start));
        line.ask(Request::Signed {
            signature: &signature,
            request: &start,
        });
        line.ask(Request::Within {
            by_us: u64::MAX,
            request: &bytes_of(Request::Status),
        });
        line.ask(Request::Status);
    });
}

#[test]
fn the_vectors_are_what_the_firmware_does() {
    const { assert!(MAX_MESSAGE_BYTES + CRC_BYTES < 254) };
    let mut text = HEAD.to_owned();
    write_frames(&mut text);
    write_spoiled(&mut text);
    write_signed(&mut text);
    write_exchanges(&mut text);
    let file = root().join(FILE);
    if std::env::var_os("ESM_BLESS").is_some() {
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(&file, &text).unwrap();
    }
    let kept = std::fs::read_to_string(&file).unwrap();
    for (number, (kept, now)) in kept.lines().zip(text.lines()).enumerate() {
        assert_eq!(
            kept,
            now,
            "{FILE}:{}: the protocol has changed; if that is meant, so has its version, and ESM_BLESS=1 writes the vectors again",
            number + 1
        );
    }
    assert_eq!(kept.lines().count(), text.lines().count());
}

#[test]
fn the_page_about_the_protocol_has_the_numbers_of_the_code() {
    use esm_link::frame::{MAX_REPLY_BYTES, MAX_REPLY_FRAME_BYTES};
    use esm_link::message::PROTOCOL_VERSION;
    use esm_link::telemetry::{MAX_ASK_BYTES, MAX_VALUE_WORDS};

    let page = std::fs::read_to_string(root().join("docs/link.md")).unwrap();
    let hello = frame_of(&ToDevice {
        seq: 7,
        request: Request::Hello,
    });
    let spaced: Vec<String> = hello.iter().map(|byte| format!("{byte:02x}")).collect();
    for told in [
        format!("version {PROTOCOL_VERSION}\n"),
        format!(
            "| message | 1 to {MAX_MESSAGE_BYTES} | see below; a robot never sends more than {MAX_REPLY_BYTES} |"
        ),
        format!(
            "at most **{MAX_FRAME_BYTES}** with its delimiter; one from a robot has at most **{MAX_REPLY_FRAME_BYTES}**"
        ),
        format!("frame     {}\n", spaced.join(" ")),
        format!("| `Chunk` 🔒 | `offset: u32`, `data: bytes`, at most {MAX_CHUNK} |"),
        format!(
            "`request: bytes`, at most {}: a request without a number",
            access::MAX_SIGNED_BYTES
        ),
        format!(
            "`request: bytes`, at most {}: a request without a message's",
            access::MAX_PROVEN_BYTES
        ),
        format!("`text: bytes`, at most {MAX_PART} from the offset"),
        format!("| `bytes` | bytes | at most {MAX_STREAM_BYTES} |"),
        format!("A window of {} bytes", 3 * MAX_CHUNK),
        format!("at most **{MAX_VALUE_WORDS}** nets"),
        format!("**{MAX_VALUE_WORDS}** words"),
        format!("`ask: bytes`, at most {MAX_ASK_BYTES}:"),
    ] {
        assert!(page.contains(&told), "docs/link.md does not say {told:?}");
    }
    for (bit, feature) in Feature::ALL.into_iter().enumerate() {
        let told = format!("\n| {bit} | `{}` | ", feature.name());
        assert!(page.contains(&told), "docs/link.md does not say {told:?}");
    }
}
