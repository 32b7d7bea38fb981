//! The whole robot drives its mission on the host board.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// Where cargo says that the program is.
const PROGRAM: &str = "CARGO_BIN_EXE_my_pico";

/// Runs the robot's program in the robot's folder.
fn robot(arguments: &[&str]) -> Output {
    let program = std::env::var_os(PROGRAM).expect("cargo says where it is");
    let mut robot = Command::new(program);
    robot.args(arguments).output().expect("the program starts")
}

/// What the program prints where all is well.
fn printed(arguments: &[&str]) -> String {
    let output = robot(arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {said}");
    String::from_utf8(output.stdout).expect("it prints text")
}

/// Drives the mission on a board; returns its trace.
fn trace_of_a_run(board: &[&str], folder: &Path) -> String {
    let trace = folder.join("trace.jsonl");
    let file = trace.to_str().expect("a path of letters");
    let run = ["run", "mission.esm", "--world", "room.world"];
    let until = ["--until", "30 s", "--trace", file];
    printed(&[&run, &until, board].concat());
    fs::read_to_string(&trace).expect("the run has left a trace")
}

#[test]
fn it_drives_its_mission_and_lights_its_lamp() {
    let folder = tempfile::tempdir().expect("a folder for the traces");
    let on_host = trace_of_a_run(&["--board", "host"], folder.path());
    for transition in [
        r#""from":"light/Watch","to":"light/Hold""#,
        r#""from":"light/Hold","to":"light/Watch""#,
        r#""from":"motion/Ahead","to":"motion/Away""#,
        r#""from":"motion/Away","to":"motion/Ahead""#,
    ] {
        assert!(on_host.contains(transition), "never taken: {transition}");
    }
}

#[test]
fn all_scenarios_hold() {
    let told = robot(&["test", "."]);
    let text = String::from_utf8_lossy(&told.stdout);
    assert!(told.status.success(), "{text}");
}

#[test]
fn the_declarations_that_the_mission_uses_are_those_of_the_firmware() {
    let kept = include_str!("../tasks.esm");
    let declared = |text: &str| {
        let lines = text.lines().filter(|line| !line.starts_with("//"));
        lines.collect::<Vec<_>>().join("\n")
    };
    assert_eq!(
        declared(kept),
        declared(&printed(&["tasks", "--board", "host"])),
        "update tasks.esm: cargo run -- tasks --board host -o tasks.esm"
    );
}
