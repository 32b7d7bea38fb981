//! Commands at a robot on a line, as processes: what they say of it, and what they do to it. The
//! robot is the host board's, and its line is one that can be listened to and cut.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::io;
use std::os::unix::fs::symlink;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use esm_link::frame::{DELIMITER, decode};
use esm_link::message::{Request, ToDevice};
use host_tools::host_board::{self, HostBoard};
use host_tools::lockstep::pace::Pace;
use host_tools::lockstep::plant_side::PlantSide;
use host_tools::plant::{BodyParameters, Plant};
use host_tools::serial::ByteLink;
use host_tools::serial::pty::PtyServer;
use host_tools::world::World;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

/// Faster than a real line, for the sake of the test's time.
const BAUD: &str = "921600";

/// What happens to a line when a request of some kind comes.
#[derive(Clone, Copy, Debug)]
enum Blow {
    /// It is cut when the request is through.
    CutBehind,
    /// The process that has sent it gets this signal.
    Signal(Signal),
}

/// A blow that is due.
struct Due {
    request: fn(&Request<'_>) -> bool,
    blow: Blow,
    /// The process.
    pid: Option<u32>,
}

/// The robot's line.
#[derive(Clone)]
struct Tapped {
    line: Arc<Mutex<Box<dyn ByteLink>>>,
    due: Arc<Mutex<Option<Due>>>,
    /// The beginning of the next frame.
    frame: Vec<u8>,
}

impl Tapped {
    /// What befalls the line when this frame is through.
    fn blow(&self, frame: &[u8]) -> Option<Due> {
        let mut frame = frame.to_vec();
        frame.pop();
        let message: ToDevice<'_> = decode(&mut frame).ok()?;
        let request = match message.request {
            Request::Within { request, .. } => postcard::from_bytes(request).ok()?,
            request => request,
        };
        (self.due.lock().unwrap()).take_if(|due| (due.request)(&request))
    }
}

impl ByteLink for Tapped {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.line.lock().unwrap().receive(buffer, timeout)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        for byte in bytes {
            self.frame.push(*byte);
            if *byte != DELIMITER {
                continue;
            }
            let frame = std::mem::take(&mut self.frame);
            let due = self.blow(&frame);
            self.line.lock().unwrap().send(&frame)?;
            match due.map(|due| (due.blow, due.pid)) {
                Some((Blow::CutBehind, _)) => return Err(io::ErrorKind::BrokenPipe.into()),
                Some((Blow::Signal(signal), Some(pid))) => {
                    kill(Pid::from_raw(pid as i32), signal).unwrap();
                }
                _ => {}
            }
        }
        Ok(())
    }
}

/// A robot at a port whose name stays when its line is cut.
struct Robot {
    tapped: Tapped,
    server: Option<PtyServer>,
    folder: tempfile::TempDir,
    _board: HostBoard,
}

impl Robot {
    fn start() -> Self {
        let world = World::parse("world cell\n start 1,1 0\n wall 0,0 3,0 3,3 0,3 0,0").unwrap();
        let plant = Plant::new(world, BodyParameters::default(), 1).unwrap();
        let plant = PlantSide::new(plant, Pace::new(true), None);
        let (board, line) = HostBoard::start(host_board::rover, plant, None).unwrap();
        let mut robot = Robot {
            tapped: Tapped {
                line: Arc::new(Mutex::new(Box::new(line))),
                due: Arc::default(),
                frame: Vec::new(),
            },
            server: None,
            folder: tempfile::tempdir().unwrap(),
            _board: board,
        };
        robot.plug_in();
        robot
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn plug_in(&mut self) {
        self.server = None;
        let server = PtyServer::start(Box::new(self.tapped.clone())).unwrap();
        let _ = std::fs::remove_file(self.path("port"));
        symlink(server.path(), self.path("port")).unwrap();
        self.server = Some(server);
    }

    /// The command, in the checkout; `{}` in its arguments stands for the robot's folder.
    fn command(&self, arguments: &str) -> Command {
        let folder = self.folder.path().to_str().unwrap();
        let mut command = Command::new(std::env::var_os("CARGO_BIN_EXE_esm").unwrap());
        command
            .current_dir("..")
            .args((arguments.split_whitespace()).map(|argument| argument.replace("{}", folder)))
            .env("XDG_CONFIG_HOME", folder)
            .env_remove("ESM_KEY")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    fn at_port(&self, arguments: &str) -> Command {
        let mut command = self.command(arguments);
        command.arg("--port").arg(self.path("port"));
        command.args(["--baud", BAUD]);
        command
    }

    /// Runs a command at the robot; it ends with this status. Answers what it says.
    #[track_caller]
    fn esm(&self, arguments: &str, status: i32) -> Said {
        Said::of(self.at_port(arguments).output().unwrap()).ended(arguments, status)
    }

    /// Runs a command that is about no robot.
    #[track_caller]
    fn esm_alone(&self, arguments: &str, status: i32) -> Said {
        Said::of(self.command(arguments).output().unwrap()).ended(arguments, status)
    }

    /// As [`Robot::esm`], and the first request of that kind brings a blow.
    #[track_caller]
    fn befallen(
        &mut self,
        arguments: &str,
        status: impl Into<Option<i32>>,
        blow: Blow,
        request: fn(&Request<'_>) -> bool,
    ) -> Said {
        let due = |pid| Due { request, blow, pid };
        *self.tapped.due.lock().unwrap() = Some(due(None));
        let child = self.at_port(arguments).spawn().unwrap();
        if let Some(due) = self.tapped.due.lock().unwrap().as_mut() {
            due.pid = Some(child.id());
        }
        let said = child.wait_with_output().unwrap();
        self.plug_in();
        assert!(self.tapped.due.lock().unwrap().is_none(), "nothing came");
        Said::of(said).ended(arguments, status)
    }

    fn status(&self) -> serde_json::Value {
        serde_json::from_str(&self.esm("status --json", 0).out).unwrap()
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
            out: String::from_utf8(output.stdout).unwrap(),
            err: String::from_utf8(output.stderr).unwrap(),
        }
    }

    #[track_caller]
    fn ended(self, arguments: &str, status: impl Into<Option<i32>>) -> Self {
        assert_eq!(self.status, status.into(), "esm {arguments}: {self:#?}");
        self
    }
}

const PATROL: &str = "missions/patrol.esm";
const FOLLOW_WALL: &str = "missions/follow_wall.esm";

/// A robot that drives, and the hash of its mission.
fn driving() -> (Robot, serde_json::Value) {
    let robot = Robot::start();
    robot.esm(&format!("upload {PATROL}"), 0);
    let mission = robot.status()["mission"].clone();
    (robot, mission)
}

#[test]
fn an_upload_whose_line_is_cut_on_the_way_leaves_the_robot_as_it_was_and_says_so() {
    let (mut robot, before) = driving();
    let upload = format!("upload {FOLLOW_WALL}");
    let said = robot.befallen(&upload, 3, Blow::CutBehind, |request| {
        matches!(request, Request::Chunk { .. })
    });
    assert!(said.err.contains("drives on with what it has"), "{said:#?}");
    let goes_on = said.err.contains("goes on where this one ended");
    assert!(goes_on, "{said:#?}");
    assert_eq!(robot.status()["mission"], before);
}

#[test]
fn an_upload_whose_line_is_cut_in_the_change_says_that_the_robot_may_have_changed_over() {
    let (mut robot, before) = driving();
    // The robot heard it all, and nobody heard the robot.
    let upload = format!("upload {FOLLOW_WALL} --trial 600s");
    let said = robot.befallen(&upload, 3, Blow::CutBehind, |request| {
        matches!(request, Request::Commit(_))
    });
    let is_sure = said.err.contains("drives on with what it has");
    assert!(!is_sure, "{said:#?}");
    for told in ["runs is not known", "600 s", "`esm status`", "on trial"] {
        assert!(said.err.contains(told), "{told}: {said:#?}");
    }
    let status = robot.status();
    assert_ne!(status["mission"], before);
    assert!(status["trial"].is_object(), "{status}");
}

#[test]
fn an_upload_whose_line_is_cut_in_the_trial_says_that_it_may_end_unconfirmed() {
    let (mut robot, _) = driving();
    let upload = format!("upload {FOLLOW_WALL}");
    let said = robot.befallen(&upload, 3, Blow::CutBehind, |request| {
        matches!(request, Request::Confirm { .. })
    });
    for told in ["not heard to be confirmed", "10 s", "`esm status`"] {
        assert!(said.err.contains(told), "{told}: {said:#?}");
    }
}

#[test]
fn a_mission_without_names_is_uploaded_and_told_by_numbers() {
    let (robot, before) = driving();
    robot.esm_alone("build missions/follow_wall.esm --strip -o {}/s.blob", 0);
    let said = robot.esm("upload {}/s.blob --json", 0);
    let uploaded: serde_json::Value = serde_json::from_str(&said.out).unwrap();
    assert_eq!(uploaded["confirmed"], true, "{said:#?}");
    let status = robot.status();
    assert_eq!(status["mission"], uploaded["hash"], "{status}");
    let active = status["active"].as_array().unwrap();
    let is_numbered = |path: &serde_json::Value| {
        let path = path.as_str().unwrap();
        path.starts_with("region") && path.contains("/State")
    };
    assert!(!active.is_empty() && active.iter().all(is_numbered));

    // Who counts on its names hears of it before anything is sent.
    let said = robot.esm("upload {}/s.blob --record {}/r.rec", 1);
    let told = said.err.contains("s.blob was built without names");
    assert!(told && said.err.contains("--record"), "{said:#?}");
    assert!(!robot.path("r.rec").exists());
    let said = robot.esm(&format!("upload {PATROL} --warm"), 0);
    let told = said.err.contains("the mission that runs has no names");
    assert!(told && said.err.contains("all begins anew"), "{said:#?}");
    assert_eq!(robot.status()["mission"], before);
    let said = robot.esm("upload {}/s.blob --warm --diff", 0);
    assert!(said.err.contains("s.blob has no names"), "{said:#?}");
}

#[test]
fn a_run_of_a_mission_without_names_is_that_of_its_source_with_numbers_for_names() {
    let robot = Robot::start();
    robot.esm_alone("build missions/patrol.esm --strip -o {}/s.blob", 0);
    let source = robot.esm_alone("inspect {}/s.blob --esm", 0).out;
    std::fs::write(robot.path("numbered.esm"), source).unwrap();
    for file in ["s.blob", "numbered.esm"] {
        let run = format!(
            "run {{}}/{file} --board host --world office --until 20s --trace {{}}/{file}.jsonl"
        );
        robot.esm_alone(&run, 0);
    }
    let trace = |file: &str| std::fs::read_to_string(robot.path(file)).unwrap();
    let (numbered, stripped) = (trace("numbered.esm.jsonl"), trace("s.blob.jsonl"));
    assert!(stripped.contains("region1/State1"), "{stripped}");
    assert_eq!(stripped.lines().count(), numbered.lines().count());
    for (stripped, numbered) in stripped.lines().zip(numbered.lines()) {
        assert_eq!(stripped, numbered);
    }
    let record = "run {}/s.blob --board host --until 1s --record {}/r.rec";
    let said = robot.esm_alone(record, 1);
    assert!(
        said.err.contains("s.blob was built without names"),
        "{said:#?}"
    );
    assert!(!robot.path("r.rec").exists());
}

#[test]
fn the_key_of_the_environment_is_made_and_shown_and_hinders_nobody() {
    let robot = Robot::start();
    let key = robot.path("folder/env.key");
    let with_key = |mut command: Command| Said::of(command.env("ESM_KEY", &key).output().unwrap());
    let missing = with_key(robot.command("key show")).ended("key show", 3);
    let makes = format!("`esm key new -o {}` makes it", key.display());
    assert!(missing.err.contains(&makes), "{missing:#?}");

    let made = with_key(robot.command("key new")).ended("key new", 0);
    assert!(made.out.contains(key.to_str().unwrap()), "{made:#?}");
    let shown = with_key(robot.command("key show")).ended("key show", 0);
    assert!(made.out.contains(shown.out.trim()), "{shown:#?}");
    let made = with_key(robot.command("key new -o {}/other.key")).ended("key new -o", 0);
    assert!(made.out.contains("other.key"), "{made:#?}");

    let shown = with_key(robot.at_port("key show")).ended("key show --port", 0);
    assert_eq!(shown.out, "the robot has no key\n");
    let both = with_key(robot.at_port("key show --key {}/other.key"));
    assert!(
        both.ended("key show --key --port", 2)
            .err
            .contains("leave out")
    );
}

/// What a replay says of a recording, which must be one.
fn replayed(robot: &Robot, file: &str) -> serde_json::Value {
    let said = robot.esm_alone(&format!("replay {{}}/{file} --json"), 0);
    serde_json::from_str(&said.out).unwrap()
}

#[test]
fn a_recorded_upload_that_is_interrupted_is_recorded_to_its_end() {
    let (mut robot, before) = driving();
    let upload = format!("upload {FOLLOW_WALL} --record {{}}/r.rec");
    for (what, request) in [
        (
            "sent",
            (|request| matches!(request, Request::Chunk { .. })) as fn(&Request<'_>) -> bool,
        ),
        ("on trial", |request| matches!(request, Request::Commit(_))),
    ] {
        let said = robot.befallen(&upload, 3, Blow::Signal(Signal::SIGINT), request);
        assert!(said.err.contains("interrupted"), "{what}: {said:#?}");
        let replayed = replayed(&robot, "r.rec");
        assert_eq!(replayed["file"], "whole", "{what}");
        let checks = replayed["checks"].as_u64().unwrap();
        assert!(checks > 0, "{what}: the end was not compared: {replayed}");
        assert_eq!(robot.status()["mission"], before, "{what}");
        std::fs::remove_file(robot.path("r.rec")).unwrap();
    }
}

#[test]
fn a_recorded_upload_that_is_killed_leaves_a_recording_that_can_be_read() {
    let (mut robot, _) = driving();
    let upload = format!("upload {FOLLOW_WALL} --record {{}}/r.rec");
    robot.befallen(&upload, None, Blow::Signal(Signal::SIGKILL), |request| {
        matches!(request, Request::Chunk { .. })
    });
    let replayed = replayed(&robot, "r.rec");
    assert!(replayed["error"].is_null(), "{replayed}");
}

#[test]
fn a_robot_at_a_port_is_recorded_with_the_values_on_its_nets() {
    let (robot, before) = driving();
    let record = "record --until 2s --sample 20ms -o {}/d.mcap --record {}/d.rec --json";
    let told: serde_json::Value = serde_json::from_str(&robot.esm(record, 0).out).unwrap();
    let channels = told["channels"].as_array().unwrap();
    let pose = |it: &&serde_json::Value| it["schema"] == "foxglove.PoseInFrame";
    let poses = channels.iter().find(pose).unwrap()["messages"].as_u64();
    // A robot on a busy machine tells less than all hundred.
    assert!(poses > Some(20), "{told}");
    assert_eq!(replayed(&robot, "d.rec")["file"], "whole");
    let plotted = robot.esm_alone("plot {}/d.rec -o {}/d.svg --json", 0);
    let plotted: serde_json::Value = serde_json::from_str(&plotted.out).unwrap();
    assert_eq!(plotted["samples"].as_u64(), poses, "{plotted}");
    assert_eq!(robot.status()["mission"], before);
}

#[test]
fn commands_at_a_robot_that_stands_still_or_runs_say_what_it_does_then() {
    let (robot, before) = driving();
    let steps = |robot: &Robot| robot.status()["steps"].as_u64().unwrap();
    let made = steps(&robot);
    let said = robot.esm("start", 0);
    assert_eq!(
        said.out,
        "the mission runs already, and goes on as it was\n"
    );
    assert!(steps(&robot) > made, "it began anew");

    let trial = format!("upload {FOLLOW_WALL} --trial 600s");
    for (stop, start, told) in [
        ("stop", "start", "it is stopped: `esm start`"),
        (
            "stop --emergency",
            "start --release",
            "an emergency stop is latched",
        ),
    ] {
        robot.esm(&trial, 0);
        robot.esm(stop, 0);
        let said = robot.esm("fallback", 0).out;
        let mission = before.as_str().unwrap();
        let is_again = said.contains(&format!("{mission} is its mission again"));
        assert!(is_again && said.contains(told), "{stop}: {said}");
        assert!(!said.contains("runs again"), "{stop}: {said}");
        let said = robot.esm(start, 0).out;
        assert_eq!(said, "started: the mission runs from its beginning\n");
    }
}

#[test]
fn status_names_the_mission_and_a_comparison_with_none_is_an_object() {
    let robot = Robot::start();
    assert!(robot.status()["machine"].is_null());
    let said = robot.esm(&format!("upload {PATROL} --diff --json"), 0);
    let compared: serde_json::Value = serde_json::from_str(&said.out).unwrap();
    let nothing = serde_json::json!({"changes": null, "carry_over": null});
    assert_eq!(compared, nothing);

    robot.esm(&format!("upload {PATROL}"), 0);
    let status = robot.status();
    assert_eq!(status["machine"], "Patrol");
    let named = format!("Patrol ({})", status["mission"].as_str().unwrap());
    let said = robot.esm("status", 0).out;
    assert!(said.contains(&named), "{said}");
}
