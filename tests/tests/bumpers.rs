//! Things that sonars do not see, and a robot that finds them with its bumpers.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use esm_tests::command::root;
use esm_tests::host_drive;
use host_tools::plant::{PathSample, Plant, Touched};
use host_tools::run::drive::Plan;
use host_tools::world::World;

const SEEDS: std::ops::RangeInclusive<u64> = 1..=10;

/// A robot that backs off has left what it touched by so much, in metres, so long after it, in
/// microseconds: it drives back for 0.12 m at 0.15 m/s.
const LEFT_M: f64 = 0.09;
const LEFT_US: u64 = 2_000_000;

fn driven(file: &std::path::Path, world: World, seed: u64, until_us: u64) -> Plant {
    let run = host_drive::driven(Plan {
        seed,
        until_us: Some(until_us),
        ..host_drive::plan(file, world)
    });
    run.plant
}

#[test]
fn bump_backs_off_from_what_its_sonars_do_not_see_and_goes_on_elsewhere() {
    for seed in SEEDS {
        let mission = root().join("missions/bump.esm");
        let plant = driven(&mission, host_drive::world("low_boxes"), seed, 120_000_000);
        let touches = plant.statistics().touches();
        assert!(touches.len() >= 5, "seed {seed}: {}", touches.len());
        for touch in touches {
            assert_eq!(touch.touched, Touched::Low, "seed {seed}: {touch:?}");
            assert!(!touch.avoidable, "seed {seed}: {touch:?}");
            let is_later = |sample: &&PathSample| sample.t_us >= touch.t_us + LEFT_US;
            // The run may end before.
            let Some(later) = plant.statistics().path().iter().find(is_later) else {
                continue;
            };
            let left_m2 = later.pose.position.squared_distance_m2(touch.place);
            assert!(left_m2 > LEFT_M * LEFT_M, "seed {seed}: {touch:?}");
        }
        let way_m = plant.distance_m();
        println!("seed {seed}: {} touches on {way_m:.1} m", touches.len());
        assert!(way_m > 10.0, "seed {seed}: {way_m} m");
    }
}

/// A robot that is to drive on for ever, and 1 m before it something low.
///
/// Its behaviours take the ranges that its bumpers have felt, or those of its sonars alone. It
/// stays where it comes to, or backs off after a time.
fn pushes(feels: bool, backs_off: bool) -> Plant {
    let behaviours = "Go.ranges, Back.ranges, Run.ranges";
    let paths = match feels {
        true => format!("path Listen.ranges -> Feel.ranges; path Feel.felt -> {behaviours};"),
        false => format!("path Listen.ranges -> Feel.ranges, {behaviours};"),
    };
    let go_on = match backs_off {
        true => "Go -> Back [timeout]; Back -> Done on *;",
        false => "Go -> Done on *;",
    };
    let mission = format!(
        r#"use "{rover}";
        interpreter slot 1;
        slot 1 period 20 ms duration 2 ms;
        slot 2 period 10 ms duration 4 ms;
        slot 3 period 40 ms duration 2 ms;
        machine Push {{
            region sonars {{ task Listen: SonarRing; initial -> Listen; }}
            region position {{ task Track: Odometry; initial -> Track; }}
            region bumpers {{ task Feel: Bumpers; initial -> Feel; }}
            region drive {{
                state Ready timeout 1 s;
                task Go: Move timeout 12 s with {{ speed_m_per_s = 0.2 }};
                task Back: Move with {{ speed_m_per_s = -0.1, outside_m = 0.1 }};
                state Done;
                initial -> Ready;
                Ready -> Go [timeout];
                {go_on}
            }}
            region behaviours {{ task Run: Behaviours; initial -> Run; }}
            region wheels {{ task Drive: WheelSpeed; initial -> Drive; }}
            {paths}
            path Run.made -> Run.list, Go.list, Back.list;
            path Track.pose -> Listen.pose, Go.pose, Back.pose, Run.pose;
            path Run.twist -> Drive.twist;
            path Track.speeds -> Drive.speeds;
        }}"#,
        rover = root().join("missions/rover.esm").display()
    );
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("push.esm");
    std::fs::write(&file, mission).unwrap();
    let world = "world step\nstart 1,1.5 0\nwall 0,0 6,0 6,3 0,3 0,0\nlow 2.12,0 2.12,3";
    driven(&file, World::parse(world).unwrap(), 1, 20_000_000)
}

/// How far the left wheel has turned, in metres at its rim.
fn rolled_m(plant: &Plant) -> f64 {
    let body = plant.body();
    let turns = f64::from(plant.sensors().left_count) / body.counts_per_revolution;
    turns * core::f64::consts::TAU * body.wheel_radius_m
}

#[test]
fn a_behaviour_that_feels_something_does_not_push_on() {
    for (what, feels, backs_off, rolls_m, ends_m) in [
        ("it feels nothing", false, false, 3.0..5.0, 1.99..2.01),
        ("it feels the step", true, false, 0.99..1.08, 1.99..2.01),
        ("and may back off", true, true, 0.85..0.99, 1.86..1.92),
    ] {
        let plant = pushes(feels, backs_off);
        let (rolled_m, x_m) = (rolled_m(&plant), plant.pose().position.x_m);
        println!("{what}: its wheels have rolled {rolled_m:.3} m, it is at {x_m:.3} m");
        assert!(rolls_m.contains(&rolled_m), "{what}: {rolled_m}");
        assert!(ends_m.contains(&x_m), "{what}: {x_m}");
        assert_eq!(plant.statistics().touches().len(), 1, "{what}");
    }
}
