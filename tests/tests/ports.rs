//! Robots that are found where no port is named, and firmware that is put onto a board.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fs::{self, File};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use esm_client::samples::elf;
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

// ─── Firmware onto a board ───────────────────────────────────────────────────────────────────────

const ARM: u16 = 40;
const FLASH: u32 = 0x1000_0000;

/// A folder with a firmware for the board `pico`, and room for a boot drive and for programs.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let code: Vec<u8> = (0..100_000_u32).map(|it| (it % 253) as u8).collect();
        let firmware = elf(ARM, &[(FLASH, &code[..256]), (FLASH + 256, &code)]);
        fs::write(folder.path().join("my robot.elf"), firmware).unwrap();
        for name in ["drive", "programs"] {
            fs::create_dir(folder.path().join(name)).unwrap();
        }
        Bench { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }

    /// `esm flash` with this firmware, and these arguments.
    #[track_caller]
    fn flash(&self, ports: &[&str], arguments: &[&str]) -> Running {
        let ports = format!("only:{}", ports.join(":"));
        let file = self.text("my robot.elf");
        let arguments = [&["flash", "--board", "pico", &file], arguments].concat();
        Running::esm_in(
            &[
                ("ESM_PORTS", &ports),
                ("ESM_BOOT_DRIVE", &self.text("drive")),
                ("PATH", &self.text("programs")),
            ],
            &arguments,
        )
    }

    /// The UF2 file of the firmware.
    #[track_caller]
    fn uf2(&self) -> Vec<u8> {
        let made = self
            .flash(&[], &["--uf2", &self.text("made.uf2")])
            .finished()
            .good();
        assert!(
            made.out.contains("made.uf2: 392 blocks, 196 KiB"),
            "{made:#?}"
        );
        fs::read(self.path("made.uf2")).unwrap()
    }

    /// Plugs the board in with its button held: its drive is there until it has the firmware.
    fn plug_in(&self, blocks: usize) -> JoinHandle<Vec<u8>> {
        let drive = self.path("drive");
        // Its drive has no file of before.
        let _ = fs::remove_file(drive.join("firmware.uf2"));
        let info = "UF2 Bootloader v3.0\r\nModel: Raspberry Pi RP2\r\nBoard-ID: RPI-RP2\r\n";
        fs::write(drive.join("INFO_UF2.TXT"), info).unwrap();
        thread::spawn(move || {
            let begun = Instant::now();
            loop {
                let copied = fs::read(drive.join("firmware.uf2")).unwrap_or_default();
                if copied.len() == blocks * 512 {
                    fs::remove_file(drive.join("INFO_UF2.TXT")).unwrap();
                    return copied;
                }
                assert!(begun.elapsed() < 20 * LONG, "nothing is copied");
                thread::sleep(LOOK);
            }
        })
    }

    /// A program that writes down its arguments and keeps the file that they name last.
    fn program(&self, name: &str, ends: &str) {
        let path = self.path("programs").join(name);
        let (lines, kept) = (self.text("lines"), self.text("kept"));
        // The builtins of the shell alone: the PATH has nothing else.
        let script = format!(
            "#!/bin/sh\nPATH=/usr/bin:/bin\necho \"{name} $*\" >> '{lines}'\nfor last; do :; done\n\
             case \"$last\" in /*) cp \"$last\" '{kept}';; esac\n{ends}\n"
        );
        fs::write(&path, script).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    }

    fn lines(&self) -> Vec<String> {
        let lines = fs::read_to_string(self.path("lines")).unwrap_or_default();
        lines.lines().map(str::to_owned).collect()
    }
}

#[test]
fn the_boot_drive_gets_the_firmware_and_the_robot_is_asked() {
    let bench = Bench::new();
    // It is better than what else is there.
    bench.program("probe-rs", "exit 1");
    let uf2 = bench.uf2();
    let robot = Line::robot("pico", PROTOCOL_VERSION);
    let other = Line::robot("lm3s6965", PROTOCOL_VERSION);
    let board = bench.plug_in(uf2.len() / 512);
    let done = bench
        .flash(&[&robot.path(), &other.path()], &["--json"])
        .finished()
        .good();
    assert!(
        board.join().unwrap() == uf2,
        "what was copied is the UF2 file"
    );
    let told = done.json();
    assert_eq!(told["method"], "drive", "{told:#}");
    assert_eq!(told["port"], robot.path(), "{told:#}");
    assert_eq!(told["robot"]["firmware"], "my robot 7", "{told:#}");
    assert_eq!(bench.lines(), [] as [&str; 0]);
}

#[test]
fn a_robot_that_does_not_answer_is_told_as_that() {
    let bench = Bench::new();
    let board = bench.plug_in(392);
    let done = bench.flash(&[], &[]).finished().good();
    board.join().unwrap();
    assert!(done.err.contains("no robot answered"), "{done:#?}");
    assert!(done.out.contains("nobody knows yet"), "{done:#?}");
    // Another robot is not this one, and of two nobody knows.
    let lines = [
        Line::robot("pico", PROTOCOL_VERSION),
        Line::robot("pico", PROTOCOL_VERSION),
    ];
    let other = Line::robot("lm3s6965", PROTOCOL_VERSION);
    for (ports, words) in [
        (vec![other.path()], "another one than the board pico"),
        (lines.each_ref().map(Line::path).to_vec(), "several robots"),
    ] {
        let board = bench.plug_in(392);
        let ports: Vec<&str> = ports.iter().map(String::as_str).collect();
        let done = bench.flash(&ports, &[]).finished().good();
        board.join().unwrap();
        assert!(done.err.contains(words), "{done:#?}");
    }
}

#[test]
fn without_a_way_the_button_is_told_and_the_drive_waited_for() {
    let bench = Bench::new();
    let done = bench.flash(&[], &[]).finished().ended(3);
    assert!(
        done.err.contains("BOOTSEL") && done.err.contains("--wait"),
        "{done:#?}"
    );
    let waits = |waiting: &Running| waiting.err().contains("waited for");
    let waiting = bench.flash(&[], &["--wait"]).until("a word", waits);
    let begun = Instant::now();
    let done = waiting.interrupted().ended(3);
    assert!(
        begun.elapsed() < LONG && done.err.contains("interrupted"),
        "{done:#?}"
    );
    let robot = Line::robot("pico", PROTOCOL_VERSION);
    let waiting = bench
        .flash(&[&robot.path()], &["--wait"])
        .until("a word", waits);
    let board = bench.plug_in(392);
    let done = waiting.finished().good();
    board.join().unwrap();
    assert!(done.out.contains("flashed, and it runs"), "{done:#?}");
}

#[test]
fn a_board_that_does_not_leave_its_drive_has_not_taken_the_firmware() {
    let bench = Bench::new();
    // It waits for more than there is.
    drop(bench.plug_in(1_000_000));
    let done = bench.flash(&[], &["--method", "drive"]).finished().ended(3);
    assert!(done.err.contains("still there"), "{done:#?}");
}

#[test]
fn programs_of_others_are_given_the_firmware() {
    let bench = Bench::new();
    let robot = Line::robot("pico", PROTOCOL_VERSION);
    let flash = |arguments: &[&str]| bench.flash(&[&robot.path()], arguments).finished();
    for (program, words) in [("probe-rs", "probe-rs-tools"), ("picotool", "github.com")] {
        let missing = flash(&["--method", program]).ended(3);
        assert!(missing.err.contains(words), "{missing:#?}");
    }
    bench.program("picotool", "");
    let done = flash(&["--json"]).good();
    assert_eq!(done.json()["method"], "picotool");
    let [line] = &bench.lines()[..] else {
        panic!("{:?}", bench.lines())
    };
    assert!(line.starts_with("picotool load -x /"), "{line}");
    assert!(line.ends_with(".uf2"), "it tells formats by names: {line}");
    assert!(fs::read(bench.path("kept")).unwrap() == bench.uf2());
    bench.program("probe-rs", "");
    fs::remove_file(bench.path("lines")).unwrap();
    assert_eq!(flash(&["--json"]).good().json()["method"], "probe-rs");
    let firmware = bench.text("my robot.elf");
    let expected = [
        format!("probe-rs download --chip RP2040 {firmware}"),
        "probe-rs reset --chip RP2040".to_owned(),
    ];
    assert_eq!(bench.lines(), expected);
    let chosen = flash(&["--method", "picotool"]).good();
    assert!(chosen.err.contains("picotool"), "{chosen:#?}");
    bench.program("probe-rs", "echo no probe was found >&2; exit 5");
    let failed = flash(&[]).ended(3);
    for words in ["probe-rs download", "no probe was found", "--method drive"] {
        assert!(failed.err.contains(words), "{failed:#?}");
    }
    bench.program("probe-rs", "sleep 100");
    let last = |_: &Running| bench.lines().len() == 5;
    let flashing = bench.flash(&[], &[]).until("the program", last);
    let begun = Instant::now();
    let done = flashing.interrupted().ended(3);
    assert!(
        begun.elapsed() < LONG && done.err.contains("interrupted"),
        "{done:#?}"
    );
}

#[test]
fn what_cannot_be_flashed_is_told() {
    let bench = Bench::new();
    let write = |name: &str, bytes: &[u8]| {
        fs::write(bench.path(name), bytes).unwrap();
        bench.text(name)
    };
    let text = write("text", b"interpreter slot 1;");
    let elsewhere = write("elsewhere", &elf(ARM, &[(0, &[1; 256])]));
    let outside = write(
        "outside",
        &elf(ARM, &[(FLASH, &[1; 256]), (0x2000_0000, &[1; 4])]),
    );
    let overlap = write(
        "overlap",
        &elf(ARM, &[(FLASH, &[1; 256]), (FLASH + 8, &[1; 4])]),
    );
    let out = bench.text("out.uf2");
    let source = write("mission.esm", b"");
    for (arguments, status, words) in [
        (&["flash"][..], 2, "`pico`"),
        (&["flash", "--board", "host"], 2, "part of this command"),
        (&["flash", "--board", "toaster"], 2, "there is no board"),
        (
            &["flash", "--board", "pico", &text, "--uf2", &out],
            1,
            "is no firmware",
        ),
        (
            &["flash", "--board", "pico", &elsewhere, "--uf2", &out],
            1,
            "another board",
        ),
        (
            &["flash", "--board", "pico", &outside, "--uf2", &out],
            1,
            "another board",
        ),
        (
            &["flash", "--board", "pico", &overlap, "--uf2", &out],
            1,
            "two parts",
        ),
        (
            &["flash", "--board", "pico", "/no/such", "--uf2", &out],
            1,
            "no firmware at",
        ),
        (
            &["flash", "--board", "pico", "--method", "magic"],
            2,
            "probe-rs",
        ),
        (
            &[
                "flash",
                "--board",
                "pico",
                &bench.text("my robot.elf"),
                "--uf2",
                &source,
            ],
            2,
            "overwritten",
        ),
    ] {
        let done = esm_in(&[], arguments).ended(status);
        assert!(done.err.contains(words), "{arguments:?}: {done:#?}");
    }
    assert!(!Path::new(&out).exists());
}
