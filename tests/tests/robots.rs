//! A robot on a serial line (a pty), in real time: uploads, refusals, status, log, stop and start,
//! on both boards.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use esm_core::format::{CRC_BYTES, crc32};
use esm_tests::command::{Robot, Running, esm, esm_until, firmware};
use esm_tests::random::Random;
use host_tools::link_client::ClientError;

const BOARDS: [&str; 2] = ["host", "lm3s6965"];

/// A blob of a mission that ships.
fn blob(mission: &str) -> (String, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mission.blob");
    esm(&[
        "build",
        &format!("missions/{mission}.esm"),
        "-o",
        path.to_str().unwrap(),
    ])
    .good();
    let blob = std::fs::read(path).unwrap();
    let hash = u32::from_le_bytes(*blob.last_chunk().unwrap());
    (format!("{hash:08x}"), blob)
}

#[test]
fn a_robot_takes_missions_while_it_moves_and_tells_what_it_does() {
    for board in BOARDS {
        let robot = Robot::start(board, None);
        // The rover's firmware has a mission of its own; the host board has none.
        let at_first = if board == "host" { "empty" } else { "running" };
        assert_eq!(robot.status()["mode"], at_first, "{board}");
        let told = robot.esm(&["status"]).good().out;
        assert!(told.contains(board), "{board}: {told}");

        robot.esm(&["upload", "missions/patrol.esm"]).good();
        let status = robot.status_when("a second of patrol", |status| {
            status["t_us"].as_u64() > Some(1_000_000)
        });
        assert_eq!(status["mode"], "running", "{board}");
        assert_eq!(status["mission"], blob("patrol").0.as_str(), "{board}");
        let active: Vec<&str> = status["active"]
            .as_array()
            .unwrap()
            .iter()
            .map(|path| path.as_str().unwrap())
            .collect();
        assert!(active.contains(&"sonars/Listen"), "{board}: {active:?}");

        // The diary has a line every other second.
        let log = Running::esm(&["log", "--port", robot.port()]);
        let has_line = |log: &Running| log.out().contains("battery");
        log.until("a line of the diary", has_line)
            .interrupted()
            .good();

        robot.esm(&["upload", "missions/follow_wall.esm"]).good();
        let status = robot.status_when("follow_wall", |status| status["steps"].as_u64() > Some(10));
        assert_eq!(status["mission"], blob("follow_wall").0.as_str(), "{board}");
        assert_eq!(status["slots_missed"], 0, "{board}");

        robot.esm(&["stop"]).good();
        assert_eq!(robot.status()["mode"], "stopped", "{board}");
        robot.esm(&["start"]).good();
        let status = robot.status_when("driving again", |status| {
            status["steps"].as_u64() > Some(10)
        });
        assert_eq!(status["mode"], "running", "{board}");
        assert_eq!(status["mission"], blob("follow_wall").0.as_str(), "{board}");

        assert_eq!(robot.end(), Some(0), "{board}: Ctrl-C is a good end");
    }
}

#[test]
fn a_mission_that_fails_its_trial_gives_way_to_the_one_before() {
    let folder = tempfile::tempdir().unwrap();
    let flood = folder.path().join("flood.esm");
    let machine = "machine Flood { event Again; region r { state A; state B; initial -> A; \
        A -> B / send Again; B -> B on Again / send Again; } }";
    let text = format!("interpreter slot 1; slot 1 period 50 ms duration 2 ms; {machine}");
    std::fs::write(&flood, text).unwrap();
    let flood = flood.to_str().unwrap();
    let (patrol, _) = blob("patrol");
    let (follow_wall, _) = blob("follow_wall");
    let (stand_by, _) = blob("stand_by");
    for board in BOARDS {
        let robot = Robot::start(board, None);
        let told = robot.esm(&["upload", flood]).ended(1).err;
        assert!(told.contains("gave"), "{board}: {told}");
        let (before, mode) = match board {
            "host" => ("no mission before".to_owned(), "empty"),
            _ => (format!("{stand_by} runs again"), "running"),
        };
        assert!(told.contains(&before), "{board}: {told}");
        assert_eq!(robot.status()["mode"], mode, "{board}");

        robot.esm(&["upload", "missions/patrol.esm"]).good();
        assert_eq!(
            robot.status()["trial"],
            serde_json::Value::Null,
            "{board}: it is confirmed"
        );
        let told = robot.esm(&["upload", flood]).ended(1).err;
        assert!(
            told.contains(&format!("{patrol} runs again")),
            "{board}: {told}"
        );
        let status = robot.status();
        assert_eq!(status["mission"], patrol.as_str(), "{board}");
        assert_eq!(status["mode"], "running", "{board}");
        let why = status["fell_back"]["reason"].as_str().unwrap_or_default();
        assert!(why.contains("no end"), "{board}: {status}");

        let on_trial = |time: &str| {
            let told = robot
                .esm(&["upload", "missions/follow_wall.esm", "--trial", time])
                .good();
            assert!(told.out.contains("on trial"), "{board}: {}", told.out);
        };
        // Nobody confirms it. The next upload waits for that, unless this machine is so busy that
        // the trial is over before it begins.
        let waited = (1..=5).find_map(|time| {
            on_trial(&format!("{time} s"));
            let told = robot.esm(&["upload", "missions/patrol.esm", "--json"]);
            let told = told.good().json()["earlier_trial"].clone();
            told.is_object().then_some(told)
        });
        let waited = waited.unwrap_or_else(|| panic!("{board}: nothing was waited for"));
        assert_eq!(waited["mission"], follow_wall.as_str(), "{board}: {waited}");
        assert_eq!(waited["confirmed"], false, "{board}: {waited}");
        let why = waited["fell_back"].as_str().unwrap_or_default();
        assert!(why.contains("not confirmed"), "{board}: {waited}");
        // Or it ends it at once. A mission that takes the place of none but itself is as good as
        // another.
        let choices = [("fallback", &patrol), ("confirm", &follow_wall)];
        // This is the command's doing, and none of the board's.
        for (choice, before) in choices.into_iter().filter(|_| board == "host") {
            on_trial("600 s");
            assert_eq!(
                robot.status()["trial"]["before"],
                patrol.as_str(),
                "{board}"
            );
            let upload = ["upload", "missions/patrol.esm", "--on-trial", choice];
            let told = robot.esm(&[&upload[..], &["--trial", "600 s", "--json"]].concat());
            let told = told.good().json();
            let earlier = &told["earlier_trial"];
            assert_eq!(earlier["mission"], follow_wall.as_str(), "{board}: {told}");
            assert_eq!(earlier["confirmed"], choice == "confirm", "{board}: {told}");
            let status = robot.status();
            assert_eq!(status["trial"]["before"], before.as_str(), "{board}");
            robot.esm(&["confirm"]).good();
        }
        on_trial("600 s");
        let told = robot.esm(&["fallback"]).good().out;
        assert!(told.contains(&patrol), "{board}: {told}");
        on_trial("600 s");
        let told = robot.esm(&["confirm"]).good().out;
        assert!(told.contains(&follow_wall), "{board}: {told}");
        robot.esm(&["confirm"]).ended(1);
        robot.esm(&["fallback"]).ended(1);
        let status = robot.status();
        assert_eq!(status["mission"], follow_wall.as_str(), "{board}");
        assert_eq!(status["slots_missed"], 0, "{board}");
    }
}

#[test]
fn a_warm_swap_to_the_mission_with_another_parameter_misses_no_slot() {
    let folder = tempfile::tempdir().unwrap();
    let missions = esm_tests::command::root().join("missions");
    std::fs::copy(missions.join("rover.esm"), folder.path().join("rover.esm")).unwrap();
    let patrol = std::fs::read_to_string(missions.join("patrol.esm")).unwrap();
    let changed = patrol.replace("angle_rad = 1.0", "angle_rad = 1.5");
    assert_ne!(changed, patrol);
    let path = folder.path().join("patrol.esm");
    std::fs::write(&path, changed).unwrap();
    let (there, back) = (path.to_str().unwrap(), "missions/patrol.esm");
    for board in BOARDS {
        let robot = Robot::start(board, None);
        robot.esm(&["upload", back]).good();
        robot.status_when("patrol", |status| status["t_us"].as_u64() > Some(1_500_000));
        for file in [there, back, there] {
            let told = robot.esm(&["upload", file, "--warm", "--json"]).good();
            let told = told.json();
            assert!(
                told["carried_regions"].as_u64() > Some(0),
                "{board}: {told:#}"
            );
            let anew = &told["carry_over"]["starts_anew"];
            assert_eq!(anew, &serde_json::json!([]), "{board}: {told:#}");
            assert_eq!(
                told["slots_moved"],
                serde_json::json!([]),
                "{board}: {told:#}"
            );
            let status = robot.status();
            assert_eq!(status["mode"], "running", "{board}: {status:#}");
            assert_eq!(status["slots_missed"], 0, "{board}: {status:#}");
        }
    }
}

/// A mission that does nothing in these slots.
fn idle_in(folder: &std::path::Path, name: &str, slots: &str) -> String {
    let path = folder.join(name);
    let machine = "machine M { region r { state A; initial -> A; } }";
    std::fs::write(&path, format!("interpreter slot 1; {slots} {machine}")).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn slots_that_both_missions_have_go_on_or_are_told_before_anything_is_sent() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, slots: &str| idle_in(folder.path(), name, slots);
    let first = file(
        "first.esm",
        "slot 1 period 20 ms duration 2 ms; slot 2 period 20 ms duration 4 ms; slot 3 period 40 ms duration 3 ms;",
    );
    // Slot 3 would come before slot 2 if nothing else counted.
    let seamless = file(
        "seamless.esm",
        "slot 1 period 20 ms duration 2 ms; slot 3 period 40 ms duration 3 ms; slot 2 period 20 ms duration 1 ms;",
    );
    // Slot 2 lasts into the time of slot 3.
    let crowded = file(
        "crowded.esm",
        "slot 1 period 20 ms duration 2 ms; slot 2 period 20 ms duration 5 ms; slot 3 period 40 ms duration 3 ms;",
    );
    let faster = file(
        "faster.esm",
        "slot 1 period 10 ms duration 2 ms; slot 3 period 40 ms duration 3 ms;",
    );
    let robot = Robot::start("host", None);
    let upload = |file: &str| -> serde_json::Value {
        let done = robot.esm(&["upload", file, "--json"]).good();
        serde_json::from_str(&done.out).unwrap()
    };
    let told = upload(&first);
    assert_eq!(told["slots_kept"], serde_json::json!([]));
    assert_eq!(told["slots_moved"], serde_json::json!([]));
    let told = upload(&seamless);
    assert_eq!(told["slots_kept"], serde_json::json!([1, 3, 2]));
    assert_eq!(told["slots_moved"], serde_json::json!([]));
    assert_eq!(told["interpreter_period_changes"], false);
    upload(&first);

    let running = robot.status()["mission"].clone();
    let refused = robot.esm(&["upload", &crowded, "--no-gap"]);
    assert_eq!(refused.status, Some(1));
    assert!(refused.err.contains("nothing was sent"), "{}", refused.err);
    assert_eq!(robot.status()["mission"], running);
    let done = robot.esm(&["upload", &crowded, "--json"]).good();
    let told: serde_json::Value = serde_json::from_str(&done.out).unwrap();
    let [moved] = &told["slots_moved"].as_array().unwrap()[..] else {
        panic!("{told}")
    };
    assert_eq!(
        (&moved["slot"], &moved["period_us"]),
        (&3.into(), &40_000.into())
    );
    let gap = format!("up to {} us", moved["longest_gap_us"]);
    assert!(done.err.contains(&gap), "{}", done.err);
    assert_eq!(robot.status()["mission"], told["hash"]);

    // A blob is what it is.
    let blob = folder.path().join("first.blob");
    let blob = blob.to_str().unwrap();
    esm(&["build", &first, "-o", blob]).good();
    let done = robot.esm(&["upload", blob]).good();
    assert!(
        done.err.contains("the starts in a blob are fixed"),
        "{}",
        done.err
    );

    let done = robot.esm(&["upload", &faster]).good();
    assert!(done.err.contains("all slots start anew"), "{}", done.err);
}

/// The tasks that the emulated board's firmware has only where it is built with them.
const BEHAVIOURS: [&str; 23] = [
    "Behaviours",
    "Move",
    "TurnTo",
    "GoTo",
    "FollowCorridor",
    "PassDoor",
    "AlongWall",
    "Wander",
    "Approach",
    "FollowObject",
    "Dock",
    "GlobalPosition",
    "SetPosition",
    "CorrectPosition",
    "OutsideRange",
    "Stuck",
    "SensorLost",
    "LowBattery",
    "Near",
    "DoorLeft",
    "DoorRight",
    "CornerLeft",
    "CornerRight",
];

/// The tasks of sensors that the rover of the emulated board does not have.
const SENSORS: [&str; 2] = ["Bumpers", "Gyro"];

#[test]
fn a_robot_declares_the_tasks_that_the_missions_take_in() {
    let shipped =
        std::fs::read_to_string(esm_tests::command::root().join("missions/rover.esm")).unwrap();
    for board in BOARDS {
        let robot = Robot::start(board, None);
        let told = robot.esm(&["tasks"]).good().out;
        for line in shipped.lines().filter(|line| line.starts_with("task ")) {
            let name = line.split_whitespace().nth(1).unwrap();
            let is_spared = BEHAVIOURS.contains(&name) || SENSORS.contains(&name);
            let has_it = board == "host" || !is_spared;
            assert_eq!(
                told.contains(&format!("task {name} ")),
                has_it,
                "{board}: {name} in\n{told}"
            );
        }
        let file = tempfile::Builder::new().suffix(".esm").tempfile().unwrap();
        std::fs::write(file.path(), &told).unwrap();
        esm(&["check", file.path().to_str().unwrap()]).good();
    }
}

/// Missions that the robot cannot run, and words with which it must be told.
const REFUSED: &[(&str, &str, &[&str])] = &[
    (
        "a task that the firmware lacks",
        "task Somersault slot 2 { out flag landed; } machine M { region r { task T: Somersault; initial -> T; } }",
        &["Somersault"],
    ),
    (
        "a task with another signature",
        "task Stop slot 2 { out data twist: Twist; out flag stopped; }
         machine M { region r { task T: Stop; initial -> T; } }",
        &["Stop", "other ports, flags or parameters"],
    ),
    (
        "a port of another type",
        "task Stop slot 2 { out data twist: Pose; } machine M { region r { task T: Stop; initial -> T; } }",
        &["Stop"],
    ),
    (
        "more states of a task than there are tasks",
        "task Stop slot 2 { out data twist: Twist; }
         machine M { region r { task A: Stop; task B: Stop; task C: Stop; task D: Stop;
         initial -> A; A -> B; B -> C; C -> D; } }",
        &["Stop", "4", "3"],
    ),
];

#[test]
fn a_robot_refuses_what_it_cannot_run_by_name_and_drives_on() {
    for board in BOARDS {
        let robot = Robot::start(board, None);
        robot.esm(&["upload", "missions/patrol.esm"]).good();
        let folder = tempfile::tempdir().unwrap();
        for (what, machine, words) in REFUSED {
            let path = folder.path().join("mission.esm");
            let head = "interpreter slot 1; slot 1 period 20 ms duration 1 ms; slot 2 period 20 ms duration 1 ms;\n";
            std::fs::write(&path, format!("{head}{machine}")).unwrap();
            let before = robot.status()["steps"].as_u64();
            let done = robot.esm(&["upload", path.to_str().unwrap()]);
            assert_eq!(done.status, Some(1), "{board}, {what}: {done:#?}");
            for word in *words {
                assert!(
                    done.err.contains(word),
                    "{board}, {what}: `{word}` in {}",
                    done.err
                );
            }
            let status =
                robot.status_when("driving on", |status| status["steps"].as_u64() > before);
            assert_eq!(status["mode"], "running", "{board}, {what}");
            assert_eq!(
                status["mission"],
                blob("patrol").0.as_str(),
                "{board}, {what}"
            );
        }
        assert_eq!(robot.status()["slots_missed"], 0, "{board}");
    }
}

#[test]
fn a_robot_refuses_corrupted_blobs_and_drives_on() {
    let (hash, good) = blob("patrol");
    let (_, other) = blob("follow_wall");
    for board in BOARDS {
        let robot = Robot::start(board, None);
        robot.esm(&["upload", "missions/patrol.esm"]).good();
        let mut client = robot.connect();
        let mut random = Random::new(5);
        let mut refused = 0;
        let mut tried = 0;
        while tried < 24 {
            let mut bytes = other.clone();
            match tried % 4 {
                0 => bytes.truncate(random.between(1, other.len() - 1)),
                1 => {
                    bytes = (0..random.between(1, 200))
                        .map(|_| random.bits() as u8)
                        .collect()
                }
                2 => bytes[random.below(other.len())] ^= 1 << random.below(8),
                _ => {
                    // The tables, and not the names at the end, of which any will do.
                    let place = random.between(4, other.len() / 2);
                    bytes[place] ^= 1 << random.below(8);
                    let end = bytes.len() - CRC_BYTES;
                    let crc = crc32(&bytes[..end]);
                    bytes[end..].copy_from_slice(&crc.to_le_bytes());
                }
            }
            tried += 1;
            // One that is valid after all would take over: the host's own verifier says which are
            // not.
            if esm_core::verify(&bytes[..]).is_ok() {
                continue;
            }
            match client.upload(&bytes, &mut |_| ()) {
                Err(ClientError::Refused { .. }) => refused += 1,
                other => panic!(
                    "{board}: {:?} to blob {tried}, which the verifier refuses: {:?}; the robot now says {:?}",
                    other.map(drop),
                    esm_core::verify(&bytes[..])
                        .err()
                        .map(|(_, refusal)| refusal),
                    client.status()
                ),
            }
            let status = client.status().unwrap();
            assert_eq!(
                status.mission.map(|hash| format!("{hash:08x}")),
                Some(hash.clone()),
                "{board}"
            );
        }
        assert!(
            refused >= 15,
            "{board}: only {refused} of {tried} were put to the robot"
        );
        drop(client);
        let before = robot.status()["steps"].as_u64();
        let status = robot.status_when("driving on", |status| status["steps"].as_u64() > before);
        assert_eq!(status["mode"], "running", "{board}");
        assert_eq!(status["slots_missed"], 0, "{board}");
        // And it takes a good one as before.
        let path = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(path.path(), &good).unwrap();
        robot.esm(&["upload", path.path().to_str().unwrap()]).good();
    }
}

#[test]
fn ctrl_c_ends_the_wait_for_the_end_of_a_trial_and_nothing_is_sent() {
    let robot = Robot::start("host", None);
    let trial = ["upload", "missions/patrol.esm", "--trial", "600 s"];
    robot.esm(&trial).good();
    let upload = ["upload", "missions/follow_wall.esm", "--port", robot.port()];
    let done = esm_until("which is waited for", &upload);
    assert_eq!(done.status, Some(3), "{done:#?}");
    let told = done.err.contains("interrupted; nothing was sent");
    assert!(told, "{done:#?}");
    let status = robot.status();
    assert!(status["trial"].is_object(), "{status:#}");
    // Whoever only looks waits for nothing.
    robot
        .esm(&["upload", "missions/follow_wall.esm", "--diff"])
        .good();
    robot.esm(&["confirm"]).good();
}

#[test]
fn an_interrupted_run_leaves_nothing_behind() {
    // A copy of the firmware has a name that no other emulator was started with.
    let folder = tempfile::tempdir().unwrap();
    let elf = folder.path().join("own.elf");
    std::fs::copy(firmware("rover"), &elf).unwrap();
    let elf = elf.to_str().unwrap();
    let emulators = || {
        let processes = std::fs::read_dir("/proc").unwrap().flatten();
        processes
            .filter_map(|process| std::fs::read(process.path().join("cmdline")).ok())
            .map(|words| String::from_utf8_lossy(&words).into_owned())
            .filter(|words| words.contains("qemu") && words.contains(elf))
            .count()
    };
    let temporary = tempfile::tempdir().unwrap();
    let left = || -> Vec<_> {
        let entries = std::fs::read_dir(temporary.path()).unwrap().flatten();
        entries.map(|entry| entry.path()).collect()
    };
    let run = || {
        let mission = "missions/patrol.esm";
        let arguments = ["run", mission, "--realtime", "--firmware", elf];
        Running::esm_with_temporary(temporary.path(), &arguments)
    };
    // Killed, it has no say in it: its folder stays until the next one is made.
    drop(run().until("the emulator", |_| emulators() == 1));
    let killed = left();
    assert_eq!(killed.len(), 1, "of the one that was killed");
    // The system ends the other's emulator (by `setpriv`), and takes its time for that.
    let is_alone = |_: &Running| emulators() == 1 && left().len() == 1 && left() != killed;
    let run = run().until("an emulator and a folder, of this run alone", is_alone);
    let done = run.interrupted();
    assert!(done.status.is_some(), "it had to be killed: {done:#?}");
    assert_eq!((emulators(), left().len()), (0, 0), "after Ctrl-C");
}
