//! Parameters of a mission that runs in the emulator: changed between two macro steps, within the
//! firmware's bounds, and kept over resets and losses of power. Those of the link's monitor stop a
//! robot that nobody calls, whatever its mission makes of it.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::path::Path;
use std::time::Duration;

use esm_tests::command::{Done, Robot, esm, firmware};
use serde_json::Value;

/// A robot whose flash is this file.
fn robot_with(flash: &Path) -> Robot {
    let arguments = ["--flash", flash.to_str().unwrap()];
    Robot::start_with("lm3s6965", None, &arguments)
}

/// What `esm param get` says of a parameter.
#[track_caller]
fn param(robot: &Robot, name: &str) -> Value {
    robot.esm(&["param", "get", name, "--json"]).good().json()
}

/// Looks at a robot after a silence that is long enough for it to stop, and after longer ones where
/// it has got no processor meanwhile.
#[track_caller]
fn assert_stops_in_silence(robot: &Robot) {
    const LONGEST: Duration = Duration::from_secs(60);
    let mut silence = Duration::from_millis(1_500);
    loop {
        std::thread::sleep(silence);
        let status = robot.status();
        if status["mode"] == "safe" {
            let why = status["safe_reason"].as_str().unwrap();
            assert!(why.contains("the host has not called"), "{why}");
            return;
        }
        silence *= 2;
        assert!(silence < LONGEST, "it does not stop: {status:#}");
    }
}

/// A mission that watches the link and does what `region` says about it.
fn watching(folder: &Path, region: &str) -> String {
    let path = folder.join("watching.esm");
    let text = format!(
        "interpreter slot 1; slot 1 period 20 ms duration 2 ms; slot 3 period 40 ms duration 2 ms;
         task LinkMonitor slot 3 wcet 100 us {{ out flag warn; out flag slow; out flag stop;
             param warn_ms: u32 = 500 min 50 max 60000; param slow_ms: u32 = 1000 min 50 max 60000;
             param stop_ms: u32 = 2000 min 50 max 60000; }}
         machine Watching {{ region lead {{ {region} }} }}"
    );
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

/// It never looks at what the monitor says.
const DEAF: &str = "task Watch: LinkMonitor; initial -> Watch; Watch -> Watch on *;";
const STOP_MS: &str = "lead/Watch.stop_ms";
/// The same, with a host that is never silent for too long by chance.
const PATIENT: &str =
    "task Watch: LinkMonitor with { stop_ms = 60000 }; initial -> Watch; Watch -> Watch on *;";

#[test]
fn a_parameter_is_changed_while_the_mission_runs_and_kept_over_a_reset_once_it_is_saved() {
    let folder = tempfile::tempdir().unwrap();
    let flash = folder.path().join("flash");
    let mission = watching(folder.path(), PATIENT);
    let set = |robot: &Robot, value: &str| robot.esm(&["param", "set", STOP_MS, value]);
    {
        let robot = robot_with(&flash);
        robot.esm(&["upload", &mission]).good();
        let before = robot.status();
        let told = robot.esm(&["param", "set", STOP_MS, "50000", "--json"]);
        let told = told.good().json();
        assert_eq!(
            (&told["before"], &told["value"]),
            (&60_000.into(), &50_000.into())
        );
        // The machine goes on as it was, and no slot waits.
        let status = robot.status();
        assert_eq!(status["mission"], before["mission"], "{status:#}");
        assert!(
            status["steps"].as_u64() > before["steps"].as_u64(),
            "{status:#}"
        );
        assert_eq!(status["slots_missed"], 0, "{status:#}");
        assert_eq!(status["changed_params"], 1, "{status:#}");
        for refused in ["49", "60001", "4294967295"] {
            let done = set(&robot, refused).ended(1);
            assert!(
                done.err.contains("50") && done.err.contains("60000"),
                "{done:#?}"
            );
        }
        set(&robot, "-1").ended(1);
        let told = param(&robot, STOP_MS);
        assert_eq!(told["value"], 50_000, "{told:#}");
        assert_eq!(told["saved"], Value::Null, "{told:#}");
        set(&robot, "1000").good();
        robot.esm(&["param", "save"]).good();
        // The task has it.
        assert_stops_in_silence(&robot);
        // What is set after that is not saved.
        set(&robot, "40000").good();
        let told = param(&robot, STOP_MS);
        assert_eq!(
            (&told["value"], &told["saved"]),
            (&40_000.into(), &1_000.into())
        );
        robot.esm(&["start"]).good();
        assert_eq!(robot.status()["mode"], "running");
    }
    let robot = robot_with(&flash);
    let status = robot.status_when("the mission", |status| status["steps"].as_u64() > Some(10));
    assert_eq!(status["saved_params"], 1, "{status:#}");
    let told = param(&robot, STOP_MS);
    assert_eq!(
        (&told["value"], &told["of_mission"]),
        (&1_000.into(), &60_000.into())
    );
    // The task has it, too.
    assert_stops_in_silence(&robot);
}

#[test]
fn a_saved_parameter_is_there_after_the_watchdog_has_reset_the_board() {
    let folder = tempfile::tempdir().unwrap();
    let mission = folder.path().join("mission.esm");
    let text = "interpreter slot 1; slot 1 period 20 ms duration 2 ms; slot 2 period 20 ms duration 4 ms;
         task Overrun slot 2 { param duration_us: u32 = 20000 min 0 max 250000; }
         task NeverReturn slot 2 {}
         machine M { region r { state Quiet timeout 10 s; task Fatal: NeverReturn; initial -> Quiet; Quiet -> Fatal [timeout]; }
             region s { state Before timeout 60 s; task A: Overrun with { duration_us = 10 }; initial -> Before; Before -> A [timeout]; } }";
    std::fs::write(&mission, text).unwrap();
    let robot = Robot::start("lm3s6965", Some(&firmware("faults")));
    // A robot that is stopped does not begin before it is told to.
    robot.esm(&["stop"]).good();
    robot.give(&mission);
    robot.esm(&["param", "set", "s/A.duration_us", "20"]).good();
    robot.esm(&["param", "save"]).good();
    robot.esm(&["start"]).good();
    // It hangs again after each start, and is refused after three: ten seconds before each give a
    // busy machine the time to look in between.
    let status = robot.status_when("the reset", |status| status["last_reset"] == "watchdog");
    assert_eq!(status["saved_params"], 1, "{status:#}");
    let told = param(&robot, "s/A.duration_us");
    assert_eq!(
        (&told["value"], &told["of_mission"]),
        (&20.into(), &10.into())
    );
}

/// Missions that make nothing of the monitor's flags, or try to get around it.
const EVADING: [(&str, &str); 4] = [
    ("never looks", DEAF),
    (
        "enters its state anew in each macro step",
        "task Watch: LinkMonitor; initial -> Watch; Watch -> Watch [not .stop]; Watch -> Watch [.stop];",
    ),
    (
        "leaves it as soon as it says stop, and comes back",
        "task Watch: LinkMonitor; state Away timeout 100 ms; initial -> Watch; Watch -> Away [.stop]; Away -> Watch [timeout];",
    ),
    (
        "is there for a moment only, now and then",
        "task Watch: LinkMonitor timeout 40 ms; state Away timeout 200 ms; initial -> Watch; Watch -> Away [timeout]; Away -> Watch [timeout];",
    ),
];

#[test]
fn a_mission_does_not_get_around_the_last_stage_of_a_lost_link() {
    let folder = tempfile::tempdir().unwrap();
    for board in ["lm3s6965", "host"] {
        for (what, region) in EVADING {
            let mission = watching(folder.path(), region);
            let elf = firmware("rover");
            let run = ["run", &mission, "--board", board, "--firmware"];
            let cut = [elf.to_str().unwrap(), "--cut-link", "1 s", "--until", "6 s"];
            let done: Done = esm(&[&run[..], &cut].concat()).ended(1);
            let why = "the host has not called for too long";
            assert!(done.err.contains(why), "{board}, {what}: {done:#?}");
            let line = done.out.lines().find(|line| line.contains("motors off"));
            let line = line.unwrap_or_else(|| panic!("{board}, {what}: {done:#?}"));
            let at_s: f64 = line.split_whitespace().next().unwrap().parse().unwrap();
            // 2 s after the last call, which came at most 0.3 s before the cut, and the second time
            // after that that the monitor is asked.
            assert!((2.7..3.6).contains(&at_s), "{board}, {what}: {done:#?}");
        }
    }
}
