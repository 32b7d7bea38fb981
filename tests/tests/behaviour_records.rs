//! What a robot writes down of its behaviours: while it runs, and in its black box.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::time::Duration;

use esm_tests::command::{Robot, esm, firmware_with, root};

/// What a run of the guard among people tells, without its summary.
fn told(board: &[&str]) -> Vec<String> {
    let run = ["run", "missions/guard.esm", "--world", "visitors"];
    let words = ["--until", "24 s", "--position", "3 s by x_m = 0.1"];
    let run = esm(&[&run[..], &words[..], board].concat()).good().out;
    // But for what the firmware logs.
    let lines = run.lines().filter(|line| !line.contains(" | "));
    let lines = lines.take_while(|line| !line.trim().is_empty());
    lines.map(str::to_owned).collect()
}

/// The lines in which these words stand, by their places.
fn places(lines: &[String], words: &str) -> Vec<usize> {
    let with = |(place, line): (usize, &String)| line.contains(words).then_some(place);
    lines.iter().enumerate().filter_map(with).collect()
}

#[test]
fn a_guard_that_somebody_steps_before_is_told_of_equally_on_both_boards() {
    let host = told(&["--board", "host"]);
    let firmware = firmware_with("lm3s6965", "behaviours");
    let emulated = told(&["--firmware", firmware.to_str().unwrap()]);
    assert_eq!(host, emulated);
    // It drives, somebody steps before it and away again, and it goes on.
    let of_move = |words: &str| places(&host, words);
    let began = of_move("Move (1) comes onto the list: EXECUTE");
    assert_eq!(began.len(), 1, "{host:#?}");
    let stopped = of_move("SAFETY_CHECK has come up -> suspend")[0];
    assert!(host[stopped].contains("Move ("), "{}", host[stopped]);
    assert!(host[stopped + 1].contains(": EXECUTE -> RESUME"));
    assert!(host[stopped + 2].contains("IDLE (0) comes onto the list: EXECUTE"));
    let gone = of_move("IDLE (0): EXECUTE -> DESTROY")[0];
    let goes_on = of_move(": RESUME -> EXECUTE")[0];
    assert!(began[0] < stopped && stopped < gone && gone < host.len());
    assert!(goes_on.abs_diff(gone) == 1, "in one activation");
    // A side ends where it is 0.8 m long, and the corner follows.
    let ended = of_move("Move (1): outside_range has come up -> cancel")[0];
    assert!(host[ended + 1].contains("EXECUTE -> DESTROY"));
    assert!(!of_move("TurnTo (2) comes onto the list").is_empty());
    assert_eq!(of_move("the robot is told how far off it is").len(), 1);
}

#[test]
fn the_black_box_has_behaviours_by_name_and_where_the_robot_was() {
    let robot = Robot::start_with("host", None, &["--world", "empty"]);
    robot.give(&root().join("missions/guard.esm"));
    std::thread::sleep(Duration::from_secs(6));
    robot
        .esm(&[
            "position",
            "--set",
            "x_m = 5, y_m = -2.5, heading_rad = 0.5",
        ])
        .good();
    robot.esm(&["stop"]).good();
    let written = robot.esm(&["blackbox", "--json"]).good().out;
    let records: Vec<serde_json::Value> = (written.lines())
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let of = |what: &str| {
        let mut of_kind = records.iter();
        of_kind.find(|record| record["what"] == what).unwrap()
    };
    let began = of("behaviour");
    assert_eq!(began["name"], "Move");
    assert!(began["from"].is_null());
    assert_eq!(began["to"], "EXECUTE");
    // Its pose is the next record, and whole: at the start.
    let place = records.iter().position(|record| record == began).unwrap();
    let pose = &records[place + 1];
    assert_eq!(
        (&pose["what"], &pose["global"]),
        (&"pose".into(), &false.into())
    );
    assert!(pose["x_m"].as_f64().unwrap().abs() < 0.01);
    let ended = of("situation");
    assert_eq!(
        (&ended["situation"], &ended["reaction"]),
        (&"outside_range".into(), &"cancel".into())
    );
    let place = records.iter().position(|record| record == of("corrected"));
    let pose = &records[place.unwrap() + 1];
    assert_eq!(pose["global"], true);
    for (name, expected) in [("x_m", 5.0), ("y_m", -2.5), ("heading_rad", 0.5)] {
        assert!(
            (pose[name].as_f64().unwrap() - expected).abs() < 0.002,
            "{pose}"
        );
    }
    let text = robot.esm(&["blackbox"]).good().out;
    assert!(
        text.contains("Move (1) comes onto the list: EXECUTE"),
        "{text}"
    );
    assert!(text.contains("the robot is told where it is"), "{text}");
}

#[test]
fn a_mission_without_behaviours_writes_none() {
    let robot = Robot::start_with("host", None, &["--world", "empty"]);
    robot.give(&root().join("missions/square.esm"));
    std::thread::sleep(Duration::from_secs(2));
    let written = robot.esm(&["blackbox", "--json"]).good().out;
    for what in ["behaviour", "situation", "pose", "corrected"] {
        assert!(
            !written.contains(&format!("\"what\":\"{what}\"")),
            "{written}"
        );
    }
}
