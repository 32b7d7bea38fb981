//! Each mission that ships, in each world, on the emulated board and on the host: the same trace,
//! line by line, and every transition taken.
//!
//! What one test drives, the others look at too: a run in the emulator takes a good part of a
//! minute.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Duration;

use esm_tests::command::{Done, chip_firmware, esm, esm_timed, figure, firmware, root};
use esm_tests::environment;
use host_tools::boards;
use host_tools::files::load_world;
use host_tools::host_board::{self, RobotMaker};
use host_tools::lang;
use host_tools::model::{Action, Container, Model, Region, Source, StateKind, Target, Trigger};
use host_tools::qemu::folder::RunFolder;
use host_tools::run::board::Board;
use host_tools::run::drive::{self, Plan, Planned};
use host_tools::run::interrupt::Interrupt;
use host_tools::run::mission::Mission;
use rt_firmware::AnyTaskPool;
use rt_firmware::body::Parts;
use rt_firmware::rover::{Measures, PinRover, PinRoverParts};

const MISSIONS: [&str; 2] = ["patrol", "follow_wall"];
const WORLDS: [&str; 2] = ["office", "corridor"];
/// Robot time of a run.
const RUN_S: u64 = 120;

/// Transitions that no run takes, and why. `missions/README.md` tells people the same.
const NOT_TAKEN: &[(&str, &str, &str)] = &[
    (
        "patrol",
        "battery: Measure -> final on pulse",
        "the battery lasts for more than an hour",
    ),
    (
        "patrol",
        "wheels: Drive -> final on Empty",
        "and so it is never empty",
    ),
    (
        "patrol",
        "wheels: Drive -> final on pulse",
        "the plant's wheels slip where real ones would block",
    ),
    (
        "follow_wall",
        "battery: Measure -> final on pulse",
        "the battery lasts for more than an hour",
    ),
    (
        "follow_wall",
        "wheels: Drive -> final on Empty",
        "and so it is never empty",
    ),
    (
        "patrol",
        "sonars: Listen -> Broken on pulse",
        "no sonar breaks in these runs; others break them",
    ),
    (
        "patrol",
        "sonars: Broken -> Listen on pulse",
        "no sonar breaks in these runs; others break them",
    ),
    (
        "follow_wall",
        "sonars: Listen -> Broken on pulse",
        "no sonar breaks in these runs; others break them",
    ),
    (
        "follow_wall",
        "sonars: Broken -> Listen on pulse",
        "no sonar breaks in these runs; others break them",
    ),
    (
        "follow_wall",
        "motion: Approach -> Stranded on SonarFault",
        "no sonar breaks in these runs; others break them",
    ),
    (
        "follow_wall",
        "motion: Corner -> Stranded on SonarFault",
        "no sonar breaks in these runs; others break them",
    ),
    (
        "follow_wall",
        "motion: Follow -> Stranded on SonarFault",
        "no sonar breaks in these runs; others break them",
    ),
    (
        "follow_wall",
        "motion: Round -> Stranded on SonarFault",
        "no sonar breaks in these runs; others break them",
    ),
    (
        "follow_wall",
        "motion: Stranded -> Stranded on SonarFault",
        "no sonar breaks in these runs; others break them",
    ),
    (
        "follow_wall",
        "motion: Stranded -> Approach on pulse",
        "no sonar breaks in these runs; others break them",
    ),
];

/// A mission driven in a world on both boards, with the processor time of each run.
struct Driven {
    mission: &'static str,
    world: &'static str,
    /// The emulator's.
    trace: String,
    emulated: (Done, Duration),
    /// Kept for further runs.
    recording: PathBuf,
    on_host: String,
    host: (Done, Duration),
}

/// Where traces and recordings of these tests are kept, to be looked at after a failure: until the
/// next run of the tests, and apart from those of a run beside this one.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<RunFolder> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let place = root().join("target/boards");
        std::fs::create_dir_all(&place).unwrap();
        RunFolder::below(&place).unwrap()
    });
    folder.path()
}

/// Drives a mission; gives the trace.
fn drive_on(
    board: &str,
    mission: &str,
    world: &str,
    until_s: u64,
    trace: &Path,
    more: &[&str],
) -> (String, (Done, Duration)) {
    let mission = format!("missions/{mission}.esm");
    let world = format!("missions/worlds/{world}.world");
    let until = format!("{until_s} s");
    let trace = trace.to_str().unwrap();
    let mut arguments = vec!["run", &mission, "--board", board, "--world", &world];
    arguments.extend(["--until", &until, "--trace", trace]);
    let elf = match board {
        "host" => None,
        boards::DEFAULT => Some(firmware("rover")),
        other => Some(chip_firmware(other)),
    };
    if let Some(elf) = &elf {
        arguments.extend(["--firmware", elf.to_str().unwrap()]);
    }
    arguments.extend(more);
    let (done, took) = esm_timed(&arguments);
    let trace = std::fs::read_to_string(trace).unwrap_or_default();
    (trace, (done.good(), took))
}

/// All runs, made once.
fn driven() -> &'static [Driven] {
    static DRIVEN: OnceLock<Vec<Driven>> = OnceLock::new();
    DRIVEN.get_or_init(|| {
        let mut found = Vec::new();
        for mission in MISSIONS {
            for world in WORLDS {
                let file = |name: &str| folder().join(format!("{mission}-{world}-{name}"));
                let recording = file("rec");
                let kept = recording.to_str().unwrap();
                let (trace, emulated) = drive_on(
                    "lm3s6965",
                    mission,
                    world,
                    RUN_S,
                    &file("lm3s6965.jsonl"),
                    &["--record", kept],
                );
                let (on_host, host) = drive_on(
                    "host",
                    mission,
                    world,
                    RUN_S,
                    &file("host.jsonl"),
                    &["--replay", kept],
                );
                found.push(Driven {
                    mission,
                    world,
                    trace,
                    emulated,
                    recording,
                    on_host,
                    host,
                });
            }
        }
        found
    })
}

/// The first line in which two traces differ.
fn first_difference(a: &str, b: &str) -> Option<String> {
    if a == b {
        return None;
    }
    let line = a.lines().zip(b.lines()).position(|(a, b)| a != b);
    let line = line.unwrap_or_else(|| a.lines().count().min(b.lines().count()));
    let at = |text: &str| {
        text.lines()
            .nth(line)
            .unwrap_or("(the trace has ended)")
            .to_owned()
    };
    Some(format!("line {}:\n  {}\n  {}", line + 1, at(a), at(b)))
}

#[test]
fn the_emulated_board_and_the_host_give_the_same_trace() {
    for run in driven() {
        let what = format!("{} in the {}", run.mission, run.world);
        if let Some(difference) = first_difference(&run.trace, &run.on_host) {
            panic!("{what}: emulator and host differ in {difference}");
        }
        let steps = run
            .trace
            .lines()
            .filter(|line| line.contains(r#""kind":"step""#))
            .count();
        // Macro steps at 0 s, 20 ms, … up to 120 s: the last one may be the one that ends the run.
        let expected = RUN_S as usize * 50;
        assert!(
            (expected..=expected + 1).contains(&steps),
            "{what}: {steps} macro steps"
        );
        assert!(!run.trace.contains(r#""kind":"fault""#), "{what}");
    }
}

/// Names of the files in a folder below the checkout that end so, without that, in order.
fn names(folder: &str, ending: &str) -> Vec<String> {
    let entries = std::fs::read_dir(root().join(folder)).into_iter().flatten();
    let mut names: Vec<String> = entries
        .filter_map(|entry| {
            let name = entry.ok()?.file_name().into_string().ok()?;
            Some(name.strip_suffix(ending)?.to_owned())
        })
        .collect();
    names.sort();
    names
}

/// Each mission that ships in a world of its own, and each world at least once; all in all of them
/// where the whole is asked for.
fn shipped_runs() -> Vec<(String, String)> {
    // It has nothing but declarations.
    let missions = names("missions", ".esm");
    let missions: Vec<String> = missions.into_iter().filter(|it| it != "rover").collect();
    let worlds = names("missions/worlds", ".world");
    if environment::number("ESM_BOARDS_ALL_WORLDS", 0) == 1 {
        let in_all = |mission: &String| {
            let with = |world: &String| (mission.clone(), world.clone());
            worlds.iter().map(with).collect::<Vec<_>>()
        };
        return missions.iter().flat_map(in_all).collect();
    }
    let mut runs = Vec::new();
    for mission in missions {
        // A goal is named after its world.
        let goals = names(&format!("missions/{mission}"), ".goal");
        let own = if goals.is_empty() {
            vec!["office".to_owned()]
        } else {
            goals
        };
        runs.extend(own.into_iter().map(|world| (mission.clone(), world)));
    }
    for world in worlds {
        if runs.iter().all(|(_, driven_in)| *driven_in != world) {
            runs.push(("patrol".to_owned(), world));
        }
    }
    runs
}

#[test]
fn every_other_board_in_qemu_gives_the_hosts_trace_of_each_mission_that_ships() {
    let until_s = environment::number("ESM_BOARDS_S", 10);
    let others = boards::all().filter(|board| {
        let machine = board.firmware.and_then(|firmware| firmware.machine());
        machine.is_some() && board.name != boards::DEFAULT
    });
    let runs = shipped_runs();
    let mut driven = 0;
    for board in others {
        for (mission, world) in &runs {
            let file = |name: &str| folder().join(format!("{mission}-{world}-{name}"));
            let recording = file(&format!("{}.rec", board.name));
            let kept = recording.to_str().unwrap();
            let drive = |on: &str, word: &str| {
                let trace = file(&format!("{}-{on}.jsonl", board.name));
                drive_on(on, mission, world, until_s, &trace, &[word, kept])
            };
            let (emulated, (done, _)) = drive(board.name, "--record");
            let (on_host, _) = drive("host", "--replay");
            let what = format!("{mission} in {world} on {}", board.name);
            if let Some(difference) = first_difference(&emulated, &on_host) {
                panic!("{what}: emulator and host differ in {difference}");
            }
            assert_eq!(figure(&done.out, "slots missed"), Some(0.0), "{what}");
            let steps = emulated.matches(r#""kind":"step""#).count();
            assert!(steps as u64 >= until_s * 5, "{what}: {steps} macro steps");
            assert!(!emulated.contains(r#""kind":"fault""#), "{what}");
            driven += 1;
        }
    }
    println!("{driven} runs of {until_s} s, each with the trace of the host");
    assert!(
        driven >= runs.len(),
        "there is a board besides the default one"
    );
}

#[test]
fn a_line_is_followed_alike_on_both_boards() {
    let file = |name: &str| folder().join(format!("line-{name}.jsonl"));
    let recording = file("recording");
    let recording = recording.to_str().unwrap();
    // Past the crossing, around a sharp corner, over the gap.
    let drive = |board: &str, more: [&str; 2]| {
        let mission = "tutorial/6_everything";
        drive_on(board, mission, "track", 30, &file(board), &more)
    };
    let (emulated, (done, _)) = drive("lm3s6965", ["--record", recording]);
    let (on_host, _) = drive("host", ["--replay", recording]);
    if let Some(difference) = first_difference(&emulated, &on_host) {
        panic!("emulator and host differ in {difference}");
    }
    assert_eq!(figure(&done.out, "collisions"), Some(0.0), "{}", done.out);
    for state in ["motion/GiveWay", "motion/Drive/steps/SearchRight"] {
        assert!(emulated.contains(&format!(r#""to":"{state}""#)), "{state}");
    }
}

#[test]
fn two_runs_in_the_emulator_are_equal_to_the_byte() {
    for mission in MISSIONS {
        let run = driven().iter().find(|run| run.mission == mission).unwrap();
        let again = folder().join(format!("{mission}-again.jsonl"));
        let recording = folder().join(format!("{mission}-again.rec"));
        let kept = ["--record", recording.to_str().unwrap()];
        let (trace, _) = drive_on("lm3s6965", mission, run.world, RUN_S, &again, &kept);
        if let Some(difference) = first_difference(&run.trace, &trace) {
            panic!("{mission}: {difference}");
        }
        assert_eq!(
            std::fs::read(&run.recording).unwrap(),
            std::fs::read(recording).unwrap(),
            "{mission}: what entered the run"
        );
    }
}

#[test]
fn no_run_collides_and_each_is_fast_enough() {
    for run in driven() {
        let what = format!("{} in the {}", run.mission, run.world);
        let boards = [
            (
                "the emulator",
                &run.emulated,
                Duration::from_secs(RUN_S / 2),
            ),
            // Start and end of the process are part of what is measured.
            (
                "the host",
                &run.host,
                Duration::from_millis(RUN_S * 1_000 / 200) + Duration::from_millis(300),
            ),
        ];
        for (board, (done, took), limit) in boards {
            println!("{what}: {board} worked for {took:?}");
            let collisions = figure(&done.out, "collisions");
            assert_eq!(collisions, Some(0.0), "{what}: {}", done.out);
            assert!(*took < limit, "{what}: {board} worked for {took:?}");
        }
    }
}

#[test]
fn every_transition_is_taken_or_listed_with_the_reason() {
    for mission in MISSIONS {
        let path = root().join(format!("missions/{mission}.esm"));
        let model = lang::load(&path).unwrap().model.unwrap();
        let mut open = transitions(&model);
        let all = open.len();
        for run in driven().iter().filter(|run| run.mission == mission) {
            for line in run.trace.lines() {
                let line: serde_json::Value = serde_json::from_str(line).unwrap();
                if line["kind"] == "transition" {
                    let line = Taken::of(&line);
                    open.retain(|_, places| !places.contains(&line));
                }
            }
        }
        let open: BTreeSet<&str> = open.keys().map(String::as_str).collect();
        let listed: BTreeSet<&str> = NOT_TAKEN
            .iter()
            .filter(|(of, _, _)| *of == mission)
            .map(|(_, transition, _)| *transition)
            .collect();
        println!("{mission}: {all} transitions, not taken: {open:?}");
        assert_eq!(
            open, listed,
            "{mission}: not taken in any run, against the list"
        );
    }
}

/// What a trace tells of a transition.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Taken {
    event: String,
    from: String,
    to: String,
    sent: Vec<String>,
    written: Vec<String>,
}

impl Taken {
    fn of(line: &serde_json::Value) -> Self {
        let text = |key: &str| line[key].as_str().unwrap().to_owned();
        let list = |key: &str| -> Vec<String> {
            let values = line[key].as_array().unwrap().iter();
            values
                .map(|value| value.as_str().unwrap().to_owned())
                .collect()
        };
        Taken {
            event: text("event"),
            from: text("from"),
            to: text("to"),
            sent: list("sent"),
            written: [list("set"), list("cleared")].concat(),
        }
    }
}

/// All transitions of the machine and its containers as the source has them, each with what a trace
/// can say of it: once for each use.
fn transitions(model: &Model) -> BTreeMap<String, BTreeSet<Taken>> {
    let mut found = BTreeMap::new();
    list_transitions(model, model.machine.unwrap(), "", None, &mut found);
    found
}

fn list_transitions(
    model: &Model,
    container: usize,
    prefix: &str,
    holder: Option<&str>,
    found: &mut BTreeMap<String, BTreeSet<Taken>>,
) {
    let declared = &model.containers[container];
    for region in &declared.regions {
        let mut seen: BTreeMap<String, usize> = BTreeMap::new();
        for transition in &region.transitions {
            let name = |state: &str| format!("{prefix}{}/{state}", region.name);
            let (from, to) = (
                source_name(region, transition.source),
                target_name(region, transition.target),
            );
            let event = match transition.trigger {
                Trigger::Pulse | Trigger::Star => "pulse",
                Trigger::Event(event) => &model.events[event],
            };
            let mut taken = Taken {
                event: event.to_owned(),
                from: name(from),
                to: name(to),
                sent: Vec::new(),
                written: Vec::new(),
            };
            let mut cleared = Vec::new();
            for action in &transition.actions {
                let (flag, value) = match *action {
                    Action::Send(event) => {
                        taken.sent.push(model.events[event].clone());
                        continue;
                    }
                    Action::Own(flag, value) => {
                        let flag = own_flag(model, region, transition.target, flag);
                        (format!("{}.{flag}", taken.to), value)
                    }
                    Action::Parent(flag, value) => {
                        let flag = &declared.flags[flag].name;
                        (format!("{}.{flag}", holder.unwrap()), value)
                    }
                };
                if value {
                    &mut taken.written
                } else {
                    &mut cleared
                }
                .push(flag);
            }
            taken.written.append(&mut cleared);
            // A container's transitions are counted once, however often it is used.
            let place = place_of(declared, region);
            let text = format!("{place}: {from} -> {to} on {event}");
            let number = seen.entry(text.clone()).or_default();
            *number += 1;
            let text = if *number == 1 {
                text
            } else {
                format!("{text} ({number})")
            };
            found.entry(text).or_default().insert(taken);
        }
        for state in &region.states {
            if let StateKind::Super { container } = state.kind {
                let path = format!("{prefix}{}/{}", region.name, state.name);
                list_transitions(model, container, &format!("{path}/"), Some(&path), found);
            }
        }
    }
}

fn place_of(container: &Container, region: &Region) -> String {
    if container.is_machine {
        region.name.clone()
    } else {
        format!("{}/{}", container.name, region.name)
    }
}

fn source_name(region: &Region, source: Source) -> &str {
    match source {
        Source::Initial => "initial",
        Source::State(state) => &region.states[state].name,
    }
}

fn target_name(region: &Region, target: Target) -> &str {
    match target {
        Target::Final => "final",
        Target::State(state) => &region.states[state].name,
    }
}

fn own_flag<'m>(model: &'m Model, region: &Region, target: Target, flag: usize) -> &'m str {
    let Target::State(state) = target else {
        unreachable!("`final` has no flags");
    };
    match region.states[state].kind {
        StateKind::Task { task, .. } => &model.tasks[task].flags[flag].name,
        StateKind::Super { container } => &model.containers[container].flags[flag].name,
        StateKind::Simple => unreachable!("a simple state has no control flags"),
    }
}

#[test]
fn a_changed_plant_or_table_breaks_the_equality() {
    let run = &driven()[0];
    let text =
        std::fs::read_to_string(root().join(format!("missions/{}.esm", run.mission))).unwrap();
    let rover = root().join("missions/rover.esm");
    let text = text.replace("\"rover.esm\"", &format!("\"{}\"", rover.display()));
    let world = root().join(format!("missions/worlds/{}.world", run.world));
    let world = std::fs::read_to_string(world).unwrap();
    let changed = |text: &str, from: &str, to: &str| {
        assert!(text.contains(from), "there is nothing to change: {from}");
        text.replacen(from, to, 1)
    };
    let folder = tempfile::tempdir().unwrap();
    let (mission, map) = (folder.path().join("m.esm"), folder.path().join("w.world"));
    for (what, text, world, seed) in [
        ("nothing", text.clone(), world.clone(), "1"),
        ("a sensor's noise", text.clone(), world.clone(), "2"),
        (
            "a wall, by a centimetre",
            text.clone(),
            changed(&world, "0.8,3.1 0.8,3.2", "0.81,3.1 0.81,3.2"),
            "1",
        ),
        (
            "a timeout, by a macro step",
            changed(&text, "timeout 2 s", "timeout 2020 ms"),
            world.clone(),
            "1",
        ),
        (
            "a parameter, by a hundredth of a radian",
            changed(&text, "angle_rad = 1.0", "angle_rad = 1.01"),
            world.clone(),
            "1",
        ),
        (
            "a flag of an action",
            changed(
                &text,
                "[.near and .left_freer] / set .left",
                "[.near and .left_freer]",
            ),
            world.clone(),
            "1",
        ),
    ] {
        std::fs::write(&mission, text).unwrap();
        std::fs::write(&map, world).unwrap();
        let trace = folder.path().join("t.jsonl");
        esm(&[
            "run",
            mission.to_str().unwrap(),
            "--board",
            "host",
            "--world",
            map.to_str().unwrap(),
            "--until",
            &format!("{RUN_S} s"),
            "--seed",
            seed,
            "--trace",
            trace.to_str().unwrap(),
        ])
        .good();
        let trace = std::fs::read_to_string(trace).unwrap();
        // Without a recording background runs end where the host ends them: for this mission that
        // is where the emulator did.
        let equal = first_difference(&run.trace, &trace).is_none();
        assert_eq!(equal, what == "nothing", "changed was: {what}");
    }
}

#[test]
fn the_demo_drives_far_through_rooms_and_swaps_missions_without_missing_a_slot() {
    let out = tempfile::tempdir().unwrap();
    let elf = firmware("rover");
    // What `cargo xtask demo` runs.
    esm(&[
        "run",
        "missions/patrol.esm",
        "--world",
        "missions/worlds/office.world",
        "--until",
        "120 s",
        "--then",
        "60 s missions/follow_wall.esm",
        "--firmware",
        elf.to_str().unwrap(),
        "--out",
        out.path().to_str().unwrap(),
    ])
    .good();
    let file = |name: &str| std::fs::read(out.path().join(name)).unwrap();
    let summary: serde_json::Value = serde_json::from_slice(&file("summary.json")).unwrap();
    assert_eq!(summary["collisions"], 0, "{summary:#}");
    assert_eq!(summary["slots_missed"], 0, "{summary:#}");
    assert!(summary["distance_m"].as_f64() >= Some(10.0), "{summary:#}");
    assert!(
        summary["rooms_entered"].as_array().unwrap().len() >= 3,
        "{summary:#}"
    );
    let missions = summary["missions"].as_array().unwrap();
    assert_eq!(missions.len(), 2, "{summary:#}");
    for mission in missions {
        assert_eq!(mission["slots_missed_in_upload"], 0, "{summary:#}");
    }
    let second_s = missions[1]["started_s"].as_f64().unwrap();
    assert!((60.0..70.0).contains(&second_s), "{summary:#}");
    for picture in ["path", "states"] {
        assert!(
            file(&format!("{picture}.svg")).starts_with(b"<svg")
                || file(&format!("{picture}.svg")).starts_with(b"<?xml")
        );
        assert!(file(&format!("{picture}.png")).starts_with(b"\x89PNG"));
    }
    // Between two macro steps: the new machine's first one has number 0, and none is cut short.
    let trace = String::from_utf8(file("trace.jsonl")).unwrap();
    let starts = trace
        .lines()
        .filter(|line| line.starts_with(r#"{"kind":"step","step":0,"#))
        .count();
    assert_eq!(starts, 2);
}

/// Something happens each millisecond, and the interpreter's slot is nearly as long as what is left
/// of one.
const QUICK: &str = "
    interpreter slot 1;
    slot 1 period 20 ms duration 550 us;
    slot 2 period 1 ms duration 350 us;
    slot 3 period 20 ms duration 500 us;
    task SlotMonitor slot 2 { out flag overrun; out flag missed; param limit: u32 = 10 min 0 max 1000; }
    task BatteryMonitor slot 3 { out data battery: Battery; out flag low; param low_v: f32 = 6.6 min 0.0 max 20.0; }
    container Deep {
        in flag quick;
        region a { state One timeout 60 ms; state Two timeout 40 ms; initial -> One; One -> Two [timeout]; Two -> One [timeout]; }
        region b { state One timeout 30 ms; state Two timeout 50 ms; initial -> One; One -> Two [timeout]; Two -> One [timeout]; }
    }
    machine Quick {
        event Leave;
        region watch { task Watch: SlotMonitor with { limit = 20 }; initial -> Watch; }
        region battery { task Measure: BatteryMonitor; initial -> Measure; }
        region left { super In: Deep; state Out timeout 70 ms; initial -> In / set .quick; In -> Out on Leave; Out -> In [timeout]; }
        region right { super In: Deep; state Out timeout 70 ms; initial -> In; In -> Out on Leave; Out -> In [timeout]; }
        region steps { state A timeout 100 ms; state B timeout 100 ms; initial -> A; A -> B [timeout] / send Leave; B -> A [timeout]; }
    }";

/// What the first macro step of a mission may be late by that follows another, in virtual time,
/// which counts instructions: three quarters of the quickest slot's period, half as much again as
/// the compilers at hand make of it.
const FOLLOWING_LIMIT_NS: u64 = 750_000;

#[test]
fn a_mission_that_follows_another_delays_its_first_step_by_less_than_a_period_cold_or_warm() {
    let folder = tempfile::tempdir().unwrap();
    let missions = root().join("missions");
    std::fs::copy(missions.join("rover.esm"), folder.path().join("rover.esm")).unwrap();
    let patrol = std::fs::read_to_string(missions.join("patrol.esm")).unwrap();
    let elf = firmware("rover");
    for (name, text, (from, to), longest_ns) in [
        // Long before the macro step nothing is due, and the missions are exchanged then.
        (
            "patrol",
            &*patrol,
            ("angle_rad = 1.0", "angle_rad = 1.5"),
            10_000,
        ),
        (
            "quick",
            QUICK,
            ("limit = 20", "limit = 21"),
            FOLLOWING_LIMIT_NS,
        ),
    ] {
        let file = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            path.to_str().unwrap().to_owned()
        };
        let changed = text.replace(from, to);
        assert_ne!(changed, text);
        let before = file(&format!("{name}.esm"), text);
        let then = format!("1 s {}", file(&format!("{name}_changed.esm"), &changed));
        let out = folder.path().join(name);
        for warm in [&[][..], &["--warm"]] {
            let arguments = ["run", &before, "--then", &then, "--until", "2400 ms"];
            let files = [
                "--firmware",
                elf.to_str().unwrap(),
                "--out",
                out.to_str().unwrap(),
            ];
            esm(&[&arguments[..], &files, warm].concat()).good();
            let summary = std::fs::read(out.join("summary.json")).unwrap();
            let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
            assert_eq!(summary["slots_missed"], 0, "{name} {warm:?}: {summary:#}");
            // Its first macro step is the one behind the swap.
            let slots = &summary["missions"][1]["slots"];
            let delay_ns = slots[0]["longest_delay_ns"].as_u64().unwrap();
            println!("{name} {warm:?}: {delay_ns} ns late, {longest_ns} ns at most");
            assert!(delay_ns <= longest_ns, "{name} {warm:?}: {delay_ns} ns");
            assert!(slots[0]["executed"].as_u64() > Some(20), "{slots:#}");
        }
    }
}

/// A robot like the rover, but with wheels a millimetre farther apart.
fn wider_rover(parts: Parts<'_>, run: &mut dyn FnMut(&mut [&mut (dyn AnyTaskPool + '_)])) {
    let parts: PinRoverParts<'_> = parts.into();
    let mut wider = Measures::ROVER;
    wider.chassis.wheel_base_m += 0.001;
    let mut robot = PinRover::new(parts, &wider);
    run(&mut robot.banks());
}

#[test]
fn a_changed_task_breaks_the_equality() {
    let run = &driven()[0];
    let blob = folder().join("task.blob");
    esm(&[
        "build",
        &format!("missions/{}.esm", run.mission),
        "-o",
        blob.to_str().unwrap(),
    ])
    .good();
    for (robot, is_equal) in [
        (host_board::rover as RobotMaker, true),
        (wider_rover, false),
    ] {
        let verified = esm_core::verify(std::fs::read(&blob).unwrap()).unwrap();
        let plan = Plan {
            until_us: Some(RUN_S * 1_000_000),
            ..Plan::new(
                Board::Host { robot },
                load_world(&root().join(format!("missions/worlds/{}.world", run.world))).unwrap(),
                vec![Planned::first(Mission::new(&blob, verified).unwrap())],
            )
        };
        let interrupt = Interrupt::take_over().unwrap();
        let driven = drive::drive(plan, Vec::new(), interrupt, &mut |_| ()).unwrap();
        let trace = String::from_utf8(driven.told.out).unwrap();
        assert_eq!(first_difference(&run.trace, &trace).is_none(), is_equal);
    }
}
