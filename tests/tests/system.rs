//! Robots with several processors: what `esm system` says of them, and what they do.
//!
//! `ESM_SYSTEM_S` says how many seconds boards in the emulator are compared with those on the host,
//! and `ESM_DRIFT_S` and `ESM_DRIFT_HOST_S` for how long frames are sent by clocks that drift, in
//! the emulator and on the host. `cargo xtask campaign systems drift` does it at full length.
//! `ESM_LINK_BOARDS` says how many boards are there besides those of the host: `cargo xtask
//! campaign links` has all.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fs;
use std::path::PathBuf;

use esm_tests::command::{Done, esm, firmware_with, root};
use esm_tests::environment;
use serde_json::Value;

/// The rover in two that ships.
const ROVER: &str = "missions/head_and_base/head_and_base.system";
const ALL_PINS: &str = "motors, encoders, sonars, analog, gyro, bumpers, outputs";

/// A folder with a system file whose missions are those that ship.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Folder(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a file; `SHIPPED` in it is the folder of the missions that ship.
    fn write(&self, name: &str, text: &str) -> String {
        let path = self.path(name);
        let missions = root().join("missions");
        fs::write(&path, text.replace("SHIPPED", missions.to_str().unwrap())).unwrap();
        path.to_str().unwrap().to_owned()
    }

    /// The rover in two with other words in its files.
    fn rover(&self, system: (&str, &str), head: (&str, &str)) -> String {
        let folder = root().join("missions/head_and_base");
        let read = |name: &str, (old, new): (&str, &str)| {
            let text = fs::read_to_string(folder.join(name)).unwrap();
            assert!(text.contains(old), "{name}: {old}");
            text.replace("\"../rover.esm\"", "\"SHIPPED/rover.esm\"")
                .replace(old, new)
        };
        self.write("base.esm", &read("base.esm", ("", "")));
        self.write("head.esm", &read("head.esm", head));
        self.write("rover.system", &read("head_and_base.system", system))
    }

    /// Runs a system; gives the lines of its trace, and its figures.
    fn run(&self, system: &str, until: &str) -> (Vec<String>, Value) {
        self.run_with(system, until, &[])
    }

    /// The same with more arguments.
    fn run_with(&self, system: &str, until: &str, more: &[&str]) -> (Vec<String>, Value) {
        let trace = self.path("trace.jsonl");
        let trace_path = trace.to_str().unwrap();
        let arguments = [
            "system", "run", system, "--until", until, "--trace", trace_path, "--json",
        ];
        let figures = esm(&[&arguments[..], more].concat()).good().json();
        let text = fs::read_to_string(trace).unwrap();
        (text.lines().map(str::to_owned).collect(), figures)
    }
}

/// The lines of one processor, without what the system's trace has before them.
fn lines_of(trace: &[String], processor: &str) -> Vec<String> {
    let begins = format!("{{\"processor\":\"{processor}\",\"plant_us\":");
    let own = trace.iter().filter_map(|line| line.strip_prefix(&begins));
    own.map(|line| format!("{{{}", line.split_once(',').unwrap().1))
        .collect()
}

/// When a processor goes from one state to another, by plant time.
fn transitions(trace: &[String], processor: &str, from: &str, to: &str) -> Vec<u64> {
    let lines = trace.iter().map(|line| serde_json::from_str(line).unwrap());
    let taken = lines.filter(|line: &Value| {
        line["processor"] == processor && line["from"] == from && line["to"] == to
    });
    taken
        .map(|line| line["plant_us"].as_u64().unwrap())
        .collect()
}

fn check(system: &str) -> Done {
    esm(&["system", "check", system, "--json"])
}

#[test]
fn a_system_of_one_processor_leaves_the_trace_of_a_run() {
    let folder = Folder::new();
    let text = format!("processor only mission \"SHIPPED/patrol.esm\" pins {ALL_PINS};");
    let (trace, figures) = folder.run(&folder.write("one.system", &text), "20 s");
    let alone = folder.path("alone.jsonl");
    let arguments = [
        "run",
        "missions/patrol.esm",
        "--board",
        "host",
        "--until",
        "20 s",
        "--json",
    ];
    let arguments = [&arguments[..], &["--trace", alone.to_str().unwrap()]].concat();
    let summary = esm(&arguments).good().json();
    let alone = fs::read_to_string(alone).unwrap();
    assert_eq!(lines_of(&trace, "only"), alone.lines().collect::<Vec<_>>());
    assert_eq!(figures["distance_m"], summary["distance_m"]);
    assert_eq!(
        figures["processors"][0]["transitions"],
        summary["transitions"]
    );
}

#[test]
fn a_processor_that_only_looks_changes_nothing_for_the_others() {
    let folder = Folder::new();
    // Its activations come between those of the other, and at other times in each period.
    let watch = "interpreter slot 1; slot 1 period 7 ms duration 1 ms;\n\
        machine Watch { region r { state A timeout 50 ms; state B timeout 30 ms; initial -> A;\n\
        A -> B on pulse [timeout]; B -> A on pulse [timeout]; } }";
    folder.write("watch.esm", watch);
    let patrol = format!("processor patrol mission \"SHIPPED/patrol.esm\" pins {ALL_PINS};");
    let alone = folder.run(&folder.write("alone.system", &patrol), "20 s");
    for (order, watched) in [
        (
            "behind",
            format!("{patrol} processor watch mission \"watch.esm\" drift 33 ppm start 1 ms;"),
        ),
        (
            "before",
            format!("processor watch mission \"watch.esm\" start 20 ms; {patrol}"),
        ),
    ] {
        let with = folder.run(&folder.write("with.system", &watched), "20 s");
        assert!(lines_of(&with.0, "watch").len() > 2_000, "{order}");
        assert!(
            lines_of(&with.0, "patrol") == lines_of(&alone.0, "patrol"),
            "{order}"
        );
        assert_eq!(with.1["distance_m"], alone.1["distance_m"], "{order}");
    }
}

#[test]
fn a_rover_in_two_patrols_as_one_does_and_the_same_in_each_run() {
    let folder = Folder::new();
    let alone = [
        "run",
        "missions/patrol.esm",
        "--board",
        "host",
        "--until",
        "120 s",
        "--json",
    ];
    let alone = esm(&alone).good().json();
    let nothing = ("", "");
    let joined = "link base.head to head.base";
    for words in ["", " loss 1 %", " noise 1e-5 delay 1 ms", " over memory"] {
        let system = folder.rover((joined, &format!("{joined}{words}")), nothing);
        let (trace, figures) = folder.run(&system, "120 s");
        let distance_m = figures["distance_m"].as_f64().unwrap();
        let of_one_m = alone["distance_m"].as_f64().unwrap();
        assert!(distance_m > 0.9 * of_one_m, "{words}: {figures}");
        assert_eq!(figures["collisions"], 0, "{words}: {figures}");
        let plant_us = |line: &String| -> u64 {
            let line: Value = serde_json::from_str(line).unwrap();
            line["plant_us"].as_u64().unwrap()
        };
        assert!(trace.iter().map(plant_us).is_sorted(), "{words}");
        if words.contains("noise") {
            assert!(folder.run(&system, "120 s").0 == trace, "{words}");
        }
    }
}

#[test]
fn over_some_runs_a_rover_in_two_drives_as_far_and_sees_as_many_rooms_as_one_does() {
    let folder = Folder::new();
    let joined = "link base.head to head.base";
    let system = folder.rover((joined, &format!("{joined} loss 1 %")), ("", ""));
    let [mut in_two, mut in_one] = [[0.0; 2]; 2];
    let add = |sums: &mut [f64; 2], figures: &Value| {
        assert_eq!(figures["collisions"], 0, "{figures}");
        sums[0] += figures["distance_m"].as_f64().unwrap();
        sums[1] += figures["rooms_entered"].as_array().unwrap().len() as f64;
    };
    for seed in ["2", "3", "4", "5", "6"] {
        let of_run = ["--until", "240 s", "--seed", seed, "--json"];
        let run = |words: &[&str]| esm(&[words, &of_run].concat()).good().json();
        add(&mut in_two, &run(&["system", "run", &system]));
        let patrol = ["run", "missions/patrol.esm", "--board", "host"];
        add(&mut in_one, &run(&patrol));
    }
    for (two, one) in in_two.iter().zip(in_one) {
        assert!(
            *two > 0.9 * one && *two < 1.1 * one,
            "{in_two:?} {in_one:?}"
        );
    }
}

#[test]
fn a_cut_cable_is_told_in_time_and_the_rover_halts_until_it_is_mended() {
    let folder = Folder::new();
    let joined = "link base.head to head.base";
    let cut = format!("{joined} cut 5 s to 8 s");
    let system = folder.rover((joined, &cut), ("", ""));
    let (trace, _) = folder.run(&system, "10 s");
    // Late after 120 ms, seen in a slot of 10 ms, taken in a macro step each 20 ms; the value
    // before came up to 40 ms before the cut.
    let lost = transitions(&trace, "base", "hearing/Hear", "hearing/Lost");
    let after_cut: Vec<u64> = lost.into_iter().filter(|t_us| *t_us > 1_000_000).collect();
    assert!(
        matches!(after_cut[..], [5_080_000..=5_150_000]),
        "{after_cut:?}"
    );
    let halted = transitions(&trace, "base", "motion/Roam", "motion/Halted");
    assert!(halted.contains(&after_cut[0]), "{halted:?}");
    // The first value behind the cut: within a period, the frame's time, a slot and a step.
    let heard = transitions(&trace, "base", "hearing/Lost", "hearing/Hear");
    assert!(matches!(heard[..], [_, 8_000_000..=8_080_000]), "{heard:?}");
    let missed = transitions(&trace, "head", "hearing/Moves", "hearing/Lost");
    assert!(
        missed
            .iter()
            .any(|t_us| (5_080_000..=5_150_000).contains(t_us)),
        "{missed:?}"
    );
}

#[test]
fn ends_that_differ_are_told_where_the_link_stands() {
    let folder = Folder::new();
    let cases = [
        (
            ("period 40 ms;", "period 20 ms;"),
            "E008",
            "another period each by frame",
        ),
        (("rate 115200", "rate 57600"), "E008", "another rate each"),
        (
            ("Ranges payload 42", "Ranges payload 43"),
            "E008",
            "another payload each by frame 1",
        ),
        (
            ("flags blind payload", "flags blind, dead payload"),
            "E008",
            "another content each by frame 2",
        ),
        (
            ("header 6 bytes", "header 5 bytes"),
            "E014",
            "6 bytes of a line before and behind",
        ),
        (
            ("frame sight 2", "frame sight 9"),
            "E008",
            "frame 2, `sight` of `base`, is sent by nobody",
        ),
    ];
    for (head, code, words) in cases {
        let system = folder.rover(("", ""), head);
        let said = check(&system).ended(1);
        let found: Vec<Value> = (said.out.lines())
            .map(|line| serde_json::from_str(line).unwrap())
            .collect();
        let told = found
            .iter()
            .find(|it| it["message"].as_str().unwrap().contains(words));
        let told = told.unwrap_or_else(|| panic!("{words}: {said:#?}"));
        assert_eq!(told["code"], code, "{told}");
        assert_eq!(told["file"], system.as_str(), "{told}");
        assert_eq!(
            (&told["line"], &told["col"]),
            (&9.into(), &6.into()),
            "{told}"
        );
        // A person sees both places in the missions.
        let person = esm(&["system", "check", &system]).ended(1);
        assert!(
            person.err.contains("base.esm:") || person.err.contains("head.esm:"),
            "{person:#?}"
        );
        // And nothing runs.
        assert_eq!(
            esm(&["system", "run", &system, "--json"]).ended(1).out,
            said.out
        );
    }
}

#[test]
fn mistakes_of_missions_are_told_where_they_are() {
    let folder = Folder::new();
    let system = folder.rover(("", ""), ("frame pose 3 in", "frame pose 4 in"));
    let said = check(&system).ended(1);
    let doubled = said.out.lines().find(|line| line.contains("E014"));
    assert!(
        doubled.is_some_and(|line| line.contains("head.esm")),
        "{said:#?}"
    );
}

#[test]
fn what_cannot_be_run_says_what_to_do() {
    let folder = Folder::new();
    let watch = "interpreter slot 1; slot 1 period 10 ms duration 1 ms;\n\
        machine M { region r { state A; initial -> A; } }";
    folder.write("watch.esm", watch);
    let cases = [
        ("processor a mission \"gone.esm\";", 1, "gone.esm"),
        (
            "processor a mission \"watch.esm\" board pico;",
            1,
            "write `board host`",
        ),
        (
            "world \"nowhere\"; processor a mission \"watch.esm\";",
            1,
            "there is no world `nowhere`",
        ),
        ("processor a;", 1, "expected `mission`"),
        ("", 1, "a system has a processor at least"),
    ];
    for (text, status, words) in cases {
        let system = folder.write("wrong.system", text);
        let said = esm(&["system", "run", &system, "--until", "1 s"]).ended(status);
        assert!(said.err.contains(words), "{text}: {said:#?}");
    }
    let both = esm(&["system", "run", ROVER, "--trace", "-", "--json"]).ended(2);
    assert!(both.err.contains("standard output"), "{both:#?}");
    let gone = esm(&["system", "check", "gone.system"]).ended(1);
    assert!(gone.err.contains("gone.system"), "{gone:#?}");
    let over = folder.path("watch.esm");
    let system = folder.write("right.system", "processor a mission \"watch.esm\";");
    let arguments = ["system", "run", &system, "--trace", over.to_str().unwrap()];
    assert!(esm(&arguments).status != Some(0));
    assert_eq!(fs::read_to_string(over).unwrap(), watch);
}

#[test]
fn the_emergency_stop_is_heard_by_all() {
    let arguments = [
        "system", "run", ROVER, "--until", "4 s", "--estop", "2 s", "--json",
    ];
    let figures = esm(&arguments).good().json();
    for processor in figures["processors"].as_array().unwrap() {
        // Nobody steps any more after 2 s, at 20 ms a step.
        let steps = processor["macro_steps"].as_u64().unwrap();
        assert!((100..=102).contains(&steps), "{figures}");
    }
}

/// What the end of a link knows of its partner.
fn partner<'f>(figures: &'f Value, to: &str) -> &'f Value {
    let links = figures["links"].as_array().unwrap();
    links.iter().find(|it| it["to"] == to).unwrap()
}

#[test]
fn each_processor_knows_the_age_of_its_values_and_the_drift_of_its_partner() {
    let folder = Folder::new();
    let joined = "link base.head to head.base";
    for (words, loses) in [("", false), (" loss 5 % noise 1e-6 delay 2 ms", true)] {
        let system = folder.rover((joined, &format!("{joined}{words}")), ("", ""));
        let (_, figures) = folder.run(&system, "61 s");
        // The head's clock gains 80 millionths.
        for (to, expected_ppm) in [("base.head", 80.0), ("head.base", -80.0)] {
            let known = partner(&figures, to);
            let drift_ppm = known["drift_ppm"].as_f64().unwrap();
            assert!((drift_ppm - expected_ppm).abs() < 2.0, "{words}: {known}");
            assert_eq!(known["begun_anew"], 0, "{words}: {known}");
            let frames = known["frames"].as_array().unwrap();
            assert_eq!(frames.len(), 2, "{words}: {known}");
            for frame in frames {
                let count = |name: &str| frame[name].as_u64().unwrap();
                let all = count("received") + count("lost");
                assert!((1_510..=1_526).contains(&all), "{words}: {frame}");
                assert_eq!(count("lost") > 30, loses, "{words}: {frame}");
                assert_eq!(count("doubled"), 0, "{words}: {frame}");
                // A period, the time on the line and what the next activation is away.
                let largest_ms = frame["largest_age_ms"].as_f64().unwrap();
                assert_eq!(largest_ms > 60.0, loses, "{words}: {frame}");
                let age_ms = frame["age_ms"].as_f64().unwrap();
                assert!(age_ms > 0.0 && age_ms <= largest_ms, "{words}: {frame}");
            }
        }
        let text = esm(&["system", "run", &system, "--until", "5 s"])
            .good()
            .out;
        assert!(
            text.contains("base.head knows of head.base: clock +80."),
            "{text}"
        );
    }
}

#[test]
fn a_recorded_run_is_run_again_without_the_others_and_the_links() {
    let folder = Folder::new();
    let joined = "link base.head to head.base";
    let bad = format!("{joined} noise 1e-5 loss 2 % cut 4 s to 5 s");
    let system = folder.rover((joined, &bad), ("", ""));
    let recordings = folder.path("recordings");
    let recordings = recordings.to_str().unwrap();
    let (trace, figures) = folder.run_with(&system, "20 s", &["--record", recordings]);
    // Neither the system nor its missions are needed.
    for name in ["rover.system", "base.esm", "head.esm"] {
        fs::remove_file(folder.path(name)).unwrap();
    }
    let again = folder.path("again.jsonl");
    let arguments = [
        "system",
        "replay",
        recordings,
        "--trace",
        again.to_str().unwrap(),
    ];
    let report = esm(&[&arguments[..], &["--json"]].concat()).good().json();
    assert!(fs::read_to_string(&again).unwrap().lines().eq(&trace));
    for (said, ran) in [0, 1].map(|n| (&report["processors"][n], &figures["processors"][n])) {
        for name in ["processor", "macro_steps", "transitions"] {
            assert_eq!(said[name], ran[name]);
        }
    }
    // One of them alone, too; and what differs is told.
    let head = format!("{recordings}/head.rec");
    let alone = folder.path("head.jsonl");
    let head_alone = ["replay", &head, "--trace", alone.to_str().unwrap()];
    esm(&head_alone).good();
    let alone = fs::read_to_string(alone).unwrap();
    assert!(alone.lines().eq(lines_of(&trace, "head")));
    let other = folder.write("other.jsonl", &trace[1..].join("\n"));
    let compared = ["system", "replay", recordings, "--expect", &other];
    assert!(esm(&compared).ended(1).err.contains("other.jsonl"));
    // What was recorded is not written over, and what is damaged is no recording.
    let over = [
        "system", "run", ROVER, "--until", "1 s", "--record", recordings,
    ];
    assert!(esm(&over).ended(2).err.contains("holds a recording"));
    let mut bytes = fs::read(&head).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&head, bytes).unwrap();
    let damaged = esm(&["system", "replay", recordings]).ended(1);
    assert!(damaged.err.contains("head"), "{damaged:#?}");
    for (index, words) in [
        ("{}", "processors"),
        (
            "{\"processors\":[{\"processor\":\"a\",\"recording\":\"../a.rec\",\"drift_ppb\":0,\"start_us\":0}]}",
            "no file's name",
        ),
    ] {
        fs::write(format!("{recordings}/system.json"), index).unwrap();
        let wrong = esm(&["system", "replay", recordings]).ended(1);
        assert!(wrong.err.contains(words), "{wrong:#?}");
    }
}

/// The rover in two, and missions with another period of the ranges for both.
fn exchanged(folder: &Folder, boards: [&str; 2]) -> (String, [String; 2]) {
    let [base, head] = boards;
    let processors = "processor base mission \"base.esm\" pins motors, encoders, analog;\n\
        processor head mission \"head.esm\" pins sonars drift 80 ppm start 3 ms;";
    let with_boards = processors
        .replace("base.esm\"", &format!("base.esm\"{base}"))
        .replace("head.esm\"", &format!("head.esm\"{head}"));
    let system = folder.rover((processors, &with_boards), ("", ""));
    // The base tells by a state that the head sends what it does not know.
    let told = "region other {\n        state Known;\n        state Strange;\n\n\
        initial -> Known;\n        Known -> Strange on Odd;\n    }\n\n    region talking {";
    let text = fs::read_to_string(folder.path("base.esm")).unwrap();
    let text = text
        .replace(
            "event Halt, Resume, Empty;",
            "event Halt, Resume, Empty, Odd;",
        )
        .replace("region talking {", told)
        .replace(
            "        Lost -> Hear on pulse [.ranges_available]",
            "        Lost -> Lost on pulse [.errors] / send Odd;\n\
             \x20       Lost -> Hear on pulse [.ranges_available]",
        );
    folder.write("base.esm", &text);
    let changed = ["base", "head"].map(|name| {
        let text = fs::read_to_string(folder.path(&format!("{name}.esm"))).unwrap();
        let (old, new) = (
            "payload 42 bytes period 40 ms",
            "payload 42 bytes period 80 ms",
        );
        assert!(text.contains(old));
        folder.write(&format!("{name}_2.esm"), &text.replace(old, new))
    });
    (system, changed)
}

/// Lets other missions take over on the head and then on the base, and looks at the link.
fn exchange(boards: [&str; 2]) {
    let folder = Folder::new();
    let (system, [base, head]) = exchanged(&folder, boards);
    let then = [format!("3 s head {head}"), format!("5 s base {base}")];
    let recordings = folder.path("recordings");
    let recordings = recordings.to_str().unwrap();
    let more = [
        "--then", &then[0], "--then", &then[1], "--warm", "--record", recordings,
    ];
    let (trace, figures) = folder.run_with(&system, "10 s", &more);
    // An upload to a board in the emulator takes some time of its line.
    let between = |times: &[u64], from_us: u64, to_us: u64| {
        times
            .iter()
            .filter(|t_us| (from_us..=to_us).contains(*t_us))
            .count()
    };
    let lost = transitions(&trace, "base", "hearing/Hear", "hearing/Lost");
    assert_eq!(
        between(&lost, 3_000_000, 3_900_000),
        1,
        "{boards:?} {lost:?}"
    );
    let odd = transitions(&trace, "base", "other/Known", "other/Strange");
    assert_eq!(odd.len(), 1, "{boards:?} {odd:?}");
    let heard = transitions(&trace, "base", "hearing/Lost", "hearing/Hear");
    assert_eq!(
        between(&heard, 3_000_000, 4_999_999),
        0,
        "{boards:?} {heard:?}"
    );
    assert_eq!(
        between(&heard, 5_000_000, 5_900_000),
        1,
        "{boards:?} {heard:?}"
    );
    // The head hears the base all the time: nothing is late because its own frames are others.
    let missed = transitions(&trace, "head", "hearing/Moves", "hearing/Lost");
    assert_eq!(
        between(&missed, 1_000_000, 10_000_000),
        0,
        "{boards:?} {missed:?}"
    );
    let known = partner(&figures, "base.head");
    assert!(
        known["other_configuration"].as_u64().unwrap() > 15,
        "{known}"
    );
    let frames = known["frames"].as_array().unwrap();
    let periods = frames.iter().filter(|it| it["frame"] == "ranges");
    let periods: Vec<u64> = periods
        .map(|it| it["period_us"].as_u64().unwrap())
        .collect();
    assert_eq!(periods, [40_000, 80_000]);
    for to in ["base.head", "head.base"] {
        let known = partner(&figures, to);
        let drift_ppm = known["drift_ppm"].as_f64().unwrap();
        assert!((drift_ppm.abs() - 80.0).abs() < 2.0, "{boards:?} {known}");
    }
    for processor in figures["processors"].as_array().unwrap() {
        assert_eq!(processor["slots_missed"], 0, "{boards:?} {processor}");
        assert_eq!(processor["fault"], Value::Null);
    }
    let trace_path = folder.path("trace.jsonl");
    let replayed = [
        "system",
        "replay",
        recordings,
        "--expect",
        trace_path.to_str().unwrap(),
    ];
    esm(&replayed).good();
}

#[test]
fn missions_with_other_frames_take_over_one_after_the_other_and_the_link_comes_back() {
    exchange(["", ""]);
    // What cannot take over says so.
    let folder = Folder::new();
    let (system, [base, head]) = exchanged(&folder, ["", ""]);
    let refused = |then: &str, status: i32, words: &str| {
        let said = esm(&["system", "run", &system, "--until", "6 s", "--then", then]).ended(status);
        assert!(said.err.contains(words), "{then}: {said:#?}");
    };
    refused(
        &format!("3 s tail {head}"),
        2,
        "the system has no processor `tail`",
    );
    refused("3 s", 2, "write a time");
    refused("3 s head gone.esm", 1, "gone.esm");
    // One end alone would stay of another configuration.
    refused(
        &format!("3 s head {head}"),
        1,
        "another period each by frame 1",
    );
    let text = fs::read_to_string(&base).unwrap();
    let faster = folder.write("faster.esm", &text.replace("rate 115200", "rate 230400"));
    refused(&format!("3 s base {faster}"), 1, "another rate each");
}

#[test]
fn missions_take_over_on_boards_in_the_emulator_as_well() {
    firmware_with("lm3s6965", "links");
    exchange(["", " board lm3s6965"]);
    exchange([" board lm3s6965", " board lm3s6965"]);
}

#[test]
fn a_board_in_the_emulator_leaves_the_trace_of_one_on_the_host_and_the_same_in_each_run() {
    firmware_with("lm3s6965", "links");
    let folder = Folder::new();
    let seconds = environment::number("ESM_SYSTEM_S", 8);
    let until = format!("{seconds} s");
    let nothing = ("", "");
    let on = |base: &str, head: &str| {
        let processors = "processor base mission \"base.esm\" pins motors, encoders, analog;\n\
            processor head mission \"head.esm\" pins sonars drift 80 ppm start 3 ms;";
        let boards = format!(
            "processor base mission \"base.esm\" {base} pins motors, encoders, analog drift -60 ppm;\n\
            processor head mission \"head.esm\" {head} pins sonars drift 80 ppm start 3 ms;"
        );
        let system = folder.rover((processors, &boards), nothing);
        let text = fs::read_to_string(&system).unwrap();
        let noisy = "link base.head to head.base delay 300 us noise 1e-5 loss 1 % cut 2 s to 3 s";
        fs::write(&system, text.replace("link base.head to head.base", noisy)).unwrap();
        folder.run(&system, &until)
    };
    let board = "board lm3s6965";
    let (host, on_host) = on("", "");
    let halted = transitions(&host, "base", "motion/Roam", "motion/Halted");
    assert!(!halted.is_empty(), "the cable is cut");
    let mut mixed = vec![("", board), (board, ""), (board, board)];
    if environment::number("ESM_LINK_BOARDS", 1) > 1 {
        firmware_with("stm32f405", "links");
        let other = "board stm32f405";
        mixed.extend([(other, ""), ("", other), (other, board), (other, other)]);
    }
    for (base, head) in mixed {
        let (trace, figures) = on(base, head);
        let differs = host.iter().zip(&trace).find(|(one, other)| one != other);
        assert!(trace == host, "{base} {head}: {differs:?}");
        assert_eq!(figures["distance_m"], on_host["distance_m"]);
        assert!(frames_were_in_time(&figures) > 45 * seconds, "{figures}");
    }
    let repeated = [on(board, board), on(board, board)];
    assert!(repeated[0].0 == repeated[1].0 && repeated[0].1 == repeated[1].1);
}

/// How many frames all lines have carried; each began within 50 us of its start.
fn frames_were_in_time(figures: &Value) -> u64 {
    const LATEST_US: f64 = 50.0;
    let lines = figures["lines"].as_array().unwrap();
    assert_eq!(lines.len(), 2);
    for line in lines {
        assert!(line["latest_us"].as_f64().unwrap() <= LATEST_US, "{line}");
    }
    lines.iter().map(|it| it["frames"].as_u64().unwrap()).sum()
}

#[test]
fn the_schedules_of_all_processors_are_told_and_drawn_on_one_time_axis() {
    let schedule = |more: &[&str]| esm(&[&["system", "schedule", ROVER], more].concat()).good();
    let text = schedule(&[]).out;
    let golden = root().join("tests/data/system_schedule.txt");
    if std::env::var_os("ESM_BLESS").is_some() {
        fs::write(&golden, &text).unwrap();
    }
    assert_eq!(
        text,
        fs::read_to_string(golden).unwrap(),
        "look at it with ESM_BLESS=1"
    );
    let folder = Folder::new();
    // The times are those of a run: macro steps of both by clocks without drift.
    let system = folder.rover((" drift 80 ppm", ""), ("", ""));
    let planned = esm(&["system", "schedule", &system, "--json"])
        .good()
        .json();
    let (trace, _) = folder.run(&system, "1 s");
    for processor in planned["processors"].as_array().unwrap() {
        let slots = processor["slots"].as_array().unwrap();
        let interpreter = slots.iter().find(|it| it["id"] == 1).unwrap();
        let number = |of: &Value, name: &str| of[name].as_u64().unwrap();
        let first_us = number(processor, "origin_us") + number(interpreter, "start_us");
        let period_us = number(interpreter, "period_us");
        let steps: Vec<u64> = (trace.iter())
            .map(|line| serde_json::from_str::<Value>(line).unwrap())
            .filter(|line| line["kind"] == "step" && line["processor"] == processor["processor"])
            .map(|line| line["plant_us"].as_u64().unwrap())
            .collect();
        let expected = (0..).map(|nth| first_us + nth * period_us);
        let expected: Vec<u64> = expected.take_while(|it| *it <= 1_000_000).collect();
        assert_eq!(steps, expected, "{processor}");
        assert!(processor["utilisation"].as_f64().unwrap() > 0.3);
    }
    // Frames take what their bytes take: (6 + 42 + 4) x 10 bits at 115,200 bit/s.
    let sent = &planned["links"][0]["directions"][1];
    assert_eq!(
        (&sent["from"], &sent["frames"][0]["id"]),
        (&"head.base".into(), &1.into())
    );
    assert_eq!(sent["frames"][0]["duration_us"], 4_514);
    assert_eq!(sent["origin_us"], 3_000);
    let picture = folder.path("schedule.svg");
    let draw = || {
        schedule(&["-o", picture.to_str().unwrap()]);
        fs::read_to_string(&picture).unwrap()
    };
    let (once, again) = (draw(), draw());
    assert!(once == again && once.contains("head.base to base.head"));
    // What is wrong is told, and no mission is written over.
    let base = folder.path("base.esm");
    let over = ["system", "schedule", &system, "-o", base.to_str().unwrap()];
    assert!(esm(&over).status != Some(0));
    assert!(fs::read_to_string(&base).unwrap().contains("machine Base"));
    let wrong = folder.rover(("", ""), ("period 40 ms;", "period 20 ms;"));
    let said = esm(&["system", "schedule", &wrong, "--json"]).ended(1);
    assert!(said.out.contains("E008"), "{said:#?}");
}

/// The rover in two, of which one processor is reset from 3 s to 3.5 s.
fn with_reset(folder: &Folder, processor: &str, boards: [&str; 2]) -> String {
    let processors = "processor base mission \"base.esm\" pins motors, encoders, analog;\n\
        processor head mission \"head.esm\" pins sonars drift 80 ppm start 3 ms;";
    let reset = |name: &str| match processor == name {
        true => "reset 3 s to 3500 ms",
        false => "",
    };
    let [base, head] = boards;
    let with_reset = format!(
        "processor base mission \"base.esm\" {base} pins motors, encoders, analog {};\n\
        processor head mission \"head.esm\" {head} pins sonars drift 80 ppm start 3 ms {};",
        reset("base"),
        reset("head")
    );
    folder.rover((processors, &with_reset), ("", ""))
}

/// The reset of a head, or of a base, as the other one sees it.
fn reset_is_seen(processor: &str, trace: &[String], figures: &Value) {
    let of_it = figures["processors"].as_array().unwrap().iter();
    for it in of_it {
        assert_eq!(it["slots_missed"], 0, "{it}");
        assert_eq!(it["fault"], Value::Null, "{it}");
        assert_eq!(
            it["resets"],
            u64::from(it["processor"] == processor),
            "{it}"
        );
    }
    let times = |of: &str, from: &str, to: &str| -> Vec<u64> {
        let all = transitions(trace, of, from, to).into_iter();
        all.filter(|it| *it > 1_000_000).collect()
    };
    // It begins anew, at once.
    let begun = times(
        processor,
        "hearing/initial",
        ["hearing/Hear", "hearing/Moves"][usize::from(processor == "head")],
    );
    assert!(matches!(begun[..], [3_500_000..=3_500_100]), "{begun:?}");
    // Late after 120 ms, seen in a slot of 10 ms, taken in a macro step each 20 ms; the value
    // before came up to 40 ms before. The first value behind it: within a period, the time that the
    // sonars take to be there, the frame's, a slot and a step.
    match processor {
        "head" => {
            let lost = times("base", "hearing/Hear", "hearing/Lost");
            assert!(matches!(lost[..], [3_080_000..=3_150_000]), "{lost:?}");
            let heard = times("base", "hearing/Lost", "hearing/Hear");
            assert!(matches!(heard[..], [3_500_000..=3_800_000]), "{heard:?}");
            // It halts from the one to the other, whatever was close before.
            assert_eq!(times("base", "motion/Roam", "motion/Halted"), lost);
            assert_eq!(times("base", "motion/Halted", "motion/Roam"), heard);
        }
        _ => {
            let lost = times("head", "hearing/Moves", "hearing/Lost");
            assert!(matches!(lost[..], [3_080_000..=3_150_000]), "{lost:?}");
            let heard = times("head", "hearing/Lost", "hearing/Moves");
            assert!(matches!(heard[..], [3_500_000..=3_600_000]), "{heard:?}");
        }
    }
}

#[test]
fn a_processor_that_is_reset_is_missed_in_time_and_comes_back() {
    let folder = Folder::new();
    let recordings = folder.path("recordings");
    let record = ["--record", recordings.to_str().unwrap()];
    for words in ["", " over memory"] {
        let _ = fs::remove_dir_all(&recordings);
        let system = with_reset(&folder, "head", ["", ""]);
        let text = fs::read_to_string(&system).unwrap();
        let link = "link base.head to head.base";
        fs::write(&system, text.replace(link, &format!("{link}{words}"))).unwrap();
        let (trace, figures) = folder.run_with(&system, "6 s", &record);
        reset_is_seen("head", &trace, &figures);
        // The partner knows it by the numbers of frames, or by their times.
        let known = partner(&figures, "base.head");
        assert!(known["begun_anew"].as_u64().unwrap() >= 1, "{known}");
        // A recording for each time that it was there.
        let trace_path = folder.path("trace.jsonl");
        let expected = ["--expect", trace_path.to_str().unwrap(), "--json"];
        let replay = ["system", "replay", recordings.to_str().unwrap()];
        let report = esm(&[&replay[..], &expected].concat()).good().json();
        assert_eq!(report["processors"].as_array().unwrap().len(), 3);
    }
    // Whoever has the motors lets go of them: the robot stands at once.
    let (trace, figures) = folder.run(&with_reset(&folder, "base", ["", ""]), "6 s");
    reset_is_seen("base", &trace, &figures);
    let distance_m = |until: &str| {
        let system = with_reset(&folder, "base", ["", ""]);
        folder.run(&system, until).1["distance_m"].as_f64().unwrap()
    };
    let (before, during, behind) = (
        distance_m("3 s"),
        distance_m("3300 ms"),
        distance_m("3500 ms"),
    );
    assert!(
        during > before && behind - during < 0.005,
        "{before} {during} {behind}"
    );
    assert!(distance_m("6 s") > behind + 0.1);
}

#[test]
fn a_board_in_the_emulator_that_is_reset_leaves_the_trace_of_one_on_the_host() {
    firmware_with("lm3s6965", "links");
    let folder = Folder::new();
    let board = "board lm3s6965";
    for (processor, boards) in [
        ("head", ["", board]),
        ("base", [board, ""]),
        ("base", [board, board]),
    ] {
        let (host, on_host) = folder.run(&with_reset(&folder, processor, ["", ""]), "5 s");
        let (trace, figures) = folder.run(&with_reset(&folder, processor, boards), "5 s");
        let differs = host.iter().zip(&trace).find(|(one, other)| one != other);
        assert!(trace == host, "{processor}: {differs:?}");
        reset_is_seen(processor, &trace, &figures);
        assert_eq!(figures["distance_m"], on_host["distance_m"], "{processor}");
    }
}

#[test]
fn a_mission_that_took_over_is_the_one_that_begins_anew_behind_a_reset() {
    let folder = Folder::new();
    let system = with_reset(&folder, "head", ["", ""]);
    // One that halts: its region has another name.
    let text = fs::read_to_string(folder.path("head.esm")).unwrap();
    let other = folder.write("other.esm", &text.replace("region sonars", "region ears"));
    let (trace, _) = folder.run_with(&system, "5 s", &["--then", &format!("2 s head {other}")]);
    let begun = transitions(&trace, "head", "ears/initial", "ears/Listen");
    assert!(
        matches!(begun[..], [2_000_000..=2_030_000, 3_500_000]),
        "{begun:?}"
    );
    assert_eq!(
        transitions(&trace, "head", "sonars/initial", "sonars/Listen").len(),
        1
    );
}

#[test]
fn a_line_that_is_full_of_another_partners_frames_shows_as_errors_and_misses_no_slot() {
    // `near` sends what `far` means otherwise, as often as the line carries it: nobody checks an
    // exchange that is under way.
    let folder = Folder::new();
    let mission = |name: &str, sent: u16, payload: u16| {
        format!(
            "interpreter slot 1; slot 1 period 20 ms duration 2 ms; slot 2 period 10 ms duration 4 ms;\n\
            link other rate 115200 bps header 6 bytes;\n\
            frame full {sent} out on other flags a payload {payload} bytes period 2500 us;\n\
            frame back {} in on other flags b payload 16 bytes period 10 ms late 50 ms;\n\
            machine {name} {{ region talking {{ task Tell: other.transmit slot 2; initial -> Tell; }}\n\
            region hearing {{ task Good: other.receive slot 2; task Bad: other.receive slot 2;\n\
            task Lost: other.receive slot 2; initial -> Good;\n\
            Good -> Bad on pulse [.errors and not .back_delayed]; Good -> Lost on pulse [.back_delayed];\n\
            Bad -> Lost on pulse [.back_delayed]; Lost -> Good on pulse [.back_available]; }} }}",
            3 - sent
        )
    };
    let quiet = |text: String| {
        text.replace(
            "payload 16 bytes period 2500 us",
            "payload 16 bytes period 10 ms",
        )
    };
    let right = [mission("Near", 1, 16), mission("Far", 2, 16)].map(quiet);
    let files = ["near.esm", "far.esm"];
    for (file, text) in files.iter().zip(&right) {
        folder.write(file, text);
    }
    // The same mission again is what both end with.
    let babbler = folder.write("babbler.esm", &mission("Near", 1, 16));
    let again = folder.write("again.esm", &right[0]);
    let system = folder.write(
        "line.system",
        "world \"office\"; link near.other to far.other;\n\
        processor near mission \"near.esm\"; processor far mission \"far.esm\";",
    );
    let then = [format!("2 s near {babbler}"), format!("3 s near {again}")];
    let more = ["--then", &then[0], "--then", &then[1]];
    let (trace, figures) = folder.run_with(&system, "4 s", &more);
    let of = |from: &str, to: &str| transitions(&trace, "far", from, to);
    let bad = of("hearing/Good", "hearing/Bad");
    assert!(matches!(bad[..], [2_000_000..=2_060_000]), "{bad:?}");
    let lost = of("hearing/Bad", "hearing/Lost");
    assert!(matches!(lost[..], [2_030_000..=2_100_000]), "{lost:?}");
    let good = of("hearing/Lost", "hearing/Good");
    assert!(matches!(good[..], [3_000_000..=3_060_000]), "{good:?}");
    for processor in figures["processors"].as_array().unwrap() {
        assert_eq!(processor["slots_missed"], 0, "{processor}");
    }
    let known = partner(&figures, "far.other");
    assert!(
        known["other_configuration"].as_u64().unwrap() > 300,
        "{known}"
    );
}

/// A processor that sends two frames, of two periods, and hears two.
fn talker(name: &str, sent: [u16; 2], heard: [u16; 2]) -> String {
    let ([quick, slow], [back, more]) = (sent, heard);
    format!(
        "interpreter slot 1; slot 1 period 1 s duration 5 ms;\n\
        slot 2 period 20 ms duration 2 ms; slot 3 period 100 ms duration 5 ms;\n\
        link other rate 115200 bps header 6 bytes;\n\
        frame quick {quick} out on other flags a payload 16 bytes period 20 ms;\n\
        frame slow {slow} out on other flags b payload 16 bytes period 50 ms;\n\
        frame back {back} in on other flags c payload 16 bytes period 20 ms;\n\
        frame more {more} in on other flags d payload 16 bytes period 50 ms;\n\
        machine {name} {{\n\
        region talking {{ task Tell: other.transmit slot 3; initial -> Tell; }}\n\
        region hearing {{ task Hear: other.receive slot 2; state Lost timeout 1 s;\n\
        initial -> Hear; Lost -> Hear on pulse [timeout];\n\
        Hear -> Lost on pulse [.back_delayed or .more_delayed or .errors]; }} }}"
    )
}

#[test]
fn frames_start_in_time_by_clocks_that_drift_and_none_is_lost() {
    firmware_with("lm3s6965", "links");
    let folder = Folder::new();
    folder.write("near.esm", &talker("Near", [1, 2], [3, 4]));
    folder.write("far.esm", &talker("Far", [3, 4], [1, 2]));
    for (board, variable, usual_s) in [
        ("", "ESM_DRIFT_HOST_S", 300),
        ("board lm3s6965", "ESM_DRIFT_S", 20),
    ] {
        let seconds = environment::number(variable, usual_s);
        let text = format!(
            "world \"office\"; link near.other to far.other;\n\
            processor near mission \"near.esm\" {board} drift 100 ppm;\n\
            processor far mission \"far.esm\" {board} drift -100 ppm start 7 ms;"
        );
        let system = folder.write("drift.system", &text);
        let (trace, figures) = folder.run(&system, &format!("{seconds} s"));
        // 70 a second each way.
        let frames = frames_were_in_time(&figures);
        assert!(frames >= 139 * (seconds - 1), "{board} {figures}");
        for (to, expected_ppm) in [("near.other", -200.0), ("far.other", 200.0)] {
            let known = partner(&figures, to);
            let drift_ppm = known["drift_ppm"].as_f64().unwrap();
            assert!((drift_ppm - expected_ppm).abs() < 1.0, "{board} {known}");
            for frame in known["frames"].as_array().unwrap() {
                for none in ["lost", "doubled", "dropped", "late"] {
                    assert_eq!(frame[none], 0, "{board} {known}");
                }
            }
        }
        for processor in ["near", "far"] {
            let lost = transitions(&trace, processor, "hearing/Hear", "hearing/Lost");
            assert_eq!(lost, [0_u64; 0], "{board} {processor}");
        }
    }
}
