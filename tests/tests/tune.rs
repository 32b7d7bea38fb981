//! `esm tune`: motors and gains, from drives of the simulated rover and of a robot at a port.

use std::fs;

use esm_tests::command::{Robot, Running, esm, root};
use serde_json::Value;

/// The plant's motors, which the command knows nothing of: 2.7 rad/s for each volt above 0.45 V of
/// 8.3 V, on a wheel of 32.8 mm, with the encoders' belief of 32.3; the right one is weaker by 4 %.
const FULL_SPEED_M_PER_S: f64 = 2.7 * (8.3 - 0.45) * 0.0323;
const FRICTION_POWER: f64 = 0.45 / 8.3;
const RIGHT_WEAKER: f64 = 0.04;
const LAG_S: f64 = 0.08;

fn number(report: &Value, path: &str) -> f64 {
    report
        .pointer(path)
        .and_then(Value::as_f64)
        .unwrap_or_else(|| panic!("{path} of {report}"))
}

/// That a report tells the plant's motors.
fn tells_the_motors(report: &Value) {
    for (side, part) in [(0, 1.0), (1, 1.0 - RIGHT_WEAKER)] {
        let of = |key: &str| number(report, &format!("/motors/{side}/{key}"));
        let full = of("full_speed_m_per_s") / (FULL_SPEED_M_PER_S * part);
        assert!((full - 1.0).abs() < 0.02, "{report}");
        assert!(
            (of("friction_power") - FRICTION_POWER).abs() < 0.005,
            "{report}"
        );
        // A period more: the loop's own.
        assert!((of("lag_s") - LAG_S - 0.01).abs() < 0.005, "{report}");
    }
}

#[test]
fn the_motors_of_the_plant_are_found_and_the_gains_are_better() {
    let tuned = esm(&["tune", "--json"]).good();
    let report = tuned.json();
    tells_the_motors(&report);
    let errors =
        ["before", "after"].map(|key| number(&report, &format!("/speed_error_m_per_s/{key}")));
    assert!(errors[1] < 0.85 * errors[0], "{report}");
    assert_eq!(esm(&["tune", "--json"]).good().out, tuned.out, "equal runs");
    let other = esm(&["tune", "--seed", "5", "--json"]).good().json();
    tells_the_motors(&other);
}

#[test]
fn a_robot_at_a_port_is_tuned_and_ctrl_c_stops_it() {
    let robot = Robot::start_with("host", None, &["--world", "empty"]);
    let report = robot.esm(&["tune", "--once", "--json"]).good().json();
    tells_the_motors(&report);
    assert!(report["speed_error_m_per_s"]["after"].is_null(), "{report}");
    let process = Running::esm(&["tune", "--port", robot.port()]).until("it drives", |process| {
        process.err().contains("the robot drives")
    });
    let ended = process.interrupted();
    assert!(ended.err.contains("the robot was stopped"), "{}", ended.err);
    assert_eq!(robot.status()["mode"], "stopped", "{}", ended.err);
    // A robot that was stopped stays so.
    let refused = robot.esm(&["tune"]).ended(1);
    assert!(
        refused.err.contains("does not drive, it is stopped"),
        "{}",
        refused.err
    );
}

#[test]
fn a_recording_is_enough_where_it_tells_of_the_wheels_often_enough() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let record = |mission: &str, sample: &str, to: &str| {
        let mcap = at("drive.mcap");
        esm(&[
            "record", mission, "--board", "host", "--world", "empty", "--until", "30 s",
            "--sample", sample, "--record", to, "-o", &mcap,
        ])
        .good();
    };
    record("missions/tune.esm", "0 s", &at("often.rec"));
    let report = esm(&["tune", &at("often.rec"), "--json"]).good().json();
    tells_the_motors(&report);

    record("missions/tune.esm", "100 ms", &at("seldom.rec"));
    let refused = esm(&["tune", &at("seldom.rec")]).ended(1);
    assert!(refused.err.contains("100 ms apart"), "{}", refused.err);

    record("missions/square.esm", "0 s", &at("without.rec"));
    let refused = esm(&["tune", &at("without.rec")]).ended(1);
    assert!(
        refused.err.contains("no values of wheels"),
        "{}",
        refused.err
    );
}

#[test]
fn what_was_found_is_written_where_it_is_wanted_and_nowhere_else() {
    let folder = tempfile::tempdir().unwrap();
    let put = |from: &str, name: &str| {
        let path = folder.path().join(name);
        fs::copy(root().join(from), &path).unwrap();
        path.display().to_string()
    };
    let robot = put("boards/pico/robot.toml", "robot.toml");
    let mission = put("missions/guard.esm", "guard.esm");
    put("missions/rover.esm", "rover.esm");
    let before = [&robot, &mission].map(|path| fs::read_to_string(path).unwrap());
    let told = esm(&[
        "tune", "--once", "--write", &robot, "--write", &mission, "--json",
    ]);
    let report = told.good().json();
    assert_eq!(report["written"], serde_json::json!([robot, mission]));

    let [robot_text, mission_text] =
        [&robot, &mission].map(|path| fs::read_to_string(path).unwrap());
    let gain = |key: &str| format!("{:?}", number(&report, &format!("/gains/{key}")));
    let state = format!(
        "task Drive: WheelSpeed with {{ proportional_s_per_m = {}, integral_per_m = {} }};",
        gain("proportional_s_per_m"),
        gain("integral_per_m")
    );
    assert_eq!(
        mission_text,
        before[1].replace("task Drive: WheelSpeed;", &state)
    );
    esm(&["check", &mission]).good();

    let changed: Vec<(&str, &str)> = (before[0].lines().zip(robot_text.lines()))
        .filter(|(before, after)| before != after)
        .collect();
    assert_eq!(before[0].lines().count(), robot_text.lines().count());
    let keys = ["full_speed_m_per_s = ", "friction_power = "];
    assert_eq!(changed.len(), keys.len(), "{changed:?}");
    for ((before, after), key) in changed.iter().zip(keys) {
        assert!(after.starts_with(key), "{after}");
        let comment = |line: &str| line.split_once('#').map(|(_, comment)| comment.to_owned());
        assert_eq!(comment(before), comment(after));
    }
    esm(&["wiring", &robot]).good();

    // Told before anything drives.
    for (file, said, status) in [
        (
            root().join("missions/rover.esm").display().to_string(),
            "no task state `WheelSpeed`",
            1,
        ),
        ("gains.txt".to_owned(), "ends in .toml", 2),
    ] {
        let refused = esm(&["tune", "--write", &file]).ended(status);
        assert!(refused.err.contains(said), "{}", refused.err);
        assert!(!refused.err.contains("drives;"), "{}", refused.err);
    }
}

#[test]
fn what_a_person_has_measured_goes_into_the_robots_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.toml");
    fs::copy(root().join("boards/pico/robot.toml"), &path).unwrap();
    let robot = path.to_str().unwrap();
    let before = fs::read_to_string(&path).unwrap();
    let report = esm(&[
        "tune", "--way", "9.9,10", "--turns", "9.8,10", "--counts", "14396,10", "--write", robot,
        "--json",
    ]);
    let report = report.good().json();
    // 0.0323 · 0.99, 0.2015 / 0.98
    for (key, expected) in [
        ("radius_m", 0.031977),
        ("base_m", 0.20561),
        ("counts_per_revolution", 1439.6),
    ] {
        assert_eq!(report[key], expected, "{report}");
    }
    let expected = before
        .replace("base_m = 0.2015 ", "base_m = 0.20561 ")
        .replace("radius_m = 0.0323 ", "radius_m = 0.031977 ")
        .replace(
            "counts_per_revolution = 1440 ",
            "counts_per_revolution = 1439.6 ",
        );
    assert_eq!(fs::read_to_string(&path).unwrap(), expected);
    esm(&["wiring", robot]).good();

    let squares = [
        "umbmark",
        "--cw",
        "-12,-20",
        "--ccw",
        "-4,9",
        "--side-mm",
        "1000",
    ];
    let named = ["--base-mm", "205.6", "--write", robot, "--json"];
    let evaluated = esm(&[&squares[..], &named].concat()).good().json();
    let base_m = libm::round(evaluated["base_mm"].as_f64().unwrap() * 10.0) / 10_000.0;
    let with_base = expected.replace("0.20561 ", &format!("{base_m} "));
    assert_eq!(fs::read_to_string(&path).unwrap(), with_base);

    for (arguments, said, status) in [
        (
            ["--way", "1,100", "--write", robot],
            "`wheels.radius_m` is",
            1,
        ),
        (["--way", "1", "--write", robot], "expected two numbers", 2),
        (
            ["--way", "1,1", "--write", "missions/guard.esm"],
            "is a mission",
            2,
        ),
        (["--way", "1,1", "--seed", "1"], "cannot be used with", 2),
    ] {
        let refused = esm(&[&["tune"][..], &arguments].concat()).ended(status);
        assert!(refused.err.contains(said), "{}", refused.err);
    }
    let nowhere = esm(&["tune", "--turns", "1,1"]).ended(2);
    assert!(
        nowhere.err.contains("--write robot.toml"),
        "{}",
        nowhere.err
    );
    assert_eq!(fs::read_to_string(&path).unwrap(), with_base);
}
