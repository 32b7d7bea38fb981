//! A host that has no key, at the line of a robot that has one and drives, in the emulator with its
//! real firmware: it floods the robot, gets nowhere, and costs no slot; the owner's next upload
//! works.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::io;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use esm_link::access::{
    Access, KEY_BYTES, NONCE_BYTES, PROOF_BYTES, SALT_BYTES, SECRET_BYTES, SIGNATURE_BYTES,
};
use esm_link::frame::{DELIMITER, FrameReader, MAX_FRAME_BYTES, checksum, decode, encode};
use esm_link::message::{FromDevice, LinkError, Mode, Request, Response, Status, Swap, ToDevice};
use esm_tests::command::{firmware, root};
use esm_tests::random::Random;
use esm_tests::{environment, subject};
use host_tools::files::load_world;
use host_tools::keys::SigningKey;
use host_tools::link_client::{ClientError, LinkClient};
use host_tools::lockstep::pace::Pace;
use host_tools::lockstep::plant_side::PlantSide;
use host_tools::plant::{BodyParameters, Plant};
use host_tools::run::board::{Board, LinkWay, RunningBoard};
use host_tools::serial::{ByteLink, DEFAULT_BAUD};

/// A line that keeps what is sent over it.
struct Tapped<L> {
    line: L,
    sent: Arc<Mutex<Vec<u8>>>,
}

impl<L: ByteLink> ByteLink for Tapped<L> {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.line.receive(buffer, timeout)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.sent.lock().unwrap().extend(bytes);
        self.line.send(bytes)
    }
}

fn blob(file: &str) -> Vec<u8> {
    subject::build_file(&root().join(file)).unwrap().blob
}

fn frame(seq: u8, request: Request<'_>) -> Vec<u8> {
    let mut frame = [0; MAX_FRAME_BYTES];
    let length = encode(&ToDevice { seq, request }, &mut frame).unwrap();
    [&[DELIMITER], &frame[..length]].concat()
}

/// One of the things that a host without the key may try.
fn attempt(random: &mut Random, seq: u8, blob: &[u8]) -> Vec<u8> {
    let signature = [random.bits() as u8; SIGNATURE_BYTES];
    let request = match random.below(18) {
        0 => Request::Start,
        1 => Request::Commit(Swap::default()),
        2 => Request::Confirm { mission: 1 },
        3 => Request::FallBack { mission: 1 },
        4 => Request::RemoveKey,
        5 => Request::SetParam {
            mission: u32::from_le_bytes(*blob.last_chunk().unwrap()),
            param: 0,
            value: 0,
        },
        6 => Request::InstallKey {
            key: &[1; KEY_BYTES],
            salt: &[2; SALT_BYTES],
            secret: &[3; SECRET_BYTES],
            signature: &signature,
        },
        7 => Request::Begin {
            len: blob.len() as u32,
            crc: checksum(blob),
        },
        8 => Request::Chunk {
            offset: 0,
            data: &blob[..100],
        },
        9 | 10 => Request::Challenge,
        11 | 12 => Request::Signed {
            signature: &signature,
            request: &[7],
        },
        13 => Request::Identify {
            nonce: [random.bits() as u8; NONCE_BYTES],
        },
        14 => Request::OpenSession {
            client: [1; NONCE_BYTES],
            // Of a time that may be now.
            robot: [0; NONCE_BYTES],
            proof: [random.bits() as u8; PROOF_BYTES],
        },
        15 => Request::Proven {
            number: random.bits() as u32,
            proof: [random.bits() as u8; PROOF_BYTES],
            request: &[4],
        },
        16 => Request::Abort,
        _ => Request::Sign {
            counter: random.bits(),
            signature: &signature,
        },
    };
    frame(seq, request)
}

/// What the robot told the host that floods it.
#[derive(Default)]
struct Told {
    refused: Vec<LinkError>,
    /// Of what none may be.
    carried_out: Vec<String>,
}

impl Told {
    fn hear(&mut self, frame: &mut [u8]) {
        // A proven answer is one that the owner had already, to the last request: nobody else has a
        // proof.
        let Ok(FromDevice::Reply { result, .. }) = decode(frame) else {
            return;
        };
        match result {
            // Who the robot is, and a session of anyone's that begins: all may.
            Ok(Response::Identity(_) | Response::Hello(_)) => {}
            // Of sessions that are replayed.
            Ok(
                Response::Status(_)
                | Response::Blob { .. }
                | Response::Clock { .. }
                | Response::Features { .. },
            ) => {}
            Ok(other) => self.carried_out.push(format!("{other:?}")),
            Err(error) => self.refused.push(error),
        }
    }
}

/// Bytes that are sent without a look at what came: where both ways are full, nobody can send.
const PIECE_BYTES: usize = 32;

/// Sends so many bytes of whatever a host without a key can, as fast as the line takes them.
fn flood(line: &mut impl ByteLink, recorded: &[u8], blob: &[u8], flood_bytes: u64) -> Told {
    let (mut random, mut reader, mut told) = (Random::new(7), FrameReader::new(), Told::default());
    let mut frames = recorded.split_inclusive(|byte| *byte == DELIMITER).cycle();
    let mut sent = 0;
    let mut seq = 0u8;
    while sent < flood_bytes {
        let bytes = match random.below(4) {
            // What the owner sent once, all of it and in its order.
            0 => {
                let replayed: Vec<&[u8]> = frames.by_ref().take(8).collect();
                [&[DELIMITER], &replayed.concat()[..]].concat()
            }
            1 => (0..random.below(300))
                .map(|_| random.bits() as u8)
                .collect(),
            _ => {
                seq = seq.wrapping_add(1);
                attempt(&mut random, seq, blob)
            }
        };
        sent += bytes.len() as u64;
        for piece in bytes.chunks(PIECE_BYTES) {
            line.send(piece).unwrap();
            let mut buffer = [0; 1024];
            let count = line.receive(&mut buffer, Duration::from_millis(1)).unwrap();
            for byte in &buffer[..count] {
                if let Some(frame) = reader.push(*byte) {
                    told.hear(frame);
                }
            }
        }
    }
    told
}

/// Reads up to the answer to a question that nobody has asked before: what comes behind it is not
/// of the flood.
fn pass_over_answers(line: &mut impl ByteLink) {
    const PATIENCE: Duration = Duration::from_secs(120);
    // Not a number that the owner comes to soon: this may be answered more than once.
    let seq = (std::process::id() as u8).wrapping_sub(1);
    let question = frame(
        seq,
        Request::Task {
            index: 0,
            offset: 0,
        },
    );
    let mut reader = FrameReader::new();
    let begun = Instant::now();
    loop {
        line.send(&question).unwrap();
        let mut buffer = [0; 1024];
        // Asked anew where nothing comes for a while: what the flood began may have corrupt it.
        loop {
            assert!(begun.elapsed() < PATIENCE, "it never ends");
            let count = line.receive(&mut buffer, Duration::from_secs(1)).unwrap();
            if count == 0 {
                break;
            }
            for byte in &buffer[..count] {
                let Some(frame) = reader.push(*byte) else {
                    continue;
                };
                let answer = decode(frame);
                if let Ok(FromDevice::Reply {
                    result: Ok(Response::TaskText { .. }),
                    ..
                }) = answer
                {
                    return;
                }
            }
        }
    }
}

#[test]
fn a_host_without_the_key_gets_nowhere_and_costs_no_slot() {
    let seconds = environment::number("ESM_HOSTILE_SECONDS", 10);
    let board = Board::emulated(firmware("rover"));
    let world = load_world(&root().join("missions/worlds/office.world")).unwrap();
    let plant = Plant::new(world, BodyParameters::default(), 1).unwrap();
    let plant = PlantSide::new(plant, Pace::new(true), None);
    let (_board, line) = RunningBoard::start(board, &plant, None, LinkWay::Uart).unwrap();
    let sent = Arc::default();
    let tapped = Tapped {
        line,
        sent: Arc::clone(&sent),
    };

    // The owner, who is listened to.
    let (patrol, next) = (
        blob("missions/patrol.esm"),
        blob("missions/follow_wall.esm"),
    );
    let (mut robot, info) = LinkClient::connect(tapped).unwrap();
    assert_eq!(info.access, Access::Open);
    let key = || SigningKey::of(&[9; 32]);
    robot.use_key(Box::new(move || Ok(key())));
    robot.install_key(&key()).unwrap();
    let mission = robot.upload(&patrol, &mut |_| ()).unwrap();
    robot.start().unwrap();
    let before = robot.status().unwrap();
    let Tapped { mut line, .. } = robot.into_line();
    let recorded = std::mem::take(&mut *sent.lock().unwrap());

    // What the line takes in that time.
    let flood_bytes = seconds * u64::from(DEFAULT_BAUD) / 10;
    let told = flood(&mut line, &recorded, &patrol, flood_bytes);
    assert_eq!(told.carried_out, Vec::<String>::new());
    for refusal in [
        LinkError::NeedsKey,
        LinkError::NoSession,
        LinkError::WrongProof,
        LinkError::NoChallenge,
    ] {
        assert!(
            told.refused.contains(&refusal),
            "{refusal:?} was not reached"
        );
    }
    println!("{} requests refused in {seconds} s", told.refused.len());

    // The owner comes back, when what the flood was answered has passed: a hello among what is
    // replayed may have had the number of his own.
    pass_over_answers(&mut line);
    let (mut robot, info) = LinkClient::connect(line).unwrap();
    assert_eq!(info.access, Access::Locked);
    let after = robot.status().unwrap();
    let standing = |status: &Status| {
        (
            status.mission,
            status.mode,
            status.missed,
            status.changed_params,
        )
    };
    assert_eq!(standing(&after), standing(&before));
    assert_eq!(standing(&after), (Some(mission), Mode::Running, 0, 0));
    assert!(after.steps > before.steps + 10, "it drives on");
    assert!(matches!(robot.start(), Err(ClientError::NoKey)));
    robot.use_key(Box::new(move || Ok(key())));
    let uploaded = robot.upload(&next, &mut |_| ()).unwrap();
    assert_eq!(uploaded.to_le_bytes(), *next.last_chunk().unwrap());
    let status = robot.status().unwrap();
    assert_eq!((status.mission, status.missed), (Some(uploaded), 0));
}
