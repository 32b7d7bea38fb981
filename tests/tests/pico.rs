//! The board pico in its emulator, with the robot's body behind its pins.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Duration;

use esm_link::message::{Mode, ResetReason};
use esm_tests::command::{chip_firmware, esm, example_of_a_file, figure, firmware_with, root};
use esm_tests::subject;
use host_tools::boards;
use host_tools::link_client::LinkClient;
use host_tools::lockstep::pace::Pace;
use host_tools::lockstep::plant_side::PlantSide;
use host_tools::plant::{BodyParameters, Plant};
use host_tools::qemu::folder::RunFolder;
use host_tools::run::board::{Board, LinkWay, RunningBoard};
use host_tools::world::World;
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
    drive_by(board, "exchange", mission, world, until_s, name)
}

/// Drives a mission on a board whose link goes this way.
fn drive_by(
    board: &str,
    way: &str,
    mission: &str,
    world: &str,
    until_s: u64,
    name: &str,
) -> Driven {
    let trace: PathBuf = folder().join(format!("{mission}-{world}-{board}-{name}.jsonl"));
    let path = trace.to_str().unwrap();
    let mission = format!("missions/{mission}.esm");
    let until = format!("{until_s} s");
    let firmware = match name {
        EXAMPLE => example_of_a_file(),
        _ => chip_firmware("pico"),
    };
    let mut arguments = vec!["run", &mission, "--board", board, "--world", world];
    arguments.extend(["--until", &until, "--trace", path, "--link", way]);
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

/// These missions do in this world what they do on the host.
fn same_order(missions: &[&str], world: &str, least: usize) {
    for mission in missions {
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
    same_order(&["patrol", "follow_wall"], "office", 20);
}

#[test]
fn missions_do_in_the_corridor_what_they_do_on_the_host() {
    same_order(&["patrol", "follow_wall"], "corridor", 10);
}

#[test]
fn behaviours_do_what_they_do_on_the_host() {
    same_order(&["guard"], "office", 8);
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

/// Of a mission that is kept in flash, so many bytes at least are no blank ones.
const KEPT_BYTES: usize = 2_000;

/// A mission that ships, which writes its diary ten times a second in place of once in two.
fn talkative(mission: &str) -> String {
    let text = std::fs::read_to_string(root().join(format!("missions/{mission}.esm"))).unwrap();
    let rover = root().join("missions/rover.esm");
    let mut changed = text.replace("use \"rover.esm\"", &format!("use {rover:?}"));
    let pause = "state Pause timeout 2 s;";
    assert_eq!(changed.matches(pause).count(), 1, "{mission}");
    changed = changed.replace(pause, "state Pause timeout 100 ms;");
    let file = folder().join(format!("talkative_{mission}.esm"));
    std::fs::write(&file, changed).unwrap();
    file.to_str().unwrap().to_owned()
}

/// The mission is sent, written into flash and started, while the robot drives and logs, and its
/// log and its trace go out, over the UART and over USB.
#[test]
fn an_upload_while_it_drives_and_logs_holds_no_slot_back() {
    let firmware = chip_firmware("pico");
    let [first, second] = ["patrol", "follow_wall"].map(talkative);
    for way in ["exchange", "usb"] {
        let flash = folder().join(format!("kept-by-{way}"));
        let then = format!("2 s {second}");
        let mut arguments = vec!["run", &first, "--board", "pico", "--then", &then];
        arguments.extend(["--firmware", firmware.to_str().unwrap(), "--until", "4 s"]);
        arguments.extend(["--link", way, "--flash", flash.to_str().unwrap()]);
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
        let logged = said.lines().filter(|line| line.contains(" log | "));
        assert!(logged.count() >= 20, "{said}");
        // Both missions are kept.
        let cells = std::fs::read(&flash).unwrap();
        let kept = cells.iter().filter(|cell| **cell != 0xFF).count();
        assert!(kept > 2 * KEPT_BYTES, "{kept} bytes are kept");
    }
}

/// Drives on until it touches something, backs off, and turns to the left by what its gyroscope
/// tells.
const FEELS: &str = r#"
interpreter slot 1;
slot 1 period 20 ms duration 2 ms;
slot 2 period 10 ms duration 4 ms;
slot 3 period 40 ms duration 2 ms;
machine Feels {
    event Touched;
    region sonars { task Listen: SonarRing; initial -> Listen; }
    region position { task Track: Odometry; initial -> Track; }
    region turning { task Sense: Gyro; initial -> Sense; }
    region bumpers {
        task Feel: Bumpers;
        initial -> Feel;
        Feel -> Feel on pulse [.touched] / send Touched;
    }
    region drive {
        state Ready timeout 1600 ms;
        task Go: Move timeout 12 s with { speed_m_per_s = 0.2 };
        task Off: Move timeout 3 s with { speed_m_per_s = -0.15, outside_m = 0.05 };
        task Round: TurnTo timeout 5 s with { angle_rad = 1.0 };
        initial -> Ready;
        Ready -> Go [timeout];
        Go -> Off on Touched;
        Off -> Round [exit or timeout];
        Round -> final [exit or timeout];
    }
    region behaviours { task Run: Behaviours; initial -> Run; }
    region wheels { task Drive: WheelSpeed; initial -> Drive; }
    path Listen.ranges -> Feel.ranges;
    path Feel.felt -> Go.ranges, Off.ranges, Round.ranges, Run.ranges;
    path Run.made -> Run.list, Go.list, Off.list, Round.list;
    path Sense.yaw_rate -> Track.yaw_rate;
    path Track.pose -> Listen.pose, Go.pose, Off.pose, Round.pose, Run.pose;
    path Run.twist -> Drive.twist;
    path Track.speeds -> Drive.speeds, Sense.speeds;
}
"#;

/// Two of its sonars and the gyroscope are at a bus. Before the robot lies something too low for
/// its sonars: it feels it as soon as on the host board. Its wheels are a tenth farther from each
/// other than its firmware takes them for, by which it would turn a tenth too little: its gyroscope
/// knows better.
#[test]
fn a_robot_with_bumpers_and_a_gyroscope_feels_and_turns_by_them() {
    chip_firmware("pico");
    let write = |name: &str, text: &str| {
        let file = folder().join(name);
        std::fs::write(&file, text).unwrap();
        file.to_str().unwrap().to_owned()
    };
    let built = firmware_with("pico", "sensors");
    let firmware = folder().join("feels.elf");
    std::fs::copy(&built, &firmware).unwrap();
    let measures = std::fs::read_to_string(built.with_extension("toml")).unwrap();
    let wider = measures.replace("base_m = 0.2015", "base_m = 0.2217");
    assert_ne!(wider, measures);
    write("feels.toml", &wider);
    let rover = root().join("missions/rover.esm");
    let mission = write("feels.esm", &format!("use {rover:?};\n{FEELS}"));
    let world = "world step\nstart 1,1.5 0\nwall 0,0 6,0 6,3 0,3 0,0\nlow 1.4,0 1.4,3";
    let world = write("step.world", world);
    let [chip, host] = ["pico", "host"].map(|board| {
        let mut arguments = vec!["run", &mission, "--board", board, "--world", &world];
        arguments.extend(["--until", "7300 ms"]);
        if board == "pico" {
            arguments.extend(["--firmware", firmware.to_str().unwrap()]);
        }
        let said = esm(&arguments).good().out;
        assert_eq!(figure(&said, "slots missed"), Some(0.0), "{said}");
        assert_eq!(figure(&said, "collisions"), Some(1.0), "{said}");
        said
    });
    let touched_s = |said: &str| -> f64 {
        let mut lines = said.lines();
        let line = lines.find(|line| line.contains("drive/Go -> drive/Off"));
        let time = line.and_then(|line| line.split_whitespace().next());
        time.expect(said).parse().unwrap()
    };
    let apart_s = (touched_s(&chip) - touched_s(&host)).abs();
    assert!(apart_s < 0.1, "{apart_s} s apart\n{chip}");
    let turned_deg = |said: &str| -> f64 {
        let line = said.lines().find(|line| line.contains(" end ")).unwrap();
        let (_, turned) = line.rsplit_once("heading ").unwrap();
        turned.split('°').next().unwrap().parse().unwrap()
    };
    let (chip_deg, host_deg) = (turned_deg(&chip), turned_deg(&host));
    println!(
        "turned by {chip_deg}° on the chip, by {host_deg}° on the host, felt {apart_s} s apart"
    );
    assert!((chip_deg - host_deg).abs() < 2.0, "{chip}");
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
fn missions_are_uploaded_over_each_serial_line_and_run_and_no_slot_is_missed() {
    let pico = boards::find("pico").unwrap();
    for way in [LinkWay::Exchange, LinkWay::Usb] {
        let world = World::parse(include_str!("../../missions/worlds/empty.world"));
        let plant = Plant::new(world.unwrap(), BodyParameters::default(), 1).unwrap();
        let plant = PlantSide::new(plant, Pace::new(false), None);
        let board = Board::Emulated {
            board: pico,
            firmware: chip_firmware("pico"),
        };
        let (_board, line) = RunningBoard::start(board, &plant, None, way).unwrap();
        let (mut robot, about) = LinkClient::connect(line).unwrap();
        assert_eq!(about.board.as_str(), "pico", "{way:?}");
        // The second while the first one drives.
        for mission in ["patrol", "follow_wall"] {
            let blob = subject::build_file(&root().join(format!("missions/{mission}.esm")));
            let hash = robot.upload(&blob.unwrap().blob, &mut |_| ()).unwrap();
            robot.attend(Duration::from_millis(200)).unwrap();
            let status = robot.status().unwrap();
            assert_eq!(status.mission, Some(hash), "{mission} by {way:?}");
            assert_eq!(status.mode, Mode::Running, "{mission} by {way:?}");
            assert!(status.executed > 0, "{mission} by {way:?}");
            assert_eq!((status.missed, status.reset), (0, ResetReason::PowerOn));
            println!(
                "{mission} by {way:?}: {} executed, delay at most {} ns, stack {:?}",
                status.executed, status.max_delay_ns, status.stack_bytes
            );
        }
    }
}

#[test]
fn a_run_over_usb_does_what_one_over_the_uart_does() {
    let [uart, usb] = ["exchange", "usb"].map(|way| {
        let name = format!("by-{way}");
        drive_by("pico", way, "patrol", "office", 4, &name)
    });
    let order = |driven: &Driven| -> Vec<(String, String)> {
        let steps = driven.transitions.iter();
        steps
            .map(|(_, from, to)| (from.clone(), to.clone()))
            .collect()
    };
    assert!(usb.transitions.len() > 3);
    assert_eq!(order(&usb), order(&uart));
    for driven in [uart, usb] {
        assert_eq!(figure(&driven.said, "slots missed"), Some(0.0));
    }
}

#[test]
fn a_board_without_usb_has_no_link_over_it() {
    for command in [
        &["run", "missions/patrol.esm", "--board", "host"][..],
        &["board", "--board", "host"],
    ] {
        let done = esm(&[command, &["--link", "usb"]].concat()).ended(2);
        assert!(
            done.err.contains("the board `host` has no USB"),
            "{}",
            done.err
        );
    }
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

/// Chips of these boards, in the sources of everything but them.
#[test]
fn nothing_outside_the_boards_names_a_chip() {
    fn look(folder: &Path) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                look(&path);
            } else if path.extension().is_some_and(|it| it == "rs") {
                let text = std::fs::read_to_string(&path).unwrap().to_lowercase();
                // Tests take texts of boards that there are.
                let code = text.split("#[cfg(test)]").next().unwrap_or_default();
                for chip in ["rp2040", "rp2350", "rp235x"] {
                    assert!(!code.contains(chip), "{} names {chip}", path.display());
                }
            }
        }
    }
    for folder in [
        "esm-core/src",
        "esm-link/src",
        "rt-firmware/src",
        "robot-file/src",
        "host-tools/src",
        "host-tools/toolkit/src",
        "host-tools/client/src",
        "boards/cortex_m/src",
        "boards/settings/src",
        "xtask/src",
    ] {
        look(&root().join(folder));
    }
}

/// Lines that a board's own code may have, without its table of pins.
const MOST_OWN_LINES: usize = 900;
/// Files that are a table of pins, and programs that are no part of a robot's firmware.
const NOT_COUNTED: [&str; 4] = ["wiring.rs", "free_pins.rs", "pins.rs", "bin/pins.rs"];

/// Lines of Rust below a folder that are neither comments nor blank.
fn lines_of_code(folder: &Path, counted: &dyn Fn(&Path) -> bool) -> usize {
    let mut lines = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            lines += lines_of_code(&path, counted);
        } else if path.extension().is_some_and(|it| it == "rs") && counted(&path) {
            let text = std::fs::read_to_string(&path).unwrap();
            let code = text.lines().map(str::trim_start);
            lines += code
                .filter(|it| !it.is_empty() && !it.starts_with("//"))
                .count();
        }
    }
    lines
}

#[test]
fn the_boards_own_code_is_small() {
    let boards = root().join("boards");
    let counted = |path: &Path| NOT_COUNTED.iter().all(|name| !path.ends_with(name));
    let shared = lines_of_code(&boards.join("rp/src"), &counted);
    for (board, other_chip) in [("pico", "rp2350.rs"), ("pico2", "rp2040.rs")] {
        let own = lines_of_code(&boards.join(board).join("src"), &counted);
        let of_chip = |path: &Path| path.ends_with(other_chip);
        let shared = shared - lines_of_code(&boards.join("rp/src"), &of_chip);
        println!("{board}: {own} lines of its own, {shared} of the crate that both chips share");
        assert!((1..=MOST_OWN_LINES).contains(&own), "{board}: {own} lines");
        // Without the shared crate there would be no board.
        assert!(shared > own, "{board}: {shared} lines");
    }
}
