//! Backs up.

use super::values::{Pose, Ranges, Twist};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// It backs no closer than this to what is behind, in metres.
const BEHIND_M: f32 = 0.12;

/// Backs up straight and finishes after `distance_m`, or earlier where something is behind, or a
/// sonar does not know whether it is free there. As long as it has no ranges or no pose, it stands.
#[derive(Clone, Copy, Debug, Default)]
pub struct Back {
    start: Option<Pose>,
}

task! {
    /// Backs up straight for `distance_m` and finishes, or earlier where something is behind, or it
    /// is not known whether something is. Without ranges or a pose it stands.
    impl Back {
        slot 2;
        wcet 300 us;
        exclusive motion;
        data {
            /// What is around the robot.
            in ranges: Ranges optional within 200 ms;
            /// Where the robot is.
            in pose: Pose optional within 100 ms;
            /// How it wants to move.
            out twist: Twist;
        }
        params {
            /// How fast, in metres per second.
            speed_m_per_s: f32 = 0.15, 0.0..=0.3;
            /// How far, in metres.
            distance_m: f32 = 0.15, 0.0..=1.0;
        }
    }
}

impl Task for Back {
    fn enter(&mut self) {
        self.start = None;
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let (Some(ranges), Some(pose)) = (io.try_read(Self::RANGES), io.try_read(Self::POSE))
        else {
            *io.write(Self::TWIST) = Twist::STILL;
            return Step::Run;
        };
        let pose = *pose;
        let start = *self.start.get_or_insert(pose);
        let (x_m, y_m) = (pose.x_m - start.x_m, pose.y_m - start.y_m);
        let distance_m = io.param(Self::DISTANCE_M);
        let arrived = x_m * x_m + y_m * y_m >= distance_m * distance_m;
        if arrived || ranges.behind_m() < BEHIND_M {
            *io.write(Self::TWIST) = Twist::STILL;
            return Step::Finished;
        }
        *io.write(Self::TWIST) = Twist {
            forward_m_per_s: -io.param(Self::SPEED_M_PER_S),
            turn_rad_per_s: 0.0,
        };
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;

    #[test]
    fn it_stops_at_its_distance_or_before_a_wall() {
        for (behind_m, expected_steps) in [(4.0, 11), (0.1, 1), (0.0, 1)] {
            let mut ranges = Ranges::FREE;
            ranges.range_m[4] = behind_m;
            let mut bench = TaskBench::new(Back::default());
            bench
                .param(Back::SPEED_M_PER_S, 0.15)
                .param(Back::DISTANCE_M, 0.2);
            bench.give(Back::RANGES, ranges);
            let mut pose = Pose {
                x_m: 3.0,
                ..Pose::START
            };
            let finished_after = (1..100).find(|_| {
                bench.give(Back::POSE, pose);
                pose.x_m -= 0.0201;
                bench.step() == Some(Step::Finished)
            });
            assert_eq!(finished_after, Some(expected_steps), "{behind_m}");
            assert_eq!(bench.output(Back::TWIST), Some(Twist::STILL));
        }
    }

    #[test]
    fn it_stands_without_ranges_or_pose() {
        for has_pose in [true, false] {
            let mut bench = TaskBench::new(Back::default());
            bench.param(Back::SPEED_M_PER_S, 0.15);
            bench.param(Back::DISTANCE_M, 0.2);
            bench
                .give(Back::RANGES, Ranges::FREE)
                .give(Back::POSE, Pose::START);
            bench.step();
            if has_pose {
                bench.take_away(Back::RANGES);
            } else {
                bench.take_away(Back::POSE);
            }
            assert_eq!(bench.step(), Some(Step::Run), "{has_pose}");
            assert_eq!(bench.output(Back::TWIST), Some(Twist::STILL), "{has_pose}");
        }
    }

    #[test]
    fn it_drives_straight_backwards() {
        let mut bench = TaskBench::new(Back::default());
        bench
            .param(Back::SPEED_M_PER_S, 0.15)
            .param(Back::DISTANCE_M, 0.2);
        bench
            .give(Back::RANGES, Ranges::FREE)
            .give(Back::POSE, Pose::START);
        assert_eq!(bench.step(), Some(Step::Run));
        let twist = bench.output(Back::TWIST).unwrap();
        assert_eq!((twist.forward_m_per_s, twist.turn_rad_per_s), (-0.15, 0.0));
    }
}
