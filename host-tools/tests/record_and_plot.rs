//! `esm record` and `esm plot` as processes: drives as MCAP files and as pictures, and recordings
//! that keep values.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::fs;
use std::path::Path;
use std::process::Command;

use host_tools::recording::file::{self, Frame};
use serde_json::Value;

const PATROL: &str = "../missions/patrol.esm";

/// Runs `esm` here, where `{}` stands for a folder; answers its status, what it says, and what it
/// says of what is wrong.
fn esm(folder: &Path, arguments: &str) -> (i32, String, String) {
    let folder = folder.to_str().unwrap();
    let words = arguments.split_whitespace();
    let done = Command::new(std::env::var_os("CARGO_BIN_EXE_esm").unwrap())
        .args(words.map(|word| word.replace("{}", folder)))
        .env("XDG_CONFIG_HOME", folder)
        .env("ESM_PORTS", "only")
        .env_remove("ESM_KEY")
        .env_remove("ESM_FIRMWARE")
        .output()
        .unwrap();
    let [out, err] = [done.stdout, done.stderr].map(|told| String::from_utf8(told).unwrap());
    (done.status.code().unwrap(), out, err)
}

/// What it prints where all is well.
fn good(folder: &Path, arguments: &str) -> String {
    let (status, out, err) = esm(folder, arguments);
    assert_eq!(status, 0, "{arguments}: {err}");
    out
}

fn json(folder: &Path, arguments: &str) -> Value {
    serde_json::from_str(&good(folder, arguments)).unwrap()
}

/// Drives patrol for twelve seconds.
fn run(more: &str) -> String {
    format!("run {PATROL} --board host --until 12s {more}")
}

/// A frame of a recording that is of no use without values.
fn is_of_values(frame: &Frame) -> bool {
    matches!(frame, Frame::Nets(_) | Frame::Samples(_))
}

fn frames(path: &Path) -> Vec<Frame> {
    file::read(&fs::read(path).unwrap()).unwrap().0
}

/// All records of a recording, one behind the other.
fn records(frames: &[Frame]) -> Vec<u8> {
    let records = frames.iter().map(|frame| match frame {
        Frame::Records(records) => records.as_slice(),
        _ => &[],
    });
    records.collect::<Vec<_>>().concat()
}

#[test]
fn a_recording_keeps_values_beside_the_same_records_and_replays_to_the_same_trace() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    good(folder, &run("--record {}/with.rec --trace {}/with.jsonl"));
    good(folder, &run("--record {}/again.rec"));
    let without = "--record {}/without.rec --no-values --trace {}/without.jsonl";
    good(folder, &run(without));
    let read = |name: &str| fs::read(folder.join(name)).unwrap();
    assert!(read("with.rec") == read("again.rec"), "equal runs differ");
    assert!(read("with.jsonl") == read("without.jsonl"));
    let [with, without] = ["with.rec", "without.rec"].map(|name| frames(&folder.join(name)));
    assert!(with.iter().any(is_of_values));
    assert!(!without.iter().any(is_of_values));
    assert_eq!(records(&with), records(&without));
    good(folder, "replay {}/with.rec --expect {}/without.jsonl");
    good(
        folder,
        "run ../missions/patrol.esm --board host --until 12s --replay {}/with.rec --trace {}/host.jsonl",
    );
    assert!(read("host.jsonl") == read("with.jsonl"));
}

#[test]
fn values_are_kept_as_often_as_is_asked_for_and_of_each_mission() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut counts = Vec::new();
    for (name, sample) in [("a", ""), ("b", "--sample 1s"), ("c", "--sample 0s")] {
        good(folder, &run(&format!("--record {{}}/{name}.rec {sample}")));
        let plotted = json(
            folder,
            &format!("plot {{}}/{name}.rec -o {{}}/p.svg --json"),
        );
        counts.push(plotted["samples"].as_u64().unwrap());
    }
    // Ten a second, one a second, and one behind each macro step of 20 ms, as far as the line has
    // room for them.
    assert!((115..=121).contains(&counts[0]), "{counts:?}");
    assert!((11..=13).contains(&counts[1]), "{counts:?}");
    assert!((300..=601).contains(&counts[2]), "{counts:?}");
    // A test of the command line knows no words with spaces.
    let then = Command::new(std::env::var_os("CARGO_BIN_EXE_esm").unwrap())
        .args(["run", PATROL, "--board", "host", "--until", "12 s"])
        .args(["--then", "6 s ../missions/follow_wall.esm", "--record"])
        .arg(folder.join("then.rec"))
        .output()
        .unwrap();
    assert!(then.status.success(), "{then:?}");
    let plotted = json(folder, "plot {}/then.rec -o {}/then.svg --json");
    assert_eq!(
        plotted["missions"],
        serde_json::json!(["patrol", "follow_wall"])
    );
    let samples = plotted["samples"].as_u64().unwrap();
    assert!((110..=121).contains(&samples), "{plotted}");
}

#[test]
fn a_drive_is_the_same_mcap_file_from_its_mission_and_from_its_recording() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let driven = format!(
        "record {PATROL} --board host --until 12s -o {{}}/driven.mcap --record {{}}/driven.rec --json"
    );
    let told = json(folder, &driven);
    good(folder, &run("--record {}/run.rec"));
    let from_recording = json(folder, "record {}/run.rec -o {}/run.mcap --json");
    let read = |name: &str| fs::read(folder.join(name)).unwrap();
    assert!(read("driven.rec") == read("run.rec"));
    assert!(read("driven.mcap") == read("run.mcap"));
    assert!(read("run.mcap").starts_with(b"\x89MCAP0\r\n"));
    assert_eq!(told, from_recording);
    let channels = told["channels"].as_array().unwrap();
    let messages = |topic: &str, schema: &str| {
        let is_it = |channel: &&Value| channel["topic"] == topic && channel["schema"] == schema;
        let channel = channels.iter().find(is_it);
        let channel = channel.unwrap_or_else(|| panic!("no {topic} of {schema}: {told}"));
        channel["messages"].as_u64().unwrap()
    };
    let poses = messages("/values/position/Track/pose", "foxglove.PoseInFrame");
    let twists = messages("/values/motion/Roam/steps/Ahead/twist", "esm.Twist");
    let ranges = messages("/values/sonars/Listen/ranges", "esm.Ranges");
    assert!(poses > 110 && twists > 110 && ranges > 110, "{told}");
    // It roams from the beginning, halts and roams again.
    assert_eq!(messages("/states/motion", "esm.RegionState"), 3);
    assert!(messages("/transitions", "foxglove.Log") > 10);
    assert_eq!(told["bytes"], read("run.mcap").len());
}

#[test]
fn a_path_that_is_drawn_is_the_way_that_the_robot_drove() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    good(folder, &run("--record {}/run.rec --out {}"));
    let summary: Value =
        serde_json::from_slice(&fs::read(folder.join("summary.json")).unwrap()).unwrap();
    let driven_m = summary["distance_m"].as_f64().unwrap();
    let plotted = json(
        folder,
        "plot {}/run.rec -o {}/run.svg --world office --json",
    );
    let path_m = plotted["path"]["length_m"].as_f64().unwrap();
    assert_eq!(plotted["path"]["net"], "position/Track.pose");
    assert!(
        (path_m - driven_m).abs() < 0.1 * driven_m,
        "{path_m} of {driven_m}"
    );
    let curves = plotted["curves"].as_array().unwrap();
    let units: Vec<&str> = curves
        .iter()
        .map(|it| it["unit"].as_str().unwrap())
        .collect();
    // The twist and both wheels; the twist's turning; eight sonars.
    let expected = [["m/s"; 3].as_slice(), &["rad/s"], &["m"; 8]].concat();
    assert_eq!(units, expected);
    let svg = fs::read_to_string(folder.join("run.svg")).unwrap();
    for word in [
        "speeds",
        "ranges",
        "kitchen",
        "AvoidRight",
        "robot time / s",
    ] {
        assert!(svg.contains(word), "{word}");
    }
    for ending in ["svg", "png"] {
        good(folder, &format!("plot {{}}/run.rec -o {{}}/once.{ending}"));
        good(folder, &format!("plot {{}}/run.rec -o {{}}/again.{ending}"));
        let read = |name: &str| fs::read(folder.join(format!("{name}.{ending}"))).unwrap();
        assert!(read("once") == read("again"), "{ending}");
    }
    assert!(
        fs::read(folder.join("once.png"))
            .unwrap()
            .starts_with(b"\x89PNG")
    );
    let states = json(folder, "plot {}/run.rec -o {}/s.svg --show states --json");
    assert!(states["path"].is_null() && states["curves"] == serde_json::json!([]));
}

#[test]
fn a_recording_without_values_gives_states_and_says_what_it_lacks() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    good(folder, &run("--record {}/run.rec --no-values"));
    for command in [
        "record {}/run.rec -o {}/o.mcap",
        "plot {}/run.rec -o {}/o.svg",
    ] {
        let (status, _, err) = esm(folder, command);
        assert_eq!(status, 0, "{command}: {err}");
        assert!(err.contains("holds no values"), "{command}: {err}");
    }
    let (status, _, err) = esm(folder, "plot {}/run.rec -o {}/p.svg --show path,ranges");
    assert_eq!(status, 1, "{err}");
    assert!(err.contains("--show states"), "{err}");
    assert!(!folder.join("p.svg").exists());
}

#[test]
fn what_a_damaged_recording_holds_before_the_damage_is_written_and_the_rest_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    good(folder, &run("--record {}/run.rec"));
    let whole = fs::read(folder.join("run.rec")).unwrap();
    let mut damaged = whole.clone();
    damaged[whole.len() * 3 / 4] ^= 1;
    fs::write(folder.join("damaged.rec"), damaged).unwrap();
    fs::write(folder.join("cut.rec"), &whole[..whole.len() * 3 / 4]).unwrap();
    for (name, status, told) in [
        ("damaged", 1, "was changed since it was written"),
        ("cut", 0, "was broken off"),
    ] {
        for command in ["record", "plot"] {
            let output = format!("{name}-{command}.svg");
            let arguments = format!("{command} {{}}/{name}.rec -o {{}}/{output}");
            let (ended, _, err) = esm(folder, &arguments);
            assert_eq!(ended, status, "{arguments}: {err}");
            assert!(err.contains(told), "{arguments}: {err}");
            assert!(folder.join(output).exists(), "{arguments}");
        }
    }
}

#[test]
fn wrong_usage_and_bad_input_are_told_apart_and_leave_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    good(folder, &run("--record {}/run.rec"));
    fs::write(folder.join("bad.esm"), "machine").unwrap();
    fs::write(folder.join("odd.rec"), "ESMREC\u{9}\0").unwrap();
    for (arguments, expected, told) in [
        ("record {}/run.rec", 2, "--output"),
        ("record {}/run.rec -o {}/run.rec", 2, "name another file"),
        (
            "record {}/run.rec -o {}/o.mcap --until 1s",
            2,
            "leave out `--until`",
        ),
        (
            "record {}/run.rec -o {}/o.mcap --world office",
            2,
            "leave out `--world`",
        ),
        (
            "record {}/run.rec -o {}/o.mcap --sample 1s",
            2,
            "leave out `--sample`",
        ),
        (
            "record {}/run.rec -o {}/o.mcap --port unix:none",
            2,
            "leave out `--port`",
        ),
        ("record -o {}/o.mcap --board host", 2, "leave out `--board`"),
        ("record {}/none.rec -o {}/o.mcap", 1, "none.rec"),
        ("record {}/odd.rec -o {}/o.mcap", 1, "form 9"),
        ("record {}/bad.esm --board host -o {}/o.mcap", 1, ""),
        (
            "record ../missions/patrol.esm --board none -o {}/o.mcap",
            2,
            "none",
        ),
        (
            "record ../missions/patrol.esm --board host --world none -o {}/o.mcap",
            1,
            "no world",
        ),
        ("record {}/run.rec -o {}/no/o.mcap", 3, "no/o.mcap"),
        (
            "record -o {}/o.mcap --port unix:/no/such/socket",
            3,
            "/no/such/socket",
        ),
        ("plot {}/run.rec", 2, "--output"),
        ("plot {}/run.rec -o {}/run.rec", 2, "name another file"),
        ("plot {}/run.rec -o {}/o.svg --show tasks", 2, "path"),
        ("plot {}/bad.esm -o {}/o.svg", 1, "no recording"),
        ("plot {}/run.rec -o {}/o.svg --world none", 1, "no world"),
        ("plot {}/run.rec -o {}/no/o.svg", 3, "no/o.svg"),
        (
            "run ../missions/patrol.esm --board host --until 1s --sample 1s",
            2,
            "--record",
        ),
        (
            "run ../missions/patrol.esm --board host --until 1s --no-values",
            2,
            "--record",
        ),
    ] {
        let (status, _, err) = esm(folder, arguments);
        assert_eq!(status, expected, "{arguments}: {err}");
        assert!(err.contains(told), "{arguments}: {err}");
        for output in ["o.mcap", "o.svg"] {
            assert!(!folder.join(output).exists(), "{arguments}");
        }
    }
}
