//! `esm bench missions`: the missions that ship, over seeds; what it says of a mission that looks
//! at nothing; and what it says of mistakes.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::path::Path;

use esm_tests::command::{Done, esm, root};
use esm_tests::environment;
use serde_json::Value;

/// Drives ahead for ever, without looking: its sonars are not even on.
const BLIND: &str = r#"use "MISSIONS/rover.esm";
interpreter slot 1;
slot 1 period 20 ms duration 2 ms;
slot 2 period 20 ms duration 4 ms;
slot 3 period 40 ms duration 2 ms;
machine Blind {
    region position { task Track: Odometry; initial -> Track; }
    region motion { task Ahead: Steer with { speed_m_per_s = 0.3 }; initial -> Ahead; }
    region wheels { task Drive: WheelSpeed; initial -> Drive; }
    path Track.speeds -> Drive.speeds;
    path Ahead.twist -> Drive.twist;
}
"#;

/// Somebody steps in on the way of a robot that drives along x from 0,1.
const HALL: &str = "world hall\nstart 0,1 0\nwall -1,0 9,0 9,2 -1,2 -1,0\n";

fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let missions = root().join("missions").display().to_string();
    for (name, text) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text.replace("MISSIONS", &missions)).unwrap();
    }
    folder
}

/// `esm bench missions` with `{}` in its arguments for a folder.
fn bench(folder: &Path, arguments: &[&str]) -> Done {
    let folder = folder.display().to_string();
    let mut all = vec!["bench".to_owned(), "missions".to_owned()];
    all.extend(arguments.iter().map(|word| word.replace("{}", &folder)));
    esm(&all)
}

fn rows(out: &str) -> Vec<Value> {
    let lines = out.lines();
    lines
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

/// The law of all missions that have a goal file. `ESM_BENCH_SEEDS` says how many seeds.
#[test]
fn missions_reach_their_goals_and_touch_nothing_that_they_could_have_avoided() {
    let seeds = environment::number("ESM_BENCH_SEEDS", 4);
    let missions = root().join("missions");
    let seeds = format!("1..={seeds}");
    let arguments = ["{}", "--seeds", &seeds];
    println!("{}", bench(&missions, &arguments).good().out);
    let out = bench(&missions, &[arguments.as_slice(), &["--json"]].concat())
        .good()
        .out;
    let rows = rows(&out);
    let (total, rows) = rows.split_last().unwrap();
    assert!(rows.len() >= 24, "{} runs", rows.len());
    assert_eq!(total["runs"], rows.len());
    for row in rows {
        assert_eq!(row["avoidable"], 0, "{row:#}");
        assert_eq!(row["fault"], Value::Null, "{row:#}");
        // A robot that has lost a sonar may stand, for safety's sake.
        let is_whole = row["dead_sonars"].as_array().unwrap().is_empty();
        assert!(row["at_goal"] == true || !is_whole, "{row:#}");
    }
    // The errand comes home in 95 of 100, whatever sonar is lost: as a mission and as a script.
    for (key, file) in [("mission", "errand.esm"), ("script", "errand.script")] {
        for world in ["office_floor", "shut_doors"] {
            let errands = rows.iter().filter(|row| {
                let is_it = row[key].as_str().is_some_and(|named| named.ends_with(file));
                is_it && row["world"] == world
            });
            let missed = errands.clone().filter(|row| row["at_goal"] != true).count();
            let driven = errands.count();
            assert!(driven > 0, "nobody drove {file} in {world}");
            assert!(
                missed * 20 <= driven,
                "{file} in {world}: {missed} of {driven}"
            );
        }
    }
    let reached = total["at_goal"].as_u64().unwrap();
    assert!(reached * 100 >= 90 * rows.len() as u64, "{total}");
}

#[test]
fn what_is_said_does_not_depend_on_how_many_run_at_the_same_time() {
    let missions = root().join("missions");
    for more in [&["--json"][..], &[]] {
        let [one, several] = ["1", "5"].map(|jobs| {
            let arguments = ["{}", "--seeds", "4..=6", "--jobs", jobs];
            bench(&missions, &[arguments.as_slice(), more].concat())
                .good()
                .out
        });
        assert!(!one.is_empty());
        assert_eq!(one, several);
    }
}

/// Of a robot that looks at nothing the walls and most people could have been avoided; one who
/// steps in right before it could not.
#[test]
fn touches_are_told_with_what_the_oracle_says() {
    // It drives 0.3 m/s from the first second on: at 5 s it is about 1.4 m from its start.
    let people = "person 2.3,1 0.2 from 5 s to 10 s\n";
    let files = folder(&[
        ("blind.esm", BLIND),
        ("far.world", &format!("{HALL}{people}")),
        ("always.world", &format!("{HALL}person 2.3,1 0.2\n")),
        ("wall.world", &HALL.replace('9', "3")),
    ]);
    for (world, touched, line) in [
        ("far", "person", Some(4)),
        ("always", "person", Some(4)),
        ("wall", "wall", None),
    ] {
        let world = format!("{{}}/{world}.world");
        let arguments = [
            "{}/blind.esm",
            "--world",
            &world,
            "--until",
            "12 s",
            "--goal",
            "3,1 within 0.1 m",
            "--seeds",
            "1..=2",
            "--no-vary",
            "--strict",
        ];
        let told = bench(files.path(), &arguments).ended(1).out;
        assert!(told.contains(": avoidable"), "{told}");
        assert!(told.contains(" m off its goal; "), "{told}");
        assert!(told.contains("  again: esm run "), "{told}");
        let json = [arguments.as_slice(), &["--json"]].concat();
        let rows = rows(&bench(files.path(), &json).ended(1).out);
        assert_eq!(rows.len(), 3, "{rows:#?}");
        for row in &rows[..2] {
            assert_eq!(row["at_goal"], false, "{row:#}");
            assert_eq!(row["collisions"], 1, "{row:#}");
            assert_eq!(row["avoidable"], 1, "{row:#}");
            let touch = &row["touches"][0];
            assert_eq!(touch["touched"], touched, "{row:#}");
            assert_eq!(touch["line"].as_u64(), line, "{row:#}");
            let stepped_in = touch["there_from_s"].as_f64().unwrap() > 0.0;
            assert_eq!(touch["needed_m"].is_number(), stepped_in, "{row:#}");
        }
        assert_eq!(rows[2]["missed"], 2, "{rows:#?}");
    }
}

/// A script drives as `esm run` lets it drive, and its row is called by it.
#[test]
fn a_script_is_judged_as_a_mission_is() {
    let missions = root().join("missions");
    let by_hand = "{}/by_hand.esm";
    let arguments = [
        by_hand,
        "--script",
        "{}/square.script",
        "--world",
        "empty",
        "--until",
        "40 s",
        "--goal",
        "start within 0.25 m",
        "--seeds",
        "2",
        "--strict",
    ];
    let told = bench(&missions, &arguments).good().out;
    assert!(told.contains("\nsquare.script  empty "), "{told}");
    let json = [&arguments[..], &["--json"]].concat();
    let row = rows(&bench(&missions, &json).good().out).remove(0);
    assert_eq!(row["at_goal"], true, "{row:#}");
    let path = |file: &str| missions.join(file).display().to_string();
    assert_eq!(row["script"], path("square.script"));
    let run = esm(&[
        "run",
        &path("by_hand.esm"),
        "--board",
        "host",
        "--world",
        "empty",
        "--until",
        "40 s",
        "--script",
        &path("square.script"),
        "--seed",
        "2",
        "--vary",
        "--json",
    ]);
    let run: Value = serde_json::from_str(&run.good().out).unwrap();
    assert_eq!(run["distance_m"], row["distance_m"]);
    // Without time for its last side it has missed its goal; it is said how to see it again.
    let short = arguments.map(|word| if word == "40 s" { "20 s" } else { word });
    let told = bench(&missions, &short).ended(1).out;
    let again = format!("--seed 2 --vary --script {}", path("square.script"));
    assert!(told.contains(&again), "{told}");
}

/// One run as `esm run` tells it is the one of the bench.
#[test]
fn a_run_of_a_bench_can_be_seen_again() {
    let missions = root().join("missions");
    let row = |seed: &str| {
        let out = bench(&missions, &["{}/guard.esm", "--seeds", seed, "--json"]);
        rows(&out.good().out).remove(0)
    };
    let mission = missions.join("guard.esm").display().to_string();
    for seed in ["3", "6"] {
        let row = row(seed);
        let arguments = [
            "run", &mission, "--board", "host", "--world", "visitors", "--until", "60 s", "--seed",
            seed, "--vary", "--json",
        ];
        let run: Value = serde_json::from_str(&esm(&arguments).good().out).unwrap();
        for key in ["distance_m", "collisions", "avoidable"] {
            assert_eq!(run[key], row[key], "seed {seed}: {key}");
        }
        let touches = run.get("touches").cloned().unwrap_or(Value::Array(vec![]));
        assert_eq!(touches, row["touches"], "seed {seed}");
        let as_written = arguments.map(|word| if word == "--vary" { "--json" } else { word });
        let as_written = &as_written[..as_written.len() - 1];
        let other: Value = serde_json::from_str(&esm(as_written).good().out).unwrap();
        assert_ne!(other["distance_m"], run["distance_m"], "seed {seed}");
    }
}

#[test]
fn what_is_wrong_with_missions_worlds_and_goals_is_told() {
    let wrong = "machine M { region r { state A; } }";
    let files = folder(&[
        ("blind.esm", BLIND),
        ("wrong.esm", wrong),
        ("wrong.goal", "world empty\nuntil 1 s\ngoal 1 room\n"),
        ("goals/nobody.goal", "world empty\nuntil 1 s\ngoal 1 room\n"),
        ("blind.home.goal", "world empty\nuntil 1 s\ngoal home\n"),
        ("nothing/readme.txt", ""),
        ("sent.esm", BLIND),
        (
            "sent.goal",
            "script absent.script\nworld empty\nuntil 1 s\ngoal 1 room\n",
        ),
        ("square.script", "go_to x_n = 1\n"),
    ]);
    for (arguments, status, said) in [
        (
            &["{}/absent.esm", "--until", "1 s"][..],
            1,
            "cannot read the mission",
        ),
        (
            &["{}/blind.esm", "--world", "empty"],
            2,
            "nobody says when a run of",
        ),
        (
            &["{}/blind.esm", "--world", "empty", "--until", "0 s"],
            2,
            "a run takes time",
        ),
        (
            &["{}/blind.esm", "--world", "emtpy", "--until", "1 s"],
            1,
            "did you mean `empty`?",
        ),
        (&["{}/blind.esm"], 1, "line 3: `home` is no goal"),
        (&["{}/wrong.esm"], 1, "E013"),
        (
            &["{}/goals"],
            1,
            "nobody.goal has no mission: there is none of",
        ),
        (&["{}/nothing"], 1, "has no goal files"),
        (&["{}/absent.goal"], 1, "absent.goal"),
        (
            &["{}", "--world", "empty"],
            2,
            "are for missions that are named",
        ),
        (
            &["{}", "--script", "{}/square.script"],
            2,
            "are for missions that are named",
        ),
        (
            &[
                "{}/blind.esm",
                "--script",
                "{}/square.script",
                "--until",
                "1 s",
            ],
            1,
            "E002",
        ),
        (&["{}/sent.goal"], 1, "cannot read"),
        (&["{}/blind.esm", "--goal", "home"], 2, "`home` is no goal"),
        (
            &["{}/blind.esm", "--seeds", "9..=1"],
            2,
            "write the smaller one first",
        ),
        (&["{}/blind.esm", "--jobs", "0"], 2, "--jobs"),
    ] {
        let done = bench(files.path(), arguments).ended(status);
        assert!(done.err.contains(said), "{arguments:?}: {}", done.err);
        assert!(done.out.is_empty(), "{arguments:?}: {}", done.out);
    }
}

#[test]
fn ctrl_c_ends_a_bench_and_says_how_far_it_came() {
    let mut bench = esm_tests::command::Running::esm(&[
        "bench",
        "missions",
        &root().join("missions/guard.esm").display().to_string(),
        "--seeds",
        "1..=100000",
        "--json",
    ]);
    bench = bench.until("a run", |bench| bench.out().contains("\"seed\":1,"));
    let done = bench.interrupted().ended(3);
    assert!(done.err.contains("ended by Ctrl-C when "), "{}", done.err);
    assert!(!done.out.contains("\"runs\""), "it was not whole");
}
