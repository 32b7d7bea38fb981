//! The mission that is compiled into the rover's firmware: what its source says, and what the robot
//! does where its flash has none that may run.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::path::Path;

use esm_tests::command::{Robot, firmware, root};
use esm_tests::subject;
use host_tools::boards;
use rt_firmware::body::flash::ERASE_BYTES;
use rt_firmware::store::HEADER_BYTES;
use rt_firmware::store::flash_store::flash_bytes;
use serde_json::Value;

const SOURCE: &str = "missions/stand_by.esm";
const BLOB: &str = "boards/stand_by.blob";

fn own_hash() -> String {
    let blob = std::fs::read(root().join(BLOB)).unwrap();
    format!("{:08x}", u32::from_le_bytes(*blob.last_chunk().unwrap()))
}

#[test]
fn the_firmware_has_what_the_source_says() {
    let compiled = subject::build_file(&root().join(SOURCE)).unwrap().blob;
    let path = root().join(BLOB);
    if std::env::var_os("ESM_BLESS").is_some() {
        std::fs::write(&path, &compiled).unwrap();
    }
    assert!(
        std::fs::read(path).unwrap() == compiled,
        "{BLOB} is not what {SOURCE} compiles to: ESM_BLESS=1 makes it so"
    );
}

/// A robot whose flash is this file.
fn robot_with(flash: &Path, elf: &str) -> Robot {
    let arguments = ["--flash", flash.to_str().unwrap()];
    Robot::start_with("lm3s6965", Some(&firmware(elf)), &arguments)
}

/// Looks whether the robot stands by with its own mission, for this reason, and takes another one.
#[track_caller]
fn assert_stands_by(robot: &Robot, slots: &str) {
    let status = robot.status_when("its own mission", |status| {
        status["steps"].as_u64() > Some(10)
    });
    assert_eq!(status["mode"], "running", "{status:#}");
    assert_eq!(status["mission"], own_hash().as_str(), "{status:#}");
    assert_eq!(status["kept"]["runs"], "firmware", "{status:#}");
    assert_eq!(status["trial"], Value::Null, "{status:#}");
    for slot in ["slot_a", "slot_b"] {
        assert_eq!(status["kept"][slot], slots, "{status:#}");
    }
    let active = ["position/Track", "battery/Measure", "charge/Enough"];
    for state in active {
        let current = status["active"].as_array().unwrap();
        assert!(current.contains(&state.into()), "{state}: {status:#}");
    }
    let told = robot.esm(&["status"]).good().out;
    assert!(told.contains("runs the firmware's own mission"), "{told}");
    // It can be commanded as any other.
    let param = "battery/Measure.low_v";
    robot.esm(&["param", "set", param, "6.0"]).good();
    robot.esm(&["stop"]).good();
    assert_eq!(robot.status()["mode"], "stopped");
    robot.esm(&["start"]).good();
    robot.esm(&["upload", "missions/patrol.esm"]).good();
    let status = robot.status();
    assert_eq!(status["mode"], "running", "{status:#}");
    assert_eq!(status["kept"]["runs"], "slot A", "{status:#}");
    assert_eq!(status["slots_missed"], 0, "{status:#}");
}

#[test]
fn a_robot_with_an_empty_flash_stands_by() {
    let folder = tempfile::tempdir().unwrap();
    let robot = robot_with(&folder.path().join("flash"), "rover");
    assert_stands_by(&robot, "empty");
}

#[test]
fn a_robot_whose_missions_are_both_damaged_stands_by() {
    let folder = tempfile::tempdir().unwrap();
    let flash = folder.path().join("flash");
    let robot = robot_with(&flash, "rover");
    robot.esm(&["upload", "missions/patrol.esm"]).good();
    robot.esm(&["upload", "missions/follow_wall.esm"]).good();
    let kept = &robot.status()["kept"];
    assert_eq!(
        (&kept["slot_a"], &kept["slot_b"]),
        (&"spare".into(), &"runs".into())
    );
    drop(robot);
    // Two slots, then the records: one bit of the payload in each slot.
    let mut cells = std::fs::read(&flash).unwrap();
    let blob_bytes = boards::find("lm3s6965").unwrap().capacities.blob_bytes;
    let records = flash_bytes(0, ERASE_BYTES as u32) as usize - 2 * ERASE_BYTES;
    let slot = (cells.len() - records) / 2;
    assert!(slot > blob_bytes as usize);
    for first in [0, slot] {
        cells[first + HEADER_BYTES as usize + 100] ^= 1;
    }
    std::fs::write(&flash, cells).unwrap();
    assert_stands_by(&robot_with(&flash, "rover"), "broken payload");
}

#[test]
fn a_robot_whose_missions_are_for_other_tasks_stands_by() {
    let folder = tempfile::tempdir().unwrap();
    let flash = folder.path().join("flash");
    // Tasks that the rover lacks, or has with another signature.
    let robot = robot_with(&flash, "faults");
    for (name, parameter) in [("first", "1000"), ("second", "1001")] {
        let mission = folder.path().join(name);
        let text = format!(
            "interpreter slot 1; slot 1 period 20 ms duration 2 ms; slot 2 period 20 ms duration 4 ms;
             task Overrun slot 2 {{ param duration_us: u32 = 20000 min 0 max 250000; }}
             machine M {{ region r {{ task A: Overrun with {{ duration_us = {parameter} }}; initial -> A; A -> A on *; }} }}"
        );
        std::fs::write(&mission, text).unwrap();
        robot.esm(&["upload", mission.to_str().unwrap()]).good();
    }
    drop(robot);
    assert_stands_by(&robot_with(&flash, "rover"), "refused");
}
