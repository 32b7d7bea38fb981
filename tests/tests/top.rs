//! `esm top` against a robot on a serial line: what it tells once, and its screen on a terminal.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fs::{File, OpenOptions};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

use esm_tests::command::{Robot, esm_binary, root};
use host_tools::serial::ByteLink;
use host_tools::serial::pipe::{self, PipeEnd};
use host_tools::serial::pty::PtyServer;

/// How long the command may take to show something, or to end.
const PATIENCE: Duration = Duration::from_secs(20);
/// What a terminal is told to give back the screen that it had before.
const LEAVE_SCREEN: &str = "\x1b[?1049l";

fn running_patrol() -> Robot {
    let robot = Robot::start("host", None);
    robot.esm(&["upload", "missions/patrol.esm"]).good();
    robot.status_when("half a second of patrol", |status| {
        status["t_us"].as_u64() > Some(500_000)
    });
    robot
}

#[test]
fn what_it_tells_once_is_what_the_robot_counted() {
    let robot = running_patrol();
    let counted = |status: &serde_json::Value| -> Vec<u64> {
        let slots = status["slots"].as_array().unwrap();
        let counts = slots.iter().map(|slot| slot["executed"].as_u64().unwrap());
        counts.collect()
    };
    let before = robot.status();
    let told = robot.esm(&["top", "--json"]).good().json();
    let after = robot.status();
    assert_eq!(told["machine"], "Patrol");
    for key in ["board", "firmware", "mode", "mission", "last_reset"] {
        assert_eq!(told[key], before[key], "{key}");
    }
    let counts = [&before, &told, &after].map(counted);
    let [low, middle, high] = &counts;
    assert!(!middle.is_empty());
    for ((low, middle), high) in low.iter().zip(middle).zip(high) {
        assert!(low <= middle && middle <= high, "{counts:?}");
    }
    for (slot, (number, period_ns)) in told["slots"].as_array().unwrap().iter().zip([
        (1, 20_000_000),
        (2, 20_000_000),
        (3, 40_000_000_u64),
    ]) {
        assert_eq!(slot["slot"], number);
        assert_eq!(slot["period_ns"], period_ns);
        let delays = slot["delays"].as_array().unwrap();
        let counts = delays
            .iter()
            .map(|bucket| bucket["count"].as_u64().unwrap());
        assert_eq!(counts.sum::<u64>(), slot["executed"].as_u64().unwrap());
        assert_eq!(delays.last().unwrap()["below_ns"], serde_json::Value::Null);
        let rate_hz = slot["rate_hz"].as_f64().unwrap();
        let nominal_hz = 1e9 / period_ns as f64;
        assert!(
            rate_hz > nominal_hz * 0.8 && rate_hz < nominal_hz * 1.2,
            "slot {number}: {rate_hz} Hz"
        );
    }
    let tasks = |slot: &serde_json::Value| slot["tasks"].as_array().unwrap().len();
    let of_slots: usize = told["slots"].as_array().unwrap().iter().map(tasks).sum();
    assert!(of_slots > 3, "{told:#}");

    // Standard output is a file here, so that `--once` changes nothing.
    for arguments in [&["top", "--once"][..], &["top"]] {
        let table = robot.esm(arguments).good().out;
        for words in [
            "mission Patrol",
            "overruns",
            "slot 2",
            "(Odometry): enabled",
        ] {
            assert!(
                table.contains(words),
                "{arguments:?}: `{words}` in\n{table}"
            );
        }
        assert!(!table.contains('\x1b'), "{arguments:?}: {table:?}");
    }
}

#[test]
fn a_robot_without_a_mission_and_a_port_without_a_robot_are_told_apart() {
    let robot = Robot::start("host", None);
    let told = robot.esm(&["top", "--json"]).good().json();
    assert_eq!(told["mode"], "empty");
    assert_eq!(told["slots"], serde_json::json!([]));
    assert!(robot.esm(&["top"]).good().out.contains("no mission"));
    let done = esm_tests::command::esm(&["top", "--port", "/no/such/port"]);
    assert_eq!(done.status, Some(3), "{done:#?}");
    assert!(done.err.contains("/no/such/port"), "{done:#?}");
}

/// `esm top` on a terminal of its own.
struct Session {
    child: Child,
    terminal: PtyServer,
    /// A terminal that nobody has open forgets what was last written to it.
    _open: File,
    /// The keyboard, and what is shown.
    far: PipeEnd,
    shown: String,
    /// How the terminal was set before.
    settings: String,
}

impl Session {
    fn start(robot: &Robot) -> Self {
        let (near, far) = pipe::pair();
        let terminal = PtyServer::start(Box::new(near)).unwrap();
        let path = terminal.path().to_str().unwrap().to_owned();
        stty(&path, &["sane", "rows", "30", "cols", "120"]);
        let settings = stty(&path, &["-g"]);
        let open = || {
            let mut options = OpenOptions::new();
            options.read(true).write(true).open(&path).unwrap()
        };
        let child = Command::new(esm_binary())
            .current_dir(root())
            .args(["top", "--interval", "100 ms", "--port", robot.port()])
            .env("TERM", "xterm-256color")
            .env_remove("NO_COLOR")
            .stdin(open())
            .stdout(open())
            .spawn()
            .unwrap();
        Session {
            child,
            _open: open(),
            terminal,
            far,
            shown: String::new(),
            settings,
        }
    }

    /// Waits until a word has been shown since the last call. Blanks are moved over and not shown, so that it is one word.
    #[track_caller]
    fn wait_for(&mut self, word: &str) {
        let deadline = Instant::now() + PATIENCE;
        while !self.shown.contains(word) {
            assert!(
                Instant::now() < deadline,
                "`{word}` was not shown: {:?}",
                self.shown
            );
            self.look();
        }
        self.shown.clear();
    }

    fn look(&mut self) {
        let mut bytes = [0; 4096];
        let count = self.far.receive(&mut bytes, Duration::from_millis(50));
        let count = count.unwrap();
        self.shown
            .push_str(&String::from_utf8_lossy(&bytes[..count]));
    }

    fn press(&mut self, keys: &[u8]) {
        self.far.send(keys).unwrap();
    }

    /// Waits for the command's good end, and looks whether the terminal is as it was.
    #[track_caller]
    fn ends_well(mut self, what: &str) {
        let deadline = Instant::now() + PATIENCE;
        let status = loop {
            self.look();
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            assert!(Instant::now() < deadline, "{what}: it does not end");
        };
        while !self.shown.contains(LEAVE_SCREEN) && Instant::now() < deadline {
            self.look();
        }
        assert_eq!(status.code(), Some(0), "{what}: {:?}", self.shown);
        assert!(
            self.shown.contains(LEAVE_SCREEN),
            "{what}: {:?}",
            self.shown
        );
        let path = self.terminal.path().to_str().unwrap();
        assert_eq!(stty(path, &["-g"]), self.settings, "{what}");
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Sets a terminal, or asks how it is set.
fn stty(path: &str, arguments: &[&str]) -> String {
    let done = Command::new("stty")
        .args(["-F", path])
        .args(arguments)
        .output()
        .unwrap();
    assert!(done.status.success(), "{done:?}");
    String::from_utf8(done.stdout).unwrap()
}

#[test]
fn the_screen_follows_the_robot_and_the_keys_and_the_terminal_is_given_back() {
    let robot = running_patrol();
    let mut session = Session::start(&robot);
    session.wait_for("Patrol");
    session.press(b"\x1b[B"); // the arrow down, to slot 2
    session.wait_for("(Odometry):");
    session.press(b"r");
    session.wait_for("counted");
    session.press(b"p");
    session.wait_for("paused");
    assert_ne!(
        stty(session.terminal.path().to_str().unwrap(), &["-g"]),
        session.settings,
        "it reads keys one by one"
    );
    session.press(b"q");
    session.ends_well("q");

    let mut session = Session::start(&robot);
    session.wait_for("Patrol");
    session.press(b"\x03");
    session.ends_well("Ctrl-C");

    let mut session = Session::start(&robot);
    session.wait_for("Patrol");
    let id = session.child.id().to_string();
    assert!(Command::new("kill").arg(&id).status().unwrap().success());
    session.ends_well("SIGTERM");
}

#[test]
fn a_robot_that_goes_is_looked_for_and_the_screen_stays() {
    let robot = running_patrol();
    let mut session = Session::start(&robot);
    session.wait_for("Patrol");
    assert_eq!(robot.end(), Some(0));
    session.wait_for("answer");
    session.press(b"q");
    session.ends_well("q without a robot");
}
