//! Telemetry on both boards: values are those of the plant, and cost neither slots nor answers
//! anything, however full the wire.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::collections::BTreeMap;
use std::time::Duration;

use esm_link::message::Mode;
use esm_tests::command::{Robot, Running, firmware, root};
use esm_tests::subject;
use host_tools::boards;
use host_tools::files::load_world;
use host_tools::host_board;
use host_tools::link_client::{LinkClient, Streams};
use host_tools::lockstep::pace::Pace;
use host_tools::lockstep::plant_side::PlantSide;
use host_tools::parameters::Value;
use host_tools::plant::{BodyParameters, Plant};
use host_tools::run::board::{Board, LinkWay, RunningBoard};
use host_tools::values::{Catalogue, Subscription, Told};

const BOARDS: [&str; 2] = ["host", "lm3s6965"];

/// Robot time that is looked at.
const UNTIL_US: u64 = 6_000_000;

/// The longest that an answer may take, in the line's time: a part that has begun, the request, and
/// the answer are 360 bytes, of which a byte takes 87 us, and each way waits for its exchange.
const LONGEST_ANSWER: Duration = Duration::from_millis(60);

/// Looks at all values on the nets of `patrol`, of a robot whose line is full of all that it can
/// send.
fn sampled(board: &str) {
    let world = load_world(&root().join("missions/worlds/office.world")).unwrap();
    let plant = Plant::new(world, BodyParameters::default(), 3).unwrap();
    let plant = PlantSide::new(plant, Pace::new(false), None);
    let place = match board {
        boards::DEFAULT => Board::emulated(firmware("rover")),
        _ => Board::Host {
            robot: host_board::rover,
        },
    };
    let (running, line) = RunningBoard::start(place, &plant, None, LinkWay::Exchange).unwrap();
    let (mut robot, _) = LinkClient::connect(line).unwrap();
    let blob = subject::build_file(&root().join("missions/patrol.esm")).unwrap();
    let hash = robot.upload(&blob.blob, &mut |_| ()).unwrap();
    let blob = esm_core::verify(blob.blob).unwrap();
    let catalogue = Catalogue::read(&mut robot, &blob).unwrap();
    let [group] = &catalogue.groups()[..] else {
        panic!("all of it fits into a sample");
    };
    let names: Vec<&str> = group.iter().map(|watched| watched.net.name()).collect();
    let streams = Streams {
        trace: true,
        log: true,
        record: true,
    };
    robot.subscribe(streams).unwrap();
    robot.watch(Some(Duration::from_millis(10))).unwrap();
    let subscription =
        Subscription::begin(&mut robot, hash, group.clone(), Duration::ZERO).unwrap();
    let mut samples = BTreeMap::new();
    let mut dropped = 0;
    let mut longest = Duration::ZERO;
    let clock = robot.clock().clone();
    let status = loop {
        let asked = clock.now();
        let status = robot.status().unwrap();
        longest = longest.max(clock.since(asked));
        for event in robot.take_events() {
            match subscription.read(&event) {
                Some(Told::Sample(reading)) => {
                    samples.insert(reading.t_us, reading.values);
                }
                Some(Told::Gap(missing)) => dropped += missing,
                Some(Told::Ended) => panic!("the mission runs"),
                None => {}
            }
        }
        if status.t_us >= UNTIL_US {
            break status;
        }
    };
    assert_eq!(status.mode, Mode::Running, "{board}");
    assert_eq!((status.missed, status.overruns), (0, 0), "{board}");
    assert!(
        longest < LONGEST_ANSWER,
        "{board}: an answer took {longest:?}"
    );
    // The line has no room for all of it, so that some were dropped, and counted: those that came
    // and those that did not are all macro steps. Counted from the second sample on: what is
    // dropped while the first one waits for the line is in the count that its part begins with.
    let (first, last) = (samples.keys().nth(1), samples.keys().next_back());
    let steps = (last.unwrap() - first.unwrap()) / 20_000 + 1;
    // A part says what was dropped when it was sent, which is behind its own macro step.
    let known = samples.len() as u64 - 1 + u64::from(dropped);
    assert!(
        (steps..=steps + 10).contains(&known),
        "{board}: {known} of {steps}"
    );
    assert!(
        dropped > 0 && samples.len() > 30,
        "{board}: {dropped} dropped"
    );
    // Board and plant stand still while nobody asks for anything: the plant is where the robot
    // believes to be.
    let place = |name: &str| names.iter().position(|known| *known == name).unwrap();
    let numbers = |name: &str| -> Vec<f64> {
        let values = samples.values().next_back().unwrap()[place(name)].as_ref();
        let number = |value: &Value| match value {
            Value::F32(value) => f64::from(*value),
            Value::U32(value) => f64::from(*value),
            other => panic!("{other:?}"),
        };
        values.unwrap().iter().map(number).collect()
    };
    let plant = plant.at_end();
    let begun = load_world(&root().join("missions/worlds/office.world")).unwrap();
    let begun = Plant::new(begun, BodyParameters::default(), 3)
        .unwrap()
        .pose();
    let pose = numbers("position/Track.pose");
    let (from, to) = (begun.position, plant.pose().position);
    let square = |x: f64, y: f64| x * x + y * y;
    let way_m2 = square(to.x_m - from.x_m, to.y_m - from.y_m);
    let told_m2 = square(pose[0], pose[1]);
    assert!(way_m2 > 0.25, "{board}: it drives: {way_m2} m²");
    assert!(
        (way_m2 - told_m2).abs() < 0.2,
        "{board}: {way_m2} m², {told_m2} m² told"
    );
    let battery_v = numbers("battery/Measure.battery")[0];
    let truth_v = plant.battery_v();
    assert!(
        (battery_v - truth_v).abs() < 0.3,
        "{board}: {truth_v} V, {battery_v} V told"
    );
    // Of eight sonars: range, age in hundredths of a second, and which of them are dead or deaf:
    // none. One echo may have been lost, and each pings once in two windows of 40 ms.
    let ranges = numbers("sonars/Listen.ranges");
    assert_eq!((ranges.len(), &ranges[16..]), (18, &[0.0, 0.0][..]));
    let ages_cs = &ranges[8..16];
    assert!(
        ages_cs.iter().all(|age_cs| (1.0..=24.0).contains(age_cs)),
        "{board}: {ages_cs:?}"
    );
    assert!(
        ages_cs.iter().any(|age_cs| *age_cs != ages_cs[0]),
        "{board}: they ping in turns"
    );
    drop((robot, running));
}

#[test]
fn values_are_the_plants_on_both_boards_and_cost_nothing_on_a_full_wire() {
    for board in BOARDS {
        sampled(board);
    }
}

#[test]
fn the_command_shows_values_by_name_and_follows_them_over_missions() {
    let robot = Robot::start("host", None);
    robot.esm(&["values"]).ended(1);
    robot.esm(&["upload", "missions/patrol.esm"]).good();
    let all = robot.esm(&["values", "--json"]).good().json();
    let values = all["values"].as_object().unwrap();
    assert!(values.len() >= 5, "{all:#}");
    assert_eq!(
        values["sonars/Listen.ranges"]["range_m"]
            .as_array()
            .unwrap()
            .len(),
        8
    );
    let text = robot.esm(&["values", "position/Track.pose"]).good().out;
    assert!(
        text.contains("position/Track.pose  x ") && text.contains(" rad"),
        "{text}"
    );
    // By the port of a reader, too.
    let read = robot.esm(&["values", "wheels/Drive.twist,position/Track.pose", "--json"]);
    assert!(read.good().json()["values"]["wheels/Drive.twist"].is_object());
    let refused = robot.esm(&["values", "position/Trak.pose"]).ended(1);
    assert!(
        refused.err.contains("did you mean `position/Track.pose`?"),
        "{refused:#?}"
    );
    let refused = robot.esm(&["values", "nothing"]).ended(1);
    assert!(
        refused.err.contains("it has ") && refused.err.contains("battery/Measure.battery"),
        "{refused:#?}"
    );
    let follow = [
        "values",
        "battery/Measure.battery",
        "--every",
        "0 s",
        "--json",
        "--port",
        robot.port(),
    ];
    let samples = Running::esm(&follow)
        .until("samples", |running| running.out().lines().count() > 5)
        .interrupted()
        .good()
        .out;
    let last: serde_json::Value = serde_json::from_str(samples.lines().nth(4).unwrap()).unwrap();
    assert_eq!(last["mission"], all["mission"]);
    let status = robot.status();
    assert_eq!(status["slots_missed"], 0, "{status:#}");
    robot.esm(&["stop"]).good();
    let refused = robot.esm(&["values"]).ended(1);
    assert!(refused.err.contains("`esm start`"), "{refused:#?}");
}
