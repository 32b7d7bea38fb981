//! `esm new`: what it writes builds, holds and drives, outside the checkout, by the words of its
//! own README; and nothing that is there is written over.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fs;
use std::path::Path;
use std::time::Instant;

use esm_tests::command::{Done, esm, root, shell};
use host_tools::boards::{self, Board};

/// Makes a robot for a board in an empty folder; returns what the command said.
fn new_robot(name: &str, board: &str, folder: &Path) -> Done {
    let at = folder.join(name);
    let framework = root().to_str().unwrap();
    let path = at.to_str().unwrap();
    let named = ["new", "robot", name, "--board", board];
    esm(&[
        &named[..],
        &["--path", path, "--framework", framework, "--json"],
    ]
    .concat())
}

/// The commands that a README shows.
fn commands(readme: &str) -> Vec<String> {
    let blocks = readme.split("```");
    let shown = blocks
        .skip(1)
        .step_by(2)
        .filter_map(|block| block.strip_prefix("text\n"));
    shown
        .flat_map(|block| block.lines().map(str::to_owned))
        .collect()
}

/// A robot for this board is made, and what its README says is done, as far as no board is plugged
/// in.
fn by_its_readme(board: &Board) {
    let began = Instant::now();
    let folder = tempfile::tempdir().unwrap();
    // The longest name that there is, and the first in the order of names.
    let name = match board.firmware {
        None => "z_has_a_name_of_24_letters".chars().take(24).collect(),
        Some(_) => format!("a_{}", board.name),
    };
    let told = new_robot(&name, board.name, folder.path()).good().json();
    let robot = folder.path().join(&name);
    for file in told["files"].as_array().unwrap() {
        assert!(robot.join(file.as_str().unwrap()).is_file(), "{file}");
    }
    let lock = fs::read_to_string(robot.join("Cargo.lock")).unwrap();
    if let Some(firmware) = board.firmware {
        if firmware.script().is_some() {
            shell(
                &format!("cargo xtask emulator --board {}", board.name),
                root(),
            )
            .good();
        }
        shell("cargo fmt --check", &robot.join("firmware")).good();
    }
    shell("cargo fmt --check", &robot).good();
    let mut ran = Vec::new();
    for command in commands(&fs::read_to_string(robot.join("README.md")).unwrap()) {
        if command.starts_with("esm flash ") {
            continue;
        }
        let done = shell(&command, &robot).good();
        assert!(!done.err.contains("warning: "), "{command}: {}", done.err);
        ran.push(command);
    }
    let count = |word: &str| ran.iter().filter(|command| command.contains(word)).count();
    assert_eq!(count("cargo test"), 1, "{ran:?}");
    let has_firmware = usize::from(board.firmware.is_some());
    assert_eq!(
        count("cargo xtask firmware --robot "),
        has_firmware,
        "{ran:?}"
    );
    let is_emulated = usize::from(board.firmware.is_some_and(|it| it.is_emulated()));
    assert_eq!(count(" run mission.esm "), 1 + is_emulated, "{ran:?}");
    // What was tested is what is built.
    assert_eq!(fs::read_to_string(robot.join("Cargo.lock")).unwrap(), lock);
    println!("{}: {:.0} s", board.name, began.elapsed().as_secs_f32());
}

#[test]
fn a_robot_for_each_board_does_what_its_readme_says() {
    for board in boards::all() {
        by_its_readme(board);
    }
}

#[test]
fn tasks_behaviours_and_missions_are_added_to_a_robot() {
    let folder = tempfile::tempdir().unwrap();
    new_robot("grower", "host", folder.path()).good();
    let robot = folder.path().join("grower");
    for (what, name) in [
        ("task", "watch_ahead_of_the_robot"),
        ("behaviour", "come_near"),
        ("mission", "explore"),
    ] {
        let line = format!("esm new {what} {name} --json");
        let told = shell(&line, &robot.join("src")).good().json();
        // A behaviour has a mission as well.
        let files = if what == "behaviour" { 3 } else { 2 };
        assert_eq!(told["files"].as_array().unwrap().len(), files, "{told}");
        let changed = told["changed"].as_array().unwrap().len();
        assert_eq!(changed, usize::from(what != "mission"), "{told}");
        let before = fs::read_to_string(robot.join("src/lib.rs")).unwrap();
        let again = shell(&line, &robot).ended(2);
        assert!(again.err.contains("take another name"), "{}", again.err);
        assert_eq!(
            fs::read_to_string(robot.join("src/lib.rs")).unwrap(),
            before
        );
    }
    shell("cargo fmt --check", &robot).good();
    shell("cargo run -- tasks --board host -o tasks.esm", &robot).good();
    let tasks = fs::read_to_string(robot.join("tasks.esm")).unwrap();
    for task in [
        "task WatchAheadOfTheRobot ",
        "task ComeNear ",
        "task Behaviours ",
    ] {
        assert!(tasks.contains(task), "{tasks}");
    }
    let tested = shell("cargo test", &robot).good();
    assert!(!tested.err.contains("warning: "), "{}", tested.err);
    for test in [
        "it_finishes_where_something_is_near_or_nobody_knows ... ok",
        "it_drives_ahead_until_something_is_near_or_nobody_knows ... ok",
        "all_scenarios_hold ... ok",
    ] {
        assert!(tested.out.contains(test), "{}", tested.out);
    }
    let check = shell("esm check come_near.esm", &robot).good();
    assert!(!check.err.contains("warning"), "{}", check.err);
    let run = "cargo run -- run come_near.esm --board host --until '20 s'";
    let driven = shell(run, &robot).good();
    let is_there = driven.out.contains("way/Go -> way/final");
    assert!(is_there, "{}", driven.out);
    let told = shell("esm test . explore", &robot).good();
    assert!(told.out.contains("explore.scenario"), "{}", told.out);
    shell("esm new mission explore_more", root()).ended(2);
    fs::write(
        robot.join("tasks.esm"),
        "task Turn slot 2 wcet 1 ms count 1 {\n}\n",
    )
    .unwrap();
    // A behaviour goes without its mission then.
    let told = shell("esm new behaviour stay_near --json", &robot).good();
    let files = told.json()["files"].as_array().unwrap().len();
    assert_eq!(files, 2, "{}", told.out);
    let lacking = shell("esm new mission another", &robot).ended(1);
    assert!(
        lacking.err.contains("SonarRing, Odometry, Cruise"),
        "{}",
        lacking.err
    );
}

#[test]
fn what_is_there_stays_and_what_is_no_name_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    new_robot("twice", "host", folder.path()).good();
    let again = new_robot("twice", "host", folder.path()).ended(2);
    assert!(again.err.contains("is there already"), "{}", again.err);
    for (name, board, expected) in [
        ("My-Robot", "host", "did you mean `my_robot`?"),
        ("match", "host", "keyword"),
        ("mine", "toaster", "the boards are"),
        (boards::DEFAULT, "host", "is a board"),
    ] {
        let refused = new_robot(name, board, folder.path()).ended(2);
        assert!(refused.err.contains(expected), "{}", refused.err);
        assert!(!folder.path().join(name).exists(), "{name}");
    }
    let nowhere = folder.path().to_str().unwrap();
    let refused = esm(&[
        "new",
        "robot",
        "mine",
        "--path",
        "/tmp",
        "--framework",
        nowhere,
    ])
    .ended(2);
    assert!(refused.err.contains("is no checkout"), "{}", refused.err);
    let board = esm(&["new", "board", "pico"]).ended(2);
    assert!(board.err.contains("is there already"), "{}", board.err);
}
