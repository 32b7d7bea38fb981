//! An attacker in the line between a robot with a key and its owner, who alters, holds, reorders,
//! repeats, drops and invents frames of both directions.
//!
//! Robot's end and owner's end are those that ship; line and time are simulated. What must hold:
//! nothing is carried out that the owner has not signed in the ten seconds before, nothing twice;
//! what the owner's client says is what the robot has said; and when the attacker goes, the owner
//! can do everything.

use std::collections::{HashMap, HashSet, VecDeque};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use esm_link::access::{Access, NONCE_BYTES, PROOF_BYTES};
use esm_link::frame::{DELIMITER, FrameReader, MAX_FRAME_BYTES, encode, parse, unpack};
use esm_link::key_store::{KeyStore, NotStored, StoredKey, Volatile, WriteError};
use esm_link::message::{
    FromDevice, LinkError, Mode, Request, Response, Status, ToDevice, UNKNOWN,
};
use host_tools::keys::SigningKey;
use host_tools::link_client::{ClientError, LinkClient};
use host_tools::serial::ByteLink;
use host_tools::serial::clock::{Clock, SimulatedTime};
use rt_firmware::{
    About, Board, Io, Limits, LinkPort, LinkSide, Mailbox, Memory, RealTime, Step, Task, TaskPool,
    registry, split, task,
};

use crate::random::Random;
use crate::subject;

const BLOB_BYTES: usize = 2_048;
const SLOTS: usize = 4;

/// Kinds of requests.
const STATUS: u8 = Request::Status.kind();
const CLOCK: u8 = Request::Clock.kind();
const CHALLENGE: u8 = Request::Challenge.kind();
const SET_PARAM: u8 = Request::SetParam {
    mission: 0,
    param: 0,
    value: 0,
}
.kind();

/// How long a frame takes on the line.
const FRAME_US: u64 = 5_000;
/// The most that anything is held.
const LONGEST_HOLD_US: usize = 60_000_000;
/// How long after it was signed a command may be carried out.
const SIGNED_LIFE_US: u64 = 10_000_000;
/// Frames that an attacker keeps for later.
const KEPT_FRAMES: usize = 200;

struct Lamp;
task! { impl Lamp { flags { out lit; } params { limit: u32 = 1, 1..=4000000000; } } }
impl Task for Lamp {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        io.set(Self::LIT, true);
        Step::Run
    }
}

registry! {
    struct Lamps { lamp: Lamp[1] }
}

const MISSION: &str =
    "interpreter slot 1; slot 1 period 10 ms duration 1 ms; slot 2 period 5 ms duration 1 ms;
task Lamp slot 2 { out flag lit; param limit: u32 = 1; }
machine M { region r { task On: Lamp; state Off; initial -> On; On -> Off on pulse [.lit]; } }";

/// The value that the mission gives its parameter.
const OWN_VALUE: u32 = 1;

#[derive(Default)]
struct Time(AtomicU64);

impl SimulatedTime for Time {
    fn elapsed(&self) -> Duration {
        Duration::from_micros(self.0.load(Ordering::Relaxed))
    }

    fn pause(&self, time: Duration) {
        self.0.fetch_add(time.as_micros() as u64, Ordering::Relaxed);
    }
}

struct Timer {
    now_us: u64,
    motors_off: u64,
}

impl Board for Timer {
    const TICKS_PER_US: u32 = 1;
    const START_LEAD_US: u32 = 0;
    fn now_ticks(&mut self) -> u64 {
        self.now_us
    }
    fn motors_off(&mut self) {
        self.motors_off += 1;
    }
}

/// The robot's end of the line, and where it keeps its key.
#[derive(Default)]
struct Wire {
    to_robot: VecDeque<u8>,
    from_robot: Vec<u8>,
    safe: Volatile,
    now_us: u64,
}

impl LinkPort for Wire {
    fn now_us(&mut self) -> u64 {
        self.now_us
    }
    fn receive(&mut self) -> Option<u8> {
        self.to_robot.pop_front()
    }
    fn send(&mut self, byte: u8) -> bool {
        self.from_robot.push(byte);
        true
    }
    fn key_store(&mut self) -> Option<&mut dyn KeyStore> {
        Some(self)
    }
}

impl KeyStore for Wire {
    fn read(&mut self, record: StoredKey, room: &mut [u8]) -> Result<usize, NotStored> {
        self.safe.read(record, room)
    }
    fn write(&mut self, record: StoredKey, bytes: &[u8]) -> Result<(), WriteError> {
        Ok(self.safe.write(record, bytes)?)
    }
}

/// What the attacker has done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Attacks {
    /// Frames whose bytes were changed, under a right checksum.
    pub altered: u64,
    /// Frames that came later than they were sent, others before them.
    pub held: u64,
    /// Frames that were sent once more, at once or later.
    pub repeated: u64,
    /// Frames that did not arrive.
    pub dropped: u64,
    /// Frames that nobody had sent.
    pub invented: u64,
}

impl Attacks {
    /// All of them but what was dropped, which teaches nobody anything.
    pub fn total(&self) -> u64 {
        self.altered + self.held + self.repeated + self.invented
    }
}

/// What became of an attacked robot and its owner.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// What the attacker did.
    pub attacks: Attacks,
    /// Commands that the owner gave, and those that were done as far as the owner knows.
    pub commands: u64,
    /// Those.
    pub done: u64,
    /// What must not be, in words.
    pub wrong: Vec<String>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Way {
    ToRobot,
    ToOwner,
}

/// A frame that arrives at a time.
struct Held {
    at_us: u64,
    way: Way,
    frame: Vec<u8>,
}

/// The robot, the line, and who is in it.
struct Line<'q, 'm> {
    time: Arc<Time>,
    real_time: RealTime<'q, 'm>,
    link: LinkSide<'q, 'm>,
    timer: Timer,
    next_us: u64,
    wire: Wire,
    to_owner: VecDeque<u8>,
    owner_reader: FrameReader,
    robot_reader: FrameReader,
    random: Random,
    /// One in so many frames is attacked; 0 for none.
    one_in: usize,
    kept: Vec<(Way, Vec<u8>)>,
    held: Vec<Held>,
    attacks: Attacks,
    /// Number and kind of the request that the owner sent last.
    asked: (u8, u8),
    /// Until then nothing of the owner's arrives.
    cut_until_us: u64,
    /// Values of the parameter that the owner has signed, when each was, and how.
    signed: Vec<(u32, u64, Vec<u8>)>,
    /// Values that arrived at the robot, by the number of the message.
    arrived: HashMap<u8, u32>,
    /// Values that the robot took, and those before.
    taken: Vec<(u32, u32)>,
    /// What the robot said of that, so that what it says again is known.
    told: HashSet<Vec<u8>>,
    /// How the robot was, each time that it said so, and when.
    said: Vec<(u64, Status)>,
    /// When the motors were switched off.
    stopped_us: Vec<u64>,
    wrong: Vec<String>,
}

impl Line<'_, '_> {
    fn now_us(&self) -> u64 {
        self.time.0.load(Ordering::Relaxed)
    }

    /// Lets the robot run up to now, and what is held arrive.
    fn run(&mut self) {
        let now_us = self.now_us();
        loop {
            let due = (self.held.iter().enumerate())
                .filter(|(_, held)| held.at_us <= now_us)
                .min_by_key(|(_, held)| held.at_us)
                .map(|(place, _)| place);
            let at_us = due.map_or(now_us, |place| self.held[place].at_us);
            while self.next_us <= at_us {
                self.step(self.next_us);
            }
            self.timer.now_us = self.timer.now_us.max(at_us);
            self.wire.now_us = self.timer.now_us;
            self.poll();
            match due {
                Some(place) => {
                    let Held { way, frame, .. } = self.held.swap_remove(place);
                    self.deliver(way, &frame);
                }
                None => return,
            }
        }
    }

    /// The timer's interrupt at this time.
    fn step(&mut self, at_us: u64) {
        self.timer.now_us = at_us;
        self.wire.now_us = at_us;
        let before = self.timer.motors_off;
        self.next_us = self.real_time.on_timer(&mut self.timer).max(at_us + 1);
        if self.timer.motors_off > before {
            self.stopped_us.push(at_us);
        }
        self.poll();
    }

    fn poll(&mut self) {
        while self.link.poll(&mut self.wire) {}
        for byte in std::mem::take(&mut self.wire.from_robot) {
            let Some(frame) = self.robot_reader.push(byte) else {
                continue;
            };
            let encoded = [&*frame, &[DELIMITER]].concat();
            let message = unpack(frame).expect("the robot sends frames");
            match parse(message).expect("the robot sends messages") {
                FromDevice::Reply { seq, result, .. } | FromDevice::Proven { seq, result, .. } => {
                    match result {
                        Ok(Response::Status(status)) => {
                            self.said.push((self.wire.now_us, status));
                        }
                        Ok(Response::ParamSet { before }) if self.told.insert(message.to_vec()) => {
                            let value = self.arrived.get(&seq).copied().unwrap_or(0);
                            self.took(value, before);
                        }
                        _ => {}
                    }
                }
                _ => {}
            }
            self.attack(Way::ToOwner, encoded);
        }
    }

    /// The robot has taken this value, after that one.
    fn took(&mut self, value: u32, before: u32) {
        let now_us = self.wire.now_us;
        // A client that was told that its session had ended signs it once more.
        let mut times = self.signed.iter().filter(|(signed, _, _)| *signed == value);
        let (signatures, signed) = (times.clone().count(), times.next_back());
        match signed.map(|(signed, at_us, _)| (signed, at_us)) {
            Some((_, at_us)) if now_us - at_us <= SIGNED_LIFE_US => {}
            Some((_, at_us)) => {
                let late_us = now_us - at_us;
                self.wrong.push(format!(
                    "{value} was taken {late_us} us after it was signed"
                ));
            }
            None => self.wrong.push(format!("{value} was never signed")),
        }
        let last = self.taken.last().map_or(OWN_VALUE, |(value, _)| *value);
        let taken = self.taken.iter().filter(|(taken, _)| *taken == value);
        if taken.count() >= signatures {
            self.wrong
                .push(format!("{value} was taken more often than it was signed"));
        }
        // A mission that starts anew has its own value.
        if ![last, OWN_VALUE].contains(&before) {
            self.wrong.push(format!(
                "{value} was taken after {before}, and not after {last}"
            ));
        }
        self.taken.push((value, before));
    }

    fn deliver(&mut self, way: Way, frame: &[u8]) {
        match way {
            Way::ToRobot => {
                if let Some((seq, value, _)) = value_in(frame) {
                    self.arrived.insert(seq, value);
                }
                self.wire.to_robot.push_back(DELIMITER);
                self.wire.to_robot.extend(frame);
                self.poll();
            }
            Way::ToOwner => {
                self.to_owner.push_back(DELIMITER);
                self.to_owner.extend(frame);
            }
        }
    }

    /// Does with a frame what the attacker wants.
    fn attack(&mut self, way: Way, frame: Vec<u8>) {
        if self.one_in == 0 {
            self.deliver(way, &frame);
            return;
        }
        if self.kept.len() < KEPT_FRAMES {
            self.kept.push((way, frame.clone()));
        } else {
            let place = self.random.below(KEPT_FRAMES);
            self.kept[place] = (way, frame.clone());
        }
        if way == Way::ToRobot && self.now_us() < self.cut_until_us {
            self.attacks.dropped += 1;
            return;
        }
        if self.random.below(self.one_in) > 0 {
            self.deliver(way, &frame);
            return;
        }
        match self.random.below(6) {
            0 => self.attacks.dropped += 1,
            1 => {
                self.attacks.held += 1;
                let longest = [30_000, 1_000_000, 12_000_000, LONGEST_HOLD_US];
                let longest = longest[self.random.below(longest.len())];
                let at_us = self.now_us() + 1 + self.random.below(longest) as u64;
                if self.random.below(16) == 0 {
                    // Nothing overtakes it, so that its number stays the next.
                    self.cut_until_us = at_us;
                }
                self.held.push(Held { at_us, way, frame });
            }
            2 => {
                self.attacks.repeated += 1;
                self.deliver(way, &frame);
                self.deliver(way, &frame);
            }
            3 => {
                self.attacks.repeated += 1;
                let (way, old) = self.kept[self.random.below(self.kept.len())].clone();
                self.deliver(way, &old);
                self.deliver(way, &frame);
            }
            4 => {
                self.attacks.altered += 1;
                let altered = self.altered(frame);
                self.deliver(way, &altered);
            }
            _ => {
                self.attacks.invented += 1;
                let invented = self.invented();
                self.deliver(Way::ToOwner, &invented);
                self.deliver(way, &frame);
            }
        }
    }

    /// Some bits of the message are others, and the checksum is right.
    fn altered(&mut self, mut frame: Vec<u8>) -> Vec<u8> {
        let Ok(message) = unpack(&mut frame) else {
            return Vec::new();
        };
        let mut message = message.to_vec();
        for _ in 0..=self.random.below(3) {
            let at = self.random.below(message.len());
            message[at] ^= 1 << self.random.below(8);
        }
        framed(&message)
    }

    /// What a robot might say to what was sent last: under its number, of its kind, and mostly of
    /// its form.
    fn invented(&mut self) -> Vec<u8> {
        let (seq, of) = self.asked;
        let status = self.said.last().map(|(_, status)| *status);
        let bits = self.random.bits();
        let fitting = match (of, status) {
            _ if self.random.below(4) == 0 => None,
            (STATUS, Some(status)) => Some(Response::Status(Status {
                mode: Mode::Stopped,
                steps: bits,
                ..status
            })),
            (CLOCK, _) => Some(Response::Clock { now_us: bits }),
            (CHALLENGE, _) => Some(Response::Challenge {
                nonce: [bits as u8; NONCE_BYTES],
                counter: bits,
            }),
            (SET_PARAM, _) => Some(Response::ParamSet {
                before: bits as u32,
            }),
            _ => Some(Response::Done),
        };
        let result = match (fitting, self.random.below(5)) {
            (Some(fitting), _) => Ok(fitting),
            (None, 0) => Err(LinkError::NoSession),
            (None, 1) => Err(LinkError::NoKey),
            (None, 2) => Err(LinkError::Late),
            (None, 3) => Err(LinkError::Busy),
            (None, _) => Ok(Response::Committed {
                mission: bits as u32,
                carried: 0,
            }),
        };
        let message = match self.random.below(2) {
            0 => FromDevice::Reply { seq, result, of },
            _ => FromDevice::Proven {
                seq,
                proof: [self.random.bits() as u8; PROOF_BYTES],
                result,
                of,
            },
        };
        let mut frame = [0; MAX_FRAME_BYTES];
        let length = encode(&message, &mut frame).unwrap_or(0);
        frame[..length].to_vec()
    }

    /// Looks at what the owner sends: when each value was signed.
    fn look(&mut self, frame: &[u8]) {
        if let Some((seq, request)) = request_in(frame) {
            self.asked = (seq, kind_of(&request));
        }
        if let Some((_, value, signature)) = value_in(frame)
            && !self
                .signed
                .iter()
                .any(|(_, _, signed)| *signed == signature)
        {
            self.signed.push((value, self.now_us(), signature));
        }
    }
}

/// The request in a frame as it is serialized, and the number of its message.
fn request_in(frame: &[u8]) -> Option<(u8, Vec<u8>)> {
    let mut frame = frame.to_vec();
    let (seq, request) = unpack(&mut frame).ok()?.split_first()?;
    Some((*seq, request.to_vec()))
}

/// The kind of a request, or of what it holds.
fn kind_of(request: &[u8]) -> u8 {
    match postcard::from_bytes(request) {
        Ok(
            Request::Proven { request, .. }
            | Request::Signed { request, .. }
            | Request::Within { request, .. },
        ) => kind_of(request),
        Ok(request) => request.kind(),
        Err(_) => UNKNOWN,
    }
}

/// The value that a frame brings, the number of its message, and the signature.
fn value_in(frame: &[u8]) -> Option<(u8, u32, Vec<u8>)> {
    let mut frame = frame.to_vec();
    let ToDevice { seq, request } = parse(unpack(&mut frame).ok()?).ok()?;
    let Request::Proven { request, .. } = request else {
        return None;
    };
    let Request::Signed { signature, request } = postcard::from_bytes(request).ok()? else {
        return None;
    };
    let Request::Within { request, .. } = postcard::from_bytes(request).ok()? else {
        return None;
    };
    match postcard::from_bytes(request).ok()? {
        Request::SetParam { value, .. } => Some((seq, value, signature.to_vec())),
        _ => None,
    }
}

/// A message as it goes over the line.
fn framed(message: &[u8]) -> Vec<u8> {
    struct Plain<'a>(&'a [u8]);
    impl serde::Serialize for Plain<'_> {
        fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
            use serde::ser::SerializeTuple;
            let mut tuple = serializer.serialize_tuple(self.0.len())?;
            for byte in self.0 {
                tuple.serialize_element(byte)?;
            }
            tuple.end()
        }
    }
    let mut frame = [0; MAX_FRAME_BYTES];
    let length = encode(&Plain(message), &mut frame).unwrap_or(0);
    frame[..length].to_vec()
}

/// The owner's end of the line.
struct OwnersEnd<'l, 'q, 'm>(&'l mut Line<'q, 'm>);

impl ByteLink for OwnersEnd<'_, '_, '_> {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let Self(line) = self;
        // Rounded up: with a part of a microsecond left, time goes on, too.
        let until_us = line.now_us() + timeout.as_nanos().div_ceil(1_000) as u64;
        loop {
            line.run();
            if !line.to_owner.is_empty() || line.now_us() >= until_us {
                break;
            }
            line.time.pause(Duration::from_micros(1_000));
        }
        let count = buffer.len().min(line.to_owner.len());
        for (place, byte) in buffer.iter_mut().zip(line.to_owner.drain(..count)) {
            *place = byte;
        }
        Ok(count)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let Self(line) = self;
        line.time.pause(Duration::from_micros(FRAME_US));
        line.run();
        for byte in bytes {
            if let Some(frame) = line.owner_reader.push(*byte) {
                let frame = [&*frame, &[DELIMITER]].concat();
                line.look(&frame);
                line.attack(Way::ToRobot, frame);
            }
        }
        line.run();
        Ok(())
    }

    fn clock(&self) -> Clock {
        Clock::simulated(self.0.time.clone())
    }
}

/// The owner's key.
fn key() -> SigningKey {
    SigningKey::of(b"the key of a robot under attack.")
}

/// What the owner did, and what came of it.
enum Deed {
    /// A value was set; what it was before, as the owner was told.
    Set(u32, Option<u32>),
    /// Asked how it is, in this time.
    Asked(u64, u64, Option<Status>),
    /// Stopped it, in this time.
    Stopped(u64, u64, bool),
    /// Started it.
    Started(bool),
}

/// Lets an owner command a robot while an attacker does as many things as `attacks` to the line.
///
/// # Panics
/// The robot cannot be made.
pub fn attack(seed: u64, attacks: u64) -> Outcome {
    let mut lamps = Lamps {
        lamp: TaskPool::new([Lamp]),
    };
    let mut banks = lamps.banks();
    let mut memory = Memory::<BLOB_BYTES, 64, SLOTS, 4, 4, 1, 256>::new();
    let mut mail = Mailbox::new();
    let about = About::new("lamps", "attacked");
    let sides = split(&mut memory, &mut banks, &mut mail, about, Limits::default());
    let Ok((real_time, _, link)) = sides else {
        panic!("the registry is right");
    };
    let mut line = Line {
        time: Arc::default(),
        real_time,
        link,
        timer: Timer {
            now_us: 0,
            motors_off: 0,
        },
        next_us: 0,
        wire: Wire::default(),
        to_owner: VecDeque::new(),
        owner_reader: FrameReader::new(),
        robot_reader: FrameReader::new(),
        random: Random::new(seed),
        one_in: 0,
        kept: Vec::new(),
        held: Vec::new(),
        attacks: Attacks::default(),
        asked: (0, UNKNOWN),
        cut_until_us: 0,
        signed: Vec::new(),
        arrived: HashMap::new(),
        taken: Vec::new(),
        told: HashSet::new(),
        said: Vec::new(),
        stopped_us: Vec::new(),
        wrong: Vec::new(),
    };
    let mut outcome = Outcome::default();
    let built = subject::build(MISSION).unwrap_or_else(|cause| panic!("{cause}"));
    let blob = built.blob;
    let mission = u32::from_le_bytes(*blob.last_chunk().unwrap_or(&[0; 4]));
    let begun = owner_commands(&mut line, &blob, true);
    outcome.wrong.extend(begun.err());
    let mut value = 1;
    while line.attacks.total() < attacks && outcome.wrong.is_empty() {
        // The random numbers of the owner are not those of the attacker.
        let mut choices = Random::new(seed ^ line.attacks.total());
        line.one_in = 1 + choices.below(6);
        let deeds = episode(&mut line, mission, &mut choices, &mut value);
        for deed in deeds {
            judge(&line, &deed, &mut outcome);
        }
        // The attacker goes, and takes along what was held back.
        line.one_in = 0;
        line.cut_until_us = 0;
        line.held.clear();
        if let Err(problem) = owner_commands(&mut line, &blob, false) {
            outcome.wrong.push(problem);
        }
        line.signed.clear();
        line.arrived.clear();
        line.stopped_us.clear();
        line.said.clear();
        // A mission that starts has its own value.
        line.taken.clear();
        line.told.clear();
        outcome.wrong.append(&mut line.wrong);
    }
    outcome.attacks = line.attacks;
    outcome
}

/// The owner commands the robot under attack, for some time.
fn episode(
    line: &mut Line<'_, '_>,
    mission: u32,
    choices: &mut Random,
    value: &mut u32,
) -> Vec<Deed> {
    let time = line.time.clone();
    let now_us = || time.0.load(Ordering::Relaxed);
    let mut deeds = Vec::new();
    let Ok((mut robot, _)) = LinkClient::connect(OwnersEnd(line)) else {
        return deeds;
    };
    robot.use_key(Box::new(|| Ok(key())));
    robot.insist_on_key();
    for _ in 0..40 {
        let from_us = now_us();
        let deed = match choices.below(6) {
            0 => {
                let status = robot.status().ok();
                Deed::Asked(from_us, now_us(), status)
            }
            1 => {
                let stopped = robot.stop().is_ok();
                let until_us = now_us();
                deeds.push(Deed::Stopped(from_us, until_us, stopped));
                Deed::Started(robot.start().is_ok())
            }
            _ => {
                *value += 1;
                Deed::Set(*value, robot.set_param(mission, 0, *value).ok())
            }
        };
        deeds.push(deed);
    }
    deeds
}

/// Whether what the owner was told is so.
fn judge(line: &Line<'_, '_>, deed: &Deed, outcome: &mut Outcome) {
    let is_done = match deed {
        Deed::Set(value, Some(before)) => {
            // A start in between gives it the mission's own value again, so that the robot's words
            // count.
            if !line.taken.contains(&(*value, *before)) {
                outcome.wrong.push(format!(
                    "the owner believes that {value} was set after {before}"
                ));
            }
            true
        }
        Deed::Asked(from_us, until_us, Some(status)) => {
            let is_said = |(at_us, said): &(u64, Status)| {
                (*from_us..=*until_us).contains(at_us) && said == status
            };
            if !line.said.iter().any(is_said) {
                outcome
                    .wrong
                    .push(format!("the owner believes that it is so: {status:?}"));
            }
            true
        }
        Deed::Stopped(from_us, until_us, true) => {
            let is_off = |at_us: &u64| (*from_us..=*until_us).contains(at_us);
            if !line.stopped_us.iter().any(is_off) {
                outcome.wrong.push(format!(
                    "the owner believes that it stopped by {until_us} us"
                ));
            }
            true
        }
        Deed::Started(is_done) => *is_done,
        Deed::Set(_, None) | Deed::Asked(_, _, None) | Deed::Stopped(_, _, false) => false,
    };
    outcome.commands += 1;
    outcome.done += u64::from(is_done);
}

/// With nobody in the line the owner can do everything: the first time, give the robot the key,
/// too.
fn owner_commands(line: &mut Line<'_, '_>, blob: &[u8], is_first: bool) -> Result<(), String> {
    let told = |error: ClientError| format!("the owner is locked out: {error}");
    let (mut robot, info) = LinkClient::connect(OwnersEnd(line)).map_err(told)?;
    robot.use_key(Box::new(|| Ok(key())));
    if is_first {
        robot.install_key(&key()).map_err(told)?;
    } else if info.access != Access::Locked {
        return Err(format!("the robot is {:?}", info.access));
    }
    robot.insist_on_key();
    robot.upload(blob, &mut |_| ()).map_err(told)?;
    robot.stop().map_err(told)?;
    robot.start().map_err(told)?;
    let mode = robot.status().map_err(told)?.mode;
    if mode == Mode::Running {
        Ok(())
    } else {
        Err(format!("the robot does not run: {mode:?}"))
    }
}
