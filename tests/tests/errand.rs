//! The mission that crosses an office floor and comes back.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use esm_tests::command::root;
use esm_tests::host_drive;
use host_tools::lockstep::plant_side::SonarBreak;
use host_tools::plant::SonarFault;
use host_tools::run::drive::Plan;
use host_tools::world::World;

/// How far from its start it may end, in metres.
const MOST_M: f64 = 0.25;

/// How an errand has ended.
struct Ended {
    /// How far it is from its start, in metres.
    off_m: f64,
    /// Names of the rooms that it has entered, in the order of the world's.
    rooms: String,
    collisions: u32,
    trace: String,
}

fn driven(world: &str, seed: u64, until_s: u64, sonar_breaks: Vec<SonarBreak>) -> Ended {
    let world = host_drive::world(world);
    let start = world.start.position;
    let run = host_drive::driven(Plan {
        seed,
        until_us: Some(until_s * 1_000_000),
        sonar_breaks,
        ..host_drive::plan(&root().join("missions/errand.esm"), world)
    });
    let end = run.plant.pose().position;
    Ended {
        off_m: libm::hypot(end.x_m - start.x_m, end.y_m - start.y_m),
        rooms: run.plant.statistics().rooms_entered().join(" "),
        collisions: run.plant.collisions(),
        trace: String::from_utf8(run.told.out).unwrap(),
    }
}

#[test]
fn the_errand_ends_where_it_began_and_touches_nobody() {
    for seed in 1..=6 {
        let Ended {
            off_m,
            rooms,
            collisions,
            trace,
        } = driven("office_floor", seed, 270, Vec::new());
        println!("seed {seed}: {off_m:.3} m off, by {rooms}");
        assert_eq!(collisions, 0, "seed {seed}");
        assert_eq!(rooms, "corridor lab storeroom", "seed {seed}");
        assert!(off_m < MOST_M, "seed {seed}: {off_m} m");
        let entered = |state: &str| trace.matches(&format!(r#""to":"errand/{state}""#)).count();
        assert_eq!(
            (entered("GivenUp"), entered("final")),
            (0, 1),
            "seed {seed}"
        );
        assert_eq!(entered("Follow"), 2, "seed {seed}");
    }
}

#[test]
fn the_errand_comes_home_without_any_one_of_its_sonars() {
    // They die in a room, in a door, in the corridor there, and behind the second turn.
    let dies_s = [3, 22, 45, 60, 95, 110, 130, 150];
    for (sonar, dies_s) in dies_s.into_iter().enumerate() {
        let dies = SonarBreak {
            sonar,
            fault: SonarFault::Dead,
            robot_us: dies_s * 1_000_000,
        };
        let Ended {
            off_m,
            rooms,
            collisions,
            ..
        } = driven("office_floor", 1, 290, vec![dies]);
        println!("sonar {sonar} dead at {dies_s} s: {off_m:.3} m off, by {rooms}");
        assert_eq!(collisions, 0, "sonar {sonar}");
        assert_eq!(rooms, "corridor lab storeroom", "sonar {sonar}");
        assert!(off_m < MOST_M, "sonar {sonar}: {off_m} m");
    }
}

#[test]
fn an_errand_whose_door_is_shut_turns_back_at_the_end_of_the_corridor() {
    for seed in 1..=3 {
        let Ended {
            off_m,
            rooms,
            collisions,
            trace,
        } = driven("shut_doors", seed, 270, Vec::new());
        assert!(trace.contains(r#""to":"errand/NoDoor""#), "seed {seed}");
        assert_eq!(rooms, "corridor storeroom", "seed {seed}");
        assert!(off_m < MOST_M, "seed {seed}: {off_m} m");
        assert_eq!(collisions, 0);
    }
}

#[test]
fn an_errand_that_is_shut_in_is_given_up() {
    let floor = std::fs::read_to_string(root().join("missions/worlds/office_floor.world")).unwrap();
    // All doors of the corridor but the storeroom's: on the way back that is the first, not the
    // third, so that the robot finds no third one there either.
    let shut = floor
        + "wall 2.6,6.15 3.5,6.15\nwall 6.5,6.15 7.4,6.15\nwall 11.4,6.15 12.3,6.15\n\
           wall 5.3,3.95 6.2,3.95\nwall 9.7,3.95 10.6,3.95\n";
    let run = host_drive::driven(Plan {
        seed: 1,
        until_us: Some(270_000_000),
        ..host_drive::plan(
            &root().join("missions/errand.esm"),
            World::parse(&shut).unwrap(),
        )
    });
    let trace = String::from_utf8(run.told.out).unwrap();
    assert!(trace.contains(r#""to":"errand/GivenUp""#));
    assert_eq!(run.plant.collisions(), 0);
}
