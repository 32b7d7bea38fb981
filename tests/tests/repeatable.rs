//! The link inside the plant exchange: whatever is asked of a robot, over however bad a line, the
//! run repeats to the byte, on both boards.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::io;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use esm_link::message::{LinkError, Swap};
use esm_tests::command::{esm, firmware, root};
use esm_tests::environment;
use esm_tests::subject;
use host_tools::boards;
use host_tools::files::load_world;
use host_tools::host_board;
use host_tools::link_client::{ClientError, LinkClient, LinkCounts, Streams};
use host_tools::lockstep::pace::Pace;
use host_tools::lockstep::plant_side::PlantSide;
use host_tools::plant::{BodyParameters, Plant};
use host_tools::run::board::{Board, LinkWay, RunningBoard};
use host_tools::serial::ByteLink;
use host_tools::serial::clock::Clock;
use host_tools::serial::noise::{Noise, Noisy};

const BOARDS: [&str; 2] = ["host", "lm3s6965"];

/// All that a run leaves behind: what it said, and its files by name.
fn left_by(board: &str, seed: &str, more: &[&str]) -> Vec<(String, Vec<u8>)> {
    let folder = tempfile::tempdir().unwrap();
    let elf = firmware("rover");
    let recording = folder.path().join("run.rec");
    let mut arguments = vec![
        "run",
        "missions/patrol.esm",
        "--board",
        board,
        "--until",
        "9 s",
        "--then",
        "3 s missions/follow_wall.esm",
        "--then",
        "6 s missions/patrol.esm",
        "--seed",
        seed,
        "--out",
        folder.path().to_str().unwrap(),
        "--record",
        recording.to_str().unwrap(),
        "--firmware",
        elf.to_str().unwrap(),
    ];
    arguments.extend(more);
    let said = esm(&arguments).good().out;
    let mut left = vec![("said".to_owned(), said.into_bytes())];
    for entry in std::fs::read_dir(folder.path()).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        left.push((name, std::fs::read(path).unwrap()));
    }
    left.sort();
    left
}

fn summary(left: &[(String, Vec<u8>)]) -> serde_json::Value {
    let (_, bytes) = left
        .iter()
        .find(|(name, _)| name == "summary.json")
        .unwrap();
    serde_json::from_slice(bytes).unwrap()
}

#[test]
fn two_runs_with_uploads_cold_and_warm_over_a_bad_line_leave_the_same_bytes() {
    for board in BOARDS {
        for more in [
            &["--line-noise", "0.01"][..],
            &["--line-noise", "0.01", "--warm"],
        ] {
            let first = left_by(board, "5", more);
            let names: Vec<&str> = first.iter().map(|(name, _)| name.as_str()).collect();
            let expected = [
                "path.png",
                "path.svg",
                "run.rec",
                "said",
                "states.png",
                "states.svg",
                "summary.json",
                "trace.jsonl",
            ];
            assert_eq!(names, expected, "{board}");
            let repeats = environment::number("ESM_REPEATS", 1);
            for repeat in 1..=repeats {
                let again = left_by(board, "5", more);
                for ((name, once), (_, again)) in first.iter().zip(&again) {
                    let place = once
                        .iter()
                        .zip(again)
                        .position(|(once, again)| once != again);
                    assert!(
                        once == again,
                        "{board} {more:?}: {name} differs from byte {place:?} on, in repetition {repeat}"
                    );
                }
            }
            println!("{board} {more:?}: {repeats} repetitions, all the same");
            let summary = summary(&first);
            assert_eq!(summary["slots_missed"], 0, "{board}: {summary:#}");
            assert_eq!(summary["missions"].as_array().unwrap().len(), 3, "{board}");
            // The noise was there: each upload takes some of its bytes twice.
            assert!(summary["link_retries"].as_u64() > Some(10), "{summary:#}");
        }
    }
}

/// A board in the office, its plant, and its line.
fn started(board: &str) -> (RunningBoard, PlantSide, Box<dyn ByteLink>) {
    let world = load_world(&root().join("missions/worlds/office.world")).unwrap();
    let plant = Plant::new(world, BodyParameters::default(), 3).unwrap();
    let plant = PlantSide::new(plant, Pace::new(false), None);
    let board = match board {
        boards::DEFAULT => Board::emulated(firmware("rover")),
        _ => Board::Host {
            robot: host_board::rover,
        },
    };
    let (running, line) = RunningBoard::start(board, &plant, None, LinkWay::Exchange).unwrap();
    (running, plant, line)
}

fn blob(mission: &str) -> Vec<u8> {
    let path = root().join("missions").join(mission);
    subject::build_file(Path::new(&path)).unwrap().blob
}

/// A session with all that changes a robot; answers what came of it, word by word, and when.
fn session(board: &str) -> Vec<String> {
    let (running, plant, line) = started(board);
    let noise = Noise::of_each(Noise::WHOLE / 400);
    let (mut robot, _) = LinkClient::connect(Noisy::new(line, noise, 11)).unwrap();
    let clock = robot.clock().clone();
    let begun = clock.now();
    let mut told = Vec::new();
    let mut tell = |what: String| told.push(format!("{:?} {what}", clock.since(begun)));
    let streams = Streams {
        trace: true,
        log: true,
        record: true,
    };
    robot.subscribe(streams).unwrap();
    let patrol = blob("patrol.esm");
    let hash = robot.upload(&patrol, &mut |_| ()).unwrap();
    tell(format!("{hash:08x} runs"));
    clock.pause(Duration::from_millis(700));
    let param = (0..64)
        .find_map(|index| {
            let bits = robot.param(hash, index).ok()?;
            let value = f32::from_bits(bits.value) * 0.9;
            let before = robot.set_param(hash, index, value.to_bits()).ok()?;
            Some((index, before))
        })
        .unwrap();
    tell(format!("{param:?} set"));
    robot.stage(&blob("follow_wall.esm"), &mut |_| ()).unwrap();
    let trial = Swap {
        trial_ms: 5_000,
        warm: true,
    };
    let committed = robot.commit(trial).unwrap();
    tell(format!("{committed:?}"));
    clock.pause(Duration::from_millis(300));
    robot.confirm(committed.mission).unwrap();
    robot.stage(&patrol, &mut |_| ()).unwrap();
    let committed = robot.commit(trial).unwrap();
    clock.pause(Duration::from_millis(300));
    robot.fall_back(committed.mission).unwrap();
    tell(format!("{:?}", robot.status().unwrap()));
    for event in robot.take_events() {
        tell(format!("{event:?}"));
    }
    tell(format!("{:?}", robot.counts()));
    // As long as the client asks for nothing, board and plant stand still; once it has gone they
    // run free.
    told.push(format!("{:?}", plant.at_end().pose()));
    drop((robot, running));
    told
}

#[test]
fn a_session_with_parameters_trials_and_noise_is_the_same_session_again() {
    for board in BOARDS {
        let (first, second) = (session(board), session(board));
        for (once, again) in first.iter().zip(&second) {
            assert_eq!(once, again, "{board}");
        }
        assert_eq!(first.len(), second.len(), "{board}");
        assert!(first.len() > 20, "{board}: {first:#?}");
    }
}

#[test]
fn an_upload_inside_the_plant_exchange_has_nine_tenths_of_the_wire_and_costs_no_slot() {
    const BLOB_BYTES: usize = 4_096;
    let wire_s = BLOB_BYTES as f64 * 10.0 / 115_200.0;
    for board in BOARDS {
        let (_running, _plant, line) = started(board);
        let (mut robot, _) = LinkClient::connect(line).unwrap();
        robot.upload(&blob("patrol.esm"), &mut |_| ()).unwrap();
        let clock = robot.clock().clone();
        clock.pause(Duration::from_millis(500));
        // Whether it is a mission is looked at when it is to take over.
        let bytes: Arc<[u8]> = (0..BLOB_BYTES).map(|i| (i * 7) as u8).collect();
        for _ in 0..3 {
            let before = robot.status().unwrap();
            let retries = robot.counts().retries;
            let begun = clock.now();
            robot.stage(&bytes, &mut |_| ()).unwrap();
            let took_s = clock.since(begun).as_secs_f64();
            let after = robot.status().unwrap();
            let part = wire_s / took_s;
            println!(
                "{board}: {BLOB_BYTES} bytes in {took_s:.4} s of virtual time, {:.1} % of the wire's rate, {} slots missed",
                100.0 * part,
                after.missed - before.missed
            );
            // No wire is faster than itself.
            assert!((0.90..1.0).contains(&part), "{board}: {part}");
            assert_eq!(after.missed, 0, "{board}");
            assert_eq!(robot.counts().retries, retries, "{board}");
            robot.abort().unwrap();
            let refused = robot.commit(Swap::default()).unwrap_err();
            assert_eq!(refused.refusal(), Some(LinkError::NoUpload), "{board}");
        }
    }
}

/// A session over a bad line, with an upload, in virtual time. So many of a thousand bytes are
/// corrupted, dropped or doubled.
struct BadLine {
    hello_s: f64,
    upload_s: f64,
    counts: LinkCounts,
}

fn over_bad_line(
    line: Box<dyn ByteLink>,
    permille: u32,
    seed: u64,
    bytes: &[u8],
) -> (Box<dyn ByteLink>, Result<BadLine, ClientError>) {
    let clock = line.clock();
    let noise = Noise::of_each(Noise::WHOLE * permille / 3_000);
    let lent = Arc::new(Mutex::new(line));
    let begun = clock.now();
    let noisy = Noisy::new(Lent(Arc::clone(&lent)), noise, seed);
    let result = LinkClient::connect(noisy).and_then(|(mut robot, _)| {
        let hello_s = clock.since(begun).as_secs_f64();
        let begun = clock.now();
        robot.stage(bytes, &mut |_| ())?;
        Ok(BadLine {
            hello_s,
            upload_s: clock.since(begun).as_secs_f64(),
            counts: robot.counts(),
        })
    });
    let Some(line) = Arc::into_inner(lent) else {
        panic!("somebody has the line still");
    };
    (line.into_inner().unwrap(), result)
}

/// A line, for one session after another.
struct Lent(Arc<Mutex<Box<dyn ByteLink>>>);

impl ByteLink for Lent {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.0.lock().unwrap().receive(buffer, timeout)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.lock().unwrap().send(bytes)
    }

    fn clock(&self) -> Clock {
        self.0.lock().unwrap().clock()
    }
}

/// Nine sessions with a robot over a line of so much noise, and what came of each.
fn bad_lines(permille: u32, seeds: u64) -> Vec<Result<BadLine, ClientError>> {
    let bytes: Vec<u8> = (0..4_096).map(|i| (i * 7) as u8).collect();
    let (_running, _plant, mut line) = started(host_board::BOARD);
    let mut results = Vec::new();
    for seed in 0..seeds {
        let result;
        (line, result) = over_bad_line(line, permille, seed, &bytes);
        let said = match &result {
            Ok(BadLine {
                hello_s,
                upload_s,
                counts,
            }) => format!("hello {hello_s:.2} s, upload {upload_s:.2} s, {counts:?}"),
            Err(error) => error.to_string(),
        };
        println!("{permille} in 1000 bytes spoiled, seed {seed}: {said}");
        results.push(result);
        let (mut robot, _) = LinkClient::connect(line).unwrap();
        robot.abort().unwrap();
        line = robot.into_line();
    }
    results
}

#[test]
fn an_upload_over_a_bad_line_takes_seconds() {
    for (permille, most_s) in [(10, 3.0), (20, 5.0), (50, 15.0)] {
        let mut took_s: Vec<f64> = (bad_lines(permille, 9).iter())
            .map(|result| result.as_ref().unwrap().upload_s)
            .collect();
        took_s.sort_by(f64::total_cmp);
        let [shortest_s, median_s, longest_s] = [0, 4, 8].map(|at| took_s[at]);
        println!(
            "{permille} in 1000: 9 of 9, {shortest_s:.1} to {longest_s:.1} s, half of them in {median_s:.1} s"
        );
        assert!(median_s < most_s, "{took_s:?}");
        assert!(longest_s < 2.0 * most_s, "{took_s:?}");
    }
    // One byte in ten, and in five: it arrives, or the error says what is to be done about it.
    for (permille, seeds) in [(100, 9), (200, 1)] {
        let results = bad_lines(permille, seeds);
        for result in &results {
            if let Err(error) = result {
                let said = error.to_string();
                assert!(
                    said.contains("frames came spoiled: the line is too bad"),
                    "{said}"
                );
            }
        }
        let arrived = results.iter().filter(|result| result.is_ok()).count();
        println!("{permille} in 1000: {arrived} of {seeds}");
    }
}
