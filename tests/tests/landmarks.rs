//! Doors and corners that a robot drives past.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use esm_tests::command::root;
use esm_tests::host_drive;
use host_tools::plant::BodyPose;
use host_tools::run::by_hand::ByHand;
use host_tools::run::drive::Plan;
use host_tools::script::read;
use host_tools::world::World;

/// The sonars are so far from the robot's centre, in metres.
const RIM_M: f64 = 0.11;

/// Where the robot is after a script, which it begins 0.5 s after its start. It has touched
/// nothing.
fn driven(script: &str, world: World, seed: u64, until_s: u64) -> BodyPose {
    const BEGINS_US: u64 = 500_000;
    let rover = std::fs::read_to_string(root().join("missions/rover.esm")).unwrap();
    let tasks = host_tools::lang::load_text("rover.esm", &rover);
    let reading = read("landmarks.script", script, &tasks.model.unwrap().tasks);
    assert_eq!(reading.diagnostics, []);
    let run = host_drive::driven(Plan {
        seed,
        until_us: Some(until_s * 1_000_000),
        by_hand: ByHand {
            script: reading.script.map(|script| (BEGINS_US, script)),
            driven: Vec::new(),
            placed: Vec::new(),
        },
        ..host_drive::plan(&root().join("missions/by_hand.esm"), world)
    });
    assert_eq!(run.plant.collisions(), 0, "{script}");
    run.plant.pose()
}

/// A world that ships, without its people, from another start on, and with something more in it.
fn without_people(name: &str, start: &str, more: &str) -> World {
    let file = root().join(format!("missions/worlds/{name}.world"));
    let text = std::fs::read_to_string(file).unwrap();
    let lines = text.lines().map(|line| match line.split_once(' ') {
        Some(("person", _)) => "\n".to_owned(),
        Some(("start", _)) => format!("start {start}\n"),
        _ => format!("{line}\n"),
    });
    World::parse(&(lines.collect::<String>() + more)).unwrap()
}

/// A situation, and where those are along x that the robot passes: where each begins and ends.
type Passed<'a> = (&'a str, &'a [(f64, f64)]);

/// Drives along x by steps that each end where a landmark was passed: so it stands behind the last
/// one only if it has found each, and nothing else. One step more leads to the end of the way.
fn doors_are_found(name: &str, start: &str, ways: &[&str], passed: &[Passed<'_>], end_m: f64) {
    // The beam hides so much of each end, and the robot brakes behind it.
    const HIDDEN_M: f64 = 0.4;
    const BRAKES_M: f64 = 0.15;
    let (mut doors, mut found, mut wrong) = (0, 0, 0);
    for way in ways {
        for (situation, ends_m) in passed {
            for (seed, count) in
                (1..=4).flat_map(|seed| (1..=ends_m.len() + 1).map(move |n| (seed, n)))
            {
                let script = format!("{way} unless {situation} -> cancel\n").repeat(count);
                let world = without_people(name, start, "");
                let x_m = driven(&script, world, seed, 60).position.x_m;
                println!("{name}, seed {seed}, {way}, {situation}: {count} at {x_m:.2} m");
                match ends_m.get(count - 1) {
                    Some((_, to_m)) => {
                        doors += 1;
                        let is_there = (to_m - HIDDEN_M..to_m + BRAKES_M).contains(&x_m);
                        found += usize::from(is_there);
                    }
                    None => wrong += usize::from((x_m - end_m).abs() > 0.1),
                }
            }
        }
    }
    println!("{name}: {found} of {doors} doors, {wrong} ways with one that is none");
    assert_eq!((found, wrong), (doors, 0), "{name}");
}

#[test]
fn the_doors_of_the_office_floor_are_found_and_nothing_else() {
    let left: &[(f64, f64)] = &[(2.6, 3.5), (6.5, 7.4), (11.4, 12.3)];
    let right: &[(f64, f64)] = &[(5.3, 6.2), (9.7, 10.6)];
    doors_are_found(
        "office_floor",
        "2.0,5.05 0",
        &[
            "follow_corridor distance_m = 12",
            "move speed_m_per_s = 0.25",
        ],
        &[
            ("door_left least_m = 0.7", left),
            ("door_right least_m = 0.7", right),
            // All are 0.9 m wide.
            ("door_left least_m = 1.1", &[]),
        ],
        12.87,
    );
}

#[test]
fn a_niche_as_wide_as_a_door_is_one_as_well() {
    doors_are_found(
        "corridor",
        "1.7,0.75 0",
        &[
            "follow_corridor distance_m = 12",
            "move speed_m_per_s = 0.2",
        ],
        &[
            ("door_left least_m = 0.6", &[(3.6, 4.5), (6.5, 7.4)]),
            ("door_right least_m = 0.6", &[(7.8, 8.7)]),
        ],
        9.67,
    );
}

#[test]
fn a_corner_is_a_wall_ahead_and_one_beside_and_somebody_ahead_is_none() {
    for seed in 1..=4 {
        for side in ["left", "right"] {
            // Walls to both sides are 0.94 m from the rim.
            let script = format!(
                "follow_corridor distance_m = 12 unless corner_{side} range_m = 1.1 -> cancel\n\
                 turn_to angle_rad = 1.5708\n"
            );
            let at = driven(
                &script,
                without_people("office_floor", "8.0,5.05 0", ""),
                seed,
                60,
            );
            let left_m = 13.2 - RIM_M - at.position.x_m;
            println!(
                "seed {seed}, {side}: {left_m:.2} m, {:.2} rad",
                at.heading_rad
            );
            assert!((0.7..1.1).contains(&left_m), "{left_m} m");
            assert!((at.heading_rad - 1.57).abs() < 0.1);
            // It waits for him.
            let at = driven(
                &script,
                without_people("office_floor", "8.0,5.05 0", "person 10.5,5.05 0.25"),
                seed,
                60,
            );
            let left_m = 10.25 - RIM_M - at.position.x_m;
            println!(
                "seed {seed}, {side}: {left_m:.2} m, {:.2} rad",
                at.heading_rad
            );
            assert!((0.2..0.4).contains(&left_m), "{left_m} m");
            assert!(at.heading_rad.abs() < 0.1);
        }
    }
}

#[test]
fn a_mission_turns_to_the_second_door_on_its_left() {
    for seed in 1..=4 {
        let run = host_drive::driven(Plan {
            seed,
            until_us: Some(45_000_000),
            ..host_drive::plan(
                &root().join("missions/landmark.esm"),
                host_drive::world("corridor"),
            )
        });
        let (at, trace) = (run.plant.pose(), String::from_utf8(run.told.out).unwrap());
        println!(
            "seed {seed}: {:.2} m, {:.2} rad",
            at.position.x_m, at.heading_rad
        );
        // It is a niche from 6.5 to 7.4 m.
        assert!((6.9..7.5).contains(&at.position.x_m) && (at.heading_rad - 1.57).abs() < 0.1);
        let entered = |state: &str| trace.contains(&format!(r#""to":"{state}""#));
        assert!(entered("way/Look") && entered("way/final") && !entered("way/GivenUp"));
        assert_eq!(run.plant.collisions(), 0);
    }
}
