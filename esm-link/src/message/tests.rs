//! The greatest messages, and what is read out of counters.

use super::status_event::Cause;
use super::trial::{FallBack, FallBackReason, Trial};
use super::*;
use crate::access::{
    Access, KEY_BYTES, MAX_PROVEN_BYTES, MAX_SIGNED_BYTES, NONCE_BYTES, PROOF_BYTES, SALT_BYTES,
    SECRET_BYTES, SIGNATURE_BYTES,
};
use crate::behaviours::BehaviourRequest;
use crate::features::Features;
use crate::frame::{MAX_FRAME_BYTES, MAX_REPLY_FRAME_BYTES, encode};
use crate::telemetry::MAX_ASK_BYTES;

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
fn the_kind_of_a_request_is_its_number_in_a_message() {
    let bytes: [u8; 16] = [1; 16];
    let all = [
        Request::Hello,
        Request::Begin { len: 0, crc: 0 },
        Request::Chunk {
            offset: 0,
            data: &bytes,
        },
        Request::Commit(Swap::default()),
        Request::Abort,
        Request::Status,
        Request::Stop,
        Request::Start,
        Request::Task {
            index: 0,
            offset: 0,
        },
        Request::ReadBlob { offset: 0 },
        Request::States { first: 0 },
        Request::SlotCounters { slot: 0 },
        Request::Subscribe {
            trace: false,
            log: false,
            record: false,
        },
        Request::TaskCounters { task_instance: 0 },
        Request::Confirm { mission: 0 },
        Request::FallBack { mission: 0 },
        Request::CrashReport,
        Request::BlackBox { from: None },
        Request::Challenge,
        Request::Signed {
            signature: &bytes,
            request: &bytes,
        },
        Request::Sign {
            counter: 0,
            signature: &bytes,
        },
        Request::InstallKey {
            key: &bytes,
            salt: &bytes,
            secret: &bytes,
            signature: &bytes,
        },
        Request::RemoveKey,
        Request::Param {
            mission: 0,
            param: 0,
        },
        Request::SetParam {
            mission: 0,
            param: 0,
            value: 0,
        },
        Request::Watch {
            news: false,
            period_ms: 0,
        },
        Request::SaveParams { mission: 0 },
        Request::EmergencyStop,
        Request::Release,
        Request::Clock,
        Request::Within {
            by_us: 0,
            request: &bytes,
        },
        Request::Features,
        Request::Values { ask: &bytes },
        Request::Identify { nonce: bytes },
        Request::OpenSession {
            client: bytes,
            robot: bytes,
            proof: bytes,
        },
        Request::Proven {
            number: 0,
            proof: bytes,
            request: &bytes,
        },
        Request::BehaviourList,
        Request::Behaviours(BehaviourRequest::EndScript),
        Request::Drive {
            forward_m_per_s: 0.0,
            turn_rad_per_s: 0.0,
            until_us: 0,
        },
        Request::EndDrive,
        Request::Selftest { ask: &bytes },
        Request::FrameCounters { frame: 0 },
    ];
    let mut room = [0; MAX_FRAME_BYTES];
    for (request, number) in all.into_iter().zip(0..) {
        let message = postcard::to_slice(&request, &mut room).expect("it fits");
        assert_eq!(
            (message[0], request.kind()),
            (number, number),
            "{request:?}"
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
        kept: Some(StoreStatus {
            runs: Source::Firmware,
            slots: [BankState::NoRoom { len: u32::MAX }; 2],
        }),
        changed_params: u8::MAX,
        saved_params: u8::MAX,
        record_dropped: u32::MAX,
        record_pending: true,
        stop_pressed: true,
        flash: Some(FlashHealth {
            records: KeyValuesState::Unreadable(WayIn::Erase),
            flaws: u16::MAX,
            mission_erases: u32::MAX,
            record_erases: u32::MAX,
        }),
    };
    let signature = [0xa5; SIGNATURE_BYTES];
    let install = Request::InstallKey {
        key: &[0xa5; KEY_BYTES],
        salt: &[0xa5; SALT_BYTES],
        secret: &[0xa5; SECRET_BYTES],
        signature: &signature,
    };
    let mut room = [0; MAX_SIGNED_BYTES];
    let request = postcard::to_slice(&install, &mut room).expect("it fits");
    let within = Request::Within {
        by_us: u64::MAX,
        request,
    };
    let mut signed = [0; MAX_SIGNED_BYTES];
    assert!(postcard::to_slice(&within, &mut signed).is_ok());
    let longest = Request::Signed {
        signature: &signature,
        request: &signed,
    };
    let mut proven = [0; MAX_PROVEN_BYTES];
    assert!(postcard::to_slice(&longest, &mut proven).is_ok());
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
        Request::Proven {
            number: u32::MAX,
            proof: [0xa5; PROOF_BYTES],
            request: &proven,
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
        },
        Response::Identity(Identity {
            key: [0xa5; KEY_BYTES],
            salt: [0xa5; SALT_BYTES],
            nonce: [0xa5; NONCE_BYTES],
            counter: u64::MAX,
            proof: [0xa5; PROOF_BYTES],
        }),
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
        Response::CrashReport {
            words: CrashReport {
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
            file: &part[..MAX_PLACE_BYTES],
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
                &FromDevice::Proven {
                    seq: 255,
                    proof: [0xa5; PROOF_BYTES],
                    result: Ok(response),
                    of: UNKNOWN,
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
    let news = StatusEvent {
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
        corrupt_frames: u32::MAX,
    };
    // The room of a stream's part.
    let room = &mut frame[..MAX_STREAM_BYTES];
    assert_eq!(encode(&FromDevice::StatusEvent(news), room), Ok(71));
}
