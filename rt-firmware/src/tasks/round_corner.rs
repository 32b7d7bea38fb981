//! Drives around the end of a wall to the right.

use super::values::{Ranges, Twist};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Something at 45° to the right is in the way when it is nearer than this, in metres.
const DIAGONAL_M: f32 = 0.17;

/// Drives an arc to the right, `radius_m` about where the wall has ended, and finishes when there
/// is a wall to the right again, nearer than `found_m`, or something in the way: less than
/// `ahead_m` ahead, or close at 45° to the right. What is not known is in the way, and the robot
/// stands then. As long as it has no ranges, it stands.
#[derive(Clone, Copy, Debug, Default)]
pub struct RoundCorner;

task! {
    /// Drives an arc to the right, around the end of a wall, and finishes at the next wall to the
    /// right, or where something is in the way. Without ranges it stands.
    impl RoundCorner {
        slot 2;
        wcet 300 us;
        exclusive motion;
        data {
            /// What is around the robot.
            in ranges: Ranges optional within 200 ms;
            /// How it wants to move.
            out twist: Twist;
        }
        params {
            /// How fast, in metres per second.
            speed_m_per_s: f32 = 0.2, 0.0..=0.5;
            /// Radius of the arc, in metres.
            radius_m: f32 = 0.36, 0.15..=2.0;
            /// How near a wall to the right must be, in metres from the rim.
            found_m: f32 = 0.32, 0.1..=1.0;
            /// How near ahead is in the way, in metres from the rim.
            ahead_m: f32 = 0.28, 0.1..=1.0;
        }
    }
}

impl Task for RoundCorner {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let Some(ranges) = io.try_read(Self::RANGES) else {
            *io.write(Self::TWIST) = Twist::STILL;
            return Step::Run;
        };
        let all_m = [ranges.ahead_m(), ranges.ahead_right_m(), ranges.right_m()];
        if all_m.iter().any(|range_m| *range_m <= 0.0) {
            *io.write(Self::TWIST) = Twist::STILL;
            return Step::Finished;
        }
        let speed_m_per_s = io.param(Self::SPEED_M_PER_S);
        *io.write(Self::TWIST) = Twist {
            forward_m_per_s: speed_m_per_s,
            turn_rad_per_s: -speed_m_per_s / io.param(Self::RADIUS_M),
        };
        let found = ranges.right_m() < io.param(Self::FOUND_M);
        let in_the_way = ranges.ahead_right_m() < DIAGONAL_M;
        if found || in_the_way || ranges.ahead_m() < io.param(Self::AHEAD_M) {
            Step::Finished
        } else {
            Step::Run
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;

    #[test]
    fn it_circles_until_there_is_a_wall() {
        for (ahead_m, ahead_right_m, right_m, expected) in [
            (4.0, 0.3, 4.0, Step::Run),
            (4.0, 0.3, 0.25, Step::Finished),
            (4.0, 0.1, 4.0, Step::Finished),
            (0.2, 0.3, 4.0, Step::Finished),
        ] {
            let mut ranges = Ranges::FREE;
            ranges.range_m[0] = ahead_m;
            ranges.range_m[7] = ahead_right_m;
            ranges.range_m[6] = right_m;
            let mut bench = TaskBench::new(RoundCorner);
            bench
                .param(RoundCorner::SPEED_M_PER_S, 0.2)
                .param(RoundCorner::RADIUS_M, 0.4);
            bench
                .param(RoundCorner::FOUND_M, 0.3)
                .param(RoundCorner::AHEAD_M, 0.25);
            bench.give(RoundCorner::RANGES, ranges);
            assert_eq!(bench.step(), Some(expected), "{ahead_m} {right_m}");
            let twist = bench.output(RoundCorner::TWIST).unwrap();
            assert!((twist.turn_rad_per_s * 0.4 + twist.forward_m_per_s).abs() < 1e-6);
        }
    }

    #[test]
    fn it_stands_without_ranges() {
        let mut bench = TaskBench::new(RoundCorner);
        bench
            .param(RoundCorner::SPEED_M_PER_S, 0.2)
            .param(RoundCorner::RADIUS_M, 0.4);
        bench.give(RoundCorner::RANGES, Ranges::FREE).step();
        assert_ne!(bench.output(RoundCorner::TWIST), Some(Twist::STILL));
        bench.take_away(RoundCorner::RANGES);
        assert_eq!(bench.step(), Some(Step::Run));
        assert_eq!(bench.output(RoundCorner::TWIST), Some(Twist::STILL));
    }

    #[test]
    fn what_is_not_known_is_in_the_way() {
        for sonar in [0, 6, 7] {
            let mut ranges = Ranges::FREE;
            ranges.range_m[sonar] = 0.0;
            let mut bench = TaskBench::new(RoundCorner);
            bench
                .param(RoundCorner::SPEED_M_PER_S, 0.2)
                .param(RoundCorner::RADIUS_M, 0.4);
            bench.give(RoundCorner::RANGES, ranges);
            assert_eq!(bench.step(), Some(Step::Finished), "{sonar}");
            assert_eq!(bench.output(RoundCorner::TWIST), Some(Twist::STILL));
        }
    }
}
