//! A line that is full, at a robot that drives in the emulator with its real firmware: whatever
//! comes over it costs no slot, leaves the background its time, and resets nothing; a stop among it
//! stops the robot, and the owner's upload arrives.
//!
//! The link goes by the plant's exchange, at the rate of a line of 115,200 baud in the robot's own
//! time. So a run repeats to the byte, and takes as long as this machine needs for it.
//!
//! `ESM_LOAD_SECONDS` says how long each kind of request floods the robot, in its own time,
//! `ESM_LOAD_ALL=1` that each kind does, and `ESM_LOAD_STOPS` how many stops are tried, of a robot
//! with the mission `ESM_LOAD_MISSION`. `cargo xtask campaign stops`, `many-stops` and `load` do it
//! at full length.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::io;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use esm_link::access::{
    KEY_BYTES, NONCE_BYTES, PROOF_BYTES, SALT_BYTES, SECRET_BYTES, SIGNATURE_BYTES,
};
use esm_link::behaviours::{BehaviourRequest, Call, Origin};
use esm_link::frame::{DELIMITER, FrameReader, MAX_FRAME_BYTES, decode, encode};
use esm_link::message::{
    FromDevice, LinkError, Mode, Request, ResetReason, Response, Status, ToDevice,
};
use esm_tests::command::{firmware, firmware_with, root};
use esm_tests::random::Random;
use esm_tests::{environment, subject};
use host_tools::boards;
use host_tools::files::load_world;
use host_tools::keys::SigningKey;
use host_tools::link_client::{ClientError, LinkClient, Streams};
use host_tools::lockstep::line;
use host_tools::lockstep::pace::Pace;
use host_tools::lockstep::plant_side::PlantSide;
use host_tools::parameters::Value;
use host_tools::plant::{BodyParameters, Plant};
use host_tools::qemu::{Emulator, Idle};
use host_tools::run::board::{Board, LinkWay, RunningBoard};
use host_tools::serial::ByteLink;
use host_tools::serial::clock::Clock;
use host_tools::values::{Catalogue, Subscription, Told};
use rt_firmware::behaviours::{GoTo, MAX_INSERTED, Move};
use rt_firmware::body::Request as BodyRequest;
use rt_firmware::declaration_of;

/// Numbers of requests of whoever floods the robot: the owner's client counts up from its own, and
/// comes to none of these in a test.
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
        (
            "task",
            Request::Task {
                index: 0,
                offset: 0,
            },
        ),
        ("read blob", Request::ReadBlob { offset: 0 }),
        ("states", Request::States { first: 0 }),
        ("slot counters", Request::SlotCounters { slot: 0 }),
        ("task counters", Request::TaskCounters { task_instance: 0 }),
        ("last words", Request::CrashReport),
        ("black box", Request::BlackBox { from: None }),
        ("challenge", Request::Challenge),
        (
            "param",
            Request::Param {
                mission: 1,
                param: 0,
            },
        ),
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
                salt: &[2; SALT_BYTES],
                secret: &[3; SECRET_BYTES],
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
        (
            "identify",
            Request::Identify {
                nonce: [4; NONCE_BYTES],
            },
        ),
        (
            "proven",
            Request::Proven {
                number: 9,
                proof: [6; PROOF_BYTES],
                request: &[5],
            },
        ),
    ]
}

/// What a robot with a key refuses to a stranger, and what takes nothing from an owner who asks for
/// no streams. At a robot without a key it would change what the robot does.
fn requests_of_strangers() -> Vec<(&'static str, Request<'static>)> {
    vec![
        ("hello", Request::Hello),
        ("begin", Request::Begin { len: 100, crc: 7 }),
        ("abort", Request::Abort),
        ("start", Request::Start),
        ("release", Request::Release),
        ("remove key", Request::RemoveKey),
        ("save params", Request::SaveParams { mission: 1 }),
        (
            "subscribe",
            Request::Subscribe {
                trace: true,
                log: false,
                record: true,
            },
        ),
        (
            "watch",
            Request::Watch {
                news: true,
                period_ms: 1,
            },
        ),
    ]
}

/// Each of these, and all of them mixed.
fn floods() -> Vec<(&'static str, Flood)> {
    let singly = requests();
    let singly = singly.into_iter();
    let singly = singly.map(|(name, request)| (name, Flood::One(request)));
    [("mixed", Flood::Mixed(Random::new(3)))]
        .into_iter()
        .chain(singly)
        .collect()
}

/// What costs the robot most.
const WORST: [&str; 10] = [
    "status",
    "black box",
    "identify",
    "install key",
    "listener",
    "mixed",
    "open session",
    "proven",
    "signed",
    "within",
];
/// How many times as long as on a quiet line an owner's upload takes at most.
const MOST_TIMES: f64 = 2.0;

/// What fills the line.
#[derive(Clone)]
enum Flood {
    Nothing,
    One(Request<'static>),
    /// Sessions with nonces of the robot's that seem to be young, by its time.
    Opening(Arc<Pace>),
    /// Wrong proofs under the number that the owner's next request will have.
    Listening,
    Mixed(Random),
}

impl Flood {
    /// The next frame of it, if the owner's last request had this number.
    fn frame(&mut self, count: usize, owners: u32) -> Vec<u8> {
        let seq = FLOOD_NUMBERS[count % FLOOD_NUMBERS.len()];
        match self {
            Flood::Nothing => Vec::new(),
            Flood::One(request) => frame(seq, *request),
            Flood::Opening(pace) => {
                let mut robot = [7; NONCE_BYTES];
                let at_us = pace.robot_us().saturating_sub(100_000) + count as u64 % 1_000;
                robot[..8].copy_from_slice(&at_us.to_le_bytes());
                frame(
                    seq,
                    Request::OpenSession {
                        client: [1; NONCE_BYTES],
                        robot,
                        proof: [2; PROOF_BYTES],
                    },
                )
            }
            Flood::Listening => {
                let mut proof = [0; PROOF_BYTES];
                proof[..8].copy_from_slice(&count.to_le_bytes());
                frame(
                    seq,
                    Request::Proven {
                        number: owners.wrapping_add(1),
                        proof,
                        request: &[5],
                    },
                )
            }
            Flood::Mixed(random) => {
                let all = requests();
                match random.below(all.len() + 2) {
                    0 => (0..random.below(60)).map(|_| random.bits() as u8).collect(),
                    1 => frame(
                        seq,
                        Request::Chunk {
                            offset: 7,
                            data: &[5; 90],
                        },
                    ),
                    kind => frame(seq, all[kind - 2].1),
                }
            }
        }
    }
}

/// The robot's line, which somebody else fills: of each two bytes, one is the owner's where the
/// owner has any.
#[derive(Clone)]
struct Crowded {
    line: Arc<Mutex<Box<dyn ByteLink>>>,
    flood: Arc<Mutex<(Flood, usize)>>,
    owner: Arc<Mutex<Overheard>>,
}

/// What a listener knows of the owner's requests.
#[derive(Default)]
struct Overheard {
    reader: FrameReader,
    /// The number of the last one.
    number: u32,
}

impl Overheard {
    fn hear(&mut self, bytes: &[u8]) {
        for byte in bytes {
            let message = self.reader.push(*byte).map(decode::<ToDevice>);
            if let Some(Ok(ToDevice {
                request: Request::Proven { number, .. },
                ..
            })) = message
            {
                self.number = number;
            }
        }
    }
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
                flood.frame(*count, self.owner.lock().unwrap().number)
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
        self.owner.lock().unwrap().hear(bytes);
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
    patrol_by(LinkWay::Exchange, Pace::new(false))
}

fn patrol_by(way: LinkWay, pace: Arc<Pace>) -> Robot {
    robot_by(firmware("rover"), &blob("missions/patrol.esm"), way, pace)
}

fn robot_by(firmware: PathBuf, mission: &[u8], way: LinkWay, pace: Arc<Pace>) -> Robot {
    let board = Board::emulated(firmware);
    let world = load_world(&root().join("missions/worlds/office.world")).unwrap();
    let plant = Plant::new(world, BodyParameters::default(), 1).unwrap();
    let plant = PlantSide::new(plant, pace, None);
    let (board, line) = RunningBoard::start(board, &plant, None, way).unwrap();
    let line = Crowded {
        line: Arc::new(Mutex::new(line)),
        flood: Arc::new(Mutex::new((Flood::Nothing, 0))),
        owner: Arc::default(),
    };
    let (mut client, _) = LinkClient::connect(line.clone()).unwrap();
    client.upload(mission, &mut |_| ()).unwrap();
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
        // Time goes on by what is sent, or by waiting.
        let wait = match flood {
            Flood::Nothing => Duration::from_millis(10),
            _ => Duration::ZERO,
        };
        self.line.set(flood);
        let until_s = self.now_s() + seconds;
        let mut buffer = [0; 1024];
        while self.now_s() < until_s {
            self.line.crowd(36).unwrap();
            let mut line = self.line.line.lock().unwrap();
            line.receive(&mut buffer, wait).unwrap();
        }
        self.line.set(Flood::Nothing);
    }

    /// Pieces of work that slot 0 has done.
    fn work_done(&self) -> u32 {
        let mut client = self.client();
        let mission = client.status().unwrap().mission.unwrap();
        let blob = client.running_blob().unwrap();
        let blob = esm_core::verify(blob).unwrap_or_else(|(_, refusal)| panic!("{refusal:?}"));
        let catalogue = Catalogue::read(&mut client, &blob).unwrap();
        let done = catalogue.find("meter/Says.done").unwrap().clone();
        let subscription =
            Subscription::begin(&mut client, mission, vec![done], Duration::ZERO).unwrap();
        loop {
            client.attend(Duration::from_millis(20)).unwrap();
            for event in client.take_events() {
                if let Some(Told::Sample(reading)) = subscription.read(&event)
                    && let [Some(values)] = reading.values.as_slice()
                    && let [Value::U32(done)] = values.as_slice()
                {
                    client.end_values().unwrap();
                    return *done;
                }
            }
        }
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
    /// Longer than an idle loop may be without a turn.
    const POLLED: Duration = Duration::from_secs(14);
    const OUTSTANDING: usize = 8;
    // Over the UART, which has answers taken as fast as they come.
    let robot = patrol_by(LinkWay::Uart, Pace::new(true));
    let before = robot.client().status().unwrap();
    let mut line = robot.line.line.lock().unwrap();
    let (mut answers, mut sent) = (0, 0);
    let mut buffer = [0; 1024];
    let begun = Instant::now();
    while begun.elapsed() < POLLED {
        while sent < answers + OUTSTANDING {
            let seq = FLOOD_NUMBERS[sent % FLOOD_NUMBERS.len()];
            line.send(&frame(seq, Request::Status)).unwrap();
            sent += 1;
        }
        let count = line
            .receive(&mut buffer, Duration::from_millis(50))
            .unwrap();
        let frames = buffer[..count].iter().filter(|byte| **byte == DELIMITER);
        answers += frames.count();
        if count == 0 {
            // Some were left out: they are asked for again.
            sent = answers;
        }
    }
    drop(line);
    let after = robot.assert_drives("status", before.mission);
    assert!(after.steps > before.steps + 300, "{} steps", after.steps);
    println!("{answers} answers in {POLLED:?}");
}

#[test]
fn whatever_fills_the_line_costs_no_slot_and_no_upload_much() {
    let all = environment::number("ESM_LOAD_ALL", 0) > 0;
    let robot = robot();
    // Without a key, nothing tells the owner's requests from those of others.
    if all {
        crowded_uploads(&robot, None);
    }
    robot.client().install_key(&key()).unwrap();
    crowded_uploads(&robot, Some(MOST_TIMES));
}

/// What a host can ask of the list of behaviours, right or wrong, as fast as the line takes it.
fn requests_of_the_list() -> Vec<(&'static str, Request<'static>)> {
    const NAN: [u8; 4] = f32::NAN.to_le_bytes();
    let call = |task, params| Call {
        task,
        params,
        watches: &[],
    };
    let (go_to, move_on) = (
        declaration_of::<GoTo>().signature_hash,
        declaration_of::<Move>().signature_hash,
    );
    // x, y, speed, farthest, before the head: 50 m, 0 m, 0.25 m/s, no limit, no.
    const FAR: &[u8] = &[
        0, 0, 0x48, 0x42, 0, 0, 0, 0, 0, 0, 0x80, 0x3e, 0, 0, 0, 0, 0, 0, 0, 0,
    ];
    const NOWHERE: &[u8] = &[
        NAN[0], NAN[1], NAN[2], NAN[3], 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
    ];
    let asked = Request::Behaviours;
    vec![
        ("list", Request::BehaviourList),
        (
            "insert",
            asked(BehaviourRequest::InsertAtTail(call(go_to, FAR))),
        ),
        (
            "insert at head",
            asked(BehaviourRequest::InsertAtHead(call(go_to, FAR))),
        ),
        (
            "insert nan",
            asked(BehaviourRequest::InsertAtTail(call(move_on, NOWHERE))),
        ),
        (
            "step",
            asked(BehaviourRequest::Step {
                script: 5,
                index: 3,
                call: call(go_to, FAR),
            }),
        ),
        (
            "run",
            asked(BehaviourRequest::Run {
                script: 5,
                steps: 4,
                all: 4,
            }),
        ),
        (
            "drive nan",
            Request::Drive {
                forward_m_per_s: f32::NAN,
                turn_rad_per_s: 0.0,
                until_us: u64::MAX,
            },
        ),
        (
            "drive stale",
            Request::Drive {
                forward_m_per_s: 0.2,
                turn_rad_per_s: 0.0,
                until_us: 1,
            },
        ),
    ]
}

#[test]
fn what_is_asked_of_the_list_of_behaviours_at_full_rate_costs_no_slot() {
    let mission = blob("missions/by_hand.esm");
    let robot = robot_by(
        firmware_with("lm3s6965", "behaviours"),
        &mission,
        LinkWay::Exchange,
        Pace::new(false),
    );
    let before = robot.client().status().unwrap().mission;
    for (name, request) in requests_of_the_list() {
        robot.flood(Flood::One(request), 0.5);
        robot.assert_drives(name, before);
    }
    // What was right of it was done, as far as there was room.
    let listed = robot.client().behaviour_list().unwrap();
    let inserted = (listed.entries.iter()).filter(|entry| entry.origin == Origin::Link);
    assert_eq!(inserted.count(), MAX_INSERTED, "{listed:?}");
}

/// Drives, and works in slot 0 without an end.
const WORKING: &str = "interpreter slot 1;
slot 1 period 20 ms duration 2 ms;
slot 2 period 20 ms duration 4 ms;
slot 3 period 40 ms duration 2 ms;
task Work slot 0 {}
task WorkMeter slot 2 { in data last: u32 optional; out data done: u32; }
machine Working {
    region work { task Does: Work; initial -> Does; }
    region meter { task Says: WorkMeter; initial -> Says; }
    path Says.done -> Says.last;
}";

#[test]
fn whatever_fills_the_line_leaves_slot_0_its_part() {
    /// Of what it has on a quiet line, in percent.
    const LEAST_PERCENT: u32 = 20;
    /// Longer than the link may go on with what it has saved up.
    const SECONDS: u32 = 4;
    let mission = subject::build(WORKING).unwrap().blob;
    let robot = robot_by(
        firmware("faults"),
        &mission,
        LinkWay::Exchange,
        Pace::new(false),
    );
    let done_in = |flood: Flood| {
        let before = robot.work_done();
        robot.flood(flood, f64::from(SECONDS));
        robot.work_done().wrapping_sub(before)
    };
    let quiet = done_in(Flood::Nothing);
    for (name, flood) in floods() {
        let percent = done_in(flood) * 100 / quiet;
        println!("{name:14} leaves slot 0 {percent} % of what it has on a quiet line");
        assert!(percent >= LEAST_PERCENT, "{name}: {percent} %");
    }
    // In a session of the owner's, whose numbers a listener knows.
    robot.client().install_key(&key()).unwrap();
    let mut owner = robot.client();
    owner.use_key(Box::new(|| Ok(key())));
    owner.abort().unwrap();
    let percent = done_in(Flood::Listening) * 100 / quiet;
    println!("listener leaves slot 0 {percent} % of what it has on a quiet line");
    assert!(percent >= LEAST_PERCENT, "listener: {percent} %");
}

fn key() -> SigningKey {
    SigningKey::of(&[9; 32])
}

/// Uploads on a full line for each kind of flood: their median counts.
const UPLOADS: usize = 5;

/// Uploads while the line is full, with this key if the robot has one. In the median they take so
/// many times as long as on a quiet line at most, if that is said.
fn crowded_uploads(robot: &Robot, most: Option<f64>) {
    let all = environment::number("ESM_LOAD_ALL", 0) > 0;
    let seconds = environment::number("ESM_LOAD_SECONDS", 2) as f64;
    // What a robot without a key does of it, one with a key does as well, or refuses: a part of the
    // time will do.
    let seconds = if most.is_some() {
        seconds
    } else {
        (seconds / 10.0).max(2.0)
    };
    let other = blob("missions/follow_wall.esm");
    // What the owner's upload takes of the robot's time.
    let upload_s = |blob: &[u8]| {
        let began_s = robot.now_s();
        let fl0 = robot.line.flood.lock().unwrap().1;
        let mut client = LinkClient::connect(robot.line.clone())?.0;
        client.use_key(Box::new(|| Ok(key())));
        let c_s = robot.now_s();
        client.abort()?;
        let a_s = robot.now_s();
        let mut last = a_s;
        let mut gaps = vec![];
        client.stage(blob, &mut |p| {
            let n = robot.now_s();
            gaps.push(format!("{:.0}", (n - last) * 1e3));
            last = n;
            let _ = p;
        })?;
        println!(
            "   {:.3} connect {:.3} abort {:.3} stage {:.3} {} frames {gaps:?}",
            robot.now_s() - began_s,
            c_s - began_s,
            a_s - c_s,
            robot.now_s() - a_s,
            robot.line.flood.lock().unwrap().1 - fl0
        );
        Ok::<_, ClientError>(robot.now_s() - began_s)
    };
    let quiet_s = upload_s(&other).unwrap();
    let status = robot.client().status().unwrap();
    let mut floods = floods();
    if most.is_some() {
        let more = requests_of_strangers().into_iter();
        floods.extend(more.map(|(name, request)| (name, Flood::One(request))));
        let pace = Arc::clone(robot.plant.pace());
        floods.push(("open session", Flood::Opening(pace)));
        floods.push(("listener", Flood::Listening));
    }
    floods.retain(|(name, _)| all || WORST.contains(name));
    let whose = if most.is_some() {
        "with a key"
    } else {
        "without one"
    };
    for (name, flood) in floods {
        robot.flood(flood.clone(), seconds);
        robot.assert_drives(name, status.mission);
        robot.line.set(flood);
        // A frame that is lost costs the client up to 0.2 s, whatever fills the line.
        let uploads = (0..UPLOADS).map(|_| upload_s(&other));
        let crowded_s = uploads.collect::<Result<Vec<_>, _>>().map(|mut times| {
            times.sort_by(f64::total_cmp);
            times[UPLOADS / 2]
        });
        robot.line.set(Flood::Nothing);
        match crowded_s {
            Ok(crowded_s) => println!(
                "{whose:11} {name:14} upload {crowded_s:.2} s, {:.1} times {quiet_s:.2} s",
                crowded_s / quiet_s
            ),
            Err(ref error) => println!("{whose:11} {name:14} upload did not arrive: {error}"),
        }
        if let Some(most) = most {
            let is_in_time = crowded_s
                .as_ref()
                .is_ok_and(|crowded_s| *crowded_s <= quiet_s * most);
            assert!(
                is_in_time,
                "{name}: {crowded_s:?}, {quiet_s} on a quiet line"
            );
        }
        // Let what was answered to the flood pass.
        robot.flood(Flood::Nothing, 0.0);
        robot.assert_drives(name, status.mission);
    }
}

/// When the motors of a robot were on last, in its own time, as its body sees them.
#[derive(Default)]
struct Motors {
    now_us: u64,
    on_us: u64,
}

/// A robot on patrol whose motors are watched.
fn watched_robot() -> (Emulator, Crowded, Arc<Mutex<Motors>>) {
    let world = load_world(&root().join("missions/worlds/office.world")).unwrap();
    let plant = Plant::new(world, BodyParameters::default(), 1).unwrap();
    let plant = PlantSide::new(plant, Pace::new(false), None);
    let board = Board::emulated(firmware("rover"));
    let flash = plant.flash(board.flash_bytes());
    let motors: Arc<Mutex<Motors>> = Arc::default();
    let seen = Arc::clone(&motors);
    let answer = move |request: &BodyRequest| {
        {
            let mut motors = seen.lock().unwrap();
            motors.now_us = request.start_us;
            let actuators = &request.actuators;
            if actuators.left_duty != 0 || actuators.right_duty != 0 {
                motors.on_us = request.start_us;
            }
        }
        plant.exchange(request)
    };
    let (near, line) = line::pair();
    let elf = firmware("rover");
    let board = boards::find(boards::DEFAULT).unwrap();
    let emulator =
        Emulator::start_linked(board, &elf, Idle::Passes, answer, flash, (Some(near), None))
            .unwrap();
    let line = Crowded {
        line: Arc::new(Mutex::new(Box::new(line))),
        flood: Arc::new(Mutex::new((Flood::Nothing, 0))),
        owner: Arc::default(),
    };
    let (mut client, _) = LinkClient::connect(line.clone()).unwrap();
    let mission = std::env::var("ESM_LOAD_MISSION");
    let mission = mission.as_deref().unwrap_or("missions/patrol.esm");
    client.upload(&blob(mission), &mut |_| ()).unwrap();
    (emulator, line, motors)
}

/// A stop among a flood, and what the robot's body made of it.
struct StopTrial {
    /// How long after the stop was sent the motors were on last.
    on_for_us: u64,
    /// The robot answered `Done`.
    is_told: bool,
}

/// A robot that is stopped again and again while its line is full without a pause.
struct StopTrials {
    _emulator: Emulator,
    line: Crowded,
    motors: Arc<Mutex<Motors>>,
    random: Random,
    /// When it was sent a start last.
    started_us: u64,
}

impl StopTrials {
    /// How often starts are sent again until it drives.
    const START_INTERVAL_US: u64 = 40_000;
    /// It is stopped at any time in so many microseconds: all slots are due at least twice in them.
    const STOPPED_WITHIN_US: usize = 80_000;
    /// So long it is watched at least, and until it has answered, but not for longer than the
    /// latter.
    const WATCHED_US: u64 = 60_000;
    const ANSWERED_US: u64 = 150_000;

    fn new(seed: u64) -> Self {
        let (emulator, line, motors) = watched_robot();
        let trials = StopTrials {
            _emulator: emulator,
            line,
            motors,
            random: Random::new(seed),
            started_us: 0,
        };
        trials.begin();
        trials
    }

    /// Somebody looks on and has the robot send all that it can; and the flood begins.
    fn begin(&self) {
        let mut client = LinkClient::connect(self.line.clone()).unwrap().0;
        let streams = Streams {
            trace: true,
            log: false,
            record: true,
        };
        client.subscribe(streams).unwrap();
        client.watch(Some(Duration::from_millis(200))).unwrap();
    }

    fn send(&self, seq: u8, request: Request<'_>) {
        let mut line = self.line.line.lock().unwrap();
        line.send(&frame(seq, request)).unwrap();
    }

    /// A bit of the flood, and what the robot has said.
    fn go_on<'b>(&self, buffer: &'b mut [u8]) -> &'b [u8] {
        self.line.crowd(36).unwrap();
        let mut line = self.line.line.lock().unwrap();
        let count = line.receive(buffer, Duration::ZERO).unwrap();
        &buffer[..count]
    }

    fn now_us(&self) -> u64 {
        self.motors.lock().unwrap().now_us
    }

    /// Has it drive, and the flood go on, for a while.
    fn drive(&mut self) {
        let mut buffer = [0; 1024];
        let begun_us = self.now_us();
        let mut start_us = begun_us;
        let mut until_us = None;
        loop {
            let (now_us, on_us) = {
                let motors = self.motors.lock().unwrap();
                (motors.now_us, motors.on_us)
            };
            // It stands still for a moment where it turns round.
            assert!(now_us < begun_us + 20_000_000, "it does not drive");
            let is_on = on_us == now_us && on_us > begun_us;
            if until_us.is_none() && is_on {
                until_us =
                    Some(now_us + 20_000 + self.random.below(Self::STOPPED_WITHIN_US) as u64);
            } else if until_us.is_none() && now_us >= start_us {
                self.started_us = now_us;
                for request in [Request::Release, Request::Start] {
                    let seq = self.random.bits() as u8;
                    self.send(seq, request);
                }
                start_us = now_us + Self::START_INTERVAL_US;
            }
            if is_on && until_us.is_some_and(|until_us| now_us >= until_us) {
                return;
            }
            self.go_on(&mut buffer);
        }
    }

    fn stop(&mut self, request: Request<'_>) -> StopTrial {
        // Somebody has injected another request under the same number just before.
        let injected = [
            Request::Abort,
            Request::Start,
            Request::Status,
            Request::Release,
        ];
        let seq = self.random.bits() as u8;
        let injected = injected[self.random.below(injected.len())];
        self.send(seq, injected);
        let sent_us = self.now_us();
        self.send(seq, request);
        let mut reader = FrameReader::new();
        let mut buffer = [0; 1024];
        let mut done_us = None;
        loop {
            let now_us = self.now_us();
            let is_answered = done_us.is_some() || now_us >= sent_us + Self::ANSWERED_US;
            if now_us >= sent_us + Self::WATCHED_US && is_answered {
                break;
            }
            for byte in self.go_on(&mut buffer) {
                let Some(frame) = reader.push(*byte) else {
                    continue;
                };
                if let Ok(FromDevice::Reply {
                    seq: answered,
                    result: Ok(Response::Done),
                    of,
                }) = decode(frame)
                    && (answered, of) == (seq, request.kind())
                {
                    done_us.get_or_insert(self.motors.lock().unwrap().now_us);
                }
            }
        }
        let on_us = self.motors.lock().unwrap().on_us;
        // What is answered is done: the body has seen nothing else since.
        if let Some(done_us) = done_us {
            assert!(
                on_us <= done_us,
                "{request:?} of {seq} sent at {sent_us} us behind {injected:?}, done at {done_us} \
                 us, on at {on_us} us, started last at {} us",
                self.started_us
            );
        }
        StopTrial {
            on_for_us: on_us.saturating_sub(sent_us),
            is_told: done_us.is_some(),
        }
    }

    /// Asks the robot, on a quiet line, how it is after a stop, and begins anew.
    fn look(&self, what: &str) {
        self.line.set(Flood::Nothing);
        let mut client = LinkClient::connect(self.line.clone()).unwrap().0;
        let status = client.status().unwrap();
        assert!(status.mode.is_latched(), "{what}: {status:?}");
        assert_eq!((status.missed, status.reset), (0, ResetReason::PowerOn));
        // The flash is spared where that is done again and again; the stop ends all the same.
        let released = client.release().map_err(|error| error.refusal());
        assert!(
            matches!(released, Ok(()) | Err(Some(LinkError::StopNotStored))),
            "{what}: {released:?}"
        );
        drop(client);
        self.begin();
    }
}

#[test]
fn a_stop_on_a_full_line_switches_the_motors_off_at_once() {
    /// From the last byte of the frame on.
    const MOST_US: u64 = 25_000;
    /// What may still be before the stop in the line's own buffer, and the stop: so long they are
    /// under way.
    const ON_THE_LINE_US: u64 = 2 * 3_125;
    /// Then another robot goes on: a battery lasts for some 30,000 s.
    const STOPS_A_BATTERY: u64 = 10_000;
    /// So often it is asked how it is.
    const STOPS_A_LOOK: u64 = 20;
    let stops = environment::number("ESM_LOAD_STOPS", 40);
    let seed = environment::number("ESM_SEED", 0);
    let mut trials = StopTrials::new(seed);
    let (mut longest_us, mut told) = (0, 0);
    for stop in 0..stops {
        let number = (seed << 32) + stop;
        if stop > 0 && stop % STOPS_A_BATTERY == 0 {
            trials = StopTrials::new(number);
        }
        if stop % STOPS_A_LOOK == 0 {
            trials.line.set(Flood::Mixed(Random::new(number)));
        }
        trials.drive();
        let request = match stop % 2 {
            0 => Request::Stop,
            _ => Request::EmergencyStop,
        };
        let StopTrial { on_for_us, is_told } = trials.stop(request);
        assert!(
            on_for_us <= MOST_US + ON_THE_LINE_US,
            "stop {stop}: motors on {on_for_us} us after it was sent"
        );
        longest_us = longest_us.max(on_for_us);
        told += u64::from(is_told);
        if (stop + 1) % STOPS_A_LOOK == 0 || stop + 1 == stops {
            trials.look(&format!("stop {stop}"));
        }
        if (stop + 1) % 1_000 == 0 {
            println!(
                "{} stops: {longest_us} us at most, {told} answered",
                stop + 1
            );
        }
    }
    println!(
        "{stops} stops, motors on for {longest_us} us at most after one was sent; {told} answered `Done`, none falsely"
    );
    assert!(told > 0, "no stop was answered");
}
