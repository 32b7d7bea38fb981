//! Defects that tests plant into the link, one at a time, to see that they are found. Shipped code
//! has none of this.
//!
//! The laws are what a host may rely on, held by a client that is good and by one that is not, over
//! a line that loses and changes bytes.

use std::collections::VecDeque;
use std::format;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::string::String;
use std::vec::Vec;

use super::device::{LinkPort, LinkSide};
use crate::{About, AnyTaskPool, Board, Limits, Mailbox, Memory, RealTime, split};
use esm_link::access::MAX_DEADLINE_US;
use esm_link::frame::{FrameReader, MAX_FRAME_BYTES, checksum, decode, encode};
use esm_link::key_store::{KeyStore, NotStored, StoredKey, Volatile, WriteError};
use esm_link::message::{FromDevice, Mode, Request, Swap, ToDevice};
use esm_link::mutants::{ALL, Bug, plant};
#[cfg(feature = "telemetry")]
use esm_link::telemetry::MAX_ASK_BYTES;

/// Those that a firmware without keys cannot have.
const OF_KEYS: &[Bug] = &[
    Bug::StopSuppressed,
    Bug::SignedCarriedOutLate,
    Bug::KeyForgotten,
    Bug::UnsignedTaken,
    Bug::CounterRepeated,
    Bug::NonceKept,
    Bug::OthersBytesKept,
    Bug::PauseForgotten,
    Bug::StrangerIsOwner,
    Bug::StrangerHeard,
    Bug::OwnerWaitsInVain,
    Bug::SessionUnproven,
    Bug::SessionReplayed,
    Bug::OldSessionOpened,
    Bug::ProofUnchecked,
    Bug::NumberRepeated,
    Bug::NonceForEver,
    Bug::CounterUnlimited,
];

/// A law that was broken, and how.
type Broken = String;

struct Timer(u64);

impl Board for Timer {
    const TICKS_PER_US: u32 = 1;
    fn now_ticks(&mut self) -> u64 {
        self.0
    }
    fn motors_off(&mut self) {}
}

/// A line, and where the robot keeps its key.
#[derive(Default)]
struct Wire {
    to_robot: VecDeque<u8>,
    to_host: Vec<u8>,
    kept: Volatile,
    now_us: u64,
    /// It takes a byte and no more.
    is_stuck: bool,
    /// How long it takes to find out what a status says.
    status_us: u64,
}

impl LinkPort for Wire {
    fn now_us(&mut self) -> u64 {
        self.now_us
    }

    fn receive(&mut self) -> Option<u8> {
        self.to_robot.pop_front()
    }

    fn send(&mut self, byte: u8) -> bool {
        if self.is_stuck && !self.to_host.is_empty() {
            return false;
        }
        self.to_host.push(byte);
        true
    }

    fn deepest_stack_bytes(&mut self) -> Option<u32> {
        self.now_us += self.status_us;
        None
    }

    fn key_store(&mut self) -> Option<&mut dyn KeyStore> {
        Some(self)
    }
}

impl KeyStore for Wire {
    fn read(&mut self, record: StoredKey, room: &mut [u8]) -> Result<usize, NotStored> {
        self.kept.read(record, room)
    }

    fn write(&mut self, record: StoredKey, bytes: &[u8]) -> Result<(), WriteError> {
        Ok(self.kept.write(record, bytes)?)
    }
}

/// A robot without a mission, and its line.
struct Robot<'a, 'q, 'm> {
    real_time: &'a mut RealTime<'q, 'm>,
    link: &'a mut LinkSide<'q, 'm>,
    wire: Wire,
    seq: u8,
}

/// Room for a blob, and for slots.
const BLOB_BYTES: usize = 256;
const SLOTS: usize = 4;

fn with_robot(
    law: impl FnOnce(&mut Robot<'_, '_, '_>) -> Result<(), Broken>,
) -> Result<(), Broken> {
    let mut memory = Memory::<BLOB_BYTES, 64, SLOTS, 4, 4, 1, 256>::new();
    let mut banks: [&mut dyn AnyTaskPool; 0] = [];
    let mut mailbox = Mailbox::new();
    let about = About::new("planted", "none");
    let (mut real_time, _, mut link) = split(
        &mut memory,
        &mut banks,
        &mut mailbox,
        about,
        Limits::default(),
    )
    .map_err(|fault| format!("{fault:?}"))?;
    // From now on it can tell how it is.
    real_time.on_timer(&mut Timer(0));
    law(&mut Robot {
        real_time: &mut real_time,
        link: &mut link,
        wire: Wire::default(),
        seq: 0,
    })
}

fn framed(seq: u8, request: Request<'_>) -> Vec<u8> {
    let mut frame = [0; MAX_FRAME_BYTES];
    let len = encode(&ToDevice { seq, request }, &mut frame).expect("it fits");
    frame[..len].to_vec()
}

impl Robot<'_, '_, '_> {
    /// What the robot answers to these bytes, in words.
    fn answers(&mut self, bytes: &[u8]) -> Vec<String> {
        self.wire.to_robot.extend(bytes);
        while self.link.poll(&mut self.wire) {}
        let mut reader = FrameReader::new();
        let mut answers = Vec::new();
        for byte in core::mem::take(&mut self.wire.to_host) {
            if let Some(frame) = reader.push(byte) {
                match decode(frame) {
                    Ok(FromDevice::Reply { seq, result, .. }) => {
                        answers.push(format!("{seq}: {result:?}"));
                    }
                    // Whether the proof is right, clients look at.
                    Ok(FromDevice::Proven { seq, result, .. }) => {
                        answers.push(format!("{seq}: proven {result:?}"));
                    }
                    _ => {}
                }
            }
        }
        answers
    }

    /// Asks under a new number for something that the real-time side does when the clock says this,
    /// and expects this answer.
    fn expect_at(
        &mut self,
        at_us: u64,
        request: Request<'_>,
        expected: &str,
    ) -> Result<(), Broken> {
        self.seq += 1;
        let seq = self.seq;
        expect(&self.answers(&framed(seq, request)), &[])?;
        self.real_time.on_timer(&mut Timer(at_us));
        self.wire.now_us = at_us;
        expect(&self.answers(&[]), &[&format!("{seq}: {expected}")])
    }

    /// Asks under a new number, and expects this answer.
    fn expect(&mut self, request: Request<'_>, expected: &str) -> Result<(), Broken> {
        self.seq += 1;
        let seq = self.seq;
        expect(
            &self.answers(&framed(seq, request)),
            &[&format!("{seq}: {expected}")],
        )
    }
}

fn expect(answers: &[String], expected: &[&str]) -> Result<(), Broken> {
    if answers == expected {
        Ok(())
    } else {
        Err(format!("{answers:?} instead of {expected:?}"))
    }
}

/// Bytes that are no mission, all different.
fn junk(len: u8) -> Vec<u8> {
    (0..len).map(|at| at.wrapping_mul(7) ^ 0x35).collect()
}

fn begin(blob: &[u8]) -> Request<'static> {
    Request::Begin {
        len: blob.len() as u32,
        crc: checksum(blob),
    }
}

fn serialized(request: Request<'_>) -> Vec<u8> {
    let mut room = [0; MAX_FRAME_BYTES];
    postcard::to_slice(&request, &mut room)
        .expect("it fits")
        .to_vec()
}

fn received(len: usize) -> String {
    format!("Ok(Received {{ len: {len} }})")
}

const COMMIT: Request<'static> = Request::Commit(Swap {
    warm: false,
    trial_ms: 0,
});
const NO_MISSION: &str = "Err(Invalid(Magic))";

type Law = fn() -> Result<(), Broken>;

/// What holds, and how that is seen.
const LAWS: &[(&str, Law)] = &[
    ("a changed bit makes a frame none", || {
        with_robot(|robot| {
            let blob = junk(20);
            robot.expect(begin(&blob), &received(0))?;
            let data = &blob[..];
            let mut frame = framed(99, Request::Chunk { offset: 0, data });
            frame[9] ^= 0x40;
            expect(&robot.answers(&frame), &[])?;
            robot.expect(begin(&blob), &received(0))
        })
    }),
    ("the frame behind garbage is understood", || {
        with_robot(|robot| {
            let garbage = [[7; MAX_FRAME_BYTES + 9].as_slice(), &[0]].concat();
            expect(&robot.answers(&garbage), &[])?;
            robot.expect(begin(&junk(9)), &received(0))
        })
    }),
    ("a frame that is longer than any is none", || {
        // The reader has room for a delimiter, too: so many bytes before one are none.
        let mut reader = FrameReader::new();
        let taken = [&[7; MAX_FRAME_BYTES + 1][..], &[0]]
            .concat()
            .iter()
            .any(|byte| reader.push(*byte).is_some());
        if taken {
            return Err(format!("{} bytes are a frame", MAX_FRAME_BYTES + 1));
        }
        Ok(())
    }),
    ("a request that comes twice is carried out once", || {
        with_robot(|robot| {
            let blob = junk(20);
            robot.expect(begin(&blob), &received(0))?;
            let data = &blob[..];
            robot.expect(Request::Chunk { offset: 0, data }, &received(20))?;
            let answer = format!("77: {NO_MISSION}");
            for _ in 0..2 {
                expect(&robot.answers(&framed(77, COMMIT)), &[&answer])?;
            }
            // Another one under the same number is another one.
            let clock = "77: Ok(Clock { now_us: 0 })";
            expect(&robot.answers(&framed(77, Request::Clock)), &[clock])
        })
    }),
    ("a stop is done, whatever came before it", || {
        with_robot(|robot| {
            // All requests of two bytes without a zero have one checksum, together with their own.
            let before = [Request::Abort, Request::Stop, Request::Stop];
            expect(&robot.answers(&framed(77, before[0])), &["77: Ok(Done)"])?;
            for (stop, at_us) in before[1..].iter().zip([1_000, 2_000]) {
                expect(&robot.answers(&framed(77, *stop)), &[])?;
                robot.real_time.on_timer(&mut Timer(at_us));
                expect(&robot.answers(&[]), &["77: Ok(Done)"])?;
            }
            Ok(())
        })
    }),
    ("what waits for its turn undoes no stop behind it", || {
        for (wanted, stop) in [
            (Request::Start, Request::Stop),
            (Request::Release, Request::EmergencyStop),
        ] {
            with_robot(|robot| {
                let mut listener = robot.link.stop_listener();
                let mut send = |robot: &mut Robot<'_, '_, '_>, bytes: &[u8]| {
                    for byte in bytes {
                        let _ = listener.hear(*byte, true);
                    }
                    robot.wire.to_robot.extend(bytes);
                    // Not until there is nothing to do: the wire is stuck.
                    for _ in 0..8 {
                        robot.link.poll(&mut robot.wire);
                    }
                };
                send(robot, &framed(1, stop));
                robot.real_time.on_timer(&mut Timer(1_000));
                // An answer is on its way out, which the wire does not take.
                let _ = robot.answers(&[]);
                robot.wire.is_stuck = true;
                send(robot, &framed(2, Request::Clock));
                // More follows than there is time for: what is read waits.
                let much = [0; 400];
                send(robot, &[&framed(3, wanted)[..], &much].concat());
                send(robot, &[&framed(4, stop)[..], &much].concat());
                robot.real_time.on_timer(&mut Timer(2_000));
                robot.wire.is_stuck = false;
                let answers = robot.answers(&[]);
                robot.real_time.on_timer(&mut Timer(3_000));
                let last = robot.answers(&[]);
                expect(&answers[1..], &["4: Ok(Done)"])?;
                let mode = robot.real_time.mode();
                let is_refused = last.len() == 1 && last[0].starts_with("3: Err(");
                let stopped = match stop {
                    Request::Stop => Mode::Stopped,
                    _ => Mode::EmergencyStopped,
                };
                if is_refused && mode == stopped {
                    return Ok(());
                }
                Err(format!("{last:?} to {wanted:?}, and then {mode:?}"))
            })?;
        }
        Ok(())
    }),
    ("a request is carried out in its time or not at all", || {
        with_robot(|robot| {
            let blob = junk(20);
            let begin = &serialized(begin(&blob))[..];
            let begin_by = |by_us| Request::Within {
                by_us,
                request: begin,
            };
            robot.wire.now_us = 1_000;
            robot.expect(begin_by(999), "Err(Late)")?;
            let data = &blob[..];
            robot.expect(Request::Chunk { offset: 0, data }, "Err(NoUpload)")?;
            robot.expect(begin_by(1_000), &received(0))?;
            // What waits for its turn with the real-time side may be late by then.
            let start = &serialized(Request::Start)[..];
            let start_by = |by_us| Request::Within {
                by_us,
                request: start,
            };
            robot.expect_at(3_000, start_by(2_999), "Err(Late)")?;
            robot.expect(Request::Clock, "Ok(Clock { now_us: 3000 })")?;
            robot.expect_at(4_000, start_by(4_000), "Ok(Done)")
        })
    }),
    ("nobody asks for something far ahead of its time", || {
        with_robot(|robot| {
            let begin = &serialized(begin(&junk(20)))[..];
            let begin_by = |by_us| Request::Within {
                by_us,
                request: begin,
            };
            robot.wire.now_us = 1_000;
            robot.expect(begin_by(1_001 + MAX_DEADLINE_US), "Err(DeadlineTooFar)")?;
            robot.expect(begin_by(1_000 + MAX_DEADLINE_US), &received(0))
        })
    }),
    ("chunks come in order and as long as was said", || {
        with_robot(|robot| {
            let blob = junk(20);
            robot.expect(begin(&blob), &received(0))?;
            let chunk = |from: usize, to: usize| Request::Chunk {
                offset: from as u32,
                data: &blob[from..to],
            };
            robot.expect(chunk(0, 8), &received(8))?;
            robot.expect(chunk(9, 12), "Err(WrongOffset { expected: 8 })")?;
            robot.expect(chunk(4, 8), &received(8))?;
            robot.expect(chunk(4, 12), &received(12))?;
            let data = &junk(21)[12..];
            robot.expect(Request::Chunk { offset: 12, data }, "Err(TooLong)")?;
            robot.expect(begin(&blob), &received(12))?;
            robot.expect(chunk(12, 20), &received(20))?;
            robot.expect(COMMIT, NO_MISSION)
        })
    }),
    ("what does not fit is refused before it is sent", || {
        with_robot(|robot| {
            let (len, crc) = (BLOB_BYTES as u32 + 1, 5);
            let refused = "Err(CapacityExceeded { what: BlobBytes, needed: 257, available: 256 })";
            robot.expect(Request::Begin { len, crc }, refused)
        })
    }),
    ("only the very same upload goes on", || {
        with_robot(|robot| {
            let blob = junk(20);
            let crc = checksum(&blob);
            let data = &blob[..8];
            for (len, crc) in [(21, crc), (20, crc ^ 1)] {
                robot.expect(begin(&blob), &received(0))?;
                robot.expect(Request::Chunk { offset: 0, data }, &received(8))?;
                robot.expect(begin(&blob), &received(8))?;
                robot.expect(Request::Begin { len, crc }, &received(0))?;
            }
            Ok(())
        })
    }),
    ("an upload that was given up is forgotten", || {
        with_robot(|robot| {
            let data = &junk(8)[..];
            robot.expect(begin(data), &received(0))?;
            robot.expect(Request::Abort, "Ok(Done)")?;
            robot.expect(Request::Chunk { offset: 0, data }, "Err(NoUpload)")?;
            robot.expect(COMMIT, "Err(NoUpload)")
        })
    }),
    ("half an upload is none, and can go on", || {
        with_robot(|robot| {
            let blob = junk(20);
            robot.expect(begin(&blob), &received(0))?;
            let data = &blob[..8];
            robot.expect(Request::Chunk { offset: 0, data }, &received(8))?;
            robot.expect(COMMIT, "Err(Incomplete { received: 8 })")?;
            let data = &blob[8..];
            robot.expect(Request::Chunk { offset: 8, data }, &received(20))?;
            robot.expect(COMMIT, NO_MISSION)
        })
    }),
    ("nothing is looked into but what was announced", || {
        with_robot(|robot| {
            let data = &junk(20)[..];
            let crc = checksum(data) ^ 0x100;
            robot.expect(Request::Begin { len: 20, crc }, &received(0))?;
            robot.expect(Request::Chunk { offset: 0, data }, &received(20))?;
            robot.expect(COMMIT, "Err(WrongChecksum)")?;
            robot.expect(COMMIT, "Err(NoUpload)")
        })
    }),
    ("noise is no stop, and a stop is heard", || {
        with_robot(|robot| {
            let mut listener = robot.link.stop_listener();
            let mut heard = |bytes: &[u8]| {
                let calls = bytes.iter().filter(|byte| listener.hear(**byte, true));
                calls.count()
            };
            let stop = framed(5, Request::Stop);
            let mut noise = stop.clone();
            noise[3] ^= 0x10;
            match (heard(&noise), heard(&stop)) {
                (0, 1) => Ok(()),
                (noise, stop) => Err(format!("{noise} and {stop} heard")),
            }
        })
    }),
    ("a stop is done when the robot stands still", || {
        with_robot(|robot| {
            robot.expect_at(1_000, Request::Stop, "Ok(Done)")?;
            expect(&[format!("{:?}", robot.real_time.mode())], &["Stopped"])
        })
    }),
    ("a start that a stop overtakes starts nothing", || {
        with_robot(|robot| {
            robot.expect_at(1_000, Request::Stop, "Ok(Done)")?;
            // One on its way to the slots, and one that is in the queue yet.
            let mut listener = robot.link.stop_listener();
            let (start, stop) = (framed(50, Request::Start), framed(51, Request::Stop));
            expect(&robot.answers(&start), &[])?;
            for byte in &stop {
                let _ = listener.hear(*byte, false);
            }
            robot.real_time.on_timer(&mut Timer(2_000));
            expect(&robot.answers(&[]), &["50: Err(StopCame)"])
        })?;
        with_robot(|robot| {
            let mut listener = robot.link.stop_listener();
            for byte in [framed(50, Request::Start), framed(51, Request::Stop)].concat() {
                let _ = listener.hear(byte, true);
            }
            expect(&robot.answers(&framed(50, Request::Start)), &[])?;
            robot.real_time.on_timer(&mut Timer(2_000));
            expect(&robot.answers(&[]), &["50: Err(StopCame)"])
        })
    }),
    ("what cannot be answered is in nobody's way", || {
        with_robot(|robot| {
            let blob = junk(20);
            robot.expect(begin(&blob), &received(0))?;
            robot.wire.is_stuck = true;
            let mut listener = robot.link.stop_listener();
            let mut bytes = Vec::new();
            for seq in 100..140 {
                bytes.extend(framed(seq, Request::Status));
            }
            let data = &blob[..];
            bytes.extend(framed(90, Request::Chunk { offset: 0, data }));
            bytes.extend(framed(91, Request::Stop));
            for seq in 140..180 {
                bytes.extend(framed(seq, Request::Status));
            }
            for _ in 0..8 {
                // What was taken before counts as kept.
                let _ = listener.hear(1, true);
            }
            for byte in &bytes {
                let _ = listener.hear(*byte, true);
            }
            robot.wire.to_robot.extend(&bytes);
            robot.link.poll(&mut robot.wire);
            robot.real_time.on_timer(&mut Timer(2_000));
            robot.wire.is_stuck = false;
            let answers = robot.answers(&[]);
            if !answers.iter().any(|answer| answer == "91: Ok(Done)") {
                return Err(format!("{answers:?}"));
            }
            robot.expect(begin(&blob), &received(20))
        })
    }),
    ("what comes over the line leaves others their time", || {
        with_robot(|robot| {
            // A line that is never empty, and requests that take their time.
            robot.wire.status_us = 5_000;
            let began_us = robot.wire.now_us;
            for seq in 0..200 {
                robot.wire.to_robot.extend(framed(seq, Request::Status));
            }
            while robot.link.poll(&mut robot.wire) {}
            let took_us = robot.wire.now_us - began_us;
            if took_us > 600_000 {
                return Err(format!("{took_us} us at once"));
            }
            // What is left comes in its time.
            let left = robot.wire.to_robot.len();
            robot.wire.now_us += 100_000;
            while robot.link.poll(&mut robot.wire) {}
            let done = left - robot.wire.to_robot.len();
            if done == 0 || done > left / 4 {
                return Err(format!("{done} of {left} bytes in 100 ms"));
            }
            Ok(())
        })
    }),
    #[cfg(feature = "telemetry")]
    ("a sample tells of so many nets and of no more", || {
        with_robot(|robot| {
            let mut ask = [0; MAX_ASK_BYTES + 2];
            ask[0] = 1;
            let values = |ask| Request::Values { ask };
            let refused = "Err(CapacityExceeded { what: Nets, needed: 21, available: 20 })";
            robot.expect(values(&[]), "Ok(Done)")?;
            robot.expect_at(1_000, values(&ask), refused)?;
            robot.expect_at(2_000, values(&ask[..MAX_ASK_BYTES]), "Err(NoMission)")?;
            robot.expect_at(3_000, values(&ask[..9]), "Err(Malformed)")
        })
    }),
    #[cfg(feature = "keys")]
    ("a robot with a key does what the key has signed", || {
        with_robot(of_keys::commands)
    }),
    #[cfg(feature = "keys")]
    ("a session is its owner's", || with_robot(of_keys::sessions)),
    #[cfg(feature = "keys")]
    ("nobody's bytes are in the owner's way", || {
        with_robot(of_keys::bytes_of_others)
    }),
    #[cfg(feature = "keys")]
    (
        "an upload that was taken is not taken again",
        of_keys::counters,
    ),
];

#[cfg(feature = "keys")]
mod of_keys {
    use ed25519_compact::{KeyPair, Seed};

    use super::*;
    use esm_link::access::{
        self, MAX_COUNTER_STEP, NO_UPLOAD, NONCE_BYTES, NONCE_LIFE_US, SALT_BYTES, SECRET_BYTES,
        SIGNATURE_BYTES,
    };
    use esm_link::keys::{Keys, PAUSE_AFTER_WRONG_US};
    use esm_link::message::{Identity, LinkError, Mode, Response};
    use esm_link::proof::{Secret, Session};

    const SALT: [u8; SALT_BYTES] = [4; SALT_BYTES];
    const SECRET: [u8; SECRET_BYTES] = [5; SECRET_BYTES];

    fn pair() -> KeyPair {
        KeyPair::from_seed(Seed::new([9; 32]))
    }

    fn sign(message: &[&[u8]]) -> [u8; SIGNATURE_BYTES] {
        *pair().sk.sign(message.concat(), None)
    }

    fn sign_upload(counter: u64, blob: &[u8]) -> [u8; SIGNATURE_BYTES] {
        sign(&access::upload(&SALT, &counter.to_le_bytes(), blob))
    }

    fn install(safe: &mut dyn KeyStore, keys: &mut Keys) -> Result<(), LinkError> {
        let key = *pair().pk;
        keys.access(Some(&mut *safe));
        let signature = sign(&access::install(&key, &SALT, &SECRET));
        keys.install(safe, 0, &key, &SALT, &SECRET, &signature)
    }

    /// The owner's end of a session.
    struct Owner {
        session: Session,
        number: u32,
    }

    impl Owner {
        /// The frame of the next request, under this number of a message.
        fn framed(&mut self, seq: u8, request: Request<'_>) -> Vec<u8> {
            self.number += 1;
            let request = &serialized(request)[..];
            framed(
                seq,
                Request::Proven {
                    number: self.number,
                    proof: self.session.of_request(self.number, request),
                    request,
                },
            )
        }
    }

    /// What the robot gives out for a session, and the session that follows from it.
    fn identify(
        robot: &mut Robot<'_, '_, '_>,
        client: [u8; NONCE_BYTES],
    ) -> Result<([u8; NONCE_BYTES], Session), Broken> {
        let Identity { nonce, .. } = robot.told(
            Request::Identify { nonce: client },
            |response| match response {
                Response::Identity(identity) => Some(identity),
                _ => None,
            },
        )?;
        Ok((nonce, Secret(SECRET).keyed().session(&client, &nonce)))
    }

    fn open(client: [u8; NONCE_BYTES], nonce: [u8; NONCE_BYTES], session: &Session) -> Request<'_> {
        Request::OpenSession {
            client,
            robot: nonce,
            proof: session.opening(),
        }
    }

    impl Robot<'_, '_, '_> {
        /// What the robot answers, as whoever knows all of it can find it out, too.
        fn told<T>(
            &mut self,
            request: Request<'_>,
            read: impl Fn(Response<'_>) -> Option<T>,
        ) -> Result<T, Broken> {
            self.seq += 1;
            let frame = framed(self.seq, request);
            self.told_by(&frame, read)
        }

        fn told_by<T>(
            &mut self,
            frame: &[u8],
            read: impl Fn(Response<'_>) -> Option<T>,
        ) -> Result<T, Broken> {
            self.wire.to_robot.extend(frame);
            while self.link.poll(&mut self.wire) {}
            let mut reader = FrameReader::new();
            for byte in core::mem::take(&mut self.wire.to_host) {
                if let Some(frame) = reader.push(byte)
                    && let Ok(FromDevice::Reply { result, .. } | FromDevice::Proven { result, .. }) =
                        decode(frame)
                    && let Ok(response) = result
                    && let Some(told) = read(response)
                {
                    return Ok(told);
                }
            }
            Err(String::from("no such answer"))
        }

        /// Opens a session.
        fn owner(&mut self) -> Result<Owner, Broken> {
            let client = [self.seq; NONCE_BYTES];
            let (nonce, session) = identify(self, client)?;
            self.expect(open(client, nonce, &session), "proven Ok(Done)")?;
            Ok(Owner { session, number: 0 })
        }

        /// Asks in a session, and expects this answer.
        fn expect_of(
            &mut self,
            owner: &mut Owner,
            request: Request<'_>,
            expected: &str,
        ) -> Result<(), Broken> {
            self.seq += 1;
            let seq = self.seq;
            let frame = owner.framed(seq, request);
            let expected = format!("{seq}: proven {expected}");
            expect(&self.answers(&frame), &[&expected])
        }

        /// Signs a request with a nonce of now, and expects this answer.
        fn expect_signed(
            &mut self,
            owner: &mut Owner,
            request: &[u8],
            expected: &str,
        ) -> Result<(), Broken> {
            let nonce = self.nonce(owner)?;
            let signature = &sign(&access::command(&nonce, &NO_UPLOAD, request))[..];
            self.expect_of(owner, Request::Signed { signature, request }, expected)
        }

        /// The nonce that the robot gives out for a signed request.
        fn nonce(&mut self, owner: &mut Owner) -> Result<[u8; NONCE_BYTES], Broken> {
            self.seq += 1;
            let frame = owner.framed(self.seq, Request::Challenge);
            self.told_by(&frame, |response| match response {
                Response::Challenge { nonce, .. } => Some(nonce),
                _ => None,
            })
        }
    }

    /// Of requests that need the key.
    pub(super) fn commands(robot: &mut Robot<'_, '_, '_>) -> Result<(), Broken> {
        let blob = junk(20);
        let data = &blob[..];
        robot.expect(begin(&blob), &received(0))?;
        robot.expect(Request::Chunk { offset: 0, data }, &received(20))?;
        let key = *pair().pk;
        let signature = &sign(&access::install(&key, &SALT, &SECRET))[..];
        let (key, salt, secret) = (&key[..], &SALT[..], &SECRET[..]);
        let install = Request::InstallKey {
            key,
            salt,
            secret,
            signature,
        };
        robot.expect(install, "Ok(Done)")?;
        robot.expect(COMMIT, "Err(NeedsKey)")?;
        let owner = &mut robot.owner()?;
        robot.expect_of(owner, COMMIT, "Err(NeedsKey)")?;
        let request = &serialized(COMMIT)[..];
        robot.expect_signed(owner, request, "Err(NotSigned)")?;
        let old = &sign(&access::command(&[0; NONCE_BYTES], &NO_UPLOAD, request))[..];
        let signed = Request::Signed {
            signature: old,
            request,
        };
        robot.expect_of(owner, signed, "Err(NoChallenge)")?;
        // A wrong one, and then a right one, too soon.
        robot.nonce(owner)?;
        robot.expect_of(owner, signed, "Err(WrongSignature)")?;
        robot.expect_signed(owner, request, "Err(TooSoon { ms: 1000 })")?;
        robot.wire.now_us += PAUSE_AFTER_WRONG_US;
        robot.expect_signed(owner, request, "Err(NotSigned)")?;
        // What was held back until it is too late: by its deadline, and by its nonce.
        let start = &serialized(Request::Start)[..];
        let by_us = robot.wire.now_us - 1;
        let late = &serialized(Request::Within {
            by_us,
            request: start,
        })[..];
        robot.expect_signed(owner, late, "Err(Late)")?;
        for (later_us, expected) in [
            (NONCE_LIFE_US, "Err(NotSigned)"),
            (NONCE_LIFE_US + 1, "Err(NoChallenge)"),
        ] {
            let nonce = robot.nonce(owner)?;
            robot.wire.now_us += later_us;
            let signature = &sign(&access::command(&nonce, &NO_UPLOAD, request))[..];
            robot.expect_of(owner, Request::Signed { signature, request }, expected)?;
        }
        // A stranger's stop holds after the owner's release, too, also where it is the same frame.
        let stop = framed(250, Request::EmergencyStop);
        expect(&robot.answers(&stop), &["250: Ok(Done)"])?;
        let nonce = robot.nonce(owner)?;
        let request = &serialized(Request::Release)[..];
        let signature = &sign(&access::command(&nonce, &NO_UPLOAD, request))[..];
        let release = owner.framed(249, Request::Signed { signature, request });
        expect(&robot.answers(&release), &[])?;
        robot.wire.now_us += 1_000;
        robot.real_time.on_timer(&mut Timer(robot.wire.now_us));
        expect(&robot.answers(&[]), &["249: proven Ok(Done)"])?;
        expect(&robot.answers(&stop), &["250: Ok(Done)"])?;
        let mode = robot.told(Request::Status, |response| match response {
            Response::Status(status) => Some(status.mode),
            _ => None,
        })?;
        if mode != Mode::EmergencyStopped {
            return Err(format!("the robot is {mode:?}"));
        }
        Ok(())
    }

    /// Of sessions, and who is in them.
    pub(super) fn sessions(robot: &mut Robot<'_, '_, '_>) -> Result<(), Broken> {
        install(&mut robot.wire, &mut Keys::new()).map_err(|error| format!("{error:?}"))?;
        robot.wire.now_us = 1;
        let blob = junk(20);
        robot.expect(begin(&blob), "Err(NoSession)")?;
        robot.expect(Request::Abort, "Err(NoSession)")?;
        // Who does not know the secret, and who comes too late.
        let client = [1; NONCE_BYTES];
        let (nonce, session) = identify(robot, client)?;
        let wrong = Secret([0; SECRET_BYTES]).keyed().session(&client, &nonce);
        robot.expect(open(client, nonce, &wrong), "Err(WrongProof)")?;
        robot.wire.now_us += NONCE_LIFE_US + 1;
        robot.expect(open(client, nonce, &session), "Err(NoChallenge)")?;
        // The right one; another after it; the first once more.
        let (nonce, session) = identify(robot, client)?;
        robot.expect(open(client, nonce, &session), "proven Ok(Done)")?;
        robot.wire.now_us += 1;
        let owner = &mut robot.owner()?;
        robot.expect(open(client, nonce, &session), "Err(NoChallenge)")?;
        // Requests in it: new ones alone are carried out, and heard.
        let heard = |robot: &Robot<'_, '_, '_>| robot.link.requests_heard();
        let before = heard(robot);
        robot.seq += 1;
        let seq = robot.seq;
        let first = owner.framed(seq, begin(&blob));
        expect(
            &robot.answers(&first),
            &[&format!("{seq}: proven {}", received(0))],
        )?;
        let data = &blob[..8];
        let chunk = Request::Chunk { offset: 0, data };
        robot.expect_of(owner, chunk, &received(8))?;
        robot.expect(Request::Chunk { offset: 8, data }, "Err(NoSession)")?;
        expect(
            &robot.answers(&first),
            &[&format!("{seq}: Err(WrongProof)")],
        )?;
        // Nobody counts on so far, whatever he can prove.
        let request = &serialized(Request::Abort)[..];
        let far = owner.number + 65;
        let proven = Request::Proven {
            number: far,
            proof: owner.session.of_request(far, request),
            request,
        };
        robot.expect(proven, "Err(WrongProof)")?;
        let by_number = heard(robot).wrapping_sub(before);
        if by_number != 2 {
            return Err(format!("{by_number} requests were heard"));
        }
        let request = &serialized(Request::Abort)[..];
        let proven = Request::Proven {
            number: owner.number + 1,
            proof: owner.session.of_request(owner.number, request),
            request,
        };
        robot.expect(proven, "Err(WrongProof)")?;
        // What a stranger asks the real-time side for keeps the owner waiting, and no more.
        let read = framed(200, Request::ReadBlob { offset: 0 });
        let states = owner.framed(201, Request::States { first: 0 });
        expect(&robot.answers(&[read, states].concat()), &[])?;
        robot.real_time.on_timer(&mut Timer(1_000));
        expect(&robot.answers(&[]), &["200: Err(NoMission)"])?;
        robot.real_time.on_timer(&mut Timer(2_000));
        expect(&robot.answers(&[]), &["201: proven Err(NoMission)"])?;
        robot.expect_of(owner, begin(&blob), &received(8))
    }

    /// Of an upload that somebody else has filled, under the owner's length and checksum.
    pub(super) fn bytes_of_others(robot: &mut Robot<'_, '_, '_>) -> Result<(), Broken> {
        install(&mut robot.wire, &mut Keys::new()).map_err(|error| format!("{error:?}"))?;
        let owner = &mut robot.owner()?;
        let (blob, others) = (junk(20), [0x5a; 20]);
        let (first, second) = (sign_upload(1, &blob), sign_upload(2, &blob));
        let right = Request::Sign {
            counter: 1,
            signature: &first,
        };
        let wrong = Request::Sign {
            counter: 1,
            signature: &second,
        };
        for (data, signed, there) in [
            (&others[..], "Err(WrongSignature)", 0),
            (&blob, "Ok(Done)", 20),
        ] {
            robot.expect_of(owner, begin(&blob), &received(0))?;
            robot.expect_of(owner, Request::Chunk { offset: 0, data }, &received(20))?;
            robot.expect_of(owner, right, signed)?;
            robot.expect_of(owner, begin(&blob), &received(there))?;
            robot.wire.now_us += PAUSE_AFTER_WRONG_US;
        }
        // What was signed is in nobody's way.
        robot.expect_of(owner, wrong, "Err(WrongSignature)")?;
        robot.expect_of(owner, begin(&blob), &received(20))
    }

    /// Of counters of uploads.
    pub(super) fn counters() -> Result<(), Broken> {
        let (mut wire, mut keys) = (Wire::default(), Keys::new());
        install(&mut wire, &mut keys).map_err(|error| format!("{error:?}"))?;
        let blob = junk(20);
        let signature = |counter: u64| sign_upload(counter, &blob);
        let upload = keys
            .check_upload(&mut wire, 0, 5, &signature(5), &blob)
            .map_err(|error| format!("{error:?}"))?;
        keys.accept(&mut wire, &upload)
            .map_err(|error| format!("{error:?}"))?;
        for (counter, expected) in [
            (4, Err(LinkError::OldCounter { last: 5 })),
            (5, Err(LinkError::OldCounter { last: 5 })),
            (6, Ok(())),
            (5 + MAX_COUNTER_STEP, Ok(())),
            (
                6 + MAX_COUNTER_STEP,
                Err(LinkError::CounterTooFar { last: 5 }),
            ),
            (u64::MAX - 1, Err(LinkError::CounterTooFar { last: 5 })),
        ] {
            let result = keys.check_upload(&mut wire, 0, counter, &signature(counter), &blob);
            let result = result.map(drop);
            if result != expected {
                return Err(format!("counter {counter}: {result:?}"));
            }
        }
        Ok(())
    }
}

/// The first law that is broken, and how. A panic breaks one, too.
fn broken() -> Option<(&'static str, Broken)> {
    LAWS.iter().find_map(|(name, law)| {
        let result = catch_unwind(AssertUnwindSafe(law));
        let result = result.unwrap_or_else(|_| Err(String::from("it panics")));
        result.err().map(|broken| (*name, broken))
    })
}

#[test]
fn without_a_planted_defect_the_link_keeps_its_laws() {
    assert_eq!(broken(), None);
}

#[test]
fn every_planted_defect_of_the_link_breaks_a_law() {
    let mut missed = Vec::new();
    std::println!();
    for (bug, what) in ALL {
        if OF_KEYS.contains(bug) && cfg!(not(feature = "keys")) {
            continue;
        }
        plant(Some(*bug));
        let found = broken();
        plant(None);
        let noticed = found.map_or("NOT NOTICED", |(law, _)| law);
        std::println!("link   {:24} {what:96} {noticed}", format!("{bug:?}"));
        if noticed == "NOT NOTICED" {
            missed.push(*what);
        }
    }
    assert!(missed.is_empty(), "not noticed: {missed:#?}");
}
