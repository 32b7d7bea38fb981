//! Robots that are found where no port is named.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fs::File;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use esm_link::access::Access;
use esm_link::frame::{self, DELIMITER, FrameReader, MAX_FRAME_BYTES};
use esm_link::message::{
    Capacities, DeviceInfo, FromDevice, LinkError, PROTOCOL_VERSION, Request, ResetReason,
    Response, ToDevice, Uploads,
};
use esm_tests::command::{Done, Robot, Running, esm_in, root};
use host_tools::serial::ByteLink;
use host_tools::serial::pipe::{self, PipeEnd};
use host_tools::serial::pty::PtyServer;

/// How long one look at a line lasts.
const LOOK: Duration = Duration::from_millis(20);

/// The longest that all ports together may take, on a machine that is busy.
const LONG: Duration = Duration::from_secs(5);

/// A serial line with something else than a robot of `esm board` at its other end.
struct Line {
    server: PtyServer,
    is_over: Arc<AtomicBool>,
    device: Option<JoinHandle<()>>,
}

impl Line {
    /// A line whose device does this with what it hears, again and again.
    fn with(mut device: impl FnMut(&mut PipeEnd, &[u8]) + Send + 'static) -> Self {
        let (near, mut far) = pipe::pair();
        let server = PtyServer::start(Box::new(near)).unwrap();
        let is_over = Arc::new(AtomicBool::new(false));
        let ends = Arc::clone(&is_over);
        let device = thread::spawn(move || {
            let mut heard = [0; 256];
            while !ends.load(Ordering::Relaxed) {
                let count = far.receive(&mut heard, LOOK).unwrap_or(0);
                device(&mut far, &heard[..count]);
            }
        });
        Line {
            server,
            is_over,
            device: Some(device),
        }
    }

    fn silent() -> Self {
        Self::with(|_, _| ())
    }

    /// A position receiver.
    fn talking() -> Self {
        Self::with(|line, _| {
            let _ = line.try_send(b"$GPGGA,092750.000,5321.6802,N,00630.3372,W,1,8,1.03*76\r\n");
        })
    }

    /// A robot that says who it is, and refuses all else.
    fn robot(board: &'static str, protocol: u16) -> Self {
        let mut frames = FrameReader::new();
        Self::with(move |line, heard| {
            for byte in heard {
                let Some(frame) = frames.push(*byte) else {
                    continue;
                };
                let Ok(ToDevice { seq, request }) = frame::decode(frame) else {
                    continue;
                };
                let of = request.kind();
                let result = match request {
                    Request::Hello => Ok(Response::Hello(hello(board, protocol))),
                    _ => Err(LinkError::NotBuiltIn),
                };
                let mut frame = [0; MAX_FRAME_BYTES];
                let reply = FromDevice::Reply { seq, result, of };
                let length = frame::encode(&reply, &mut frame).unwrap();
                line.send(&[&[DELIMITER], &frame[..length]].concat())
                    .unwrap();
            }
        })
    }

    fn path(&self) -> String {
        self.server.path().display().to_string()
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        let _ = self.device.take().unwrap().join();
    }
}

fn hello(board: &'static str, protocol: u16) -> DeviceInfo<'static> {
    DeviceInfo {
        protocol,
        firmware: "my robot 7",
        board,
        task_types: 0,
        capacities: Capacities {
            blob_bytes: 4096,
            arena_words: 128,
            slots: 8,
            task_instances: 8,
            nets: 8,
            exclusive_groups: 1,
        },
        mission: None,
        reset: ResetReason::PowerOn,
        uploads: Uploads {
            chunk_bytes: 64,
            window_bytes: 64,
        },
        access: Access::Open,
    }
}

/// `esm` with these ports and no others.
#[track_caller]
fn esm_with(ports: &[&str], arguments: &[&str]) -> Done {
    let ports = format!("only:{}", ports.join(":"));
    esm_in(&[("ESM_PORTS", &ports)], arguments)
}

/// What `esm ports --json` says of one of its ports.
#[track_caller]
fn told_of(done: &Done, port: &str) -> serde_json::Value {
    let told = done.json();
    let ports = told["ports"].as_array().unwrap();
    let found = ports.iter().find(|found| found["port"] == port);
    found.unwrap_or_else(|| panic!("{port}: {told:#}")).clone()
}

#[test]
fn all_ports_are_told_with_what_is_behind_them() {
    let robot = Robot::start("host", None);
    let mission = root().join("missions/patrol.esm");
    robot.give(&mission);
    let (silent, talking) = (Line::silent(), Line::talking());
    let other = Line::robot("lm3s6965", PROTOCOL_VERSION + 1);
    let lines = [&silent, &talking, &other].map(Line::path);
    let ports = [robot.port(), &lines[0], &lines[1], &lines[2], "/no/such"];
    let begun = Instant::now();
    let done = esm_with(&ports, &["ports", "--json"]).good();
    assert!(begun.elapsed() < LONG, "{:?}", begun.elapsed());
    let told = told_of(&done, robot.port());
    assert_eq!(told["state"], "robot", "{told:#}");
    assert_eq!(told["robot"]["board"], "host", "{told:#}");
    assert_eq!(told["robot"]["mode"], "running", "{told:#}");
    assert_eq!(told["robot"]["machine"], "Patrol", "{told:#}");
    assert_eq!(told["robot"]["mission"], robot.status()["mission"]);
    for (port, state, words) in [
        (&lines[0][..], "no robot", "nothing answers"),
        (&lines[1], "no robot", "what comes from there"),
        (&lines[2], "other version", "use a newer esm"),
        ("/no/such", "unopened", "there is no /no/such"),
    ] {
        let told = told_of(&done, port);
        assert_eq!(told["state"], state, "{told:#}");
        assert!(told["told"].as_str().unwrap().contains(words), "{told:#}");
        assert!(told["robot"].is_null(), "{told:#}");
    }
    let read = esm_with(&ports, &["ports"]).good().out;
    assert!(read.contains("a robot: board host"), "{read}");
    assert!(read.contains("mission Patrol, "), "{read}");
    assert!(read.contains(", running\n"), "{read}");
    let none = esm_with(&[], &["ports"]).good();
    assert!(none.err.contains("no serial port"), "{none:#?}");
}

#[test]
fn a_command_without_a_port_takes_that_of_the_only_robot() {
    let robot = Robot::start("host", None);
    robot.give(&root().join("missions/patrol.esm"));
    let silent = Line::silent();
    let ports = [robot.port(), &silent.path()];
    let took = format!("took {}", robot.port());
    for arguments in [&["status", "--json"][..], &["param", "get"], &["stop"]] {
        let done = esm_with(&ports, arguments).good();
        assert!(done.err.contains(&took), "{arguments:?}: {done:#?}");
    }
    assert_eq!(robot.status()["mode"], "stopped");
    // A port that is named is the one that is taken.
    let named = esm_with(
        &ports,
        &["status", "--port", &silent.path(), "--baud", "9600"],
    );
    assert!(!named.ended(3).err.contains("took"));
}

#[test]
fn without_a_robot_the_ports_are_told() {
    let silent = Line::silent();
    let none = esm_with(&[&silent.path()], &["status"]).ended(3);
    for words in [
        "no robot answers",
        "--port",
        &silent.path(),
        "nothing answers",
    ] {
        assert!(none.err.contains(words), "{words}: {none:#?}");
    }
    let none = esm_with(&[], &["stop", "--emergency"]).ended(3);
    assert!(none.err.contains("no robot is plugged in"), "{none:#?}");
}

#[test]
fn with_several_robots_none_is_stopped_and_all_are_told() {
    let robots = [(); 2].map(|()| Robot::start("host", None));
    let mission = root().join("missions/patrol.esm");
    robots.iter().for_each(|robot| robot.give(&mission));
    let ports = [robots[0].port(), robots[1].port()];
    for arguments in [
        &["stop"][..],
        &["stop", "--emergency"],
        &["status"],
        &["upload", "missions/follow_wall.esm"],
    ] {
        let done = esm_with(&ports, arguments).ended(3);
        assert!(done.err.contains("more than one robot"), "{done:#?}");
        for port in ports {
            assert!(done.err.contains(&format!("\n  {port}: ")), "{done:#?}");
        }
    }
    for robot in &robots {
        assert_eq!(robot.status()["mode"], "running");
    }
    esm_with(&ports, &["stop", "--port", ports[1]]).good();
    assert_eq!(robots[0].status()["mode"], "running");
    assert_eq!(robots[1].status()["mode"], "stopped");
}

#[test]
fn a_port_in_use_is_left_alone_but_for_a_stop() {
    let robot = Robot::start("host", None);
    robot.give(&root().join("missions/patrol.esm"));
    let only = format!("only:{}", robot.port());
    let log = Running::esm_in(&[("ESM_PORTS", &only)], &["log", "--news", "100 ms"]);
    let said = |log: &Running| log.out().lines().count();
    let mut log = log.until("the first line", |log| said(log) > 0);
    for _ in 0..3 {
        let done = esm_with(&[robot.port()], &["ports", "--json"]).good();
        let told = told_of(&done, robot.port());
        assert_eq!(told["state"], "in use", "{told:#}");
        assert!(told["told"].as_str().unwrap().contains("esm command"));
    }
    // The status of a robot ends the streams of others: the log goes on.
    let lines = said(&log);
    log = log.until("more lines", |log| said(log) > lines + 5);
    assert!(log.is_running(), "{}", log.err());
    assert_eq!(log.err().lines().count(), 1, "the port: {}", log.err());
    let refused = esm_with(&[robot.port()], &["status"]).ended(3);
    assert!(refused.err.contains("in use"), "{refused:#?}");
    // With another robot beside it, nobody knows which one is meant.
    let other = Line::robot("host", PROTOCOL_VERSION);
    let ports = [robot.port(), &other.path()];
    for command in ["status", "stop"] {
        let several = esm_with(&ports, &[command]).ended(3);
        assert!(
            several.err.contains("in use by another esm"),
            "{several:#?}"
        );
    }
    // The only one that a stop can be meant for.
    esm_with(&[robot.port()], &["stop"]).good();
    // Who found the port goes back to it without asking anybody.
    log.until("the log again", |log| {
        log.err().contains("the log goes on;")
    });
    let is_stopped = |status: &serde_json::Value| status["mode"] == "stopped";
    robot.status_when("a robot that stands", is_stopped);
}

#[test]
fn a_port_that_another_program_has_is_no_robot_and_hinders_nobody() {
    let robot = Robot::start("host", None);
    let taken = Line::robot("host", PROTOCOL_VERSION);
    let file = File::open(taken.path()).unwrap();
    file.lock().unwrap();
    let ports = [robot.port(), &taken.path()];
    let done = esm_with(&ports, &["ports", "--json"]).good();
    let told = told_of(&done, &taken.path());
    assert_eq!(told["told"], "in use by another program", "{told:#}");
    let status = esm_with(&ports, &["status"]).good();
    assert!(status.err.contains(robot.port()), "{status:#?}");
}

#[test]
fn ctrl_c_ends_the_search_for_a_robot() {
    let lines: Vec<Line> = (0..40).map(|_| Line::silent()).collect();
    let paths: Vec<String> = lines.iter().map(Line::path).collect();
    let ports = format!("only:{}", paths.join(":"));
    let search = Running::esm_in(&[("ESM_PORTS", &ports)], &["status"]);
    thread::sleep(Duration::from_millis(500));
    let begun = Instant::now();
    let done = search.interrupted().ended(3);
    assert!(begun.elapsed() < Duration::from_secs(1));
    assert!(done.err.contains("interrupted"), "{done:#?}");
}
