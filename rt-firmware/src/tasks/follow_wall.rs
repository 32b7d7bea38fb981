//! Keeps a wall to the right at a distance.

use super::laws::WallSight;
use super::values::{Ranges, Twist};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Drives along a wall to its right, `distance_m` from rim to wall. It stands where it does not
/// know what is ahead, to the right, or in between. As long as it has no ranges, it stands and
/// leaves its flags as they are.
///
/// `ahead` is set while something stands less than `ahead_m` ahead, or so near at 45° to the right
/// that the robot would scrape along it, or one of the two is not known; `lost` while there is no
/// wall to the right.
#[derive(Clone, Copy, Debug, Default)]
pub struct FollowWall;

task! {
    /// Drives along a wall to its right. It stands where it does not know what is ahead or to the
    /// right.
    impl FollowWall {
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
            /// Something is in the way, or nobody knows.
            out ahead;
            /// There is no wall to the right.
            out lost;
        }
        params {
            /// How fast at most, in metres per second.
            speed_m_per_s: f32 = 0.25, 0.0..=0.5;
            /// How far from the wall to drive, in metres from the rim.
            distance_m: f32 = 0.22, 0.1..=1.0;
            /// How near ahead is in the way, in metres from the rim.
            ahead_m: f32 = 0.28, 0.1..=1.0;
        }
    }
}

impl Task for FollowWall {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let Some(ranges) = io.try_read(Self::RANGES) else {
            *io.write(Self::TWIST) = Twist::STILL;
            return Step::Run;
        };
        let distance_m = io.param(Self::DISTANCE_M);
        let all_m = [ranges.ahead_m(), ranges.ahead_right_m(), ranges.right_m()];
        let known = all_m.iter().all(|range_m| *range_m > 0.0);
        let sight = WallSight {
            beside_m: ranges.right_m(),
            diagonal_m: ranges.ahead_right_m(),
        };
        *io.write(Self::TWIST) = if known {
            Twist {
                forward_m_per_s: io.param(Self::SPEED_M_PER_S),
                turn_rad_per_s: -sight.towards_rad_per_s(distance_m),
            }
        } else {
            Twist::STILL
        };
        let scrapes = sight.scrapes(distance_m);
        io.set(
            Self::AHEAD,
            scrapes || ranges.ahead_m() < io.param(Self::AHEAD_M),
        );
        io.set(Self::LOST, sight.is_lost(distance_m));
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;
    use crate::tasks::laws::RIM_M;

    /// Ranges beside a straight wall, `distance_m` from the rim, in a direction `away_rad` off its
    /// own.
    fn beside_wall(distance_m: f32, away_rad: f32) -> Ranges {
        let centre_m = distance_m + RIM_M;
        let mut ranges = Ranges::FREE;
        ranges.range_m[6] = centre_m / libm::cosf(away_rad) - RIM_M;
        let diagonal_rad = away_rad + core::f32::consts::FRAC_PI_4;
        ranges.range_m[7] = centre_m / libm::cosf(diagonal_rad) - RIM_M;
        ranges
    }

    #[test]
    fn it_steers_back_to_its_distance_and_along_the_wall() {
        for (distance_m, away_rad, turn) in [
            (0.2, 0.0, 0.0),
            (0.3, 0.0, -1.0),
            (0.1, 0.0, 1.0),
            (0.2, 0.3, -1.0),
            (0.2, -0.3, 1.0),
        ] {
            let mut bench = TaskBench::new(FollowWall);
            bench
                .param(FollowWall::SPEED_M_PER_S, 0.25)
                .param(FollowWall::DISTANCE_M, 0.2);
            bench.param(FollowWall::AHEAD_M, 0.25);
            bench
                .give(FollowWall::RANGES, beside_wall(distance_m, away_rad))
                .step();
            let turn_rad_per_s = bench.output(FollowWall::TWIST).unwrap().turn_rad_per_s;
            if turn == 0.0 {
                assert!(turn_rad_per_s.abs() < 1e-3, "{turn_rad_per_s}");
            } else {
                assert!(
                    turn_rad_per_s * turn > 0.1,
                    "{distance_m} {away_rad}: {turn_rad_per_s}"
                );
            }
            assert!(!bench.flag(FollowWall::LOST) && !bench.flag(FollowWall::AHEAD));
        }
    }

    #[test]
    fn it_stands_without_ranges() {
        let mut bench = TaskBench::new(FollowWall);
        bench.param(FollowWall::SPEED_M_PER_S, 0.25);
        assert_eq!(bench.step(), Some(Step::Run));
        assert_eq!(bench.output(FollowWall::TWIST), Some(Twist::STILL));
        bench.give(FollowWall::RANGES, Ranges::FREE).step();
        assert_ne!(bench.output(FollowWall::TWIST), Some(Twist::STILL));
        bench.take_away(FollowWall::RANGES).step();
        assert_eq!(bench.output(FollowWall::TWIST), Some(Twist::STILL));
    }

    #[test]
    fn it_tells_what_it_cannot_follow() {
        for (ahead_m, ahead_right_m, right_m, ahead, lost) in [
            (4.0, 0.3, 0.2, false, false),
            (0.2, 0.3, 0.2, true, false),
            (4.0, 0.1, 0.2, true, false),
            (4.0, 0.3, 0.6, false, true),
            (0.2, 0.3, 4.0, true, true),
            (0.0, 0.3, 0.2, true, false),
            (4.0, 0.0, 0.2, true, false),
            (4.0, 0.3, 0.0, false, false),
        ] {
            let mut ranges = Ranges::FREE;
            ranges.range_m[0] = ahead_m;
            ranges.range_m[7] = ahead_right_m;
            ranges.range_m[6] = right_m;
            let mut bench = TaskBench::new(FollowWall);
            bench
                .param(FollowWall::DISTANCE_M, 0.2)
                .param(FollowWall::AHEAD_M, 0.25);
            bench.give(FollowWall::RANGES, ranges).step();
            assert_eq!(bench.flag(FollowWall::AHEAD), ahead, "{ahead_m} {right_m}");
            assert_eq!(bench.flag(FollowWall::LOST), lost, "{ahead_m} {right_m}");
            let known = [ahead_m, ahead_right_m, right_m]
                .iter()
                .all(|range_m| *range_m > 0.0);
            let stands = bench.output(FollowWall::TWIST) == Some(Twist::STILL);
            assert_eq!(stands, !known, "{ahead_m} {ahead_right_m} {right_m}");
        }
    }
}
