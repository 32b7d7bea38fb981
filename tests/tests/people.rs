//! People who step in the way of a robot that drives its round, and away again.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use esm_tests::command::root;
use esm_tests::host_drive;
use host_tools::plant::{PathSample, Plant};
use host_tools::run::drive::Plan;
use host_tools::world::{Person, World};
use serde_json::Value;

const SEEDS: std::ops::RangeInclusive<u64> = 1..=20;

/// A person who stays has gone by then, and the robot has gone on elsewhere.
const UNTIL_US: u64 = 50_000_000;

/// How long after somebody steps in the robot may still move: the reaction to what sonars hear, and
/// the way to brake.
const HALT_US: u64 = 1_000_000;

/// How long after somebody has stepped away the robot moves again at the latest: two pings, half a
/// second in which the way must be free, a sample of the path.
const GO_ON_US: u64 = 1_000_000;

/// So much is free between the two while the robot stands, in metres: `SafetyCheck` keeps 0.2 m,
/// and sonars scatter.
const GAP_M: f64 = 0.18;

/// Farther than this is a movement, in metres, and in radians.
const MOVED: f64 = 0.001;

/// `guard.esm` in a world: the plant at the end, and what its trace says.
struct Guarded {
    plant: Plant,
    trace: String,
}

impl Guarded {
    /// Where the robot really was, in a span of time.
    fn path(&self, from_us: u64, to_us: u64) -> impl Iterator<Item = &PathSample> {
        let path = self.plant.statistics().path().iter();
        path.filter(move |sample| (from_us..=to_us).contains(&sample.t_us))
    }

    /// When the robot first moves in a span of time, in microseconds.
    fn moves_at_us(&self, from_us: u64, to_us: u64) -> Option<u64> {
        let start = self.path(from_us, to_us).next()?.pose;
        let has_moved = |sample: &&PathSample| {
            let square_m2 = sample.pose.position.squared_distance_m2(start.position);
            let turned_rad = (sample.pose.heading_rad - start.heading_rad).abs();
            square_m2 > MOVED * MOVED || turned_rad > MOVED
        };
        (self.path(from_us, to_us).find(has_moved)).map(|sample| sample.t_us)
    }

    /// Where the round goes on, and when, in microseconds.
    fn round(&self) -> Vec<(u64, String)> {
        let lines = self.trace.lines();
        let entries = lines.map(|line| serde_json::from_str::<Value>(line).unwrap());
        entries
            .filter(|entry| entry["kind"] == "transition")
            .filter_map(|entry| {
                let state = entry["to"].as_str()?.strip_prefix("round/")?.to_owned();
                Some((entry["t_us"].as_u64()?, state))
            })
            .collect()
    }

    /// The state of the round at a time, and when it was entered.
    fn state_at(&self, time_us: u64) -> (u64, String) {
        let before = |(entered_us, _): &(u64, String)| *entered_us <= time_us;
        self.round().into_iter().take_while(before).last().unwrap()
    }
}

fn visitors() -> String {
    std::fs::read_to_string(root().join("missions/worlds/visitors.world")).unwrap()
}

fn guarded(world: World, seed: u64) -> Guarded {
    let run = host_drive::driven(Plan {
        seed,
        until_us: Some(UNTIL_US),
        ..host_drive::plan(&root().join("missions/guard.esm"), world)
    });
    Guarded {
        plant: run.plant,
        trace: String::from_utf8(run.told.out).unwrap(),
    }
}

/// The one who goes again, and the one who stays, with the times of stepping in and away.
fn people(world: &World) -> [(Person, u64, u64); 2] {
    let times = |person: Person| (person, person.from_us, person.to_us.unwrap());
    let [goes, stays] = world.people[..] else {
        panic!("two people: {:?}", world.people);
    };
    [goes, stays].map(times)
}

#[test]
fn guard_waits_for_a_person_and_goes_on_when_the_person_has_gone() {
    let world = World::parse(&visitors()).unwrap();
    let [(person, from_us, to_us), _] = people(&world);
    for seed in SEEDS {
        let guarded = guarded(world.clone(), seed);
        assert_eq!(guarded.plant.collisions(), 0, "seed {seed}");
        let before = guarded.moves_at_us(from_us - 500_000, from_us);
        assert!(
            before.is_some(),
            "seed {seed}: it drives when somebody steps in"
        );
        let moved = guarded.moves_at_us(from_us + HALT_US, to_us);
        assert_eq!(moved, None, "seed {seed}: it moves while somebody is there");
        let stands = guarded.path(to_us, to_us).next().unwrap().pose.position;
        let gap_m = person.circle.distance_m(stands) - guarded.plant.body().radius_m;
        assert!(gap_m > GAP_M, "seed {seed}: {gap_m} m");
        let gone_us = guarded.moves_at_us(to_us, to_us + 5_000_000).unwrap();
        println!(
            "seed {seed}: {gap_m:.3} m before the person, goes on after {} us",
            gone_us - to_us
        );
        assert!(gone_us <= to_us + GO_ON_US, "seed {seed}: {gone_us}");
        // One side, from its entry to the corner behind it, without another state in between.
        assert_eq!(
            guarded.state_at(gone_us),
            (0, "Side".to_owned()),
            "seed {seed}"
        );
        let (_, then) = &guarded.round()[1];
        assert_eq!(then, "Corner", "seed {seed}");
    }
}

#[test]
fn guard_turns_back_from_a_person_who_stays() {
    const TIMEOUT_US: u64 = 15_000_000;
    /// This person steps in up to 0.44 m before it: it drives on for 0.6 s until the stop distance,
    /// and then brakes.
    const DRIVES_ON_US: u64 = 200_000;
    /// A macro step.
    const STEP_US: u64 = 20_000;
    let world = World::parse(&visitors()).unwrap();
    let [_, (_, from_us, to_us)] = people(&world);
    for seed in SEEDS {
        let guarded = guarded(world.clone(), seed);
        assert_eq!(guarded.plant.collisions(), 0, "seed {seed}");
        let (entered_us, state) = guarded.state_at(from_us);
        assert_eq!(state, "Side", "seed {seed}");
        let back = guarded
            .round()
            .into_iter()
            .find(|(_, state)| state == "Back");
        let (back_us, _) = back.unwrap();
        let waited_us = back_us - entered_us;
        println!("seed {seed}: {waited_us} us on the side");
        assert!(
            (TIMEOUT_US..=TIMEOUT_US + 2 * STEP_US).contains(&waited_us),
            "{waited_us}"
        );
        assert!(back_us < to_us, "seed {seed}: somebody is there still");
        let moved = guarded.moves_at_us(from_us + HALT_US + DRIVES_ON_US, back_us);
        assert_eq!(moved, None, "seed {seed}: it moves while somebody is there");
        // It turns, and drives away.
        let (_, then) = guarded.state_at(to_us);
        assert_ne!(then, "Back", "seed {seed}");
        let at = |time_us| guarded.path(time_us, time_us).next().unwrap().pose.position;
        let way_m2 = at(back_us.next_multiple_of(100_000)).squared_distance_m2(at(to_us));
        assert!(way_m2 > 0.7 * 0.7, "seed {seed}: {way_m2} m²");
    }
}

#[test]
fn without_people_nothing_holds_guard_in_the_same_room() {
    let text = visitors().replace("\nperson ", "\n# person ");
    for seed in [1, 2] {
        let guarded = guarded(World::parse(&text).unwrap(), seed);
        let round = guarded.round();
        assert!(round.iter().all(|(_, state)| state != "Back"), "{round:?}");
        let (corner_us, _) = round[1];
        assert!((3_000_000..4_000_000).contains(&corner_us), "{round:?}");
    }
}

#[test]
fn a_run_with_people_repeats_to_the_bit() {
    let run = || guarded(World::parse(&visitors()).unwrap(), 3);
    let (first, second) = (run(), run());
    assert!(first.trace == second.trace);
    assert_eq!(
        first.plant.statistics().path(),
        second.plant.statistics().path()
    );
}
