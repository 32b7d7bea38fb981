//! A line that is full, at a robot that drives in the emulator with its real firmware: whatever comes over it costs no slot, leaves the background its time, and
//! resets nothing; a stop among it stops the robot, and the owner's upload arrives.
//!
//! The link goes by the plant's exchange, at the rate of a line of 115,200 baud in the robot's own time. So a run repeats to the byte, and takes as long as this machine needs for it.
//!
//! `ESM_LOAD_SECONDS` says how long each kind of request floods the robot, in its own time, `ESM_LOAD_ALL=1` that each
//! kind does, and `ESM_LOAD_STOPS` how many stops are tried. The campaign: `ESM_LOAD_ALL=1 ESM_LOAD_SECONDS=600 ESM_LOAD_STOPS=500 cargo test -p esm-tests --test line_load -- --nocapture`.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::io;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use esm_tests::command::{firmware, root};
use esm_tests::random::Random;
use esm_tests::{environment, subject};
use host_tools::link_client::LinkClient;
use host_tools::lockstep::pace::Pace;
use host_tools::lockstep::plant_side::PlantSide;
use host_tools::plant::{BodyParameters, Plant};
use host_tools::run::board::{Board, LinkWay, RunningBoard};
use host_tools::serial::ByteLink;
use host_tools::serial::clock::Clock;
use host_tools::world::World;
use rt_firmware::link::access::{KEY_BYTES, SEED_BYTES, SIGNATURE_BYTES};
use rt_firmware::link::frame::{DELIMITER, MAX_FRAME_BYTES, encode};
use rt_firmware::link::message::{Mode, Request, ResetReason, Status, ToDevice};

/// Numbers of requests of whoever floods the robot: the owner's client counts up from its own, and comes to none of these in a test.
const FLOOD_NUMBERS: [u8; 8] = [180, 181, 182, 183, 184, 185, 186, 187];

fn frame(seq: u8, request: Request<'_>) -> Vec<u8> {
    let mut frame = [0; MAX_FRAME_BYTES];
    let length = encode(&ToDevice { seq, request }, &mut frame).unwrap();
    [&[DELIMITER], &frame[..length]].concat()
}

/// All that anyone may ask for, but what stops the robot or ends the owner's session.
fn requests() -> Vec<(&'static str, Request<'static>)> {
    vec![
        ("status", Request::Status),
        ("task", Request::Task { index: 0, offset: 0 }),
        ("read blob", Request::ReadBlob { offset: 0 }),
        ("states", Request::States { first: 0 }),
        ("slot counters", Request::SlotCounters { slot: 0 }),
        ("task counters", Request::TaskCounters { task_instance: 0 }),
        ("last words", Request::LastWords),
        ("black box", Request::BlackBox { from: None }),
        ("challenge", Request::Challenge),
        ("param", Request::Param { mission: 1, param: 0 }),
        ("clock", Request::Clock),
        ("features", Request::Features),
        (
            "signed",
            Request::Signed {
                signature: &[3; SIGNATURE_BYTES],
                request: &[7],
            },
        ),
        (
            "sign",
            Request::Sign {
                counter: 9,
                signature: &[3; SIGNATURE_BYTES],
            },
        ),
        (
            "install key",
            Request::InstallKey {
                key: &[1; KEY_BYTES],
                seed: &[2; SEED_BYTES],
                signature: &[3; SIGNATURE_BYTES],
            },
        ),
        ("confirm", Request::Confirm { mission: 1 }),
        ("fall back", Request::FallBack { mission: 1 }),
        (
            "values",
            Request::Values {
                ask: &[0, 0, 1, 0, 1, 0, 0, 0, 0, 0],
            },
        ),
        (
            "within",
            Request::Within {
                by_us: 1,
                request: &[5],
            },
        ),
    ]
}

/// What costs the robot most.
const WORST: [&str; 4] = ["status", "black box", "install key", "mixed"];

/// What fills the line.
#[derive(Clone)]
enum Flood {
    Nothing,
    One(Request<'static>),
    Mixed(Random),
}

impl Flood {
    /// The next frame of it.
    fn frame(&mut self, count: usize) -> Vec<u8> {
        let seq = FLOOD_NUMBERS[count % FLOOD_NUMBERS.len()];
        match self {
            Flood::Nothing => Vec::new(),
            Flood::One(request) => frame(seq, *request),
            Flood::Mixed(random) => {
                let all = requests();
                match random.below(all.len() + 2) {
                    0 => (0..random.below(60)).map(|_| random.bits() as u8).collect(),
                    1 => frame(seq, Request::Chunk { offset: 7, data: &[5; 90] }),
                    kind => frame(seq, all[kind - 2].1),
                }
            }
        }
    }
}

/// The robot's line, which somebody else fills: of each two bytes, one is the owner's where the owner has any.
#[derive(Clone)]
struct Crowded {
    line: Arc<Mutex<Box<dyn ByteLink>>>,
    flood: Arc<Mutex<(Flood, usize)>>,
}

impl Crowded {
    fn set(&self, flood: Flood) {
        self.flood.lock().unwrap().0 = flood;
    }

    /// As many bytes of the flood, or a frame more.
    fn crowd(&self, bytes: usize) -> io::Result<()> {
        let mut sent = 0;
        while sent < bytes {
            let frame = {
                let (flood, count) = &mut *self.flood.lock().unwrap();
                *count += 1;
                flood.frame(*count)
            };
            if matches!(self.flood.lock().unwrap().0, Flood::Nothing) {
                return Ok(());
            }
            sent += frame.len().max(1);
            self.line.lock().unwrap().send(&frame)?;
        }
        Ok(())
    }
}

impl ByteLink for Crowded {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        if matches!(self.flood.lock().unwrap().0, Flood::Nothing) {
            return self.line.lock().unwrap().receive(buffer, timeout);
        }
        // While the owner waits, the line is filled by the other alone.
        let clock = self.clock();
        let begun = clock.now();
        loop {
            let count = self.line.lock().unwrap().receive(buffer, Duration::ZERO)?;
            if count > 0 || clock.since(begun) >= timeout {
                return Ok(count);
            }
            self.crowd(36)?;
        }
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.crowd(bytes.len())?;
        self.line.lock().unwrap().send(bytes)
    }

    fn clock(&self) -> Clock {
        self.line.lock().unwrap().clock()
    }
}

fn blob(file: &str) -> Vec<u8> {
    subject::build_file(&root().join(file)).unwrap().blob
}

/// A robot on patrol, and its line.
struct Robot {
    _board: RunningBoard,
    plant: PlantSide,
    line: Crowded,
}

fn robot() -> Robot {
    let board = Board::Emulated {
        firmware: firmware("rover"),
    };
    let world = World::load(&root().join("missions/worlds/office.world")).unwrap();
    let plant = Plant::new(world, BodyParameters::default(), 1).unwrap();
    let plant = PlantSide::new(plant, Pace::new(false), None);
    let (board, line) = RunningBoard::start(board, &plant, None, LinkWay::Exchange).unwrap();
    let line = Crowded {
        line: Arc::new(Mutex::new(line)),
        flood: Arc::new(Mutex::new((Flood::Nothing, 0))),
    };
    let (mut client, _) = LinkClient::connect(line.clone()).unwrap();
    client.upload(&blob("missions/patrol.esm"), &mut |_| ()).unwrap();
    Robot {
        _board: board,
        plant,
        line,
    }
}

impl Robot {
    fn client(&self) -> LinkClient<Crowded> {
        LinkClient::connect(self.line.clone()).unwrap().0
    }

    /// Robot time in seconds.
    fn now_s(&self) -> f64 {
        self.plant.pace().robot_us() as f64 / 1e6
    }

    /// Fills the line for so many seconds of the robot's time, and takes what it says to that.
    fn flood(&self, flood: Flood, seconds: f64) {
        self.line.set(flood);
        let until_s = self.now_s() + seconds;
        let mut buffer = [0; 1024];
        while self.now_s() < until_s {
            self.line.crowd(36).unwrap();
            let mut line = self.line.line.lock().unwrap();
            line.receive(&mut buffer, Duration::ZERO).unwrap();
        }
        self.line.set(Flood::Nothing);
    }

    /// It drives as if nothing had been.
    fn assert_drives(&self, what: &str, mission: Option<u32>) -> Status {
        let status = self.client().status().unwrap();
        assert_eq!(status.mode, Mode::Running, "{what}: {status:?}");
        assert_eq!(status.reset, ResetReason::PowerOn, "{what}: {status:?}");
        assert_eq!((status.missed, status.overruns), (0, 0), "{what}");
        assert_eq!(status.mission, mission, "{what}");
        status
    }
}

#[test]
fn polling_without_a_pause_neither_resets_the_robot_nor_costs_it_a_slot() {
    let robot = robot();
    let before = robot.client().status().unwrap();
    // Longer than an idle loop may be without a turn.
    robot.flood(Flood::One(Request::Status), 14.0);
    let after = robot.assert_drives("status", before.mission);
    assert!(after.steps > before.steps + 300, "{} steps", after.steps);
}

#[test]
fn whatever_fills_the_line_costs_no_slot_and_no_upload_much() {
    let all = environment::number("ESM_LOAD_ALL", 0) > 0;
    let seconds = environment::number("ESM_LOAD_SECONDS", 2) as f64;
    let robot = robot();
    let other = blob("missions/follow_wall.esm");
    // What the owner's upload takes of the robot's time.
    let upload_s = |blob: &[u8]| {
        let began_s = robot.now_s();
        let mut client = robot.client();
        client.abort().unwrap();
        client.stage(blob, &mut |_| ()).unwrap();
        robot.now_s() - began_s
    };
    let quiet_s = upload_s(&other);
    let status = robot.client().status().unwrap();
    let mut floods: Vec<(&str, Flood)> = vec![("mixed", Flood::Mixed(Random::new(3)))];
    floods.extend(requests().into_iter().map(|(name, request)| (name, Flood::One(request))));
    floods.retain(|(name, _)| all || WORST.contains(name));
    for (name, flood) in floods {
        robot.flood(flood.clone(), seconds);
        robot.assert_drives(name, status.mission);
        robot.line.set(flood);
        let crowded_s = upload_s(&other);
        robot.line.set(Flood::Nothing);
        println!("{name:14} upload {crowded_s:.2} s, {:.1} times {quiet_s:.2} s", crowded_s / quiet_s);
        // Let what was answered to the flood pass.
        robot.flood(Flood::Nothing, 0.0);
        robot.assert_drives(name, status.mission);
    }
}
