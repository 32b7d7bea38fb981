//! Drives ahead, towards free space.

use super::values::{Bearing, Ranges, Twist};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Turning speed for each metre that one side is freer than the other.
const STEERING_RAD_PER_S_M: f32 = 0.25;

/// What is farther than this does not matter for steering.
const STEERING_HORIZON_M: f32 = 1.2;

/// The robot slows down over this way before it comes near.
const BRAKING_WAY_M: f32 = 0.5;

/// The slowest that it gets, as a part of its speed.
const SLOWEST_PART: f32 = 0.4;

/// What stands at 45° may be closer than what stands ahead, by this factor.
const DIAGONAL_PART: f32 = 0.6;

/// Drives ahead and steers gently towards the side with more space. It stands where it does not
/// know whether the way ahead is free. As long as it has no picture, or an old one, it stands and
/// leaves its flags as they are.
///
/// `near` is set while something is nearer than `near_m` ahead, or the way there is not known;
/// `left_freer` while there is more space on the left. A robot needs a sonar that looks ahead; it
/// can do without the others that are asked here.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cruise;

task! {
    /// Drives ahead and steers gently towards the side with more space. It slows down before an
    /// obstacle, and stands where the way ahead is not known, or the ranges are old.
    impl Cruise {
        slot 2;
        wcet 300 us;
        exclusive motion;
        endless;
        data {
            /// What is around the robot.
            in ranges: Ranges optional within 200 ms;
            /// How it wants to move.
            out twist: Twist;
        }
        flags {
            /// Something is nearer than `near_m` ahead, or nobody knows.
            out near;
            /// There is more space on the left than on the right.
            out left_freer;
        }
        params {
            /// How fast at most, in metres per second.
            speed_m_per_s: f32 = 0.3, 0.0..=0.5;
            /// How near is near, in metres from the rim.
            near_m: f32 = 0.35, 0.1..=2.0;
        }
    }
}

impl Task for Cruise {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let Some(ranges) = io.try_read(Self::RANGES) else {
            *io.write(Self::TWIST) = Twist::STILL;
            return Step::Run;
        };
        let near_m = io.param(Self::NEAR_M);
        let diagonal_m = (ranges.free_unless_seen_m(Bearing::AheadLeft))
            .min(ranges.free_unless_seen_m(Bearing::AheadRight));
        let free_m = ranges.ahead_m().min(diagonal_m / DIAGONAL_PART);
        let brake = ((free_m - near_m) / BRAKING_WAY_M).clamp(SLOWEST_PART, 1.0);
        let surplus_m = left_surplus_m(ranges);
        *io.write(Self::TWIST) = if free_m > 0.0 {
            Twist {
                forward_m_per_s: io.param(Self::SPEED_M_PER_S) * brake,
                turn_rad_per_s: STEERING_RAD_PER_S_M * surplus_m,
            }
        } else {
            Twist::STILL
        };
        io.set(Self::NEAR, free_m < near_m);
        io.set(Self::LEFT_FREER, surplus_m > 0.0);
        Step::Run
    }
}

/// How much more space there is on the left than on the right, in metres.
fn left_surplus_m(ranges: &Ranges) -> f32 {
    let near = |bearing| ranges.free_unless_seen_m(bearing).min(STEERING_HORIZON_M);
    let ahead = near(Bearing::AheadLeft) - near(Bearing::AheadRight);
    let beside = near(Bearing::Left) - near(Bearing::Right);
    ahead + beside / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;

    #[test]
    fn it_steers_towards_space_and_brakes_before_walls() {
        // Ranges ahead, 45° left, left, right, 45° right; then: near, left freer, faster than half,
        // sign of the turn.
        for (ranges_m, near, left_freer, fast, turn) in [
            ([4.0, 4.0, 4.0, 4.0, 4.0], false, false, true, 0.0),
            ([4.0, 4.0, 4.0, 0.4, 0.5], false, true, true, 1.0),
            ([4.0, 0.5, 0.4, 4.0, 4.0], false, false, true, -1.0),
            ([0.5, 4.0, 4.0, 4.0, 4.0], false, false, false, 0.0),
            ([0.3, 4.0, 4.0, 4.0, 4.0], true, false, false, 0.0),
            ([4.0, 0.2, 4.0, 4.0, 4.0], true, false, false, -1.0),
            ([4.0, 4.0, 4.0, 4.0, 0.2], true, true, false, 1.0),
        ] {
            let [ahead_m, ahead_left_m, left_m, right_m, ahead_right_m] = ranges_m;
            let mut ranges = Ranges::FREE;
            ranges.range_m[0] = ahead_m;
            ranges.range_m[1] = ahead_left_m;
            ranges.range_m[2] = left_m;
            ranges.range_m[6] = right_m;
            ranges.range_m[7] = ahead_right_m;
            let mut bench = TaskBench::new(Cruise);
            bench
                .param(Cruise::SPEED_M_PER_S, 0.4)
                .param(Cruise::NEAR_M, 0.35);
            bench.give(Cruise::RANGES, ranges).step();
            let twist = bench.output(Cruise::TWIST).unwrap();
            assert_eq!(bench.flag(Cruise::NEAR), near, "{ranges_m:?}");
            assert_eq!(bench.flag(Cruise::LEFT_FREER), left_freer, "{ranges_m:?}");
            assert_eq!(twist.forward_m_per_s > 0.2, fast, "{ranges_m:?} {twist:?}");
            assert!(twist.forward_m_per_s > 0.1);
            assert!(twist.turn_rad_per_s * turn > 0.0 || twist.turn_rad_per_s == turn);
        }
    }

    #[test]
    fn it_stands_without_ranges() {
        let mut bench = TaskBench::new(Cruise);
        bench.param(Cruise::SPEED_M_PER_S, 0.4);
        assert_eq!(bench.step(), Some(Step::Run));
        assert_eq!(bench.output(Cruise::TWIST), Some(Twist::STILL));
        bench.give(Cruise::RANGES, Ranges::FREE).step();
        assert_eq!(bench.output(Cruise::TWIST).unwrap().forward_m_per_s, 0.4);
        bench.take_away(Cruise::RANGES).step();
        assert_eq!(bench.output(Cruise::TWIST), Some(Twist::STILL));
    }

    #[test]
    fn it_stands_where_the_way_ahead_is_not_known() {
        // The sonar that does not know; whether the robot stands.
        for (sonar, stands) in [
            (0, true),
            (1, true),
            (7, true),
            (2, false),
            (4, false),
            (6, false),
        ] {
            let mut ranges = Ranges::FREE;
            ranges.range_m[sonar] = 0.0;
            let mut bench = TaskBench::new(Cruise);
            bench
                .param(Cruise::SPEED_M_PER_S, 0.4)
                .param(Cruise::NEAR_M, 0.35);
            bench.give(Cruise::RANGES, ranges).step();
            let twist = bench.output(Cruise::TWIST).unwrap();
            assert_eq!(twist == Twist::STILL, stands, "{sonar}: {twist:?}");
            assert_eq!(bench.flag(Cruise::NEAR), stands, "{sonar}");
        }
    }

    #[test]
    fn a_robot_with_two_sonars_drives_where_the_one_ahead_sees_space() {
        for (ahead_m, near) in [(4.0, false), (0.3, true), (0.0, true)] {
            let mut ranges = Ranges {
                sonars: 2,
                ..Ranges::FREE
            };
            ranges.bearings[1] = Bearing::Behind;
            ranges.range_m[0] = ahead_m;
            let mut bench = TaskBench::new(Cruise);
            bench
                .param(Cruise::SPEED_M_PER_S, 0.4)
                .param(Cruise::NEAR_M, 0.35);
            bench.give(Cruise::RANGES, ranges).step();
            let twist = bench.output(Cruise::TWIST).unwrap();
            assert_eq!(bench.flag(Cruise::NEAR), near, "{ahead_m}");
            assert_eq!(twist.turn_rad_per_s, 0.0, "nobody looks to the sides");
            assert_eq!(twist.forward_m_per_s > 0.0, ahead_m > 0.0, "{ahead_m}");
        }
    }
}
