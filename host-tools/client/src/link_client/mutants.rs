//! Defects that a test plants into the client, one at a time, to see that they are found. Shipped
//! code has none of this.
//!
//! The laws are what a robot, and whoever uses the client, may rely on; they are held against a
//! robot that says what a law needs it to say, in a time of its own.

use std::cell::Cell;
use std::collections::VecDeque;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use esm_link::access::Access;
use esm_link::features::Features;
use esm_link::frame::{FrameReader, MAX_FRAME_BYTES, checksum, decode, encode};
use esm_link::message::{
    Capacities, Channel, DeviceInfo, FromDevice, LinkError, PROTOCOL_VERSION, Request, ResetReason,
    Response, Stream, ToDevice, Uploads,
};

use super::session::innermost_kind;
use super::timing::REQUEST_DEADLINE;
use super::{ClientError, Flaw, LinkClient, StreamEvent, Streams};
use crate::serial::ByteLink;
use crate::serial::clock::{Clock, SimulatedTime};

/// Makes an enum of defects, and the list of them with what each one is.
macro_rules! bugs {
    ($($bug:ident: $what:literal,)+) => {
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(super) enum Bug { $(#[doc = $what] $bug,)+ }
        const ALL: &[(Bug, &str)] = &[$((Bug::$bug, $what),)+];
    };
}

bugs! {
    StaleAnswerTaken: "an answer to another request is taken for the present one's",
    OldHelloTaken: "what answers hello need not be a hello",
    Renumbered: "a request is sent again under another number",
    OtherVersionAsked: "a robot of another version is asked as if it were of this one",
    DeadlineForgotten: "a command is sent without its deadline",
    DeadlineTooFar: "a command may be carried out after nobody waits any more",
    FlashForgotten: "a robot that writes its flash is asked again before it can have done that",
    LengthBelieved: "a robot may say any length of what is read from it",
    SlownessBorne: "a session whose waits have an end goes on behind it",
    MixedBlobTaken: "a blob that was read in parts of two missions is taken",
    WindowOverrun: "more of an upload is on its way than the robot allows",
    ResumedElsewhere: "an upload goes on at another byte than the robot named",
    StaleChunkAnswerTaken: "an answer of before the upload tells how far it has come",
    ClaimBelieved: "more is believed to have arrived than there is",
    GapIgnored: "a chunk that the robot misses is sent again only when nothing comes any more",
    LossForgotten: "an upload that the robot has forgotten goes on",
    OtherKindTaken: "an answer to a request of another kind is taken for the present one's",
    UnprovenTaken: "an answer without a proof is taken in an owner's session",
    ForgeryTaken: "an answer with a wrong proof is taken in an owner's session",
    SessionEndIgnored: "a session goes on that the robot does not know any more",
    IdentityBelieved: "a robot is believed that does not know the secret of its key",
}

thread_local! {
    static PLANTED: Cell<Option<Bug>> = const { Cell::new(None) };
}

/// Whether this defect is planted in this thread.
pub(super) fn is_mutant(bug: Bug) -> bool {
    PLANTED.get() == Some(bug)
}

/// A law that was broken, and how.
type Broken = String;

/// Time that passes when somebody waits, in microseconds.
#[derive(Default)]
pub(super) struct Waited(AtomicU64);

impl SimulatedTime for Waited {
    fn elapsed(&self) -> Duration {
        Duration::from_micros(self.0.load(Ordering::Relaxed))
    }

    fn pause(&self, time: Duration) {
        self.0.fetch_add(time.as_micros() as u64, Ordering::Relaxed);
    }
}

/// What a robot says to a request of this number.
type Said = Vec<(u8, Result<Response<'static>, LinkError>)>;
type Behaviour = Box<dyn FnMut(u8, &Request<'_>) -> Said + Send>;
/// What somebody sends for a request, frame by frame.
type Frames = Box<dyn FnMut(u8, &Request<'_>) -> Vec<Vec<u8>> + Send>;

/// The line to a robot that behaves as a law needs it to.
struct Line {
    time: Arc<Waited>,
    reader: FrameReader,
    to_host: VecDeque<u8>,
    behave: Behaviour,
    /// Instead of all else, what comes for requests.
    frames: Option<Frames>,
    /// What streams bring behind the answers to hello and to a subscription.
    streams: [Vec<u8>; 2],
}

impl ByteLink for Line {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let count = buffer.len().min(self.to_host.len());
        for (place, byte) in buffer.iter_mut().zip(self.to_host.drain(..count)) {
            *place = byte;
        }
        if count == 0 {
            self.time.pause(timeout.max(Duration::from_micros(1)));
        }
        Ok(count)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.time.pause(FRAME_TIME);
        for byte in bytes {
            let Some(frame) = self.reader.push(*byte) else {
                continue;
            };
            let Ok(ToDevice { seq, request }) = decode(frame) else {
                continue;
            };
            if let Some(frames) = &mut self.frames {
                let frames = frames(seq, &request);
                self.to_host.extend(frames.into_iter().flatten());
                continue;
            }
            let of = innermost_kind(&request);
            for (seq, result) in (self.behave)(seq, &request) {
                self.to_host.extend(reply(seq, result, of));
            }
            let [behind_hello, behind_subscribe] = &mut self.streams;
            match request {
                Request::Hello => self.to_host.extend(behind_hello.drain(..)),
                Request::Subscribe { .. } => self.to_host.extend(behind_subscribe.drain(..)),
                _ => {}
            }
        }
        Ok(())
    }

    fn clock(&self) -> Clock {
        Clock::simulated(self.time.clone())
    }
}

fn reply(seq: u8, result: Result<Response<'_>, LinkError>, of: u8) -> Vec<u8> {
    let mut frame = [0; MAX_FRAME_BYTES];
    let reply = FromDevice::Reply { seq, result, of };
    let length = encode(&reply, &mut frame).expect("it fits");
    frame[..length].to_vec()
}

/// A robot with a key, and somebody who speaks before it.
mod owned {
    use esm_link::access::{NONCE_BYTES, PROOF_BYTES, SALT_BYTES};
    use esm_link::frame::encode_with;
    use esm_link::message::{Identity, PROVEN_HEADER_BYTES};
    use esm_link::proof::Session;

    use super::*;
    use crate::keys::SigningKey;

    const SALT: [u8; SALT_BYTES] = [4; SALT_BYTES];
    const NONCE: [u8; NONCE_BYTES] = [5; NONCE_BYTES];

    fn key() -> SigningKey {
        SigningKey::of(&[9; 32])
    }

    /// What is said before the robot's own answer.
    #[derive(Clone, Copy, PartialEq)]
    pub(super) enum Before {
        /// An answer without a proof.
        Unproven,
        /// An answer with a wrong one.
        Forged,
        /// Another salt, for the first time.
        Identity,
        /// That there is no session, of a robot that has started anew.
        Reset,
    }

    /// The time that the owner's session is told, of which the robot's own is 2.
    pub(super) fn told(before: Before) -> Result<u64, Broken> {
        let mut session: Option<Session> = None;
        let (mut is_first, mut is_reset, mut time_told) = (true, false, 2);
        let robot = move |seq: u8, request: &Request<'_>| {
            let of = request.kind();
            match *request {
                Request::Hello => {
                    let Response::Hello(info) = hello(PROTOCOL_VERSION) else {
                        return vec![];
                    };
                    let info = Response::Hello(DeviceInfo {
                        access: Access::Locked,
                        ..info
                    });
                    vec![reply(seq, Ok(info), of)]
                }
                Request::Identify { nonce } => {
                    let (public, counter) = (key().public().0, 7);
                    let secret = key().secret(&SALT);
                    session = Some(secret.keyed().session(&nonce, &NONCE));
                    let mut identity = Identity {
                        key: public,
                        salt: SALT,
                        nonce: NONCE,
                        counter,
                        proof: secret
                            .keyed()
                            .of_identity(&nonce, &public, &SALT, &NONCE, counter),
                    };
                    if before == Before::Identity && is_first {
                        identity.salt = [0; SALT_BYTES];
                    }
                    is_first = false;
                    vec![reply(seq, Ok(Response::Identity(identity)), of)]
                }
                Request::OpenSession { proof, .. } => match session {
                    Some(session) if session.opening() == proof => {
                        vec![proven(seq, 0, &session, Response::Done, of)]
                    }
                    _ => {
                        // An opening to a secret that is not the robot's.
                        time_told = 3;
                        vec![reply(seq, Err(LinkError::WrongProof), of)]
                    }
                },
                Request::Proven { number, .. } => {
                    if before == Before::Reset && !is_reset {
                        is_reset = true;
                        session = None;
                    }
                    let Some(session) = session else {
                        return vec![reply(seq, Err(LinkError::NoSession), of)];
                    };
                    let of = Request::Clock.kind();
                    let clock = |now_us| Response::Clock { now_us };
                    let first = match before {
                        Before::Unproven => reply(seq, Ok(clock(1)), of),
                        Before::Forged => proven(seq, number ^ 1, &session, clock(1), of),
                        Before::Identity | Before::Reset => vec![],
                    };
                    vec![first, proven(seq, number, &session, clock(time_told), of)]
                }
                _ => vec![],
            }
        };
        let line = Line {
            time: Arc::default(),
            reader: FrameReader::new(),
            to_host: VecDeque::new(),
            streams: Default::default(),
            behave: Box::new(|_, _| vec![]),
            frames: Some(Box::new(robot)),
        };
        let (mut client, _) = LinkClient::connect(line).map_err(failed)?;
        client.use_key(Box::new(|| Ok(key())));
        client.robot_us().map_err(failed)
    }

    fn proven(seq: u8, number: u32, session: &Session, response: Response<'_>, of: u8) -> Vec<u8> {
        let mut frame = [0; MAX_FRAME_BYTES];
        let message = FromDevice::Proven {
            seq,
            proof: [0; PROOF_BYTES],
            result: Ok(response),
            of,
        };
        let prove = |message: &mut [u8]| {
            let (head, answer) = message.split_at_mut(PROVEN_HEADER_BYTES);
            head[2..].copy_from_slice(&session.of_answer(number, answer));
        };
        let length = encode_with(&message, &mut frame, prove).expect("it fits");
        frame[..length].to_vec()
    }
}

/// What a frame takes on the line.
const FRAME_TIME: Duration = Duration::from_millis(2);

/// How long the robot's flash takes.
const FLASH_MS: u16 = 900;

const CHUNK_BYTES: usize = 100;
const WINDOW_BYTES: usize = 300;

fn hello(protocol: u16) -> Response<'static> {
    Response::Hello(DeviceInfo {
        protocol,
        firmware: "a robot",
        board: "none",
        task_types: 0,
        capacities: Capacities {
            blob_bytes: 4_096,
            arena_words: 1,
            slots: 1,
            task_instances: 1,
            nets: 1,
            exclusive_groups: 1,
        },
        mission: None,
        reset: ResetReason::PowerOn,
        uploads: Uploads {
            chunk_bytes: CHUNK_BYTES as u16,
            window_bytes: WINDOW_BYTES as u16,
        },
        access: Access::Open,
    })
}

/// A session with a robot that answers `hello` by itself and all else as it is told to, and the
/// time that the session takes.
fn session(
    behave: impl FnMut(u8, &Request<'_>) -> Said + Send + 'static,
) -> Result<(LinkClient<Line>, Arc<Waited>), Broken> {
    session_after(Vec::new(), Default::default(), behave)
}

/// A session on a line on which these bytes are already, and with streams that bring these.
fn session_after(
    before: Vec<u8>,
    streams: [Vec<u8>; 2],
    mut behave: impl FnMut(u8, &Request<'_>) -> Said + Send + 'static,
) -> Result<(LinkClient<Line>, Arc<Waited>), Broken> {
    let time = Arc::<Waited>::default();
    let line = Line {
        time: time.clone(),
        reader: FrameReader::new(),
        to_host: before.into(),
        streams,
        behave: Box::new(move |seq, request| match request {
            Request::Hello => vec![
                // Of the session before, under the same number.
                (seq, Ok(Response::Done)),
                (seq, Ok(hello(PROTOCOL_VERSION))),
            ],
            Request::Features => {
                let told = Response::Features {
                    built_in: Features::NONE,
                    flash_ms: FLASH_MS,
                };
                vec![(seq, Ok(told))]
            }
            request => behave(seq, request),
        }),
        frames: None,
    };
    let (client, _) = LinkClient::connect(line).map_err(|error| format!("hello: {error}"))?;
    Ok((client, time))
}

/// The frame of a part of the log.
fn log_part(seq: u8, dropped: u32, bytes: &[u8]) -> Vec<u8> {
    let mut frame = [0; MAX_FRAME_BYTES];
    let part = FromDevice::Stream(Stream {
        channel: Channel::Log,
        seq,
        continues: false,
        dropped,
        bytes,
    });
    let length = encode(&part, &mut frame).expect("it fits");
    frame[..length].to_vec()
}

fn holds(what: &str, holds: bool) -> Result<(), Broken> {
    if holds { Ok(()) } else { Err(what.to_owned()) }
}

fn failed(error: ClientError) -> Broken {
    error.to_string()
}

/// Bytes that end with their checksum, as a blob does.
fn blob(bytes: usize, salt: u8) -> Vec<u8> {
    let mut blob: Vec<u8> = (0..bytes).map(|at| at as u8 ^ salt).collect();
    let crc = checksum(&blob);
    blob.extend(crc.to_le_bytes());
    blob
}

/// How a robot takes an upload.
#[derive(Default)]
struct Taken {
    bytes: Vec<u8>,
    /// Numbers of requests for chunks, and where each one began.
    chunks: Vec<(u8, usize)>,
    /// Announcements of an upload.
    begun: usize,
}

impl Taken {
    /// Takes a chunk as a robot does.
    fn chunk(&mut self, seq: u8, offset: u32, data: &[u8]) -> Result<Response<'static>, LinkError> {
        let offset = offset as usize;
        self.chunks.push((seq, offset));
        let there = self.bytes.len();
        let Some(known) = there.checked_sub(offset) else {
            let expected = there as u32;
            return Err(LinkError::WrongOffset { expected });
        };
        self.bytes.extend(data.get(known..).unwrap_or_default());
        let len = self.bytes.len() as u32;
        Ok(Response::Received { len })
    }
}

/// Uploads to a robot that has `there` already; `chunk` says what it answers, which by itself is
/// what [`Taken::chunk`] does. Returns what it took, and how long that took.
fn upload(
    blob: &[u8],
    there: usize,
    mut chunk: impl FnMut(&mut Taken, u8, u32, &[u8]) -> Said + Send + 'static,
) -> Result<(Taken, Duration), Broken> {
    let taken = Arc::new(Mutex::new(Taken {
        bytes: blob[..there].to_vec(),
        ..Taken::default()
    }));
    let of_robot = taken.clone();
    let (mut client, time) = session(move |seq, request| {
        let mut taken = of_robot.lock().expect("nobody panics with it");
        match *request {
            Request::Begin { .. } => {
                taken.begun += 1;
                let len = taken.bytes.len() as u32;
                vec![(seq, Ok(Response::Received { len }))]
            }
            Request::Chunk { offset, data } => chunk(&mut taken, seq, offset, data),
            _ => vec![(seq, Ok(Response::Done))],
        }
    })?;
    let before = time.elapsed();
    client.stage(blob, &mut |_| ()).map_err(failed)?;
    let took = time.elapsed() - before;
    let taken = std::mem::take(&mut *taken.lock().expect("nobody panics with it"));
    holds("all of it arrives", taken.bytes == blob)?;
    Ok((taken, took))
}

type Law = fn() -> Result<(), Broken>;

/// What holds, and how that is seen.
const LAWS: &[(&str, Law)] = &[
    ("a request is answered by its own answer", || {
        let (mut client, _) = session(|seq, _| {
            let clock = |now_us| Ok(Response::Clock { now_us });
            vec![(seq.wrapping_sub(1), clock(1)), (seq, clock(2))]
        })?;
        holds(
            "the second is its own",
            client.robot_us().map_err(failed)? == 2,
        )
    }),
    ("a request is answered by one to its kind", || {
        let (mut client, _) = session(|_, _| vec![])?;
        client.link.frames = Some(Box::new(|seq, request| {
            let clock = |now_us| Ok(Response::Clock { now_us });
            let (others, own) = (Request::Status.kind(), request.kind());
            vec![reply(seq, clock(1), others), reply(seq, clock(2), own)]
        }));
        holds("its own", client.robot_us().map_err(failed)? == 2)
    }),
    ("in a session nobody speaks for the robot", || {
        use owned::{Before, told};
        for before in [Before::Unproven, Before::Forged, Before::Identity] {
            holds("its own answer", told(before)? == 2)?;
        }
        Ok(())
    }),
    ("a robot that has started anew gets another session", || {
        holds("it answers in it", owned::told(owned::Before::Reset)? == 2)
    }),
    ("a request is sent again as it was", || {
        let seen = Arc::new(Mutex::new(Vec::new()));
        let of_robot = seen.clone();
        let (mut client, _) = session(move |seq, _| {
            let mut seen = of_robot.lock().expect("nobody panics with it");
            seen.push(seq);
            // The answers to the first two sendings are lost.
            let answer = (seq, Ok(Response::Done));
            (seen.len() > 2).then_some(answer).into_iter().collect()
        })?;
        client.abort().map_err(failed)?;
        let seen = seen.lock().expect("nobody panics with it");
        holds("under one number", seen.iter().all(|seq| *seq == seen[0]))
    }),
    ("what no robot understands is sent again once", || {
        let sent = Arc::new(Mutex::new(0));
        let of_robot = sent.clone();
        let (mut client, _) = session(move |seq, _| {
            *of_robot.lock().expect("nobody panics with it") += 1;
            vec![(seq, Err(LinkError::Malformed))]
        })?;
        let refused = client.abort().map_err(|error| error.refusal());
        let sent = *sent.lock().expect("nobody panics with it");
        holds("it is told", refused == Err(Some(LinkError::Malformed)))?;
        holds("once", sent == 2)
    }),
    (
        "a robot that cannot tell yet is asked again, for a while",
        || {
            let (mut client, _) = session(|seq, request| match *request {
                Request::Begin { len: 1, .. } => vec![(seq, Err(LinkError::NoAnswer))],
                _ => vec![(seq, Ok(Response::Received { len: 0 }))],
            })?;
            let refused = client.begin(&[0]).map_err(|error| error.refusal());
            holds("it is told", refused == Err(Some(LinkError::NoAnswer)))?;
            let mut asked = 0;
            let (mut client, time) = session(move |seq, _| {
                asked += 1;
                let answer = match asked {
                    1 => Err(LinkError::NoAnswer),
                    2 => Err(LinkError::TooSoon { ms: 300 }),
                    _ => Ok(Response::Done),
                };
                vec![(seq, answer)]
            })?;
            let before = time.elapsed();
            client.abort().map_err(failed)?;
            let waited = time.elapsed() - before;
            holds("after its time", waited >= Duration::from_millis(300))
        },
    ),
    ("a session has its own streams alone", || {
        // The robot still sends to the session before when the new one begins.
        let before = [log_part(38, 7, b"old"), log_part(39, 7, b"old")].concat();
        let own = [log_part(0, 7, b"new"), log_part(1, 7, b"new")].concat();
        let streams = [log_part(40, 7, b"old"), own];
        let (mut client, _) =
            session_after(before, streams, |seq, _| vec![(seq, Ok(Response::Done))])?;
        client.subscribe(Streams::NONE).map_err(failed)?;
        client.listen(Duration::ZERO).map_err(failed)?;
        let expected = StreamEvent::Log(b"new".to_vec());
        let events = client.take_events();
        holds("whole", events == [expected.clone(), expected])?;
        client.hello().map_err(failed)?;
        client.link.streams[1] = log_part(0, 7, b"new");
        client.subscribe(Streams::NONE).map_err(failed)?;
        client.listen(Duration::ZERO).map_err(failed)?;
        let events = client.take_events();
        holds(
            "as does the next",
            events == [StreamEvent::Log(b"new".to_vec())],
        )
    }),
    ("of a robot of another version nothing is asked", || {
        let time = Arc::<Waited>::default();
        let line = Line {
            time,
            reader: FrameReader::new(),
            to_host: VecDeque::new(),
            streams: Default::default(),
            behave: Box::new(|seq, _| vec![(seq, Ok(hello(PROTOCOL_VERSION + 1)))]),
            frames: None,
        };
        let is_named = matches!(
            LinkClient::connect(line),
            Err(ClientError::OtherVersion { robot }) if robot == PROTOCOL_VERSION + 1
        );
        holds("its version is named", is_named)
    }),
    ("nobody gives a command up before its deadline", || {
        const NOW_US: u64 = 5_000_000;
        let deadline = Arc::new(Mutex::new(None));
        let of_robot = deadline.clone();
        let (mut client, time) = session(move |seq, request| match *request {
            Request::Clock => vec![(seq, Ok(Response::Clock { now_us: NOW_US }))],
            Request::Within { by_us, .. } => {
                *of_robot.lock().expect("nobody panics with it") = Some(by_us);
                vec![]
            }
            _ => vec![],
        })?;
        let before = time.elapsed();
        let given_up = matches!(client.start(), Err(ClientError::NoReply { .. }));
        let waited = time.elapsed() - before;
        holds("there is no answer", given_up)?;
        let deadline = deadline.lock().expect("nobody panics with it");
        let by_us = deadline.ok_or("there is no deadline")?;
        let left = Duration::from_micros(by_us - NOW_US);
        holds("it is as far as the client waits", left <= waited)?;
        holds("and no nearer", left >= REQUEST_DEADLINE)
    }),
    ("a robot gets the time that its flash takes", || {
        let sent = Arc::new(Mutex::new(0));
        let of_robot = sent.clone();
        let (mut client, time) = session(move |seq, request| match *request {
            Request::Clock => vec![(seq, Ok(Response::Clock { now_us: 0 }))],
            Request::Within { .. } => {
                *of_robot.lock().expect("nobody panics with it") += 1;
                vec![]
            }
            _ => vec![],
        })?;
        let before = time.elapsed();
        let given_up = matches!(client.confirm(1), Err(ClientError::NoReply { .. }));
        let waited = time.elapsed() - before;
        holds("there is no answer", given_up)?;
        let flash = Duration::from_millis(FLASH_MS.into());
        let sent = *sent.lock().expect("nobody panics with it");
        holds("before each sending but the first", flash * sent <= waited)
    }),
    ("a blob is that of one mission", || {
        let read = |changes: u8| {
            let mut reads = 0;
            let (mut client, _) = session(move |seq, request| {
                let Request::ReadBlob { offset } = *request else {
                    return vec![];
                };
                // Another mission runs for each part, so many times.
                let mission = blob(100, reads.min(changes));
                reads += 1;
                let from = offset as usize;
                let part: &'static [u8] =
                    Vec::leak(mission[from..mission.len().min(from + 60)].to_vec());
                let total = mission.len() as u32;
                vec![(seq, Ok(Response::Blob { total, data: part }))]
            })?;
            Ok::<_, Broken>(client.running_blob())
        };
        let once = read(1)?.map_err(failed)?;
        holds("the one that runs", once == blob(100, 1))?;
        let ended = read(u8::MAX)?;
        holds(
            "or none",
            matches!(ended, Err(ClientError::BadAnswer { .. })),
        )
    }),
    ("what is read is no longer than it can be", || {
        const SAID: u32 = u32::MAX;
        // One that never ends: as long as it says the same each time, there is always a next part.
        let asked = Arc::new(Mutex::new(0));
        let of_robot = asked.clone();
        let (mut client, _) = session(move |seq, request| {
            let mut asked = of_robot.lock().expect("nobody panics with it");
            *asked += 1;
            match *request {
                Request::ReadBlob { .. } if *asked < 100 => {
                    let data = &[7; 60];
                    vec![(seq, Ok(Response::Blob { total: SAID, data }))]
                }
                _ => vec![(seq, Err(LinkError::NoMission))],
            }
        })?;
        let read = client.running_blob();
        let is_told = matches!(
            read,
            Err(ClientError::BadParts {
                flaw: Flaw::TooLong {
                    said: 0xffff_ffff,
                    most: 4_096,
                    ..
                },
                ..
            })
        );
        holds("it is told", is_told)?;
        let asked = *asked.lock().expect("nobody panics with it");
        holds("at once", asked == 1)
    }),
    (
        "a session that is to end ends, however busy the robot",
        || {
            let (mut client, time) = session(|seq, _| vec![(seq, Err(LinkError::NoAnswer))])?;
            let limit = Duration::from_secs(3);
            client.limit_waits(Some(limit));
            let before = time.elapsed();
            let told = client.abort();
            holds(
                "it is told",
                matches!(told, Err(ClientError::TooSlow { .. })),
            )?;
            let took = time.elapsed() - before;
            holds("in time", took < limit + Duration::from_millis(200))?;
            client.limit_waits(None);
            let refused = client.abort().map_err(|error| error.refusal());
            holds(
                "and goes on without a limit",
                refused == Err(Some(LinkError::NoAnswer)),
            )
        },
    ),
    ("an upload goes on as soon as answers come", || {
        let mut withheld = Vec::new();
        let (taken, _) = upload(&blob(1_000, 0), 0, move |taken, seq, offset, data| {
            let answer = taken.chunk(seq, offset, data);
            withheld.push((seq, answer));
            // It answers when the window is full, or all is there.
            let is_full = withheld.len() * CHUNK_BYTES >= WINDOW_BYTES;
            if is_full || taken.bytes.len() == 1_004 {
                std::mem::take(&mut withheld)
            } else {
                vec![]
            }
        })?;
        holds("each chunk is sent once", taken.chunks.len() == 11)
    }),
    (
        "a robot that says nothing gets its window and no more",
        || {
            let (mut client, _) = {
                let ahead = Arc::new(Mutex::new(0));
                let of_robot = ahead.clone();
                let (client, time) = session(move |seq, request| match *request {
                    Request::Begin { .. } => vec![(seq, Ok(Response::Received { len: 0 }))],
                    Request::Chunk { offset, data } => {
                        let end = offset as usize + data.len();
                        let mut ahead = of_robot.lock().expect("nobody panics with it");
                        *ahead = end.max(*ahead);
                        // Refuses as soon as it is too much; that ends the upload.
                        if *ahead > WINDOW_BYTES {
                            vec![(seq, Err(LinkError::TooLong))]
                        } else {
                            vec![]
                        }
                    }
                    _ => vec![],
                })?;
                (client, time)
            };
            let ended = client.stage(&blob(1_000, 0), &mut |_| ());
            holds(
                "it waits",
                matches!(ended, Err(ClientError::NoReply { .. })),
            )
        },
    ),
    ("an upload goes on where the robot says", || {
        let (taken, _) = upload(&blob(600, 0), 250, |taken, seq, offset, data| {
            vec![(seq, taken.chunk(seq, offset, data))]
        })?;
        holds(
            "at that byte",
            taken.chunks.first().map(|(_, at)| *at) == Some(250),
        )
    }),
    (
        "what was said of another upload says nothing of this one",
        || {
            let (taken, _) = upload(&blob(600, 0), 0, |taken, seq, offset, data| {
                // Of before the upload, which lay on the line: more than there is now, and within
                // the blob.
                let old = (seq.wrapping_sub(100), Ok(Response::Received { len: 500 }));
                vec![old, (seq, taken.chunk(seq, offset, data))]
            })?;
            holds("all of it was sent", taken.chunks.len() >= 6)
        },
    ),
    ("no more is believed to be there than there is", || {
        let (taken, _) = upload(&blob(600, 0), 0, |taken, seq, offset, data| {
            let answer = taken.chunk(seq, offset, data);
            vec![(seq, Ok(Response::Received { len: 5_000 })), (seq, answer)]
        })?;
        holds("all of it was sent", taken.chunks.len() >= 6)
    }),
    (
        "a lost chunk costs no wait, and what is behind it once",
        || {
            let mut is_lost = false;
            let mut waiting = Vec::new();
            let (taken, took) = upload(&blob(1_000, 0), 0, move |taken, seq, offset, data| {
                if offset == 100 && !is_lost {
                    is_lost = true;
                    return vec![];
                }
                // Answers come when the window is full, so that some are under way when the first
                // tells of the loss.
                waiting.push((seq, taken.chunk(seq, offset, data)));
                if is_lost && waiting.len() < 2 && taken.bytes.len() == 100 {
                    return vec![];
                }
                std::mem::take(&mut waiting)
            })?;
            holds("nobody waits", took < Duration::from_millis(50))?;
            // Shorter ones may follow a loss.
            holds("once", taken.chunks.len() <= 17)
        },
    ),
    ("an upload that the robot has forgotten begins anew", || {
        let mut is_reset = false;
        let (taken, _) = upload(&blob(600, 0), 0, move |taken, seq, offset, data| {
            if offset >= 200 && !is_reset {
                is_reset = true;
                taken.bytes.clear();
                taken.begun = 0;
                return vec![(seq, Err(LinkError::NoUpload))];
            }
            if taken.begun == 0 {
                return vec![(seq, Err(LinkError::NoUpload))];
            }
            vec![(seq, taken.chunk(seq, offset, data))]
        })?;
        holds("once", taken.begun == 1)
    }),
];

/// The first law that is broken, and how. A panic breaks one, too.
fn broken() -> Option<(&'static str, Broken)> {
    LAWS.iter().find_map(|(name, law)| {
        let result = catch_unwind(AssertUnwindSafe(law));
        let result = result.unwrap_or_else(|_| Err("it panics".to_owned()));
        result.err().map(|broken| (*name, broken))
    })
}

#[test]
fn without_a_planted_defect_the_client_keeps_its_laws() {
    assert_eq!(broken(), None);
}

#[test]
fn every_planted_defect_of_the_client_breaks_a_law() {
    let mut missed = Vec::new();
    println!();
    for (bug, what) in ALL {
        PLANTED.set(Some(*bug));
        let found = broken();
        PLANTED.set(None);
        let noticed = found.map_or("NOT NOTICED", |(law, _)| law);
        println!("client {:24} {what:96} {noticed}", format!("{bug:?}"));
        if noticed == "NOT NOTICED" {
            missed.push(*what);
        }
    }
    assert!(missed.is_empty(), "not noticed: {missed:#?}");
}
