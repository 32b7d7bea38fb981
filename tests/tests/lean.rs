//! The default firmware without its features, in the emulator: it drives as the other does, and
//! says of what it cannot do that it was built without it.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::path::Path;

use esm_tests::command::{Robot, esm, firmware, lean_firmware, root};

/// What its stack may take: `board.toml` says it in its section `limits.lean`.
fn stack_limit() -> u64 {
    let board = std::fs::read_to_string(root().join("boards/lm3s6965/board.toml")).unwrap();
    let lean = board.split("[limits.lean]").nth(1).unwrap();
    let limit = lean.split("stack_bytes = ").nth(1).unwrap();
    limit.lines().next().unwrap().parse().unwrap()
}

/// The trace of a mission on the board with this firmware.
fn trace_of(firmware: &Path, mission: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let trace = folder.path().join("trace.jsonl");
    let mission = format!("missions/{mission}.esm");
    esm(&[
        "run",
        &mission,
        "--board",
        "lm3s6965",
        "--world",
        "office",
        "--until",
        "30 s",
        "--link",
        "uart",
        "--firmware",
        firmware.to_str().unwrap(),
        "--trace",
        trace.to_str().unwrap(),
    ])
    .good();
    std::fs::read_to_string(trace).unwrap()
}

#[test]
fn a_mission_runs_on_the_lean_firmware_as_on_the_full_one() {
    let lean = trace_of(&lean_firmware(), "patrol");
    assert!(lean.lines().count() > 100, "{lean}");
    assert_eq!(lean, trace_of(&firmware("rover"), "patrol"));
}

#[test]
fn what_the_lean_firmware_was_built_without_it_refuses_and_drives_on() {
    let robot = Robot::start("lm3s6965", Some(&lean_firmware()));
    robot.esm(&["upload", "missions/patrol.esm"]).good();
    let status = robot.status();
    let all = [
        "record",
        "log",
        "news",
        "params",
        "warm",
        "keys",
        "store",
        "black-box",
        "telemetry",
        "behaviours",
        "links",
        "selftest",
    ];
    assert_eq!(
        status["built_without"],
        serde_json::json!(all),
        "{status:#}"
    );
    let running = status["mission"].clone();
    assert!(running.is_object() || running.is_string(), "{running}");
    for (refused, feature) in [
        (&["param", "get"][..], "params"),
        (&["param", "save"], "params"),
        (&["upload", "--warm", "missions/follow_wall.esm"], "warm"),
        (
            &["upload", "--key", "none", "missions/follow_wall.esm"],
            "keys",
        ),
        (&["log"], "log"),
        (&["log", "--news"], "news"),
        (&["log", "--record", "none.rec"], "record"),
        (&["blackbox"], "black-box"),
        (&["values"], "telemetry"),
    ] {
        let done = robot.esm(refused).ended(1);
        let why = format!("built without the feature `{feature}`");
        assert!(done.err.contains(&why), "{refused:?} says why: {done:#?}");
        let status = robot.status();
        assert_eq!(status["mission"], running, "after {refused:?}");
    }
    // Nor does anyone find out at the next start that nothing was kept.
    let folder = tempfile::tempdir().unwrap();
    let flash = folder.path().join("robot.flash");
    let lean = lean_firmware();
    let [flash, lean] = [&flash, &lean].map(|path| path.to_str().unwrap());
    for starts in [
        &["run", "missions/patrol.esm", "--until", "1 s"][..],
        &["board"],
    ] {
        let kept = ["--flash", flash, "--firmware", lean];
        let link: &[&str] = match starts {
            ["run", ..] => &["--link", "uart"],
            _ => &[],
        };
        let done = esm(&[starts, &kept, link].concat()).ended(1);
        let why = "built without the feature `store`";
        assert!(done.err.contains(why), "{starts:?}: {done:#?}");
    }
    // What was refused warm is taken cold.
    robot.esm(&["upload", "missions/follow_wall.esm"]).good();
    let status = robot.status();
    assert_ne!(status["mission"], running);
    assert_eq!(status["slots_missed"], 0, "{status:#}");
    let stack = status["deepest_stack_bytes"].as_u64().unwrap();
    assert!(stack <= stack_limit(), "{stack} bytes of stack");
}
