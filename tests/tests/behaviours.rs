//! Missions made of behaviours.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::f64::consts::{FRAC_PI_2, PI};
use std::path::Path;

use esm_tests::command::{esm, firmware_with};
use object::{File, Object, ObjectSymbol};

/// The trace of 40 s of the guard's round.
fn trace(board: &[&str], world: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let trace = folder.path().join("trace.jsonl");
    let run = ["run", "missions/guard.esm", "--until", "44 s"];
    let there = ["--world", world, "--trace", trace.to_str().unwrap()];
    esm(&[&run[..], &there[..], board].concat()).good();
    read(&trace)
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap()
}

#[test]
fn a_round_is_the_same_on_the_emulated_board_and_on_the_host() {
    let firmware = firmware_with("lm3s6965", "behaviours");
    let emulated = ["--firmware", firmware.to_str().unwrap()];
    for (world, corners) in [("office", 5), ("corridor", 3)] {
        let host = trace(&["--board", "host"], world);
        assert!(
            host == trace(&emulated, world),
            "{world}: the traces differ"
        );
        let turned = host.matches(r#""to":"round/Corner""#).count();
        assert!(turned >= corners, "{world}: {turned} corners");
    }
}

/// The robot with all behaviours takes 14 KB, which are the stack's where it is made as a value. So
/// it is made in its place, bank by bank.
#[test]
fn the_robot_with_behaviours_leaves_room_on_the_stack() {
    const LEFT_BYTES: u64 = 512;
    let firmware = firmware_with("lm3s6965", "behaviours");
    let bytes = std::fs::read(&firmware).unwrap();
    let elf = File::parse(bytes.as_slice()).unwrap();
    let address = |name| elf.symbol_by_name(name).unwrap().address();
    let room_bytes = address("_stack_start") - address("_stack_end");
    let run = ["run", "missions/guard.esm", "--until", "3 s", "--json"];
    let there = ["--firmware", firmware.to_str().unwrap()];
    let summary = esm(&[&run[..], &there].concat()).good().json();
    let deepest_bytes = summary["deepest_stack_bytes"].as_u64().unwrap();
    println!("{deepest_bytes} bytes of {room_bytes}");
    assert!(
        deepest_bytes + LEFT_BYTES <= room_bytes,
        "{deepest_bytes} bytes of {room_bytes}"
    );
}

#[test]
fn a_firmware_without_behaviours_says_which_task_it_lacks() {
    let said = esm(&["run", "missions/guard.esm", "--until", "1 s"]);
    assert_eq!(said.status, Some(1));
    let lacks = "its firmware lacks the task `GlobalPosition`";
    assert!(said.err.contains(lacks), "{}", said.err);
}

#[test]
fn a_firmware_tells_its_behaviours_and_their_parameters() {
    let told = esm(&["behaviours", "--board", "host", "--json"])
        .good()
        .json();
    let behaviours = told["behaviours"].as_array().unwrap();
    let names: Vec<&str> = (behaviours.iter())
        .map(|behaviour| behaviour["name"].as_str().unwrap())
        .collect();
    assert_eq!(
        names,
        [
            "Move",
            "TurnTo",
            "GoTo",
            "FollowCorridor",
            "PassDoor",
            "AlongWall",
            "Wander",
            "Approach",
            "FollowObject",
            "Dock"
        ]
    );
    let angle = &behaviours[1]["params"][0];
    assert_eq!(angle["name"], "angle_rad");
    assert_eq!(angle["type"], "f32");
    let has = |key: &str, value: f64| (angle[key].as_f64().unwrap() - value).abs() < 1e-4;
    assert!(has("default", FRAC_PI_2) && has("min", -PI) && has("max", PI));
    for behaviour in behaviours {
        assert!(!behaviour["docs"].as_str().unwrap().is_empty());
        let params = behaviour["params"].as_array().unwrap();
        assert!(params.iter().any(|param| param["name"] == "outside_m"));
    }
    let words = esm(&["behaviours", "--board", "host"]).good().out;
    assert!(
        words.contains("TurnTo\n") && words.contains("angle_rad"),
        "{words}"
    );
}
