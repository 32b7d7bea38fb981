//! Behaviours that find their way by walls and doors.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fmt::Write;

use esm_tests::behaviour_run::{BehaviourRun, behave, behave_with};
use host_tools::world::World;

/// A wall of this thickness is between corridor and rooms, which are this deep, in metres.
const THICK_M: f64 = 0.1;
const DEEP_M: f64 = 2.5;

/// How long each corridor is, in metres, from 2 m behind the robot's start.
const LONG_M: f64 = 14.0;

/// A corridor along x whose middle is y = 0, with door openings from one x to another.
struct Hall<'a> {
    width_m: f64,
    left: &'a [(f64, f64)],
    right: &'a [(f64, f64)],
}

impl Hall<'_> {
    /// The world in which the robot starts at x = 0.
    fn world(&self, y_m: f64, heading_deg: f64) -> World {
        let (from_m, to_m) = (-2.0, LONG_M - 2.0);
        let half_m = self.width_m / 2.0;
        let mut text = format!("world hall\nstart 0,{y_m} {heading_deg}\n");
        for (doors, side) in [(self.left, 1.0), (self.right, -1.0)] {
            let (near_m, far_m) = (half_m * side, (half_m + THICK_M) * side);
            let deep_m = (half_m + THICK_M + DEEP_M) * side;
            let mut begin_m = from_m;
            for (open_m, shut_m) in doors.iter().chain([&(to_m, to_m)]) {
                writeln!(
                    text,
                    "wall {begin_m},{far_m} {begin_m},{near_m} {open_m},{near_m} {open_m},{far_m} {begin_m},{far_m}"
                )
                .unwrap();
                begin_m = *shut_m;
            }
            writeln!(
                text,
                "wall {from_m},{far_m} {from_m},{deep_m} {to_m},{deep_m} {to_m},{far_m}"
            )
            .unwrap();
        }
        writeln!(text, "wall {from_m},{} {from_m},{half_m}", -half_m).unwrap();
        writeln!(text, "wall {to_m},{} {to_m},{half_m}", -half_m).unwrap();
        World::parse(&text).unwrap()
    }
}

/// Root of the mean square of the distance from the middle, from 3 m of driving on, in metres.
fn off_middle_m(run: &BehaviourRun) -> f64 {
    let squares: Vec<f64> = (run.path())
        .map(|sample| sample.pose.position)
        .filter(|at| at.x_m > 3.0)
        .map(|at| at.y_m * at.y_m)
        .collect();
    assert!(squares.len() > 50, "{} samples", squares.len());
    libm::sqrt(squares.iter().sum::<f64>() / squares.len() as f64)
}

#[test]
fn the_middle_of_a_corridor_is_kept_from_any_start() {
    const MOST_M: f64 = 0.05;
    let doors: &[(f64, f64)] = &[(1.0, 1.9), (4.0, 5.3), (7.0, 7.7)];
    let others: &[(f64, f64)] = &[(-0.4, 0.5), (4.5, 5.4), (6.0, 6.9)];
    let mut worst_m = 0.0_f64;
    for (seed, width_m) in (1..).zip([1.6, 2.0, 2.4]) {
        for (left, right) in [(&[][..], &[][..]), (doors, others), (others, doors)] {
            let hall = Hall {
                width_m,
                left,
                right,
            };
            for (y_m, heading_deg) in [
                (0.0, 0.0),
                (0.4, 30.0),
                (0.4, -30.0),
                (-0.4, -30.0),
                (-0.4, 15.0),
            ] {
                let start = format!(
                    "{width_m} m, {} doors, from {y_m} m, {heading_deg}°",
                    left.len()
                );
                let run = behave(
                    "FollowCorridor with { distance_m = 9.0 }",
                    hall.world(y_m, heading_deg),
                    seed,
                    70,
                );
                assert!(run.ended_us.is_some() && !run.failed, "{start}");
                assert_eq!(run.plant.collisions(), 0, "{start}");
                let off_m = off_middle_m(&run);
                println!("{start}: {off_m:.4} m off the middle");
                worst_m = worst_m.max(off_m);
            }
        }
    }
    assert!(worst_m < MOST_M, "{worst_m} m");
}

#[test]
fn it_ends_beside_the_middle_of_the_door_that_is_asked_for() {
    const MOST_M: f64 = 0.08;
    let left: &[(f64, f64)] = &[(2.6, 3.5), (4.4, 5.7), (7.0, 7.7)];
    let right: &[(f64, f64)] = &[(-0.4, 0.5), (4.6, 5.5), (6.3, 7.2)];
    let mut worst_m = 0.0_f64;
    for (seed, width_m) in (1..).zip([1.6, 2.0, 2.4]) {
        let hall = Hall {
            width_m,
            left,
            right,
        };
        for (wanted, middle_m) in [
            ("doors_left = 1", 3.05),
            ("doors_left = 2", 5.05),
            ("doors_left = 3", 7.35),
            // It began beside one, which it has not seen from end to end.
            ("doors_right = 2", 6.75),
        ] {
            let run = behave(
                &format!("FollowCorridor with {{ distance_m = 9.0, {wanted} }}"),
                hall.world(0.1, -5.0),
                seed,
                60,
            );
            let at = run.plant.pose();
            let off_m = (at.position.x_m - middle_m).abs();
            worst_m = worst_m.max(off_m);
            println!(
                "{width_m} m, {wanted}: {off_m:.3} m off, {:.3} m beside the middle, {:.3} rad",
                at.position.y_m, at.heading_rad
            );
            assert!(
                run.ended_us.is_some() && !run.failed,
                "{wanted}: {:?}",
                run.ended_us
            );
            assert!(
                at.position.y_m.abs() < MOST_M && at.heading_rad.abs() < 0.1,
                "{wanted}: {at:?}"
            );
            assert_eq!(run.plant.collisions(), 0);
        }
    }
    assert!(worst_m < MOST_M, "{worst_m} m");
}

#[test]
fn a_corridor_that_begins_beside_an_opening_is_placed_where_it_is() {
    const MOST_M: f64 = 0.05;
    let right: &[(f64, f64)] = &[(-0.4, 0.5), (4.6, 5.5)];
    for (seed, (width_m, heading_deg)) in
        (1..).zip([(2.0, -10.0), (2.4, -10.0), (2.4, -15.0), (1.6, -20.0)])
    {
        let hall = Hall {
            width_m,
            left: &[],
            right,
        };
        let run = behave(
            "FollowCorridor with { distance_m = 3.5 }",
            hall.world(0.2, heading_deg),
            seed,
            40,
        );
        let start = format!("{width_m} m, {heading_deg}°");
        let beyond_m = (run.path())
            .map(|sample| sample.pose.position)
            .filter(|at| at.x_m > 2.0)
            .map(|at| at.y_m.abs())
            .fold(0.0, f64::max);
        println!("{start}: {beyond_m:.3} m off the middle from 2 m on");
        assert!(run.ended_us.is_some() && !run.failed, "{start}");
        assert!(beyond_m < MOST_M, "{start}: {beyond_m} m");
    }
}

#[test]
fn a_corridor_is_kept_and_a_door_found_without_any_one_sonar() {
    const OFF_MIDDLE_M: f64 = 0.05;
    const OFF_DOOR_M: f64 = 0.2;
    let left: &[(f64, f64)] = &[(2.6, 3.5), (4.4, 5.7), (7.0, 7.7)];
    // Where both sides are open at once, one run in a hundred misses a door, and fails.
    let right: &[(f64, f64)] = &[(-0.4, 0.5), (6.0, 6.7)];
    for sonar in 0..8 {
        for (seed, (width_m, dies_ms, right)) in
            (1..).zip([(1.6, 200, right), (2.0, 3_000, right), (2.4, 9_000, &[])])
        {
            let hall = Hall {
                width_m,
                left,
                right,
            };
            let run = behave_with(
                "FollowCorridor with { distance_m = 9.0, doors_left = 3 }",
                hall.world(0.2, -10.0),
                seed,
                90,
                &[(sonar, dies_ms)],
            );
            let at = run.plant.pose().position;
            let start = format!("{width_m} m, sonar {sonar} dead at {dies_ms} ms");
            let off_m = off_middle_m(&run);
            println!(
                "{start}: {:.3} m off, {off_m:.4} m off the middle",
                at.x_m - 7.35
            );
            assert!(run.ended_us.is_some() && !run.failed, "{start}: {at:?}");
            assert_eq!(run.plant.collisions(), 0, "{start}");
            assert!(off_m < OFF_MIDDLE_M, "{start}: {off_m} m");
            assert!((at.x_m - 7.35).abs() < OFF_DOOR_M, "{start}: {at:?}");
        }
    }
}

/// Beside an opening on one side the post of one on the other side is heard a little farther than
/// the wall: who believed that turned towards it, and saw openings where there are none.
#[test]
fn doors_are_counted_where_both_sides_are_open_at_once() {
    const OFF_DOOR_M: f64 = 0.2;
    let hall = Hall {
        width_m: 2.0,
        left: &[(2.6, 3.5), (4.4, 5.7), (7.0, 7.7)],
        right: &[(-0.4, 0.5), (4.6, 5.5), (6.3, 7.2)],
    };
    for (sonar, seed) in [(0, 5), (5, 4), (7, 5), (2, 1), (6, 1)] {
        let run = behave_with(
            "FollowCorridor with { distance_m = 9.0, doors_left = 3 }",
            hall.world(0.2, -10.0),
            seed,
            90,
            &[(sonar, 3_000)],
        );
        let at = run.plant.pose().position;
        println!(
            "sonar {sonar} dead, seed {seed}: {:.3} m off",
            at.x_m - 7.35
        );
        assert!(run.ended_us.is_some() && !run.failed, "{sonar}: {at:?}");
        assert!((at.x_m - 7.35).abs() < OFF_DOOR_M, "{sonar}: {at:?}");
    }
}

/// From 5° off its first way leads to a post.
#[test]
fn who_meets_a_post_backs_off_and_passes_the_door_then() {
    const END_M: f64 = 0.12;
    for (seed, (width_m, wide_m, aside_m, turned_deg)) in [
        (6, (1.6, 0.7, -0.1, 5.0)),
        (7, (1.6, 0.7, 0.1, -5.0)),
        (30, (1.6, 0.9, 0.0, -5.0)),
        (85, (1.8, 0.8, 0.1, -5.0)),
    ] {
        let hall = Hall {
            width_m,
            left: &[(-wide_m / 2.0, wide_m / 2.0)],
            right: &[],
        };
        let mut world = hall.world(0.0, 90.0 + turned_deg);
        world.start.position.x_m = aside_m;
        let run = behave("PassDoor with { beyond_m = 0.6 }", world, seed, 40);
        let at = run.plant.pose().position;
        let end_m = libm::hypot(at.x_m, at.y_m - (width_m + THICK_M) / 2.0 - 0.6);
        let start = format!("{wide_m} m, {width_m} m, from {aside_m} m, {turned_deg}°");
        println!("{start}: {end_m:.3} m off");
        assert!(run.ended_us.is_some() && !run.failed, "{start}: {at:?}");
        assert_eq!(run.plant.collisions(), 0, "{start}");
        assert!(end_m < END_M, "{start}: {end_m} m");
    }
}

#[test]
fn a_door_is_passed_without_any_one_sonar() {
    const MOST_M: f64 = 0.12;
    for sonar in 0..8 {
        for (seed, (wide_m, dies_ms)) in (1..).zip([(0.8, 200), (0.9, 3_000), (1.2, 6_000)]) {
            let hall = Hall {
                width_m: 2.0,
                left: &[(-wide_m / 2.0, wide_m / 2.0)],
                right: &[],
            };
            let mut world = hall.world(0.0, 92.0);
            world.start.position.x_m = 0.06;
            let run = behave_with(
                "PassDoor with { beyond_m = 0.6 }",
                world,
                seed,
                40,
                &[(sonar, dies_ms)],
            );
            let at = run.plant.pose().position;
            let end_m = libm::hypot(at.x_m, at.y_m - 1.0 - THICK_M / 2.0 - 0.6);
            let start = format!("{wide_m} m, sonar {sonar} dead at {dies_ms} ms");
            println!("{start}: {end_m:.3} m off");
            assert!(run.ended_us.is_some() && !run.failed, "{start}: {at:?}");
            assert_eq!(run.plant.collisions(), 0, "{start}");
            assert!(end_m < MOST_M, "{start}: {end_m} m");
        }
    }
}

#[test]
fn it_fails_where_there_is_no_corridor_or_no_such_door() {
    let hall = Hall {
        width_m: 2.0,
        left: &[(3.0, 3.9)],
        right: &[],
    };
    let run = behave(
        "FollowCorridor with { distance_m = 6.0, doors_left = 2 }",
        hall.world(0.0, 0.0),
        1,
        60,
    );
    assert!(run.failed);
    assert!((run.plant.pose().position.x_m - 6.0).abs() < 0.2);
    let empty = World::parse("world field\nstart 0,0 0\nwall -9,-9 9,-9 9,9 -9,9 -9,-9\n").unwrap();
    let run = behave("FollowCorridor", empty, 1, 60);
    assert!(run.failed);
}

#[test]
fn a_door_is_passed_in_its_middle() {
    const BESIDE_M: f64 = 0.12;
    const END_M: f64 = 0.12;
    const BEYOND_M: f64 = 0.6;
    for (seed, wide_m) in (1..).zip([0.7, 0.8, 0.9, 1.3]) {
        // The robot stands in the corridor before a door to its left.
        let left: &[(f64, f64)] = &[(-wide_m / 2.0, wide_m / 2.0)];
        for width_m in [1.6, 2.4] {
            let hall = Hall {
                width_m,
                left,
                right: &[],
            };
            for (y_m, aside_m, turned_deg) in [
                (0.0, 0.0, 0.0),
                (0.05, 0.1, 3.0),
                (0.0, -0.1, 3.0),
                (-0.1, 0.05, -3.0),
                (0.0, 0.15, 0.0),
            ] {
                let start = format!("{wide_m} m, {width_m} m, from {aside_m} m, {turned_deg}°");
                let mut world = hall.world(y_m, 90.0 + turned_deg);
                world.start.position.x_m = aside_m;
                let run = behave("PassDoor with { beyond_m = 0.6 }", world, seed, 30);
                assert!(run.ended_us.is_some() && !run.failed, "{start}");
                assert_eq!(run.plant.collisions(), 0, "{start}");
                let middle_m = width_m / 2.0 + THICK_M / 2.0;
                let between = run.path().map(|sample| sample.pose.position);
                let between = between.filter(|at| (at.y_m - middle_m).abs() < THICK_M);
                let beside_m = between.map(|at| at.x_m.abs()).fold(0.0, f64::max);
                let at = run.plant.pose().position;
                let end_m = libm::hypot(at.x_m, at.y_m - middle_m - BEYOND_M);
                println!("{start}: {beside_m:.3} m beside the middle, end {end_m:.3} m off");
                assert!(beside_m < BESIDE_M, "{start}: {beside_m} m");
                assert!(end_m < END_M, "{start}: {end_m} m");
            }
        }
    }
}

#[test]
fn a_door_that_is_shut_is_not_passed() {
    let hall = Hall {
        width_m: 2.0,
        left: &[],
        right: &[],
    };
    let run = behave("PassDoor", hall.world(0.0, 90.0), 1, 30);
    assert_eq!(run.plant.collisions(), 0);
    assert_eq!(run.ended_us, None, "it waits for the door");
    // Nor is a door found along the corridor.
    let run = behave("PassDoor", hall.world(0.0, 0.0), 1, 30);
    assert!(run.failed);
}

#[test]
fn an_approach_ends_before_what_it_came_to() {
    let hall = "world hall\nstart 0,0 10\nwall -1,-4 4,-4 4,4 -1,4 -1,-4\n";
    for (seed, distance_m) in (1..).zip([0.25, 0.5, 1.0]) {
        let approach = format!("Approach with {{ distance_m = {distance_m:.2} }}");
        let run = behave(&approach, World::parse(hall).unwrap(), seed, 40);
        assert!(run.ended_us.is_some() && !run.failed);
        // The rim is 0.11 m from the centre; a beam meets a wall that it looks at by 10° at right
        // angles.
        let left_m = 4.0 - run.plant.pose().position.x_m - 0.11;
        println!("{distance_m} m: {left_m:.3} m");
        assert!((left_m - distance_m).abs() < 0.04, "{left_m} m");
    }
}

#[test]
fn a_wall_is_kept_around_a_room_and_around_its_end() {
    // A room of 3 m by 3 m with a wall that ends in its middle.
    let room = "world room\nstart 0.5,0.37 0\nwall 0,0 3,0 3,3 0,3 0,0\nwall 1.45,3 1.45,1.6 1.55,1.6 1.55,3\n";
    let mirrored = "world room\nstart 0.5,2.63 0\nwall 0,0 3,0 3,3 0,3 0,0\nwall 1.45,0 1.45,1.4 1.55,1.4 1.55,0\n";
    for (seed, (world, left)) in (1..).zip([(room, false), (mirrored, true)]) {
        let along = format!("AlongWall with {{ distance_m = 11.0, left = {left} }}");
        let run = behave(&along, World::parse(world).unwrap(), seed, 120);
        assert!(
            run.ended_us.is_some() && !run.failed,
            "{left}: {:?}",
            run.plant.pose()
        );
        assert_eq!(run.plant.collisions(), 0);
        // It has been on both sides of the wall in the middle.
        let x_m = run.path().map(|sample| sample.pose.position.x_m);
        let (least_m, most_m) = x_m.fold((9.0_f64, 0.0_f64), |(least, most), x| {
            (least.min(x), most.max(x))
        });
        assert!(least_m < 0.6 && most_m > 2.4, "{least_m} to {most_m}");
    }
}

#[test]
fn who_wanders_touches_nothing_and_comes_around() {
    for seed in 1..=4 {
        let world = esm_tests::host_drive::world("office");
        let run = behave("Wander with { time_s = 60.0 }", world, seed, 90);
        assert_eq!(run.plant.collisions(), 0);
        assert!(run.ended_us.is_some_and(|ended_us| ended_us >= 60_000_000) && !run.failed);
        println!("seed {seed}: {:.1} m", run.plant.distance_m());
        assert!(run.plant.distance_m() > 5.0, "{} m", run.plant.distance_m());
    }
}

#[test]
fn an_object_is_followed_where_it_goes_and_told_where_it_is_lost() {
    // Somebody stands ahead, then half to the left and farther, and then is gone.
    let hall = "world hall\nstart 0,0 0\nwall -6,-6 6,-6 6,6 -6,6 -6,-6\n\
                person 1.0,0 0.25 to 8 s\nperson 1.2,0.8 0.25 from 8 s to 20 s\n";
    let follow = "FollowObject with { distance_m = 0.5, lost_s = 3.0 }";
    for seed in 1..=4 {
        let run = behave(follow, World::parse(hall).unwrap(), seed, 40);
        let gap_m = |t_us: u64, x_m: f64, y_m: f64| {
            let sample = run.path().find(|sample| sample.t_us == t_us).unwrap();
            let at = sample.pose.position;
            libm::hypot(at.x_m - x_m, at.y_m - y_m) - 0.25 - 0.11
        };
        let (first_m, second_m) = (gap_m(7_900_000, 1.0, 0.0), gap_m(19_900_000, 1.2, 0.8));
        println!(
            "seed {seed}: {first_m:.3} m, {second_m:.3} m, {:?}",
            run.ended_us
        );
        assert!((first_m - 0.5).abs() < 0.06, "{first_m} m");
        assert!((second_m - 0.5).abs() < 0.1, "{second_m} m");
        assert!(run.failed && run.ended_us.unwrap() < 25_000_000);
        assert_eq!(run.plant.collisions(), 0);
    }
}
