//! The rover's own tasks on the plant, without a mission: what they measure and reach is held
//! against where the body really is.

#![allow(clippy::unwrap_used, reason = "what only tests call fails the test")]

use host_tools::plant::{BodyParameters, BodyPose, Plant};
use host_tools::world::World;
use rt_firmware::body::{Freshness, PinImage, PlantExchange};
use rt_firmware::ports::{Inputs, TaskPlace};
use rt_firmware::rover::{Measures, PinRover, RoverParts};
use rt_firmware::tasks::Pose;
use rt_firmware::{Step, assemble, nets};

/// Nets of the rig: one for each name that ports of the rover's tasks have.
const NETS: [&str; 5] = ["ranges", "pose", "speeds", "twist", "battery"];
const POSE_NET: usize = 1;

const PERIOD_US: u64 = 20_000;

/// A task to move with: its name, `in` flags and parameters.
struct Movement {
    task: &'static str,
    flags: u16,
    params: [f32; 2],
}

/// Where a run ended, and what the robot thought of it.
#[derive(Debug, PartialEq)]
struct End {
    real: BodyPose,
    located: Pose,
    distance_m: f64,
    collisions: u32,
    finished: bool,
}

/// Drives with `movement` until it finishes or `limit_s` is over, with sonars, odometry and wheel
/// control around it.
fn drive(world: &str, movement: &Movement, limit_s: u64, seed: u64) -> End {
    let world = World::parse(world).unwrap();
    let mut plant = Plant::new(world, BodyParameters::default(), seed).unwrap();
    let pins = PinImage::new();
    let mut rover = PinRover::new(RoverParts::from(pins.parts()), &Measures::ROVER);
    let mut banks = rover.banks();
    let mut nets = nets::<5>();
    let (mut executor, registry) = assemble(&mut banks, &mut nets).unwrap();
    let mut exchange = PlantExchange::new();
    let mut finished = false;

    let mut cycle = |cycle: u64, tasks: &[(&str, u16, &[f32])]| {
        let start_us = cycle * PERIOD_US;
        let request = exchange.request(&pins, start_us, start_us.saturating_sub(PERIOD_US - 5_000));
        let reply = plant.exchange(&request);
        assert_eq!(
            exchange.accept(&pins, Some(&reply.encode())),
            Freshness::Fresh
        );
        tasks
            .iter()
            .map(|(name, flags, params)| {
                let bank = registry
                    .declarations()
                    .position(|task| task.name == *name)
                    .unwrap();
                let ports = registry.declaration(bank).unwrap().ports;
                let net_of = |port: usize| NETS.iter().position(|net| *net == ports[port].name);
                let mut inputs = Inputs {
                    flags: *flags,
                    now_us: start_us,
                    period_us: if *name == "SonarRing" { 40_000 } else { 20_000 },
                    ..Inputs::default()
                };
                for (bits, value) in inputs.params.iter_mut().zip(params.iter()) {
                    *bits = value.to_bits();
                }
                let place = TaskPlace {
                    bank: bank as u8,
                    place: 0,
                };
                let outcome = executor.execute(place, net_of, &inputs, cycle == 0);
                outcome.is_some_and(|outcome| outcome.step == Step::Finished)
            })
            .collect::<Vec<bool>>()
    };

    for number in 0..limit_s * 1_000_000 / PERIOD_US {
        let mut tasks: Vec<(&str, u16, &[f32])> = vec![("Odometry", 0, &[])];
        tasks.push(if finished {
            ("Stop", 0, &[])
        } else {
            (movement.task, movement.flags, &movement.params)
        });
        tasks.push(("WheelSpeed", 0, &[1.2, 30.0, 0.8, 4.0]));
        if number % 2 == 0 {
            tasks.push(("SonarRing", 0, &[0.0, 20.0]));
        }
        finished |= cycle(number, &tasks)[1];
    }
    End {
        real: plant.pose(),
        located: executor.value_on(POSE_NET).unwrap(),
        distance_m: plant.distance_m(),
        collisions: plant.collisions(),
        finished,
    }
}

const HALL: &str = "world hall\nstart 10,10 0\nwall 0,0 20,0 20,20 0,20 0,0";

#[test]
fn the_robot_drives_as_fast_as_asked_and_knows_where_it_is() {
    let cruise = Movement {
        task: "Cruise",
        flags: 0,
        params: [0.3, 0.35],
    };
    let end = drive(HALL, &cruise, 20, 1);
    // It stands until the sonars have looked around, for half a second or so.
    assert!((end.distance_m - 5.85).abs() < 0.2, "{end:?}");
    // The slip and a ruler's error on wheels and wheel base: a few parts in a hundred.
    let real_x_m = end.real.position.x_m - 10.0;
    let real_y_m = end.real.position.y_m - 10.0;
    assert!(
        (f64::from(end.located.x_m) - real_x_m).abs() < 0.2,
        "{end:?}"
    );
    assert!(
        (f64::from(end.located.y_m) - real_y_m).abs() < 0.2,
        "{end:?}"
    );
    assert_eq!(end.collisions, 0);
}

#[test]
fn turns_reach_their_angle() {
    for (left, angle_rad, expected_rad) in [(1, 1.5, 1.5), (0, 0.7, -0.7), (1, 3.0, 3.0)] {
        let turn = Movement {
            task: "Turn",
            flags: left,
            params: [angle_rad, 1.2],
        };
        let end = drive(HALL, &turn, 6, 2);
        assert!(end.finished, "{angle_rad}");
        assert!(
            (end.real.heading_rad - expected_rad).abs() < 0.12,
            "{end:?}"
        );
        assert!(end.distance_m < 0.03, "on the spot: {end:?}");
    }
}

#[test]
fn backing_up_ends_at_its_distance_or_before_the_wall_behind() {
    for (wall_x_m, expected_m) in [(0.0, 0.5), (9.6, 0.19)] {
        let world = format!(
            "world yard\nstart 10,10 0\nwall {wall_x_m},0 20,0 20,20 {wall_x_m},20 {wall_x_m},0"
        );
        let back = Movement {
            task: "Back",
            flags: 0,
            params: [0.15, 0.5],
        };
        let end = drive(&world, &back, 6, 3);
        assert!(end.finished && end.collisions == 0, "{end:?}");
        assert!((end.distance_m - expected_m).abs() < 0.03, "{end:?}");
        assert!(end.real.position.x_m < 10.0);
    }
}

#[test]
fn two_runs_are_equal_to_the_bit() {
    let cruise = Movement {
        task: "Cruise",
        flags: 0,
        params: [0.3, 0.35],
    };
    assert_eq!(drive(HALL, &cruise, 5, 7), drive(HALL, &cruise, 5, 7));
    assert_ne!(drive(HALL, &cruise, 5, 7), drive(HALL, &cruise, 5, 8));
}
