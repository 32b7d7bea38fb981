//! Robots with several processors: what `esm system` says of them, and what they do.
//!
//! `ESM_SYSTEM_S` says how many seconds boards in the emulator are compared with those on the host,
//! and `ESM_DRIFT_S` and `ESM_DRIFT_HOST_S` for how long frames are sent by clocks that drift, in
//! the emulator and on the host. `cargo xtask campaign systems drift` does it at full length.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fs;
use std::path::PathBuf;

use esm_tests::command::{Done, esm, firmware_with_links, root};
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
        let trace = self.path("trace.jsonl");
        let trace_path = trace.to_str().unwrap();
        let arguments = [
            "system", "run", system, "--until", until, "--trace", trace_path, "--json",
        ];
        let figures = esm(&arguments).good().json();
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

#[test]
fn a_board_in_the_emulator_leaves_the_trace_of_one_on_the_host_and_the_same_in_each_run() {
    firmware_with_links();
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
    for (base, head) in [("", board), (board, ""), (board, board)] {
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
    firmware_with_links();
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
        for processor in ["near", "far"] {
            let lost = transitions(&trace, processor, "hearing/Hear", "hearing/Lost");
            assert_eq!(lost, [0_u64; 0], "{board} {processor}");
        }
    }
}
