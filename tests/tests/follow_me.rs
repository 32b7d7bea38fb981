//! The mission that follows whoever stands before it, and somebody who walks.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use esm_tests::command::root;
use esm_tests::host_drive;
use host_tools::run::drive::Plan;

/// The radii of robot and person, in metres.
const RADII_M: f64 = 0.11 + 0.25;

/// Somebody walks 8 m at 0.1 m/s: along a wall, across, and back, and then stands.
#[test]
fn who_walks_is_followed_to_the_end_of_the_way_and_never_touched() {
    for seed in 1..=4 {
        let run = host_drive::driven(Plan {
            seed,
            until_us: Some(100_000_000),
            ..host_drive::plan(
                &root().join("missions/follow_me.esm"),
                host_drive::world("walker"),
            )
        });
        let person = run.plant.people().next().unwrap().circle.centre;
        assert_eq!((person.x_m, person.y_m), (2.0, 2.8), "seed {seed}");
        let at = run.plant.pose().position;
        let gap_m = libm::hypot(at.x_m - person.x_m, at.y_m - person.y_m) - RADII_M;
        println!(
            "seed {seed}: {gap_m:.3} m behind, {:.1} m",
            run.plant.distance_m()
        );
        assert!((gap_m - 0.5).abs() < 0.1, "seed {seed}: {gap_m} m");
        assert!(run.plant.distance_m() > 6.0, "seed {seed}");
        assert_eq!(run.plant.collisions(), 0, "seed {seed}");
    }
}
