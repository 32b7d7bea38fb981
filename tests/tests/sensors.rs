//! Recorded ranges in the place of a world.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::path::Path;

use esm_tests::command::{esm, root};

/// How many sonars the array has.
const SONARS: usize = 24;

/// The sonars that look ahead and to the left, in their order from 0.
const AHEAD: std::ops::Range<usize> = 10..15;
const LEFT: std::ops::Range<usize> = 17..20;

/// Rows of ranges in millimetres: what decides is at its limits, and around them. Pseudo-random,
/// the same in each run.
fn rows(count: usize) -> Vec<[u32; SONARS]> {
    const LIMITS_MM: [u32; 6] = [450, 495, 900, 1_200, 2_500, 5_000];
    let mut state: u32 = 1;
    let mut random = |below: u32| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 16) % below
    };
    let mut range_mm = || LIMITS_MM[random(6) as usize] + random(3) - 1;
    let row = |_| {
        let (ahead_mm, left_mm) = (range_mm(), range_mm());
        std::array::from_fn(|sonar| {
            let others_mm = range_mm();
            if AHEAD.contains(&sonar) {
                ahead_mm.max(others_mm)
            } else if LEFT.contains(&sonar) {
                left_mm.max(others_mm)
            } else {
                others_mm
            }
        })
    };
    (0..count).map(row).collect()
}

/// The rule that was published, on whole millimetres.
fn published(row: &[u32; SONARS]) -> &'static str {
    let least_mm = |sector: std::ops::Range<usize>| row[sector].iter().copied().min().unwrap();
    match (least_mm(AHEAD), least_mm(LEFT)) {
        (..=900, _) => "SharpRight",
        (_, 901..) => "SlightLeft",
        (_, ..=494) => "SlightRight",
        (_, _) => "Forward",
    }
}

fn write(folder: &Path, rows: &[[u32; SONARS]]) -> String {
    let line = |row: &[u32; SONARS]| {
        let cells: Vec<String> = (row.iter())
            .map(|mm| format!("{}.{:03}", mm / 1_000, mm % 1_000))
            .collect();
        cells.join(",") + "\n"
    };
    let path = folder.join("ranges.csv");
    std::fs::write(&path, rows.iter().map(line).collect::<String>()).unwrap();
    path.to_str().unwrap().to_owned()
}

/// The state of the region `decision` after each macro step of a trace.
fn decisions(trace: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(trace).unwrap();
    let steps = (text.lines())
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap())
        .filter(|record| record["kind"] == "step");
    let state = |step: serde_json::Value| {
        let active = step["active"].as_array().unwrap().clone();
        let mut paths = active.iter().filter_map(|path| path.as_str());
        let found = paths.find_map(|path| path.strip_prefix("decision/").map(str::to_owned));
        found.unwrap()
    };
    steps.map(state).collect()
}

#[test]
fn each_row_is_decided_once_as_published_on_both_boards() {
    for (board, count) in [("host", 3_000), ("lm3s6965", 60)] {
        let folder = tempfile::tempdir().unwrap();
        let rows = rows(count);
        let table = write(folder.path(), &rows);
        let trace = folder.path().join("trace.jsonl");
        esm(&[
            "run",
            "missions/wall_rules.esm",
            "--board",
            board,
            "--sensors",
            &table,
            "--trace",
            trace.to_str().unwrap(),
        ])
        .good();
        let decided = decisions(&trace);
        let waited = decided
            .iter()
            .take_while(|state| *state == "Undecided")
            .count();
        assert_eq!(waited, 2, "the first picture is there after a whole row");
        let expected: Vec<&str> = rows.iter().map(published).collect();
        assert_eq!(decided[waited..], expected, "{board}");
        for state in ["SharpRight", "SlightLeft", "SlightRight", "Forward"] {
            assert!(expected.contains(&state), "{board}: no row says {state}");
        }
    }
}

#[test]
fn the_run_ends_earlier_where_somebody_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let table = write(folder.path(), &rows(100));
    let trace = folder.path().join("trace.jsonl");
    for (until, steps) in [("1 s", 9), ("60 s", 102)] {
        esm(&[
            "run",
            "missions/wall_rules.esm",
            "--board",
            "host",
            "--sensors",
            &table,
            "--until",
            until,
            "--trace",
            trace.to_str().unwrap(),
        ])
        .good();
        assert_eq!(decisions(&trace).len(), steps, "until {until}");
    }
}

#[test]
fn the_ring_sees_what_was_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("ring.csv");
    // Ahead something comes nearer, and is near from the 21st row on.
    let row = |number: u32| {
        let ahead_m = if number < 20 { "1.500" } else { "0.200" };
        format!("{ahead_m},2,2,2,2,2,2,2\n")
    };
    std::fs::write(&table, (0..40).map(row).collect::<String>()).unwrap();
    let trace = folder.path().join("trace.jsonl");
    esm(&[
        "run",
        "missions/follow_wall.esm",
        "--board",
        "host",
        "--sensors",
        table.to_str().unwrap(),
        "--trace",
        trace.to_str().unwrap(),
    ])
    .good();
    let text = std::fs::read_to_string(&trace).unwrap();
    let transitions = (text.lines())
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap())
        .filter(|record| record["kind"] == "transition" && record["to"] == "motion/Corner");
    let first_us = transitions.map(|it| it["t_us"].as_u64().unwrap()).next();
    // Row 20 begins after 20 rounds of 80 ms; two windows and a macro step later it is seen.
    let first_us = first_us.expect("a corner is seen");
    assert!((1_600_000..=1_760_000).contains(&first_us), "{first_us}");
}

#[test]
fn tables_that_do_not_fit_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("ranges.csv");
    let row = vec!["1"; SONARS].join(",");
    for (mission, text, status, expected) in [
        ("wall_rules", "", 1, "it has no ranges"),
        (
            "wall_rules",
            "1,2\n",
            1,
            "has 2 columns, and the mission has 24 sonars",
        ),
        (
            "patrol",
            row.as_str(),
            1,
            "has 24 columns, and the mission has 8 sonars",
        ),
        ("stand_by", row.as_str(), 1, "the mission has no sonars"),
        (
            "wall_rules",
            "front,left\n",
            1,
            "line 1, column 1: `front` is no range",
        ),
    ] {
        std::fs::write(&table, text).unwrap();
        let mission = format!("missions/{mission}.esm");
        let table = table.to_str().unwrap();
        let said = esm(&["run", &mission, "--board", "host", "--sensors", table]);
        assert_eq!(said.status, Some(status), "{}", said.err);
        assert!(said.err.contains(expected), "{}", said.err);
    }
    let missing = [
        "run",
        "missions/wall_rules.esm",
        "--sensors",
        "/no/such/table",
    ];
    let said = esm(&missing);
    assert_eq!(said.status, Some(1));
    assert!(said.err.contains("/no/such/table"), "{}", said.err);
    let both = [&missing[..], &["--world", "office"]].concat();
    assert_eq!(esm(&both).status, Some(2));
    assert!(root().join("missions/wall_rules/ranges.csv").is_file());
}
