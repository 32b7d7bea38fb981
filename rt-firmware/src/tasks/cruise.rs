//! Drives ahead, towards free space.

use super::values::{Ranges, Twist};
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

/// Drives ahead and steers gently towards the side with more space.
///
/// `near` is set while something is nearer than `near_m` ahead, `left_freer` while there is more space on the left.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cruise;

task! {
    impl Cruise {
        slot 2;
        wcet 300 us;
        exclusive motion;
        data {
            in ranges: Ranges;
            out twist: Twist;
        }
        flags {
            out near;
            out left_freer;
        }
        params {
            speed_m_per_s: f32 = 0.3, 0.0..=0.5;
            near_m: f32 = 0.35, 0.1..=2.0;
        }
    }
}

impl Task for Cruise {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let ranges = io.read(Self::RANGES);
        let near_m = io.param(Self::NEAR_M);
        let diagonal_m = ranges.ahead_left_m().min(ranges.ahead_right_m());
        let free_m = ranges.ahead_m().min(diagonal_m / DIAGONAL_PART);
        let brake = ((free_m - near_m) / BRAKING_WAY_M).clamp(SLOWEST_PART, 1.0);
        *io.write(Self::TWIST) = Twist {
            forward_m_per_s: io.param(Self::SPEED_M_PER_S) * brake,
            turn_rad_per_s: STEERING_RAD_PER_S_M * left_surplus_m(ranges),
        };
        io.set(Self::NEAR, free_m < near_m);
        io.set(Self::LEFT_FREER, left_surplus_m(ranges) > 0.0);
        Step::Run
    }
}

/// How much more space there is on the left than on the right, in metres.
fn left_surplus_m(ranges: &Ranges) -> f32 {
    let near = |range_m: f32| range_m.min(STEERING_HORIZON_M);
    let ahead = near(ranges.ahead_left_m()) - near(ranges.ahead_right_m());
    let beside = near(ranges.left_m()) - near(ranges.right_m());
    ahead + beside / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;

    #[test]
    fn it_steers_towards_space_and_brakes_before_walls() {
        // Ranges ahead, 45° left, left, right, 45° right; then: near, left freer, faster than half, sign of the turn.
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
}
