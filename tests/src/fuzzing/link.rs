//! A robot whose line brings anything.

use std::collections::VecDeque;
use std::sync::OnceLock;

use rt_firmware::link::frame::{CRC_BYTES, FrameReader, MAX_FRAME_BYTES, checksum, decode, encode};
use rt_firmware::link::message::{
    FromDevice, LinkError, MAX_CHUNK, Mode, Request, Response, Swap, ToDevice,
};
use rt_firmware::{
    About, Bank, Board, Io, Limits, LinkPort, LinkSide, Mail, Memory, RealTime, Step, Task,
    registry, split, task,
};
use serde::Serialize;
use serde::ser::{SerializeTuple, Serializer};

use super::seeds::Seed;
use crate::subject;

/// What the robot has room for.
const BLOB_BYTES: usize = 2_048;
const ARENA_WORDS: usize = 64;
const SLOTS: usize = 4;

/// Greatest number of times that the timer comes before a request is answered. One comes to answer it; some more are for a swap.
const TIMER_CALLS_TO_AN_ANSWER: usize = 8;

/// How often a request of the good client may be sent. The first answers can be [`LinkError::Busy`], of a request before that is still under way: a start
/// or a swap waits for the interpreter's next occurrence, and an occurrence passes between two sendings.
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
    pub const COUNT: u8 = 6;
}

struct Lamp;
task! { impl Lamp { flags { out lit; } params { limit: u32 = 1, 1..=9; } } }
impl Task for Lamp {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        io.set(Self::LIT, true);
        Step::Run
    }
}

registry! {
    struct Lamps { lamp: Lamp[2] }
}

const MISSION: &str = "interpreter slot 1; slot 1 period 10 ms duration 1 ms; slot 2 period 5 ms duration 1 ms;
task Lamp slot 2 { out flag lit; param limit: u32 = 1; }
machine M { region r { task On: Lamp with { limit = 3 }; task Off: Lamp; initial -> On; On -> Off on pulse [.lit]; Off -> On on pulse [.lit]; } }";

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

#[derive(Default)]
struct Wire {
    to_robot: VecDeque<u8>,
    to_host: Vec<u8>,
    /// Bytes that it takes.
    room: usize,
}

impl LinkPort for Wire {
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
struct Subject<'q, 'm> {
    real_time: RealTime<'q, 'm, SLOTS>,
    link: LinkSide<'q, 'm>,
    timer: Timer,
    wire: Wire,
    reader: FrameReader,
    seq: u8,
}

impl Subject<'_, '_> {
    fn timer_comes(&mut self) {
        let next_ticks = self.real_time.on_timer(&mut self.timer);
        assert!(next_ticks > self.timer.0, "time goes on");
        self.timer.0 = next_ticks;
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

    /// What came from the robot: each frame of it is a message. Answers the last reply.
    fn heard(&mut self) -> Option<(u8, Result<(), LinkError>)> {
        let mut last = None;
        for byte in std::mem::take(&mut self.wire.to_host) {
            let Some(frame) = self.reader.push(byte) else {
                continue;
            };
            match decode(frame).unwrap_or_else(|error| panic!("the robot sends {error:?}")) {
                FromDevice::Reply { seq, result } => last = Some((seq, result.map(drop))),
                FromDevice::Stream(_) | FromDevice::News(_) => {}
            }
        }
        last
    }

    /// Does what the bytes say.
    fn suffer(&mut self, mut bytes: &[u8]) {
        while let [kind, count, rest @ ..] = bytes {
            let count = usize::from(*count);
            let (own, after) = rest.split_at(count.min(rest.len()));
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
                part::WIRE => self.wire.room = count,
                part::CHUNK => {
                    let offset = count * 8;
                    let data = mission().get(offset..).unwrap_or_default();
                    let data = data.get(..MAX_CHUNK).unwrap_or(data);
                    self.request(Request::Chunk {
                        offset: offset as u32,
                        data,
                    });
                }
                _ => self.request(begin()),
            }
            self.poll();
            self.heard();
        }
        self.wire.to_robot.extend(bytes);
        self.poll();
    }

    fn request(&mut self, request: Request<'_>) {
        self.seq = self.seq.wrapping_add(1);
        let seq = self.seq;
        self.wire
            .to_robot
            .extend(framed(&ToDevice { seq, request }));
    }

    /// Asks as a good client does, and reads the answer.
    fn ask<T>(
        &mut self,
        request: Request<'_>,
        mut read: impl FnMut(Response<'_>) -> Option<T>,
    ) -> T {
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
                    match decode(frame).unwrap_or_else(|error| panic!("the robot sends {error:?}"))
                    {
                        // Of before, under the same number.
                        FromDevice::Reply { result, .. }
                            if request == Request::Hello
                                && !matches!(result, Ok(Response::Hello(_))) => {}
                        FromDevice::Reply { seq, result } if seq == self.seq => {
                            answer = Some(result.map(|response| {
                                read(response).unwrap_or_else(|| {
                                    panic!("{request:?} is answered with something else")
                                })
                            }));
                        }
                        _ => {}
                    }
                }
                if answer.is_some() {
                    break;
                }
                self.timer_comes();
            }
            match answer {
                Some(Ok(answer)) => return answer,
                Some(Err(LinkError::Busy)) => self.timer_comes(),
                Some(Err(error)) => panic!("{request:?} is refused: {error:?}"),
                None => panic!("{request:?} is not answered"),
            }
        }
        panic!("the robot is busy for ever");
    }
}

fn begin() -> Request<'static> {
    let blob = mission();
    Request::Begin {
        len: blob.len() as u32,
        crc: checksum(blob),
    }
}

/// Lets anything come over the line of a robot; then a good client greets it, uploads a mission and starts it.
///
/// # Panics
/// Where the robot does not answer that client within a few occurrences of its slots, or sends what is no message.
pub fn link(bytes: &[u8]) {
    let mut lamps = Lamps {
        lamp: Bank::new([Lamp, Lamp]),
    };
    let mut banks = lamps.banks();
    let mut memory = Memory::<BLOB_BYTES, ARENA_WORDS, SLOTS, 4, 4, 1, 256>::new();
    let mut mail = Mail::new();
    let about = About::new("lamps", "fuzzed");
    let sides = split(&mut memory, &mut banks, &mut mail, about, Limits::default());
    let Ok((real_time, _, link)) = sides else {
        panic!("the registry is right");
    };
    let mut subject = Subject {
        real_time,
        link,
        timer: Timer(0),
        wire: Wire {
            room: usize::MAX,
            ..Wire::default()
        },
        reader: FrameReader::new(),
        seq: 0,
    };
    subject.suffer(bytes);

    subject.wire.room = usize::MAX;
    subject.poll();
    let (firmware, chunk_bytes) = subject.ask(Request::Hello, |response| match response {
        Response::Hello(info) => Some((info.firmware.to_owned(), info.uploads.chunk_bytes)),
        _ => None,
    });
    assert_eq!(
        (firmware.as_str(), usize::from(chunk_bytes)),
        ("lamps", MAX_CHUNK)
    );
    let done = |response: Response<'_>| matches!(response, Response::Done).then_some(());
    // What was suffered may have been an emergency stop, which lasts until it is released.
    subject.ask(Request::Release, done);
    let received = |response: Response<'_>| match response {
        Response::Received { len } => Some(len as usize),
        _ => None,
    };
    let blob = mission();
    let mut there = subject.ask(begin(), received);
    while there < blob.len() {
        let end = blob.len().min(there + MAX_CHUNK);
        let request = Request::Chunk {
            offset: there as u32,
            data: &blob[there..end],
        };
        assert_eq!(subject.ask(request, received), end);
        there = end;
    }
    let hash = subject.ask(
        Request::Commit(Swap::default()),
        |response| match response {
            Response::Committed { mission, .. } => Some(mission),
            _ => None,
        },
    );
    subject.ask(Request::Start, done);
    let status = subject.ask(Request::Status, |response| match response {
        Response::Status(status) => Some(status),
        _ => None,
    });
    assert_eq!((status.mode, status.mission), (Mode::Running, Some(hash)));
    let steps = status.steps;
    (0..10).for_each(|_| subject.timer_comes());
    let status = subject.ask(Request::Status, |response| match response {
        Response::Status(status) => Some(status),
        _ => None,
    });
    assert!(status.steps > steps, "it drives");
}

/// Sessions of good clients, whole and in disorder.
pub fn sessions() -> Vec<Seed> {
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
        ("task_counters", Request::TaskCounters { task_instance: 0 }),
        (
            "watch",
            Request::Watch {
                news: true,
                period_ms: 10,
            },
        ),
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
    let chunks = (0..mission().len())
        .step_by(MAX_CHUNK)
        .flat_map(|offset| [part::CHUNK, (offset / 8) as u8]);
    let uploaded: Vec<u8> = [part::BEGIN, 0].into_iter().chain(chunks).collect();
    let whole = [
        message(100, Request::Hello),
        uploaded,
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
    seeds.push(Seed {
        name: "noise".into(),
        bytes: [&[part::RAW, 200][..], &[0x55; 200], &[0]].concat(),
    });
    seeds
}

/// The message in a frame that is shorter than the longest stretch without a 0 that COBS has a number for.
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
