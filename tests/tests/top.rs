//! `esm top` against a robot on a serial line: what it tells once, and its screen on a terminal.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::process::Command;
use std::time::{Duration, Instant};

use esm_tests::command::{Robot, esm_binary, root};
use esm_tests::terminal::Session;

/// How long it may take until the rates are known well.
const PATIENCE: Duration = Duration::from_secs(120);

fn running_patrol() -> Robot {
    let robot = Robot::start("host", None);
    robot.esm(&["upload", "missions/patrol.esm"]).good();
    robot.status_when("half a second of patrol", |status| {
        status["t_us"].as_u64() > Some(500_000)
    });
    robot
}

/// A slot whose rate is far from that of its period, in words.
fn odd_rate(told: &serde_json::Value) -> Option<String> {
    told["slots"].as_array().unwrap().iter().find_map(|slot| {
        let rate_hz = slot["rate_hz"].as_f64().unwrap();
        let nominal_hz = 1e9 / slot["period_ns"].as_f64().unwrap();
        let is_odd = !(nominal_hz * 0.8..nominal_hz * 1.2).contains(&rate_hz);
        is_odd.then(|| format!("{rate_hz} Hz in {told:#}"))
    })
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
        (2, 10_000_000),
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
    }
    // When each slot was asked for is known the better the longer the robot drives.
    let deadline = Instant::now() + PATIENCE;
    let mut told = told;
    while let Some(odd) = odd_rate(&told) {
        assert!(Instant::now() < deadline, "{odd}");
        told = robot.esm(&["top", "--json"]).good().json();
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
fn on_a_terminal(robot: &Robot) -> Session {
    let mut command = Command::new(esm_binary());
    command
        .current_dir(root())
        .args(["top", "--interval", "100 ms", "--port", robot.port()]);
    Session::start(&mut command)
}

#[test]
fn the_screen_follows_the_robot_and_the_keys_and_the_terminal_is_given_back() {
    let robot = running_patrol();
    let mut session = on_a_terminal(&robot);
    session.wait_for("Patrol");
    session.press(b"\x1b[B"); // the arrow down, to slot 2
    session.wait_for("(Odometry):");
    session.press(b"r");
    session.wait_for("counted");
    session.press(b"p");
    session.wait_for("paused");
    assert!(!session.is_as_before(), "it reads keys one by one");
    session.press(b"q");
    session.ends_well("q");

    let mut session = on_a_terminal(&robot);
    session.wait_for("Patrol");
    session.press(b"\x03");
    session.ends_well("Ctrl-C");

    let mut session = on_a_terminal(&robot);
    session.wait_for("Patrol");
    session.terminate();
    session.ends_well("SIGTERM");
}

#[test]
fn a_robot_that_goes_is_looked_for_and_the_screen_stays() {
    let robot = running_patrol();
    let mut session = on_a_terminal(&robot);
    session.wait_for("Patrol");
    assert_eq!(robot.end(), Some(0));
    session.wait_for("answer");
    session.press(b"q");
    session.ends_well("q without a robot");
}
