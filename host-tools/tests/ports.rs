//! Ports as several processes want them: `esm stop` takes one over from whoever has it, and Ctrl-C
//! ends each command whatever comes on its line.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::fs::{self, DirBuilder, File, Permissions};
use std::io::{self, Read, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, sleep};
use std::time::{Duration, Instant};

use esm_link::frame::{self, DELIMITER, MAX_FRAME_BYTES, decode};
use esm_link::message::{Request, ToDevice};
use host_tools::host_board::{self, HostBoard};
use host_tools::lockstep::pace::Pace;
use host_tools::lockstep::plant_side::PlantSide;
use host_tools::plant::{BodyParameters, Plant};
use host_tools::serial::pipe;
use host_tools::serial::pty::PtyServer;
use host_tools::serial::{self, ByteLink, OpenError};
use host_tools::world::World;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use tempfile::TempDir;

/// How long something may take that is a matter of a moment, before it counts as hung.
const PATIENCE: Duration = Duration::from_secs(60);

/// How often a running command is looked at.
const LOOK_INTERVAL: Duration = Duration::from_millis(5);

/// How long a command may live after Ctrl-C: a second, and as much again for a machine that does
/// other things, too.
const LAST_SECONDS: Duration = Duration::from_secs(2);

/// What comes from a robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Manner {
    /// What it says.
    Good,
    /// Noise without end, as fast as it is taken.
    Garbage,
    /// Nothing.
    Silence,
    /// A byte of noise now and then.
    Drip,
    /// Nothing, and it takes nothing either.
    Deaf,
}

const BAD_MANNERS: [Manner; 4] = [Manner::Garbage, Manner::Silence, Manner::Drip, Manner::Deaf];

/// How often a line that drips lets a byte through.
const DRIP_INTERVAL: Duration = Duration::from_millis(30);

/// What is known of a line.
struct Seen {
    manner: Manner,
    /// Names of the requests that came, and when.
    requests: Vec<(String, Instant)>,
}

impl Seen {
    fn when(&self, name: &str) -> Option<Instant> {
        let found = self.requests.iter().find(|(it, _)| it == name);
        found.map(|(_, at)| *at)
    }
}

/// A robot's line that is looked at, and may turn bad.
struct Tapped<L> {
    line: L,
    seen: Arc<Mutex<Seen>>,
    frame: Vec<u8>,
    noise: u8,
}

impl<L> Tapped<L> {
    fn note(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.frame.push(*byte);
            if *byte != DELIMITER {
                continue;
            }
            let mut frame = std::mem::take(&mut self.frame);
            frame.pop();
            let Ok(message) = decode::<ToDevice<'_>>(&mut frame) else {
                continue;
            };
            let request = match message.request {
                Request::Within { request, .. } => postcard::from_bytes(request).unwrap(),
                request => request,
            };
            let name = format!("{request:?}");
            let name = name.split([' ', '(', '{']).next().unwrap().to_owned();
            let mut seen = self.seen.lock().unwrap();
            seen.requests.push((name, Instant::now()));
        }
    }
}

impl<L: ByteLink> ByteLink for Tapped<L> {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let manner = self.seen.lock().unwrap().manner;
        let noise = match manner {
            Manner::Good => return self.line.receive(buffer, timeout),
            Manner::Garbage => buffer.len(),
            Manner::Drip => {
                sleep(DRIP_INTERVAL);
                1
            }
            Manner::Silence | Manner::Deaf => {
                sleep(timeout);
                0
            }
        };
        for place in &mut buffer[..noise] {
            self.noise = self.noise.wrapping_mul(5).wrapping_add(1);
            *place = self.noise;
        }
        Ok(noise)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.note(bytes);
        self.line.send(bytes)
    }

    fn try_send(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.seen.lock().unwrap().manner == Manner::Deaf {
            return Ok(0);
        }
        let count = self.line.try_send(bytes)?;
        self.note(&bytes[..count]);
        Ok(count)
    }
}

/// A robot on the host board, and a folder for what a test needs.
struct Robot {
    seen: Arc<Mutex<Seen>>,
    port: String,
    _server: Option<PtyServer>,
    folder: TempDir,
    _board: HostBoard,
}

impl Robot {
    /// Behind a pseudo-terminal.
    fn start() -> Self {
        Self::start_at(|line, _| {
            let server = PtyServer::start(Box::new(line)).unwrap();
            (server.path().to_str().unwrap().to_owned(), Some(server))
        })
    }

    /// Behind a socket that takes one client, as an emulator's.
    fn start_at_socket() -> Self {
        Self::start_at(|mut line, folder| {
            let path = folder.join("uart");
            let listener = UnixListener::bind(&path).unwrap();
            thread::spawn(move || {
                for client in listener.incoming() {
                    serve(client.unwrap(), &mut line);
                }
            });
            (format!("unix:{}", path.display()), None)
        })
    }

    fn start_at(
        serve: impl FnOnce(Tapped<pipe::PipeEnd>, &Path) -> (String, Option<PtyServer>),
    ) -> Self {
        let world = World::parse("world cell\n start 1,1 0\n wall 0,0 3,0 3,3 0,3 0,0").unwrap();
        let plant = Plant::new(world, BodyParameters::default(), 1).unwrap();
        let plant = PlantSide::new(plant, Pace::new(true), None);
        let (board, line) = HostBoard::start(host_board::rover, plant, None).unwrap();
        let seen = Arc::new(Mutex::new(Seen {
            manner: Manner::Good,
            requests: Vec::new(),
        }));
        let line = Tapped {
            line,
            seen: Arc::clone(&seen),
            frame: Vec::new(),
            noise: 1,
        };
        let folder = tempfile::tempdir().unwrap();
        let (port, server) = serve(line, folder.path());
        Robot {
            seen,
            port,
            _server: server,
            folder,
            _board: board,
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The command at this robot; `{}` in its arguments stands for the robot's folder.
    fn command(&self, arguments: &str) -> Command {
        let folder = self.folder.path().to_str().unwrap();
        let mut command = Command::new(std::env::var_os("CARGO_BIN_EXE_esm").unwrap());
        let rate = if arguments.contains("--baud") {
            &[][..]
        } else {
            &["--baud", "921600"]
        };
        command
            .current_dir("..")
            .args((arguments.split_whitespace()).map(|argument| argument.replace("{}", folder)))
            .args(["--port", &self.port])
            .args(rate)
            .env("XDG_CONFIG_HOME", folder)
            .env("XDG_RUNTIME_DIR", folder)
            .env("TERM", "xterm")
            .env_remove("ESM_KEY")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    #[track_caller]
    fn esm(&self, arguments: &str, status: i32) -> Said {
        Said::of(
            spawn(&mut self.command(arguments))
                .wait_with_output()
                .unwrap(),
        )
        .ended(arguments, status)
    }

    fn manner(&self, manner: Manner) {
        self.seen.lock().unwrap().manner = manner;
    }

    /// Waits until a request of this name has come.
    #[track_caller]
    fn until(&self, name: &str) -> Instant {
        let begun = Instant::now();
        loop {
            if let Some(at) = self.seen.lock().unwrap().when(name) {
                return at;
            }
            assert!(begun.elapsed() < PATIENCE, "waited in vain for {name}");
            sleep(LOOK_INTERVAL);
        }
    }

    fn forget(&self) {
        self.seen.lock().unwrap().requests.clear();
    }

    fn mode(&self) -> serde_json::Value {
        let said = self.esm("status --json", 0);
        serde_json::from_str::<serde_json::Value>(&said.out).unwrap()["mode"].clone()
    }

    /// Starts a command that has the port, and waits until it is in the midst of its work.
    #[track_caller]
    fn held_by(&self, holder: &Holder) -> Held {
        self.forget();
        let mut command = self.command(holder.arguments);
        let screen = holder.has_screen.then(|| Screen::give(&mut command));
        let child = spawn(&mut command);
        self.until(holder.request);
        if holder.request == "Subscribe" {
            // It listens, and lets the robot hear that.
            self.forget();
            self.until("Clock");
        }
        Held {
            child: Some(child),
            _screen: screen,
        }
    }
}

/// Held while a process is started: until it is the other program, it has a copy of all that is
/// open here.
static STARTING: Mutex<()> = Mutex::new(());

fn spawn(command: &mut Command) -> Child {
    let _starting = STARTING.lock().unwrap_or_else(PoisonError::into_inner);
    command.spawn().unwrap()
}

/// Carries bytes between a client and a robot until the client goes.
fn serve(mut client: UnixStream, line: &mut impl ByteLink) {
    client.set_nonblocking(true).unwrap();
    let mut buffer = [0; 512];
    loop {
        match client.read(&mut buffer) {
            Ok(0) => return,
            Ok(count) => line.send(&buffer[..count]).unwrap(),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
            Err(_) => return,
        }
        let count = line.receive(&mut buffer, Duration::from_millis(1)).unwrap();
        if client.write_all(&buffer[..count]).is_err() {
            return;
        }
    }
}

/// A command that has a port for longer.
struct Holder {
    arguments: &'static str,
    /// With which it is in the midst of its work.
    request: &'static str,
    has_screen: bool,
    /// What becomes of it when `esm stop` takes the port over: it goes on, or ends, and says this.
    goes_on: bool,
    says: &'static str,
}

const HOLDERS: [Holder; 5] = [
    Holder {
        arguments: "log",
        request: "Subscribe",
        has_screen: false,
        goes_on: true,
        says: "the log goes on; what the robot said meanwhile did not come",
    },
    Holder {
        arguments: "log --record {}/drive.rec",
        request: "Subscribe",
        has_screen: false,
        goes_on: false,
        says: "`esm stop` has taken the port over",
    },
    Holder {
        arguments: "values --every 100ms",
        request: "Values",
        has_screen: false,
        goes_on: false,
        says: "`esm stop` has taken the port over",
    },
    Holder {
        arguments: "top --interval 100ms",
        request: "SlotCounters",
        has_screen: true,
        goes_on: true,
        says: "",
    },
    Holder {
        // So slow that it lasts.
        arguments: "upload missions/follow_wall.esm --baud 4800",
        request: "Chunk",
        has_screen: false,
        goes_on: false,
        says: "`esm stop` has taken the port over\nthe robot is stopped by it",
    },
];

/// A running command, killed in the end.
struct Held {
    child: Option<Child>,
    _screen: Option<Screen>,
}

impl Held {
    fn signal(&self, signal: Signal) {
        let pid = self.child.as_ref().unwrap().id();
        kill(Pid::from_raw(pid as i32), signal).unwrap();
    }

    fn is_over(&mut self) -> bool {
        self.child.as_mut().unwrap().try_wait().unwrap().is_some()
    }

    /// Waits for its end. Answers how long that took.
    #[track_caller]
    fn ended(mut self, what: &str) -> (Said, Duration) {
        let begun = Instant::now();
        while !self.is_over() {
            assert!(begun.elapsed() < PATIENCE, "{what} does not end");
            sleep(LOOK_INTERVAL);
        }
        let took = begun.elapsed();
        let output = self.child.take().unwrap().wait_with_output().unwrap();
        (Said::of(output), took)
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        if let Some(mut child) = self.child.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// A terminal whose screen nobody looks at, but which takes what is drawn.
struct Screen(#[allow(dead_code, reason = "kept open")] PtyServer);

impl Screen {
    fn give(command: &mut Command) -> Self {
        let (near, mut far) = pipe::pair();
        let terminal = PtyServer::start(Box::new(near)).unwrap();
        let open = || {
            let options = File::options().read(true).write(true).to_owned();
            options.open(terminal.path()).unwrap()
        };
        let size = rustix::termios::Winsize {
            ws_row: 40,
            ws_col: 120,
            ws_xpixel: 0,
            ws_ypixel: 0,
        };
        rustix::termios::tcsetwinsize(open(), size).unwrap();
        command.stdin(open()).stdout(open());
        thread::spawn(move || {
            let mut buffer = [0; 4096];
            while far.receive(&mut buffer, PATIENCE).is_ok() {}
        });
        Screen(terminal)
    }
}

/// What a command said.
#[derive(Debug)]
struct Said {
    status: Option<i32>,
    out: String,
    err: String,
}

impl Said {
    fn of(output: Output) -> Self {
        Said {
            status: output.status.code(),
            out: String::from_utf8_lossy(&output.stdout).into_owned(),
            err: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }

    #[track_caller]
    fn ended(self, arguments: &str, status: i32) -> Self {
        assert_eq!(self.status, Some(status), "esm {arguments}: {self:#?}");
        self
    }
}

/// Both stops: the arguments, the request, the mode that follows, and how a robot drives again.
const STOPS: [(&str, &str, &str, &str); 2] = [
    ("stop", "Stop", "stopped", "start"),
    (
        "stop --emergency",
        "EmergencyStop",
        "emergency stop",
        "start --release",
    ),
];

#[test]
fn a_stop_takes_the_port_over_from_whoever_has_it() {
    let robot = Robot::start();
    robot.esm("upload missions/patrol.esm", 0);
    let mut alone = Vec::new();
    for (stop, _, mode, start) in STOPS {
        alone.push(robot.esm(stop, 0).out);
        assert_eq!(robot.mode(), mode);
        robot.esm(start, 0);
    }
    for holder in &HOLDERS {
        for ((stop, request, mode, start), said_alone) in STOPS.into_iter().zip(&alone) {
            let what = format!("esm {stop} during esm {}", holder.arguments);
            let _ = fs::remove_file(robot.path("drive.rec"));
            let mut held = robot.held_by(holder);
            let begun = Instant::now();
            let said = robot.esm(stop, 0);
            let on_the_line = robot.until(request) - begun;
            println!("{what}: on the line after {on_the_line:?}");
            assert!(on_the_line < LAST_SECONDS, "{what}: {on_the_line:?}");
            assert_eq!(said.out, *said_alone, "{what}: {said:#?}");
            if holder.goes_on {
                robot.forget();
                // A new session, and what it does in it.
                robot.until("Hello");
                robot.until(holder.request);
                assert!(!held.is_over(), "{what}");
                held.signal(Signal::SIGINT);
                let (said, _) = held.ended(&what);
                assert_eq!(said.status, Some(0), "{what}: {said:#?}");
                assert!(said.err.contains(holder.says), "{what}: {said:#?}");
            } else {
                let (said, _) = held.ended(&what);
                assert_eq!(said.status, Some(3), "{what}: {said:#?}");
                assert!(said.err.contains(holder.says), "{what}: {said:#?}");
            }
            assert_eq!(robot.mode(), mode, "{what}");
            robot.esm(start, 0);
        }
    }
}

#[test]
fn a_socket_that_takes_one_client_is_passed_on() {
    let robot = Robot::start_at_socket();
    robot.esm("upload missions/patrol.esm", 0);
    let held = robot.held_by(&HOLDERS[1]);
    robot.esm("stop", 0);
    let (said, _) = held.ended("the log");
    assert!(said.err.contains(HOLDERS[1].says), "{said:#?}");
    assert!(said.err.contains("recorded in"), "{said:#?}");
    assert_eq!(robot.mode(), "stopped");
}

#[test]
fn a_suspended_command_does_not_keep_a_stop_from_a_serial_line() {
    let robot = Robot::start();
    robot.esm("upload missions/patrol.esm", 0);
    let held = robot.held_by(&HOLDERS[0]);
    held.signal(Signal::SIGSTOP);
    let begun = Instant::now();
    robot.esm("stop --emergency", 0);
    let on_the_line = robot.until("EmergencyStop") - begun;
    println!("on the line after {on_the_line:?}");
    assert!(on_the_line < LAST_SECONDS, "{on_the_line:?}");
    // Nobody else gets in.
    let said = robot.esm("status", 3);
    assert!(said.err.contains("is in use"), "{said:#?}");
    held.signal(Signal::SIGKILL);
    held.ended("the log");
    assert_eq!(robot.mode(), "emergency stop");
}

#[test]
fn what_a_killed_command_leaves_behind_is_in_nobodys_way() {
    let robot = Robot::start();
    robot.esm("upload missions/patrol.esm", 0);
    let controls = || fs::read_dir(robot.path("esm")).unwrap().count();
    assert_eq!(controls(), 0);
    let held = robot.held_by(&HOLDERS[0]);
    assert_eq!(controls(), 1);
    held.signal(Signal::SIGKILL);
    held.ended("the log");
    assert_eq!(controls(), 1, "nobody could remove it");
    robot.esm("stop", 0);
    assert_eq!(controls(), 0);
    robot.esm("start", 0);
    let held = robot.held_by(&HOLDERS[1]);
    robot.esm("stop", 0);
    held.ended("the recording");
    assert_eq!(controls(), 0);
}

#[test]
fn a_directory_that_others_can_use_is_not_used() {
    let robot = Robot::start();
    robot.esm("upload missions/patrol.esm", 0);
    fs::remove_dir(robot.path("esm")).unwrap();
    let nobody = 65_534;
    let is_root = rustix::process::geteuid().is_root();
    for (mode, owner) in [(0o777, None), (0o700, Some(nobody))] {
        if owner.is_some() && !is_root {
            // Only the superuser can give a directory away; the rule itself is tested where it
            // stands.
            continue;
        }
        DirBuilder::new()
            .mode(0o700)
            .create(robot.path("esm"))
            .unwrap();
        fs::set_permissions(robot.path("esm"), Permissions::from_mode(mode)).unwrap();
        std::os::unix::fs::chown(robot.path("esm"), owner, None).unwrap();
        let held = robot.held_by(&HOLDERS[1]);
        assert_eq!(fs::read_dir(robot.path("esm")).unwrap().count(), 0);
        // It finds the other one where the first has found it.
        robot.esm("stop", 0);
        let (said, _) = held.ended("the recording");
        assert!(said.err.contains(HOLDERS[1].says), "{said:#?}");
        assert_eq!(robot.mode(), "stopped");
        robot.esm("start", 0);
        fs::remove_file(robot.path("drive.rec")).unwrap();
        // Somebody else's would be in the way of the next.
        fs::remove_dir(robot.path("esm")).unwrap();
    }
}

#[test]
fn a_line_is_one_commands_alone_but_for_a_stop() {
    let _starting = STARTING.lock().unwrap_or_else(PoisonError::into_inner);
    let (near, _far) = pipe::pair();
    let server = PtyServer::start(Box::new(near)).unwrap();
    let port = server.path().to_str().unwrap().parse().unwrap();
    let mut first = serial::open(&port, serial::DEFAULT_BAUD).unwrap();
    let second = serial::open(&port, serial::DEFAULT_BAUD).err().unwrap();
    assert!(matches!(second, OpenError::Busy { .. }), "{second}");
    let stop = serial::open_to_stop(&port, serial::DEFAULT_BAUD).unwrap();
    let error = first.send(b"more").unwrap_err();
    assert!(serial::wire::is_taken_over(&error), "{error}");
    let error = first.receive(&mut [0; 8], Duration::ZERO).unwrap_err();
    assert!(serial::wire::is_taken_over(&error), "{error}");
    // A second one comes before the first has ended.
    let another = serial::open_to_stop(&port, serial::DEFAULT_BAUD).unwrap();
    drop(first);
    let second = serial::open(&port, serial::DEFAULT_BAUD).err().unwrap();
    assert!(matches!(second, OpenError::Busy { .. }), "{second}");
    let third = serial::open_to_stop(&port, serial::DEFAULT_BAUD).unwrap();
    drop((stop, another, third));
    drop(serial::open(&port, serial::DEFAULT_BAUD).unwrap());
}

#[test]
fn ctrl_c_ends_each_command_whatever_comes_on_its_line() {
    let mut longest = Duration::ZERO;
    for holder in &HOLDERS {
        let robot = Robot::start();
        robot.esm("upload missions/patrol.esm", 0);
        for manner in BAD_MANNERS {
            let what = format!("{manner:?} during esm {}", holder.arguments);
            robot.manner(Manner::Good);
            let _ = fs::remove_file(robot.path("drive.rec"));
            let mut held = robot.held_by(holder);
            robot.manner(manner);
            // It is to be in the midst of that.
            sleep(Duration::from_millis(400));
            assert!(!held.is_over(), "{what}");
            held.signal(Signal::SIGINT);
            let (said, took) = held.ended(&what);
            println!("{what}: {took:?}");
            assert!(took < LAST_SECONDS, "{what}: {took:?} {said:#?}");
            assert!(said.status.is_some(), "{what}: {said:#?}");
            longest = longest.max(took);
        }
    }
    println!("{longest:?} at the longest");
}

/// The emulated robot of `esm board`, killed in the end.
struct Board {
    held: Held,
    port: String,
}

impl Board {
    fn start(folder: &Path) -> Self {
        let out = folder.join("out");
        let mut command = Command::new(std::env::var_os("CARGO_BIN_EXE_esm").unwrap());
        command
            .args(["board", "--board", "host"])
            .stdin(Stdio::null())
            .stdout(File::create(&out).unwrap())
            .stderr(Stdio::null());
        let held = Held {
            child: Some(spawn(&mut command)),
            _screen: None,
        };
        let begun = Instant::now();
        let port = loop {
            let said = fs::read_to_string(&out).unwrap();
            let rest = said.strip_prefix("the robot is at ");
            if let Some((port, _)) = rest.and_then(|rest| rest.split_once(';')) {
                break port.to_owned();
            }
            assert!(begun.elapsed() < PATIENCE, "it says no port: {said}");
            sleep(LOOK_INTERVAL);
        };
        Board { held, port }
    }
}

/// How long a client sends requests whose answers it does not read.
const FLOOD_TIME: Duration = Duration::from_secs(2);

/// Bytes that are to have come through meanwhile: more than all buffers on the way hold.
const FLOOD_BYTES: usize = 1 << 20;

/// Sends requests as fast as they are taken, and reads nothing. Answers how many bytes were taken,
/// and the open line.
fn flood(port: &str) -> (usize, File) {
    let flags = rustix::fs::OFlags::NONBLOCK | rustix::fs::OFlags::NOCTTY;
    let mut options = File::options();
    options.read(true).write(true);
    let mut line = options
        .custom_flags(flags.bits() as i32)
        .open(port)
        .unwrap();
    let mut requests = Vec::new();
    for seq in 0..=u8::MAX {
        let mut wire = [0; MAX_FRAME_BYTES];
        let request = Request::Hello;
        let length = frame::encode(&ToDevice { seq, request }, &mut wire).unwrap();
        requests.extend_from_slice(&wire[..length]);
    }
    let begun = Instant::now();
    let mut sent = 0;
    while begun.elapsed() < FLOOD_TIME {
        match line.write(&requests[sent % requests.len()..]) {
            Ok(count) => sent += count,
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => sleep(LOOK_INTERVAL / 10),
            Err(error) => panic!("{error}"),
        }
    }
    (sent, line)
}

#[test]
fn a_client_that_asks_and_never_reads_stops_no_board() {
    let folder = tempfile::tempdir().unwrap();
    let board = Board::start(folder.path());
    let (sent, line) = flood(&board.port);
    println!("{sent} bytes of requests");
    assert!(sent > FLOOD_BYTES, "it took {sent} bytes, and no more");
    drop(line);
    // Another client finds the robot, once the answers that were on their way are over.
    let mut status = Command::new(std::env::var_os("CARGO_BIN_EXE_esm").unwrap());
    status.args(["status", "--port", &board.port]);
    status.stdout(Stdio::piped()).stderr(Stdio::piped());
    let begun = Instant::now();
    loop {
        let said = Said::of(spawn(&mut status).wait_with_output().unwrap());
        if said.status == Some(0) {
            break;
        }
        assert!(begun.elapsed() < PATIENCE, "{said:#?}");
    }
    let _flooded = flood(&board.port);
    board.held.signal(Signal::SIGINT);
    let (said, took) = board.held.ended("the board");
    println!("ended after {took:?}");
    assert_eq!(said.status, Some(0), "{said:#?}");
    assert!(took < LAST_SECONDS, "{took:?}");
}

/// Every command with a port.
const AT_A_PORT: [&str; 22] = [
    "log",
    "log --record {}/new.rec",
    "log --news 100ms",
    "top",
    "top --once",
    "values",
    "values --every 100ms",
    "status",
    "tasks",
    "blackbox",
    "param get",
    "param save",
    "key show",
    "key remove",
    "stop",
    "stop --emergency",
    "start",
    "start --release",
    "confirm",
    "fallback",
    "upload missions/patrol.esm",
    "upload missions/patrol.esm --diff",
];

#[test]
fn ctrl_c_ends_each_command_at_a_line_without_a_robot() {
    let robot = Robot::start();
    let mut longest = Duration::ZERO;
    for manner in BAD_MANNERS {
        robot.manner(manner);
        for arguments in AT_A_PORT {
            let what = format!("{manner:?} before esm {arguments}");
            let child = spawn(&mut robot.command(arguments));
            let mut held = Held {
                child: Some(child),
                _screen: None,
            };
            sleep(Duration::from_millis(250));
            assert!(!held.is_over(), "{what}: {:#?}", held.ended(&what));
            held.signal(Signal::SIGINT);
            let (said, took) = held.ended(&what);
            assert!(took < LAST_SECONDS, "{what}: {took:?} {said:#?}");
            println!("{what}: {took:?}");
            longest = longest.max(took);
        }
    }
    println!("{longest:?} at the longest");
}
