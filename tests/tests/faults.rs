//! Planted faults on the emulated board: each shows in the robot's own counters with its exact
//! number, and ends in the safe state where it must.
//!
//! The firmware `faults` has tasks that misbehave once, in the first step after their state is
//! entered.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::path::PathBuf;

use rt_firmware::supervision::BACKGROUND_BOUND_US;
use tempfile::TempDir;

use esm_tests::command::{Robot, esm, firmware};

const HEAD: &str = "interpreter slot 1;
slot 1 period 20 ms duration 2 ms;
slot 2 period 20 ms duration 4 ms;
slot 3 period 40 ms duration 2 ms;
task Overrun slot 2 { param duration_us: u32 = 20000 min 0 max 250000; }
task MaskInterrupts slot 0 { param duration_us: u32 = 20000 min 0 max 250000; }
task NeverReturn slot 2 {}
task NeverReturnInBackground slot 0 {}
task Panic slot 2 {}
task Undefined slot 2 {}
task DeepStack slot 2 {}
";

/// A robot with the firmware `faults` that runs a machine with one region, which starts in `Quiet`
/// and goes on after a second.
fn robot_with(states: &str) -> Robot {
    let robot = Robot::start("lm3s6965", Some(&firmware("faults")));
    upload(&robot, states);
    robot
}

/// Without a trial, in which a fault may be the end of the mission and not of the drive, and which
/// would be over sooner or later.
fn upload(robot: &Robot, states: &str) {
    let (_folder, path) = mission(states);
    robot.give(&path);
}

fn mission(states: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mission.esm");
    let machine = format!(
        "{HEAD}machine M {{ region r {{ state Quiet timeout 1 s; initial -> Quiet; {states} }} }}"
    );
    std::fs::write(&path, machine).unwrap();
    (folder, path)
}

/// What the counters must say, after the state behind `Quiet` has been current for a while.
struct Counted {
    what: &'static str,
    states: &'static str,
    overruns: u64,
    missed: u64,
}

const COUNTED: &[Counted] = &[
    Counted {
        what: "nothing",
        states: "state After; Quiet -> After [timeout];",
        overruns: 0,
        missed: 0,
    },
    Counted {
        what: "an overrun that ends before the next slot",
        states: "task After: Overrun with { duration_us = 6000 }; Quiet -> After [timeout];",
        overruns: 1,
        missed: 0,
    },
    Counted {
        // From 2 ms after a start of slot 1 to 24 ms later: slot 1 is late once, within its period.
        what: "an overrun that makes another slot late",
        states: "task After: Overrun with { duration_us = 24000 }; Quiet -> After [timeout];",
        overruns: 1,
        missed: 0,
    },
    Counted {
        // 42 ms: the next activations of slots 1 and 2 find no start within their period, those
        // after them do. So does slot 3, at whichever of the interpreter's activations the mission
        // began.
        what: "an overrun over two periods",
        states: "task After: Overrun with { duration_us = 42000 }; Quiet -> After [timeout];",
        overruns: 1,
        missed: 2,
    },
    Counted {
        what: "interrupts masked for two periods",
        states: "task After: MaskInterrupts with { duration_us = 40000 }; Quiet -> After [timeout];",
        overruns: 0,
        missed: 2,
    },
    Counted {
        what: "two overruns, one after the other",
        states: "task One: Overrun timeout 100 ms with { duration_us = 6000 };
                 task After: Overrun with { duration_us = 7000 };
                 Quiet -> One [timeout]; One -> After [timeout];",
        overruns: 2,
        missed: 0,
    },
];

#[test]
fn counters_have_the_exact_number_of_faults_and_the_robot_goes_on() {
    let robot = robot_with(COUNTED[0].states);
    let (mut overruns, mut missed) = (0, 0);
    for case in COUNTED {
        upload(&robot, case.states);
        let status = robot.status_when(case.what, |status| {
            status["t_us"].as_u64() > Some(1_500_000)
                && status["active"]
                    .as_array()
                    .unwrap()
                    .contains(&"r/After".into())
        });
        // Counted since the robot started, over all missions.
        overruns += case.overruns;
        missed += case.missed;
        assert_eq!(status["overruns"], overruns, "{}: {status:#}", case.what);
        assert_eq!(status["slots_missed"], missed, "{}: {status:#}", case.what);
        assert_eq!(status["mode"], "running", "{}: {status:#}", case.what);
        let of_slots: u64 = status["slots"]
            .as_array()
            .unwrap()
            .iter()
            .map(|slot| slot["missed"].as_u64().unwrap())
            .sum();
        assert_eq!(of_slots, case.missed, "{}: {status:#}", case.what);
    }
}

#[path = "../../boards/lm3s6965/src/reset_cause.rs"]
mod reset_cause;

#[test]
fn the_chip_tells_a_brown_out_and_a_pin_from_the_rest() {
    use esm_link::message::ResetReason::{BrownOut, Pin, PowerOn, Software, Watchdog};
    for (resc, expected) in [
        (0, None),
        (0b0_0001, Some(Pin)),
        (0b0_0010, Some(PowerOn)),
        (0b0_0110, Some(PowerOn)),
        (0b0_0100, Some(BrownOut)),
        (0b1_0101, Some(BrownOut)),
        (0b0_1000, Some(Watchdog)),
        (0b1_0000, Some(Software)),
        (0b10_0000, None),
    ] {
        assert_eq!(reset_cause::reason(resc), expected, "{resc:#b}");
    }
}

#[path = "../../boards/stm32f405/src/reset_cause.rs"]
mod stm32f405_reset_cause;

#[test]
fn the_stm32f405_tells_a_power_on_from_what_comes_with_it_and_the_pin_from_the_rest() {
    use esm_link::message::ResetReason::{BrownOut, Pin, PowerOn, Software, Watchdog};
    for (csr, expected) in [
        (0, None),
        // Those of RM0090, 7.3.21; the low-speed clock's bits stand below.
        (0x0C00_0000, Some(PowerOn)),
        (0x0E00_0003, Some(PowerOn)),
        (0x0600_0000, Some(BrownOut)),
        (0x2400_0000, Some(Watchdog)),
        (0x1400_0000, Some(Software)),
        (0x0400_0000, Some(Pin)),
        (0x0000_0003, None),
    ] {
        let reason = stm32f405_reset_cause::reason(csr);
        assert_eq!(reason, expected, "{csr:#x}");
    }
}

#[test]
fn what_ends_the_firmware_is_told_after_the_reset() {
    for (task, reason, detail) in [
        ("NeverReturn", "watchdog", "in task number 0"),
        (
            "NeverReturnInBackground",
            "watchdog",
            "a slot-0 task did not return",
        ),
        ("Panic", "panicked", "src/bin/faults.rs:"),
        ("Undefined", "fault", "cfsr 0x00010000"),
        (
            "DeepStack",
            "fault",
            "the stack was too deep for its memory",
        ),
    ] {
        let robot = Robot::start("lm3s6965", Some(&firmware("faults")));
        assert_eq!(robot.status()["last_reset"], "power on", "{task}");
        // On trial, so that the robot does not start with it again.
        let (_folder, path) = mission(&format!("task Fatal: {task}; Quiet -> Fatal [timeout];"));
        let on_trial = ["upload", path.to_str().unwrap(), "--trial", "3600 s"];
        robot.esm(&on_trial).good();
        let status = robot.status_when("the reset", |status| status["mode"] != "running");
        let told = status["last_reset"].as_str().unwrap();
        assert!(told.contains(reason), "{task}: {told}");
        assert_eq!(
            status["mode"], "empty",
            "{task}: no mission, so nothing moves"
        );
        // In words for people, and in the black box, behind what the mission did.
        let told = robot.esm(&["status"]).good().out;
        assert!(told.contains(detail), "{task}: {told}");
        let words = &status["last_words"];
        let (in_task, from_us) = match task {
            // All slots go on, until the idle loop has been away for too long.
            "NeverReturnInBackground" => (serde_json::Value::Null, 1_000_000 + BACKGROUND_BOUND_US),
            _ => (0.into(), 1_000_000),
        };
        assert_eq!(words["task"], in_task, "{task}: {words:#}");
        let after_us = words["after_us"].as_u64().unwrap();
        assert!(
            (u64::from(from_us)..u64::from(from_us) + 500_000).contains(&after_us),
            "{task}: {words:#}"
        );
        let written = robot.esm(&["blackbox", "--json"]).good().out;
        let written: Vec<serde_json::Value> = written
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect();
        let what: Vec<&str> = written
            .iter()
            .map(|entry| entry["what"].as_str().unwrap())
            .collect();
        let expected = [
            "started",
            "mission",
            "transition",
            "transition",
            "ended",
            "started",
        ];
        assert_eq!(what, expected, "{task}: {written:#?}");
        assert!(
            written[5]["reason"].as_str().unwrap().contains(reason),
            "{task}: {written:#?}"
        );
        // The robot is as good as new.
        upload(&robot, "");
        robot.status_when("the next mission", |status| {
            status["steps"].as_u64() > Some(10)
        });
    }
}

#[test]
fn a_mission_that_resets_the_robot_again_and_again_is_not_started_for_ever() {
    let robot = Robot::start("lm3s6965", Some(&firmware("faults")));
    upload(&robot, "task Fatal: Panic; Quiet -> Fatal [timeout];");
    // Where its answer was lost in the first reset, the upload is made again, and is one start
    // more.
    robot.status_when("three starts and no more", |status| {
        status["last_words"]["bad_starts"].as_u64() >= Some(3) && status["mode"] == "empty"
    });
    // Another one is as good as ever.
    upload(&robot, "");
    robot.status_when("the next mission", |status| {
        status["mode"] == "running" && status["steps"].as_u64() > Some(10)
    });
}

#[test]
fn an_emergency_stop_is_latched_over_missions_and_a_reset_until_it_is_released() {
    // The idle loop hangs from the first second on, and goes on to do so: the watchdog resets the
    // robot.
    let states = "task Fatal: NeverReturnInBackground; Quiet -> Fatal [timeout];";
    let robot = robot_with(states);
    robot.status_when("the task", |status| {
        status["active"].to_string().contains("Fatal")
    });
    robot.esm(&["stop", "--emergency"]).good();
    assert_eq!(robot.status()["mode"], "emergency stop");
    let status = robot.status_when("the reset", |status| status["last_reset"] == "watchdog");
    assert_eq!(status["mode"], "emergency stop", "{status:#}");
    let told = robot.esm(&["status"]).good().out;
    assert!(
        told.contains("emergency stop, latched: motors off until `esm start --release`"),
        "{told}"
    );
    upload(&robot, "");
    let status = robot.status();
    assert_eq!(status["mode"], "emergency stop", "{status:#}");
    assert_eq!(status["steps"], 0, "{status:#}");
    let refused = robot.esm(&["start"]);
    assert_eq!(refused.status, Some(1), "{}", refused.err);
    assert!(
        refused.err.contains("esm start --release"),
        "{}",
        refused.err
    );
    robot.esm(&["start", "--release"]).good();
    robot.status_when("the mission", |status| {
        status["mode"] == "running" && status["steps"].as_u64() > Some(10)
    });
}

#[test]
fn faults_of_the_machine_end_in_the_safe_state() {
    let robot = Robot::start("lm3s6965", None);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mission.esm");
    for (machine, reason) in [
        (
            "queue 2; machine M { event E; region r { state Quiet timeout 1 s; state B; initial -> Quiet;
             Quiet -> B [timeout] / send E, send E, send E; } }",
            "queue",
        ),
        (
            "machine M { event E; region r { state Quiet timeout 1 s; state B; initial -> Quiet;
             Quiet -> B [timeout] / send E; B -> B on E / send E; } }",
            "no end",
        ),
    ] {
        let head = "interpreter slot 1; slot 1 period 20 ms duration 2 ms;\n";
        std::fs::write(&path, format!("{head}{machine}")).unwrap();
        robot.give(&path);
        let status = robot.status_when("the safe state", |status| status["mode"] == "safe");
        let told = status["safe_reason"].as_str().unwrap();
        assert!(told.contains(reason), "{reason}: {told}");
    }
    robot.esm(&["upload", "missions/patrol.esm"]).good();
    robot.status_when("a mission that runs", |status| status["mode"] == "running");
}

#[test]
fn a_robot_whose_host_falls_silent_warns_then_drives_slowly_then_stops_whatever_its_mission_does() {
    for board in ["host", "lm3s6965"] {
        let done = esm(&[
            "run",
            "missions/on_a_lead.esm",
            "--board",
            board,
            "--firmware",
            firmware("rover").to_str().unwrap(),
            "--cut-link",
            "2 s",
            "--until",
            "6 s",
        ]);
        assert_eq!(done.status, Some(1), "{board}: {done:#?}");
        let why = "the host has not called for too long";
        assert!(done.err.contains(why), "{board}: {done:#?}");
        let told: Vec<&str> = done.out.lines().collect();
        let at = |what: &str| {
            let line = told.iter().find(|line| line.contains(what));
            let line = line.unwrap_or_else(|| panic!("{board}: `{what}` is missing: {done:#?}"));
            line.split_whitespace()
                .next()
                .unwrap()
                .parse::<f64>()
                .unwrap()
        };
        // The last call came at most 0.3 s before the cut, and the tasks run each 40 ms.
        for (what, after_s) in [
            ("sends Quiet", 0.5),
            ("motion/Fast -> motion/Slow", 1.0),
            ("sends Gone", 2.0),
        ] {
            let time_s = at(what) - 2.0;
            assert!(
                (after_s - 0.3..after_s + 0.2).contains(&time_s),
                "{board}, {what}: {done:#?}"
            );
        }
    }
}

#[test]
fn a_frozen_plant_ends_a_run_in_the_safe_state() {
    for board in ["lm3s6965", "host"] {
        let done = esm(&[
            "run",
            "missions/patrol.esm",
            "--board",
            board,
            "--firmware",
            firmware("rover").to_str().unwrap(),
            "--until",
            "20 s",
            "--freeze-plant-at",
            "5 s",
        ]);
        assert_eq!(done.status, Some(1), "{board}: {done:#?}");
        assert!(
            done.err.contains("body does not answer"),
            "{board}: {done:#?}"
        );
    }
}
