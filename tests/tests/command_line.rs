//! The command from outside: what it answers, where, and with which exit status.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::path::PathBuf;
use std::process::Command;

use esm_tests::command::{esm, root};

const GOOD: &str =
    "interpreter slot 1; slot 1 period 10 ms duration 1 ms; slot 2 period 10 ms duration 1 ms;
task Drive slot 2 { out flag near; }
container Escape { region turn { task Back: Drive; initial -> Back; Back -> final on *; } }
machine Rover {
  event Obstacle;
  region motion {
    task Cruise: Drive; super Escape: Escape;
    initial -> Cruise;
    Cruise -> Escape [.near] / send Obstacle;
    Escape -> Cruise on *;
  }
  region count { state None; state Some; initial -> None; None -> Some on Obstacle; }
}
";

/// Files that belong together, in a folder of their own.
struct Files {
    folder: tempfile::TempDir,
}

impl Files {
    fn new(files: &[(&str, &str)]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        Files { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// `esm` with `{}` in the arguments standing for the folder.
    #[track_caller]
    fn esm(&self, arguments: &str) -> esm_tests::command::Done {
        let folder = self.folder.path().to_str().unwrap();
        let arguments: Vec<String> = arguments
            .split_whitespace()
            .map(|argument| argument.replace("{}", folder))
            .collect();
        esm(&arguments)
    }
}

#[test]
fn exit_statuses_are_those_of_the_manual() {
    let files = Files::new(&[
        ("good.esm", GOOD),
        ("bad.esm", "machine M { region r { state A; } }"),
        ("lib.esm", "task T slot 2 { out flag near; }"),
        (
            "met.scenario",
            "at 0 ms expect motion/Cruise\nuntil 10 ms\n",
        ),
        (
            "unmet.scenario",
            "at 0 ms expect motion/Escape\nuntil 10 ms\n",
        ),
        (
            "wrong.scenario",
            "at 0 ms expect motion/Nowhere\nuntil 10 ms\n",
        ),
        ("endless.scenario", "at 0 ms expect motion/Cruise\n"),
        ("noise.blob", "this is no blob"),
        ("old.rec", "ESMREC\u{2}\0"),
    ]);
    for (arguments, expected) in [
        ("check {}/good.esm", 0),
        ("check {}/lib.esm", 0),
        ("check {}/bad.esm", 1),
        ("check {}/absent.esm", 1),
        ("check", 2),
        ("check --nonsense {}/good.esm", 2),
        ("nonsense", 2),
        ("build {}/good.esm -o {}/good.blob", 0),
        ("build {}/bad.esm -o {}/bad.blob", 1),
        ("build {}/lib.esm -o {}/lib.blob", 1),
        ("build {}/good.esm", 2),
        ("build {}/good.esm -o {}/good.esm", 2),
        ("build {}/good.esm -o {}/no/such/folder.blob", 3),
        ("draw {}/good.esm -o {}/lib.esm", 2),
        ("schedule {}/good.esm --svg {}/good.esm", 2),
        ("schedule {}/good.esm --svg {}/lib.esm", 2),
        ("schedule {}/good.esm --perfetto {}/good.esm", 2),
        ("schedule {}/good.esm --svg {}/out --perfetto {}/out", 2),
        ("schedule {}/good.esm --svg {}/no/such/picture.svg", 3),
        ("schedule {}/good.esm --perfetto {}/no/such/trace.json", 3),
        ("schedule {}/bad.esm --svg {}/bad.svg", 1),
        ("schedule {}/good.esm --limit never", 2),
        ("sim {}/good.esm {}/met.scenario --trace {}/met.scenario", 2),
        ("run {}/good.esm --board host --trace {}/good.esm", 2),
        ("run {}/good.esm --board host --record {}/good.esm", 2),
        ("run {}/good.esm --board host --record {}/old.rec", 2),
        ("log --record {}/old.rec --port unix:/no/such/socket", 2),
        (
            "upload {}/good.esm --record {}/old.rec --port unix:/no/such/socket",
            2,
        ),
        ("test {}/good.esm", 1),
        ("test {}/absent", 1),
        ("fmt {}/good.blob --check", 1),
        ("inspect {}/good.blob", 0),
        ("inspect {}/noise.blob", 1),
        ("schedule {}/good.esm", 0),
        ("sim {}/good.esm {}/met.scenario", 0),
        ("sim {}/good.esm {}/unmet.scenario", 1),
        ("sim {}/good.esm {}/wrong.scenario", 1),
        ("sim {}/good.esm {}/endless.scenario", 1),
        ("status --port /dev/no-such-port", 3),
        ("upload {}/good.esm --port unix:/no/such/socket", 3),
        ("upload {}/good.esm --port nonsense:", 3),
        ("run {}/good.esm --board nonsense", 2),
        ("--help", 0),
        ("--version", 0),
    ] {
        let done = files.esm(arguments);
        assert_eq!(done.status, Some(expected), "esm {arguments}: {done:#?}");
        if expected != 0 {
            assert!(!done.err.trim().is_empty(), "esm {arguments} says nothing");
        }
    }
    assert_eq!(
        std::fs::read_to_string(files.path("good.esm")).unwrap(),
        GOOD
    );
    assert!(
        !files.path("bad.blob").exists(),
        "a failed build leaves no file"
    );
}

/// What a person may mistake for a port, or for a file of another kind.
#[test]
fn what_is_no_port_and_no_such_file_is_told_as_that() {
    let files = Files::new(&[
        ("good.esm", GOOD),
        ("plain", "text"),
        ("binary", "\u{7f}ELF\u{1}\u{0}\u{1b}"),
        ("empty", ""),
    ]);
    std::fs::create_dir(files.path("folder")).unwrap();
    for command in [
        "upload {}/good.esm",
        "param get",
        "param set a.b 1",
        "param save",
        "key show",
        "key remove",
        "blackbox",
        "confirm",
        "fallback",
        "values",
        "position",
        "log",
        "top",
        "status",
    ] {
        for (port, expected, why) in [
            ("", 3, "no robot is plugged in"),
            ("--port a --port b", 2, "cannot be used multiple times"),
            ("--port tcp:robot", 2, "tcp:HOST:PORT"),
            ("--port {}/plain", 3, "no serial line"),
            ("--port {}/folder", 3, "no serial line"),
            ("--port unix:{}/plain", 3, "nobody answers"),
        ] {
            if (command, port) == ("key show", "") {
                continue; // of the file
            }
            let done = files.esm(&format!("{command} {port}")).ended(expected);
            assert!(done.err.contains(why), "{command} {port}: {done:#?}");
        }
    }
    let nobody = "--port unix:{}/nobody";
    for command in [
        "replay FILE",
        "inspect FILE",
        "diff FILE {}/good.esm",
        "sim {}/good.esm FILE",
        "run {}/good.esm --board host --replay FILE",
        "run {}/good.esm --world FILE",
        "run {}/good.esm --firmware FILE",
        "upload FILE --port unix:{}/nobody",
        "blackbox --mission FILE --port unix:{}/nobody",
    ] {
        for file in ["plain", "binary", "empty", "folder", "absent"] {
            let done = files.esm(&command.replace("FILE", &format!("{{}}/{file}")));
            assert_eq!(done.status, Some(1), "{command} {file}: {done:#?}");
            let said = done.err.contains("error") && !done.err.contains("panicked");
            assert!(said, "{command} {file}: {done:#?}");
            assert!(!done.err.contains('\u{1b}'), "{command} {file}: {done:#?}");
        }
    }
    let done = files.esm(&format!("key install --key {{}}/folder {nobody}"));
    let said = done.ended(3).err;
    assert!(
        said.contains("it is a folder, and a file is wanted"),
        "{said}"
    );
}

#[test]
fn every_subcommand_has_help_worth_reading() {
    let overview = esm(&["--help"]).good().out;
    let listed = overview.lines().skip_while(|line| *line != "Commands:");
    let listed = listed.skip(1).take_while(|line| !line.is_empty());
    let mut shown = 0;
    for line in listed.filter(|line| line.starts_with("  ") && !line.starts_with("   ")) {
        let subcommand = line.split_whitespace().next().unwrap();
        if subcommand == "help" {
            continue;
        }
        let help = esm(&[subcommand, "--help"]).good().out;
        assert!(help.contains("Usage: esm"), "{subcommand}: {help}");
        assert!(help.contains("Example"), "{subcommand}: {help}");
        shown += 1;
    }
    assert!(shown >= 25, "{shown}: {overview}");
}

#[test]
fn schedule_shows_starts_bars_and_tasks_and_writes_the_same_files_twice() {
    const TWO_SLOTS: &str = "slot 3 period 40 ms duration 2 ms; slot 4 period 40 ms duration 3 ms;
        task Sense slot 3 wcet 1 ms { } task Plan slot 4 wcet 2 ms { }
        container C { region r { task A: Sense; task B: Plan; initial -> A; A -> B; B -> A; } }";
    let files = Files::new(&[("good.esm", GOOD), ("two.esm", TWO_SLOTS)]);
    let shown = files.esm("schedule {}/two.esm").good().out;
    for part in [
        "one hyperperiod of 40 ms:",
        "slot 4 │",
        "  free │",
        "     4         2 ms         1 ms  1 of 1: C/r/B",
        "hint: the tasks of slots 3 and 4 are never active together, and both come every 40 ms: one slot of 3 ms has room for either",
    ] {
        assert!(shown.contains(part), "{part}\n{shown}");
    }
    let longest = shown
        .lines()
        .filter(|line| !line.starts_with("hint"))
        .map(|line| line.chars().count())
        .max();
    assert!(longest <= Some(100), "{shown}");
    let json: serde_json::Value =
        serde_json::from_str(&files.esm("schedule {}/good.esm --json").good().out).unwrap();
    assert_eq!(json["feasible"], true);
    assert_eq!(
        json["tasks"][1],
        serde_json::json!({
            "slot": 2, "duration_us": 1000, "worst_us": 0, "together": ["motion/Cruise"],
            "tasks": ["motion/Cruise", "motion/Escape/turn/Back"], "left_out": 0, "without_wcet": 2,
        })
    );
    for (option, names) in [
        ("--svg", ["one.svg", "two.svg"]),
        ("--svg", ["one.png", "two.png"]),
        ("--perfetto", ["one.json", "two.json"]),
    ] {
        for name in names {
            files
                .esm(&format!("schedule {{}}/good.esm {option} {{}}/{name}"))
                .good();
        }
        let [one, two] = names.map(|name| std::fs::read(files.path(name)).unwrap());
        assert!(one == two && !one.is_empty(), "{names:?}");
    }
}

#[test]
fn no_schedule_leaves_no_picture() {
    let files = Files::new(&[(
        "clash.esm",
        "slot 1 period 2 ms duration 1 ms; slot 2 period 3 ms duration 1 ms;",
    )]);
    let done =
        files.esm("schedule {}/clash.esm --json --svg {}/clash.svg --perfetto {}/clash.json");
    assert_eq!(done.status, Some(1), "{done:#?}");
    let json: serde_json::Value = serde_json::from_str(&done.out).unwrap();
    assert_eq!(json["feasible"], false);
    assert_eq!(json["tasks"].as_array().map(Vec::len), Some(2), "{json}");
    assert!(!files.path("clash.svg").exists() && !files.path("clash.json").exists());
}

#[test]
fn check_reports_all_errors_with_place_and_hint() {
    let files = Files::new(&[(
        "bad.esm",
        "interpreter slot 1; slot 1 period 10 ms duration 1 ms;
task Drive slot 1 { out flag near; }
machine M {
  region a { task Cruise: Drive; state Cruise; initial -> Cruise; Cruise -> Cruse [.near]; }
  region b { state Lone }
  region c { state Idle; }
  region d { task T: Drive slot 9; initial -> T; }
}
",
    )]);
    let done = files.esm("check {}/bad.esm --json");
    assert_eq!(done.status, Some(1), "{done:#?}");
    let mut found: Vec<(String, u64)> = Vec::new();
    for line in done.out.lines() {
        let value: serde_json::Value = serde_json::from_str(line).unwrap();
        for key in ["file", "message"] {
            assert!(value[key].is_string(), "{key} in {line}");
        }
        assert!(value["col"].as_u64().unwrap() >= 1, "{line}");
        if value["severity"] == "error" {
            let code = value["code"].as_str().unwrap().to_owned();
            found.push((code, value["line"].as_u64().unwrap()));
        }
    }
    found.sort();
    let expected = [
        ("E001", 5),
        ("E002", 4),
        ("E002", 7),
        ("E003", 4),
        ("E004", 5),
        ("E004", 6),
    ];
    let expected: Vec<(String, u64)> = expected
        .iter()
        .map(|(code, line)| ((*code).to_owned(), *line))
        .collect();
    assert_eq!(found, expected, "{}", done.out);

    let done = files.esm("check {}/bad.esm");
    assert!(
        !done.out.contains("E00") && done.out.lines().count() <= 1,
        "messages for people go to standard error, and standard output sums up"
    );
    for part in ["E002", "did you mean", "Cruise -> Cruse"] {
        assert!(done.err.contains(part), "{part}: {}", done.err);
    }
    assert!(!done.err.contains('\x1b'), "no colour where nobody looks");
}

#[test]
fn a_blob_is_the_same_each_time_and_inspect_reads_it() {
    let files = Files::new(&[("good.esm", GOOD)]);
    let built = files
        .esm("build {}/good.esm -o {}/a.blob --json")
        .good()
        .json();
    files.esm("build {}/good.esm -o {}/b.blob").good();
    let (a, b) = (
        std::fs::read(files.path("a.blob")).unwrap(),
        std::fs::read(files.path("b.blob")).unwrap(),
    );
    assert_eq!(a, b);
    for (key, expected) in [
        ("bytes", a.len()),
        ("states", 5),
        ("transitions", 7),
        ("containers", 2),
        ("instances", 2),
        ("events", 1),
    ] {
        assert_eq!(built[key], expected, "{key} in {built}");
    }
    assert!(built["flags"].as_u64().unwrap() > 0, "{built}");
    assert!(built["ram_bytes"].as_u64().unwrap() > 0, "{built}");
    let inspected = files.esm("inspect {}/a.blob --json").good();
    inspected.json();
    for name in ["Rover", "Escape", "Cruise", "Obstacle"] {
        assert!(inspected.out.contains(name), "{name}");
        let table = files.esm("inspect {}/a.blob").good().out;
        assert!(table.contains(name), "{name}: {table}");
    }
}

#[test]
fn a_damaged_blob_is_refused_with_the_reason() {
    let files = Files::new(&[("good.esm", GOOD)]);
    files.esm("build {}/good.esm -o {}/a.blob").good();
    let mut bytes = std::fs::read(files.path("a.blob")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(files.path("a.blob"), &bytes).unwrap();
    let done = files.esm("inspect {}/a.blob");
    assert_eq!(done.status, Some(1));
    assert!(
        done.err.contains("CRC") || done.err.contains("checksum"),
        "{}",
        done.err
    );
}

#[test]
fn sim_writes_the_trace_of_the_manual() {
    let files = Files::new(&[
        ("good.esm", GOOD),
        (
            "s.scenario",
            "at 10 ms set motion/Cruise.near     # something ahead\n\
             at 10 ms expect motion/Escape\n\
             at 10 ms expect count/Some\n\
             at 30 ms exit motion/Escape/turn/Back\n\
             at 50 ms expect motion/Cruise\n\
             at 50 ms expect not motion/Cruise.near\n\
             until 55 ms\n",
        ),
    ]);
    files
        .esm("sim {}/good.esm {}/s.scenario --trace {}/t.jsonl")
        .good();
    let trace = std::fs::read_to_string(files.path("t.jsonl")).unwrap();
    let expected = r#"{"kind":"transition","step":0,"micro":0,"t_us":0,"event":"pulse","from":"motion/initial","to":"motion/Cruise","sent":[],"set":[],"cleared":[]}
{"kind":"transition","step":0,"micro":0,"t_us":0,"event":"pulse","from":"count/initial","to":"count/None","sent":[],"set":[],"cleared":[]}
{"kind":"step","step":0,"t_us":0,"micro_steps":1,"active":["motion/Cruise","count/None"],"enabled":["motion/Cruise"]}
{"kind":"transition","step":1,"micro":0,"t_us":10000,"event":"pulse","from":"motion/Cruise","to":"motion/Escape","sent":["Obstacle"],"set":[],"cleared":[]}
{"kind":"transition","step":1,"micro":1,"t_us":10000,"event":"Obstacle","from":"count/None","to":"count/Some","sent":[],"set":[],"cleared":[]}
{"kind":"step","step":1,"t_us":10000,"micro_steps":2,"active":["motion/Escape","motion/Escape/turn/initial","count/Some"],"enabled":[]}
{"kind":"transition","step":2,"micro":0,"t_us":20000,"event":"pulse","from":"motion/Escape/turn/initial","to":"motion/Escape/turn/Back","sent":[],"set":[],"cleared":[]}
{"kind":"step","step":2,"t_us":20000,"micro_steps":1,"active":["motion/Escape","motion/Escape/turn/Back","count/Some"],"enabled":["motion/Escape/turn/Back"]}
{"kind":"transition","step":3,"micro":0,"t_us":30000,"event":"pulse","from":"motion/Escape/turn/Back","to":"motion/Escape/turn/final","sent":[],"set":[],"cleared":[]}
{"kind":"step","step":3,"t_us":30000,"micro_steps":1,"active":["motion/Escape","motion/Escape/turn/final","count/Some"],"enabled":[]}
{"kind":"transition","step":4,"micro":0,"t_us":40000,"event":"pulse","from":"motion/Escape","to":"motion/Cruise","sent":[],"set":[],"cleared":[]}
{"kind":"step","step":4,"t_us":40000,"micro_steps":1,"active":["motion/Cruise","count/Some"],"enabled":["motion/Cruise"]}
{"kind":"step","step":5,"t_us":50000,"micro_steps":1,"active":["motion/Cruise","count/Some"],"enabled":["motion/Cruise"]}
"#;
    assert_eq!(trace, expected);
    let to_output = files.esm("sim {}/good.esm {}/s.scenario --trace -").good();
    assert_eq!(to_output.out, expected);
}

/// Width and height as a PNG says them of itself.
fn png_size(bytes: &[u8]) -> Option<[u32; 2]> {
    let header = bytes.strip_prefix(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR")?;
    let number = |at: usize| Some(u32::from_be_bytes(header.get(at..at + 4)?.try_into().ok()?));
    Some([number(0)?, number(4)?])
}

#[test]
fn draw_writes_what_the_name_asks_for_and_shows_no_more_than_it_is_told() {
    let described = GOOD.replace("container Escape", "/// Gets away.\ncontainer Escape");
    let files = Files::new(&[("good.esm", &described)]);
    let draw = |arguments: &str, name: &str| {
        let done = files.esm(&format!("draw {{}}/good.esm -o {{}}/{name} {arguments}"));
        assert_eq!(done.status, Some(0), "{arguments}: {}", done.err);
        assert_eq!(done.out, "", "{arguments}");
        std::fs::read(files.path(name)).unwrap()
    };
    let svg = |arguments: &str| String::from_utf8(draw(arguments, "out.svg")).unwrap();
    let whole = svg("");
    for word in [
        "machine Rover",
        "Escape : Escape",
        "Back",
        "motion",
        "count",
        "event Obstacle",
    ] {
        assert!(whole.contains(word), "{word}");
    }
    let closed = svg("--depth 0");
    assert!(closed.contains(": Escape …") && !closed.contains(">Back<"));
    assert_eq!(svg("--depth 1"), whole);
    let alone = svg("--container Escape");
    assert!(alone.contains("container Escape") && !alone.contains("Rover"));
    assert!(!whole.contains("simple state") && svg("--legend").contains("simple state"));
    assert!(!whole.contains("Gets away.") && svg("--notes").contains("Gets away."));

    let [width, height] = png_size(&draw("", "out.PNG")).unwrap();
    let tall = png_size(&draw("--legend", "legend.png")).unwrap();
    assert!(tall[0] >= width && tall[1] > height);
    assert!(png_size(whole.as_bytes()).is_none());
}

#[test]
fn draw_says_what_it_cannot_draw() {
    let loops = "state A; initial -> A; ".to_owned() + &"A -> A on E; ".repeat(6_001);
    let slots = "interpreter slot 1; slot 1 period 10 ms duration 1 ms;";
    let files = Files::new(&[
        ("good.esm", GOOD),
        ("lib.esm", "task T slot 2 { out flag near; }"),
        ("bad.esm", "machine M { region r { state A; } }"),
        (
            "large.esm",
            &format!("{slots} machine M {{ event E; region r {{ {loops} }} }}"),
        ),
    ]);
    for (arguments, status, words) in [
        (
            "good.esm -o {}/p.svg --container Escap",
            2,
            "did you mean `Escape`?",
        ),
        ("good.esm -o {}/p.svg --depth -1", 2, "-1"),
        ("good.esm -o {}/absent/p.svg", 3, "absent"),
        ("lib.esm -o {}/p.svg", 1, "nothing to draw"),
        ("bad.esm -o {}/p.svg", 1, "error"),
        ("large.esm -o {}/p.svg", 1, "1 states and 6002 transitions"),
    ] {
        let done = files.esm(&format!("draw {{}}/{arguments}"));
        assert_eq!(done.status, Some(status), "{arguments}: {}", done.err);
        assert!(done.err.contains(words), "{arguments}: {}", done.err);
        assert!(!files.path("p.svg").exists(), "{arguments}");
    }
}

#[test]
fn a_failed_expectation_says_where_and_what_was_current_instead() {
    let files = Files::new(&[
        ("good.esm", GOOD),
        ("s.scenario", "until 20 ms\nat 0 ms expect motion/Escape\n"),
    ]);
    let done = files.esm("sim {}/good.esm {}/s.scenario");
    assert_eq!(done.status, Some(1));
    let told = done.out + &done.err;
    for part in ["s.scenario:2", "motion/Escape", "motion/Cruise"] {
        assert!(told.contains(part), "{part}: {told}");
    }
}

#[test]
fn the_cd_player_takes_at_most_ten_bytes_a_transition() {
    let blob = tempfile::tempdir().unwrap();
    let blob = blob.path().join("cd51.blob");
    esm(&["build", "tests/data/cd51.esm", "-o", blob.to_str().unwrap()]).good();
    let inspected = esm(&["inspect", blob.to_str().unwrap(), "--json"])
        .good()
        .json();
    let bytes = inspected["bytes_per_transition"].as_f64().unwrap();
    assert!((6.0..=10.0).contains(&bytes), "{bytes} bytes a transition");
}

#[test]
fn the_missions_that_ship_are_without_errors_and_warnings() {
    let missions = root().join("missions");
    let mut checked = 0;
    for entry in std::fs::read_dir(missions).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "esm") {
            let path = path.to_str().unwrap();
            let done = esm(&["check", path, "--json"]).good();
            let told: Vec<serde_json::Value> = done
                .out
                .lines()
                .map(|line| serde_json::from_str(line).unwrap())
                .filter(|found: &serde_json::Value| {
                    // No mission uses all that the rover can do.
                    !(found["code"] == "W107" && found["file"] != path)
                })
                .collect();
            assert_eq!(told, [] as [serde_json::Value; 0], "{path}");
            // A person sees no more than how much of the library is unused.
            let done = esm(&["check", path]).good();
            assert!(
                done.out.ends_with(": no errors, no warnings\n"),
                "{done:#?}"
            );
            assert!(!done.err.contains("warning"), "{done:#?}");
            checked += 1;
        }
    }
    assert!(checked >= 3, "only {checked} missions were found");
}

#[test]
fn a_mission_that_is_too_large_for_one_board_is_built_for_another() {
    let slots: String = (2..=17)
        .map(|number| format!("slot {number} period 100 ms duration 1 ms;\n"))
        .collect();
    let mission = format!(
        "interpreter slot 1;\nslot 1 period 100 ms duration 1 ms;\n{slots}machine M {{ region r {{ state A; initial -> A; }} }}\n"
    );
    let files = Files::new(&[("large.esm", &mission)]);
    for (command, asked) in [
        ("check {}/large.esm", ""),
        ("build {}/large.esm -o {}/large.blob", " --board lm3s6965"),
    ] {
        let done = files.esm(&format!("{command}{asked} --json"));
        assert_eq!(done.status, Some(1), "{done:#?}");
        // Its slots have no tasks, and it has no way out: warnings stand beside the error.
        let errors: Vec<serde_json::Value> = done
            .out
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .filter(|it: &serde_json::Value| it["severity"] == "error")
            .collect();
        let [told] = errors.as_slice() else {
            panic!("{done:#?}");
        };
        assert_eq!(
            (&told["code"], &told["line"]),
            (&"E012".into(), &18.into()),
            "{done:#?}"
        );
        for word in ["17 slots", "1 more", "16", "lm3s6965"] {
            assert!(told["message"].as_str().unwrap().contains(word), "{told}");
        }
        files.esm(&format!("{command} --board host")).good();
        let done = files.esm(&format!("{command} --board toaster"));
        assert_eq!(done.status, Some(2), "{done:#?}");
        for word in ["toaster", "`lm3s6965`", "`host`"] {
            assert!(done.err.contains(word), "{done:#?}");
        }
    }
    let built = files.esm("build {}/large.esm -o {}/large.blob").good();
    assert!(
        built
            .err
            .contains("17 slots are needed, 1 more than the 16 that board `lm3s6965`"),
        "{built:#?}"
    );
    // A machine alone has no board.
    let scenario = Files::new(&[("large.esm", &mission), ("s.scenario", "until 100 ms\n")]);
    scenario.esm("sim {}/large.esm {}/s.scenario").good();
}

#[test]
fn what_a_mission_leaves_unused_of_a_library_is_counted_unless_it_is_asked_for() {
    let library =
        "task Blink slot 1 { out flag lit; }\ntask Fade slot 1 { }\ntask Glow slot 1 { }\n";
    let mission = "use \"library.esm\";\ninterpreter slot 1;\nslot 1 period 10 ms duration 1 ms;\nslot 2 period 10 ms duration 1 ms;\n\
        machine M { region r { task A: Blink; initial -> A; A -> A [.lit]; } }\n";
    let files = Files::new(&[("library.esm", library), ("mission.esm", mission)]);
    let counted = files.esm("check {}/mission.esm").good();
    for (part, is_there) in [
        ("slot 2 is not used", true),
        ("library.esm: 2 declarations not used by this mission", true),
        ("`Fade`", false),
        ("esm explain W107", true),
    ] {
        assert_eq!(counted.err.contains(part), is_there, "{part}: {counted:#?}");
    }
    assert!(
        counted.out.ends_with("no errors, 1 warning\n"),
        "{counted:#?}"
    );
    let all = files.esm("check {}/mission.esm --all").good();
    for part in ["slot 2 is not used", "`Fade`", "`Glow`"] {
        assert!(all.err.contains(part), "{part}: {all:#?}");
    }
    assert!(all.out.ends_with("no errors, 3 warnings\n"), "{all:#?}");
    assert_eq!(all.err.matches("esm explain").count(), 1, "{all:#?}");
    let lines = files.esm("check {}/mission.esm --json").good().out;
    assert_eq!(lines.lines().count(), 3, "{lines}");
    for line in lines.lines() {
        let found: serde_json::Value = serde_json::from_str(line).unwrap();
        let keys: Vec<&str> = found
            .as_object()
            .unwrap()
            .keys()
            .map(String::as_str)
            .collect();
        let mut expected = ["code", "severity", "file", "line", "col", "message"];
        expected.sort_unstable();
        assert_eq!(keys, expected);
    }
}

#[test]
fn a_code_is_explained_and_an_unknown_one_is_wrong_usage() {
    let page = esm(&["explain", "e008"]).good().out;
    for part in [
        "E008: a data path",
        "`esm check` says:",
        "error[E008]",
        "Right",
    ] {
        assert!(page.contains(part), "{part}: {page}");
    }
    let list = esm(&["explain"]).good().out;
    assert_eq!(
        list.lines().count(),
        host_tools::lang::Code::ALL.len(),
        "{list}"
    );
    let done = esm(&["explain", "E0O8"]);
    assert_eq!(done.status, Some(2), "{done:#?}");
    assert!(done.err.contains("did you mean `E008`"), "{done:#?}");
}

/// Commands of fenced `sh` blocks in a Markdown file.
fn commands_in(file: &str) -> Vec<String> {
    let text = std::fs::read_to_string(root().join(file)).unwrap();
    let mut commands = Vec::new();
    let mut inside = false;
    for line in text.lines() {
        match line.trim_end() {
            "```sh" => inside = true,
            "```" => inside = false,
            line if inside => {
                let command = line.split(" #").next().unwrap_or_default().trim();
                if !command.is_empty() {
                    commands.push(command.to_owned());
                }
            }
            _ => {}
        }
    }
    commands
}

/// Splits a command into words; quotes keep words together.
fn words(command: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (index, part) in command.split('\'').enumerate() {
        if index % 2 == 1 {
            found.push(part.to_owned());
        } else {
            found.extend(part.split_whitespace().map(str::to_owned));
        }
    }
    found
}

#[test]
fn the_commands_of_the_front_page_work_as_they_stand() {
    let folder = tempfile::tempdir().unwrap();
    let made = [
        "patrol.blob",
        "patrol.rec",
        "patrol.svg",
        "rover.recs",
        "schedule.svg",
    ];
    let there = |word: String, name: &&str| {
        let path = folder.path().join(name);
        word.replace(name, path.to_str().unwrap())
    };
    let mut ran = 0;
    for command in commands_in("README.md") {
        let Some(arguments) = command.strip_prefix("esm ") else {
            let others = ["cargo xtask demo", "cargo xtask test", INSTALL];
            assert!(
                others.contains(&command.as_str()),
                "a new kind of command: test it too: {command}"
            );
            continue;
        };
        let arguments: Vec<String> = words(arguments)
            .into_iter()
            .map(|word| made.iter().fold(word, there))
            .collect();
        let done = esm(&arguments);
        assert_eq!(done.status, Some(0), "{command}: {done:#?}");
        ran += 1;
    }
    assert!(ran >= 9, "only {ran} commands were found");
}

/// What puts the command on the path of whoever follows the book.
const INSTALL: &str = "cargo install --locked --path host-tools";

#[test]
fn the_command_is_installed_as_the_front_page_says() {
    esm(&["--version"]).good();
    let folder = tempfile::tempdir().unwrap();
    let mut cargo = Command::new("cargo");
    let status = cargo
        .args(INSTALL.split_whitespace().skip(1))
        .args(["--quiet", "--no-track", "--root"])
        .arg(folder.path())
        .current_dir(root())
        .status();
    assert!(status.unwrap().success());
    let installed = Command::new(folder.path().join("bin/esm"))
        .args(["explain", "E008"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert_eq!(
        String::from_utf8_lossy(&installed.stdout),
        esm(&["explain", "E008"]).good().out
    );
}
