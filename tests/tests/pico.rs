//! The board pico in its emulator, with the robot's body behind its pins.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use esm_tests::command::{chip_firmware, esm, example_of_a_file, figure, root};
use host_tools::qemu::folder::RunFolder;
use serde_json::Value;

/// Robot time of a run, in seconds.
const RUN_S: u64 = 15;

/// How much later, or earlier, a transition may be than on the host board, in microseconds. Between
/// the body and its pins lies a millisecond, and wheels turn by whole edges: what depends on the
/// exact place of the robot may come in another activation of the interpreter, 20 ms apart.
const MOST_APART_US: u64 = 200_000;

/// Where traces of these tests are kept, to be looked at after a failure.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<RunFolder> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| RunFolder::new().unwrap());
    folder.path()
}

/// A transition: when, from where, to where.
type Transition = (u64, String, String);

struct Driven {
    transitions: Vec<Transition>,
    trace: String,
    said: String,
}

/// The run of the robot in `examples/my_pico`.
const EXAMPLE: &str = "my_pico";

/// Drives a mission on a board.
fn drive(board: &str, mission: &str, world: &str, until_s: u64, name: &str) -> Driven {
    let trace: PathBuf = folder().join(format!("{mission}-{world}-{board}-{name}.jsonl"));
    let path = trace.to_str().unwrap();
    let mission = format!("missions/{mission}.esm");
    let until = format!("{until_s} s");
    let firmware = match name {
        EXAMPLE => example_of_a_file(),
        _ => chip_firmware("pico"),
    };
    let mut arguments = vec!["run", &mission, "--board", board, "--world", world];
    arguments.extend(["--until", &until, "--trace", path]);
    if board == "pico" {
        arguments.extend(["--firmware", firmware.to_str().unwrap()]);
    }
    let done = esm(&arguments).good();
    let trace = std::fs::read_to_string(&trace).unwrap();
    let lines = trace
        .lines()
        .map(|line| serde_json::from_str(line).unwrap());
    let transitions = lines
        .filter(|line: &Value| line["kind"] == "transition")
        .map(|line| {
            let text = |key: &str| line[key].as_str().unwrap().to_owned();
            (line["t_us"].as_u64().unwrap(), text("from"), text("to"))
        })
        .collect();
    Driven {
        transitions,
        trace,
        said: done.out,
    }
}

/// Both missions do in this world what they do on the host.
fn same_order(world: &str, least: usize) {
    for mission in ["patrol", "follow_wall"] {
        let [chip, host] = ["pico", "host"].map(|board| drive(board, mission, world, RUN_S, "15s"));
        let order = |driven: &Driven| -> Vec<String> {
            let steps = driven.transitions.iter();
            steps
                .map(|(_, from, to)| format!("{from} -> {to}"))
                .collect()
        };
        assert_eq!(order(&chip), order(&host), "{mission} in {world}");
        assert!(chip.transitions.len() >= least, "{mission} in {world}");
        let apart = (chip.transitions.iter().zip(&host.transitions))
            .map(|((a_us, ..), (b_us, ..))| a_us.abs_diff(*b_us))
            .max();
        println!(
            "{mission} in {world}: at most {} us apart",
            apart.unwrap_or(0)
        );
        assert!(apart.unwrap_or(0) <= MOST_APART_US, "{mission} in {world}");
        for (name, limit) in [("slots missed", 0.0), ("collisions", 0.0)] {
            assert_eq!(figure(&chip.said, name), Some(limit), "{}", chip.said);
        }
    }
}

#[test]
fn missions_do_in_the_office_what_they_do_on_the_host() {
    same_order("office", 20);
}

#[test]
fn missions_do_in_the_corridor_what_they_do_on_the_host() {
    same_order("corridor", 10);
}

/// Bridges with a direction, an encoder that counts backwards, two sonars: all of it is said in the
/// robot's file, and the robot drives.
#[test]
fn a_robot_with_two_sonars_drives_by_its_file() {
    chip_firmware("pico");
    let driven = drive("pico", "patrol", "office", 10, EXAMPLE);
    let to = |state: &str| {
        let reached = driven.transitions.iter();
        reached.filter(|(_, _, to)| to.ends_with(state)).count()
    };
    // Ahead, until a wall is near; round, and ahead again.
    assert!(to("steps/AvoidLeft") + to("steps/AvoidRight") >= 1);
    assert!(to("steps/Ahead") >= 2, "{}", driven.said);
    assert!(
        figure(&driven.said, "distance") > Some(0.5),
        "{}",
        driven.said
    );
    for name in ["slots missed", "collisions"] {
        assert_eq!(figure(&driven.said, name), Some(0.0), "{}", driven.said);
    }
}

/// Its wheels are smaller than the rover's, and nearer to each other: the body has them so, and the
/// file says it. Two of the square's corners are half a turn, which no other measures would make.
#[test]
fn a_robot_turns_by_the_measures_of_its_file() {
    chip_firmware("pico");
    let driven = drive("pico", "square", "empty", 14, EXAMPLE);
    let end = driven
        .said
        .lines()
        .find(|line| line.contains(" end "))
        .unwrap();
    let (_, turned) = end.rsplit_once(" and ").unwrap();
    let turned: f64 = turned.split('°').next().unwrap().parse().unwrap();
    assert!((turned.abs() - 180.0).abs() < 4.0, "{end}");
    assert_eq!(figure(&driven.said, "collisions"), Some(0.0), "{end}");
}

/// What the chapter says of an upload while the robot drives: a slot begins so much late at most,
/// in microseconds.
const LATEST_START_US: f64 = 50.0;

/// The mission is sent, written into flash and started, while the log and the trace go out.
#[test]
fn an_upload_while_it_drives_holds_no_slot_back() {
    let firmware = chip_firmware("pico");
    let mut arguments = vec!["run", "missions/patrol.esm", "--board", "pico"];
    arguments.extend(["--firmware", firmware.to_str().unwrap(), "--until", "4 s"]);
    arguments.extend(["--then", "2 s missions/follow_wall.esm"]);
    let said = esm(&arguments).good().out;
    assert_eq!(figure(&said, "slots missed"), Some(0.0), "{said}");
    let uploads = said.lines().filter(|line| line.contains("  upload "));
    assert_eq!(
        uploads
            .filter(|line| line.contains("0 slots missed meanwhile"))
            .count(),
        2
    );
    let late = figure(&said, "longest dispatch delay");
    assert!(late <= Some(LATEST_START_US) && late > Some(0.0), "{said}");
}

const CHAPTER: &str = "docs/src/pico.md";
const PICTURE: &str = "docs/src/img/pico-wiring.svg";

/// The chapter's table and picture of the wiring are those of the rover's file.
/// `ESM_BLESS=1 cargo test -p esm-tests --test pico the_chapter` writes them anew.
#[test]
fn the_chapter_shows_the_wiring_of_the_robots_file() {
    const BEGIN: &str = "<!-- esm wiring boards/pico/robot.toml -->\n";
    const END: &str = "<!-- end -->\n";
    let drawn = folder().join("wiring.svg");
    let table = esm(&[
        "wiring",
        "boards/pico/robot.toml",
        "--svg",
        drawn.to_str().unwrap(),
    ])
    .good();
    let picture = std::fs::read_to_string(&drawn).unwrap();
    let chapter = std::fs::read_to_string(root().join(CHAPTER)).unwrap();
    let (before, rest) = chapter.split_once(BEGIN).unwrap();
    let (_, after) = rest.split_once(END).unwrap();
    let right = format!("{before}{BEGIN}\n{}\n{END}{after}", table.out);
    if std::env::var_os("ESM_BLESS").is_some() {
        std::fs::write(root().join(CHAPTER), &right).unwrap();
        std::fs::write(root().join(PICTURE), &picture).unwrap();
    }
    assert_eq!(
        std::fs::read_to_string(root().join(CHAPTER)).unwrap(),
        right
    );
    assert_eq!(
        std::fs::read_to_string(root().join(PICTURE)).unwrap(),
        picture
    );
}

#[test]
fn a_robots_file_that_cannot_be_built_is_told() {
    let file = folder().join("robot.toml");
    let text = std::fs::read_to_string(root().join("boards/pico/robot.toml")).unwrap();
    std::fs::write(&file, text.replace("pin = 22", "pin = 10")).unwrap();
    let told = esm(&["wiring", file.to_str().unwrap()]).ended(1).err;
    let expected =
        "`sonars[0].trigger` and `stop_button.pin` are both GP10: give one of them another pin";
    assert!(told.contains(expected), "{told}");
    esm(&["wiring", "no/robot.toml"]).ended(1);
}

#[test]
fn two_runs_are_equal_to_the_byte() {
    let [first, second] = ["a", "b"].map(|name| drive("pico", "patrol", "office", 2, name));
    assert_eq!(first.trace, second.trace);
    let told = |driven: &Driven| {
        let lines = driven
            .said
            .lines()
            .filter(|line| !line.contains("on the wall"));
        lines.map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(told(&first), told(&second));
}
