//! A robot that lies, or whoever answers in its place, in a time of its own: it knows what an
//! honest robot answers, and changes that.
//!
//! All of a session follows from its seed. What it does is *structure-aware*: frames, checksums and
//! numbers of requests are right where nothing is to be learnt from wrong ones, so that what the
//! robot says reaches what believes it.

use std::collections::VecDeque;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;

use esm_link::access::Access;
use esm_link::behaviours::{BehaviourRequest, ListEntry, Origin, ScriptState, ScriptStatus};
use esm_link::frame::{self, FrameReader, MAX_FRAME_BYTES, MAX_MESSAGE_BYTES};
use esm_link::message::{
    Capacities, Channel, CrashReport, DeviceInfo, FromDevice, LinkError, Mode, Request, Response,
    Status, Stream, Swap, ToDevice, Uploads,
};
use esm_link::telemetry::Ask;
use host_tools::host_board::{self, HostBoard};
use host_tools::link_client::{LinkClient, Streams};
use host_tools::lockstep::pace::Pace;
use host_tools::lockstep::plant_side::PlantSide;
use host_tools::plant::{BodyParameters, Plant};
use host_tools::run::interrupt;
use host_tools::serial::ByteLink;
use host_tools::serial::clock::{Clock, SimulatedTime};
use host_tools::world::World;
use serde::ser::{Serialize, SerializeTuple, Serializer};

use crate::random::Random;

/// What a byte takes on a line of 115,200 bits a second.
const BYTE_US: u64 = 87;

/// How long a mission is on trial, as it says.
pub const TRIAL_S: u32 = 60;

/// What a macro step takes.
const STEP_US: u64 = 20_000;

/// What it says that values are made of.
const FIELDS: &[u8] = b"x_m:f32\ny:[u8;2]\n";

/// Bytes of a part of a blob, as honest robots send them.
const PART_BYTES: usize = 128;

/// Time that passes for a session, and when somebody presses Ctrl-C in it.
#[derive(Debug, Default)]
pub struct SessionTime {
    now_us: AtomicU64,
    interrupt_us: AtomicU64,
}

impl SessionTime {
    /// A time in which Ctrl-C is pressed after so long, or never.
    pub fn new(interrupt: Option<Duration>) -> Self {
        let at = interrupt.map_or(u64::MAX, |after| after.as_micros() as u64);
        SessionTime {
            now_us: AtomicU64::new(0),
            interrupt_us: AtomicU64::new(at),
        }
    }

    fn pass(&self, time_us: u64) {
        let now_us = self.now_us.fetch_add(time_us, Relaxed) + time_us;
        if now_us >= self.interrupt_us.load(Relaxed) {
            interrupt::request(true);
        }
    }
}

impl SimulatedTime for SessionTime {
    fn elapsed(&self) -> Duration {
        Duration::from_micros(self.now_us.load(Relaxed))
    }

    fn pause(&self, time: Duration) {
        self.pass(time.as_micros() as u64);
    }
}

/// What an honest robot answered once: requests, and what came of them, as bytes.
pub struct Honest {
    answers: Vec<(Vec<u8>, Vec<u8>)>,
    /// Messages that nobody asked for.
    streams: Vec<Vec<u8>>,
    /// Missions that a robot may run, all of them valid: names of some are hostile.
    blobs: Vec<Vec<u8>>,
}

/// A line that keeps what passes over it.
struct Tapped<'h, L> {
    line: L,
    honest: &'h std::sync::Mutex<Honest>,
    asked: FrameReader,
    answered: FrameReader,
    open: Vec<(u8, Vec<u8>)>,
}

impl<L: ByteLink> ByteLink for Tapped<'_, L> {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let count = self.line.receive(buffer, timeout)?;
        let mut honest = self.honest.lock().map_err(|_| io::ErrorKind::Other)?;
        for byte in buffer.iter().take(count) {
            let Some(frame) = self.answered.push(*byte) else {
                continue;
            };
            match frame::decode::<FromDevice<'_>>(frame) {
                Ok(FromDevice::Reply { seq, result, .. }) => {
                    let asked = self.open.iter().find(|(open, _)| *open == seq);
                    if let (Some((_, asked)), Ok(bytes)) = (asked, postcard::to_stdvec(&result)) {
                        honest.answers.push((asked.clone(), bytes));
                    }
                }
                Ok(other) => honest.streams.extend(postcard::to_stdvec(&other)),
                Err(_) => {}
            }
        }
        Ok(count)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        for byte in bytes {
            let Some(frame) = self.asked.push(*byte) else {
                continue;
            };
            if let Ok(ToDevice { seq, request }) = frame::decode(frame) {
                let request = match request {
                    Request::Within { request, .. } => request.to_vec(),
                    request => postcard::to_stdvec(&request).unwrap_or_default(),
                };
                self.open.retain(|(open, _)| *open != seq);
                self.open.push((seq, request));
            }
        }
        self.line.send(bytes)
    }
}

impl Honest {
    /// Asks the robot of the board `host` for all that can be asked, with this mission.
    ///
    /// # Panics
    /// If it does not answer.
    #[expect(
        clippy::unwrap_used,
        reason = "a test without an honest robot has failed"
    )]
    pub fn learn(blob: &[u8]) -> Self {
        let honest = std::sync::Mutex::new(Honest {
            answers: Vec::new(),
            streams: Vec::new(),
            blobs: vec![blob.to_vec()],
        });
        let world = "world cell\n start 1,1 0\n wall 0,0 3,0 3,3 0,3 0,0";
        let plant = Plant::new(World::parse(world).unwrap(), BodyParameters::default(), 1);
        let plant = PlantSide::new(plant.unwrap(), Pace::new(true), None);
        let (_board, line) = HostBoard::start(host_board::rover, plant, None).unwrap();
        let tapped = Tapped {
            line,
            honest: &honest,
            asked: FrameReader::new(),
            answered: FrameReader::new(),
            open: Vec::new(),
        };
        let (mut robot, info) = LinkClient::connect(tapped).unwrap();
        robot.stage(blob, &mut |_| ()).unwrap();
        let swap = Swap {
            trial_ms: TRIAL_S * 1_000,
            ..Swap::default()
        };
        let hash = robot.commit(swap).unwrap().mission;
        for index in 0..info.task_types {
            robot.task_declaration(index).unwrap();
        }
        robot.running_blob().unwrap();
        robot.status().unwrap();
        robot.crash_report().unwrap();
        robot.black_box().unwrap();
        robot.current_states().unwrap();
        robot.slot_counters(0).unwrap();
        robot.task_counters(0).unwrap();
        let value = robot.param(hash, 0).unwrap().value;
        robot.set_param(hash, 0, value).unwrap();
        robot.fields(hash, 0).unwrap();
        robot.values(hash, &[0, 1], Duration::ZERO).unwrap();
        robot.watch(Some(Duration::from_millis(50))).unwrap();
        let all = Streams {
            trace: true,
            log: true,
            record: true,
        };
        robot.subscribe(all).unwrap();
        for _ in 0..40 {
            robot.attend(Duration::from_millis(10)).unwrap();
        }
        robot.confirm(hash).ok();
        robot.stop().unwrap();
        robot.start().unwrap();
        robot.emergency_stop().unwrap();
        robot.release().unwrap();
        drop(robot);
        let mut honest = honest.into_inner().unwrap();
        assert!(honest.streams.len() > 10, "the robot has told nothing");
        honest.spoil_names();
        honest
    }

    /// Adds missions in whose texts letters are others, as far as they are valid all the same.
    fn spoil_names(&mut self) {
        const WANTED: usize = 40;
        let mut random = Random::new(5);
        let first = self.blobs.first().cloned().unwrap_or_default();
        for _ in 0..20_000 {
            if self.blobs.len() > WANTED {
                break;
            }
            let mut blob = first.clone();
            let end = blob.len() - 4;
            for _ in 0..random.between(1, 6) {
                let from = random.below(end);
                let letters = (from..end).find(|at| {
                    let letters = blob.get(*at..*at + 3);
                    letters.is_some_and(|letters| letters.iter().all(u8::is_ascii_alphabetic))
                });
                let Some(at) = letters else { continue };
                let spoilt: &[u8] = match random.below(6) {
                    0 => b"\x1b",
                    1 => "\u{9b}".as_bytes(),
                    2 => "\u{202e}".as_bytes(),
                    3 => b"\x07\x1b",
                    4 => b"\r",
                    _ => b"\x9b\xff",
                };
                blob[at..at + spoilt.len()].copy_from_slice(spoilt);
            }
            let crc = frame::checksum(&blob[..end]);
            blob[end..].copy_from_slice(&crc.to_le_bytes());
            if esm_core::verify(blob.clone()).is_ok() {
                self.blobs.push(blob);
            }
        }
    }

    /// What came of this request, or else of one of its kind.
    fn answer(&self, request: &Request<'_>, random: &mut Random) -> Option<&[u8]> {
        let asked = postcard::to_stdvec(request).unwrap_or_default();
        let same = |(known, _): &&(Vec<u8>, Vec<u8>)| *known == asked;
        let kind = |(known, _): &&(Vec<u8>, Vec<u8>)| known.first() == asked.first();
        let found = self.answers.iter().rfind(same).or_else(|| {
            let all: Vec<_> = self.answers.iter().filter(kind).collect();
            all.get(random.below(all.len())).copied()
        });
        found.map(|(_, answer)| &answer[..])
    }
}

/// How a robot lies. Parts of 100.
#[derive(Clone, Copy, Debug, Default)]
struct Character {
    /// Answers that are made up.
    made_up: usize,
    /// Answers of which bytes are changed.
    changed: usize,
    /// Refusals.
    refuses: usize,
    /// Requests that are not answered.
    silent: usize,
    /// Answers that come late, and how late at most.
    late: usize,
    late_us: usize,
    /// Parts of answers that are as short as can be, so that they go on and on.
    short: usize,
    /// Streams that come whenever nothing else does.
    floods: usize,
    /// Bytes that are no frames, whenever nothing else comes.
    noise: usize,
}

impl Character {
    fn chosen(random: &mut Random) -> Self {
        let some = Character {
            made_up: 15,
            changed: 10,
            ..Character::default()
        };
        match random.below(12) {
            // Its words and numbers alone are lies, now and then one of its answers.
            10 => Character::default(),
            11 => Character {
                made_up: 2,
                changed: 1,
                ..Character::default()
            },
            0 => Character {
                made_up: 40,
                ..some
            },
            1 => Character {
                changed: 40,
                ..some
            },
            2 => Character {
                floods: 100,
                ..some
            },
            3 => Character { noise: 100, ..some },
            4 => Character {
                floods: 50,
                noise: 50,
                ..some
            },
            5 => Character {
                late: 60,
                late_us: 31_000_000,
                ..some
            },
            6 => Character {
                short: 100,
                late: 100,
                late_us: 900_000,
                made_up: 2,
                ..Character::default()
            },
            7 => Character {
                refuses: 40,
                ..some
            },
            8 => Character {
                silent: 30,
                late: 20,
                late_us: 500_000,
                ..some
            },
            _ => some,
        }
    }
}

/// How a robot takes an upload that is honest otherwise, or seems so.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taker {
    /// All of it, and each byte takes so long.
    Slow(Duration),
    /// One byte of each chunk, and says so after this time.
    OneByte(Duration),
    /// It says after this time that it has not a byte yet.
    Nothing(Duration),
    /// It says after this time that nobody has begun an upload.
    Forgetful(Duration),
}

/// The line to a robot that lies.
pub struct Liar {
    /// It does so with uploads alone, in this way.
    taker: Option<Taker>,
    /// When it has taken the bytes that it got so far.
    taken_us: u64,
    /// How many of an upload's bytes it has taken.
    taken: u32,
    time: Arc<SessionTime>,
    honest: Arc<Honest>,
    random: Random,
    character: Character,
    /// The mission that it says it runs.
    blob: usize,
    /// Whether that is on trial.
    on_trial: bool,
    /// What it does, if it was told to.
    mode: Option<Mode>,
    /// Number of the request for values, if they were asked for.
    samples: Option<u8>,
    /// Parts of streams that it has sent by itself.
    parts: u8,
    /// When the line breaks.
    cut_us: u64,
    reader: FrameReader,
    /// What is on its way to the host, and from when on it can be there.
    to_host: VecDeque<(u64, Vec<u8>)>,
}

/// Bytes that are serialized as they are.
struct Raw<'a>(&'a [u8]);

impl Serialize for Raw<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut tuple = serializer.serialize_tuple(self.0.len())?;
        for byte in self.0 {
            tuple.serialize_element(byte)?;
        }
        tuple.end()
    }
}

fn framed(message: &[u8]) -> Vec<u8> {
    let mut frame = [0; MAX_FRAME_BYTES];
    let message = message.get(..MAX_MESSAGE_BYTES).unwrap_or(message);
    let length = frame::encode(&Raw(message), &mut frame).unwrap_or(0);
    frame[..length].to_vec()
}

/// Numbers at which something ends.
fn edge(random: &mut Random) -> u64 {
    const EDGES: [u64; 16] = [
        0,
        1,
        2,
        7,
        127,
        128,
        255,
        256,
        4_096,
        65_534,
        65_535,
        65_536,
        0x7fff_ffff,
        0x8000_0000,
        0xffff_ffff,
        u64::MAX,
    ];
    match random.below(3) {
        0 => random.bits() >> random.below(64),
        _ => EDGES[random.below(EDGES.len())],
    }
}

/// Text that does something to a terminal.
fn text(random: &mut Random, most: usize) -> String {
    const PIECES: [&str; 20] = [
        "rover",
        "x:f32\n",
        "x:[u32;18446744073709551615]\n",
        "a_m_per_s:[f32;65536]\n",
        "\x1b[2J",
        "\x1b]0;title\x07",
        "\x1b]52;c;cm0gLXJm\x07",
        "\u{9b}31m",
        "\u{9d}0;t\u{9c}",
        "\u{202e}",
        "\u{2066}",
        "\u{feff}",
        "\u{2028}",
        "\r",
        "\n",
        "\t",
        "\0",
        "\x7f",
        "\u{e0041}",
        "task A { in data x: f32; }\n",
    ];
    let mut text = String::new();
    for _ in 0..random.between(0, 8) {
        let piece = PIECES[random.below(PIECES.len())];
        if text.len() + piece.len() <= most {
            text += piece;
        }
    }
    text
}

/// The same, or bytes that are no text.
fn bytes(random: &mut Random, most: usize) -> Vec<u8> {
    match random.below(3) {
        0 => (0..random.between(0, most))
            .map(|_| random.bits() as u8)
            .collect(),
        _ => text(random, most).into_bytes(),
    }
}

impl Liar {
    /// A robot that lies as follows from the seed, in this time.
    pub fn new(honest: Arc<Honest>, time: Arc<SessionTime>, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let character = Character::chosen(&mut random);
        Liar {
            taker: None,
            taken_us: 0,
            taken: 0,
            blob: random.below(honest.blobs.len()),
            on_trial: random.below(3) == 0,
            mode: None,
            samples: None,
            parts: 0,
            cut_us: match random.below(50) {
                0 => random.below(40_000_000) as u64,
                _ => u64::MAX,
            },
            time,
            honest,
            character,
            random,
            reader: FrameReader::new(),
            to_host: VecDeque::new(),
        }
    }

    /// A robot that is honest but for how it takes an upload.
    pub fn taking(honest: Arc<Honest>, time: Arc<SessionTime>, taker: Taker) -> Self {
        Liar {
            taker: Some(taker),
            character: Character::default(),
            blob: 0,
            on_trial: false,
            cut_us: u64::MAX,
            ..Liar::new(honest, time, 0)
        }
    }

    /// What it says of a chunk, or of the beginning of an upload, and how much later.
    fn take(&mut self, taker: Taker, request: &Request<'_>) -> Option<(Vec<u8>, Duration)> {
        let (offset, bytes) = match *request {
            Request::Begin { .. } => (0, 0),
            Request::Chunk { offset, data } => (offset, data.len() as u32),
            _ => return None,
        };
        let (result, late) = match taker {
            Taker::Slow(byte) => {
                let new = (offset + bytes).saturating_sub(self.taken);
                let busy_us = u64::from(new) * byte.as_micros() as u64;
                let now_us = self.now_us();
                self.taken += new;
                self.taken_us = self.taken_us.max(now_us) + busy_us;
                let late = Duration::from_micros(self.taken_us - now_us);
                (Ok(Response::Received { len: self.taken }), late)
            }
            Taker::OneByte(late) => {
                let brings = (offset..offset + bytes).contains(&self.taken);
                self.taken += u32::from(brings);
                (Ok(Response::Received { len: self.taken }), late)
            }
            Taker::Nothing(late) => (Ok(Response::Received { len: 0 }), late),
            Taker::Forgetful(late) => match bytes {
                0 => (Ok(Response::Received { len: 0 }), late),
                _ => (Err(LinkError::NoUpload), late),
            },
        };
        Some((postcard::to_stdvec(&result).unwrap_or_default(), late))
    }

    fn now_us(&self) -> u64 {
        self.time.now_us.load(Relaxed)
    }

    fn one_of(&mut self, parts_of_100: usize) -> bool {
        self.random.below(100) < parts_of_100
    }

    /// A part of bytes from an offset, as its length is told.
    fn part(&mut self, of: &[u8], offset: usize) -> Vec<u8> {
        let most = if self.one_of(self.character.short) {
            1
        } else {
            PART_BYTES
        };
        let from = offset.min(of.len());
        of[from..of.len().min(from + most)].to_vec()
    }

    fn answer(&mut self, seq: u8, request: &Request<'_>) {
        if let Request::Within { request, .. }
        | Request::Signed { request, .. }
        | Request::Proven { request, .. } = request
        {
            let inner = request.to_vec();
            if let Ok(inner) = postcard::from_bytes::<Request<'_>>(&inner) {
                return self.answer(seq, &inner);
            }
        }
        if let Some(taker) = self.taker
            && let Some((result, late)) = self.take(taker, request)
        {
            let frame = framed(&[&[0, seq], &result[..], &[request.kind()]].concat());
            let at = self.now_us() + late.as_micros() as u64;
            self.to_host.push_back((at, frame));
            return;
        }
        let Character {
            silent,
            refuses,
            changed,
            made_up,
            late,
            late_us,
            ..
        } = self.character;
        if self.one_of(silent) {
            return;
        }
        let mut result = if self.one_of(refuses) {
            let refused: Result<Response<'_>, LinkError> = Err(self.refusal());
            postcard::to_stdvec(&refused).unwrap_or_default()
        } else if self.one_of(made_up) {
            self.made_up(request)
        } else {
            self.true_to_its_lie(seq, request)
        };
        if self.one_of(changed) {
            for _ in 0..self.random.between(1, 4) {
                let at = self.random.below(result.len().max(1));
                match self.random.below(4) {
                    0 => result.truncate(at),
                    1 => result.insert(at.min(result.len()), self.random.bits() as u8),
                    2 => result.extend(bytes(&mut self.random, 20)),
                    _ => {
                        if let Some(byte) = result.get_mut(at) {
                            *byte = self.random.bits() as u8;
                        }
                    }
                }
            }
        }
        // Now and then under another number, and twice.
        let number = if self.one_of(3) {
            self.random.bits() as u8
        } else {
            seq
        };
        let frame = framed(&[&[0, number], &result[..], &[request.kind()]].concat());
        let delay_us = if self.one_of(late) {
            self.random.below(late_us.max(1))
        } else {
            500
        };
        let at = self.now_us() + delay_us as u64;
        if self.one_of(3) {
            self.to_host.push_back((at, frame.clone()));
        }
        self.to_host.push_back((at, frame));
    }

    fn refusal(&mut self) -> LinkError {
        let number = edge(&mut self.random);
        match self.random.below(14) {
            0 => LinkError::Busy,
            1 => LinkError::NoAnswer,
            2 => LinkError::TooSoon { ms: number as u32 },
            3 => LinkError::Late,
            4 => LinkError::Malformed,
            5 => LinkError::NoUpload,
            6 => LinkError::WrongOffset {
                expected: number as u32,
            },
            7 => LinkError::NoMission,
            8 => LinkError::UnknownTask {
                task: number as u16,
            },
            9 => LinkError::ParamOutside {
                min: number as u32,
                max: 0,
            },
            10 => LinkError::NotBuiltIn,
            11 => LinkError::NotOnTrial,
            12 => LinkError::OtherMission,
            _ => LinkError::OldCounter { last: number },
        }
    }

    /// What an honest robot answers that runs this mission, has a key mostly, and whose words are
    /// hostile now and then.
    fn true_to_its_lie(&mut self, seq: u8, request: &Request<'_>) -> Vec<u8> {
        let honest = Arc::clone(&self.honest);
        let blob = &honest.blobs[self.blob];
        let hash = blob.last_chunk().map(|crc| u32::from_le_bytes(*crc));
        let known = honest.answer(request, &mut self.random);
        let known: Option<Result<Response<'_>, LinkError>> =
            known.and_then(|known| postcard::from_bytes(known).ok());
        let (data, name);
        let response = match (*request, known) {
            (Request::Hello, Some(Ok(Response::Hello(info)))) => {
                name = text(&mut self.random, 20);
                let access = match self.random.below(20) {
                    0 => Access::Locked,
                    1 => Access::Unreadable,
                    _ => Access::Open,
                };
                let is_plain = self.random.below(2) == 0;
                Ok(Response::Hello(DeviceInfo {
                    firmware: if is_plain { info.firmware } else { &name },
                    mission: hash,
                    access,
                    ..info
                }))
            }
            (Request::Status, Some(Ok(Response::Status(status)))) => {
                let status = Status {
                    mission: hash,
                    mode: self.mode.unwrap_or(status.mode),
                    trial: status.trial.filter(|_| self.on_trial),
                    t_us: self.now_us(),
                    steps: self.now_us() / STEP_US,
                    ..status
                };
                Ok(Response::Status(status))
            }
            (Request::ReadBlob { offset }, _) => {
                data = self.part(blob, offset as usize);
                let total = blob.len() as u32;
                Ok(Response::Blob { total, data: &data })
            }
            (Request::Values { ask }, _) => match Ask::of(ask) {
                Ok(Ask::Fields { offset, .. }) => {
                    data = self.part(FIELDS, offset.into());
                    let total = FIELDS.len() as u16;
                    Ok(Response::TaskText { total, text: &data })
                }
                _ => {
                    self.samples = Some(seq);
                    Ok(Response::Done)
                }
            },
            (Request::Begin { len, .. }, _) => {
                let len = len / 2 * self.random.below(2) as u32;
                Ok(Response::Received { len })
            }
            (Request::Chunk { offset, data }, _) => {
                let brought = if self.one_of(self.character.short) {
                    1
                } else {
                    data.len()
                };
                Ok(Response::Received {
                    len: offset + brought as u32,
                })
            }
            (Request::Stop | Request::EmergencyStop | Request::Release | Request::Start, _) => {
                self.mode = Some(match request {
                    Request::EmergencyStop => Mode::EmergencyStopped,
                    Request::Start => Mode::Running,
                    _ => Mode::Stopped,
                });
                Ok(Response::Done)
            }
            (Request::Commit(_), _) => {
                self.on_trial = true;
                Ok(Response::Committed {
                    mission: hash.unwrap_or(1),
                    carried: 0,
                })
            }
            (Request::BehaviourList, _) => {
                data = listed(&mut self.random);
                let entries = &data;
                let script = ScriptStatus::default();
                Ok(Response::BehaviourList { script, entries })
            }
            (Request::Behaviours(BehaviourRequest::KeptScript), _) => Ok(Response::BehaviourList {
                script: ScriptStatus {
                    script: edge(&mut self.random) as u32,
                    steps: 1,
                    ended: 0,
                    state: ScriptState::Runs,
                },
                entries: &[],
            }),
            (
                Request::Behaviours(
                    BehaviourRequest::InsertAtTail(_) | BehaviourRequest::InsertAtHead(_),
                ),
                _,
            ) => Ok(Response::Behaviour {
                key: edge(&mut self.random) as u16,
            }),
            (Request::Confirm { .. } | Request::FallBack { .. }, _) => {
                self.on_trial = false;
                Ok(Response::Done)
            }
            // What the board `host` has no flash for.
            (Request::SaveParams { .. }, _) => Ok(Response::ParamsSaved { count: 1 }),
            (Request::Challenge, _) => Ok(Response::Challenge {
                nonce: Default::default(),
                counter: edge(&mut self.random),
            }),
            (_, Some(known)) => known,
            (_, None) => Ok(Response::Done),
        };
        postcard::to_stdvec(&response).unwrap_or_default()
    }

    /// An answer of the right kind that is made up.
    fn made_up(&mut self, request: &Request<'_>) -> Vec<u8> {
        let honest = Arc::clone(&self.honest);
        let random = &mut self.random;
        let known = honest.answer(request, random);
        let known: Option<Result<Response<'_>, LinkError>> =
            known.and_then(|known| postcard::from_bytes(known).ok());
        let (some, other) = (text(random, 40), text(random, 40));
        let data = bytes(random, 100);
        let (one, two, three) = (edge(random), edge(random), edge(random));
        let response = match (*request, known) {
            (Request::Hello, Some(Ok(Response::Hello(info)))) => Response::Hello(DeviceInfo {
                firmware: &some,
                board: if random.below(2) == 0 {
                    info.board
                } else {
                    &other
                },
                task_types: edge(random) as u8,
                capacities: Capacities {
                    blob_bytes: edge(random) as u32,
                    arena_words: edge(random) as u32,
                    slots: edge(random) as u16,
                    task_instances: edge(random) as u16,
                    nets: edge(random) as u16,
                    exclusive_groups: edge(random) as u16,
                },
                uploads: Uploads {
                    chunk_bytes: edge(random) as u16,
                    window_bytes: edge(random) as u16,
                },
                ..info
            }),
            (Request::BehaviourList, _) => Response::BehaviourList {
                script: ScriptStatus {
                    script: one as u32,
                    steps: two as u8,
                    ended: three as u8,
                    state: ScriptState::Runs,
                },
                entries: &data,
            },
            (Request::Task { .. } | Request::Values { .. }, _) => Response::TaskText {
                total: match random.below(3) {
                    0 => one as u16,
                    1 => data.len() as u16,
                    _ => 2_000,
                },
                text: &data,
            },
            (Request::ReadBlob { .. }, _) => Response::Blob {
                total: match random.below(2) {
                    0 => one as u32,
                    _ => data.len() as u32,
                },
                data: &data,
            },
            (Request::States { .. }, _) => Response::States {
                step: one,
                total: two as u16,
                states: &data,
            },
            (Request::BlackBox { from }, _) => Response::BlackBox {
                end: from.map_or(one as u32, |from| from.wrapping_add(two as u32)),
                records: &data,
            },
            (Request::CrashReport, Some(Ok(Response::CrashReport { words, .. }))) => {
                Response::CrashReport {
                    words: CrashReport {
                        after_us: one,
                        line: two as u32,
                        ..words
                    },
                    file: &data,
                }
            }
            (Request::Status, Some(Ok(Response::Status(status)))) => Response::Status(Status {
                mission: match random.below(3) {
                    0 => None,
                    1 => status.mission,
                    _ => Some(one as u32),
                },
                steps: two,
                t_us: three,
                max_delay_ns: one as u32,
                ..status
            }),
            (Request::Clock, _) => Response::Clock { now_us: one },
            (Request::Param { .. }, _) => Response::Param {
                value: one as u32,
                of_mission: two as u32,
                saved: Some(three as u32),
            },
            (Request::Begin { .. } | Request::Chunk { .. }, _) => {
                Response::Received { len: one as u32 }
            }
            (Request::Challenge, _) => Response::Challenge {
                nonce: Default::default(),
                counter: one,
            },
            // Something else altogether.
            _ => match random.below(3) {
                0 => Response::Done,
                1 => Response::TaskText {
                    total: one as u16,
                    text: &data,
                },
                _ => Response::Committed {
                    mission: one as u32,
                    carried: two as u16,
                },
            },
        };
        let result: Result<Response<'_>, LinkError> = Ok(response);
        postcard::to_stdvec(&result).unwrap_or_default()
    }

    /// What comes when nothing else does.
    fn unasked(&mut self) {
        let now = self.now_us();
        if let Some(number) = self.samples
            && self.one_of(50)
        {
            // Values of two nets, in words: the head, which nets, the time, and what is on them.
            let head = u32::from_le_bytes([number, 0, 0, 0]);
            let words = [
                head,
                3,
                now as u32,
                0,
                1.5_f32.to_bits(),
                7,
                8,
                0x7fc0_0000,
                1,
                2,
            ];
            let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
            let part = FromDevice::Stream(Stream {
                channel: Channel::Values,
                seq: self.parts,
                continues: false,
                dropped: 0,
                bytes: &bytes,
            });
            self.parts = self.parts.wrapping_add(1);
            let message = postcard::to_stdvec(&part).unwrap_or_default();
            self.to_host.push_back((now + STEP_US, framed(&message)));
        }
        if self.one_of(self.character.noise) {
            let bytes = (0..64).map(|_| self.random.bits() as u8 & self.random.bits() as u8);
            let bytes = bytes.collect();
            self.to_host.push_back((now, bytes));
        }
        if self.one_of(self.character.floods) {
            let message = if self.random.below(3) == 0 {
                let honest = Arc::clone(&self.honest);
                let known = &honest.streams[self.random.below(honest.streams.len())];
                known.clone()
            } else {
                let channels = [
                    Channel::Trace,
                    Channel::Log,
                    Channel::Record,
                    Channel::Values,
                ];
                let bytes = match self.random.below(3) {
                    0 => vec![b'A'; 96],
                    _ => bytes(&mut self.random, 96),
                };
                let part = FromDevice::Stream(Stream {
                    channel: channels[self.random.below(channels.len())],
                    seq: self.random.bits() as u8,
                    continues: self.random.below(4) != 0,
                    dropped: edge(&mut self.random) as u32,
                    bytes: &bytes,
                });
                postcard::to_stdvec(&part).unwrap_or_default()
            };
            self.to_host.push_back((now, framed(&message)));
        }
    }
}

impl ByteLink for Liar {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        // A call takes its time, too.
        self.time.pass(1);
        if self.now_us() >= self.cut_us {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let is_due = |at: u64, now: u64| at <= now;
        if !self
            .to_host
            .iter()
            .any(|(at, _)| is_due(*at, self.now_us()))
        {
            self.unasked();
        }
        let soonest = self.to_host.iter().map(|(at, _)| *at).min();
        let until = self.now_us() + timeout.as_micros() as u64;
        let Some(soonest) = soonest.filter(|at| *at <= until) else {
            self.time.pause(timeout);
            return Ok(0);
        };
        self.time.pass(soonest.saturating_sub(self.now_us()));
        let now = self.now_us();
        let Some(place) = self.to_host.iter().position(|(at, _)| is_due(*at, now)) else {
            return Ok(0);
        };
        let Some((at, bytes)) = self.to_host.remove(place) else {
            return Ok(0);
        };
        let count = bytes.len().min(buffer.len());
        buffer[..count].copy_from_slice(&bytes[..count]);
        if count < bytes.len() {
            self.to_host.push_front((at, bytes[count..].to_vec()));
        }
        self.time.pass(count as u64 * BYTE_US);
        Ok(count)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.time.pass(bytes.len() as u64 * BYTE_US);
        for byte in bytes {
            let mut asked = [0; MAX_FRAME_BYTES];
            let Some(frame) = self.reader.push(*byte) else {
                continue;
            };
            let length = frame.len();
            asked[..length].copy_from_slice(frame);
            if let Ok(ToDevice { seq, request }) = frame::decode(&mut asked[..length]) {
                self.answer(seq, &request);
            }
        }
        Ok(())
    }

    fn clock(&self) -> Clock {
        Clock::simulated(self.time.clone())
    }
}

/// What may stand on a list of behaviours.
fn listed(random: &mut Random) -> Vec<u8> {
    let entries = (0..random.below(10)).flat_map(|_| {
        let entry = ListEntry {
            key: random.bits() as u16,
            task: random.bits() as u16,
            state: random.below(8) as u8,
            origin: Origin::Mission,
            is_held: random.below(2) == 0,
        };
        entry.to_bytes()
    });
    entries.collect()
}
