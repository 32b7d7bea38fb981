//! A robot that is told where it is: by its mission, over the link, and in a run.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::f32::consts::FRAC_PI_2;
use std::path::Path;

use esm_link::position::Correction;
use esm_tests::command::{Robot, esm, firmware_with, root};
use esm_tests::host_drive::{self, world};
use host_tools::run::by_hand::{ByHand, Placed};
use host_tools::run::drive::Plan;
use host_tools::script::{Script, read};
use rt_firmware::tasks::Pose;

/// Far from where it is, and looking elsewhere.
const ELSEWHERE: Placed = Placed {
    at_us: 3_000_000,
    correction: Correction::Set,
    by: Pose {
        x_m: 5.0,
        y_m: 0.0,
        heading_rad: FRAC_PI_2,
    },
};

fn script(text: &str) -> Script {
    let source = std::fs::read_to_string(root().join("missions/rover.esm")).unwrap();
    let tasks = host_tools::lang::load_text("rover.esm", &source).model;
    let tasks = tasks.unwrap().tasks;
    read("a.script", text, &tasks).script.unwrap()
}

/// Where the robot was all along, in the world, in a run of 12 s in which it goes to a point.
fn path(placed: Vec<Placed>) -> Vec<(u64, f64, f64)> {
    let run = host_drive::driven(Plan {
        until_us: Some(12_000_000),
        by_hand: ByHand {
            script: Some((500_000, script("go_to x_m = 1.5, y_m = 0.5\n"))),
            placed,
            ..ByHand::default()
        },
        ..host_drive::plan(&root().join("missions/by_hand.esm"), world("empty"))
    });
    let path = run.plant.statistics().path();
    (path.iter())
        .map(|sample| {
            let at = sample.pose.position;
            (sample.t_us, at.x_m, at.y_m)
        })
        .collect()
}

#[test]
fn a_behaviour_goes_on_to_its_point_as_if_nobody_had_told_the_robot_where_it_is() {
    let alone = path(Vec::new());
    let (_, x_m, y_m) = alone[0];
    let (_, end_x_m, end_y_m) = alone[alone.len() - 1];
    let way_m = libm::hypot(end_x_m - x_m, end_y_m - y_m);
    assert!((way_m - libm::hypot(1.5, 0.5)).abs() < 0.05, "{way_m}");
    let by = Placed {
        at_us: 4_000_000,
        correction: Correction::Difference,
        by: Pose {
            x_m: -0.7,
            y_m: 0.9,
            heading_rad: -0.5,
        },
    };
    // To the last bit.
    assert_eq!(path(vec![ELSEWHERE, by]), alone);
}

/// A mission that sets its position after a second, corrects it after two, and then asks for too
/// much.
const SETS: &str = r#"
use "rover.esm";

interpreter slot 1;
slot 1 period 20 ms duration 2 ms;
slot 2 period 10 ms duration 4 ms;
slot 3 period 40 ms duration 2 ms;

machine Sets {
    region position { task Track: Odometry; initial -> Track; }
    region place { task Place: GlobalPosition; initial -> Place; }
    region told {
        state Waits timeout 1 s;
        task Set: SetPosition with { x_m = 10.0, y_m = -20.0, heading_rad = 1.5 };
        state Between timeout 1 s;
        task Correct: CorrectPosition with { x_m = 0.5, heading_rad = 0.25 };
        task Far: SetPosition with { x_m = 1000.0, y_m = -20.0, heading_rad = 0.0 };
        task Beyond: CorrectPosition with { x_m = 0.5 };
        state Done;
        state Failed;

        initial -> Waits;
        Waits -> Set [timeout];
        Set -> Between [exit and not .failed];
        Between -> Correct [timeout];
        Correct -> Far [exit and not .failed];
        Far -> Beyond [exit and not .failed];
        Beyond -> Failed [exit and .failed];
        Beyond -> Done [exit and not .failed];
    }

    path Track.pose -> Place.pose;
    path Place.made -> Place.global, Set.global, Correct.global, Far.global, Beyond.global;
}
"#;

fn global(robot: &Robot) -> (f64, f64, f64) {
    let told = robot.esm(&["position", "--json"]).good();
    let told = told.json();
    assert_eq!(told["global"], true);
    let number = |name: &str| told[name].as_f64().unwrap();
    (number("x_m"), number("y_m"), number("heading_rad"))
}

#[track_caller]
fn assert_near(found: (f64, f64, f64), expected: (f64, f64, f64)) {
    let off = [
        found.0 - expected.0,
        found.1 - expected.1,
        found.2 - expected.2,
    ];
    assert!(
        off.iter().all(|off| off.abs() < 1e-3),
        "{found:?}, not {expected:?}"
    );
}

/// A mission in a folder beside `rover.esm`.
fn mission_in(folder: &Path, name: &str, text: &str) -> std::path::PathBuf {
    let rover = root().join("missions/rover.esm");
    std::fs::copy(rover, folder.join("rover.esm")).unwrap();
    let file = folder.join(name);
    std::fs::write(&file, text).unwrap();
    file
}

#[test]
fn a_mission_sets_and_corrects_its_position_and_is_told_what_was_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = mission_in(folder.path(), "sets.esm", SETS);
    let run = ["run", file.to_str().unwrap(), "--board", "host", "--until"];
    let told = esm(&[&run[..], &["4 s", "--world", "empty"]].concat()).good();
    for line in [
        "told/Waits -> told/Set",
        "told/Set -> told/Between",
        "told/Correct -> told/Far",
        "told/Far -> told/Beyond",
        "told/Beyond -> told/Failed",
    ] {
        assert!(told.out.contains(line), "{line}: {}", told.out);
    }
    let robot = Robot::start_with("host", None, &["--world", "empty"]);
    robot.give(&file);
    std::thread::sleep(std::time::Duration::from_secs(3));
    // What was refused has changed nothing.
    assert_near(global(&robot), (1_000.0, -20.0, 0.0));
}

#[test]
fn a_robot_is_told_over_the_link_where_it_is_and_says_where_it_believes_itself_to_be() {
    let robot = Robot::start_with("host", None, &["--world", "empty"]);
    robot.give(&root().join("missions/by_hand.esm"));
    assert_near(global(&robot), (0.0, 0.0, 0.0));
    let set = "x_m = 3, y_m = -4, heading_rad = 1.5707964";
    let told = robot.esm(&["position", "--set", set]).good();
    assert_eq!(
        told.out,
        "x 3.000 m, y -4.000 m, heading 1.571 rad, in the global frame\n"
    );
    robot
        .esm(&["position", "--by", "x_m = 0.5, heading_rad = -0.5"])
        .good();
    assert_near(global(&robot), (3.0, -3.5, f64::from(FRAC_PI_2) - 0.5));
    for (words, status, what) in [
        (["--by", "x_m = 2"], 2, "at most 1 m"),
        (["--set", "x_m = 2"], 2, "`y_m` is missing"),
        (
            ["--set", "x_m = nan, y_m = 0, heading_rad = 0"],
            2,
            "1000 m",
        ),
    ] {
        let refused = robot.esm(&[&["position"][..], &words].concat());
        assert_eq!(refused.status, Some(status), "{}", refused.err);
        assert!(refused.err.contains(what), "{}", refused.err);
    }
    // A mission that knows of no global position.
    robot.give(&root().join("missions/errand.esm"));
    let refused = robot.esm(&["position", "--by", "x_m = 0.5"]);
    assert_ne!(refused.status, Some(0));
    assert!(
        refused.err.contains("no task `GlobalPosition`"),
        "{}",
        refused.err
    );
    let counted = robot.esm(&["position"]).good();
    assert!(
        counted.out.contains("from where it was switched on"),
        "{}",
        counted.out
    );
}

/// What a run leaves in its folder.
fn left(words: &[&str]) -> (String, String) {
    let folder = tempfile::tempdir().unwrap();
    let run = ["run", "missions/by_hand.esm", "--world", "empty", "--out"];
    esm(&[&run[..], &[folder.path().to_str().unwrap()], words].concat()).good();
    let file = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    (file("trace.jsonl"), file("path.svg"))
}

#[test]
fn positions_are_the_same_on_the_emulated_board_and_on_the_host() {
    let firmware = firmware_with("lm3s6965", "behaviours");
    let told = [
        "--until",
        "8 s",
        "--script",
        "missions/square.script",
        "--position",
        "3 s set x_m = 5, y_m = 0, heading_rad = 1.57",
        "--position",
        "4 s by x_m = -0.3, heading_rad = 0.1",
    ];
    let host = left(&[&told[..], &["--board", "host"]].concat());
    let emulated = ["--firmware", firmware.to_str().unwrap()];
    let there = left(&[&told[..], &emulated].concat());
    assert!(host.0 == there.0, "the traces differ");
    assert!(host.1 == there.1, "the paths differ");
}
