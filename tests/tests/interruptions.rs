//! Uploads that end before they are done: the robot drives on, and the next upload works.
//!
//! First a client in this process, to whom a byte is as exact as one likes; then the command
//! itself, as a process that is killed, suspended, or whose cable is pulled out, at a robot on the
//! host board and at one in the emulator.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::io;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::{Duration, Instant};

use esm_link::frame::{DELIMITER, decode};
use esm_link::message::{Mode, Request, ToDevice};
use esm_tests::command::{self, esm_binary, firmware, root};
use esm_tests::environment;
use esm_tests::random::Random;
use esm_tests::subject;
use host_tools::host_board::{self, HostBoard};
use host_tools::link_client::LinkClient;
use host_tools::lockstep::pace::Pace;
use host_tools::lockstep::plant_side::PlantSide;
use host_tools::plant::{BodyParameters, Plant};
use host_tools::run::board::{Board, LinkWay, RunningBoard};
use host_tools::serial::ByteLink;
use host_tools::serial::port::Port;
use host_tools::serial::pty::PtyServer;
use host_tools::world::World;
use tempfile::TempDir;

/// Faster than a real line, for the sake of the test's time.
const BAUD: u32 = 921_600;

/// What becomes of a client after so many bytes that it has sent.
#[derive(Clone, Copy, Debug)]
enum Fate {
    /// The line breaks off in the middle of a frame; the client goes, and the pseudo-terminal is
    /// closed.
    Cut,
    /// It sleeps, and goes on.
    Pause(Duration),
    /// What it sends from here on arrives nowhere, for so many bytes.
    Hole(usize),
}

/// A line to a client with a fate.
struct Fateful<L> {
    line: L,
    left: usize,
    fate: Option<Fate>,
    hole: usize,
}

impl<L: ByteLink> ByteLink for Fateful<L> {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.line.receive(buffer, timeout)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        for byte in bytes {
            if self.left == 0 {
                match self.fate.take() {
                    Some(Fate::Cut) => return Err(io::ErrorKind::BrokenPipe.into()),
                    Some(Fate::Pause(duration)) => std::thread::sleep(duration),
                    Some(Fate::Hole(bytes)) => self.hole = bytes,
                    None => {}
                }
            }
            self.left = self.left.saturating_sub(1);
            match self.hole.checked_sub(1) {
                Some(hole) => self.hole = hole,
                None => self.line.send(&[*byte])?,
            }
        }
        Ok(())
    }
}

fn blob(path: &str) -> Vec<u8> {
    subject::build_file(&root().join(path)).unwrap().blob
}

fn open(port: &Path) -> Box<dyn ByteLink> {
    command::open(&Port::Tty(port.to_owned()), BAUD).unwrap()
}

/// Opens the robot's port and begins a session.
fn connect(port: &Path) -> LinkClient<Box<dyn ByteLink>> {
    LinkClient::connect(open(port)).unwrap().0
}

/// Sees that the robot makes another macro step.
#[track_caller]
fn assert_drives_on(robot: &mut LinkClient<Box<dyn ByteLink>>, what: &str) {
    let steps = robot.status().unwrap().steps;
    let begun = Instant::now();
    while robot.status().unwrap().steps == steps {
        assert!(begun.elapsed() < PATIENCE, "{what}: it stands still");
        sleep(Duration::from_millis(5));
    }
}

#[test]
fn the_robot_drives_on_and_the_next_upload_works_wherever_one_ends() {
    let (board, line) = HostBoard::start(host_board::rover, in_a_cell(), None).unwrap();
    let server = PtyServer::start(Box::new(line)).unwrap();
    let missions = ["missions/patrol.esm", "missions/follow_wall.esm"].map(blob);
    connect(server.path())
        .upload(&missions[0], &mut |_| ())
        .unwrap();

    let rounds = environment::number("ESM_INTERRUPTIONS", 50) as usize;
    let mut random = Random::new(environment::number("ESM_SEED", 0));
    let mut resumed = 0;
    for round in 0..rounds {
        let next = &missions[(round + 1) % missions.len()];
        let before = connect(server.path()).status().unwrap();
        let fate = match random.between(0, 3) {
            0 => Fate::Pause(Duration::from_millis(random.between(1, 400) as u64)),
            1 => Fate::Hole(random.between(1, 400)),
            _ => Fate::Cut,
        };
        // Up to beyond the last chunk, so that some break off at the commit.
        let left = random.between(0, next.len() * 11 / 10);
        let what = format!("round {round}, {fate:?} after {left} bytes");
        let fateful = Fateful {
            line: open(server.path()),
            left,
            fate: Some(fate),
            hole: 0,
        };
        let mut told = Vec::new();
        let ended = LinkClient::connect(fateful)
            .and_then(|(mut client, _)| client.upload(next, &mut |bytes| told.push(bytes)));
        if !matches!(fate, Fate::Cut) {
            assert!(ended.is_ok(), "{what}: {ended:?}");
        }

        let mut client = connect(server.path());
        let status = client.status().unwrap();
        assert_eq!(status.mode, Mode::Running, "{what}");
        assert_eq!((status.missed, status.overruns), (0, 0), "{what}");
        assert_drives_on(&mut client, &what);
        let mut first = None;
        let hash = client
            .upload(next, &mut |bytes| {
                first.get_or_insert(bytes);
            })
            .unwrap();
        let there = told.last().copied().unwrap_or(0);
        if ended.is_err() && there < next.len() && status.mission == before.mission {
            assert!(
                first.unwrap_or(0) >= there,
                "{what}: {there} bytes were there"
            );
            resumed += usize::from(first.unwrap_or(0) > 0);
        }
        assert_eq!(client.status().unwrap().mission, Some(hash), "{what}");
        assert_eq!(client.running_blob().unwrap(), *next, "{what}");
        board.check().unwrap();
    }
    assert!(resumed > rounds / 10, "only {resumed} went on");
}

/// Missions that take turns.
const MISSIONS: [&str; 2] = ["patrol", "follow_wall"];

/// How long a suspended command sleeps: longer than a client waits for an answer (6 s), and longer
/// than a trial (10 s).
const SUSPENDED: Duration = Duration::from_secs(11);

/// How long it sleeps before it is killed.
const SUSPENDED_BEFORE_DEATH: Duration = Duration::from_millis(300);

/// How long anything may take of which a test waits for the end.
const PATIENCE: Duration = Duration::from_secs(120);

/// Robots that are interrupted at the same time: a suspended command takes no processor. Each is
/// at a pseudo-terminal, whose bytes wait for a worker of the kernel; where other programs keep all
/// processors busy, that worker may come to nothing for seconds, and a client gives up.
const ROBOTS: u64 = 3;

/// What becomes of a command in the middle of an upload.
#[derive(Clone, Copy, Debug)]
enum Blow {
    /// `kill -9`.
    Killed,
    /// Suspended for longer than all timers, then it goes on.
    Suspended,
    /// Suspended, then killed.
    SuspendedAndKilled,
    /// The cable is pulled out, and put in again when the command has ended.
    Unplugged,
    /// Ctrl-C. From then on no part of the mission comes through, so that the command cannot be
    /// done before it has noticed.
    Interrupted,
}

const BLOWS: [Blow; 4] = [
    Blow::Killed,
    Blow::Suspended,
    Blow::SuspendedAndKilled,
    Blow::Unplugged,
];

/// When the next blow falls, and on whom.
#[derive(Default)]
struct Plan {
    /// Bytes that clients have sent since this was set to 0.
    sent: usize,
    /// After so many of them.
    at: Option<(usize, Blow, u32)>,
    /// It fell.
    fell: bool,
    /// Since parts of missions come through no more: the beginning of the next frame.
    held: Option<Vec<u8>>,
}

impl Plan {
    /// What comes through of these bytes.
    fn let_through(&mut self, bytes: &[u8]) -> Vec<u8> {
        let Some(frame) = &mut self.held else {
            return bytes.to_vec();
        };
        let mut through = Vec::new();
        for byte in bytes {
            frame.push(*byte);
            if *byte != DELIMITER {
                continue;
            }
            let mut read = std::mem::take(frame);
            let whole = read.clone();
            read.pop();
            let is_other =
                |message: ToDevice<'_>| !matches!(message.request, Request::Chunk { .. });
            if read.is_empty() || decode(&mut read).is_ok_and(is_other) {
                through.extend(whole);
            }
        }
        through
    }
}

/// The robot's line, which is kept where the cable is pulled out.
#[derive(Clone)]
struct Tapped {
    line: Arc<Mutex<Box<dyn ByteLink>>>,
    plan: Arc<Mutex<Plan>>,
}

impl ByteLink for Tapped {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.line.lock().unwrap().receive(buffer, timeout)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut plan = self.plan.lock().unwrap();
        let before = plan.sent;
        plan.sent += bytes.len();
        let due = (plan.at).take_if(|(at, ..)| before + bytes.len() > *at);
        let Some((at, blow, pid)) = due else {
            let through = plan.let_through(bytes);
            return self.line.lock().unwrap().send(&through);
        };
        plan.fell = true;
        self.line.lock().unwrap().send(&bytes[..at - before])?;
        match blow {
            // What it had sent before arrives all the same.
            Blow::Killed => command::signal(pid, "-KILL"),
            Blow::Suspended | Blow::SuspendedAndKilled => command::signal(pid, "-STOP"),
            Blow::Unplugged => return Err(io::ErrorKind::BrokenPipe.into()),
            Blow::Interrupted => {
                plan.held = Some(Vec::new());
                command::signal(pid, "-INT");
            }
        }
        let through = plan.let_through(&bytes[at - before..]);
        self.line.lock().unwrap().send(&through)
    }
}

/// A robot at a port whose name stays when its cable is pulled out and put in again.
struct Plugged {
    tapped: Tapped,
    server: Option<PtyServer>,
    folder: TempDir,
}

impl Plugged {
    fn new(line: Box<dyn ByteLink>) -> Self {
        let mut plugged = Plugged {
            tapped: Tapped {
                line: Arc::new(Mutex::new(line)),
                plan: Arc::default(),
            },
            server: None,
            folder: tempfile::tempdir().unwrap(),
        };
        plugged.plug_in();
        plugged
    }

    fn port(&self) -> PathBuf {
        self.folder.path().join("robot")
    }

    fn pull_out(&mut self) {
        self.server = None;
    }

    fn plug_in(&mut self) {
        let server = PtyServer::start(Box::new(self.tapped.clone())).unwrap();
        let _ = std::fs::remove_file(self.port());
        symlink(server.path(), self.port()).unwrap();
        self.server = Some(server);
    }

    fn esm(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(esm_binary());
        command
            .current_dir(root())
            .args(arguments)
            .arg("--port")
            .arg(self.port())
            .args(["--baud", &BAUD.to_string()])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    /// Runs `esm` to its end.
    fn esm_done(&self, arguments: &[&str]) -> Output {
        let child = command::spawn(&mut self.esm(arguments)).unwrap();
        child.wait_with_output().unwrap()
    }

    /// Runs `esm` to its end, which is to be good; answers what it told a person beside.
    #[track_caller]
    fn esm_good(&self, arguments: &[&str]) -> String {
        let done = self.esm_done(arguments);
        assert!(done.status.success(), "{arguments:?}: {done:?}");
        String::from_utf8(done.stderr).unwrap()
    }

    /// Uploads, and has the command meet its fate after it has sent so many bytes. Answers what it
    /// said, or `None` if it was done before.
    fn interrupted(&mut self, file: &str, at: usize, blow: Blow) -> Option<Output> {
        let mut child = {
            // Nothing passes before it is known whom the blow is for.
            let mut plan = self.tapped.plan.lock().unwrap();
            let child = command::spawn(&mut self.esm(&["upload", file])).unwrap();
            *plan = Plan {
                at: Some((at, blow, child.id())),
                ..Plan::default()
            };
            child
        };
        let begun = Instant::now();
        while !self.tapped.plan.lock().unwrap().fell && child.try_wait().unwrap().is_none() {
            assert!(begun.elapsed() < PATIENCE, "it neither sends nor ends");
            sleep(Duration::from_millis(2));
        }
        let mut plan = self.tapped.plan.lock().unwrap();
        let fell = plan.fell;
        plan.at = None;
        drop(plan);
        match blow {
            _ if !fell => {}
            Blow::Killed | Blow::Interrupted => {}
            Blow::Suspended => {
                sleep(SUSPENDED);
                command::signal(child.id(), "-CONT");
            }
            Blow::SuspendedAndKilled => {
                sleep(SUSPENDED_BEFORE_DEATH);
                command::signal(child.id(), "-KILL");
            }
            Blow::Unplugged => self.pull_out(),
        }
        let output = child.wait_with_output().unwrap();
        self.tapped.plan.lock().unwrap().held = None;
        if self.server.is_none() {
            self.plug_in();
        }
        fell.then_some(output)
    }
}

/// What a command that met this fate may end with: a status, or, for those that were killed, none.
fn may_end_with(blow: Blow, status: Option<i32>) -> bool {
    match blow {
        Blow::Killed | Blow::SuspendedAndKilled => status.is_none(),
        // It went on in time; or its mission was given up while it slept; or nobody waited for it.
        Blow::Suspended => matches!(status, Some(0 | 1 | 3)),
        Blow::Unplugged | Blow::Interrupted => status == Some(3),
    }
}

/// A blob, and a file that it is in.
struct Sent {
    file: PathBuf,
    blob: Vec<u8>,
}

impl Sent {
    fn new(name: &str, folder: &Path) -> Self {
        let blob = blob(&format!("missions/{name}.esm"));
        let file = folder.join(format!("{name}.blob"));
        std::fs::write(&file, &blob).unwrap();
        Sent { file, blob }
    }

    fn file(&self) -> &str {
        self.file.to_str().unwrap()
    }

    fn hash(&self) -> u32 {
        u32::from_le_bytes(*self.blob.last_chunk().unwrap())
    }
}

/// Interrupts uploads to a robot so often, and sees each time that it drives on with a whole
/// mission and that the next upload works.
fn interrupt_uploads(robot: &mut Plugged, rounds: usize, seed: u64) {
    let folder = tempfile::tempdir().unwrap();
    let missions = MISSIONS.map(|name| Sent::new(name, folder.path()));
    let mut random = Random::new(seed);
    robot.esm_good(&["upload", missions[0].file()]);
    robot.tapped.plan.lock().unwrap().sent = 0;
    robot.esm_good(&["upload", missions[1].file()]);
    let bytes = robot.tapped.plan.lock().unwrap().sent;
    let mut round = 0;
    let mut tries = 0;
    while round < rounds {
        let [old, new] = [1, 0].map(|other| &missions[(tries + other) % missions.len()]);
        tries += 1;
        let before = connect(&robot.port()).status().unwrap();
        assert_eq!(before.mission, Some(old.hash()));
        let blow = BLOWS[(round + seed as usize) % BLOWS.len()];
        let at = random.between(0, bytes);
        let Some(output) = robot.interrupted(new.file(), at, blow) else {
            // A trial that is watched takes some bytes more or less: it came through before this
            // one. That is none of those that count.
            continue;
        };
        let what = format!("round {round} of {seed}: {blow:?} after {at} bytes: {output:?}");
        assert!(may_end_with(blow, output.status.code()), "{what}");

        let mut client = connect(&robot.port());
        let status = client.status().unwrap();
        assert_eq!(status.mode, Mode::Running, "{what}");
        let running = client.running_blob().unwrap();
        let whole = missions.iter().find(|mission| mission.blob == running);
        let whole = whole.unwrap_or_else(|| panic!("{what}: what runs was never sent"));
        // Where a trial has ended meanwhile, it was another mission's.
        if status.trial.is_none() {
            assert_eq!(status.mission, Some(whole.hash()), "{what}");
        }
        assert_drives_on(&mut client, &what);
        // Who finds a trial that nobody watches any more waits for its end, or ends it.
        let begun = Instant::now();
        while round % 2 == 0 && client.status().unwrap().trial.is_some() {
            assert!(begun.elapsed() < PATIENCE, "{what}: a trial without end");
            sleep(Duration::from_millis(100));
        }
        let is_on_trial = client.status().unwrap().trial.is_some();
        drop(client);
        if is_on_trial {
            let done = robot.esm_done(&["fallback"]);
            let mut client = connect(&robot.port());
            let is_over = client.status().unwrap().trial.is_none();
            // The robot may have been faster.
            let is_well = matches!(done.status.code(), Some(0 | 1)) && is_over;
            assert!(is_well, "{what}: {done:?}");
        }

        robot.esm_good(&["upload", new.file()]);
        let mut client = connect(&robot.port());
        assert_eq!(client.running_blob().unwrap(), new.blob, "{what}");
        let status = client.status().unwrap();
        let standing = (status.mode, status.mission, status.trial);
        assert_eq!(standing, (Mode::Running, Some(new.hash()), None), "{what}");
        assert_eq!((status.missed, status.overruns), (0, 0), "{what}");
        round += 1;
    }
    println!("robot {seed}: {round} interruptions in {tries} uploads");
}

fn in_a_cell() -> PlantSide {
    let world = World::parse("world cell\n start 1,1 0\n wall 0,0 3,0 3,3 0,3 0,0").unwrap();
    let plant = Plant::new(world, BodyParameters::default(), 1).unwrap();
    PlantSide::new(plant, Pace::new(true), None)
}

#[test]
fn whatever_befalls_the_command_the_robot_drives_on_and_the_next_upload_works() {
    let rounds = environment::number("ESM_COMMAND_INTERRUPTIONS", 12);
    let seed = environment::number("ESM_SEED", 0);
    let _ = esm_binary();
    std::thread::scope(|scope| {
        for robot in 0..ROBOTS {
            scope.spawn(move || {
                let plant = in_a_cell();
                let (board, line) = HostBoard::start(host_board::rover, plant, None).unwrap();
                let mut plugged = Plugged::new(Box::new(line));
                let rounds = (rounds + robot) / ROBOTS;
                interrupt_uploads(&mut plugged, rounds as usize, seed * ROBOTS + robot);
                board.check().unwrap();
            });
        }
    });
}

#[test]
fn whatever_befalls_the_command_the_emulated_board_drives_on_too() {
    let rounds = environment::number("ESM_BOARD_INTERRUPTIONS", 4);
    let seed = environment::number("ESM_SEED", 0);
    let _ = esm_binary();
    let board = Board::emulated(firmware("rover"));
    let starting = command::starting();
    let (mut board, line) = RunningBoard::start(board, &in_a_cell(), None, LinkWay::Uart).unwrap();
    drop(starting);
    interrupt_uploads(&mut Plugged::new(line), rounds as usize, seed);
    board.check().unwrap();
}

/// A robot that drives with the first of the missions, and what an upload of the second one is
/// broken off in the midst of.
fn in_the_midst() -> (HostBoard, Plugged, [Sent; 2], TempDir, usize) {
    let (board, line) = HostBoard::start(host_board::rover, in_a_cell(), None).unwrap();
    let robot = Plugged::new(Box::new(line));
    let folder = tempfile::tempdir().unwrap();
    let missions = MISSIONS.map(|name| Sent::new(name, folder.path()));
    robot.esm_good(&["upload", missions[0].file()]);
    // What comes before the mission is much less than half of it.
    let at = missions[1].blob.len() / 2 + 400;
    (board, robot, missions, folder, at)
}

#[test]
fn ctrl_c_ends_an_upload_and_the_robot_drives_on_with_what_it_had() {
    let (board, mut robot, [old, new], _folder, at) = in_the_midst();
    let output = robot
        .interrupted(new.file(), at, Blow::Interrupted)
        .unwrap();
    assert!(
        may_end_with(Blow::Interrupted, output.status.code()),
        "{output:?}"
    );
    let told = format!("interrupted; the robot goes on with {:08x}", old.hash());
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains(&told), "{output:?}");
    let status = connect(&robot.port()).status().unwrap();
    assert_eq!((status.mission, status.missed), (Some(old.hash()), 0));
    // What was there is forgotten.
    let said = robot.esm_good(&["upload", new.file()]);
    assert!(!said.contains("went on at byte"), "{said}");
    let status = connect(&robot.port()).status().unwrap();
    assert_eq!(status.mission, Some(new.hash()));
    board.check().unwrap();
}

#[test]
fn an_upload_whose_host_was_killed_goes_on_where_it_was() {
    let (board, mut robot, [old, new], _folder, at) = in_the_midst();
    let output = robot.interrupted(new.file(), at, Blow::Killed).unwrap();
    assert!(
        may_end_with(Blow::Killed, output.status.code()),
        "{output:?}"
    );
    let status = connect(&robot.port()).status().unwrap();
    assert_eq!(status.mission, Some(old.hash()));
    let said = robot.esm_good(&["upload", new.file()]);
    assert!(said.contains("went on at byte"), "{said}");
    let status = connect(&robot.port()).status().unwrap();
    assert_eq!((status.mission, status.missed), (Some(new.hash()), 0));
    board.check().unwrap();
}
