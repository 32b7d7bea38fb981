//! A robot told by hand what to do: behaviours over the link, scripts, steering.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fs::OpenOptions;
use std::io::Write;
use std::process::Command;
use std::time::Duration;

use esm_link::behaviours::{
    BehaviourRequest, Call, MAX_DRIVE_US, Origin, Reaction, ScriptState, Situation, Watch,
};
use esm_link::message::{LinkError, Swap};
use esm_tests::command::{Robot, Running, esm, firmware_with, root};
use esm_tests::host_drive::{self, world};
use esm_tests::random::Random;
use esm_tests::subject;
use host_tools::host_board;
use host_tools::link_client::behaviours::{End, Pilot};
use host_tools::link_client::{ClientError, LinkClient};
use host_tools::lockstep::pace::Pace;
use host_tools::lockstep::plant_side::PlantSide;
use host_tools::model::Task;
use host_tools::plant::flash::Flash;
use host_tools::plant::{BodyParameters, Plant};
use host_tools::run::board::{Board, LinkWay, RunningBoard};
use host_tools::run::by_hand::{ByHand, Driven};
use host_tools::run::drive::Plan;
use host_tools::script::{Script, read};
use host_tools::serial::ByteLink;
use rt_firmware::behaviours::{GoTo, MAX_BEHAVIOURS, MAX_INSERTED, Move};
use rt_firmware::body::flash::ERASE_BYTES;
use rt_firmware::declaration_of;
use rt_firmware::store::SCRIPT_BYTES;
use rt_firmware::store::flash_store::bank_bytes;
use rt_firmware::tasks::Twist;

type Client = LinkClient<Box<dyn ByteLink>>;

/// A robot on the host board that runs a mission, whose time passes while somebody waits for it.
fn with_robot(mission: &str, test: impl FnOnce(&mut Client)) {
    switched_on(None, |robot| {
        upload(robot, mission);
        test(robot);
        assert_eq!(robot.status().unwrap().missed, 0, "slots");
    });
}

/// A robot on the host board, with this flash, from power-on on.
fn switched_on(flash: Option<&Flash>, test: impl FnOnce(&mut Client)) {
    let plant = Plant::new(world("empty"), BodyParameters::default(), 1).unwrap();
    let plant = PlantSide::new(plant, Pace::new(false), None).with_flash(flash.cloned());
    let board = Board::Host {
        robot: host_board::rover,
    };
    let (_running, line) = RunningBoard::start(board, &plant, None, LinkWay::Exchange).unwrap();
    let (mut robot, _) = LinkClient::connect(line).unwrap();
    robot.limit_waits(None);
    test(&mut robot);
}

fn upload(robot: &mut Client, mission: &str) {
    let blob = subject::build_file(&root().join(mission)).unwrap().blob;
    robot.stage(&blob, &mut |_| ()).unwrap();
    robot.commit(Swap::default()).unwrap();
    wait(robot, 200);
}

fn wait(robot: &mut Client, ms: u64) {
    let until = robot.clock().now() + Duration::from_millis(ms);
    while robot.clock().now() < until {
        robot.listen(Duration::from_millis(10)).unwrap();
    }
}

fn refused<T: std::fmt::Debug>(result: Result<T, ClientError>) -> LinkError {
    result.unwrap_err().refusal().unwrap()
}

const fn twist(forward_m_per_s: f32, turn_rad_per_s: f32) -> Twist {
    Twist {
        forward_m_per_s,
        turn_rad_per_s,
    }
}

/// Bits of parameters as they are sent.
fn params(values: &[f32]) -> Vec<u8> {
    values
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect()
}

fn move_on(params: &[u8]) -> Call<'_> {
    Call {
        task: declaration_of::<Move>().signature_hash,
        params,
        watches: &[],
    }
}

#[test]
fn a_behaviour_that_is_none_is_refused_with_a_reason_and_nothing_moves() {
    with_robot("missions/by_hand.esm", |robot| {
        let good = params(&[0.2, 0.0, 0.0, 0.0]);
        let strange = Call {
            task: 1,
            ..move_on(&good)
        };
        // A task of the firmware, which is no behaviour.
        let odometry = rt_firmware_task("Odometry");
        let no_behaviour = Call {
            task: odometry,
            ..move_on(&good)
        };
        let bad_watch = Call {
            watches: &[99, 0, 0, 0, 0, 0],
            ..move_on(&good)
        };
        let nan = Watch {
            situation: Situation::Near,
            value: f32::NAN,
            reaction: Reaction::Cancel,
        };
        let nan = nan.to_bytes();
        let nan_watch = Call {
            watches: &nan,
            ..move_on(&good)
        };
        let half_watch = Call {
            watches: &[0, 0],
            ..move_on(&good)
        };
        let four = [0; 24];
        let four_watches = Call {
            watches: &four,
            ..move_on(&good)
        };
        let (few, many) = (params(&[0.2]), params(&[0.2; 9]));
        let (not_a_number, infinite) = (
            params(&[f32::NAN, 0.0, 0.0, 0.0]),
            params(&[f32::INFINITY, 0.0, 0.0, 0.0]),
        );
        let too_fast = params(&[0.51, 0.0, 0.0, 0.0]);
        for (call, expected) in [
            (strange, LinkError::NotABehaviour),
            (no_behaviour, LinkError::NotABehaviour),
            (bad_watch, LinkError::NoSituation),
            (nan_watch, LinkError::NoSituation),
            (half_watch, LinkError::NoSituation),
            (four_watches, LinkError::NoSituation),
            (move_on(&few), LinkError::Malformed),
            (move_on(&many), LinkError::Malformed),
            (move_on(&good[1..]), LinkError::Malformed),
            (move_on(&not_a_number), LinkError::ParamNoValue),
            (move_on(&infinite), LinkError::ParamNoValue),
            (
                move_on(&too_fast),
                LinkError::ParamOutside {
                    min: (-0.5_f32).to_bits(),
                    max: 0.5_f32.to_bits(),
                },
            ),
        ] {
            for end in [End::Head, End::Tail] {
                assert_eq!(refused(robot.insert_behaviour(end, call)), expected);
            }
            let step = BehaviourRequest::Step {
                script: 1,
                index: 0,
                call,
            };
            assert_eq!(refused(robot.change_behaviours(step)), expected);
        }
        assert!(robot.behaviour_list().unwrap().entries.is_empty());
    });
}

/// The tasks that ship.
fn tasks() -> Vec<Task> {
    let text = std::fs::read_to_string(root().join("missions/rover.esm")).unwrap();
    host_tools::lang::load_text("rover.esm", &text)
        .model
        .unwrap()
        .tasks
}

/// Hash of the signature of a task that ships.
fn rt_firmware_task(name: &str) -> u64 {
    let tasks = tasks();
    let task = tasks.iter().find(|task| task.name == name).unwrap();
    host_tools::script::signature_hash(task)
}

#[test]
fn movements_by_hand_that_are_none_too_fast_or_stale_do_nothing() {
    with_robot("missions/by_hand.esm", |robot| {
        let mut drive = |forward_m_per_s, turn_rad_per_s, ahead_us: i64| {
            let now_us = robot.robot_us().unwrap();
            robot.drive_until(
                twist(forward_m_per_s, turn_rad_per_s),
                now_us.saturating_add_signed(ahead_us),
            )
        };
        let none = f32::NAN;
        for (forward, turn, ahead_us, expected) in [
            (none, 0.0, 100_000, LinkError::TooFast),
            (0.0, none, 100_000, LinkError::TooFast),
            (f32::INFINITY, 0.0, 100_000, LinkError::TooFast),
            (0.0, f32::NEG_INFINITY, 100_000, LinkError::TooFast),
            (2.01, 0.0, 100_000, LinkError::TooFast),
            (0.0, -6.31, 100_000, LinkError::TooFast),
            (0.1, 0.0, -1, LinkError::Late),
            (0.1, 0.0, -10_000_000, LinkError::Late),
            // The answer took its time: what is a second ahead then is far ahead still.
            (0.1, 0.0, 1_000_000, LinkError::DeadlineTooFar),
            (0.1, 0.0, i64::MAX, LinkError::DeadlineTooFar),
        ] {
            let refused = refused(drive(forward, turn, ahead_us));
            assert_eq!(refused, expected, "{forward} {turn} {ahead_us}");
        }
        drive(0.1, 0.0, MAX_DRIVE_US as i64 / 2).unwrap();
        let listed = robot.behaviour_list().unwrap();
        assert_eq!(listed.entries[0].origin, Origin::Remote);
        wait(robot, 400);
        assert!(robot.behaviour_list().unwrap().entries.is_empty());
    });
}

#[test]
fn a_list_at_capacity_refuses_as_long_as_it_is_full() {
    with_robot("missions/by_hand.esm", |robot| {
        let still = params(&[0.0, 0.0, 0.0, 0.0]);
        let mut keys = Vec::new();
        for _ in 0..MAX_INSERTED {
            keys.push(robot.insert_behaviour(End::Tail, move_on(&still)).unwrap());
        }
        for _ in 0..20 {
            for end in [End::Head, End::Tail] {
                let full = refused(robot.insert_behaviour(end, move_on(&still)));
                assert_eq!(full, LinkError::ListFull);
            }
        }
        // Who steers by hand has a place of his own.
        Pilot::default().drive(robot, twist(0.1, 0.0)).unwrap();
        wait(robot, 400);
        let cancel = BehaviourRequest::Cancel { key: keys[3] };
        robot.change_behaviours(cancel).unwrap();
        assert_eq!(
            refused(robot.change_behaviours(cancel)),
            LinkError::NotOnList
        );
        robot.insert_behaviour(End::Head, move_on(&still)).unwrap();
        let listed = robot.behaviour_list().unwrap().entries;
        assert_eq!(listed.len(), MAX_INSERTED);
        assert_eq!(listed[1].key, keys[0]);
    });
}

#[test]
fn a_mission_without_a_list_says_so_and_so_does_a_robot_that_is_stopped() {
    with_robot("missions/square.esm", |robot| {
        assert_eq!(refused(robot.behaviour_list()), LinkError::NoBehaviours);
        let steered = Pilot::default().drive(robot, twist(0.1, 0.0));
        assert_eq!(refused(steered), LinkError::NoBehaviours);
    });
    with_robot("missions/by_hand.esm", |robot| {
        robot.behaviour_list().unwrap();
        robot.stop().unwrap();
        wait(robot, 300);
        let steered = Pilot::default().drive(robot, twist(0.1, 0.0));
        assert_eq!(refused(steered), LinkError::NoBehaviours);
        robot.start().unwrap();
        wait(robot, 200);
        assert!(robot.behaviour_list().unwrap().entries.is_empty());
    });
}

fn script(text: &str) -> Script {
    read("a.script", text, &tasks()).script.unwrap()
}

#[test]
fn a_script_arrives_whole_or_not_at_all() {
    with_robot("missions/by_hand.esm", |robot| {
        let script = script("go_to x_m = 0.2\nturn_to angle_rad = 0.5\n");
        let run = BehaviourRequest::Run {
            script: script.id(),
            steps: 2,
            all: 2,
        };
        assert_eq!(refused(robot.change_behaviours(run)), LinkError::NoScript);
        let step = |index: u8| BehaviourRequest::Step {
            script: script.id(),
            index,
            call: script.all[usize::from(index)].call(),
        };
        robot.change_behaviours(step(1)).unwrap();
        assert_eq!(refused(robot.change_behaviours(run)), LinkError::NoScript);
        assert_eq!(
            robot.behaviour_list().unwrap().script.state,
            ScriptState::None
        );
        robot.change_behaviours(step(0)).unwrap();
        robot.change_behaviours(run).unwrap();
        let status = robot.behaviour_list().unwrap().script;
        assert_eq!((status.state, status.steps), (ScriptState::Runs, 2));
        // Another one takes its place, and its step leaves the list.
        robot
            .run_script(&self::script("move speed_m_per_s = 0.1"))
            .unwrap();
        wait(robot, 100);
        let listed = robot.behaviour_list().unwrap();
        assert_eq!(listed.entries.len(), 1);
        robot
            .change_behaviours(BehaviourRequest::EndScript)
            .unwrap();
        let listed = robot.behaviour_list().unwrap();
        assert_eq!(listed.script.state, ScriptState::Ended);
        assert!(listed.entries.is_empty());
    });
}

#[test]
fn a_script_that_is_kept_starts_again_with_its_mission_until_it_is_removed() {
    const LONG: &str = "go_to x_m = 3 unless near range_m = 0.1 -> cancel\nturn_to angle_rad = 1\n";
    let flash = Flash::blank(host_board::FLASH_BYTES);
    let kept = script(LONG);
    let of_kept = |robot: &mut Client| robot.kept_script().unwrap();
    switched_on(Some(&flash), |robot| {
        upload(robot, "missions/by_hand.esm");
        assert_eq!(refused(robot.keep_script(&kept)), LinkError::NoScript);
        assert_eq!(of_kept(robot).state, ScriptState::None);
        robot.run_script(&kept).unwrap();
        robot.keep_script(&kept).unwrap();
        let status = of_kept(robot);
        assert_eq!((status.script, status.steps), (kept.id(), 2));
        assert_eq!(status.state, ScriptState::Runs);
        // What comes after it is not kept.
        robot.run_script(&script("turn_to angle_rad = 2")).unwrap();
        wait(robot, 100);
    });
    let begins = |robot: &mut Client| {
        wait(robot, 2_000);
        let listed = robot.behaviour_list().unwrap();
        (listed.script.script, listed.script.state, listed.entries)
    };
    for _ in 0..2 {
        switched_on(Some(&flash), |robot| {
            let (script, state, entries) = begins(robot);
            assert_eq!((script, state), (kept.id(), ScriptState::Runs));
            assert_eq!(entries.len(), 1);
            assert_eq!(entries[0].origin, Origin::Script);
            assert_eq!(robot.status().unwrap().missed, 0, "slots");
        });
    }
    // With another mission it does not begin.
    switched_on(Some(&flash), |robot| {
        upload(robot, "missions/guard.esm");
        assert_eq!(of_kept(robot).state, ScriptState::Ended);
    });
    switched_on(Some(&flash), |robot| {
        assert_eq!(begins(robot).1, ScriptState::None);
        upload(robot, "missions/by_hand.esm");
    });
    // A client that has a script of its own comes first.
    let own = script("turn_to angle_rad = 3");
    switched_on(Some(&flash), |robot| {
        wait(robot, 2_000);
        robot.run_script(&own).unwrap();
        assert_eq!(begins(robot).0, own.id());
        robot.remove_script().unwrap();
        assert_eq!(of_kept(robot).state, ScriptState::None);
    });
    switched_on(Some(&flash), |robot| {
        assert_eq!(begins(robot).1, ScriptState::None);
        assert_eq!(of_kept(robot).state, ScriptState::None);
    });
    // A flash with room for missions and records alone.
    let script_bytes = 2 * bank_bytes(SCRIPT_BYTES as u32, ERASE_BYTES as u32);
    let small = Flash::blank(host_board::FLASH_BYTES - script_bytes);
    switched_on(Some(&small), |robot| {
        upload(robot, "missions/by_hand.esm");
        robot.run_script(&kept).unwrap();
        assert_eq!(refused(robot.keep_script(&kept)), LinkError::NoStore);
        assert_eq!(of_kept(robot).state, ScriptState::None);
    });
}

/// Whatever is asked, at full rate: no slot is missed, and the list is one.
#[test]
fn requests_at_random_and_at_full_rate_miss_no_slot() {
    const REQUESTS: usize = 800;
    with_robot("missions/by_hand.esm", |robot| {
        let mut random = Random::new(20);
        let tasks = [
            declaration_of::<Move>().signature_hash,
            declaration_of::<GoTo>().signature_hash,
            7,
        ];
        let edges = [
            0.0,
            -0.0,
            0.1,
            -0.5,
            1e9,
            f32::MIN_POSITIVE,
            f32::NAN,
            f32::INFINITY,
        ];
        let (mut done, mut refused) = (0, 0);
        for _ in 0..REQUESTS {
            let values: Vec<f32> = (0..random.between(2, 4))
                .map(|_| edges[random.below(edges.len())])
                .collect();
            let values = params(&values);
            let watch: Vec<u8> = (0..random.below(3) * 6)
                .map(|_| random.bits() as u8)
                .collect();
            let call = Call {
                task: tasks[random.below(tasks.len())],
                params: &values,
                watches: &watch,
            };
            let key = random.below(20) as u16;
            let now_us = robot.robot_us().unwrap();
            let request = match random.below(14) {
                0 => BehaviourRequest::InsertAtHead(call),
                1 | 2 => BehaviourRequest::InsertAtTail(call),
                3 | 4 => BehaviourRequest::Cancel { key },
                5 => BehaviourRequest::Suspend { key },
                6 => BehaviourRequest::Resume { key },
                7 => BehaviourRequest::EndScript,
                8 | 9 => BehaviourRequest::Step {
                    script: 1,
                    index: random.below(18) as u8,
                    call,
                },
                10 => BehaviourRequest::Run {
                    script: 1,
                    steps: random.below(4) as u8,
                    all: random.below(20) as u8,
                },
                11 => BehaviourRequest::SuspendScript,
                12 => BehaviourRequest::ResumeScript,
                _ => {
                    let drive = robot.drive_until(
                        twist(
                            edges[random.below(edges.len())],
                            edges[random.below(edges.len())],
                        ),
                        now_us + random.below(400_000) as u64,
                    );
                    if let Err(error) = drive {
                        error.refusal().unwrap();
                    }
                    BehaviourRequest::EndScript
                }
            };
            // A key comes back from inserts, which is another answer than the others have.
            match robot.change_behaviours(request) {
                Ok(()) | Err(ClientError::BadAnswer { .. }) => done += 1,
                Err(error) => {
                    error.refusal().unwrap();
                    refused += 1;
                }
            }
            let listed = robot.behaviour_list().unwrap();
            assert!(listed.entries.len() <= MAX_BEHAVIOURS + 1);
            let mut keys: Vec<u16> = listed.entries.iter().map(|entry| entry.key).collect();
            keys.sort_unstable();
            keys.dedup();
            assert_eq!(keys.len(), listed.entries.len());
        }
        println!("{done} done, {refused} refused");
        assert!(done > REQUESTS / 20 && refused > REQUESTS / 20);
    });
}

/// How a robot drove by a plan: its speed in the plant at some robot times, in m/s.
fn speeds(plan: Plan, at_us: &[u64]) -> Vec<f64> {
    let run = host_drive::driven(plan);
    let path = run.plant.statistics().path();
    let place = |t_us: u64| {
        let sample = path.iter().find(|sample| sample.t_us >= t_us).unwrap();
        (sample.t_us, sample.pose.position)
    };
    let speed = |t_us: u64| {
        let ((from_us, from), (to_us, to)) = (place(t_us), place(t_us + 100_000));
        libm::sqrt(from.squared_distance_m2(to)) / ((to_us - from_us) as f64 / 1e6)
    };
    at_us.iter().map(|t_us| speed(*t_us)).collect()
}

#[test]
fn a_lost_line_stops_the_robot_within_the_time_that_a_movement_holds() {
    const CUT_US: u64 = 4_000_000;
    let plan = |cut_link_us| Plan {
        until_us: Some(6_000_000),
        by_hand: ByHand {
            driven: vec![Driven {
                from_us: 1_000_000,
                to_us: 10_000_000,
                twist: twist(0.3, 0.0),
            }],
            ..ByHand::default()
        },
        cut_link_us,
        ..host_drive::plan(&root().join("missions/by_hand.esm"), world("empty"))
    };
    // 300 ms, and 0.3 m/s at 1.2 m/s^2.
    let times_us = [3_500_000, CUT_US + 600_000, CUT_US + 1_500_000];
    let [before, stopped, later] = speeds(plan(Some(CUT_US)), &times_us)[..] else {
        panic!("three speeds");
    };
    assert!((before - 0.3).abs() < 0.03, "{before}");
    assert!(stopped < 0.01 && later < 0.001, "{stopped} {later}");
    let goes_on = speeds(plan(None), &times_us);
    assert!(
        goes_on.iter().all(|speed| (speed - 0.3).abs() < 0.03),
        "{goes_on:?}"
    );
}

#[test]
fn the_behaviour_before_goes_on_when_the_hand_is_off() {
    // In the office, guard.esm drives its side from the start.
    let plan = Plan {
        until_us: Some(6_000_000),
        by_hand: ByHand {
            driven: vec![Driven {
                from_us: 1_000_000,
                to_us: 2_000_000,
                twist: twist(-0.1, 0.0),
            }],
            ..ByHand::default()
        },
        ..host_drive::plan(&root().join("missions/guard.esm"), world("empty"))
    };
    let speeds = speeds(plan, &[800_000, 1_600_000, 2_800_000]);
    let is = |speed: f64, expected: f64| (speed - expected).abs() < 0.03;
    assert!(
        is(speeds[0], 0.25) && is(speeds[1], 0.1) && is(speeds[2], 0.25),
        "{speeds:?}"
    );
}

#[test]
fn an_errand_as_a_script_ends_where_it_began() {
    let file = root().join("missions/errand.script");
    let script = script(&std::fs::read_to_string(file).unwrap());
    assert_eq!(script.steps, 15);
    // Where the third door is shut it comes home from the corridor's end.
    let floors = [
        ("office_floor", "corridor lab storeroom"),
        ("shut_doors", "corridor storeroom"),
    ];
    for (seed, (floor, rooms)) in (1..=3).flat_map(|seed| floors.map(|floor| (seed, floor))) {
        let run = host_drive::driven(Plan {
            seed,
            until_us: Some(280_000_000),
            by_hand: ByHand {
                script: Some((500_000, script.clone())),
                ..ByHand::default()
            },
            ..host_drive::plan(&root().join("missions/by_hand.esm"), world(floor))
        });
        let entered = run.plant.statistics().rooms_entered().join(" ");
        assert_eq!(entered, rooms, "seed {seed}");
        let path = run.plant.statistics().path();
        let (start, end) = (path[0].pose.position, path[path.len() - 1].pose.position);
        let off_m = libm::sqrt(start.squared_distance_m2(end));
        let far_m2 = path
            .iter()
            .map(|sample| start.squared_distance_m2(sample.pose.position));
        assert!(
            far_m2.fold(0.0, f64::max) > 8.0 * 8.0,
            "it was at the other end"
        );
        println!("{floor}, seed {seed}: {off_m:.3} m");
        assert!(off_m < 0.25, "{floor}, seed {seed}: {off_m} m");
        assert_eq!(run.plant.collisions(), 0, "seed {seed}");
    }
}

/// What a run leaves with these words behind it: its trace, the picture of its path, and how far
/// the robot drove, in metres.
fn left(words: &[&str]) -> (String, String, f64) {
    let folder = tempfile::tempdir().unwrap();
    let run = ["run", "missions/by_hand.esm", "--world", "empty", "--out"];
    esm(&[&run[..], &[folder.path().to_str().unwrap()], words].concat()).good();
    let file = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&file("summary.json")).unwrap();
    let distance_m = summary["distance_m"].as_f64().unwrap();
    (file("trace.jsonl"), file("path.svg"), distance_m)
}

#[test]
fn scripts_and_steering_are_the_same_on_the_emulated_board_and_on_the_host() {
    let firmware = firmware_with("lm3s6965", "behaviours");
    let emulated = ["--firmware", firmware.to_str().unwrap()];
    let script = ["--until", "20 s", "--script", "missions/square.script"];
    let steered = [
        "--until",
        "8 s",
        "--drive",
        // Times at which a movement reaches both boards well before a slot: the emulated one takes
        // a millisecond to read it.
        "2100 ms 5 s 0.3,0.5",
        "--drive",
        "6 s 7 s -0.1,0",
    ];
    for (words, least_m) in [(&script[..], 1.5), (&steered, 0.9)] {
        let (trace, path, distance_m) = left(&[words, &["--board", "host"]].concat());
        assert!(distance_m > least_m, "{words:?}: {distance_m} m");
        let there = left(&[words, &emulated].concat());
        assert!(trace == there.0, "{words:?}: the traces differ");
        assert!(path == there.1, "{words:?}: the paths differ");
    }
}

#[test]
fn commands_say_what_is_wrong_with_a_script() {
    let folder = tempfile::tempdir().unwrap();
    let bad = folder.path().join("bad.script");
    std::fs::write(&bad, "go_to x_m = 1\ngo_tu x_m = 1\n").unwrap();
    let bad = bad.to_str().unwrap();
    let check = esm(&["script", "check", bad, "--board", "host"]);
    assert_eq!(check.status, Some(1));
    assert!(check.err.contains("did you mean `go_to`?"), "{}", check.err);
    assert!(check.err.contains(":2:1"), "{}", check.err);
    let json = esm(&["script", "check", bad, "--board", "host", "--json"]);
    assert_eq!(json.status, Some(1));
    let line: serde_json::Value = serde_json::from_str(json.out.trim()).unwrap();
    assert_eq!(
        (&line["code"], &line["line"], &line["col"]),
        (&"E002".into(), &2.into(), &1.into())
    );
    let run = [
        "run",
        "missions/by_hand.esm",
        "--board",
        "host",
        "--until",
        "1 s",
        "--script",
    ];
    let run = esm(&[&run[..], &[bad]].concat());
    assert_eq!(run.status, Some(1));
    assert!(run.err.contains("did you mean `go_to`?"), "{}", run.err);
    let none = esm(&["script", "check", "nowhere.script", "--board", "host"]);
    assert_eq!(none.status, Some(1));
    let good = esm(&[
        "script",
        "check",
        "missions/square.script",
        "--board",
        "host",
    ])
    .good();
    assert_eq!(good.out, "missions/square.script: 8 steps\n");
}

/// A gamepad is a file of events; here a pipe.
#[test]
fn the_stick_of_a_gamepad_drives_and_a_gamepad_that_is_pulled_out_lets_go() {
    let folder = tempfile::tempdir().unwrap();
    let device = folder.path().join("js0");
    let made = Command::new("mkfifo").arg(&device).status().unwrap();
    assert!(made.success());
    let robot = Robot::start_with("host", None, &["--world", "empty"]);
    robot.give(&root().join("missions/by_hand.esm"));
    let gamepad = format!("--gamepad={}", device.display());
    let driving = Running::esm(&["drive", "--port", robot.port(), &gamepad]);
    // Opened as soon as the command reads.
    let mut events = OpenOptions::new().write(true).open(&device).unwrap();
    let driving = driving.until("it steers", |it| it.err().contains("the gamepad steers"));
    // The left stick to its end, away from the person: axis 1, as the kernel tells it.
    let [low, high] = (-32_767_i16).to_ne_bytes();
    events.write_all(&[0, 0, 0, 0, low, high, 2, 1]).unwrap();
    std::thread::sleep(Duration::from_secs(2));
    drop(events);
    let ended = driving.finished().ended(3);
    assert!(ended.err.contains("not there any more"), "{}", ended.err);
    let x_m = || {
        let told = robot
            .esm(&["values", "position/Track.pose", "--json"])
            .good();
        told.json()["values"]["position/Track.pose"]["x_m"]
            .as_f64()
            .unwrap()
    };
    std::thread::sleep(Duration::from_secs(1));
    let (before_m, after_m) = (x_m(), x_m());
    assert!((0.15..0.6).contains(&before_m), "{before_m} m");
    assert!(
        (after_m - before_m).abs() < 0.001,
        "it stands: {before_m} m, {after_m} m"
    );
}
