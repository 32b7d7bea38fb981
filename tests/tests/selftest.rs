//! `esm selftest`: a good robot passes on each board, each planted fault is found, alone and in
//! pairs, and whatever becomes of it the robot stands afterwards with the mission that it had.
//!
//! `ESM_SELFTEST_PAIRS=1` plants all pairs on the emulated boards, too.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{Read, Write};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use clap::Parser;
use esm_tests::command::{Robot, Running, chip_firmware, esm, esm_binary, firmware, root, spawn};
use esm_tests::environment;
use host_tools::cli::console::Console;
use host_tools::cli::exit::CommandError;
use host_tools::cli::selftest::faults::{ALL, Fault, Plantable};
use host_tools::cli::{self, Cli};
use host_tools::host_board;
use host_tools::plant::WiringFault;
use nix::pty::openpty;

/// The boards, and whether they have a gyroscope.
const BOARDS: [(&str, bool); 3] = [("host", true), ("lm3s6965", false), ("stm32f405", true)];

/// The faults of which each pair is planted on emulated boards: of the others one or the other
/// hides some.
const TWELVE: usize = 12;

/// Where a console's output goes.
#[derive(Clone, Default)]
struct Kept(Arc<Mutex<Vec<u8>>>);

impl Write for Kept {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// The firmware of a board; none for the host.
fn firmware_of(board: &str) -> Option<PathBuf> {
    match board {
        "host" => None,
        "lm3s6965" => Some(firmware("rover")),
        other => Some(chip_firmware(other)),
    }
}

/// What a selftest of a board with these faults finds: the rows that do not pass.
#[track_caller]
fn found(board: &str, firmware: Option<&PathBuf>, faults: &[&Plantable]) -> BTreeSet<String> {
    let mut words = vec!["esm", "selftest", "--board", board, "--json"];
    if let Some(firmware) = firmware {
        words.extend(["--firmware", firmware.to_str().unwrap()]);
    }
    for fault in faults {
        words.extend(["--fault", fault.name]);
    }
    let command = Cli::try_parse_from(&words).unwrap().command;
    let (out, error) = (Kept::default(), Kept::default());
    let mut console = Console::onto(out.clone(), error.clone());
    let ended = cli::execute(&command, host_board::rover, &mut console);
    console.flush().unwrap();
    drop(console);
    let said = String::from_utf8(out.0.lock().unwrap().clone()).unwrap();
    let told = String::from_utf8(error.0.lock().unwrap().clone()).unwrap();
    let report: serde_json::Value = serde_json::from_str(&said)
        .unwrap_or_else(|error| panic!("{words:?}: {error}: {ended:?}\n{said}\n{told}"));
    let findings = report["findings"].as_array().unwrap();
    let bad = findings.iter().filter(|it| it["pass"] == false);
    let bad: BTreeSet<String> = bad
        .map(|it| {
            assert!(it["advice"].is_string(), "{words:?}: {it}");
            it["name"].as_str().unwrap().to_owned()
        })
        .collect();
    assert_eq!(report["passed"], bad.is_empty(), "{words:?}");
    assert_eq!(
        matches!(ended, Err(CommandError::Told)),
        !bad.is_empty(),
        "{words:?}: {ended:?}"
    );
    bad
}

/// Whether a fault leaves nothing by which the other could be found: a wheel that does not turn
/// says nothing of its encoder, and a robot that takes no mission next to nothing.
fn hides(fault: &Plantable, other: &Plantable) -> bool {
    let row = other.found_by;
    match fault.fault {
        Fault::Wiring(WiringFault::LeftMotorDead) => row == "encoders.left",
        Fault::Wiring(WiringFault::RightMotorDead) => row == "encoders.right",
        Fault::BadMissionSector => {
            !["clock", "line.bad_frames", "flash.mission", "flash.record"].contains(&row)
        }
        _ => false,
    }
}

/// The rows that find these faults together.
fn expected(faults: &[&Plantable]) -> BTreeSet<String> {
    let is_hidden = |it: &&&Plantable| faults.iter().any(|other| hides(other, it));
    let seen = faults.iter().filter(|it| !is_hidden(it));
    seen.map(|it| it.found_by.to_owned()).collect()
}

fn plantable(has_gyroscope: bool) -> Vec<&'static Plantable> {
    let is_there = |it: &&Plantable| has_gyroscope || it.found_by != "gyroscope";
    ALL.iter().filter(is_there).collect()
}

#[test]
fn a_good_robot_passes_and_each_fault_is_found_on_every_board() {
    for (board, has_gyroscope) in BOARDS {
        let firmware = firmware_of(board);
        assert_eq!(
            found(board, firmware.as_ref(), &[]),
            BTreeSet::new(),
            "{board}"
        );
        for fault in plantable(has_gyroscope) {
            let bad = found(board, firmware.as_ref(), &[fault]);
            assert_eq!(bad, expected(&[fault]), "{board}: {}", fault.name);
        }
    }
}

#[test]
fn any_two_faults_are_found_together_unless_one_hides_the_other() {
    let is_full = environment::number("ESM_SELFTEST_PAIRS", 0) > 0;
    for (board, has_gyroscope) in BOARDS {
        if board != "host" && !is_full {
            continue;
        }
        let firmware = firmware_of(board);
        let mut faults = plantable(has_gyroscope);
        if board != "host" {
            faults.truncate(TWELVE);
        }
        let mut pairs = 0;
        for (index, first) in faults.iter().enumerate() {
            for second in &faults[index + 1..] {
                let pair = [*first, *second];
                let bad = found(board, firmware.as_ref(), &pair);
                let names = pair.map(|it| it.name);
                assert_eq!(bad, expected(&pair), "{board}: {names:?}");
                pairs += 1;
            }
        }
        println!("{board}: {pairs} pairs");
        assert!(pairs >= TWELVE * (TWELVE - 1) / 2);
    }
}

#[test]
fn a_page_for_a_bug_report_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("selftest.md");
    let told = esm(&[
        "selftest",
        "--board",
        "host",
        "--fault",
        "left-encoder-backwards",
        "--write",
        page.to_str().unwrap(),
    ])
    .ended(1);
    let advice = "the left encoder counts backwards: swap A and B";
    assert!(told.out.contains(advice), "{told:#?}");
    let page = std::fs::read_to_string(page).unwrap();
    for words in [
        advice,
        "| board | host |",
        "| planted faults | left-encoder-backwards |",
    ] {
        assert!(page.contains(words), "{words}: {page}");
    }
}

#[test]
fn a_fault_needs_a_simulated_robot_and_a_name() {
    esm(&["selftest", "--fault", "dead-sonar", "--port", "/dev/null"]).ended(2);
    let told = esm(&["selftest", "--board", "host", "--fault", "dead-sonars"]).ended(2);
    assert!(told.err.contains("`dead-sonar` meant"), "{told:#?}");
}

/// A robot at a port, with a mission that it runs.
fn on_patrol() -> (Robot, String) {
    let robot = Robot::start("host", None);
    robot.esm(&["upload", "missions/patrol.esm"]).good();
    let mission = robot.status()["mission"].as_str().unwrap().to_owned();
    (robot, mission)
}

#[track_caller]
fn assert_stands_with(robot: &Robot, mission: &str) {
    let status = robot.status();
    assert_eq!(status["mode"], "stopped", "{status}");
    assert_eq!(status["mission"], mission, "{status}");
    assert_eq!(status["trial"], serde_json::Value::Null, "{status}");
}

#[test]
fn at_a_port_nothing_is_driven_unless_it_may_be_and_the_mission_before_comes_back() {
    let (robot, mission) = on_patrol();
    let told = robot.esm(&["selftest", "--json"]);
    let report = told.json();
    let findings = report["findings"].as_array().unwrap();
    for finding in findings {
        let name = finding["name"].as_str().unwrap();
        let is_of_wheels = name.starts_with("motors.") || name.starts_with("encoders.");
        if is_of_wheels {
            assert_eq!(finding["pass"], serde_json::Value::Null, "{finding}");
            assert!(finding["advice"].to_string().contains("--wheels-lifted"));
        }
        // The office has walls that no sonar hears. A simulated board in real time falls behind the
        // wall's clock where the machine has no time for it, and frames of its line come too late.
        let may_fail = name.starts_with("sonars") || matches!(name, "clock" | "line.bad_frames");
        assert!(finding["pass"] != false || may_fail, "{finding}");
    }
    assert_stands_with(&robot, &mission);
    robot.esm(&["start"]).good();
    assert_eq!(robot.status()["mission"], mission.as_str());
}

#[test]
fn a_line_is_tried_at_other_rates_and_has_its_own_again() {
    let robot = Robot::start("stm32f405", Some(&chip_firmware("stm32f405")));
    let report = robot.esm(&["selftest", "--json"]).json();
    let findings = report["findings"].as_array().unwrap();
    let row = |name: &str| {
        let found = findings.iter().find(|it| it["name"] == name);
        found.unwrap_or_else(|| panic!("no {name}: {report:#}"))
    };
    // The emulator's line has the pace of its client. Below its own rate that is no faster than
    // what the robot can take; above it, it may be.
    for baud in [9_600, 57_600, 230_400, 460_800, 921_600] {
        let row = row(&format!("line.bad_frames.{baud}"));
        assert!(row["value"].is_number(), "{row}");
        assert!(row["pass"] != false || baud < 115_200, "{row}");
    }
    let section = row("critical_section");
    assert_eq!(section["pass"], true, "{section}");
    assert!(section["value"].as_f64().unwrap() > 0.0, "{section}");
    // It answers at its own rate.
    assert_eq!(robot.status()["mode"], "stopped");
}

/// What a person at a terminal is asked, and answers.
const ANSWERS: [(&str, &str); 4] = [
    ("[y/N]", "y\n"),
    ("Enter begins", "\n"),
    ("when both were to turn forwards", "bf\n"),
    ("the left one was to turn backwards", "ff\n"),
];

#[test]
fn a_person_at_a_terminal_says_how_the_wheels_turned_and_both_causes_are_told_apart() {
    // Its wheels turn as they should, and the person says otherwise: so the encoder seems to count
    // backwards, too.
    let robot = Robot::start_with("host", None, &["--world", "empty"]);
    let terminal = openpty(None, None).unwrap();
    let mut command = Command::new(esm_binary());
    command
        .args(["selftest", "--json", "--port", robot.port()])
        .current_dir(root())
        .stdin(terminal.slave.try_clone().unwrap())
        .stderr(terminal.slave)
        .stdout(Stdio::piped());
    let selftest = spawn(&mut command).unwrap();
    // It has copies of the terminal, which ends with the process that it starts.
    drop(command);
    let mut person = File::from(terminal.master);
    let mut said = String::new();
    for (question, answer) in ANSWERS {
        let mut buffer = [0; 1024];
        while !said.contains(question) {
            let count = person.read(&mut buffer).unwrap();
            said += &String::from_utf8_lossy(&buffer[..count]);
        }
        said.clear();
        person.write_all(answer.as_bytes()).unwrap();
    }
    // What it still tells is taken, so that it does not wait for its reader.
    // A process that another test starts may have the terminal, too: the end is not waited for.
    thread::spawn(move || while person.read(&mut [0; 1024]).is_ok_and(|it| it > 0) {});
    let done = selftest.wait_with_output().unwrap();
    assert_eq!(done.status.code(), Some(1), "{done:?}");
    let report: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    let findings = report["findings"].as_array().unwrap().iter();
    let bad: Vec<_> = findings.filter(|it| it["pass"] == false).collect();
    let advice: Vec<_> = bad.iter().filter_map(|it| it["advice"].as_str()).collect();
    assert_eq!(
        advice,
        [
            "the left motor turns backwards: swap its two wires",
            "the left encoder counts backwards: swap A and B"
        ]
    );
}

#[test]
fn ctrl_c_in_the_middle_stops_the_robot_and_brings_its_mission_back() {
    let (robot, mission) = on_patrol();
    let selftest = Running::esm(&["selftest", "--wheels-lifted", "--port", robot.port()]);
    let selftest = selftest.until("it measures", |it| it.err().contains("measures itself"));
    // By then it has one of its missions.
    thread::sleep(Duration::from_secs(12));
    let done = selftest.interrupted();
    assert_eq!(done.status, Some(3), "{done:#?}");
    assert_stands_with(&robot, &mission);
}

#[test]
fn a_stop_by_somebody_else_ends_it_and_the_robot_stands() {
    let (robot, _) = on_patrol();
    let selftest = Running::esm(&["selftest", "--wheels-lifted", "--port", robot.port()]);
    let selftest = selftest.until("it measures", |it| it.err().contains("measures itself"));
    thread::sleep(Duration::from_secs(12));
    robot.esm(&["stop"]).good();
    let done = selftest.finished();
    assert_eq!(done.status, Some(3), "{done:#?}");
    assert_eq!(robot.status()["mode"], "stopped");
}
