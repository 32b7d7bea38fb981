//! The client against the firmware's own end of the link, over lines that are good, bad, and cut.

use super::mutants::Waited;
use super::timing::REQUEST_DEADLINE;
use super::*;
use crate::flash::Flash;
use crate::host_board::{self, HostBoard};
use crate::keys::SigningKey;
use crate::lockstep::pace::Pace;
use crate::lockstep::plant_side::PlantSide;
use crate::serial::clock::SimulatedTime;
use crate::serial::noise::{Noise, Noisy};
use crate::serial::pipe::{self, PipeEnd};
use esm_core::Refusal;
use esm_toolkit::compile::NameTable;
use esm_toolkit::fit::compile_to_fit;
use esm_toolkit::plant::{BodyParameters, Plant};
use esm_toolkit::world::World;
use std::collections::VecDeque;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

fn robot() -> (HostBoard, PipeEnd) {
    let world = World::parse("world cell\n start 1,1 0\n wall 0,0 3,0 3,3 0,3 0,0").unwrap();
    let plant = Plant::new(world, BodyParameters::default(), 1).unwrap();
    // A command's deadline is a time of the robot's: that must not run away while the client works.
    let plant = PlantSide::new(plant, Pace::new(true), None);
    HostBoard::start(host_board::rover, plant, None).unwrap()
}

fn declarations<L: ByteLink>(client: &mut LinkClient<L>, info: &RobotInfo) -> Vec<String> {
    (0..info.task_types)
        .map(|index| client.task_declaration(index).unwrap())
        .collect()
}

/// Bytes that are no blob, all different from their neighbours.
fn junk(length: usize) -> Vec<u8> {
    (0..length).map(|i| (i * 31 + i / 256) as u8).collect()
}

#[test]
fn a_robot_says_who_it_is_and_what_it_can() {
    let (_board, line) = robot();
    let (mut client, info) = LinkClient::connect(line).unwrap();
    assert_eq!(info.board, host_board::BOARD);
    assert_eq!(info.mission, None);
    let declarations = declarations(&mut client, &info);
    assert!(
        declarations
            .iter()
            .any(|text| text.contains("\ntask Cruise "))
    );
    let refused = client.task_declaration(info.task_types).unwrap_err();
    assert_eq!(refused.refusal(), Some(LinkError::NoSuchIndex));
    let refused = client.running_blob().unwrap_err();
    assert_eq!(refused.refusal(), Some(LinkError::NoMission));
}

#[test]
fn over_a_bad_line_every_answer_is_the_right_one() {
    let (_board, line) = robot();
    let (mut client, info) = LinkClient::connect(line).unwrap();
    let expected = declarations(&mut client, &info);
    let LinkClient { link, .. } = client;
    let noisy = Noisy::new(link, Noise::of_each(Noise::WHOLE / 300), 11);
    let (mut client, info) = LinkClient::connect(noisy).unwrap();
    assert_eq!(declarations(&mut client, &info), expected);
    assert!(client.counts().retries > 0, "the line was too good to tell");
}

#[test]
fn over_a_bad_line_an_upload_arrives_as_it_was_sent() {
    let blob = junk(1500);
    for seed in 0..3 {
        let (_board, line) = robot();
        let noisy = Noisy::new(line, Noise::of_each(Noise::WHOLE / 300), seed);
        let (mut client, _) = LinkClient::connect(noisy).unwrap();
        let mut told = Vec::new();
        client.stage(&blob, &mut |bytes| told.push(bytes)).unwrap();
        assert_eq!(told.last(), Some(&blob.len()));
        // The robot looks at the checksum of the whole before it looks at what it means.
        let refused = client.commit(Swap::default()).unwrap_err().refusal();
        assert_eq!(
            refused,
            Some(LinkError::Invalid(Refusal::Magic)),
            "seed {seed}"
        );
    }
}

#[test]
fn an_upload_goes_on_where_a_lost_client_left_it() {
    let blob = junk(1000);
    let (_board, line) = robot();
    let (mut client, _) = LinkClient::connect(line).unwrap();
    assert_eq!(client.begin(&blob).unwrap(), 0);
    let request = Request::Chunk {
        offset: 0,
        data: &blob[..100],
    };
    let there = client.ask("upload", request, |response| match response {
        Response::Received { len } => Some(len),
        _ => None,
    });
    assert_eq!(there.unwrap(), 100);
    let LinkClient { link, .. } = client;
    let (mut client, _) = LinkClient::connect(link).unwrap();
    let mut told = Vec::new();
    client.stage(&blob, &mut |bytes| told.push(bytes)).unwrap();
    assert_eq!(told.first(), Some(&100));
    let refused = client.commit(Swap::default()).unwrap_err().refusal();
    assert_eq!(refused, Some(LinkError::Invalid(Refusal::Magic)));
    let refused = client.commit(Swap::default()).unwrap_err().refusal();
    assert_eq!(refused, Some(LinkError::NoUpload), "it was forgotten");
}

#[test]
fn a_blob_that_is_too_long_is_refused_before_it_is_sent() {
    let (_board, line) = robot();
    let (mut client, info) = LinkClient::connect(line).unwrap();
    let length = info.capacities.blob_bytes as usize + 1;
    let before = client.counts().bytes_sent;
    let refused = client.stage(&junk(length), &mut |_| ()).unwrap_err();
    assert!(matches!(
        refused.refusal(),
        Some(LinkError::CapacityExceeded { .. })
    ));
    assert!(client.counts().bytes_sent - before < 100);
}

/// A line on which nothing comes and nothing that is sent arrives, in a time of its own.
struct Deaf(Arc<Waited>);

impl ByteLink for Deaf {
    fn receive(&mut self, _: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.0.pause(timeout);
        Ok(0)
    }

    fn send(&mut self, _: &[u8]) -> io::Result<()> {
        Ok(())
    }

    fn clock(&self) -> Clock {
        Clock::simulated(self.0.clone())
    }
}

#[test]
fn a_robot_that_does_not_answer_is_given_up_in_time() {
    let time = Arc::<Waited>::default();
    let error = LinkClient::connect(Deaf(time.clone())).err().unwrap();
    assert!(matches!(error, ClientError::NoReply { .. }), "{error}");
    let took = time.elapsed();
    assert!(
        took >= REQUEST_DEADLINE && took < REQUEST_DEADLINE * 2,
        "{took:?}"
    );
}

#[test]
fn a_line_that_is_cut_is_told_at_once() {
    let (near, far) = pipe::pair();
    drop(far);
    let error = LinkClient::connect(near).err().unwrap();
    // Who had waited would say that nobody answers.
    assert!(matches!(error, ClientError::Line(_)), "{error}");
}

#[test]
fn a_robot_of_another_version_is_named_as_such() {
    // As version 2 answered: its answer ends where that of today goes on. And what a later one has
    // behind its number, nobody knows.
    let older =
        |seq: u8, frame: &mut [u8]| frame::encode(&(0u8, seq, 0u8, 0u8, 2u16, "old"), frame);
    let newer = |seq: u8, frame: &mut [u8]| {
        frame::encode(&(0u8, seq, 0u8, 0u8, 300u16, [0xffu8; 4]), frame)
    };
    let draft = |seq: u8, frame: &mut [u8]| {
        frame::encode(&(0u8, seq, 0u8, 0u8, PROTOCOL_VERSION, "draft"), frame)
    };
    type Answer = fn(u8, &mut [u8]) -> Result<usize, frame::FrameError>;
    for (answer, version, advice) in [
        (older as Answer, 2, "flash a newer firmware"),
        (draft, PROTOCOL_VERSION, "from the same source"),
        (newer, 300, "use a newer esm"),
    ] {
        let (near, mut far) = pipe::pair();
        let robot = std::thread::spawn(move || {
            let mut reader = FrameReader::new();
            let mut bytes = [0; 64];
            while let Ok(count) = far.receive(&mut bytes, Duration::from_secs(10)) {
                for &byte in &bytes[..count] {
                    let Some(frame) = reader.push(byte) else {
                        continue;
                    };
                    let asked = frame::decode::<ToDevice<'_>>(frame).unwrap();
                    assert_eq!(asked.request, Request::Hello);
                    let mut wire = [0; MAX_FRAME_BYTES];
                    let length = answer(asked.seq, &mut wire).unwrap();
                    far.send(&wire[..length]).unwrap();
                }
            }
        });
        let error = LinkClient::connect(near).err().unwrap();
        assert!(
            matches!(error, ClientError::OtherVersion { robot } if robot == version),
            "{error}"
        );
        assert!(error.to_string().ends_with(advice), "{error}");
        robot.join().unwrap();
    }
}

/// A line with a time of its own, and a robot at its end that takes uploads: a byte takes its time
/// on the wire, and an answer as long again as it takes to be made.
struct Timed {
    time: Arc<Waited>,
    byte_us: f64,
    answer_us: f64,
    reader: FrameReader,
    /// Bytes of the upload that are there.
    there: u32,
    /// Answers on their way, and when they are here.
    answers: VecDeque<(f64, Vec<u8>)>,
}

impl Timed {
    fn now_us(&self) -> f64 {
        self.time.elapsed().as_secs_f64() * 1e6
    }

    fn pass_us(&self, time_us: f64) {
        self.time.pause(Duration::from_secs_f64(time_us / 1e6));
    }
}

impl ByteLink for Timed {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let until_us = self.now_us() + timeout.as_secs_f64() * 1e6;
        match self.answers.front() {
            Some((at_us, _)) if *at_us <= until_us => {
                self.pass_us((at_us - self.now_us()).max(0.0));
                let (_, bytes) = self.answers.pop_front().unwrap();
                buffer[..bytes.len()].copy_from_slice(&bytes);
                Ok(bytes.len())
            }
            _ => {
                self.time.pause(timeout);
                Ok(0)
            }
        }
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.pass_us(bytes.len() as f64 * self.byte_us);
        for &byte in bytes {
            let Some(frame) = self.reader.push(byte) else {
                continue;
            };
            let ToDevice { seq, request } = frame::decode(frame).unwrap();
            if let Request::Chunk { offset, data } = request {
                assert_eq!(offset, self.there, "nothing is sent twice");
                self.there += data.len() as u32;
            }
            let len = self.there;
            let result = match request {
                Request::Clock => Ok(Response::Clock { now_us: 0 }),
                _ => Ok(Response::Received { len }),
            };
            let mut wire = [0; MAX_FRAME_BYTES];
            let of = request.kind();
            let reply = FromDevice::Reply { seq, result, of };
            let length = frame::encode(&reply, &mut wire).unwrap();
            let at_us = self.now_us() + self.answer_us + length as f64 * self.byte_us;
            self.answers.push_back((at_us, wire[..length].to_vec()));
        }
        Ok(())
    }

    fn clock(&self) -> Clock {
        Clock::simulated(self.time.clone())
    }
}

/// A session with that robot, whose window has so many bytes.
fn timed(byte_us: f64, answer_us: f64, window_bytes: u16) -> LinkClient<Timed> {
    let link = Timed {
        time: Arc::default(),
        byte_us,
        answer_us,
        reader: FrameReader::new(),
        there: 0,
        answers: VecDeque::new(),
    };
    LinkClient {
        clock: link.clock(),
        sent: link.clock().now(),
        allowance: Allowance::new(None, link.clock().now()),
        capacities: NO_CAPACITIES,
        link,
        incoming: Incoming::new(),
        seq: 0,
        reply_time: ReplyTime::default(),
        counts: LinkCounts::default(),
        built_in: None,
        signing: Signing::default(),
        uploads: Uploads {
            chunk_bytes: 176,
            window_bytes,
        },
        stop: None,
        calling: None,
        end: None,
    }
}

#[test]
fn a_robot_hears_of_a_host_that_only_listens() {
    let mut robot = timed(10.0, 0.0, 176);
    let mut last = robot.clock.now();
    let mut calls = 0;
    while robot.link.time.elapsed() < Duration::from_secs(10) {
        let before = robot.counts.bytes_sent;
        robot.attend(Duration::from_millis(90)).unwrap();
        if robot.counts.bytes_sent > before {
            let silence = robot.clock.since(last);
            assert!(silence < CALL_INTERVAL * 2, "{silence:?}");
            last = robot.clock.now();
            calls += 1;
        }
    }
    // As often as it needs to, and not more.
    assert!((25..=50).contains(&calls), "{calls}");
    // Whoever asks it something takes none of these answers for the answer.
    let before = robot.counts.retries;
    assert_eq!(robot.begin(&junk(8)).unwrap(), 0);
    assert_eq!(robot.counts.retries, before);
}

/// A line to which a process listens that is suspended the first time, for longer than anybody
/// waits.
struct Suspended {
    line: Timed,
    was: bool,
}

impl ByteLink for Suspended {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        if !std::mem::replace(&mut self.was, true) {
            self.line.time.pause(2 * REQUEST_DEADLINE);
            return Ok(0);
        }
        self.line.receive(buffer, timeout)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.line.send(bytes)
    }

    fn clock(&self) -> Clock {
        self.line.clock()
    }
}

#[test]
fn a_process_that_was_suspended_takes_the_answer_that_came_meanwhile() {
    let line = |line| Suspended { line, was: false };
    let mut client = over(timed(10.0, 2_000.0, 528), line);
    assert_eq!(client.begin(&junk(1_000)).unwrap(), 0);
}

#[test]
fn an_upload_takes_little_more_than_its_bytes_on_the_wire() {
    const BAUD: f64 = 115_200.0;
    let blob = junk(4096);
    let byte_us = 10.0 * 1e6 / BAUD;
    // An answer that waits for a slot of 2 ms, and one that waits for a part of a stream, too.
    for (answer_us, window_bytes, most) in [
        (2_000.0, 528, 0.90),
        (12_000.0, 528, 0.85),
        (2_000.0, 176, 0.80),
    ] {
        let mut client = timed(byte_us, answer_us, window_bytes);
        client.stage(&blob, &mut |_| ()).unwrap();
        assert_eq!(client.counts.retries, 0);
        let part = 4096.0 * byte_us / client.link.now_us();
        let is_enough = part >= most;
        let is_full = window_bytes > 176;
        assert_eq!(
            is_enough, is_full,
            "{part:.3} of the wire's rate, answers after {answer_us} µs, a window of {window_bytes}"
        );
    }
}

#[test]
fn nothing_runs_but_what_was_sent_however_bad_the_line() {
    let blob = mission();
    for (percent, seed) in [(1, 0), (1, 1), (3, 0)] {
        let (_board, line) = robot();
        let (client, _) = LinkClient::connect(line).unwrap();
        // So many of a hundred bytes are corrupted, dropped or doubled.
        let noise = Noise::of_each(Noise::WHOLE * percent / 300);
        let mut noisy = over(client, |line| Noisy::new(line, noise, seed));
        let uploaded = noisy.upload(&blob, &mut |_| ());
        assert!(
            uploaded.is_ok(),
            "{percent} % noise, seed {seed}: {uploaded:?}"
        );
        assert!(noisy.counts().retries > 0, "the line was too good to tell");
        let mut client = over(noisy, Noisy::into_inner);
        assert_eq!(client.running_blob().unwrap(), blob);
    }
}

#[test]
fn parameters_of_a_running_mission_change_within_what_its_task_declares() {
    const NAME: &str = "motion/Roam/steps/AvoidRight/steps/Retreat.speed_m_per_s";
    let (_board, line) = robot();
    let (mut client, _) = LinkClient::connect(line).unwrap();
    let mission = client.upload(&mission(), &mut |_| ()).unwrap();
    let blob = esm_core::verify(client.running_blob().unwrap()).unwrap();
    let parameters = esm_toolkit::parameters::parameters_of(&blob).unwrap();
    let has_name = |names: &[String]| names.iter().any(|name| name == NAME);
    let speed = (parameters.iter()).find(|parameter| has_name(&parameter.names));
    let index = speed.unwrap().index;
    let bits = |value: f32| value.to_bits();
    let of = |value| ParamBits {
        value: bits(value),
        of_mission: bits(0.15),
        saved: None,
    };
    assert_eq!(client.param(mission, index).unwrap(), of(0.15));
    let before = client.set_param(mission, index, bits(0.2)).unwrap();
    assert_eq!(before, bits(0.15));
    assert_eq!(client.param(mission, index).unwrap(), of(0.2));
    assert_eq!(client.status().unwrap().changed_params, 1);
    let outside = LinkError::ParamOutside {
        min: bits(0.0),
        max: bits(0.3),
    };
    for (value, expected) in [
        (bits(0.31), outside),
        (bits(-0.1), outside),
        (bits(f32::NAN), LinkError::ParamNoValue),
    ] {
        let refused = client.set_param(mission, index, value).unwrap_err();
        assert_eq!(refused.refusal(), Some(expected));
    }
    let refused = client.set_param(!mission, index, bits(0.1)).unwrap_err();
    assert_eq!(refused.refusal(), Some(LinkError::OtherMission));
}

#[test]
fn parameters_that_were_saved_are_there_after_the_power_was_off() {
    const NAME: &str = "motion/Roam/steps/AvoidRight/steps/Retreat.speed_m_per_s";
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("robot.flash");
    // With its flash in a file, which is all that a loss of power leaves.
    let power_on = || {
        let world = World::parse("world cell\n start 1,1 0\n wall 0,0 3,0 3,3 0,3 0,0").unwrap();
        let plant = Plant::new(world, BodyParameters::default(), 1).unwrap();
        let flash = Flash::open(&file, host_board::FLASH_BYTES).unwrap();
        let plant = PlantSide::new(plant, Pace::new(true), None).with_flash(Some(flash));
        HostBoard::start(host_board::rover, plant, None).unwrap()
    };
    let bits = |value: f32| value.to_bits();
    let of = |value, saved: Option<f32>| ParamBits {
        value: bits(value),
        of_mission: bits(0.15),
        saved: saved.map(bits),
    };
    let patrol = mission();
    let index = {
        let (_board, line) = power_on();
        let (mut client, _) = LinkClient::connect(line).unwrap();
        let mission = client.upload(&patrol, &mut |_| ()).unwrap();
        let blob = esm_core::verify(client.running_blob().unwrap()).unwrap();
        let parameters = esm_toolkit::parameters::parameters_of(&blob).unwrap();
        let has_name = |names: &[String]| names.iter().any(|name| name == NAME);
        let speed = (parameters.iter()).find(|parameter| has_name(&parameter.names));
        let index = speed.unwrap().index;
        client.set_param(mission, index, bits(0.2)).unwrap();
        assert_eq!(client.save_params(mission).unwrap(), 1);
        client.set_param(mission, index, bits(0.25)).unwrap();
        assert_eq!(client.param(mission, index).unwrap(), of(0.25, Some(0.2)));
        index
    };
    {
        let (_board, line) = power_on();
        let (mut client, _) = LinkClient::connect(line).unwrap();
        let mission = started(&mut client);
        assert_eq!(client.param(mission, index).unwrap(), of(0.2, Some(0.2)));
        let status = client.status().unwrap();
        assert_eq!((status.changed_params, status.saved_params), (1, 1));
        client.set_param(mission, index, bits(0.15)).unwrap();
        assert_eq!(client.save_params(mission).unwrap(), 0);
    }
    let (_board, line) = power_on();
    let (mut client, _) = LinkClient::connect(line).unwrap();
    let mission = started(&mut client);
    assert_eq!(client.param(mission, index).unwrap(), of(0.15, None));
}

/// The mission that a robot started with, as soon as it runs: at the first activation of a slot.
fn started<L: ByteLink>(client: &mut LinkClient<L>) -> u32 {
    let begun = Instant::now();
    loop {
        if let Some(mission) = client.status().unwrap().mission {
            return mission;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "it never starts");
    }
}

/// The blob of a mission that ships.
fn mission() -> Vec<u8> {
    let file = Path::new("../../missions/patrol.esm");
    let mut checked = crate::sources::load(file).unwrap();
    let schedule = checked
        .lay_out(crate::time::work_limit(Duration::from_secs(5)))
        .unwrap();
    let blob = compile_to_fit(&mut checked, &schedule, None, NameTable::Kept).unwrap();
    blob.unwrap().into_bytes()
}

/// The client, over another line.
fn over<L, M: ByteLink>(client: LinkClient<L>, line: impl FnOnce(L) -> M) -> LinkClient<M> {
    let link = line(client.link);
    LinkClient {
        sent: client.sent,
        allowance: client.allowance,
        capacities: client.capacities,
        clock: link.clock(),
        link,
        incoming: client.incoming,
        seq: client.seq,
        reply_time: client.reply_time,
        counts: client.counts,
        uploads: client.uploads,
        built_in: client.built_in,
        stop: client.stop,
        end: client.end,
        signing: client.signing,
        calling: client.calling,
    }
}

#[test]
fn a_robot_with_a_key_is_driven_by_its_owner_alone() {
    let key = |number: u8| SigningKey::of(&[number; 32]);
    let owner = || -> KeyLoader { Box::new(|| Ok(SigningKey::of(&[1; 32]))) };
    let stranger = || -> KeyLoader { Box::new(|| Ok(SigningKey::of(&[2; 32]))) };
    let (_board, line) = robot();
    let (mut client, info) = LinkClient::connect(line).unwrap();
    assert_eq!(info.access, Access::Open);
    let blob = mission();
    client.install_key(&key(1)).unwrap();

    assert!(matches!(client.start(), Err(ClientError::NoKey)));
    client.use_key(stranger());
    assert!(matches!(client.start(), Err(ClientError::OtherKey { .. })));
    let refused = client.upload(&blob, &mut |_| ()).unwrap_err();
    assert!(matches!(refused, ClientError::OtherKey { .. }));
    assert_eq!(client.status().unwrap().mission, None);
    client.stop().unwrap();

    client.use_key(owner());
    let mission = client.upload(&blob, &mut |_| ()).unwrap();
    client.stop().unwrap();
    client.start().unwrap();
    assert_eq!(client.status().unwrap().mission, Some(mission));
    assert_eq!(client.identity().unwrap().counter, 1);

    // Bytes that are none of the owner's under his checksum are in nobody's way.
    client.begin(&blob).unwrap();
    for (part, data) in vec![0x5a; blob.len()].chunks(64).enumerate() {
        let offset = (part * 64) as u32;
        let chunk = Request::Chunk { offset, data };
        client.ask("chunk", chunk, |_| Some(())).unwrap();
    }
    assert_eq!(client.begin(&blob).unwrap(), blob.len());
    assert_eq!(client.upload(&blob, &mut |_| ()).unwrap(), mission);
    assert_eq!(client.identity().unwrap().counter, 2);

    // And over a bad line, where requests are sent again.
    let noise = Noise::of_each(Noise::WHOLE / 300);
    let (mut client, info) = LinkClient::connect(Noisy::new(client.link, noise, 5)).unwrap();
    assert_eq!(info.access, Access::Locked);
    client.use_key(owner());
    for counter in 3..6 {
        assert_eq!(client.upload(&blob, &mut |_| ()).unwrap(), mission);
        assert_eq!(client.identity().unwrap().counter, counter);
    }
    client.remove_key().unwrap();
    assert_eq!(client.hello().unwrap().access, Access::Open);
}
