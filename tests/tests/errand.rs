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

#[test]
fn the_errand_ends_where_it_began_and_touches_nobody() {
    for seed in 1..=6 {
        let world = host_drive::world("office_floor");
        let start = world.start.position;
        let run = host_drive::driven(Plan {
            seed,
            until_us: Some(270_000_000),
            ..host_drive::plan(&root().join("missions/errand.esm"), world)
        });
        let end = run.plant.pose().position;
        let off_m = libm::hypot(end.x_m - start.x_m, end.y_m - start.y_m);
        let rooms = run.plant.statistics().rooms_entered().join(" ");
        println!("seed {seed}: {off_m:.3} m off, by {rooms}");
        assert_eq!(run.plant.collisions(), 0, "seed {seed}");
        assert_eq!(rooms, "corridor lab storeroom", "seed {seed}");
        assert!(off_m < MOST_M, "seed {seed}: {off_m} m");
        let trace = String::from_utf8(run.told.out).unwrap();
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
        let world = host_drive::world("office_floor");
        let start = world.start.position;
        let run = host_drive::driven(Plan {
            seed: 1,
            until_us: Some(290_000_000),
            sonar_breaks: vec![SonarBreak {
                sonar,
                fault: SonarFault::Dead,
                robot_us: dies_s * 1_000_000,
            }],
            ..host_drive::plan(&root().join("missions/errand.esm"), world)
        });
        let end = run.plant.pose().position;
        let off_m = libm::hypot(end.x_m - start.x_m, end.y_m - start.y_m);
        let rooms = run.plant.statistics().rooms_entered().join(" ");
        println!("sonar {sonar} dead at {dies_s} s: {off_m:.3} m off, by {rooms}");
        assert_eq!(run.plant.collisions(), 0, "sonar {sonar}");
        assert_eq!(rooms, "corridor lab storeroom", "sonar {sonar}");
        assert!(off_m < MOST_M, "sonar {sonar}: {off_m} m");
    }
}

#[test]
fn an_errand_whose_door_is_shut_is_given_up() {
    let floor = std::fs::read_to_string(root().join("missions/worlds/office_floor.world")).unwrap();
    let shut = floor + "wall 11.4,6.15 12.3,6.15\n";
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
