//! Recordings that a host makes of a robot over its line, good or bad, while it gives the robot
//! missions, takes them back and stops it: replayed, they are the run, line by line, wherever
//! nothing is missing.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use esm_link::frame::{self, FrameReader};
use esm_link::message::{Channel, FromDevice, Mode, Swap};
use esm_link::trace::TraceEvent;
use esm_tests::command::{Robot, Running, esm, esm_binary, firmware, root};
use host_tools::compile::compile;
use host_tools::files::load_world;
use host_tools::link_client::{LinkClient, RobotInfo, Streams};
use host_tools::lockstep::pace::Pace;
use host_tools::lockstep::plant_side::PlantSide;
use host_tools::plant::{BodyParameters, Plant};
use host_tools::recording::file::{self, FileEnd, Frame};
use host_tools::recording::live::{LiveError, LiveRecording, Noted};
use host_tools::recording::player::{Recording, ReplayError, replay};
use host_tools::recording::writer::Counts;
use host_tools::run::board::{Board, LinkWay, RunningBoard};
use host_tools::run::mission::Mission;
use host_tools::run::story::Story;
use host_tools::serial::ByteLink;
use host_tools::serial::clock::Clock;
use host_tools::serial::noise::{Noise, Noisy};
use host_tools::time::work_limit;
use host_tools::{host_board, lang};

/// What the robot wants of its host: its trace, which is compared with, beside the recording.
const TRACE: Streams = Streams {
    trace: true,
    log: false,
    record: false,
};

/// How long a wait for the robot's next words lasts.
const LISTEN_TIME: Duration = Duration::from_millis(10);

/// A trace as it left the robot, before the line had its way with it.
#[derive(Default)]
struct Tapped {
    reader: Option<FrameReader>,
    bytes: Vec<u8>,
    dropped: Option<u32>,
}

impl Tapped {
    fn hear(&mut self, bytes: &[u8]) {
        for byte in bytes {
            let Some(frame) = self.reader.get_or_insert_with(FrameReader::new).push(*byte) else {
                continue;
            };
            let Ok(FromDevice::Stream(part)) = frame::decode(frame) else {
                continue;
            };
            if part.channel == Channel::Trace {
                assert_eq!(*self.dropped.get_or_insert(part.dropped), part.dropped);
                self.bytes.extend_from_slice(part.bytes);
            }
        }
    }
}

/// A line on which somebody listens.
struct Tap<L> {
    line: L,
    tapped: Arc<Mutex<Tapped>>,
}

impl<L: ByteLink> ByteLink for Tap<L> {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let count = self.line.receive(buffer, timeout)?;
        self.tapped.lock().unwrap().hear(&buffer[..count]);
        Ok(count)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.line.send(bytes)
    }

    fn clock(&self) -> Clock {
        self.line.clock()
    }
}

type Line = Noisy<Tap<Box<dyn ByteLink>>>;

/// A host that records a robot.
struct Session {
    robot: LinkClient<Line>,
    info: RobotInfo,
    recording: Option<LiveRecording<Vec<u8>>>,
    tapped: Arc<Mutex<Tapped>>,
    gaps: u64,
    /// Last: whoever waits for the robot's words is gone before the robot is.
    _board: RunningBoard,
}

impl Session {
    /// Board and host share one virtual time, so that a session repeats to the byte.
    fn start(board: Board, noise: u32, seed: u64) -> Self {
        let world = load_world(&root().join("missions/worlds/office.world")).unwrap();
        let plant = Plant::new(world, BodyParameters::default(), seed).unwrap();
        let plant = PlantSide::new(plant, Pace::new(false), None);
        let (board, line) = RunningBoard::start(board, &plant, None, LinkWay::Exchange).unwrap();
        let tapped = Arc::new(Mutex::new(Tapped::default()));
        let line = Tap {
            line,
            tapped: Arc::clone(&tapped),
        };
        let line = Noisy::new(line, Noise::of_each(noise), seed);
        let (robot, info) = LinkClient::connect(line).unwrap();
        let mut session = Session {
            robot,
            info,
            recording: None,
            tapped,
            gaps: 0,
            _board: board,
        };
        session.robot.subscribe(TRACE).unwrap();
        session
    }

    fn record(&mut self) {
        let begun = LiveRecording::begin(&mut self.robot, &self.info, TRACE, &[], || {
            Ok::<_, LiveError>(Vec::new())
        });
        self.recording = Some(begun.unwrap());
    }

    fn take(&mut self) {
        for event in self.robot.take_events() {
            let Some(recording) = &mut self.recording else {
                continue;
            };
            match recording.take(&mut self.robot, &event).unwrap() {
                Some(Noted::Gap(_)) => self.gaps += 1,
                Some(Noted::DeadlineMiss(hash)) => panic!("{hash:08x} was not read"),
                Some(Noted::NoValues(why)) => panic!("{why}"),
                None => {}
            }
        }
    }

    /// Lets the robot drive for so long.
    fn drive(&mut self, seconds: f64) {
        let clock = self.robot.clock().clone();
        let end = clock.now() + Duration::from_secs_f64(seconds);
        while clock.now() < end {
            self.robot.listen(LISTEN_TIME).unwrap();
            self.take();
            if let Some(recording) = &mut self.recording {
                recording.look_after(&mut self.robot).unwrap();
            }
        }
    }

    fn upload(&mut self, name: &str, warm: bool, trial_ms: u32) -> u32 {
        let mission = mission(name);
        self.robot.stage(&mission.blob, &mut |_| ()).unwrap();
        self.take();
        let swap = Swap { warm, trial_ms };
        let committed = self.robot.commit(swap).unwrap();
        assert_eq!(committed.mission, mission.hash);
        self.take();
        mission.hash
    }

    fn finish(mut self) -> Made {
        let recording = self.recording.take().unwrap();
        let (bytes, counts, lost) = recording.finish(&mut self.robot).unwrap();
        assert!(lost.is_none(), "{lost:?}");
        let trace = std::mem::take(&mut self.tapped.lock().unwrap().bytes);
        Made {
            bytes,
            counts,
            trace,
        }
    }
}

fn mission(name: &str) -> Mission {
    let path = root().join(format!("missions/{name}.esm"));
    let mut checked = lang::load(&path).unwrap();
    let schedule = checked
        .lay_out(work_limit(Duration::from_secs(60)))
        .unwrap();
    let blob = compile(checked.model.as_ref().unwrap(), &schedule).unwrap();
    Mission::new(&path, esm_core::verify(blob).unwrap()).unwrap()
}

/// What came of a session.
struct Made {
    bytes: Vec<u8>,
    counts: Counts,
    trace: Vec<u8>,
}

/// The lines of a macro step of a run of a mission, which is known by its hash and start.
type Lines = BTreeMap<(u32, u64, u64), Vec<String>>;

impl Made {
    /// The robot's own trace.
    fn traced(&self) -> Lines {
        let missions = ["patrol", "follow_wall", "stand_by"].map(mission);
        let mut lines = Lines::new();
        let mut rest = self.trace.as_slice();
        let mut playing: Option<(u32, u64, Story<Vec<u8>>)> = None;
        let mut keep = |played: Option<(u32, u64, Story<Vec<u8>>)>| {
            let Some((hash, start_us, story)) = played else {
                return;
            };
            let told = story.finish(0).unwrap().unwrap();
            for line in String::from_utf8(told.out).unwrap().lines() {
                let of = (hash, start_us, step_of(line));
                lines.entry(of).or_default().push(line.to_owned());
            }
        };
        while !rest.is_empty() {
            let Ok(record) = TraceEvent::take(&mut rest) else {
                // The last one was under way when the session ended.
                break;
            };
            if let TraceEvent::Started { mission, start_us } = record {
                keep(playing.take());
                let of = missions.iter().find(|of| of.hash == mission).unwrap();
                let mut story = Story::new(Vec::new(), None);
                let directory = Arc::clone(&of.directory);
                story.mission(&of.name, directory, start_us).unwrap();
                playing = Some((mission, start_us, story));
            }
            if let Some((_, _, story)) = &mut playing {
                story.record(&record, &mut |_| ()).unwrap();
            }
        }
        keep(playing);
        lines
    }

    /// Compares the replay with the trace, wherever nothing is missing; answers of how many of its
    /// macro steps the recording knows.
    fn compare(&self, what: &str) -> (u64, usize) {
        let traced = self.traced();
        let recording = Recording::read(&self.bytes).unwrap();
        assert_eq!(recording.end, FileEnd::Whole, "{what}");
        let mut out = Vec::new();
        let outcome = replay(&recording, true, Some(&mut out)).unwrap_or_else(|(_, error)| {
            panic!("{what}: {error}");
        });
        assert_eq!(outcome.stretches, recording.stretches.len(), "{what}");
        assert_eq!(outcome.steps, self.counts.steps, "{what}");
        let out = String::from_utf8(out).unwrap();
        let mut again = out.lines().peekable();
        for stretch in &recording.stretches {
            // That of the robot's own mission began before anybody listened.
            let is_traced = (traced.keys()).any(|(hash, start_us, _)| {
                (*hash, *start_us) == (stretch.mission, stretch.start_us)
            });
            for _ in 0..stretch.made {
                if !is_traced {
                    again.find(|line| line.contains("\"kind\":\"step\""));
                    continue;
                }
                let step = step_of(again.peek().unwrap());
                let of_step = traced
                    .get(&(stretch.mission, stretch.start_us, step))
                    .unwrap_or_else(|| panic!("{what}: step {step} of {stretch:?}"));
                for line in of_step {
                    assert_eq!(again.next(), Some(line.as_str()), "{what}");
                }
            }
        }
        assert_eq!(again.next(), None, "{what}");
        (outcome.steps, traced.len())
    }
}

fn step_of(line: &str) -> u64 {
    let line: serde_json::Value = serde_json::from_str(line).unwrap();
    line["step"].as_u64().unwrap()
}

fn on_the_host() -> Board {
    Board::Host {
        robot: host_board::rover,
    }
}

fn in_the_emulator() -> Board {
    Board::emulated(firmware("rover"))
}

/// What a host does with a robot that it records.
type Script = fn(&mut Session);

const NO_TRIAL: u32 = 0;
const LONG_TRIAL: u32 = 60_000;
const SHORT_TRIAL: u32 = 1_000;

fn cold(session: &mut Session) {
    session.record();
    session.upload("patrol", false, NO_TRIAL);
    session.drive(1.5);
    session.upload("follow_wall", false, NO_TRIAL);
    session.drive(1.5);
}

fn warm(session: &mut Session) {
    session.record();
    session.upload("patrol", false, NO_TRIAL);
    session.drive(1.5);
    session.upload("follow_wall", true, NO_TRIAL);
    session.drive(1.0);
    session.upload("patrol", true, NO_TRIAL);
    session.drive(1.0);
}

fn fall_back_on_request(session: &mut Session) {
    session.record();
    session.upload("patrol", false, NO_TRIAL);
    session.drive(1.0);
    let hash = session.upload("follow_wall", true, LONG_TRIAL);
    session.drive(1.0);
    session.robot.fall_back(hash).unwrap();
    session.drive(1.0);
}

fn fall_back_of_a_mission_that_nobody_confirms(session: &mut Session) {
    session.record();
    session.upload("patrol", false, NO_TRIAL);
    session.drive(1.0);
    session.upload("follow_wall", false, SHORT_TRIAL);
    session.drive(2.0);
    let hash = session.robot.status().unwrap().mission;
    assert_eq!(hash, Some(mission("patrol").hash));
}

fn a_mission_that_is_confirmed(session: &mut Session) {
    session.record();
    session.upload("patrol", false, NO_TRIAL);
    session.drive(0.5);
    let hash = session.upload("follow_wall", false, SHORT_TRIAL);
    session.drive(0.5);
    session.robot.confirm(hash).unwrap();
    session.drive(1.5);
    assert_eq!(session.robot.status().unwrap().mission, Some(hash));
}

/// Another value for the first parameter that takes one: a tenth less, or more, of what it is.
fn change_a_parameter(session: &mut Session, hash: u32) {
    let changed = (0..100).any(|param| {
        let Ok(bits) = session.robot.param(hash, param) else {
            return false;
        };
        let value = f32::from_bits(bits.value);
        [0.9, 1.1, 0.5].iter().any(|factor| {
            let other = (value * factor).to_bits();
            other != bits.value && session.robot.set_param(hash, param, other).is_ok()
        })
    });
    assert!(changed, "no parameter could be changed");
}

fn changed_parameters(session: &mut Session) {
    session.record();
    let hash = session.upload("patrol", false, NO_TRIAL);
    session.drive(1.0);
    change_a_parameter(session, hash);
    session.drive(2.0);
}

fn emergency_stop(session: &mut Session) {
    session.record();
    session.upload("patrol", false, NO_TRIAL);
    session.drive(1.0);
    session.robot.emergency_stop().unwrap();
    session.drive(0.5);
    let mode = session.robot.status().unwrap().mode;
    assert_eq!(mode, Mode::EmergencyStopped);
    session.robot.release().unwrap();
    session.drive(0.3);
    session.robot.start().unwrap();
    session.drive(1.0);
}

fn stop_and_start(session: &mut Session) {
    session.record();
    session.upload("follow_wall", false, NO_TRIAL);
    session.drive(1.0);
    session.robot.stop().unwrap();
    session.drive(0.5);
    session.robot.start().unwrap();
    session.drive(1.0);
}

fn begun_in_the_midst(session: &mut Session) {
    session.upload("patrol", false, NO_TRIAL);
    session.drive(1.3);
    session.record();
    session.drive(1.5);
    session.upload("follow_wall", true, NO_TRIAL);
    session.drive(1.0);
}

fn ended_in_a_stop(session: &mut Session) {
    session.record();
    session.upload("patrol", false, NO_TRIAL);
    session.drive(1.0);
    session.robot.stop().unwrap();
    session.drive(0.3);
}

/// All of it, one after the other.
fn all(session: &mut Session) {
    session.upload("patrol", false, NO_TRIAL);
    session.drive(0.7);
    session.record();
    session.drive(1.0);
    let hash = session.upload("follow_wall", true, LONG_TRIAL);
    session.drive(1.0);
    session.robot.fall_back(hash).unwrap();
    session.drive(1.0);
    change_a_parameter(session, mission("patrol").hash);
    session.drive(1.0);
    session.upload("follow_wall", false, SHORT_TRIAL);
    session.drive(2.0);
    session.robot.emergency_stop().unwrap();
    session.drive(0.5);
    session.robot.release().unwrap();
    session.robot.start().unwrap();
    session.drive(1.5);
}

const SCRIPTS: [(&str, Script); 10] = [
    ("cold", cold),
    ("warm", warm),
    ("fall-back on request", fall_back_on_request),
    (
        "fall-back of a mission that nobody confirms",
        fall_back_of_a_mission_that_nobody_confirms,
    ),
    ("a mission that is confirmed", a_mission_that_is_confirmed),
    ("changed parameters", changed_parameters),
    ("emergency stop", emergency_stop),
    ("stop and start", stop_and_start),
    ("begun in the midst", begun_in_the_midst),
    ("ended in a stop", ended_in_a_stop),
];

/// A session on a good line has all from where it began.
#[track_caller]
fn check_whole(what: &str, board: Board, script: Script) {
    let mut session = Session::start(board, 0, 1);
    script(&mut session);
    assert_eq!(session.gaps, 0, "{what}");
    let made = session.finish();
    let (steps, traced) = made.compare(what);
    assert!(made.counts.gaps == 0, "{what}: {:?}", made.counts);
    // The first second may be before the recording; the end of the trace, behind it.
    assert!(steps as usize + 100 > traced, "{what}: {steps} of {traced}");
    assert!(steps > 40, "{what}: {steps} macro steps");
}

#[test]
fn on_a_good_line_ten_sessions_with_the_host_board_are_had_again_line_by_line() {
    std::thread::scope(|scope| {
        for (what, script) in SCRIPTS {
            scope.spawn(move || check_whole(what, on_the_host(), script));
        }
    });
}

#[test]
fn on_a_good_line_a_session_with_the_emulated_board_is_had_again_line_by_line() {
    check_whole("all", in_the_emulator(), all);
}

/// So often each of three things happens to a byte: four in ten of the longest frames suffer.
const BAD: u32 = Noise::WHOLE / 600;

#[track_caller]
fn check_noisy(what: &str, board: Board, seed: u64) -> u64 {
    let mut session = Session::start(board, BAD, seed);
    all(&mut session);
    let gaps = session.gaps;
    let (steps, traced) = session.finish().compare(what);
    assert!(
        steps as usize > traced / 5,
        "{what}: {steps} of {traced} macro steps, {gaps} gaps"
    );
    gaps
}

#[test]
fn on_a_bad_line_what_is_known_is_as_it_was_and_gaps_are_told() {
    let gaps: u64 = std::thread::scope(|scope| {
        let sessions = [1, 2, 3].map(|seed| {
            scope.spawn(move || check_noisy(&format!("seed {seed}"), on_the_host(), seed))
        });
        sessions.map(|session| session.join().unwrap()).iter().sum()
    });
    assert!(gaps > 0, "the line was too good");
}

#[test]
fn on_a_bad_line_sessions_with_the_emulated_board_are_known_as_they_were_and_repeat() {
    for seed in [1, 2] {
        let what = format!("seed {seed}");
        assert!(check_noisy(&what, in_the_emulator(), seed) > 0, "{what}");
    }
    let made = || {
        let mut session = Session::start(in_the_emulator(), BAD, 3);
        session.upload("patrol", false, NO_TRIAL);
        session.record();
        session.drive(2.0);
        session.finish().bytes
    };
    assert_eq!(made(), made(), "the same noise on the same bytes");
}

/// A subscription that is gone, and parts that are numbered anew: so a robot that was reset looks
/// from outside.
#[test]
fn a_robot_that_has_forgotten_who_listens_is_asked_anew_and_the_gap_is_told() {
    let mut session = Session::start(on_the_host(), 0, 1);
    session.record();
    session.upload("patrol", false, NO_TRIAL);
    session.drive(3.0);
    session.robot.hello().unwrap();
    // Longer than a silence may last.
    session.drive(8.0);
    let made = session.finish();
    assert_eq!(made.counts.gaps, 1, "{:?}", made.counts);
    let recording = Recording::read(&made.bytes).unwrap();
    assert_eq!(recording.end, FileEnd::Whole);
    let mut before = Vec::new();
    let (outcome, error) = replay(&recording, false, Some(&mut before)).unwrap_err();
    assert!(matches!(error, ReplayError::Gap { .. }), "{error}");
    assert!(outcome.steps > 100, "{outcome:?}");
    let outcome = replay(&recording, true, Some(io::sink())).unwrap();
    assert!(outcome.checks > 0, "{outcome:?}");
    assert_eq!(outcome.steps, made.counts.steps);
}

/// `esm log --record`, as a process of its own.
struct Recorder {
    child: Child,
    file: PathBuf,
    said: PathBuf,
}

impl Recorder {
    fn start(robot: &Robot, folder: &Path, name: &str) -> Self {
        let (file, said) = (folder.join(name), folder.join(format!("{name}.err")));
        let child = Command::new(esm_binary())
            .args(["log", "--port", robot.port(), "--record"])
            .arg(&file)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(File::create(&said).unwrap())
            .spawn()
            .unwrap();
        Recorder { child, file, said }
    }

    /// Waits until more is in the file than its beginning.
    fn has_records(&mut self) {
        let records = |path: &Path| {
            let bytes = std::fs::read(path).unwrap_or_default();
            let (frames, _) = file::read(&bytes).unwrap_or((Vec::new(), FileEnd::Whole));
            let is_records = |frame: &&Frame| matches!(frame, Frame::Records(_));
            frames.iter().filter(is_records).count()
        };
        self.wait_for("records", |it| records(&it.file) >= 3);
    }

    /// Waits for its end.
    fn ended(&mut self) -> (Option<i32>, String) {
        self.wait_for("its end", |it| it.child.try_wait().unwrap().is_some());
        let status = self.child.wait().unwrap();
        (status.code(), std::fs::read_to_string(&self.said).unwrap())
    }

    fn wait_for(&mut self, what: &str, mut is_there: impl FnMut(&mut Self) -> bool) {
        let begun = Instant::now();
        while !is_there(self) {
            assert!(begun.elapsed() < PATIENCE, "waited in vain for {what}");
            std::thread::sleep(LISTEN_TIME);
        }
    }

    /// What `esm replay` says of the file.
    fn replayed(&self) -> serde_json::Value {
        let file = self.file.to_str().unwrap();
        esm(&["replay", file, "--json"]).good().json()
    }
}

/// How long a command may take to come to what a test waits for.
const PATIENCE: Duration = Duration::from_secs(60);

#[test]
fn whatever_ends_the_command_what_it_recorded_can_be_replayed() {
    let robot = Robot::start("host", None);
    let folder = tempfile::tempdir().unwrap();
    let name = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    robot.esm(&["upload", "missions/patrol.esm"]).good();

    // No room on the disk: the robot is left as it is.
    let full = robot.esm(&["log", "--record", "/dev/full"]).ended(3);
    assert!(
        full.err.contains("cannot write the recording /dev/full"),
        "{full:#?}"
    );
    let before = robot.status()["mission"].clone();
    robot
        .esm(&["upload", "missions/stand_by.esm", "--record", "/dev/full"])
        .ended(3);
    assert_eq!(robot.status()["mission"], before);

    // `kill -9`.
    let mut killed = Recorder::start(&robot, folder.path(), "killed.rec");
    killed.has_records();
    killed.child.kill().unwrap();
    killed.child.wait().unwrap();
    let told = killed.replayed();
    assert!(told["macro_steps"].as_u64().unwrap() > 0, "{told}");
    assert_eq!(told["gaps"], 0, "{told}");

    // What a robot did cannot be had again.
    let bytes = std::fs::read(&killed.file).unwrap();
    let again = robot
        .esm(&["log", "--record", &name("killed.rec")])
        .ended(2);
    assert!(again.err.contains("holds a recording"), "{again:#?}");
    assert_eq!(std::fs::read(&killed.file).unwrap(), bytes);

    // An upload, from before it to its confirmation.
    for (file, how) in [("cold.rec", &[][..]), ("warm.rec", &["--warm"])] {
        let mission = ["missions/follow_wall.esm", "missions/patrol.esm"];
        let mission = mission[usize::from(file == "warm.rec")];
        let record = name(file);
        let upload = [&["upload", mission, "--record", &record], how].concat();
        let done = robot.esm(&upload).good();
        assert!(done.err.contains("recorded in"), "{done:#?}");
        let told = esm(&["replay", &record, "--json"]).good().json();
        let missions = told["missions"].as_array().unwrap();
        assert_eq!(missions.len(), 2, "{told}");
        assert!(missions.iter().all(|it| it["macro_steps"] != 0), "{told}");
        // At the end it was what the robot's machine was.
        assert!(told["checks"].as_u64().unwrap() >= 1, "{told}");
        assert_eq!((&told["gaps"], &told["file"]), (&0.into(), &"whole".into()));
    }

    // The cable is pulled out.
    let mut lost = Recorder::start(&robot, folder.path(), "lost.rec");
    lost.has_records();
    drop(robot);
    let (status, said) = lost.ended();
    assert_eq!(status, Some(3), "{said}");
    assert!(said.contains("the line to the robot is lost"), "{said}");
    assert!(said.contains("recorded in"), "{said}");
    assert!(said.contains("`esm replay "), "{said}");
    let told = lost.replayed();
    assert_eq!(told["file"], "whole", "{told}");
    assert!(told["macro_steps"].as_u64().unwrap() > 0, "{told}");
}

#[test]
fn the_command_records_a_robot_from_the_midst_of_its_run_until_it_is_ended() {
    let robot = Robot::start("host", None);
    robot.esm(&["upload", "missions/patrol.esm"]).good();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("midst.rec");
    let file = file.to_str().unwrap();
    let log = Running::esm(&["log", "--port", robot.port(), "--record", file]);
    let two_seconds = |_: &Running| {
        let bytes = std::fs::read(file).unwrap_or_default();
        Recording::read(&bytes).is_ok_and(|recording| {
            let made = recording.stretches.iter().map(|stretch| stretch.made);
            made.sum::<u64>() > 100
        })
    };
    let log = log.until("two seconds of a recording", two_seconds);
    let done = log.interrupted().good();
    assert!(done.err.contains("recorded in"), "{done:#?}");
    let told = esm(&["replay", file, "--json"]).good().json();
    assert_eq!(told["file"], "whole", "{told}");
    assert_eq!(told["missions"][0]["name"], "Patrol", "{told}");
    assert_eq!(told["gaps"], 0, "{told}");
    assert_eq!(told["seed"], serde_json::Value::Null, "{told}");
    assert!(told["macro_steps"].as_u64().unwrap() > 100, "{told}");
    // At the end it is compared with what the robot was then.
    assert!(told["checks"].as_u64().unwrap() >= 1, "{told}");
}
