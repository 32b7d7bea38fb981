//! Commands that work out where a robot has gone, as processes: what they print, and with which
//! exit status they end.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::fs;
use std::process::{Command, Output};

use serde_json::Value;

/// The folder of a test, and `esm` in it.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new(files: &[(&str, &str)]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            fs::write(folder.path().join(name), text).unwrap();
        }
        Self(folder)
    }

    /// Exit status, standard output and standard error of a command.
    fn esm(&self, arguments: &str) -> (i32, String, String) {
        let Output {
            status,
            stdout,
            stderr,
        } = Command::new(std::env::var_os("CARGO_BIN_EXE_esm").unwrap())
            .args(arguments.split_whitespace())
            .current_dir(self.0.path())
            .output()
            .unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        (status.code().unwrap(), text(stdout), text(stderr))
    }

    /// What a command says in JSON, on one line and nowhere else.
    fn json(&self, arguments: &str) -> Value {
        let (status, out, err) = self.esm(arguments);
        assert_eq!((status, err.as_str()), (0, ""), "{arguments}");
        assert_eq!(out.matches('\n').count(), 1, "{out}");
        serde_json::from_str(&out).unwrap()
    }
}

/// A wheel with a rim of one metre, and a tick a millimetre.
const METRE: &str = "--ticks-per-rev 1000 --wheel-radius-mm 159.15494309189535 --base-mm 200";

#[test]
fn a_log_is_told_for_programs_and_for_people() {
    let folder = Folder::new(&[("log.csv", "t_us,left,right\n0,65530,5\n10,494,1005\n")]);
    let said = folder.json(&format!("odometry log.csv {METRE} --json"));
    // An arc of 0.75 m that turns by 2.5 rad has a radius of 0.3 m.
    for (key, expected) in [
        ("x_mm", 300.0 * libm::sin(2.5)),
        ("y_mm", 300.0 * (1.0 - libm::cos(2.5))),
        ("theta_deg", 2.5_f64.to_degrees()),
        ("distance_mm", 750.0),
        ("rotation_deg", 2.5_f64.to_degrees()),
    ] {
        let value = said[key].as_f64().unwrap();
        assert!((value - expected).abs() < 1e-9, "{key}: {said}");
    }
    assert_eq!(
        (&said["rows"], &said["counter_bits"]),
        (&2.into(), &16.into())
    );
    let (status, out, _) = folder.esm(&format!("odometry log.csv {METRE}"));
    assert!(
        status == 0 && out.contains("750.000 mm, forwards less"),
        "{out}"
    );
}

#[test]
fn a_wheel_that_turns_far_at_once_is_doubted_unless_the_width_is_said() {
    let folder = Folder::new(&[("log.csv", "0,0,0\n1,40000,40000\n")]);
    let (status, _, err) = folder.esm(&format!("odometry log.csv {METRE}"));
    assert_eq!(status, 0);
    assert!(
        err.contains("log.csv:2: a wheel turns by 25536 ticks"),
        "{err}"
    );
    let said = folder.json(&format!(
        "odometry log.csv {METRE} --counter-bits 32 --json"
    ));
    assert!((said["distance_mm"].as_f64().unwrap() - 40_000.0).abs() < 1e-6);
}

#[test]
fn squares_tell_the_wheels_from_a_table_or_from_the_command_line() {
    let table = "direction,x_mm,y_mm\ncw,-50,-70\ncw,-70,-50\nccw,-20,20\n";
    let folder = Folder::new(&[("squares.csv", table)]);
    let measures = "--side-mm 1000 --base-mm 200 --json";
    let said = folder.json(&format!("umbmark squares.csv {measures}"));
    for (key, expected) in [
        ("e_max_syst_mm", 84.852_813_742),
        ("alpha_deg", 1.145_915_590),
        ("beta_deg", 0.572_957_795),
        ("radius_mm", 100_000.416_667_882),
        ("base_mm", 202.579_320_0),
        ("e_b", 1.012_896_600),
        ("e_d", 1.002_027_839),
        ("left_diameter_factor", 0.998_987_108),
        ("right_diameter_factor", 1.001_012_892),
    ] {
        let value = said[key].as_f64().unwrap();
        assert!((value / expected - 1.0).abs() < 1e-7, "{key}: {said}");
    }
    assert_eq!(said["cw"]["runs"], 2);
    assert_eq!(said["ccw"]["x_mm"], -20.0);
    let flags = "umbmark --cw -50,-70 --cw -70,-50 --ccw -20,20";
    assert_eq!(folder.json(&format!("{flags} {measures}")), said);
    let (status, out, _) = folder.esm("umbmark squares.csv --side-mm 1000 --base-mm 200");
    assert!(
        status == 0 && out.contains("202.58 mm in the place of 200 mm"),
        "{out}"
    );
    let flat = "umbmark --cw -1,-1 --ccw -1,1 --side-mm 1000 --base-mm 200 --json";
    assert!(folder.json(flat)["radius_mm"].is_null());
}

#[test]
fn squares_that_say_nothing_are_told_with_the_status_of_the_manual() {
    let folder = Folder::new(&[
        ("one.csv", "cw,1,2\n"),
        ("left.csv", "cw,1,2\nleft,1,2\n"),
        ("good.csv", "cw,1,2\nccw,1,2\n"),
    ]);
    for (arguments, status, said) in [
        ("good.csv --base-mm 200", 0, ""),
        (
            "one.csv --base-mm 200",
            1,
            "one.csv: runs clockwise: 1, counter-clockwise: 0",
        ),
        (
            "left.csv --base-mm 200",
            1,
            "left.csv:2: the direction is `left`",
        ),
        (
            "none.csv --base-mm 200",
            1,
            "cannot read the table of squares none.csv",
        ),
        ("good.csv --base-mm 2000", 1, "shorter than the wheel base"),
        ("--cw 1,2 --base-mm 200", 2, "counter-clockwise: 0"),
        ("--cw 1;2 --base-mm 200", 2, "expected two numbers"),
        ("good.csv --cw 1,2 --base-mm 200", 2, "cannot be used with"),
        ("--base-mm 200", 2, "required"),
        ("good.csv --base-mm 0", 2, "above zero"),
        ("good.csv", 2, "--base-mm"),
    ] {
        let (found, _, err) = folder.esm(&format!("umbmark {arguments} --side-mm 1000"));
        assert_eq!(found, status, "{arguments}: {err}");
        assert!(err.contains(said), "{arguments}: {err}");
    }
}

#[test]
fn what_is_wrong_is_told_with_its_place_and_the_status_of_the_manual() {
    let folder = Folder::new(&[
        ("empty.csv", ""),
        ("words.csv", "t_us,left,right\n0,1,2\n5,x,3\n"),
        ("columns.csv", "t_us,left\n0,1\n"),
        ("wide.csv", "0,0,0\n1,2,70000\n"),
        ("good.csv", "0,0,0\n"),
    ]);
    let measured = |log: &str, more: &str| format!("odometry {log} {METRE} {more}");
    for (arguments, status, said) in [
        (measured("good.csv", ""), 0, ""),
        (
            measured("empty.csv", "--json"),
            1,
            "empty.csv: there are no rows",
        ),
        (measured("words.csv", ""), 1, "words.csv:3: left is `x`"),
        (
            measured("columns.csv", ""),
            1,
            "columns.csv:1: there is no column `right`",
        ),
        (
            measured("wide.csv", "--counter-bits 16"),
            1,
            "wide.csv:2: right is 70000",
        ),
        (
            measured("none.csv", ""),
            1,
            "cannot read the tick log none.csv",
        ),
        (
            measured("good.csv", "--counter-bits 8"),
            2,
            "possible values: 16, 32, 64",
        ),
        ("odometry good.csv".to_owned(), 2, "--base-mm"),
        (
            measured("good.csv", "").replace(" 200", " 0"),
            2,
            "above zero",
        ),
        (
            measured("good.csv", "").replace(" 200", " -1"),
            2,
            "above zero",
        ),
        (
            measured("good.csv", "").replace(" 1000", " x"),
            2,
            "expected a number",
        ),
    ] {
        let (found, _, err) = folder.esm(&arguments);
        assert_eq!(found, status, "{arguments}: {err}");
        assert!(err.contains(said), "{arguments}: {err}");
    }
}

/// The method, held against a body whose wheel base is known.
#[test]
fn driven_squares_tell_the_wheel_base_of_the_body_that_drove_them() {
    let folder = Folder::new(&[]);
    for (true_base_mm, e_max_mm) in [
        ("201.5", 0.0..20.0),
        ("206", 80.0..130.0),
        ("196", 80.0..150.0),
    ] {
        let run = format!("umbmark run --seeds 1..=8 --true-base-mm {true_base_mm} --json");
        let said = folder.json(&run);
        for way in ["cw", "ccw"] {
            assert_eq!(said[way]["runs"], 8, "{said:#}");
        }
        let off_mm = said["base_mm"].as_f64().unwrap() - true_base_mm.parse::<f64>().unwrap();
        assert!(off_mm.abs() < 0.4, "{true_base_mm}: {said:#}");
        let found_mm = said["e_max_syst_mm"].as_f64().unwrap();
        assert!(e_max_mm.contains(&found_mm), "{true_base_mm}: {said:#}");
    }
}

#[test]
fn the_table_of_driven_squares_says_the_same_as_the_drive() {
    let folder = Folder::new(&[("mission.esm", "")]);
    let (status, told, note) = folder.esm("umbmark run --seeds 3..=4 -o squares.csv");
    assert_eq!(
        (status, note.as_str()),
        (0, "4 squares in squares.csv\n"),
        "{told}"
    );
    let table = fs::read_to_string(folder.0.path().join("squares.csv")).unwrap();
    assert_eq!(table.lines().count(), 5, "{table}");
    let (status, again, note) = folder.esm("umbmark squares.csv --side-mm 1000 --base-mm 201.5");
    assert_eq!((status, note.as_str()), (0, ""));
    assert_eq!(told, again);
    for (arguments, status, said) in [
        (
            "umbmark run -o mission.esm",
            2,
            "mission.esm would be overwritten",
        ),
        (
            "umbmark run --side-mm 20001",
            2,
            "longer than the robot's tasks drive",
        ),
        (
            "umbmark run --side-mm 100",
            1,
            "shorter than the wheel base",
        ),
        ("umbmark run -o nowhere/squares.csv", 3, "nowhere"),
        ("umbmark --side-mm 1000", 2, "--base-mm"),
    ] {
        let (found, out, err) = folder.esm(arguments);
        assert_eq!((found, out.as_str()), (status, ""), "{arguments}: {err}");
        assert!(err.contains(said), "{arguments}: {err}");
    }
}
