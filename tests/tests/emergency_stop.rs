//! The emergency stop of a robot that is emulated or on the host: its latch over a loss of power,
//! and its button.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::path::Path;

use esm_tests::command::{Done, Robot, esm, firmware};

/// A robot whose flash is this file.
fn robot_with(flash: &Path) -> Robot {
    let arguments = ["--flash", flash.to_str().unwrap()];
    Robot::start_with("lm3s6965", None, &arguments)
}

#[test]
fn an_emergency_stop_is_latched_over_losses_of_power_until_it_is_released() {
    let folder = tempfile::tempdir().unwrap();
    let flash = folder.path().join("flash");
    let robot = robot_with(&flash);
    robot.esm(&["upload", "missions/patrol.esm"]).good();
    robot.esm(&["stop", "--emergency"]).good();
    drop(robot);
    for _ in 0..2 {
        // What was in RAM is gone.
        let robot = robot_with(&flash);
        let status = robot.status_when("the mission", |status| !status["mission"].is_null());
        assert_eq!(status["last_reset"], "power on", "{status:#}");
        assert_eq!(status["mode"], "emergency stop", "{status:#}");
        assert_eq!(status["stop_pressed"], false, "{status:#}");
        assert_eq!(status["steps"], 0, "{status:#}");
        let refused = robot.esm(&["start"]).ended(1).err;
        assert!(refused.contains("esm start --release"), "{refused}");
        let written = robot.esm(&["blackbox"]).good().out;
        assert!(written.contains("emergency stop"), "{written}");
    }
    let robot = robot_with(&flash);
    robot.esm(&["start", "--release"]).good();
    robot.status_when("patrol", |status| status["steps"].as_u64() > Some(10));
    drop(robot);
    let robot = robot_with(&flash);
    let status = robot.status_when("patrol", |status| status["steps"].as_u64() > Some(10));
    assert_eq!(status["mode"], "running", "{status:#}");
}

/// When the button is pressed.
const PRESSED_S: f64 = 2.0;

/// Drives a mission whose button is pressed, on a board.
fn pressed(board: &str, mission: &str, more: &[&str]) -> Done {
    let elf = firmware("rover");
    let run = ["run", mission, "--board", board, "--estop", "2 s"];
    let until = ["--until", "4 s", "--firmware", elf.to_str().unwrap()];
    esm(&[&run[..], &until, more].concat()).ended(1)
}

/// The time in a line of a run's story that has these words.
#[track_caller]
fn time_of(done: &Done, words: &str) -> f64 {
    let line = done.out.lines().find(|line| line.contains(words));
    let line = line.unwrap_or_else(|| panic!("`{words}` is missing: {done:#?}"));
    line.split_whitespace().next().unwrap().parse().unwrap()
}

#[test]
fn the_button_stops_the_robot_at_once_whatever_its_mission_does_and_without_a_host() {
    let folder = tempfile::tempdir().unwrap();
    let mut traces = Vec::new();
    for board in ["lm3s6965", "host", "lm3s6965"] {
        let trace = folder.path().join(format!("{}.jsonl", traces.len()));
        // A mission that has no state for it; and nobody calls a robot that has its mission.
        let more = ["--trace", trace.to_str().unwrap()];
        let done = pressed(board, "missions/patrol.esm", &more);
        let why = "the emergency stop's button is pressed";
        assert!(done.err.contains(why), "{board}: {done:#?}");
        // Told with the time of the macro step that did not come.
        let late_s = time_of(&done, "motors off: an emergency stop") - PRESSED_S;
        assert!((0.0..=0.04).contains(&late_s), "{board}: {done:#?}");
        traces.push(std::fs::read_to_string(trace).unwrap());
    }
    let [first, on_host, again] = &traces[..] else {
        panic!("three runs")
    };
    assert!(first.contains("\"t_us\":2000000"));
    assert!(
        !first.contains("\"t_us\":2040000"),
        "the machine stops, too"
    );
    assert!(first == on_host, "emulator and host differ");
    assert!(first == again, "two runs in the emulator differ");
}

#[test]
fn a_stop_by_the_button_outlasts_a_loss_of_power() {
    let folder = tempfile::tempdir().unwrap();
    let flash = folder.path().join("flash");
    let kept = ["--flash", flash.to_str().unwrap()];
    pressed("lm3s6965", "missions/patrol.esm", &kept);
    // Switched on again, with a button that was let go of.
    let robot = robot_with(&flash);
    let status = robot.status_when("the mission", |status| !status["mission"].is_null());
    assert_eq!(status["mode"], "emergency stop", "{status:#}");
    assert_eq!(status["stop_pressed"], false, "{status:#}");
    robot.esm(&["start", "--release"]).good();
    robot.status_when("patrol", |status| status["steps"].as_u64() > Some(10));
}

#[test]
fn the_button_under_the_enter_key_stops_a_robot_until_it_is_up_and_released() {
    let mut robot = Robot::start_with("host", None, &["--estop"]);
    robot.esm(&["upload", "missions/patrol.esm"]).good();
    robot.press_enter();
    robot.status_when("the stop", |status| {
        status["mode"] == "emergency stop" && status["stop_pressed"] == true
    });
    let refused = robot.esm(&["start", "--release"]).ended(1).err;
    assert!(refused.contains("still pressed"), "{refused}");
    assert!(refused.contains("let go of it"), "{refused}");
    robot.press_enter();
    robot.status_when("the button", |status| status["stop_pressed"] == false);
    let refused = robot.esm(&["start"]).ended(1).err;
    assert!(refused.contains("`esm start --release`"), "{refused}");
    robot.esm(&["start", "--release"]).good();
    robot.status_when("patrol", |status| status["steps"].as_u64() > Some(10));
}
