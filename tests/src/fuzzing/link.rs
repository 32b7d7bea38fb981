//! A robot whose line brings anything: with a flash for missions, parameters and a key, with a
//! memory that outlasts resets, and with an owner who has a key.

use std::collections::VecDeque;
use std::sync::OnceLock;

use esm_link::access::{
    self, Access, MAX_SIGNED_BYTES, NO_UPLOAD, NONCE_BYTES, SALT_BYTES, SIGNATURE_BYTES,
    may_be_proven,
};
use esm_link::frame::{
    CRC_BYTES, FrameReader, MAX_FRAME_BYTES, checksum, decode, encode, parse, unpack,
};
use esm_link::key_store::KeyStore;
use esm_link::message::{
    Channel, FromDevice, Identity, LinkError, MAX_CHUNK, Mode, Request, ResetReason, Response,
    Status, Stream, Swap, ToDevice,
};
use esm_link::telemetry::Sample;
use host_tools::keys::SigningKey;
use host_tools::plant::flash::Flash;
use rt_firmware::body::flash::ERASE_BYTES;
use rt_firmware::mission_store::MissionStore;
use rt_firmware::store::flash_store::{FlashStore, RECORD_BYTES, flash_bytes};
use rt_firmware::{
    About, Board, Io, Limits, LinkPort, LinkSide, Mailbox, Memory, RealTime, RetainedRam, Step,
    Task, TaskPool, registry, split, task,
};
use serde::Serialize;
use serde::ser::{SerializeTuple, Serializer};

use super::seeds::Seed;
use crate::owner::{Installation, Owner, bytes_of};
use crate::subject;

/// What the robot has room for.
const BLOB_BYTES: usize = 2_048;
const ARENA_WORDS: usize = 64;
const SLOTS: usize = 4;

/// Greatest number of times that the timer comes before a request is answered. One comes to answer
/// it; some more are for a swap.
const TIMER_CALLS_TO_AN_ANSWER: usize = 8;

/// How often a request of the good client may be sent. The first answers can be
/// [`LinkError::Busy`], of a request before that is still under way: a start or a swap waits for
/// the interpreter's next activation, and an activation passes between two sendings.
const SENDINGS: usize = 12;

/// What the input's first bytes say of those after them.
mod part {
    /// So many bytes that follow come over the line.
    pub const RAW: u8 = 0;
    /// So many bytes that follow come in a frame, as a message.
    pub const MESSAGE: u8 = 1;
    /// The timer comes so often.
    pub const TIMER: u8 = 2;
    /// The wire takes so many bytes from the robot, and no more until this is said again.
    pub const WIRE: u8 = 3;
    /// A good mission's chunk from this byte on, times 8.
    pub const CHUNK: u8 = 4;
    /// An upload of the good mission begins.
    pub const BEGIN: u8 = 5;
    /// The log has so many bytes more.
    pub const LOG: u8 = 6;
    /// The owner gives the robot his key.
    pub const KEY: u8 = 7;
    /// So many bytes that follow are a request that the owner signs.
    pub const SIGNED: u8 = 8;
    /// The owner signs the good mission.
    pub const SIGN: u8 = 9;
    /// So many bytes that follow are a request that is to be done within 20 ms.
    pub const WITHIN: u8 = 10;
    /// Power is lost and comes back, or the robot is reset.
    pub const RESET: u8 = 11;
    /// So many bytes that follow are a request in the owner's session.
    pub const OWNED: u8 = 12;
    pub const COUNT: u8 = 13;
}

struct Lamp;
task! { impl Lamp { data { in seen: u32 optional; out level: u32; } flags { out lit; } params { limit: u32 = 1, 1..=9; } } }
impl Task for Lamp {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        io.set(Self::LIT, true);
        *io.write(Self::LEVEL) = LEVEL;
        Step::Run
    }
}

registry! {
    struct Lamps { lamp: Lamp[2] }
}

const MISSION: &str = "interpreter slot 1; slot 1 period 10 ms duration 1 ms; slot 2 period 5 ms duration 1 ms;
task Lamp slot 2 { in data seen: u32 optional; out data level: u32; out flag lit; param limit: u32 = 1; }
machine M { region r { task On: Lamp with { limit = 3 }; task Off: Lamp; initial -> On; On -> Off on pulse [.lit]; Off -> On on pulse [.lit]; } path On.level -> Off.seen; }";

/// What lamps write.
const LEVEL: u32 = 0x1e4e1;

/// The good mission's blob.
fn mission() -> &'static [u8] {
    static BLOB: OnceLock<Vec<u8>> = OnceLock::new();
    BLOB.get_or_init(|| {
        subject::build(MISSION)
            .unwrap_or_else(|cause| panic!("{cause}"))
            .blob
    })
}

struct Timer(u64);
impl Board for Timer {
    const TICKS_PER_US: u32 = 1;
    const START_LEAD_US: u32 = 0;
    fn now_ticks(&mut self) -> u64 {
        self.0
    }
    fn motors_off(&mut self) {}
}

/// The line, and what the board keeps.
struct Wire<'k> {
    to_robot: VecDeque<u8>,
    to_host: Vec<u8>,
    /// Bytes that it takes.
    room: usize,
    /// Bytes of the log.
    log: usize,
    now_us: u64,
    keep: FlashStore<'k, Flash>,
}

impl LinkPort for Wire<'_> {
    fn now_us(&mut self) -> u64 {
        self.now_us
    }

    fn receive(&mut self) -> Option<u8> {
        self.to_robot.pop_front()
    }

    fn send(&mut self, byte: u8) -> bool {
        let Some(room) = self.room.checked_sub(1) else {
            return false;
        };
        self.room = room;
        self.to_host.push(byte);
        true
    }

    fn read_log(&mut self, room: &mut [u8]) -> usize {
        let count = room.len().min(self.log);
        self.log -= count;
        count
    }

    fn key_store(&mut self) -> Option<&mut dyn KeyStore> {
        Some(&mut self.keep)
    }

    fn mission_store(&mut self) -> Option<&mut dyn MissionStore> {
        Some(&mut self.keep)
    }
}

/// The owner's key, and how it is brought to a robot.
fn owner() -> &'static SigningKey {
    static KEY: OnceLock<SigningKey> = OnceLock::new();
    KEY.get_or_init(|| SigningKey::of(b"the key of a robot in a fuzzer.."))
}

const SALT: [u8; SALT_BYTES] = [7; SALT_BYTES];

fn installation() -> &'static Installation {
    static MADE: OnceLock<Installation> = OnceLock::new();
    MADE.get_or_init(|| Installation::of(owner(), SALT))
}

/// What somebody sends for a session.
const CLIENT: [u8; NONCE_BYTES] = [3; NONCE_BYTES];

/// A request as another one holds it.
fn held(request: Request<'_>) -> Vec<u8> {
    bytes_of(&request)
}

/// Bytes that are a message as they are.
struct Plain<'a>(&'a [u8]);
impl Serialize for Plain<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut tuple = serializer.serialize_tuple(self.0.len())?;
        for byte in self.0 {
            tuple.serialize_element(byte)?;
        }
        tuple.end()
    }
}

fn framed(message: &impl Serialize) -> Vec<u8> {
    let mut frame = [0; MAX_FRAME_BYTES];
    match encode(message, &mut frame) {
        Ok(len) => frame[..len].to_vec(),
        // Longer than messages are: then it is noise.
        Err(_) => Vec::new(),
    }
}

/// The robot, its line, and a good client.
struct Subject<'q, 'm, 'k> {
    real_time: RealTime<'q, 'm>,
    link: LinkSide<'q, 'm>,
    timer: Timer,
    wire: Wire<'k>,
    reader: FrameReader,
    seq: u8,
    /// The owner's session.
    session: Option<Owner>,
    /// Sessions of the owner's so far.
    sessions: u8,
    /// What the robot said of its key last.
    identity: Option<Identity>,
    nonce: [u8; NONCE_BYTES],
    counter: u64,
    /// The signature of the upload that was signed last.
    upload: [u8; SIGNATURE_BYTES],
}

/// A robot from its start to its next one.
fn life<R>(
    flash: &Flash,
    kept: &RetainedRam,
    reason: Option<ResetReason>,
    live: impl FnOnce(&mut Subject<'_, '_, '_>) -> R,
) -> R {
    // Before anybody looks at what it retains.
    let reset = kept.begin(reason);
    let mut lamps = Lamps {
        lamp: TaskPool::new([Lamp, Lamp]),
    };
    let mut banks = lamps.banks();
    let mut memory = Memory::<BLOB_BYTES, ARENA_WORDS, SLOTS, 4, 4, 1, 256>::new();
    let mut mail = Mailbox::new();
    let mut records = [0; RECORD_BYTES];
    let Ok(keep) = FlashStore::open(flash.clone(), BLOB_BYTES as u32, None, &mut records) else {
        panic!("the flash is large enough");
    };
    let keep = keep.over_resets(kept);
    let about = About {
        reset,
        kept: Some(kept),
        ..About::new("lamps", "fuzzed")
    };
    let sides = split(&mut memory, &mut banks, &mut mail, about, Limits::default());
    let Ok((real_time, _, link)) = sides else {
        panic!("the registry is right");
    };
    let mut subject = Subject {
        real_time,
        link,
        timer: Timer(0),
        wire: Wire {
            to_robot: VecDeque::new(),
            to_host: Vec::new(),
            room: usize::MAX,
            log: 0,
            now_us: 0,
            keep,
        },
        reader: FrameReader::new(),
        seq: 0,
        session: None,
        sessions: 0,
        identity: None,
        nonce: [0; NONCE_BYTES],
        counter: 0,
        upload: NO_UPLOAD,
    };
    subject.link.start(&mut subject.wire);
    live(&mut subject)
}

impl Subject<'_, '_, '_> {
    fn timer_comes(&mut self) {
        let next_ticks = self.real_time.on_timer(&mut self.timer);
        assert!(next_ticks > self.timer.0, "time goes on");
        self.timer.0 = next_ticks;
        self.wire.now_us = next_ticks;
        self.poll();
    }

    /// Lets the link do all that it can.
    fn poll(&mut self) {
        loop {
            let before = (self.wire.to_robot.len(), self.wire.room);
            let has_more = self.link.poll(&mut self.wire);
            // A link that has more to do does some of it, or waits for the wire.
            if !has_more || (self.wire.to_robot.len(), self.wire.room) == before {
                assert!(!has_more || self.wire.room == 0, "it is idle for nothing");
                return;
            }
        }
    }

    /// What came from the robot: each frame of it is a message.
    fn heard(&mut self) {
        for byte in std::mem::take(&mut self.wire.to_host) {
            let Some(frame) = self.reader.push(byte) else {
                continue;
            };
            match decode(frame).unwrap_or_else(|error| panic!("the robot sends {error:?}")) {
                FromDevice::Proven {
                    result: Ok(Response::Challenge { nonce, counter }),
                    ..
                } => (self.nonce, self.counter) = (nonce, counter),
                FromDevice::Reply {
                    result: Ok(Response::Identity(identity)),
                    ..
                } => self.identity = Some(identity),
                FromDevice::Stream(part) => check(&part),
                FromDevice::Reply { .. }
                | FromDevice::Proven { .. }
                | FromDevice::StatusEvent(_) => {}
            }
        }
    }

    /// Does what the bytes say, up to the robot's next start. Returns why it starts, and the bytes
    /// behind that.
    fn suffer<'b>(&mut self, mut bytes: &'b [u8]) -> Option<(u8, &'b [u8])> {
        while let [kind, count, rest @ ..] = bytes {
            let length = usize::from(*count);
            let (own, after) = rest.split_at(length.min(rest.len()));
            bytes = rest;
            match kind % part::COUNT {
                part::RAW => {
                    self.wire.to_robot.extend(own);
                    bytes = after;
                }
                part::MESSAGE => {
                    self.wire.to_robot.extend(framed(&Plain(own)));
                    bytes = after;
                }
                part::TIMER => (0..count % 16).for_each(|_| self.timer_comes()),
                part::WIRE => self.wire.room = length,
                part::CHUNK => {
                    let offset = length * 8;
                    let data = mission().get(offset..).unwrap_or_default();
                    let data = data.get(..MAX_CHUNK).unwrap_or(data);
                    self.request(Request::Chunk {
                        offset: offset as u32,
                        data,
                    });
                }
                part::BEGIN => self.request(begin()),
                part::LOG => self.wire.log += length,
                part::KEY => self.request(install()),
                part::OWNED => {
                    bytes = after;
                    self.begin_session();
                    self.owned(own);
                }
                part::SIGNED => {
                    bytes = after;
                    self.begin_session();
                    self.request(Request::Challenge);
                    self.poll();
                    self.heard();
                    let signature = owner().sign(&access::command(&self.nonce, &self.upload, own));
                    self.request(Request::Signed {
                        signature: &signature,
                        request: own,
                    });
                }
                part::SIGN => {
                    self.begin_session();
                    self.request(Request::Challenge);
                    self.poll();
                    self.heard();
                    let counter = self.counter.wrapping_add(1);
                    self.upload = sign_mission(counter);
                    let signature = self.upload;
                    self.request(Request::Sign {
                        counter,
                        signature: &signature,
                    });
                }
                part::WITHIN => {
                    bytes = after;
                    let by_us = self.wire.now_us + 20_000;
                    let request = own.get(..MAX_SIGNED_BYTES).unwrap_or(own);
                    self.request(Request::Within { by_us, request });
                }
                _ => return Some((*count, bytes)),
            }
            self.poll();
            self.heard();
        }
        self.wire.to_robot.extend(bytes);
        self.poll();
        None
    }

    /// Begins a session with the owner, if there is none and the wire lets it.
    fn begin_session(&mut self) {
        if self.session.is_some() {
            return;
        }
        self.identity = None;
        let client = self.client_nonce();
        self.request(Request::Identify { nonce: client });
        self.poll();
        self.heard();
        if let Some(identity) = self.identity {
            let session = Owner::of(owner(), &client, &identity);
            self.request(session.opening(client, &identity));
            self.poll();
            self.session = Some(session);
        }
    }

    fn request(&mut self, request: Request<'_>) {
        match self.session.as_mut().filter(|_| may_be_proven(&request)) {
            Some(session) => {
                let proven = session.prove(&request);
                self.plain_request(proven.request());
            }
            None => self.plain_request(request),
        }
    }

    /// Bytes as a request in the owner's session.
    fn owned(&mut self, bytes: &[u8]) {
        if let Some(session) = &mut self.session {
            session.number = session.number.wrapping_add(1);
            let number = session.number;
            let proof = session.session.of_request(number, bytes);
            self.plain_request(Request::Proven {
                number,
                proof,
                request: bytes,
            });
        }
    }

    fn plain_request(&mut self, request: Request<'_>) {
        self.seq = self.seq.wrapping_add(1);
        let seq = self.seq;
        self.wire
            .to_robot
            .extend(framed(&ToDevice { seq, request }));
    }

    /// Asks as a good client does, and reads the answer. Refused with `Busy` it asks anew, which
    /// must have an end.
    fn try_ask<T>(
        &mut self,
        request: Request<'_>,
        mut read: impl FnMut(Response<'_>) -> Option<T>,
    ) -> Result<T, LinkError> {
        for _ in 0..SENDINGS {
            // Ends whatever came before.
            self.wire.to_robot.push_back(0);
            self.request(request);
            self.poll();
            let mut answer = None;
            for _ in 0..TIMER_CALLS_TO_AN_ANSWER {
                for byte in std::mem::take(&mut self.wire.to_host) {
                    let Some(frame) = self.reader.push(byte) else {
                        continue;
                    };
                    let message =
                        unpack(frame).unwrap_or_else(|error| panic!("the robot sends {error:?}"));
                    match parse(message).unwrap_or_else(|error| panic!("the robot sends {error:?}"))
                    {
                        // In a session nothing else counts.
                        FromDevice::Reply { .. }
                            if self.session.is_some() && may_be_proven(&request) => {}
                        // Of before, under the same number.
                        FromDevice::Reply { result, .. }
                            if request == Request::Hello
                                && !matches!(result, Ok(Response::Hello(_))) => {}
                        FromDevice::Proven {
                            seq, proof, result, ..
                        } if seq == self.seq => {
                            let session = self.session.as_ref().expect("it is one in a session");
                            assert!(session.accepts(session.number, &proof, message));
                            answer = Some(result.map(|response| {
                                read(response).unwrap_or_else(|| {
                                    panic!("{request:?} is answered with something else")
                                })
                            }));
                        }
                        FromDevice::Reply { seq, result, .. } if seq == self.seq => {
                            answer = Some(result.map(|response| {
                                read(response).unwrap_or_else(|| {
                                    panic!("{request:?} is answered with something else")
                                })
                            }));
                        }
                        FromDevice::Stream(part) => check(&part),
                        _ => {}
                    }
                }
                if answer.is_some() {
                    break;
                }
                self.timer_comes();
            }
            match answer {
                Some(Err(LinkError::Busy)) if !matches!(request, Request::Signed { .. }) => {
                    self.timer_comes();
                }
                Some(answer) => return answer,
                None => panic!("{request:?} is not answered"),
            }
        }
        panic!("the robot is busy for ever");
    }

    fn ask<T>(&mut self, request: Request<'_>, read: impl FnMut(Response<'_>) -> Option<T>) -> T {
        self.try_ask(request, read)
            .unwrap_or_else(|error| panic!("{request:?} is refused: {error:?}"))
    }

    fn access(&mut self) -> Access {
        self.ask(Request::Hello, |response| match response {
            Response::Hello(info) => Some(info.access),
            _ => None,
        })
    }

    fn status(&mut self) -> Status {
        self.ask(Request::Status, |response| match response {
            Response::Status(status) => Some(status),
            _ => None,
        })
    }

    /// Asks for a nonce; returns it with the number of the last upload.
    fn challenge(&mut self) -> ([u8; NONCE_BYTES], u64) {
        self.ask(Request::Challenge, |response| match response {
            Response::Challenge { nonce, counter } => Some((nonce, counter)),
            _ => None,
        })
    }

    /// Opens the owner's session, in place of any before.
    fn open_session(&mut self) {
        self.session = None;
        // The robot's clock goes on from one session to the next.
        self.timer_comes();
        let client = self.client_nonce();
        let identify = Request::Identify { nonce: client };
        let identity = self.ask(identify, |response| match response {
            Response::Identity(identity) => Some(identity),
            _ => None,
        });
        let session = Owner::of(owner(), &client, &identity);
        self.session = Some(session);
        self.ask(session.opening(client, &identity), done);
    }

    /// The owner's nonce for another session than any before.
    fn client_nonce(&mut self) -> [u8; NONCE_BYTES] {
        self.sessions = self.sessions.wrapping_add(1);
        [self.sessions; NONCE_BYTES]
    }

    /// Asks the robot to do something within a time, signed where it has a key.
    fn command<T>(
        &mut self,
        access: Access,
        request: Request<'_>,
        mut read: impl FnMut(Response<'_>) -> Option<T>,
    ) -> Result<T, LinkError> {
        const PATIENCE_US: u64 = 1_000_000;
        let upload = match request {
            Request::Commit(_) => self.upload,
            _ => NO_UPLOAD,
        };
        let request = &held(request)[..];
        // One `TooSoon` lasts for a second at most, of which each call of the timer is some
        // milliseconds.
        for _ in 0..SENDINGS {
            let now_us = self.ask(Request::Clock, |response| match response {
                Response::Clock { now_us } => Some(now_us),
                _ => None,
            });
            let by_us = now_us + PATIENCE_US;
            let answer = if access == Access::Locked {
                let request = &held(Request::Within { by_us, request })[..];
                let (nonce, _) = self.challenge();
                let signature = &owner().sign(&access::command(&nonce, &upload, request))[..];
                self.try_ask(Request::Signed { signature, request }, &mut read)
            } else {
                self.try_ask(Request::Within { by_us, request }, &mut read)
            };
            match answer {
                Err(LinkError::Busy) => self.timer_comes(),
                Err(LinkError::TooSoon { ms }) => self.wait_us(u64::from(ms) * 1_000),
                answer => return answer,
            }
        }
        panic!("the robot is busy for ever");
    }

    fn wait_us(&mut self, us: u64) {
        let until_us = self.wire.now_us + us;
        while self.wire.now_us < until_us {
            self.timer_comes();
        }
    }

    /// A good client greets the robot, ends what it finds, uploads a mission, starts it, changes
    /// and keeps a parameter.
    fn is_recovered(&mut self) -> u32 {
        self.wire.room = usize::MAX;
        self.poll();
        let (firmware, chunk_bytes, access) = self.ask(Request::Hello, |response| match response {
            Response::Hello(info) => Some((
                info.firmware.to_owned(),
                info.uploads.chunk_bytes,
                info.access,
            )),
            _ => None,
        });
        assert_eq!(
            (firmware.as_str(), usize::from(chunk_bytes)),
            ("lamps", MAX_CHUNK)
        );
        self.session = None;
        if access == Access::Locked {
            self.open_session();
        }
        // What was suffered may have been an emergency stop, which lasts until it is released, or a
        // mission on trial, which leaves no room for another.
        self.command(access, Request::Release, done)
            .unwrap_or_else(|error| panic!("no release: {error:?}"));
        let status = self.status();
        if let (Some(_), Some(mission)) = (status.trial, status.mission) {
            let ended = self.command(access, Request::FallBack { mission }, done);
            assert!(
                matches!(ended, Ok(()) | Err(LinkError::NotOnTrial)),
                "{ended:?}"
            );
        }
        let there = self.ask(begin(), received);
        let hash = match self.bring(access) {
            // What was there already was somebody else's, and is forgotten now.
            Err(LinkError::WrongSignature | LinkError::WrongChecksum) if there > 0 => {
                self.bring(access)
            }
            uploaded => uploaded,
        };
        let hash = hash.unwrap_or_else(|error| panic!("no upload: {error:?}"));
        let started = self.command(access, Request::Start, done);
        assert_eq!(started, Ok(()));
        self.drives(hash);
        let (mission, param) = (hash, 0);
        let set = self.command(
            access,
            Request::SetParam {
                mission,
                param,
                value: LIMIT,
            },
            |response| matches!(response, Response::ParamSet { .. }).then_some(()),
        );
        assert_eq!(set, Ok(()));
        let saved = self.command(access, Request::SaveParams { mission }, |response| {
            matches!(response, Response::ParamsSaved { count: 1 }).then_some(())
        });
        assert_eq!(saved, Ok(()));
        self.stands_when_told(access, hash);
        hash
    }

    /// Sends what the robot lacks of the good mission, and lets it take over. Answers its hash.
    fn bring(&mut self, access: Access) -> Result<u32, LinkError> {
        let blob = mission();
        let mut there = self.ask(begin(), received);
        while there < blob.len() {
            let end = blob.len().min(there + MAX_CHUNK);
            let request = Request::Chunk {
                offset: there as u32,
                data: &blob[there..end],
            };
            assert_eq!(self.ask(request, received), end);
            there = end;
        }
        if access == Access::Locked {
            self.sign()?;
        }
        self.command(
            access,
            Request::Commit(Swap::default()),
            |response| match response {
                Response::Committed { mission, .. } => Some(mission),
                _ => None,
            },
        )
    }

    /// Signs the mission that was uploaded, as soon as the robot looks at signatures.
    fn sign(&mut self) -> Result<(), LinkError> {
        loop {
            let (_, last) = self.challenge();
            let counter = last + 1;
            self.upload = sign_mission(counter);
            let signature = self.upload;
            let request = Request::Sign {
                counter,
                signature: &signature,
            };
            match self.try_ask(request, done) {
                Err(LinkError::TooSoon { ms }) => self.wait_us(u64::from(ms) * 1_000),
                signed => return signed,
            }
        }
    }

    fn drives(&mut self, hash: u32) {
        let before = self.status();
        assert_eq!((before.mode, before.mission), (Mode::Running, Some(hash)));
        (0..10).for_each(|_| self.timer_comes());
        let after = self.status();
        assert_eq!((after.mode, after.mission), (Mode::Running, Some(hash)));
        assert!(after.steps > before.steps, "it drives");
    }

    /// What comes too late is not done, and an emergency stop is, until it is released.
    fn stands_when_told(&mut self, access: Access, hash: u32) {
        let late = Request::Within {
            by_us: self.wire.now_us - 1,
            request: &held(Request::Stop),
        };
        assert_eq!(self.try_ask(late, done), Err(LinkError::Late));
        self.drives(hash);
        self.ask(Request::EmergencyStop, done);
        assert_eq!(self.status().mode, Mode::EmergencyStopped);
        let refused = self.command(access, Request::Start, done);
        assert_eq!(refused, Err(LinkError::EmergencyStopped));
        assert_eq!(self.command(access, Request::Release, done), Ok(()));
        assert_eq!(self.status().mode, Mode::Stopped);
        assert_eq!(self.command(access, Request::Start, done), Ok(()));
        self.drives(hash);
    }

    /// A robot that was switched off and on has kept what it was given.
    fn has_kept(&mut self, hash: u32) {
        (0..4).for_each(|_| self.timer_comes());
        self.drives(hash);
        let request = Request::Param {
            mission: hash,
            param: 0,
        };
        let value = self.ask(request, |response| match response {
            Response::Param { value, .. } => Some(value),
            _ => None,
        });
        assert_eq!(value, LIMIT);
        // Streams come to a good client, too.
        self.ask(
            Request::Subscribe {
                trace: true,
                log: false,
                record: true,
            },
            done,
        );
        let ask = &ask_values(hash);
        self.ask(Request::Values { ask }, done);
        let mut came = [false; 3];
        for _ in 0..40 {
            self.timer_comes();
            for byte in std::mem::take(&mut self.wire.to_host) {
                let Some(frame) = self.reader.push(byte) else {
                    continue;
                };
                if let Ok(FromDevice::Stream(part)) = decode(frame) {
                    check(&part);
                    let place = match part.channel {
                        Channel::Trace => 0,
                        Channel::Record => 1,
                        Channel::Values => 2,
                        Channel::Log => continue,
                    };
                    came[place] = true;
                }
            }
        }
        assert_eq!(came, [true; 3], "trace, recording and values");
        self.access();
    }
}

/// A value of the mission's parameter that is not the mission's own.
const LIMIT: u32 = 7;

/// Of values, a part is a whole sample, with as many words as nets have values, and what is on them
/// is what lamps write.
fn check(part: &Stream<'_>) {
    if part.channel != Channel::Values {
        return;
    }
    match Sample::of(part.bytes) {
        Some(Sample::Values { has, words, .. }) => {
            assert_eq!(has.count_ones() as usize, words.len(), "{part:?}");
            let level = LEVEL.to_le_bytes();
            assert!(words.iter().all(|word| *word == level), "{part:?}");
        }
        Some(Sample::Ended { .. }) => {}
        None => panic!("no sample: {part:?}"),
    }
    assert!(!part.continues, "{part:?}");
}

/// What is asked for values on the net of the mission of this hash, after each macro step.
fn ask_values(mission: u32) -> Vec<u8> {
    [&[1, 0], &mission.to_le_bytes()[..], &[0; 4]].concat()
}

fn done(response: Response<'_>) -> Option<()> {
    matches!(response, Response::Done).then_some(())
}

fn received(response: Response<'_>) -> Option<usize> {
    match response {
        Response::Received { len } => Some(len as usize),
        _ => None,
    }
}

fn begin() -> Request<'static> {
    let blob = mission();
    Request::Begin {
        len: blob.len() as u32,
        crc: checksum(blob),
    }
}

fn install() -> Request<'static> {
    installation().request()
}

fn sign_mission(counter: u64) -> [u8; SIGNATURE_BYTES] {
    owner().sign(&access::upload(&SALT, &counter.to_le_bytes(), mission()))
}

/// Lets anything come over the line of a robot, over as many of its starts as it may; then a good
/// client greets it, uploads a mission and starts it, changes and keeps a parameter, stops it for
/// an emergency; and then it is switched off and on.
///
/// # Panics
/// Where the robot does not answer that client within a few activations of its slots, or sends what
/// is no message; where it does what comes too late; where it does not do what it is asked to, or
/// has not kept what it said that it kept.
pub fn link(bytes: &[u8]) {
    let flash = Flash::blank(flash_bytes(BLOB_BYTES as u32, ERASE_BYTES as u32));
    let mut kept = RetainedRam::new();
    let mut reason = None;
    let mut bytes = bytes;
    let hash = loop {
        let next = life(&flash, &kept, reason, |robot| match robot.suffer(bytes) {
            Some(next) => Err(next),
            None => Ok(robot.is_recovered()),
        });
        let (why, rest) = match next {
            Ok(hash) => break hash,
            Err(next) => next,
        };
        bytes = rest;
        reason = match why % 3 {
            0 => {
                // Power was lost: nothing but the flash is as it was.
                kept = RetainedRam::new();
                None
            }
            1 => Some(ResetReason::Software),
            _ => Some(ResetReason::Watchdog),
        };
    };
    life(&flash, &RetainedRam::new(), None, |robot| {
        robot.has_kept(hash)
    });
}

/// Sessions of good clients, whole and in disorder.
pub fn sessions() -> Vec<Seed> {
    let mission = u32::from_le_bytes(*mission().last_chunk().unwrap_or(&[0; 4]));
    let values = ask_values(mission);
    // Of the same net, from the first byte on.
    let fields = [&[0, 0], &values[2..6], &[0; 4]].concat();
    let requests = [
        ("hello", Request::Hello),
        ("begin", begin()),
        ("commit", Request::Commit(Swap::default())),
        ("abort", Request::Abort),
        ("status", Request::Status),
        ("stop", Request::Stop),
        ("start", Request::Start),
        (
            "task",
            Request::Task {
                index: 0,
                offset: 0,
            },
        ),
        ("read_blob", Request::ReadBlob { offset: 0 }),
        ("states", Request::States { first: 0 }),
        ("slot_counters", Request::SlotCounters { slot: 0 }),
        (
            "subscribe",
            Request::Subscribe {
                trace: true,
                log: true,
                record: true,
            },
        ),
        ("frame_counters", Request::FrameCounters { frame: 0 }),
        ("task_counters", Request::TaskCounters { task_instance: 0 }),
        (
            "watch",
            Request::Watch {
                news: true,
                period_ms: 10,
            },
        ),
        ("fields", Request::Values { ask: &fields }),
        ("values", Request::Values { ask: &values }),
        ("last_words", Request::CrashReport),
        ("black_box", Request::BlackBox { from: None }),
        ("clock", Request::Clock),
        ("features", Request::Features),
        ("identify", Request::Identify { nonce: CLIENT }),
        ("challenge", Request::Challenge),
        ("emergency_stop", Request::EmergencyStop),
        ("release", Request::Release),
        ("remove_key", Request::RemoveKey),
        ("param", Request::Param { mission, param: 0 }),
        (
            "set_param",
            Request::SetParam {
                mission,
                param: 0,
                value: 5,
            },
        ),
        ("save_params", Request::SaveParams { mission }),
        ("confirm", Request::Confirm { mission }),
        ("fall_back", Request::FallBack { mission }),
    ];
    let message = |number: usize, request: Request<'_>| {
        // Made as a frame and read back: what postcard makes of it.
        let body = plain(&framed(&ToDevice {
            seq: number as u8,
            request,
        }));
        [&[part::MESSAGE, body.len() as u8][..], &body].concat()
    };
    let mut seeds: Vec<Seed> = requests
        .iter()
        .enumerate()
        .map(|(number, (name, request))| Seed {
            name: (*name).to_owned(),
            bytes: message(number, *request),
        })
        .collect();
    let chunks = (0..self::mission().len())
        .step_by(MAX_CHUNK)
        .flat_map(|offset| [part::CHUNK, (offset / 8) as u8]);
    let uploaded: Vec<u8> = [part::BEGIN, 0].into_iter().chain(chunks).collect();
    let whole = [
        message(100, Request::Hello),
        uploaded.clone(),
        message(101, Request::Commit(Swap::default())),
        vec![part::TIMER, 3],
        requests
            .iter()
            .zip(102..)
            .flat_map(|((_, request), number)| {
                [message(number, *request), vec![part::TIMER, 2]].concat()
            })
            .collect(),
    ]
    .concat();
    seeds.push(Seed {
        name: "session".into(),
        bytes: whole.clone(),
    });
    seeds.push(Seed {
        name: "session_on_a_full_wire".into(),
        bytes: [vec![part::WIRE, 40], whole].concat(),
    });
    let on_trial = Request::Commit(Swap {
        warm: true,
        trial_ms: 50,
    });
    let holding = |kind: u8, request: Request<'_>| {
        let bytes = held(request);
        [&[kind, bytes.len() as u8][..], &bytes].concat()
    };
    let tries = |trial: Vec<u8>, ends: &[Vec<u8>]| {
        [&[uploaded.clone(), trial, vec![part::TIMER, 4]], ends]
            .concat()
            .concat()
    };
    let power = vec![part::RESET, 0];
    let watchdog = vec![part::RESET, 2];
    seeds.extend(
        [
            (
                "trial_without_end",
                tries(holding(part::WITHIN, on_trial), &[]),
            ),
            (
                "trial_that_is_confirmed_and_power_that_is_lost",
                tries(
                    holding(part::WITHIN, on_trial),
                    &[
                        holding(part::WITHIN, Request::Confirm { mission }),
                        vec![part::TIMER, 3],
                        power.clone(),
                        vec![part::TIMER, 3],
                    ],
                ),
            ),
            (
                "power_that_is_lost_during_a_trial",
                tries(
                    holding(part::WITHIN, on_trial),
                    std::slice::from_ref(&power),
                ),
            ),
            (
                "a_watchdog_again_and_again",
                tries(
                    holding(part::WITHIN, Request::Commit(Swap::default())),
                    &vec![watchdog; 5],
                ),
            ),
            (
                "an_emergency_stop_and_power_that_is_lost",
                [message(1, Request::EmergencyStop), power.clone()].concat(),
            ),
            (
                "an_owner_with_a_key",
                [
                    vec![part::KEY, 0],
                    holding(part::OWNED, Request::Status),
                    uploaded.clone(),
                    vec![part::SIGN, 0],
                    holding(part::SIGNED, Request::Commit(Swap::default())),
                    vec![part::TIMER, 3],
                    holding(part::SIGNED, Request::Start),
                    vec![part::TIMER, 3],
                    power,
                    message(1, Request::Start),
                    holding(part::SIGNED, Request::RemoveKey),
                ]
                .concat(),
            ),
            (
                "bytes_of_others_under_the_owners_checksum",
                [
                    vec![part::KEY, 0, part::BEGIN, 0],
                    (0..self::mission().len())
                        .step_by(MAX_CHUNK)
                        .flat_map(|offset| {
                            let data = [0x5a; MAX_CHUNK];
                            let len = MAX_CHUNK.min(self::mission().len() - offset);
                            let (offset, data) = (offset as u32, &data[..len]);
                            message(20, Request::Chunk { offset, data })
                        })
                        .collect(),
                ]
                .concat(),
            ),
            (
                "a_wrong_signature",
                [
                    vec![part::KEY, 0, part::SIGN, 0],
                    holding(part::SIGNED, Request::Start),
                    message(
                        9,
                        Request::Signed {
                            signature: &[1; SIGNATURE_BYTES],
                            request: &held(Request::Start),
                        },
                    ),
                ]
                .concat(),
            ),
            (
                "a_parameter_that_is_kept",
                tries(
                    holding(part::WITHIN, Request::Commit(Swap::default())),
                    &[
                        message(
                            50,
                            Request::SetParam {
                                mission,
                                param: 0,
                                value: 5,
                            },
                        ),
                        vec![part::TIMER, 3],
                        message(51, Request::SaveParams { mission }),
                        vec![part::TIMER, 3, part::LOG, 200, part::RESET, 1],
                        vec![part::TIMER, 3],
                    ],
                ),
            ),
        ]
        .map(|(name, bytes)| Seed {
            name: name.to_owned(),
            bytes,
        }),
    );
    seeds.push(Seed {
        name: "noise".into(),
        bytes: [&[part::RAW, 200][..], &[0x55; 200], &[0]].concat(),
    });
    seeds
}

/// The message in a frame that is shorter than the longest stretch without a 0 that COBS has a
/// number for.
fn plain(frame: &[u8]) -> Vec<u8> {
    let mut message = Vec::new();
    let mut rest = frame;
    while let Some((distance, after)) = rest.split_first().filter(|(first, _)| **first > 0) {
        let (bytes, next) = after.split_at(usize::from(*distance) - 1);
        message.extend(bytes);
        message.push(0);
        rest = next;
    }
    // The last of these zeros stands for the end.
    message.truncate(message.len() - 1 - CRC_BYTES);
    message
}
